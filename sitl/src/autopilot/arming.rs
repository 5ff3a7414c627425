//! Whether the motors may run; what is refused is refused with its reason in a STATUSTEXT.
//!
//! Checks are made all the time. While one fails, its reason is said every 30 s as `PreArm: ..`; an attempt to arm says it as
//! `Arm: ..`.
//!
//! Source: `ArduPilot` 4.6, `AP_Arming`, `ArduCopter/AP_Arming.cpp`, `Rover/AP_Arming.cpp` (rules and words).

use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::dialect::cmd;
use mavlink_ext::dialect::tandem::MavSeverity;

use super::fence::Parts;
use super::guide::Goal;
use super::mode::{Kind, Mode};
use super::parameters::Parameter;
use super::power::{Charge, Limits};
use super::{Autopilot, has_booted};

/// When the reasons are first said after power-up, and how often then.
const FIRST_SAID: Duration = Duration::from_secs(15);
const SAID_EVERY: Duration = Duration::from_secs(30);
/// Bits of `ARMING_CHECK`.
const POSITIONS: u32 = 8;
const PARAMETERS: u32 = 32;
const VOLTAGE: u32 = 128;
const BATTERY: u32 = 256;
const MISSION: u32 = 16_384;
/// Bits of `ARMING_MIS_ITEMS`, with the items' commands and `ArduPilot`'s names.
const ITEMS: [(u32, u16, &str); 3] = [
    (1, cmd::NAV_LAND, "land"),
    (8, cmd::NAV_TAKEOFF, "takeoff"),
    (64, cmd::NAV_RETURN_TO_LAUNCH, "RTL"),
];
/// What a receiver with a fix says of its dilution of precision, in hundredths.
pub(super) const DILUTION: u16 = 60;

/// Whether somebody insists on arming.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Checks {
    /// All that the parameters ask for.
    Wanted,
    /// Only those that cannot be done without.
    Mandatory,
}

impl Autopilot {
    /// Everything that stands against arming: one reason per check.
    pub(super) fn prearm_failures(&self, now: Stamp) -> Vec<String> {
        if self.armed {
            return Vec::new();
        }
        if self.parameters.bits(Parameter::ArmingCheck) == 0 {
            return self
                .mandatory_failure(now)
                .map(str::to_owned)
                .into_iter()
                .collect();
        }
        let copter = self.kind == Kind::Copter;
        let settings = self.fence_settings();
        let fence = self
            .fence
            .arming_failure(&settings, self.has_fix(now) && self.home.is_some());
        let checks = [
            self.parameter_failure(),
            (copter && self.failsafe.misses_ground_station()).then(|| "GCS failsafe on".to_owned()),
            self.position_failure(now).map(str::to_owned),
            self.battery_failure(),
            self.mission_failure(),
            (copter && self.wants(VOLTAGE) && self.failsafe.battery.noticed() > Charge::Enough)
                .then(|| "Battery failsafe".to_owned()),
            fence,
            (!copter && !self.can_arm_in_mode()).then(|| "Mode not armable".to_owned()),
        ];
        checks.into_iter().flatten().collect()
    }

    fn wants(&self, check: u32) -> bool {
        self.parameters.bits(Parameter::ArmingCheck) & (1 | check) != 0
    }

    fn can_arm_in_mode(&self) -> bool {
        match (self.mode, self.kind) {
            (Mode::Auto, Kind::Copter) => self.parameters.is_on(Parameter::AutoOptions),
            (mode, _) => mode.can_arm(),
        }
    }

    /// What cannot be done without, whatever the parameters say: a position, where the mode needs one.
    fn mandatory_failure(&self, now: Stamp) -> Option<&'static str> {
        let lost = self.mode.needs_position() && !self.has_fix(now);
        lost.then_some("Need Position Estimate")
    }

    /// A vehicle that needs no position where it is armed does not wait for one.
    fn position_failure(&self, now: Stamp) -> Option<&'static str> {
        let settings = self.fence_settings();
        let level = Parts::CIRCLE.with(Parts::ZONES);
        let fenced = self.kind == Kind::Copter && self.fence.active(&settings).has(level);
        let checked = (self.mode.needs_position() || fenced) && self.wants(POSITIONS);
        let copter = self.kind == Kind::Copter;
        let poor = f64::from(DILUTION) > self.parameters.get(Parameter::DilutionGood);
        if checked && !self.has_fix(now) {
            Some("GPS 1: Bad fix")
        } else if checked && self.home.is_none() {
            Some("AHRS: waiting for home")
        } else if copter && !has_booted(now) {
            Some("AHRS: EKF3 still initialising")
        } else if let Some(failure) = self.mandatory_failure(now) {
            Some(failure)
        } else {
            (checked && copter && poor).then_some("High GPS HDOP")
        }
    }

    fn parameter_failure(&self) -> Option<String> {
        let tilt = self.parameters.get(Parameter::AngleMax);
        let wrong = self.kind == Kind::Copter && !(1000.0..=8000.0).contains(&tilt);
        (wrong && self.wants(PARAMETERS)).then(|| "Check ANGLE_MAX".to_owned())
    }

    fn battery_failure(&self) -> Option<String> {
        let limits = Limits::of(&self.parameters);
        let failure = limits
            .arming_failure(self.battery_reading())
            .filter(|_| self.wants(BATTERY))?;
        Some(format!("Battery 1 {failure}"))
    }

    fn mission_failure(&self) -> Option<String> {
        let wanted = self.parameters.bits(Parameter::ArmingItems);
        let items = self.mission.items();
        let missing = ITEMS.iter().find(|(bit, command, _)| {
            wanted & bit != 0 && !items.iter().any(|item| item.command == *command)
        });
        let (_, _, name) = missing.filter(|_| self.wants(MISSION))?;
        Some(format!("Missing mission item: {name}"))
    }

    /// Says what stands against arming, now and then.
    pub(super) fn say_prearm_failures(&mut self, now: Stamp) {
        let next = *self
            .prearm_said_next
            .get_or_insert(Stamp::ZERO + FIRST_SAID);
        if now >= next {
            self.prearm_said_next = Some(now + SAID_EVERY);
            self.run_checks(now);
        }
    }

    /// Says what stands against arming, at once.
    pub(super) fn run_checks(&mut self, now: Stamp) {
        for failure in self.prearm_failures(now) {
            let severity = MavSeverity::MAV_SEVERITY_CRITICAL;
            self.say(severity, &format!("PreArm: {failure}"));
        }
    }

    /// What stands against arming right now, in this mode.
    fn arm_failures(&self, now: Stamp, checks: Checks) -> Vec<String> {
        if checks == Checks::Mandatory {
            return self
                .mandatory_failure(now)
                .map(str::to_owned)
                .into_iter()
                .collect();
        }
        let failures = self.prearm_failures(now);
        if failures.is_empty() && self.kind == Kind::Copter && !self.can_arm_in_mode() {
            return vec![format!("{} mode not armable", self.mode)];
        }
        failures
    }

    /// Lets the motors run. False, with the reasons said, if something stands against it.
    pub(super) fn arm(&mut self, now: Stamp, checks: Checks) -> bool {
        if self.armed {
            return true;
        }
        let failures = self.arm_failures(now, checks);
        for failure in &failures {
            let severity = MavSeverity::MAV_SEVERITY_CRITICAL;
            self.say(severity, &format!("Arm: {failure}"));
        }
        if !failures.is_empty() {
            return false;
        }
        self.armed = true;
        self.idle_since = None;
        self.home = Some(self.estimate.position());
        self.goal = Goal::Stay;
        self.restart_mission();
        self.reverse = false;
        self.speed_mps = None;
        if checks == Checks::Wanted && self.parameters.bits(Parameter::ArmingCheck) == 0 {
            let warning = "Warning: Arming Checks Disabled";
            self.say(MavSeverity::MAV_SEVERITY_WARNING, warning);
        }
        self.say(
            MavSeverity::MAV_SEVERITY_INFO,
            match self.kind {
                Kind::Copter => "Arming motors",
                Kind::Rover => "Throttle armed",
            },
        );
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
            self.say(
                MavSeverity::MAV_SEVERITY_INFO,
                match self.kind {
                    Kind::Copter => "Disarming motors",
                    Kind::Rover => "Throttle disarmed",
                },
            );
            self.out.push(self.heartbeat());
        }
    }
}
