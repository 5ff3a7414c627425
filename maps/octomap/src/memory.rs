//! How much memory a map will take, before it takes it.

use maps::tile::TileId;
use maps::voxel::VoxelKey;

/// More than a map takes for a tile of its own, its directory of blocks above all.
const TILE_BYTES: u64 = 16 * 1024;
/// More than a map takes for a block of 8³ voxels, colours and spare room included.
const BLOCK_BYTES: u64 = 2 * 1024;
/// Levels from a voxel up to its block and to its tile.
const BLOCK_LEVELS: u32 = 3;
const TILE_LEVELS: u32 = 7;

/// Adds up tiles and blocks of cubes that come in the order of the tree: those of one block, and of one tile, come in a row.
#[derive(Default)]
pub(crate) struct Memory {
    bytes: u64,
    tile: Option<TileId>,
    block: Option<[i32; 3]>,
}

impl Memory {
    /// Adds the cube that spans this many levels, with its least voxel; all memory up to now.
    pub(crate) fn add(&mut self, low: VoxelKey, levels: u32) -> u64 {
        let tile = Some(TileId::of(low));
        let block = Some([low.x, low.y, low.z].map(|c| c >> BLOCK_LEVELS));
        if self.tile != tile {
            self.bytes += TILE_BYTES * cubes(levels.saturating_sub(TILE_LEVELS));
        }
        if self.block != block {
            self.bytes += BLOCK_BYTES * cubes(levels.saturating_sub(BLOCK_LEVELS));
        }
        (self.tile, self.block) = (tile, block);
        self.bytes
    }

    /// By how many levels a cube of so many is too much for so much memory; at least 1.
    pub(crate) fn levels_too_many(levels: u32, most_bytes: u64) -> u32 {
        let bytes = |levels| Self::default().add(VoxelKey::new(0, 0, 0), levels);
        let fits = (1..levels).find(|less| bytes(levels - less) <= most_bytes);
        fits.unwrap_or(levels).max(1)
    }
}

/// How many cubes are in one so many levels above.
fn cubes(levels: u32) -> u64 {
    1 << (3 * levels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_counts_once_and_a_tile_counts_once() {
        let mut used = Memory::default();
        let first = used.add(VoxelKey::new(0, 0, 0), 0);
        assert_eq!(first, TILE_BYTES + BLOCK_BYTES);
        assert_eq!(used.add(VoxelKey::new(7, 7, 7), 0), first);
        assert_eq!(used.add(VoxelKey::new(8, 0, 0), 3), first + BLOCK_BYTES);
        assert_eq!(
            used.add(VoxelKey::new(128, 0, 0), 0),
            2 * first + BLOCK_BYTES
        );
    }

    #[test]
    fn a_leaf_high_in_the_tree_counts_as_all_that_it_stands_for() {
        let tiles = 8;
        let blocks = tiles * 16 * 16 * 16;
        assert_eq!(
            Memory::default().add(VoxelKey::new(0, 0, 0), 8),
            tiles * TILE_BYTES + blocks * BLOCK_BYTES
        );
    }
}
