//! `ODOMETRY` as flight controllers want it for external navigation.
//!
//! ArduPilot drops it silently unless `frame_id` is `LOCAL_FRD` and `child_frame_id` is `BODY_FRD`; PX4 takes the same.
//! `LOCAL_FRD` is a local frame whose x axis need not point north; ours does, since world is east-north-up.

use maps::frame::{Body, Isometry, Vector, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Matrix6, Quaternion, Translation3, UnitQuaternion};

use super::{attitude_from_ned, attitude_to_ned, from_ned, to_frd, to_ned};
use crate::dialect::tandem::{MavEstimatorType, MavFrame, ODOMETRY_DATA};

/// A covariance that is not known: only its first element is looked at.
pub(super) const UNKNOWN_COVARIANCE: [f32; 21] = {
    let mut unknown = [0.0; 21];
    unknown[0] = f32::NAN;
    unknown
};

/// An estimate of where the vehicle is and how it moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Odometry {
    /// When the sensors saw it, on our clock.
    pub at: Stamp,
    /// The pose.
    pub world_from_body: Isometry<World, Body>,
    /// Velocity over ground in metres per second, as seen from the body; `None` if it is not known.
    pub velocity: Option<Vector<Body>>,
    /// Turn rates in radians per second about the body's axes; `None` if they are not known.
    pub turn_rate: Option<Vector<Body>>,
    /// Covariance of the pose perturbed on the right, translation before rotation (m², rad²); `None` if not known.
    pub covariance: Option<Matrix6<f64>>,
    /// Counts jumps of the estimate, as after a loop closure: the flight controller resets instead of rejecting.
    pub reset_counter: u8,
    /// How good the estimate is: −1 failed, 0 unknown, 1..=100 percent.
    pub quality: i8,
}

/// The message for a flight controller.
pub fn odometry_message(odometry: &Odometry) -> ODOMETRY_DATA {
    let position = to_ned(Vector::from_raw(
        odometry.world_from_body.translation().raw.coords,
    ));
    let [x, y, z] = position.map(|c| c as f32);
    let attitude = attitude_to_ned(odometry.world_from_body.rotation());
    let or_unknown = |v: Option<Vector<Body>>| {
        v.map_or([f32::NAN; 3], |v| {
            to_frd(v).map(|component| component as f32)
        })
    };
    let [vx, vy, vz] = or_unknown(odometry.velocity);
    let [rollspeed, pitchspeed, yawspeed] = or_unknown(odometry.turn_rate);
    ODOMETRY_DATA {
        time_usec: odometry.at.as_nanos() / 1000,
        x,
        y,
        z,
        q: [attitude.w, attitude.i, attitude.j, attitude.k].map(|c| c as f32),
        vx,
        vy,
        vz,
        rollspeed,
        pitchspeed,
        yawspeed,
        pose_covariance: odometry
            .covariance
            .as_ref()
            .map_or(UNKNOWN_COVARIANCE, |covariance| {
                let rotation = odometry.world_from_body.rotation();
                upper_triangle(&wire_covariance(covariance, &rotation))
            }),
        velocity_covariance: UNKNOWN_COVARIANCE,
        frame_id: MavFrame::MAV_FRAME_LOCAL_FRD,
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
        reset_counter: odometry.reset_counter,
        estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION,
        quality: odometry.quality,
    }
}

/// The pose in a message; `None` if its estimator says that it failed, it is in other frames than ours, or not finite.
pub fn odometry_pose(message: &ODOMETRY_DATA) -> Option<Isometry<World, Body>> {
    let ours = message.frame_id == MavFrame::MAV_FRAME_LOCAL_FRD
        && message.child_frame_id == MavFrame::MAV_FRAME_BODY_FRD;
    if !ours || message.quality < 0 {
        return None;
    }
    let position = from_ned([message.x, message.y, message.z].map(f64::from));
    let [w, x, y, z] = message.q.map(f64::from);
    let attitude = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5)?;
    let pose = Isometry::claim(Isometry3::from_parts(
        Translation3::from(position.raw),
        attitude_from_ned(attitude),
    ));
    pose.is_finite().then_some(pose)
}

/// Covariance of the position in NED and of the attitude about the axes of FRD. Ours is of a perturbation on the right:
/// its translation is in the body (FLU) and turns with it; its rotation is about FLU axes already.
pub(super) fn wire_covariance(
    covariance: &Matrix6<f64>,
    world_from_body: &nalgebra::UnitQuaternion<f64>,
) -> Matrix6<f64> {
    let frd_flu = nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, -1.0, -1.0));
    let ned_enu = nalgebra::Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let mut jacobian = Matrix6::zeros();
    jacobian
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&(ned_enu * world_from_body.to_rotation_matrix().matrix()));
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&frd_flu);
    jacobian * covariance * jacobian.transpose()
}

/// Row by row from the diagonal on, as MAVLink packs covariances.
pub(super) fn upper_triangle(matrix: &Matrix6<f64>) -> [f32; 21] {
    let mut packed = [0.0; 21];
    let indices = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
    for (slot, index) in packed.iter_mut().zip(indices) {
        *slot = matrix[index] as f32;
    }
    packed
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use nalgebra::{Isometry3, UnitQuaternion, Vector3, Vector6};

    use super::*;

    fn heading_north_at_1_2_3() -> Odometry {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2);
        let diagonal = Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0);
        Odometry {
            at: Stamp::from_nanos(5_000),
            world_from_body: Isometry::claim(Isometry3::from_parts(
                Vector3::new(1.0, 2.0, 3.0).into(),
                rotation,
            )),
            velocity: Some(Vector::new(0.5, 0.25, 0.125)),
            turn_rate: None,
            covariance: Some(Matrix6::from_diagonal(&diagonal)),
            reset_counter: 3,
            quality: 90,
        }
    }

    #[test]
    fn odometry_is_in_the_frames_that_flight_controllers_take() {
        let message = odometry_message(&heading_north_at_1_2_3());
        assert_eq!(message.frame_id, MavFrame::MAV_FRAME_LOCAL_FRD);
        assert_eq!(message.child_frame_id, MavFrame::MAV_FRAME_BODY_FRD);
        assert_eq!((message.x, message.y, message.z), (2.0, 1.0, -3.0));
        assert_eq!((message.vx, message.vy, message.vz), (0.5, -0.25, -0.125));
        assert!(message.rollspeed.is_nan(), "unknown is NaN");
        assert!(
            (message.q[0].abs() - 1.0).abs() < 1e-6,
            "yaw 0: {:?}",
            message.q
        );
        assert_eq!((message.time_usec, message.reset_counter), (5, 3));
    }

    #[test]
    fn the_pose_of_a_message_is_the_one_it_was_made_of() {
        let odometry = heading_north_at_1_2_3();
        let message = odometry_message(&odometry);
        let pose = odometry_pose(&message).expect("ours");
        let error = (pose.inverse() * odometry.world_from_body).raw;
        assert!(error.translation.vector.norm() < 1e-6, "single precision");
        assert!(error.rotation.angle() < 1e-3, "single precision: {error}");
    }

    #[test]
    fn a_pose_that_failed_or_is_in_other_frames_is_none() {
        let good = odometry_message(&heading_north_at_1_2_3());
        let none = [
            ODOMETRY_DATA {
                quality: -1,
                ..good.clone()
            },
            ODOMETRY_DATA {
                x: f32::NAN,
                ..good.clone()
            },
            ODOMETRY_DATA {
                q: [0.0; 4],
                ..good.clone()
            },
            ODOMETRY_DATA {
                q: [f32::NAN; 4],
                ..good.clone()
            },
            ODOMETRY_DATA {
                frame_id: MavFrame::MAV_FRAME_LOCAL_NED,
                ..good.clone()
            },
        ];
        for message in none {
            assert_eq!(odometry_pose(&message), None, "{message:?}");
        }
    }

    #[test]
    fn covariance_turns_into_the_frames_of_the_message() {
        let covariance = odometry_message(&heading_north_at_1_2_3()).pose_covariance;
        let diagonal = [0, 6, 11, 15, 18, 20].map(|index| covariance[index].round() as i32);
        assert_eq!(diagonal, [1, 2, 3, 4, 5, 6], "forward is north here");
        let unknown = Odometry {
            covariance: None,
            ..heading_north_at_1_2_3()
        };
        assert!(odometry_message(&unknown).pose_covariance[0].is_nan());
    }
}
