//! Flight and drive modes, with the numbers that `ArduPilot` gives them in `HEARTBEAT.custom_mode`.
//!
//! The same number means something else on another kind of vehicle. Source: `ArduPilot`, `ArduCopter/mode.h` and
//! `Rover/mode.h`.

use std::fmt;

/// What kind of vehicle is being flown or driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A quadrotor.
    Copter,
    /// A small car.
    Rover,
}

/// What the autopilot is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Copter: the pilot's sticks; there are none here, so it holds level and its height.
    Stabilize,
    /// The mission.
    Auto,
    /// Where it is told to go.
    Guided,
    /// Copter: stays where it is.
    Loiter,
    /// Back to where it was armed.
    Rtl,
    /// Copter: straight down.
    Land,
    /// Copter: stops as fast as it can.
    Brake,
    /// Rover: the pilot's sticks; there are none here, so it stands.
    Manual,
    /// Rover: stands still.
    Hold,
}

const COPTER: [(u32, Mode); 7] = [
    (0, Mode::Stabilize),
    (3, Mode::Auto),
    (4, Mode::Guided),
    (5, Mode::Loiter),
    (6, Mode::Rtl),
    (9, Mode::Land),
    (17, Mode::Brake),
];
const ROVER: [(u32, Mode); 5] = [
    (0, Mode::Manual),
    (4, Mode::Hold),
    (10, Mode::Auto),
    (11, Mode::Rtl),
    (15, Mode::Guided),
];

impl Kind {
    fn modes(self) -> &'static [(u32, Mode)] {
        match self {
            Self::Copter => &COPTER,
            Self::Rover => &ROVER,
        }
    }

    /// The mode after power-up.
    pub fn first_mode(self) -> Mode {
        match self {
            Self::Copter => Mode::Stabilize,
            Self::Rover => Mode::Manual,
        }
    }
}

impl Mode {
    /// The mode of that number, if this kind of vehicle has it.
    pub fn from_number(kind: Kind, number: u32) -> Option<Self> {
        let mut modes = kind.modes().iter();
        modes.find(|(n, _)| *n == number).map(|&(_, mode)| mode)
    }

    /// Its number; 0 for a mode that this kind of vehicle does not have.
    pub fn number(self, kind: Kind) -> u32 {
        let mut modes = kind.modes().iter();
        modes.find(|(_, mode)| *mode == self).map_or(0, |&(n, _)| n)
    }

    /// Whether the vehicle can be armed in it.
    pub fn can_arm(self) -> bool {
        match self {
            Self::Stabilize
            | Self::Auto
            | Self::Guided
            | Self::Loiter
            | Self::Manual
            | Self::Hold => true,
            Self::Rtl | Self::Land | Self::Brake => false,
        }
    }

    /// Whether it needs to know where it is.
    pub fn needs_position(self) -> bool {
        match self {
            Self::Auto | Self::Guided | Self::Loiter | Self::Rtl | Self::Brake => true,
            Self::Stabilize | Self::Land | Self::Manual | Self::Hold => false,
        }
    }
}

/// As operators know it.
impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stabilize => "STABILIZE",
            Self::Auto => "AUTO",
            Self::Guided => "GUIDED",
            Self::Loiter => "LOITER",
            Self::Rtl => "RTL",
            Self::Land => "LAND",
            Self::Brake => "BRAKE",
            Self::Manual => "MANUAL",
            Self::Hold => "HOLD",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_and_its_number_bring_each_other_back() {
        for kind in [Kind::Copter, Kind::Rover] {
            for &(number, mode) in kind.modes() {
                assert_eq!(Mode::from_number(kind, number), Some(mode));
                assert_eq!(mode.number(kind), number);
            }
        }
        assert_eq!(Mode::from_number(Kind::Rover, 9), None);
    }
}
