//! Where the drone carries its camera: round the room at 1.5 m, looking across it and down.
//!
//! ```text
//! p(t) = c + (r_x cos θ, r_y sin θ)      heading = θ - π + 0.35 sin(2.3(θ - π))      θ(0) = π
//! ```
//!
//! so that it starts above the scene's origin with its optical axis to the east, as the maps made from it assume. It
//! starts at rest, breathes a little in height and shakes as a hovering drone does; every term is smooth, so that the
//! truth has a velocity at any time.

use std::f64::consts::{PI, TAU};
use std::time::Duration;

use maps::frame::{Body, Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};

use crate::noise::{at_cell, unit};
use crate::scene::ROOM_CENTRE;

/// One round, at speed.
pub const LAP: Duration = Duration::from_secs(36);
/// It gets under way over these seconds.
const START_S: f64 = 2.0;
const RADII: [f64; 2] = [1.3, 1.0];
const HEIGHT_M: f64 = 1.5;
/// How far the camera looks below the horizon.
const TILT_RAD: f64 = 0.36;

/// The drone that carries the camera.
pub fn world_from_body(at: Stamp, seed: u64) -> Isometry<World, Body> {
    let t = at.as_secs_f64();
    let lap = lap(t);
    let angle = PI + TAU * lap;
    // Each round is a little narrower than the one before and comes back: new points of view of the same walls.
    let narrow = 1.0 - 0.12 * (1.0 - (PI * lap).cos()) / 2.0;
    let x = ROOM_CENTRE[0] + RADII[0] * narrow * angle.cos();
    let y = ROOM_CENTRE[1] + RADII[1] * narrow * angle.sin();
    let z = HEIGHT_M + 0.08 * (0.9 * TAU * lap * 2.0).sin();
    let heading = TAU * lap + 0.35 * (2.3 * TAU * lap).sin();
    let shake = |axis: i32, hz: f64| {
        let phase = TAU * f64::from(unit(at_cell(axis, 0, seed as u32)));
        // Zero at the start, so that the first picture is level.
        (TAU * hz * t + phase).sin() * (t / START_S).min(1.0)
    };
    let turn = Rotation3::from_euler_angles(0.012 * shake(1, 0.9), 0.012 * shake(2, 1.1), heading);
    Isometry::claim(Isometry3::from_parts(
        Vector3::new(x + 0.006 * shake(3, 0.8), y + 0.006 * shake(4, 0.7), z).into(),
        UnitQuaternion::from_rotation_matrix(&turn),
    ))
}

/// The camera on the drone: at its reference point, tilted down.
pub fn body_from_camera() -> Isometry<Body, Camera> {
    // Optical axes: z forward, x right, y down; then tilted about the body's left axis.
    let optical = UnitQuaternion::from_euler_angles(-PI / 2.0, 0.0, -PI / 2.0);
    let tilt = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), TILT_RAD);
    Isometry::claim(Isometry3::from_parts(
        Vector3::zeros().into(),
        tilt * optical,
    ))
}

/// The pose of the camera: the truth that goes with each picture.
pub fn world_from_camera(at: Stamp, seed: u64) -> Isometry<World, Camera> {
    world_from_body(at, seed) * body_from_camera()
}

/// Rounds flown after `t` seconds: the integral of a speed that rises from zero over the first seconds.
fn lap(t: f64) -> f64 {
    let s = (t / START_S).min(1.0);
    // The integral of 3s² - 2s³ is s³ - s⁴/2.
    let rising = START_S * (s.powi(3) - s.powi(4) / 2.0);
    (rising + (t - START_S).max(0.0)) / LAP.as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;
    use maps::frame::Vector;

    #[test]
    fn it_starts_above_the_origin_looking_east_and_down() {
        let start = world_from_camera(Stamp::ZERO, 1);
        let place = start.translation().raw;
        assert!(place.x.abs() < 1e-9 && place.y.abs() < 1e-9, "{place}");
        assert!((place.z - 1.5).abs() < 1e-9);
        let axis = (start * Vector::new(0.0, 0.0, 1.0)).raw;
        assert!(axis.x > 0.9 && axis.y.abs() < 1e-9, "{axis}");
        assert!(axis.z < -0.3, "{axis}");
        let down = (start * Vector::new(0.0, 1.0, 0.0)).raw;
        assert!(down.z < -0.9, "the image is upright: {down}");
    }

    #[test]
    fn it_is_smooth_and_slow_enough_for_a_camera() {
        let step = Duration::from_millis(20);
        for i in 0..4000_u64 {
            let now = Stamp::from_nanos(i * 20_000_000);
            let [a, b, c] = [now, now + step, now + step + step].map(|t| world_from_camera(t, 1));
            let speed = (b.translation() - a.translation()).norm() / 0.02;
            let turn = a.rotation().angle_to(&b.rotation()) / 0.02;
            assert!(speed < 0.5, "{speed} m/s at {now}");
            assert!(turn < 0.6, "{turn} rad/s at {now}");
            let change = ((c.translation() - b.translation()).raw
                - (b.translation() - a.translation()).raw)
                .norm();
            assert!(change / 0.02 / 0.02 < 0.6, "{change} at {now}");
        }
    }

    #[test]
    fn it_keeps_away_from_people() {
        use crate::scene::{Name, Scene};
        let scene = Scene::generate(Name::Room, 1);
        for i in 0..1200_u64 {
            let now = Stamp::from_nanos(i * 100_000_000);
            let here = world_from_camera(now, 1).translation().raw.xy();
            for walker in scene.walkers() {
                let distance = (walker.position(now).raw.xy() - here).norm();
                assert!(distance > 0.6, "{distance} m at {now}");
            }
        }
    }
}
