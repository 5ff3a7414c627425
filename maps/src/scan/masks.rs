//! Bit masks for the blocks that a scan touches.

use crate::tile::TileId;
use crate::voxel::VoxelKey;
use crate::voxel::block::{Mask, NONE};
use crate::voxel::grid::{Directory, Hashed, OfTile, block_index};

/// One mask for each block that was asked for, found by tile and place. Keeps its memory when it is cleared.
#[derive(Clone, Debug)]
pub(super) struct Masks {
    tiles: Hashed<TileMasks>,
    /// Which tiles this scan has touched; the others wait, empty, for a later one.
    touched: Vec<usize>,
    /// Where the tiles asked for last are, so that rays need not search: a place for each by the lowest bits of its id.
    recent: [Option<(TileId, u32)>; RECENT],
}

const RECENT: usize = 64;

#[derive(Clone, Debug)]
pub(super) struct TileMasks {
    id: TileId,
    directory: Directory,
    places: Vec<u16>,
    masks: Vec<Mask>,
}

impl TileMasks {
    /// The mask of a block, if it was asked for.
    pub(super) fn get(&self, block: u16) -> Option<&Mask> {
        self.directory.get(block).map(|slot| &self.masks[slot])
    }

    /// The blocks that were asked for, in that order.
    pub(super) fn places(&self) -> &[u16] {
        &self.places
    }
}

impl OfTile for TileMasks {
    fn new(id: TileId) -> Self {
        Self {
            id,
            directory: Directory::new(),
            places: Vec::new(),
            masks: Vec::new(),
        }
    }
}

impl Default for Masks {
    fn default() -> Self {
        Self {
            tiles: Hashed::default(),
            touched: Vec::new(),
            recent: [None; RECENT],
        }
    }
}

impl Masks {
    /// The mask of a voxel's block, empty if it is new.
    #[inline]
    pub(super) fn of(&mut self, key: VoxelKey) -> &mut Mask {
        let (tile, block) = (TileId::of(key), block_index(key));
        let recent = (tile.x & 3 | (tile.y & 3) << 2 | (tile.z & 3) << 4) as usize;
        let position = match self.recent[recent] {
            Some((id, position)) if id == tile => position as usize,
            _ => self.enter(tile, recent),
        };
        let tile = self.tiles.at_mut(position);
        let slot = tile.directory.get(block).unwrap_or_else(|| {
            let slot = tile.masks.len();
            tile.places.push(block);
            tile.masks.push(NONE);
            tile.directory.set(block, slot);
            slot
        });
        &mut tile.masks[slot]
    }

    /// The masks of a tile, if any of its blocks was ever asked for.
    pub(super) fn tile(&self, id: TileId) -> Option<&TileMasks> {
        self.tiles.get(id)
    }

    /// The tiles of which blocks were asked for.
    pub(super) fn tiles(&self) -> impl Iterator<Item = TileId> {
        self.touched.iter().map(|at| self.tiles.at(*at).id)
    }

    fn enter(&mut self, tile: TileId, recent: usize) -> usize {
        let position = self.tiles.position(tile);
        if self.tiles.at(position).masks.is_empty() {
            self.touched.push(position);
        }
        self.recent[recent] = Some((tile, position as u32));
        position
    }

    /// Forgets the scan but keeps the memory for the next, unless most of it lies where the sensor no longer is.
    pub(super) fn clear(&mut self) {
        if self.tiles.values().count() > 16 + 2 * self.touched.len() {
            *self = Self::default();
            return;
        }
        for position in self.touched.drain(..) {
            let tile = self.tiles.at_mut(position);
            for block in tile.places.drain(..) {
                tile.directory.clear(block);
            }
            tile.masks.clear();
        }
        self.recent = [None; RECENT];
    }
}
