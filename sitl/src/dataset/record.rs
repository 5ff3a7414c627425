//! What a set says about itself: `sequence.json` in each sequence, and `dataset.json` in the folder of its split.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::disk::{Digests, Disk, cannot, replace};
use super::{DatasetError, Job, Settings};
use crate::scene::Class;

/// Version of the layouts: what changes a file's meaning changes this.
const FORMAT: u32 = 1;
/// What each sequence says about itself.
pub(super) const SEQUENCE: &str = "sequence.json";
/// What the folder of a split says about itself.
const DATASET: &str = "dataset.json";

/// How something was made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Making {
    format: u32,
    made_by: String,
    layout: String,
    split: String,
    frames: u32,
    rate_hz: f64,
}

/// `sequence.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    #[serde(flatten)]
    making: Making,
    scene: String,
    seed: u64,
    /// Files beside this one.
    files: u64,
    /// Bytes of those.
    pub(super) bytes: u64,
    /// Over those; see [`Digests::xxh3`].
    xxh3: String,
}

/// `dataset.json`.
#[derive(Serialize, Deserialize)]
struct Manifest {
    #[serde(flatten)]
    making: Making,
    /// What the numbers in masks, grids and objects mean.
    classes: BTreeMap<u8, String>,
    /// The sequences that are whole.
    sequences: BTreeMap<String, Entry>,
}

#[derive(Serialize, Deserialize)]
struct Entry {
    files: u64,
    bytes: u64,
    xxh3: String,
}

impl Making {
    fn new(settings: &Settings) -> Self {
        Self {
            format: FORMAT,
            made_by: format!("sitl {}", env!("CARGO_PKG_VERSION")),
            layout: settings.layout.to_string(),
            split: settings.split.to_string(),
            frames: settings.frames,
            rate_hz: settings.rate_hz,
        }
    }

    fn compare(&self, asked: &Self, folder: &Path) -> Result<(), DatasetError> {
        if self == asked {
            return Ok(());
        }
        Err(DatasetError::Other {
            folder: folder.to_owned(),
            found: self.to_string(),
            asked: asked.to_string(),
        })
    }
}

impl std::fmt::Display for Making {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} frames at {} Hz for {} in the {} layout, format {}, by {}",
            self.frames, self.rate_hz, self.split, self.layout, self.format, self.made_by
        )
    }
}

impl Record {
    pub(super) fn new(settings: &Settings, job: Job, digests: &Digests) -> Self {
        Self {
            making: Making::new(settings),
            scene: job.scene.to_string(),
            seed: job.seed,
            files: digests.files(),
            bytes: digests.bytes(),
            xxh3: digests.xxh3(),
        }
    }

    pub(super) fn text(&self) -> Vec<u8> {
        json(self)
    }

    fn entry(&self) -> Entry {
        Entry {
            files: self.files,
            bytes: self.bytes,
            xxh3: self.xxh3.clone(),
        }
    }
}

/// The record of a sequence that is whole; `None` if there is no such sequence yet.
pub(super) fn whole(settings: &Settings, job: Job) -> Result<Option<Record>, DatasetError> {
    let folder = settings.folder().join(job.to_string());
    if !folder.exists() {
        return Ok(None);
    }
    let in_the_way = |why: String| DatasetError::InTheWay {
        folder: folder.clone(),
        why,
    };
    let text = fs::read(folder.join(SEQUENCE)).map_err(|error| in_the_way(error.to_string()))?;
    let record: Record =
        serde_json::from_slice(&text).map_err(|error| in_the_way(error.to_string()))?;
    record.making.compare(&Making::new(settings), &folder)?;
    let (mut files, mut bytes) = (0, 0);
    each_file(&folder, "", &mut |_, path| {
        let meta = fs::metadata(path).map_err(cannot("read", path))?;
        files += 1;
        bytes += meta.len();
        Ok(())
    })?;
    if (files, bytes) != (record.files, record.bytes) {
        let (had, of) = (record.files, record.bytes);
        let why = format!("{files} files of {bytes} bytes instead of {had} of {of}");
        return Err(DatasetError::Damaged { folder, why });
    }
    Ok(Some(record))
}

/// Refuses a split that was made with other settings.
pub(super) fn compare(settings: &Settings) -> Result<(), DatasetError> {
    let path = settings.folder().join(DATASET);
    if !path.exists() {
        return Ok(());
    }
    let found = read_manifest(&path)?;
    found
        .making
        .compare(&Making::new(settings), &settings.folder())
}

/// Writes `dataset.json` of these sequences, and of those that it had already.
pub(super) fn write_manifest(
    disk: &dyn Disk,
    settings: &Settings,
    records: &BTreeMap<String, Record>,
) -> Result<(), DatasetError> {
    let path = settings.folder().join(DATASET);
    let mut sequences = if path.exists() {
        read_manifest(&path)?.sequences
    } else {
        BTreeMap::new()
    };
    sequences.retain(|name, _| settings.folder().join(name).join(SEQUENCE).is_file());
    let entries = records
        .iter()
        .map(|(name, record)| (name.clone(), record.entry()));
    sequences.extend(entries);
    let manifest = Manifest {
        making: Making::new(settings),
        classes: classes(),
        sequences,
    };
    replace(disk, &path, &json(&manifest))
}

fn read_manifest(path: &Path) -> Result<Manifest, DatasetError> {
    let text = fs::read(path).map_err(cannot("read", path))?;
    serde_json::from_slice(&text).map_err(|error| DatasetError::InTheWay {
        folder: path.to_owned(),
        why: error.to_string(),
    })
}

/// What [`check`] has read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Checked {
    /// Sequences that are as they were written.
    pub sequences: u64,
    /// Their bytes.
    pub bytes: u64,
}

/// Reads every file of every sequence of a split again, and compares them with what was written.
pub fn check(folder: &Path) -> Result<Checked, DatasetError> {
    let manifest = read_manifest(&folder.join(DATASET))?;
    let mut checked = Checked::default();
    for (name, entry) in &manifest.sequences {
        let folder = folder.join(name);
        let mut digests = Digests::default();
        each_file(&folder, "", &mut |name, path| {
            digests.add(name, &fs::read(path).map_err(cannot("read", path))?);
            Ok(())
        })?;
        if digests.xxh3() != entry.xxh3 {
            let why = "its files are not those that were written".to_owned();
            return Err(DatasetError::Damaged { folder, why });
        }
        checked.sequences += 1;
        checked.bytes += digests.bytes();
    }
    Ok(checked)
}

/// All files of a sequence but its record, with their names within it.
fn each_file(
    folder: &Path,
    prefix: &str,
    visit: &mut dyn FnMut(&str, &Path) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    for entry in fs::read_dir(folder).map_err(cannot("read", folder))? {
        let path = entry.map_err(cannot("read", folder))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let name = format!("{prefix}{name}");
        if path.is_dir() {
            each_file(&path, &format!("{name}/"), visit)?;
        } else if name != SEQUENCE {
            visit(&name, &path)?;
        }
    }
    Ok(())
}

fn classes() -> BTreeMap<u8, String> {
    Class::ALL
        .into_iter()
        .map(|class| (class as u8, format!("{class:?}").to_lowercase()))
        .collect()
}

fn json(value: &impl Serialize) -> Vec<u8> {
    let text = serde_json::to_string_pretty(value).expect("numbers and names have a JSON form");
    (text + "\n").into_bytes()
}
