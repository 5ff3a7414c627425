//! How the sparse map grows and shrinks: when a frame becomes a keyframe, which points it adds, and which are forgotten.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::coarse::clear_of;
use crate::map::{Keyframe, KeyframeId, Map, PointId};
use crate::matching::{Sighting, expected_points};
use crate::optics::Optics;
use crate::settings::Settings;

/// Notes which of the points that should be in view were found.
pub(crate) fn count_found(optics: &Optics, map: &mut Map, now: &Sighting, pose: &Isometry3<f64>) {
    for id in expected_points(optics, map, &now.coarse, pose) {
        if let Some(point) = map.point_mut(id) {
            point.expected += 1;
        }
    }
    for id in now.points.iter().flatten() {
        if let Some(point) = map.point_mut(*id) {
            point.found += 1;
            // Found, but not expected: at the rim of what can be seen.
            point.expected = point.expected.max(point.found);
        }
    }
}

/// Whether the frame shows enough new, or so little known, that it should become a keyframe.
pub(crate) fn needs_keyframe(
    reference: &Keyframe,
    now: &Sighting,
    (optics, pose): (&Optics, &Isometry3<f64>),
    (agreeing, frames_since): (usize, usize),
) -> bool {
    const SOONEST: usize = 4;
    const LATEST: usize = 30;
    const MOVED_M: f64 = 0.15;
    const TURNED_RAD: f64 = 0.17;
    const KNOWN_SHARE: f64 = 0.3;
    if frames_since < SOONEST {
        return false;
    }
    let step = reference.world_from_camera.inverse() * pose;
    let moved = step.translation.vector.norm() > MOVED_M || step.rotation.angle() > TURNED_RAD;
    let fresh = unmatched(optics, now).count();
    let forgetting = (agreeing as f64) < KNOWN_SHARE * reference.tracked as f64 && fresh > 50;
    let starving = agreeing < 100 && fresh > 70;
    moved || forgetting || starving || frames_since >= LATEST
}

/// Features with a depth, on static surface, that no map point explains.
fn unmatched<'a>(optics: &'a Optics, now: &'a Sighting) -> impl Iterator<Item = usize> + 'a {
    let is_new = move |&i: &usize| {
        let f = &now.features[i];
        f.depth_m.is_some() && now.points[i].is_none() && !now.coarse.moving[optics.cell_at(f.raw)]
    };
    (0..now.features.len()).filter(is_new)
}

/// Adds the points that a new keyframe sees with depth and that are not in the map yet.
pub(crate) fn add_points(optics: &Optics, map: &mut Map, id: KeyframeId) {
    let Some(k) = map.keyframes.get(&id) else {
        return;
    };
    let pose = k.world_from_camera;
    let fresh: Vec<(usize, Vector3<f64>)> = k
        .features
        .iter()
        .enumerate()
        .filter(|&(i, f)| k.points[i].is_none() && !k.coarse.moving[optics.cell_at(f.raw)])
        .filter_map(|(i, f)| {
            let in_camera = optics.lift(f.ideal, f.depth_m?);
            Some((i, (pose * Point3::from(in_camera)).coords))
        })
        .collect();
    for (feature, position) in fresh {
        map.add_point(id, feature, position);
    }
}

/// Forgets points through which the new keyframe, like one before it, sees a surface clearly behind them.
pub(crate) fn forget_seen_through(optics: &Optics, map: &mut Map, id: KeyframeId) {
    const ENOUGH: u32 = 2;
    let Some(k) = map.keyframes.get(&id) else {
        return;
    };
    let camera_from_world = k.world_from_camera.inverse();
    let verdict = |position: &Vector3<f64>| {
        let p = (camera_from_world * Point3::from(*position))
            .coords
            .cast::<f32>();
        let near = optics.cell_of(&p).map(|cell| k.coarse.near_m[cell])?;
        (near > 0.0).then(|| near > p.z + 1.5 * clear_of(near))
    };
    let verdicts: Vec<(PointId, bool)> = map
        .points()
        .filter_map(|(point, p)| Some((point, verdict(&p.position)?)))
        .collect();
    for (point, through) in verdicts {
        let count = map.point_mut(point).map(|p| {
            p.seen_through = if through { p.seen_through + 1 } else { 0 };
            p.seen_through
        });
        if count.is_some_and(|c| c >= ENOUGH) {
            map.remove_point(point);
        }
    }
}

/// Forgets the points of a keyframe that turned out to be on something that moved.
pub(crate) fn forget_masked(optics: &Optics, map: &mut Map, id: KeyframeId) {
    let Some(k) = map.keyframes.get(&id) else {
        return;
    };
    let masked: Vec<PointId> = k
        .features
        .iter()
        .zip(&k.points)
        .filter(|(f, _)| k.coarse.moving[optics.cell_at(f.raw)])
        .filter_map(|(_, point)| *point)
        .collect();
    for point in masked {
        map.remove_view(point, id);
    }
}

/// Forgets points that are hardly ever found again, and what is over the limits.
pub(crate) fn cull(
    map: &mut Map,
    window: &[KeyframeId],
    (settings, most_keyframes): (&Settings, usize),
) {
    const TRIALS: u32 = 6;
    const LEAST_SHARE: f64 = 0.25;
    let lost: Vec<PointId> = map
        .points()
        .filter(|(_, p)| {
            p.expected >= TRIALS && f64::from(p.found) < LEAST_SHARE * f64::from(p.expected)
        })
        .map(|(id, _)| id)
        .collect();
    for id in lost {
        map.remove_point(id);
    }
    cull_keyframes(map, window, most_keyframes.max(2 * settings.window));
    let surplus = map.point_count().saturating_sub(settings.max_points);
    if surplus > 0 {
        let mut ranked: Vec<_> = map
            .points()
            .map(|(id, p)| (p.views.len(), p.found, p.born, id))
            .collect();
        ranked.select_nth_unstable(surplus - 1);
        for &(.., id) in &ranked[..surplus] {
            map.remove_point(id);
        }
    }
}

/// Over the limit, the later one of the two most similar views is forgotten, unless it is still in the window.
pub(crate) fn cull_keyframes(map: &mut Map, window: &[KeyframeId], most: usize) {
    while map.keyframes.len() > most {
        let settled: Vec<(KeyframeId, Isometry3<f64>)> = map
            .keyframes
            .iter()
            .filter(|(id, _)| !window.contains(id))
            .map(|(id, k)| (*id, k.world_from_camera))
            .collect();
        let mut closest: Option<(f64, KeyframeId)> = None;
        for (i, (_, a)) in settled.iter().enumerate() {
            for (id, b) in &settled[i + 1..] {
                let away = (a.translation.vector - b.translation.vector).norm();
                let least = closest.map_or(f64::INFINITY, |(least, _)| least);
                if away < least && away + a.rotation.angle_to(&b.rotation) < least {
                    closest = Some((away + a.rotation.angle_to(&b.rotation), *id));
                }
            }
        }
        let Some((_, id)) = closest else { return };
        map.remove_keyframe(id);
    }
}
