//! Which voxels the surfaces of all that stands still pass through.

use std::collections::BTreeMap;

use nalgebra::Point3;

use crate::scene::{Class, Face, Scene};

/// Voxels with a surface in them, by index along x, y and z, each with the class of that surface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Voxels {
    /// The class of the surface that covers most of each.
    pub classes: BTreeMap<[i32; 3], Class>,
}

/// The voxels of this size within a box between two corners. Surfaces are sampled four times a voxel along each edge:
/// corners that reach into a voxel by less than that may be missed.
pub fn voxels(scene: &Scene, voxel_m: f64, [low, high]: [Point3<f64>; 2]) -> Voxels {
    let mut counts: BTreeMap<([i32; 3], Class), u32> = BTreeMap::new();
    for face in scene.still() {
        if is_outside(face, low, high) {
            continue;
        }
        let class = scene.class_of(face.instance);
        each_sample(face, voxel_m / 4.0, |p| {
            let inside = (0..3).all(|i| p[i] >= low[i] && p[i] < high[i]);
            if inside {
                let key = [p.x, p.y, p.z].map(|c| (c / voxel_m).floor() as i32);
                *counts.entry((key, class)).or_default() += 1;
            }
        });
    }
    let mut best: BTreeMap<[i32; 3], (u32, Class)> = BTreeMap::new();
    for ((key, class), count) in counts {
        let most = best.entry(key).or_insert((count, class));
        if count > most.0 {
            *most = (count, class);
        }
    }
    let classes = best.into_iter().map(|(key, (_, class))| (key, class));
    Voxels {
        classes: classes.collect(),
    }
}

fn is_outside(face: &Face, low: Point3<f64>, high: Point3<f64>) -> bool {
    let corners = face.corners().map(|corner| corner.raw);
    (0..3).any(|i| {
        corners.iter().all(|corner| corner[i] < low[i])
            || corners.iter().all(|corner| corner[i] > high[i])
    })
}

/// Places on a face, about this far from one another; a face smaller than that has one.
fn each_sample(face: &Face, step_m: f64, mut sample: impl FnMut(Point3<f64>)) {
    let (u, v) = (face.edge_u.raw, face.edge_v.raw);
    let rows = (v.norm() / step_m).ceil().max(1.0) as usize;
    for row in 0..rows {
        let up = (row as f64 + 0.5) / rows as f64;
        let left = face.top[0] * up;
        let right = 1.0 + (face.top[1] - 1.0) * up;
        let columns = ((right - left) * u.norm() / step_m).ceil().max(1.0) as usize;
        for column in 0..columns {
            let along = left + (right - left) * (column as f64 + 0.5) / columns as f64;
            sample(face.corner.raw + u * along + v * up);
        }
    }
}
