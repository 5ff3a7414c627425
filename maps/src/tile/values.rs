//! The log-odds of each known voxel, given all states and the log-odds before.
//!
//! Neighbours were mostly seen as often as one another. So the first question is whether a voxel is as a guess from its
//! neighbours, and only where it is not its value is coded, bit by bit. Against a known base the guess is that it changed
//! as its neighbours did.

use super::field::{FREE, Field, OCCUPIED, ROW, Rows, SLICE, State, UNKNOWN};
use super::mixer::{Mixer, hash};
use super::range_coder::Coder;
use crate::voxel::LogOdds;

/// Steps back to the neighbours that share a face and come before.
const BEHIND: [usize; 3] = [1, ROW, SLICE];
/// Steps back to further neighbours.
const FURTHER: [usize; 9] = [
    ROW + 1,
    ROW - 1,
    SLICE + 1,
    SLICE - 1,
    SLICE + ROW,
    SLICE - ROW,
    2,
    2 * ROW,
    2 * SLICE,
];
/// Steps to the neighbours that share a face and come after.
const AHEAD: [usize; 3] = [1, ROW, SLICE];

/// The contexts of the log-odds.
pub(super) struct Values {
    same: Mixer<6>,
    free: Mixer<4>,
    occupied: Mixer<4>,
}

/// What a voxel's log-odds may be, and who says so.
struct Guess {
    value: i8,
    /// Which neighbours agree on it.
    who: u8,
    /// The log-odds before; 0 if there is no base or it was of another state.
    was: i8,
}

impl Values {
    pub(super) fn new() -> Self {
        Self {
            same: Mixer::new(3 * 5),
            free: Mixer::new(64),
            occupied: Mixer::new(128),
        }
    }

    /// Codes the log-odds of all voxels of these rows; `None` if no encoder wrote them.
    pub(super) fn code(
        &mut self,
        coder: &mut impl Coder,
        field: &mut Field,
        base: Option<&Field>,
        rows: &Rows,
    ) -> Option<()> {
        for (_, runs) in rows.iter() {
            for i in runs.flat_map(|start| start..start + 8) {
                if field.states[i] != UNKNOWN {
                    field.values[i] = self.value(coder, field, base, i)?;
                }
            }
            if coder.is_exhausted() {
                return None;
            }
        }
        Some(())
    }

    fn value(
        &mut self,
        coder: &mut impl Coder,
        field: &Field,
        base: Option<&Field>,
        i: usize,
    ) -> Option<i8> {
        let given = field.values[i];
        let state = field.states[i];
        let guess = base
            .filter(|base| base.states[i] == state)
            .map_or_else(|| guess(field, i), |base| guess_change(field, base, i));
        let contexts = contexts(field, &guess, i);
        let set = usize::from(guess.who) * 3 + usize::from(state);
        let set = set.min(3 * 5 - 1);
        if self.same.bit(coder, &contexts, set, given == guess.value) {
            return Some(guess.value);
        }
        let [w, n, d] = BEHIND.map(|back| byte(field.values[i - back]));
        let (value, was) = (byte(guess.value), byte(guess.was));
        let contexts = [
            hash(value),
            hash(w << 16 | n << 8 | value | 1 << 24),
            hash(d << 16 | was << 8 | value | 2 << 24),
            hash(faces(field, i) << 8 | 3 << 24),
        ];
        if state == OCCUPIED {
            let value = self
                .occupied
                .tree(coder, &contexts, 7, given.cast_unsigned());
            let range = 1..=LogOdds::MAX.0.cast_unsigned();
            range.contains(&value).then_some(value.cast_signed())
        } else {
            let given = given.wrapping_neg().cast_unsigned();
            let value = self.free.tree(coder, &contexts, 6, given);
            let range = 0..=LogOdds::MIN.0.unsigned_abs();
            range.contains(&value).then_some(-value.cast_signed())
        }
    }
}

/// The contexts of the question whether a guess is right.
fn contexts(field: &Field, guess: &Guess, i: usize) -> [u32; 6] {
    let [w, n, d] = BEHIND.map(|back| byte(field.values[i - back]));
    let (value, who, was) = (byte(guess.value), u64::from(guess.who), byte(guess.was));
    let alike = FURTHER.iter().fold(0, |sum, back| {
        2 * sum + u64::from(field.values[i - back] == guess.value)
    });
    let agree = u64::from(alike.count_ones());
    let around = faces(field, i);
    [
        hash(agree << 16 | who << 8 | value),
        hash(w << 24 | n << 16 | d << 8 | was),
        hash(around << 16 | who << 8 | value),
        hash(alike << 16 | who << 8 | value),
        hash(was << 16 | agree << 8 | value),
        hash(around << 16 | alike),
    ]
}

/// The guess from the neighbours of the same state.
fn guess(field: &Field, i: usize) -> Guess {
    let state = field.states[i];
    let of = |back: usize| (field.states[i - back] == state).then(|| field.values[i - back]);
    let (value, who) = agreement(BEHIND.map(of)).unwrap_or_else(|| {
        let first = FURTHER.iter().find_map(|back| of(*back));
        (first.unwrap_or_else(|| first_value(state)), 4)
    });
    Guess { value, who, was: 0 }
}

/// The guess from what the voxel was before and how the neighbours changed since.
fn guess_change(field: &Field, base: &Field, i: usize) -> Guess {
    let state = field.states[i];
    let was = base.values[i];
    let of = |back: usize| {
        let j = i - back;
        let both = field.states[j] == state && base.states[j] == state;
        both.then(|| field.values[j].saturating_sub(base.values[j]))
    };
    let (change, who) = agreement(BEHIND.map(of)).unwrap_or((0, 4));
    let range = if state == FREE {
        LogOdds::MIN.0..=0
    } else {
        1..=LogOdds::MAX.0
    };
    let value = was
        .saturating_add(change)
        .clamp(*range.start(), *range.end());
    Guess { value, who, was }
}

/// What most of three say, and which; the first that says anything if they differ.
fn agreement(said: [Option<i8>; 3]) -> Option<(i8, u8)> {
    match said {
        [Some(w), n, d] if n == Some(w) && d == Some(w) => Some((w, 0)),
        [Some(w), n, _] if n == Some(w) => Some((w, 1)),
        [Some(w), _, d] if d == Some(w) => Some((w, 2)),
        [_, Some(n), d] if d == Some(n) => Some((n, 3)),
        said => said.into_iter().flatten().next().map(|first| (first, 4)),
    }
}

/// What a voxel is that was seen once.
fn first_value(state: State) -> i8 {
    if state == OCCUPIED {
        LogOdds::HIT.0
    } else {
        LogOdds::MISS.0
    }
}

/// The states of the six neighbours that share a face, and of the voxel, as one number.
fn faces(field: &Field, i: usize) -> u64 {
    let states = &field.states;
    let pairs = BEHIND.iter().zip(AHEAD);
    pairs.fold(u64::from(states[i]), |sum, (back, ahead)| {
        9 * sum + 3 * u64::from(states[i - back]) + u64::from(states[i + ahead])
    })
}

fn byte(value: i8) -> u64 {
    u64::from(value.cast_unsigned())
}
