//! When and by whom voxels were seen: one entry for each slice of a block, one for each of its surfaces.
//!
//! A scan leaves the same entry on all it touched, so most entries are among the last few. An entry that is not is coded
//! byte by byte as a difference from the last.

use super::range_coder::{Bit, Coder};
use crate::voxel::block::Block;
use crate::voxel::surface::PackedSeen;

/// How many entries are remembered.
const RECENT: usize = 15;

/// The contexts of sightings.
pub(super) struct Sightings {
    /// The entries that were coded last, the latest first.
    recent: Vec<PackedSeen>,
    /// By whether it is a surface and where the entry before was among the recent ones.
    rank: Box<[[[Bit; 16]; 16]; 2]>,
    /// By byte.
    bytes: Box<[[Bit; 256]; 6]>,
    last_rank: usize,
}

impl Sightings {
    pub(super) fn new() -> Self {
        Self {
            recent: vec![PackedSeen::NEVER],
            rank: Box::new([[[Bit::NEW; 16]; 16]; 2]),
            bytes: Box::new([[Bit::NEW; 256]; 6]),
            last_rank: 0,
        }
    }

    /// Codes the sightings of a block that has its surfaces: those of `given`, or into `block`. `None` if no encoder
    /// wrote them.
    pub(super) fn code(
        &mut self,
        coder: &mut impl Coder,
        given: Option<&Block>,
        block: &mut Block,
    ) -> Option<()> {
        let slices = *given.unwrap_or(block).slices_seen();
        let slices = slices.map(|seen| self.entry(coder, 0, seen));
        for (slice, seen) in block.slices_seen_mut().iter_mut().zip(slices) {
            *slice = seen?;
        }
        let mut given = given.into_iter().flat_map(Block::surfaces);
        for surface in block.surfaces_mut() {
            let given = given.next().map_or(surface.seen, |given| given.seen);
            surface.seen = self.entry(coder, 1, given)?;
        }
        Some(())
    }

    fn entry(
        &mut self,
        coder: &mut impl Coder,
        kind: usize,
        given: PackedSeen,
    ) -> Option<PackedSeen> {
        let rank = self.recent.iter().position(|seen| *seen == given);
        let tree = &mut self.rank[kind][self.last_rank];
        let rank = coder.tree(tree, 4, rank.unwrap_or(RECENT) as u8);
        self.last_rank = usize::from(rank);
        let seen = if self.last_rank == RECENT {
            self.new_entry(coder, given)?
        } else if self.last_rank < self.recent.len() {
            self.recent.remove(self.last_rank)
        } else {
            return None;
        };
        self.recent.truncate(RECENT - 1);
        self.recent.insert(0, seen);
        Some(seen)
    }

    /// Of the last entry that was remembered, so that it can be told from any of them.
    fn new_entry(&mut self, coder: &mut impl Coder, given: PackedSeen) -> Option<PackedSeen> {
        let last = self.recent.first().copied().unwrap_or_default().to_bits();
        let difference = given.to_bits().wrapping_sub(last);
        let mut bytes = difference.to_le_bytes();
        for (byte, tree) in bytes.iter_mut().zip(self.bytes.iter_mut()) {
            *byte = coder.tree(tree, 8, *byte);
        }
        let [a, b, c, d, e, f, ..] = bytes;
        let difference = u64::from_le_bytes([a, b, c, d, e, f, 0, 0]);
        PackedSeen::from_bits(last.wrapping_add(difference) & ((1 << 48) - 1))
    }
}
