//! What a room and those in it are made of, and bricks.

#![expect(
    clippy::inline_always,
    reason = "loops over these become vector instructions only if all of them is in the loop"
)]

use super::{
    Cell, Colour, Colours, Spot, Spots, above, between, blend, cell, dots, one_if, paint, scale,
};
use crate::lanes::{LANES, lanes, vectorised};
use crate::noise::{at_cell, floor, lerp, octaves_at, unit, visible};

vectorised! {
pub(super) fn planks(spots: &Spots, seed: u32) -> Colours {
    let (width, length) = (0.13, 1.1);
    let tint = lanes!(k => {
        let row = floor(spots.v[k] / width);
        let shift = unit(at_cell(row, 9, seed)) * length;
        let board = cell(spots.u[k] + shift, spots.v[k], length, width);
        lerp(0.55, 1.05, board.random(1, seed))
    });
    let x = lanes!(k => spots.u[k] * 5.0 + tint[k] * 40.0);
    let y = lanes!(k => spots.v[k] * 60.0);
    let footprint = lanes!(k => spots.footprint[k] * 30.0);
    let grain = octaves_at([&x, &y, &footprint], spots.finest * 30.0, 4, seed);
    paint!(spots, spot, k => {
        let row = floor(spot.v / width);
        let shift = unit(at_cell(row, 9, seed)) * length;
        let board = cell(spot.u + shift, spot.v, length, width);
        let gap = between(0.004, width - 0.004, board.y, spot.footprint)
            * between(0.003, length - 0.003, board.x, spot.footprint);
        let knot = dots(spot, 0.11, 0.35, seed ^ 0xa1);
        let base = blend(
            [0.56, 0.40, 0.25],
            [0.48, 0.36, 0.27],
            board.random(2, seed),
        );
        scale(
            base,
            tint[k] * (1.0 + 0.55 * grain[k]) * lerp(0.35, 1.0, gap) * (1.0 - 0.55 * knot),
        )
    })
}
}

vectorised! {
pub(super) fn plaster(spots: &Spots, seed: u32) -> Colours {
    let hue = cell(0.0, 0.0, 1.0, 1.0).colour(seed);
    let base = blend([0.62, 0.61, 0.57], hue, 0.25);
    let stain = spots.octaves([3.0; 3], 6, seed);
    paint!(spots, spot, k => {
        let chips = dots(spot, 0.09, 0.5, seed ^ 1) - 0.6 * dots(spot, 0.05, 0.3, seed ^ 2);
        let skirting = above(0.09, spot.v, spot.footprint);
        scale(
            base,
            (1.0 + 0.5 * stain[k]) * (1.0 - 0.5 * chips) * lerp(0.4, 1.0, skirting),
        )
    })
}
}

vectorised! {
pub(super) fn brick(spots: &Spots, seed: u32) -> Colours {
    bricks(spots, seed)
}
}

#[inline(always)]
pub(super) fn bricks(spots: &Spots, seed: u32) -> Colours {
    let (width, height) = (0.25, 0.08);
    let rough = spots.octaves([12.0; 3], 4, seed);
    paint!(spots, spot, k => {
        let row = floor(spot.v / height);
        let brick = cell(
            spot.u + 0.5 * width * (row & 1) as f32,
            spot.v,
            width,
            height,
        );
        let inside = between(0.006, width - 0.006, brick.x, spot.footprint)
            * between(0.006, height - 0.006, brick.y, spot.footprint);
        let base = blend(
            [0.52, 0.25, 0.18],
            [0.66, 0.46, 0.34],
            brick.random(1, seed),
        );
        let pits = dots(spot, 0.06, 0.3, seed ^ 4);
        let fired = scale(
            base,
            lerp(0.6, 1.15, brick.random(2, seed)) * (1.0 - 0.5 * pits),
        );
        scale(blend([0.62, 0.6, 0.57], fired, inside), 1.0 + 0.5 * rough[k])
    })
}

vectorised! {
pub(super) fn poster(spots: &Spots, seed: u32) -> Colours {
    let [width, height] = spots.size;
    paint!(spots, spot, k => {
        let picture = blocks(spot, 0.11, seed);
        let detail = cell(spot.u, spot.v, 0.037, 0.037);
        let chosen = one_if(detail.random(1, seed) < 0.35);
        let seen = chosen * visible(0.037, spot.footprint);
        let painted = blend(picture, detail.colour(seed), seen);
        let inside = between(0.025, width - 0.025, spot.u, spot.footprint)
            * between(0.025, height - 0.025, spot.v, spot.footprint);
        blend([0.12, 0.1, 0.09], painted, inside)
    })
}
}

/// Cells of one colour each, with straight edges.
#[inline(always)]
fn blocks(spot: Spot, pitch: f32, seed: u32) -> Colour {
    let here = cell(spot.u, spot.v, pitch, pitch);
    let colour = here.colour(seed);
    // Soften towards the neighbour on the nearer side.
    let right = above(pitch, here.x, spot.footprint);
    let next = Cell {
        i: here.i.wrapping_add(1),
        ..here
    };
    blend(colour, next.colour(seed), right * 0.5)
}

vectorised! {
pub(super) fn books(spots: &Spots, seed: u32) -> Colours {
    let (pitch, shelf) = (0.042, 0.34);
    paint!(spots, spot, k => {
        let book = cell(spot.u, spot.v, pitch, shelf);
        let board = 1.0 - above(0.025, book.y, spot.footprint);
        let top = lerp(0.2, 0.31, book.random(1, seed));
        let within = (1.0 - above(top, book.y, spot.footprint))
            * between(0.002, pitch - 0.002, book.x, spot.footprint);
        let label = lerp(0.08, 0.15, book.random(2, seed));
        let labelled =
            between(label, label + 0.035, book.y, spot.footprint) * visible(0.035, spot.footprint);
        let spine = blend(
            scale(book.colour(seed), 0.75),
            [0.85, 0.82, 0.7],
            labelled * 0.8,
        );
        let shelved = blend([0.06, 0.05, 0.05], spine, within);
        blend(shelved, [0.45, 0.33, 0.22], board)
    })
}
}

vectorised! {
pub(super) fn wood(spots: &Spots, seed: u32) -> Colours {
    let tint = cell(0.0, 0.0, 1.0, 1.0);
    let base = blend([0.42, 0.27, 0.16], [0.72, 0.62, 0.48], tint.random(1, seed));
    let grain = spots.octaves([40.0, 5.0, 25.0], 4, seed);
    paint!(spots, spot, k => {
        let panel = cell(spot.u, spot.v, 0.38, 0.23);
        let inside = between(0.012, 0.368, panel.x, spot.footprint)
            * between(0.012, 0.218, panel.y, spot.footprint);
        let handle = between(0.15, 0.23, panel.x, spot.footprint)
            * between(0.10, 0.125, panel.y, spot.footprint);
        let knot = dots(spot, 0.1, 0.3, seed ^ 8);
        scale(
            base,
            (1.0 + 0.6 * grain[k]) * lerp(0.5, 1.0, inside) * (1.0 - 0.75 * handle)
                * (1.0 - 0.45 * knot),
        )
    })
}
}

vectorised! {
pub(super) fn carton(spots: &Spots, seed: u32) -> Colours {
    let rough = spots.octaves([8.0; 3], 5, seed);
    let [width, height] = spots.size;
    paint!(spots, spot, k => {
        let board = scale([0.62, 0.47, 0.31], 1.0 + 0.35 * rough[k]);
        let tape = between(
            height * 0.5 - 0.025,
            height * 0.5 + 0.025,
            spot.v,
            spot.footprint,
        );
        let taped = blend(board, [0.75, 0.68, 0.5], tape);
        // Print: short dark bars in rows, as text seen from afar.
        let glyph = cell(spot.u, spot.v, 0.03, 0.04);
        let inked = 0.8 * one_if(glyph.random(1, seed) < 0.55);
        let ink = inked
            * between(0.004, 0.024, glyph.x, spot.footprint)
            * between(0.008, 0.03, glyph.y, spot.footprint)
            * between(width * 0.1, width * 0.6, spot.u, spot.footprint)
            * between(height * 0.6, height * 0.9, spot.v, spot.footprint)
            * visible(0.03, spot.footprint);
        blend(taped, [0.1, 0.09, 0.12], ink)
    })
}
}

vectorised! {
pub(super) fn cloth(spots: &Spots, seed: u32) -> Colours {
    let one = cell(0.0, 0.0, 1.0, 1.0).colour(seed);
    let two = cell(1.5, 0.0, 1.0, 1.0).colour(seed);
    let fold = spots.octaves([6.0, 3.0, 5.0], 4, seed);
    paint!(spots, spot, k => {
        let check = cell(spot.u, spot.v, 0.09, 0.09);
        let across = between(0.03, 0.06, check.x, spot.footprint);
        let along = between(0.03, 0.06, check.y, spot.footprint);
        scale(blend(one, two, 0.5 * (across + along)), 0.8 + 0.5 * fold[k])
    })
}
}

vectorised! {
pub(super) fn skin(spots: &Spots, seed: u32) -> Colours {
    let hairline = spots.size[1] * 0.72;
    paint!(spots, spot, k => {
        let hair = above(hairline, spot.v, spot.footprint);
        let eyes = dots(spot, 0.07, 0.5, seed);
        let face = scale([0.76, 0.56, 0.45], 1.0 - 0.8 * eyes);
        blend(face, [0.15, 0.1, 0.07], hair)
    })
}
}
