//! Why there is no path, in words and numbers.

use std::fmt;

use crate::traversability::Hindrance;

/// Which end of the path an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Where the vehicle stands.
    Start,
    /// Where it shall go.
    Goal,
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Start => "start",
            Self::Goal => "goal",
        })
    }
}

/// Something blocked, where it is and what blocks there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// East.
    pub x_m: f64,
    /// North.
    pub y_m: f64,
    /// What hinders there; unknown on a grid that was not made from a map.
    pub why: Option<Hindrance>,
}

impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.why {
            Some(why) => write!(f, "{why}")?,
            None => f.write_str("an obstacle")?,
        }
        write!(f, " at ({:.2}, {:.2}) m", self.x_m, self.y_m)
    }
}

/// Why there is no path.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// There is nowhere to go.
    #[error("cannot plan without a goal")]
    NoGoal,
    /// More goals than can be put in the best order.
    #[error("cannot order {goals} goals: at most {most} are")]
    TooManyGoals {
        /// How many there are.
        goals: usize,
        /// How many there may be.
        most: usize,
    },
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
        "the {end} ({x_m:.2}, {y_m:.2}) m is blocked by {by}, {distance_m:.2} m from the vehicle's middle, which needs {needed_m:.2} m around it"
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
        /// The nearest.
        by: Obstacle,
    },
    /// The goal is free but nearer to something blocked than allowed.
    #[error(
        "the goal ({x_m:.2}, {y_m:.2}) m is inside the inflation of {of}: {clearance_m:.2} m would be between it and the vehicle, {needed_m:.2} m are required"
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
        /// The nearest.
        of: Obstacle,
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
