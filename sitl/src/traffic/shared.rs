//! Stretches that two lanes share, as where one turns into the other: who drives there follows whoever is ahead, on
//! either lane.
//!
//! Where the two come together, and where they part, there are gates (`gate`); in between, a place of one lane is a
//! place of the other.

use super::course::Slice;
use super::path::{direction, left_of, wrapped};

/// Slices of the same way are no farther apart across it.
const ACROSS_M: f64 = 0.2;
/// Half the distance between two slices, and some rounding.
const ALONG_M: f64 = 0.51;
const PARALLEL_RAD: f64 = 0.1;

/// A stretch of two lanes.
#[derive(Clone, Debug)]
pub(super) struct Shared {
    pub(super) lanes: [usize; 2],
    /// Where it begins on each.
    pub(super) from_m: [f64; 2],
    pub(super) length_m: f64,
}

impl Shared {
    /// Where a place of the other lane is on this one, from the start of this lane. `None` if it is not on the stretch,
    /// or this lane has no part in it.
    pub(super) fn on_lane(&self, lane: usize, other: usize, along_m: f64) -> Option<f64> {
        let (this, that) = match self.lanes {
            [a, b] if [a, b] == [lane, other] => (0, 1),
            [a, b] if [b, a] == [lane, other] => (1, 0),
            _ => return None,
        };
        let into_m = along_m - self.from_m[that];
        (0.0..=self.length_m)
            .contains(&into_m)
            .then_some(self.from_m[this] + into_m)
    }
}

/// A run of slices of two corridors that are the same, by their first and last ones.
pub(super) struct Run {
    pub(super) rows: [usize; 2],
    pub(super) columns: [usize; 2],
}

/// The longest run of slices, within these bounds, that both corridors have.
pub(super) fn longest_run(
    rows: (&[Slice], [usize; 2]),
    columns: (&[Slice], [usize; 2]),
) -> Option<Run> {
    let mut best: Option<Run> = None;
    let mut now: Option<Run> = None;
    for i in rows.1[0]..=rows.1[1] {
        let next = now.as_ref().map(|run| run.columns[1] + 1);
        let same = |j: &usize| is_same(&rows.0[i], &columns.0[*j]);
        now = match (now, next.filter(|&j| j <= columns.1[1]).filter(same)) {
            (Some(run), Some(j)) => Some(Run {
                rows: [run.rows[0], i],
                columns: [run.columns[0], j],
            }),
            _ => (columns.1[0]..=columns.1[1]).find(same).map(|j| Run {
                rows: [i, i],
                columns: [j, j],
            }),
        };
        let length = |run: &Option<Run>| run.as_ref().map_or(0, |run| run.rows[1] - run.rows[0]);
        if length(&now) > length(&best) {
            best = now.as_ref().map(|run| Run { ..*run });
        }
    }
    best
}

/// How far along its way a slice is beyond another.
pub(super) fn beyond_m(slice: &Slice, other: &Slice) -> f64 {
    (slice.middle - other.middle).dot(&direction(other.heading_rad))
}

fn is_same(a: &Slice, b: &Slice) -> bool {
    let across_m = (a.middle - b.middle).dot(&left_of(b.heading_rad));
    beyond_m(a, b).abs() < ALONG_M
        && across_m.abs() < ACROSS_M
        && wrapped(a.heading_rad - b.heading_rad).abs() < PARALLEL_RAD
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_of_one_lane_is_a_place_of_the_other() {
        let shared = Shared {
            lanes: [3, 5],
            from_m: [10.0, 40.0],
            length_m: 20.0,
        };
        assert_eq!(shared.on_lane(3, 5, 45.0), Some(15.0));
        assert_eq!(shared.on_lane(5, 3, 15.0), Some(45.0));
        assert_eq!(shared.on_lane(5, 3, 9.0), None);
        assert_eq!(shared.on_lane(3, 5, 61.0), None);
        assert_eq!(shared.on_lane(3, 4, 45.0), None);
    }
}
