//! Tiles: cubes of 128³ voxels of a map, which travel, are stored and are compared on their own.
//!
//! A tile carries a version that its sender counts up with every change, so that a receiver keeps the newest whatever the
//! order of arrival. [`Tile::encode`] compresses it for thin links.

mod codec;
mod model;
mod range_coder;

use std::fmt;

use crate::voxel::block::Block;
use crate::voxel::{Seen, Voxel, VoxelKey, grid};

/// Which tile: the key of any of its voxels, shifted right by 7 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TileId {
    /// Towards east.
    pub x: i32,
    /// Towards north.
    pub y: i32,
    /// Up.
    pub z: i32,
}

impl TileId {
    /// Voxels along each edge of a tile.
    pub const EDGE: i32 = 128;

    /// The tile that holds a voxel.
    pub const fn of(key: VoxelKey) -> Self {
        Self {
            x: key.x >> 7,
            y: key.y >> 7,
            z: key.z >> 7,
        }
    }

    /// The voxel of the tile with the least coordinates.
    pub const fn corner(self) -> VoxelKey {
        VoxelKey::new(self.x << 7, self.y << 7, self.z << 7)
    }

    /// Whether a map can hold it.
    pub fn is_in_world(self) -> bool {
        let range = VoxelKey::RANGE.start() >> 7..=VoxelKey::RANGE.end() >> 7;
        [self.x, self.y, self.z].iter().all(|c| range.contains(c))
    }
}

/// `x/y/z`.
impl fmt::Display for TileId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}", self.x, self.y, self.z)
    }
}

/// Why a tile was refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TileError {
    /// Something else.
    #[error("not a tile: it does not begin with TDTL")]
    NotATile,
    /// Cut off.
    #[error("the tile ends within its header")]
    TooShort,
    /// Written by a newer program.
    #[error("the tile has format {found}, this program reads format {newest}")]
    OtherFormat {
        /// The tile's.
        found: u8,
        /// The newest that is understood.
        newest: u8,
    },
    /// Written by a newer program.
    #[error("the tile is compressed by codec {found}, this program knows codec {newest}")]
    OtherCodec {
        /// The tile's.
        found: u8,
        /// The newest that is understood.
        newest: u8,
    },
    /// Bits have changed on the way.
    #[error("the tile is damaged: checksum {computed:08x}, header says {stored:08x}")]
    Damaged {
        /// What the header says.
        stored: u32,
        /// What the bytes give.
        computed: u32,
    },
    /// The checksum is right but the payload is none that an encoder writes.
    #[error("the payload of tile {0} makes no sense")]
    Malformed(TileId),
    /// No map can have it.
    #[error("tile {id} has voxels of {tile_m} m, a map has 0.001 m to 100 m")]
    BadResolution {
        /// The tile.
        id: TileId,
        /// Its resolution.
        tile_m: f64,
    },
    /// No map reaches that far.
    #[error("tile {0} is outside of the world")]
    OutsideWorld(TileId),
    /// The tile and the map have voxels of different size.
    #[error("tile {id} has voxels of {tile_m} m, the map has {map_m} m")]
    OtherResolution {
        /// The tile.
        id: TileId,
        /// Its resolution.
        tile_m: f64,
        /// The resolution of the map.
        map_m: f64,
    },
}

/// What a map knows of one cube of 128³ voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Where it is.
    pub id: TileId,
    /// Counted up by the sender with every change.
    pub version: u64,
    /// The edge of a voxel.
    pub resolution_m: f64,
    /// The blocks in which something is known, by their place in the tile, ascending.
    pub(crate) blocks: Vec<(u16, Block)>,
}

impl Tile {
    /// A tile of which nothing is known.
    pub fn unknown(id: TileId, version: u64, resolution_m: f64) -> Self {
        Self {
            id,
            version,
            resolution_m,
            blocks: Vec::new(),
        }
    }

    /// What is known of a voxel; `None` also if it is in another tile.
    pub fn voxel(&self, key: VoxelKey) -> Option<Voxel> {
        self.block_of(key)?.voxel(grid::voxel_index(key))
    }

    /// When and by whom a voxel was seen, as [`crate::voxel::VoxelMap::seen`]; not told by tiles that were decoded.
    pub fn seen(&self, key: VoxelKey) -> Option<Seen> {
        self.block_of(key)?.seen(grid::voxel_index(key))
    }

    fn block_of(&self, key: VoxelKey) -> Option<&Block> {
        if TileId::of(key) != self.id {
            return None;
        }
        let at = grid::block_index(key);
        let place = self.blocks.binary_search_by_key(&at, |(at, _)| *at).ok()?;
        Some(&self.blocks[place].1)
    }

    /// Its occupied voxels, ordered by block and place in the block.
    pub fn occupied(&self) -> impl Iterator<Item = (VoxelKey, Voxel)> {
        self.blocks
            .iter()
            .flat_map(|(at, block)| grid::occupied(self.id, *at, block))
    }

    /// Its free and occupied voxels, ordered by block and place in the block.
    pub fn known(&self) -> impl Iterator<Item = (VoxelKey, Voxel)> {
        self.blocks
            .iter()
            .flat_map(|(at, block)| grid::known(self.id, *at, block))
    }

    /// How many of its voxels are occupied.
    pub fn occupied_count(&self) -> usize {
        self.blocks.iter().map(|(_, b)| b.occupied_count()).sum()
    }

    /// How many of its voxels are free or occupied.
    pub fn known_count(&self) -> usize {
        self.blocks.iter().map(|(_, b)| b.known_count()).sum()
    }

    /// A hash of its place, resolution and content, but not of its version: two maps that know the same of a tile agree,
    /// whatever way they took.
    pub fn digest(&self) -> u64 {
        let blocks = self.blocks.iter().map(|(at, block)| (*at, block));
        grid::digest(self.id, self.resolution_m, blocks)
    }
}
