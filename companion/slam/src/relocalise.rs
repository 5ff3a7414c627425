//! The pose of a camera that has lost its place: features are matched with a keyframe's points by description alone, and
//! the rigid motion that most pairs agree on is found by RANSAC on their 3-D positions.
//!
//! - S. Umeyama, *Least-squares estimation of transformation parameters between two point patterns*, PAMI 1991.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng as _;

use crate::map::{Map, PointId};
use crate::matching::{Sighting, match_descriptions};
use crate::optics::Optics;

/// A point of the world and the same point as the camera measured it.
pub(crate) struct Pair {
    pub(crate) in_world: Vector3<f64>,
    pub(crate) in_camera: Vector3<f64>,
}

const FEWEST: usize = 12;
const TRIES: usize = 300;

/// The pose from which `now` sees some of `points`, with the matches that agree with it claimed.
pub(crate) fn relocalise(
    optics: &Optics,
    map: &Map,
    now: &mut Sighting,
    points: &[Option<PointId>],
    rng: &mut Pcg64,
) -> Option<Isometry3<f64>> {
    let matches = match_descriptions(now, map, points);
    let mut pairs = Vec::new();
    let mut names = Vec::new();
    for (feature, id, distance) in matches {
        let f = &now.features[feature];
        if let (Some(depth), Some(point)) = (f.depth_m, map.point(id)) {
            pairs.push(Pair {
                in_world: point.position,
                in_camera: optics.lift(f.ideal, depth),
            });
            names.push((feature, id, distance));
        }
    }
    let (pose, agrees) = consensus(&pairs, rng)?;
    now.forget_matches();
    for ((feature, id, distance), _) in names.into_iter().zip(agrees).filter(|&(_, a)| a) {
        now.claim(feature, id, distance);
    }
    Some(pose)
}

/// `world_from_camera` on which at least 12 pairs agree, and which do.
pub(crate) fn consensus(pairs: &[Pair], rng: &mut Pcg64) -> Option<(Isometry3<f64>, Vec<bool>)> {
    if pairs.len() < FEWEST {
        return None;
    }
    let mut best = (Isometry3::identity(), Vec::new(), 0);
    for _ in 0..TRIES {
        let mut pick = || &pairs[(rng.next_u64() % pairs.len() as u64) as usize];
        let sample = [pick(), pick(), pick()];
        let Some(pose) = align(&sample) else { continue };
        let agrees = agreeing(&pose, pairs);
        let count = agrees.iter().filter(|&&a| a).count();
        if count > best.2 {
            best = (pose, agrees, count);
        }
    }
    if best.2 < FEWEST {
        return None;
    }
    let chosen: Vec<&Pair> = pairs
        .iter()
        .zip(&best.1)
        .filter(|(_, a)| **a)
        .map(|(p, _)| p)
        .collect();
    let pose = align(&chosen)?;
    let agrees = agreeing(&pose, pairs);
    let count = agrees.iter().filter(|&&a| a).count();
    (count >= FEWEST).then_some((pose, agrees))
}

fn agreeing(pose: &Isometry3<f64>, pairs: &[Pair]) -> Vec<bool> {
    let close = |p: &Pair| {
        let off = (pose * Point3::from(p.in_camera)).coords - p.in_world;
        off.norm() < 0.03 + 0.015 * p.in_camera.z
    };
    pairs.iter().map(close).collect()
}

/// The rigid motion that brings the camera's points onto the world's, in the least-squares sense.
fn align(pairs: &[&Pair]) -> Option<Isometry3<f64>> {
    let n = pairs.len() as f64;
    let mean_world = pairs.iter().map(|p| p.in_world).sum::<Vector3<f64>>() / n;
    let mean_camera = pairs.iter().map(|p| p.in_camera).sum::<Vector3<f64>>() / n;
    let correlation: Matrix3<f64> = pairs
        .iter()
        .map(|p| (p.in_world - mean_world) * (p.in_camera - mean_camera).transpose())
        .sum();
    let svd = correlation.svd(true, true);
    // Three points on a line, or fewer than three, leave a turn open.
    if svd.singular_values[1] < 1e-4 {
        return None;
    }
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u.determinant() * v_t.determinant()).signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let translation = mean_world - rotation * mean_camera;
    Some(Isometry3::from_parts(
        Translation3::from(translation),
        rotation,
    ))
}
