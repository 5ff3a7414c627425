//! Numbers of the commands (`MAV_CMD`) that Tandem sends or understands.
//!
//! Commands are an open set: message fields hold the plain number, so that an unknown one can be answered.

use super::tandem::MavCmd;

macro_rules! commands {
    ($($(#[$doc:meta])* $name:ident = $variant:ident;)*) => {$(
        $(#[$doc])*
        pub const $name: u16 = MavCmd::$variant as u16;
    )*};
}

commands! {
    /// Fly or drive to a position.
    NAV_WAYPOINT = MAV_CMD_NAV_WAYPOINT;
    /// Circle a position without limit.
    NAV_LOITER_UNLIM = MAV_CMD_NAV_LOITER_UNLIM;
    /// Circle or hold a position for a time.
    NAV_LOITER_TIME = MAV_CMD_NAV_LOITER_TIME;
    /// Return to launch.
    NAV_RETURN_TO_LAUNCH = MAV_CMD_NAV_RETURN_TO_LAUNCH;
    /// Land.
    NAV_LAND = MAV_CMD_NAV_LAND;
    /// Take off.
    NAV_TAKEOFF = MAV_CMD_NAV_TAKEOFF;
    /// Wait at the item.
    NAV_DELAY = MAV_CMD_NAV_DELAY;
    /// Delay the mission.
    CONDITION_DELAY = MAV_CMD_CONDITION_DELAY;
    /// Turn to a heading.
    CONDITION_YAW = MAV_CMD_CONDITION_YAW;
    /// Set the mode: base mode, custom mode.
    DO_SET_MODE = MAV_CMD_DO_SET_MODE;
    /// Jump to a mission item.
    DO_JUMP = MAV_CMD_DO_JUMP;
    /// Change the speed.
    DO_CHANGE_SPEED = MAV_CMD_DO_CHANGE_SPEED;
    /// Set the home position.
    DO_SET_HOME = MAV_CMD_DO_SET_HOME;
    /// Go to a position now.
    DO_REPOSITION = MAV_CMD_DO_REPOSITION;
    /// Pause or continue the mission.
    DO_PAUSE_CONTINUE = MAV_CMD_DO_PAUSE_CONTINUE;
    /// Drive in reverse (1) or forward (0).
    DO_SET_REVERSE = MAV_CMD_DO_SET_REVERSE;
    /// Region of interest.
    DO_SET_ROI_LOCATION = MAV_CMD_DO_SET_ROI_LOCATION;
    /// Take pictures by distance.
    DO_SET_CAM_TRIGG_DIST = MAV_CMD_DO_SET_CAM_TRIGG_DIST;
    /// Switch the fence off (0) or on (1), all of it or some kinds.
    DO_FENCE_ENABLE = MAV_CMD_DO_FENCE_ENABLE;
    /// Of a fence: where to return to.
    NAV_FENCE_RETURN_POINT = MAV_CMD_NAV_FENCE_RETURN_POINT;
    /// Of a fence: a corner of a polygon to stay within.
    NAV_FENCE_POLYGON_VERTEX_INCLUSION = MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION;
    /// Of a fence: a corner of a polygon to stay out of.
    NAV_FENCE_POLYGON_VERTEX_EXCLUSION = MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION;
    /// Of a fence: a circle to stay within.
    NAV_FENCE_CIRCLE_INCLUSION = MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION;
    /// Of a fence: a circle to stay out of.
    NAV_FENCE_CIRCLE_EXCLUSION = MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION;
    /// Choose the current mission item.
    DO_SET_MISSION_CURRENT = MAV_CMD_DO_SET_MISSION_CURRENT;
    /// Start the mission.
    MISSION_START = MAV_CMD_MISSION_START;
    /// Arm (1) or disarm (0).
    COMPONENT_ARM_DISARM = MAV_CMD_COMPONENT_ARM_DISARM;
    /// Run the checks before arming.
    RUN_PREARM_CHECKS = MAV_CMD_RUN_PREARM_CHECKS;
    /// Ask for the home position.
    GET_HOME_POSITION = MAV_CMD_GET_HOME_POSITION;
    /// Ask how often a message is sent.
    GET_MESSAGE_INTERVAL = MAV_CMD_GET_MESSAGE_INTERVAL;
    /// Set how often a message is sent.
    SET_MESSAGE_INTERVAL = MAV_CMD_SET_MESSAGE_INTERVAL;
    /// Ask for one message.
    REQUEST_MESSAGE = MAV_CMD_REQUEST_MESSAGE;
    /// Ask for `PROTOCOL_VERSION`.
    REQUEST_PROTOCOL_VERSION = MAV_CMD_REQUEST_PROTOCOL_VERSION;
    /// Ask for `AUTOPILOT_VERSION`.
    REQUEST_AUTOPILOT_CAPABILITIES = MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES;
    /// Reboot or shut down.
    PREFLIGHT_REBOOT_SHUTDOWN = MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN;
    /// Calibrate.
    PREFLIGHT_CALIBRATION = MAV_CMD_PREFLIGHT_CALIBRATION;
    /// Store or load parameters.
    PREFLIGHT_STORAGE = MAV_CMD_PREFLIGHT_STORAGE;
}
