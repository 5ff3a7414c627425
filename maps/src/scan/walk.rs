//! A straight walk from voxel to voxel.
//!
//! Where it crosses borders is counted in whole numbers, of which [`WHOLE`] make its length, so that adding them up is exact.
//! So a walk may skip a block all of whose voxels are marked already, as most are near the sensor, and go on behind it as if
//! it had walked through: what is marked does not depend on which rays came before.

use super::masks::Masks;
use crate::voxel::VoxelKey;
use crate::voxel::block::Mask;

/// The length of a walk. Rounding moves a border by less than 1e-9 voxels over ten thousand.
const WHOLE: f64 = (1_u64 << 56) as f64;
/// A border that is not crossed, or not twice: no sum along a walk overflows.
const NEVER: i64 = 1 << 60;
const FAR: i64 = 1 << 58;

/// Where a walk is.
pub(super) struct Walk {
    at: [i32; 3],
    /// Where it crosses the next border along each axis.
    next: [i64; 3],
    /// From a border to the one after.
    each: [i64; 3],
    /// Borders along each axis by places of the walk.
    per_place: [f64; 3],
    /// Towards which neighbour.
    step: [i32; 3],
}

impl Walk {
    /// From `start`, in voxel `from`, to `end`; all in voxels.
    pub(super) fn new(start: [f64; 3], from: [i32; 3], end: [f64; 3]) -> Self {
        let ray: [f64; 3] = std::array::from_fn(|i| end[i] - start[i]);
        let inverse = ray.map(|c| WHOLE / c);
        let next = |i: usize| {
            let border = f64::from(from[i] + i32::from(ray[i] > 0.0));
            // Infinite along an axis that the walk does not follow; then it could be no number.
            if inverse[i].is_finite() {
                (((border - start[i]) * inverse[i]) as i64).min(NEVER)
            } else {
                NEVER
            }
        };
        Self {
            at: from,
            next: std::array::from_fn(next),
            each: inverse.map(|c| (c.abs() as i64).min(FAR)),
            per_place: ray.map(|c| c.abs() / WHOLE),
            step: ray.map(|c| if c > 0.0 { 1 } else { -1 }),
        }
    }

    /// Goes to the next voxel.
    pub(super) fn advance(&mut self) -> VoxelKey {
        let axis = nearest(self.next);
        self.at[axis] += self.step[axis];
        self.next[axis] += self.each[axis];
        self.key()
    }

    fn key(&self) -> VoxelKey {
        VoxelKey::new(self.at[0], self.at[1], self.at[2])
    }

    /// Marks this many voxels, from the one it is in.
    pub(super) fn mark(&mut self, free: &mut Masks, mut remaining: u32) {
        while remaining > 0 {
            let mask = free.of(self.key());
            remaining = if mask.iter().all(|word| *word == u64::MAX) {
                remaining.saturating_sub(self.skip_block())
            } else {
                self.mark_block(mask, remaining)
            };
        }
    }

    /// How many steps along each axis lead out of the block, from 1 to 8.
    fn to_leave(&self) -> [i32; 3] {
        std::array::from_fn(|i| {
            let in_block = self.at[i] & 7;
            if self.step[i] > 0 {
                8 - in_block
            } else {
                in_block + 1
            }
        })
    }

    /// Walks until the block is left or nothing remains to be marked, and returns what does.
    ///
    /// The word of the slice is kept out of memory until the slice is left: steps would wait for one another's stores.
    fn mark_block(&mut self, mask: &mut Mask, mut remaining: u32) -> u32 {
        let (step, [each_x, each_y, each_z]) = (self.step, self.each);
        let [mut next_x, mut next_y, mut next_z] = self.next;
        let to_leave = self.to_leave();
        let [mut left_x, mut left_y, mut left_z] = to_leave;
        let mut place = (self.at[1] & 7) << 3 | self.at[0] & 7;
        let mut slice = (self.at[2] & 7) as usize;
        let mut word = mask[slice];
        loop {
            word |= 1 << (place & 63);
            remaining -= 1;
            let left = if next_z <= next_x.min(next_y) {
                next_z += each_z;
                mask[slice] = word;
                slice = slice.wrapping_add_signed(step[2] as isize) & 7;
                word = mask[slice];
                left_z -= 1;
                left_z
            } else if next_x < next_y {
                next_x += each_x;
                place += step[0];
                left_x -= 1;
                left_x
            } else {
                next_y += each_y;
                place += 8 * step[1];
                left_y -= 1;
                left_y
            };
            if left == 0 || remaining == 0 {
                break;
            }
        }
        // If the block was left along z, this is the word of the slice at its other end, unchanged.
        mask[slice] = word;
        self.next = [next_x, next_y, next_z];
        let left = [left_x, left_y, left_z];
        for i in 0..3 {
            self.at[i] += step[i] * (to_leave[i] - left[i]);
        }
        remaining
    }

    /// Goes to where [`Self::mark_block`] would come out of the block; how many voxels that is.
    fn skip_block(&mut self) -> u32 {
        let to_leave = self.to_leave();
        let last = |i: usize| self.next[i] + i64::from(to_leave[i] - 1) * self.each[i];
        let leaves = std::array::from_fn(last);
        let axis = nearest(leaves);
        let mut walked = 0;
        for (i, &all) in to_leave.iter().enumerate() {
            let count = if i == axis {
                all
            } else {
                // Of borders crossed at once, the one along the later axis comes first.
                self.crossed(i, leaves[axis] + i64::from(i > axis))
            };
            self.at[i] += self.step[i] * count;
            self.next[i] += self.each[i] * i64::from(count);
            walked += count.cast_unsigned();
        }
        walked
    }

    /// How many borders along an axis it crosses before a place.
    fn crossed(&self, axis: usize, before: i64) -> i32 {
        let way = before - self.next[axis];
        if way <= 0 {
            return 0;
        }
        // A division of whole numbers takes longer than to mend this one's rounding.
        let mut count = (way as f64 * self.per_place[axis]) as i64;
        while count * self.each[axis] >= way {
            count -= 1;
        }
        while (count + 1) * self.each[axis] < way {
            count += 1;
        }
        count as i32 + 1
    }
}

/// The axis whose border comes first, the later of those that tie.
fn nearest([x, y, z]: [i64; 3]) -> usize {
    if x < y && x < z {
        0
    } else if y < z {
        1
    } else {
        2
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::voxel::block::NONE;

    fn any_place() -> impl Strategy<Value = [f64; 3]> {
        // Half of them on a grid, to make ties.
        let c = prop_oneof![-40.0..40.0, (-80..80_i32).prop_map(|c| f64::from(c) / 2.0)];
        prop::array::uniform3(c)
    }

    fn distance(a: [i32; 3], b: [i32; 3]) -> u32 {
        (0..3).map(|i| a[i].abs_diff(b[i])).sum()
    }

    proptest! {
        #[test]
        fn a_walk_comes_out_of_a_skipped_block_where_it_would_have_walked_out(
            start in any_place(), end in any_place()
        ) {
            let [from, to] = [start, end].map(|c| c.map(|c| c.floor() as i32));
            let mut walk = Walk::new(start, from, end);
            let mut skip = Walk::new(start, from, end);
            let mut remaining = distance(from, to);
            while remaining > 0 {
                let before = remaining;
                let skipped = skip.skip_block();
                remaining = walk.mark_block(&mut NONE.clone(), remaining);
                if remaining > 0 {
                    prop_assert_eq!(before - remaining, skipped);
                    prop_assert_eq!(walk.at, skip.at);
                    prop_assert_eq!(walk.next, skip.next);
                }
            }
        }

        #[test]
        fn a_walk_ends_in_the_voxel_of_its_end(start in any_place(), end in any_place()) {
            let [from, to] = [start, end].map(|c| c.map(|c| c.floor() as i32));
            let mut walk = Walk::new(start, from, end);
            for _ in 0..distance(from, to) {
                walk.advance();
            }
            // Where the end lies on a border, the last steps may lead across others than the voxel's own.
            let off = distance(walk.at, to);
            let on_border = end.iter().any(|c| (c - c.round()).abs() < 1e-9);
            prop_assert!(off == 0 || on_border, "{:?} for {to:?}", walk.at);
        }
    }
}
