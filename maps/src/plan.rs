//! Paths that a car-like vehicle can drive on a traversability grid.
//!
//! A path is a chain of arcs no tighter than the vehicle's turning radius, forward and in reverse, along which its
//! rectangle keeps its distance from everything blocked. It is found by hybrid A\*: a search over continuous poses, one
//! kept per cell, heading and gear, guided by the cost of the way of a disc to the goal and finished by the shortest
//! obstacle-free ways, then shortened by such ways between its own poses.
//!
//! - D. Dolgov, S. Thrun, M. Montemerlo, J. Diebel, *Path planning for autonomous vehicles in unknown semi-structured
//!   environments*, IJRR 29 (5), 2010.
//!
//! [`plan`] gives one path at once; [`Planning`] gives a first one quickly and better ones as long as it is asked, to the
//! nearest of several goals; [`plan_tour`] visits all of them; a [`Planner`] keeps its path while the map changes and repairs
//! what has become blocked. Effort is counted in poses, never in time.
//!
//! The same arguments give the same path, bit by bit, on the same machine.

mod anytime;
mod cost;
mod error;
mod field;
mod footprint;
mod goal;
mod motion;
mod path;
mod reeds_shepp;
mod replan;
mod search;
mod smooth;
mod stops;
mod tour;

pub use anytime::{Planning, Progress};
pub use error::{End, Obstacle, PlanError};
pub use motion::{Gear, Pose2};
pub use path::{Path, Waypoint};
pub use replan::{Planner, Update};
pub use stops::{Speeds, Stop};
pub use tour::{Tour, plan_tour};

use crate::traversability::{Traversability, Vehicle};

/// Where a path shall end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// East.
    pub x_m: f64,
    /// North.
    pub y_m: f64,
    /// Heading on arrival; any, if none.
    pub heading_rad: Option<f64>,
    /// How far from the place the path may end, if the vehicle cannot stand exactly there. At most 64 cells are used.
    pub tolerance_m: f64,
}

impl Goal {
    /// To stand exactly at a pose.
    pub const fn pose(pose: Pose2) -> Self {
        Self {
            x_m: pose.x_m,
            y_m: pose.y_m,
            heading_rad: Some(pose.heading_rad),
            tolerance_m: 0.0,
        }
    }

    /// To stand exactly at a place, heading anywhere.
    pub const fn place(x_m: f64, y_m: f64) -> Self {
        Self {
            x_m,
            y_m,
            heading_rad: None,
            tolerance_m: 0.0,
        }
    }
}

/// What to do about ground that nobody has seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unknown {
    /// Never drive over it, except for what is under the vehicle at the start.
    Avoid,
    /// Drive over it where that is worth `cost` extra metres per metre.
    Cross {
        /// Extra cost per metre; not negative.
        cost: f64,
    },
}

/// What a path must keep to and what it shall prefer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanLimits {
    /// Least distance from the footprint to anything blocked. Near the start as much as there is, where that is less.
    pub clearance_m: f64,
    /// Distance up to which more clearance is worth a detour.
    pub preferred_clearance_m: f64,
    /// What to do about unknown ground.
    pub unknown: Unknown,
    /// How many metres forward a metre in reverse is worth; at least 1.
    pub reverse_factor: f64,
    /// How many metres a change of gear is worth.
    pub gear_change_m: f64,
    /// Largest distance between waypoints.
    pub waypoint_spacing_m: f64,
    /// Poses to expand before giving up; each takes some microseconds and some hundred bytes.
    pub max_expansions: usize,
}

impl Default for PlanLimits {
    fn default() -> Self {
        Self {
            clearance_m: 0.05,
            preferred_clearance_m: 0.3,
            unknown: Unknown::Avoid,
            reverse_factor: 2.0,
            gear_change_m: 0.5,
            waypoint_spacing_m: 0.25,
            max_expansions: 150_000,
        }
    }
}

/// A path for `vehicle` from `start` to `goal`: the first that is found, improved with as much effort again.
pub fn plan(
    grid: &Traversability,
    vehicle: &Vehicle,
    start: Pose2,
    goal: Goal,
    limits: &PlanLimits,
) -> Result<Path, PlanError> {
    let mut planning = Planning::new(grid, vehicle, start, &[goal], limits)?;
    planning.find(limits.max_expansions);
    planning.into_path()
}

fn validate(
    vehicle: &Vehicle,
    start: &Pose2,
    goals: &[Goal],
    limits: &PlanLimits,
) -> Result<(), PlanError> {
    let unknown_cost = match limits.unknown {
        Unknown::Avoid => 0.0,
        Unknown::Cross { cost } => cost,
    };
    let positive = [
        ("length_m", vehicle.length_m),
        ("width_m", vehicle.width_m),
        ("min_turning_radius_m", vehicle.min_turning_radius_m),
        ("waypoint_spacing_m", limits.waypoint_spacing_m),
    ];
    let not_negative = [
        ("wheelbase_m", vehicle.wheelbase_m),
        ("clearance_m", limits.clearance_m),
        ("preferred_clearance_m", limits.preferred_clearance_m),
        ("gear_change_m", limits.gear_change_m),
        ("unknown cost", unknown_cost),
        ("reverse_factor - 1", limits.reverse_factor - 1.0),
    ];
    let finite = [
        ("start x_m", start.x_m),
        ("start y_m", start.y_m),
        ("start heading_rad", start.heading_rad),
    ];
    let wrong_goal = goals.iter().find_map(|goal| {
        let finite = [
            ("goal x_m", goal.x_m),
            ("goal y_m", goal.y_m),
            ("goal heading_rad", goal.heading_rad.unwrap_or(0.0)),
        ];
        let wrong = finite.into_iter().find(|(_, v)| !v.is_finite());
        let tolerance_m = goal.tolerance_m;
        let is_wrong = !(tolerance_m.is_finite() && tolerance_m >= 0.0);
        wrong.or(is_wrong.then_some(("tolerance_m", tolerance_m)))
    });
    let wrong = (positive.iter().find(|(_, v)| !(v.is_finite() && *v > 0.0)))
        .or_else(|| (not_negative.iter()).find(|(_, v)| !(v.is_finite() && *v >= 0.0)))
        .or_else(|| finite.iter().find(|(_, v)| !v.is_finite()))
        .or(wrong_goal.as_ref());
    match wrong {
        Some(&(what, value)) => Err(PlanError::Invalid { what, value }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
