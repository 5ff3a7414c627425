//! A cube of 8³ voxels: one byte of log-odds and two bits, *known* and *occupied*, a voxel; surfaces where it is occupied.
//!
//! Invariants, which make equal content equal bytes: an unknown voxel has log-odds 0; `occupied` is `log_odds > 0`;
//! `surfaces` holds one entry for each occupied voxel in order.

use xxhash_rust::xxh3::Xxh3Default;

use super::surface::{PackedColor, PackedSeen, Surface};
use super::{ClassId, LogOdds, Occupancy, Seen, Voxel};

/// Voxels along an edge of a block.
pub(crate) const EDGE: usize = 8;
/// Voxels in a block.
pub(crate) const VOLUME: usize = EDGE * EDGE * EDGE;

/// One bit a voxel: word `z`, bit `8 y + x`.
pub(crate) type Mask = [u64; EDGE];

/// No voxel.
pub(crate) const NONE: Mask = [0; EDGE];

/// A cube of 8³ voxels. Equal if the content is: when and by whom it was seen does not count.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    known: Mask,
    occupied: Mask,
    log_odds: [i8; VOLUME],
    /// When the free voxels of each slice were last seen.
    free_seen: [PackedSeen; EDGE],
    surfaces: Vec<Surface>,
}

impl PartialEq for Block {
    fn eq(&self, other: &Self) -> bool {
        let pairs = || self.surfaces.iter().zip(&other.surfaces);
        self.known == other.known
            && self.log_odds == other.log_odds
            && pairs().all(|(one, other)| one.is_same(*other))
    }
}

impl Block {
    pub(crate) const UNKNOWN: Self = Self {
        known: NONE,
        occupied: NONE,
        log_odds: [0; VOLUME],
        free_seen: [PackedSeen::NEVER; EDGE],
        surfaces: Vec::new(),
    };

    /// The block of these voxels, of which the occupied ones have the surface that `surface` gives for their index.
    pub(crate) fn from_voxels(
        log_odds: &[Option<LogOdds>; VOLUME],
        surface: impl FnMut(usize) -> Surface,
    ) -> Self {
        let mut block = Self::UNKNOWN;
        for (index, log_odds) in log_odds.iter().enumerate() {
            if let Some(log_odds) = log_odds {
                block.log_odds[index] = log_odds.0;
                put(&mut block.known, index, true);
                put(&mut block.occupied, index, log_odds.is_occupied());
            }
        }
        block.surfaces = ones(&block.occupied).map(surface).collect();
        block
    }

    /// When the free voxels of each slice were seen, for the codec of tiles.
    pub(crate) fn slices_seen(&self) -> &[PackedSeen; EDGE] {
        &self.free_seen
    }

    pub(crate) fn slices_seen_mut(&mut self) -> &mut [PackedSeen; EDGE] {
        &mut self.free_seen
    }

    /// One for each occupied voxel, in order.
    pub(crate) fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    pub(crate) fn surfaces_mut(&mut self) -> &mut [Surface] {
        &mut self.surfaces
    }

    pub(crate) fn is_colored(&self) -> bool {
        self.surfaces.iter().any(|s| s.color != PackedColor::NONE)
    }

    /// Whether any voxel has a class.
    pub(crate) fn is_classified(&self) -> bool {
        self.surfaces.iter().any(|s| s.class != ClassId::NONE)
    }

    pub(crate) fn known_mask(&self) -> &Mask {
        &self.known
    }

    pub(crate) fn occupied_mask(&self) -> &Mask {
        &self.occupied
    }

    pub(crate) fn is_unknown(&self) -> bool {
        self.known == NONE
    }

    pub(crate) fn known_count(&self) -> usize {
        count(&self.known)
    }

    pub(crate) fn occupied_count(&self) -> usize {
        count(&self.occupied)
    }

    pub(crate) fn is_any_occupied(&self) -> bool {
        self.occupied != NONE
    }

    /// Unknown, free or occupied.
    pub(crate) fn occupancy(&self, index: usize) -> Occupancy {
        if has(&self.occupied, index) {
            Occupancy::Occupied
        } else if has(&self.known, index) {
            Occupancy::Free
        } else {
            Occupancy::Unknown
        }
    }

    pub(crate) fn is_occupied(&self, index: usize) -> bool {
        has(&self.occupied, index)
    }

    /// The log-odds of a voxel that is known.
    pub(crate) fn log_odds(&self, index: usize) -> Option<LogOdds> {
        has(&self.known, index).then(|| LogOdds(self.log_odds[index]))
    }

    /// What is kept of a voxel that is occupied.
    pub(crate) fn surface(&self, index: usize) -> Option<&Surface> {
        has(&self.occupied, index).then(|| &self.surfaces[rank(&self.occupied, index)])
    }

    pub(crate) fn surface_mut(&mut self, index: usize) -> Option<&mut Surface> {
        has(&self.occupied, index).then(|| &mut self.surfaces[rank(&self.occupied, index)])
    }

    pub(crate) fn voxel(&self, index: usize) -> Option<Voxel> {
        let log_odds = self.log_odds(index)?;
        let surface = self.surface(index).copied().unwrap_or_default();
        Some(Voxel {
            log_odds,
            color: surface.color.into(),
            class: surface.class,
        })
    }

    /// When and by whom a known voxel was seen.
    pub(crate) fn seen(&self, index: usize) -> Option<Seen> {
        let slice = self.free_seen[index / 64];
        let seen = self.surface(index).map_or(slice, |surface| surface.seen);
        has(&self.known, index).then(|| seen.into())
    }

    /// Overwrites one voxel; whether that changed anything.
    pub(crate) fn set(&mut self, index: usize, voxel: Voxel) -> bool {
        let log_odds = voxel.log_odds.clamped();
        let before = self.voxel(index);
        let at = rank(&self.occupied, index);
        match (self.is_occupied(index), log_odds.is_occupied()) {
            (false, true) => self.surfaces.insert(at, Surface::default()),
            (true, false) => drop(self.surfaces.remove(at)),
            _ => {}
        }
        self.log_odds[index] = log_odds.0;
        put(&mut self.known, index, true);
        put(&mut self.occupied, index, log_odds.is_occupied());
        if let Some(surface) = self.surface_mut(index) {
            surface.set(
                voxel.color.map_or(PackedColor::NONE, Into::into),
                voxel.class,
            );
        }
        before != self.voxel(index)
    }

    /// One update a voxel: those in `hit` have the end of a ray in them, the others in `free` have rays passing. Weights
    /// are those of a miss, not above 0, and of a hit. Whether that changed any content.
    pub(crate) fn update(
        &mut self,
        free: &Mask,
        hit: &Mask,
        weights: [i8; 2],
        seen: PackedSeen,
    ) -> bool {
        let known = self.known;
        let occupied = self.occupied;
        let mut moved = 0;
        for z in 0..EDGE {
            let free = free[z] & !hit[z];
            if free | hit[z] == 0 {
                continue;
            }
            self.known[z] |= free | hit[z];
            let slice = &mut self.log_odds[z * 64..][..64];
            let deltas = deltas(free, hit[z], weights);
            for (value, delta) in slice.iter_mut().zip(deltas) {
                let new = value
                    .saturating_add(delta)
                    .clamp(LogOdds::MIN.0, LogOdds::MAX.0);
                moved |= new ^ *value;
                *value = new;
            }
            self.occupied[z] = positive(slice);
            if free & !self.occupied[z] != 0 {
                self.free_seen[z] = self.free_seen[z].and(seen);
            }
        }
        self.realign_surfaces(&occupied);
        for (index, surface) in ones(&self.occupied).zip(&mut self.surfaces) {
            if has(free, index) || has(hit, index) {
                surface.seen = surface.seen.and(seen);
            }
        }
        moved != 0 || known != self.known
    }

    /// Adds what another block has found out since: log-odds add up, its colours and classes count. Whether that changed
    /// any content.
    pub(crate) fn add(&mut self, newer: &Self) -> bool {
        let before = self.clone();
        for index in ones(&newer.known) {
            let sum = self.log_odds[index].saturating_add(newer.log_odds[index]);
            self.log_odds[index] = LogOdds(sum).clamped().0;
        }
        for z in 0..EDGE {
            self.known[z] |= newer.known[z];
            self.occupied[z] = positive(&self.log_odds[z * 64..][..64]);
            self.free_seen[z] = self.free_seen[z].and(newer.free_seen[z]);
        }
        self.realign_surfaces(&before.occupied);
        for (index, surface) in ones(&self.occupied).zip(&mut self.surfaces) {
            if let Some(newer) = newer.surface(index) {
                surface.add(*newer);
            }
        }
        *self != before
    }

    /// The least and greatest place `[x, y, z]` of what is known.
    pub(crate) fn bounds(&self) -> Option<([u8; 3], [u8; 3])> {
        let mut low = [u8::MAX; 3];
        let mut high = [0; 3];
        for (z, word) in (0..).zip(self.known).filter(|(_, word)| *word != 0) {
            let columns = word.to_le_bytes().iter().fold(0, |any, row| any | row);
            let [left, right] = [columns.trailing_zeros(), columns.ilog2()];
            let [near, far] = [word.trailing_zeros() / 8, word.ilog2() / 8];
            for (axis, (least, greatest)) in
                [(left, right), (near, far), (z, z)].into_iter().enumerate()
            {
                low[axis] = low[axis].min(least as u8);
                high[axis] = high[axis].max(greatest as u8);
            }
        }
        (!self.is_unknown()).then_some((low, high))
    }

    /// Feeds all content, and where it is, to a hash.
    pub(crate) fn hash_into(&self, hash: &mut Xxh3Default) {
        for word in self.known {
            hash.update(&word.to_le_bytes());
        }
        hash.update(&self.log_odds.map(i8::cast_unsigned));
        hash.update(&[u8::from(self.is_colored()), u8::from(self.is_classified())]);
        if self.is_colored() {
            for surface in &self.surfaces {
                hash.update(&surface.color.to_le_bytes());
            }
        }
        if self.is_classified() {
            for surface in &self.surfaces {
                hash.update(&[surface.class.0]);
            }
        }
    }

    /// Restores the order of the surfaces after `occupied` changed from what it was.
    fn realign_surfaces(&mut self, was: &Mask) {
        if *was == self.occupied {
            return;
        }
        let mut old = ones(was).zip(self.surfaces.iter().copied()).peekable();
        let mut surfaces = Vec::with_capacity(count(&self.occupied));
        surfaces.extend(ones(&self.occupied).map(|index| {
            while old.next_if(|(at, _)| *at < index).is_some() {}
            old.next_if(|(at, _)| *at == index)
                .map_or_else(Surface::default, |(_, surface)| surface)
        }));
        self.surfaces = surfaces;
    }
}

/// The indices of the bits that are set, ascending.
pub(crate) fn ones(mask: &Mask) -> impl Iterator<Item = usize> + use<> {
    mask.map(Some)
        .into_iter()
        .zip((0..).step_by(64))
        .flat_map(|(word, base)| {
            std::iter::successors(word, |w| Some(w & w.wrapping_sub(1)))
                .take_while(|w| *w != 0)
                .map(move |w| base + w.trailing_zeros() as usize)
        })
}

fn count(mask: &Mask) -> usize {
    mask.iter().map(|w| w.count_ones() as usize).sum()
}

fn has(mask: &Mask, index: usize) -> bool {
    mask[index / 64] >> (index % 64) & 1 == 1
}

fn put(mask: &mut Mask, index: usize, value: bool) {
    let bit = 1 << (index % 64);
    if value {
        mask[index / 64] |= bit;
    } else {
        mask[index / 64] &= !bit;
    }
}

/// How many bits are set before `index`.
fn rank(mask: &Mask, index: usize) -> usize {
    let whole: u32 = mask[..index / 64].iter().map(|w| w.count_ones()).sum();
    let part = (mask[index / 64] & ((1 << (index % 64)) - 1)).count_ones();
    (whole + part) as usize
}

/// What 64 voxels gain: eight at a time, a byte of each mask spread over eight bytes.
fn deltas(free: u64, hit: u64, weights: [i8; 2]) -> [i8; 64] {
    let [miss_weight, hit_weight] =
        weights.map(|w| u64::from(w.cast_unsigned()) * 0x0101_0101_0101_0101);
    let mut deltas = [0; 64];
    let rows = free.to_le_bytes().into_iter().zip(hit.to_le_bytes());
    for (row, (free, hit)) in deltas.chunks_exact_mut(8).zip(rows) {
        let bytes = SPREAD[usize::from(free)] & miss_weight | SPREAD[usize::from(hit)] & hit_weight;
        for (delta, byte) in row.iter_mut().zip(bytes.to_le_bytes()) {
            *delta = byte.cast_signed();
        }
    }
    deltas
}

/// A byte for each bit of the index: 255 where it is set.
static SPREAD: [u64; 256] = {
    let mut table = [0; 256];
    let mut bits = 0;
    while bits < 256 {
        let mut bit = 0;
        while bit < 8 {
            if bits >> bit & 1 == 1 {
                table[bits] |= 0xff << (8 * bit);
            }
            bit += 1;
        }
        bits += 1;
    }
    table
};

/// A bit for each of 64 values: whether it is above zero.
fn positive(values: &[i8]) -> u64 {
    const LOW: u64 = 0x7f7f_7f7f_7f7f_7f7f;
    let mut mask = [0; 8];
    for (row, bits) in values.chunks_exact(8).zip(&mut mask) {
        let word = u64::from_le_bytes(std::array::from_fn(|i| row[i].cast_unsigned()));
        // The top bit of each byte: set by the carry unless its low bits are zero, then cleared where negative.
        let above_zero = ((word & LOW) + LOW) & !word & !LOW;
        // Gathers the eight top bits into one byte.
        *bits = ((above_zero >> 7).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8;
    }
    u64::from_le_bytes(mask)
}
