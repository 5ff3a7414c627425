//! Where something was and when: stamped poses, in the text format of the TUM RGB-D benchmark, and how far an estimate is
//! from the truth.
//!
//! - [`Trajectory`] holds the poses, in order; [`tum`] reads and writes them.
//! - [`evaluation`] pairs two trajectories by stamp, lays one over the other and measures the absolute (ATE) and the
//!   relative (RPE) error, as `evo` does or as the benchmark's own tool does.
//! - [`drift`] is the error in per cent of the way.

pub mod drift;
pub mod evaluation;
pub mod tum;

use std::time::Duration;

use crate::frame::{Isometry, World};
use crate::time::Stamp;

/// The poses of a frame `B` in the world of one source, at stamps that strictly increase; each pose is finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory<B> {
    poses: Vec<(Stamp, Isometry<World, B>)>,
}

/// Why poses are no trajectory.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrajectoryError {
    /// A stamp is not after the one before.
    #[error("pose {index} is stamped {at} s, not after the one before at {previous} s")]
    NotIncreasing {
        /// Counted from 0.
        index: usize,
        /// Its stamp.
        at: Stamp,
        /// The stamp before.
        previous: Stamp,
    },
    /// A NaN or an infinity in a pose.
    #[error("pose {index} is not finite")]
    NotFinite {
        /// Counted from 0.
        index: usize,
    },
}

impl<B> Trajectory<B> {
    /// The trajectory through these poses.
    pub fn new(poses: Vec<(Stamp, Isometry<World, B>)>) -> Result<Self, TrajectoryError> {
        if let Some(index) = poses.iter().position(|(_, pose)| !pose.is_finite()) {
            return Err(TrajectoryError::NotFinite { index });
        }
        match (1..poses.len()).find(|&i| poses[i].0 <= poses[i - 1].0) {
            Some(index) => Err(TrajectoryError::NotIncreasing {
                index,
                at: poses[index].0,
                previous: poses[index - 1].0,
            }),
            None => Ok(Self { poses }),
        }
    }

    /// The poses, in order.
    pub fn poses(&self) -> &[(Stamp, Isometry<World, B>)] {
        &self.poses
    }

    /// How many poses there are.
    pub fn len(&self) -> usize {
        self.poses.len()
    }

    /// Whether there is no pose.
    pub fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }

    /// Length of the straight lines from pose to pose.
    pub fn length_m(&self) -> f64 {
        self.poses
            .windows(2)
            .map(|pair| (pair[1].1.translation() - pair[0].1.translation()).norm())
            .sum()
    }

    /// The pose at any moment between two that are at most `max_gap` apart: the position on the straight line between
    /// them, the rotation on the shorter arc. `None` before the first, after the last and in wider gaps.
    pub fn interpolated(&self, at: Stamp, max_gap: Duration) -> Option<Isometry<World, B>> {
        let after = self.poses.partition_point(|(stamp, _)| *stamp < at);
        let (next_at, next) = self.poses.get(after)?;
        if *next_at == at {
            return Some(*next);
        }
        let (last_at, last) = self.poses.get(after.checked_sub(1)?)?;
        let gap = next_at.since(*last_at);
        if gap > max_gap {
            return None;
        }
        let share = at.since(*last_at).as_secs_f64() / gap.as_secs_f64();
        Some(Isometry::claim(
            last.raw
                .try_lerp_slerp(&next.raw, share, 1e-9)
                .unwrap_or(last.raw),
        ))
    }

    /// The index of the pose nearest in time; the earlier of two equally near ones.
    pub(crate) fn nearest(&self, at: Stamp) -> Option<usize> {
        let after = self.poses.partition_point(|(stamp, _)| *stamp < at);
        let before = after.checked_sub(1);
        match (before, self.poses.get(after)) {
            (None, None) => None,
            (Some(before), None) => Some(before),
            (None, Some(_)) => Some(after),
            (Some(before), Some((next, _))) => {
                let nearer = next.distance(at) < at.distance(self.poses[before].0);
                Some(if nearer { after } else { before })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::{Isometry3, Vector3};

    use super::*;
    use crate::frame::Body;

    fn at(seconds: f64, x: f64, turn: f64) -> (Stamp, Isometry<World, Body>) {
        let pose = Isometry3::new(Vector3::new(x, 0.0, 0.0), Vector3::new(0.0, 0.0, turn));
        let stamp = Stamp::from_secs_f64(seconds).expect("a stamp");
        (stamp, Isometry::claim(pose))
    }

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn between_two_poses_the_vehicle_moves_and_turns_evenly() {
        let trajectory =
            Trajectory::new(vec![at(1.0, 0.0, 3.0), at(2.0, 4.0, -3.0)]).expect("increasing");
        let quarter = Stamp::from_secs_f64(1.25).expect("a stamp");
        let pose = trajectory
            .interpolated(quarter, SECOND)
            .expect("in between");
        assert!((pose.translation().raw.x - 1.0).abs() < 1e-12);
        // By the shorter arc, over π.
        let turn = 3.0 + 0.25 * (2.0 * PI - 6.0);
        assert!((pose.rotation().euler_angles().2 - turn).abs() < 1e-12);
    }

    #[test]
    fn outside_of_the_trajectory_and_in_wide_gaps_there_is_no_pose() {
        let trajectory =
            Trajectory::new(vec![at(1.0, 0.0, 0.0), at(3.0, 4.0, 0.0)]).expect("increasing");
        for seconds in [0.5, 3.5, 2.0] {
            let stamp = Stamp::from_secs_f64(seconds).expect("a stamp");
            assert!(
                trajectory.interpolated(stamp, SECOND).is_none(),
                "{seconds} s"
            );
        }
        let last = Stamp::from_nanos(3_000_000_000);
        assert!(trajectory.interpolated(last, SECOND).is_some());
        let none = Trajectory::<Body>::new(Vec::new()).expect("no poses");
        assert!(none.interpolated(last, SECOND).is_none() && none.nearest(last).is_none());
    }

    #[test]
    fn turning_by_exactly_half_a_turn_is_interpolated_without_nan() {
        let trajectory =
            Trajectory::new(vec![at(1.0, 0.0, 0.0), at(2.0, 4.0, PI)]).expect("increasing");
        let stamp = Stamp::from_secs_f64(1.5).expect("a stamp");
        assert!(
            trajectory
                .interpolated(stamp, SECOND)
                .expect("in between")
                .is_finite()
        );
    }

    #[test]
    fn poses_out_of_order_or_not_finite_are_refused_by_index() {
        let back = Trajectory::new(vec![
            at(1.0, 0.0, 0.0),
            at(2.0, 0.0, 0.0),
            at(2.0, 0.0, 0.0),
        ]);
        assert!(matches!(
            back,
            Err(TrajectoryError::NotIncreasing { index: 2, .. })
        ));
        let nan = Trajectory::new(vec![at(1.0, 0.0, 0.0), at(2.0, f64::NAN, 0.0)]);
        assert_eq!(nan, Err(TrajectoryError::NotFinite { index: 1 }));
    }
}
