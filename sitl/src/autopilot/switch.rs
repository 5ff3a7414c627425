//! Changes of mode; one that is not possible is refused with its reason in a STATUSTEXT.
//!
//! Source: `ArduPilot` 4.6, `ArduCopter/mode.cpp` and `Rover/mode.cpp` (rules and words). A disarmed vehicle may be put into nearly
//! any mode: the checks before arming are what counts then.

use maps::frame::Point;
use mavlink_ext::dialect::tandem::MavSeverity;

use super::Autopilot;
use super::fence::Parts;
use super::guide::{Goal, Guided};
use super::mode::{Kind, Mode};
use super::parameters::Parameter;
use super::pursuit::Line;

impl Autopilot {
    /// Why it cannot be in that mode, said. What a copter's mode itself says comes first.
    fn mode_failure(&mut self, mode: Mode) -> Option<&'static str> {
        let lost =
            self.armed && mode.needs_position() && self.parameters.is_on(Parameter::GpsDisable);
        match (mode, self.kind) {
            _ if lost => Some("requires position"),
            (Mode::Auto, Kind::Rover) if !self.has_mission() => {
                self.say(
                    MavSeverity::MAV_SEVERITY_NOTICE,
                    "No Mission. Can't set AUTO.",
                );
                Some("init failed")
            }
            (Mode::Auto, Kind::Copter) if self.armed && !self.has_mission() => Some("init failed"),
            (Mode::Auto, Kind::Copter)
                if self.armed && self.on_ground() && self.lacks_takeoff() =>
            {
                self.say(
                    MavSeverity::MAV_SEVERITY_CRITICAL,
                    "Auto: Missing Takeoff Cmd",
                );
                Some("init failed")
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
        if mode == self.mode {
            return true;
        }
        if let Some(reason) = self.mode_failure(mode) {
            let text = match self.kind {
                Kind::Copter => format!("Mode change to {mode} failed: {reason}"),
                Kind::Rover => "Flight mode change failed".to_owned(),
            };
            self.say(MavSeverity::MAV_SEVERITY_WARNING, &text);
            return false;
        }
        // Whoever changes the mode of a vehicle outside of its fence is taken to bring it back.
        let acts = self.parameters.bits(Parameter::FenceAction) != 0;
        if acts && self.fence.begin_recovery(self.now) {
            self.say(MavSeverity::MAV_SEVERITY_INFO, "Manual recovery started");
        }
        self.enter(mode);
        true
    }

    /// Makes the mode's goal the goal.
    pub(super) fn enter(&mut self, mode: Mode) {
        self.mode = mode;
        self.guided = Guided::default();
        self.failsafe.pause_until = None;
        let here = self.estimate.position();
        let home = self.home.unwrap_or(here);
        self.goal = match (mode, self.kind) {
            (Mode::Land, _) => Goal::Land(here),
            (Mode::Rtl, Kind::Copter) if self.armed && !self.on_ground() => {
                Goal::Hover(Point::new(here.raw.x, here.raw.y, self.return_height()))
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

    /// Where a copter flies home: not lower than it is, unless the fence's ceiling is.
    fn return_height(&self) -> f64 {
        let here = self.estimate.position().raw.z;
        let home = self.home.map_or(here, |home| home.raw.z);
        let high = here.max(home + self.parameters.get(Parameter::ReturnHeight) / 100.0);
        let settings = self.fence_settings();
        if self.fence.active(&settings).has(Parts::CEILING) {
            high.min(home + settings.safe_ceiling_m())
        } else {
            high
        }
    }
}
