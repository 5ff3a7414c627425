//! The voxels that rays cross.
//!
//! Where a ray crosses the borders between voxels is computed from the ray and the border, never summed up. So a ray may skip
//! a block all of whose voxels are marked already, as most are near the sensor, and go on behind it as if it had
//! walked through: what is marked does not depend on which rays came before.

use std::ops::Range;

use super::masks::Masks;
use super::{Carving, Rays, Scan, color_of};
use crate::frame::{Point, World};
use crate::tile::TileId;
use crate::voxel::block::Mask;
use crate::voxel::grid::voxel_index;
use crate::voxel::surface::PackedColor;
use crate::voxel::{ClassId, Occupancy, VoxelKey, VoxelMap, key_at};

/// What the points of a scan, or a part of them, have touched.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gathered {
    /// Crossed by a ray. Has a mask for each block with a hit, too.
    free: Masks,
    /// With a point in it.
    hit: Masks,
    /// With the end of a ray in it that was cut at the greatest range.
    cut: Masks,
    /// The colour of the first point in each voxel that was hit.
    colors: Vec<(VoxelKey, PackedColor)>,
    /// The class of each point.
    classes: Vec<(VoxelKey, ClassId)>,
}

impl Gathered {
    pub(super) fn tiles(&self) -> impl Iterator<Item = TileId> {
        self.free.tiles()
    }

    pub(super) fn free_of(&self, id: TileId) -> impl Iterator<Item = (u16, &Mask)> {
        self.free.blocks(id)
    }

    pub(super) fn free_in(&self, id: TileId, block: u16) -> Option<&Mask> {
        self.free.get(id, block)
    }

    pub(super) fn hit_in(&self, id: TileId, block: u16) -> Option<&Mask> {
        self.hit.get(id, block)
    }

    pub(super) fn has_hit(&self, key: VoxelKey) -> bool {
        let block = crate::voxel::grid::block_index(key);
        let index = voxel_index(key);
        self.hit
            .get(TileId::of(key), block)
            .is_some_and(|mask| mask[index / 64] >> (index % 64) & 1 == 1)
    }

    pub(super) fn colors(&self) -> &[(VoxelKey, PackedColor)] {
        &self.colors
    }

    pub(super) fn classes(&self) -> &[(VoxelKey, ClassId)] {
        &self.classes
    }

    pub(super) fn clear(&mut self) {
        self.free.clear();
        self.hit.clear();
        self.cut.clear();
        self.colors.clear();
        self.classes.clear();
    }

    /// Marks what these points of the scan hit and what their rays cross.
    pub(super) fn gather(&mut self, map: &VoxelMap, scan: &Scan<'_>, points: Range<usize>) {
        let caster = Caster::new(map, scan);
        for index in points {
            let Some(end) = caster.end(scan.hits[index]) else {
                continue;
            };
            let voxel = voxel_index(end.key);
            let is_first = if end.is_cut {
                put(self.cut.of(end.key), voxel)
            } else {
                self.classes.extend(caster.class_of(index, end.key));
                let is_first = put(self.hit.of(end.key), voxel);
                if is_first {
                    let color = color_of(scan, index).map(|color| (end.key, color));
                    self.colors.extend(color);
                    let _touched = self.free.of(end.key);
                }
                is_first
            };
            match scan.rays {
                Rays::EachPoint => caster.cast(&mut self.free, end.at, &end),
                Rays::EachVoxel if is_first => {
                    let center = [end.key.x, end.key.y, end.key.z].map(|c| f64::from(c) + 0.5);
                    caster.cast(&mut self.free, center, &end);
                }
                Rays::EachVoxel => {}
            }
        }
    }
}

/// Where a ray ends: at a point, or at the greatest range.
struct End {
    /// In voxels.
    at: [f64; 3],
    key: VoxelKey,
    is_cut: bool,
}

/// Casts the rays of one scan.
struct Caster<'a> {
    map: &'a VoxelMap,
    scan: &'a Scan<'a>,
    per_m: f64,
    reach_squared: f64,
    /// The origin, in voxels, and its voxel.
    start: [f64; 3],
    from: [i32; 3],
}

impl<'a> Caster<'a> {
    fn new(map: &'a VoxelMap, scan: &'a Scan<'a>) -> Self {
        let per_m = 1.0 / map.resolution_m();
        let reach = scan.max_range_m.max(0.0); // no NaN
        let key = key_at(scan.origin, per_m);
        Self {
            map,
            scan,
            per_m,
            reach_squared: reach * reach,
            start: (scan.origin.raw.coords * per_m).into(),
            from: [key.x, key.y, key.z],
        }
    }

    /// Where the ray to a point ends; `None` if the point is to be ignored.
    fn end(&self, hit: Point<World>) -> Option<End> {
        let ray = hit - self.scan.origin;
        let squared = ray.raw.norm_squared();
        if !squared.is_finite() || hit.raw.z < self.scan.min_height_m {
            return None;
        }
        let is_cut = squared > self.reach_squared;
        let end = if is_cut {
            self.scan.origin + ray * (self.reach_squared / squared).sqrt()
        } else {
            hit
        };
        let at = [end.raw.x, end.raw.y, end.raw.z].map(|c| c * self.per_m);
        let [x, y, z] = at.map(floor);
        let key = VoxelKey { x, y, z };
        key.is_in_world().then_some(End { at, key, is_cut })
    }

    fn class_of(&self, index: usize, key: VoxelKey) -> Option<(VoxelKey, ClassId)> {
        let class = self.scan.classes.get(index)?;
        (*class != ClassId::NONE).then_some((key, *class))
    }

    /// Marks the voxels from that of the origin, included, to that of the end, excluded, on the way to a place in it.
    fn cast(&self, free: &mut Masks, towards: [f64; 3], end: &End) {
        let to = [end.key.x, end.key.y, end.key.z];
        let line = Line::new(self.start, towards);
        let steps = distance(self.from, to);
        let spared = if end.is_cut {
            0
        } else {
            self.spared(&line, to, steps)
        };
        line.mark(free, self.from, steps - spared);
    }

    /// How many of the last steps to an end mark nothing.
    fn spared(&self, line: &Line, to: [i32; 3], steps: u32) -> u32 {
        let mut spared = 0;
        if self.scan.noise != super::Noise::NONE {
            let length_m = line.length() / self.per_m;
            let share = 1.0 - self.scan.noise.margin_m(length_m) / length_m;
            let stop = line.at(share.max(0.0)).map(floor);
            spared = steps.saturating_sub(distance(self.from, stop));
        }
        if self.scan.carving == Carving::SparesSurfaces {
            spared = spared.max(self.surface_before(line, to, steps));
        }
        spared
    }

    /// How many occupied voxels the line crosses without a gap just before its end.
    fn surface_before(&self, line: &Line, to: [i32; 3], steps: u32) -> u32 {
        let back = line.reversed();
        let mut at = to;
        let mut next = std::array::from_fn(|i| back.border(i, at[i]));
        for step in 0..steps {
            let axis = nearest(next);
            at[axis] += back.step[axis];
            next[axis] = back.border(axis, at[axis]);
            let key = VoxelKey::new(at[0], at[1], at[2]);
            if self.map.occupancy(key) != Occupancy::Occupied {
                return step;
            }
        }
        steps
    }
}

/// A straight way through the voxels; positions along it count from 0 at its start to 1 at its end.
struct Line {
    start: [f64; 3],
    ray: [f64; 3],
    inverse: [f64; 3],
    step: [i32; 3],
    /// Added to a voxel's coordinate to get that of the border through which it is left.
    ahead: [i32; 3],
}

impl Line {
    fn new(start: [f64; 3], end: [f64; 3]) -> Self {
        let ray: [f64; 3] = std::array::from_fn(|i| end[i] - start[i]);
        Self {
            start,
            ray,
            inverse: ray.map(|c| 1.0 / c),
            step: ray.map(|c| if c > 0.0 { 1 } else { -1 }),
            ahead: ray.map(|c| i32::from(c > 0.0)),
        }
    }

    fn reversed(&self) -> Self {
        Self::new(self.at(1.0), self.start)
    }

    fn at(&self, position: f64) -> [f64; 3] {
        std::array::from_fn(|i| self.start[i] + self.ray[i] * position)
    }

    fn length(&self) -> f64 {
        self.ray.iter().map(|c| c * c).sum::<f64>().sqrt()
    }

    /// Where it leaves a voxel with this coordinate, or a block if that is the coordinate of its last voxel.
    fn border(&self, axis: usize, c: i32) -> f64 {
        if self.ray[axis] == 0.0 {
            return f64::INFINITY;
        }
        (f64::from(c + self.ahead[axis]) - self.start[axis]) * self.inverse[axis]
    }

    /// Marks this many voxels, the first at `from`.
    fn mark(&self, free: &mut Masks, from: [i32; 3], mut remaining: u32) {
        let mut at = from;
        while remaining > 0 {
            let mask = free.of(VoxelKey::new(at[0], at[1], at[2]));
            if mask.iter().all(|word| *word == u64::MAX) {
                let behind = self.skip_block(at);
                remaining = remaining.saturating_sub(distance(at, behind));
                at = behind;
            } else {
                (at, remaining) = self.mark_block(mask, at, remaining);
            }
        }
    }

    /// Walks from voxel to voxel until the block is left or nothing remains to be marked.
    ///
    /// The word of the slice is kept out of memory until the slice is left: steps would wait for one another's stores.
    fn mark_block(&self, mask: &mut Mask, at: [i32; 3], mut remaining: u32) -> ([i32; 3], u32) {
        let [mut next_x, mut next_y, mut next_z] = std::array::from_fn(|i| self.border(i, at[i]));
        let mut border = [0, 1, 2].map(|i| f64::from(at[i] + self.ahead[i]));
        let step = self.step.map(f64::from);
        // How many steps along each axis lead out of the block.
        let out: [i32; 3] = std::array::from_fn(|i| {
            let in_block = at[i] & 7;
            if self.ahead[i] == 1 {
                8 - in_block
            } else {
                in_block + 1
            }
        });
        let mut left = out;
        let mut place = (at[1] & 7) << 3 | at[0] & 7;
        let mut slice = (at[2] & 7) as usize;
        let mut word = mask[slice];
        loop {
            word |= 1 << (place & 63);
            remaining -= 1;
            let axis = if next_x < next_y && next_x < next_z {
                border[0] += step[0];
                next_x = (border[0] - self.start[0]) * self.inverse[0];
                place += self.step[0];
                0
            } else if next_y < next_z {
                border[1] += step[1];
                next_y = (border[1] - self.start[1]) * self.inverse[1];
                place += 8 * self.step[1];
                1
            } else {
                border[2] += step[2];
                next_z = (border[2] - self.start[2]) * self.inverse[2];
                mask[slice] = word;
                slice = (slice.wrapping_add_signed(self.step[2] as isize)) & 7;
                word = mask[slice];
                2
            };
            left[axis] -= 1;
            if left[axis] == 0 || remaining == 0 {
                break;
            }
        }
        // If the block was left along z, this is the word of the slice at its other end, unchanged.
        mask[slice] = word;
        let walked = std::array::from_fn(|i| at[i] + (out[i] - left[i]) * self.step[i]);
        (walked, remaining)
    }

    /// The first voxel behind the block that `at` is in: where [`Self::mark_block`] would come out.
    fn skip_block(&self, at: [i32; 3]) -> [i32; 3] {
        // The last voxel of the block along each axis, in the direction of the line.
        let last: [i32; 3] = std::array::from_fn(|i| (at[i] & !7) + 7 * self.ahead[i]);
        let leaves: [f64; 3] = std::array::from_fn(|i| self.border(i, last[i]));
        let axis = nearest(leaves);
        // Of borders crossed at once, the one along the later axis comes first.
        let is_crossed = |i: usize, c: i32| match self.border(i, c).partial_cmp(&leaves[axis]) {
            Some(order) => order.is_lt() || order.is_eq() && i > axis,
            None => false,
        };
        std::array::from_fn(|i| {
            if i == axis {
                return last[i] + self.step[i];
            }
            let guess = floor(self.start[i] + self.ray[i] * leaves[axis]);
            let mut c = guess.clamp(at[i].min(last[i]), at[i].max(last[i]));
            // Rounding may have put the guess on the wrong side of a border.
            while c != last[i] && is_crossed(i, c) {
                c += self.step[i];
            }
            while c != at[i] && !is_crossed(i, c - self.step[i]) {
                c -= self.step[i];
            }
            c
        })
    }
}

/// The axis whose border comes first, the later of those that tie.
fn nearest([x, y, z]: [f64; 3]) -> usize {
    if x < y && x < z {
        0
    } else if y < z {
        1
    } else {
        2
    }
}

/// The steps from one voxel to another, each across one face.
fn distance(a: [i32; 3], b: [i32; 3]) -> u32 {
    (0..3).map(|i| a[i].abs_diff(b[i])).sum()
}

/// The greatest integer not above; saturates, NaN becomes 0. `f64::floor` is a call where SSE 4.1 may be missing.
fn floor(c: f64) -> i32 {
    let towards_zero = c as i32;
    towards_zero.saturating_sub(i32::from(c < f64::from(towards_zero)))
}

/// Sets a bit; whether it was not set before.
fn put(mask: &mut Mask, index: usize) -> bool {
    let bit = 1 << (index % 64);
    let word = &mut mask[index / 64];
    let new = *word & bit == 0;
    *word |= bit;
    new
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_place() -> impl Strategy<Value = [f64; 3]> {
        // Half of them on a grid, to make ties.
        let c = prop_oneof![-40.0..40.0, (-80..80_i32).prop_map(|c| f64::from(c) / 2.0)];
        prop::array::uniform3(c)
    }

    proptest! {
        #[test]
        fn a_ray_comes_out_of_a_skipped_block_where_it_would_have_walked_out(
            start in any_place(), end in any_place()
        ) {
            let line = Line::new(start, end);
            let (mut walked, mut skipped) = (start.map(floor), start.map(floor));
            let mut remaining = distance(walked, end.map(floor));
            while remaining > 0 {
                let mut mask = crate::voxel::block::NONE;
                skipped = line.skip_block(skipped);
                (walked, remaining) = line.mark_block(&mut mask, walked, remaining);
                if remaining > 0 {
                    prop_assert_eq!(walked, skipped);
                }
            }
        }

        #[test]
        fn floor_is_floor(c in prop_oneof![-1e10..1e10, -3.0..3.0, any::<f64>()]) {
            prop_assert_eq!(floor(c), c.floor() as i32);
        }
    }
}
