//! Bird's-eye views as evidence about voxels: coarse cells, seen from a pose that is not quite known.
//!
//! A view is 128 × 128 cells of 0.5 m around the ground vehicle, in layers of 0.5 m, each with a mass for occupied and one
//! for free. A voxel of the map gets what it may expect over all poses that the view may have been taken from:
//!
//! ```text
//! q = bev_from_world · p                      where the middle of the voxel is in the view         Eq. (16), (17)
//! Σ = J Σ_pose Jᵀ + h²/12 I,  J = [-I  [q]ₓ]     how far off that may be, h the edge of a voxel
//! m(p) = Σ_c m_c · Π_axis (Φ((bᵢ - qᵢ)/σᵢ) - Φ((aᵢ - qᵢ)/σᵢ))         over the cells c = [a, b] near q     Eq. (19)
//! ```
//!
//! Every voxel asks for the cells that it may lie in, not the other way round, and a turned voxel counts as a blot of the
//! same spread: no holes, no stairs, nothing lost. An uncertain pose spreads a wall out and thins it, so that a wall seen
//! from fifty poses becomes one thick wall, not fifty thin ones. The blots of the axes are taken as independent, which
//! keeps their widths and rounds their corners.
//!
//! [`OrientedBox`] gives a detected object's corners (Eq. 18) and voxels.
//!
//! - Li et al., *Multi-Source Heterogeneous Collaborative Perception System Based on UAV and UGV*, Drones 2026, 10(6), 470,
//!   section 3.4.3.

mod boxes;
mod normal;

use nalgebra::{Matrix6, Point3, Vector3};

use crate::evidence::{Mass, Mobility, Observation};
use crate::frame::{Bev, Isometry, Point, World};
use crate::voxel::VoxelKey;

pub use boxes::OrientedBox;
use normal::share_within;

/// The cells of a bird's-eye view.
#[derive(Clone, Debug, PartialEq)]
pub struct BevGrid {
    layers: usize,
    /// From the least z, then y, then x upwards.
    cells: Vec<BevCell>,
}

/// What a view says of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BevCell {
    /// Whether something is in it.
    pub mass: Mass,
    /// What that can do.
    pub mobility: Mobility,
}

/// A view and where it was taken from.
#[derive(Clone, Debug, PartialEq)]
pub struct BevView<'a> {
    /// The cells.
    pub grid: &'a BevGrid,
    /// The estimated pose of the view; its z is the bottom of the lowest layer.
    pub world_from_bev: Isometry<World, Bev>,
    /// How uncertain the pose is: a perturbation on the right, translation (m²) before rotation (rad²).
    pub covariance: Matrix6<f64>,
}

/// Why a view says nothing about the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BevError {
    /// The pose holds something that is no number.
    #[error("the pose of a bird's-eye view is not finite")]
    Pose,
    /// The covariance holds something that is no number, or a variance is negative.
    #[error("the covariance of a bird's-eye view's pose is not finite or has a negative variance")]
    Covariance,
    /// Too many or too few layers.
    #[error("a bird's-eye view of {0} layers; it has 1 to 32")]
    Layers(usize),
}

impl BevGrid {
    /// Cells along x and along y.
    pub const CELLS: usize = 128;
    /// The edge of a cell, and the height of a layer.
    pub const CELL_M: f64 = 0.5;
    /// The most layers.
    pub const MAX_LAYERS: usize = 32;

    /// A view that says nothing, with this many layers.
    pub fn new(layers: usize) -> Result<Self, BevError> {
        if !(1..=Self::MAX_LAYERS).contains(&layers) {
            return Err(BevError::Layers(layers));
        }
        Ok(Self {
            layers,
            cells: vec![BevCell::default(); layers * Self::CELLS * Self::CELLS],
        })
    }

    /// How many layers.
    pub fn layers(&self) -> usize {
        self.layers
    }

    /// The cell at `[x, y, layer]`: x forward and y left, each from the least coordinate. `None` outside.
    pub fn cell(&self, at: [usize; 3]) -> Option<&BevCell> {
        self.index(at).map(|index| &self.cells[index])
    }

    /// The same, to be changed.
    pub fn cell_mut(&mut self, at: [usize; 3]) -> Option<&mut BevCell> {
        self.index(at).map(|index| &mut self.cells[index])
    }

    /// The cell that holds a point of the view's frame.
    pub fn cell_at(&self, p: Point<Bev>) -> Option<[usize; 3]> {
        let [x, y, z] = Self::coordinates(&p.raw).map(f64::floor);
        // NaN and what is negative fail; what is too large is no cell.
        let is_inside = x >= 0.0 && y >= 0.0 && z >= 0.0;
        let at = [x as usize, y as usize, z as usize];
        (is_inside && self.index(at).is_some()).then_some(at)
    }

    /// In cells from the corner of the grid.
    fn coordinates(p: &Point3<f64>) -> [f64; 3] {
        let half = Self::CELLS as f64 / 2.0;
        [
            p.x / Self::CELL_M + half,
            p.y / Self::CELL_M + half,
            p.z / Self::CELL_M,
        ]
    }

    fn index(&self, [x, y, layer]: [usize; 3]) -> Option<usize> {
        let is_inside = x < Self::CELLS && y < Self::CELLS && layer < self.layers;
        is_inside.then(|| (layer * Self::CELLS + y) * Self::CELLS + x)
    }
}

/// Voxels with less than this in all are left out: an eighth of the least that a probability of one byte can say.
const LEAST_MASS: f64 = 0.0005;
/// Beyond this many deviations a cell counts nothing.
const REACH: f64 = 3.0;

impl BevView<'_> {
    /// What the view says of the voxels with edge `resolution_m` between `low` and `high`, both inclusive: each once,
    /// z above y above x, those of which it says next to nothing left out.
    pub fn observations(
        &self,
        resolution_m: f64,
        low: VoxelKey,
        high: VoxelKey,
    ) -> Result<Vec<(VoxelKey, Observation)>, BevError> {
        if !self.world_from_bev.is_finite() {
            return Err(BevError::Pose);
        }
        let variances = self.covariance.diagonal();
        if !self.covariance.iter().all(|c| c.is_finite()) || variances.min() < 0.0 {
            return Err(BevError::Covariance);
        }
        let (low, high) = self.clipped(resolution_m, low, high);
        let bev_from_world = self.world_from_bev.inverse();
        let mut seen = Vec::new();
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    let center = [x, y, z].map(|c| (f64::from(c) + 0.5) * resolution_m);
                    let p = Point::<World>::new(center[0], center[1], center[2]);
                    let found = self.at(bev_from_world * p, resolution_m);
                    seen.extend(found.map(|observation| (VoxelKey::new(x, y, z), observation)));
                }
            }
        }
        Ok(seen)
    }

    /// The part of a range of voxels that the view reaches.
    fn clipped(&self, resolution_m: f64, low: VoxelKey, high: VoxelKey) -> (VoxelKey, VoxelKey) {
        let half = BevGrid::CELL_M * BevGrid::CELLS as f64 / 2.0;
        let top = BevGrid::CELL_M * self.grid.layers as f64;
        let (mut least, mut greatest) = (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN));
        for corner in 0..8 {
            let pick =
                |bit: usize, low: f64, high: f64| if corner >> bit & 1 == 0 { low } else { high };
            let p = Point::<Bev>::new(
                pick(0, -half, half),
                pick(1, -half, half),
                pick(2, 0.0, top),
            );
            let p = (self.world_from_bev * p).raw.coords;
            (least, greatest) = (least.inf(&p), greatest.sup(&p));
        }
        // Cells are up to a blot away; what lies beyond the grid would be outside anyway.
        let key = |p: Vector3<f64>| {
            let [x, y, z] = [p.x, p.y, p.z].map(|c| (c / resolution_m).floor() as i32);
            VoxelKey::new(x, y, z)
        };
        let (least, greatest) = (key(least), key(greatest));
        (
            VoxelKey::new(low.x.max(least.x), low.y.max(least.y), low.z.max(least.z)),
            VoxelKey::new(
                high.x.min(greatest.x),
                high.y.min(greatest.y),
                high.z.min(greatest.z),
            ),
        )
    }

    /// What is expected at `q`.
    fn at(&self, q: Point<Bev>, resolution_m: f64) -> Option<Observation> {
        let deviations = self.deviations(&q.raw.coords, resolution_m);
        let middle = BevGrid::coordinates(&q.raw);
        let size = [BevGrid::CELLS, BevGrid::CELLS, self.grid.layers];
        let axes: [Span; 3] = std::array::from_fn(|axis| {
            Span::new(middle[axis], deviations[axis] / BevGrid::CELL_M, size[axis])
        });
        let (mut occupied, mut free) = (0.0, 0.0);
        let mut labels = [0.0; 4];
        for (layer, in_z) in axes[2].cells() {
            for (y, in_y) in axes[1].cells() {
                for (x, in_x) in axes[0].cells() {
                    let share = in_x * in_y * in_z;
                    let cell = &self.grid.cells[(layer * BevGrid::CELLS + y) * BevGrid::CELLS + x];
                    occupied += share * f64::from(cell.mass.occupied());
                    free += share * f64::from(cell.mass.free());
                    labels[label(cell.mobility)] += share * f64::from(cell.mass.occupied());
                }
            }
        }
        if occupied + free < LEAST_MASS {
            return None;
        }
        Some(Observation {
            mass: Mass::new(occupied as f32, free as f32)?,
            mobility: likeliest(labels),
            detection: None,
        })
    }

    /// How uncertain the place of a voxel in the view is along each axis.
    fn deviations(&self, q: &Vector3<f64>, resolution_m: f64) -> [f64; 3] {
        let footprint = resolution_m * resolution_m / 12.0;
        let covariance = &self.covariance;
        // J = [-I  [q]ₓ], row by row.
        let rows = [
            [-1.0, 0.0, 0.0, 0.0, -q.z, q.y],
            [0.0, -1.0, 0.0, q.z, 0.0, -q.x],
            [0.0, 0.0, -1.0, -q.y, q.x, 0.0],
        ];
        rows.map(|row| {
            let row = nalgebra::RowVector6::from(row);
            let variance = (row * covariance * row.transpose())[0];
            // A covariance that is not quite positive may make this negative.
            (variance.max(0.0) + footprint).sqrt()
        })
    }
}

/// The cells of one axis that a blot may lie in.
struct Span {
    middle: f64,
    deviation: f64,
    cells: std::ops::Range<usize>,
}

impl Span {
    /// All in cells; the axis has `size` of them.
    fn new(middle: f64, deviation: f64, size: usize) -> Self {
        let reach = REACH * deviation;
        // Casts saturate, so a blot beside the grid has no cells.
        let first = (middle - reach).floor().max(0.0) as usize;
        let end = ((middle + reach).ceil().max(0.0) as usize).min(size);
        Self {
            middle,
            deviation,
            cells: first.min(end)..end,
        }
    }

    /// Each cell and the share of the blot within it.
    fn cells(&self) -> impl Iterator<Item = (usize, f64)> {
        self.cells.clone().map(|cell| {
            let at = |edge: f64| (edge - self.middle) / self.deviation;
            (cell, share_within(at(cell as f64), at(cell as f64 + 1.0)))
        })
    }
}

fn label(mobility: Mobility) -> usize {
    match mobility {
        Mobility::Unknown => 0,
        Mobility::Static => 1,
        Mobility::Movable => 2,
        Mobility::Moving => 3,
    }
}

/// The label with the most mass; of equals the first.
fn likeliest(labels: [f64; 4]) -> Mobility {
    let mut best = (0.0, Mobility::Unknown);
    for mobility in [Mobility::Static, Mobility::Movable, Mobility::Moving] {
        let mass = labels[label(mobility)];
        if mass > best.0 && mass > labels[0] {
            best = (mass, mobility);
        }
    }
    best.1
}

#[cfg(test)]
mod tests;
