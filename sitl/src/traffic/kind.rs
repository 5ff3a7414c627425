//! Who takes part in traffic, how large they are and how they move.
//!
//! Sizes are typical ones. Of the driver model's parameters, the gaps and headways are near those its authors give for
//! town; accelerations are chosen so that streets look lively and nobody brakes hard.
//!
//! - M. Treiber, A. Kesting, *Traffic Flow Dynamics*, Springer 2013, ch. 11: the Intelligent Driver Model.
//! - U. Weidmann, *Transporttechnik der Fussgänger*, ETH Zürich 1993: people walk at 1.34 m/s, standard deviation 0.26.

/// A kind of road user.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// A passenger car.
    Car,
    /// A lorry for goods in town.
    Truck,
    /// A town bus.
    Bus,
    /// Someone on a bicycle.
    Cyclist,
    /// Someone on foot.
    Pedestrian,
    /// A small ground vehicle of ours: slow, and careful.
    Robot,
}

/// How someone likes to move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manner {
    /// Speed on a free straight, if the limit allows it.
    pub desired_speed_mps: f64,
    /// Largest gain of speed, in m/s².
    pub acceleration_mps2: f64,
    /// Comfortable loss of speed, in m/s². In need they brake harder.
    pub braking_mps2: f64,
    /// Time behind the one in front.
    pub headway_s: f64,
    /// Gap to the one in front when standing.
    pub standstill_gap_m: f64,
    /// Sideways acceleration they accept in curves, in m/s².
    pub lateral_mps2: f64,
}

impl Kind {
    /// All that drive on lanes.
    pub const ON_LANES: [Self; 4] = [Self::Car, Self::Truck, Self::Bus, Self::Cyclist];

    /// Typical length, width and height in metres. For people the length is the depth of their body.
    pub fn size_m(self) -> [f64; 3] {
        match self {
            Self::Car => [4.4, 1.8, 1.5],
            Self::Truck => [7.5, 2.4, 3.1],
            Self::Bus => [11.5, 2.5, 3.1],
            Self::Cyclist => [1.8, 0.6, 1.75],
            Self::Pedestrian => [0.3, 0.48, 1.72],
            Self::Robot => [1.2, 0.9, 1.3],
        }
    }

    /// Typical manner.
    pub fn manner(self) -> Manner {
        let car = Manner {
            desired_speed_mps: 15.0,
            acceleration_mps2: 1.4,
            braking_mps2: 2.0,
            headway_s: 1.0,
            standstill_gap_m: 2.0,
            lateral_mps2: 2.0,
        };
        match self {
            Self::Car => car,
            Self::Truck => Manner {
                desired_speed_mps: 12.5,
                acceleration_mps2: 0.9,
                headway_s: 1.3,
                lateral_mps2: 1.2,
                ..car
            },
            Self::Bus => Manner {
                desired_speed_mps: 12.5,
                acceleration_mps2: 1.0,
                headway_s: 1.3,
                lateral_mps2: 1.0,
                ..car
            },
            Self::Cyclist => Manner {
                desired_speed_mps: 5.0,
                acceleration_mps2: 0.9,
                standstill_gap_m: 1.2,
                lateral_mps2: 1.5,
                ..car
            },
            Self::Robot => Manner {
                desired_speed_mps: 3.0,
                acceleration_mps2: 1.0,
                braking_mps2: 1.5,
                lateral_mps2: 1.0,
                ..car
            },
            Self::Pedestrian => Manner {
                desired_speed_mps: 1.34,
                acceleration_mps2: 2.0,
                standstill_gap_m: 0.1,
                ..car
            },
        }
    }

    /// Where in its tables a vehicle's kind stands. What is slow everywhere shares the cars' place; pedestrians share the
    /// cyclists' and never ask.
    pub(super) fn index(self) -> usize {
        match self {
            Self::Car | Self::Robot => 0,
            Self::Truck => 1,
            Self::Bus => 2,
            Self::Cyclist | Self::Pedestrian => 3,
        }
    }
}
