//! Which motions the surfaces tell nothing about: along a plain wall, around a pole, over open ground.
//!
//! The eigenvectors of the information, in metres (a turn counts as what it moves the samples by), are the motions to ask
//! about. Summing up what the samples say is not enough: ten thousand normals that are each three degrees off seem to know
//! the place along a wall to a centimetre. A sample is therefore heard about a motion only if it would see a good part
//! of it, and a motion is *weak* unless enough samples are heard, or if the result is not sure enough of it.
//!
//! - T. Tuna et al., *X-ICP: localizability-aware lidar registration for robust localization in extreme environments*,
//!   T-RO 2024 (contributions of single points, filtered).
//! - J. Zhang et al., *On degeneracy of optimization-based state estimation problems*, ICRA 2016.

use nalgebra::{Isometry3, Matrix6, SymmetricEigen, Vector6};

use super::normal::{INLIER_SIGMAS, matches, weight};
use super::se3::parts;
use super::source::Source;
use super::surface::Level;

/// A sample is heard about a motion of one metre if it sees this much of it, in metres.
const HEARD_M: f64 = 0.3;
/// The least share of the samples, in samples that see all of a motion, and the least number.
const LEAST_SHARE: f64 = 0.005;
const LEAST_SAMPLES: f64 = 10.0;

/// A motion that cannot be told.
#[derive(Clone, Debug)]
pub(super) struct Weak {
    /// Unit motion about the centre, a turn in metres at the radius of the source.
    pub(super) motion: Vector6<f64>,
    /// How sure the surfaces are of it.
    pub(super) std_m: f64,
    /// How many samples would see it.
    pub(super) support: f64,
}

/// The weak motions at a pose, the weakest first.
pub(super) fn weak_motions(
    level: &Level,
    source: &Source,
    pose: &Isometry3<f64>,
    information: &Matrix6<f64>,
    most_std_m: f64,
) -> Vec<Weak> {
    let scale = in_metres(source.radius_m);
    let eigen = SymmetricEigen::new(scale * information * scale);
    let mut order = [0, 1, 2, 3, 4, 5];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let motions = order.map(|at| Vector6::from(eigen.eigenvectors.column(at)));
    let (support, total) = support(level, source, pose, &motions);
    let least = (LEAST_SHARE * total).max(LEAST_SAMPLES);
    (0..6)
        .map(|i| Weak {
            motion: motions[i],
            std_m: eigen.eigenvalues[order[i]].max(1e-12).sqrt().recip(),
            support: support[i],
        })
        .filter(|weak| weak.support < least || weak.std_m > most_std_m)
        .collect()
}

/// For each motion, the weighted samples that see it, each counted by how much of it it sees; and all of them.
fn support(
    level: &Level,
    source: &Source,
    pose: &Isometry3<f64>,
    motions: &[Vector6<f64>; 6],
) -> ([f64; 6], f64) {
    let scale = in_metres(source.radius_m);
    let (mut support, mut total) = ([0.0; 6], 0.0);
    for found in matches(level, &source.samples, pose) {
        let weight = weight(found.squared, INLIER_SIGMAS);
        total += weight;
        for (sum, motion) in support.iter_mut().zip(motions) {
            let (rho, phi) = parts(&(scale * motion));
            let moved = pose.rotation * (rho + phi.cross(&found.sample.at));
            let seen = found.surface.across(&moved).norm();
            if seen > HEARD_M {
                *sum += weight * seen.min(1.0).powi(2);
            }
        }
    }
    (support, total)
}

/// What takes a motion in metres to translation and radians.
pub(super) fn in_metres(radius_m: f64) -> Matrix6<f64> {
    let turn = radius_m.recip();
    Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, turn, turn, turn))
}

/// The projector that leaves of a perturbation what is not weak.
pub(super) fn without(weak: &[Weak], radius_m: f64) -> Matrix6<f64> {
    let mut projector = Matrix6::identity();
    for motion in weak.iter().map(|weak| weak.motion) {
        projector -= motion * motion.transpose();
    }
    in_metres(radius_m) * projector * in_metres(radius_m.recip())
}
