//! Coming back to a place after some drift: the new keyframe is brought onto the old map.
//!
//! Drift of more than a few pixels hides old points from the search by projection, and the map would grow a second copy
//! of the place. So where many old points should be in view and few are found, the keyframe is matched with the old one
//! that saw most of them by description alone; if a rigid motion explains enough pairs, the correction is spread
//! evenly over the window, the copies are merged, and bundle adjustment does the rest. Poses older than the window stay
//! as they are: larger drift is for [`crate::loops`]. A wrong correction costs more than a missed one, so the tests are strict.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};
use rand_pcg::Pcg64;

use crate::loops::AROUND;
use crate::map::{Excerpt, KeyframeId, Map, PointId};
use crate::matching::{expected_points, match_descriptions};
use crate::optics::Optics;
use crate::relocalise::consensus_of;
use crate::solver::{Seen, Sight, fit_pose};

/// Old points that must be expected, and the share of them that is found where all is well.
const FEWEST_EXPECTED: usize = 60;
const FOUND_SHARE: f64 = 0.25;
/// Pairs that must agree on the correction.
const FEWEST_PAIRS: usize = 30;
/// Drift within a few seconds: larger corrections are mistakes.
const LARGEST_M: f64 = 0.3;
const LARGEST_RAD: f64 = 0.2;

/// So many of the window's last keyframes are tied to the old place.
const TIED: usize = 3;

/// A feature and the point it shows.
type Pair = (usize, PointId);

/// Corrects the drift of the window's newest keyframe, if it has come back to an old place.
pub(crate) fn correct_drift(
    optics: &Optics,
    map: &mut Map,
    window: &[KeyframeId],
    rng: &mut Pcg64,
) {
    let (Some(&first), Some(&newest)) = (window.first(), window.last()) else {
        return;
    };
    let Some(old) = lost_sight_of(optics, map, first, newest) else {
        return;
    };
    let Some((pose, pairs)) = same_place(optics, map, (newest, old), rng) else {
        return;
    };
    let Some(drifted) = map.keyframes.get(&newest).map(|k| k.world_from_camera) else {
        return;
    };
    let step = drifted.inverse() * pose;
    if step.translation.vector.norm() > LARGEST_M || step.rotation.angle() > LARGEST_RAD {
        return;
    }
    spread_correction(map, window, &(pose * drifted.inverse()));
    for (feature, point) in pairs {
        match map.keyframes.get(&newest).and_then(|k| k.points[feature]) {
            Some(copy) if copy == point => {}
            Some(copy) => map.merge(copy, point),
            None => map.attach(newest, feature, point),
        }
    }
    // The last ones are tied to the old place as well: bundle adjustment would turn back what one keyframe alone says.
    let around = map.around(old, AROUND);
    for &id in window.iter().rev().take(TIED) {
        let there = Excerpt::new(map, &around);
        map.fuse(optics, id, &there);
    }
}

/// The old keyframe that saw most of the old points that should be in view, if too few of them are found.
fn lost_sight_of(
    optics: &Optics,
    map: &Map,
    first: KeyframeId,
    newest: KeyframeId,
) -> Option<KeyframeId> {
    let k = map.keyframes.get(&newest)?;
    let is_old = |id: &PointId| map.point(*id).is_some_and(|p| p.born < first);
    let expected: Vec<PointId> = expected_points(optics, map, &k.coarse, &k.world_from_camera)
        .into_iter()
        .filter(is_old)
        .collect();
    let found = k.points.iter().flatten().filter(|id| is_old(id)).count();
    if expected.len() < FEWEST_EXPECTED || found as f64 > FOUND_SHARE * expected.len() as f64 {
        return None;
    }
    let mut seen: BTreeMap<KeyframeId, usize> = BTreeMap::new();
    for (view, _) in expected
        .iter()
        .filter_map(|id| map.point(*id))
        .flat_map(|p| &p.views)
    {
        if *view < first {
            *seen.entry(*view).or_default() += 1;
        }
    }
    seen.into_iter()
        .max_by_key(|&(id, count)| (count, id))
        .map(|(id, _)| id)
}

/// Where the new keyframe is, seen from the old one's points, and which features are which of them.
fn same_place(
    optics: &Optics,
    map: &Map,
    (newest, old): (KeyframeId, KeyframeId),
    rng: &mut Pcg64,
) -> Option<(Isometry3<f64>, Vec<Pair>)> {
    let features = &map.keyframes.get(&newest)?.features;
    let matches = match_descriptions(features, map, &map.keyframes.get(&old)?.points);
    let (rough, agreeing) = consensus_of((optics, map), features, matches, rng)?;
    let pairs: Vec<Pair> = agreeing.into_iter().map(|(f, id, _)| (f, id)).collect();
    // Three-dimensional positions are as rough as depth is; pixels are not.
    let sight = |&(feature, id): &Pair| {
        Some(Sight {
            point: map.point(id)?.position,
            seen: Seen::from(&features[feature]),
        })
    };
    let sights: Vec<Sight> = pairs.iter().map(sight).collect::<Option<_>>()?;
    let fit = fit_pose(optics, &rough, &sights, None)?;
    let agreeing = pairs.into_iter().zip(fit.agrees).filter(|(_, a)| *a);
    let pairs: Vec<Pair> = agreeing.map(|(pair, _)| pair).collect();
    (pairs.len() >= FEWEST_PAIRS).then_some((fit.world_from_camera, pairs))
}

/// Moves the window's keyframes, the later the farther, and the points first seen by them.
fn spread_correction(map: &mut Map, window: &[KeyframeId], correction: &Isometry3<f64>) {
    let steps: BTreeMap<KeyframeId, Isometry3<f64>> = (1..)
        .zip(window)
        .map(|(i, &id)| {
            let share = f64::from(i) / window.len() as f64;
            let turn = UnitQuaternion::identity().slerp(&correction.rotation, share);
            let shift = Translation3::from(correction.translation.vector * share);
            (id, Isometry3::from_parts(shift, turn))
        })
        .collect();
    for (&id, step) in &steps {
        if let Some(pose) = map.keyframes.get(&id).map(|k| k.world_from_camera) {
            map.set_pose(id, step * pose);
        }
    }
    let young: Vec<PointId> = map
        .points()
        .filter(|(_, p)| steps.contains_key(&p.born))
        .map(|(id, _)| id)
        .collect();
    for id in young {
        if let Some(point) = map.point_mut(id)
            && let Some(step) = steps.get(&point.born)
        {
            point.position = (step * Point3::from(point.position)).coords;
        }
    }
}
