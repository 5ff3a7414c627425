//! What the operator must know now, most urgent first.
//!
//! An alert comes with its cause and leaves with it; the operator's acknowledgement only stops its flashing. Three levels as
//! in 14 CFR 25.1322: *warning* act now, *caution* know now, *advisory* know.

use std::collections::VecDeque;

use maps::time::Stamp;
use mavlink_ext::SystemId;

/// How urgent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Act now: red.
    Warning,
    /// Know now, act later: amber.
    Caution,
    /// Know: white.
    Advisory,
}

impl Level {
    /// One word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Warning => "WARNING",
            Self::Caution => "CAUTION",
            Self::Advisory => "NOTE",
        }
    }
}

/// What an alert is about: at most one alert for each.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// Nothing is heard of the vehicle's autopilot.
    VehicleLost(SystemId),
    /// Its battery is nearly empty.
    BatteryLow(SystemId),
    /// It says that it is in danger.
    Failsafe(SystemId),
    /// What it has on board is not what was uploaded.
    MissionDiffers(SystemId),
    /// The upload did not end well.
    UploadFailed(SystemId),
    /// It accepted an order and does not do it.
    NoEffect(SystemId, u64),
    /// It said something severe.
    Said(SystemId, String),
    /// No companion is heard any more.
    CompanionLost(SystemId),
    /// The camera that builds the map does not know where it is.
    CameraLost(SystemId),
    /// The companion has finished and its map is not ours.
    MapDiffers,
    /// A link cannot be used.
    Link(usize),
}

/// One thing the operator must know now.
#[derive(Clone, Debug, PartialEq)]
pub struct Alert {
    /// For acknowledging.
    pub id: u64,
    /// How urgent.
    pub level: Level,
    /// What it is about.
    pub cause: Cause,
    /// The words: which vehicle, what is wrong.
    pub text: String,
    /// Since when.
    pub since: Stamp,
    /// Whether the operator has seen it.
    pub acknowledged: bool,
}

/// All present alerts, and those that have left.
#[derive(Clone, Debug, Default)]
pub struct Alerts {
    present: Vec<Alert>,
    past: VecDeque<Alert>,
    next_id: u64,
}

impl Alerts {
    /// The most urgent first, then the oldest.
    pub fn present(&self) -> &[Alert] {
        &self.present
    }

    /// Those whose cause has gone, the newest first.
    pub fn past(&self) -> impl Iterator<Item = &Alert> {
        self.past.iter()
    }

    /// Stops the flashing of one.
    pub fn acknowledge(&mut self, id: u64) {
        if let Some(alert) = self.present.iter_mut().find(|alert| alert.id == id) {
            alert.acknowledged = true;
        }
    }

    /// Makes the list say what is so now: `causes` are all there are.
    pub fn update(&mut self, now: Stamp, causes: Vec<(Level, Cause, String)>) {
        let (stay, leave): (Vec<_>, Vec<_>) = std::mem::take(&mut self.present)
            .into_iter()
            .partition(|alert| causes.iter().any(|(_, cause, _)| *cause == alert.cause));
        for alert in leave {
            self.past.push_front(alert);
        }
        self.past.truncate(100);
        self.present = stay;
        for (level, cause, text) in causes {
            if let Some(alert) = self.present.iter_mut().find(|alert| alert.cause == cause) {
                // One that gets worse wants attention again.
                alert.acknowledged &= level >= alert.level;
                (alert.level, alert.text) = (level, text);
                continue;
            }
            let id = self.next_id;
            self.next_id += 1;
            self.present.push(Alert {
                id,
                level,
                cause,
                text,
                since: now,
                acknowledged: false,
            });
        }
        self.present
            .sort_by_key(|alert| (alert.level, alert.since, alert.id));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lost(level: Level) -> (Level, Cause, String) {
        (
            level,
            Cause::VehicleLost(SystemId(2)),
            "UGV 2: link lost".to_owned(),
        )
    }

    #[test]
    fn an_alert_leaves_with_its_cause_and_is_remembered() {
        let mut alerts = Alerts::default();
        alerts.update(Stamp::from_nanos(1), vec![lost(Level::Warning)]);
        alerts.update(Stamp::from_nanos(2), vec![lost(Level::Warning)]);
        assert_eq!(alerts.present().len(), 1, "the same cause is one alert");
        assert_eq!(alerts.present()[0].since, Stamp::from_nanos(1));
        alerts.update(Stamp::from_nanos(3), vec![]);
        assert!(alerts.present().is_empty());
        assert_eq!(alerts.past().count(), 1);
    }

    #[test]
    fn an_acknowledged_alert_that_gets_worse_wants_attention_again() {
        let mut alerts = Alerts::default();
        alerts.update(Stamp::ZERO, vec![lost(Level::Caution)]);
        alerts.acknowledge(alerts.present()[0].id);
        alerts.update(Stamp::ZERO, vec![lost(Level::Caution)]);
        assert!(alerts.present()[0].acknowledged);
        alerts.update(Stamp::ZERO, vec![lost(Level::Warning)]);
        assert!(!alerts.present()[0].acknowledged);
    }

    #[test]
    fn the_most_urgent_stands_first() {
        let mut alerts = Alerts::default();
        let differs = (Level::Caution, Cause::MapDiffers, "map differs".to_owned());
        alerts.update(Stamp::ZERO, vec![differs.clone()]);
        alerts.update(Stamp::from_nanos(5), vec![differs, lost(Level::Warning)]);
        assert_eq!(alerts.present()[0].level, Level::Warning);
    }
}
