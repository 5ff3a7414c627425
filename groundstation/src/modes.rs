//! Flight and drive modes: the numbers autopilots put into `HEARTBEAT.custom_mode`, and what people call them.
//!
//! Numbers are ArduPilot's (`modes` in its vehicles' `mode.h`): the same number means another mode on another kind of vehicle.

use std::fmt;

/// What kind of vehicle a system is, from HEARTBEAT.type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Multicopter or helicopter.
    Copter,
    /// Car-like ground vehicle.
    Rover,
    /// Fixed wing.
    Plane,
    /// Boat: drives with the rover's modes.
    Boat,
    /// Under water.
    Submarine,
    /// Anything else, with its `MAV_TYPE`.
    Other(u32),
}

impl Kind {
    /// The kind that goes with a `MAV_TYPE`.
    pub fn from_mav_type(number: u32) -> Self {
        match number {
            1 => Self::Plane,
            2 | 3 | 4 | 13 | 14 | 15 | 29 | 35 => Self::Copter,
            10 => Self::Rover,
            11 => Self::Boat,
            12 => Self::Submarine,
            other => Self::Other(other),
        }
    }

    /// Whether it leaves the ground: altitude is then shown and asked for.
    pub fn flies(self) -> bool {
        matches!(self, Self::Copter | Self::Plane)
    }

    /// Whether a path over the map can be planned for it.
    pub fn drives(self) -> bool {
        matches!(self, Self::Rover)
    }

    /// What operators call such a vehicle.
    pub fn word(self) -> &'static str {
        match self {
            Self::Copter | Self::Plane => "UAV",
            Self::Rover => "UGV",
            Self::Boat => "Boat",
            Self::Submarine => "ROV",
            Self::Other(_) => "Vehicle",
        }
    }

    fn table(self) -> &'static [(u32, Mode)] {
        match self {
            Self::Copter => COPTER,
            Self::Rover | Self::Boat => ROVER,
            Self::Submarine => SUBMARINE,
            Self::Plane => PLANE,
            Self::Other(_) => &[],
        }
    }
}

/// A mode by meaning; [`Mode::Unnamed`] where this program has no word for the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(
    missing_docs,
    reason = "the names are the autopilots' own and Display prints them"
)]
pub enum Mode {
    Stabilize,
    Acro,
    AltHold,
    Auto,
    Guided,
    Loiter,
    Rtl,
    Circle,
    Land,
    PosHold,
    Brake,
    SmartRtl,
    Manual,
    Hold,
    Steering,
    Surface,
    FlyByWire,
    Cruise,
    /// A number without a name here.
    Unnamed(u32),
}

const COPTER: &[(u32, Mode)] = &[
    (0, Mode::Stabilize),
    (1, Mode::Acro),
    (2, Mode::AltHold),
    (3, Mode::Auto),
    (4, Mode::Guided),
    (5, Mode::Loiter),
    (6, Mode::Rtl),
    (7, Mode::Circle),
    (9, Mode::Land),
    (16, Mode::PosHold),
    (17, Mode::Brake),
    (21, Mode::SmartRtl),
];
const ROVER: &[(u32, Mode)] = &[
    (0, Mode::Manual),
    (1, Mode::Acro),
    (3, Mode::Steering),
    (4, Mode::Hold),
    (5, Mode::Loiter),
    (10, Mode::Auto),
    (11, Mode::Rtl),
    (12, Mode::SmartRtl),
    (15, Mode::Guided),
];
const SUBMARINE: &[(u32, Mode)] = &[
    (0, Mode::Stabilize),
    (1, Mode::Acro),
    (2, Mode::AltHold),
    (3, Mode::Auto),
    (4, Mode::Guided),
    (7, Mode::Circle),
    (9, Mode::Surface),
    (16, Mode::PosHold),
    (19, Mode::Manual),
];
const PLANE: &[(u32, Mode)] = &[
    (0, Mode::Manual),
    (1, Mode::Circle),
    (2, Mode::Stabilize),
    (4, Mode::Acro),
    (5, Mode::FlyByWire),
    (7, Mode::Cruise),
    (10, Mode::Auto),
    (11, Mode::Rtl),
    (12, Mode::Loiter),
    (15, Mode::Guided),
];

impl Mode {
    /// The mode that a vehicle of this kind means by `number`.
    pub fn from_number(kind: Kind, number: u32) -> Self {
        let found = kind.table().iter().find(|(n, _)| *n == number);
        found.map_or(Self::Unnamed(number), |(_, mode)| *mode)
    }

    /// The number a vehicle of this kind has for it; `None` if it has no such mode.
    pub fn number(self, kind: Kind) -> Option<u32> {
        match self {
            Self::Unnamed(number) => Some(number),
            named => kind
                .table()
                .iter()
                .find(|(_, mode)| *mode == named)
                .map(|(n, _)| *n),
        }
    }

    /// The mode called `name`, in any case.
    pub fn from_name(name: &str) -> Option<Self> {
        let tables = [COPTER, ROVER, SUBMARINE, PLANE];
        let mut modes = tables.into_iter().flatten().map(|(_, mode)| *mode);
        modes.find(|mode| mode.to_string().eq_ignore_ascii_case(name))
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = match self {
            Self::Stabilize => "STABILIZE",
            Self::Acro => "ACRO",
            Self::AltHold => "ALT_HOLD",
            Self::Auto => "AUTO",
            Self::Guided => "GUIDED",
            Self::Loiter => "LOITER",
            Self::Rtl => "RTL",
            Self::Circle => "CIRCLE",
            Self::Land => "LAND",
            Self::PosHold => "POSHOLD",
            Self::Brake => "BRAKE",
            Self::SmartRtl => "SMART_RTL",
            Self::Manual => "MANUAL",
            Self::Hold => "HOLD",
            Self::Steering => "STEERING",
            Self::Surface => "SURFACE",
            Self::FlyByWire => "FBWA",
            Self::Cruise => "CRUISE",
            Self::Unnamed(number) => return write!(f, "MODE {number}"),
        };
        f.write_str(word)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_number_is_another_mode_on_another_vehicle() {
        assert_eq!(Mode::from_number(Kind::Copter, 4), Mode::Guided);
        assert_eq!(Mode::from_number(Kind::Rover, 4), Mode::Hold);
        assert_eq!(Mode::from_number(Kind::Rover, 77).to_string(), "MODE 77");
    }

    #[test]
    fn every_number_survives_the_way_to_its_mode_and_back() {
        for kind in [
            Kind::Copter,
            Kind::Rover,
            Kind::Submarine,
            Kind::Plane,
            Kind::Other(99),
        ] {
            for number in 0..40 {
                assert_eq!(
                    Mode::from_number(kind, number).number(kind),
                    Some(number),
                    "{kind:?}"
                );
            }
        }
    }

    #[test]
    fn a_rover_has_no_mode_to_land_in() {
        assert_eq!(Mode::Land.number(Kind::Rover), None);
        assert_eq!(Mode::from_name("land"), Some(Mode::Land));
        assert_eq!(Mode::from_name("warp"), None);
    }
}
