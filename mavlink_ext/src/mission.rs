//! The mission protocol, both ends: upload, download and clear for a ground station, and a server for a vehicle.
//!
//! ```text
//! upload    client: COUNT     server: REQUEST 0, REQUEST 1 ..   client: ITEM each time   server: ACK
//! download  client: LIST      server: COUNT    client: REQUEST 0 ..   server: ITEM each time   client: ACK
//! clear     client: CLEAR_ALL server: ACK
//! ```
//!
//! Whoever asks repeats: after 1500 ms, within a transfer after 250 ms, 5 times. A vehicle keeps its old mission until
//! the new one is complete. A mission counts as uploaded when it has been read back and [`differences`] finds none.
//! <https://mavlink.io/en/services/mission.html>

mod compare;
mod download;
mod server;
#[cfg(test)]
mod tests;
mod upload;

use std::time::Duration;

use crate::dialect::tandem::{MavMissionResult, MavMissionType};

pub use compare::{Difference, differences};
pub use download::Download;
pub use server::{MAX_ITEMS, MissionChange, Server};
pub use upload::{Clear, Upload};

pub use crate::convert::{MissionFrame, MissionItem};

/// Silence before the first question of a transfer is repeated.
const RESPONSE_TIMEOUT: Duration = Duration::from_millis(1500);
/// Silence before an item is asked for, or sent, again.
const ITEM_TIMEOUT: Duration = Duration::from_millis(250);
/// How often a question is repeated.
const RETRIES: u32 = 5;

const MISSION: MavMissionType = MavMissionType::MAV_MISSION_TYPE_MISSION;

/// Why a transfer failed. The vehicle then has the mission it had before.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MissionError {
    /// The vehicle says nothing.
    #[error("no answer from the vehicle after {done} of {total} mission items")]
    NoAnswer {
        /// Items that went through.
        done: usize,
        /// Items to transfer; 0 if that is not known yet.
        total: usize,
    },
    /// The vehicle does not take the mission, or does not give it.
    #[error("the vehicle refused the mission at item {item}: {result:?}")]
    Refused {
        /// Its reason.
        result: MavMissionResult,
        /// The item it had asked for last.
        item: usize,
    },
    /// The vehicle accepted the mission before it had asked for all of it.
    #[error("the vehicle accepted the mission after {done} of {total} items")]
    Incomplete {
        /// Items it asked for.
        done: usize,
        /// Items of the mission.
        total: usize,
    },
    /// More items than the protocol can count.
    #[error("a mission of {items} items is too long, at most 65535 can be sent")]
    TooLong {
        /// Items of the mission.
        items: usize,
    },
    /// An item of the vehicle's mission cannot be understood.
    #[error("mission item {item} of the vehicle: {source}")]
    Item {
        /// Its number.
        item: usize,
        /// What is wrong with it.
        source: crate::convert::ItemError,
    },
}
