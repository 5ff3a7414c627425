//! The voxel map: what is known of the world, free and occupied, in cubes of one resolution.
//!
//! Each known voxel holds the log-odds of being occupied, updated by `OctoMap`'s inverse sensor model:
//!
//! ```text
//! l ← clamp(l + Δ, -2.0, 3.5)        Δ = log(0.7 / 0.3) = 0.85 if a ray ended in it, log(0.4 / 0.6) = -0.4 if one passed
//! ```
//!
//! All five numbers are multiples of 0.05, so log-odds are integers in steps of 0.05 ([`LogOdds`]), and tiles and files
//! hold them exactly.
//!
//! An occupied voxel has a surface, and the surface a colour, a class and a memory of when it was last seen and by whom
//! ([`Seen`]). Free space remembers that too, but only for each slice of 8 × 8 × 1 voxels: the last time any free voxel of
//! the slice was seen, and by which sources. Times are kept in steps of 1/32 s.
//!
//! Log-odds, colour and class are *content*: they make equal maps, digests and tile versions. When and by whom a voxel was
//! seen is not: looking at the same thing again changes no tile, and nothing need be sent.
//!
//! Voxels live in blocks of 8³ with one bit a voxel for *known* and *occupied*; blocks hang in tiles of 16³ blocks; tiles
//! are found by hashing. Nothing iterates in hash order: every sequence the map gives out is ordered by tile, block, voxel.
//! A block takes 0.7 kB, and ten bytes more for each occupied voxel.
//!
//! The world is bounded to 2¹⁶ voxels along each axis, centred on the origin: the very space of an `OctoMap` file.
//!
//! ```
//! use maps::frame::Point;
//! use maps::scan::Scan;
//! use maps::tile::Tile;
//! use maps::voxel::{Occupancy, VoxelMap};
//!
//! let mut map = VoxelMap::new(0.1);
//! let wall = [Point::new(2.0, 0.3, 1.0)];
//! map.insert_scan(&Scan { max_range_m: 30.0, ..Scan::new(Point::new(0.0, 0.0, 1.5), &wall) });
//! assert_eq!(map.occupancy(map.key_of(wall[0])), Occupancy::Occupied);
//!
//! // What changed travels as tiles to another map, which then is the same.
//! let mut copy = VoxelMap::new(0.1);
//! for id in map.take_changed_tiles() {
//!     let bytes = map.tile(id).expect("it changed").encode();
//!     copy.set_tile(&Tile::decode(&bytes)?)?;
//! }
//! assert_eq!(copy.digest(), map.digest());
//! # Ok::<(), maps::tile::TileError>(())
//! ```
//!
//! - A. Hornung et al., *`OctoMap`: an efficient probabilistic 3D mapping framework based on octrees*, Autonomous Robots
//!   34, 2013, Eq. (2)–(4).
//! - M. Nießner et al., *Real-time 3D reconstruction at scale using voxel hashing*, ACM TOG 32(6), 2013.

pub(crate) mod block;
mod cast;
mod evict;
pub(crate) mod grid;
mod pyramid;
pub(crate) mod surface;
mod value;

use std::collections::BTreeMap;
use std::fmt;
use std::ops::RangeInclusive;

use xxhash_rust::xxh3::Xxh3Default;

use crate::frame::{Point, World};
use crate::scan::Scratch;
use crate::tile::{Tile, TileError, TileId};
pub use cast::RayHit;
pub use evict::RestoreError;
use grid::{Hashed, TileNode};
pub use pyramid::Cube;
pub use value::{ClassId, LogOdds, Occupancy, Rgb, Seen, Sources, Voxel, VoxelKey};

/// A hash of the content, which is where something is known, its log-odds, colours and classes: contents are equal if and
/// only if (but for one chance in 2⁶⁴) their digests are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MapDigest(pub u64);

/// Sixteen hexadecimal digits.
impl fmt::Display for MapDigest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

/// What is known of the world. See the [module](self).
#[derive(Clone, Debug)]
pub struct VoxelMap {
    resolution_m: f64,
    tiles: Hashed<TileNode>,
    /// The tiles that were handed out, with their versions: what is here of them is not all.
    away: BTreeMap<TileId, u64>,
    /// Kept between scans for its memory only.
    pub(crate) scratch: Scratch,
}

impl VoxelMap {
    /// The resolutions a map may have, in metres.
    pub const RESOLUTION_M: RangeInclusive<f64> = 0.001..=100.0;

    /// An empty map of voxels with this edge.
    ///
    /// # Panics
    ///
    /// Unless the resolution is within [`Self::RESOLUTION_M`]; check input from outside against it.
    pub fn new(resolution_m: f64) -> Self {
        assert!(
            Self::RESOLUTION_M.contains(&resolution_m),
            "a voxel of {resolution_m} m"
        );
        Self {
            resolution_m,
            tiles: Hashed::default(),
            away: BTreeMap::new(),
            scratch: Scratch::default(),
        }
    }

    /// The edge of a voxel.
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// The voxel that holds `p`. Far outside of the world it saturates; a NaN counts as 0.
    pub fn key_of(&self, p: Point<World>) -> VoxelKey {
        key_at(p, 1.0 / self.resolution_m)
    }

    /// The centre of a voxel.
    pub fn center_of(&self, key: VoxelKey) -> Point<World> {
        let [x, y, z] = [key.x, key.y, key.z].map(|c| (f64::from(c) + 0.5) * self.resolution_m);
        Point::new(x, y, z)
    }

    /// What is known of a voxel.
    pub fn voxel(&self, key: VoxelKey) -> Option<Voxel> {
        let block = self
            .tiles
            .get(TileId::of(key))?
            .block(grid::block_index(key))?;
        block.voxel(grid::voxel_index(key))
    }

    /// Whether a voxel is unknown, free or occupied.
    pub fn occupancy(&self, key: VoxelKey) -> Occupancy {
        self.tiles
            .get(TileId::of(key))
            .and_then(|tile| tile.block(grid::block_index(key)))
            .map_or(Occupancy::Unknown, |block| {
                block.occupancy(grid::voxel_index(key))
            })
    }

    /// When a voxel was last seen, and by whom; `None` if it is unknown. Of a free voxel, the answer is that of its slice.
    pub fn seen(&self, key: VoxelKey) -> Option<Seen> {
        self.tiles
            .get(TileId::of(key))?
            .block(grid::block_index(key))?
            .seen(grid::voxel_index(key))
    }

    /// Overwrites one voxel, its log-odds clamped; a free voxel keeps no colour and no class. When it was seen stays as it
    /// was. Does nothing outside of the world.
    pub fn set_voxel(&mut self, key: VoxelKey, voxel: Voxel) {
        if !key.is_in_world() {
            return;
        }
        let tile = self.tiles.get_or_insert(TileId::of(key));
        tile.edit(grid::block_index(key), |block| {
            block.set(grid::voxel_index(key), voxel)
        });
        tile.commit();
    }

    /// Every occupied voxel, ordered by tile, block and place in the block.
    pub fn occupied(&self) -> impl Iterator<Item = (VoxelKey, Voxel)> {
        self.sorted_tiles().into_iter().flat_map(|tile| {
            tile.blocks()
                .flat_map(|(at, block)| grid::occupied(tile.id, at, block))
        })
    }

    /// Every free and every occupied voxel, ordered by tile, block and place in the block.
    pub fn known(&self) -> impl Iterator<Item = (VoxelKey, Voxel)> {
        self.sorted_tiles().into_iter().flat_map(|tile| {
            tile.blocks()
                .flat_map(|(at, block)| grid::known(tile.id, at, block))
        })
    }

    /// How many voxels are occupied.
    pub fn occupied_count(&self) -> usize {
        self.all_blocks()
            .map(|(_, _, block)| block.occupied_count())
            .sum()
    }

    /// How many voxels are free or occupied.
    pub fn known_count(&self) -> usize {
        self.all_blocks()
            .map(|(_, _, block)| block.known_count())
            .sum()
    }

    /// The least and the greatest coordinates of the known voxels, both inclusive.
    pub fn bounds(&self) -> Option<(VoxelKey, VoxelKey)> {
        self.all_blocks()
            .filter_map(|(tile, at, block)| {
                let corner = grid::block_corner(tile, at);
                let (low, high) = block.bounds()?;
                Some((grid::offset(corner, low), grid::offset(corner, high)))
            })
            .reduce(|(low, high), (l, h)| (least(low, l), greatest(high, h)))
    }

    /// The tiles in which something is known and none of which is away, sorted.
    pub fn tile_ids(&self) -> Vec<TileId> {
        self.sorted_tiles()
            .into_iter()
            .map(|tile| tile.id)
            .filter(|id| !self.away.contains_key(id))
            .collect()
    }

    /// A copy of what the map knows of a tile; its version counts the changes to it. `None` if that is nothing,
    /// or not all because the tile was handed out ([`Self::evict`]).
    pub fn tile(&self, id: TileId) -> Option<Tile> {
        let node = self.tiles.get(id)?;
        if self.away.contains_key(&id) {
            return None;
        }
        let blocks: Vec<_> = node
            .blocks()
            .filter(|(_, block)| !block.is_unknown())
            .map(|(at, block)| (at, block.clone()))
            .collect();
        (!blocks.is_empty()).then_some(Tile {
            id,
            version: node.version,
            resolution_m: self.resolution_m,
            blocks,
        })
    }

    /// Replaces what the map knows of a tile, its version included; one that was handed out is no longer away.
    pub fn set_tile(&mut self, tile: &Tile) -> Result<(), TileError> {
        self.check(tile)?;
        self.away.remove(&tile.id);
        if !tile.blocks.is_empty() || self.tiles.get(tile.id).is_some() {
            self.tiles.get_or_insert(tile.id).replace(tile);
        }
        Ok(())
    }

    /// Whether the map can hold a tile.
    fn check(&self, tile: &Tile) -> Result<(), TileError> {
        if !tile.id.is_in_world() {
            return Err(TileError::OutsideWorld(tile.id));
        }
        if tile.resolution_m.to_bits() != self.resolution_m.to_bits() {
            return Err(TileError::OtherResolution {
                id: tile.id,
                tile_m: tile.resolution_m,
                map_m: self.resolution_m,
            });
        }
        Ok(())
    }

    /// The tiles that changed since this was last asked, sorted.
    pub fn take_changed_tiles(&mut self) -> Vec<TileId> {
        let away = &self.away;
        let mut ids: Vec<_> = self
            .tiles
            .values_mut()
            .filter(|tile| !away.contains_key(&tile.id))
            .filter_map(|tile| std::mem::take(&mut tile.changed).then_some(tile.id))
            .collect();
        ids.sort_unstable();
        ids
    }

    /// The digest of the resolution and of every known voxel.
    pub fn digest(&self) -> MapDigest {
        let mut hash = Xxh3Default::new();
        hash.update(&self.resolution_m.to_bits().to_le_bytes());
        for tile in self.sorted_tiles() {
            let digest = grid::digest(tile.id, self.resolution_m, tile.blocks());
            hash.update(&digest.to_le_bytes());
        }
        MapDigest(hash.digest())
    }

    /// Gives back the memory that insertion keeps from one scan to the next.
    pub fn forget_scratch(&mut self) {
        self.scratch = Scratch::default();
    }

    pub(crate) fn tiles(&self) -> &Hashed<TileNode> {
        &self.tiles
    }

    pub(crate) fn tiles_mut(&mut self) -> &mut Hashed<TileNode> {
        &mut self.tiles
    }

    pub(crate) fn tile_mut(&mut self, id: TileId) -> &mut TileNode {
        self.tiles.get_or_insert(id)
    }

    /// The tiles in which something is known, sorted.
    fn sorted_tiles(&self) -> Vec<&TileNode> {
        let mut tiles: Vec<_> = self
            .tiles
            .values()
            .filter(|tile| tile.blocks().any(|(_, block)| !block.is_unknown()))
            .collect();
        tiles.sort_unstable_by_key(|tile| tile.id);
        tiles
    }

    fn all_blocks(&self) -> impl Iterator<Item = (TileId, u16, &block::Block)> {
        self.tiles
            .values()
            .flat_map(|tile| tile.blocks().map(|(at, block)| (tile.id, at, block)))
    }
}

/// The voxel that holds `p` where an edge is `1 / per_m`; casts saturate.
pub(crate) fn key_at(p: Point<World>, per_m: f64) -> VoxelKey {
    let [x, y, z] = [p.raw.x, p.raw.y, p.raw.z].map(|c| floor(c * per_m));
    VoxelKey { x, y, z }
}

fn least(a: VoxelKey, b: VoxelKey) -> VoxelKey {
    VoxelKey::new(a.x.min(b.x), a.y.min(b.y), a.z.min(b.z))
}

fn greatest(a: VoxelKey, b: VoxelKey) -> VoxelKey {
    VoxelKey::new(a.x.max(b.x), a.y.max(b.y), a.z.max(b.z))
}

/// The greatest integer not above; saturates, NaN becomes 0. `f64::floor` is a call where SSE 4.1 may be missing.
pub(crate) fn floor(c: f64) -> i32 {
    let towards_zero = c as i32;
    towards_zero.saturating_sub(i32::from(c < f64::from(towards_zero)))
}

#[cfg(test)]
mod tests;
