//! Two maps become one, and parts of a map are cut out to be worked on.

use nalgebra::{Isometry3, Point3};

use crate::drift::Drift;

use super::{Keyframe, KeyframeId, Link, Map, MapPoint, PointId, Slot, Standing};

/// How keyframes and points of a map are called after it has become part of another one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Renaming {
    keyframes: u32,
    slots: u32,
}

impl Renaming {
    pub(crate) fn keyframe(self, id: KeyframeId) -> KeyframeId {
        KeyframeId(id.0 + self.keyframes)
    }

    pub(crate) fn point(self, id: PointId) -> PointId {
        PointId {
            slot: id.slot + self.slots,
            ..id
        }
    }
}

/// Some points of a map, and nothing else: to be matched with a keyframe.
#[derive(Default)]
pub(crate) struct Excerpt {
    /// The points without their views.
    pub(crate) map: Map,
    /// What the map they are from calls them, by slot.
    names: Vec<PointId>,
}

impl Excerpt {
    /// The points that these keyframes see.
    pub(crate) fn new(map: &Map, keyframes: &[KeyframeId]) -> Self {
        let mut names: Vec<PointId> = keyframes
            .iter()
            .filter_map(|id| map.keyframes.get(id))
            .flat_map(|k| k.points.iter().flatten().copied())
            .filter(|id| map.point(*id).is_some())
            .collect();
        names.sort_unstable();
        names.dedup();
        let bare = |id: &PointId| map.point(*id).map(MapPoint::without_views);
        let slots = names.iter().map(|id| Slot {
            generation: 0,
            point: bare(id),
        });
        Self {
            map: Map {
                slots: slots.collect(),
                ..Map::default()
            },
            names,
        }
    }

    /// The excerpt's name for a point of the map.
    pub(crate) fn find(&self, id: PointId) -> Option<PointId> {
        let slot = self.names.binary_search(&id).ok()? as u32;
        Some(PointId {
            slot,
            generation: 0,
        })
    }

    /// The map's name for a point of the excerpt.
    pub(crate) fn name(&self, id: PointId) -> Option<PointId> {
        self.names.get(id.slot as usize).copied()
    }
}

fn moved(point: &mut MapPoint, by: &Isometry3<f64>) {
    point.position = (by * Point3::from(point.position)).coords;
    point.direction = by.rotation * point.direction;
}

impl Map {
    /// An empty map, begun where the place was lost.
    pub(crate) fn adrift(number: u32) -> Self {
        Self {
            number,
            standing: Standing::Adrift,
            ..Self::default()
        }
    }

    /// Moves everything.
    pub(crate) fn transform(&mut self, by: &Isometry3<f64>) {
        let points = self.slots.iter_mut().filter_map(|s| s.point.as_mut());
        points.for_each(|point| moved(point, by));
        for pose in &mut self.poses {
            *pose = by * *pose;
            pose.rotation.renormalize();
        }
        for (id, keyframe) in &mut self.keyframes {
            keyframe.world_from_camera = self.poses[id.0 as usize];
        }
    }

    /// Says how far everything may be off.
    pub(crate) fn set_drift(&mut self, drift: Drift) {
        let points = self.slots.iter_mut().filter_map(|s| s.point.as_mut());
        points.for_each(|point| point.drift = drift);
        self.keyframes.values_mut().for_each(|k| k.drift = drift);
    }

    /// Takes over the keyframes and points of another map, which must be in the same frame. Its keyframes count as
    /// later than all that are here.
    pub(crate) fn absorb(&mut self, other: Self) -> Renaming {
        let renaming = Renaming {
            keyframes: self.poses.len() as u32,
            slots: self.slots.len() as u32,
        };
        if let Some(last) = renaming.keyframes.checked_sub(1) {
            self.keep_unbent(KeyframeId(last));
        }
        self.unbent.extend(other.unbent);
        self.poses.extend(other.poses);
        self.free
            .extend(other.free.iter().map(|slot| slot + renaming.slots));
        self.slots.extend(other.slots.into_iter().map(|mut slot| {
            if let Some(point) = &mut slot.point {
                point.born = renaming.keyframe(point.born);
                for (keyframe, _) in &mut point.views {
                    *keyframe = renaming.keyframe(*keyframe);
                }
            }
            slot
        }));
        for (id, keyframe) in other.keyframes {
            let points = keyframe.points.iter();
            let keyframe = Keyframe {
                points: points.map(|id| id.map(|id| renaming.point(id))).collect(),
                ..keyframe
            };
            let id = renaming.keyframe(id);
            self.places.insert(id, &keyframe.features);
            self.keyframes.insert(id, keyframe);
        }
        self.starts.push(KeyframeId(renaming.keyframes));
        self.starts
            .extend(other.starts.into_iter().map(|id| renaming.keyframe(id)));
        self.links.extend(other.links.into_iter().map(|link| Link {
            from: renaming.keyframe(link.from),
            to: renaming.keyframe(link.to),
            ..link
        }));
        renaming
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::super::tests::keyframe;
    use super::*;

    /// Two keyframes that see one point between them, and one more each.
    fn small() -> Map {
        let mut map = Map::default();
        let first = map.add_keyframe(keyframe(vec![None, None]));
        map.add_point(first, 0, Vector3::new(0.0, 0.0, 2.0));
        map.add_point(first, 1, Vector3::new(0.5, 0.0, 2.0));
        let shared = map.keyframes[&first].points[0];
        let second = map.add_keyframe(keyframe(vec![shared, None]));
        map.add_point(second, 1, Vector3::new(0.0, 0.5, 2.0));
        map
    }

    #[track_caller]
    fn check_views(map: &Map) {
        for (id, point) in map.points() {
            for (k, f) in &point.views {
                assert_eq!(map.keyframes[k].points[*f as usize], Some(id));
            }
        }
        let seen = map
            .keyframes
            .values()
            .flat_map(|k| k.points.iter().flatten());
        assert_eq!(
            seen.clone().count(),
            map.points().map(|(_, p)| p.views.len()).sum::<usize>()
        );
        assert!(seen.into_iter().all(|id| map.point(*id).is_some()));
    }

    #[test]
    fn two_maps_become_one_with_all_views_intact() {
        let (mut older, mut newer) = (small(), small());
        let gone = newer.keyframes[&KeyframeId(1)].points[1].expect("a point");
        newer.remove_point(gone);
        let kept = newer.keyframes[&KeyframeId(1)].points[0].expect("a point");
        let shift = Isometry3::translation(0.0, 3.0, 0.0);
        newer.transform(&shift);
        let renaming = older.absorb(newer);
        check_views(&older);
        assert_eq!(
            (
                older.point_count(),
                older.keyframes.len(),
                older.poses.len()
            ),
            (5, 4, 4)
        );
        let point = older
            .point(renaming.point(kept))
            .expect("it is still there");
        assert!((point.position - Vector3::new(0.0, 3.0, 2.0)).norm() < 1e-12);
        assert_eq!(renaming.keyframe(KeyframeId(1)), KeyframeId(3));
        assert_eq!(older.starts, [KeyframeId(2)]);
        let added = older.add_keyframe(keyframe(vec![None]));
        older.add_point(added, 0, Vector3::z());
        check_views(&older);
    }

    #[test]
    fn an_excerpt_names_its_points_both_ways() {
        let map = small();
        let excerpt = Excerpt::new(&map, &[KeyframeId(1)]);
        assert_eq!(excerpt.map.point_count(), 2);
        for id in map.keyframes[&KeyframeId(1)].points.iter().flatten() {
            let inside = excerpt.find(*id).expect("the keyframe sees it");
            assert_eq!(excerpt.name(inside), Some(*id));
        }
        let elsewhere = map.keyframes[&KeyframeId(0)].points[1].expect("a point");
        assert_eq!(excerpt.find(elsewhere), None);
    }
}
