//! Positions by satellites. Each is tied to the keyframe next to which the camera was then; now and then the map is bent to all of
//! them ([`super::bending`]).
//!
//! What a receiver says is wrong in nearly the same way for a while (ionosphere, orbits, reflections): so one position a
//! second is kept, and so much less is believed of each.

use std::time::Duration;

use maps::time::Stamp;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::Slam;
use crate::aid::Fix;
use crate::georeference::Sighted;
use crate::map::{KeyframeId, Renaming};

/// One in so much time is kept.
const APART: Duration = Duration::from_secs(1);
/// How many positions in a row, that long apart, are wrong alike: of a receiver alone, half a minute of them; of one that is sent
/// corrections, and says so by its accuracy, as long as its reflections last.
const ALIKE: f64 = 30.0;
const ALIKE_CORRECTED: f64 = 5.0;
const CORRECTED_M: f64 = 1.0;
/// Positions kept: half an hour. Beyond, every other one is forgotten.
const MOST: usize = 1800;
/// A position so much older than the last frame is too late.
const LATEST: Duration = Duration::from_secs(2);

/// What satellites have said so far.
#[derive(Default)]
pub(super) struct Positions {
    tied: Vec<Tied>,
    last: Option<Stamp>,
    /// Those that came since the map was last bent.
    pub(super) new: usize,
    pub(super) world_from_enu: Option<Isometry3<f64>>,
}

/// A position, and which keyframe was nearest in time.
struct Tied {
    map: u32,
    keyframe: KeyframeId,
    /// Where the antenna was, in the axes of the keyframe.
    from_keyframe: Vector3<f64>,
    in_enu: Vector3<f64>,
    covariance: Matrix3<f64>,
}

impl Slam {
    /// How the map's world lies on the Earth, as far as positions have told: `world_from_enu`. East, north and up count
    /// from the origin of the positions.
    pub fn world_from_enu(&self) -> Option<Isometry3<f64>> {
        self.positions.world_from_enu
    }

    /// Keeps a position, if the camera was tracked then.
    pub(super) fn note_position(&mut self, fix: &Fix) {
        let is_next = self
            .positions
            .last
            .is_none_or(|last| fix.at >= last + APART);
        let numbers = fix
            .position
            .iter()
            .chain(&fix.antenna_in_camera)
            .chain(&fix.covariance);
        let is_sound = numbers.clone().all(|n| n.is_finite()) && fix.covariance.trace() > 0.0;
        let Some((map, keyframe, from_keyframe)) =
            self.antenna_at(fix).filter(|_| is_next && is_sound)
        else {
            return;
        };
        self.positions.last = Some(fix.at);
        self.positions.new += 1;
        self.positions.tied.push(Tied {
            map,
            keyframe,
            from_keyframe,
            in_enu: fix.position,
            covariance: fix.covariance,
        });
        if self.positions.tied.len() > MOST {
            let mut keep = false;
            self.positions.tied.retain(|_| {
                keep = !keep;
                keep
            });
        }
    }

    /// Where the antenna was at a moment between two tracked frames: map, keyframe, and place in the keyframe's axes.
    fn antenna_at(&self, fix: &Fix) -> Option<(u32, KeyframeId, Vector3<f64>)> {
        let at = fix.at;
        let antenna = Point3::from(fix.antenna_in_camera);
        let after = self.log.partition_point(|logged| logged.at < at);
        let later = self.log.get(after)?;
        let now = self.log.last()?.at;
        let earlier = self.log.get(after.saturating_sub(1))?;
        let between = later.at.since(earlier.at);
        if now.since(at) > LATEST || between > APART || earlier.map != later.map {
            return None;
        }
        let map = self.map_of(later.map)?;
        let reference = map.poses.get(later.reference.0 as usize)?;
        let other = map.poses.get(earlier.reference.0 as usize)?;
        let place = (later.reference_from_camera * antenna).coords;
        let before = reference.inverse() * other * (earlier.reference_from_camera * antenna);
        let share = if between.is_zero() {
            0.0
        } else {
            later.at.since(at).as_secs_f64() / between.as_secs_f64()
        };
        let in_keyframe = place.lerp(&before.coords, share.clamp(0.0, 1.0));
        Some((later.map, later.reference, in_keyframe))
    }

    /// Of the map in use, the keyframe of each position, where the antenna was then as known now, and the position. Keyframes that are
    /// culled stand by the nearest one that is kept.
    pub(super) fn sighted(&self) -> Vec<(KeyframeId, Sighted)> {
        let of = |tied: &Tied| {
            if tied.map != self.map.number {
                return None;
            }
            let keyframe = self.map.nearest_kept(tied.keyframe)?;
            let pose = self.map.poses.get(tied.keyframe.0 as usize)?;
            let sighted = Sighted {
                in_world: (pose * Point3::from(tied.from_keyframe)).coords,
                in_enu: tied.in_enu,
                covariance: tied.covariance,
            };
            Some((keyframe, sighted))
        };
        self.positions.tied.iter().filter_map(of).collect()
    }
}

impl Positions {
    /// The map of that number has become part of another one.
    pub(super) fn rename(&mut self, was: u32, is: u32, renaming: Renaming) {
        for tied in self.tied.iter_mut().filter(|tied| tied.map == was) {
            (tied.map, tied.keyframe) = (is, renaming.keyframe(tied.keyframe));
        }
    }
}

/// How many positions like this one are wrong alike.
pub(super) fn alike(covariance: &Matrix3<f64>) -> f64 {
    let horizontal_m2 = f64::midpoint(covariance[(0, 0)], covariance[(1, 1)]);
    if horizontal_m2 < CORRECTED_M * CORRECTED_M {
        ALIKE_CORRECTED
    } else {
        ALIKE
    }
}

#[cfg(test)]
mod tests {
    use maps::camera::Pinhole;

    use super::*;
    use crate::Settings;
    use crate::map::tests::keyframe;

    const KEYFRAMES: u32 = 40;

    /// A way of 39 m along x, as vision has it.
    fn straight() -> Slam {
        let camera = Pinhole {
            width: 64,
            height: 48,
            fx: 40.0,
            fy: 40.0,
            cx: 31.5,
            cy: 23.5,
            distortion: [0.0; 5],
        };
        let mut slam = Slam::new(camera, Settings::default());
        for i in 0..KEYFRAMES {
            let id = slam.map.add_keyframe(keyframe(vec![None]));
            let pose = Isometry3::translation(f64::from(i), 0.0, 0.0);
            slam.map.set_pose(id, pose);
        }
        slam
    }

    /// What a receiver says of it, half a metre to the side in the middle.
    fn bowed(i: u32) -> Tied {
        let share = f64::from(i) / f64::from(KEYFRAMES - 1);
        Tied {
            map: 0,
            keyframe: KeyframeId(i),
            from_keyframe: Vector3::zeros(),
            in_enu: Vector3::new(f64::from(i), 2.0 * share * (1.0 - share), 0.0),
            covariance: Matrix3::identity() * 1e-3,
        }
    }

    /// How far the middle lies beside the line between the ends.
    fn bow_m(slam: &Slam) -> f64 {
        let y = |i: u32| slam.map.poses[i as usize].translation.vector.y;
        y(KEYFRAMES / 2) - f64::midpoint(y(0), y(KEYFRAMES - 1))
    }

    #[test]
    fn what_was_said_once_bends_the_way_once_however_often_it_is_heard() {
        let mut slam = straight();
        slam.positions.tied = (0..KEYFRAMES).map(bowed).collect();
        slam.map.keep_unbent(KeyframeId(KEYFRAMES - 1));
        let bows = [(); 4].map(|()| {
            slam.positions.new = usize::MAX;
            slam.bend();
            slam.bend();
            bow_m(&slam)
        });
        assert!((0.01..0.45).contains(&bows[0]), "{bows:?}");
        assert!((bows[3] - bows[0]).abs() < 0.01 * bows[0], "{bows:?}");
    }

    #[test]
    fn a_receiver_with_corrections_is_believed_sooner_than_one_without() {
        let of = |sigma_m: f64| alike(&(Matrix3::identity() * sigma_m * sigma_m));
        assert!(of(0.02) < of(2.0));
    }

    #[test]
    fn a_position_beside_a_culled_keyframe_counts_by_the_nearest_that_is_kept() {
        let mut slam = straight();
        slam.positions.tied = (0..KEYFRAMES).map(bowed).collect();
        let all = slam.sighted();
        slam.map.remove_keyframe(KeyframeId(20));
        let rest = slam.sighted();
        assert_eq!(rest.len(), all.len());
        let neighbours = [KeyframeId(19), KeyframeId(21)];
        assert!(neighbours.contains(&rest[20].0));
        assert!((rest[20].1.in_world - all[20].1.in_world).norm() < 1e-9);
    }
}
