//! Which version of which tile an end has, hashed by region.

use std::collections::BTreeMap;
use std::ops::Range;

use maps::tile::TileId;
use xxhash_rust::xxh3::xxh3_64_with_seed;

/// Parts of a region: 4 along each axis.
pub(super) const HASHES: usize = 64;
/// Added to a tile's coordinate before it is shifted: binary 01 01 01 …, so that the world's origin, around which maps grow,
/// lies within the second part of four at each level and never on a border between large regions.
const ORIGIN: i32 = 0x15_5555;
/// A tile's coordinates have one bit less; with [`ORIGIN`] added they fit these.
const BITS: u8 = 22;

/// A cube of 2^level tiles an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Region {
    pub(super) level: u8,
    /// A tile's coordinates, with [`ORIGIN`] added, shifted right by the level.
    pub(super) at: [u32; 3],
}

impl Region {
    /// All tiles.
    pub(super) const WORLD: Self = Self {
        level: BITS,
        at: [0; 3],
    };
    /// Its parts are tiles.
    pub(super) const LEAST_LEVEL: u8 = 2;

    /// `None` if there is none of this level, or not there.
    pub(super) fn new(level: u8, at: [u32; 3]) -> Option<Self> {
        let is_level = (Self::LEAST_LEVEL..=BITS).contains(&level) && level.is_multiple_of(2);
        let is_place = is_level && at.iter().all(|c| *c < 1 << (BITS - level));
        is_place.then_some(Self { level, at })
    }

    /// One of its parts, which is no tile.
    pub(super) fn part(self, part: usize) -> Option<Self> {
        if self.level <= Self::LEAST_LEVEL || part >= HASHES {
            return None;
        }
        let offset = [part, part >> 1, part >> 2].map(|low| (low & 1 | low >> 2 & 2) as u32);
        Some(Self {
            level: self.level - 2,
            at: std::array::from_fn(|i| self.at[i] << 2 | offset[i]),
        })
    }

    pub(super) fn contains(self, other: Self) -> bool {
        other.level <= self.level
            && (0..3).all(|i| other.at[i] >> (self.level - other.level) == self.at[i])
    }

    /// The square of how many tiles lie between it and a tile.
    pub(super) fn distance_squared(self, tile: TileId) -> u64 {
        let far = |c: i32, at: u32| {
            let (c, low) = (
                i64::from(c) + i64::from(ORIGIN),
                i64::from(at) << self.level,
            );
            let high = low + (1 << self.level) - 1;
            ((low - c).max(c - high).max(0)).unsigned_abs()
        };
        let away = [
            far(tile.x, self.at[0]),
            far(tile.y, self.at[1]),
            far(tile.z, self.at[2]),
        ];
        away.iter().map(|c| c * c).sum()
    }

    /// The places of its tiles on the curve.
    fn places(self) -> Range<u128> {
        let first = interleaved(self.at) << (3 * self.level);
        first..first + (1 << (3 * self.level))
    }
}

/// What is known of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Item {
    /// Its version.
    pub version: u64,
    /// A hash of its content, the same at both ends: maps of two starts may have different tiles of one version.
    pub content: u64,
}

impl Item {
    /// Of an encoded tile, as it travels.
    pub fn new(version: u64, bytes: &[u8]) -> Self {
        Self {
            version,
            content: crc32c::crc32c(bytes).into(),
        }
    }
}

/// Which version of which tile an end has. See the [module](super).
#[derive(Clone, Debug, Default)]
pub struct Inventory {
    /// By place on a curve on which each region is in one piece (Morton order).
    items: BTreeMap<u128, (TileId, Item)>,
}

impl Inventory {
    /// Notes a tile, in place of its former version; `false` if a coordinate does not fit 21 bits.
    pub fn insert(&mut self, tile: TileId, item: Item) -> bool {
        let Some(place) = place(tile) else {
            return false;
        };
        self.items.insert(place, (tile, item));
        true
    }

    /// Forgets a tile.
    pub fn remove(&mut self, tile: TileId) {
        if let Some(place) = place(tile) {
            self.items.remove(&place);
        }
    }

    /// What is known of a tile.
    pub fn get(&self, tile: TileId) -> Option<Item> {
        self.items.get(&place(tile)?).map(|(_, item)| *item)
    }

    /// How many tiles there are.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// A hash of each part of a region, of 24 bits; 0 is that of a part without tiles, and of no other.
    pub(super) fn hashes(&self, region: Region, salt: u32) -> [u32; HASHES] {
        let mut sums = [None; HASHES];
        let shift = 3 * (region.level - 2);
        for (place, (tile, item)) in self.items.range(region.places()) {
            let sum = &mut sums[(place >> shift) as usize % HASHES];
            // A sum, since tiles have no order in which both ends could take them.
            *sum = Some(sum.unwrap_or(0_u64).wrapping_add(hash(*tile, *item, salt)));
        }
        sums.map(|sum| sum.map_or(0, |sum| ((sum >> 40) as u32).max(1)))
    }

    /// The parts of a region in which this end has something other than what `theirs` are the hashes of, a bit each.
    pub(super) fn differing(&self, region: Region, salt: u32, theirs: &[u32; HASHES]) -> u64 {
        let ours = self.hashes(region, salt);
        let parts = ours.iter().zip(theirs).enumerate();
        parts
            .filter(|(_, (ours, theirs))| **ours != 0 && ours != theirs)
            .fold(0, |mask, (part, _)| mask | 1 << part)
    }

    /// The tiles of some parts of a region.
    pub(super) fn tiles_of(&self, region: Region, parts: u64) -> Vec<TileId> {
        let shift = 3 * (region.level - 2);
        let tiles = self.items.range(region.places());
        tiles
            .filter(|(place, _)| parts >> ((**place >> shift) as usize % HASHES) & 1 == 1)
            .map(|(_, (tile, _))| *tile)
            .collect()
    }

    /// The smallest region with all tiles of this one; `None` if it has none.
    pub(super) fn bounds(&self, region: Region) -> Option<Region> {
        let mut tiles = self.items.range(region.places()).map(|(place, _)| *place);
        let first = tiles.next()?;
        let last = tiles.next_back().unwrap_or(first);
        let bits = 128 - (first ^ last).leading_zeros();
        let level = bits.div_ceil(6) * 2;
        let level = (level as u8).max(Region::LEAST_LEVEL);
        let at = self.items[&first].0;
        let at = [at.x, at.y, at.z].map(|c| (c + ORIGIN).cast_unsigned() >> level);
        Some(Region { level, at })
    }
}

/// Where a tile is on the curve.
fn place(tile: TileId) -> Option<u128> {
    let at = [tile.x, tile.y, tile.z];
    let fits = at.iter().all(|c| (-(1 << 20)..1 << 20).contains(c));
    fits.then(|| interleaved(at.map(|c| (c + ORIGIN).cast_unsigned())))
}

/// The bits of three numbers in turns, x lowest.
fn interleaved(at: [u32; 3]) -> u128 {
    (0..BITS).fold(0, |place, bit| {
        let three = (0..3).fold(0, |three, axis| three | (at[axis] >> bit & 1) << axis);
        place | u128::from(three) << (3 * bit)
    })
}

fn hash(tile: TileId, item: Item, salt: u32) -> u64 {
    let mut bytes = [0; 28];
    for (four, c) in bytes.chunks_exact_mut(4).zip([tile.x, tile.y, tile.z]) {
        four.copy_from_slice(&c.to_le_bytes());
    }
    bytes[12..20].copy_from_slice(&item.version.to_le_bytes());
    bytes[20..28].copy_from_slice(&item.content.to_le_bytes());
    xxh3_64_with_seed(&bytes, u64::from(salt))
}
