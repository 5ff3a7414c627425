//! Keyframes are moved by more than a bundle adjustment moves them, and what hangs on them goes along.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3};

use super::{Excerpt, KeyframeId, Map, PointId};
use crate::matching::{Sighting, match_map};
use crate::optics::Optics;

impl Map {
    /// Gives keyframes new poses. A point goes with the keyframe that saw it first, or the first one left; a keyframe
    /// forgotten long ago with the one left that was tracked next before or after it.
    pub(crate) fn correct(&mut self, poses: &[(KeyframeId, Isometry3<f64>)]) {
        let steps: BTreeMap<KeyframeId, Isometry3<f64>> = poses
            .iter()
            .filter(|(_, pose)| pose.to_homogeneous().iter().all(|c| c.is_finite()))
            .filter_map(|(id, pose)| {
                Some((
                    *id,
                    pose * self.keyframes.get(id)?.world_from_camera.inverse(),
                ))
            })
            .collect();
        for point in self.slots.iter_mut().filter_map(|s| s.point.as_mut()) {
            let first = point.views.first().map(|(k, _)| *k);
            let step = steps.get(&point.born).or_else(|| steps.get(&first?));
            if let Some(step) = step {
                point.position = (step * Point3::from(point.position)).coords;
                point.direction = step.rotation * point.direction;
            }
        }
        for index in 0..self.poses.len() {
            let id = KeyframeId(index as u32);
            if let Some(step) = self.nearest_kept(id).and_then(|kept| steps.get(&kept)) {
                let mut pose = step * self.poses[index];
                pose.rotation.renormalize();
                self.poses[index] = pose;
                if let Some(k) = self.keyframes.get_mut(&id) {
                    k.world_from_camera = pose;
                }
            }
        }
    }

    /// Where a keyframe would be if none had moved since it left the window. Only what lies between two of them counts: of two that
    /// were tracked one from the other, it tells where one was seen from the other.
    pub(crate) fn unbent(&self, id: KeyframeId) -> Isometry3<f64> {
        let index = id.0 as usize;
        let last = self.unbent.len().checked_sub(1);
        match (self.unbent.get(index), last) {
            (Some(unbent), _) => *unbent,
            (None, Some(last)) => {
                self.unbent[last] * self.poses[last].inverse() * self.poses[index]
            }
            (None, None) => self.poses[index],
        }
    }

    /// A keyframe, and all before it, leaves the window.
    pub(crate) fn keep_unbent(&mut self, id: KeyframeId) {
        for index in self.unbent.len()..=id.0 as usize {
            self.unbent.push(self.unbent(KeyframeId(index as u32)));
        }
    }

    /// The keyframe itself, or the one that is left of those tracked next to it.
    pub(crate) fn nearest_kept(&self, id: KeyframeId) -> Option<KeyframeId> {
        let before = self.keyframes.range(..=id).next_back().map(|(k, _)| *k);
        let after = self.keyframes.range(id..).next().map(|(k, _)| *k);
        let (Some(earlier), Some(later)) = (before, after) else {
            return before.or(after);
        };
        let started =
            |from: KeyframeId, to: KeyframeId| self.starts.iter().any(|s| from < *s && *s <= to);
        let later_is_nearer = later.0 - id.0 < id.0 - earlier.0;
        let later_is_better = started(earlier, id) || (later_is_nearer && !started(id, later));
        Some(if later_is_better { later } else { earlier })
    }

    /// Merges the points that a keyframe sees with those of the excerpt that are in the same place.
    pub(crate) fn fuse(&mut self, optics: &Optics, id: KeyframeId, there: &Excerpt) {
        /// Points farther apart than this and this share of their distance are not one.
        const APART_M: f64 = 0.1;
        const APART_SHARE: f64 = 0.04;
        let Some(k) = self.keyframes.get(&id) else {
            return;
        };
        let pose = k.world_from_camera;
        let mut sighting = Sighting::new(optics, k.features.clone(), k.coarse.clone());
        match_map(optics, &there.map, &mut sighting, (&pose, 4.0));
        let pairs: Vec<(usize, PointId)> = (0..)
            .zip(&sighting.points)
            .filter_map(|(i, id)| Some((i, there.name((*id)?)?)))
            .collect();
        for (feature, original) in pairs {
            let copy = self.keyframes.get(&id).and_then(|k| k.points[feature]);
            let near = |copy: PointId| {
                let (a, b) = (self.point(copy)?.position, self.point(original)?.position);
                let range = (a - pose.translation.vector).norm();
                Some((a - b).norm() < APART_M + APART_SHARE * range)
            };
            match copy {
                Some(copy) if copy == original => {}
                Some(copy) if near(copy) == Some(true) => self.merge(copy, original),
                Some(_) => {}
                None => self.attach(id, feature, original),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::tests::keyframe;
    use super::*;

    #[test]
    fn points_and_forgotten_keyframes_move_with_the_keyframe_they_hang_on() {
        let mut map = Map::default();
        for i in 0..5 {
            let id = map.add_keyframe(keyframe(vec![None]));
            map.set_pose(id, Isometry3::translation(f64::from(i), 0.0, 0.0));
            map.add_point(id, 0, Vector3::new(f64::from(i), 0.0, 1.0));
        }
        map.starts.push(KeyframeId(3));
        map.remove_keyframe(KeyframeId(1));
        map.remove_keyframe(KeyframeId(3));
        let up = Isometry3::translation(0.0, 0.0, 1.0);
        let moved: Vec<_> = [(2, 1.0), (4, 2.0)]
            .map(|(id, steps)| {
                let lift = Isometry3::translation(0.0, 0.0, steps);
                (KeyframeId(id), lift * map.poses[id as usize])
            })
            .into();
        map.correct(&moved);
        let heights: Vec<f64> = map.poses.iter().map(|p| p.translation.vector.z).collect();
        // The second hangs on the first, which has not moved; the fourth on the fifth, with which its run began.
        assert_eq!(heights, [0.0, 0.0, 1.0, 2.0, 2.0]);
        let points: Vec<f64> = map.points().map(|(_, p)| p.position.z).collect();
        assert_eq!(points, [1.0, 2.0, 3.0]);
        let nan = Isometry3::translation(f64::NAN, 0.0, 0.0);
        map.correct(&[(KeyframeId(2), nan)]);
        assert!(map.poses[2] == up * Isometry3::translation(2.0, 0.0, 0.0));
    }
}
