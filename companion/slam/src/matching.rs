//! Finds map points among the features of a frame: by projection where the pose is roughly known, by description alone
//! where it is not.

use nalgebra::{Isometry3, Point3};

use crate::brief::Descriptor;
use crate::coarse::Coarse;
use crate::features::{Feature, Grid, scale_of};
use crate::map::{Map, MapPoint, PointId};
use crate::optics::Optics;

/// Bits in which a point and its feature may differ.
const SIMILAR: u32 = 72;
/// The same where the place is known to a few pixels.
const SIMILAR_NEARBY: u32 = 88;
/// How much better the best must be than the next on the same pyramid level.
const RATIO: f64 = 0.85;

/// What a frame shows, and which map point each feature is.
#[derive(Clone, Default)]
pub(crate) struct Sighting {
    pub(crate) features: Vec<Feature>,
    pub(crate) grid: Grid,
    pub(crate) coarse: Coarse,
    pub(crate) points: Vec<Option<PointId>>,
    distances: Vec<u32>,
}

impl Sighting {
    pub(crate) fn new(optics: &Optics, features: Vec<Feature>, coarse: Coarse) -> Self {
        Self {
            grid: Grid::new(optics, &features),
            points: vec![None; features.len()],
            distances: vec![u32::MAX; features.len()],
            features,
            coarse,
        }
    }

    pub(crate) fn forget_matches(&mut self) {
        self.points.fill(None);
        self.distances.fill(u32::MAX);
    }

    pub(crate) fn forget_match(&mut self, feature: usize) {
        self.points[feature] = None;
        self.distances[feature] = u32::MAX;
    }

    pub(crate) fn matched(&self) -> usize {
        self.points.iter().flatten().count()
    }

    /// Of the features that show a point and have a depth; 0 if none has.
    pub(crate) fn median_depth_m(&self) -> f64 {
        let matched = self.features.iter().zip(&self.points);
        let mut depths: Vec<f64> = matched.filter_map(|(f, p)| p.and(f.depth_m)).collect();
        let middle = depths.len() / 2;
        if depths.is_empty() {
            return 0.0;
        }
        *depths.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// A feature that two points want goes to the more similar one.
    pub(crate) fn claim(&mut self, feature: usize, point: PointId, distance: u32) {
        if distance < self.distances[feature] {
            self.points[feature] = Some(point);
            self.distances[feature] = distance;
        }
    }

    /// The feature near an ideal pixel most similar to a description, on about the given pyramid level.
    pub(crate) fn most_similar(&self, wanted: &Wanted) -> Option<(usize, u32)> {
        let mut best = (usize::MAX, u32::MAX, 0u8);
        let mut second = (u32::MAX, 0u8);
        for (i, f) in self
            .grid
            .around(&self.features, wanted.ideal, wanted.radius)
        {
            if f.octave.abs_diff(wanted.octave) > 1 {
                continue;
            }
            let distance = f.descriptor.distance(&wanted.descriptor);
            if distance < best.1 {
                second = (best.1, best.2);
                best = (i, distance, f.octave);
            } else if distance < second.0 {
                second = (distance, f.octave);
            }
        }
        let clear = second.0 == u32::MAX
            || best.2 != second.1
            || f64::from(best.1) <= RATIO * f64::from(second.0);
        (best.1 <= wanted.similar && clear).then_some((best.0, best.1))
    }
}

/// A feature that is sought.
pub(crate) struct Wanted {
    /// Where, and how far from there along each axis, in ideal pixels.
    pub(crate) ideal: [f64; 2],
    pub(crate) radius: f64,
    /// On which pyramid level, or one beside it.
    pub(crate) octave: u8,
    pub(crate) descriptor: Descriptor,
    /// In how many bits it may differ.
    pub(crate) similar: u32,
}

/// Finds the points of the last frame again, within `radius` pixels of where `pose` puts them.
pub(crate) fn match_last(
    optics: &Optics,
    map: &Map,
    last: &Sighting,
    now: &mut Sighting,
    (pose, radius): (&Isometry3<f64>, f64),
) {
    let camera_from_world = pose.inverse();
    for (feature, id) in last.features.iter().zip(&last.points) {
        let Some((id, point)) = id.and_then(|id| Some((id, map.point(id)?))) else {
            continue;
        };
        let in_camera = camera_from_world * Point3::from(point.position);
        let Some(ideal) = optics.see(&in_camera.coords) else {
            continue;
        };
        let found = now.most_similar(&Wanted {
            ideal,
            radius: radius * scale_of(feature.octave),
            octave: feature.octave,
            descriptor: feature.descriptor,
            similar: SIMILAR,
        });
        if let Some((i, distance)) = found {
            now.claim(i, id, distance);
        }
    }
}

/// Finds those points of the whole map that should be in view and are not matched yet.
pub(crate) fn match_map(
    optics: &Optics,
    map: &Map,
    now: &mut Sighting,
    (pose, radius): (&Isometry3<f64>, f64),
) {
    let camera_from_world = pose.inverse();
    let mut known: Vec<PointId> = now.points.iter().flatten().copied().collect();
    known.sort_unstable();
    for (id, point) in map.points() {
        if known.binary_search(&id).is_ok() {
            continue;
        }
        let Some((ideal, octave)) = in_view(optics, &now.coarse, point, (pose, &camera_from_world))
        else {
            continue;
        };
        let found = now.most_similar(&Wanted {
            ideal,
            radius: radius * scale_of(octave),
            octave,
            descriptor: point.descriptor,
            similar: SIMILAR_NEARBY,
        });
        if let Some((i, distance)) = found
            && now.points[i].is_none_or(|other| known.binary_search(&other).is_err())
        {
            now.claim(i, id, distance);
        }
    }
}

/// The points that should be in view: not too far to be seen, not from behind, not hidden by something nearer, not on
/// something that moves.
pub(crate) fn expected_points(
    optics: &Optics,
    map: &Map,
    coarse: &Coarse,
    pose: &Isometry3<f64>,
) -> Vec<PointId> {
    let camera_from_world = pose.inverse();
    map.points()
        .filter(|(_, point)| in_view(optics, coarse, point, (pose, &camera_from_world)).is_some())
        .map(|(id, _)| id)
        .collect()
}

/// The pixel and pyramid level at which a point should be found.
fn in_view(
    optics: &Optics,
    coarse: &Coarse,
    point: &MapPoint,
    (pose, camera_from_world): (&Isometry3<f64>, &Isometry3<f64>),
) -> Option<([f64; 2], u8)> {
    /// Cosine of the largest angle between the direction from which a point is known and the one it is searched from.
    const WIDEST: f64 = 0.5;
    let in_camera = (camera_from_world * Point3::from(point.position)).coords;
    let ideal = optics.see(&in_camera)?;
    let ray = point.position - pose.translation.vector;
    let distance = ray.norm();
    if ray.dot(&point.direction) < WIDEST * distance {
        return None;
    }
    let farthest = point.reach_m * 1.3;
    if distance > farthest {
        return None;
    }
    let visible = optics
        .cell_of(&in_camera.cast())
        .is_none_or(|cell| !coarse.hides(cell, in_camera.z as f32));
    visible.then(|| (ideal, point.octave_at(distance)))
}

/// Pairs of `features` with map points of a keyframe, by description alone and mutually best.
pub(crate) fn match_descriptions(
    features: &[Feature],
    map: &Map,
    points: &[Option<PointId>],
) -> Vec<(usize, PointId, u32)> {
    let known: Vec<(PointId, Descriptor)> = points
        .iter()
        .flatten()
        .filter_map(|&id| Some((id, map.point(id)?.descriptor)))
        .collect();
    let mut best_of_point = vec![(usize::MAX, u32::MAX); known.len()];
    let mut best_of_feature = vec![(usize::MAX, u32::MAX, u32::MAX); features.len()];
    for (i, feature) in features.iter().enumerate() {
        for (j, (_, descriptor)) in known.iter().enumerate() {
            let distance = feature.descriptor.distance(descriptor);
            let of_feature = &mut best_of_feature[i];
            if distance < of_feature.1 {
                *of_feature = (j, distance, of_feature.1);
            } else if distance < of_feature.2 {
                of_feature.2 = distance;
            }
            if distance < best_of_point[j].1 {
                best_of_point[j] = (i, distance);
            }
        }
    }
    best_of_feature
        .iter()
        .enumerate()
        .filter(|&(i, &(j, distance, second))| {
            j != usize::MAX
                && distance <= SIMILAR
                && f64::from(distance) <= RATIO * f64::from(second)
                && best_of_point[j].0 == i
        })
        .map(|(i, &(j, distance, _))| (i, known[j].0, distance))
        .collect()
}
