//! A simulated autopilot: what `ArduPilot` does as far as ground stations and companions can tell, without sockets or
//! clocks.
//!
//! [`Autopilot::step`] moves the vehicle on and returns what it sends by itself; [`Autopilot::handle`] takes a message
//! and returns the answers. It steers by what its sensors say, not by the truth.
//!
//! - [`mode`], [`parameters`]: `ArduPilot`'s numbers and names.
//! - `command`, `arming`, `switch` (of modes), `streams`, `telemetry`: the services.
//! - `plans`: missions and fences as they come in.
//! - `failsafe`, `power`, `fence`: what it does when something goes wrong.
//! - `guide`, `execute`, [`pursuit`]: where to go, by mission or command, and how to get there.

mod arming;
mod command;
mod execute;
mod failsafe;
mod fence;
mod guide;
mod guided;
pub mod mode;
pub mod parameters;
mod plans;
mod power;
pub mod pursuit;
mod streams;
mod switch;
mod telemetry;

use std::time::Duration;

use maps::frame::{Isometry, Point, World};
use maps::time::Stamp;
use mavlink_ext::dialect::tandem::{
    MavMissionType, MavSeverity, MavType, ODOMETRY_DATA, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use mavlink_ext::dialect::{char_array, cmd};
use mavlink_ext::mission::{MissionItem, Server};
use mavlink_ext::service::is_for;
use mavlink_ext::{Address, Message, ftp, params};
use nalgebra::Isometry3;

use crate::vehicle::Motion;
use crate::vehicle::battery::Battery;
use crate::vehicle::copter::{self, Copter, Wind};
use crate::vehicle::gnss::{Gnss, Quality};
use crate::vehicle::rover::{self, Rover};
use crate::wgs84::Origin;
use execute::Execution;
use failsafe::Failsafe;
use fence::{Fence, zones};
use guide::{Goal, Guided};
use mode::{Kind, Mode};
use parameters::{Parameter, Parameters};
use plans::{accepts_in_the_air, accepts_on_the_ground};
use streams::Streams;

/// After power-up the receiver needs this long for a fix, and the estimator to settle.
const BOOT: Duration = Duration::from_secs(2);
/// Heartbeats of the autopilot itself.
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(1);
/// Bytes of files that it sends in a second.
const FILES_BYTES_PER_S: u32 = 50_000;
/// Parameters sent in one step while a list goes out.
const PARAMETERS_PER_STEP: usize = 2;

/// The vehicle that is flown or driven.
#[derive(Clone, Debug)]
pub enum Vehicle {
    /// A quadrotor.
    Copter(Box<Copter>),
    /// A small car.
    Rover(Rover),
}

/// What an autopilot is installed on.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Its MAVLink address.
    pub address: Address,
    /// The vehicle.
    pub vehicle: Vehicle,
    /// Where the world is on Earth.
    pub origin: Origin,
    /// Its receiver.
    pub gnss: Quality,
    /// Seed of its receiver's errors.
    pub seed: u64,
}

/// ODOMETRY messages from the companion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OdometryHeard {
    /// How many were usable: in the frames that `ArduPilot` takes, and finite.
    pub accepted: u64,
    /// How many were not.
    pub refused: u64,
    /// Quality of the last one, -1..=100.
    pub last_quality: Option<i8>,
}

/// An autopilot and its vehicle.
#[derive(Clone, Debug)]
pub struct Autopilot {
    address: Address,
    kind: Kind,
    vehicle: Vehicle,
    gnss: Gnss,
    battery: Battery,
    origin: Origin,
    parameters: Parameters,
    streams: Streams,
    /// Serves the parameters as one file.
    files: ftp::Server,
    mission: Server,
    execution: Execution,
    /// Polygons and circles as they were uploaded; `fence` has them as they are in the world.
    fence_plan: Server,
    fence: Fence,
    failsafe: Failsafe,
    /// When it says next what stands against arming.
    prearm_said_next: Option<Stamp>,
    mode: Mode,
    armed: bool,
    /// Since when it has stood on the ground, armed and not wanting to fly.
    idle_since: Option<Stamp>,
    home: Option<Point<World>>,
    /// Where it thinks it is.
    estimate: Motion,
    goal: Goal,
    guided: Guided,
    /// Speed asked for by command or mission, m/s.
    speed_mps: Option<f64>,
    reverse: bool,
    odometry: OdometryHeard,
    next_heartbeat: Stamp,
    now: Stamp,
    out: Vec<Message>,
}

impl Autopilot {
    /// Powers it up: disarmed, without a mission, parameters at their defaults.
    pub fn new(setup: Setup) -> Self {
        let (kind, battery, accept): (_, _, fn(&MissionItem) -> _) = match setup.vehicle {
            Vehicle::Copter(_) => (
                Kind::Copter,
                Battery::lithium(4, 5200.0),
                accepts_in_the_air,
            ),
            Vehicle::Rover(_) => (
                Kind::Rover,
                Battery::lithium(3, 5200.0),
                accepts_on_the_ground,
            ),
        };
        let estimate = true_motion(&setup.vehicle);
        Self {
            address: setup.address,
            kind,
            vehicle: setup.vehicle,
            gnss: Gnss::new(setup.gnss, setup.seed),
            battery,
            origin: setup.origin,
            parameters: Parameters::new(kind),
            streams: Streams::default(),
            files: ftp::Server::new(setup.address, None, FILES_BYTES_PER_S),
            mission: Server::new(setup.address, accept),
            execution: Execution::default(),
            fence_plan: Server::of_kind(
                setup.address,
                MavMissionType::MAV_MISSION_TYPE_FENCE,
                (zones::accepts, zones::accepts_all),
            ),
            fence: Fence::default(),
            failsafe: Failsafe::default(),
            prearm_said_next: None,
            mode: kind.first_mode(),
            armed: false,
            idle_since: None,
            home: None,
            estimate,
            goal: Goal::Stay,
            guided: Guided::default(),
            speed_mps: None,
            reverse: false,
            odometry: OdometryHeard::default(),
            next_heartbeat: Stamp::ZERO,
            now: Stamp::ZERO,
            out: Vec::new(),
        }
    }

    /// Moves on by `dt` seconds to `now`; returns what it sends.
    pub fn step(&mut self, now: Stamp, dt: f64) -> Vec<Message> {
        self.now = now;
        self.apply_parameters();
        self.sense(now, dt);
        self.check_failsafes(now);
        self.say_prearm_failures(now);
        self.execute_mission(now);
        self.move_on(now, dt);
        self.disarm_on_the_ground(now);
        for plan in [&mut self.mission, &mut self.fence_plan] {
            self.out.extend(plan.tick(now).send);
        }
        if now >= self.next_heartbeat {
            self.next_heartbeat = now + HEARTBEAT_INTERVAL;
            self.out.push(self.heartbeat());
        }
        for stream in self.streams.due(now, &self.parameters) {
            if let Some(message) = self.telemetry(stream, now) {
                self.out.push(message);
            }
        }
        self.out.extend(self.files.tick(now));
        let listed = self.parameters.next_listed(PARAMETERS_PER_STEP);
        self.out.extend(listed);
        std::mem::take(&mut self.out)
    }

    /// Tells it of a message that came in; returns the answers.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Vec<Message> {
        if from == self.address || !is_for(self.address, message) {
            return Vec::new();
        }
        self.now = now;
        self.exchange_plan(now, from, message);
        match message {
            Message::HEARTBEAT(heartbeat) => {
                self.streams.start();
                if heartbeat.mavtype == MavType::MAV_TYPE_GCS {
                    self.hear_ground_station(now);
                }
            }
            Message::COMMAND_LONG(command) => self.command_long(now, from, command),
            Message::COMMAND_INT(command) => self.command_int(now, from, command),
            Message::SET_MODE(set) => {
                self.set_mode_number(set.custom_mode);
            }
            Message::MISSION_SET_CURRENT(set) => {
                self.set_mission_current(usize::from(set.seq));
                self.out.push(self.mission_current());
            }
            Message::PARAM_REQUEST_LIST(_) => self.parameters.list(),
            Message::PARAM_REQUEST_READ(read) => {
                let index = match usize::try_from(read.param_index) {
                    Ok(index) => Some(index),
                    Err(_by_name) => self
                        .parameters
                        .index_of(read.param_id.to_str().unwrap_or_default()),
                };
                self.out
                    .extend(index.and_then(|index| self.parameters.message(index)));
            }
            Message::PARAM_SET(set) => {
                let name = set.param_id.to_str().unwrap_or_default();
                let index = self.parameters.set(name, set.param_value);
                self.out
                    .extend(index.and_then(|index| self.parameters.message(index)));
            }
            Message::REQUEST_DATA_STREAM(request) => {
                let interval = match (request.start_stop, request.req_message_rate) {
                    (0, _) | (_, 0) => Duration::ZERO,
                    (_, rate_hz) => Duration::from_secs(1) / u32::from(rate_hz),
                };
                self.streams.ask_group(request.req_stream_id, interval);
            }
            Message::FILE_TRANSFER_PROTOCOL(_) => {
                let packed = params::pack(&self.parameters.all());
                self.files.publish(params::PACKED_PATH, packed);
                self.out.extend(self.files.handle(now, from, message));
            }
            Message::TIMESYNC(sync) => self.out.extend(timesync_answer(now, from, sync)),
            Message::ODOMETRY(odometry) => self.hear_odometry(from, odometry),
            Message::SET_POSITION_TARGET_LOCAL_NED(target) => self.go_local(now, target),
            Message::SET_POSITION_TARGET_GLOBAL_INT(target) => self.go_global(now, target),
            _ => {}
        }
        std::mem::take(&mut self.out)
    }

    /// Its MAVLink address.
    pub fn address(&self) -> Address {
        self.address
    }

    /// Where the vehicle truly is.
    pub fn truth(&self) -> Motion {
        true_motion(&self.vehicle)
    }

    /// Where it thinks it is.
    pub fn estimate(&self) -> Motion {
        self.estimate
    }

    /// What it is doing.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Whether its motors may run.
    pub fn is_armed(&self) -> bool {
        self.armed
    }

    /// How its mission goes.
    pub fn execution(&self) -> &Execution {
        &self.execution
    }

    /// Its mission.
    pub fn mission_items(&self) -> &[MissionItem] {
        self.mission.items()
    }

    /// What it has heard from a companion about where it is.
    pub fn odometry(&self) -> OdometryHeard {
        self.odometry
    }

    /// The last place of the mission that it was sent to, in the world.
    pub fn last_mission_target(&self) -> Option<Point<World>> {
        let mut items = self.mission.items().iter().rev();
        let item = items.find(|item| item.command == cmd::NAV_WAYPOINT)?;
        Some(self.place_of(item))
    }

    fn say(&mut self, severity: MavSeverity, text: &str) {
        self.out.push(Message::STATUSTEXT(STATUSTEXT_DATA {
            severity,
            text: char_array(text),
            id: 0,
            chunk_seq: 0,
        }));
    }

    /// Parameters that are limits of the vehicle or of what is around it.
    fn apply_parameters(&mut self) {
        let get = |parameter| self.parameters.get(parameter);
        self.battery.capacity_mah = get(Parameter::BatteryCapacity);
        match &mut self.vehicle {
            Vehicle::Copter(copter) => {
                // Beyond these it does not arm, but it may be told so in flight.
                let tilt_deg = (get(Parameter::AngleMax) / 100.0).clamp(10.0, 80.0);
                copter.limits.tilt_rad = tilt_deg.to_radians();
                // The wind blows from there: in the world, towards the opposite direction.
                let (sin, cos) = get(Parameter::WindDirection).to_radians().sin_cos();
                let speed = get(Parameter::WindSpeed);
                copter.wind = Wind {
                    mean: maps::frame::Vector::new(-speed * sin, -speed * cos, 0.0),
                    gust_mps: get(Parameter::WindGusts),
                };
            }
            Vehicle::Rover(rover) => {
                rover.chassis.acceleration_mps2 = get(Parameter::Acceleration);
            }
        }
    }

    fn has_fix(&self, now: Stamp) -> bool {
        has_booted(now) && !self.parameters.is_on(Parameter::GpsDisable)
    }

    /// The estimate: attitude and velocity as they are, the position with the receiver's error. Without a fix the
    /// position is carried on by the velocity.
    fn sense(&mut self, now: Stamp, dt: f64) {
        let truth = self.truth();
        let position = if self.has_fix(now) {
            self.gnss.measure(truth.position(), dt)
        } else {
            self.estimate.position() + truth.velocity * dt
        };
        self.estimate = Motion {
            world_from_body: Isometry::claim(Isometry3::from_parts(
                position.raw.into(),
                truth.world_from_body.rotation(),
            )),
            ..truth
        };
        if self.home.is_none() && self.has_fix(now) {
            self.home = Some(position);
            self.out.extend(self.home_position());
        }
    }

    fn move_on(&mut self, now: Stamp, dt: f64) {
        let electronics_a = 0.6;
        match self.kind {
            Kind::Copter => {
                let control = self.fly(now);
                if let Vehicle::Copter(copter) = &mut self.vehicle {
                    copter.step(control, dt);
                    let motors_a = if control == copter::Control::Off {
                        0.0
                    } else {
                        14.0 * copter.effort()
                    };
                    self.battery.draw(electronics_a + motors_a, dt);
                }
            }
            Kind::Rover => {
                let control = self.drive(now);
                if let Vehicle::Rover(rover) = &mut self.vehicle {
                    rover.step(control, dt);
                    self.battery
                        .draw(electronics_a + 4.0 * rover.speed_mps().abs(), dt);
                }
            }
        }
    }

    fn on_ground(&self) -> bool {
        match &self.vehicle {
            Vehicle::Copter(copter) => copter.on_ground(),
            Vehicle::Rover(_) => true,
        }
    }

    fn hear_odometry(&mut self, from: Address, odometry: &ODOMETRY_DATA) {
        use mavlink_ext::dialect::tandem::MavFrame;
        if from.system != self.address.system {
            return;
        }
        // ArduPilot silently drops every other pair of frames.
        let frames = odometry.frame_id == MavFrame::MAV_FRAME_LOCAL_FRD
            && odometry.child_frame_id == MavFrame::MAV_FRAME_BODY_FRD;
        let mut numbers = [odometry.x, odometry.y, odometry.z]
            .into_iter()
            .chain(odometry.q);
        if frames && numbers.all(f32::is_finite) {
            self.odometry.accepted += 1;
            self.odometry.last_quality = Some(odometry.quality);
        } else {
            self.odometry.refused += 1;
        }
    }
}

fn has_booted(now: Stamp) -> bool {
    now >= Stamp::ZERO + BOOT
}

fn true_motion(vehicle: &Vehicle) -> Motion {
    match vehicle {
        Vehicle::Copter(copter) => copter.motion(),
        Vehicle::Rover(rover) => rover.motion(),
    }
}

/// Answers a request; what is itself an answer is none.
fn timesync_answer(now: Stamp, from: Address, sync: &TIMESYNC_DATA) -> Option<Message> {
    (sync.tc1 == 0).then(|| {
        Message::TIMESYNC(TIMESYNC_DATA {
            tc1: now.as_nanos().cast_signed(),
            ts1: sync.ts1,
            target_system: from.system.0,
            target_component: from.component.0,
        })
    })
}

/// What a rover does that is to stand.
const STAND: rover::Control = rover::Control {
    speed_mps: 0.0,
    curvature_per_m: 0.0,
};

#[cfg(test)]
mod tests;
