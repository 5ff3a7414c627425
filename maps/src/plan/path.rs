//! A path as its waypoints.

use super::footprint::Checker;
use super::motion::{Gear, Motion, Pose2};

/// A pose on a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// Where the middle of the rear axle shall be.
    pub pose: Pose2,
    /// The gear in which the vehicle arrives here; at the first waypoint, in which it leaves.
    pub gear: Gear,
}

/// A drivable path.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// From the start to the goal, evenly spaced between changes of gear, each of which has one. A path that begins at its
    /// goal has one waypoint.
    pub waypoints: Vec<Waypoint>,
    /// Length of the drive.
    pub length_m: f64,
    /// Least distance from the footprint to a blocked cell on the whole path, to 1 cm; infinite where nothing is blocked.
    pub min_clearance_m: f64,
}

impl Path {
    /// How often the gear changes on the way.
    pub fn gear_changes(&self) -> usize {
        self.waypoints
            .windows(2)
            .filter(|pair| pair[0].gear != pair[1].gear)
            .count()
    }
}

/// The waypoints along `motions` and what a path tells of itself.
pub(crate) fn sampled(
    checker: &Checker<'_>,
    start: &Pose2,
    motions: &[Motion],
    spacing_m: f64,
) -> Path {
    let mut path = Path {
        waypoints: vec![Waypoint {
            pose: *start,
            gear: motions.first().map_or(Gear::Forward, Motion::gear),
        }],
        length_m: motions.iter().map(Motion::length_m).sum(),
        min_clearance_m: checker.clearance_m(start, f64::INFINITY),
    };
    let mut pose = *start;
    for run in motions.chunk_by(|a, b| a.gear() == b.gear()) {
        let length: f64 = run.iter().map(Motion::length_m).sum();
        let apart = length / (length / spacing_m).ceil().max(1.0);
        // Distance along the run at which the current motion begins, and of the last waypoint.
        let (mut begun, mut last) = (0.0, 0.0);
        for motion in run {
            let end = begun + motion.length_m();
            // The end of the run has its own waypoint, below.
            while last + apart <= end && last + 1.5 * apart < length {
                last += apart;
                path.waypoints.push(Waypoint {
                    pose: motion.at(&pose, last - begun),
                    gear: motion.gear(),
                });
            }
            path.min_clearance_m = least_clearance(checker, &pose, motion, path.min_clearance_m);
            pose = motion.end(&pose);
            begun = end;
        }
        if let Some(motion) = run.last() {
            path.waypoints.push(Waypoint {
                pose,
                gear: motion.gear(),
            });
        }
    }
    path
}

/// The least clearance along a motion, to [`FINE_M`], or `least_m` if that is less. Where there is more than that, the next
/// place to look at is as far as no corner can come nearer.
fn least_clearance(checker: &Checker<'_>, from: &Pose2, motion: &Motion, least_m: f64) -> f64 {
    let (mut least, mut driven) = (least_m, 0.0);
    let mut pose = *from;
    loop {
        let mut clearance = checker.clearance_at_least_m(&pose);
        if clearance < least + FINE_M {
            clearance = checker.clearance_m(&pose, least + ENOUGH_M);
        }
        least = least.min(clearance);
        let spare = clearance - least;
        if driven >= motion.length_m() || spare.is_nan() {
            return least;
        }
        driven += spare.max(FINE_M) / checker.footprint.sweep();
        driven = driven.min(motion.length_m());
        pose = motion.at(from, driven);
    }
}

/// How exact the clearance of a path is.
const FINE_M: f64 = 0.02;
/// More clearance than the least so far plus this is not measured.
const ENOUGH_M: f64 = 1.0;
