//! Oriented BRIEF: 256 comparisons of smoothed pixels around a corner, turned with its intensity centroid.
//!
//! ```text
//! θ = atan2(Σ y·I(x, y), Σ x·I(x, y))   over a disc          bitᵢ = I(R_θ aᵢ) < I(R_θ bᵢ)
//! ```
//!
//! The pairs are drawn once, from the isotropic Gaussian of BRIEF's section 3.2 (G II), by a generator of fixed seed.
//!
//! - M. Calonder et al., *BRIEF: Binary Robust Independent Elementary Features*, ECCV 2010.
//! - E. Rublee et al., *ORB: an efficient alternative to SIFT or SURF*, ICCV 2011, section 3.2 (the centroid).

use std::f64::consts::TAU;

use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng as _, SeedableRng as _};

use crate::pyramid::Gray;

/// 256 bits that describe the surroundings of a corner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Descriptor([u64; 4]);

impl Descriptor {
    /// The number of bits in which two descriptors differ.
    pub(crate) fn distance(&self, other: &Self) -> u32 {
        let pairs = self.0.iter().zip(&other.0);
        pairs.map(|(a, b)| (a ^ b).count_ones()).sum()
    }

    /// One of the bits.
    pub(crate) fn bit(&self, index: u8) -> bool {
        self.0[usize::from(index / 64)] >> (index % 64) & 1 == 1
    }

    #[cfg(test)]
    pub(crate) fn from_words(words: [u64; 4]) -> Self {
        Self(words)
    }
}

/// Pixels around a corner that its description looks at.
pub(crate) const REACH: usize = 16;

const DISC: i16 = 15;
const FARTHEST: f64 = 13.0;
const SIGMA: f64 = 31.0 / 5.0;
const TURNS: usize = 32;
const SEED: u64 = 0x7461_6e64_656d;

/// Side of the square that is looked at: the corner's pixel, 15 before and 15 after it, and one to make it a power of two.
const PATCH: usize = 32;
// Pixels that are compared lie within the square, whichever way they are turned.
const _: () = assert!(FARTHEST + 1.0 < (REACH - 1) as f64);

/// Where in the patch two pixels lie that are compared.
type Pair = [u16; 2];

/// A row of the disc over which the centroid is taken: for each pixel of the patch, its column and 1, or 0 twice out of the disc.
struct DiscRow {
    columns: [i16; PATCH],
    inside: [i16; PATCH],
}

/// The comparisons, turned in advance to each of 32 directions.
pub(crate) struct Brief {
    turned: Vec<[Pair; 256]>,
    disc: Vec<DiscRow>,
}

impl Brief {
    pub(crate) fn new() -> Self {
        let mut rng = Pcg64::seed_from_u64(SEED);
        let pairs: Vec<[(f64, f64); 2]> = (0..256).map(|_| draw_pair(&mut rng)).collect();
        let turned = (0..TURNS).map(|turn| {
            let (sin, cos) = (TAU * turn as f64 / TURNS as f64).sin_cos();
            let rotate = |(x, y): (f64, f64)| {
                let (u, v) = (cos * x - sin * y, sin * x + cos * y);
                let from_corner = |w: f64| (w.round() + (REACH - 1) as f64) as usize;
                (from_corner(v) * PATCH + from_corner(u)) as u16
            };
            std::array::from_fn(|i| pairs[i].map(rotate))
        });
        let disc = (-DISC..=DISC).map(|y| {
            let (mut columns, mut inside) = ([0; PATCH], [0; PATCH]);
            let weights = columns.iter_mut().zip(&mut inside);
            for (x, (column, inside)) in (-DISC..=DISC).zip(weights) {
                if x * x + y * y <= DISC * DISC {
                    (*column, *inside) = (x, 1);
                }
            }
            DiscRow { columns, inside }
        });
        Self {
            turned: turned.collect(),
            disc: disc.collect(),
        }
    }

    /// The direction of the intensity centroid around a pixel at least [`REACH`] from the border, in radians.
    pub(crate) fn angle(&self, image: &Gray, x: usize, y: usize) -> f64 {
        let (mut m10, mut m01) = (0i32, 0i32);
        let (left, top) = (x + 1 - REACH, y + 1 - REACH);
        for ((line, row), dy) in self.disc.iter().enumerate().zip(-i32::from(DISC)..) {
            let part = &image.row(top + line)[left..left + PATCH];
            let weigh = |weights: &[i16; PATCH]| -> i32 {
                let pairs = part.iter().zip(weights);
                pairs.map(|(&v, &w)| i32::from(v) * i32::from(w)).sum()
            };
            m10 += weigh(&row.columns);
            m01 += dy * weigh(&row.inside);
        }
        f64::from(m01).atan2(f64::from(m10))
    }

    /// Describes a pixel at least [`REACH`] from the border of the smoothed image.
    pub(crate) fn describe(&self, smooth: &Gray, x: usize, y: usize, angle: f64) -> Descriptor {
        let turn = (angle.rem_euclid(TAU) / TAU * TURNS as f64).round() as usize % TURNS;
        // Around the corner all distances are known in advance, and nothing is out of reach.
        let mut patch = [0u8; PATCH * PATCH];
        let (left, top) = (x + 1 - REACH, y + 1 - REACH);
        for (line, row) in patch.chunks_exact_mut(PATCH).zip(top..y + REACH) {
            line.copy_from_slice(&smooth.row(row)[left..left + PATCH]);
        }
        let value = |at: u16| patch[usize::from(at) % (PATCH * PATCH)];
        let mut bits = [0u64; 4];
        for (word, pairs) in bits.iter_mut().zip(self.turned[turn].chunks(64)) {
            for (i, &[a, b]) in pairs.iter().enumerate() {
                *word |= u64::from(value(a) < value(b)) << i;
            }
        }
        Descriptor(bits)
    }
}

/// Pairs of nearly the same pixel say nothing but noise: those are drawn again.
fn draw_pair(rng: &mut Pcg64) -> [(f64, f64); 2] {
    loop {
        let [a, b] = [draw_point(rng), draw_point(rng)];
        if (a.0 - b.0).hypot(a.1 - b.1) >= 3.0 {
            return [a, b];
        }
    }
}

fn draw_point(rng: &mut Pcg64) -> (f64, f64) {
    let mut uniform = || (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    loop {
        // Box and Muller: two uniform numbers make a point of the Gaussian.
        let (u, v) = (1.0 - uniform(), uniform());
        let radius = SIGMA * (-2.0 * u.ln()).sqrt();
        if radius <= FARTHEST {
            let (sin, cos) = (TAU * v).sin_cos();
            return (radius * cos, radius * sin);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth blobs, sampled around (40, 40) after a turn by `angle`.
    fn scene(angle: f64) -> Gray {
        let (width, height) = (81, 81);
        let (sin, cos) = angle.sin_cos();
        let value = |i: usize| {
            let (x, y) = ((i % width) as f64 - 40.0, (i / width) as f64 - 40.0);
            let (u, v) = (cos * x + sin * y, -sin * x + cos * y);
            let waves = (0.45 * u + 0.2 * v).sin() + (0.31 * v - 0.11 * u + 1.0).sin() + 0.05 * u;
            (128.0 + 40.0 * waves).clamp(0.0, 255.0) as u8
        };
        Gray {
            width,
            height,
            pixels: (0..width * height).map(value).collect(),
        }
    }

    fn describe(image: &Gray, x: usize, y: usize) -> Descriptor {
        let brief = Brief::new();
        brief.describe(&image.blurred(), x, y, brief.angle(image, x, y))
    }

    #[test]
    fn a_turned_camera_sees_nearly_the_same_bits() {
        let upright = describe(&scene(0.0), 40, 40);
        for degrees in [10.0f64, 37.0, 90.0, 155.0, 260.0] {
            let turned = describe(&scene(degrees.to_radians()), 40, 40);
            let distance = upright.distance(&turned);
            assert!(distance < 50, "{degrees} degrees: {distance} bits differ");
        }
        let elsewhere = upright.distance(&describe(&scene(0.0), 30, 50));
        assert!(
            elsewhere > 70,
            "another place differs by {elsewhere} bits only"
        );
    }

    #[test]
    fn the_comparisons_stay_within_reach() {
        let brief = Brief::new();
        let pixels = brief.turned.iter().flatten().flatten();
        let places = pixels.map(|&at| [usize::from(at) % PATCH, usize::from(at) / PATCH]);
        let (least, most) = places.flatten().fold((PATCH, 0), |(least, most), at| {
            (least.min(at), most.max(at))
        });
        let middle = REACH - 1;
        let farthest = (middle - least).max(most - middle) as f64;
        assert!(farthest <= FARTHEST.ceil(), "{least} to {most}");
    }
}
