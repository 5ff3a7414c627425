//! The map as the companions deliver it, tile by tile.
//!
//! It is the companion's own map, voxel for voxel: when the companion has finished, equal digests prove it.

use std::collections::BTreeMap;
use std::time::Duration;

use geodesy::{Geodetic, Origin};
use maps::frame::{Body, Isometry, World};
use maps::tile::{Tile, TileId};
use maps::time::Stamp;
use maps::voxel::{MapDigest, VoxelMap};
use mavlink_ext::Address;

use super::Timed;

/// No mission needs more tiles, and a broken sender shall not fill the memory.
const MAX_TILES: usize = 2048;
/// A changed map is hashed at most this often.
const DIGEST_EVERY: Duration = Duration::from_secs(1);

/// The geodetic origin of the map's frame.
#[derive(Debug)]
pub struct MapOrigin {
    /// Conversions.
    pub origin: Origin,
    /// Where it is.
    pub geodetic: Geodetic,
    /// Who said so; `None` while no companion has, and the first position of a vehicle stands in.
    pub from: Option<Address>,
    /// Counts the companion's changes of the origin.
    pub epoch: u32,
}

/// What a companion says of its work.
#[derive(Clone, Debug, PartialEq)]
pub struct CompanionStatus {
    /// Digest of its map.
    pub map_digest: u64,
    /// Occupied voxels in its map.
    pub voxels_occupied: u32,
    /// Tiles in its map.
    pub tiles_known: u32,
    /// Tiles it knows to be here in their newest version.
    pub tiles_delivered: u32,
    /// Frames it has processed.
    pub frames: u32,
    /// Frames it knew its pose in.
    pub frames_tracked: u32,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Bytes that wait to be sent.
    pub queued_bytes: u32,
    /// Bytes it sends per second.
    pub link_rate_bps: u32,
    /// 99th percentile from a frame to its pose, if known.
    pub slam_latency: Option<Duration>,
    /// 99th percentile from queueing a tile to its delivery, if known.
    pub delivery_latency: Option<Duration>,
    /// Share of symbols lost, if known.
    pub loss: Option<f64>,
    /// Whether its pose can be trusted.
    pub tracking: Tracking,
    /// Whether its sensors have come to their end: the map will not change any more.
    pub finished: bool,
}

/// State of a companion's localisation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tracking {
    /// No frame yet.
    None,
    /// The pose follows from the last one.
    Good,
    /// The last good pose is too old.
    Lost,
}

/// A companion computer.
#[derive(Clone, Debug, Default)]
pub struct Companion {
    /// When its heartbeat was last heard.
    pub heard_at: Option<Stamp>,
    /// What it says of its work.
    pub status: Option<Timed<CompanionStatus>>,
    /// Where its own odometry puts the body that carries the camera, while it knows.
    pub world_from_body: Option<Timed<Isometry<World, Body>>>,
}

/// How our map relates to the companion's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Agreement {
    /// Nobody has told a digest, or nothing was received.
    Unknown,
    /// It still grows, or tiles are on their way.
    Arriving,
    /// Finished and equal.
    Equal,
    /// Finished, nothing on its way, and not equal.
    Differs,
}

/// Everything known of the map.
#[derive(Debug, Default)]
pub struct MapState {
    /// The voxels; `None` before the first tile, which tells the resolution.
    pub voxels: Option<VoxelMap>,
    /// Where its frame is on the earth.
    pub origin: Option<MapOrigin>,
    /// Who builds it.
    pub companions: BTreeMap<Address, Companion>,
    /// The version received last of each tile.
    pub versions: BTreeMap<TileId, u64>,
    /// Tiles received, counting every version.
    pub tiles_received: u64,
    /// Objects that were received and are no tile of this map, and why the last one was not.
    pub refused: u64,
    /// Why the last object was refused.
    pub last_refusal: Option<String>,
    /// Digest of our map, and when it was computed.
    pub digest: Option<Timed<MapDigest>>,
    /// When a tile last changed the map.
    pub changed_at: Option<Stamp>,
    occupied: usize,
}

impl MapState {
    /// No map yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Puts a tile into the map in place of what was there; says whether it could. Of an older version than what is there,
    /// it is that of a companion that has started anew.
    pub fn receive(&mut self, now: Stamp, tile: &Tile) -> bool {
        self.tiles_received += 1;
        if self.versions.len() >= MAX_TILES && !self.versions.contains_key(&tile.id) {
            self.refuse(format!("the map has {MAX_TILES} tiles already"));
            return false;
        }
        let voxels = self
            .voxels
            .get_or_insert_with(|| VoxelMap::new(tile.resolution_m));
        if let Err(error) = voxels.set_tile(tile) {
            self.refuse(error.to_string());
            return false;
        }
        self.versions.insert(tile.id, tile.version);
        self.changed_at = Some(now);
        true
    }

    /// Counts an object that cannot be used.
    pub fn refuse(&mut self, why: String) {
        self.refused += 1;
        self.last_refusal = Some(why);
    }

    /// Tiles in the map.
    pub fn tiles(&self) -> usize {
        self.versions.len()
    }

    /// Occupied voxels, when they were last counted.
    pub fn occupied(&self) -> usize {
        self.occupied
    }

    /// Hashes and counts a map that has changed, at most once a second.
    pub fn tick(&mut self, now: Stamp) {
        let Some(changed_at) = self.changed_at else {
            return;
        };
        let due = self
            .digest
            .is_none_or(|digest| digest.at <= changed_at && now.since(digest.at) >= DIGEST_EVERY);
        if let (true, Some(voxels)) = (due, &self.voxels) {
            self.digest = Some(Timed::new(voxels.digest(), now));
            self.occupied = voxels.occupied_count();
        }
    }

    /// The latest word of any companion.
    pub fn status(&self) -> Option<&Timed<CompanionStatus>> {
        let told = self
            .companions
            .values()
            .filter_map(|companion| companion.status.as_ref());
        told.max_by_key(|status| status.at)
    }

    /// Whether our map is the companion's.
    pub fn agreement(&self) -> Agreement {
        let (Some(status), Some(digest)) = (self.status(), self.digest) else {
            return Agreement::Unknown;
        };
        let hashed_since = self.changed_at.is_none_or(|changed| digest.at > changed);
        if !status.value.finished || !hashed_since {
            return Agreement::Arriving;
        }
        if status.value.map_digest == digest.value.0 {
            return Agreement::Equal;
        }
        let quiet = self
            .changed_at
            .is_some_and(|changed| status.at.since(changed) > Duration::from_secs(5));
        if quiet && status.value.queued_bytes == 0 {
            Agreement::Differs
        } else {
            Agreement::Arriving
        }
    }
}
