//! The text above the nodes, and what it says of them.

use std::fmt;
use std::io::{self, BufRead, Read as _};

use maps::voxel::VoxelMap;

use crate::ReadError;

/// The first line of each kind of file.
pub(crate) const OT_MAGIC: &str = "# Octomap OcTree file";
pub(crate) const BT_MAGIC: &str = "# Octomap OcTree binary file";
/// What a `.bt` file of before 2010 begins with instead: the number 3, little-endian.
const OLD_MAGIC: [u8; 4] = [3, 0, 0, 0];
/// The longest header that is read.
pub(crate) const LONGEST_HEADER: u64 = 64 * 1024;

/// How the nodes are written down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `.ot`: each node with its log-odds, and its colour if the tree has colours.
    Full,
    /// `.bt`: free or occupied.
    Binary,
    /// `.bt` as it was before 2010, without a text header.
    OldBinary,
}

/// Which of `OctoMap`'s trees the file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeType {
    /// Occupancy.
    Plain,
    /// Occupancy and a colour for each node.
    Color,
    /// Occupancy; its time stamps are not in the file, `OctoMap` does not write them.
    Stamped,
}

impl TreeType {
    /// The name in the header.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "OcTree",
            Self::Color => "ColorOcTree",
            Self::Stamped => "OcTreeStamped",
        }
    }

    fn named(name: &str) -> Option<Self> {
        [Self::Plain, Self::Color, Self::Stamped]
            .into_iter()
            .find(|tree| tree.name() == name)
    }
}

/// As in the header of the file.
impl fmt::Display for TreeType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What the header says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Header {
    /// How the nodes are written down.
    pub format: Format,
    /// Which tree they make.
    pub tree: TreeType,
    /// The edge of a voxel.
    pub resolution_m: f64,
    /// How many nodes there are, by the header; `None` if it does not say. The nodes themselves decide.
    pub nodes: Option<u64>,
}

impl Header {
    /// Reads the header of whichever kind of file this is, up to the first node.
    pub(crate) fn read(from: &mut impl BufRead) -> Result<Self, ReadError> {
        // Enough to tell an old file: no text begins with these bytes.
        let start = from.fill_buf()?;
        if !start.is_empty() && start[0] == OLD_MAGIC[0] {
            return Self::read_old(from);
        }
        let mut lines = Lines {
            from: from.take(LONGEST_HEADER),
            line: Vec::new(),
        };
        let first = lines.next()?.unwrap_or_default();
        let format = if first.starts_with(BT_MAGIC) {
            Format::Binary
        } else if first.starts_with(OT_MAGIC) {
            Format::Full
        } else {
            return Err(ReadError::NotOctomap);
        };
        let mut tree = TreeType::Plain;
        let mut nodes = None;
        let mut resolution = String::new();
        loop {
            let line = lines.next()?.ok_or(ReadError::NoData)?;
            let (key, value) = line.split_once(' ').unwrap_or((&line, ""));
            match key {
                "data" => break,
                "id" => {
                    tree = TreeType::named(value).ok_or_else(|| ReadError::OtherTree {
                        found: value.chars().take(64).collect(),
                    })?;
                }
                "size" => nodes = value.parse().ok(),
                "res" => value.clone_into(&mut resolution),
                _ => {}
            }
        }
        let resolution_m = resolution
            .parse()
            .ok()
            .filter(|m| is_resolution(*m))
            .ok_or_else(|| ReadError::BadResolution {
                found: resolution.chars().take(64).collect(),
            })?;
        Ok(Self {
            format,
            tree,
            resolution_m,
            nodes,
        })
    }

    /// The number 3, the resolution as an f64 and the number of nodes as a u32.
    fn read_old(from: &mut impl BufRead) -> Result<Self, ReadError> {
        let mut magic = [0; 4];
        from.read_exact(&mut magic)?;
        if magic != OLD_MAGIC {
            return Err(ReadError::NotOctomap);
        }
        let mut resolution = [0; 8];
        from.read_exact(&mut resolution)?;
        let mut nodes = [0; 4];
        from.read_exact(&mut nodes)?;
        let resolution_m = f64::from_le_bytes(resolution);
        if !is_resolution(resolution_m) {
            return Err(ReadError::BadResolution {
                found: resolution_m.to_string(),
            });
        }
        Ok(Self {
            format: Format::OldBinary,
            tree: TreeType::Plain,
            resolution_m,
            nodes: Some(u32::from_le_bytes(nodes).into()),
        })
    }
}

fn is_resolution(m: f64) -> bool {
    VoxelMap::RESOLUTION_M.contains(&m)
}

struct Lines<R> {
    from: io::Take<R>,
    line: Vec<u8>,
}

impl<R: BufRead> Lines<R> {
    /// The next line without what ends it; `None` where the file, or as much of it as may be header, does.
    fn next(&mut self) -> io::Result<Option<String>> {
        self.line.clear();
        self.from.read_until(b'\n', &mut self.line)?;
        let text = String::from_utf8_lossy(&self.line).trim_end().to_owned();
        Ok(self.line.ends_with(b"\n").then_some(text))
    }
}
