//! Training data with truth: streets at many moments, written to files that need no program of ours to be read.
//!
//! A *sequence* is a drive through one scene with one seed. Sequences are independent of one another: each thread makes
//! one after the other, holding one frame of it, so that memory does not grow with the size of the set and its bytes do
//! not depend on how many threads there are. A sequence is written to `NAME.part` and gets its name when it is whole; a
//! run that was ended therefore goes on with the sequences that are missing.
//!
//! `docs/dataset.md` says what each file holds.

pub mod cli;
mod disk;
mod files;
mod grid;
mod opv2v;
mod record;
mod tandem;
mod work;
mod world;

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;

use maps::time::Stamp;

use crate::scene::Name;

pub use disk::{Disk, Local};
pub use record::{Checked, check};
pub use work::{Outcome, Progress, run};

/// How long there is traffic in a street.
const DRIVE_S: f64 = 240.0;
/// The `LiDAR` turns this often.
const MOST_HZ: f64 = 10.0;

/// What a sequence is for. No seed is in two of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Split {
    /// Seeds 0 to 999.
    Train,
    /// Seeds 1000 to 1099.
    Val,
    /// Seeds 1100 to 1199: nothing is ever fitted on these.
    Test,
}

impl Split {
    /// Its seeds.
    pub fn seeds(self) -> Range<u64> {
        match self {
            Self::Train => 0..1000,
            Self::Val => 1000..1100,
            Self::Test => 1100..1200,
        }
    }
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
        })
    }
}

/// Which files there are, and what is in them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Layout {
    /// Our own: everything.
    Tandem,
    /// That of OPV2V, which `OpenCOOD` reads.
    Opv2v,
}

impl Layout {
    /// The folder of a split.
    pub fn folder(self, split: Split) -> String {
        match (self, split) {
            (Self::Opv2v, Split::Val) => "validate".to_owned(),
            _ => split.to_string(),
        }
    }

    /// Frames a second if nothing else is asked for: those of nuScenes' labels, and those of OPV2V.
    pub fn usual_hz(self) -> f64 {
        match self {
            Self::Tandem => 2.0,
            Self::Opv2v => 10.0,
        }
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Tandem => "tandem",
            Self::Opv2v => "opv2v",
        })
    }
}

/// What to make.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// What for.
    pub split: Split,
    /// In which files.
    pub layout: Layout,
    /// The folder that holds the folders of the splits.
    pub out: PathBuf,
    /// Streets.
    pub scenes: Vec<Name>,
    /// Seeds, each of which every street is generated from.
    pub seeds: Range<u64>,
    /// Frames of each sequence.
    pub frames: u32,
    /// Frames a second, at most 10.
    pub rate_hz: f64,
    /// How many threads work.
    pub threads: usize,
}

impl Settings {
    /// Refuses what cannot be made.
    pub fn check(&self) -> Result<(), DatasetError> {
        let allowed = self.split.seeds();
        if self.seeds.start < allowed.start || self.seeds.end > allowed.end {
            return Err(DatasetError::Seeds {
                split: self.split,
                asked: self.seeds.clone(),
                allowed,
            });
        }
        if self.scenes.is_empty() || self.seeds.is_empty() || self.frames == 0 {
            return Err(DatasetError::Nothing);
        }
        if self.scenes.contains(&Name::Room) {
            return Err(DatasetError::Room);
        }
        if !(self.rate_hz > 0.0 && self.rate_hz <= MOST_HZ) {
            return Err(DatasetError::Rate(self.rate_hz));
        }
        let seconds = f64::from(self.frames) / self.rate_hz;
        if seconds > DRIVE_S {
            return Err(DatasetError::TooLong {
                seconds,
                frames: (DRIVE_S * self.rate_hz) as u32,
            });
        }
        Ok(())
    }

    /// The folder of the split.
    pub fn folder(&self) -> PathBuf {
        self.out.join(self.layout.folder(self.split))
    }

    /// When a frame is: the first one interval after the start, so that a turn of the `LiDAR` is over.
    fn stamp(&self, frame: u32) -> Stamp {
        let seconds = f64::from(frame + 1) / self.rate_hz;
        Stamp::from_secs_f64(seconds).unwrap_or(Stamp::ZERO)
    }

    /// All sequences, seed by seed: a set that is cut short still has every scene.
    fn jobs(&self) -> Vec<Job> {
        let scenes = |seed| {
            self.scenes.iter().map(move |scene| Job {
                scene: *scene,
                seed,
            })
        };
        self.seeds.clone().flat_map(scenes).collect()
    }
}

/// One sequence that is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Job {
    scene: Name,
    seed: u64,
}

impl fmt::Display for Job {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{:04}", self.scene, self.seed)
    }
}

/// Why a set cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// Seeds of another split.
    #[error(
        "seeds {}..{} are not all {split} seeds: those are {}..{}",
        .asked.start, .asked.end, .allowed.start, .allowed.end
    )]
    Seeds {
        /// The split.
        split: Split,
        /// What was asked for.
        asked: Range<u64>,
        /// What there is.
        allowed: Range<u64>,
    },
    /// An empty set.
    #[error("nothing to do: ask for at least one scene, one seed and one frame")]
    Nothing,
    /// The room.
    #[error(
        "the room has no ground vehicle: ask for streets, or use `sitl run --scene room --record FILE`"
    )]
    Room,
    /// No rate, or too high a rate.
    #[error(
        "{0} frames a second cannot be made: the LiDAR turns {MOST_HZ} times a second, ask for --rate 10 or less"
    )]
    Rate(f64),
    /// Longer than there is traffic.
    #[error(
        "a sequence of {seconds} s is longer than the {DRIVE_S} s of traffic: ask for --frames {frames} or less"
    )]
    TooLong {
        /// What was asked for.
        seconds: f64,
        /// What fits at that rate.
        frames: u32,
    },
    /// Another program is at it.
    #[error("another sitl writes to {}: wait for it, or choose another --out", .0.display())]
    Busy(PathBuf),
    /// What is there was made with other settings.
    #[error(
        "{} has {found}, not {asked}: choose another --out, or delete it",
        .folder.display()
    )]
    Other {
        /// The folder of a sequence or of the split.
        folder: PathBuf,
        /// How it was made.
        found: String,
        /// How it would be made.
        asked: String,
    },
    /// What is there is not what this program makes of the same settings.
    #[error(
        "{} was made by another version of sitl: this one makes other bytes of the same seed ({file} differs). \
         Choose another --out, or delete {}",
        .folder.display(), .folder.display()
    )]
    Version {
        /// A sequence.
        folder: PathBuf,
        /// The first file that differs.
        file: String,
    },
    /// There is something by the name of a sequence.
    #[error("{} is in the way: it has no readable sequence.json ({why}); move it elsewhere, or delete it", .folder.display())]
    InTheWay {
        /// What is there.
        folder: PathBuf,
        /// Why it is not taken for a sequence.
        why: String,
    },
    /// A sequence has lost files.
    #[error("{} is damaged: {why}; delete it, and the same command makes it again", .folder.display())]
    Damaged {
        /// A sequence.
        folder: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// The disk is too small.
    #[error(
        "{} needs about {} and has {} free: free some, choose another --out, or ask for fewer --seeds or --frames",
        .folder.display(), Size(*.needed), Size(*.free)
    )]
    NoRoom {
        /// Where.
        folder: PathBuf,
        /// Bytes that are missing yet.
        needed: u64,
        /// Bytes that there are.
        free: u64,
    },
    /// The disk is full.
    #[error("the disk is full at {}: free some space, and the same command goes on; whole sequences are kept", .0.display())]
    Full(PathBuf),
    /// A file or folder cannot be written or read.
    #[error("cannot {doing} {}", .path.display())]
    Io {
        /// What was tried.
        doing: &'static str,
        /// On what.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// A picture cannot be encoded.
    #[error("cannot encode a picture of {sequence}")]
    Picture {
        /// The sequence.
        sequence: String,
        /// Why not.
        source: png::EncodingError,
    },
    /// No threads.
    #[error("cannot start {0} threads")]
    Threads(usize),
}

/// A number of bytes, to be read.
#[derive(Clone, Copy, Debug)]
pub struct Size(pub u64);

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bytes = self.0 as f64;
        match bytes {
            ..1e6 => write!(f, "{:.0} kB", bytes / 1e3),
            ..1e9 => write!(f, "{:.0} MB", bytes / 1e6),
            _ => write!(f, "{:.1} GB", bytes / 1e9),
        }
    }
}

#[cfg(test)]
mod tests;
