//! How far an estimate comes off the truth on its way, in per cent of the way.
//!
//! The absolute error depends on how long a recording is and whether it comes back to where it began; drift does not. Two
//! figures are in use:
//!
//! ```text
//! of stretches:  mean over i of ‖trans Eᵢ‖ / L        Eᵢ as in the relative pose error, from pose i to the first that is
//!                                                     at least L farther on along the true path
//! at the end:    ‖trans((Q₀⁻¹ Qₙ)⁻¹ (P₀⁻¹ Pₙ))‖ / path        Q true, P estimated
//! ```
//!
//! The first is that of the KITTI odometry benchmark, with a stretch from every pose, not from every tenth. The second is how far
//! off the last position is if the first pose is right: a wrong heading at the start tells in full.
//!
//! - A. Geiger, P. Lenz and R. Urtasun, *Are we ready for autonomous driving? The KITTI vision benchmark suite*, CVPR 2012,
//!   section 3.1.

use nalgebra::Isometry3;

use super::Trajectory;
use super::evaluation::{EvaluationError, Tool, pairs, too_few};

/// Mean error of the translation over all stretches of `length_m` along the true path, in per cent of that length. Poses are
/// paired as `tool` does it.
///
/// A path that is shorter has no such stretch and is refused, as is a length that is not positive.
pub fn percent_of_stretches<B>(
    truth: &Trajectory<B>,
    estimate: &Trajectory<B>,
    length_m: f64,
    tool: Tool,
) -> Result<f64, EvaluationError> {
    let poses = paired(truth, estimate, tool);
    let mut travelled_m = vec![0.0];
    for pair in poses.windows(2) {
        let step = pair[1].0.translation.vector - pair[0].0.translation.vector;
        travelled_m.push(travelled_m.last().copied().unwrap_or(0.0) + step.norm());
    }
    let none = || too_few(0, 1, estimate.len(), truth.len());
    if !length_m.is_finite() || length_m <= 0.0 {
        return Err(none());
    }
    let (mut sum, mut count) = (0.0, 0_u32);
    let mut end = 0;
    for start in 0..poses.len() {
        while end < poses.len() && travelled_m[end] - travelled_m[start] < length_m {
            end += 1;
        }
        if end == poses.len() {
            break;
        }
        sum += off(&poses[start], &poses[end]);
        count += 1;
    }
    if count == 0 {
        return Err(none());
    }
    Ok(100.0 * sum / f64::from(count) / length_m)
}

/// How far off the last position is where the first pose is laid over the truth, in per cent of the length of the true path
/// between them. At least two poses must belong together, and the truth must have moved.
pub fn percent_at_end<B>(
    truth: &Trajectory<B>,
    estimate: &Trajectory<B>,
    tool: Tool,
) -> Result<f64, EvaluationError> {
    let poses = paired(truth, estimate, tool);
    let path_m: f64 = (poses.windows(2))
        .map(|pair| (pair[1].0.translation.vector - pair[0].0.translation.vector).norm())
        .sum();
    match (poses.first(), poses.last()) {
        (Some(first), Some(last)) if path_m > 0.0 => Ok(100.0 * off(first, last) / path_m),
        _ => Err(too_few(poses.len(), 2, estimate.len(), truth.len())),
    }
}

type Pair = (Isometry3<f64>, Isometry3<f64>);

/// The poses that belong together: true, estimated.
fn paired<B>(truth: &Trajectory<B>, estimate: &Trajectory<B>, tool: Tool) -> Vec<Pair> {
    (pairs(truth, estimate, tool).into_iter())
        .map(|(i, j)| (truth.poses()[i].1.raw, estimate.poses()[j].1.raw))
        .collect()
}

/// How far apart the translations of the true and the estimated motion between two moments are.
fn off(from: &Pair, to: &Pair) -> f64 {
    let true_motion = from.0.inv_mul(&to.0);
    let estimated = from.1.inv_mul(&to.1);
    true_motion.inv_mul(&estimated).translation.vector.norm()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};
    use proptest::prelude::*;

    use super::*;
    use crate::frame::{Camera, Isometry};
    use crate::time::Stamp;

    /// A camera that goes east by a metre a second, its poses changed by `change`.
    fn east(
        metres: u32,
        change: impl Fn(f64, Isometry3<f64>) -> Isometry3<f64>,
    ) -> Trajectory<Camera> {
        let pose = |x: u32| {
            let at = Stamp::from_nanos(u64::from(x) * 1_000_000_000);
            let pose = Isometry3::translation(f64::from(x), 0.0, 0.0);
            (at, Isometry::claim(change(f64::from(x), pose)))
        };
        Trajectory::new((0..=metres).map(pose).collect()).expect("increasing")
    }

    fn scaled(metres: u32, scale: f64) -> Trajectory<Camera> {
        east(metres, |x, _| Isometry3::translation(scale * x, 0.0, 0.0))
    }

    #[test]
    fn an_estimate_that_is_one_per_cent_too_long_drifts_by_one_per_cent() {
        let (truth, long) = (scaled(300, 1.0), scaled(300, 1.01));
        for length_m in [1.0, 50.0, 100.0, 300.0] {
            let found =
                percent_of_stretches(&truth, &long, length_m, Tool::Evo).expect("stretches");
            assert!((found - 1.0).abs() < 1e-9, "{found} over {length_m} m");
        }
        let at_end = percent_at_end(&truth, &long, Tool::Evo).expect("a path");
        assert!((at_end - 1.0).abs() < 1e-9, "{at_end}");
    }

    #[test]
    fn a_jump_counts_in_the_stretches_across_it_only() {
        let truth = scaled(100, 1.0);
        let jumped = east(100, |x, pose| {
            Isometry3::translation(0.0, if x > 49.5 { 0.5 } else { 0.0 }, 0.0) * pose
        });
        // Of the 91 stretches of 10 m, those that begin at 40 to 49 m.
        let found = percent_of_stretches(&truth, &jumped, 10.0, Tool::Evo).expect("stretches");
        assert!((found - 5.0 * 10.0 / 91.0).abs() < 1e-9, "{found}");
        let at_end = percent_at_end(&truth, &jumped, Tool::Evo).expect("a path");
        assert!((at_end - 0.5).abs() < 1e-9, "{at_end}");
    }

    #[test]
    fn a_path_that_is_too_short_or_stands_still_has_no_drift() {
        let truth = scaled(20, 1.0);
        for length_m in [21.0, 0.0, -1.0, f64::NAN, f64::INFINITY] {
            let found = percent_of_stretches(&truth, &truth, length_m, Tool::Evo);
            assert!(found.is_err(), "{length_m}");
        }
        let still = scaled(20, 0.0);
        assert!(percent_at_end(&still, &truth, Tool::Evo).is_err());
        let none = Trajectory::new(Vec::new()).expect("no poses");
        assert!(percent_at_end(&none, &truth, Tool::Evo).is_err());
        assert!(percent_of_stretches(&truth, &none, 5.0, Tool::TumBenchmark).is_err());
    }

    proptest! {
        #[test]
        fn neither_figure_depends_on_the_estimates_world(
            t in prop::array::uniform3(-50.0..50.0_f64), r in prop::array::uniform3(-3.0..3.0_f64)
        ) {
            let truth = scaled(60, 1.0);
            let estimate = |moved: Isometry3<f64>| {
                east(60, |x, pose| moved * pose * Isometry3::rotation(Vector3::z() * 0.001 * x))
            };
            let here = estimate(Isometry3::identity());
            let there = estimate(Isometry3::new(t.into(), r.into()));
            let both = [&here, &there].map(|e| {
                [
                    percent_of_stretches(&truth, e, 25.0, Tool::Evo).expect("stretches"),
                    percent_at_end(&truth, e, Tool::Evo).expect("a path"),
                ]
            });
            prop_assert!((both[0][0] - both[1][0]).abs() < 1e-9);
            prop_assert!((both[0][1] - both[1][1]).abs() < 1e-9);
            prop_assert!(both[0][0] > 0.1, "a heading that turns away is drift");
        }
    }
}
