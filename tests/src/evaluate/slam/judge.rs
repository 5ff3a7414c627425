//! How good an estimated trajectory is, and the table of all that was measured.

use std::time::Duration;

use maps::frame::Camera;
use maps::trajectory::Trajectory;
use maps::trajectory::drift;
use maps::trajectory::evaluation::{Alignment, Delta, Tool, ate, rpe};

use super::super::Table;
use super::job::Measured;

/// Drift is told of stretches of this length, of paths that are half as long again.
const STRETCH_M: f64 = 100.0;

/// A figure: its key and its value.
pub(super) type Figure = (&'static str, f64);

/// What a run measured of itself.
pub(super) fn cost(measured: &Measured) -> Vec<Figure> {
    let frames = measured.frames.max(1) as f64;
    let mut figures = vec![
        ("frames", measured.frames as f64),
        ("tracked_share", measured.tracked as f64 / frames),
        ("fps", measured.fps),
        ("p50_ms", measured.p50_ms),
        ("p99_ms", measured.p99_ms),
        ("cpu_ms", measured.cpu_ms),
    ];
    figures.extend(measured.peak_mb.map(|mb| ("peak_mb", mb)));
    figures.extend(measured.resets.map(|resets| ("resets", f64::from(resets))));
    figures
}

/// How far the estimate is from the truth. What cannot be compared is left out: a recording of a second has no motion over a
/// second, and an estimate of two frames no alignment.
pub(super) fn accuracy(truth: &Trajectory<Camera>, estimate: &Trajectory<Camera>) -> Vec<Figure> {
    let mut figures = Vec::new();
    let path_m = truth_along(truth, estimate).length_m();
    for (key, tool) in [("ate_rmse_m", Tool::TumBenchmark), ("ate_evo_m", Tool::Evo)] {
        let errors = ate(truth, estimate, tool, Alignment::Rigid);
        figures.extend(errors.ok().map(|errors| (key, errors.rmse)));
    }
    if let Ok(errors) = rpe(truth, estimate, Delta::Frames(1)) {
        figures.push(("rpe_trans_m", errors.translation_m.rmse));
        figures.push(("rpe_rot_deg", errors.rotation_rad.rmse.to_degrees()));
    }
    if let Ok(errors) = rpe(truth, estimate, Delta::Time(Duration::from_secs(1))) {
        figures.push(("rpe_1s_trans_m", errors.translation_m.rmse));
        figures.push(("rpe_1s_rot_deg", errors.rotation_rad.rmse.to_degrees()));
    }
    figures.push(("path_m", path_m));
    if path_m >= 1.5 * STRETCH_M {
        let tool = Tool::TumBenchmark;
        let drift = drift::percent_of_stretches(truth, estimate, STRETCH_M, tool);
        figures.extend(drift.ok().map(|percent| ("drift_percent", percent)));
        let end = drift::percent_at_end(truth, estimate, tool);
        figures.extend(end.ok().map(|percent| ("end_percent", percent)));
    }
    figures
}

/// The truth between the first and the last moment of the estimate: a recording may be an excerpt.
fn truth_along(truth: &Trajectory<Camera>, estimate: &Trajectory<Camera>) -> Trajectory<Camera> {
    let ends = estimate.poses().first().zip(estimate.poses().last());
    let during = |at| ends.is_some_and(|((first, _), (last, _))| (*first..=*last).contains(&at));
    let poses = truth.poses().iter().copied();
    let poses = poses.filter(|(at, _)| during(*at)).collect();
    // Part of a trajectory is one.
    Trajectory::new(poses).unwrap_or_else(|_| truth.clone())
}

/// All figures of one method on one recording.
pub(super) struct Row {
    pub(super) case: String,
    pub(super) method: String,
    pub(super) figures: Vec<Figure>,
}

impl Row {
    pub(super) fn get(&self, key: &str) -> Option<f64> {
        let mut figures = self.figures.iter();
        figures.find_map(|(known, value)| (*known == key).then_some(*value))
    }
}

/// What people read: the figures that matter, of all rows.
pub(super) fn table(rows: &[Row]) -> Table {
    let columns: [(&str, &str, usize); 14] = [
        ("ATE m", "ate_rmse_m", 4),
        ("at once", "ate_live_m", 4),
        ("RPE m", "rpe_trans_m", 4),
        ("RPE 1 s", "rpe_1s_trans_m", 4),
        ("path m", "path_m", 1),
        ("drift %", "drift_percent", 2),
        ("NEES", "nees", 2),
        ("tracked", "tracked_share", 3),
        ("fps", "fps", 1),
        ("p99 ms", "p99_ms", 1),
        ("CPU ms", "cpu_ms", 1),
        ("peak MB", "peak_mb", 0),
        ("ghosts", "ghost_share", 4),
        ("people", "ghost_people_share", 4),
    ];
    let row = |row: &Row| {
        let cells = columns.iter().map(|(_, key, digits)| {
            let value = row.get(key);
            value.map_or(String::new(), |value| format!("{value:.digits$}"))
        });
        let name = format!("{} {}", row.case, row.method);
        std::iter::once(name).chain(cells).collect()
    };
    Table {
        title: "SLAM: accuracy, cost and what a map keeps of those who moved".to_owned(),
        header: std::iter::once("")
            .chain(columns.iter().map(|(title, ..)| *title))
            .map(str::to_owned)
            .collect(),
        rows: rows.iter().map(row).collect(),
    }
}

#[cfg(test)]
mod tests {
    use maps::frame::Isometry;
    use maps::time::Stamp;
    use nalgebra::Isometry3;

    use super::*;

    /// A camera that goes east by half a metre every tenth of a second, and so much too far.
    fn east(frames: std::ops::Range<u64>, scale: f64) -> Trajectory<Camera> {
        let pose = |i: u64| {
            let pose = Isometry3::translation(0.5 * i as f64 * scale, 0.0, 0.0);
            (Stamp::from_nanos(i * 100_000_000), Isometry::claim(pose))
        };
        Trajectory::new(frames.map(pose).collect()).expect("increasing")
    }

    fn get(figures: &[Figure], key: &str) -> Option<f64> {
        let found = figures.iter().find(|(known, _)| *known == key);
        found.map(|(_, value)| *value)
    }

    #[test]
    fn a_long_flight_has_all_figures_and_each_tells_of_the_scale() {
        let figures = accuracy(&east(0..601, 1.0), &east(0..601, 1.01));
        let check = |key: &str, expected: f64| {
            let found = get(&figures, key).expect(key);
            assert!((found - expected).abs() < 1e-6 * expected, "{key}: {found}");
        };
        check("path_m", 300.0);
        check("drift_percent", 1.0);
        check("end_percent", 1.0);
        check("rpe_trans_m", 0.005);
        check("rpe_1s_trans_m", 0.05);
        // Evenly spread over ±1.5 m.
        let ate = get(&figures, "ate_rmse_m").expect("aligned");
        assert!((0.86..0.88).contains(&ate), "{ate}");
        assert!(get(&figures, "ate_evo_m").is_some_and(|evo| (evo - ate).abs() < 1e-9));
    }

    #[test]
    fn only_the_part_of_the_path_that_was_estimated_counts() {
        let figures = accuracy(&east(0..601, 1.0), &east(100..201, 1.0));
        let path_m = get(&figures, "path_m").expect("there is some");
        assert!((path_m - 50.0).abs() < 1e-9, "{path_m}");
        assert_eq!(get(&figures, "drift_percent"), None, "too short");
    }

    #[test]
    fn what_cannot_be_compared_is_left_out_and_nothing_is_nan() {
        let none = Trajectory::new(Vec::new()).expect("no poses");
        for estimate in [none, east(0..2, 1.0)] {
            let figures = accuracy(&east(0..20, 1.0), &estimate);
            assert_eq!(get(&figures, "ate_rmse_m"), None);
            assert!(figures.iter().all(|(_, value)| value.is_finite()));
        }
        let nothing = cost(&Measured::default());
        assert!(nothing.iter().all(|(_, value)| value.is_finite()));
    }
}
