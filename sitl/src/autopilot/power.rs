//! The battery monitor: when a battery is low or critical, what is then done, and what it says before arming.
//!
//! A voltage counts once it has been too low for a while, a charge at once. What has been noticed in flight stays until the
//! battery is replaced, as on `ArduPilot`: a battery that recovers on the ground is not a full one.
//!
//! Source: `ArduPilot` 4.6, `AP_BattMonitor` and `AP_BattMonitor_Backend` (rules and words).

use std::time::Duration;

use maps::time::Stamp;

use super::parameters::{Parameter, Parameters};

/// How a battery is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Charge {
    #[default]
    Enough,
    Low,
    Critical,
}

/// What the monitor reads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    pub(super) voltage_v: f64,
    pub(super) left_mah: f64,
}

/// Below what a battery is low or critical; 0 for never.
#[derive(Clone, Copy, Debug)]
struct Threshold {
    voltage_v: f64,
    left_mah: f64,
}

/// The thresholds that parameters set.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    low: Threshold,
    critical: Threshold,
    arming: Threshold,
    patience: Duration,
}

impl Limits {
    pub(super) fn of(parameters: &Parameters) -> Self {
        let threshold = |voltage, charge| Threshold {
            voltage_v: parameters.get(voltage),
            left_mah: parameters.get(charge),
        };
        Self {
            low: threshold(Parameter::BatteryLowVolt, Parameter::BatteryLow),
            critical: threshold(Parameter::BatteryCriticalVolt, Parameter::BatteryCritical),
            arming: threshold(Parameter::BatteryToArmVolt, Parameter::BatteryToArm),
            patience: Duration::from_secs_f64(parameters.get(Parameter::BatteryTimer)),
        }
    }

    /// What stands against arming with this battery.
    pub(super) fn arming_failure(&self, now: Reading) -> Option<&'static str> {
        let upside_down = |low: f64, critical: f64| low > 0.0 && critical > 0.0 && low <= critical;
        let checks = [
            (self.arming.voltage(now), "below minimum arming voltage"),
            (self.arming.charge(now), "below minimum arming capacity"),
            (self.low.voltage(now), "low voltage failsafe"),
            (self.low.charge(now), "low capacity failsafe"),
            (self.critical.voltage(now), "critical voltage failsafe"),
            (self.critical.charge(now), "critical capacity failsafe"),
            (
                upside_down(self.low.left_mah, self.critical.left_mah),
                "capacity failsafe critical >= low",
            ),
            (
                upside_down(self.low.voltage_v, self.critical.voltage_v),
                "voltage failsafe critical >= low",
            ),
        ];
        checks.iter().find(|(fails, _)| *fails).map(|(_, why)| *why)
    }
}

impl Threshold {
    fn voltage(self, now: Reading) -> bool {
        now.voltage_v > 0.0 && self.voltage_v > 0.0 && now.voltage_v < self.voltage_v
    }

    fn charge(self, now: Reading) -> bool {
        self.left_mah > 0.0 && now.left_mah < self.left_mah
    }
}

/// What has been noticed since the battery was put in.
#[derive(Clone, Debug, Default)]
pub(super) struct Monitor {
    noticed: Charge,
    /// Since when the voltage has been too low.
    low_since: Option<Stamp>,
    critical_since: Option<Stamp>,
    /// How urgent what was done is: 0 is the most urgent.
    urgency: Option<usize>,
}

impl Monitor {
    /// How the battery is, as far as it was noticed in flight.
    pub(super) fn noticed(&self) -> Charge {
        self.noticed
    }

    /// How urgent what was done about it is; `None` while nothing was.
    pub(super) fn urgency(&self) -> Option<usize> {
        self.urgency
    }

    /// While armed: how the battery is, if it is worse than was noticed before.
    pub(super) fn watch(
        &mut self,
        now: Stamp,
        reading: Reading,
        limits: &Limits,
    ) -> Option<Charge> {
        let patience = limits.patience;
        let long = |since: &mut Option<Stamp>, low: bool| {
            if !low {
                *since = None;
                return false;
            }
            let since = *since.get_or_insert(now);
            !patience.is_zero() && now.since(since) > patience
        };
        let critical = long(&mut self.critical_since, limits.critical.voltage(reading));
        let low = long(&mut self.low_since, limits.low.voltage(reading));
        let charge = if critical || limits.critical.charge(reading) {
            Charge::Critical
        } else if low || limits.low.charge(reading) {
            Charge::Low
        } else {
            Charge::Enough
        };
        (charge > self.noticed).then(|| {
            self.noticed = charge;
            charge
        })
    }

    /// Whether something that urgent is to be done: not if something more urgent was done before.
    pub(super) fn may_act(&mut self, urgency: usize) -> bool {
        let may = self.urgency.is_none_or(|before| urgency <= before);
        if may {
            self.urgency = Some(urgency);
        }
        may
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::mode::Kind;

    fn limits(set: &[(&str, f32)]) -> Limits {
        let mut parameters = Parameters::new(Kind::Copter);
        for (name, value) in set {
            assert!(parameters.set(name, *value).is_some(), "{name}");
        }
        Limits::of(&parameters)
    }

    fn reading(voltage_v: f64, left_mah: f64) -> Reading {
        Reading {
            voltage_v,
            left_mah,
        }
    }

    fn at(seconds: f64) -> Stamp {
        Stamp::ZERO + Duration::from_secs_f64(seconds)
    }

    #[test]
    fn a_voltage_counts_after_the_timer_and_a_charge_at_once() {
        let limits = limits(&[("BATT_LOW_VOLT", 14.0), ("BATT_CRT_MAH", 300.0)]);
        let mut monitor = Monitor::default();
        let sags = reading(13.9, 4000.0);
        assert_eq!(monitor.watch(at(0.0), sags, &limits), None);
        assert_eq!(
            monitor.watch(at(10.0), sags, &limits),
            None,
            "10 s is not yet more"
        );
        // A moment of a better voltage starts it over.
        assert_eq!(
            monitor.watch(at(10.1), reading(14.1, 4000.0), &limits),
            None
        );
        assert_eq!(monitor.watch(at(10.2), sags, &limits), None);
        assert_eq!(monitor.watch(at(20.3), sags, &limits), Some(Charge::Low));
        assert_eq!(monitor.watch(at(21.0), sags, &limits), None, "said once");
        let empty = reading(13.9, 299.0);
        assert_eq!(
            monitor.watch(at(21.1), empty, &limits),
            Some(Charge::Critical)
        );
        assert_eq!(
            monitor.watch(at(50.0), reading(16.0, 5000.0), &limits),
            None
        );
        assert_eq!(
            monitor.noticed(),
            Charge::Critical,
            "it does not recover by itself"
        );
    }

    #[test]
    fn without_a_timer_voltages_never_count() {
        let limits = limits(&[("BATT_CRT_VOLT", 14.0), ("BATT_LOW_TIMER", 0.0)]);
        let mut monitor = Monitor::default();
        for second in 0..100 {
            let sags = reading(12.0, 4000.0);
            assert_eq!(monitor.watch(at(f64::from(second)), sags, &limits), None);
        }
    }

    #[test]
    fn what_is_less_urgent_than_what_was_done_is_not_done() {
        let mut monitor = Monitor::default();
        assert!(monitor.may_act(2));
        assert!(!monitor.may_act(3));
        assert!(monitor.may_act(2), "the same again");
        assert!(monitor.may_act(0));
        assert_eq!(monitor.urgency(), Some(0));
    }

    #[track_caller]
    fn check_before_arming(set: &[(&str, f32)], now: Reading, expected: Option<&str>) {
        assert_eq!(limits(set).arming_failure(now), expected, "{set:?}");
    }

    #[test]
    fn a_battery_that_would_fail_in_flight_is_named_before_arming() {
        let half = reading(14.8, 2600.0);
        check_before_arming(&[], half, None);
        check_before_arming(
            &[("BATT_ARM_VOLT", 15.0)],
            half,
            Some("below minimum arming voltage"),
        );
        check_before_arming(
            &[("BATT_ARM_MAH", 3000.0)],
            half,
            Some("below minimum arming capacity"),
        );
        check_before_arming(
            &[("BATT_LOW_VOLT", 15.0)],
            half,
            Some("low voltage failsafe"),
        );
        check_before_arming(
            &[("BATT_LOW_MAH", 3000.0)],
            half,
            Some("low capacity failsafe"),
        );
        check_before_arming(
            &[("BATT_CRT_VOLT", 15.0)],
            half,
            Some("critical voltage failsafe"),
        );
        check_before_arming(
            &[("BATT_CRT_MAH", 3000.0)],
            half,
            Some("critical capacity failsafe"),
        );
        check_before_arming(
            &[("BATT_CRT_MAH", 700.0)],
            half,
            Some("capacity failsafe critical >= low"),
        );
        check_before_arming(
            &[("BATT_CRT_VOLT", 11.0)],
            half,
            Some("voltage failsafe critical >= low"),
        );
    }
}
