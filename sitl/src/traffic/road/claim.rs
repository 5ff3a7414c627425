//! Who may pass a gate.
//!
//! A vehicle claims a gate as late as it can still stop before it in comfort, and holds it until its tail is out. It
//! claims only if
//!
//! - the gate is open: no rival is held by another, nobody on foot keeps it closed, the signal is green;
//! - behind it there is room, even if the one ahead brakes now;
//! - the same is true of every further gate before which it could not stop clear of this one.
//!
//! So who holds a gate leaves it without waiting for anyone who waits for them, and nobody is locked in. Of two who
//! wait for each other's gates, the one who has waited longer goes first.

use super::{Held, Road, Vehicle, Waiting};
use crate::traffic::gate::GateKind;

/// The line of a gate is so far before it.
const LINE_M: f64 = 1.0;
/// Braking that nobody minds, in m/s².
const COMFORTABLE_MPS2: f64 = 2.5;
/// After this long, those who came later leave the way to who waits. But once in so long, for this long, they do not:
/// who waits may wait for room that only they can make.
const PATIENCE_S: f64 = 4.0;
const COURTESY_S: f64 = 20.0;
/// A closed gate is not minded from beyond the braking distance at this deceleration, in m/s².
const ANTICIPATION_MPS2: f64 = 1.0;

/// A gate before a vehicle, by distances from its nose.
#[derive(Clone, Copy)]
struct Ahead {
    gate: usize,
    line_m: f64,
    end_m: f64,
}

impl Road {
    /// How far a vehicle may go until the line of a gate it does not hold, after it has claimed what it needs. `None`
    /// if nothing stops it within sight.
    pub(super) fn distance_to_stop(
        &mut self,
        i: usize,
        now_s: f64,
        closed: &[bool],
    ) -> Option<f64> {
        let ahead = self.gates_ahead(i);
        let mut rest = ahead.as_slice();
        while let Some(first) = rest.first() {
            let length_m = self.vehicles[i].length_m();
            // Joined are gates before which it could not stop clear of the last one.
            let mut end_m = first.end_m;
            let joined = rest
                .iter()
                .take_while(|next| {
                    let joins = next.line_m <= first.line_m || next.line_m < end_m + length_m;
                    end_m = if joins { end_m.max(next.end_m) } else { end_m };
                    joins
                })
                .count();
            let (chain, further) = rest.split_at(joined);
            let open = chain
                .iter()
                .all(|next| self.is_open(i, next.gate, now_s, closed));
            let vehicle = &self.vehicles[i];
            if first.line_m > self.claims_within_m(vehicle, first.gate) {
                let minds_m = braking_m(vehicle.speed_mps, ANTICIPATION_MPS2) + 5.0;
                let shut = self.is_shut(first.gate, now_s, closed);
                return (shut && first.line_m < minds_m).then_some(first.line_m.max(0.0));
            }
            if !open || !self.has_room(i, chain, end_m) {
                self.wait(i, chain, now_s, open);
                return Some(first.line_m.max(0.0));
            }
            for next in chain {
                self.claim(i, next);
            }
            rest = further;
        }
        None
    }

    /// Whether a vehicle holds the gate.
    pub(in crate::traffic) fn is_held(&self, gate: usize) -> bool {
        !self.holders[gate].is_empty()
    }

    /// When the first vehicle could be at the gate, from now, in seconds.
    pub(in crate::traffic) fn arrives_in_s(&self, gate: usize) -> f64 {
        let lane = self.gates[gate].lane;
        self.members[lane]
            .iter()
            .filter(|&&i| self.vehicles[i].drives())
            .filter_map(|&i| {
                let ahead = self.gates_ahead(i).into_iter().find(|a| a.gate == gate)?;
                // It may be about to speed up.
                Some(ahead.line_m / (self.vehicles[i].speed_mps + 1.0).max(3.0))
            })
            .fold(f64::INFINITY, f64::min)
    }

    /// Gives back the gates that a vehicle has left.
    pub(super) fn let_go(&mut self, i: usize) {
        let vehicle = &mut self.vehicles[i];
        let (drives, travelled_m) = (vehicle.drives(), vehicle.travelled_m);
        let holders = &mut self.holders;
        vehicle.held.retain(|held| {
            let keeps = drives && travelled_m < held.until_m;
            if !keeps {
                holders[held.gate].retain(|&holder| holder != i);
            }
            keeps
        });
        if !drives {
            vehicle.waiting = None;
        }
    }

    /// Claims the gates that a vehicle stands in as it comes in at the start of an open lane; if it cannot, it has
    /// none.
    pub(super) fn enters_gates(&mut self, i: usize, now_s: f64, closed: &[bool]) -> bool {
        let inside = self.gates_inside(i);
        let free = inside
            .iter()
            .all(|next| self.is_open(i, next.gate, now_s, closed));
        if free {
            for next in &inside {
                self.claim(i, next);
            }
        }
        free
    }

    /// Distance to the line of the next gate that a vehicle does not hold.
    pub(super) fn nearest_gate_m(&self, i: usize) -> f64 {
        let first = self.gates_ahead(i).first().map(|ahead| ahead.line_m);
        first.map_or(f64::INFINITY, |line_m| line_m.max(0.0))
    }

    /// Gates that a vehicle would touch where it is.
    pub(super) fn touches_gate(&self, i: usize) -> bool {
        let vehicle = &self.vehicles[i];
        let course = &self.courses[vehicle.lane];
        let inside = !self.gates_inside(i).is_empty();
        let around = self.gates_of[vehicle.lane].iter().any(|&gate| {
            // On a closed lane a gate may begin before the start.
            let gate = &self.gates[gate];
            let rear_m = vehicle.along_m - vehicle.length_m() / 2.0;
            let [to_rear_m, extent_m] = [
                rear_m - gate.start_m + LINE_M,
                gate.end_m - gate.start_m + LINE_M,
            ];
            course.path().is_closed() && to_rear_m.rem_euclid(course.length_m()) < extent_m
        });
        inside || around
    }

    fn gates_inside(&self, i: usize) -> Vec<Ahead> {
        let vehicle = &self.vehicles[i];
        let half_m = vehicle.length_m() / 2.0;
        self.gates_of[vehicle.lane]
            .iter()
            .map(|&gate| self.ahead(gate, vehicle.along_m + half_m))
            .filter(|ahead| ahead.line_m < 0.0 && ahead.end_m > -vehicle.length_m())
            .collect()
    }

    /// A gate as seen from a place of its lane, not yet taken round a closed lane.
    fn ahead(&self, gate: usize, from_m: f64) -> Ahead {
        let at = &self.gates[gate];
        Ahead {
            gate,
            line_m: at.start_m - LINE_M - from_m,
            end_m: at.end_m - from_m,
        }
    }

    /// The gates that a vehicle has still to pass and does not hold, the nearest first.
    fn gates_ahead(&self, i: usize) -> Vec<Ahead> {
        let vehicle = &self.vehicles[i];
        let course = &self.courses[vehicle.lane];
        let nose_m = vehicle.along_m + vehicle.length_m() / 2.0;
        let mut ahead: Vec<Ahead> = self.gates_of[vehicle.lane]
            .iter()
            .filter(|&&gate| !vehicle.held.iter().any(|held| held.gate == gate))
            .map(|&gate| self.ahead(gate, nose_m))
            .filter_map(|mut next| {
                if course.path().is_closed() {
                    let extent_m = next.end_m - next.line_m;
                    // Rounding must not put the line behind a nose that is right at it.
                    let round_m = (next.line_m + 0.1).rem_euclid(course.length_m()) - 0.1;
                    next = Ahead {
                        line_m: round_m,
                        end_m: round_m + extent_m,
                        ..next
                    };
                }
                (next.line_m > -0.1).then_some(next)
            })
            .collect();
        ahead.sort_by(|a, b| a.line_m.total_cmp(&b.line_m).then(a.gate.cmp(&b.gate)));
        ahead
    }

    fn claims_within_m(&self, vehicle: &Vehicle, gate: usize) -> f64 {
        let braking_m = braking_m(vehicle.speed_mps, COMFORTABLE_MPS2);
        match self.gates[gate].kind {
            // Early enough not to slow down for a free junction.
            GateKind::Junction { .. } => braking_m + vehicle.speed_mps + 3.0,
            // Late: until then, it gives way to who wants to cross.
            GateKind::Crossing | GateKind::Signal(_) => braking_m + 0.2 * vehicle.speed_mps + 1.0,
        }
    }

    /// Whether people on foot or a signal keep it closed.
    fn is_shut(&self, gate: usize, now_s: f64, closed: &[bool]) -> bool {
        match &self.gates[gate].kind {
            GateKind::Junction { .. } => false,
            GateKind::Crossing => closed.get(gate).copied().unwrap_or(false),
            GateKind::Signal(signal) => !signal.is_green(now_s),
        }
    }

    fn is_open(&self, i: usize, gate: usize, now_s: f64, closed: &[bool]) -> bool {
        let GateKind::Junction { rivals } = &self.gates[gate].kind else {
            return !self.is_shut(gate, now_s, closed);
        };
        rivals.iter().all(|&rival| {
            let free = self.holders[rival].iter().all(|&holder| holder == i);
            free && !self.gives_way(i, rival, now_s)
        })
    }

    /// Whether someone else has waited for a gate for so long that this one lets them go first.
    fn gives_way(&self, i: usize, rival: usize, now_s: f64) -> bool {
        let since = |j: usize| {
            self.vehicles[j]
                .waiting
                .as_ref()
                .map_or(now_s, |w| w.since_s)
        };
        self.members[self.gates[rival].lane].iter().any(|&j| {
            let waits = self.vehicles[j].waiting.as_ref();
            let wants = waits.is_some_and(|waiting| waiting.gates.contains(&rival));
            let first = (since(j), j) < (since(i), i);
            j != i && wants && first && (now_s - since(j)) % COURTESY_S > PATIENCE_S
        })
    }

    fn has_room(&self, i: usize, chain: &[Ahead], end_m: f64) -> bool {
        let vehicle = &self.vehicles[i];
        let only_signals = chain
            .iter()
            .all(|next| matches!(self.gates[next.gate].kind, GateKind::Signal(_)));
        let needed_m = end_m + vehicle.length_m() + vehicle.manner.standstill_gap_m;
        only_signals
            || self.leader(i).is_none_or(|leader| {
                leader.gap_m + braking_m(leader.speed_mps, COMFORTABLE_MPS2) > needed_m
            })
    }

    /// Notes what a vehicle waits for, once it stands and others hold it.
    fn wait(&mut self, i: usize, chain: &[Ahead], now_s: f64, open: bool) {
        let vehicle = &mut self.vehicles[i];
        if !open && vehicle.speed_mps < 1.0 && vehicle.waiting.is_none() {
            vehicle.waiting = Some(Waiting {
                gates: chain.iter().map(|next| next.gate).collect(),
                since_s: now_s,
            });
        }
    }

    fn claim(&mut self, i: usize, next: &Ahead) {
        let vehicle = &mut self.vehicles[i];
        vehicle.waiting = None;
        vehicle.held.push(Held {
            gate: next.gate,
            until_m: vehicle.travelled_m + next.end_m + vehicle.size_m[0],
        });
        self.holders[next.gate].push(i);
    }
}

fn braking_m(speed_mps: f64, braking_mps2: f64) -> f64 {
    speed_mps * speed_mps / (2.0 * braking_mps2)
}
