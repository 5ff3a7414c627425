//! What `ArduPilot` moves, and what its sensors feel of it.

use std::time::Duration;

use maps::frame::{Point, Vector, World};
use maps::time::Stamp;
use mavlink_ext::convert::{attitude_to_ned, to_frd, to_ned};
use nalgebra::{Point3, Vector3};

use super::Setup;
use super::packet::Packet;
use crate::rays::{Hit, Rays, Snapshot};
use crate::vehicle::Motion;
use crate::vehicle::copter::GRAVITY;
use crate::vehicle::quadrotor::{Frame, Quadrotor};
use crate::vehicle::rover::{Chassis, Control, Rover};

/// How far a rangefinder sees.
const RANGE_M: f64 = 40.0;
/// What it says where it sees nothing: more than any `RNGFND1_MAX`.
const NO_ECHO_M: f64 = 1000.0;
/// How often it is looked at where those are that move; what stands still is always where it is.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Rays to the ground start this far above the skids, so that they start above it.
const ABOVE_M: f64 = 0.2;
/// Where a rover's rangefinder is: ahead of its axle and above the ground.
const BUMPER_M: [f64; 2] = [0.35, 0.15];
/// A rover's steering servo and motor.
const STEERING: usize = 1;
const THROTTLE: usize = 3;

/// What kind of vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum VehicleKind {
    /// A quadrotor in X, its motors at channels 1 to 4 in `ArduPilot`'s order.
    Copter,
    /// A small car: channel 1 steers, channel 3 drives.
    Rover,
}

impl std::fmt::Display for VehicleKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Copter => "copter",
            Self::Rover => "rover",
        })
    }
}

enum Body {
    Copter(Box<Quadrotor>),
    Rover {
        car: Rover,
        acceleration: Vector<World>,
    },
}

/// What sensors feel, without errors: `ArduPilot` adds its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Senses {
    /// Turn rates about forward, right and down.
    pub gyro_frd_radps: [f64; 3],
    /// Acceleration without gravity along forward, right and down: up by gravity at rest.
    pub force_frd_mps2: [f64; 3],
    /// North, east and down of the world's origin.
    pub position_ned_m: [f64; 3],
    /// Along north, east and down.
    pub velocity_ned_mps: [f64; 3],
    /// The attitude: w, x, y, z.
    pub ned_from_frd_wxyz: [f64; 4],
    /// What the rangefinder reads: a copter's looks down, a rover's ahead.
    pub range_m: f64,
}

/// A vehicle in a scene.
pub struct Plant<'a> {
    body: Body,
    rays: Rays<'a>,
    /// The scene as it was last looked at, and when it is to be looked at again.
    snapshot: Snapshot,
    look_again_s: f64,
    range_m: f64,
    highest_m: f64,
    travelled_m: f64,
}

impl<'a> Plant<'a> {
    pub(super) fn new(setup: &Setup<'_>, rays: Rays<'a>) -> Self {
        let start = setup.start;
        let place = Point::new(start.x_m, start.y_m, 0.0);
        let heading_rad = (90.0 - start.heading_deg).to_radians();
        let body = match setup.vehicle {
            VehicleKind::Copter => Body::Copter(Box::new(Quadrotor::new(
                place,
                heading_rad,
                Frame::default(),
            ))),
            VehicleKind::Rover => Body::Rover {
                car: Rover::new(place, heading_rad, Chassis::default()),
                acceleration: Vector::from_raw(Vector3::zeros()),
            },
        };
        let mut plant = Self {
            body,
            snapshot: rays.at(Stamp::ZERO),
            rays,
            look_again_s: 0.0,
            range_m: NO_ECHO_M,
            highest_m: 0.0,
            travelled_m: 0.0,
        };
        plant.look();
        plant
    }

    /// Moves on by `dt` seconds to `now_s`.
    pub(super) fn step(&mut self, packet: &Packet, now_s: f64, dt: f64) {
        let before = self.motion();
        match &mut self.body {
            Body::Copter(quad) => quad.step([1, 2, 3, 4].map(|motor| packet.power(motor)), dt),
            Body::Rover { car, acceleration } => {
                let chassis = car.chassis;
                // Right is positive for ArduPilot, left for us.
                let wheels_rad = -packet.deflection(STEERING) * chassis.max_steering_rad();
                let control = Control {
                    speed_mps: packet.deflection(THROTTLE) * chassis.top_speed_mps,
                    curvature_per_m: wheels_rad.tan() / chassis.wheelbase_m,
                };
                car.step(control, dt);
                let change = car.motion().velocity.raw - before.velocity.raw;
                *acceleration = Vector::from_raw(change / dt);
            }
        }
        let now = self.motion();
        self.travelled_m += (now.position() - before.position()).norm();
        self.highest_m = self.highest_m.max(now.position().raw.z);
        if now_s >= self.look_again_s {
            self.look_again_s = now_s + LOOK_EVERY.as_secs_f64();
            self.snapshot = self.rays.at(Stamp::ZERO + Duration::from_secs_f64(now_s));
        }
        self.look();
    }

    /// What the rangefinder sees, and where the ground below a copter is.
    fn look(&mut self) {
        let motion = self.motion();
        let (turn, here) = (motion.world_from_body.rotation(), motion.position().raw);
        let (from, direction, inside_m) = match &self.body {
            Body::Copter(_) => {
                let up = turn * Vector3::z();
                (here + up * ABOVE_M, -up, ABOVE_M)
            }
            Body::Rover { .. } => {
                let [ahead, above] = BUMPER_M;
                (
                    here + turn * Vector3::new(ahead, 0.0, above),
                    turn * Vector3::x(),
                    0.0,
                )
            }
        };
        let seen = self.snapshot.cast(from, direction, RANGE_M + inside_m);
        self.range_m = seen.map_or(NO_ECHO_M, |hit| (hit.range_m - inside_m).max(0.0));
        if let Some(ground_m) = self.ground_below(here)
            && let Body::Copter(quad) = &mut self.body
        {
            quad.ground_m = ground_m;
        }
    }

    /// What a copter would land on: nothing that moves.
    fn ground_below(&self, here: Point3<f64>) -> Option<f64> {
        let from = here + Vector3::z() * ABOVE_M;
        let stands = |hit: &Hit| !self.rays.scene().class_of(hit.face.instance).is_traffic();
        let hit = self
            .snapshot
            .cast(from, -Vector3::z(), NO_ECHO_M)
            .filter(stands)?;
        Some(from.z - hit.range_m)
    }

    /// Where the vehicle truly is.
    pub fn motion(&self) -> Motion {
        match &self.body {
            Body::Copter(quad) => quad.motion(),
            Body::Rover { car, .. } => car.motion(),
        }
    }

    /// The highest that it has been, above the origin.
    pub fn highest_m(&self) -> f64 {
        self.highest_m
    }

    /// How long its way was.
    pub fn travelled_m(&self) -> f64 {
        self.travelled_m
    }

    /// What its sensors feel.
    pub fn senses(&self) -> Senses {
        let motion = self.motion();
        let acceleration = match &self.body {
            Body::Copter(quad) => quad.acceleration(),
            Body::Rover { acceleration, .. } => *acceleration,
        };
        let turn = motion.world_from_body.rotation();
        let force = turn.inverse() * (acceleration.raw + Vector3::z() * GRAVITY);
        let attitude = attitude_to_ned(turn);
        let sign = 1.0_f64.copysign(attitude.w);
        Senses {
            gyro_frd_radps: to_frd(motion.rates),
            force_frd_mps2: to_frd(Vector::from_raw(force)),
            position_ned_m: to_ned(motion.position() - Point::origin()),
            velocity_ned_mps: to_ned(motion.velocity),
            ned_from_frd_wxyz: [attitude.w, attitude.i, attitude.j, attitude.k]
                .map(|part| part * sign),
            range_m: self.range_m,
        }
    }
}
