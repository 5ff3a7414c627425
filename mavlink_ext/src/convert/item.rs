//! Mission items, typed, to and from `MISSION_ITEM_INT` and the older `MISSION_ITEM`.

use super::{deg_to_e7, e7_to_deg};
use crate::dialect::tandem::{MISSION_ITEM_DATA, MISSION_ITEM_INT_DATA, MavFrame, MavMissionType};
use crate::wire::Address;

/// What the altitude of a mission item is measured from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissionFrame {
    /// Mean sea level.
    Global,
    /// The home position.
    GlobalRelativeAlt,
    /// The terrain below.
    GlobalTerrainAlt,
    /// The item has no position: `lat_deg`, `lon_deg` and `alt_m` are the command's parameters 5 to 7 as they are.
    Command,
}

/// One item of a mission.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissionItem {
    /// `MAV_CMD`, see [`crate::dialect::cmd`].
    pub command: u16,
    /// What the position means.
    pub frame: MissionFrame,
    /// The command's parameters 1 to 4; NaN leaves a value to the vehicle.
    pub params: [f32; 4],
    /// Latitude, WGS-84. The wire has 10⁻⁷ degrees, 1.1 cm.
    pub lat_deg: f64,
    /// Longitude, WGS-84.
    pub lon_deg: f64,
    /// Altitude. The wire has single precision.
    pub alt_m: f64,
    /// Whether the next item follows by itself.
    pub autocontinue: bool,
}

/// Why a message is no mission item that we understand.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ItemError {
    /// A local or body frame: missions have global positions.
    #[error("mission items in {frame:?} are not supported")]
    Frame {
        /// The frame.
        frame: MavFrame,
    },
    /// The position is not on earth, or not a number.
    #[error("mission item has no valid position")]
    Position,
}

impl MissionItem {
    /// A position to go to, at an altitude above home.
    pub fn waypoint(lat_deg: f64, lon_deg: f64, alt_m: f64) -> Self {
        Self {
            command: crate::dialect::cmd::NAV_WAYPOINT,
            frame: MissionFrame::GlobalRelativeAlt,
            params: [0.0; 4],
            lat_deg,
            lon_deg,
            alt_m,
            autocontinue: true,
        }
    }

    /// A command without a position.
    pub fn command(command: u16, params: [f32; 4]) -> Self {
        Self {
            command,
            frame: MissionFrame::Command,
            params,
            lat_deg: 0.0,
            lon_deg: 0.0,
            alt_m: 0.0,
            autocontinue: true,
        }
    }

    /// As item `seq` of the mission of `target`. The first item is marked current, which MAVSDK insists on.
    pub fn to_message(
        self,
        seq: u16,
        target: Address,
        mission_type: MavMissionType,
    ) -> MISSION_ITEM_INT_DATA {
        let (x, y) = match self.frame {
            MissionFrame::Command => (self.lat_deg.round() as i32, self.lon_deg.round() as i32),
            _ => (deg_to_e7(self.lat_deg), deg_to_e7(self.lon_deg)),
        };
        let [param1, param2, param3, param4] = self.params;
        MISSION_ITEM_INT_DATA {
            param1,
            param2,
            param3,
            param4,
            x,
            y,
            z: self.alt_m as f32,
            seq,
            command: self.command,
            target_system: target.system.0,
            target_component: target.component.0,
            frame: self.frame.to_wire(),
            current: u8::from(seq == 0),
            autocontinue: u8::from(self.autocontinue),
            mission_type,
        }
    }

    /// The item of a `MISSION_ITEM_INT`.
    pub fn from_message(item: &MISSION_ITEM_INT_DATA) -> Result<Self, ItemError> {
        let frame = MissionFrame::from_wire(item.frame)?;
        let (lat_deg, lon_deg) = match frame {
            MissionFrame::Command => (f64::from(item.x), f64::from(item.y)),
            _ => (e7_to_deg(item.x), e7_to_deg(item.y)),
        };
        Self {
            command: item.command,
            frame,
            params: [item.param1, item.param2, item.param3, item.param4],
            lat_deg,
            lon_deg,
            alt_m: f64::from(item.z),
            autocontinue: item.autocontinue != 0,
        }
        .checked()
    }

    /// The item of a `MISSION_ITEM`.
    pub fn from_float_message(item: &MISSION_ITEM_DATA) -> Result<Self, ItemError> {
        Self {
            command: item.command,
            frame: MissionFrame::from_wire(item.frame)?,
            params: [item.param1, item.param2, item.param3, item.param4],
            lat_deg: f64::from(item.x),
            lon_deg: f64::from(item.y),
            alt_m: f64::from(item.z),
            autocontinue: item.autocontinue != 0,
        }
        .checked()
    }

    fn checked(self) -> Result<Self, ItemError> {
        let on_earth = self.frame == MissionFrame::Command
            || (self.lat_deg.abs() <= 90.0 && self.lon_deg.abs() <= 180.0);
        let finite = self.lat_deg.is_finite() && self.lon_deg.is_finite();
        (on_earth && finite)
            .then_some(self)
            .ok_or(ItemError::Position)
    }
}

impl MissionFrame {
    fn to_wire(self) -> MavFrame {
        match self {
            Self::Global => MavFrame::MAV_FRAME_GLOBAL,
            Self::GlobalRelativeAlt => MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
            Self::GlobalTerrainAlt => MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT,
            Self::Command => MavFrame::MAV_FRAME_MISSION,
        }
    }

    fn from_wire(frame: MavFrame) -> Result<Self, ItemError> {
        match frame {
            MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT => Ok(Self::Global),
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT
            | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT => Ok(Self::GlobalRelativeAlt),
            MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT | MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT_INT => {
                Ok(Self::GlobalTerrainAlt)
            }
            MavFrame::MAV_FRAME_MISSION => Ok(Self::Command),
            frame => Err(ItemError::Frame { frame }),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn an_item_survives_the_wire_to_its_rounding(
            lat_deg in -90.0..90.0, lon_deg in -180.0..180.0, alt_m in -500.0..9000.0,
            params in prop::array::uniform4(-1e6f32..1e6), seq in any::<u16>()
        ) {
            let item = MissionItem { params, ..MissionItem::waypoint(lat_deg, lon_deg, alt_m) };
            let message = item.to_message(seq, Address::new(1, 1), MavMissionType::MAV_MISSION_TYPE_MISSION);
            let back = MissionItem::from_message(&message).expect("on earth");
            prop_assert!((back.lat_deg - lat_deg).abs() <= 0.501e-7, "half a unit of the wire");
            prop_assert!((back.lon_deg - lon_deg).abs() <= 0.501e-7, "half a unit of the wire");
            prop_assert!((back.alt_m - alt_m).abs() <= 5e-4, "single precision at 9 km");
            prop_assert_eq!(back.params.map(f32::to_bits), params.map(f32::to_bits));
            let again = back.to_message(seq, Address::new(1, 1), MavMissionType::MAV_MISSION_TYPE_MISSION);
            prop_assert_eq!(again, message);
        }
    }

    #[test]
    fn positions_off_the_earth_and_local_frames_are_refused() {
        let mut message = MissionItem::waypoint(1.0, 2.0, 3.0).to_message(
            0,
            Address::new(1, 1),
            MavMissionType::MAV_MISSION_TYPE_MISSION,
        );
        message.x = 900_000_001;
        assert_eq!(
            MissionItem::from_message(&message),
            Err(ItemError::Position)
        );
        message.frame = MavFrame::MAV_FRAME_LOCAL_NED;
        let error = MissionItem::from_message(&message).expect_err("a local frame");
        assert_eq!(
            error.to_string(),
            "mission items in MAV_FRAME_LOCAL_NED are not supported"
        );
    }
}
