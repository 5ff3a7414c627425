//! Reading `OctoMap` files, which may come from anyone: depth, voxels and header are bounded.

use std::io::{self, BufRead, Read as _};

use maps::voxel::{LogOdds, Voxel, VoxelKey, VoxelMap};

use crate::{BT_MAGIC, DEPTH, OT_MAGIC};

/// The most voxels that pruned leaves may stand for: 64 million, about 100 MB.
const MOST_VOXELS: u64 = 1 << 26;
/// The longest header that is read.
const LONGEST_HEADER: u64 = 64 * 1024;

/// Why an `OctoMap` file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file itself; `UnexpectedEof` where it ends in the midst of the tree.
    #[error("cannot read the file: {0}")]
    Io(#[from] io::Error),
    /// Another kind of file.
    #[error("the file does not begin with {expected:?}")]
    NotOctomap {
        /// Its first line should have been this.
        expected: &'static str,
    },
    /// A tree with other nodes, as of colours or time stamps.
    #[error("the file holds a tree of type {found:?}, only OcTree is understood")]
    OtherTree {
        /// What the header says.
        found: String,
    },
    /// Missing, no number, or no resolution that a map can have.
    #[error("the header gives the resolution as {found:?}")]
    BadResolution {
        /// What it says.
        found: String,
    },
    /// The header does not come to an end.
    #[error("the header has no line \"data\" in its first {LONGEST_HEADER} bytes")]
    NoData,
    /// A node below the lowest level.
    #[error("the tree is deeper than {DEPTH} levels")]
    TooDeep,
    /// Its leaves stand for too much to hold.
    #[error("the leaves stand for more than {MOST_VOXELS} voxels")]
    TooLarge,
}

/// Reads a `.ot` file. Leaves above the lowest level become voxels; inner nodes tell nothing that their leaves do not.
/// Log-odds are rounded to our steps of 0.05 and clamped.
pub fn read_ot(from: impl BufRead) -> Result<VoxelMap, ReadError> {
    let (mut tree, nodes) = Tree::open(from, OT_MAGIC)?;
    if nodes {
        tree.full_node([0; 3], 0)?;
    }
    Ok(tree.map)
}

/// Reads a `.bt` file. Leaves above the lowest level become voxels; free and occupied ones are as sure as can be, as
/// `OctoMap` reads them.
pub fn read_bt(from: impl BufRead) -> Result<VoxelMap, ReadError> {
    let (mut tree, nodes) = Tree::open(from, BT_MAGIC)?;
    if nodes {
        tree.binary_node([0; 3], 0)?;
    }
    Ok(tree.map)
}

struct Tree<R> {
    from: R,
    map: VoxelMap,
    voxels: u64,
}

impl<R: BufRead> Tree<R> {
    /// Reads the header; also whether there are any nodes.
    fn open(mut from: R, magic: &'static str) -> Result<(Self, bool), ReadError> {
        let mut header = from.by_ref().take(LONGEST_HEADER);
        let mut line = Vec::new();
        let mut next = |header: &mut io::Take<&mut R>| -> Result<Option<String>, ReadError> {
            line.clear();
            header.read_until(b'\n', &mut line)?;
            let text = String::from_utf8_lossy(&line).trim_end().to_owned();
            Ok(line.ends_with(b"\n").then_some(text))
        };
        if next(&mut header)?.is_none_or(|line| !line.starts_with(magic)) {
            return Err(ReadError::NotOctomap { expected: magic });
        }
        let mut nodes = true;
        let mut resolution = String::new();
        loop {
            let line = next(&mut header)?.ok_or(ReadError::NoData)?;
            let (key, value) = line.split_once(' ').unwrap_or((&line, ""));
            match key {
                "data" => break,
                "id" if value != "OcTree" => {
                    return Err(ReadError::OtherTree {
                        found: value.to_owned(),
                    });
                }
                "size" => nodes = value != "0",
                "res" => value.clone_into(&mut resolution),
                _ => {}
            }
        }
        let resolution_m = resolution
            .parse()
            .ok()
            .filter(|m| VoxelMap::RESOLUTION_M.contains(m))
            .ok_or(ReadError::BadResolution { found: resolution })?;
        let map = VoxelMap::new(resolution_m);
        Ok((
            Self {
                from,
                map,
                voxels: 0,
            },
            nodes,
        ))
    }

    /// A node of a `.ot` file at `depth`, of which `at` is the path along each axis.
    fn full_node(&mut self, at: [i32; 3], depth: u32) -> Result<(), ReadError> {
        let [a, b, c, d, children] = self.read()?;
        if children == 0 {
            let log_odds = f32::from_le_bytes([a, b, c, d]);
            return self.leaf(at, depth, LogOdds::nearest(log_odds.into()));
        }
        let depth = one_deeper(depth)?;
        for child in (0..8).filter(|child| children >> child & 1 == 1) {
            self.full_node(child_of(at, child), depth)?;
        }
        Ok(())
    }

    /// An inner node of a `.bt` file.
    fn binary_node(&mut self, at: [i32; 3], depth: u32) -> Result<(), ReadError> {
        let kinds = u16::from_le_bytes(self.read()?);
        let depth = one_deeper(depth)?;
        for child in 0..8 {
            let at = child_of(at, child);
            match kinds >> (2 * child) & 3 {
                0b01 => self.leaf(at, depth, LogOdds::MIN)?,
                0b10 => self.leaf(at, depth, LogOdds::MAX)?,
                0b11 => self.binary_node(at, depth)?,
                _ => {}
            }
        }
        Ok(())
    }

    fn leaf(&mut self, at: [i32; 3], depth: u32, log_odds: LogOdds) -> Result<(), ReadError> {
        let levels = DEPTH - depth;
        self.voxels += 1 << (3 * levels);
        if self.voxels > MOST_VOXELS {
            return Err(ReadError::TooLarge);
        }
        let [x, y, z] = at.map(|c| (c << levels) + VoxelKey::RANGE.start());
        let voxel = Voxel::new(log_odds);
        let edge = 1 << levels;
        for dz in 0..edge {
            for dy in 0..edge {
                for dx in 0..edge {
                    self.map
                        .set_voxel(VoxelKey::new(x + dx, y + dy, z + dz), voxel);
                }
            }
        }
        Ok(())
    }

    fn read<const N: usize>(&mut self) -> Result<[u8; N], ReadError> {
        let mut bytes = [0; N];
        self.from.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

fn one_deeper(depth: u32) -> Result<u32, ReadError> {
    if depth == DEPTH {
        return Err(ReadError::TooDeep);
    }
    Ok(depth + 1)
}

fn child_of(at: [i32; 3], child: u8) -> [i32; 3] {
    [0, 1, 2].map(|axis| at[axis] << 1 | i32::from(child >> axis & 1))
}
