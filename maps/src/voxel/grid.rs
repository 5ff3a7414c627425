//! Where things are: tiles by hash, blocks by directory within a tile, voxels by index within a block.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use xxhash_rust::xxh3::Xxh3Default;

use super::block::{Block, EDGE, ones};
use super::{Voxel, VoxelKey};
use crate::tile::{Tile, TileId};

/// Blocks in a tile: 16 along each edge.
pub(crate) const BLOCKS: usize = 16 * 16 * 16;
/// The directory's entry for a block that is not there.
const ABSENT: u16 = u16::MAX;

/// The place of a voxel's block in its tile: z above y above x, four bits each.
pub(crate) fn block_index(key: VoxelKey) -> u16 {
    let of = |c: i32| (c >> 3 & 15) as u16;
    of(key.z) << 8 | of(key.y) << 4 | of(key.x)
}

/// The place of a voxel in its block: z above y above x, three bits each.
pub(crate) fn voxel_index(key: VoxelKey) -> usize {
    let of = |c: i32| (c & 7) as usize;
    of(key.z) << 6 | of(key.y) << 3 | of(key.x)
}

/// The voxel of a block with the least coordinates.
pub(crate) fn block_corner(tile: TileId, block: u16) -> VoxelKey {
    let at = |tile: i32, shift: u16| (tile << 4 | i32::from(block >> shift & 15)) << 3;
    VoxelKey::new(at(tile.x, 0), at(tile.y, 4), at(tile.z, 8))
}

/// The voxel `[x, y, z]` further on.
pub(crate) fn offset(key: VoxelKey, by: [u8; 3]) -> VoxelKey {
    let [x, y, z] = by.map(i32::from);
    VoxelKey::new(key.x + x, key.y + y, key.z + z)
}

fn voxel_key(corner: VoxelKey, index: usize) -> VoxelKey {
    let of = |shift: usize| (index >> shift & (EDGE - 1)) as u8;
    offset(corner, [of(0), of(3), of(6)])
}

/// The occupied voxels of a block, in order.
pub(crate) fn occupied(
    tile: TileId,
    at: u16,
    block: &Block,
) -> impl Iterator<Item = (VoxelKey, Voxel)> {
    let corner = block_corner(tile, at);
    ones(block.occupied_mask())
        .filter_map(move |index| Some((voxel_key(corner, index), block.voxel(index)?)))
}

/// The known voxels of a block, in order.
pub(crate) fn known(
    tile: TileId,
    at: u16,
    block: &Block,
) -> impl Iterator<Item = (VoxelKey, Voxel)> {
    let corner = block_corner(tile, at);
    ones(block.known_mask())
        .filter_map(move |index| Some((voxel_key(corner, index), block.voxel(index)?)))
}

/// A hash of where a tile is and of everything known in it, version left out.
pub(crate) fn digest<'a>(
    id: TileId,
    resolution_m: f64,
    blocks: impl Iterator<Item = (u16, &'a Block)>,
) -> u64 {
    let mut hash = Xxh3Default::new();
    hash.update(&resolution_m.to_bits().to_le_bytes());
    for c in [id.x, id.y, id.z] {
        hash.update(&c.to_le_bytes());
    }
    for (at, block) in blocks.filter(|(_, block)| !block.is_unknown()) {
        hash.update(&at.to_le_bytes());
        block.hash_into(&mut hash);
    }
    hash.digest()
}

/// What belongs to one tile of a [`Hashed`].
pub(crate) trait OfTile {
    fn new(id: TileId) -> Self;
}

/// Things found by their tile: a hash table of indices into a list, whose order never shows.
#[derive(Clone, Debug)]
pub(crate) struct Hashed<T> {
    index: HashMap<TileId, u32, BuildHasherDefault<TileHasher>>,
    values: Vec<T>,
    bounds: Option<[TileId; 2]>,
}

impl<T> Default for Hashed<T> {
    fn default() -> Self {
        Self {
            index: HashMap::default(),
            values: Vec::new(),
            bounds: None,
        }
    }
}

impl Hashed<TileNode> {
    /// Takes out what belongs to a tile.
    pub(crate) fn remove(&mut self, id: TileId) -> Option<TileNode> {
        let at = self.index.remove(&id)?;
        let node = self.values.swap_remove(at as usize);
        if let Some(moved) = self.values.get(at as usize) {
            self.index.insert(moved.id, at);
        }
        let ids = self.values.iter().map(|node| node.id);
        self.bounds = ids.fold(None, |bounds, id| Some(grown(bounds, id)));
        Some(node)
    }
}

impl<T: OfTile> Hashed<T> {
    pub(crate) fn get(&self, id: TileId) -> Option<&T> {
        self.index.get(&id).map(|&at| &self.values[at as usize])
    }

    pub(crate) fn position(&mut self, id: TileId) -> usize {
        let next = self.values.len();
        let at = *self.index.entry(id).or_insert(next as u32) as usize;
        if at == next {
            self.values.push(T::new(id));
            self.bounds = Some(grown(self.bounds, id));
        }
        at
    }

    /// The least and the greatest coordinates of all that is here.
    pub(crate) fn bounds(&self) -> Option<[TileId; 2]> {
        self.bounds
    }

    /// Those of these tiles, new ones where there are none yet; in no particular order.
    pub(crate) fn many_mut(&mut self, ids: &[TileId]) -> Vec<&mut T> {
        let mut positions: Vec<_> = ids.iter().map(|id| self.position(*id)).collect();
        positions.sort_unstable();
        let mut wanted = positions.into_iter().peekable();
        self.values
            .iter_mut()
            .enumerate()
            .filter(|(at, _)| wanted.next_if_eq(at).is_some())
            .map(|(_, value)| value)
            .collect()
    }

    pub(crate) fn get_or_insert(&mut self, id: TileId) -> &mut T {
        let at = self.position(id);
        &mut self.values[at]
    }

    pub(crate) fn at(&self, position: usize) -> &T {
        &self.values[position]
    }

    pub(crate) fn at_mut(&mut self, position: usize) -> &mut T {
        &mut self.values[position]
    }

    pub(crate) fn values(&self) -> impl Iterator<Item = &T> {
        self.values.iter()
    }

    pub(crate) fn values_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.values.iter_mut()
    }
}

/// Bounds that hold one tile more.
fn grown(bounds: Option<[TileId; 2]>, id: TileId) -> [TileId; 2] {
    let [low, high] = bounds.unwrap_or([id, id]);
    let of = |pick: fn(i32, i32) -> i32, a: TileId| TileId {
        x: pick(a.x, id.x),
        y: pick(a.y, id.y),
        z: pick(a.z, id.z),
    };
    [of(i32::min, low), of(i32::max, high)]
}

/// A multiplicative hash of three small integers: the table is asked for each tile a ray enters.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TileHasher(u64);

impl Hasher for TileHasher {
    fn finish(&self) -> u64 {
        self.0 ^ self.0 >> 32
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_i32(i32::from(byte));
        }
    }

    fn write_i32(&mut self, value: i32) {
        self.0 = (self.0.rotate_left(21) ^ u64::from(value.cast_unsigned()))
            .wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
}

/// Which of a tile's 16³ blocks exist, and where in a list.
#[derive(Clone, Debug)]
pub(crate) struct Directory(Box<[u16; BLOCKS]>);

impl Directory {
    pub(crate) fn new() -> Self {
        Self(Box::new([ABSENT; BLOCKS]))
    }

    pub(crate) fn get(&self, block: u16) -> Option<usize> {
        let slot = self.0[usize::from(block)];
        (slot != ABSENT).then_some(usize::from(slot))
    }

    pub(crate) fn set(&mut self, block: u16, slot: usize) {
        self.0[usize::from(block)] = slot as u16;
    }

    pub(crate) fn clear(&mut self, block: u16) {
        self.0[usize::from(block)] = ABSENT;
    }

    /// The blocks that exist, ascending, with their places in the list.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u16, usize)> {
        (0..)
            .zip(self.0.iter())
            .filter_map(|(block, &slot)| (slot != ABSENT).then_some((block, usize::from(slot))))
    }
}

/// What the map knows of one tile.
#[derive(Clone, Debug)]
pub(crate) struct TileNode {
    pub(crate) id: TileId,
    pub(crate) version: u64,
    /// Since the map was last asked what changed.
    pub(crate) changed: bool,
    /// Since the last version.
    dirty: bool,
    directory: Directory,
    blocks: Vec<Block>,
    /// A bit for each block, by its place: whether a voxel in it is occupied. Rays skip the others.
    occupied: Box<[u64; BLOCKS / 64]>,
}

impl OfTile for TileNode {
    fn new(id: TileId) -> Self {
        Self {
            id,
            version: 0,
            changed: false,
            dirty: false,
            directory: Directory::new(),
            blocks: Vec::new(),
            occupied: Box::new([0; BLOCKS / 64]),
        }
    }
}

impl TileNode {
    /// Its blocks, by their place in the tile.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = (u16, &Block)> {
        self.directory
            .iter()
            .map(|(at, slot)| (at, &self.blocks[slot]))
    }

    pub(crate) fn block(&self, at: u16) -> Option<&Block> {
        self.directory.get(at).map(|slot| &self.blocks[slot])
    }

    /// Whether a voxel of this block is occupied.
    pub(crate) fn has_occupied(&self, at: u16) -> bool {
        self.occupied[usize::from(at >> 6)] >> (at & 63) & 1 == 1
    }

    /// Whether any voxel of the tile is.
    pub(crate) fn is_any_occupied(&self) -> bool {
        self.occupied.iter().any(|word| *word != 0)
    }

    /// Changes a block, which says whether its content changed, and notes that for the next version.
    pub(crate) fn edit(&mut self, at: u16, change: impl FnOnce(&mut Block) -> bool) {
        let slot = self.slot(at);
        let block = &mut self.blocks[slot];
        self.dirty |= change(block);
        let bit = 1 << (at & 63);
        let word = &mut self.occupied[usize::from(at >> 6)];
        if block.is_any_occupied() {
            *word |= bit;
        } else {
            *word &= !bit;
        }
    }

    /// Makes place for so many new blocks at once.
    pub(crate) fn reserve(&mut self, new: usize) {
        if self.blocks.capacity() - self.blocks.len() < new {
            // Doubling would waste a third of the memory of a map.
            let some = 8 + self.blocks.len() / 8;
            self.blocks.reserve_exact(new.max(some));
        }
    }

    fn slot(&mut self, at: u16) -> usize {
        self.directory.get(at).unwrap_or_else(|| {
            let slot = self.blocks.len();
            self.reserve(1);
            self.blocks.push(Block::UNKNOWN);
            self.directory.set(at, slot);
            slot
        })
    }

    /// Makes all that was noted one new version.
    pub(crate) fn commit(&mut self) {
        if std::mem::take(&mut self.dirty) {
            self.changed = true;
            self.version = self.version.saturating_add(1);
        }
    }

    /// Takes over what `tile` knows, and its version.
    pub(crate) fn replace(&mut self, tile: &Tile) {
        let known = self.blocks().filter(|(_, block)| !block.is_unknown());
        let same = known.eq(tile.blocks.iter().map(|(at, block)| (*at, block)));
        self.version = tile.version;
        if same {
            return;
        }
        self.changed = true;
        self.directory = Directory::new();
        self.blocks = Vec::with_capacity(tile.blocks.len());
        *self.occupied = [0; BLOCKS / 64];
        for (at, block) in &tile.blocks {
            self.edit(*at, |place| {
                *place = block.clone();
                false
            });
        }
    }
}
