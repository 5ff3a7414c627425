//! A path as what an autopilot is told: places on the ground, how near is near enough, and how fast.

use super::motion::{Gear, Pose2, wrapped};
use super::{Path, Waypoint};
use crate::frame::{Point, World};
use crate::traversability::{Cell, Traversability};

/// How fast a vehicle shall drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speeds {
    /// Straight on.
    pub cruise_mps: f64,
    /// In reverse, at most.
    pub reverse_mps: f64,
    /// Sideways acceleration in a curve, at most.
    pub lateral_mps2: f64,
}

impl Default for Speeds {
    fn default() -> Self {
        Self {
            cruise_mps: 1.0,
            reverse_mps: 0.5,
            lateral_mps2: 0.8,
        }
    }
}

/// A waypoint ready to become a mission item, once its place is given in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Where the middle of the rear axle shall be, on the ground.
    pub place: Point<World>,
    /// Where the front points, counter-clockwise from east.
    pub heading_rad: f64,
    /// The gear in which the vehicle arrives.
    pub gear: Gear,
    /// Nearer than this it has arrived: no more than half the way to the next or from the last, nor more than the path's
    /// clearance, nor less than 5 cm.
    pub accept_radius_m: f64,
    /// How fast to drive here: no faster than `√(a/κ)` on the way there.
    pub speed_mps: f64,
}

/// No vehicle is held to less.
const LEAST_ACCEPT_M: f64 = 0.05;

impl Path {
    /// The path as stops, the first where the vehicle stands. Where the grid knows no ground, the height is that of the
    /// stop before, or 0.
    pub fn stops(&self, grid: &Traversability, speeds: &Speeds) -> Vec<Stop> {
        let mut height_m = 0.0;
        (0..self.waypoints.len())
            .map(|i| {
                let Waypoint { pose, gear } = self.waypoints[i];
                if let Cell::Drivable { height_m: here, .. } = grid.cell(pose.x_m, pose.y_m) {
                    height_m = here;
                }
                let before = i.checked_sub(1).map(|i| &self.waypoints[i].pose);
                let after = self.waypoints.get(i + 1).map(|waypoint| &waypoint.pose);
                let half = |other: Option<&Pose2>| {
                    other.map_or(f64::INFINITY, |other| 0.5 * pose.distance_m(other))
                };
                let accept_m = half(before).min(half(after)).min(self.min_clearance_m);
                Stop {
                    place: Point::new(pose.x_m, pose.y_m, height_m),
                    heading_rad: pose.heading_rad,
                    gear,
                    // A path of one waypoint on open ground would be infinite.
                    accept_radius_m: accept_m.clamp(LEAST_ACCEPT_M, 1.0),
                    speed_mps: speed(before, &pose, gear, speeds),
                }
            })
            .collect()
    }
}

fn speed(before: Option<&Pose2>, pose: &Pose2, gear: Gear, speeds: &Speeds) -> f64 {
    let most = match gear {
        Gear::Forward => speeds.cruise_mps,
        Gear::Reverse => speeds.cruise_mps.min(speeds.reverse_mps),
    };
    let curvature = before.map_or(0.0, |before| {
        let turn = wrapped(pose.heading_rad - before.heading_rad).abs();
        turn / pose.distance_m(before).max(1e-6)
    });
    most.min((speeds.lateral_mps2 / curvature.max(1e-9)).sqrt())
}
