//! Our poses as CARLA tells them.
//!
//! CARLA's axes are left-handed: x forward, y right, z up. With `S = diag(1, -1, 1)`, a transform `T` between our frames
//! (x forward, y left, z up) is there
//!
//! ```text
//! T' = S·T·S        R' = Rz(yaw)·Ry(-pitch)·Rx(-roll)
//! ```
//!
//! with angles in degrees: yaw clockwise from above, pitch upwards, roll to the right.
//! It is the matrix that `OpenCOOD` makes of them.
//!
//! - R. Xu et al., *OPV2V*, ICRA 2022; `OpenCOOD`, `opencood/utils/transformation_utils.py`, `x_to_world`.

use std::f64::consts::FRAC_PI_2;

use maps::frame::{Camera, Isometry, World};
use nalgebra::{Isometry3, Matrix4, UnitQuaternion};

/// `[x, y, z, roll, yaw, pitch]` in metres and degrees.
pub(super) type Pose = [f64; 6];

/// A pose of ours.
pub(super) fn pose(world_from_frame: &Isometry3<f64>) -> Pose {
    let m = mirrored(world_from_frame);
    let pitch = m[(2, 0)].clamp(-1.0, 1.0).asin();
    let yaw = m[(1, 0)].atan2(m[(0, 0)]);
    let roll = (-m[(2, 1)]).atan2(m[(2, 2)]);
    let [x, y, z] = [m[(0, 3)], m[(1, 3)], m[(2, 3)]];
    [
        x,
        y,
        z,
        roll.to_degrees(),
        yaw.to_degrees(),
        pitch.to_degrees(),
    ]
}

/// A transform between two frames of ours as one between CARLA's.
pub(super) fn mirrored(transform: &Isometry3<f64>) -> Matrix4<f64> {
    let mut m = transform.to_homogeneous();
    for i in [0, 2, 3] {
        m[(1, i)] = -m[(1, i)];
        m[(i, 1)] = -m[(i, 1)];
    }
    m
}

/// A camera with the axes of a vehicle: x along the view ray, z up in the picture.
pub(super) fn camera(world_from_camera: Isometry<World, Camera>) -> Isometry3<f64> {
    let from_optical = UnitQuaternion::from_euler_angles(-FRAC_PI_2, 0.0, -FRAC_PI_2);
    world_from_camera.raw * from_optical.inverse()
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;

    use super::*;

    /// Written out as `OpenCOOD` computes it from `[x, y, z, roll, yaw, pitch]`: from the frame to CARLA's world.
    pub(in super::super) fn matrix([x, y, z, roll, yaw, pitch]: Pose) -> Matrix4<f64> {
        let [(sr, cr), (sy, cy), (sp, cp)] = [roll, yaw, pitch].map(|a| a.to_radians().sin_cos());
        Matrix4::new(
            cp * cy,
            cy * sp * sr - sy * cr,
            -cy * sp * cr - sy * sr,
            x,
            sy * cp,
            sy * sp * sr + cy * cr,
            -sy * sp * cr + cy * sr,
            y,
            sp,
            -cp * sr,
            cp * cr,
            z,
            0.0,
            0.0,
            0.0,
            1.0,
        )
    }

    proptest! {
        #[test]
        fn a_pose_that_opencood_makes_a_matrix_of_takes_mirrored_points_where_ours_takes_them(
            [roll, yaw] in [-3.1..3.1_f64, -3.1..3.1],
            pitch in -1.5..1.5_f64,
            place in [-50.0..50.0_f64, -50.0..50.0, 0.0..20.0],
            point in [-9.0..9.0_f64, -9.0..9.0, -9.0..9.0],
        ) {
            let turn = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let ours = Isometry3::from_parts(Vector3::from(place).into(), turn);
            let [x, y, z] = (ours * Point3::from(point)).into();
            let [a, b, c] = point;
            let theirs = matrix(pose(&ours)).transform_point(&Point3::new(a, -b, c));
            prop_assert!((theirs - Point3::new(x, -y, z)).norm() < 1e-9);
        }
    }

    #[test]
    fn turning_left_is_a_negative_yaw_and_looking_down_a_negative_pitch() {
        let left = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5);
        let down = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.25);
        let at = Isometry3::from_parts(Vector3::new(3.0, 2.0, 1.0).into(), left * down);
        let expected = [
            3.0,
            -2.0,
            1.0,
            0.0,
            -0.5_f64.to_degrees(),
            -0.25_f64.to_degrees(),
        ];
        for (found, expected) in pose(&at).into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{:?}", pose(&at));
        }
    }
}
