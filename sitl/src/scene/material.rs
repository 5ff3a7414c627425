//! What surfaces look like: patterns computed from a place on the face, so that they are as fine as the picture asks.
//!
//! Every pattern knows the footprint of a pixel on the surface and leaves out what is finer (band limiting); hard edges
//! are softened over one footprint. That keeps corners in place from picture to picture, which is what features need.

#![expect(
    clippy::inline_always,
    reason = "loops over these become vector instructions only if all of them is in the loop"
)]

mod indoor;
mod outdoor;

use crate::lanes::{LANES, Lanes, lanes};
use crate::noise::{at_cell, floor, lerp, octaves_at, unit, visible};

type Colour = [f32; 3];

/// Red, green and blue of many places.
pub(crate) type Colours = [Lanes; 3];

/// `paint!(spots, spot, k => colour)`: the colour of each `spot`, the `k`th.
macro_rules! paint {
    ($spots:ident, $spot:pat, $k:ident => $colour:expr) => {{
        let mut colours = [[0.0; LANES]; 3];
        for $k in 0..LANES {
            let $spot = $spots.at($k);
            let [red, green, blue] = $colour;
            colours[0][$k] = red;
            colours[1][$k] = green;
            colours[2][$k] = blue;
        }
        colours
    }};
}
use paint;

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

/// Places on a face, in metres along its edges.
#[derive(Clone, Debug)]
pub(crate) struct Spots {
    /// Along the first edge.
    u: Lanes,
    /// Along the second edge.
    v: Lanes,
    /// Lengths of the edges.
    size: [f32; 2],
    /// How much of the surface one pixel covers.
    footprint: Lanes,
    /// The least of them.
    finest: f32,
}

/// One of them.
#[derive(Clone, Copy)]
struct Spot {
    u: f32,
    v: f32,
    footprint: f32,
}

impl Spots {
    /// Places along the edges of a face with edges of that size, and what a pixel covers there.
    #[inline(always)]
    pub(crate) fn new([u, v]: [Lanes; 2], size: [f32; 2], footprint: Lanes) -> Self {
        let finest = footprint.iter().copied().fold(f32::INFINITY, f32::min);
        Self {
            u,
            v,
            size,
            footprint,
            finest,
        }
    }

    #[inline(always)]
    fn at(&self, k: usize) -> Spot {
        Spot {
            u: self.u[k],
            v: self.v[k],
            footprint: self.footprint[k],
        }
    }

    /// Octaves of noise, so many periods to a metre along the edges and, for what is too fine to be seen, at all.
    #[inline(always)]
    fn octaves(&self, [along, across, finest]: [f32; 3], count: u32, seed: u32) -> Lanes {
        let x = lanes!(k => self.u[k] * along);
        let y = lanes!(k => self.v[k] * across);
        let footprint = lanes!(k => self.footprint[k] * finest);
        octaves_at([&x, &y, &footprint], self.finest * finest, count, seed)
    }
}

impl Material {
    /// The share of light that the surface gives back there, for red, green and blue.
    pub(crate) fn reflectance(self, spots: &Spots) -> Colours {
        match self {
            Self::Planks { seed } => indoor::planks(spots, seed),
            Self::Plaster { seed } => indoor::plaster(spots, seed),
            Self::Brick { seed } => indoor::brick(spots, seed),
            Self::Poster { seed } => indoor::poster(spots, seed),
            Self::Books { seed } => indoor::books(spots, seed),
            Self::Wood { seed } => indoor::wood(spots, seed),
            Self::Carton { seed } => indoor::carton(spots, seed),
            Self::Cloth { seed } => indoor::cloth(spots, seed),
            Self::Skin { seed } => indoor::skin(spots, seed),
            Self::Asphalt { seed } => outdoor::asphalt(spots, seed),
            Self::Marking => outdoor::marking(spots),
            Self::Paving { seed } => outdoor::paving(spots, seed),
            Self::Grass { seed } => outdoor::grass(spots, seed),
            Self::Leaves { seed } => outdoor::leaves(spots, seed),
            Self::Bark => outdoor::bark(spots),
            Self::Facade { seed } => outdoor::facade(spots, seed),
            Self::Shopfront { seed } => outdoor::shopfront(spots, seed),
            Self::Tiles { seed } => outdoor::tiles(spots, seed),
            Self::Corrugated { seed } => outdoor::corrugated(spots, seed),
            Self::Concrete { seed } => outdoor::concrete(spots, seed),
            Self::Metal { seed } => outdoor::metal(spots, seed),
            Self::Paint { seed } => outdoor::paint(spots, seed),
            Self::Glass => even([0.03, 0.035, 0.04]),
            Self::Rubber => outdoor::rubber(spots),
            Self::Lamp { is_red: true } => even([0.6, 0.06, 0.05]),
            Self::Lamp { is_red: false } => even([0.8, 0.8, 0.75]),
            Self::Sign { seed } => outdoor::sign(spots, seed),
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
#[derive(Clone, Copy)]
struct Cell {
    i: i32,
    j: i32,
    x: f32,
    y: f32,
}

#[inline(always)]
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
    #[inline(always)]
    fn random(&self, what: u32, seed: u32) -> f32 {
        unit(at_cell(
            self.i,
            self.j,
            seed.wrapping_add(what.wrapping_mul(0x51_7cc1)),
        ))
    }

    #[inline(always)]
    fn colour(&self, seed: u32) -> Colour {
        let [red, green, blue] = [10, 11, 12];
        [
            self.random(red, seed),
            self.random(green, seed),
            self.random(blue, seed),
        ]
    }
}

/// 0 below the edge, 1 above it, softened over a footprint.
#[inline(always)]
fn above(edge: f32, x: f32, footprint: f32) -> f32 {
    ((x - edge) / footprint.max(1e-4) + 0.5).clamp(0.0, 1.0)
}

/// 1 within `low..high`, 0 outside.
#[inline(always)]
fn between(low: f32, high: f32, x: f32, footprint: f32) -> f32 {
    above(low, x, footprint) * (1.0 - above(high, x, footprint))
}

#[inline(always)]
fn blend(from: Colour, to: Colour, share: f32) -> Colour {
    [
        lerp(from[0], to[0], share),
        lerp(from[1], to[1], share),
        lerp(from[2], to[2], share),
    ]
}

#[inline(always)]
fn scale(colour: Colour, factor: f32) -> Colour {
    [colour[0] * factor, colour[1] * factor, colour[2] * factor]
}

/// 1 where it is so.
#[inline(always)]
fn one_if(is_so: bool) -> f32 {
    f32::from(u8::from(is_so))
}

/// The same everywhere.
fn even(colour: Colour) -> Colours {
    colour.map(|channel| [channel; LANES])
}

/// A dot in some of the cells of a grid: 1 inside it.
#[inline(always)]
fn dots(spot: Spot, pitch: f32, share: f32, seed: u32) -> f32 {
    let cell = cell(spot.u, spot.v, pitch, pitch);
    let radius = pitch * lerp(0.1, 0.25, cell.random(2, seed));
    let x = cell.x - pitch * lerp(0.3, 0.7, cell.random(3, seed));
    let y = cell.y - pitch * lerp(0.3, 0.7, cell.random(4, seed));
    let [x, y] = [f64::from(x), f64::from(y)];
    let inside = 1.0 - above(radius, (x * x + y * y).sqrt() as f32, spot.footprint);
    let drawn = one_if(cell.random(1, seed) <= share);
    drawn * inside * visible(2.0 * radius, spot.footprint * 0.5)
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
            let greens: Vec<f32> = (0..60_i16)
                .flat_map(|block| {
                    let index = lanes!(k => block * 16 + i16::try_from(k).expect("few"));
                    let u = index.map(|i| f32::from(i % 30) * 0.011);
                    let v = index.map(|i| f32::from(i / 30) * 0.011);
                    let spots = Spots::new([u, v], [0.33, 0.33], [0.004; LANES]);
                    material.reflectance(&spots)[1]
                })
                .collect();
            assert!(
                greens.iter().all(|g| (0.0..1.6).contains(g)),
                "{material:?}"
            );
            let mean = greens.iter().sum::<f32>() / 960.0;
            let spread = (greens.iter().map(|g| (g - mean).powi(2)).sum::<f32>() / 960.0).sqrt();
            assert!(spread > 0.03, "{material:?} is flat: {spread}");
        }
    }
}
