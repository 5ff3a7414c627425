//! What happens when the ground station falls silent, the battery runs low or the fence is breached, and the stages of a
//! return.
//!
//! Source: `ArduPilot` 4.6, `ArduCopter/events.cpp`, `ArduCopter/fence.cpp`, `Rover/failsafe.cpp`, `Rover/fence.cpp` (rules and
//! words). There is no `SmartRTL` here: what asks for it gets what `ArduPilot` does where that is not available.

use std::time::Duration;

use maps::frame::Point;
use maps::time::Stamp;
use mavlink_ext::dialect::tandem::MavSeverity;

use super::fence::{self, Parts};
use super::guide::Goal;
use super::mode::{Kind, Mode};
use super::parameters::Parameter;
use super::power::{Charge, Limits, Monitor, Reading};
use super::{Autopilot, execute};

/// Further than this outside of the fence, a vehicle does not try to return.
const GIVE_UP_M: f64 = 100.0;
/// A failsafe that lands gives the pilot this long before it comes down.
const LAND_PAUSE: Duration = Duration::from_secs(4);
/// Bits of a copter's `FS_OPTIONS`.
const CONTINUE_IN_AUTO: u32 = 2;
const CONTINUE_LANDING: u32 = 8;
const CONTINUE_WITH_PILOT: u32 = 16;
/// Landing, in [`Action::urgency`].
const URGENCY_OF_LANDING: usize = 1;

/// What has been noticed, so that it is acted on once.
#[derive(Clone, Debug, Default)]
pub(super) struct Failsafe {
    pub(super) battery: Monitor,
    ground_heard: Option<Stamp>,
    /// Copter: it has acted. Rover: it has noticed, at that time.
    ground_lost: Option<Stamp>,
    /// Rover: it has acted.
    triggered: bool,
    /// Copter: until then it does not come down to land.
    pub(super) pause_until: Option<Stamp>,
}

impl Failsafe {
    /// Whether something is wrong now.
    pub(super) fn is_active(&self, kind: Kind) -> bool {
        match kind {
            Kind::Copter => self.battery.noticed() > Charge::Enough || self.ground_lost.is_some(),
            Kind::Rover => self.triggered,
        }
    }

    /// Copter: whether the ground station is missing.
    pub(super) fn misses_ground_station(&self) -> bool {
        self.ground_lost.is_some()
    }
}

/// What to do; the numbers are those of parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    Nothing,
    Land,
    Return,
    SmartReturn,
    SmartReturnOrStop,
    Terminate,
    MissionReturn,
    Brake,
    Hold,
}

impl Action {
    /// Of `BATT_FS_*_ACT`, and of a rover's `FS_ACTION` and `FENCE_ACTION`.
    fn of(kind: Kind, number: u32) -> Self {
        match (kind, number) {
            (Kind::Copter, 1) => Self::Land,
            (Kind::Copter, 2) | (Kind::Rover, 1) => Self::Return,
            (_, 3) => Self::SmartReturn,
            (_, 4) => Self::SmartReturnOrStop,
            (_, 5) => Self::Terminate,
            (Kind::Copter, 6) => Self::MissionReturn,
            (Kind::Copter, 7) => Self::Brake,
            (Kind::Rover, 2) => Self::Hold,
            _ => Self::Nothing,
        }
    }

    /// Of a copter's `FS_GCS_ENABLE`.
    fn of_silence(number: u32) -> Self {
        match number {
            0 => Self::Nothing,
            3 => Self::SmartReturn,
            4 => Self::SmartReturnOrStop,
            5 => Self::Land,
            6 => Self::MissionReturn,
            7 => Self::Brake,
            _ => Self::Return,
        }
    }

    /// Where it is in the order in which a battery's actions may follow one another: the most urgent first.
    fn urgency(self) -> usize {
        let order = [
            &[Self::Terminate] as &[Self],
            &[Self::Land, Self::Hold],
            &[Self::Return],
            &[Self::SmartReturnOrStop],
            &[Self::SmartReturn],
            &[Self::Nothing],
        ];
        order
            .iter()
            .position(|equal| equal.contains(&self))
            .unwrap_or(order.len())
    }
}

impl Autopilot {
    pub(super) fn hear_ground_station(&mut self, now: Stamp) {
        self.failsafe.ground_heard = Some(now);
    }

    pub(super) fn check_failsafes(&mut self, now: Stamp) {
        self.check_battery(now);
        match self.kind {
            Kind::Copter => self.check_ground_station_of_copter(now),
            Kind::Rover => self.check_ground_station_of_rover(now),
        }
        self.check_fence(now);
        self.return_in_stages();
    }

    /// What the battery monitor reads.
    pub(super) fn battery_reading(&self) -> Reading {
        let set = self.parameters.get(Parameter::BatteryVoltage);
        Reading {
            voltage_v: if set > 0.0 {
                set
            } else {
                self.battery.voltage_v()
            },
            left_mah: self.battery.share() * self.battery.capacity_mah,
        }
    }

    /// A battery counts only while armed.
    fn check_battery(&mut self, now: Stamp) {
        if !self.armed {
            return;
        }
        let (reading, limits) = (self.battery_reading(), Limits::of(&self.parameters));
        let (what, action) = match self.failsafe.battery.watch(now, reading, &limits) {
            Some(Charge::Low) => ("low", Parameter::BatteryAction),
            Some(Charge::Critical) => ("critical", Parameter::BatteryCriticalAction),
            Some(Charge::Enough) | None => return,
        };
        let used = self.battery.used_mah();
        let text = format!(
            "Battery 1 is {what} {:.2}V used {used:.0} mAh",
            reading.voltage_v
        );
        self.say(MavSeverity::MAV_SEVERITY_WARNING, &text);
        let action = Action::of(self.kind, self.parameters.bits(action));
        if self.failsafe.battery.may_act(action.urgency()) {
            match self.kind {
                Kind::Copter => self.act_on_battery(now, action),
                Kind::Rover => self.act(now, action),
            }
        }
    }

    fn act_on_battery(&mut self, now: Stamp, action: Action) {
        if self.would_rather_disarm() {
            self.disarm();
            self.announce("Battery Failsafe - Disarming");
        } else if self.is_landing() && self.continues(CONTINUE_LANDING) && action != Action::Nothing
        {
            self.announce("Battery Failsafe - Continuing Landing");
            self.act(now, Action::Land);
        } else {
            self.announce("Battery Failsafe");
            self.act(now, action);
        }
    }

    fn silence(&self, now: Stamp) -> Option<Duration> {
        self.failsafe.ground_heard.map(|heard| now.since(heard))
    }

    fn ground_timeout(&self) -> Duration {
        Duration::from_secs_f64(self.parameters.get(Parameter::GroundStationTimeout))
    }

    /// Only silence of a ground station that was there counts, and only if the parameter says so.
    fn check_ground_station_of_copter(&mut self, now: Stamp) {
        let number = self.parameters.bits(Parameter::GroundStationAction);
        let Some(silence) = self.silence(now).filter(|_| number != 0) else {
            return;
        };
        let timeout = self.ground_timeout();
        match self.failsafe.ground_lost {
            Some(_) if silence < timeout => {
                self.failsafe.ground_lost = None;
                self.announce("GCS Failsafe Cleared");
            }
            None if silence > timeout => {
                self.failsafe.ground_lost = Some(now);
                self.lose_ground_station(now, Action::of_silence(number));
            }
            Some(_) | None => {}
        }
    }

    fn lose_ground_station(&mut self, now: Stamp, action: Action) {
        let battery_lands = self
            .failsafe
            .battery
            .urgency()
            .is_some_and(|urgency| urgency <= URGENCY_OF_LANDING);
        let pilot_steers = matches!(self.mode, Mode::Stabilize | Mode::Loiter | Mode::Brake);
        if !self.armed {
            self.announce("GCS Failsafe");
        } else if self.would_rather_disarm() {
            self.disarm();
            self.announce("GCS Failsafe - Disarming");
        } else if self.is_landing() && battery_lands {
            self.announce("GCS + Battery Failsafe - Continuing Landing");
            self.act(now, Action::Land);
        } else if self.is_landing() && self.continues(CONTINUE_LANDING) {
            self.announce("GCS Failsafe - Continuing Landing");
            self.act(now, Action::Land);
        } else if self.mode == Mode::Auto && self.continues(CONTINUE_IN_AUTO) {
            self.announce("GCS Failsafe - Continuing Auto Mode");
        } else if pilot_steers && self.continues(CONTINUE_WITH_PILOT) {
            self.announce("GCS Failsafe - Continuing Pilot Control");
        } else {
            self.announce("GCS Failsafe");
            self.act(now, action);
        }
    }

    /// A rover notices after one timeout and acts after another, armed or not.
    fn check_ground_station_of_rover(&mut self, now: Stamp) {
        let number = self.parameters.bits(Parameter::GroundStationAction);
        let Some(silence) = self.silence(now).filter(|_| number != 0) else {
            return;
        };
        if silence < self.ground_timeout() {
            self.failsafe.ground_lost = None;
            if std::mem::take(&mut self.failsafe.triggered) {
                self.say(MavSeverity::MAV_SEVERITY_INFO, "GCS Failsafe Cleared");
            }
            return;
        }
        let noticed = *self.failsafe.ground_lost.get_or_insert(now);
        let patience =
            Duration::from_secs_f64(self.parameters.get(Parameter::RoverFailsafeTimeout));
        let also_in_hold = self.parameters.bits(Parameter::RoverFailsafeOptions) & 1 != 0;
        let safe = self.mode == Mode::Rtl || (self.mode == Mode::Hold && !also_in_hold);
        if self.failsafe.triggered || safe || now.since(noticed) <= patience {
            return;
        }
        self.failsafe.triggered = true;
        self.announce("GCS Failsafe");
        if self.mode == Mode::Auto && number == 2 {
            self.announce("Failsafe - Continuing Auto Mode");
        } else {
            let action = self.parameters.bits(Parameter::RoverFailsafeAction);
            self.act(now, Action::of(Kind::Rover, action));
        }
    }

    /// Where it thinks it is, as the fence sees it; `None` without a position or home.
    fn place_in_fence(&self, now: Stamp) -> Option<fence::Place> {
        self.has_fix(now)
            .then(|| self.estimate.position())
            .and_then(|here| self.seen_by_fence(here))
    }

    /// A place, as the fence sees it; `None` without a home.
    pub(super) fn seen_by_fence(&self, place: Point<maps::frame::World>) -> Option<fence::Place> {
        let from_home = place.raw - self.home?.raw;
        Some(fence::Place {
            at: place.raw.xy(),
            from_home_m: from_home.xy().norm(),
            above_home_m: from_home.z,
        })
    }

    pub(super) fn fence_settings(&self) -> fence::Settings {
        fence::Settings::of(&self.parameters, self.kind)
    }

    /// Breaches are looked for also while disarmed, and acted on while armed.
    fn check_fence(&mut self, now: Stamp) {
        let before = self.fence.breached();
        let settings = self.fence_settings();
        let new = self
            .fence
            .check(now, &settings, self.place_in_fence(now).as_ref());
        let is_first = before.is_empty() && !self.fence.breached().is_empty();
        if is_first {
            self.out.extend(self.fence_status());
        }
        let flies = self.kind == Kind::Copter && !self.on_ground();
        if new.is_empty() && !before.is_empty() && self.fence.breached().is_empty() && flies {
            self.say(MavSeverity::MAV_SEVERITY_NOTICE, "Fence breach cleared");
        }
        if new.is_empty() || !self.armed {
            return;
        }
        if flies {
            let text = format!("{} breached", new.names());
            self.say(MavSeverity::MAV_SEVERITY_NOTICE, &text);
        }
        let number = self.parameters.bits(Parameter::FenceAction);
        if number != 0 {
            match self.kind {
                Kind::Copter => self.turn_copter_back(number, new),
                Kind::Rover if self.fence.beyond_m(new) > GIVE_UP_M => self.act(now, Action::Hold),
                Kind::Rover => self.act(now, Action::of(Kind::Rover, number)),
            }
        }
    }

    fn turn_copter_back(&mut self, number: u32, breached: Parts) {
        if self.on_ground() {
            self.disarm();
            return;
        }
        let far = self.fence.beyond_m(breached) > GIVE_UP_M;
        let tried: &[Mode] = match number {
            _ if far => &[],
            2 | 5 => &[],
            4 => &[Mode::Brake],
            _ => &[Mode::Rtl],
        };
        if !tried.iter().any(|mode| self.set_mode(*mode)) {
            self.set_mode(Mode::Land);
        }
    }

    fn announce(&mut self, text: &str) {
        self.say(MavSeverity::MAV_SEVERITY_WARNING, text);
    }

    fn continues(&self, option: u32) -> bool {
        self.parameters.bits(Parameter::CopterFailsafeOptions) & option != 0
    }

    fn is_landing(&self) -> bool {
        matches!(self.goal, Goal::Land(_))
    }

    /// A copter that stands on the ground is safest without its motors; in AUTO, until it has begun.
    fn would_rather_disarm(&self) -> bool {
        let begun = self.mode == Mode::Auto && self.execution.state() == execute::State::Running;
        self.on_ground() && !begun
    }

    fn act(&mut self, now: Stamp, action: Action) {
        match (action, self.kind) {
            (Action::Nothing, _) => {}
            (Action::Terminate, _) => self.disarm(),
            (
                Action::Hold | Action::Land | Action::Brake | Action::SmartReturnOrStop,
                Kind::Rover,
            ) => {
                self.set_mode(Mode::Hold);
            }
            (Action::Return | Action::SmartReturn | Action::MissionReturn, Kind::Rover) => {
                if !self.set_mode(Mode::Rtl) {
                    self.set_mode(Mode::Hold);
                }
            }
            (Action::Land | Action::Hold, Kind::Copter) => self.land_after_pause(now),
            (Action::Return, Kind::Copter) => self.return_or_land(now),
            (Action::SmartReturn, Kind::Copter) => {
                self.announce("SmartRTL Unavailable, Trying RTL Mode");
                self.return_or_land(now);
            }
            (Action::SmartReturnOrStop, Kind::Copter) => {
                self.announce("SmartRTL Unavailable, Using Land Mode");
                self.land_after_pause(now);
            }
            (Action::MissionReturn, Kind::Copter) => {
                self.announce("Trying RTL Mode");
                self.return_or_land(now);
            }
            (Action::Brake, Kind::Copter) => {
                if !self.set_mode(Mode::Brake) {
                    self.announce("Trying Land Mode");
                    self.land_after_pause(now);
                }
            }
        }
    }

    fn return_or_land(&mut self, now: Stamp) {
        if !self.set_mode(Mode::Rtl) {
            self.land_after_pause(now);
        }
    }

    fn land_after_pause(&mut self, now: Stamp) {
        self.set_mode(Mode::Land);
        self.failsafe.pause_until = Some(now + LAND_PAUSE);
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
