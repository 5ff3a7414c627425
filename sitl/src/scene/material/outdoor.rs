//! What a street is made of.

use super::indoor::bricks;
use super::{
    Cell, Colour, Colours, Spot, Spots, above, between, blend, cell, dots, one_if, paint, scale,
};
use crate::lanes::{LANES, vectorised};
use crate::noise::{at_cell, floor, lerp, unit, value, visible};

vectorised! {
pub(super) fn asphalt(spots: &Spots, seed: u32) -> Colours {
    let old = spots.octaves([0.35; 3], 2, seed);
    let grit = spots.octaves([22.0; 3], 2, seed ^ 1);
    let stained = spots.octaves([1.1; 3], 2, seed ^ 2);
    let field = spots.octaves([0.6; 3], 2, seed ^ 3);
    paint!(spots, Spot { u, v, footprint }, k => {
        let stains = (stained[k] - 0.2).max(0.0);
        // Cracks are where a field crosses zero.
        let crack = (1.0 - field[k].abs() / 0.012).max(0.0) * visible(0.06, footprint);
        let patch = cell(u, v, 5.3, 3.7);
        let patched = one_if(patch.random(1, seed) < 0.12)
            * between(0.8, lerp(2.0, 5.0, patch.random(2, seed)), patch.x, footprint)
            * between(0.6, lerp(1.4, 3.3, patch.random(3, seed)), patch.y, footprint);
        let grey = 0.23 + 0.05 * old[k] + 0.13 * grit[k] - 0.12 * stains - 0.1 * crack;
        let grey = lerp(grey, 0.13 + 0.06 * grit[k], patched);
        [grey, grey * 0.99, grey * 0.96]
    })
}
}

vectorised! {
pub(super) fn marking(spots: &Spots) -> Colours {
    let worn = spots.octaves([9.0; 3], 4, 77);
    paint!(spots, _, k => {
        let left = ((worn[k] + 0.55) * 4.0).clamp(0.0, 1.0);
        blend([0.3, 0.3, 0.29], [0.84, 0.84, 0.8], left)
    })
}
}

vectorised! {
pub(super) fn paving(spots: &Spots, seed: u32) -> Colours {
    let (width, height) = (0.5, 0.5);
    let rough = spots.octaves([15.0; 3], 3, seed);
    let dirt = spots.octaves([0.7; 3], 3, seed ^ 5);
    paint!(spots, spot, k => {
        let shift = 0.25 * (floor(spot.v / height) & 1) as f32;
        let slab = cell(spot.u + shift, spot.v, width, height);
        let joint = between(0.008, width - 0.008, slab.x, spot.footprint)
            * between(0.008, height - 0.008, slab.y, spot.footprint);
        let tint = lerp(0.34, 0.52, slab.random(1, seed));
        let gum = dots(spot, 0.17, 0.12, seed ^ 6);
        let grey = tint
            * (1.0 + 0.3 * rough[k] + 0.25 * dirt[k])
            * lerp(0.45, 1.0, joint)
            * (1.0 - 0.4 * gum);
        [grey * 1.02, grey, grey * 0.94]
    })
}
}

vectorised! {
pub(super) fn grass(spots: &Spots, seed: u32) -> Colours {
    let tufts = spots.octaves([4.0; 3], 4, seed);
    let land = spots.octaves([0.25; 3], 3, seed ^ 1);
    paint!(spots, spot, k => {
        let dry = (land[k] * 1.5 + 0.35).clamp(0.0, 1.0);
        let base = blend([0.12, 0.24, 0.06], [0.33, 0.32, 0.14], dry * 0.7);
        let flowers = dots(spot, 0.35, 0.12, seed ^ 2);
        blend(
            scale(base, 1.0 + 0.9 * tufts[k]),
            [0.75, 0.72, 0.5],
            flowers * 0.6,
        )
    })
}
}

vectorised! {
pub(super) fn leaves(spots: &Spots, seed: u32) -> Colours {
    let kind = unit(at_cell(3, 1, seed));
    let base = blend([0.10, 0.22, 0.05], [0.26, 0.30, 0.08], kind);
    let clumps = spots.octaves([3.0; 3], 3, seed);
    paint!(spots, Spot { u, v, footprint }, k => {
        let leaf = cell(u, v, 0.09, 0.07);
        let one = (leaf.random(1, seed) - 0.5) * visible(0.09, footprint);
        scale(base, (1.0 + 1.1 * clumps[k] + 0.8 * one).max(0.12))
    })
}
}

vectorised! {
pub(super) fn bark(spots: &Spots) -> Colours {
    let ridges = spots.octaves([30.0, 6.0, 25.0], 4, 9);
    paint!(spots, _, k => scale([0.27, 0.2, 0.14], 1.0 + 0.9 * ridges[k]))
}
}

vectorised! {
/// The wall itself: plaster of a colour, or bricks.
fn wall(spots: &Spots, seed: u32) -> Colours {
    let [kind, colour] = [unit(at_cell(1, 0, seed)), unit(at_cell(2, 0, seed))];
    if kind < 0.35 {
        return bricks(spots, seed);
    }
    let colours = [
        [0.78, 0.72, 0.60],
        [0.70, 0.66, 0.62],
        [0.74, 0.55, 0.42],
        [0.58, 0.63, 0.66],
        [0.80, 0.78, 0.74],
        [0.66, 0.52, 0.45],
    ];
    let base: Colour = colours[(colour * 5.99) as usize];
    let rough = spots.octaves([14.0; 3], 3, seed);
    // Rain leaves streaks below sills and roofs.
    let streaks = spots.octaves([3.0, 0.4, 3.0], 4, seed ^ 3);
    paint!(spots, _, k => scale(base, (1.0 + 0.14 * rough[k] + 0.22 * streaks[k]) * 0.85))
}
}

/// How windows sit in a wall.
#[derive(Clone, Copy)]
struct Windows {
    pitch: f32,
    storey: f32,
    /// Width and height of the glass.
    glass: [f32; 2],
    frame: Colour,
    seed: u32,
}

impl Windows {
    fn of([width, height]: [f32; 2], seed: u32) -> Self {
        let pick = |what: i32| unit(at_cell(what, 7, seed));
        let pitch = width / (width / lerp(1.7, 2.9, pick(0))).round().max(1.0);
        let storey = height / (height / lerp(2.8, 3.3, pick(1))).round().max(1.0);
        let glass = [
            pitch * lerp(0.4, 0.62, pick(2)),
            storey * lerp(0.42, 0.58, pick(3)),
        ];
        let frame = if pick(4) < 0.6 {
            [0.82, 0.82, 0.8]
        } else {
            [0.25, 0.17, 0.12]
        };
        Self {
            pitch,
            storey,
            glass,
            frame,
            seed,
        }
    }
}

pub(super) fn facade(spots: &Spots, seed: u32) -> Colours {
    let windows = Windows::of(spots.size, seed);
    windowed(spots, &wall(spots, seed), windows)
}

vectorised! {
fn windowed(spots: &Spots, wall: &Colours, windows: Windows) -> Colours {
    let is_narrow = spots.size[0] < 1.5;
    let Windows { pitch, storey, glass, frame, seed } = windows;
    let left = (pitch - glass[0]) / 2.0;
    let bottom = storey * 0.30;
    paint!(spots, Spot { u, v, footprint }, k => {
        let place = cell(u, v, pitch, storey);
        let plain = [wall[0][k], wall[1][k], wall[2][k]];
        // A line between storeys.
        let ledge = 1.0 - above(0.12, place.y, footprint);
        let plain = blend(plain, scale(plain, 1.25), ledge * 0.7);
        let x = place.x - left;
        let y = place.y - bottom;
        let sill =
            between(-0.1, glass[0] + 0.1, x, footprint) * between(-0.14, -0.06, y, footprint);
        let bare = blend(plain, [0.62, 0.6, 0.57], sill);
        let in_frame = between(-0.07, glass[0] + 0.07, x, footprint)
            * between(-0.07, glass[1] + 0.07, y, footprint);
        let framed = blend(bare, frame, in_frame);
        let in_glass =
            between(0.0, glass[0], x, footprint) * between(0.0, glass[1], y, footprint);
        let window = blend(framed, pane([x, y], glass, place, footprint, seed), in_glass);
        let blind = is_narrow || place.random(9, seed) < 0.06;
        // Not a blend, which would lose the last bit.
        [
            if blind { plain[0] } else { window[0] },
            if blind { plain[1] } else { window[1] },
            if blind { plain[2] } else { window[2] },
        ]
    })
}
}

/// What is seen through a window: bars, curtains, a blind, the dark, a reflection of the sky.
#[inline(always)]
fn pane(
    [x, y]: [f32; 2],
    [width, height]: [f32; 2],
    at: Cell,
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

pub(super) fn shopfront(spots: &Spots, seed: u32) -> Colours {
    let width = spots.size[0];
    let pitch = width / (width / 4.2).round().max(1.0);
    shops(spots, &wall(spots, seed), pitch, seed)
}

vectorised! {
fn shops(spots: &Spots, wall: &Colours, pitch: f32, seed: u32) -> Colours {
    let height = spots.size[1];
    paint!(spots, Spot { u, v, footprint }, k => {
        let shop = cell(u, 0.0, pitch, 1.0);
        let sign = above(height - 0.75, v, footprint);
        let letter = cell(u, v - height + 0.55, 0.16, 0.3);
        let ink = one_if(letter.random(1, seed) < 0.7)
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
        let is_low = shop.random(4, seed) < 0.4;
        let opening = between(0.25, pitch - 0.25, shop.x, footprint)
            * between(if is_low { 0.05 } else { 0.55 }, height - 0.9, v, footprint);
        let post = between(pitch * 0.5 - 0.04, pitch * 0.5 + 0.04, shop.x, footprint);
        let plain = scale([wall[0][k], wall[1][k], wall[2][k]], 0.8);
        let front = blend(plain, glass, opening * (1.0 - post));
        blend(front, board, sign)
    })
}
}

vectorised! {
pub(super) fn tiles(spots: &Spots, seed: u32) -> Colours {
    let (width, height) = (0.24, 0.32);
    let kind = unit(at_cell(1, 1, seed));
    let base = if kind < 0.6 {
        [0.46, 0.22, 0.15]
    } else {
        [0.24, 0.24, 0.27]
    };
    let mossy = spots.octaves([0.9; 3], 3, seed);
    paint!(spots, spot, k => {
        let tile = cell(spot.u, spot.v, width, height);
        let wave = 0.75
            + 0.35 * (1.0 - (tile.x / width * 2.0 - 1.0).abs()) * visible(width, spot.footprint);
        let lap = above(0.04, tile.y, spot.footprint);
        let moss = (mossy[k] - 0.1).max(0.0);
        let fired = scale(
            base,
            lerp(0.75, 1.2, tile.random(1, seed)) * wave * lerp(0.5, 1.0, lap),
        );
        blend(fired, [0.24, 0.27, 0.15], moss)
    })
}
}

vectorised! {
pub(super) fn corrugated(spots: &Spots, seed: u32) -> Colours {
    let colours = [
        [0.55, 0.57, 0.58],
        [0.20, 0.33, 0.47],
        [0.58, 0.24, 0.17],
        [0.22, 0.40, 0.30],
        [0.72, 0.70, 0.62],
        [0.70, 0.45, 0.16],
    ];
    let base: Colour = colours[(unit(at_cell(0, 4, seed)) * 5.99) as usize];
    let grime = spots.octaves([1.5, 0.5, 1.5], 4, seed);
    let rusty = spots.octaves([2.0; 3], 4, seed ^ 8);
    paint!(spots, spot, k => {
        let rib = cell(spot.u, 0.0, 0.28, 1.0).x / 0.28;
        let ribs = 1.0 + 0.35 * ((rib * 2.0 - 1.0).abs() - 0.5) * visible(0.28, spot.footprint);
        let panel = cell(spot.u, spot.v, 2.8, 2.4);
        let seam = between(0.02, 2.78, panel.x, spot.footprint)
            * between(0.02, 2.38, panel.y, spot.footprint);
        let rust = (rusty[k] - 0.3).max(0.0) * 2.0;
        let painted = scale(
            base,
            ribs * (1.0 + 0.3 * grime[k])
                * lerp(0.6, 1.0, seam)
                * lerp(0.9, 1.1, panel.random(1, seed)),
        );
        blend(painted, [0.34, 0.2, 0.12], rust.min(0.8))
    })
}
}

vectorised! {
pub(super) fn concrete(spots: &Spots, seed: u32) -> Colours {
    let cloudy = spots.octaves([1.2; 3], 5, seed);
    let streaks = spots.octaves([5.0, 0.3, 5.0], 3, seed ^ 2);
    paint!(spots, spot, k => {
        let panel = cell(spot.u, spot.v, 2.4, 1.2);
        let joint = between(0.012, 2.388, panel.x, spot.footprint)
            * between(0.012, 1.188, panel.y, spot.footprint);
        let holes = dots(spot, 0.11, 0.3, seed ^ 5);
        let grey = 0.47
            * (1.0 + 0.28 * cloudy[k] + 0.2 * streaks[k])
            * lerp(0.6, 1.0, joint)
            * (1.0 - 0.4 * holes);
        [grey, grey * 0.98, grey * 0.94]
    })
}
}

vectorised! {
pub(super) fn metal(spots: &Spots, seed: u32) -> Colours {
    let colours = [
        [0.42, 0.43, 0.44],
        [0.16, 0.24, 0.19],
        [0.30, 0.30, 0.32],
        [0.55, 0.56, 0.55],
    ];
    let base: Colour = colours[(unit(at_cell(2, 4, seed)) * 3.99) as usize];
    let worn = spots.octaves([8.0, 3.0, 8.0], 4, seed);
    paint!(spots, spot, k => {
        let sticker = dots(spot, 0.5, 0.25, seed ^ 1);
        blend(
            scale(base, 1.0 + 0.3 * worn[k]),
            [0.8, 0.75, 0.3],
            sticker * 0.8,
        )
    })
}
}

vectorised! {
pub(super) fn paint(spots: &Spots, seed: u32) -> Colours {
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
    let dust = spots.octaves([2.0; 3], 3, seed);
    paint!(spots, _, k => scale(base, 1.0 + 0.12 * dust[k]))
}
}

vectorised! {
pub(super) fn rubber(spots: &Spots) -> Colours {
    paint!(spots, Spot { u, v, footprint }, k => {
        let tread = value(u * 30.0, v * 30.0, 3) * visible(0.03, footprint);
        [0.05 + 0.04 * tread; 3]
    })
}
}

vectorised! {
pub(super) fn sign(spots: &Spots, seed: u32) -> Colours {
    let [width, height] = spots.size;
    let pick = unit(at_cell(6, 6, seed));
    let [edge, ground, ink] = if pick < 0.35 {
        [[0.7, 0.06, 0.06], [0.9, 0.9, 0.88], [0.05, 0.05, 0.06]]
    } else if pick < 0.7 {
        [[0.9, 0.9, 0.9], [0.05, 0.16, 0.5], [0.9, 0.9, 0.9]]
    } else {
        [[0.1, 0.1, 0.1], [0.85, 0.65, 0.08], [0.08, 0.08, 0.08]]
    };
    let border = 0.08 * width.min(height);
    paint!(spots, Spot { u, v, footprint }, k => {
        let inside = between(border, width - border, u, footprint)
            * between(border, height - border, v, footprint);
        let glyph = cell(u, v, width * 0.2, height * 0.25);
        let drawn = one_if(glyph.random(1, seed) < 0.5)
            * between(width * 0.2, width * 0.8, u, footprint)
            * between(height * 0.25, height * 0.75, v, footprint);
        blend(edge, blend(ground, ink, drawn), inside)
    })
}
}
