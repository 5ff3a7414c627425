use std::fs;
use std::path::Path;

use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::frame::Camera;
use crate::time::Stamp;
use crate::trajectory::tum;

const RECORDINGS: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../shared/data/trajectories"
);

/// A trajectory from the recordings; none, with a note, where they are absent.
fn recorded(name: &str) -> Option<Trajectory<Camera>> {
    let path = Path::new(RECORDINGS).join(format!("freiburg1_xyz-{name}.txt"));
    if let Ok(text) = fs::read_to_string(&path) {
        return Some(tum::parse(&text).expect("a trajectory"));
    }
    println!("skipped: there is no {}", path.display());
    None
}

#[track_caller]
fn check_close(found: f64, expected: f64) {
    assert!(
        (found - expected).abs() < 1e-9,
        "{found} instead of {expected}"
    );
}

/// The answers of `evo` 1.x (API, float64) for `freiburg1_xyz`: pairs; RMSE as it is, rigid, similarity; RPE of 1, 10, and
/// 10 frames from every pose, translation in metres and rotation in radians.
#[track_caller]
fn check_evo(name: &str, count: usize, ape: [f64; 3], rpe_of: [(f64, f64); 3]) {
    let (Some(truth), Some(estimate)) = (recorded("groundtruth"), recorded(name)) else {
        return;
    };
    let kinds = [Alignment::None, Alignment::Rigid, Alignment::Similarity];
    for (alignment, expected) in kinds.into_iter().zip(ape) {
        let found = ate(&truth, &estimate, Tool::Evo, alignment).expect("comparable");
        assert_eq!(found.count, count);
        check_close(found.rmse, expected);
    }
    let deltas = [Delta::Frames(1), Delta::Frames(10), Delta::EveryFrames(10)];
    for (delta, (translation, rotation)) in deltas.into_iter().zip(rpe_of) {
        let found = rpe(&truth, &estimate, delta).expect("comparable");
        check_close(found.translation_m.rmse, translation);
        check_close(found.rotation_rad.rmse, rotation);
    }
}

#[test]
fn the_errors_of_a_drifting_estimate_are_those_of_evo() {
    check_evo(
        "rgbdslam_drift",
        785,
        [0.134_185_420_489, 0.013_470_118_951_4, 0.013_389_416_164_9],
        [
            (0.005_764_378_833_03, 0.006_171_720_485_84),
            (0.014_610_204_865_9, 0.012_244_829_183_4),
            (0.014_040_694_883_9, 0.011_777_114_361_5),
        ],
    );
}

#[test]
fn the_errors_of_a_monocular_estimate_of_keyframes_are_those_of_evo() {
    check_evo(
        "ORB_kf_mono",
        32,
        [2.025_141_545_69, 0.024_301_632_277_6, 0.009_754_581_898_69],
        [
            (0.025_265_936_345_4, 0.015_443_527_73),
            (0.047_411_268_990_7, 0.013_532_292_111_1),
            (0.037_581_868_123_1, 0.018_701_137_568_5),
        ],
    );
}

#[test]
fn all_statistics_are_those_of_evo() {
    let (Some(truth), Some(estimate)) = (recorded("groundtruth"), recorded("rgbdslam_drift"))
    else {
        return;
    };
    let found = ate(&truth, &estimate, Tool::Evo, Alignment::Rigid).expect("comparable");
    check_close(found.mean, 0.012_024_516_062_2);
    check_close(found.median, 0.011_183_137_957_4);
    check_close(found.std, 0.006_070_841_624_84);
    check_close(found.min, 0.000_955_520_301_245);
    check_close(found.max, 0.034_759_897_174_1);
    check_close(ate_rmse(&truth, &estimate).expect("comparable"), found.rmse);
}

/// The answers of the TUM benchmark's tools, `evaluate_rpe.py` with `--fixed_delta`.
#[track_caller]
fn check_tum(
    name: &str,
    (count, ate_m): (usize, f64),
    (motions, rpe_m, rpe_rad): (usize, f64, f64),
) {
    let (Some(truth), Some(estimate)) = (recorded("groundtruth"), recorded(name)) else {
        return;
    };
    let found = ate(&truth, &estimate, Tool::TumBenchmark, Alignment::Rigid).expect("comparable");
    assert_eq!(found.count, count);
    check_close(found.rmse, ate_m);
    let second = Delta::Time(Duration::from_secs(1));
    let found = rpe(&truth, &estimate, second).expect("comparable");
    assert_eq!(found.translation_m.count, motions);
    check_close(found.translation_m.rmse, rpe_m);
    check_close(found.rotation_rad.rmse, rpe_rad);
}

#[test]
fn the_errors_are_those_of_the_tum_benchmark() {
    let drift = (753, 0.021_217_486_641_807_937, 0.016_309_822_633_824_477);
    check_tum("rgbdslam_drift", (786, 0.013_473_498_381_254_091), drift);
    let mono = (30, 0.031_423_132_555_853_16, 0.018_732_685_910_452_986);
    check_tum("ORB_kf_mono", (32, 0.024_301_632_277_621_017), mono);
}

/// The made-up truth of these tests: a spiral with a stamp every 0.1 s.
fn spiral(count: usize) -> Trajectory<Camera> {
    let poses = (0..count)
        .map(|i| {
            let t = 0.1 * i as f64;
            let pose = Isometry3::new(
                Vector3::new(t.cos(), t.sin(), 0.2 * t),
                Vector3::new(0.1 * t, 0.0, t),
            );
            (
                Stamp::from_nanos(1_000_000_000 + i as u64 * 100_000_000),
                Isometry::claim(pose),
            )
        })
        .collect();
    Trajectory::new(poses).expect("increasing")
}

/// The same poses seen from another world, `late` later.
fn moved_by(
    trajectory: &Trajectory<Camera>,
    moved: Isometry3<f64>,
    late: Duration,
) -> Trajectory<Camera> {
    let poses = (trajectory.poses().iter())
        .map(|(at, pose)| (*at + late, Isometry::claim(moved * pose.raw)))
        .collect();
    Trajectory::new(poses).expect("increasing")
}

proptest! {
    #[test]
    fn an_estimate_in_another_world_has_no_error_left(
        t in prop::array::uniform3(-50.0..50.0_f64), r in prop::array::uniform3(-3.0..3.0_f64)
    ) {
        let truth = spiral(40);
        let estimate = moved_by(&truth, Isometry3::new(t.into(), r.into()), Duration::ZERO);
        prop_assert!(ate_rmse(&truth, &estimate).expect("comparable") < 1e-9, "rounding of 50 m");
        let relative = rpe(&truth, &estimate, Delta::Frames(3)).expect("comparable");
        prop_assert!(relative.translation_m.max < 1e-9 && relative.rotation_rad.max < 1e-6);
        let over = aligned(&truth, &estimate).expect("comparable");
        for ((_, a), (_, b)) in truth.poses().iter().zip(over.poses()) {
            prop_assert!((a.translation() - b.translation()).norm() < 1e-9);
        }
    }

    #[test]
    fn a_scaled_estimate_is_brought_back_to_scale(scale in 0.1..10.0_f64, r in prop::array::uniform3(-3.0..3.0_f64)) {
        let truth: Vec<_> = spiral(40).poses().iter().map(|(_, pose)| pose.translation()).collect();
        let turned = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), r.into());
        let estimate: Vec<_> = truth.iter().map(|p| Point::from_raw(turned * Point3::from(p.raw.coords / scale))).collect();
        let found = align_sim3(&truth, &estimate).expect("comparable");
        prop_assert!((found.scale - scale).abs() < 1e-9 * scale);
        for (t, e) in truth.iter().zip(&estimate) {
            prop_assert!((*t - found.apply(*e)).norm() < 1e-9);
        }
    }

    #[test]
    fn no_rotation_and_shift_is_better_than_the_aligned_one(
        noise in prop::collection::vec(prop::array::uniform3(-0.3..0.3_f64), 12),
        t in prop::array::uniform3(-0.1..0.1_f64), r in prop::array::uniform3(-0.1..0.1_f64)
    ) {
        let truth: Vec<_> = spiral(12).poses().iter().map(|(_, pose)| pose.translation()).collect();
        let estimate: Vec<_> = truth.iter().zip(&noise)
            .map(|(p, n)| Point::from_raw(p.raw + Vector3::from(*n))).collect();
        let best = align_se3(&truth, &estimate).expect("comparable");
        let other = Isometry::claim(Isometry3::new(t.into(), r.into()) * best.raw);
        let sum = |by: Isometry<World, World>| -> f64 {
            truth.iter().zip(&estimate).map(|(t, e)| (*t - by * *e).norm().powi(2)).sum()
        };
        prop_assert!(sum(best) <= sum(other) + 1e-12);
    }
}

#[test]
fn poses_on_a_line_or_in_one_place_are_aligned_all_the_same() {
    let line = |scale: f64| -> Vec<Point<World>> {
        (0..9)
            .map(|i| Point::new(scale * f64::from(i), 1.0, 2.0))
            .collect()
    };
    for scale in [1.0, 0.0] {
        let (truth, estimate) = (line(scale), line(scale));
        let found = align_se3(&truth, &estimate).expect("comparable");
        for (t, e) in truth.iter().zip(&estimate) {
            assert!((*t - found * *e).norm() < 1e-9, "scale {scale}");
        }
    }
}

#[test]
fn stamps_farther_apart_than_the_tool_allows_are_not_paired() {
    let truth = spiral(10);
    let late = |millis| moved_by(&truth, Isometry3::identity(), Duration::from_millis(millis));
    assert_eq!(
        pairs(&truth, &late(10), Tool::Evo).len(),
        10,
        "10 ms is just near enough"
    );
    assert_eq!(pairs(&truth, &late(11), Tool::Evo).len(), 0);
    assert_eq!(pairs(&truth, &late(19), Tool::TumBenchmark).len(), 10);
    assert_eq!(
        pairs(&truth, &late(20), Tool::TumBenchmark).len(),
        0,
        "20 ms is just too far"
    );
}

#[test]
fn trajectories_without_a_common_moment_cannot_be_compared() {
    let (truth, empty) = (spiral(10), Trajectory::new(Vec::new()).expect("no poses"));
    let late = moved_by(&truth, Isometry3::identity(), Duration::from_mins(1));
    for estimate in [&empty, &late] {
        for tool in [Tool::Evo, Tool::TumBenchmark] {
            let found = ate(&truth, estimate, tool, Alignment::Rigid);
            assert!(matches!(
                found,
                Err(EvaluationError::TooFewPairs { found: 0, .. })
            ));
        }
        for delta in [
            Delta::Frames(1),
            Delta::EveryFrames(0),
            Delta::Time(Duration::from_secs(1)),
        ] {
            assert!(rpe(&truth, estimate, delta).is_err());
        }
        assert!(aligned(&truth, estimate).is_err());
    }
    let unequal = align_se3(&[Point::origin()], &[]);
    assert_eq!(
        unequal,
        Err(EvaluationError::Lengths {
            truths: 1,
            estimated: 0
        })
    );
}
