//! People on foot: they stroll along walkways, pause, and now and then cross the road.
//!
//! Someone's place is kept by distance along their way and to its left, so that they cannot leave it: a *way* is a
//! walkway, or a crossing from end to end. Where they step is chosen by [`avoid`] every 0.2 s. A step that would bring
//! them within [`NEAREST_M`] of someone else, or into something, is shortened or not taken; so if all are apart at the
//! start, all remain apart.

mod crossing;
mod populate;

use nalgebra::Vector2;
use rand::RngExt as _;
use rand_pcg::Pcg64;

use super::avoid::{self, BODY_M, Edges, Neighbour, SIGHT_M, View};
use super::path::{Path, angle, direction, left_of, wrapped};
use super::road::Road;
use super::track::{State, Track};
use super::{Kind, Obstacle, Priority, STEP_S};

use crossing::{Kerb, Leg};

/// Feet stay so far inside the edge of their way.
const INSIDE_M: f64 = 0.3;
/// Nobody comes nearer to another, from middle to middle.
const NEAREST_M: f64 = 2.0 * BODY_M;
/// How far ahead on their way people aim.
const AIM_M: f64 = 2.5;
/// Time in which someone takes up another speed.
const RELAXATION_S: f64 = 0.4;
/// They could stop within this time (τ).
const REACTION_S: f64 = 0.5;
/// They choose their direction once in so many steps.
const CHOOSE_EVERY: usize = 4;
/// How fast someone turns round at most, in rad/s, and the time constant of smaller turns.
const TURN_RADPS: f64 = 4.0;
const TURN_S: f64 = 0.2;
/// Mean time from one pause to the next.
const PAUSE_EVERY_S: f64 = 50.0;
/// Who has been stuck for this long looks all round for a way, and after the longer time turns back.
const LOOK_ROUND_S: f64 = 1.0;
const TURN_BACK_S: f64 = 4.0;

/// Everyone on foot.
pub(super) struct Crowd {
    /// The walkways, then the crossings.
    ways: Vec<Way>,
    walkways: usize,
    priorities: Vec<Priority>,
    /// Both ends of each crossing; none of one that leads nowhere.
    kerbs: Vec<Option<[Kerb; 2]>>,
    obstacles: Vec<Obstacle>,
    walkers: Vec<Walker>,
    closed: Vec<bool>,
    steps: usize,
    random: Pcg64,
}

/// Where one walks.
struct Way {
    path: Path,
    /// How far to the left or right of its middle feet may be.
    limit_m: f64,
}

struct Walker {
    seed: u32,
    size_m: [f64; 3],
    way: usize,
    along_m: f64,
    left_m: f64,
    /// 1 along the way, -1 against it.
    forward: f64,
    /// Where across the way they like to be.
    keep_m: f64,
    speed_mps: f64,
    at: Vector2<f64>,
    velocity: Vector2<f64>,
    /// Where they step, and how fast.
    chosen: Vector2<f64>,
    heading_rad: f64,
    travelled_m: f64,
    stuck_s: f64,
    intent: Intent,
    /// The crossings near by that they have passed or used.
    passed: Vec<usize>,
}

/// What someone is about.
#[derive(Clone, Copy, Debug)]
enum Intent {
    Stroll,
    Pause {
        until_s: f64,
    },
    /// Going to the kerb.
    Approach {
        leg: Leg,
        since_s: f64,
    },
    /// Standing at the kerb.
    Wait {
        leg: Leg,
        since_s: f64,
    },
    /// Crossing, or about to take the first step: vehicles have stopped.
    Cross {
        leg: Leg,
        since_s: f64,
    },
}

/// Where someone wants to go.
struct Aim {
    target: Vector2<f64>,
    speed_mps: f64,
    /// Whether they keep clear of the edges of their way. Not where they go to the kerb.
    minds_edges: bool,
}

impl Crowd {
    /// An empty track for each of them.
    pub(super) fn tracks(&self) -> Vec<Track> {
        let track = |w: &Walker| Track::new(Kind::Pedestrian, w.seed, w.size_m);
        self.walkers.iter().map(track).collect()
    }

    /// Adds where everyone is to their tracks.
    pub(super) fn record(&self, tracks: &mut [Track]) {
        for (walker, track) in self.walkers.iter().zip(tracks) {
            track.push(Some(State {
                position: walker.at.into(),
                heading_rad: walker.heading_rad,
                speed_mps: walker.velocity.norm(),
                travelled_m: walker.travelled_m,
            }));
        }
    }

    /// Lets everyone walk for [`STEP_S`].
    pub(super) fn step(&mut self, now_s: f64, road: &Road) {
        self.steps += 1;
        for i in 0..self.walkers.len() {
            self.decide(i, now_s, road);
            if (self.steps + i).is_multiple_of(CHOOSE_EVERY) {
                self.walkers[i].chosen = self.choose(i);
            }
            self.walk(i);
            self.turn(i);
        }
    }

    fn decide(&mut self, i: usize, now_s: f64, road: &Road) {
        match self.walkers[i].intent {
            Intent::Stroll => self.stroll(i, now_s),
            Intent::Pause { until_s } => {
                if now_s >= until_s {
                    self.walkers[i].intent = Intent::Stroll;
                }
            }
            Intent::Approach { leg, since_s } => self.approach(i, leg, now_s, since_s),
            Intent::Wait { leg, since_s } => self.wait(i, leg, [now_s, since_s], road),
            Intent::Cross { leg, since_s } => self.cross(i, leg, now_s, since_s),
        }
    }

    fn stroll(&mut self, i: usize, now_s: f64) {
        let way = &self.ways[self.walkers[i].way];
        let (length_m, limit_m) = (way.path.length_m(), way.limit_m);
        let walker = &mut self.walkers[i];
        let at_end = !way.path.is_closed()
            && ((walker.forward > 0.0 && walker.along_m > length_m - 0.6)
                || (walker.forward < 0.0 && walker.along_m < 0.6));
        if at_end || walker.stuck_s > TURN_BACK_S {
            walker.forward = -walker.forward;
            walker.stuck_s = 0.0;
            walker.keep_m = self.random.random_range(-1.0..=1.0) * limit_m;
        } else if limit_m > 0.6 && self.random.random_bool(STEP_S / PAUSE_EVERY_S) {
            let until_s = now_s + self.random.random_range(2.0..8.0);
            walker.intent = Intent::Pause { until_s };
        } else if (self.steps + i).is_multiple_of(CHOOSE_EVERY) {
            self.consider_crossing(i, now_s);
        }
    }

    /// Where someone wants to go now; nowhere if they stand.
    fn aim(&self, i: usize) -> Option<Aim> {
        let walker = &self.walkers[i];
        let way = &self.ways[walker.way];
        let along_way = |speed_mps: f64| {
            let ahead = way
                .path
                .at_or_beyond(walker.along_m + walker.forward * AIM_M);
            Aim {
                target: ahead.to_the_left(walker.keep_m).into(),
                speed_mps,
                minds_edges: true,
            }
        };
        match walker.intent {
            Intent::Pause { .. } | Intent::Wait { .. } => None,
            Intent::Stroll => Some(along_way(walker.speed_mps)),
            Intent::Approach { leg, .. } => {
                let target = self.spot(i, leg);
                // Slower over the last steps.
                let slow_mps = (target - walker.at).norm() / 0.7;
                Some(Aim {
                    target,
                    speed_mps: walker.speed_mps.min(slow_mps),
                    minds_edges: false,
                })
            }
            Intent::Cross { leg, .. } => {
                // Nobody dawdles on the road.
                let speed_mps = walker.speed_mps * 1.15;
                if walker.way >= self.walkways {
                    return Some(along_way(speed_mps));
                }
                Some(Aim {
                    target: self.entry(i, leg),
                    speed_mps,
                    minds_edges: false,
                })
            }
        }
    }

    /// The velocity someone takes up.
    fn choose(&self, i: usize) -> Vector2<f64> {
        let Some(aim) = self.aim(i) else {
            return Vector2::zeros();
        };
        let walker = &self.walkers[i];
        let way = &self.ways[walker.way];
        let near = |other: &Walker| (other.at - walker.at).norm_squared() < SIGHT_M * SIGHT_M;
        let neighbours: Vec<Neighbour> = self
            .walkers
            .iter()
            .enumerate()
            .filter(|&(j, other)| j != i && near(other))
            .map(|(_, other)| Neighbour {
                at: other.at,
                velocity: other.velocity,
            })
            .collect();
        let obstacles: Vec<Obstacle> = self
            .obstacles
            .iter()
            .filter(|obstacle| obstacle.distance_m(walker.at.into()) < SIGHT_M)
            .copied()
            .collect();
        let choice = avoid::choose(&View {
            at: walker.at,
            wanted_rad: angle(aim.target - walker.at),
            speed_mps: walker.speed_mps,
            neighbours: &neighbours,
            obstacles: &obstacles,
            edges: aim.minds_edges.then(|| Edges {
                heading_rad: way.path.at(walker.along_m).heading_rad,
                room_m: [way.limit_m - walker.left_m, way.limit_m + walker.left_m],
            }),
            stuck: walker.stuck_s > LOOK_ROUND_S,
        });
        direction(choice.heading_rad) * aim.speed_mps.min(choice.free_m / REACTION_S)
    }

    /// One step, as long as it may be.
    fn walk(&mut self, i: usize) {
        let walker = &self.walkers[i];
        // Who has to turn first hardly moves until they face their way.
        let aside_rad = angle(walker.chosen) - walker.heading_rad;
        let wanted = walker.chosen * aside_rad.cos().max(0.1);
        let velocity = walker.velocity + (wanted - walker.velocity) * (STEP_S / RELAXATION_S);
        let step = [1.0, 0.6, 0.3]
            .iter()
            .map(|share| self.moved(walker, velocity * *share))
            .find(|&(_, _, at)| self.is_free(i, at));
        let wants = walker.chosen.norm() > 0.1 || self.aim(i).is_some();
        let walker = &mut self.walkers[i];
        let before = walker.at;
        if let Some((along_m, left_m, at)) = step {
            (walker.along_m, walker.left_m, walker.at) = (along_m, left_m, at);
        }
        let moved = walker.at - before;
        walker.velocity = moved / STEP_S;
        walker.travelled_m += moved.norm();
        let slow = moved.norm() < 0.15 * walker.speed_mps * STEP_S;
        walker.stuck_s = if wants && slow {
            walker.stuck_s + STEP_S
        } else {
            (walker.stuck_s - 0.5 * STEP_S).max(0.0)
        };
    }

    /// Where a step with that velocity leads: along the way, to its left, and on the ground.
    fn moved(&self, walker: &Walker, velocity: Vector2<f64>) -> (f64, f64, Vector2<f64>) {
        let way = &self.ways[walker.way];
        let heading_rad = way.path.at_or_beyond(walker.along_m).heading_rad;
        // On the inside of a bend a step leads farther along the way than on its outside.
        let stretch = (1.0 - way.path.curvature_per_m(walker.along_m) * walker.left_m).max(0.3);
        let mut along_m = walker.along_m + velocity.dot(&direction(heading_rad)) * STEP_S / stretch;
        if walker.way < self.walkways {
            let length_m = way.path.length_m();
            along_m = if way.path.is_closed() {
                along_m.rem_euclid(length_m)
            } else {
                along_m.clamp(0.0, length_m)
            };
        }
        // Who comes from a crossing may still be at the edge, but not go farther out.
        let most_m = way.limit_m.max(walker.left_m.abs());
        let left_m = walker.left_m + velocity.dot(&left_of(heading_rad)) * STEP_S;
        let left_m = left_m.clamp(-most_m, most_m);
        let at = way.path.at_or_beyond(along_m).to_the_left(left_m);
        (along_m, left_m, at.into())
    }

    /// Whether someone can be there: not too near to anyone or anything, or at least no nearer than before.
    fn is_free(&self, i: usize, at: Vector2<f64>) -> bool {
        let before = self.walkers[i].at;
        // Where a bend folds the inside of a way, no step leads across the fold.
        let is_step = (at - before).norm() < 0.2;
        let others = self.walkers.iter().enumerate();
        let mut others = others.filter(|&(j, _)| j != i);
        let mut obstacles = self.obstacles.iter();
        is_step
            && others.all(|(_, other)| (at - other.at).norm_squared() >= NEAREST_M * NEAREST_M)
            && obstacles.all(|obstacle| {
                let distance_m = obstacle.distance_m(at.into());
                distance_m >= BODY_M || distance_m >= obstacle.distance_m(before.into())
            })
    }

    /// Turns someone to where they step, or over the road while they wait there.
    fn turn(&mut self, i: usize) {
        let walker = &self.walkers[i];
        let wanted_rad = match walker.intent {
            Intent::Wait { leg, .. } => self.inward_rad(leg),
            _ if walker.chosen.norm() > 0.2 => angle(walker.chosen),
            _ => walker.heading_rad,
        };
        let most_rad = TURN_RADPS * STEP_S;
        let turn_rad = wrapped(wanted_rad - walker.heading_rad) * (STEP_S / TURN_S);
        self.walkers[i].heading_rad += turn_rad.clamp(-most_rad, most_rad);
    }
}
