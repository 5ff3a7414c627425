//! How often messages come: asking for rates, and keeping those that others ask for.
//!
//! A vehicle sends little but heartbeats until `MAV_CMD_SET_MESSAGE_INTERVAL` asks for more, forgets it when it restarts, and may
//! grant less than was asked for. [`Client`] asks, looks at what arrives, asks the vehicle
//! (`MAV_CMD_GET_MESSAGE_INTERVAL`) where that does not tell, and asks again when a message ceases. [`Schedule`] is
//! the other end. <https://mavlink.io/en/messages/common.html#MAV_CMD_SET_MESSAGE_INTERVAL>

mod client;
mod schedule;
#[cfg(test)]
mod tests;
mod wish;

use std::time::Duration;

use crate::dialect::MessageData as _;
use crate::dialect::tandem::{MESSAGE_INTERVAL_DATA, MavDataStream};

pub use client::Client;
pub use schedule::Schedule;

/// `MESSAGE_INTERVAL`.
const MESSAGE_INTERVAL: u32 = MESSAGE_INTERVAL_DATA::ID;

/// How often a message is to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// Once in so long.
    Every(Duration),
    /// As the sender likes.
    Default,
    /// Not at all.
    Off,
}

impl Rate {
    /// Parameter 2 of `MAV_CMD_SET_MESSAGE_INTERVAL`: microseconds, 0 or −1.
    fn to_param(self) -> f32 {
        match self {
            Self::Every(interval) => (interval.as_secs_f64() * 1e6).max(1.0) as f32,
            Self::Default => 0.0,
            Self::Off => -1.0,
        }
    }

    /// `None` for what is none of these.
    fn from_param(param: f32) -> Option<Self> {
        match param {
            -1.0 => Some(Self::Off),
            0.0 => Some(Self::Default),
            micros if micros > 0.0 => Duration::try_from_secs_f64(f64::from(micros) * 1e-6)
                .ok()
                .map(Self::Every),
            _ => None,
        }
    }
}

/// What became of a wish.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IntervalEvent {
    /// The message is sent about as often as was asked for.
    Granted {
        /// Message id.
        message: u32,
    },
    /// The message is sent, but more seldom.
    Slower {
        /// Message id.
        message: u32,
        /// Time between two, as the vehicle says or as was seen.
        interval: Duration,
    },
    /// It comes no more as it was granted, and is asked for again: the vehicle may have restarted.
    Lapsed {
        /// Message id.
        message: u32,
    },
    /// The vehicle does not send it, whichever way it is asked.
    Unavailable {
        /// Message id.
        message: u32,
    },
}

/// The old data stream (`REQUEST_DATA_STREAM`) that a message is part of at ArduPilot, for autopilots that do not know of
/// intervals; `None` if there is none. <https://mavlink.io/en/messages/common.html#MAV_DATA_STREAM>
fn stream_of(message: u32) -> Option<MavDataStream> {
    Some(match message {
        // RAW_IMU, SCALED_IMU2, SCALED_IMU3, SCALED_PRESSURE
        27 | 116 | 129 | 29 => MavDataStream::MAV_DATA_STREAM_RAW_SENSORS,
        // SYS_STATUS, GPS_RAW_INT, MISSION_CURRENT, NAV_CONTROLLER_OUTPUT, POSITION_TARGET_GLOBAL_INT, POWER_STATUS,
        // FENCE_STATUS
        1 | 24 | 42 | 62 | 87 | 125 | 162 => MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS,
        // SERVO_OUTPUT_RAW, RC_CHANNELS
        36 | 65 => MavDataStream::MAV_DATA_STREAM_RC_CHANNELS,
        // LOCAL_POSITION_NED, GLOBAL_POSITION_INT
        32 | 33 => MavDataStream::MAV_DATA_STREAM_POSITION,
        // ATTITUDE
        30 => MavDataStream::MAV_DATA_STREAM_EXTRA1,
        // VFR_HUD
        74 => MavDataStream::MAV_DATA_STREAM_EXTRA2,
        // SYSTEM_TIME, DISTANCE_SENSOR, BATTERY_STATUS, VIBRATION
        2 | 132 | 147 | 241 => MavDataStream::MAV_DATA_STREAM_EXTRA3,
        _ => return None,
    })
}
