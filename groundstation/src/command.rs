//! What the operator can ask for: the one vocabulary of buttons, map clicks and scripts.
//!
//! A [`Command`] is an intent. It changes nothing that the screen shows about a vehicle: that comes from telemetry alone.

use std::fmt;

use mavlink_ext::SystemId;

use crate::modes::Mode;

/// Something the operator wants done.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Open a link, for example `udpin:127.0.0.1:14550`.
    Connect(String),
    /// Make this vehicle the one that map clicks and the mission panel are about.
    Select(SystemId),
    /// Something a vehicle should do at once.
    Order(SystemId, Order),
    /// Find a path for a ground vehicle over the received map.
    PlanPath {
        /// Who shall drive it.
        vehicle: SystemId,
        /// East of the map's origin.
        x_m: f64,
        /// North of the map's origin.
        y_m: f64,
        /// Which way to face at the end, clockwise from north; `None` leaves it open.
        heading_deg: Option<f64>,
    },
    /// Lay a lawn-mower survey over a rectangle of the map.
    PlanSurvey {
        /// Who shall fly it.
        vehicle: SystemId,
        /// The rectangle, the height and the distance between lines.
        area: SurveyArea,
    },
    /// Forget the plan of this vehicle; what it has on board stays.
    DiscardPlan(SystemId),
    /// Write the plan to the vehicle, read it back and compare.
    Upload(SystemId),
    /// The operator has seen this alert: it stops flashing.
    Acknowledge(u64),
}

impl Command {
    /// Whether it asks nothing of a vehicle or a link, so that it makes sense in a recording.
    pub fn suits_a_replay(&self) -> bool {
        matches!(self, Self::Select(_) | Self::Acknowledge(_))
    }
}

/// Something one vehicle should do at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// Start the motors.
    Arm,
    /// Stop the motors; a vehicle in the air refuses.
    Disarm,
    /// Climb to this height above the take-off point.
    Takeoff {
        /// Height above the take-off point.
        altitude_m: f64,
    },
    /// Follow the mission on board from its beginning.
    StartMission,
    /// Stop where it is.
    Hold,
    /// Come back to the launch point.
    ReturnToLaunch,
    /// Land where it is.
    Land,
    /// Fly or drive in this mode.
    Mode(Mode),
}

/// A rectangle to survey, from any corner to the opposite one, in metres east and north of the map's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(
    clippy::struct_field_names,
    reason = "all are lengths, and names end in the unit"
)]
pub struct SurveyArea {
    /// One corner.
    pub from_m: [f64; 2],
    /// The corner opposite.
    pub to_m: [f64; 2],
    /// Height above the take-off point.
    pub altitude_m: f64,
    /// Distance between neighbouring lines.
    pub spacing_m: f64,
}

/// What the button says, without the vehicle's name.
impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Arm => write!(f, "Arm"),
            Self::Disarm => write!(f, "Disarm"),
            Self::Takeoff { altitude_m } => write!(f, "Take off to {altitude_m:.1} m"),
            Self::StartMission => write!(f, "Start mission"),
            Self::Hold => write!(f, "Hold"),
            Self::ReturnToLaunch => write!(f, "Return to launch"),
            Self::Land => write!(f, "Land"),
            Self::Mode(mode) => write!(f, "Mode {mode}"),
        }
    }
}
