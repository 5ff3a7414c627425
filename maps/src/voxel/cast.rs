//! The first occupied voxel along a ray.
//!
//! The ray goes from cube to cube: through a tile in which nothing is occupied in one step, through such a block in one
//! step, and voxel by voxel only where a block has something in it. Where a step ends is computed from the ray and the
//! border of the cube, never summed up, so that it does not matter how large the steps before it were.
//!
//! - J. Amanatides, A. Woo, *A fast voxel traversal algorithm for ray tracing*, Eurographics 1987.

use super::grid::{TileNode, block_index, voxel_index};
use super::{VoxelKey, VoxelMap, floor};
use crate::frame::{Point, Vector, World};
use crate::tile::TileId;

/// Where a ray meets an occupied voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// The voxel.
    pub key: VoxelKey,
    /// Where the ray enters it: its origin, if that is inside.
    pub point: Point<World>,
    /// From the origin of the ray to that point.
    pub distance_m: f64,
}

/// How far a step goes, as the exponent of the edge of the cube it leaves.
const VOXEL: u32 = 0;
const BLOCK: u32 = 3;
const TILE: u32 = 7;

impl VoxelMap {
    /// The first occupied voxel within `max_range_m` along a ray; unknown and free ones let it pass. `direction` needs no
    /// particular length. Takes time in the part of the ray within the bounds of the map only, so the range may be
    /// infinite and the origin outside. A ray of length zero or with a NaN meets nothing.
    pub fn cast_ray(
        &self,
        origin: Point<World>,
        direction: Vector<World>,
        max_range_m: f64,
    ) -> Option<RayHit> {
        let length = direction.norm();
        if !(length > 0.0 && length.is_finite() && origin.is_finite() && max_range_m >= 0.0) {
            return None;
        }
        let unit = direction.raw / length;
        let per_m = 1.0 / self.resolution_m();
        let ray = Ray::new((origin.raw.coords * per_m).into(), unit.into());
        let bounds = self.tile_bounds()?;
        let (enter, leave) = ray.clip(bounds)?;
        let last = leave.min(max_range_m * per_m);
        let (key, entered) = self.first_occupied(&ray, bounds, enter, last)?;
        let distance_m = entered / per_m;
        Some(RayHit {
            key,
            point: Point::from_raw(origin.raw + unit * distance_m),
            distance_m,
        })
    }

    /// Walks from `enter` to `last`, in voxels from the origin of the ray, within a box.
    fn first_occupied(
        &self,
        ray: &Ray,
        [low, high]: [[i32; 3]; 2],
        enter: f64,
        last: f64,
    ) -> Option<(VoxelKey, f64)> {
        let mut at = ray.at(enter, low, high);
        let mut entered = enter;
        let mut tile_id = None;
        let mut tile = None;
        while entered <= last {
            let key = VoxelKey::new(at[0], at[1], at[2]);
            let id = TileId::of(key);
            if tile_id != Some(id) {
                tile_id = Some(id);
                tile = self.tiles().get(id).filter(|tile| tile.is_any_occupied());
            }
            let Some(empty) = empty_around(tile, key) else {
                return Some((key, entered));
            };
            let (distance, axis) = ray.leaves(at, empty);
            let from: [i32; 3] = std::array::from_fn(|i| at[i] >> empty << empty);
            let to = from.map(|c| c + (1 << empty) - 1);
            if empty > VOXEL {
                at = ray.at(distance, from, to);
            }
            at[axis] = if ray.direction[axis] > 0.0 {
                to[axis] + 1
            } else {
                from[axis] - 1
            };
            if !(low[axis]..=high[axis]).contains(&at[axis]) {
                return None;
            }
            entered = entered.max(distance);
        }
        None
    }

    /// The least and the greatest voxel of the tiles there are.
    fn tile_bounds(&self) -> Option<[[i32; 3]; 2]> {
        let [low, high] = self.tiles().bounds()?;
        Some([
            [low.x, low.y, low.z].map(|c| c << TILE),
            [high.x, high.y, high.z].map(|c| (c << TILE) + 127),
        ])
    }
}

/// The exponent of the largest of our cubes around a voxel in which nothing is occupied; `None` if the voxel is.
fn empty_around(tile: Option<&TileNode>, key: VoxelKey) -> Option<u32> {
    let Some(tile) = tile else {
        return Some(TILE);
    };
    let at = block_index(key);
    if !tile.has_occupied(at) {
        return Some(BLOCK);
    }
    let is_occupied = tile
        .block(at)
        .is_some_and(|block| block.is_occupied(voxel_index(key)));
    (!is_occupied).then_some(VOXEL)
}

/// A ray in units of voxels.
struct Ray {
    origin: [f64; 3],
    direction: [f64; 3],
    inverse: [f64; 3],
}

impl Ray {
    fn new(origin: [f64; 3], direction: [f64; 3]) -> Self {
        Self {
            origin,
            direction,
            inverse: direction.map(|d| 1.0 / d),
        }
    }

    /// Where it enters and leaves a box of voxels; `None` if it misses it.
    fn clip(&self, [low, high]: [[i32; 3]; 2]) -> Option<(f64, f64)> {
        let mut enter = 0.0_f64;
        let mut leave = f64::INFINITY;
        for axis in 0..3 {
            let (from, to) = (f64::from(low[axis]), f64::from(high[axis]) + 1.0);
            let (origin, direction) = (self.origin[axis], self.direction[axis]);
            if direction == 0.0 {
                if !(from..to).contains(&origin) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((from - origin) / direction, (to - origin) / direction);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        (enter <= leave).then_some((enter, leave))
    }

    /// The voxel it is in after a distance, kept within a box: rounding may not lead out of the cube the ray is in.
    fn at(&self, distance: f64, low: [i32; 3], high: [i32; 3]) -> [i32; 3] {
        std::array::from_fn(|i| {
            let c = floor(self.origin[i] + self.direction[i] * distance);
            c.clamp(low[i], high[i])
        })
    }

    /// The distance at which it leaves the cube with this exponent that holds a voxel, and along which axis.
    fn leaves(&self, at: [i32; 3], exponent: u32) -> (f64, usize) {
        let to_border: [f64; 3] = std::array::from_fn(|i| {
            if self.direction[i] == 0.0 {
                return f64::INFINITY;
            }
            let upper = i32::from(self.direction[i] > 0.0);
            let border = ((at[i] >> exponent) + upper) << exponent;
            (f64::from(border) - self.origin[i]) * self.inverse[i]
        });
        let axis = nearest(to_border);
        (to_border[axis], axis)
    }
}

/// The axis whose border comes first.
fn nearest([x, y, z]: [f64; 3]) -> usize {
    if x < y {
        if x < z { 0 } else { 2 }
    } else if y < z {
        1
    } else {
        2
    }
}
