//! What a voxel is and where.

use std::ops::RangeInclusive;

use crate::time::Stamp;

/// Where a voxel is: `floor(p / resolution)` along each axis of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VoxelKey {
    /// Towards east.
    pub x: i32,
    /// Towards north.
    pub y: i32,
    /// Up.
    pub z: i32,
}

impl VoxelKey {
    /// The coordinates a key may have along each axis: those of an `OctoMap` file.
    pub const RANGE: RangeInclusive<i32> = -32_768..=32_767;

    /// The voxel at these coordinates.
    pub const fn new(x: i32, y: i32, z: i32) -> Self {
        Self { x, y, z }
    }

    /// Whether a map can hold it.
    pub fn is_in_world(self) -> bool {
        [self.x, self.y, self.z]
            .iter()
            .all(|c| Self::RANGE.contains(c))
    }
}

/// A colour, in sRGB.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Rgb(pub [u8; 3]);

/// A semantic class, such as road, car or person: an index into the list of classes that the peers agree on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClassId(pub u8);

impl ClassId {
    /// Not classified.
    pub const NONE: Self = Self(0);
}

/// A set of those who see: what was known before, the drone, the ground vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Sources(u8);

impl Sources {
    /// Nobody, or nobody knows.
    pub const NONE: Self = Self(0);
    /// A map from before the mission.
    pub const PRIOR: Self = Self(1);
    /// The drone.
    pub const UAV: Self = Self(2);
    /// The ground vehicle.
    pub const UGV: Self = Self(4);

    /// One bit a source, as they travel: 1 prior, 2 UAV, 4 UGV.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// From one bit a source; others are dropped.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & 7)
    }

    /// Whether all of `others` are among these.
    pub const fn contains(self, others: Self) -> bool {
        self.0 & others.0 == others.0
    }

    /// Whether there are none.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }
}

impl std::ops::BitOr for Sources {
    type Output = Self;

    /// Those in either.
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl std::ops::BitOrAssign for Sources {
    fn bitor_assign(&mut self, other: Self) {
        *self = *self | other;
    }
}

/// When something was last seen, and by whom it ever was while it was there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Seen {
    /// The last time, kept to 1/32 s; the start of the clock if it was never told.
    pub at: Stamp,
    /// Everyone who saw it.
    pub sources: Sources,
}

/// What is known of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Occupancy {
    /// No ray has come by.
    Unknown,
    /// Rays passed through.
    Free,
    /// Something is there.
    Occupied,
}

/// The logarithm of the odds that a voxel is occupied, in steps of 0.05.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LogOdds(pub i8);

impl LogOdds {
    /// What the end of a ray adds: probability 0.7.
    pub const HIT: Self = Self(17);
    /// What a passing ray adds: probability 0.4.
    pub const MISS: Self = Self(-8);
    /// The least it may be, so that a voxel can change its mind: probability 0.12.
    pub const MIN: Self = Self(-40);
    /// The most it may be: probability 0.97.
    pub const MAX: Self = Self(70);
    /// What one step is worth.
    pub const STEP: f64 = 0.05;

    /// The value itself.
    pub fn value(self) -> f64 {
        f64::from(self.0) * Self::STEP
    }

    /// The nearest to `value` that a voxel can hold; NaN gives even odds.
    pub fn nearest(value: f64) -> Self {
        let steps = (value / Self::STEP).round() as i8; // saturates; NaN becomes 0
        Self(steps).clamped()
    }

    /// Within what a voxel can hold.
    #[must_use]
    pub fn clamped(self) -> Self {
        self.clamp(Self::MIN, Self::MAX)
    }

    /// The probability of being occupied.
    pub fn probability(self) -> f64 {
        1.0 - 1.0 / (1.0 + self.value().exp())
    }

    /// Whether occupied is more likely than free; even odds count as free.
    pub fn is_occupied(self) -> bool {
        self.0 > 0
    }
}

/// A known voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Voxel {
    /// How likely it is occupied.
    pub log_odds: LogOdds,
    /// The colour of its surface, of which the map keeps five bits a channel; `None` where free or never seen in colour.
    pub color: Option<Rgb>,
    /// What its surface belongs to; [`ClassId::NONE`] where free or never classified.
    pub class: ClassId,
}

impl Voxel {
    /// A voxel without colour or class.
    pub const fn new(log_odds: LogOdds) -> Self {
        Self {
            log_odds,
            color: None,
            class: ClassId::NONE,
        }
    }

    /// Free or occupied.
    pub fn occupancy(self) -> Occupancy {
        if self.log_odds.is_occupied() {
            Occupancy::Occupied
        } else {
            Occupancy::Free
        }
    }
}
