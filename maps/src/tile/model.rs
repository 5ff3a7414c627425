//! What the coder expects of the next voxel, given those before it.

use super::range_coder::{Bit, Coder};
use crate::voxel::LogOdds;
use crate::voxel::block::{Block, VOLUME};
use crate::voxel::surface::PackedColor;

/// A tile and a border around it, so that every voxel has neighbours.
const SIDE: usize = 128 + 2;
const ROW: usize = SIDE;
const SLICE: usize = SIDE * SIDE;

/// A voxel as the coder sees it: its log-odds, or this.
const UNKNOWN: i8 = i8::MIN;

/// What has been coded so far.
pub(super) struct Field {
    states: Vec<i8>,
    /// Empty if no voxel of the tile has a colour.
    colors: Vec<PackedColor>,
    /// The colour that was coded last.
    recent: [u8; 3],
}

impl Field {
    pub(super) fn new(colored: bool) -> Self {
        let volume = SIDE * SLICE;
        Self {
            states: vec![UNKNOWN; volume],
            colors: vec![PackedColor::NONE; if colored { volume } else { 0 }],
            recent: [16; 3],
        }
    }

    /// The colour to compare with: a neighbour's if any has one, else the last. With the number of neighbours that have.
    fn reference(&self, i: usize) -> ([u8; 3], usize) {
        let mut sum = [0_u16; 3];
        let mut count = 0;
        let near = [
            1,
            ROW,
            SLICE,
            ROW + 1,
            ROW - 1,
            SLICE + 1,
            SLICE - 1,
            SLICE + ROW,
            SLICE - ROW,
        ];
        for channels in near
            .iter()
            .filter_map(|back| self.colors[i - back].channels())
        {
            for (sum, channel) in sum.iter_mut().zip(channels) {
                *sum += u16::from(channel);
            }
            count += 1;
        }
        if count == 0 {
            return (self.recent, 0);
        }
        (
            sum.map(|sum| ((2 * sum + count) / (2 * count)) as u8),
            usize::from(count),
        )
    }
}

/// The contexts of everything that is coded.
pub(super) struct Model {
    present: Presence,
    /// By kind of the guess, which neighbours agree on it and how many further ones do.
    same: Box<[[[Bit; 7]; 5]; 5]>,
    /// By what the three nearest neighbours are.
    known: [Bit; 27],
    occupied: [Bit; 27],
    /// By the log-odds of the first two neighbours of the same class.
    free_value: Vec<[[Bit; 64]; 6]>,
    occupied_value: Vec<[[Bit; 128]; 6]>,
    has_color: [Bit; 2],
    /// By channel and by how surprising the channel before was, or how well founded the reference is.
    color: Box<[[[Bit; 32]; 4]; 3]>,
}

/// Which blocks there are: by the three neighbours behind.
struct Presence {
    contexts: [Bit; 8],
    present: Box<[bool; 17 * 17 * 17]>,
}

impl Model {
    pub(super) fn new() -> Self {
        Self {
            present: Presence {
                contexts: [Bit::NEW; 8],
                present: Box::new([false; 17 * 17 * 17]),
            },
            same: Box::new([[[Bit::NEW; 7]; 5]; 5]),
            known: [Bit::NEW; 27],
            occupied: [Bit::NEW; 27],
            free_value: vec![[[Bit::NEW; 64]; 6]; 6],
            occupied_value: vec![[[Bit::NEW; 128]; 6]; 6],
            has_color: [Bit::NEW; 2],
            color: Box::new([[[Bit::NEW; 32]; 4]; 3]),
        }
    }

    /// Whether the tile has a block at this place.
    pub(super) fn is_present(&mut self, coder: &mut impl Coder, at: u16, given: bool) -> bool {
        let [x, y, z] = [0, 4, 8].map(|shift| usize::from(at >> shift & 15) + 1);
        let i = (z * 17 + y) * 17 + x;
        let Presence { contexts, present } = &mut self.present;
        let behind = [1, 17, 17 * 17].map(|back| usize::from(present[i - back]));
        let context = behind[0] | behind[1] << 1 | behind[2] << 2;
        present[i] = coder.bit(&mut contexts[context], given);
        present[i]
    }

    /// One block; `None` if no encoder wrote this.
    pub(super) fn block<C: Coder>(
        &mut self,
        coder: &mut C,
        field: &mut Field,
        at: u16,
        given: Option<&Block>,
    ) -> Option<Block> {
        let [x, y, z] = [0, 4, 8].map(|shift| usize::from(at >> shift & 15) * 8 + 1);
        let corner = z * SLICE + y * ROW + x;
        let mut log_odds = [None; VOLUME];
        let mut colors = [PackedColor::NONE; VOLUME];
        for index in 0..VOLUME {
            let i = corner + (index >> 6) * SLICE + (index >> 3 & 7) * ROW + (index & 7);
            let state = given.and_then(|block| block.log_odds(index));
            let state = state.map_or(UNKNOWN, |log_odds| log_odds.0);
            let state = self.state(coder, &field.states, i, state)?;
            field.states[i] = state;
            log_odds[index] = (state != UNKNOWN).then_some(LogOdds(state));
            if state > 0 && !field.colors.is_empty() {
                let color = given.map_or(PackedColor::NONE, |block| block.color(index));
                colors[index] = self.color(coder, field, i, color);
            }
        }
        Some(Block::from_voxels(&log_odds, &colors))
    }

    fn state(&mut self, coder: &mut impl Coder, s: &[i8], i: usize, given: i8) -> Option<i8> {
        let behind @ [w, n, d] = [s[i - 1], s[i - ROW], s[i - SLICE]];
        let (guess, who) = match (w == n, w == d, n == d) {
            (true, true, _) => (w, 0),
            (true, ..) => (w, 1),
            (_, true, _) => (w, 2),
            (.., true) => (n, 3),
            _ => (w, 4),
        };
        let further = [
            ROW + 1,
            ROW - 1,
            SLICE + 1,
            SLICE - 1,
            SLICE + ROW,
            SLICE - ROW,
        ];
        let agree = further.iter().filter(|back| s[i - **back] == guess).count();
        let same = &mut self.same[kind(guess)][who][agree];
        if coder.bit(same, given == guess) {
            return Some(guess);
        }
        let near = behind.iter().fold(0, |sum, state| sum * 3 + class(*state));
        // What is not the same as unknown is known.
        if guess != UNKNOWN && !coder.bit(&mut self.known[near], given != UNKNOWN) {
            return Some(UNKNOWN);
        }
        let occupied = coder.bit(&mut self.occupied[near], given > 0);
        let mut alike = behind
            .into_iter()
            .filter(|state| class(*state) == 1 + usize::from(occupied));
        let alike = [alike.next(), alike.next()];
        if occupied {
            let [one, two] = alike.map(|state| state.map_or(0, sureness_occupied));
            let tree = &mut self.occupied_value[one][two];
            let value = coder.tree(tree, 7, given.cast_unsigned());
            let range = 1..=LogOdds::MAX.0.cast_unsigned();
            range.contains(&value).then_some(value.cast_signed())
        } else {
            let [one, two] = alike.map(|state| state.map_or(0, sureness_free));
            let tree = &mut self.free_value[one][two];
            let value = coder.tree(tree, 6, given.wrapping_neg().cast_unsigned());
            let range = 0..=LogOdds::MIN.0.unsigned_abs();
            range.contains(&value).then_some(-value.cast_signed())
        }
    }

    fn color(
        &mut self,
        coder: &mut impl Coder,
        field: &mut Field,
        i: usize,
        given: PackedColor,
    ) -> PackedColor {
        let (reference, founded) = field.reference(i);
        let given = given.channels();
        let has_color = &mut self.has_color[usize::from(founded > 0)];
        if !coder.bit(has_color, given.is_some()) {
            return PackedColor::NONE;
        }
        let given = given.unwrap_or(reference);
        let mut color = [0; 3];
        // Green first; red and blue mostly differ from the reference as it does.
        let mut expected = 0;
        let mut context = founded.min(3);
        for channel in [1, 0, 2] {
            let base = reference[channel].wrapping_add(expected);
            let tree = &mut self.color[channel][context];
            let difference = coder.tree(tree, 5, given[channel].wrapping_sub(base) & 31);
            color[channel] = base.wrapping_add(difference) & 31;
            if channel == 1 {
                expected = difference;
            }
            context = match difference.min(32 - difference) {
                0 => 0,
                1 => 1,
                2..=3 => 2,
                _ => 3,
            };
        }
        field.recent = color;
        let color = PackedColor::from_channels(color);
        field.colors[i] = color;
        color
    }
}

/// Unknown, free or occupied.
fn class(state: i8) -> usize {
    if state == UNKNOWN {
        0
    } else {
        1 + usize::from(state > 0)
    }
}

/// The class, and whether it is as sure as it can be.
fn kind(state: i8) -> usize {
    let is_sure = state == LogOdds::MIN.0 || state == LogOdds::MAX.0;
    match class(state) {
        0 => 0,
        class => 2 * class - usize::from(is_sure),
    }
}

fn sureness_free(log_odds: i8) -> usize {
    match log_odds {
        ..=-40 => 1,
        -39..=-24 => 2,
        -23..=-9 => 3,
        -8 => 4,
        _ => 5,
    }
}

fn sureness_occupied(log_odds: i8) -> usize {
    match log_odds {
        ..17 => 1,
        17 => 2,
        18..=50 => 3,
        51..=69 => 4,
        _ => 5,
    }
}
