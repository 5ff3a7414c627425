//! The plan for a vehicle, and whether the vehicle has it.
//!
//! A plan belongs to one vehicle. It is never uploaded by itself, and an upload counts only when what was read back is equal.

use maps::frame::{Point, World};
use maps::time::Stamp;
use mavlink_ext::convert::MissionItem;

use crate::command::SurveyArea;

/// What a plan is.
#[derive(Clone, Debug, PartialEq)]
pub enum PlanKind {
    /// A path over the map for a ground vehicle.
    Path {
        /// Driven distance.
        length_m: f64,
        /// Distance to the nearest obstacle on the way.
        min_clearance_m: f64,
        /// How often the vehicle changes between forward and reverse.
        gear_changes: usize,
        /// Which way it shall face at the end, counter-clockwise from east; any, if none.
        goal_heading_rad: Option<f64>,
    },
    /// Survey lines for an aircraft.
    Survey {
        /// What is surveyed.
        area: SurveyArea,
        /// Flown distance along the lines.
        length_m: f64,
    },
}

/// What the first item of a mission is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomeItem {
    /// The home position, as `ArduPilot` wants it; what comes back is the vehicle's own.
    First,
    /// Something to do.
    None,
}

/// A plan that can be uploaded.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// When it was made.
    pub made_at: Stamp,
    /// What it is.
    pub kind: PlanKind,
    /// What is uploaded.
    pub items: Vec<MissionItem>,
    /// Whether the first item stands for the home position, which the vehicle replaces by its own.
    pub home: HomeItem,
    /// How it runs over the map.
    pub line: Vec<Point<World>>,
}

/// Where planning stands.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum PlanState {
    /// There is no plan.
    #[default]
    None,
    /// The planner works on it.
    Planning {
        /// Since when.
        since: Stamp,
    },
    /// There is a plan.
    Ready(Plan),
    /// None could be made.
    Refused {
        /// Since when.
        at: Stamp,
        /// Why.
        reason: String,
    },
}

/// Whether the vehicle has the plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Transfer {
    /// Nothing was uploaded.
    #[default]
    None,
    /// Items go to the vehicle.
    Uploading {
        /// Items the vehicle has asked for.
        done: usize,
        /// Items in the plan.
        total: usize,
    },
    /// Items come back from the vehicle.
    ReadingBack {
        /// Items received.
        done: usize,
        /// Items the vehicle says that it has.
        total: usize,
    },
    /// What was read back is the plan.
    Verified {
        /// When.
        at: Stamp,
        /// How many items.
        items: usize,
    },
    /// What was read back is something else.
    Differs {
        /// Since when.
        at: Stamp,
        /// Each difference in words.
        differences: Vec<String>,
    },
    /// It did not get so far.
    Failed {
        /// Since when.
        at: Stamp,
        /// Why.
        reason: String,
    },
}

/// The plan for one vehicle and what became of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mission {
    /// Where planning stands.
    pub plan: PlanState,
    /// Whether the vehicle has it.
    pub transfer: Transfer,
}

impl Mission {
    /// The plan, if there is one.
    pub fn plan(&self) -> Option<&Plan> {
        match &self.plan {
            PlanState::Ready(plan) => Some(plan),
            PlanState::None | PlanState::Planning { .. } | PlanState::Refused { .. } => None,
        }
    }

    /// Whether a plan can be uploaded now.
    pub fn can_upload(&self) -> bool {
        self.plan().is_some() && !self.is_transferring()
    }

    /// Whether an upload is under way.
    pub fn is_transferring(&self) -> bool {
        matches!(
            self.transfer,
            Transfer::Uploading { .. } | Transfer::ReadingBack { .. }
        )
    }

    /// Whether the vehicle has the present plan, as read back.
    pub fn is_verified(&self) -> bool {
        matches!(self.transfer, Transfer::Verified { .. })
    }
}
