//! Commands: `COMMAND_LONG` and `COMMAND_INT`, every one of which is answered.

use std::time::Duration;

use maps::frame::Point;
use maps::time::Stamp;
use mavlink_ext::convert::e7_to_deg;
use mavlink_ext::dialect::cmd;
use mavlink_ext::dialect::tandem::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MESSAGE_INTERVAL_DATA, MavResult,
    MavSeverity,
};
use mavlink_ext::mission::MissionFrame;
use mavlink_ext::{Address, Message};

use super::Autopilot;
use super::arming::Checks;
use super::guide::Goal;
use super::guided::altitude_frame;
use super::mode::{Kind, Mode};
use super::power::Monitor;
use super::streams::Stream;
use super::telemetry::flight_information;

/// Disarms in the air, and arms without the checks that can be done without.
const FORCE: f32 = 21196.0;
/// `ArduPilot`'s own number for arming so.
const FORCE_ARMING: f32 = 2989.0;
/// `MAV_CMD_BATTERY_RESET` of `ArduPilot`'s dialect: a mask of batteries, and what is left in percent.
const BATTERY_RESET: u16 = 42_651;

/// What both kinds of command say.
struct Command {
    number: u16,
    /// Parameters 1 to 4.
    params: [f32; 4],
    /// Latitude and longitude, if the command has a place.
    place: Option<[f64; 2]>,
    frame: MissionFrame,
    /// Parameter 7.
    z: f64,
}

type Outcome = Result<(), MavResult>;

const DENIED: Outcome = Err(MavResult::MAV_RESULT_DENIED);
const FAILED: Outcome = Err(MavResult::MAV_RESULT_FAILED);

impl Autopilot {
    pub(super) fn command_long(&mut self, now: Stamp, from: Address, long: &COMMAND_LONG_DATA) {
        let [lat, lon] = [long.param5, long.param6].map(f64::from);
        let command = Command {
            number: long.command,
            params: [long.param1, long.param2, long.param3, long.param4],
            place: place(lat, lon),
            frame: MissionFrame::GlobalRelativeAlt,
            z: f64::from(long.param7),
        };
        self.acknowledge(now, from, &command);
    }

    pub(super) fn command_int(&mut self, now: Stamp, from: Address, int: &COMMAND_INT_DATA) {
        let global = altitude_frame(int.frame);
        let [lat, lon] = [int.x, int.y].map(e7_to_deg);
        // i32::MAX stands for "not given", as NaN does for floats.
        let given = int.x != i32::MAX && int.y != i32::MAX;
        let command = Command {
            number: int.command,
            params: [int.param1, int.param2, int.param3, int.param4],
            place: global.filter(|_| given).and_then(|_| place(lat, lon)),
            frame: global.unwrap_or(MissionFrame::Command),
            z: f64::from(int.z),
        };
        self.acknowledge(now, from, &command);
    }

    fn acknowledge(&mut self, now: Stamp, from: Address, command: &Command) {
        let result = self
            .obey(now, from, command)
            .err()
            .unwrap_or(MavResult::MAV_RESULT_ACCEPTED);
        self.out.push(Message::COMMAND_ACK(COMMAND_ACK_DATA {
            command: command.number,
            result,
            progress: 0,
            result_param2: 0,
            target_system: from.system.0,
            target_component: from.component.0,
        }));
    }

    fn obey(&mut self, now: Stamp, from: Address, command: &Command) -> Outcome {
        let [first, second, ..] = command.params;
        match command.number {
            cmd::COMPONENT_ARM_DISARM => self.arm_or_disarm(now, command.params),
            cmd::RUN_PREARM_CHECKS => {
                self.run_checks(now);
                Ok(())
            }
            cmd::DO_SET_MODE => done(second >= 0.0 && self.set_mode_number(second as u32)),
            cmd::NAV_TAKEOFF => self.take_off(command.z),
            cmd::NAV_LAND if self.kind == Kind::Copter => done(self.set_mode(Mode::Land)),
            cmd::NAV_RETURN_TO_LAUNCH => done(self.set_mode(Mode::Rtl)),
            cmd::NAV_LOITER_UNLIM => done(self.set_mode(self.pause_mode())),
            cmd::DO_PAUSE_CONTINUE => self.pause_or_continue(first),
            cmd::DO_REPOSITION => self.reposition(command),
            cmd::DO_CHANGE_SPEED => denied_unless(self.change_speed(second)),
            cmd::DO_SET_REVERSE if self.kind == Kind::Rover => {
                self.reverse = first > 0.5;
                Ok(())
            }
            cmd::DO_SET_HOME => self.set_home(command),
            cmd::DO_FENCE_ENABLE => denied_unless(self.switch_fence(first, second)),
            BATTERY_RESET => denied_unless(self.replace_battery(first, second)),
            cmd::MISSION_START => self.start_mission(first),
            cmd::DO_SET_MISSION_CURRENT => {
                denied_unless(first >= 0.0 && self.set_mission_current(first as usize))
            }
            cmd::SET_MESSAGE_INTERVAL => self.set_interval(first, second),
            cmd::GET_MESSAGE_INTERVAL => {
                self.get_interval(first);
                Ok(())
            }
            cmd::REQUEST_MESSAGE => self.send_once(now, first),
            cmd::GET_HOME_POSITION => self.send_once(now, 242.0),
            cmd::REQUEST_AUTOPILOT_CAPABILITIES => self.send_once(now, 148.0),
            cmd::REQUEST_PROTOCOL_VERSION => self.send_once(now, 300.0),
            _ => {
                tracing::debug!(command = command.number, %from, "unsupported command");
                Err(MavResult::MAV_RESULT_UNSUPPORTED)
            }
        }
    }

    fn arm_or_disarm(&mut self, now: Stamp, [arm, force, ..]: [f32; 4]) -> Outcome {
        if arm > 0.5 {
            let forced = [FORCE, FORCE_ARMING]
                .iter()
                .any(|magic| (force - magic).abs() < 0.5);
            let checks = if forced {
                Checks::Mandatory
            } else {
                Checks::Wanted
            };
            return done(self.arm(now, checks));
        }
        if !self.on_ground() && (force - FORCE).abs() > 0.5 {
            return FAILED;
        }
        self.disarm();
        Ok(())
    }

    /// Of the first battery, the only one there is.
    fn replace_battery(&mut self, mask: f32, percent: f32) -> bool {
        let ours = mask >= 0.0 && mask as u32 & 1 != 0;
        let possible = ours && (0.0..=100.0).contains(&percent);
        if possible {
            self.battery.replace(f64::from(percent) / 100.0);
            self.failsafe.battery = Monitor::default();
        }
        possible
    }

    /// To a height above home, from the ground.
    fn take_off(&mut self, height_m: f64) -> Outcome {
        if self.kind != Kind::Copter {
            return Err(MavResult::MAV_RESULT_UNSUPPORTED);
        }
        let ready = self.armed && self.mode == Mode::Guided && self.on_ground();
        if !ready || !height_m.is_finite() || height_m <= 0.0 {
            return FAILED;
        }
        let here = self.estimate.position().raw;
        let home = self.home.map_or(0.0, |home| home.raw.z);
        self.goal = Goal::TakeOff(Point::new(here.x, here.y, home + height_m));
        Ok(())
    }

    fn pause_mode(&self) -> Mode {
        match self.kind {
            Kind::Copter => Mode::Loiter,
            Kind::Rover => Mode::Hold,
        }
    }

    /// 0 pauses, 1 goes on with the mission.
    fn pause_or_continue(&mut self, go_on: f32) -> Outcome {
        let mode = if go_on > 0.5 {
            Mode::Auto
        } else {
            self.pause_mode()
        };
        done(self.set_mode(mode))
    }

    /// Parameter 2, bit 0: change to GUIDED if it is not in it.
    fn reposition(&mut self, command: &Command) -> Outcome {
        let Some([lat_deg, lon_deg]) = command.place else {
            return DENIED;
        };
        let may_change = command.params[1] as u32 & 1 != 0;
        if self.mode != Mode::Guided && !(may_change && self.set_mode(Mode::Guided)) {
            return DENIED;
        }
        if command.params[0] > 0.0 && !self.change_speed(command.params[0]) {
            return DENIED;
        }
        let mut to = self.place(lat_deg, lon_deg, (command.frame, command.z));
        if !command.z.is_finite() {
            to.raw.z = self.estimate.position().raw.z;
        }
        done(self.go_to(to))
    }

    /// Parameter 1: here.
    fn set_home(&mut self, command: &Command) -> Outcome {
        let home = if command.params[0] > 0.5 {
            self.estimate.position()
        } else if let (Some([lat_deg, lon_deg]), true) = (command.place, command.z.is_finite()) {
            // As for ArduPilot: the altitude of a home is above sea level unless the frame says otherwise.
            let place = self
                .place(lat_deg, lon_deg, (MissionFrame::Global, command.z))
                .raw;
            Point::new(place.x, place.y, place.z)
        } else {
            return DENIED;
        };
        self.home = Some(home);
        self.out.extend(self.home_position());
        Ok(())
    }

    /// As `ArduCopter`: only when armed.
    fn start_mission(&mut self, first_item: f32) -> Outcome {
        if !self.armed {
            let severity = MavSeverity::MAV_SEVERITY_WARNING;
            self.say(severity, "Mission start: not armed");
            return FAILED;
        }
        if self.mode == Mode::Auto {
            self.resume_mission();
        } else if !self.set_mode(Mode::Auto) {
            return FAILED;
        }
        if first_item > 0.0 && !self.set_mission_current(first_item as usize) {
            return DENIED;
        }
        Ok(())
    }

    /// In microseconds; 0 for the default, -1 for never.
    fn set_interval(&mut self, id: f32, micros: f32) -> Outcome {
        let interval = match micros {
            m if m < 0.0 => Some(Duration::ZERO),
            // Not finer than the steps of the simulation.
            m if m > 0.0 => Some(Duration::from_micros(m as u64).max(Duration::from_millis(20))),
            _ => None,
        };
        done(id >= 0.0 && self.streams.ask(id as u32, interval))
    }

    fn get_interval(&mut self, id: f32) {
        let interval = self.streams.interval(id as u32, &self.parameters);
        let interval_us = match interval {
            Some(interval) if interval.is_zero() => -1,
            Some(interval) => interval.as_micros() as i32,
            None => 0,
        };
        self.out
            .push(Message::MESSAGE_INTERVAL(MESSAGE_INTERVAL_DATA {
                interval_us,
                message_id: id as u16,
            }));
    }

    fn send_once(&mut self, now: Stamp, id: f32) -> Outcome {
        let message = match id as u32 {
            148 => Some(self.autopilot_version()),
            49 => Some(self.global_origin(now)),
            0 => Some(self.heartbeat()),
            300 => Some(protocol_version()),
            264 => Some(flight_information(now)),
            id => Stream::of(id).and_then(|stream| self.telemetry(stream, now)),
        };
        let sent = message.is_some();
        self.out.extend(message);
        done(sent)
    }
}

fn place(lat_deg: f64, lon_deg: f64) -> Option<[f64; 2]> {
    let somewhere = lat_deg.abs() <= 90.0
        && lon_deg.abs() <= 180.0
        && (lat_deg.abs() > 0.0 || lon_deg.abs() > 0.0);
    somewhere.then_some([lat_deg, lon_deg])
}

fn done(it: bool) -> Outcome {
    if it { Ok(()) } else { FAILED }
}

fn denied_unless(it: bool) -> Outcome {
    if it { Ok(()) } else { DENIED }
}

fn protocol_version() -> Message {
    use mavlink_ext::dialect::tandem::PROTOCOL_VERSION_DATA;
    Message::PROTOCOL_VERSION(PROTOCOL_VERSION_DATA {
        version: 200,
        min_version: 200,
        max_version: 200,
        ..PROTOCOL_VERSION_DATA::default()
    })
}
