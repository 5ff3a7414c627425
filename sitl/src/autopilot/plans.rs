//! Missions and fences as they come in: which end of the protocol they are for, and which items the vehicles can do.

use maps::time::Stamp;
use mavlink_ext::dialect::cmd;
use mavlink_ext::dialect::tandem::{MavMissionResult, MavMissionType};
use mavlink_ext::mission::{MissionChange, MissionFrame, MissionItem};
use mavlink_ext::{Address, Message};

use super::Autopilot;
use super::fence::zones;

impl Autopilot {
    /// Mission and fence travel by the same messages; of other kinds of plans, the mission's end answers that it has none.
    pub(super) fn exchange_plan(&mut self, now: Stamp, from: Address, message: &Message) {
        let kind = plan_kind(message);
        if kind != Some(MavMissionType::MAV_MISSION_TYPE_FENCE) {
            let step = self.mission.handle(now, from, message);
            self.out.extend(step.send);
            for MissionChange::Replaced { items } in step.events {
                self.mission_replaced(items);
            }
        }
        let fence = [
            MavMissionType::MAV_MISSION_TYPE_FENCE,
            MavMissionType::MAV_MISSION_TYPE_ALL,
        ];
        if kind.is_some_and(|kind| fence.contains(&kind)) {
            let step = self.fence_plan.handle(now, from, message);
            if kind == Some(MavMissionType::MAV_MISSION_TYPE_FENCE) {
                self.out.extend(step.send);
            }
            if !step.events.is_empty() {
                let zones = zones::of(self.fence_plan.items(), &self.origin);
                self.fence.set_zones(zones);
            }
        }
    }
}

/// Of which kind of plan a message is; `None` if it is about none.
fn plan_kind(message: &Message) -> Option<MavMissionType> {
    Some(match message {
        Message::MISSION_COUNT(it) => it.mission_type,
        Message::MISSION_ITEM_INT(it) => it.mission_type,
        Message::MISSION_ITEM(it) => it.mission_type,
        Message::MISSION_REQUEST_LIST(it) => it.mission_type,
        Message::MISSION_REQUEST_INT(it) => it.mission_type,
        Message::MISSION_REQUEST(it) => it.mission_type,
        Message::MISSION_REQUEST_PARTIAL_LIST(it) => it.mission_type,
        Message::MISSION_WRITE_PARTIAL_LIST(it) => it.mission_type,
        Message::MISSION_CLEAR_ALL(it) => it.mission_type,
        Message::MISSION_ACK(it) => it.mission_type,
        _ => return None,
    })
}

/// Whether a copter can do that.
pub(super) fn accepts_in_the_air(item: &MissionItem) -> Result<(), MavMissionResult> {
    accepts(item, &[cmd::NAV_TAKEOFF, cmd::NAV_LAND])
}

/// Whether a rover can do that.
pub(super) fn accepts_on_the_ground(item: &MissionItem) -> Result<(), MavMissionResult> {
    accepts(item, &[cmd::DO_SET_REVERSE])
}

fn accepts(item: &MissionItem, also: &[u16]) -> Result<(), MavMissionResult> {
    const BOTH: [u16; 7] = [
        cmd::NAV_WAYPOINT,
        cmd::NAV_LOITER_UNLIM,
        cmd::NAV_LOITER_TIME,
        cmd::NAV_RETURN_TO_LAUNCH,
        cmd::DO_CHANGE_SPEED,
        cmd::DO_SET_CAM_TRIGG_DIST,
        cmd::DO_FENCE_ENABLE,
    ];
    if !BOTH.contains(&item.command) && !also.contains(&item.command) {
        return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED);
    }
    let needs_place = matches!(
        item.command,
        cmd::NAV_WAYPOINT | cmd::NAV_LOITER_UNLIM | cmd::NAV_LOITER_TIME
    );
    if needs_place && item.frame == MissionFrame::Command {
        return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME);
    }
    if !item.alt_m.is_finite() {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM7);
    }
    Ok(())
}
