//! Writing `OctoMap` files.
//!
//! A tile is a node of the tree, at depth 9. Tiles are sorted by the path from the root to them, and the voxels of each
//! likewise; a node is then one stretch of a list, and the tree need never exist, nor more than one tile's list at a
//! time. A node whose eight children turn out equal leaves takes their bytes back and becomes a leaf itself.

mod node;

use std::io::{self, Write};

use maps::tile::TileId;
use maps::voxel::{VoxelKey, VoxelMap};

use crate::DEPTH;
use crate::header::{BT_MAGIC, OT_MAGIC, TreeType};
use node::{Kind, Nodes, Said};

/// The shape of the tree that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Whether equal leaves are merged.
    pub pruning: Pruning,
    /// Levels to cut off at the bottom, at most 15: the least leaf is then 2 to this power voxels wide, as occupied as the
    /// most occupied voxel in it, and of their average colour or most frequent class. The resolution in the header
    /// stays, as it does where `OctoMap` prunes: readers that know nothing of the cut see larger cubes.
    pub cut_levels: u32,
}

impl Default for Shape {
    fn default() -> Self {
        Self {
            pruning: Pruning::EqualLeaves,
            cut_levels: 0,
        }
    }
}

/// What becomes of eight equal leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pruning {
    /// They become one, above them. Leaves are equal if nothing that is written tells them apart, so that nothing is lost;
    /// `OctoMap` itself also merges leaves of different colours.
    EqualLeaves,
    /// They stay: every leaf is a voxel, or what [`Shape::cut_levels`] makes of some.
    Nothing,
}

/// What a `.ot` file tells of a voxel beside its log-odds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Nothing: an `OcTree`.
    Occupancy,
    /// The colour that a camera saw: a `ColorOcTree`. Pure white means to `OctoMap` that there is no colour, so that is
    /// written a shade darker.
    Color,
    /// Its class as the colour of [`maps::palette`]: a `ColorOcTree` too, which any viewer shows and
    /// [`crate::Colors::Classes`] takes back. An inner node has the colour of the most frequent among its children.
    Class,
}

/// Writes a `.ot` file: all known voxels with their log-odds, equal ones pruned, without colours.
pub fn write_ot(map: &VoxelMap, to: impl Write) -> io::Result<()> {
    write_ot_as(map, Content::Occupancy, Shape::default(), to)
}

/// Writes a `.bt` file: all known voxels, free or occupied, equal ones pruned.
pub fn write_bt(map: &VoxelMap, to: impl Write) -> io::Result<()> {
    write_bt_as(map, Shape::default(), to)
}

/// Writes a `.ot` file of some content and shape.
pub fn write_ot_as(
    map: &VoxelMap,
    content: Content,
    shape: Shape,
    to: impl Write,
) -> io::Result<()> {
    let kind = match content {
        Content::Occupancy => Kind::Full,
        Content::Color => Kind::Colored,
        Content::Class => Kind::Classified,
    };
    write_file(map, Nodes::new(kind, shape), to)
}

/// Writes a `.bt` file of some shape.
pub fn write_bt_as(map: &VoxelMap, shape: Shape, to: impl Write) -> io::Result<()> {
    write_file(map, Nodes::new(Kind::Binary, shape), to)
}

fn write_file(map: &VoxelMap, mut nodes: Nodes, mut to: impl Write) -> io::Result<()> {
    let mut tiles: Vec<_> = map
        .tile_ids()
        .into_iter()
        .map(|id| TileBelow { id, map })
        .collect();
    tiles.sort_unstable_by_key(Below::path);
    if !tiles.is_empty() {
        write_node(&mut nodes, &tiles, 0);
    }
    let (magic, tree) = match nodes.kind {
        Kind::Full => (OT_MAGIC, TreeType::Plain),
        Kind::Colored | Kind::Classified => (OT_MAGIC, TreeType::Color),
        Kind::Binary => (BT_MAGIC, TreeType::Plain),
    };
    let (size, resolution_m) = (nodes.count, map.resolution_m());
    let remark = "# (feel free to add / change comments, but leave the first line as it is!)";
    write!(
        to,
        "{magic}\n{remark}\n#\nid {tree}\nsize {size}\nres {resolution_m}\ndata\n"
    )?;
    to.write_all(&nodes.bytes)?;
    to.flush()
}

/// Writes the node at `depth` above these, which are sorted by path and not none.
fn write_node<T: Below>(nodes: &mut Nodes, below: &[T], depth: u32) -> Said {
    if depth == T::DEPTH {
        return below[0].write(nodes);
    }
    let node = nodes.open(depth);
    let child = |item: &T| (item.path() >> (3 * (T::DEPTH - 1 - depth)) & 7) as usize;
    let mut children = [None; 8];
    for part in below.chunk_by(|a, b| child(a) == child(b)) {
        children[child(&part[0])] = Some(write_node(nodes, part, depth + 1));
    }
    nodes.close(&node, &children)
}

/// What hangs in the tree.
trait Below {
    /// How deep.
    const DEPTH: u32;

    /// The path to it: three bits a level, the lowest for the last step. It may begin anywhere above.
    fn path(&self) -> u64;

    /// Writes its node.
    fn write(&self, nodes: &mut Nodes) -> Said;
}

struct TileBelow<'a> {
    id: TileId,
    map: &'a VoxelMap,
}

impl Below for TileBelow<'_> {
    const DEPTH: u32 = DEPTH - TileId::EDGE.trailing_zeros();

    fn path(&self) -> u64 {
        path([self.id.x, self.id.y, self.id.z], Self::DEPTH)
    }

    fn write(&self, nodes: &mut Nodes) -> Said {
        let tile = self.map.tile(self.id);
        let mut voxels: Vec<_> = tile
            .iter()
            .flat_map(maps::tile::Tile::known)
            .map(|(key, voxel)| VoxelBelow::new(key, nodes.kind.said_of(voxel)))
            .collect();
        voxels.sort_unstable_by_key(Below::path);
        write_node(nodes, &voxels, Self::DEPTH)
    }
}

struct VoxelBelow {
    /// From its tile.
    path: u32,
    said: Said,
}

impl VoxelBelow {
    fn new(key: VoxelKey, said: Said) -> Self {
        let levels = DEPTH - TileBelow::DEPTH;
        let within = [key.x, key.y, key.z].map(|c| c & (TileId::EDGE - 1));
        Self {
            path: spread(within, levels) as u32,
            said,
        }
    }
}

impl Below for VoxelBelow {
    const DEPTH: u32 = DEPTH;

    fn path(&self) -> u64 {
        self.path.into()
    }

    fn write(&self, nodes: &mut Nodes) -> Said {
        nodes.leaf(self.said)
    }
}

/// The path to a node at `depth` with these coordinates, which are counted from the middle of the world.
fn path(at: [i32; 3], depth: u32) -> u64 {
    spread(at.map(|c| c + (1 << (depth - 1))), depth)
}

/// So many of the lowest bits of x, y and z, in turn.
fn spread([x, y, z]: [i32; 3], bits: u32) -> u64 {
    (0..bits).fold(0, |sum, i| {
        let bit = |c: i32| u64::from((c >> i & 1).cast_unsigned());
        sum | (bit(x) | bit(y) << 1 | bit(z) << 2) << (3 * i)
    })
}
