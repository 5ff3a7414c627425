//! From a start to the nearest minimum, coarse to fine, by Gauss and Newton with a prior.

use nalgebra::{Isometry3, Matrix6, Vector6};

use super::normal::{INLIER_SIGMAS, equations, matches};
use super::se3::{exp, log, parts, right_jacobian_inverse};
use super::source::Sample;
use super::surface::Level;

/// Steps at each coarse level, and at most at the finest.
const COARSE_STEPS: usize = 6;
const FINE_STEPS: usize = 30;
/// A step of less than this many standard deviations of the result has converged.
const CONVERGED_SIGMAS: f64 = 0.05;
/// After this many steps at the finest level each is halved: samples that change their cell to and fro come to rest.
const FULL_STEPS: usize = 14;
/// The longest step, as a share of a cell and in radians.
const LONGEST_CELLS: f64 = 1.0;
const LONGEST_RAD: f64 = 0.15;

/// What was known before: a pose of the centre of the source and its information, the inverse of its covariance.
#[derive(Clone, Debug)]
pub(super) struct Prior {
    pub(super) pose: Isometry3<f64>,
    pub(super) information: Matrix6<f64>,
}

impl Prior {
    /// Half the gradient and the Hessian of the squared distance from the prior.
    fn equations(&self, pose: &Isometry3<f64>) -> (Matrix6<f64>, Vector6<f64>) {
        let error = log(&(self.pose.inverse() * pose));
        let jacobian = right_jacobian_inverse(&error);
        let pull = jacobian.tr_mul(&self.information);
        (pull * jacobian, pull * error)
    }

    /// How far a pose is from the prior, in standard deviations, squared.
    pub(super) fn squared_distance(&self, pose: &Isometry3<f64>) -> f64 {
        let error = log(&(self.pose.inverse() * pose));
        error.dot(&(self.information * error))
    }
}

/// Where a refinement ended.
#[derive(Clone, Debug)]
pub(super) struct Refined {
    pub(super) pose: Isometry3<f64>,
    /// What the surfaces alone tell, about the centre.
    pub(super) information: Matrix6<f64>,
    /// Of the last step, in standard deviations of the result.
    pub(super) last_step_sigmas: f64,
}

/// What the refinement may use of what the surfaces tell: all, or what a projector leaves of it.
pub(super) type Kept<'a> = Option<&'a Matrix6<f64>>;

/// Moves towards the minimum at the coarser levels, whose kernels are wide.
pub(super) fn approach(
    levels: &[Level],
    samples: &[Sample],
    prior: &Prior,
    start: &Isometry3<f64>,
) -> Isometry3<f64> {
    let mut pose = *start;
    for level in levels.iter().rev() {
        let (wide, narrow) = kernels(level);
        for step in 0..COARSE_STEPS {
            let share = step as f64 / (COARSE_STEPS - 1) as f64;
            let k = wide * (narrow / wide).powf(share);
            let (delta, ..) = newton(level, samples, prior, (&pose, k), None);
            pose *= limited(&delta, level.cell_m);
        }
    }
    pose
}

/// Goes to the minimum at the finest level.
pub(super) fn finish(
    level: &Level,
    samples: &[Sample],
    prior: &Prior,
    start: &Isometry3<f64>,
    kept: Kept<'_>,
) -> Refined {
    let (wide, _) = kernels(level);
    let mut pose = *start;
    let mut k = wide.max(INLIER_SIGMAS);
    let mut information = Matrix6::zeros();
    let mut last_step_sigmas = f64::INFINITY;
    for step in 0..FINE_STEPS {
        let (delta, data, total) = newton(level, samples, prior, (&pose, k), kept);
        let share = if step < FULL_STEPS { 1.0 } else { 0.5 };
        pose *= limited(&(delta * share), level.cell_m);
        information = data;
        last_step_sigmas = delta.dot(&(total * delta)).max(0.0).sqrt();
        if k <= INLIER_SIGMAS && last_step_sigmas < CONVERGED_SIGMAS {
            break;
        }
        k = (k * 0.7).max(INLIER_SIGMAS);
    }
    Refined {
        pose,
        information,
        last_step_sigmas,
    }
}

/// The widths of the kernel at a level, in standard deviations: from about a cell to half of one.
fn kernels(level: &Level) -> (f64, f64) {
    let wide = level.cell_m / level.typical_std_m;
    (wide, wide / 2.0)
}

/// One step, the information in the surfaces, and that with the prior.
fn newton(
    level: &Level,
    samples: &[Sample],
    prior: &Prior,
    (pose, k): (&Isometry3<f64>, f64),
    kept: Kept<'_>,
) -> (Vector6<f64>, Matrix6<f64>, Matrix6<f64>) {
    let mut told = equations(level, samples, pose, k);
    if let Some(kept) = kept {
        told.information = kept.tr_mul(&told.information) * kept;
        told.gradient = kept.tr_mul(&told.gradient);
    }
    let (prior_information, prior_gradient) = prior.equations(pose);
    let total = told.information + prior_information;
    let total = (total + total.transpose()) * 0.5;
    let delta = total.cholesky().map_or_else(Vector6::zeros, |c| {
        -c.solve(&(told.gradient + prior_gradient))
    });
    (delta, told.information, total)
}

fn limited(delta: &Vector6<f64>, cell_m: f64) -> Isometry3<f64> {
    let (rho, phi) = parts(delta);
    let over = (rho.norm() / (LONGEST_CELLS * cell_m)).max(phi.norm() / LONGEST_RAD);
    exp(&(delta / over.max(1.0)))
}

/// How well samples at a pose fit the map.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    /// The mean over the samples of `k² / (k² + r²)`: 1 if each lies on a surface.
    pub(super) score: f64,
    /// The share of samples within three standard deviations of their surface.
    pub(super) inlier_share: f64,
    /// Root mean square distance of those from their surface.
    pub(super) residual_m: f64,
}

/// Judges a pose.
pub(super) fn fit(level: &Level, samples: &[Sample], pose: &Isometry3<f64>) -> Fit {
    const LIMIT: f64 = INLIER_SIGMAS * INLIER_SIGMAS;
    let (mut score, mut inliers, mut squares) = (0.0, 0.0, 0.0);
    for found in matches(level, samples, pose) {
        score += LIMIT / (LIMIT + found.squared);
        if found.squared < LIMIT {
            inliers += 1.0;
            squares += found.squared * found.surface.variance;
        }
    }
    let count = samples.len().max(1) as f64;
    Fit {
        score: score / count,
        inlier_share: inliers / count,
        residual_m: (squares / f64::max(inliers, 1.0)).sqrt(),
    }
}
