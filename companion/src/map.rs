//! What `companion map` does with map files: says what is in them, converts and draws them.
//!
//! - [`files`]: reading and writing a map, whatever kind of file it is.
//! - [`info`]: what is in a map, in lines to read.
//! - [`drawing`]: pictures as PNG files.

pub mod drawing;
pub mod files;
pub mod info;

use std::io;
use std::path::PathBuf;

use maps::picture::PictureError;
use octomap::ReadError;

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
    /// What there is cannot be written.
    #[error(transparent)]
    Write(#[from] OutputError),
}
