//! Vehicle telemetry into typed poses.

use maps::frame::{Body, Isometry, Point, Vector, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::{attitude_from_ned, e7_to_deg, from_frd, from_ned};
use crate::dialect::tandem::{ATTITUDE_DATA, GLOBAL_POSITION_INT_DATA, LOCAL_POSITION_NED_DATA};

/// Where a vehicle is relative to its own local origin, and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalPosition {
    /// Since the vehicle started, on its clock.
    pub at: Stamp,
    /// Position. It is in world only if the vehicle's origin is the mission origin.
    pub position: Point<World>,
    /// Velocity in metres per second.
    pub velocity: Vector<World>,
}

/// How a vehicle is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// Since the vehicle started, on its clock.
    pub at: Stamp,
    /// Rotation from body to world.
    pub world_from_body: UnitQuaternion<f64>,
    /// Turn rates in radians per second.
    pub turn_rate: Vector<Body>,
}

/// Typed `LOCAL_POSITION_NED`; `None` if a component is not finite.
pub fn local_position(message: &LOCAL_POSITION_NED_DATA) -> Option<LocalPosition> {
    let position = from_ned([message.x, message.y, message.z].map(f64::from));
    let velocity = from_ned([message.vx, message.vy, message.vz].map(f64::from));
    let finite = position.norm().is_finite() && velocity.norm().is_finite();
    finite.then(|| LocalPosition {
        at: stamp_of_ms(message.time_boot_ms),
        position: Point::origin() + position,
        velocity,
    })
}

/// Typed `ATTITUDE`; `None` if a component is not finite.
pub fn attitude(message: &ATTITUDE_DATA) -> Option<Attitude> {
    let angles = [message.roll, message.pitch, message.yaw].map(f64::from);
    let rates = from_frd([message.rollspeed, message.pitchspeed, message.yawspeed].map(f64::from));
    let [roll, pitch, yaw] = angles;
    angles
        .iter()
        .all(|angle| angle.is_finite())
        .then(|| Attitude {
            at: stamp_of_ms(message.time_boot_ms),
            world_from_body: attitude_from_ned(UnitQuaternion::from_euler_angles(roll, pitch, yaw)),
            turn_rate: rates,
        })
}

/// The pose that a position and an attitude make.
pub fn world_from_body(position: &LocalPosition, attitude: &Attitude) -> Isometry<World, Body> {
    Isometry::claim(Isometry3::from_parts(
        Translation3::from(position.position.raw),
        attitude.world_from_body,
    ))
}

/// Latitude and longitude in degrees and altitude above mean sea level in metres; `None` without a position.
pub fn global_position(message: &GLOBAL_POSITION_INT_DATA) -> Option<[f64; 3]> {
    let [lat_deg, lon_deg] = [message.lat, message.lon].map(e7_to_deg);
    let known = (message.lat, message.lon) != (0, 0);
    (known && lat_deg.abs() <= 90.0 && lon_deg.abs() <= 180.0).then_some([
        lat_deg,
        lon_deg,
        f64::from(message.alt) * 1e-3,
    ])
}

fn stamp_of_ms(time_boot_ms: u32) -> Stamp {
    Stamp::from_nanos(u64::from(time_boot_ms) * 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_north_of_home_and_nose_east_is_so_in_world() {
        let position = local_position(&LOCAL_POSITION_NED_DATA {
            time_boot_ms: 1500,
            x: 10.0,
            z: -2.0,
            vy: 1.0,
            ..LOCAL_POSITION_NED_DATA::default()
        })
        .expect("finite");
        let attitude = attitude(&ATTITUDE_DATA {
            yaw: std::f32::consts::FRAC_PI_2,
            yawspeed: 0.5,
            ..ATTITUDE_DATA::default()
        })
        .expect("finite");
        assert_eq!(position.at.to_string(), "1.500000000");
        assert_eq!(position.velocity, Vector::new(1.0, 0.0, 0.0), "to the east");
        assert!(
            (attitude.turn_rate.raw.z + 0.5).abs() < 1e-12,
            "clockwise is negative"
        );
        let ahead = world_from_body(&position, &attitude) * Point::<Body>::new(1.0, 0.0, 0.0);
        assert!(
            (ahead - Point::new(1.0, 10.0, 2.0)).norm() < 1e-6,
            "{ahead:?}"
        );
    }

    #[test]
    fn telemetry_that_is_not_a_number_is_no_pose() {
        let nan = ATTITUDE_DATA {
            pitch: f32::NAN,
            ..ATTITUDE_DATA::default()
        };
        assert_eq!(attitude(&nan), None);
        let infinite = LOCAL_POSITION_NED_DATA {
            x: f32::INFINITY,
            ..LOCAL_POSITION_NED_DATA::default()
        };
        assert_eq!(local_position(&infinite), None);
        assert_eq!(global_position(&GLOBAL_POSITION_INT_DATA::default()), None);
    }
}
