//! What surfaces look like: patterns computed from a place on the face, so that they are as fine as the picture asks.
//!
//! Every pattern knows the footprint of a pixel on the surface and leaves out what is finer (band limiting); hard edges
//! are softened over one footprint. That keeps corners in place from picture to picture, which is what features need.

mod outdoor;

use crate::noise::{at_cell, floor, lerp, octaves, unit, visible};

type Colour = [f32; 3];

/// A kind of surface; the seed varies it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Material {
    /// A floor of wooden boards.
    Planks {
        /// Varies boards and grain.
        seed: u32,
    },
    /// A painted wall with stains and chips.
    Plaster {
        /// Varies colour and stains.
        seed: u32,
    },
    /// A wall of bricks.
    Brick {
        /// Varies the bricks.
        seed: u32,
    },
    /// A picture: coloured rectangles in a frame.
    Poster {
        /// Which picture.
        seed: u32,
    },
    /// Shelves full of books.
    Books {
        /// Which books.
        seed: u32,
    },
    /// Furniture of wood, with panels.
    Wood {
        /// Varies colour and grain.
        seed: u32,
    },
    /// A cardboard box with tape and print.
    Carton {
        /// Varies the print.
        seed: u32,
    },
    /// Checked cloth.
    Cloth {
        /// Varies colours and checks.
        seed: u32,
    },
    /// A face, with hair.
    Skin {
        /// Varies the hair.
        seed: u32,
    },
    /// A street of asphalt, with cracks, patches and stains.
    Asphalt {
        /// Varies its age.
        seed: u32,
    },
    /// White paint on a street, worn.
    Marking,
    /// A pavement of slabs.
    Paving {
        /// Varies the slabs.
        seed: u32,
    },
    /// A meadow or lawn.
    Grass {
        /// Varies its tufts.
        seed: u32,
    },
    /// A heap of leaves: a crown or a hedge.
    Leaves {
        /// Varies kind and season.
        seed: u32,
    },
    /// The bark of a tree.
    Bark,
    /// The outside wall of a house, with windows in rows.
    Facade {
        /// Varies wall, windows and curtains.
        seed: u32,
    },
    /// The ground floor of a house with shops.
    Shopfront {
        /// Varies windows and signs.
        seed: u32,
    },
    /// A roof of tiles.
    Tiles {
        /// Varies their colour.
        seed: u32,
    },
    /// Corrugated sheet metal: a warehouse or a container.
    Corrugated {
        /// Varies colour and rust.
        seed: u32,
    },
    /// Concrete, cast in panels.
    Concrete {
        /// Varies its stains.
        seed: u32,
    },
    /// Galvanised or painted metal: poles, rails, boxes.
    Metal {
        /// Varies its colour.
        seed: u32,
    },
    /// A vehicle's painted body.
    Paint {
        /// Varies its colour.
        seed: u32,
    },
    /// A vehicle's window.
    Glass,
    /// Rubber: tyres and trims.
    Rubber,
    /// A head lamp, or a tail lamp.
    Lamp {
        /// Red, not white.
        is_red: bool,
    },
    /// A traffic sign or advertisement.
    Sign {
        /// Which.
        seed: u32,
    },
}

/// A place on a face, in metres along its edges.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Along the first edge.
    pub u: f32,
    /// Along the second edge.
    pub v: f32,
    /// Lengths of the edges.
    pub size: [f32; 2],
    /// How much of the surface one pixel covers.
    pub footprint: f32,
}

impl Material {
    /// The share of light that the surface gives back there, for red, green and blue.
    pub fn reflectance(self, spot: Spot) -> Colour {
        match self {
            Self::Planks { seed } => planks(spot, seed),
            Self::Plaster { seed } => plaster(spot, seed),
            Self::Brick { seed } => brick(spot, seed),
            Self::Poster { seed } => poster(spot, seed),
            Self::Books { seed } => books(spot, seed),
            Self::Wood { seed } => wood(spot, seed),
            Self::Carton { seed } => carton(spot, seed),
            Self::Cloth { seed } => cloth(spot, seed),
            Self::Skin { seed } => skin(spot, seed),
            Self::Asphalt { seed } => outdoor::asphalt(spot, seed),
            Self::Marking => outdoor::marking(spot),
            Self::Paving { seed } => outdoor::paving(spot, seed),
            Self::Grass { seed } => outdoor::grass(spot, seed),
            Self::Leaves { seed } => outdoor::leaves(spot, seed),
            Self::Bark => outdoor::bark(spot),
            Self::Facade { seed } => outdoor::facade(spot, seed),
            Self::Shopfront { seed } => outdoor::shopfront(spot, seed),
            Self::Tiles { seed } => outdoor::tiles(spot, seed),
            Self::Corrugated { seed } => outdoor::corrugated(spot, seed),
            Self::Concrete { seed } => outdoor::concrete(spot, seed),
            Self::Metal { seed } => outdoor::metal(spot, seed),
            Self::Paint { seed } => outdoor::paint(spot, seed),
            Self::Glass => [0.03, 0.035, 0.04],
            Self::Rubber => outdoor::rubber(spot),
            Self::Lamp { is_red: true } => [0.6, 0.06, 0.05],
            Self::Lamp { is_red: false } => [0.8, 0.8, 0.75],
            Self::Sign { seed } => outdoor::sign(spot, seed),
        }
    }

    /// Whether its pattern lies on the ground as on one sheet, wherever faces begin and end.
    pub(crate) fn follows_the_world(self) -> bool {
        matches!(
            self,
            Self::Asphalt { .. } | Self::Marking | Self::Paving { .. } | Self::Grass { .. }
        )
    }

    /// How much it mirrors when looked at straight on.
    pub(crate) fn gloss(self) -> f32 {
        match self {
            Self::Glass => 0.25,
            Self::Paint { .. } => 0.06,
            Self::Lamp { .. } => 0.1,
            _ => 0.0,
        }
    }

    /// How much of a laser's light, at 905 nm, it gives back when hit straight on.
    pub(crate) fn at_905_nm(self) -> f32 {
        match self {
            Self::Grass { .. } | Self::Leaves { .. } => 0.55,
            Self::Asphalt { .. } | Self::Rubber => 0.12,
            Self::Marking => 0.6,
            Self::Sign { .. } => 0.95,
            Self::Glass => 0.05,
            Self::Paint { seed } => 0.15 + 0.5 * unit(at_cell(0, 905, seed)),
            Self::Metal { .. } | Self::Corrugated { .. } | Self::Lamp { .. } => 0.45,
            Self::Bark => 0.3,
            _ => 0.4,
        }
    }
}

/// A place within a cell of a grid: which cell, and where in it, in metres.
struct Cell {
    i: i32,
    j: i32,
    x: f32,
    y: f32,
}

fn cell(u: f32, v: f32, width: f32, height: f32) -> Cell {
    let (i, j) = (floor(u / width), floor(v / height));
    Cell {
        i,
        j,
        x: u - i as f32 * width,
        y: v - j as f32 * height,
    }
}

impl Cell {
    fn random(&self, what: u32, seed: u32) -> f32 {
        unit(at_cell(
            self.i,
            self.j,
            seed.wrapping_add(what.wrapping_mul(0x51_7cc1)),
        ))
    }

    fn colour(&self, seed: u32) -> Colour {
        [10, 11, 12].map(|channel| self.random(channel, seed))
    }
}

/// 0 below the edge, 1 above it, softened over a footprint.
fn above(edge: f32, x: f32, footprint: f32) -> f32 {
    ((x - edge) / footprint.max(1e-4) + 0.5).clamp(0.0, 1.0)
}

/// 1 within `low..high`, 0 outside.
fn between(low: f32, high: f32, x: f32, footprint: f32) -> f32 {
    above(low, x, footprint) * (1.0 - above(high, x, footprint))
}

fn blend(from: Colour, to: Colour, share: f32) -> Colour {
    [0, 1, 2].map(|c| lerp(from[c], to[c], share))
}

fn scale(colour: Colour, factor: f32) -> Colour {
    colour.map(|c| c * factor)
}

/// A dot in some of the cells of a grid: 1 inside it.
fn dots(spot: Spot, pitch: f32, share: f32, seed: u32) -> f32 {
    let cell = cell(spot.u, spot.v, pitch, pitch);
    if cell.random(1, seed) > share {
        return 0.0;
    }
    let radius = pitch * lerp(0.1, 0.25, cell.random(2, seed));
    let [x, y] = [3, 4].map(|what| pitch * lerp(0.3, 0.7, cell.random(what, seed)));
    let inside = 1.0 - above(radius, (cell.x - x).hypot(cell.y - y), spot.footprint);
    inside * visible(2.0 * radius, spot.footprint * 0.5)
}

fn planks(spot: Spot, seed: u32) -> Colour {
    let (width, length) = (0.13, 1.1);
    let row = floor(spot.v / width);
    let shift = unit(at_cell(row, 9, seed)) * length;
    let board = cell(spot.u + shift, spot.v, length, width);
    let tint = lerp(0.55, 1.05, board.random(1, seed));
    let grain = octaves(
        spot.u * 5.0 + tint * 40.0,
        spot.v * 60.0,
        4,
        spot.footprint * 30.0,
        seed,
    );
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
        tint * (1.0 + 0.55 * grain) * lerp(0.35, 1.0, gap) * (1.0 - 0.55 * knot),
    )
}

fn plaster(spot: Spot, seed: u32) -> Colour {
    let hue = cell(0.0, 0.0, 1.0, 1.0).colour(seed);
    let base = blend([0.62, 0.61, 0.57], hue, 0.25);
    let stain = octaves(spot.u * 3.0, spot.v * 3.0, 6, spot.footprint * 3.0, seed);
    let chips = dots(spot, 0.09, 0.5, seed ^ 1) - 0.6 * dots(spot, 0.05, 0.3, seed ^ 2);
    let skirting = above(0.09, spot.v, spot.footprint);
    scale(
        base,
        (1.0 + 0.5 * stain) * (1.0 - 0.5 * chips) * lerp(0.4, 1.0, skirting),
    )
}

fn brick(spot: Spot, seed: u32) -> Colour {
    let (width, height) = (0.25, 0.08);
    let row = floor(spot.v / height);
    let brick = cell(
        spot.u + 0.5 * width * row.rem_euclid(2) as f32,
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
    let rough = octaves(spot.u * 12.0, spot.v * 12.0, 4, spot.footprint * 12.0, seed);
    let pits = dots(spot, 0.06, 0.3, seed ^ 4);
    let fired = scale(
        base,
        lerp(0.6, 1.15, brick.random(2, seed)) * (1.0 - 0.5 * pits),
    );
    scale(blend([0.62, 0.6, 0.57], fired, inside), 1.0 + 0.5 * rough)
}

fn poster(spot: Spot, seed: u32) -> Colour {
    let picture = blocks(spot, 0.11, seed);
    let detail = cell(spot.u, spot.v, 0.037, 0.037);
    let chosen = if detail.random(1, seed) < 0.35 {
        1.0
    } else {
        0.0
    };
    let seen = chosen * visible(0.037, spot.footprint);
    let painted = blend(picture, detail.colour(seed), seen);
    let [width, height] = spot.size;
    let inside = between(0.025, width - 0.025, spot.u, spot.footprint)
        * between(0.025, height - 0.025, spot.v, spot.footprint);
    blend([0.12, 0.1, 0.09], painted, inside)
}

/// Cells of one colour each, with straight edges.
fn blocks(spot: Spot, pitch: f32, seed: u32) -> Colour {
    let here = cell(spot.u, spot.v, pitch, pitch);
    let colour = here.colour(seed);
    // Soften towards the neighbour on the nearer side.
    let right = above(pitch, here.x, spot.footprint);
    let next = Cell {
        i: here.i + 1,
        ..here
    };
    blend(colour, next.colour(seed), right * 0.5)
}

fn books(spot: Spot, seed: u32) -> Colour {
    let (pitch, shelf) = (0.042, 0.34);
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
}

fn wood(spot: Spot, seed: u32) -> Colour {
    let tint = cell(0.0, 0.0, 1.0, 1.0);
    let base = blend([0.42, 0.27, 0.16], [0.72, 0.62, 0.48], tint.random(1, seed));
    let grain = octaves(spot.u * 40.0, spot.v * 5.0, 4, spot.footprint * 25.0, seed);
    let panel = cell(spot.u, spot.v, 0.38, 0.23);
    let inside = between(0.012, 0.368, panel.x, spot.footprint)
        * between(0.012, 0.218, panel.y, spot.footprint);
    let handle = between(0.15, 0.23, panel.x, spot.footprint)
        * between(0.10, 0.125, panel.y, spot.footprint);
    let knot = dots(spot, 0.1, 0.3, seed ^ 8);
    scale(
        base,
        (1.0 + 0.6 * grain) * lerp(0.5, 1.0, inside) * (1.0 - 0.75 * handle) * (1.0 - 0.45 * knot),
    )
}

fn carton(spot: Spot, seed: u32) -> Colour {
    let rough = octaves(spot.u * 8.0, spot.v * 8.0, 5, spot.footprint * 8.0, seed);
    let board = scale([0.62, 0.47, 0.31], 1.0 + 0.35 * rough);
    let [width, height] = spot.size;
    let tape = between(
        height * 0.5 - 0.025,
        height * 0.5 + 0.025,
        spot.v,
        spot.footprint,
    );
    let taped = blend(board, [0.75, 0.68, 0.5], tape);
    // Print: short dark bars in rows, as text seen from afar.
    let glyph = cell(spot.u, spot.v, 0.03, 0.04);
    let inked = if glyph.random(1, seed) < 0.55 {
        0.8
    } else {
        0.0
    };
    let ink = inked
        * between(0.004, 0.024, glyph.x, spot.footprint)
        * between(0.008, 0.03, glyph.y, spot.footprint)
        * between(width * 0.1, width * 0.6, spot.u, spot.footprint)
        * between(height * 0.6, height * 0.9, spot.v, spot.footprint)
        * visible(0.03, spot.footprint);
    blend(taped, [0.1, 0.09, 0.12], ink)
}

fn cloth(spot: Spot, seed: u32) -> Colour {
    let one = cell(0.0, 0.0, 1.0, 1.0).colour(seed);
    let two = cell(1.5, 0.0, 1.0, 1.0).colour(seed);
    let check = cell(spot.u, spot.v, 0.09, 0.09);
    let across = between(0.03, 0.06, check.x, spot.footprint);
    let along = between(0.03, 0.06, check.y, spot.footprint);
    let fold = octaves(spot.u * 6.0, spot.v * 3.0, 4, spot.footprint * 5.0, seed);
    scale(blend(one, two, 0.5 * (across + along)), 0.8 + 0.5 * fold)
}

fn skin(spot: Spot, seed: u32) -> Colour {
    let hair = above(spot.size[1] * 0.72, spot.v, spot.footprint);
    let eyes = dots(spot, 0.07, 0.5, seed);
    let face = scale([0.76, 0.56, 0.45], 1.0 - 0.8 * eyes);
    blend(face, [0.15, 0.1, 0.07], hair)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_material_reflects_a_share_of_the_light_and_has_detail() {
        let seed = 5;
        let all = [
            Material::Planks { seed },
            Material::Plaster { seed },
            Material::Brick { seed },
            Material::Poster { seed },
            Material::Books { seed },
            Material::Wood { seed },
            Material::Carton { seed },
            Material::Cloth { seed },
            Material::Skin { seed },
            Material::Asphalt { seed },
            Material::Paving { seed },
            Material::Grass { seed },
            Material::Leaves { seed },
            Material::Bark,
            Material::Tiles { seed },
            Material::Corrugated { seed },
            Material::Sign { seed },
        ];
        for material in all {
            let greens: Vec<f32> = (0..900_i16)
                .map(|i| {
                    let spot = Spot {
                        u: f32::from(i % 30) * 0.011,
                        v: f32::from(i / 30) * 0.011,
                        size: [0.33, 0.33],
                        footprint: 0.004,
                    };
                    material.reflectance(spot)[1]
                })
                .collect();
            assert!(
                greens.iter().all(|g| (0.0..1.6).contains(g)),
                "{material:?}"
            );
            let mean = greens.iter().sum::<f32>() / 900.0;
            let spread = (greens.iter().map(|g| (g - mean).powi(2)).sum::<f32>() / 900.0).sqrt();
            assert!(spread > 0.03, "{material:?} is flat: {spread}");
        }
    }
}
