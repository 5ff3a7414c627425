//! The faces of voxels that can be seen from a side.

use super::Drawn;
use crate::voxel::{Voxel, VoxelKey};

/// A side of a cube: the axis of its normal, and the two axes along it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Side {
    axis: usize,
    /// 1 or -1.
    sign: i32,
}

impl Side {
    pub(super) const fn new(axis: usize, sign: i32) -> Self {
        Self { axis, sign }
    }

    pub(super) fn normal(self) -> [i32; 3] {
        let mut normal = [0; 3];
        normal[self.axis] = self.sign;
        normal
    }

    /// Unit steps along the side.
    pub(super) fn along(self) -> [[i32; 3]; 2] {
        [1, 2].map(|next| {
            let mut step = [0; 3];
            step[(self.axis + next) % 3] = 1;
            step
        })
    }

    /// The corner of the side with the least coordinates, from that of the cube.
    pub(super) fn corner(self) -> [i32; 3] {
        self.normal().map(|c| c.max(0))
    }
}

/// A voxel with the sides of it that can be seen.
pub(super) struct Cube {
    pub(super) key: VoxelKey,
    pub(super) voxel: Voxel,
    /// For each side asked for, unless it is covered: how dark its corners are, 0 to 3 neighbours each, at (0, 0), (1, 0),
    /// (0, 1) and (1, 1) along the side.
    pub(super) sides: [Option<[u8; 4]>; 3],
}

/// The cubes of which any of these sides can be seen, in the order of the map.
pub(super) fn cubes(drawn: &Drawn<'_>, sides: &[Side]) -> Vec<Cube> {
    drawn
        .map
        .occupied()
        .filter(|(key, _)| key.z <= drawn.top)
        .filter_map(|(key, voxel)| {
            let mut seen = [None; 3];
            for (corners, side) in seen.iter_mut().zip(sides) {
                *corners = corners_of(drawn, key, *side);
            }
            seen.iter().any(Option::is_some).then_some(Cube {
                key,
                voxel,
                sides: seen,
            })
        })
        .collect()
}

/// How many of the three neighbours at each corner rise above the side; `None` if it is covered.
fn corners_of(drawn: &Drawn<'_>, key: VoxelKey, side: Side) -> Option<[u8; 4]> {
    let above = step(key, side.normal(), 1);
    if drawn.has(above) {
        return None;
    }
    let [u, v] = side.along();
    let has = |du: i32, dv: i32| u8::from(drawn.has(step(step(above, u, du), v, dv)));
    let (left, right, low, high) = (has(-1, 0), has(1, 0), has(0, -1), has(0, 1));
    // Where both sides rise the corner itself is hidden.
    let corner = |a: u8, b: u8, du, dv| a + b + if a & b == 1 { 1 } else { has(du, dv) };
    Some([
        corner(left, low, -1, -1),
        corner(right, low, 1, -1),
        corner(left, high, -1, 1),
        corner(right, high, 1, 1),
    ])
}

fn step(key: VoxelKey, [x, y, z]: [i32; 3], times: i32) -> VoxelKey {
    VoxelKey::new(key.x + times * x, key.y + times * y, key.z + times * z)
}
