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
//! The same arguments give the same path, bit by bit, on the same machine.

mod cost;
mod field;
mod footprint;
mod goal;
mod motion;
mod reeds_shepp;
mod search;
mod smooth;

pub use motion::{Gear, Pose2};

use crate::traversability::{Traversability, Vehicle};
use cost::CostModel;
use footprint::{Checker, Footprint, Margins};
use motion::Motion;

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

/// A pose on a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// Where the middle of the rear axle shall be.
    pub pose: Pose2,
    /// The gear in which the vehicle arrives here; at the first waypoint, in which it leaves.
    pub gear: Gear,
}

/// A drivable path.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// From the start to the goal, evenly spaced between changes of gear, each of which has one. A path that begins at its
    /// goal has one waypoint.
    pub waypoints: Vec<Waypoint>,
    /// Length of the drive.
    pub length_m: f64,
    /// Least distance from the footprint to a blocked cell on the whole path, to 2 mm; infinite where nothing is blocked.
    pub min_clearance_m: f64,
}

impl Path {
    /// How often the gear changes on the way.
    pub fn gear_changes(&self) -> usize {
        self.waypoints
            .windows(2)
            .filter(|pair| pair[0].gear != pair[1].gear)
            .count()
    }
}

/// Which end of the path an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Where the vehicle stands.
    Start,
    /// Where it shall go.
    Goal,
}

impl std::fmt::Display for End {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Start => "start",
            Self::Goal => "goal",
        })
    }
}

/// Why there is no path.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// An argument is not finite or out of range.
    #[error("cannot plan with {what} = {value}")]
    Invalid {
        /// Name of the argument.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// The place is not on the grid.
    #[error(
        "the {end} ({x_m:.2}, {y_m:.2}) m is outside the map, which spans x {west_m:.2}..{east_m:.2} m and y {south_m:.2}..{north_m:.2} m"
    )]
    Outside {
        /// Which end.
        end: End,
        /// East.
        x_m: f64,
        /// North.
        y_m: f64,
        /// Western edge of the map.
        west_m: f64,
        /// Eastern edge of the map.
        east_m: f64,
        /// Southern edge of the map.
        south_m: f64,
        /// Northern edge of the map.
        north_m: f64,
    },
    /// The footprint overlaps something blocked, in every heading that was asked for.
    #[error(
        "the {end} ({x_m:.2}, {y_m:.2}) m is blocked: {distance_m:.2} m to the nearest obstacle, the vehicle needs {needed_m:.2} m around its middle"
    )]
    Blocked {
        /// Which end.
        end: End,
        /// East.
        x_m: f64,
        /// North.
        y_m: f64,
        /// From the middle of the footprint to the nearest blocked cell.
        distance_m: f64,
        /// Half the vehicle's width and the clearance.
        needed_m: f64,
    },
    /// The goal is free but nearer to something blocked than allowed.
    #[error(
        "the goal ({x_m:.2}, {y_m:.2}) m leaves {clearance_m:.2} m between the vehicle and an obstacle, {needed_m:.2} m are required"
    )]
    GoalTooClose {
        /// East.
        x_m: f64,
        /// North.
        y_m: f64,
        /// Largest clearance of the footprint there over the headings asked for.
        clearance_m: f64,
        /// Clearance required, with the pad for the steps of the collision check.
        needed_m: f64,
    },
    /// Unknown ground would be under the vehicle.
    #[error(
        "the ground at the goal ({x_m:.2}, {y_m:.2}) m is unknown; the nearest known ground is {known_m:.2} m away"
    )]
    GoalUnknown {
        /// East.
        x_m: f64,
        /// North.
        y_m: f64,
        /// Distance to the nearest drivable cell; infinite if there is none.
        known_m: f64,
    },
    /// Every pose within reach was tried.
    #[error(
        "no path: the vehicle comes no nearer than {nearest_m:.2} m to the goal ({expansions} poses tried)"
    )]
    NoPath {
        /// Poses expanded.
        expansions: usize,
        /// Least distance to the goal that can be reached.
        nearest_m: f64,
    },
    /// The budget was used up first.
    #[error("gave up after {expansions} poses, {nearest_m:.2} m from the goal; a path may exist")]
    BudgetExhausted {
        /// Poses expanded.
        expansions: usize,
        /// Least distance to the goal so far.
        nearest_m: f64,
    },
}

/// A path for `vehicle` from `start` to `goal`.
pub fn plan(
    grid: &Traversability,
    vehicle: &Vehicle,
    start: Pose2,
    goal: Goal,
    limits: &PlanLimits,
) -> Result<Path, PlanError> {
    validate(vehicle, &start, &goal, limits)?;
    let footprint = Footprint::new(vehicle);
    let margins = Margins {
        clearance_m: limits.clearance_m,
        cross_unknown: matches!(limits.unknown, Unknown::Cross { .. }),
    };
    let checker = Checker::new(grid, footprint, start, margins);
    let needed_m = footprint.inradius() + limits.clearance_m;
    goal::check_inside(grid, End::Start, start.x_m, start.y_m)?;
    if !checker.is_free(&start) {
        let [x, y] = footprint.center(&start);
        return Err(PlanError::Blocked {
            end: End::Start,
            x_m: start.x_m,
            y_m: start.y_m,
            distance_m: grid.clearance_m(x, y),
            needed_m,
        });
    }
    let goals = goal::settle(&checker, &goal, needed_m)?;
    let costs = CostModel::new(grid, &footprint, limits);
    let problem = search::Problem {
        checker: &checker,
        costs: &costs,
        radius_m: vehicle.min_turning_radius_m,
        start,
        goals: &goals,
    };
    let found = search::search(&problem, limits.max_expansions)?;
    let motions = smooth::shorten(&problem, found);
    Ok(sampled(
        &checker,
        &start,
        &motions,
        limits.waypoint_spacing_m,
    ))
}

fn validate(
    vehicle: &Vehicle,
    start: &Pose2,
    goal: &Goal,
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
        ("tolerance_m", goal.tolerance_m),
        ("unknown cost", unknown_cost),
        ("reverse_factor - 1", limits.reverse_factor - 1.0),
    ];
    let finite = [
        ("start x_m", start.x_m),
        ("start y_m", start.y_m),
        ("start heading_rad", start.heading_rad),
        ("goal x_m", goal.x_m),
        ("goal y_m", goal.y_m),
        ("goal heading_rad", goal.heading_rad.unwrap_or(0.0)),
    ];
    let wrong = (positive.iter().find(|(_, v)| !(v.is_finite() && *v > 0.0)))
        .or_else(|| (not_negative.iter()).find(|(_, v)| !(v.is_finite() && *v >= 0.0)))
        .or_else(|| finite.iter().find(|(_, v)| !v.is_finite()));
    match wrong {
        Some(&(what, value)) => Err(PlanError::Invalid { what, value }),
        None => Ok(()),
    }
}

/// The waypoints along `motions` and what a path tells of itself.
fn sampled(checker: &Checker<'_>, start: &Pose2, motions: &[Motion], spacing_m: f64) -> Path {
    let mut path = Path {
        waypoints: vec![Waypoint {
            pose: *start,
            gear: motions.first().map_or(Gear::Forward, Motion::gear),
        }],
        length_m: motions.iter().map(Motion::length_m).sum(),
        min_clearance_m: checker.clearance_m(start, f64::INFINITY),
    };
    let mut pose = *start;
    for run in motions.chunk_by(|a, b| a.gear() == b.gear()) {
        let length: f64 = run.iter().map(Motion::length_m).sum();
        let apart = length / (length / spacing_m).ceil().max(1.0);
        // Distance along the run at which the current motion begins, and of the last waypoint.
        let (mut begun, mut last) = (0.0, 0.0);
        for motion in run {
            let end = begun + motion.length_m();
            // The end of the run has its own waypoint, below.
            while last + apart <= end && last + 1.5 * apart < length {
                last += apart;
                path.waypoints.push(Waypoint {
                    pose: motion.at(&pose, last - begun),
                    gear: motion.gear(),
                });
            }
            path.min_clearance_m = least_clearance(checker, &pose, motion, path.min_clearance_m);
            pose = motion.end(&pose);
            begun = end;
        }
        if let Some(motion) = run.last() {
            path.waypoints.push(Waypoint {
                pose,
                gear: motion.gear(),
            });
        }
    }
    path
}

/// The least clearance along a motion, to [`FINE_M`], or `least_m` if that is less. Where there is more than that, the next
/// place to look at is as far as no corner can come nearer.
fn least_clearance(checker: &Checker<'_>, from: &Pose2, motion: &Motion, least_m: f64) -> f64 {
    let (mut least, mut driven) = (least_m, 0.0);
    let mut spare = checker.clearance_m(from, f64::INFINITY) - least;
    while driven < motion.length_m() {
        let step = (spare / checker.footprint.sweep()).max(FINE_M / checker.footprint.sweep());
        driven = (driven + step).min(motion.length_m());
        let clearance = checker.clearance_m(&motion.at(from, driven), f64::INFINITY);
        least = least.min(clearance);
        spare = clearance - least;
    }
    least
}

/// How exact the clearance of a path is.
const FINE_M: f64 = 0.004;

#[cfg(test)]
mod tests;
