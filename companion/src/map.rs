//! What `companion map` does with map files: says what is in them, converts and draws them.
//!
//! - [`files`]: reading and writing a map, whatever kind of file it is.
//! - [`stored`]: maps in a tile store.
//! - [`conflict`]: where two maps contradict each other.
//! - [`info`]: what is in a map, in lines to read.
//! - [`drawing`]: pictures as PNG files.

pub mod conflict;
pub mod drawing;
pub mod files;
pub mod info;
pub mod stored;

use std::io;
use std::path::PathBuf;

use maps::picture::PictureError;
use maps::tile::TileError;
use octomap::ReadError;
use store::StoreError;

use crate::output::OutputError;

/// Why nothing could be done with a map file.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// The file is not there, or not for us.
    #[error("cannot open {}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It is there, but no map.
    #[error("cannot read a map from {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: ReadError,
    },
    /// Its name does not say as what to write it.
    #[error("cannot tell from the name {} what to write: it must end in {known}", path.display())]
    Ending {
        /// The file.
        path: PathBuf,
        /// The endings that would do.
        known: &'static str,
    },
    /// A `.bt` file is only free and occupied.
    #[error("{} would not keep the {what} of the map: a .bt file has only free and occupied, write a .ot file", path.display())]
    WouldLose {
        /// The file.
        path: PathBuf,
        /// What it was to keep.
        what: &'static str,
    },
    /// There is no picture.
    #[error("cannot draw {}", path.display())]
    Draw {
        /// The map's file.
        path: PathBuf,
        /// Why.
        source: PictureError,
    },
    /// The store says no.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A store that nothing was put into, or nothing before the moment asked for.
    #[error("{} has no tile at that time", path.display())]
    NothingYet {
        /// The store.
        path: PathBuf,
    },
    /// Tiles that do not fit together.
    #[error("the tiles of {} are not of one map", path.display())]
    Mixed {
        /// The store.
        path: PathBuf,
        /// What does not fit.
        source: TileError,
    },
    /// Only a store has a past.
    #[error("{} is no tile store, so it has only one state: leave out --at", path.display())]
    NoHistory {
        /// The file.
        path: PathBuf,
    },
    /// Two maps with voxels of different size.
    #[error(
        "{} has voxels of {there_m} m, this map of {here_m} m: they cannot be laid on each other", path.display()
    )]
    Resolution {
        /// The other map.
        path: PathBuf,
        /// Its voxels.
        there_m: f64,
        /// Ours.
        here_m: f64,
    },
    /// What there is cannot be written.
    #[error(transparent)]
    Write(#[from] OutputError),
}
