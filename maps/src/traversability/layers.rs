//! What is known of each cell, kept apart by kind: what a view shows, and why a cell is blocked.

use std::collections::BTreeMap;
use std::fmt;

use crate::voxel::ClassId;

/// Why a cell is blocked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hindrance {
    /// The ground rises or falls at once.
    Step {
        /// By this much.
        rise_m: f32,
    },
    /// The ground is too steep.
    Slope {
        /// Against the horizontal.
        angle_rad: f32,
    },
    /// Something stands on the ground.
    Obstacle {
        /// Its top over the ground.
        height_m: f32,
    },
    /// Something hangs too low.
    Overhang {
        /// Its underside over the ground.
        gap_m: f32,
    },
    /// The ground is of a class that is not driven on.
    Class {
        /// Which.
        class: ClassId,
    },
    /// Something is there, but no ground anywhere near to compare it with.
    NoGround,
}

impl fmt::Display for Hindrance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Step { rise_m } => write!(f, "a step of {rise_m:.2} m"),
            Self::Slope { angle_rad } => write!(f, "a slope of {:.0} deg", angle_rad.to_degrees()),
            Self::Obstacle { height_m } => write!(f, "an obstacle {height_m:.2} m high"),
            Self::Overhang { gap_m } => write!(f, "an overhang at {gap_m:.2} m"),
            Self::Class { class } => write!(f, "ground of class {}", class.0),
            Self::NoGround => f.write_str("something without ground around it"),
        }
    }
}

/// What was measured on one cell of a map. Where there is no ground, all but the hindrance is as of level ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Details {
    /// Largest difference of height to a neighbour, or how far something sticks out.
    pub step_m: f32,
    /// Of the plane under the vehicle, against the horizontal.
    pub slope_rad: f32,
    /// Root of the mean squared deviation from that plane.
    pub roughness_m: f32,
    /// From the ground to whatever hangs over it; infinite under the sky.
    pub headroom_m: f32,
    /// Of the ground's surface.
    pub class: ClassId,
    /// Why the cell is blocked; none if it is not.
    pub hindrance: Option<Hindrance>,
}

impl Default for Details {
    fn default() -> Self {
        Self {
            step_m: 0.0,
            slope_rad: 0.0,
            roughness_m: 0.0,
            headroom_m: f32::INFINITY,
            class: ClassId::NONE,
            hindrance: None,
        }
    }
}

/// One kind of what is known, to be shown by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Layer {
    /// Height of the ground, in metres.
    Height,
    /// [`Details::step_m`].
    Step,
    /// [`Details::slope_rad`].
    Slope,
    /// [`Details::roughness_m`].
    Roughness,
    /// [`Details::headroom_m`], where something hangs over the ground.
    Headroom,
    /// [`Details::class`], where it is known.
    Class,
    /// Extra cost of a metre.
    Cost,
    /// Distance to the nearest blocked cell, in metres.
    Clearance,
}

impl Layer {
    /// Every kind.
    pub const ALL: [Self; 8] = [
        Self::Height,
        Self::Step,
        Self::Slope,
        Self::Roughness,
        Self::Headroom,
        Self::Class,
        Self::Cost,
        Self::Clearance,
    ];
}

/// What ground of a class is good for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClassRule {
    /// It is driven on, at this extra cost per metre; not negative.
    Cost(f64),
    /// It is never driven on, such as water or a flower bed.
    Blocked,
}

/// What to do about the classes of ground; those without a rule cost nothing extra.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClassRules(BTreeMap<ClassId, ClassRule>);

impl ClassRules {
    /// The rule of a class.
    pub fn of(&self, class: ClassId) -> ClassRule {
        self.0.get(&class).copied().unwrap_or(ClassRule::Cost(0.0))
    }
}

impl FromIterator<(ClassId, ClassRule)> for ClassRules {
    fn from_iter<I: IntoIterator<Item = (ClassId, ClassRule)>>(rules: I) -> Self {
        Self(rules.into_iter().collect())
    }
}
