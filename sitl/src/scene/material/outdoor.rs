//! What a street is made of.

use super::{Cell, Colour, Spot, above, between, blend, cell, dots, scale};
use crate::noise::{at_cell, floor, lerp, octaves, unit, value, visible};

pub(super) fn asphalt(spot: Spot, seed: u32) -> Colour {
    let Spot {
        u, v, footprint, ..
    } = spot;
    let old = octaves(u * 0.35, v * 0.35, 2, footprint * 0.35, seed);
    let grit = octaves(u * 22.0, v * 22.0, 2, footprint * 22.0, seed ^ 1);
    let stains = (octaves(u * 1.1, v * 1.1, 2, footprint * 1.1, seed ^ 2) - 0.2).max(0.0);
    // Cracks are where a field crosses zero.
    let field = octaves(u * 0.6, v * 0.6, 2, footprint * 0.6, seed ^ 3);
    let crack = (1.0 - field.abs() / 0.012).max(0.0) * visible(0.06, footprint);
    let patch = cell(u, v, 5.3, 3.7);
    let patched = if patch.random(1, seed) < 0.12 {
        between(
            0.8,
            lerp(2.0, 5.0, patch.random(2, seed)),
            patch.x,
            footprint,
        ) * between(
            0.6,
            lerp(1.4, 3.3, patch.random(3, seed)),
            patch.y,
            footprint,
        )
    } else {
        0.0
    };
    let grey = 0.23 + 0.05 * old + 0.13 * grit - 0.12 * stains - 0.1 * crack;
    let grey = lerp(grey, 0.13 + 0.06 * grit, patched);
    [grey, grey * 0.99, grey * 0.96]
}

pub(super) fn marking(spot: Spot) -> Colour {
    let worn = octaves(spot.u * 9.0, spot.v * 9.0, 4, spot.footprint * 9.0, 77);
    let left = ((worn + 0.55) * 4.0).clamp(0.0, 1.0);
    blend([0.3, 0.3, 0.29], [0.84, 0.84, 0.8], left)
}

pub(super) fn paving(spot: Spot, seed: u32) -> Colour {
    let (width, height) = (0.5, 0.5);
    let shift = if floor(spot.v / height) & 1 == 0 {
        0.0
    } else {
        0.25
    };
    let slab = cell(spot.u + shift, spot.v, width, height);
    let joint = between(0.008, width - 0.008, slab.x, spot.footprint)
        * between(0.008, height - 0.008, slab.y, spot.footprint);
    let tint = lerp(0.34, 0.52, slab.random(1, seed));
    let rough = octaves(spot.u * 15.0, spot.v * 15.0, 3, spot.footprint * 15.0, seed);
    let dirt = octaves(
        spot.u * 0.7,
        spot.v * 0.7,
        3,
        spot.footprint * 0.7,
        seed ^ 5,
    );
    let gum = dots(spot, 0.17, 0.12, seed ^ 6);
    let grey =
        tint * (1.0 + 0.3 * rough + 0.25 * dirt) * lerp(0.45, 1.0, joint) * (1.0 - 0.4 * gum);
    [grey * 1.02, grey, grey * 0.94]
}

pub(super) fn grass(spot: Spot, seed: u32) -> Colour {
    let Spot {
        u, v, footprint, ..
    } = spot;
    let tufts = octaves(u * 4.0, v * 4.0, 4, footprint * 4.0, seed);
    let land = octaves(u * 0.25, v * 0.25, 3, footprint * 0.25, seed ^ 1);
    let dry = (land * 1.5 + 0.35).clamp(0.0, 1.0);
    let base = blend([0.12, 0.24, 0.06], [0.33, 0.32, 0.14], dry * 0.7);
    let flowers = dots(spot, 0.35, 0.12, seed ^ 2);
    blend(
        scale(base, 1.0 + 0.9 * tufts),
        [0.75, 0.72, 0.5],
        flowers * 0.6,
    )
}

pub(super) fn leaves(spot: Spot, seed: u32) -> Colour {
    let Spot {
        u, v, footprint, ..
    } = spot;
    let kind = unit(at_cell(3, 1, seed));
    let base = blend([0.10, 0.22, 0.05], [0.26, 0.30, 0.08], kind);
    let clumps = octaves(u * 3.0, v * 3.0, 3, footprint * 3.0, seed);
    let leaf = cell(u, v, 0.09, 0.07);
    let one = (leaf.random(1, seed) - 0.5) * visible(0.09, footprint);
    scale(base, (1.0 + 1.1 * clumps + 0.8 * one).max(0.12))
}

pub(super) fn bark(spot: Spot) -> Colour {
    let ridges = octaves(spot.u * 30.0, spot.v * 6.0, 4, spot.footprint * 25.0, 9);
    scale([0.27, 0.2, 0.14], 1.0 + 0.9 * ridges)
}

/// How windows sit in a wall.
struct Windows {
    pitch: f32,
    storey: f32,
    /// Share of the pitch and of the storey that is glass.
    width: f32,
    height: f32,
}

/// The wall itself: plaster of a colour, or bricks.
fn wall(spot: Spot, seed: u32) -> Colour {
    let pick = |what: i32| unit(at_cell(what, 0, seed));
    if pick(1) < 0.35 {
        return super::brick(spot, seed);
    }
    let colours = [
        [0.78, 0.72, 0.60],
        [0.70, 0.66, 0.62],
        [0.74, 0.55, 0.42],
        [0.58, 0.63, 0.66],
        [0.80, 0.78, 0.74],
        [0.66, 0.52, 0.45],
    ];
    let base: Colour = colours[(pick(2) * 5.99) as usize];
    let rough = octaves(spot.u * 14.0, spot.v * 14.0, 3, spot.footprint * 14.0, seed);
    // Rain leaves streaks below sills and roofs.
    let streaks = octaves(
        spot.u * 3.0,
        spot.v * 0.4,
        4,
        spot.footprint * 3.0,
        seed ^ 3,
    );
    scale(base, (1.0 + 0.14 * rough + 0.22 * streaks) * 0.85)
}

pub(super) fn facade(spot: Spot, seed: u32) -> Colour {
    let pick = |what: i32| unit(at_cell(what, 7, seed));
    let Spot {
        u,
        v,
        size: [width, height],
        footprint,
    } = spot;
    let windows = Windows {
        pitch: width / (width / lerp(1.7, 2.9, pick(0))).round().max(1.0),
        storey: height / (height / lerp(2.8, 3.3, pick(1))).round().max(1.0),
        width: lerp(0.4, 0.62, pick(2)),
        height: lerp(0.42, 0.58, pick(3)),
    };
    let place = cell(u, v, windows.pitch, windows.storey);
    let plain = wall(spot, seed);
    // A line between storeys.
    let ledge = 1.0 - above(0.12, place.y, footprint);
    let plain = blend(plain, scale(plain, 1.25), ledge * 0.7);
    if place.random(9, seed) < 0.06 || width < 1.5 {
        return plain;
    }
    let glass = [
        windows.pitch * windows.width,
        windows.storey * windows.height,
    ];
    let left = (windows.pitch - glass[0]) / 2.0;
    let bottom = windows.storey * 0.30;
    let x = place.x - left;
    let y = place.y - bottom;
    let inside = |grow: f32| {
        between(-grow, glass[0] + grow, x, footprint)
            * between(-grow, glass[1] + grow, y, footprint)
    };
    let sill = between(-0.1, glass[0] + 0.1, x, footprint) * between(-0.14, -0.06, y, footprint);
    let bare = blend(plain, [0.62, 0.6, 0.57], sill);
    let framed = blend(bare, frame(pick(4)), inside(0.07));
    blend(
        framed,
        pane([x, y], glass, &place, footprint, seed),
        inside(0.0),
    )
}

fn frame(pick: f32) -> Colour {
    if pick < 0.6 {
        [0.82, 0.82, 0.8]
    } else {
        [0.25, 0.17, 0.12]
    }
}

/// What is seen through a window: bars, curtains, a blind, the dark, a reflection of the sky.
fn pane(
    [x, y]: [f32; 2],
    [width, height]: [f32; 2],
    at: &Cell,
    footprint: f32,
    seed: u32,
) -> Colour {
    let bar = between(width * 0.5 - 0.025, width * 0.5 + 0.025, x, footprint)
        + between(height * 0.68 - 0.02, height * 0.68 + 0.02, y, footprint);
    let dark = blend(
        [0.05, 0.06, 0.08],
        [0.30, 0.36, 0.42],
        (y / height) * at.random(1, seed),
    );
    let drawn = lerp(0.0, 0.45, at.random(2, seed)) * width;
    let curtain = 1.0 - between(drawn, width - drawn, x, footprint);
    let folds = 0.55 + 0.25 * value(x * 25.0, 0.5, seed) * visible(0.06, footprint);
    let hung = blend(dark, [folds, folds, folds * 0.92], curtain * 0.8);
    let blind = above(height * lerp(0.5, 1.4, at.random(3, seed)), y, footprint);
    let covered = blend(hung, scale([0.7, 0.68, 0.6], 0.9), blind);
    // The wall's thickness shades the top of the glass.
    let recess = 1.0 - 0.5 * above(height - 0.12, y, footprint);
    blend(scale(covered, recess), [0.8, 0.8, 0.78], bar.min(1.0))
}

pub(super) fn shopfront(spot: Spot, seed: u32) -> Colour {
    let Spot {
        u,
        v,
        size: [width, height],
        footprint,
    } = spot;
    let pitch = width / (width / 4.2).round().max(1.0);
    let shop = cell(u, 0.0, pitch, 1.0);
    let sign = above(height - 0.75, v, footprint);
    let letter = cell(u, v - height + 0.55, 0.16, 0.3);
    let ink = (f32::from(u8::from(letter.random(1, seed) < 0.7)))
        * between(0.03, 0.13, letter.x, footprint)
        * between(0.05, 0.26, letter.y, footprint)
        * between(pitch * 0.2, pitch * 0.8, shop.x, footprint)
        * between(height - 0.6, height - 0.2, v, footprint)
        * visible(0.12, footprint);
    let board = scale(shop.colour(seed), 0.8);
    let board = blend(board, [0.93, 0.92, 0.88], ink);
    let goods = cell(u, v, 0.22, 0.31);
    let shown = blend(
        [0.06, 0.06, 0.07],
        goods.colour(seed ^ 3),
        0.75 * visible(0.22, footprint),
    );
    let high = (1.0 - above(1.5, v, footprint)) * 0.8 + 0.2;
    let glass = scale(shown, high);
    let opening = between(0.25, pitch - 0.25, shop.x, footprint)
        * between(
            if shop.random(4, seed) < 0.4 {
                0.05
            } else {
                0.55
            },
            height - 0.9,
            v,
            footprint,
        );
    let post = between(pitch * 0.5 - 0.04, pitch * 0.5 + 0.04, shop.x, footprint);
    let front = blend(scale(wall(spot, seed), 0.8), glass, opening * (1.0 - post));
    blend(front, board, sign)
}

pub(super) fn tiles(spot: Spot, seed: u32) -> Colour {
    let (width, height) = (0.24, 0.32);
    let tile = cell(spot.u, spot.v, width, height);
    let wave =
        0.75 + 0.35 * (1.0 - (tile.x / width * 2.0 - 1.0).abs()) * visible(width, spot.footprint);
    let lap = above(0.04, tile.y, spot.footprint);
    let kind = unit(at_cell(1, 1, seed));
    let base = if kind < 0.6 {
        [0.46, 0.22, 0.15]
    } else {
        [0.24, 0.24, 0.27]
    };
    let moss = (octaves(spot.u * 0.9, spot.v * 0.9, 3, spot.footprint * 0.9, seed) - 0.1).max(0.0);
    let fired = scale(
        base,
        lerp(0.75, 1.2, tile.random(1, seed)) * wave * lerp(0.5, 1.0, lap),
    );
    blend(fired, [0.24, 0.27, 0.15], moss)
}

pub(super) fn corrugated(spot: Spot, seed: u32) -> Colour {
    let colours = [
        [0.55, 0.57, 0.58],
        [0.20, 0.33, 0.47],
        [0.58, 0.24, 0.17],
        [0.22, 0.40, 0.30],
        [0.72, 0.70, 0.62],
        [0.70, 0.45, 0.16],
    ];
    let base: Colour = colours[(unit(at_cell(0, 4, seed)) * 5.99) as usize];
    let rib = cell(spot.u, 0.0, 0.28, 1.0).x / 0.28;
    let ribs = 1.0 + 0.35 * ((rib * 2.0 - 1.0).abs() - 0.5) * visible(0.28, spot.footprint);
    let panel = cell(spot.u, spot.v, 2.8, 2.4);
    let seam =
        between(0.02, 2.78, panel.x, spot.footprint) * between(0.02, 2.38, panel.y, spot.footprint);
    let grime = octaves(spot.u * 1.5, spot.v * 0.5, 4, spot.footprint * 1.5, seed);
    let rust = (octaves(
        spot.u * 2.0,
        spot.v * 2.0,
        4,
        spot.footprint * 2.0,
        seed ^ 8,
    ) - 0.3)
        .max(0.0)
        * 2.0;
    let painted = scale(
        base,
        ribs * (1.0 + 0.3 * grime) * lerp(0.6, 1.0, seam) * lerp(0.9, 1.1, panel.random(1, seed)),
    );
    blend(painted, [0.34, 0.2, 0.12], rust.min(0.8))
}

pub(super) fn concrete(spot: Spot, seed: u32) -> Colour {
    let panel = cell(spot.u, spot.v, 2.4, 1.2);
    let joint = between(0.012, 2.388, panel.x, spot.footprint)
        * between(0.012, 1.188, panel.y, spot.footprint);
    let cloudy = octaves(spot.u * 1.2, spot.v * 1.2, 5, spot.footprint * 1.2, seed);
    let streaks = octaves(
        spot.u * 5.0,
        spot.v * 0.3,
        3,
        spot.footprint * 5.0,
        seed ^ 2,
    );
    let holes = dots(spot, 0.11, 0.3, seed ^ 5);
    let grey =
        0.47 * (1.0 + 0.28 * cloudy + 0.2 * streaks) * lerp(0.6, 1.0, joint) * (1.0 - 0.4 * holes);
    [grey, grey * 0.98, grey * 0.94]
}

pub(super) fn metal(spot: Spot, seed: u32) -> Colour {
    let colours = [
        [0.42, 0.43, 0.44],
        [0.16, 0.24, 0.19],
        [0.30, 0.30, 0.32],
        [0.55, 0.56, 0.55],
    ];
    let base: Colour = colours[(unit(at_cell(2, 4, seed)) * 3.99) as usize];
    let worn = octaves(spot.u * 8.0, spot.v * 3.0, 4, spot.footprint * 8.0, seed);
    let sticker = dots(spot, 0.5, 0.25, seed ^ 1);
    blend(
        scale(base, 1.0 + 0.3 * worn),
        [0.8, 0.75, 0.3],
        sticker * 0.8,
    )
}

pub(super) fn paint(spot: Spot, seed: u32) -> Colour {
    let colours = [
        [0.72, 0.73, 0.74],
        [0.08, 0.08, 0.09],
        [0.35, 0.36, 0.38],
        [0.80, 0.80, 0.78],
        [0.10, 0.16, 0.36],
        [0.50, 0.07, 0.06],
        [0.14, 0.24, 0.17],
        [0.62, 0.55, 0.42],
    ];
    let base: Colour = colours[(unit(at_cell(5, 4, seed)) * 7.99) as usize];
    let dust = octaves(spot.u * 2.0, spot.v * 2.0, 3, spot.footprint * 2.0, seed);
    scale(base, 1.0 + 0.12 * dust)
}

pub(super) fn rubber(spot: Spot) -> Colour {
    let tread = value(spot.u * 30.0, spot.v * 30.0, 3) * visible(0.03, spot.footprint);
    [0.05 + 0.04 * tread; 3]
}

pub(super) fn sign(spot: Spot, seed: u32) -> Colour {
    let Spot {
        u,
        v,
        size: [width, height],
        footprint,
    } = spot;
    let pick = unit(at_cell(6, 6, seed));
    let [edge, ground, ink] = if pick < 0.35 {
        [[0.7, 0.06, 0.06], [0.9, 0.9, 0.88], [0.05, 0.05, 0.06]]
    } else if pick < 0.7 {
        [[0.9, 0.9, 0.9], [0.05, 0.16, 0.5], [0.9, 0.9, 0.9]]
    } else {
        [[0.1, 0.1, 0.1], [0.85, 0.65, 0.08], [0.08, 0.08, 0.08]]
    };
    let border = 0.08 * width.min(height);
    let inside = between(border, width - border, u, footprint)
        * between(border, height - border, v, footprint);
    let glyph = cell(u, v, width * 0.2, height * 0.25);
    let drawn = f32::from(u8::from(glyph.random(1, seed) < 0.5))
        * between(width * 0.2, width * 0.8, u, footprint)
        * between(height * 0.25, height * 0.75, v, footprint);
    blend(edge, blend(ground, ink, drawn), inside)
}
