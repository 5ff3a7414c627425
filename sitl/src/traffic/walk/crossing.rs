//! How people cross the road.
//!
//! They go to the kerb, to the right of those who come over; wait there until no vehicle holds a gate of the crossing
//! (and, where vehicles have priority, until there is a gap that is long enough); and go. From that moment the gates
//! are closed, each until they are past it.

use nalgebra::Vector2;
use rand::RngExt as _;

use super::{Crowd, INSIDE_M, Intent};
use crate::traffic::Priority;
use crate::traffic::course::beside;
use crate::traffic::path::{angle, direction, left_of};
use crate::traffic::road::Road;

/// How many of those who pass a crossing use it.
const SHARE_WHO_CROSS: f64 = 0.4;
/// Crossings are noticed from here.
const NOTICED_M: f64 = 4.0;
/// Who does not get to the kerb, or over the road, within this time walks on.
const PATIENCE_S: f64 = 30.0;
/// Who was let go but does not get off the kerb within this time waits again.
const HELD_UP_S: f64 = 6.0;
/// Where vehicles have priority people are over the road so long before the next one.
const GAP_S: f64 = 2.0;
/// Someone is off the crossing when they are so far beyond its end.
const BEYOND_M: f64 = INSIDE_M;
/// Changing from one way to another may move someone by this much.
const SEAM_M: f64 = 0.02;

/// One end of a crossing.
pub(super) struct Kerb {
    pub(super) walkway: usize,
    /// Where it is along the walkway.
    pub(super) along_m: f64,
    pub(super) at: Vector2<f64>,
}

/// Over a crossing, from one of its ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Leg {
    pub(super) crossing: usize,
    /// Where it begins, 0 or 1.
    pub(super) end: usize,
}

impl Leg {
    /// 1 along the crossing, -1 against it.
    fn forward(self) -> f64 {
        if self.end == 0 { 1.0 } else { -1.0 }
    }
}

impl Crowd {
    /// Which gates people on foot keep closed now.
    pub(in crate::traffic) fn closed(&mut self, road: &Road) -> &[bool] {
        self.closed.clear();
        self.closed.resize(road.gate_count(), false);
        for walker in &self.walkers {
            match walker.intent {
                Intent::Wait { leg, .. } => {
                    if self.priorities[leg.crossing] == Priority::Pedestrians {
                        for span in road.spans(leg.crossing) {
                            self.closed[span.gate] = true;
                        }
                    }
                }
                Intent::Cross { leg, .. } => {
                    let [along_m, _] = self.on_crossing(leg.crossing, walker.at);
                    for span in road.spans(leg.crossing) {
                        let past = if leg.end == 0 {
                            along_m > span.to_m
                        } else {
                            along_m < span.from_m
                        };
                        self.closed[span.gate] |= !past;
                    }
                }
                Intent::Stroll | Intent::Pause { .. } | Intent::Approach { .. } => {}
            }
        }
        &self.closed
    }

    /// Sometimes someone who comes to a crossing wants to cross.
    pub(super) fn consider_crossing(&mut self, i: usize, now_s: f64) {
        let walker = &self.walkers[i];
        let path = &self.ways[walker.way].path;
        let mut noticed = None;
        for (crossing, kerbs) in self.kerbs.iter().enumerate() {
            for (end, kerb) in kerbs.iter().flatten().enumerate() {
                let mut ahead_m = (kerb.along_m - walker.along_m) * walker.forward;
                if path.is_closed() {
                    ahead_m = ahead_m.rem_euclid(path.length_m());
                }
                let here = kerb.walkway == walker.way && (0.0..NOTICED_M).contains(&ahead_m);
                if here && !walker.passed.contains(&crossing) {
                    noticed = Some(Leg { crossing, end });
                }
            }
        }
        let kerbs = &self.kerbs;
        let walker = &mut self.walkers[i];
        // Far from a crossing, it may be chosen again.
        walker.passed.retain(|&crossing| {
            let mut ends = kerbs[crossing].iter().flatten();
            ends.any(|kerb| (kerb.at - walker.at).norm() < 3.0 * NOTICED_M)
        });
        if let Some(leg) = noticed {
            walker.passed.push(leg.crossing);
            if self.random.random_bool(SHARE_WHO_CROSS) {
                let limit_m = self.ways[self.walkways + leg.crossing].limit_m;
                let right_m = self.random.random_range(0.3..=limit_m.max(0.4));
                walker.keep_m = -leg.forward() * right_m;
                walker.stuck_s = 0.0;
                walker.intent = Intent::Approach {
                    leg,
                    since_s: now_s,
                };
            }
        }
    }

    /// On the way to the kerb.
    pub(super) fn approach(&mut self, i: usize, leg: Leg, now_s: f64, since_s: f64) {
        let away_m = (self.spot(i, leg) - self.walkers[i].at).norm();
        let stuck_s = self.walkers[i].stuck_s;
        if away_m < 0.3 || (away_m < 1.5 && stuck_s > 1.0) {
            self.walkers[i].intent = Intent::Wait {
                leg,
                since_s: now_s,
            };
        } else if now_s - since_s > PATIENCE_S || stuck_s > 2.0 * super::TURN_BACK_S {
            self.stroll_on(i);
        }
    }

    /// At the kerb.
    pub(super) fn wait(&mut self, i: usize, leg: Leg, [now_s, since_s]: [f64; 2], road: &Road) {
        if now_s - since_s > PATIENCE_S {
            self.stroll_on(i);
        } else if now_s - since_s > 0.5 && self.may_go(i, leg, road) {
            self.walkers[i].intent = Intent::Cross {
                leg,
                since_s: now_s,
            };
        }
    }

    fn may_go(&self, i: usize, leg: Leg, road: &Road) -> bool {
        let walker = &self.walkers[i];
        let [along_m, _] = self.on_crossing(leg.crossing, walker.at);
        road.spans(leg.crossing).iter().all(|span| {
            let way_m = if leg.end == 0 {
                span.to_m - along_m
            } else {
                along_m - span.from_m
            };
            let gap_s = way_m.max(0.0) / walker.speed_mps + GAP_S;
            let yields = self.priorities[leg.crossing] == Priority::Pedestrians;
            !road.is_held(span.gate) && (yields || road.arrives_in_s(span.gate) > gap_s)
        })
    }

    /// Between one walkway and the next.
    pub(super) fn cross(&mut self, i: usize, leg: Leg, now_s: f64, since_s: f64) {
        let way = self.walkways + leg.crossing;
        let [along_m, left_m] = self.on_crossing(leg.crossing, self.walkers[i].at);
        if self.walkers[i].way != way {
            if left_m.abs() <= self.ways[way].limit_m {
                let walker = &mut self.walkers[i];
                (walker.way, walker.along_m, walker.left_m) = (way, along_m, left_m);
                walker.forward = leg.forward();
            } else if now_s - since_s > HELD_UP_S {
                self.walkers[i].intent = Intent::Wait {
                    leg,
                    since_s: now_s,
                };
            }
            return;
        }
        let length_m = self.ways[way].path.length_m();
        let beyond_m = if leg.end == 0 {
            along_m - length_m
        } else {
            -along_m
        };
        if beyond_m > BEYOND_M {
            self.arrive(i, leg, beyond_m);
        }
    }

    /// From the crossing to the walkway behind it, where the two fit.
    fn arrive(&mut self, i: usize, leg: Leg, beyond_m: f64) {
        let Some(kerb) = self.kerbs[leg.crossing]
            .as_ref()
            .map(|ends| &ends[1 - leg.end])
        else {
            return;
        };
        let (walkway, at) = (kerb.walkway, self.walkers[i].at);
        let path = &self.ways[walkway].path;
        let nearest = path.nearest(at.into());
        let there: Vector2<f64> = path.at(nearest.along_m).to_the_left(nearest.left_m).into();
        let fits = (there - at).norm() < SEAM_M || beyond_m > 5.0 * BEYOND_M;
        if fits && self.is_free(i, there) {
            let walker = &mut self.walkers[i];
            walker.way = walkway;
            walker.at = there;
            (walker.along_m, walker.left_m) = (nearest.along_m, nearest.left_m);
            self.stroll_on(i);
        }
    }

    /// Along the walkway, either way.
    fn stroll_on(&mut self, i: usize) {
        let limit_m = self.ways[self.walkers[i].way].limit_m;
        let walker = &mut self.walkers[i];
        walker.intent = Intent::Stroll;
        walker.stuck_s = 0.0;
        walker.forward = if self.random.random_bool(0.5) {
            1.0
        } else {
            -1.0
        };
        walker.keep_m = self.random.random_range(-1.0..=1.0) * limit_m;
    }

    /// Where on the walkway someone waits for their turn.
    pub(super) fn spot(&self, i: usize, leg: Leg) -> Vector2<f64> {
        let walker = &self.walkers[i];
        let Some(kerb) = self.kerbs[leg.crossing].as_ref().map(|ends| &ends[leg.end]) else {
            return walker.at;
        };
        let inward_rad = self.inward_rad(leg);
        let aside = left_of(inward_rad) * (leg.forward() * walker.keep_m);
        let way = &self.ways[kerb.walkway];
        let nearest = way.path.nearest((kerb.at + aside).into());
        let left_m = nearest.left_m.clamp(-way.limit_m, way.limit_m);
        way.path.at(nearest.along_m).to_the_left(left_m).into()
    }

    /// Where someone takes the first step onto the crossing.
    pub(super) fn entry(&self, i: usize, leg: Leg) -> Vector2<f64> {
        let walker = &self.walkers[i];
        let crossing = self.walkways + leg.crossing;
        let start_m = if leg.end == 0 {
            0.0
        } else {
            self.ways[crossing].path.length_m()
        };
        let way = &self.ways[crossing];
        let keep_m = walker.keep_m.clamp(-0.8 * way.limit_m, 0.8 * way.limit_m);
        way.path.at(start_m).to_the_left(keep_m).into()
    }

    /// Over the road, as seen from where a leg begins.
    pub(super) fn inward_rad(&self, leg: Leg) -> f64 {
        let path = &self.ways[self.walkways + leg.crossing].path;
        let along_rad = path.at(0.0).heading_rad;
        angle(direction(along_rad) * leg.forward())
    }

    /// A place by its distance along a crossing from its first end, and to its left.
    fn on_crossing(&self, crossing: usize, at: Vector2<f64>) -> [f64; 2] {
        let start = self.ways[self.walkways + crossing].path.at(0.0);
        beside(Vector2::new(start.x, start.y), start.heading_rad, at)
    }
}
