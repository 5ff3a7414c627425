//! Points too far for the depth sensor: seen by two keyframes from places far enough apart, their distance follows from
//! the angle between the rays. They say little about where the camera is, but much about where it looks.
//!
//! - R. Hartley, A. Zisserman, *Multiple View Geometry*, 2nd ed. 2004, section 12.2 (linear triangulation).

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use crate::features::Feature;
use crate::map::{Keyframe, KeyframeId, Map};
use crate::optics::{NEAREST_M, Optics};
use crate::solver::{PIXEL_GATE, Seen, chi2, residual};

/// Keyframes that a new one is compared with.
const PARTNERS: usize = 3;
/// The least angle between two rays; below, the distance is a guess.
const LEAST_PARALLAX_RAD: f64 = 0.015;
/// Farther than this a point is as good as at infinity.
const FARTHEST_M: f64 = 150.0;
/// 95 % quantile of χ² with 1 degree of freedom, for the distance from the epipolar line.
const LINE_GATE: f64 = 3.84;
/// Bits in which two views of a point may differ.
const SIMILAR: u32 = 50;
/// How much better the best must be than the next.
const RATIO: f64 = 0.8;

/// Adds the far points that the new keyframe and one before it both see.
pub(crate) fn add_far_points(optics: &Optics, map: &mut Map, window: &[KeyframeId]) {
    let Some((&newest, before)) = window.split_last() else {
        return;
    };
    for &partner in before.iter().rev().take(PARTNERS) {
        let found = match (map.keyframes.get(&newest), map.keyframes.get(&partner)) {
            (Some(a), Some(b)) => far_points(optics, a, b),
            _ => continue,
        };
        for (feature, other, position) in found {
            map.add_point(newest, feature, position);
            let added = map.keyframes.get(&newest).and_then(|k| k.points[feature]);
            if let Some(id) = added {
                map.attach(partner, other, id);
                map.redescribe(id);
            }
        }
    }
}

/// Features of `a` and `b` that are one point, and where it is in the world.
fn far_points(optics: &Optics, a: &Keyframe, b: &Keyframe) -> Vec<(usize, usize, Vector3<f64>)> {
    let b_from_a = b.world_from_camera.inverse() * a.world_from_camera;
    if b_from_a.translation.vector.norm() < LEAST_PARALLAX_RAD {
        // Even a point one metre away has not moved enough.
        return Vec::new();
    }
    let essential = b_from_a.translation.vector.cross_matrix()
        * b_from_a.rotation.to_rotation_matrix().matrix();
    let theirs: Vec<usize> = open(optics, b).collect();
    let mut taken = vec![false; b.features.len()];
    let mut found = Vec::new();
    for i in open(optics, a) {
        let line = Line::new(optics, &essential, &a.features[i]);
        let Some(j) = line.most_similar(&a.features[i], &theirs, &b.features) else {
            continue;
        };
        let pair = (&a.features[i], &b.features[j]);
        if taken[j] {
            continue;
        }
        if let Some(in_a) = triangulate(optics, pair, &b_from_a) {
            taken[j] = true;
            found.push((i, j, (a.world_from_camera * Point3::from(in_a)).coords));
        }
    }
    found
}

/// Features that show no known point, nothing that moves, and have no depth because nothing is in reach.
fn open<'a>(optics: &'a Optics, k: &'a Keyframe) -> impl Iterator<Item = usize> + 'a {
    (0..k.features.len()).filter(|&i| {
        let f = &k.features[i];
        f.is_far && k.points[i].is_none() && !k.coarse.moving[optics.cell_at(f.raw)]
    })
}

/// The epipolar line of a feature in the other image, `a·u + b·v + c = 0` in ideal pixels with `a² + b² = 1`.
struct Line {
    a: f64,
    b: f64,
    c: f64,
}

impl Line {
    fn new(optics: &Optics, essential: &Matrix3<f64>, feature: &Feature) -> Self {
        let camera = &optics.camera;
        let normal = essential * optics.lift(feature.ideal, 1.0);
        let (a, b) = (normal.x / camera.fx, normal.y / camera.fy);
        let c = normal.z - a * camera.cx - b * camera.cy;
        let length = a.hypot(b).max(f64::MIN_POSITIVE);
        Self {
            a: a / length,
            b: b / length,
            c: c / length,
        }
    }

    /// The feature near the line that looks most like `wanted`, if none other looks nearly as much like it.
    fn most_similar(
        &self,
        wanted: &Feature,
        candidates: &[usize],
        features: &[Feature],
    ) -> Option<usize> {
        let (mut best, mut second) = ((usize::MAX, u32::MAX), u32::MAX);
        for &j in candidates {
            let f = &features[j];
            let off = self.a * f.ideal[0] + self.b * f.ideal[1] + self.c;
            let sigma = Seen::from(f).sigma;
            if f.octave.abs_diff(wanted.octave) > 1 || off * off > LINE_GATE * sigma * sigma {
                continue;
            }
            let distance = wanted.descriptor.distance(&f.descriptor);
            if distance < best.1 {
                second = best.1;
                best = (j, distance);
            } else {
                second = second.min(distance);
            }
        }
        let clear = second == u32::MAX || f64::from(best.1) <= RATIO * f64::from(second);
        (best.1 <= SIMILAR && clear).then_some(best.0)
    }
}

/// The point, in the first camera, that both features show; `None` where the rays are nearly parallel, meet behind a
/// camera or miss each other.
fn triangulate(
    optics: &Optics,
    (a, b): (&Feature, &Feature),
    b_from_a: &Isometry3<f64>,
) -> Option<Vector3<f64>> {
    let ray_a = optics.lift(a.ideal, 1.0);
    let ray_b = b_from_a.rotation.inverse() * optics.lift(b.ideal, 1.0);
    let cross = ray_a.cross(&ray_b).norm();
    if cross < LEAST_PARALLAX_RAD.sin() * ray_a.norm() * ray_b.norm() {
        return None;
    }
    // s·ray_a and eye_b + t·ray_b, as near as they come.
    let eye_b = b_from_a.inverse().translation.vector;
    let (aa, ab, bb) = (
        ray_a.norm_squared(),
        ray_a.dot(&ray_b),
        ray_b.norm_squared(),
    );
    let (ea, eb) = (eye_b.dot(&ray_a), eye_b.dot(&ray_b));
    let s = (ea * bb - eb * ab) / (aa * bb - ab * ab);
    let point = s * ray_a;
    let other = (b_from_a * Point3::from(point)).coords;
    let in_reach = (NEAREST_M..FARTHEST_M).contains(&point.z);
    let fits = |p: &Vector3<f64>, f: &Feature| {
        residual(optics, p, &Seen::from(f)).is_some_and(|r| chi2(&r.value).0 <= PIXEL_GATE)
    };
    (in_reach && fits(&point, a) && fits(&other, b)).then_some(point)
}

#[cfg(test)]
mod tests {
    use maps::camera::Pinhole;

    use super::*;
    use crate::brief::Descriptor;

    fn optics() -> Optics {
        Optics::new(Pinhole {
            width: 640,
            height: 480,
            fx: 500.0,
            fy: 500.0,
            cx: 320.0,
            cy: 240.0,
            distortion: [0.0; 5],
        })
    }

    fn feature(optics: &Optics, p: &Vector3<f64>) -> Feature {
        let ideal = optics.project(p).expect("in front");
        Feature {
            raw: ideal.map(|c| c as f32),
            ideal,
            octave: 0,
            depth_m: None,
            is_far: true,
            descriptor: Descriptor::default(),
        }
    }

    fn check(b_from_a: &Isometry3<f64>, point: Vector3<f64>) -> Option<Vector3<f64>> {
        let optics = optics();
        let other = (b_from_a * Point3::from(point)).coords;
        let pair = (&feature(&optics, &point), &feature(&optics, &other));
        triangulate(&optics, pair, b_from_a)
    }

    #[test]
    fn two_rays_give_the_point_and_its_line_passes_through_the_other_view() {
        let b_from_a = Isometry3::new(Vector3::new(-0.8, 0.1, 0.2), Vector3::new(0.02, -0.05, 0.1));
        let point = Vector3::new(2.0, -1.0, 15.0);
        let found = check(&b_from_a, point).expect("three degrees of parallax");
        assert!((found - point).norm() < 1e-6, "{found}");
        let optics = optics();
        let essential = b_from_a.translation.vector.cross_matrix()
            * b_from_a.rotation.to_rotation_matrix().matrix();
        let line = Line::new(&optics, &essential, &feature(&optics, &point));
        let there = feature(&optics, &(b_from_a * Point3::from(point)).coords);
        let off = line.a * there.ideal[0] + line.b * there.ideal[1] + line.c;
        assert!(off.abs() < 1e-6, "{off} px off the line");
    }

    #[test]
    fn nearly_parallel_rays_and_points_behind_give_none() {
        let point = Vector3::new(2.0, -1.0, 15.0);
        assert_eq!(check(&Isometry3::translation(0.1, 0.0, 0.0), point), None);
        let optics = optics();
        let (left, right) = (Vector3::new(-1.0, 0.0, 5.0), Vector3::new(1.0, 0.0, 5.0));
        let apart = Isometry3::translation(-1.0, 0.0, 0.0);
        let pair = (&feature(&optics, &left), &feature(&optics, &right));
        assert_eq!(triangulate(&optics, pair, &apart), None, "the rays diverge");
    }

    #[test]
    fn rays_that_miss_each_other_give_none() {
        let optics = optics();
        let apart = Isometry3::translation(-1.0, 0.0, 0.0);
        let point = Vector3::new(0.0, 0.0, 10.0);
        let mut other = feature(&optics, &(apart * Point3::from(point)).coords);
        other.ideal[1] += 8.0;
        assert_eq!(
            triangulate(&optics, (&feature(&optics, &point), &other), &apart),
            None
        );
    }
}
