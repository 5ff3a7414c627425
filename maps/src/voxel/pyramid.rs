//! The map at coarser resolutions: what is known of cubes of 2ᵏ voxels along each edge, counted from the bit masks.
//!
//! No coarser copy of the map is kept: a cube within a block takes eight words, a tile its 4096 blocks.

use std::collections::BTreeSet;

use super::block::{Mask, NONE, ones};
use super::grid::{TileNode, block_corner, block_index, offset, voxel_index};
use super::{Occupancy, VoxelKey, VoxelMap};
use crate::tile::TileId;

/// What is known of the voxels in a cube.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cube {
    /// How many voxels it has.
    pub volume: u64,
    /// How many of them are free or occupied.
    pub known: u64,
    /// How many of them are occupied.
    pub occupied: u64,
}

impl Cube {
    /// The careful answer for the whole: occupied if anything in it is, free only if all of it is.
    pub fn occupancy(self) -> Occupancy {
        if self.occupied > 0 {
            Occupancy::Occupied
        } else if self.known == self.volume {
            Occupancy::Free
        } else {
            Occupancy::Unknown
        }
    }
}

impl VoxelMap {
    /// The coarsest level there is: the world is eight such cubes.
    pub const COARSEST: u32 = 15;

    /// What is known of the cube of `2^level` voxels along each edge that holds a voxel; levels above [`Self::COARSEST`]
    /// count as that. Takes a few steps up to level 3, up to 4096 within a tile (level 7), and as many for each tile above.
    pub fn cube(&self, key: VoxelKey, level: u32) -> Cube {
        let level = level.min(Self::COARSEST);
        let mut cube = Cube {
            volume: 1 << (3 * level),
            ..Cube::default()
        };
        if level <= 7 {
            if let Some(tile) = self.tiles().get(TileId::of(key)) {
                count_in_tile(&mut cube, tile, key, level);
            }
            return cube;
        }
        let coarse = |id: TileId| [id.x, id.y, id.z].map(|c| c >> (level - 7));
        let wanted = coarse(TileId::of(key));
        for tile in self.tiles().values().filter(|t| coarse(t.id) == wanted) {
            count_in_tile(&mut cube, tile, tile.id.corner(), 7);
        }
        cube
    }

    /// The voxel with the least coordinates of each cube of `2^level` voxels along each edge in which anything is occupied,
    /// sorted.
    pub fn occupied_cubes(&self, level: u32) -> BTreeSet<VoxelKey> {
        let level = level.min(Self::COARSEST);
        let corner = |key: VoxelKey| {
            let [x, y, z] = [key.x, key.y, key.z].map(|c| c >> level << level);
            VoxelKey { x, y, z }
        };
        let mut cubes = BTreeSet::new();
        for tile in self.tiles().values() {
            for (at, block) in tile.blocks().filter(|(_, b)| b.is_any_occupied()) {
                let first = block_corner(tile.id, at);
                if level >= 3 {
                    cubes.insert(corner(first));
                    continue;
                }
                cubes.extend(ones(block.occupied_mask()).map(|index| {
                    let of = |shift: usize| (index >> shift & 7) as u8;
                    corner(offset(first, [of(0), of(3), of(6)]))
                }));
            }
        }
        cubes
    }
}

/// Counts what is known of a cube that is within one tile.
fn count_in_tile(cube: &mut Cube, tile: &TileNode, key: VoxelKey, level: u32) {
    let mut count = |at: u16, within: &Mask| {
        if let Some(block) = tile.block(at) {
            let both = |mask: &Mask| -> u64 {
                let words = mask.iter().zip(within);
                words.map(|(a, b)| u64::from((a & b).count_ones())).sum()
            };
            cube.known += both(block.known_mask());
            cube.occupied += both(block.occupied_mask());
        }
    };
    if level <= 3 {
        count(block_index(key), &cube_in_block(voxel_index(key), level));
        return;
    }
    let edge = 1_u16 << (level - 3);
    let first = block_index(key);
    let [x, y, z] = [0, 4, 8].map(|shift| (first >> shift & 15) / edge * edge);
    for z in z..z + edge {
        for y in y..y + edge {
            for x in x..x + edge {
                count(z << 8 | y << 4 | x, &[u64::MAX; 8]);
            }
        }
    }
}

/// The voxels of the cube, at most a block, that holds a voxel of a block.
fn cube_in_block(index: usize, level: u32) -> Mask {
    let edge = 1 << level;
    let [x, y, z] = [0, 3, 6].map(|shift| (index >> shift & 7) >> level << level);
    let row = ((1_u64 << edge) - 1) << x;
    let slice = (y..y + edge).fold(0, |slice, y| slice | row << (8 * y));
    let mut mask = NONE;
    mask[z..z + edge].fill(slice);
    mask
}
