//! How vehicles move: a quadrotor and a small car, stepped at a fixed rate, and what their sensors say.
//!
//! Everything is in the world frame (ENU) and SI. A vehicle is told what to do by its autopilot and does it as well as
//! its limits, its lag and the wind let it.

pub mod battery;
pub mod copter;
pub mod gnss;
pub mod quadrotor;
pub mod rover;

use maps::frame::{Body, Isometry, Point, Vector, World};

/// Where a vehicle is and how it moves: the truth, or an estimate of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Its pose.
    pub world_from_body: Isometry<World, Body>,
    /// Its velocity in m/s.
    pub velocity: Vector<World>,
    /// Roll, pitch and yaw rates in rad/s about the body's forward, left and up axes.
    pub rates: Vector<Body>,
}

impl Motion {
    /// Where it is.
    pub fn position(&self) -> Point<World> {
        self.world_from_body.translation()
    }

    /// Its heading, counter-clockwise from east, in radians.
    pub fn heading_rad(&self) -> f64 {
        let forward = self.world_from_body.rotation() * nalgebra::Vector3::x();
        forward.y.atan2(forward.x)
    }
}

/// The same angle within -π..π.
pub fn wrapped(angle_rad: f64) -> f64 {
    let turns = (angle_rad / std::f64::consts::TAU).round();
    angle_rad - turns * std::f64::consts::TAU
}

/// `value`, moved towards `target` by at most `step`.
pub(crate) fn towards(value: f64, target: f64, step: f64) -> f64 {
    value + (target - value).clamp(-step, step)
}
