//! What is to be aligned, thinned out: a few thousand places that tell all directions about equally.
//!
//! Most of what a ground vehicle sees is ground, which says nothing about where it is on it. Places are therefore drawn
//! evenly from bins by shape and by the direction they face, and evenly through space within a bin.
//!
//! - S. Rusinkiewicz, M. Levoy, *Efficient variants of the ICP algorithm*, 3DIM 2001, section 3.1 (normal-space sampling).

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::cells::Cells;
use super::surface::{Blobs, Shape, Surface};

/// A piece of surface to align.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    /// Relative to the centre of the source.
    pub(super) at: Vector3<f64>,
    /// The normal of a plane, the direction of a line.
    pub(super) axis: Vector3<f64>,
    pub(super) shape: Shape,
}

/// The samples and the point they turn about.
#[derive(Clone, Debug)]
pub(super) struct Source {
    /// Their mean, in the local frame.
    pub(super) center: Vector3<f64>,
    /// Root mean square distance from it: what a turn by one radian moves them by.
    pub(super) radius_m: f64,
    pub(super) samples: Vec<Sample>,
}

impl Source {
    /// At most about `most` samples from the surfaces in these cells; none if there are none.
    pub(super) fn of(cells: &Cells, most: usize) -> Self {
        let surfaces = cells.surfaces(Blobs::Dropped).surfaces;
        let mut bins: [Vec<usize>; BINS] = Default::default();
        for (at, surface) in surfaces.iter().enumerate() {
            bins[bin(surface)].push(at);
        }
        let mut samples = Vec::new();
        for (bin, quota) in bins.iter().zip(quotas(bins.each_ref().map(Vec::len), most)) {
            samples.extend((0..quota).map(|i| {
                let surface = &surfaces[bin[i * bin.len() / quota]];
                Sample {
                    at: surface.center,
                    axis: surface.axis,
                    shape: surface.shape,
                }
            }));
        }
        let count = samples.len().max(1) as f64;
        let center = samples.iter().map(|s| s.at).sum::<Vector3<f64>>() / count;
        for sample in &mut samples {
            sample.at -= center;
        }
        let spread: f64 = samples.iter().map(|s| s.at.norm_squared()).sum();
        Self {
            center,
            radius_m: (spread / count).sqrt().max(1e-3),
            samples,
        }
    }

    /// About `most` of the samples, evenly.
    pub(super) fn thinned(&self, most: usize) -> Vec<Sample> {
        let count = self.samples.len().min(most);
        (0..count)
            .map(|i| self.samples[i * self.samples.len() / count].clone())
            .collect()
    }
}

/// Bins of upright planes, each of 30° of the direction that they face.
const FACING: usize = 6;
/// Those, level planes and lines.
const BINS: usize = FACING + 2;

fn bin(surface: &Surface) -> usize {
    if surface.shape == Shape::Line {
        return FACING + 1;
    }
    if surface.axis.z.abs() > 0.7 {
        return FACING;
    }
    let facing = surface.axis.y.atan2(surface.axis.x).rem_euclid(PI) / PI;
    ((facing * FACING as f64) as usize).min(FACING - 1)
}

/// Splits `most` among bins: what a small bin leaves is shared by the others.
fn quotas<const N: usize>(sizes: [usize; N], most: usize) -> [usize; N] {
    let mut order: [usize; N] = std::array::from_fn(|bin| bin);
    order.sort_by_key(|&bin| sizes[bin]);
    let mut quotas = [0; N];
    let mut left = most;
    for (done, bin) in order.into_iter().enumerate() {
        quotas[bin] = sizes[bin].min(left / (order.len() - done));
        left -= quotas[bin];
    }
    quotas
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_small_bin_leaves_is_shared_by_the_others() {
        assert_eq!(quotas([100, 0, 3, 0, 1000], 43), [20, 0, 3, 0, 20]);
        assert_eq!(quotas([1, 2, 3, 4, 5], 100), [1, 2, 3, 4, 5]);
        assert_eq!(quotas([9, 9, 9, 9, 9], 0), [0; 5]);
    }
}
