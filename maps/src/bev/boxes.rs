//! Detected objects as boxes.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::frame::{Body, Isometry, Point, World};
use crate::voxel::VoxelKey;

/// A box that stands upright, turned about its vertical.
///
/// Invariant: finite, with sizes from 0 to [`Self::MAX_SIZE_M`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedBox {
    world_from_box: Isometry<World, Body>,
    half: Vector3<f64>,
}

impl OrientedBox {
    /// The longest edge: a train's, and a bound on the voxels of a box that a peer sends.
    pub const MAX_SIZE_M: f64 = 100.0;

    /// A box with this middle, its length (along its heading), width and height, and its heading in radians from east to
    /// north. `None` if something is not finite or a size is not within 0 to [`Self::MAX_SIZE_M`].
    pub fn new(center: Point<World>, size_m: [f64; 3], yaw: f64) -> Option<Self> {
        let is_valid = center.is_finite()
            && yaw.is_finite()
            && size_m
                .iter()
                .all(|size| (0.0..=Self::MAX_SIZE_M).contains(size));
        is_valid.then(|| Self {
            world_from_box: Isometry::claim(Isometry3::from_parts(
                center.raw.coords.into(),
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw),
            )),
            half: Vector3::from(size_m) * 0.5,
        })
    }

    /// Its corners, Eq. (18): bottom before top; of each the back right, front right, back left and front left one.
    pub fn corners(&self) -> [Point<World>; 8] {
        std::array::from_fn(|corner| {
            let side = |bit: usize| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
            let [x, y, z] = [0, 1, 2].map(|axis| side(axis) * self.half[axis]);
            self.world_from_box * Point::new(x, y, z)
        })
    }

    /// Whether a point is inside, the surface included.
    pub fn contains(&self, p: Point<World>) -> bool {
        let q = self.world_from_box.inverse() * p;
        (0..3).all(|axis| q.raw[axis].abs() <= self.half[axis])
    }

    /// The voxels with edge `resolution_m` whose middle is inside, z above y above x, between `low` and `high`, both
    /// inclusive.
    pub fn voxels(
        &self,
        resolution_m: f64,
        low: VoxelKey,
        high: VoxelKey,
    ) -> impl Iterator<Item = VoxelKey> {
        let corners = self.corners().map(|c| c.raw.coords);
        let range = |axis: usize, low: i32, high: i32| {
            let of = corners.map(|c| c[axis] / resolution_m);
            let least = of.iter().copied().fold(f64::INFINITY, f64::min).floor() as i32;
            let greatest = of.iter().copied().fold(f64::NEG_INFINITY, f64::max).floor() as i32;
            least.max(low)..=greatest.min(high)
        };
        let (xs, ys) = (range(0, low.x, high.x), range(1, low.y, high.y));
        let this = *self;
        range(2, low.z, high.z).flat_map(move |z| {
            let xs = xs.clone();
            ys.clone().flat_map(move |y| {
                xs.clone().filter_map(move |x| {
                    let [px, py, pz] = [x, y, z].map(|c| (f64::from(c) + 0.5) * resolution_m);
                    this.contains(Point::new(px, py, pz))
                        .then_some(VoxelKey::new(x, y, z))
                })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    const LOW: VoxelKey = VoxelKey::new(-500, -500, -500);
    const HIGH: VoxelKey = VoxelKey::new(500, 500, 500);

    #[test]
    fn corners_turn_with_the_heading() {
        let car = OrientedBox::new(Point::new(10.0, 0.0, 1.0), [4.0, 2.0, 1.0], FRAC_PI_2)
            .expect("valid");
        let expected = [
            [11.0, -2.0, 0.5],
            [11.0, 2.0, 0.5],
            [9.0, -2.0, 0.5],
            [9.0, 2.0, 0.5],
            [11.0, -2.0, 1.5],
            [11.0, 2.0, 1.5],
            [9.0, -2.0, 1.5],
            [9.0, 2.0, 1.5],
        ];
        for (corner, [x, y, z]) in car.corners().into_iter().zip(expected) {
            assert!((corner - Point::new(x, y, z)).norm() < 1e-12, "{corner:?}");
        }
    }

    #[test]
    fn the_voxels_fill_the_volume_at_any_heading() {
        for step in 0..12 {
            let yaw = f64::from(step) * 0.3;
            let car =
                OrientedBox::new(Point::new(0.31, -7.2, 1.0), [4.0, 2.0, 1.0], yaw).expect("valid");
            let volume = car.voxels(0.1, LOW, HIGH).count() as f64 * 1e-3;
            // Along 44 m² of surface, voxels count by their middle.
            assert!((volume - 8.0).abs() < 0.25, "{volume} m³ at {yaw} rad");
        }
    }

    #[test]
    fn what_is_no_box_is_refused() {
        let at = Point::origin();
        assert_eq!(
            OrientedBox::new(Point::new(f64::NAN, 0.0, 0.0), [1.0; 3], 0.0),
            None
        );
        assert_eq!(OrientedBox::new(at, [1.0, -1.0, 1.0], 0.0), None);
        assert_eq!(OrientedBox::new(at, [1e9, 1.0, 1.0], 0.0), None);
        assert_eq!(OrientedBox::new(at, [1.0; 3], f64::INFINITY), None);
    }
}
