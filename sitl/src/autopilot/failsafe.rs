//! What happens when the ground station falls silent or the battery runs low, and the stages of a return.

use std::time::Duration;

use maps::frame::Point;
use maps::time::Stamp;
use mavlink_ext::dialect::tandem::MavSeverity;

use super::Autopilot;
use super::guide::Goal;
use super::mode::{Kind, Mode};
use super::parameters::Parameter;

/// What has been noticed, so that it is acted on once.
#[derive(Clone, Debug, Default)]
pub(super) struct Failsafe {
    ground_heard: Option<Stamp>,
    ground_lost: bool,
    battery_low: bool,
}

impl Failsafe {
    /// Whether something is wrong now.
    pub(super) fn is_active(&self) -> bool {
        self.ground_lost || self.battery_low
    }
}

impl Autopilot {
    pub(super) fn hear_ground_station(&mut self, now: Stamp) {
        self.failsafe.ground_heard = Some(now);
        if self.failsafe.ground_lost {
            self.failsafe.ground_lost = false;
            self.say(MavSeverity::MAV_SEVERITY_WARNING, "GCS Failsafe Cleared");
        }
    }

    pub(super) fn check_failsafes(&mut self, now: Stamp) {
        self.check_ground_station(now);
        self.check_battery();
        self.return_in_stages();
    }

    /// Silence counts only while armed, and only of a ground station that was there.
    fn check_ground_station(&mut self, now: Stamp) {
        let timeout = Duration::from_secs_f64(self.parameters.get(Parameter::GroundStationTimeout));
        let silent = self
            .failsafe
            .ground_heard
            .is_some_and(|heard| now.since(heard) > timeout);
        if !silent || !self.armed || self.failsafe.ground_lost {
            return;
        }
        self.failsafe.ground_lost = true;
        let action = self.parameters.get(Parameter::GroundStationAction);
        self.fail("GCS Failsafe", action);
    }

    fn check_battery(&mut self) {
        let low = self.remaining_mah() < self.parameters.get(Parameter::BatteryLow);
        if low && self.armed && !self.failsafe.battery_low {
            let action = self.parameters.get(Parameter::BatteryAction);
            self.fail("Battery 1 is low", action);
        }
        self.failsafe.battery_low = low;
    }

    /// 0 goes on, 1 returns (the battery's 2), 2 lands or holds (the battery's 1): see the parameters.
    fn fail(&mut self, what: &str, action: f64) {
        let battery = what.starts_with("Battery");
        let mode = match (action.round() as i32, battery, self.kind) {
            (1, false, _) | (2, true, _) => Some(Mode::Rtl),
            (2, false, Kind::Copter) | (1, true, Kind::Copter) => Some(Mode::Land),
            (2, false, Kind::Rover) | (1, true, Kind::Rover) => Some(Mode::Hold),
            _ => None,
        };
        let goes_on = format!("{what}: continuing {}", self.mode);
        let text = mode.map_or(goes_on, |mode| format!("{what}: {mode}"));
        self.say(MavSeverity::MAV_SEVERITY_CRITICAL, &text);
        if let Some(mode) = mode {
            self.set_mode(mode);
        }
    }

    /// A copter that returns climbs, then flies home, then lands.
    fn return_in_stages(&mut self) {
        let (Mode::Rtl, Kind::Copter, Goal::Hover(to)) = (self.mode, self.kind, &self.goal) else {
            return;
        };
        let (here, home) = (self.estimate.position().raw, self.home.unwrap_or(*to).raw);
        let radius_m = self.parameters.get(Parameter::CopterWaypointRadius) / 100.0;
        if (to.raw - here).norm() > radius_m {
            return;
        }
        let above_home = Point::new(home.x, home.y, to.raw.z);
        let is_home = (above_home.raw - to.raw).norm() < 1e-9;
        self.goal = if is_home {
            Goal::Land(above_home)
        } else {
            Goal::Hover(above_home)
        };
    }
}
