//! What the operator must know now, judged anew from the model at every tick.

use std::time::Duration;

use super::Station;
use crate::model::alerts::{Cause, Level};
use crate::model::log::Severity;
use crate::model::map::{Agreement, Tracking};
use crate::model::missions::Transfer;
use crate::model::vehicle::{Presence, Vehicle};
use crate::model::{LINK_LOST_AFTER, Model};

/// Below this a battery is nearly empty.
const LOW_PERCENT: u8 = 20;
/// Something severe that a vehicle said stays this long.
const SAID_FOR: Duration = Duration::from_secs(15);
/// A companion speaks once a second.
const COMPANION_LOST_AFTER: Duration = Duration::from_secs(5);

type Found = Vec<(Level, Cause, String)>;

impl Station {
    /// Brings the alerts up to date.
    pub(super) fn judge(&mut self) {
        let mut found = Found::new();
        for vehicle in self.model.vehicles.values() {
            judge_vehicle(&self.model, vehicle, &mut found);
        }
        judge_missions(&self.model, &mut found);
        judge_map(&self.model, &mut found);
        for (number, link) in self.model.links.iter().enumerate() {
            if let Some(error) = &link.error {
                found.push((Level::Caution, Cause::Link(number), error.clone()));
            }
        }
        self.model.alerts.update(self.model.now, found);
    }
}

fn judge_vehicle(model: &Model, vehicle: &Vehicle, found: &mut Found) {
    let (id, name) = (vehicle.id, vehicle.name());
    if vehicle.presence(model.now) == Presence::Lost {
        let seconds = LINK_LOST_AFTER.as_secs_f64();
        let text = format!("{name}: link lost, no heartbeat for more than {seconds} s");
        // One that cannot do harm is a caution.
        let level = if vehicle.is_armed() {
            Level::Warning
        } else {
            Level::Caution
        };
        found.push((level, Cause::VehicleLost(id), text));
        return;
    }
    if vehicle.heartbeat.value.system_status >= 5 {
        let text = format!("{name}: failsafe, mode {}", vehicle.heartbeat.value.mode);
        found.push((Level::Warning, Cause::Failsafe(id), text));
    }
    let remaining = vehicle
        .battery
        .and_then(|battery| battery.value.remaining_percent);
    if let Some(percent) = remaining.filter(|percent| *percent < LOW_PERCENT) {
        let level = if percent < LOW_PERCENT / 2 {
            Level::Warning
        } else {
            Level::Caution
        };
        found.push((
            level,
            Cause::BatteryLow(id),
            format!("{name}: battery at {percent} %"),
        ));
    }
    let lately = model
        .log
        .iter()
        .rev()
        .take_while(|line| model.now.since(line.at) <= SAID_FOR);
    for line in lately.filter(|line| line.from == Some(id)) {
        let level = match line.severity {
            Severity::Critical => Level::Warning,
            Severity::Error => Level::Caution,
            Severity::Warning | Severity::Notice | Severity::Debug => continue,
        };
        let cause = Cause::Said(id, line.text.clone());
        if !found.iter().any(|(_, known, _)| *known == cause) {
            found.push((level, cause, format!("{name}: {}", line.text)));
        }
    }
}

fn judge_missions(model: &Model, found: &mut Found) {
    for (id, mission) in &model.missions {
        let name = model.name_of(*id);
        match &mission.transfer {
            Transfer::Differs { differences, .. } => {
                let text = format!(
                    "{name}: the mission read back differs in {} places",
                    differences.len()
                );
                found.push((Level::Warning, Cause::MissionDiffers(*id), text));
            }
            Transfer::Failed { reason, .. } => {
                found.push((
                    Level::Caution,
                    Cause::UploadFailed(*id),
                    format!("{name}: upload failed: {reason}"),
                ));
            }
            Transfer::None
            | Transfer::Uploading { .. }
            | Transfer::ReadingBack { .. }
            | Transfer::Verified { .. } => {}
        }
    }
    for order in model
        .orders
        .iter()
        .filter(|order| order.is_without_effect(model.now))
    {
        // An older order that a newer one has overtaken concerns nobody.
        let newest = model
            .orders
            .iter()
            .find(|other| other.vehicle == order.vehicle);
        if newest.is_some_and(|newest| newest.id == order.id) {
            let name = model.name_of(order.vehicle);
            let text = format!(
                "{name}: accepted \"{}\", but telemetry does not show it",
                order.order
            );
            found.push((
                Level::Caution,
                Cause::NoEffect(order.vehicle, order.id),
                text,
            ));
        }
    }
}

fn judge_map(model: &Model, found: &mut Found) {
    for (address, companion) in &model.map.companions {
        let Some(heard_at) = companion.heard_at else {
            continue;
        };
        let finished = companion
            .status
            .as_ref()
            .is_some_and(|status| status.value.finished);
        if model.now.since(heard_at) > COMPANION_LOST_AFTER {
            let level = if finished {
                Level::Advisory
            } else {
                Level::Caution
            };
            let text = format!("companion {address}: not heard any more");
            found.push((level, Cause::CompanionLost(address.system), text));
            continue;
        }
        let lost = companion
            .status
            .as_ref()
            .is_some_and(|status| status.value.tracking == Tracking::Lost);
        if lost && !finished {
            let text = format!(
                "companion {address}: the camera has lost its place, the map does not grow"
            );
            found.push((Level::Caution, Cause::CameraLost(address.system), text));
        }
    }
    if model.map.agreement() == Agreement::Differs {
        let text =
            "the map here is not the companion's: some tiles are missing or damaged".to_owned();
        found.push((Level::Caution, Cause::MapDiffers, text));
    }
}
