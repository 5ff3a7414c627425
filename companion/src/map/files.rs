//! Map files: opened by what is in them, written by what their name ends in.

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use maps::voxel::VoxelMap;
use octomap::{Content, Format, Opened, ReadOptions, Shape};
use store::AsOf;

use super::{MapError, stored};
use crate::output::write_atomically;

/// A map and where it comes from.
#[derive(Debug)]
pub struct OpenedMap {
    /// The map.
    pub map: VoxelMap,
    /// What kind of file it was, in words.
    pub kind: String,
    /// Occupied voxels whose colour is no class, where colours were to mean classes.
    pub unclassified: u64,
    /// How much more memory the process had after reading than before; `None` where the system does not say.
    pub resident_bytes: Option<u64>,
}

/// Reads a map: an `OctoMap` file of either kind, or a tile store as it was `as_of` then.
pub fn open(path: &Path, options: &ReadOptions, as_of: AsOf) -> Result<OpenedMap, MapError> {
    let cannot_open = |source| MapError::Open {
        path: path.to_owned(),
        source,
    };
    let mut file = BufReader::new(File::open(path).map_err(cannot_open)?);
    let before = resident_bytes();
    if file
        .fill_buf()
        .map_err(cannot_open)?
        .starts_with(stored::MAGIC)
    {
        let opened = stored::open(path, as_of)?;
        return Ok(OpenedMap {
            resident_bytes: grown(before),
            ..opened
        });
    }
    if as_of != AsOf::Newest {
        return Err(MapError::NoHistory {
            path: path.to_owned(),
        });
    }
    let opened = octomap::read(file, options);
    let opened = opened.map_err(|source| MapError::Read {
        path: path.to_owned(),
        source,
    })?;
    Ok(OpenedMap {
        kind: describe(&opened),
        map: opened.map,
        unclassified: opened.unclassified,
        resident_bytes: grown(before),
    })
}

fn grown(before: Option<u64>) -> Option<u64> {
    let (now, before) = resident_bytes().zip(before)?;
    Some(now.saturating_sub(before))
}

/// The memory of this process that is not swapped out: `VmRSS` of proc(5).
fn resident_bytes() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}

fn describe(opened: &Opened) -> String {
    let ending = match opened.header.format {
        Format::Full => ".ot",
        Format::Binary => ".bt",
        Format::OldBinary => ".bt of before 2010",
    };
    let Opened {
        header,
        nodes,
        pruned,
        ..
    } = opened;
    let said = match header.nodes {
        Some(said) if said != *nodes => format!(" ({said} by its header)"),
        _ => String::new(),
    };
    format!(
        "OctoMap {ending}, {} of {nodes} nodes{said}, {pruned} pruned leaves",
        header.tree
    )
}

/// Writes an `OctoMap` file: `.ot` or `.bt`, by its name.
pub fn save_octomap(
    map: &VoxelMap,
    path: &Path,
    content: Content,
    shape: Shape,
) -> Result<(), MapError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("ot") => Ok(write_atomically(path, |file| {
            octomap::write_ot_as(map, content, shape, file)
        })?),
        Some("bt") => {
            let what = match content {
                Content::Occupancy => None,
                Content::Color => Some("colours"),
                Content::Class => Some("classes"),
            };
            if let Some(what) = what {
                return Err(MapError::WouldLose {
                    path: path.to_owned(),
                    what,
                });
            }
            Ok(write_atomically(path, |file| {
                octomap::write_bt_as(map, shape, file)
            })?)
        }
        _ => Err(MapError::Ending {
            path: path.to_owned(),
            known: ".ot or .bt",
        }),
    }
}
