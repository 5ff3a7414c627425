//! What can go wrong, and what to do about it.

use std::path::{Path, PathBuf};

use maps::tile::{TileError, TileId};
use rusqlite::{Error, ErrorCode};

/// Why a store could not do something.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The folder is missing, or may not be written.
    #[error("cannot open {path:?}: {source}: check that the folder exists and may be written")]
    CannotOpen {
        /// The file.
        path: PathBuf,
        /// What SQLite says.
        source: rusqlite::Error,
    },
    /// The folder is missing, or may not be written.
    #[error("cannot lock {path:?}: {source}: check that the folder exists and may be written")]
    CannotLock {
        /// The file that is locked, beside the store.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// Some other file.
    #[error("{path:?} is not a tile store: give another path, or move the file away")]
    NotAStore {
        /// The file.
        path: PathBuf,
    },
    /// Written by a newer program.
    #[error(
        "the store {path:?} has schema {found}, this program knows up to schema {known}: use a newer program"
    )]
    NewerSchema {
        /// The file.
        path: PathBuf,
        /// The file's.
        found: i64,
        /// The newest that is known.
        known: i64,
    },
    /// No space, on the device or below the limit of the settings. What is pending is still there.
    #[error(
        "no space left for {path:?}: what is not written yet is kept in memory; free some space or compact the store"
    )]
    Full {
        /// The file.
        path: PathBuf,
    },
    /// Another process has it.
    #[error("another process has the store {path:?} open: stop it, or give another path")]
    Busy {
        /// The file.
        path: PathBuf,
    },
    /// Bits have changed on the disk.
    #[error(
        "the store {path:?} is damaged ({source}): move it away, and save what can be read with `sqlite3 {path:?} .recover`"
    )]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// What SQLite says.
        source: rusqlite::Error,
    },
    /// Bits have changed on the disk, in one version only.
    #[error(
        "version {version} of tile {id} in {path:?} is damaged ({source}): older versions may be whole, or ask a peer for the tile"
    )]
    DamagedTile {
        /// The file.
        path: PathBuf,
        /// The tile.
        id: TileId,
        /// The version.
        version: u64,
        /// What is wrong with it.
        source: TileError,
    },
    /// It decodes, but to something else than what was put in.
    #[error(
        "version {version} of tile {id} in {path:?} has digest {found:016x}, but {expected:016x} was put in: ask a peer for the tile"
    )]
    OtherContent {
        /// The file.
        path: PathBuf,
        /// The tile.
        id: TileId,
        /// The version.
        version: u64,
        /// That of what was put in.
        expected: u64,
        /// That of what is there.
        found: u64,
    },
    /// The store has a newer version of the tile, or the same version with other content.
    #[error("tile {id}: version {given} is not newer than version {newest} in the store")]
    OldVersion {
        /// The tile.
        id: TileId,
        /// That was to be put in.
        given: u64,
        /// That the store has.
        newest: u64,
    },
    /// Anything else that SQLite or the device says.
    #[error("cannot use {path:?}: {source}")]
    Device {
        /// The file.
        path: PathBuf,
        /// What SQLite says.
        source: rusqlite::Error,
    },
}

impl StoreError {
    pub(crate) fn from_sqlite(path: &Path, source: rusqlite::Error) -> Self {
        let path = path.to_owned();
        match source.sqlite_error_code() {
            Some(ErrorCode::CannotOpen | ErrorCode::ReadOnly | ErrorCode::PermissionDenied) => {
                Self::CannotOpen { path, source }
            }
            Some(ErrorCode::NotADatabase) => Self::NotAStore { path },
            Some(ErrorCode::DiskFull) => Self::Full { path },
            Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => Self::Busy { path },
            Some(ErrorCode::DatabaseCorrupt) => Self::Corrupt { path, source },
            // What a row points at is gone, or a column holds what nobody puts there.
            None if matches!(
                source,
                Error::QueryReturnedNoRows
                    | Error::InvalidColumnType(..)
                    | Error::FromSqlConversionFailure(..)
                    | Error::IntegralValueOutOfRange(..)
            ) =>
            {
                Self::Corrupt { path, source }
            }
            _ => Self::Device { path, source },
        }
    }
}
