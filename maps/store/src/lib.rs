//! The tile store: one SQLite file that holds every version of every tile of a map, so that the map can be shown as it was
//! at any time.
//!
//! What is put in is acknowledged at once and written in batches, by [`Store::tick`]: a crash loses what was put within the
//! last [`Settings::flush_after`], half a second, and nothing else. Versions within one batch are one version of history:
//! only the last of them is kept. If a batch cannot be written, say for want of space, it stays in memory, the caller is
//! told, and the next tick tries again.
//!
//! The file is in WAL mode with `synchronous = FULL`: one `fsync` a batch, so that a batch that was written outlives not only
//! `kill -9`, for which nothing would be needed, but also a flat battery. At two batches a second that costs nothing.
//!
//! A version is kept whole or as a change of the one before it, at most [`Settings::chain`] changes in a row, with
//! everything that the tile knows ([`Detail::Sightings`](maps::tile::Detail)). A tile that is read is compared with the digest
//! it had when it was put: a store says that it is damaged, never anything else than what was.
//!
//! Nothing here has a clock or a thread: moments come in as arguments. They should be of a clock that goes on over restarts;
//! one that goes backwards counts as standing still. One process at a time has a store open, and a lock says so to others.
//!
//! ```
//! use maps::tile::Tile;
//! use maps::time::Stamp;
//! use maps::voxel::{LogOdds, Voxel, VoxelKey, VoxelMap};
//! use store::{AsOf, Settings, Store};
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("map.tandem");
//! let mut store = Store::open(&path, Settings::default())?;
//! let mut map = VoxelMap::new(0.1);
//! for (second, height) in [(10, 3), (20, 4)] {
//!     map.set_voxel(VoxelKey::new(1, 2, height), Voxel::new(LogOdds::HIT));
//!     for id in map.take_changed_tiles() {
//!         store.put(&map.tile(id).expect("it changed"), Stamp::from_nanos(second * 1_000_000_000))?;
//!     }
//!     store.tick(Stamp::from_nanos(second * 1_000_000_000 + 500_000_000))?;
//! }
//! let id = map.tile_ids()[0];
//! let then = AsOf::Time(Stamp::from_nanos(15_000_000_000));
//! assert_eq!(store.tile(id, AsOf::Newest)?, map.tile(id));
//! assert_eq!(store.tile(id, then)?.map(|tile| tile.known_count()), Some(1), "as it was");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod compact;
mod error;
mod read;
mod regions;
mod schema;
mod write;

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use maps::tile::{Tile, TileId};
use maps::time::Stamp;
use rusqlite::Connection;

pub use compact::{Compaction, Keep};
pub use error::StoreError;
pub use regions::{RegionDigest, RegionId};

/// How a store works.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The longest that something put in waits to be written: what a crash may cost.
    pub flush_after: Duration,
    /// The most changes that must be undone to have a tile whole again; 0 keeps every version whole.
    pub chain: u32,
    /// The most that the file may grow to, its log aside; beyond it the store is as if the disk were full.
    pub limit_bytes: Option<u64>,
}

/// Half a second, 7 changes, no limit.
impl Default for Settings {
    fn default() -> Self {
        Self {
            flush_after: Duration::from_millis(500),
            chain: 7,
            limit_bytes: None,
        }
    }
}

/// The place of a version in the order in which versions were put in. Numbers may be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Sequence(pub u64);

/// The number.
impl fmt::Display for Sequence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Which state of the map is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AsOf {
    /// The newest.
    Newest,
    /// As it was at that moment, that included.
    Time(Stamp),
    /// As it was after that version, of whatever tile, was put in.
    Sequence(Sequence),
}

/// A version of a tile in a store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileVersion {
    /// Which tile.
    pub id: TileId,
    /// Its version.
    pub version: u64,
    /// [`Tile::digest`].
    pub digest: u64,
    /// When in the order of all.
    pub sequence: Sequence,
    /// When.
    pub at: Stamp,
}

/// A version that waits to be written.
#[derive(Debug)]
struct Pending {
    tile: Tile,
    is: TileVersion,
}

/// The store. See the [crate](self).
#[derive(Debug)]
pub struct Store {
    connection: Connection,
    path: PathBuf,
    settings: Settings,
    pending: BTreeMap<TileId, Pending>,
    /// When the oldest of what is pending was put in.
    pending_since: Option<Stamp>,
    /// The last that was given out.
    sequence: Sequence,
    /// The latest moment that was heard of.
    now: Stamp,
    /// Versions written last, to encode changes of them without reading them again.
    recent: BTreeMap<TileId, (Sequence, Tile)>,
    /// Held as long as the store is open; the system lets go of it when the process ends, however it does.
    _lock: File,
}

impl Store {
    /// Opens a store, or makes a new one where there is no file. Takes milliseconds, whatever its size.
    pub fn open(path: &Path, settings: Settings) -> Result<Self, StoreError> {
        let lock = schema::lock(path)?;
        let connection = schema::open(path, &settings)?;
        let (sequence, now) =
            schema::last(&connection).map_err(|e| StoreError::from_sqlite(path, e))?;
        Ok(Self {
            connection,
            path: path.to_owned(),
            settings,
            pending: BTreeMap::new(),
            pending_since: None,
            sequence,
            now,
            recent: BTreeMap::new(),
            _lock: lock,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How many versions wait to be written.
    pub fn pending(&self) -> usize {
        self.pending.len()
    }

    /// Takes note of a moment; beyond what the file can tell apart, 292 years, all are its last.
    fn advance(&mut self, now: Stamp) {
        let last = Stamp::from_nanos(i64::MAX.unsigned_abs());
        self.now = self.now.max(now).min(last);
    }

    fn wrap(&self) -> impl Fn(rusqlite::Error) -> StoreError + use<> {
        let path = self.path.clone();
        move |source| StoreError::from_sqlite(&path, source)
    }
}

/// Writes what is pending; whether that worked cannot be told any more, so call [`Store::flush`] before.
impl Drop for Store {
    fn drop(&mut self) {
        // Nobody is left to be told.
        drop(self.flush());
    }
}
