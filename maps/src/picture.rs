//! Pictures of a map: from above and from aside, on paper, without a graphics card.
//!
//! Occupied voxels are drawn as shaded cubes in parallel projection, so that one scale holds all over a view. Three things
//! tell shapes apart: each side of a cube has its own light, corners between voxels are darker (ambient occlusion from the
//! eight neighbours of a face), and so is what lies behind an edge (eye-dome lighting).
//!
//! ```text
//! colour = paint · light(side) · (1 - 0.45 corner) · (1 - 0.55 mean over neighbours of min(1, Δdepth / 6 voxels))
//! ```
//!
//! The view is framed on all but the outermost 0.2 % of what is drawn on each side: a stray return must not shrink a map to a
//! dot. The same map gives the same picture, bit for bit.
//!
//! - C. Boucheny, *Interactive scientific visualization of large datasets: towards a perceptive-based approach*, thesis,
//!   Grenoble 2009 (eye-dome lighting).

mod canvas;
mod faces;
mod font;
mod legend;
mod sheet;
mod view;

use crate::voxel::{VoxelKey, VoxelMap};

pub use sheet::sheet;

/// Rows of pixels from the top, three bytes of sRGB each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green and blue of each pixel.
    pub rgb: Vec<u8>,
}

/// What the colour of a voxel tells.
#[derive(Clone, Copy)]
pub enum Paint<'a> {
    /// How high it is.
    Height,
    /// Its class, by [`crate::palette`].
    Class,
    /// The colour that a camera saw.
    Color,
    /// A figure that is not in the map itself, such as the conflict of what its sources say.
    Measure(Measure<'a>),
}

/// A figure for each voxel, drawn from low to high.
#[derive(Clone, Copy)]
pub struct Measure<'a> {
    /// What it is, as it stands in the legend: unit included, if it has one.
    pub name: &'a str,
    /// What gets the low end of the ramp; lower ones too.
    pub low: f64,
    /// What gets the high end; more than `low`.
    pub high: f64,
    /// The figure of a voxel, if it has one; those without are grey.
    pub of: &'a dyn Fn(VoxelKey) -> Option<f64>,
}

/// What to draw, and how large.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// What colours tell.
    pub paint: Paint<'a>,
    /// The line above; letters other than ASCII become boxes.
    pub title: &'a str,
    /// Pixels, each within [`Request::SIZE`].
    pub width: usize,
    /// Pixels, each within [`Request::SIZE`].
    pub height: usize,
    /// What is higher than this above the origin is not drawn: takes the ceiling off a building.
    pub ceiling_m: Option<f64>,
}

impl Request<'_> {
    /// How large a picture may be along each side.
    pub const SIZE: std::ops::RangeInclusive<usize> = 480..=8192;
}

/// Why there is no picture.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PictureError {
    /// Nothing is occupied.
    #[error("no voxel of the map is occupied: there is nothing to draw")]
    Empty,
    /// Nothing is occupied as far up as was asked for.
    #[error("no voxel is occupied below {ceiling_m} m: the lowest one reaches {lowest_m:.2} m")]
    AllAbove {
        /// What was asked for.
        ceiling_m: f64,
        /// The least that would show something.
        lowest_m: f64,
    },
    /// No voxel has what colours were to tell.
    #[error("no voxel of the map has a {0}")]
    NothingToTell(&'static str),
    /// Too small to read or too large to hold.
    #[error("a picture of {width} x {height} pixels: each must be 480 to 8192")]
    Size {
        /// What was asked for.
        width: usize,
        /// What was asked for.
        height: usize,
    },
}

/// Which voxels are drawn.
struct Drawn<'a> {
    map: &'a VoxelMap,
    /// The highest layer.
    top: i32,
}

impl<'a> Drawn<'a> {
    fn new(map: &'a VoxelMap, ceiling_m: Option<f64>) -> Self {
        let top = ceiling_m.map_or(i32::MAX, |m| {
            // A ceiling of 0.3 m is three layers of 0.1 m, whatever the rounding.
            let layers = (m / map.resolution_m() + 1e-6).floor() as i32;
            layers.saturating_sub(1)
        });
        Self { map, top }
    }

    fn has(&self, key: VoxelKey) -> bool {
        key.z <= self.top
            && self
                .map
                .voxel(key)
                .is_some_and(|voxel| voxel.log_odds.is_occupied())
    }
}

#[cfg(test)]
mod tests;
