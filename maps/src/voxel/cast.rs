//! The first occupied voxel along a ray.
//!
//! - J. Amanatides, A. Woo, *A fast voxel traversal algorithm for ray tracing*, Eurographics 1987.

use super::grid::{block_index, voxel_index};
use super::{VoxelKey, VoxelMap};
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
        let ray = Ray {
            origin: (origin.raw.coords * per_m).into(),
            direction: unit.into(),
        };
        let (low, high) = self.tile_bounds()?;
        let (enter, leave) = ray.clip([low, high])?;
        let last = leave.min(max_range_m * per_m);
        let (key, entered) = self.first_occupied(&ray, [low, high], enter, last)?;
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
        let (mut at, step, mut next, delta) = ray.start(enter, low, high);
        let mut entered = enter;
        let mut cached = None;
        while entered <= last {
            let key = VoxelKey::new(at[0], at[1], at[2]);
            let place = (TileId::of(key), block_index(key));
            let block = match cached {
                Some((same, block)) if same == place => block,
                _ => self.tiles().get(place.0).and_then(|t| t.block(place.1)),
            };
            cached = Some((place, block));
            if block.is_some_and(|block| block.is_occupied(voxel_index(key))) {
                return Some((key, entered));
            }
            let axis = nearest(next);
            at[axis] += step[axis];
            if !(low[axis]..=high[axis]).contains(&at[axis]) {
                return None;
            }
            entered = next[axis];
            next[axis] += delta[axis];
        }
        None
    }

    /// The least and the greatest voxel of the tiles there are.
    fn tile_bounds(&self) -> Option<([i32; 3], [i32; 3])> {
        self.tiles()
            .values()
            .map(|tile| {
                let low = [tile.id.x, tile.id.y, tile.id.z].map(|c| c << 7);
                (low, low.map(|c| c + 127))
            })
            .reduce(|(low, high), (l, h)| {
                (
                    std::array::from_fn(|i| low[i].min(l[i])),
                    std::array::from_fn(|i| high[i].max(h[i])),
                )
            })
    }
}

/// A ray in units of voxels.
struct Ray {
    origin: [f64; 3],
    direction: [f64; 3],
}

impl Ray {
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

    /// The voxel it is in after `enter`, the way it steps, where it leaves that voxel and how far apart the next borders
    /// are, along each axis.
    fn start(
        &self,
        enter: f64,
        low: [i32; 3],
        high: [i32; 3],
    ) -> ([i32; 3], [i32; 3], [f64; 3], [f64; 3]) {
        let at: [i32; 3] = std::array::from_fn(|i| {
            let c = (self.origin[i] + self.direction[i] * enter).floor() as i32;
            c.clamp(low[i], high[i])
        });
        let step = self.direction.map(|d| if d > 0.0 { 1 } else { -1 });
        let next = std::array::from_fn(|i| {
            let border = f64::from(at[i] + i32::from(step[i] > 0));
            if self.direction[i] == 0.0 {
                f64::INFINITY
            } else {
                (border - self.origin[i]) / self.direction[i]
            }
        });
        (at, step, next, self.direction.map(|d| 1.0 / d.abs()))
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
