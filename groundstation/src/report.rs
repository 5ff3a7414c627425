//! The figures of a run, for whoever checks it: written as JSON when the program ends.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::model::missions::{PlanKind, Transfer};
use crate::model::{Model, vehicle};

/// Everything measured in a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Tiles received, counting every version.
    pub tiles_received: u64,
    /// Tiles in the map.
    pub tiles_known: usize,
    /// Occupied voxels in the map.
    pub map_voxels_occupied: usize,
    /// 16 hexadecimal digits; none without a map.
    pub map_digest: Option<String>,
    /// The companion's digest of its map, as it last told.
    pub map_digest_companion: Option<String>,
    /// Whether both are equal and the companion has finished.
    pub map_equal: bool,
    /// Objects received that could not be used.
    pub objects_refused: u64,
    /// Of the last path planned for a ground vehicle.
    pub path_length_m: Option<f64>,
    /// Of the last path planned for a ground vehicle.
    pub path_min_clearance_m: Option<f64>,
    /// Items of all uploaded missions.
    pub mission_items: usize,
    /// Whether every mission that was uploaded was read back equal; none were if nothing was uploaded.
    pub mission_readback_equal: Option<bool>,
    /// By system id.
    pub vehicles: BTreeMap<u8, VehicleReport>,
    /// By the order they were opened.
    pub links: Vec<LinkReport>,
    /// Bytes received on all links.
    pub bytes_received: u64,
    /// Bytes sent on all links.
    pub bytes_sent: u64,
    /// Frames that came in faster than they could be handled.
    pub frames_dropped: u64,
    /// The last word about the link between companion and station.
    pub symbol_loss: Option<f64>,
    /// Time from start to end.
    pub wall_s: f64,
    /// Why the script ended early, if it did.
    pub failure: Option<String>,
}

/// One vehicle at the end.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct VehicleReport {
    /// What it is called.
    pub name: String,
    /// East, north and up in the map's frame, as last told.
    pub position_m: Option<[f64; 3]>,
    /// Clockwise from north, 0 to 360.
    pub heading_deg: Option<f64>,
    /// Its last mode.
    pub mode: String,
    /// Whether its motors ran.
    pub armed: bool,
    /// Whether it reached the end of its mission.
    pub mission_complete: bool,
    /// Items of the mission that was uploaded to it.
    pub mission_items: usize,
    /// Whether that mission was read back equal.
    pub mission_readback_equal: Option<bool>,
}

/// One link at the end.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LinkReport {
    /// As it was asked for.
    pub uri: String,
    /// Bytes received.
    pub bytes_received: u64,
    /// Bytes sent.
    pub bytes_sent: u64,
    /// Damaged frames.
    pub bad_frames: u64,
}

impl Report {
    /// What can be told from the model.
    pub fn of(model: &Model) -> Self {
        let map = &model.map;
        let status = map.status().map(|status| &status.value);
        let mut report = Self {
            tiles_received: map.tiles_received,
            tiles_known: map.tiles(),
            map_voxels_occupied: map.occupied(),
            map_digest: map.digest.map(|digest| digest.value.to_string()),
            map_digest_companion: status.map(|status| format!("{:016x}", status.map_digest)),
            map_equal: map.agreement() == crate::model::map::Agreement::Equal,
            objects_refused: map.refused,
            symbol_loss: status.and_then(|status| status.loss),
            wall_s: model.now.as_secs_f64(),
            ..Self::default()
        };
        for (id, vehicle) in &model.vehicles {
            report.vehicles.insert(id.0, vehicle_report(model, vehicle));
        }
        for mission in model.missions.values() {
            if let Some(PlanKind::Path {
                length_m,
                min_clearance_m,
                ..
            }) = mission.plan().map(|plan| &plan.kind)
            {
                report.path_length_m = Some(*length_m);
                report.path_min_clearance_m = Some(*min_clearance_m);
            }
        }
        let uploaded = || {
            report
                .vehicles
                .values()
                .filter_map(|vehicle| vehicle.mission_readback_equal)
        };
        report.mission_readback_equal =
            (uploaded().count() > 0).then(|| uploaded().all(|equal| equal));
        report.mission_items = report
            .vehicles
            .values()
            .map(|vehicle| vehicle.mission_items)
            .sum();
        for link in &model.links {
            report.bytes_received += link.bytes_received;
            report.bytes_sent += link.bytes_sent;
            report.links.push(LinkReport {
                uri: link.uri.clone(),
                bytes_received: link.bytes_received,
                bytes_sent: link.bytes_sent,
                bad_frames: link.bad_frames,
            });
        }
        report
    }
}

fn vehicle_report(model: &Model, vehicle: &vehicle::Vehicle) -> VehicleReport {
    let mission = model.missions.get(&vehicle.id);
    let equal = mission.and_then(|mission| match mission.transfer {
        Transfer::None => None,
        Transfer::Verified { .. } => Some(true),
        Transfer::Uploading { .. }
        | Transfer::ReadingBack { .. }
        | Transfer::Differs { .. }
        | Transfer::Failed { .. } => Some(false),
    });
    VehicleReport {
        name: vehicle.name(),
        position_m: vehicle
            .position
            .map(|position| position.value.raw.coords.into()),
        heading_deg: vehicle
            .attitude
            .map(|attitude| attitude.value.heading_deg()),
        mode: vehicle.heartbeat.value.mode.to_string(),
        armed: vehicle.is_armed(),
        mission_complete: vehicle
            .mission
            .is_some_and(|mission| mission.value.complete),
        mission_items: if equal.is_some() {
            mission
                .and_then(|mission| mission.plan())
                .map_or(0, |plan| plan.items.len())
        } else {
            0
        },
        mission_readback_equal: equal,
    }
}
