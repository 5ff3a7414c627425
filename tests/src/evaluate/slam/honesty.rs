//! Whether poses are as far off as they are said to be: the normalised estimation error squared (NEES).
//!
//! ```text
//! ε = eᵀ·P⁻¹·e      e = (translation, rotation vector) of Ê⁻¹·A⁻¹·T      A = T₀·Ê₀⁻¹
//! ```
//!
//! with `Ê` the pose that was told at once, `P` its covariance, `T` the truth, `0` the first frame with a pose: covariances are
//! relative to where the map begins. If they are honest, ε is distributed as χ² with 6 degrees of freedom: its mean is 6, and 95 %
//! are below 12.6. Errors of one flight are alike, so that a single one may well be off by a factor.
//!
//! - Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 5.4.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::Context as _;
use maps::frame::Camera;
use maps::time::Stamp;
use maps::trajectory::Trajectory;
use nalgebra::{Matrix6, Vector6};

use super::judge::Figure;

/// Covariances that were told, by stamp; translation first, in the camera's axes.
pub(super) type Told = Vec<(Stamp, Matrix6<f64>)>;

/// 95 % quantile of χ² with 6 degrees of freedom.
const LIKELY: f64 = 12.592;

/// One covariance a line: stamp and 36 numbers.
pub(super) fn write(path: &Path, told: &Told) -> anyhow::Result<()> {
    let mut text = String::new();
    for (at, covariance) in told {
        // Writing to a string cannot fail.
        let _ = write!(text, "{at}");
        for number in covariance {
            let _ = write!(text, " {number:.9e}");
        }
        text.push('\n');
    }
    fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

pub(super) fn read(path: &Path) -> anyhow::Result<Told> {
    let text =
        fs::read_to_string(path).with_context(|| format!("it left no {}", path.display()))?;
    let line = |line: &str| {
        let mut numbers = line.split(' ').map(str::parse);
        let at = Stamp::from_secs_f64(numbers.next()?.ok()?)?;
        let covariance: Vec<f64> = numbers.collect::<Result<_, _>>().ok()?;
        (covariance.len() == 36).then(|| (at, Matrix6::from_column_slice(&covariance)))
    };
    let told: Option<Told> = text.lines().map(line).collect();
    told.with_context(|| format!("{} holds no covariances", path.display()))
}

/// `nees`, a sixth of the mean of ε, which should be 1; `nees_likely_share`, frames below the 95 % quantile. Nothing if there is nothing
/// to compare.
pub(super) fn figures(
    truth: &Trajectory<Camera>,
    live: &Trajectory<Camera>,
    told: &Told,
) -> Vec<Figure> {
    let near = |at: Stamp| {
        let after = truth.poses().partition_point(|(t, _)| *t < at);
        let found = truth.poses()[after.saturating_sub(1)..].iter().take(2);
        let found = found.min_by_key(|(t, _)| t.as_nanos().abs_diff(at.as_nanos()))?;
        (found.0.as_nanos().abs_diff(at.as_nanos()) < 1_000_000).then_some(found.1.raw)
    };
    let mut pairs = live
        .poses()
        .iter()
        .filter_map(|(at, pose)| Some((*at, pose.raw, near(*at)?)));
    let Some((_, first, first_truth)) = pairs.next() else {
        return Vec::new();
    };
    let world_from_truth = first * first_truth.inverse();
    let errors: Vec<f64> = pairs
        .filter_map(|(at, pose, truth)| {
            let index = told.partition_point(|(t, _)| t.as_nanos() + 500_000 < at.as_nanos());
            let (_, covariance) = told.get(index)?;
            let off = pose.inverse() * world_from_truth * truth;
            let (t, r) = (off.translation.vector, off.rotation.scaled_axis());
            let e = Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z);
            Some(e.dot(&covariance.cholesky()?.solve(&e)))
        })
        .collect();
    if errors.is_empty() {
        return Vec::new();
    }
    let count = errors.len() as f64;
    let likely = errors.iter().filter(|e| **e <= LIKELY).count();
    vec![
        ("nees", errors.iter().sum::<f64>() / count / 6.0),
        ("nees_likely_share", likely as f64 / count),
    ]
}

#[cfg(test)]
mod tests {
    use maps::frame::Isometry;
    use nalgebra::{Isometry3, Vector3};

    use super::*;

    fn at(i: u64) -> Stamp {
        Stamp::from_nanos(i * 33_333_333)
    }

    /// A camera that goes east, and so many metres beside it from the second frame on.
    fn path(beside_m: f64) -> Trajectory<Camera> {
        let pose = |i: u64| {
            let shift = Vector3::new(i as f64, if i > 0 { beside_m } else { 0.0 }, 0.0);
            let pose = Isometry3::new(shift, Vector3::new(0.0, 0.0, 0.7));
            (at(i), Isometry::claim(pose))
        };
        Trajectory::new((0..20).map(pose).collect()).expect("increasing")
    }

    fn told(sigma_m: f64) -> Told {
        let mut covariance = Matrix6::identity() * 1e-4;
        (0..3).for_each(|i| covariance[(i, i)] = sigma_m * sigma_m);
        (0..20).map(|i| (at(i), covariance)).collect()
    }

    #[test]
    fn an_error_counts_in_units_of_what_was_told_wherever_the_truth_begins() {
        let moved = |(at, pose): &(Stamp, Isometry<_, _>)| {
            let elsewhere =
                Isometry3::new(Vector3::new(5.0, 6.0, 7.0), Vector3::new(0.1, 0.2, 3.0));
            (*at, Isometry::claim(elsewhere * pose.raw))
        };
        let truth = Trajectory::new(path(0.0).poses().iter().map(moved).collect());
        let truth = truth.expect("increasing");
        for (sigma_m, nees, likely) in [(0.1, 4.0 / 6.0, 1.0), (0.05, 16.0 / 6.0, 0.0)] {
            let figures = figures(&truth, &path(0.2), &told(sigma_m));
            let [("nees", found), ("nees_likely_share", share)] = figures[..] else {
                panic!("{figures:?}");
            };
            assert!((found - nees).abs() < 1e-6 && (share - likely).abs() < 1e-9);
        }
    }

    #[test]
    fn what_was_told_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("told.txt");
        let mut before = told(0.1);
        before[3].1[(0, 4)] = -3.25e-7;
        write(&path, &before).expect("written");
        let after = read(&path).expect("read");
        assert_eq!(after.len(), 20);
        assert!((after[3].1 - before[3].1).norm() < 1e-12);
        fs::write(&path, "0.5 1 2 3\n").expect("written");
        assert!(
            read(&path)
                .expect_err("cut")
                .to_string()
                .contains("told.txt")
        );
    }

    #[test]
    fn nothing_is_said_of_no_poses() {
        let none = Trajectory::new(Vec::new()).expect("no poses");
        assert!(figures(&none, &path(0.0), &told(0.1)).is_empty());
        assert!(figures(&path(0.0), &none, &told(0.1)).is_empty());
        assert!(figures(&path(0.0), &path(0.0), &Told::new()).is_empty());
    }
}
