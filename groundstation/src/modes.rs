//! Flight and drive modes: the numbers autopilots put into `HEARTBEAT.custom_mode`, and what people call them.
//!
//! What a number means depends on the firmware: `ArduPilot` has a table for each kind of vehicle (`mode.h` of each), PX4 one
//! for all, of a main mode in the third byte and a sub mode in the fourth (`px4_custom_mode.h`).

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
}

/// Whose numbers a vehicle's modes are, from HEARTBEAT.autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Firmware {
    /// `MAV_AUTOPILOT_ARDUPILOTMEGA`.
    ArduPilot,
    /// `MAV_AUTOPILOT_PX4`.
    Px4,
    /// One whose modes this program does not know: it is shown, and not told to change them.
    Other,
}

impl Firmware {
    /// The firmware that goes with a `MAV_AUTOPILOT`.
    pub fn from_mav_autopilot(number: u32) -> Self {
        match number {
            3 => Self::ArduPilot,
            12 => Self::Px4,
            _ => Self::Other,
        }
    }

    fn table(self, kind: Kind) -> &'static [(u32, Mode)] {
        match (self, kind) {
            (Self::Px4, _) => PX4,
            (Self::ArduPilot, Kind::Copter) => COPTER,
            (Self::ArduPilot, Kind::Rover | Kind::Boat) => ROVER,
            (Self::ArduPilot, Kind::Submarine) => SUBMARINE,
            (Self::ArduPilot, Kind::Plane) => PLANE,
            (Self::ArduPilot, Kind::Other(_)) | (Self::Other, _) => &[],
        }
    }

    /// The parameters of `DO_SET_MODE` after its first, for a number of this firmware.
    pub fn mode_parameters(self, number: u32) -> [f32; 2] {
        let [_, _, main, sub] = number.to_le_bytes();
        match self {
            Self::Px4 => [f32::from(main), f32::from(sub)],
            // MAVLink carries parameters in single precision, exact up to 2²⁴; modes are small numbers.
            Self::ArduPilot | Self::Other => [number as f32, 0.0],
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
    Offboard,
    Takeoff,
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
const PX4: &[(u32, Mode)] = &[
    (px4(1, 0), Mode::Manual),
    (px4(2, 0), Mode::AltHold),
    (px4(3, 0), Mode::PosHold),
    (px4(4, 2), Mode::Takeoff),
    (px4(4, 3), Mode::Hold),
    (px4(4, 4), Mode::Auto),
    (px4(4, 5), Mode::Rtl),
    (px4(4, 6), Mode::Land),
    (px4(5, 0), Mode::Acro),
    (px4(6, 0), Mode::Offboard),
    (px4(7, 0), Mode::Stabilize),
];

const fn px4(main: u8, sub: u8) -> u32 {
    u32::from_le_bytes([0, 0, main, sub])
}

impl Mode {
    /// The mode that a vehicle of this kind means by `number`.
    pub fn from_number(firmware: Firmware, kind: Kind, number: u32) -> Self {
        let found = firmware.table(kind).iter().find(|(n, _)| *n == number);
        found.map_or(Self::Unnamed(number), |(_, mode)| *mode)
    }

    /// The number a vehicle of this kind has for it; `None` if it has no such mode.
    pub fn number(self, firmware: Firmware, kind: Kind) -> Option<u32> {
        match self {
            Self::Unnamed(number) => Some(number),
            named => firmware
                .table(kind)
                .iter()
                .find(|(_, mode)| *mode == named)
                .map(|(n, _)| *n),
        }
    }

    /// The mode called `name`, in any case.
    pub fn from_name(name: &str) -> Option<Self> {
        let tables = [COPTER, ROVER, SUBMARINE, PLANE, PX4];
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
            Self::Offboard => "OFFBOARD",
            Self::Takeoff => "TAKEOFF",
            Self::Unnamed(number) => return write!(f, "MODE {number}"),
        };
        f.write_str(word)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ARDUPILOT: Firmware = Firmware::ArduPilot;

    #[test]
    fn the_same_number_is_another_mode_on_another_vehicle() {
        let mode = |kind, number| Mode::from_number(ARDUPILOT, kind, number);
        assert_eq!(mode(Kind::Copter, 4), Mode::Guided);
        assert_eq!(mode(Kind::Rover, 4), Mode::Hold);
        assert_eq!(mode(Kind::Rover, 77).to_string(), "MODE 77");
    }

    #[test]
    fn the_return_home_of_another_firmware_is_another_number() {
        let return_home = |firmware| Mode::Rtl.number(firmware, Kind::Copter);
        assert_eq!(return_home(Firmware::ArduPilot), Some(6));
        let px4 = return_home(Firmware::Px4).expect("it has one");
        let parameters = Firmware::Px4.mode_parameters(px4);
        assert_eq!(parameters.map(|p| p as u8), [4, 5]);
        assert_eq!(return_home(Firmware::Other), None);
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
            for firmware in [Firmware::ArduPilot, Firmware::Px4, Firmware::Other] {
                for number in (0..40).chain((0..8).map(|sub| px4(4, sub))) {
                    assert_eq!(
                        Mode::from_number(firmware, kind, number).number(firmware, kind),
                        Some(number),
                        "{firmware:?} {kind:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_rover_has_no_mode_to_land_in() {
        assert_eq!(Mode::Land.number(ARDUPILOT, Kind::Rover), None);
        assert_eq!(Mode::from_name("land"), Some(Mode::Land));
        assert_eq!(Mode::from_name("warp"), None);
    }
}
