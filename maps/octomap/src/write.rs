//! Writing `OctoMap` files.
//!
//! All voxels are sorted by the path from the root to them; each node is then one stretch of that list, and the tree need
//! never exist. A node whose eight children are equal leaves becomes a leaf itself.

use std::io::{self, Write};

use maps::voxel::{LogOdds, VoxelKey, VoxelMap};

use crate::{BT_MAGIC, DEPTH, OT_MAGIC};

/// Writes a `.ot` file: all known voxels with their log-odds, equal ones pruned.
pub fn write_ot(map: &VoxelMap, to: impl Write) -> io::Result<()> {
    let mut tree = FullTree::default();
    let leaves = sorted(map, |log_odds| log_odds);
    if !leaves.is_empty() {
        tree.node(&leaves, 0);
    }
    write_file(map, to, OT_MAGIC, tree.nodes, &tree.bytes)
}

/// Writes a `.bt` file: all known voxels, free or occupied, equal ones pruned.
pub fn write_bt(map: &VoxelMap, to: impl Write) -> io::Result<()> {
    let mut tree = BinaryTree::default();
    let leaves = sorted(map, |log_odds| {
        if log_odds.is_occupied() {
            LogOdds::MAX
        } else {
            LogOdds::MIN
        }
    });
    if !leaves.is_empty() {
        tree.root(&leaves);
    }
    write_file(map, to, BT_MAGIC, tree.nodes, &tree.bytes)
}

fn write_file(
    map: &VoxelMap,
    mut to: impl Write,
    magic: &str,
    nodes: usize,
    data: &[u8],
) -> io::Result<()> {
    let resolution_m = map.resolution_m();
    let remark = "# (feel free to add / change comments, but leave the first line as it is!)";
    write!(
        to,
        "{magic}\n{remark}\n#\nid OcTree\nsize {nodes}\nres {resolution_m}\ndata\n"
    )?;
    to.write_all(data)?;
    to.flush()
}

/// A voxel: the path to it, three bits a level, above its log-odds.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Leaf(u64);

impl Leaf {
    fn new(key: VoxelKey, log_odds: LogOdds) -> Self {
        let along = |c: i32| spread(c.wrapping_sub(*VoxelKey::RANGE.start()) as u64);
        let path = along(key.x) | along(key.y) << 1 | along(key.z) << 2;
        Self(path << 8 | u64::from(log_odds.0.cast_unsigned()))
    }

    /// Which child of a node at `depth` it is below.
    fn child(self, depth: u32) -> usize {
        (self.0 >> (8 + 3 * (DEPTH - 1 - depth)) & 7) as usize
    }

    fn log_odds(self) -> LogOdds {
        LogOdds((self.0 as u8).cast_signed())
    }
}

/// The lowest 16 bits, each at three times its place.
fn spread(bits: u64) -> u64 {
    (0..DEPTH).fold(0, |sum, i| sum | (bits >> i & 1) << (3 * i))
}

fn sorted(map: &VoxelMap, as_written: impl Fn(LogOdds) -> LogOdds) -> Vec<Leaf> {
    let mut leaves: Vec<_> = map
        .known()
        .map(|(key, voxel)| Leaf::new(key, as_written(voxel.log_odds)))
        .collect();
    leaves.sort_unstable();
    leaves
}

/// The part of the leaves below each child that has any.
fn children(leaves: &[Leaf], depth: u32) -> impl Iterator<Item = (usize, &[Leaf])> {
    leaves
        .chunk_by(move |a, b| a.child(depth) == b.child(depth))
        .map(move |part| (part[0].child(depth), part))
}

/// The log-odds of all leaves below a node at `depth`, if it is full of equal ones.
fn uniform(leaves: &[Leaf], depth: u32) -> Option<LogOdds> {
    let first = leaves.first()?.log_odds();
    let is_full = leaves.len() as u64 == 1 << (3 * (DEPTH - depth));
    (is_full && leaves.iter().all(|leaf| leaf.log_odds() == first)).then_some(first)
}

#[derive(Default)]
struct FullTree {
    bytes: Vec<u8>,
    nodes: usize,
}

impl FullTree {
    /// Writes the node at `depth` that holds these leaves; gives the greatest log-odds in it.
    fn node(&mut self, leaves: &[Leaf], depth: u32) -> LogOdds {
        self.nodes += 1;
        let start = self.bytes.len();
        if let Some(log_odds) = uniform(leaves, depth) {
            self.bytes.extend(as_octomap(log_odds).to_le_bytes());
            self.bytes.push(0);
            return log_odds;
        }
        // Both are known only after the children.
        self.bytes.extend([0; 5]);
        let mut greatest = LogOdds::MIN;
        for (child, leaves) in children(leaves, depth) {
            self.bytes[start + 4] |= 1 << child;
            greatest = greatest.max(self.node(leaves, depth + 1));
        }
        self.bytes[start..start + 4].copy_from_slice(&as_octomap(greatest).to_le_bytes());
        greatest
    }
}

/// At even odds `OctoMap` says occupied, we say free.
fn as_octomap(log_odds: LogOdds) -> f32 {
    if log_odds.0 == 0 {
        return -1e-6;
    }
    log_odds.value() as f32
}

#[derive(Default)]
struct BinaryTree {
    bytes: Vec<u8>,
    nodes: usize,
}

impl BinaryTree {
    fn root(&mut self, leaves: &[Leaf]) {
        self.nodes += 1;
        self.inner(leaves, 0);
    }

    /// Writes the inner node at `depth` that holds these leaves.
    fn inner(&mut self, leaves: &[Leaf], depth: u32) {
        let mut kinds = 0_u16;
        let start = self.bytes.len();
        self.bytes.extend([0; 2]);
        for (child, leaves) in children(leaves, depth) {
            self.nodes += 1;
            let kind = match uniform(leaves, depth + 1) {
                None => {
                    self.inner(leaves, depth + 1);
                    0b11
                }
                Some(log_odds) if log_odds.is_occupied() => 0b10,
                Some(_) => 0b01,
            };
            kinds |= kind << (2 * child);
        }
        self.bytes[start..start + 2].copy_from_slice(&kinds.to_le_bytes());
    }
}
