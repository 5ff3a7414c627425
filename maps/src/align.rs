//! Aligning a scan or a local map with the global one: where it truly is, how sure that is, or why that cannot be told.
//!
//! The UAV and the UGV each know their place from GNSS, metres off, and their yaw, degrees off. [`Reference::align`] starts
//! from such a [`Guess`] and finds the transform that lays the local surfaces on those of the map:
//!
//! 1. both are reduced to surfaces, planes and upright lines, at three sizes of cell, and the local ones to a few
//!    thousand samples that tell all directions;
//! 2. a search on a coarse grid over the guess's three standard deviations finds where to start;
//! 3. Gauss and Newton refine each start, coarse to fine, with a robust kernel that narrows;
//! 4. the result is judged. It is refused if it cannot be told from the surfaces, if another place fits about as well, if
//!    too little fits at all, or if it contradicts the guess.
//!
//! ```text
//! T* = argmin Σᵢ ρ(|Pᵢ(T·pᵢ - μᵢ - o_g)|²/σᵢ²) + Σ_g o_gᵀ K_g o_g + |log(T₀⁻¹·T)|²_Σ₀
//! ```
//!
//! with `o_g` the common offset of surfaces that err together and `(T₀, Σ₀)` the guess. The covariance of the result is on
//! the right, translation before rotation, as [`crate::frame`] has it: the inverse of the Hessian, which contains the guess,
//! and what the map itself may be off by, [`AlignSettings::map_std_m`].
//!
//! The same input gives the same result on any number of threads.
//!
//! ```
//! use maps::align::{AlignError, AlignSettings, GnssSigmas, Guess, Local, Reference};
//! use maps::frame::{Body, Isometry, Point, World};
//! use maps::voxel::{LogOdds, Voxel, VoxelMap};
//!
//! // A plain wall, and a scan of it.
//! let wall: Vec<[f64; 3]> = (0..8000).map(|i| [f64::from(i % 200) * 0.05, 4.0, f64::from(i / 200) * 0.05]).collect();
//! let mut map = VoxelMap::new(0.1);
//! for &[x, y, z] in &wall {
//!     map.set_voxel(map.key_of(Point::new(x, y, z)), Voxel::new(LogOdds::MAX));
//! }
//! let scan: Vec<Point<Body>> = wall.iter().map(|&[x, y, z]| Point::new(x, y, z)).collect();
//!
//! // Along it, the scan may be anywhere: the answer is no.
//! let guess = Guess::gnss(Isometry::identity(), &GnssSigmas::default());
//! let answer = Reference::new(&map).align(&Local::from_points(&scan), &guess, &AlignSettings::default());
//! assert!(matches!(answer, Err(AlignError::Unobservable { .. })));
//! ```
//!
//! Works on what the map has occupied; where voxels are, not how sure the map is of them, decides. Repeated structure within
//! the guess's uncertainty is refused as [`AlignError::Ambiguous`] where it is noticed, which is where the search kept both
//! places; a tighter guess is the remedy.

mod cells;
mod normal;
mod observe;
#[cfg(test)]
mod recordings;
mod refine;
#[cfg(test)]
mod scenes;
mod se3;
mod search;
mod source;
mod surface;
mod task;
#[cfg(test)]
mod tests;

use std::marker::PhantomData;

use nalgebra::{Matrix3, Matrix6, Vector3};

use crate::frame::{Isometry, Point, Vector, World};
use crate::voxel::VoxelMap;
use cells::Cells;
use surface::{Blobs, Level};
use task::Task;

/// The finest cells have this many voxels along an edge; the next two are two and four times as wide.
const CELL_VOXELS: f64 = 3.0;
/// How finely the points of a scan are resolved.
const POINT_GRAIN_M: f64 = 0.03;
/// How sure a GNSS receiver and an attitude filter are, as standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GnssSigmas {
    /// Along east and along north.
    pub horizontal_m: f64,
    /// Up.
    pub vertical_m: f64,
    /// Of the heading.
    pub yaw_rad: f64,
    /// Of roll and of pitch.
    pub tilt_rad: f64,
}

/// A plain receiver without corrections, and a magnetic heading.
impl Default for GnssSigmas {
    fn default() -> Self {
        Self {
            horizontal_m: 1.5,
            vertical_m: 2.0,
            yaw_rad: 4.0_f64.to_radians(),
            tilt_rad: 0.7_f64.to_radians(),
        }
    }
}

/// What is known before: a pose of the local frame and its covariance.
#[derive(Clone, Debug, PartialEq)]
pub struct Guess<L> {
    /// The pose.
    pub world_from_local: Isometry<World, L>,
    /// Of the perturbation on the right, translation before rotation, in m², m·rad and rad².
    pub covariance: Matrix6<f64>,
}

impl<L> Guess<L> {
    /// A guess whose position is that of the origin of `L`, with errors along the axes of the world.
    pub fn gnss(world_from_local: Isometry<World, L>, sigmas: &GnssSigmas) -> Self {
        let local_from_world = world_from_local.raw.rotation.inverse().to_rotation_matrix();
        let turned = |x: f64, y: f64, z: f64| {
            let diagonal = Matrix3::from_diagonal(&Vector3::new(x * x, y * y, z * z));
            local_from_world.matrix() * diagonal * local_from_world.matrix().transpose()
        };
        let mut covariance = Matrix6::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&turned(
            sigmas.horizontal_m,
            sigmas.horizontal_m,
            sigmas.vertical_m,
        ));
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&turned(
            sigmas.tilt_rad,
            sigmas.tilt_rad,
            sigmas.yaw_rad,
        ));
        Self {
            world_from_local,
            covariance,
        }
    }
}

/// What is to be aligned: places on surfaces in frame `L`, whose z axis is about up.
#[derive(Clone, Debug)]
pub struct Local<L> {
    points: Vec<(Vector3<f64>, f64)>,
    grain_m: f64,
    frame: PhantomData<fn() -> L>,
}

impl<L> Local<L> {
    /// A scan, or several in one frame. Points that are not finite are left out.
    pub fn from_points(points: &[Point<L>]) -> Self {
        Self {
            points: points.iter().map(|p| (p.raw.coords, 1.0)).collect(),
            grain_m: POINT_GRAIN_M,
            frame: PhantomData,
        }
    }

    /// The occupied voxels of a map that was built in a frame of its own, which its type calls the world.
    pub fn from_map(map: &VoxelMap) -> Self {
        Self {
            points: weighted_centers(map).collect(),
            grain_m: map.resolution_m(),
            frame: PhantomData,
        }
    }
}

/// The surfaces of a map, made once for any number of alignments. Takes about a tenth of a second for a hundred thousand
/// occupied voxels.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The finest first.
    levels: Vec<Level>,
}

/// When to refuse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlignSettings {
    /// The search reaches no further than this from the guess along each axis of the world, however unsure the guess is.
    pub reach_m: f64,
    /// The least number of places on surfaces, after thinning out, of about three voxels each.
    pub least_samples: usize,
    /// The least share of them that must lie on a surface of the map.
    pub least_inlier_share: f64,
    /// A motion that the surfaces tell less surely than this, as a standard deviation, is not observable.
    pub most_std_m: f64,
    /// How far the map and the scan may be bent, beyond the size of a voxel, as a standard deviation: the poses with which
    /// the map was made have errors, and a lidar moves while it turns. It is added to the covariance of the result,
    /// once for each axis and, at the radius of the scan, for each turn.
    pub map_std_m: f64,
}

impl Default for AlignSettings {
    fn default() -> Self {
        Self {
            reach_m: 10.0,
            least_samples: 100,
            least_inlier_share: 0.25,
            most_std_m: 0.3,
            map_std_m: 0.03,
        }
    }
}

/// Where the local frame is.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment<L> {
    /// Its pose in the world of the map.
    pub world_from_local: Isometry<World, L>,
    /// Of the perturbation on the right, translation before rotation, in m², m·rad and rad². Contains the guess.
    pub covariance: Matrix6<f64>,
    /// The share of the samples within three standard deviations of a surface of the map.
    pub inlier_share: f64,
    /// Root mean square distance of those from their surface.
    pub residual_m: f64,
}

/// A motion of the local frame that its surfaces cannot tell from none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeakDirection {
    /// Of the middle of the points. Together with the turn, a motion of about one metre.
    pub translation_m: Vector<World>,
    /// About the middle of the points, as an axis times an angle.
    pub rotation_rad: Vector<World>,
    /// How sure the surfaces seem of it; more than they are.
    pub std_m: f64,
    /// How many samples see it, each by how much of it it sees.
    pub support: f64,
}

/// An alignment of which some directions may be the guess's alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Constrained<L> {
    /// Its covariance is that of the guess along the held directions.
    pub alignment: Alignment<L>,
    /// Along these the pose is the guess's, the weakest first; none if the surfaces tell all.
    pub held: Vec<WeakDirection>,
}

/// Why there is no alignment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AlignError {
    /// The guess is not finite or its covariance not positive definite.
    #[error("the guess is not finite or its covariance not positive definite")]
    BadGuess,
    /// Too little surface to align.
    #[error("{found} places on surfaces, where {least} are needed")]
    TooFewPoints {
        /// After thinning out.
        found: usize,
        /// The limit.
        least: usize,
    },
    /// Nowhere near the guess do enough points lie on surfaces of the map.
    #[error("{:.0} % of the points fit the map, where {:.0} % are needed", 100.0 * inlier_share, 100.0 * least)]
    PoorFit {
        /// At the best place.
        inlier_share: f64,
        /// The limit.
        least: f64,
    },
    /// The best place contradicts the guess: either is wrong.
    #[error("the best fit is {translation_m:.2} m and {:.1}° from the guess, {sigmas:.1} standard deviations", rotation_rad.to_degrees())]
    TooFar {
        /// Of the middle of the points.
        translation_m: f64,
        /// By the whole turn.
        rotation_rad: f64,
        /// By the covariance of the guess.
        sigmas: f64,
    },
    /// The surfaces do not tell some motions, as along a straight wall.
    #[error("{} of 6 directions cannot be told from the surfaces", weak.len())]
    Unobservable {
        /// At least one, the weakest first.
        weak: Vec<WeakDirection>,
    },
    /// Another place fits about as well, as in a row of equal columns.
    #[error("a place {:.2} m away fits as well: {other_score:.2} against {score:.2}", apart_m.norm())]
    Ambiguous {
        /// From the best place to the other, of the middle of the points.
        apart_m: Vector<World>,
        /// How well the best place fits, up to 1.
        score: f64,
        /// How well the other does.
        other_score: f64,
    },
    /// The refinement was still moving.
    #[error("still moving by {step_sigmas:.2} standard deviations at the last step")]
    NotConverged {
        /// The last step, by the covariance of the result.
        step_sigmas: f64,
    },
}

impl Reference {
    /// The surfaces of what is occupied in a map.
    pub fn new(map: &VoxelMap) -> Self {
        let resolution_m = map.resolution_m();
        let fine = Cells::of(
            weighted_centers(map),
            CELL_VOXELS * resolution_m,
            resolution_m,
        );
        let middle = fine.doubled();
        let coarse = middle.doubled();
        Self {
            levels: vec![
                fine.surfaces(Blobs::Dropped),
                middle.surfaces(Blobs::Kept),
                coarse.surfaces(Blobs::Kept),
            ],
        }
    }

    /// The pose of the local frame, all of it told by the surfaces; refused otherwise.
    pub fn align<L>(
        &self,
        local: &Local<L>,
        guess: &Guess<L>,
        settings: &AlignSettings,
    ) -> Result<Alignment<L>, AlignError> {
        let task = Task::new(self, local, guess, settings)?;
        let best = task.best()?;
        if !best.weak.is_empty() {
            return Err(AlignError::Unobservable {
                weak: task.directions(&best),
            });
        }
        task.checked(&best.refined)?;
        Ok(task.alignment(&best.refined, best.fit))
    }

    /// As [`Self::align`], but along directions that the surfaces do not tell the pose is left where the guess has it.
    pub fn align_observable<L>(
        &self,
        local: &Local<L>,
        guess: &Guess<L>,
        settings: &AlignSettings,
    ) -> Result<Constrained<L>, AlignError> {
        let task = Task::new(self, local, guess, settings)?;
        let best = task.best()?;
        let (refined, fit) = task.held(&best);
        task.checked(&refined)?;
        Ok(Constrained {
            alignment: task.alignment(&refined, fit),
            held: task.directions(&best),
        })
    }
}

/// The occupied voxels, each weighed by how sure the map is of it.
fn weighted_centers(map: &VoxelMap) -> impl Iterator<Item = (Vector3<f64>, f64)> {
    map.occupied()
        .map(|(key, voxel)| (map.center_of(key).raw.coords, voxel.log_odds.value()))
}
