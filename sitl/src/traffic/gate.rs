//! Gates: stretches of a lane that a vehicle enters only after it has claimed them.
//!
//! Where two lanes come nearer to each other than what their vehicles sweep, each gets a gate, and the two are rivals:
//! as long as a vehicle holds one, no other vehicle can claim the other. A crossing makes a gate of each lane it leads
//! over, which those on foot can close. A signal makes one without extent.
//!
//! Two bodies can overlap only where a cross-section of one lane meets a cross-section of the other. Both are then
//! within a pair of rival gates, which only one of them can hold.

use nalgebra::Vector2;

use super::course::{Course, Slice, beside};
use super::path::angle;
use super::shared::{Shared, beyond_m, longest_run};
use super::{Crossing, Signal};

/// Slices of a lane are this far apart at most.
const SLICE_M: f64 = 1.0;
/// Along one and the same lane, what is nearer than this is no other branch of it.
const OWN_BRANCH_M: f64 = 25.0;
/// Narrower crossings are as wide as this: two people must be able to pass each other.
pub(super) const NARROWEST_CROSSING_M: f64 = 1.6;
/// Free space between people on a crossing and vehicles beside them.
const BESIDE_PEOPLE_M: f64 = 0.5;

/// A stretch of a lane that must be claimed.
#[derive(Clone, Debug)]
pub(super) struct Gate {
    pub(super) lane: usize,
    /// From the start of the lane. Below zero if it begins before an open lane does.
    pub(super) start_m: f64,
    /// Not before `start_m`.
    pub(super) end_m: f64,
    pub(super) kind: GateKind,
}

/// Why there is a gate.
#[derive(Clone, Debug)]
pub(super) enum GateKind {
    /// Another lane. None of the rivals may be held.
    Junction { rivals: Vec<usize> },
    /// People on foot may close it.
    Crossing,
    /// Open while it is green.
    Signal(Signal),
}

/// Where a crossing leads over a lane, by distance from its first end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub(super) gate: usize,
    /// Who is nearer to the first end than this is not in the way of vehicles.
    pub(super) from_m: f64,
    /// Who is farther from the first end than this is not in the way of vehicles.
    pub(super) to_m: f64,
}

/// Adds the gates of all pairs of lanes, and of lanes with themselves, and returns the stretches that pairs share.
pub(super) fn junctions(courses: &[Course], gates: &mut Vec<Gate>) -> Vec<Shared> {
    let corridors: Vec<Vec<Slice>> = courses.iter().map(Course::corridor).collect();
    let mut all_shared = Vec::new();
    for a in 0..courses.len() {
        for b in a..courses.len() {
            let own = (a == b).then_some(&courses[a]);
            for meeting in meetings(&corridors[a], &corridors[b], own) {
                let lanes = [
                    Side::new([a, meeting.rows[0], meeting.rows[1]], courses, &corridors),
                    Side::new(
                        [b, meeting.columns[0], meeting.columns[1]],
                        courses,
                        &corridors,
                    ),
                ];
                match shared_stretch(&lanes).filter(|_| a != b) {
                    None => add_rivals(gates, [0, 1].map(|k| (lanes[k].lane, lanes[k].whole()))),
                    Some((shared, ends)) => {
                        for bounds in ends.into_iter().flatten() {
                            add_rivals(gates, [0, 1].map(|k| (lanes[k].lane, bounds[k])));
                        }
                        all_shared.push(shared);
                    }
                }
            }
        }
    }
    all_shared
}

fn add_rivals(gates: &mut Vec<Gate>, sides: [(usize, [f64; 2]); 2]) {
    let first = gates.len();
    for ((lane, [start_m, end_m]), rival) in sides.into_iter().zip([first + 1, first]) {
        gates.push(Gate {
            lane,
            start_m,
            end_m,
            kind: GateKind::Junction {
                rivals: vec![rival],
            },
        });
    }
}

/// One of the two lanes of a meeting.
struct Side<'a> {
    lane: usize,
    course: &'a Course,
    corridor: &'a [Slice],
    /// The slices that meet the other lane, first and last.
    slices: [usize; 2],
}

impl<'a> Side<'a> {
    fn new(
        [lane, first, last]: [usize; 3],
        courses: &'a [Course],
        corridors: &'a [Vec<Slice>],
    ) -> Self {
        Self {
            lane,
            course: &courses[lane],
            corridor: &corridors[lane],
            slices: [first, last],
        }
    }

    /// From where to where it meets the other.
    fn whole(&self) -> [f64; 2] {
        let [first, last] = self.slices.map(|i| self.corridor[i].along_m);
        [first - SLICE_M, last + SLICE_M]
    }

    fn starts_with(&self, slice: usize) -> bool {
        slice == 0 && !self.course.path().is_closed()
    }

    fn ends_with(&self, slice: usize) -> bool {
        slice + 1 == self.corridor.len() && !self.course.path().is_closed()
    }
}

/// From where to where a gate is on each of two lanes.
type Bounds = [[f64; 2]; 2];

/// The stretch that the lanes of a meeting share, if it is long enough, and the gates before and behind it.
///
/// No gate is before it if both lanes begin there. If only one does, its vehicles would come in among those of the
/// other, and nothing is shared. No gate is behind it if either ends there.
fn shared_stretch(lanes: &[Side<'_>; 2]) -> Option<(Shared, [Option<Bounds>; 2])> {
    let [a, b] = lanes;
    let run = longest_run((a.corridor, a.slices), (b.corridor, b.slices))?;
    let runs = [run.rows, run.columns];
    let clear_m = a.course.longest_m() + 2.0;
    let length_m = a.corridor[run.rows[1]].along_m - a.corridor[run.rows[0]].along_m;
    let starts = [0, 1].map(|k| lanes[k].starts_with(runs[k][0]));
    if length_m < 2.0 * clear_m + 10.0 || starts[0] != starts[1] {
        return None;
    }
    let first = [0, 1].map(|k| &lanes[k].corridor[runs[k][0]]);
    let from_m = [
        first[0].along_m,
        first[1].along_m + beyond_m(first[0], first[1]),
    ];
    let ends = (0..2).any(|k| lanes[k].ends_with(runs[k][1]));
    let whole = [0, 1].map(|k| lanes[k].whole());
    let before = [0, 1].map(|k| [whole[k][0], from_m[k] + clear_m]);
    let behind = [0, 1].map(|k| [from_m[k] + length_m - clear_m, whole[k][1]]);
    let shared = Shared {
        lanes: [a.lane, b.lane],
        from_m,
        length_m,
    };
    Some((
        shared,
        [(!starts[0]).then_some(before), (!ends).then_some(behind)],
    ))
}

/// A stretch of one corridor and a stretch of another that come too near to each other, by their first and last slices.
#[derive(Clone, Copy)]
struct Meeting {
    rows: [usize; 2],
    columns: [usize; 2],
}

impl Meeting {
    fn touches(&self, other: &Self) -> bool {
        let near = |a: [usize; 2], b: [usize; 2]| a[0] <= b[1] + 2 && b[0] <= a[1] + 2;
        near(self.rows, other.rows) && near(self.columns, other.columns)
    }

    fn join(&mut self, other: &Self) {
        let hull = |a: [usize; 2], b: [usize; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        self.rows = hull(self.rows, other.rows);
        self.columns = hull(self.columns, other.columns);
    }
}

/// All meetings of two corridors; of a corridor with itself, if its lane is given, those of its different branches.
fn meetings(rows: &[Slice], columns: &[Slice], own: Option<&Course>) -> Vec<Meeting> {
    let mut found: Vec<Meeting> = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        for (j, column) in columns.iter().enumerate() {
            let reach_m = row.half_m + column.half_m;
            let apart = (row.middle - column.middle).norm_squared() >= reach_m * reach_m;
            let same = own.is_some_and(|lane| {
                let ahead_m = lane.ahead_m(row.along_m, column.along_m);
                let round_m = lane.ahead_m(column.along_m, row.along_m);
                // Each pair once, and no place with itself.
                j <= i
                    || ahead_m.is_some_and(|d| d < OWN_BRANCH_M)
                    || round_m.is_some_and(|d| d < OWN_BRANCH_M)
            });
            if apart || same {
                continue;
            }
            let here = Meeting {
                rows: [i, i],
                columns: [j, j],
            };
            match found.iter_mut().find(|meeting| meeting.touches(&here)) {
                Some(meeting) => meeting.join(&here),
                None => found.push(here),
            }
        }
    }
    joined(found)
}

/// Joins what touches until nothing does.
fn joined(found: Vec<Meeting>) -> Vec<Meeting> {
    let mut apart: Vec<Meeting> = Vec::with_capacity(found.len());
    for mut meeting in found {
        while let Some(i) = apart.iter().position(|other| other.touches(&meeting)) {
            meeting.join(&apart.swap_remove(i));
        }
        apart.push(meeting);
    }
    apart
}

/// The gates of one crossing, and which part of it leads over each.
pub(super) fn crossing(
    crossing: &Crossing,
    courses: &[Course],
    gates: &mut Vec<Gate>,
) -> Vec<Span> {
    let [from, to] = crossing.ends.map(Vector2::from);
    let (heading_rad, length_m) = (angle(to - from), (to - from).norm());
    let half_m = crossing.width_m.max(NARROWEST_CROSSING_M) / 2.0;
    let mut spans = Vec::new();
    for (lane, course) in courses.iter().enumerate() {
        let corridor = course.corridor();
        let over = |slice: &Slice| {
            let [along_m, left_m] = beside(from, heading_rad, slice.middle);
            let reach_m = slice.half_m + BESIDE_PEOPLE_M;
            left_m.abs() < reach_m + half_m && along_m > -reach_m && along_m < length_m + reach_m
        };
        for run in corridor.chunk_by(|a, b| over(a) == over(b)) {
            let (Some(first), Some(last)) = (run.first(), run.last()) else {
                continue;
            };
            if !over(first) {
                continue;
            }
            let (mut from_m, mut to_m) = (f64::INFINITY, f64::NEG_INFINITY);
            for slice in run {
                let [along_m, _] = beside(from, heading_rad, slice.middle);
                from_m = from_m.min(along_m - slice.half_m - BESIDE_PEOPLE_M);
                to_m = to_m.max(along_m + slice.half_m + BESIDE_PEOPLE_M);
            }
            spans.push(Span {
                gate: gates.len(),
                from_m,
                to_m,
            });
            gates.push(Gate {
                lane,
                start_m: first.along_m - SLICE_M,
                end_m: last.along_m + SLICE_M,
                kind: GateKind::Crossing,
            });
        }
    }
    spans
}

/// The gates of signals; those of lanes that are not there, or without a cycle, are left out.
pub(super) fn signals(signals: &[Signal], courses: &[Course], gates: &mut Vec<Gate>) {
    for signal in signals {
        let exists = courses
            .get(signal.lane)
            .is_some_and(|course| (0.0..=course.length_m()).contains(&signal.at_m));
        if exists && signal.cycle_s > 0.0 {
            gates.push(Gate {
                lane: signal.lane,
                start_m: signal.at_m,
                end_m: signal.at_m,
                kind: GateKind::Signal(*signal),
            });
        }
    }
}

impl Signal {
    /// Whether vehicles may pass.
    pub fn is_green(&self, now_s: f64) -> bool {
        (now_s - self.green_from_s).rem_euclid(self.cycle_s) < self.green_for_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traffic::{Agents, Lane, Path};

    /// The gates of two lanes for cars, and what these share.
    fn between(lanes: [&[[f64; 2]]; 2]) -> (Vec<Gate>, Vec<Shared>) {
        let agents = Agents {
            cars: 1,
            ..Agents::default()
        };
        let course = |points| {
            let lane = Lane {
                path: Path::open(points, 8.0),
                width_m: 3.5,
                speed_limit_mps: 14.0,
            };
            Course::new(&lane, &agents)
        };
        let mut gates = Vec::new();
        let shared = junctions(&lanes.map(course), &mut gates);
        (gates, shared)
    }

    const STREET: &[[f64; 2]] = &[[-100.0, 0.0], [100.0, 0.0]];

    #[test]
    fn lanes_that_cross_have_rival_gates_there() {
        let (gates, shared) = between([STREET, &[[20.0, -50.0], [20.0, 50.0]]]);
        assert!(shared.is_empty() && gates.len() == 2);
        for (gate, expected_m) in gates.iter().zip([120.0, 50.0]) {
            let [before_m, behind_m] = [expected_m - gate.start_m, gate.end_m - expected_m];
            // Two halves of 1.8 m, margins, and up to two metres of rounding.
            assert!(
                (2.0..4.5).contains(&before_m) && (2.0..4.5).contains(&behind_m),
                "{gate:?}"
            );
        }
    }

    #[test]
    fn lanes_side_by_side_have_no_gates() {
        let (gates, shared) = between([STREET, &[[100.0, 3.5], [-100.0, 3.5]]]);
        assert!(gates.is_empty() && shared.is_empty());
    }

    #[test]
    fn a_lane_that_turns_into_another_shares_it_behind_a_gate() {
        let (gates, shared) = between([STREET, &[[20.0, -50.0], [20.0, 0.0], [100.0, 0.0]]]);
        assert_eq!((gates.len(), shared.len()), (2, 1));
        // The arc ends 8 m behind the corner; 0.2 m aside of the street is near enough.
        assert!((124.0..129.0).contains(&shared[0].from_m[0]), "{shared:?}");
        assert!((71.0..78.0).contains(&shared[0].length_m), "{shared:?}");
        assert!(gates[0].end_m < 140.0, "{gates:?}");
    }
}
