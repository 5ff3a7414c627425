//! How much a tile tells of each voxel.

use xxhash_rust::xxh3::Xxh3Default;

use super::{Base, Tile};
use crate::voxel::LogOdds;
use crate::voxel::block::{Block, VOLUME};
use crate::voxel::surface::Surface;

/// How much a compressed tile tells of each voxel, each kind more than the one before: a thin link may carry little, a
/// store must keep all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Detail {
    /// Unknown, free or occupied; what comes out is as sure as can be, as from an `OctoMap` `.bt` file.
    State = 0,
    /// And the log-odds.
    LogOdds = 1,
    /// And colour and class of what is occupied: all that makes maps equal.
    Surface = 2,
    /// And when and by whom everything was seen.
    Sightings = 3,
}

impl Detail {
    /// Every kind, in order.
    pub const ALL: [Self; 4] = [Self::State, Self::LogOdds, Self::Surface, Self::Sightings];
}

impl Tile {
    /// What a receiver has of this tile that was encoded with this detail.
    #[must_use]
    pub fn reduced(&self, detail: Detail) -> Self {
        let reduce = |block: &Block| match detail {
            Detail::State => reduce(block, |value| {
                if value.is_occupied() {
                    LogOdds::MAX
                } else {
                    LogOdds::MIN
                }
            }),
            Detail::LogOdds => reduce(block, |value| value),
            Detail::Surface => without_sightings(block),
            Detail::Sightings => block.clone(),
        };
        let blocks = self.blocks.iter();
        Self {
            blocks: blocks.map(|(at, block)| (*at, reduce(block))).collect(),
            ..*self
        }
    }

    /// What names this version where a change of it is encoded; the tile must be reduced already.
    pub(super) fn as_base(&self, detail: Detail) -> Base {
        let content = self.digest();
        let digest = if detail == Detail::Sightings {
            self.sightings_digest(content)
        } else {
            content
        };
        Base {
            version: self.version,
            digest,
        }
    }

    fn sightings_digest(&self, content: u64) -> u64 {
        let mut hash = Xxh3Default::new();
        hash.update(&content.to_le_bytes());
        for (_, block) in &self.blocks {
            let slices = block.slices_seen().iter().copied();
            for seen in slices.chain(block.surfaces().iter().map(|surface| surface.seen)) {
                hash.update(&seen.to_bits().to_le_bytes());
            }
        }
        hash.digest()
    }
}

fn reduce(block: &Block, change: impl Fn(LogOdds) -> LogOdds) -> Block {
    let log_odds: [_; VOLUME] = std::array::from_fn(|index| block.log_odds(index).map(&change));
    Block::from_voxels(&log_odds, |_| Surface::default())
}

fn without_sightings(block: &Block) -> Block {
    let log_odds: [_; VOLUME] = std::array::from_fn(|index| block.log_odds(index));
    Block::from_voxels(&log_odds, |index| {
        let surface = block.surface(index).copied().unwrap_or_default();
        Surface::new(surface.color, surface.class)
    })
}
