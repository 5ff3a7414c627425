//! The normal equations of one step: how the surfaces pull at the samples, with what they share taken out.
//!
//! A sample at `p` that lands at `q = T·p` near a surface with mean `μ` and variance `σ²` has, along each unit vector `n`
//! that the surface tells, the residual `e = n·(q - μ - o - τ×(q - c))`, where `o` and `τ` are the offset and the tilt of the
//! surface's group about its middle `c`, known to the precision `K`. With `j = (Rᵀn, p × Rᵀn)`, `ν = (n, (q - c) × n)` and
//! `s = w/σ²`, taking `o` and `τ` out of the least-squares problem leaves
//!
//! ```text
//! H = Σ s·j·jᵀ - Σ_g Aᵀ(S + K)⁻¹A      g = Σ s·j·(n·d) - Σ_g Aᵀ(S + K)⁻¹r        d = q - μ
//! S = Σ s·ν·νᵀ   A = Σ s·ν·jᵀ   r = Σ s·ν·(n·d)   over the samples of group g
//! ```
//!
//! so that a wall of ten thousand voxels is known no better than its own place is. Without this the covariance of a
//! registration is too small by one or two orders of magnitude, as all know who have used it.
//!
//! The weight is Geman and `McClure`'s, `w = (k² / (k² + r²))²` with `r² = |P·d|²/σ²`; `k` shrinks from step to step.
//!
//! - H. Yang et al., *Graduated non-convexity for robust spatial perception*, RA-L 2020.

use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};

use super::se3::joined;
use super::source::Sample;
use super::surface::{Level, Surface};

/// A sample is an inlier if it is within this many standard deviations of its surface.
pub(super) const INLIER_SIGMAS: f64 = 3.0;

/// One step's equations, `H·δ = -g` for the perturbation about the centre.
#[derive(Clone, Debug)]
pub(super) struct Equations {
    pub(super) information: Matrix6<f64>,
    pub(super) gradient: Vector6<f64>,
}

/// A sample that has found its surface.
pub(super) struct Match<'a> {
    pub(super) sample: &'a Sample,
    pub(super) surface: &'a Surface,
    /// From the mean of the surface, in the world.
    pub(super) offset: Vector3<f64>,
    /// How far off in standard deviations, squared.
    pub(super) squared: f64,
}

/// The samples that land near a surface that may be theirs, in order.
pub(super) fn matches<'a>(
    level: &'a Level,
    samples: &'a [Sample],
    pose: &'a Isometry3<f64>,
) -> impl Iterator<Item = Match<'a>> {
    samples.iter().filter_map(move |sample| {
        let landed = pose.rotation * sample.at + pose.translation.vector;
        let surface = level.find(&landed)?;
        if !surface.may_be(sample.shape, &(pose.rotation * sample.axis)) {
            return None;
        }
        let offset = landed - surface.mean;
        Some(Match {
            sample,
            surface,
            offset,
            squared: surface.across(&offset).norm_squared() / surface.variance,
        })
    })
}

/// Geman and `McClure`'s weight at a squared residual, for a kernel of width `k`, in standard deviations.
pub(super) fn weight(squared: f64, k: f64) -> f64 {
    (k * k / (k * k + squared)).powi(2)
}

/// What the samples of one group add up to.
struct GroupSums {
    group: u32,
    precision: Matrix6<f64>,
    pull: Matrix6<f64>,
    residual: Vector6<f64>,
}

/// The sums of the groups that have samples.
struct Groups {
    place: Vec<u32>,
    sums: Vec<GroupSums>,
}

impl Groups {
    fn sums_of(&mut self, group: u32) -> &mut GroupSums {
        let slot = &mut self.place[group as usize];
        if *slot == u32::MAX {
            *slot = self.sums.len() as u32;
            self.sums.push(GroupSums {
                group,
                precision: Matrix6::zeros(),
                pull: Matrix6::zeros(),
                residual: Vector6::zeros(),
            });
        }
        &mut self.sums[*slot as usize]
    }
}

/// The equations at a pose, with a kernel of width `k`, in standard deviations.
pub(super) fn equations(
    level: &Level,
    samples: &[Sample],
    pose: &Isometry3<f64>,
    k: f64,
) -> Equations {
    let mut information = Matrix6::zeros();
    let mut gradient = Vector6::zeros();
    let mut groups = Groups {
        place: vec![u32::MAX; level.groups.len()],
        sums: Vec::new(),
    };
    let local_from_world = pose.rotation.inverse();
    for found in matches(level, samples, pose) {
        let surface = found.surface;
        let scale = weight(found.squared, k) / surface.variance;
        let arm = found.offset + surface.mean - level.groups[surface.group as usize].middle;
        let sums = groups.sums_of(surface.group);
        for normal in surface.told() {
            let turned = local_from_world * normal;
            let moves = joined(&turned, &found.sample.at.cross(&turned));
            let shares = joined(&normal, &arm.cross(&normal));
            let residual = scale * normal.dot(&found.offset);
            information.ger(scale, &moves, &moves, 1.0);
            gradient += moves * residual;
            sums.precision.ger(scale, &shares, &shares, 1.0);
            sums.pull.ger(scale, &shares, &moves, 1.0);
            sums.residual += shares * residual;
        }
    }
    for sums in &groups.sums {
        let known = level.groups[sums.group as usize].precision + sums.precision;
        let Some(factor) = known.cholesky() else {
            continue; // cannot be: both terms are positive, one definite
        };
        let weighted = factor.solve(&sums.pull);
        information -= sums.pull.tr_mul(&weighted);
        gradient -= weighted.tr_mul(&sums.residual);
    }
    Equations {
        information: (information + information.transpose()) * 0.5,
        gradient,
    }
}
