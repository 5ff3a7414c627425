//! Points summed up in cubic cells, and cells found by hashing.
//!
//! A cell keeps the count, the weight, and the first and second moments of its points about its own centre, so that the
//! covariance of a neighbourhood far from the origin loses nothing to rounding.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::surface::{Blobs, Level, Shape, Surface};

/// A neighbourhood of fewer points than this has no shape.
const LEAST_POINTS: f64 = 5.0;

/// Points summed up by cell.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    cell_m: f64,
    /// The edge of what is one point: its variance is the least a surface can have.
    grain_m: f64,
    /// Ordered by key.
    sums: Vec<(u64, Sums)>,
}

/// Sums over points, relative to the centre of their cell.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: f64,
    weight: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
}

impl Sums {
    fn add(&mut self, d: &Vector3<f64>, weight: f64) {
        self.count += 1.0;
        self.weight += weight;
        self.first += d * weight;
        self.second += d * d.transpose() * weight;
    }

    /// Adds the sums of a cell whose centre is at `offset` from this one's.
    fn merge(&mut self, other: &Self, offset: &Vector3<f64>) {
        let cross = other.first * offset.transpose();
        self.count += other.count;
        self.weight += other.weight;
        self.first += other.first + offset * other.weight;
        self.second +=
            other.second + cross + cross.transpose() + offset * offset.transpose() * other.weight;
    }
}

impl Cells {
    /// Sums up weighted points in cells of `cell_m`; those not finite or too far out are left out. `grain_m` is how
    /// finely the points themselves are resolved.
    pub(super) fn of(
        points: impl Iterator<Item = (Vector3<f64>, f64)>,
        cell_m: f64,
        grain_m: f64,
    ) -> Self {
        let mut keyed: Vec<(u64, Vector3<f64>, f64)> = points
            .filter_map(|(p, weight)| {
                let scaled = p / cell_m;
                let inside = scaled.iter().all(|c| c.abs() < f64::from(HALF));
                let key = packed(scaled.map(|c| c.floor() as i32))?;
                inside.then_some((key, p, weight))
            })
            .collect();
        keyed.par_sort_by_key(|(key, ..)| *key); // stable: sums run in the order of the points
        let sums = keyed
            .chunk_by(|a, b| a.0 == b.0)
            .map(|same| {
                let key = same[0].0;
                let center = center_of(key, cell_m);
                let mut sums = Sums::default();
                for (_, p, weight) in same {
                    sums.add(&(p - center), *weight);
                }
                (key, sums)
            })
            .collect();
        Self {
            cell_m,
            grain_m,
            sums,
        }
    }

    /// The same points in cells of twice the edge.
    pub(super) fn doubled(&self) -> Self {
        let cell_m = 2.0 * self.cell_m;
        let mut keyed: Vec<(u64, usize)> = self
            .sums
            .iter()
            .enumerate()
            .filter_map(|(at, (key, _))| Some((packed(unpacked(*key).map(|c| c >> 1))?, at)))
            .collect();
        keyed.par_sort_unstable();
        let sums = keyed
            .chunk_by(|a, b| a.0 == b.0)
            .map(|same| {
                let key = same[0].0;
                let mut sums = Sums::default();
                for &(_, at) in same {
                    let (child, part) = &self.sums[at];
                    let offset = center_of(*child, self.cell_m) - center_of(key, cell_m);
                    sums.merge(part, &offset);
                }
                (key, sums)
            })
            .collect();
        Self {
            cell_m,
            grain_m: self.grain_m,
            sums,
        }
    }

    /// The surface in each cell, from it and the 26 around it.
    pub(super) fn surfaces(&self, blobs: Blobs) -> Level {
        let place: Index = self
            .sums
            .iter()
            .enumerate()
            .map(|(at, (key, _))| (*key, at as u32))
            .collect();
        let shaped: Vec<(u64, Surface)> = self
            .sums
            .par_iter()
            .filter_map(|(key, own)| Some((*key, self.surface(&place, *key, own)?)))
            .filter(|(_, surface)| blobs == Blobs::Kept || surface.shape != Shape::Blob)
            .collect();
        Level::new(shaped, self.cell_m, self.grain_m)
    }

    fn surface(&self, place: &Index, key: u64, own: &Sums) -> Option<Surface> {
        let here = unpacked(key);
        let mut sums = Sums::default();
        for step in 0..27 {
            let step = Vector3::new(step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1);
            let Some(&at) = packed(here + step).and_then(|key| place.get(&key)) else {
                continue;
            };
            sums.merge(
                &self.sums[at as usize].1,
                &(step.map(f64::from) * self.cell_m),
            );
        }
        if sums.count < LEAST_POINTS {
            return None;
        }
        let center = center_of(key, self.cell_m);
        let mean = sums.first / sums.weight;
        let covariance = sums.second / sums.weight - mean * mean.transpose();
        Surface::of(
            [center + own.first / own.weight, center + mean],
            covariance,
            self.grain_m,
        )
    }
}

/// Cells may be this far from the origin along each axis.
const HALF: i32 = 1 << 20;

/// 21 bits an axis, z above y above x; `None` outside.
pub(super) fn packed(key: Vector3<i32>) -> Option<u64> {
    let inside = key.iter().all(|c| (-HALF..HALF).contains(c));
    let [x, y, z] = [key.x, key.y, key.z].map(|c| u64::from((c.wrapping_add(HALF)) as u32));
    inside.then_some(z << 42 | y << 21 | x)
}

fn unpacked(key: u64) -> Vector3<i32> {
    let of = |shift: u32| (key >> shift & ((1 << 21) - 1)) as i32 - HALF;
    Vector3::new(of(0), of(21), of(42))
}

fn center_of(key: u64, cell_m: f64) -> Vector3<f64> {
    unpacked(key).map(|c| (f64::from(c) + 0.5) * cell_m)
}

/// Where the surface or the sums of a cell are.
pub(super) type Index = HashMap<u64, u32, BuildHasherDefault<KeyHasher>>;

/// One multiplication: keys are not chosen by an enemy, and the table is not iterated.
#[derive(Clone, Default)]
pub(super) struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_u64(u64::from(byte));
        }
    }

    fn write_u64(&mut self, value: u64) {
        let mixed = (self.0 ^ value).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ mixed >> 32;
    }
}
