//! Driving a car along a line of waypoints, forwards or backwards: pure pursuit of a point a little way ahead.
//!
//! ```text
//! κ = 2·y / (x² + y²)        (x, y): the point pursued, in the body
//! v ≤ √(2·a·s)               s: distance left to the end of the line, where it has to stop
//! v ≤ √(a_lateral / |κ|)
//! ```
//!
//! The arc through a point behind the car is the same arc, so that one equation steers both ways. A change between
//! forwards and backwards ends one line and starts the next: the car stops there.
//!
//! - R. C. Coulter, *Implementation of the Pure Pursuit Path Tracking Algorithm*, CMU-RI-TR-92-01, 1992.

use maps::frame::{Point, World};
use nalgebra::{Point2, Vector2};

use crate::vehicle::Motion;
use crate::vehicle::rover::Control;

/// Sideways acceleration that is comfortable, m/s².
const LATERAL_MPS2: f64 = 0.6;
/// A line ends when this little is left of it.
const ARRIVED_M: f64 = 0.02;
/// It creeps this fast over the last centimetres.
const CREEP_MPS: f64 = 0.05;

/// How to drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Speed on the straight, m/s.
    pub speed_mps: f64,
    /// Whether to drive backwards.
    pub reverse: bool,
    /// How far ahead to steer.
    pub look_ahead_m: f64,
    /// Loss of speed to count on, m/s².
    pub braking_mps2: f64,
    /// Waypoints within the line count as reached this near.
    pub radius_m: f64,
    /// Tightest turn.
    pub min_turning_radius_m: f64,
}

/// Waypoints in a row that are driven without stopping or changing direction.
#[derive(Clone, Debug)]
pub struct Line {
    /// Where the line starts, then the waypoints.
    points: Vec<Point2<f64>>,
    /// Which waypoint is next, from 1.
    next: usize,
}

/// What came of one step along the line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// What the wheels are to do.
    pub control: Control,
    /// How many waypoints were reached.
    pub reached: usize,
    /// Distance from the line, positive to its left.
    pub cross_track_m: f64,
}

impl Line {
    /// A line from where the car is through the waypoints.
    pub fn new(from: Point<World>, waypoints: impl IntoIterator<Item = Point<World>>) -> Self {
        let points = std::iter::once(from).chain(waypoints).map(|p| p.raw.xy());
        Self {
            points: points.collect(),
            next: 1,
        }
    }

    /// Whether the last waypoint has been reached.
    pub fn is_done(&self) -> bool {
        self.next >= self.points.len()
    }

    /// Distance to the next waypoint, and its bearing counter-clockwise from east.
    pub fn next_waypoint(&self, from: Point<World>) -> Option<(f64, f64)> {
        let to = self.points.get(self.next)? - from.raw.xy();
        Some((to.norm(), to.y.atan2(to.x)))
    }

    /// What to do where the car is now.
    pub fn follow(&mut self, motion: &Motion, style: &Style) -> Progress {
        let here = motion.position().raw.xy();
        let mut reached = 0;
        while self.has_reached(here, style.radius_m) {
            self.next += 1;
            reached += 1;
        }
        if self.is_done() {
            return Progress {
                control: Control::default(),
                reached,
                cross_track_m: 0.0,
            };
        }
        let (along, cross_track_m) = self.project(here);
        let ahead = self.point_at(along + style.look_ahead_m) - here;
        let (sin, cos) = motion.heading_rad().sin_cos();
        let (x, y) = (ahead.x * cos + ahead.y * sin, ahead.y * cos - ahead.x * sin);
        let limit = 1.0 / style.min_turning_radius_m;
        // A goal on the wrong side of the car (ahead when reversing, behind when not) needs a turn, as tight as it gets.
        let wrong_side = (x < 0.0) != style.reverse;
        let pursued = 2.0 * y / ahead.norm_squared().max(1e-6);
        let curvature = if wrong_side {
            limit.copysign(y)
        } else {
            pursued.clamp(-limit, limit)
        };
        let left = (self.left_after(along) - ARRIVED_M / 2.0).max(0.0);
        let speed = style
            .speed_mps
            .min((2.0 * style.braking_mps2 * left).sqrt() + CREEP_MPS)
            .min((LATERAL_MPS2 / curvature.abs().max(1e-6)).sqrt());
        Progress {
            control: Control {
                speed_mps: if style.reverse { -speed } else { speed },
                curvature_per_m: curvature,
            },
            reached,
            cross_track_m,
        }
    }

    /// The current leg, from one waypoint to the next.
    fn leg(&self) -> (Point2<f64>, Vector2<f64>) {
        let from = self.points[self.next - 1];
        (from, self.points[self.next] - from)
    }

    /// Within the line: near it, or past it. At its end: when nothing is left.
    fn has_reached(&self, here: Point2<f64>, radius_m: f64) -> bool {
        if self.is_done() {
            return false;
        }
        let (from, leg) = self.leg();
        let length = leg.norm();
        let left = if length > 1e-6 {
            length - (here - from).dot(&leg) / length
        } else {
            (here - from).norm()
        };
        let last = self.next + 1 == self.points.len();
        left <= ARRIVED_M || (!last && (self.points[self.next] - here).norm() <= radius_m)
    }

    /// How far along the current leg the car is, and how far beside it.
    fn project(&self, here: Point2<f64>) -> (f64, f64) {
        let (from, leg) = self.leg();
        let length = leg.norm();
        if length < 1e-6 {
            return (0.0, 0.0);
        }
        let to = here - from;
        let along = (to.dot(&leg) / length).clamp(0.0, length);
        (along, (leg.x * to.y - leg.y * to.x) / length)
    }

    /// The point that far along the line, counted from the start of the current leg; straight on beyond its end.
    fn point_at(&self, mut along: f64) -> Point2<f64> {
        for pair in self.points[self.next - 1..].windows(2) {
            let length = (pair[1] - pair[0]).norm();
            if along <= length && length > 0.0 {
                return pair[0] + (pair[1] - pair[0]) * (along / length);
            }
            along -= length;
        }
        let end = self.points[self.points.len() - 1];
        let mut legs = self.points.windows(2).rev().map(|pair| pair[1] - pair[0]);
        let last = legs.find(|leg| leg.norm() > 1e-6);
        last.map_or(end, |leg| end + leg.normalize() * along)
    }

    /// What is left of the line from there.
    fn left_after(&self, along: f64) -> f64 {
        let whole: f64 = self.points[self.next - 1..]
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).norm())
            .sum();
        whole - along
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::rover::{Chassis, Rover};

    const DT: f64 = 0.02;

    fn style(reverse: bool) -> Style {
        Style {
            speed_mps: 0.5,
            reverse,
            look_ahead_m: 0.3,
            braking_mps2: 0.5,
            radius_m: 0.1,
            min_turning_radius_m: 0.45,
        }
    }

    /// Drives the line; returns where it ends and how far beside the line it ever was.
    #[track_caller]
    fn drive(rover: &mut Rover, waypoints: &[[f64; 2]], reverse: bool) -> f64 {
        let points = waypoints.iter().map(|&[x, y]| Point::new(x, y, 0.0));
        let mut line = Line::new(rover.motion().position(), points);
        let mut worst = 0.0_f64;
        let mut reached = 0;
        for _ in 0..10_000 {
            let progress = line.follow(&rover.motion(), &style(reverse));
            reached += progress.reached;
            worst = worst.max(progress.cross_track_m.abs());
            rover.step(progress.control, DT);
            if line.is_done() && rover.speed_mps().abs() < 1e-9 {
                break;
            }
        }
        assert_eq!(reached, waypoints.len(), "every waypoint is reported once");
        let end = waypoints[waypoints.len() - 1];
        let p = rover.motion().position().raw;
        let miss = (p.x - end[0]).hypot(p.y - end[1]);
        assert!(miss < 0.06, "stands {miss} m from the last waypoint");
        worst
    }

    fn arc(radius: f64, from_rad: f64, to_rad: f64) -> Vec<[f64; 2]> {
        (1..=8)
            .map(|i| {
                let angle = from_rad + (to_rad - from_rad) * f64::from(i) / 8.0;
                [radius * angle.sin(), radius * (1.0 - angle.cos())]
            })
            .collect()
    }

    #[test]
    fn a_dense_arc_is_followed_to_a_few_centimetres() {
        let mut rover = Rover::new(Point::origin(), 0.0, Chassis::default());
        let worst = drive(&mut rover, &arc(1.0, 0.0, 2.0), false);
        assert!(worst < 0.05, "{worst} m beside the line");
    }

    #[test]
    fn it_reverses_along_the_arc_it_came_on() {
        let mut rover = Rover::new(Point::origin(), 0.0, Chassis::default());
        drive(&mut rover, &arc(1.0, 0.0, 1.5), false);
        let back: Vec<_> = arc(1.0, 1.5, 0.0);
        let worst = drive(&mut rover, &back, true);
        assert!(worst < 0.06, "{worst} m beside the line");
        assert!(
            rover.motion().heading_rad().abs() < 0.25,
            "it faces the way it started"
        );
    }

    #[test]
    fn a_single_waypoint_behind_it_is_reached_by_turning_round() {
        let mut rover = Rover::new(Point::origin(), 0.0, Chassis::default());
        drive(&mut rover, &[[-3.0, 0.0]], false);
    }

    #[test]
    fn waypoints_on_top_of_each_other_are_no_trouble() {
        let mut rover = Rover::new(Point::origin(), 0.0, Chassis::default());
        drive(
            &mut rover,
            &[[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0]],
            false,
        );
    }
}
