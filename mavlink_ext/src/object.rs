//! The object transport: whole objects (map tiles, feature frames) over links that lose, repeat and reorder messages.
//!
//! An object is announced (`TANDEM_OBJECT`) and sent as `RaptorQ` symbols (RFC 6330, `TANDEM_SYMBOL`): any K of them, or
//! one or two more, make the object, so that a lost symbol needs no name and is made good by any other. The receiver
//! reports how many it lacks (`TANDEM_REPORT`), and the sender goes on, round by round:
//!
//! ```text
//! n = missing                                 reliable, while others wait for the link: nothing is sent in vain
//! n = (missing + m·√(missing·p)) / (1 − p)    else; p = share of symbols lost lately, and m the higher the fewer rounds are
//!                                             left before a deadline
//! ```
//!
//! - The pace is what the link carries without anything waiting in its buffers, up to a budget: commands wait there, too.
//! - A receiver that starts late or restarts is noticed by the session in its reports. What it lacks of a map it asks for
//!   ([`digest`]); the sender keeps nothing that was delivered.
//! - A newer version of the same key replaces an older one that waits; one under way is finished first, so that an object
//!   which changes often gets through at all.
//! - Both sides are bounded in objects and bytes, the receiver also in age; a checksum (CRC32C) guards each object.
//!
//! Both ends are pure. [`Sender::tick`] wants to be called every 10 to 20 ms.

pub mod digest;
mod estimate;
mod fountain;
mod pace;
mod receiver;
mod sender;
#[cfg(test)]
mod tests;

use std::fmt;
use std::time::Duration;

use maps::tile::TileId;

pub use receiver::{Received, Receiver, ReceiverLimits, ReceiverStats};
pub use sender::{OfferError, Sender, SenderEvent, SenderSettings, SenderStats};

/// No object is larger.
pub const MAX_OBJECT_BYTES: usize = 4 << 20;
/// Bytes of a symbol at most; on slow links they are smaller.
pub const SYMBOL_BYTES: usize = 248;
/// Bytes of the frame around a symbol: what every message of MAVLink 2 has, and the fields of `TANDEM_SYMBOL` before the data.
const SYMBOL_FRAME_BYTES: usize = 12 + 6;

/// What kind of object it is, `TANDEM_STREAM` of the dialect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StreamId(pub u8);

impl StreamId {
    /// Map tiles.
    pub const TILE: Self = Self(0);
    /// Bird's-eye-view features.
    pub const BEV: Self = Self(1);
    /// Sets of detected objects.
    pub const BOXES: Self = Self(2);
    /// Pictures for the operator.
    pub const PICTURE: Self = Self(3);
}

/// Which object, and which version of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ObjectId {
    /// What kind of object.
    pub stream: StreamId,
    /// Which one of that kind.
    pub key: u64,
    /// A higher version replaces a lower one.
    pub version: u64,
}

impl ObjectId {
    /// A version of a map tile; `None` if a coordinate does not fit 21 bits; those of all tiles of a map do.
    pub fn of_tile(tile: TileId, version: u64) -> Option<Self> {
        let mut key = 0;
        for coordinate in [tile.x, tile.y, tile.z] {
            if !(-(1 << 20)..1 << 20).contains(&coordinate) {
                return None;
            }
            key = key << 21 | (coordinate as u64 & 0x1F_FFFF);
        }
        Some(Self {
            stream: StreamId::TILE,
            key,
            version,
        })
    }

    /// The map tile it is; `None` if it is of another stream.
    pub fn tile(self) -> Option<TileId> {
        let coordinate = |shift: u32| ((self.key >> shift) as i32) << 11 >> 11;
        (self.stream == StreamId::TILE && self.key >> 63 == 0).then(|| TileId {
            x: coordinate(42),
            y: coordinate(21),
            z: coordinate(0),
        })
    }
}

/// `stream:key@version`; a tile's key as `x/y/z`.
impl fmt::Display for ObjectId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.tile() {
            Some(tile) => write!(f, "tile:{tile}@{}", self.version),
            None => write!(f, "{}:{}@{}", self.stream.0, self.key, self.version),
        }
    }
}

/// How much an object matters, and for how long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Service {
    /// Delivered eventually. A newer version replaces one that waits.
    Reliable,
    /// Goes before everything else, but only until its deadline or a newer object of its stream.
    Latest {
        /// How long it is worth anything.
        deadline: Duration,
    },
    /// Sent once when nothing else waits, and not resent.
    BestEffort,
}

impl Service {
    fn to_wire(self) -> u8 {
        match self {
            Self::Reliable => 0,
            Self::Latest { .. } => 1,
            Self::BestEffort => 2,
        }
    }
}

/// Something to be sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Object {
    /// Its name.
    pub id: ObjectId,
    /// How it is treated.
    pub service: Service,
    /// Its content, 1 to [`MAX_OBJECT_BYTES`].
    pub bytes: Vec<u8>,
}

/// What a receiver says of a transfer, `TANDEM_TRANSFER_STATE` of the dialect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TransferState {
    Wanted = 0,
    Complete = 1,
    Unknown = 2,
    Refused = 3,
    Damaged = 4,
}

impl TransferState {
    fn from_wire(state: u8) -> Option<Self> {
        [
            Self::Wanted,
            Self::Complete,
            Self::Unknown,
            Self::Refused,
            Self::Damaged,
        ]
        .into_iter()
        .find(|known| *known as u8 == state)
    }
}

/// Transfers that one `TANDEM_REPORT` can tell about.
const REPORT_ENTRIES: usize = 8;
