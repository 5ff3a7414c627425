//! Digests of regions, by which two stores find out where they differ without naming every tile.

use std::fmt;

use maps::tile::TileId;
use xxhash_rust::xxh3::Xxh3Default;

use crate::{AsOf, Store, StoreError, TileVersion};

/// A cube of 8³ tiles: the id of any of them, shifted right by 3 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RegionId {
    /// Towards east.
    pub x: i32,
    /// Towards north.
    pub y: i32,
    /// Up.
    pub z: i32,
}

impl RegionId {
    /// The region that holds a tile.
    pub const fn of(tile: TileId) -> Self {
        Self {
            x: tile.x >> 3,
            y: tile.y >> 3,
            z: tile.z >> 3,
        }
    }
}

/// `x/y/z`.
impl fmt::Display for RegionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}", self.x, self.y, self.z)
    }
}

/// What a region holds, in short.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegionDigest {
    /// The region.
    pub id: RegionId,
    /// How many tiles it has.
    pub tiles: usize,
    /// A hash of their ids, versions and digests.
    pub digest: u64,
}

impl Store {
    /// The digest of each region that has tiles, sorted by id.
    pub fn regions(&self, as_of: AsOf) -> Result<Vec<RegionDigest>, StoreError> {
        let mut versions = self.versions(as_of)?;
        versions.sort_unstable_by_key(|is| (RegionId::of(is.id), is.id));
        let regions = versions.chunk_by(|a, b| RegionId::of(a.id) == RegionId::of(b.id));
        Ok(regions.map(digest).collect())
    }

    /// The tiles of a region, sorted by id.
    pub fn versions_in(
        &self,
        region: RegionId,
        as_of: AsOf,
    ) -> Result<Vec<TileVersion>, StoreError> {
        let mut versions = self.versions(as_of)?;
        versions.retain(|is| RegionId::of(is.id) == region);
        Ok(versions)
    }
}

/// Of the tiles of one region, of which there is at least one.
fn digest(tiles: &[TileVersion]) -> RegionDigest {
    let mut hash = Xxh3Default::new();
    for is in tiles {
        for c in [is.id.x, is.id.y, is.id.z] {
            hash.update(&c.to_le_bytes());
        }
        hash.update(&is.version.to_le_bytes());
        hash.update(&is.digest.to_le_bytes());
    }
    RegionDigest {
        id: RegionId::of(tiles[0].id),
        tiles: tiles.len(),
        digest: hash.digest(),
    }
}
