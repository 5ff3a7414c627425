//! A lane as those who drive on it know it: how fast one may be where, and how much room one sweeps.
//!
//! ```text
//! v(s) ≤ limit      v(s)² ≤ a_lat / κ(s)      v(s)² ≤ v(s + Δs)² + 2·b·Δs
//! ```
//!
//! The last one, from end to start, lets them brake in time for a curve.

use nalgebra::Vector2;

use super::kind::Kind;
use super::path::{Path, Pose2, angle, direction, left_of};
use super::{Agents, Lane};

/// Distance between the places for which a speed is known.
const GRID_M: f64 = 1.0;
/// No curve is too tight to creep through.
const CREEP_MPS: f64 = 0.5;
/// From the middle of a vehicle to its axles, per length.
const AXLE: f64 = 0.3;
/// Longer lanes stay empty: they would not fit into memory.
const LONGEST_M: f64 = 1e5;
/// Free space beside a vehicle that counts as its own.
const MARGIN_M: f64 = 0.1;

/// One lane.
pub(super) struct Course {
    path: Path,
    length_m: f64,
    width_m: f64,
    /// By kind, every [`GRID_M`].
    speeds: [Vec<f64>; 4],
    /// By kind: how far a body reaches beyond its width in the tightest curve.
    swept_m: [f64; 4],
    /// Longest and widest of the kinds in traffic.
    largest: Vector2<f64>,
    has_cyclists: bool,
}

impl Course {
    pub(super) fn new(lane: &Lane, agents: &Agents) -> Self {
        let mut largest = Vector2::zeros();
        for (kind, count) in [
            (Kind::Car, agents.cars),
            (Kind::Truck, agents.trucks),
            (Kind::Bus, agents.buses),
            (Kind::Cyclist, agents.cyclists),
        ] {
            let [length_m, width_m, _] = kind.size_m();
            if count > 0 {
                largest = largest.sup(&Vector2::new(length_m, width_m));
            }
        }
        let path = if lane.path.length_m() <= LONGEST_M {
            lane.path.clone()
        } else {
            Path::open(&[], 0.0)
        };
        let mut course = Self {
            length_m: path.length_m(),
            path,
            width_m: finite(lane.width_m),
            speeds: Default::default(),
            swept_m: [0.0; 4],
            largest,
            has_cyclists: agents.cyclists > 0,
        };
        for kind in Kind::ON_LANES {
            let bends = course.bends(kind);
            let sharpest = bends.iter().copied().fold(0.0, f64::max);
            course.swept_m[kind.index()] = overhang(kind.size_m()[0], sharpest);
            course.speeds[kind.index()] =
                course.profile(kind, &bends, finite(lane.speed_limit_mps));
        }
        course
    }

    /// How sharply that kind turns at each place of the grid, in 1/m, with its axles on the path.
    fn bends(&self, kind: Kind) -> Vec<f64> {
        let places = (self.length_m / GRID_M).ceil() as usize + 1;
        let half_m = (AXLE * kind.size_m()[0]).max(0.5);
        let here: Vec<f64> = (0..places)
            .map(|i| {
                let along_m = i as f64 * GRID_M;
                let turned = self.path.turning_rad(along_m - half_m, along_m + half_m);
                turned / (2.0 * half_m)
            })
            .collect();
        (0..places)
            .map(|i| {
                let near = &here[i.saturating_sub(1)..(i + 2).min(places)];
                near.iter().copied().fold(0.0, f64::max)
            })
            .collect()
    }

    fn profile(&self, kind: Kind, bends: &[f64], limit_mps: f64) -> Vec<f64> {
        let manner = kind.manner();
        let mut speeds: Vec<f64> = bends
            .iter()
            .map(|bend| {
                // Beside the middle a curve is longer or tighter than the path itself.
                let beside = 1.0 + bend * self.left_m(kind).abs();
                let in_curve = (manner.lateral_mps2 / (bend * beside).max(1e-9)).sqrt();
                (limit_mps / beside).min(in_curve.max(CREEP_MPS))
            })
            .collect();
        let places = speeds.len();
        // Round a closed lane twice: a curve behind the start slows those before it.
        let laps = if self.path.is_closed() { 2 } else { 1 };
        for _ in 0..laps {
            if self.path.is_closed() {
                speeds[places - 1] = speeds[places - 1].min(speeds[0]);
            }
            for i in (0..places - 1).rev() {
                let next = speeds[i + 1];
                let braking = (next * next + 2.0 * manner.braking_mps2 * GRID_M).sqrt();
                speeds[i] = speeds[i].min(braking);
            }
        }
        speeds
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Length of the longest vehicle in traffic.
    pub(super) fn longest_m(&self) -> f64 {
        self.largest.x
    }

    /// The top speed of that kind there.
    pub(super) fn speed_mps(&self, kind: Kind, along_m: f64) -> f64 {
        let speeds = &self.speeds[kind.index()];
        let along_m = if self.path.is_closed() {
            along_m.rem_euclid(self.length_m)
        } else {
            along_m.clamp(0.0, self.length_m)
        };
        let i = ((along_m / GRID_M) as usize).min(speeds.len().saturating_sub(2));
        match (speeds.get(i), speeds.get(i + 1)) {
            (Some(from), Some(to)) => from + (to - from) * (along_m / GRID_M - i as f64).min(1.0),
            _ => 0.0,
        }
    }

    /// How far ahead of one place another is; on an open lane `None` if it is behind.
    pub(super) fn ahead_m(&self, from_m: f64, to_m: f64) -> Option<f64> {
        let ahead_m = to_m - from_m;
        if self.path.is_closed() {
            Some(ahead_m.rem_euclid(self.length_m))
        } else {
            (ahead_m >= 0.0).then_some(ahead_m)
        }
    }

    /// Where across the lane that kind keeps.
    pub(super) fn left_m(&self, kind: Kind) -> f64 {
        match kind {
            Kind::Cyclist | Kind::Pedestrian => -(self.width_m / 2.0 - 0.5).max(0.0),
            Kind::Car | Kind::Truck | Kind::Bus | Kind::Robot => 0.0,
        }
    }

    /// How far a body of that kind reaches beyond its width in the tightest curve.
    pub(super) fn swept_m(&self, kind: Kind) -> f64 {
        self.swept_m[kind.index()]
    }

    /// Where a vehicle of that length is when `along_m` along the lane and so far to the left: both axles keep to the
    /// way, as those of a bus do well enough.
    pub(super) fn pose(&self, along_m: f64, left_m: f64, length_m: f64) -> Pose2 {
        let half_m = AXLE * length_m;
        let [rear, front] = [-half_m, half_m].map(|offset_m| {
            let pose = self.path.at_or_beyond(along_m + offset_m);
            Vector2::from(pose.to_the_left(left_m))
        });
        let middle = (rear + front) / 2.0;
        Pose2 {
            x: middle.x,
            y: middle.y,
            heading_rad: angle(front - rear),
        }
    }

    /// The middle of what vehicles sweep there, half its width, and the distance along the lane, every metre from
    /// before the first vehicle's tail to beyond the last one's nose.
    pub(super) fn corridor(&self) -> Vec<Slice> {
        let beyond_m = if self.path.is_closed() || self.length_m <= 0.0 {
            0.0
        } else {
            self.largest.x / 2.0
        };
        let count = ((self.length_m + 2.0 * beyond_m) / GRID_M).ceil() as u32;
        (0..count)
            .map(|i| {
                let along_m = f64::from(i) * GRID_M - beyond_m;
                let pose = self.path.at_or_beyond(along_m);
                let half_m = (self.largest.x / 2.0).max(0.5);
                let bend =
                    self.path.turning_rad(along_m - half_m, along_m + half_m) / (2.0 * half_m);
                let left_m = self.largest.y / 2.0;
                let right_m = if self.has_cyclists {
                    left_m.max(self.width_m / 2.0 - 0.2)
                } else {
                    left_m
                };
                let middle = Vector2::new(pose.x, pose.y)
                    + left_of(pose.heading_rad) * ((left_m - right_m) / 2.0);
                Slice {
                    along_m,
                    middle,
                    heading_rad: pose.heading_rad,
                    half_m: f64::midpoint(left_m, right_m)
                        + overhang(self.largest.x, bend)
                        + MARGIN_M,
                }
            })
            .collect()
    }
}

/// What vehicles sweep at one place of a lane.
pub(super) struct Slice {
    pub(super) along_m: f64,
    pub(super) middle: Vector2<f64>,
    pub(super) heading_rad: f64,
    pub(super) half_m: f64,
}

/// How far the nose of a body of that length reaches out of a curve: the sagitta of its half, less that between its
/// axles, by which its middle is inside.
fn overhang(length_m: f64, bend_per_m: f64) -> f64 {
    let [nose_m, axle_m] = [length_m / 2.0, AXLE * length_m];
    ((nose_m * nose_m - axle_m * axle_m) * bend_per_m / 2.0).min(nose_m)
}

fn finite(x: f64) -> f64 {
    if x.is_finite() { x.max(0.0) } else { 0.0 }
}

/// Whether a straight way leads from `from` in that direction past a point, and where: along it and to its left.
pub(super) fn beside(from: Vector2<f64>, heading_rad: f64, point: Vector2<f64>) -> [f64; 2] {
    let away = point - from;
    [
        away.dot(&direction(heading_rad)),
        away.dot(&left_of(heading_rad)),
    ]
}
