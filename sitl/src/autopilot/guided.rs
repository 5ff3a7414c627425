//! Going where a companion or a ground station says, in GUIDED: `SET_POSITION_TARGET_LOCAL_NED` and `_GLOBAL_INT`.

use maps::frame::{Point, Vector, World};
use maps::time::Stamp;
use mavlink_ext::convert::{e7_to_deg, from_ned};
use mavlink_ext::dialect::tandem::{
    MavFrame, PositionTargetTypemask as Mask, SET_POSITION_TARGET_GLOBAL_INT_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use mavlink_ext::mission::MissionFrame;

use super::Autopilot;
use super::guide::Goal;
use super::mode::{Kind, Mode};
use super::pursuit::Line;

impl Autopilot {
    pub(super) fn go_local(&mut self, now: Stamp, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
        if target.coordinate_frame != MavFrame::MAV_FRAME_LOCAL_NED {
            return;
        }
        let position = Point::origin() + from_ned([target.x, target.y, target.z].map(f64::from));
        let velocity = from_ned([target.vx, target.vy, target.vz].map(f64::from));
        self.go(now, target.type_mask, position, velocity);
        self.turn(target.type_mask, target.yaw);
    }

    pub(super) fn go_global(&mut self, now: Stamp, target: &SET_POSITION_TARGET_GLOBAL_INT_DATA) {
        let Some(frame) = altitude_frame(target.coordinate_frame) else {
            return;
        };
        let (lat_deg, lon_deg) = (e7_to_deg(target.lat_int), e7_to_deg(target.lon_int));
        let position = self.place(lat_deg, lon_deg, (frame, f64::from(target.alt)));
        let velocity = from_ned([target.vx, target.vy, target.vz].map(f64::from));
        self.go(now, target.type_mask, position, velocity);
        self.turn(target.type_mask, target.yaw);
    }

    fn go(&mut self, now: Stamp, mask: Mask, position: Point<World>, velocity: Vector<World>) {
        if self.mode != Mode::Guided {
            return;
        }
        let no_position =
            Mask::POSITION_TARGET_TYPEMASK_X_IGNORE | Mask::POSITION_TARGET_TYPEMASK_Y_IGNORE;
        let no_velocity =
            Mask::POSITION_TARGET_TYPEMASK_VX_IGNORE | Mask::POSITION_TARGET_TYPEMASK_VY_IGNORE;
        if !mask.intersects(no_position) && position.is_finite() {
            self.go_to(position);
        } else if !mask.intersects(no_velocity) && velocity.norm().is_finite() {
            self.guided.velocity = Some((velocity, now));
        }
    }

    fn turn(&mut self, mask: Mask, yaw: f32) {
        let told = !mask.intersects(Mask::POSITION_TARGET_TYPEMASK_YAW_IGNORE) && yaw.is_finite();
        // Yaw is clockwise from north, headings here are counter-clockwise from east.
        self.guided.heading_rad = told.then(|| std::f64::consts::FRAC_PI_2 - f64::from(yaw));
    }

    /// Makes a place the goal. False, silently as on `ArduPilot`, if a copter's fence is in the way.
    pub(super) fn go_to(&mut self, to: Point<World>) -> bool {
        let settings = self.fence_settings();
        let place = self.seen_by_fence(to);
        let allowed = place.is_none_or(|place| self.fence.allows(&settings, &place));
        if self.kind == Kind::Copter && !allowed {
            return false;
        }
        self.guided.velocity = None;
        self.goal = match self.kind {
            Kind::Copter => Goal::Hover(to),
            Kind::Rover => Goal::Drive {
                line: Line::new(self.estimate.position(), [to]),
                items: Vec::new(),
            },
        };
        true
    }
}

/// What altitudes in that frame are measured from; `None` for a frame without latitude and longitude.
pub(super) fn altitude_frame(frame: MavFrame) -> Option<MissionFrame> {
    match frame {
        MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT => Some(MissionFrame::Global),
        MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT => {
            Some(MissionFrame::GlobalRelativeAlt)
        }
        MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT | MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT_INT => {
            Some(MissionFrame::GlobalTerrainAlt)
        }
        _ => None,
    }
}
