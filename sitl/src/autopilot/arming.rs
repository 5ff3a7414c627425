//! Whether the motors may run, and in which mode; what is refused is refused with its reason in a STATUSTEXT.

use maps::time::Stamp;
use mavlink_ext::dialect::tandem::MavSeverity;

use super::Autopilot;
use super::guide::{Goal, Guided};
use super::mode::{Kind, Mode};
use super::parameters::Parameter;
use super::pursuit::Line;
use maps::frame::Point;

impl Autopilot {
    /// Everything that stands against arming, whatever the mode.
    pub(super) fn prearm_failures(&self, now: Stamp) -> Vec<&'static str> {
        let mut failures = Vec::new();
        if !self.parameters.is_on(Parameter::ArmingCheck) {
            return failures;
        }
        if self.parameters.is_on(Parameter::GpsDisable) {
            failures.push("GPS 1: Bad fix");
        } else if !self.has_fix(now) {
            failures.push("AHRS: waiting for home");
        }
        if self.remaining_mah() < self.parameters.get(Parameter::BatteryLow) {
            failures.push("Battery 1 below minimum arming capacity");
        }
        failures
    }

    pub(super) fn remaining_mah(&self) -> f64 {
        self.battery.share() * self.battery.capacity_mah
    }

    /// Lets the motors run. False, with the reasons said, if something stands against it.
    pub(super) fn arm(&mut self, now: Stamp) -> bool {
        if self.armed {
            return true;
        }
        let failures = self.prearm_failures(now);
        for failure in &failures {
            self.say(
                MavSeverity::MAV_SEVERITY_CRITICAL,
                &format!("PreArm: {failure}"),
            );
        }
        let reason = if self.mode.can_arm() {
            self.mode_failure(self.mode)
        } else {
            Some("mode not armable")
        };
        if let Some(reason) = reason {
            let text = format!("Arm: {} {reason}", self.mode);
            self.say(MavSeverity::MAV_SEVERITY_CRITICAL, &text);
        }
        if !failures.is_empty() || reason.is_some() {
            return false;
        }
        self.armed = true;
        self.idle_since = None;
        self.home = Some(self.estimate.position());
        self.goal = Goal::Stay;
        self.restart_mission();
        self.reverse = false;
        self.speed_mps = None;
        self.say(MavSeverity::MAV_SEVERITY_INFO, "Arming motors");
        self.out.push(self.heartbeat());
        self.out.extend(self.home_position());
        true
    }

    /// Stops the motors.
    pub(super) fn disarm(&mut self) {
        if self.armed {
            self.armed = false;
            self.idle_since = None;
            self.goal = Goal::Stay;
            self.say(MavSeverity::MAV_SEVERITY_INFO, "Disarming motors");
            self.out.push(self.heartbeat());
        }
    }

    /// Why it cannot be in that mode.
    fn mode_failure(&self, mode: Mode) -> Option<&'static str> {
        let no_position = self.parameters.is_on(Parameter::GpsDisable);
        match mode {
            _ if mode.needs_position() && no_position => Some("requires position"),
            Mode::Auto if !self.has_mission() => Some("requires a mission"),
            Mode::Auto if self.on_ground() && self.lacks_takeoff() => {
                Some("mission starts without takeoff")
            }
            _ => None,
        }
    }

    /// Changes the mode by its number. False, with the reason said, if that is not possible.
    pub(super) fn set_mode_number(&mut self, number: u32) -> bool {
        if let Some(mode) = Mode::from_number(self.kind, number) {
            self.set_mode(mode)
        } else {
            self.say(
                MavSeverity::MAV_SEVERITY_WARNING,
                &format!("No such mode {number}"),
            );
            false
        }
    }

    /// Changes the mode. False, with the reason said, if that is not possible.
    pub(super) fn set_mode(&mut self, mode: Mode) -> bool {
        if let Some(reason) = self.mode_failure(mode) {
            let text = format!("Mode {mode}: {reason}");
            self.say(MavSeverity::MAV_SEVERITY_WARNING, &text);
            return false;
        }
        if mode != self.mode {
            self.enter(mode);
        }
        true
    }

    /// Makes the mode's goal the goal.
    pub(super) fn enter(&mut self, mode: Mode) {
        self.mode = mode;
        self.guided = Guided::default();
        let here = self.estimate.position();
        let home = self.home.unwrap_or(here);
        self.goal = match (mode, self.kind) {
            (Mode::Land, _) => Goal::Land(here),
            (Mode::Rtl, Kind::Copter) if self.armed && !self.on_ground() => {
                let high = home.raw.z + self.parameters.get(Parameter::ReturnHeight) / 100.0;
                Goal::Hover(Point::new(here.raw.x, here.raw.y, here.raw.z.max(high)))
            }
            (Mode::Rtl, Kind::Rover) => {
                self.reverse = false;
                Goal::Drive {
                    line: Line::new(here, [home]),
                    items: Vec::new(),
                }
            }
            _ => Goal::Stay,
        };
        if mode == Mode::Auto {
            self.resume_mission();
        }
        self.out.push(self.heartbeat());
    }
}
