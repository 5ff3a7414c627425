//! `VISION_POSITION_ESTIMATE`, for autopilots and bridges that take no `ODOMETRY`.
//!
//! North, east and down of the local origin, and Euler angles from it to FRD. ArduPilot takes it without asking for frames;
//! of the covariance it takes one error of the position and one of the attitude, `cbrt` of the sum of the squares on each
//! half of the diagonal, and the noise of its parameters where the first element is NaN. PX4 takes the same. There is no
//! velocity and no quality: what failed must not be sent.
//! <https://mavlink.io/en/messages/common.html#VISION_POSITION_ESTIMATE>

use maps::frame::Vector;
use nalgebra::{Matrix3, Matrix6};

use super::odometry::{Odometry, UNKNOWN_COVARIANCE, upper_triangle, wire_covariance};
use super::{attitude_to_ned, to_ned};
use crate::dialect::tandem::VISION_POSITION_ESTIMATE_DATA;

/// With less of a cosine of the pitch, roll and yaw are one angle, and their covariance is not known.
const GIMBAL_LOCK: f64 = 0.02;

/// The message for a flight controller; `None` if the estimate has failed or is not finite. `reset_counter` goes along, so
/// that the flight controller resets at a jump instead of rejecting it.
pub fn vision_message(odometry: &Odometry) -> Option<VISION_POSITION_ESTIMATE_DATA> {
    if odometry.quality < 0 || !odometry.world_from_body.is_finite() {
        return None;
    }
    let position = odometry.world_from_body.translation().raw.coords;
    let [x, y, z] = to_ned(Vector::from_raw(position)).map(|c| c as f32);
    let rotation = odometry.world_from_body.rotation();
    let (roll, pitch, yaw) = attitude_to_ned(rotation).euler_angles();
    let covariance = (odometry.covariance.as_ref())
        .and_then(|covariance| {
            euler_covariance(&wire_covariance(covariance, &rotation), roll, pitch)
        })
        .map_or(UNKNOWN_COVARIANCE, |covariance| upper_triangle(&covariance));
    Some(VISION_POSITION_ESTIMATE_DATA {
        usec: odometry.at.as_nanos() / 1000,
        x,
        y,
        z,
        roll: roll as f32,
        pitch: pitch as f32,
        yaw: yaw as f32,
        covariance,
        reset_counter: odometry.reset_counter,
    })
}

/// Covariance of position and Euler angles, from that of position and turns about the axes of FRD. `None` near gimbal lock,
/// and where it is not finite.
///
/// ```text
/// (φ̇, θ̇, ψ̇) = E ω     E = [1, sin φ tan θ, cos φ tan θ;  0, cos φ, −sin φ;  0, sin φ / cos θ, cos φ / cos θ]
/// ```
fn euler_covariance(of_turns: &Matrix6<f64>, roll: f64, pitch: f64) -> Option<Matrix6<f64>> {
    let (sin, cos) = roll.sin_cos();
    let cos_pitch = pitch.cos();
    if cos_pitch.abs() < GIMBAL_LOCK {
        return None;
    }
    let tan = pitch.tan();
    let rates = Matrix3::new(
        1.0,
        sin * tan,
        cos * tan,
        0.0,
        cos,
        -sin,
        0.0,
        sin / cos_pitch,
        cos / cos_pitch,
    );
    let mut jacobian = Matrix6::identity();
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&rates);
    let covariance = jacobian * of_turns * jacobian.transpose();
    covariance
        .iter()
        .all(|c| c.is_finite())
        .then_some(covariance)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use maps::frame::Isometry;
    use maps::time::Stamp;
    use nalgebra::{Isometry3, UnitQuaternion, Vector3, Vector6};
    use proptest::prelude::*;

    use super::*;
    use crate::convert::{attitude_from_ned, odometry_message};

    /// At 1 m east, 2 m north and 3 m up.
    fn turned_in_ned(roll: f64, pitch: f64, yaw: f64) -> Odometry {
        let rotation = attitude_from_ned(UnitQuaternion::from_euler_angles(roll, pitch, yaw));
        let diagonal = Vector6::new(1.0, 2.0, 3.0, 0.04, 0.05, 0.06);
        Odometry {
            at: Stamp::from_nanos(5_000),
            world_from_body: Isometry::claim(Isometry3::from_parts(
                Vector3::new(1.0, 2.0, 3.0).into(),
                rotation,
            )),
            velocity: None,
            turn_rate: None,
            covariance: Some(Matrix6::from_diagonal(&diagonal)),
            reset_counter: 3,
            quality: 90,
        }
    }

    fn diagonal(covariance: &[f32; 21]) -> [f32; 6] {
        [0, 6, 11, 15, 18, 20].map(|index| covariance[index])
    }

    #[test]
    fn position_is_in_ned_and_angles_turn_to_frd() {
        let odometry = turned_in_ned(0.1, -0.2, 1.5);
        let message = vision_message(&odometry).expect("it is good");
        assert_eq!((message.x, message.y, message.z), (2.0, 1.0, -3.0));
        let angles = [message.roll, message.pitch, message.yaw];
        for (angle, expected) in angles.into_iter().zip([0.1, -0.2, 1.5]) {
            assert!((angle - expected).abs() < 1e-6, "{angles:?}");
        }
        assert_eq!((message.usec, message.reset_counter), (5, 3));
    }

    #[test]
    fn a_level_vehicle_has_the_covariance_of_its_odometry() {
        let odometry = turned_in_ned(0.0, 0.0, FRAC_PI_2);
        let message = vision_message(&odometry).expect("it is good");
        let expected = diagonal(&odometry_message(&odometry).pose_covariance);
        for (found, expected) in diagonal(&message.covariance).into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-5, "{message:?}");
        }
    }

    #[test]
    fn what_is_not_known_begins_with_nan() {
        let unknown = Odometry {
            covariance: None,
            ..turned_in_ned(0.0, 0.0, 0.0)
        };
        let infinite = Odometry {
            covariance: Some(Matrix6::from_element(f64::INFINITY)),
            ..turned_in_ned(0.0, 0.0, 0.0)
        };
        let upright = turned_in_ned(0.0, FRAC_PI_2, 0.0);
        for odometry in [unknown, infinite, upright] {
            let message = vision_message(&odometry).expect("the pose is good");
            assert!(message.covariance[0].is_nan(), "{message:?}");
        }
    }

    #[test]
    fn a_pose_that_failed_or_is_not_finite_is_not_sent() {
        let good = turned_in_ned(0.0, 0.0, 0.0);
        let failed = Odometry {
            quality: -1,
            ..good.clone()
        };
        let nowhere = Odometry {
            world_from_body: Isometry::claim(Isometry3::translation(f64::NAN, 0.0, 0.0)),
            ..good
        };
        for odometry in [failed, nowhere] {
            assert_eq!(vision_message(&odometry), None);
        }
    }

    proptest! {
        /// The Jacobian agrees with angles of attitudes that are turned a little more.
        #[test]
        fn small_turns_change_the_angles_as_the_covariance_says(
            roll in -3.0..3.0, pitch in -1.3..1.3, yaw in -3.0..3.0, axis in 0_usize..3
        ) {
            let mut turn = Vector3::zeros();
            turn[axis] = 1e-6;
            let attitude = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let turned = attitude * UnitQuaternion::from_scaled_axis(turn);
            let (before, after) = (attitude.euler_angles(), turned.euler_angles());
            let wrap = |angle: f64| (angle + 9.0 * std::f64::consts::PI)
                .rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
            let changes = [wrap(after.0 - before.0), wrap(after.1 - before.1), wrap(after.2 - before.2)];
            let mut of_turns = Matrix6::zeros();
            of_turns[(3 + axis, 3 + axis)] = 1e-12;
            let covariance = euler_covariance(&of_turns, roll, pitch).expect("no gimbal lock");
            for (index, change) in changes.iter().enumerate() {
                let deviation = covariance[(3 + index, 3 + index)].sqrt();
                prop_assert!((deviation - change.abs()).abs() < 1e-9, "{} {}", deviation, change);
            }
        }
    }
}
