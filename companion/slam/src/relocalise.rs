//! The pose of a camera that has lost its place: features are matched with a keyframe's points by description alone, and
//! the rigid motion that most pairs agree on is found by RANSAC on their 3-D positions.
//!
//! - S. Umeyama, *Least-squares estimation of transformation parameters between two point patterns*, PAMI 1991.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng as _;

use crate::features::Feature;
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
    let matches = match_descriptions(&now.features, map, points);
    let (pose, agreeing) = consensus_of((optics, map), &now.features, matches, rng)?;
    now.forget_matches();
    for (feature, id, distance) in agreeing {
        now.claim(feature, id, distance);
    }
    Some(pose)
}

/// A feature, the point it may be, and in how many bits they differ.
type Match = (usize, PointId, u32);

/// The pose on which most matches agree, and those that do.
pub(crate) fn consensus_of(
    (optics, map): (&Optics, &Map),
    features: &[Feature],
    matches: Vec<Match>,
    rng: &mut Pcg64,
) -> Option<(Isometry3<f64>, Vec<Match>)> {
    let mut pairs = Vec::new();
    let mut names = Vec::new();
    for found in matches {
        let f = &features[found.0];
        if let (Some(depth), Some(point)) = (f.depth_m, map.point(found.1)) {
            pairs.push(Pair {
                in_world: point.position,
                in_camera: optics.lift(f.ideal, depth),
            });
            names.push(found);
        }
    }
    let (pose, agrees) = consensus(&pairs, rng)?;
    let agreeing = names.into_iter().zip(agrees).filter(|&(_, a)| a);
    Some((pose, agreeing.map(|(found, _)| found).collect()))
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

#[cfg(test)]
mod tests {
    use rand_pcg::rand_core::SeedableRng as _;

    use super::*;

    fn pairs(truth: &Isometry3<f64>, count: i32, wrong_every: i32) -> Vec<Pair> {
        let wave = |i: i32, f: f64| (f64::from(i) * f).sin();
        (0..count)
            .map(|i| {
                let in_camera = Vector3::new(wave(i, 1.3), wave(i, 2.3), 3.0 + wave(i, 0.9));
                let there = if i % wrong_every == 0 {
                    in_camera.yzx()
                } else {
                    in_camera
                };
                Pair {
                    in_world: (truth * Point3::from(there)).coords,
                    in_camera,
                }
            })
            .collect()
    }

    #[test]
    fn the_motion_most_pairs_agree_on_is_found_though_half_are_wrong() {
        let truth = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.5, -1.0, 2.0));
        let (found, agrees) =
            consensus(&pairs(&truth, 60, 2), &mut Pcg64::seed_from_u64(1)).expect("30 pairs agree");
        assert!((truth.inverse() * found).translation.vector.norm() < 1e-6);
        assert!(agrees.iter().skip(1).step_by(2).all(|&a| a));
    }

    #[test]
    fn too_few_pairs_and_pairs_on_a_line_decide_nothing() {
        let truth = Isometry3::identity();
        let mut rng = Pcg64::seed_from_u64(1);
        assert!(consensus(&pairs(&truth, 11, 100), &mut rng).is_none());
        let line: Vec<Pair> = (0..40)
            .map(|i| Vector3::new(0.1 * f64::from(i), 0.0, 2.0))
            .map(|p| Pair {
                in_world: p,
                in_camera: p,
            })
            .collect();
        assert!(consensus(&line, &mut rng).is_none());
    }
}
