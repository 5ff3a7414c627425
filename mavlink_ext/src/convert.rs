//! The only place with MAVLink's units and frames: NED and FRD, degrees times 10⁷, millimetres.
//!
//! ```text
//! ENU ↔ NED  (x, y, z) ↔ (y, x, −z)        a half turn about (1, 1, 0)/√2, its own inverse
//! FLU ↔ FRD  (x, y, z) ↔ (x, −y, −z)       a half turn about x, its own inverse
//! q_ned_frd = q_ned_enu · q_enu_flu · q_flu_frd
//! ```

mod item;
mod odometry;
mod pose;
mod vision;

pub use item::{ItemError, MissionFrame, MissionItem};
pub use odometry::{Odometry, odometry_message, odometry_pose};
pub use pose::{
    Attitude, LocalPosition, attitude, global_position, local_position, world_from_body,
};
pub use vision::vision_message;

use maps::frame::{Body, Vector, World};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Degrees of latitude or longitude as MAVLink's integers.
pub fn deg_to_e7(degrees: f64) -> i32 {
    (degrees * 1e7).round() as i32
}

/// MAVLink's integers as degrees of latitude or longitude.
pub fn e7_to_deg(e7: i32) -> f64 {
    f64::from(e7) * 1e-7
}

/// Components in north-east-down of a vector in world (east, north, up).
pub fn to_ned(v: Vector<World>) -> [f64; 3] {
    [v.raw.y, v.raw.x, -v.raw.z]
}

/// The vector in world with these components in north-east-down.
pub fn from_ned([north, east, down]: [f64; 3]) -> Vector<World> {
    Vector::new(east, north, -down)
}

/// Components in forward-right-down of a vector in body (forward, left, up).
pub fn to_frd(v: Vector<Body>) -> [f64; 3] {
    [v.raw.x, -v.raw.y, -v.raw.z]
}

/// The vector in body with these components in forward-right-down.
pub fn from_frd([forward, right, down]: [f64; 3]) -> Vector<Body> {
    Vector::new(forward, -right, -down)
}

/// The rotation from FRD to NED that is the same attitude as this rotation from body (FLU) to world (ENU).
pub fn attitude_to_ned(world_from_body: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    ned_enu() * world_from_body * flu_frd()
}

/// The rotation from body (FLU) to world (ENU) that is the same attitude as this rotation from FRD to NED.
pub fn attitude_from_ned(ned_from_frd: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    ned_enu().inverse() * ned_from_frd * flu_frd().inverse()
}

fn ned_enu() -> UnitQuaternion<f64> {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    UnitQuaternion::new_unchecked(Quaternion::new(0.0, half, half, 0.0))
}

fn flu_frd() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_body_that_heads_north_has_yaw_zero_in_ned() {
        let heading_north = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2);
        let (roll, pitch, yaw) = attitude_to_ned(heading_north).euler_angles();
        assert!(
            roll.abs() < 1e-12 && pitch.abs() < 1e-12 && yaw.abs() < 1e-12,
            "{roll} {pitch} {yaw}"
        );
    }

    #[test]
    fn nose_up_is_a_positive_pitch_in_ned_and_a_negative_turn_about_left() {
        let heading_east_nose_up = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -0.3);
        let (roll, pitch, yaw) = attitude_to_ned(heading_east_nose_up).euler_angles();
        assert!(roll.abs() < 1e-12 && (pitch - 0.3).abs() < 1e-12);
        assert!(
            (yaw - FRAC_PI_2).abs() < 1e-12,
            "east is 90° clockwise of north"
        );
    }

    proptest! {
        #[test]
        fn vectors_turn_with_the_attitude(r in prop::array::uniform3(-3.0..3.0), v in prop::array::uniform3(-9.0..9.0)) {
            let world_from_body = UnitQuaternion::from_scaled_axis(Vector3::from(r));
            let v_in_body = Vector::<Body>::from_raw(v.into());
            let v_in_world = Vector::<World>::from_raw(world_from_body * v_in_body.raw);
            let turned = attitude_to_ned(world_from_body) * Vector3::from(to_frd(v_in_body));
            prop_assert!((turned - Vector3::from(to_ned(v_in_world))).norm() < 1e-12);
            let back = attitude_from_ned(attitude_to_ned(world_from_body));
            prop_assert!(back.angle_to(&world_from_body) < 1e-7, "rounding near zero angle");
            prop_assert_eq!(from_ned(to_ned(v_in_world)), v_in_world);
            prop_assert_eq!(from_frd(to_frd(v_in_body)), v_in_body);
        }
    }
}
