//! Evidence about voxels from several sources, and the rules that make one map of it.
//!
//! A prior map, a drone and a ground vehicle say of a voxel that it is occupied, that it is free, or nothing: a [`Mass`].
//! An [`UpdateRule`] folds what they say into a state, voxel by voxel; an [`EvidenceMap`] holds the states of the voxels
//! that anybody spoke of.
//!
//! - [`Tandem`] is ours. It keeps the evidence of each source apart, in weights that fade with time, and tells objects
//!   that may drive away from walls.
//! - [`Paper`] is the rule of the paper that Tandem starts from, as printed and as probably meant; [`Replace`],
//!   [`Linear`] and [`LogOddsRule`] are its baselines. They are there for comparison.
//!
//! ```
//! use maps::evidence::{EvidenceMap, Look, Mass, Mobility, Observation, Source, Tandem, View};
//! use maps::time::Stamp;
//! use maps::voxel::VoxelKey;
//!
//! let mut map = EvidenceMap::new(Tandem::default(), 0.1);
//! let key = VoxelKey::new(12, 3, 4);
//! let look = Look { source: Source::Ugv, at: Stamp::ZERO, view: View(0) };
//! let hit = Observation { mass: Mass::occupied_by(0.7), mobility: Mobility::Static, detection: None };
//! map.observe(&look, &[(key, hit)]);
//! assert!(map.mass(key, Stamp::ZERO).occupied() > 0.5);
//! ```
//!
//! - Li et al., *Multi-Source Heterogeneous Collaborative Perception System Based on UAV and UGV*, Drones 2026, 10(6), 470,
//!   section 3.4.3.

mod baseline;
mod layer;
mod mass;
mod paper;
mod tandem;

use crate::time::Stamp;
use crate::voxel::Sources;

pub use baseline::{Gain, Linear, LogOddsRule, Probability, Replace};
pub use layer::EvidenceMap;
pub use mass::Mass;
pub use paper::{Agreement, Paper};
pub use tandem::{Semantics, Tandem, TandemState, Theory, Trust};

/// Who says something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Source {
    /// A map from before the mission.
    Prior,
    /// The drone.
    Uav,
    /// The ground vehicle.
    Ugv,
}

impl Source {
    /// All of them, in order.
    pub const ALL: [Self; 3] = [Self::Prior, Self::Uav, Self::Ugv];

    /// The set of this one.
    pub fn as_set(self) -> Sources {
        match self {
            Self::Prior => Sources::PRIOR,
            Self::Uav => Sources::UAV,
            Self::Ugv => Sources::UGV,
        }
    }

    /// Its place among [`Self::ALL`].
    fn index(self) -> usize {
        match self {
            Self::Prior => 0,
            Self::Uav => 1,
            Self::Ugv => 2,
        }
    }
}

/// A place from which a source looks. Looks from one place share their mistakes (a reflection, a grazing ray), so that the
/// second is no news; whoever moves a sensor counts up once it has moved far enough for its mistakes to be others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct View(pub u32);

/// What all observations of one scan or frame share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// Who looked.
    pub source: Source,
    /// When. For a prior map, when that was made.
    pub at: Stamp,
    /// From where.
    pub view: View,
}

/// Whether what occupies a voxel may go elsewhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Mobility {
    /// Not classified.
    #[default]
    Unknown,
    /// Ground, buildings, vegetation.
    Static,
    /// It stands, and may drive away: a parked car.
    Movable,
    /// It moves: a person, a car in traffic.
    Moving,
}

/// What one look says of one voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observation {
    /// Whether it is occupied or free.
    pub mass: Mass,
    /// What it is occupied by.
    pub mobility: Mobility,
    /// How sure a detector is of the object whose box covers the voxel, within 0..=1; `None` outside of boxes.
    pub detection: Option<f32>,
}

/// How what is seen changes what is known of one voxel.
pub trait UpdateRule {
    /// What is kept of a voxel; the default is that nothing was seen.
    type State: Clone + Default;

    /// Takes in one observation. Looks may come late: those of an earlier stamp count as old.
    fn observe(&self, state: &mut Self::State, look: &Look, seen: &Observation);

    /// What is believed at `now`; [`Mass::UNKNOWN`] if nothing was seen.
    fn mass(&self, state: &Self::State, now: Stamp) -> Mass;
}
