//! Whether each voxel is unknown, free or occupied, given the voxels before it.
//!
//! Space is mostly smooth: where all 28 voxels around that were coded before are the same, one cheap bit says that this one
//! is too. Elsewhere a [`Mixer`] weighs eight views of the neighbourhood: how the nearest voxels are, the slice below, two
//! slices below, the row, and so on. Rays leave thin sheets and shadows, and each view sees another kind of them.
//!
//! Against a known base, each view also sees what the voxel was before.

use super::field::{Field, OCCUPIED, ROW, Rows, SLICE, State, UNKNOWN};
use super::mixer::{Mixer, hash};
use super::range_coder::{Bit, Coder};

/// Steps back to the voxels around that come before: those that share a face, then an edge, then a corner.
const NEAR: [usize; 13] = [
    1,
    ROW,
    SLICE,
    ROW + 1,
    ROW - 1,
    SLICE + 1,
    SLICE - 1,
    SLICE + ROW,
    SLICE - ROW,
    SLICE + ROW + 1,
    SLICE + ROW - 1,
    SLICE - ROW + 1,
    SLICE - ROW - 1,
];

/// Steps back to voxels two away.
const FAR: [usize; 15] = [
    2,
    2 * ROW,
    2 * SLICE,
    ROW + 2,
    ROW - 2,
    2 * ROW + 1,
    2 * ROW - 1,
    SLICE - 2,
    SLICE + 2,
    SLICE - 2 * ROW,
    SLICE + 2 * ROW,
    2 * SLICE - 1,
    2 * SLICE + 1,
    2 * SLICE - ROW,
    2 * SLICE + ROW,
];

/// The slice below, in order, and the voxel below that.
const BELOW: [usize; 10] = [
    SLICE + ROW + 1,
    SLICE + ROW,
    SLICE + ROW - 1,
    SLICE + 1,
    SLICE,
    SLICE - 1,
    SLICE - ROW + 1,
    SLICE - ROW,
    SLICE - ROW - 1,
    2 * SLICE,
];

/// Two slices below, and the nearest.
const DEEP: [usize; 12] = [
    2 * SLICE + ROW + 1,
    2 * SLICE + ROW,
    2 * SLICE + ROW - 1,
    2 * SLICE + 1,
    2 * SLICE,
    2 * SLICE - 1,
    2 * SLICE - ROW + 1,
    2 * SLICE - ROW,
    2 * SLICE - ROW - 1,
    SLICE,
    1,
    ROW,
];

/// The same slice.
const LEVEL: [usize; 12] = [
    3,
    2,
    1,
    ROW + 2,
    ROW + 1,
    ROW,
    ROW - 1,
    ROW - 2,
    2 * ROW + 1,
    2 * ROW,
    2 * ROW - 1,
    3 * ROW,
];

/// The states that many steps back, as one number in base 3.
fn ternary(states: &[State], i: usize, back: &[usize]) -> u64 {
    let states = back.iter().map(|back| u64::from(states[i - back]));
    states.fold(0, |sum, state| 3 * sum + state)
}

fn count(states: &[State], i: usize, back: &[usize], which: impl Fn(State) -> bool) -> u64 {
    back.iter().filter(|back| which(states[i - **back])).count() as u64
}

/// The contexts of the states.
pub(super) struct States {
    /// Whether a voxel is as all around it: by what that is and where in its block the voxel is.
    plain: [[Bit; 8]; 3],
    known: Mixer<8>,
    occupied: Mixer<8>,
}

impl States {
    pub(super) fn new() -> Self {
        Self {
            plain: [[Bit::NEW; 8]; 3],
            known: Mixer::new(27),
            occupied: Mixer::new(27),
        }
    }

    /// Codes the states of all voxels of these rows; `None` if no encoder wrote them.
    pub(super) fn code(
        &mut self,
        coder: &mut impl Coder,
        field: &mut Field,
        base: Option<&Field>,
        rows: &Rows,
    ) -> Option<()> {
        let states = &mut field.states;
        let base = base.map(|base| &base.states[..]);
        for (z, runs) in rows.iter() {
            for start in runs {
                for i in start..start + 8 {
                    let edge = usize::from(i == start + 7) | usize::from(z & 7 == 7) << 1;
                    states[i] = self.state(coder, states, base, [i, edge]);
                }
            }
            if coder.is_exhausted() {
                return None;
            }
        }
        Some(())
    }

    fn state(
        &mut self,
        coder: &mut impl Coder,
        states: &[State],
        base: Option<&[State]>,
        [i, edge]: [usize; 2],
    ) -> State {
        let given = states[i];
        let guess = states[i - 1];
        let is_plain = is_plain(states, base, i, guess);
        if is_plain {
            let place = edge | usize::from(base.is_some()) << 2;
            let plain = &mut self.plain[usize::from(guess)][place];
            if coder.bit(plain, given == guess) {
                return guess;
            }
        }
        let contexts = base.map_or_else(|| alone(states, i), |base| compared(states, base, i));
        let set = ternary(states, i, &NEAR[..3]) as usize;
        // What is not the same as unknown is known.
        let is_known = is_plain && guess == UNKNOWN;
        if !is_known && !self.known.bit(coder, &contexts, set, given != UNKNOWN) {
            return UNKNOWN;
        }
        let occupied = self.occupied.bit(coder, &contexts, set, given == OCCUPIED);
        1 + u8::from(occupied)
    }
}

/// Whether everything around is as `guess`, before and, as far as the base knows, after.
fn is_plain(states: &[State], base: Option<&[State]>, i: usize, guess: State) -> bool {
    let same = |back: &[usize]| back.iter().all(|back| states[i - back] == guess);
    let was = |base: &[State]| {
        let ahead = [0, 1, ROW, SLICE];
        ahead.iter().all(|ahead| base[i + ahead] == guess)
    };
    same(&NEAR) && same(&FAR) && base.is_none_or(was)
}

/// The views of a neighbourhood without a base.
fn alone(states: &[State], i: usize) -> [u32; 8] {
    let near = ternary(states, i, &NEAR);
    let far = ternary(states, i, &FAR);
    [
        ternary(states, i, &NEAR[..6]) as u32,
        hash(near),
        ternary(states, i, &BELOW) as u32,
        hash(ternary(states, i, &LEVEL)),
        hash(ternary(states, i, &DEEP)),
        hash(near << 16 ^ ternary(states, i, &FAR[..8])),
        hash(far),
        crowd(states, i),
    ]
}

/// The views of a neighbourhood that was `base` before.
fn compared(states: &[State], base: &[State], i: usize) -> [u32; 8] {
    let was = u64::from(base[i]);
    let ahead = [1, ROW, SLICE, ROW + 1, SLICE + 1, SLICE + ROW];
    let ahead = ahead
        .iter()
        .fold(was, |sum, ahead| 3 * sum + u64::from(base[i + ahead]));
    let behind = ternary(base, i, &NEAR[..6]);
    let near = ternary(states, i, &NEAR);
    let nearest = ternary(states, i, &NEAR[..6]);
    // Which neighbours have changed, and into what.
    let changed = NEAR.iter().fold(0, |sum, back| {
        let changed = u64::from(states[i - back] != base[i - back]);
        2 * sum + changed
    });
    [
        hash(nearest << 2 | was),
        hash(near << 2 | was),
        hash(ternary(states, i, &LEVEL) << 2 | was),
        hash(ternary(states, i, &BELOW) << 2 | was),
        hash((ahead << 16 ^ behind) << 16 | nearest),
        hash(changed << 16 ^ ahead),
        hash(changed << 12 ^ nearest << 2 ^ was),
        hash(u64::from(crowd(states, i)) << 2 | was),
    ]
}

/// How many around are known and how many occupied.
fn crowd(states: &[State], i: usize) -> u32 {
    let known = |state| state != UNKNOWN;
    let occupied = |state| state == OCCUPIED;
    let near = count(states, i, &NEAR, known) << 4 | count(states, i, &NEAR, occupied);
    let far = count(states, i, &FAR, known) << 3 | count(states, i, &FAR, occupied).min(7);
    ((near << 7 | far) & 0x7fff) as u32
}
