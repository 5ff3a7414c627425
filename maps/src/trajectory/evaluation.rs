//! How far an estimated trajectory is from the true one.
//!
//! Poses are paired by stamp. The *absolute trajectory error* is what is left of the distances between paired positions
//! once the estimate is laid over the truth as well as possible; the *relative pose error* compares how far both moved
//! between two moments:
//!
//! ```text
//! ATE = ‖trans(Qᵢ) - S·trans(Pᵢ)‖        S = argmin Σ ‖trans(Qᵢ) - S·trans(Pᵢ)‖²
//! RPE = Eᵢ = (Qᵢ⁻¹ Qᵢ₊Δ)⁻¹ (Pᵢ⁻¹ Pᵢ₊Δ)   Q true, P estimated
//! ```
//!
//! Two tools are the references of the literature and differ in details: [`Tool::Evo`] pairs every pose of the shorter
//! trajectory with the nearest of the other within 10 ms; [`Tool::TumBenchmark`] pairs greedily, nearest first and each
//! pose once, within 20 ms, and multiplies the relative motions the other way round. Both are reproduced.
//!
//! - J. Sturm et al., *A benchmark for the evaluation of RGB-D SLAM systems*, IROS 2012.
//! - S. Umeyama, *Least-squares estimation of transformation parameters between two point patterns*, PAMI 13 (4), 1991.

use std::time::Duration;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::Trajectory;
use crate::frame::{Isometry, Point, World};

/// Whose definitions to follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tool {
    /// `evo_ape` and `evo_rpe`.
    #[default]
    Evo,
    /// `evaluate_ate.py` and `evaluate_rpe.py` of the TUM RGB-D benchmark.
    TumBenchmark,
}

impl Tool {
    fn max_difference(self) -> Duration {
        match self {
            Self::Evo => Duration::from_millis(10),
            Self::TumBenchmark => Duration::from_millis(20),
        }
    }
}

/// How an estimate is laid over the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alignment {
    /// As it is.
    None,
    /// Turned and moved (`evo_ape -a`, `evaluate_ate.py`).
    Rigid,
    /// Turned, moved and scaled, for what cannot know its scale (`evo_ape -as`).
    Similarity,
}

/// Why two trajectories cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EvaluationError {
    /// Too few poses have a counterpart.
    #[error(
        "only {found} poses of the estimate's {estimated} and the truth's {truths} belong together in time, {needed} are needed"
    )]
    TooFewPairs {
        /// Pairs found.
        found: usize,
        /// Pairs needed.
        needed: usize,
        /// Poses estimated.
        estimated: usize,
        /// True poses.
        truths: usize,
    },
    /// Positions that do not belong to each other one by one.
    #[error("{truths} true positions cannot be laid over {estimated} estimated ones")]
    Lengths {
        /// True positions.
        truths: usize,
        /// Estimated positions.
        estimated: usize,
    },
}

/// Statistics of errors, in the unit of the errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// How many errors.
    pub count: usize,
    /// Root of the mean square.
    pub rmse: f64,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Standard deviation around the mean.
    pub std: f64,
    /// Least.
    pub min: f64,
    /// Greatest.
    pub max: f64,
}

impl Statistics {
    /// Of at least one error; all NaN of none.
    fn of(mut errors: Vec<f64>) -> Self {
        errors.sort_by(f64::total_cmp);
        let count = errors.len();
        let n = count as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let squares = errors.iter().map(|e| e * e).sum::<f64>() / n;
        let spread = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n;
        let at = |index: usize| errors.get(index).copied().unwrap_or(f64::NAN);
        let last = count.saturating_sub(1);
        Self {
            count,
            rmse: squares.sqrt(),
            mean,
            median: 0.5 * (at(last / 2) + at(last.div_ceil(2))),
            std: spread.sqrt(),
            min: at(0),
            max: at(last),
        }
    }
}

/// A similarity transform: a point is scaled, turned and moved, in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Turns and moves.
    pub isometry: Isometry<World, World>,
    /// Scales; 1 in a rigid alignment.
    pub scale: f64,
}

impl Similarity {
    /// Where a point comes to lie.
    pub fn apply(&self, p: Point<World>) -> Point<World> {
        self.isometry * Point::from_raw(p.raw * self.scale)
    }
}

/// The rigid transform that lays `estimate` over `truth`, position by position, with the least squared distances. Where
/// positions on a line or in one place leave it a choice, it is one of the best.
pub fn align_se3(
    truth: &[Point<World>],
    estimate: &[Point<World>],
) -> Result<Isometry<World, World>, EvaluationError> {
    umeyama(truth, estimate, false).map(|similarity| similarity.isometry)
}

/// The similarity transform that lays `estimate` over `truth` with the least squared distances.
pub fn align_sim3(
    truth: &[Point<World>],
    estimate: &[Point<World>],
) -> Result<Similarity, EvaluationError> {
    umeyama(truth, estimate, true)
}

fn umeyama(
    truth: &[Point<World>],
    estimate: &[Point<World>],
    with_scale: bool,
) -> Result<Similarity, EvaluationError> {
    if truth.len() != estimate.len() {
        return Err(EvaluationError::Lengths {
            truths: truth.len(),
            estimated: estimate.len(),
        });
    }
    if truth.is_empty() {
        return Err(too_few(0, 1, estimate.len(), truth.len()));
    }
    let n = truth.len() as f64;
    let mean = |points: &[Point<World>]| -> Vector3<f64> {
        points.iter().map(|p| p.raw.coords).sum::<Vector3<f64>>() / n
    };
    let (mean_y, mean_x) = (mean(truth), mean(estimate)); // Eq. (34), (35)
    let (mut covariance, mut variance) = (Matrix3::zeros(), 0.0);
    for (y, x) in truth.iter().zip(estimate) {
        let (y, x) = (y.raw.coords - mean_y, x.raw.coords - mean_x);
        covariance += y * x.transpose() / n; // Eq. (38)
        variance += x.norm_squared() / n; // Eq. (36)
    }
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        // Asked for above; numbers too large to square leave no rotation.
        return Ok(moved(Rotation3::identity(), 1.0, &mean_x, &mean_y));
    };
    // Eq. (43): a rotation, not a reflection; the singular values are in descending order.
    let mut signs = Vector3::new(1.0, 1.0, 1.0);
    if u.determinant() * v_t.determinant() < 0.0 {
        signs.z = -1.0;
    }
    let rotation = u * Matrix3::from_diagonal(&signs) * v_t; // Eq. (40)
    let scale = if with_scale && variance > 0.0 {
        svd.singular_values.dot(&signs) / variance // Eq. (42)
    } else {
        1.0
    };
    let rotation = Rotation3::from_matrix_unchecked(rotation);
    Ok(moved(rotation, scale, &mean_x, &mean_y))
}

/// Eq. (41).
fn moved(
    rotation: Rotation3<f64>,
    scale: f64,
    mean_x: &Vector3<f64>,
    mean_y: &Vector3<f64>,
) -> Similarity {
    let translation = Translation3::from(mean_y - scale * (rotation * mean_x));
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    Similarity {
        isometry: Isometry::claim(Isometry3::from_parts(translation, rotation)),
        scale,
    }
}

pub(super) fn too_few(
    found: usize,
    needed: usize,
    estimated: usize,
    truths: usize,
) -> EvaluationError {
    EvaluationError::TooFewPairs {
        found,
        needed,
        estimated,
        truths,
    }
}

/// The indices of poses that belong together, (truth, estimate), in order, as `tool` pairs them.
pub fn pairs<B>(
    truth: &Trajectory<B>,
    estimate: &Trajectory<B>,
    tool: Tool,
) -> Vec<(usize, usize)> {
    match tool {
        Tool::Evo if estimate.len() > truth.len() => nearest_pairs(truth, estimate, tool),
        Tool::Evo => nearest_pairs(estimate, truth, tool)
            .into_iter()
            .map(|(estimated, true_one)| (true_one, estimated))
            .collect(),
        Tool::TumBenchmark => greedy_pairs(truth, estimate, tool),
    }
}

fn nearest_pairs<B>(
    short: &Trajectory<B>,
    long: &Trajectory<B>,
    tool: Tool,
) -> Vec<(usize, usize)> {
    (short.poses().iter().enumerate())
        .filter_map(|(i, (at, _))| {
            let nearest = long.nearest(*at)?;
            let apart = long.poses()[nearest].0.distance(*at);
            (apart <= tool.max_difference()).then_some((i, nearest))
        })
        .collect()
}

fn greedy_pairs<B>(
    truth: &Trajectory<B>,
    estimate: &Trajectory<B>,
    tool: Tool,
) -> Vec<(usize, usize)> {
    let mut candidates = Vec::new();
    let mut first = 0;
    for (i, (at, _)) in truth.poses().iter().enumerate() {
        let earliest = *at - tool.max_difference();
        while estimate
            .poses()
            .get(first)
            .is_some_and(|(e, _)| *e < earliest)
        {
            first += 1;
        }
        for (j, (estimated_at, _)) in estimate.poses().iter().enumerate().skip(first) {
            let apart = estimated_at.distance(*at);
            if apart < tool.max_difference() {
                candidates.push((apart, i, j));
            } else if estimated_at > at {
                break;
            }
        }
    }
    candidates.sort_unstable();
    let (mut truth_used, mut estimate_used) =
        (vec![false; truth.len()], vec![false; estimate.len()]);
    let mut pairs: Vec<(usize, usize)> = candidates
        .into_iter()
        .filter_map(|(_, i, j)| {
            let free = !truth_used[i] && !estimate_used[j];
            if free {
                truth_used[i] = true;
                estimate_used[j] = true;
            }
            free.then_some((i, j))
        })
        .collect();
    pairs.sort_unstable();
    pairs
}

/// The absolute trajectory error after rigid alignment, root mean square in metres, as `evo_ape tum -a` computes it.
pub fn ate_rmse<B>(
    truth: &Trajectory<B>,
    estimate: &Trajectory<B>,
) -> Result<f64, EvaluationError> {
    ate(truth, estimate, Tool::Evo, Alignment::Rigid).map(|statistics| statistics.rmse)
}

/// The absolute trajectory error, in metres. At least three poses must belong together.
pub fn ate<B>(
    truth: &Trajectory<B>,
    estimate: &Trajectory<B>,
    tool: Tool,
    alignment: Alignment,
) -> Result<Statistics, EvaluationError> {
    const NEEDED: usize = 3;
    let pairs = pairs(truth, estimate, tool);
    if pairs.len() < NEEDED {
        return Err(too_few(pairs.len(), NEEDED, estimate.len(), truth.len()));
    }
    let (true_points, estimated): (Vec<_>, Vec<_>) = pairs
        .iter()
        .map(|&(i, j)| {
            (
                truth.poses()[i].1.translation(),
                estimate.poses()[j].1.translation(),
            )
        })
        .unzip();
    let similarity = match alignment {
        Alignment::None => moved(
            Rotation3::identity(),
            1.0,
            &Vector3::zeros(),
            &Vector3::zeros(),
        ),
        Alignment::Rigid => umeyama(&true_points, &estimated, false)?,
        Alignment::Similarity => umeyama(&true_points, &estimated, true)?,
    };
    let errors = (true_points.iter().zip(&estimated))
        .map(|(t, e)| (*t - similarity.apply(*e)).norm())
        .collect();
    Ok(Statistics::of(errors))
}

/// Between which poses relative motions are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delta {
    /// Poses so many paired poses apart, one after the other without overlap (`evo_rpe -d N -u f`).
    Frames(usize),
    /// The same with overlap, from every pose (`evo_rpe -d N -u f --all_pairs`).
    EveryFrames(usize),
    /// From every pose of the estimate to the one nearest to so much later (`evaluate_rpe.py --fixed_delta`).
    Time(Duration),
}

/// The relative pose error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeError {
    /// Of the translations, in metres.
    pub translation_m: Statistics,
    /// Of the rotations, in radians.
    pub rotation_rad: Statistics,
}

/// The relative pose error. `delta` says whose definition it is: frames as `evo_rpe`, time as `evaluate_rpe.py`.
pub fn rpe<B>(
    truth: &Trajectory<B>,
    estimate: &Trajectory<B>,
    delta: Delta,
) -> Result<RelativeError, EvaluationError> {
    let (q, p) = (truth.poses(), estimate.poses());
    let errors: Vec<Isometry3<f64>> = match delta {
        Delta::Frames(step) | Delta::EveryFrames(step) => {
            let paired = pairs(truth, estimate, Tool::Evo);
            let stride = if matches!(delta, Delta::Frames(_)) {
                step
            } else {
                1
            };
            (0..paired.len().saturating_sub(step))
                .step_by(stride.max(1))
                .map(|i| {
                    let ((a, b), (c, d)) = (paired[i], paired[i + step]);
                    let true_motion = q[a].1.raw.inv_mul(&q[c].1.raw);
                    true_motion.inv_mul(&p[b].1.raw.inv_mul(&p[d].1.raw))
                })
                .collect()
        }
        Delta::Time(span) => pairs_in_time(truth, estimate, span)
            .into_iter()
            .map(|[(a, b), (c, d)]| {
                // From the later to the earlier pose, estimate first, as the tool does.
                let estimated = p[d].1.raw.inv_mul(&p[b].1.raw);
                estimated.inv_mul(&q[c].1.raw.inv_mul(&q[a].1.raw))
            })
            .collect(),
    };
    if errors.is_empty() {
        return Err(too_few(0, 1, estimate.len(), truth.len()));
    }
    let translations = errors.iter().map(|e| e.translation.vector.norm()).collect();
    let rotations = errors.iter().map(|e| e.rotation.angle()).collect();
    Ok(RelativeError {
        translation_m: Statistics::of(translations),
        rotation_rad: Statistics::of(rotations),
    })
}

type Pair = (usize, usize);

/// The pairs (truth, estimate) at the beginning and the end of every motion that lasts `span`.
fn pairs_in_time<B>(
    truth: &Trajectory<B>,
    estimate: &Trajectory<B>,
    span: Duration,
) -> Vec<[Pair; 2]> {
    let mut intervals: Vec<Duration> = (truth.poses().windows(2))
        .map(|pair| pair[1].0.since(pair[0].0))
        .collect();
    intervals.sort_unstable();
    let Some(last) = intervals.len().checked_sub(1) else {
        return Vec::new();
    };
    // Twice the median.
    let max_difference = intervals[last / 2] + intervals[last.div_ceil(2)];
    let paired = |j: usize| {
        let at = estimate.poses()[j].0;
        let i = truth.nearest(at)?;
        (truth.poses()[i].0.distance(at) <= max_difference).then_some((i, j))
    };
    (0..estimate.len())
        .filter_map(|j| {
            let later = estimate.nearest(estimate.poses()[j].0 + span)?;
            // The tool leaves out motions that end with the last pose: most are shorter.
            (later + 1 != estimate.len()).then_some([paired(j)?, paired(later)?])
        })
        .collect()
}

/// The estimate laid over the truth by [`align_se3`] of the poses that belong together, for pictures of both.
pub fn aligned<B>(
    truth: &Trajectory<B>,
    estimate: &Trajectory<B>,
) -> Result<Trajectory<B>, EvaluationError> {
    let (true_points, estimated): (Vec<_>, Vec<_>) = pairs(truth, estimate, Tool::Evo)
        .into_iter()
        .map(|(i, j)| {
            (
                truth.poses()[i].1.translation(),
                estimate.poses()[j].1.translation(),
            )
        })
        .unzip();
    let truth_from_estimate = align_se3(&true_points, &estimated)?;
    Ok(Trajectory {
        poses: (estimate.poses().iter())
            .map(|(at, pose)| (*at, truth_from_estimate * *pose))
            .collect(),
    })
}

#[cfg(test)]
mod tests;
