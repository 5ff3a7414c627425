//! Where the two vehicles are in a street, and where their sensors are on them.
//!
//! The ground vehicle drives along its lane, as one road user among others; the drone flies over the middle of the street some metres ahead of it and
//! looks down at what lies before it, as in the field experiments of the paper (5 to 8 m ahead).

use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use maps::camera::Pinhole;
use maps::frame::{Body, Camera, Isometry, Vector, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::noise::{at_cell, unit};
use crate::render::{Moment, Picture};
use crate::scene::Scene;
use crate::vehicle::Motion;

/// How far the drone is ahead of it.
const AHEAD_M: f64 = 6.5;
/// How far below the horizon the drone's camera looks.
const TILT_RAD: f64 = 0.75;

/// Half of the time over which velocities and accelerations are taken.
const HALF_SPAN: Duration = Duration::from_millis(20);

/// One of the two vehicles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Platform {
    /// The drone.
    Uav,
    /// The ground vehicle.
    Ugv,
}

impl Platform {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Uav, Self::Ugv];

    /// As its topics and sensors are named.
    pub fn name(self) -> &'static str {
        match self {
            Self::Uav => "uav",
            Self::Ugv => "ugv",
        }
    }

    /// Where it is.
    pub fn pose(self, scene: &Scene, at: Stamp, seed: u64) -> Isometry<World, Body> {
        match self {
            Self::Uav => uav(scene, at, seed),
            Self::Ugv => ugv(scene, at),
        }
    }

    /// Where it is, how it moves, and its acceleration in m/s²: differences over 40 ms, in the first 20 ms those of then.
    pub fn motion(self, scene: &Scene, at: Stamp, seed: u64) -> (Motion, Vector<World>) {
        let middle = at.max(Stamp::ZERO + HALF_SPAN);
        let before = Stamp::ZERO + middle.since(Stamp::ZERO + HALF_SPAN);
        let [before, now, after] =
            [before, middle, middle + HALF_SPAN].map(|at| self.pose(scene, at, seed).raw);
        let half_s = HALF_SPAN.as_secs_f64();
        let [a, b, c] = [before, now, after].map(|pose| pose.translation.vector);
        let turned = after.rotation * before.rotation.inverse();
        let rates = turned.scaled_axis() / (2.0 * half_s);
        let motion = Motion {
            world_from_body: self.pose(scene, at, seed),
            velocity: Vector::from_raw((c - a) / (2.0 * half_s)),
            rates: Vector::from_raw(now.rotation.inverse() * rates),
        };
        let acceleration = (c - b * 2.0 + a) / (half_s * half_s);
        (motion, Vector::from_raw(acceleration))
    }
}

/// The ground vehicle: the middle of its footprint.
pub fn ugv(scene: &Scene, at: Stamp) -> Isometry<World, Body> {
    if let Some(way) = scene.way(Platform::Ugv) {
        return way.pose(at);
    }
    let Some(street) = scene.street() else {
        return Isometry::claim(Isometry3::identity());
    };
    let (place, heading_rad) = street.guest(at);
    level([place.x, place.y, 0.0], heading_rad)
}

/// The drone.
pub fn uav(scene: &Scene, at: Stamp, seed: u64) -> Isometry<World, Body> {
    if let Some(way) = scene.way(Platform::Uav) {
        return way.pose(at);
    }
    let Some(street) = scene.street() else {
        return crate::flight::world_from_body(at, seed);
    };
    let (guest, _) = street.guest(at);
    let (along, course) = (guest.x + AHEAD_M, street.course());
    let t = at.as_secs_f64();
    let sway = |axis: i32, hz: f64| {
        let phase = std::f64::consts::TAU * f64::from(unit(at_cell(axis, 0, seed as u32)));
        (std::f64::consts::TAU * hz * t + phase).sin()
    };
    let place = course.place(along, 0.6 * sway(5, 0.07));
    let up = street.flight_m() + 0.25 * sway(6, 0.11);
    // None at the start, so that maps made from there know where up and east are.
    let grown = (t / 2.0).min(1.0);
    let shake = UnitQuaternion::from_euler_angles(
        0.014 * grown * sway(1, 0.9),
        0.014 * grown * sway(2, 1.1),
        0.02 * grown * sway(3, 0.3),
    );
    let level = level([place.x, place.y, up], course.heading(along));
    Isometry::claim(level.raw * Isometry3::from_parts(Translation3::identity(), shake))
}

/// A level place for the drone over a street, turned along it: so far along it from the scene's origin, so far to the left of
/// its middle, and as high as the scene's own drone flies. `None` in the room.
pub fn over_street(scene: &Scene, along_m: f64, left_m: f64) -> Option<Isometry<World, Body>> {
    let street = scene.street()?;
    let (course, up_m) = (street.course(), street.flight_m());
    let place = course.place(along_m, left_m);
    Some(level([place.x, place.y, up_m], course.heading(along_m)))
}

/// The drone's camera.
pub fn uav_camera(scene: &Scene, at: Stamp, seed: u64) -> Isometry<World, Camera> {
    uav(scene, at, seed) * body_from_uav_camera(scene)
}

/// Where the drone's camera is on it: in a street it looks farther down.
pub fn body_from_uav_camera(scene: &Scene) -> Isometry<Body, Camera> {
    if scene.street().is_none() {
        return crate::flight::body_from_camera();
    }
    let tilt = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), TILT_RAD);
    let forward = Vector3::new(0.1, 0.0, -0.05);
    Isometry::claim(Isometry3::from_parts(forward.into(), tilt * optical()))
}

/// The ground vehicle's cameras: front, left, rear and right, each half above the other, 1 m above the ground.
pub const UGV_CAMERAS: [&str; 4] = ["front", "left", "rear", "right"];

/// The lens of each of them: 256 × 736, 90 degrees wide, without distortion.
pub fn ugv_lens() -> Pinhole {
    Pinhole {
        width: 736,
        height: 256,
        fx: 368.0,
        fy: 368.0,
        cx: 367.5,
        cy: 127.5,
        distortion: [0.0; 5],
    }
}

/// Where one of [`UGV_CAMERAS`] is on the ground vehicle.
pub fn body_from_ugv_camera(index: usize) -> Isometry<Body, Camera> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2 * index as f64);
    let forward = turn * Vector3::new(0.25, 0.0, 1.0);
    Isometry::claim(Isometry3::from_parts(forward.into(), turn * optical()))
}

/// What each of [`UGV_CAMERAS`] sees, and from where.
pub fn ugv_views(moment: &Moment<'_>) -> Vec<(Isometry<World, Camera>, Picture)> {
    let (lens, body) = (ugv_lens(), ugv(moment.scene(), moment.at()));
    (0..UGV_CAMERAS.len())
        .map(|index| {
            let pose = body * body_from_ugv_camera(index);
            (pose, moment.picture(&lens, pose))
        })
        .collect()
}

/// From optical axes (x right, y down, z forward) to those of a body (x forward, y left, z up).
fn optical() -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(-FRAC_PI_2, 0.0, -FRAC_PI_2)
}

fn level(place: [f64; 3], heading_rad: f64) -> Isometry<World, Body> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad);
    Isometry::claim(Isometry3::from_parts(Vector3::from(place).into(), turn))
}
