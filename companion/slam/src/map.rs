//! The sparse map: keyframes and the points they see.
//!
//! Invariants: `point.views` holds `(k, f)` exactly where `keyframe k` holds the point at its feature `f`; the index of
//! places holds exactly the keyframes.

mod correct;
mod merge;

use std::collections::BTreeMap;
use std::sync::Arc;

use maps::time::Stamp;
use nalgebra::{Isometry3, Vector3};

use crate::brief::Descriptor;
use crate::coarse::Coarse;
use crate::dense::{Pending, Surface};
use crate::drift::Drift;
use crate::features::{Feature, LEVELS, scale_of};
use crate::places::Places;
use crate::pyramid::SCALE;

pub(crate) use merge::{Excerpt, Renaming};

/// Names a keyframe for ever; later ones are larger.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct KeyframeId(pub(crate) u32);

/// Names a map point for ever: a slot, and how often it was used before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PointId {
    slot: u32,
    generation: u32,
}

/// A point of the static world.
#[derive(Debug)]
pub(crate) struct MapPoint {
    /// In the world.
    pub(crate) position: Vector3<f64>,
    pub(crate) descriptor: Descriptor,
    /// Mean unit vector from the cameras that saw it to it.
    pub(crate) direction: Vector3<f64>,
    /// Distance at which it would be found on pyramid level 0.
    pub(crate) reach_m: f64,
    /// Where it was seen: keyframe and feature.
    pub(crate) views: Vec<(KeyframeId, u32)>,
    /// Frames in which it should have been found, and was.
    pub(crate) expected: u32,
    pub(crate) found: u32,
    /// Keyframes that look through it.
    pub(crate) seen_through: u32,
    pub(crate) born: KeyframeId,
    /// How far it may be off, with the map around it.
    pub(crate) drift: Drift,
}

impl MapPoint {
    /// The same, as if nobody had seen it.
    fn without_views(&self) -> Self {
        Self {
            position: self.position,
            descriptor: self.descriptor,
            direction: self.direction,
            reach_m: self.reach_m,
            views: Vec::new(),
            expected: self.expected,
            found: self.found,
            seen_through: self.seen_through,
            born: self.born,
            drift: self.drift,
        }
    }

    /// The pyramid level on which it should be found from this distance.
    pub(crate) fn octave_at(&self, distance_m: f64) -> u8 {
        let level = (self.reach_m / distance_m).ln() / SCALE.ln();
        level.round().clamp(0.0, LEVELS as f64 - 1.0) as u8
    }
}

/// A frame that the map keeps.
pub(crate) struct Keyframe {
    pub(crate) at: Stamp,
    pub(crate) world_from_camera: Isometry3<f64>,
    pub(crate) features: Vec<Feature>,
    pub(crate) points: Vec<Option<PointId>>,
    pub(crate) coarse: Coarse,
    /// What dense mapping will need of it, until its mask is final.
    pub(crate) pending: Option<Pending>,
    /// The static surface it saw, from then on.
    pub(crate) surface: Option<Arc<Surface>>,
    /// Map points tracked when it was made: what later frames are compared with.
    pub(crate) tracked: usize,
    /// How far its pose may be off.
    pub(crate) drift: Drift,
}

#[derive(Default)]
struct Slot {
    generation: u32,
    point: Option<MapPoint>,
}

/// Whether a map's place in the world is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Standing {
    /// It holds the first keyframe of all, whose pose is the world's.
    #[default]
    Joined,
    /// It was begun after the place was lost and has not been joined since: where it is, is a guess.
    Adrift,
}

/// Two keyframes that were recognised to show the same place.
#[derive(Clone, Debug)]
pub(crate) struct Link {
    pub(crate) from: KeyframeId,
    pub(crate) to: KeyframeId,
    /// The pose of `to` in the frame of `from`, as measured then.
    pub(crate) from_from_to: Isometry3<f64>,
}

/// Keyframes and points, each found by its id.
#[derive(Default)]
pub(crate) struct Map {
    /// Tells maps apart.
    pub(crate) number: u32,
    pub(crate) standing: Standing,
    pub(crate) keyframes: BTreeMap<KeyframeId, Keyframe>,
    /// Of every keyframe there ever was.
    pub(crate) poses: Vec<Isometry3<f64>>,
    /// Where tracking alone would have had those that have left the window: from one to the next as they were then.
    unbent: Vec<Isometry3<f64>>,
    /// Keyframes that were not tracked from the one before.
    pub(crate) starts: Vec<KeyframeId>,
    /// The keyframe whose pose stays when others are corrected; the first one that is left if it is gone.
    pub(crate) fixed: KeyframeId,
    /// Loops that were closed, oldest first.
    pub(crate) links: Vec<Link>,
    pub(crate) places: Places,
    slots: Vec<Slot>,
    free: Vec<u32>,
}

impl Map {
    pub(crate) fn point(&self, id: PointId) -> Option<&MapPoint> {
        let slot = self.slots.get(id.slot as usize)?;
        slot.point
            .as_ref()
            .filter(|_| slot.generation == id.generation)
    }

    pub(crate) fn point_mut(&mut self, id: PointId) -> Option<&mut MapPoint> {
        let slot = self.slots.get_mut(id.slot as usize)?;
        slot.point
            .as_mut()
            .filter(|_| slot.generation == id.generation)
    }

    /// All points, in the order of their slots.
    pub(crate) fn points(&self) -> impl Iterator<Item = (PointId, &MapPoint)> {
        self.slots.iter().enumerate().filter_map(|(slot, s)| {
            let id = PointId {
                slot: slot as u32,
                generation: s.generation,
            };
            s.point.as_ref().map(|point| (id, point))
        })
    }

    pub(crate) fn point_count(&self) -> usize {
        self.slots.len() - self.free.len()
    }

    /// Adds a keyframe with the points it was tracked by; returns its name.
    pub(crate) fn add_keyframe(&mut self, keyframe: Keyframe) -> KeyframeId {
        let id = KeyframeId(self.poses.len() as u32);
        self.poses.push(keyframe.world_from_camera);
        let seen: Vec<(usize, PointId)> = keyframe
            .points
            .iter()
            .enumerate()
            .filter_map(|(feature, point)| point.map(|p| (feature, p)))
            .collect();
        self.places.insert(id, &keyframe.features);
        self.keyframes.insert(id, keyframe);
        for (feature, point) in seen {
            match self.point_mut(point) {
                Some(p) => p.views.push((id, feature as u32)),
                None => self.forget_view(id, feature),
            }
            self.redescribe(point);
        }
        id
    }

    /// Adds the point that a keyframe sees with depth at a feature.
    pub(crate) fn add_point(
        &mut self,
        keyframe: KeyframeId,
        feature: usize,
        position: Vector3<f64>,
    ) {
        let Some(k) = self.keyframes.get_mut(&keyframe) else {
            return;
        };
        let eye = k.world_from_camera.translation.vector;
        let seen = &k.features[feature];
        let point = MapPoint {
            position,
            descriptor: seen.descriptor,
            direction: (position - eye).normalize(),
            reach_m: (position - eye).norm() * scale_of(seen.octave),
            views: vec![(keyframe, feature as u32)],
            expected: 1,
            found: 1,
            seen_through: 0,
            born: keyframe,
            drift: k.drift,
        };
        let slot = self.free.pop().unwrap_or_else(|| {
            self.slots.push(Slot::default());
            self.slots.len() as u32 - 1
        });
        let entry = &mut self.slots[slot as usize];
        entry.point = Some(point);
        k.points[feature] = Some(PointId {
            slot,
            generation: entry.generation,
        });
    }

    /// Removes a point everywhere.
    pub(crate) fn remove_point(&mut self, id: PointId) {
        if self.point(id).is_none() {
            return;
        }
        let slot = &mut self.slots[id.slot as usize];
        slot.generation = slot.generation.wrapping_add(1);
        self.free.push(id.slot);
        let views = slot.point.take().map(|p| p.views).unwrap_or_default();
        for (keyframe, feature) in views {
            self.forget_view(keyframe, feature as usize);
        }
    }

    fn forget_view(&mut self, keyframe: KeyframeId, feature: usize) {
        if let Some(k) = self.keyframes.get_mut(&keyframe) {
            k.points[feature] = None;
        }
    }

    /// Notes that a keyframe's feature, so far nothing, shows a point that it does not show elsewhere.
    pub(crate) fn attach(&mut self, keyframe: KeyframeId, feature: usize, id: PointId) {
        let Some(k) = self.keyframes.get_mut(&keyframe) else {
            return;
        };
        let slot = self.slots.get_mut(id.slot as usize);
        let Some(point) = slot
            .filter(|s| s.generation == id.generation)
            .and_then(|s| s.point.as_mut())
        else {
            return;
        };
        if k.points[feature].is_none() && point.views.iter().all(|&(k, _)| k != keyframe) {
            k.points[feature] = Some(id);
            point.views.push((keyframe, feature as u32));
        }
    }

    /// Two points are one: the views of `copy` become those of `original`.
    pub(crate) fn merge(&mut self, copy: PointId, original: PointId) {
        let views = self
            .point(copy)
            .map(|p| p.views.clone())
            .unwrap_or_default();
        self.remove_point(copy);
        for (keyframe, feature) in views {
            self.attach(keyframe, feature as usize, original);
        }
        self.redescribe(original);
    }

    /// Takes one view away from a point; a point without views goes.
    pub(crate) fn remove_view(&mut self, id: PointId, keyframe: KeyframeId) {
        let Some(point) = self.point_mut(id) else {
            return;
        };
        let Some(at) = point.views.iter().position(|&(k, _)| k == keyframe) else {
            return;
        };
        let (_, feature) = point.views.remove(at);
        let orphan = point.views.is_empty();
        self.forget_view(keyframe, feature as usize);
        if orphan {
            self.remove_point(id);
        }
    }

    /// Removes a keyframe; its last pose stays in `poses`, and its links go.
    pub(crate) fn remove_keyframe(&mut self, id: KeyframeId) {
        let Some(k) = self.keyframes.get(&id) else {
            return;
        };
        for point in k.points.iter().flatten().copied().collect::<Vec<_>>() {
            self.remove_view(point, id);
        }
        self.keyframes.remove(&id);
        self.places.remove(id);
        self.links.retain(|link| link.from != id && link.to != id);
    }

    pub(crate) fn set_pose(&mut self, id: KeyframeId, pose: Isometry3<f64>) {
        if let (Some(k), Some(kept)) = (
            self.keyframes.get_mut(&id),
            self.poses.get_mut(id.0 as usize),
        ) {
            k.world_from_camera = pose;
            *kept = pose;
        }
    }

    /// How many points each other keyframe shares with these.
    pub(crate) fn shared(&self, ids: &[KeyframeId]) -> BTreeMap<KeyframeId, usize> {
        let mut points: Vec<PointId> = ids
            .iter()
            .filter_map(|id| self.keyframes.get(id))
            .flat_map(|k| k.points.iter().flatten().copied())
            .collect();
        points.sort_unstable();
        points.dedup();
        let mut shared = BTreeMap::new();
        for (view, _) in points
            .iter()
            .filter_map(|id| self.point(*id))
            .flat_map(|p| &p.views)
        {
            if !ids.contains(view) {
                *shared.entry(*view).or_default() += 1;
            }
        }
        shared
    }

    /// A keyframe and those, at most `most`, that share most points with it: what is around there.
    pub(crate) fn around(&self, id: KeyframeId, most: usize) -> Vec<KeyframeId> {
        const FEWEST_SHARED: usize = 15;
        let mut others: Vec<(usize, KeyframeId)> = self
            .shared(&[id])
            .into_iter()
            .filter(|&(_, shared)| shared >= FEWEST_SHARED)
            .map(|(other, shared)| (shared, other))
            .collect();
        others.sort_unstable_by(|a, b| b.cmp(a));
        std::iter::once(id)
            .chain(others.into_iter().take(most).map(|(_, other)| other))
            .collect()
    }

    /// Gives the point the view's description nearest to all others, and its mean direction.
    pub(crate) fn redescribe(&mut self, id: PointId) {
        const MOST: usize = 8;
        let Some(point) = self.point(id) else { return };
        let views = &point.views[point.views.len().saturating_sub(MOST)..];
        let seen: Vec<(Descriptor, Vector3<f64>)> = views
            .iter()
            .filter_map(|(k, f)| {
                let k = self.keyframes.get(k)?;
                let eye = k.world_from_camera.translation.vector;
                Some((
                    k.features[*f as usize].descriptor,
                    (point.position - eye).normalize(),
                ))
            })
            .collect();
        let apart = |d: &Descriptor| seen.iter().map(|(other, _)| d.distance(other)).sum::<u32>();
        let central = seen.iter().map(|(d, _)| *d).min_by_key(apart);
        let direction: Vector3<f64> = seen.iter().map(|(_, direction)| direction).sum();
        if let (Some(descriptor), Some(point)) = (central, self.point_mut(id)) {
            point.descriptor = descriptor;
            point.direction = direction.try_normalize(1e-9).unwrap_or(point.direction);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn keyframe(points: Vec<Option<PointId>>) -> Keyframe {
        let feature = Feature {
            raw: [1.0, 1.0],
            ideal: [1.0, 1.0],
            octave: 0,
            depth_m: Some(1.0),
            is_far: false,
            descriptor: Descriptor::default(),
        };
        Keyframe {
            at: Stamp::ZERO,
            world_from_camera: Isometry3::identity(),
            features: vec![feature; points.len()],
            points,
            coarse: Coarse::default(),
            pending: None,
            surface: None,
            tracked: 0,
            drift: Drift::default(),
        }
    }

    #[test]
    fn a_removed_point_is_gone_even_if_its_slot_is_used_again() {
        let mut map = Map::default();
        let k = map.add_keyframe(keyframe(vec![None, None]));
        map.add_point(k, 0, Vector3::z());
        let old = map.keyframes[&k].points[0].expect("just added");
        map.remove_point(old);
        map.add_point(k, 1, Vector3::z());
        let new = map.keyframes[&k].points[1].expect("just added");
        assert_eq!(old.slot, new.slot);
        assert!(map.point(old).is_none() && map.point(new).is_some());
        assert_eq!(map.keyframes[&k].points[0], None);
        assert_eq!(map.point_count(), 1);
    }

    #[test]
    fn a_point_goes_with_the_last_keyframe_that_sees_it() {
        let mut map = Map::default();
        let first = map.add_keyframe(keyframe(vec![None]));
        map.add_point(first, 0, Vector3::z());
        let id = map.keyframes[&first].points[0].expect("just added");
        let second = map.add_keyframe(keyframe(vec![Some(id)]));
        map.remove_keyframe(first);
        assert_eq!(
            map.point(id).map(|p| p.views.clone()),
            Some(vec![(second, 0)])
        );
        map.remove_keyframe(second);
        assert_eq!(map.point_count(), 0);
        assert_eq!(map.poses.len(), 2, "poses stay for the trajectory");
    }
}
