//! Randomness without state: the same place and seed give the same number on any thread, in any order.
//!
//! Textures and sensor noise are functions of integer coordinates, mixed by a 32-bit integer hash with low bias, so
//! that a picture does not depend on which thread drew which row.
//!
//! - C. Wellons, *Prospecting for Hash Functions*, 2018 (`lowbias32`).
//! - K. Perlin, *An Image Synthesizer*, SIGGRAPH 1985: lattice noise and its sum over octaves.

#![expect(
    clippy::inline_always,
    reason = "loops over these become vector instructions only if all of them is in the loop"
)]

use crate::lanes::{LANES, Lanes};

/// Mixes a number so that every bit of the result depends on every bit of it.
#[inline(always)]
pub fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A number that belongs to a lattice point.
#[inline(always)]
pub fn at_cell(x: i32, y: i32, seed: u32) -> u32 {
    // Odd multipliers spread neighbouring cells over all bits before they are mixed once.
    let place =
        x.cast_unsigned().wrapping_mul(0x9e37_79b1) ^ y.cast_unsigned().wrapping_mul(0x85eb_ca6b);
    mix(place
        .wrapping_add(seed.wrapping_mul(0xc2b2_ae35))
        .wrapping_add(0x27d4_eb2f))
}

/// A hash as a number in `0.0..1.0`.
#[inline(always)]
pub fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A hash as a number of zero mean and unit variance, nearly normal: the sum of its four bytes.
#[inline(always)]
pub fn normal(hash: u32) -> f32 {
    let sum = (hash & 0xff) + (hash >> 8 & 0xff) + (hash >> 16 & 0xff) + (hash >> 24);
    // Four uniform bytes: mean 510, variance 4·(256² - 1)/12 = 147.8².
    (sum as f32 - 510.0) / 147.8
}

/// Smooth lattice noise in `0.0..1.0`, wavelength about 2.
#[inline(always)]
pub fn value(x: f32, y: f32, seed: u32) -> f32 {
    let (i, j) = (floor(x), floor(y));
    let (u, v) = (fade(x - i as f32), fade(y - j as f32));
    let corner = |di: i32, dj: i32| unit(at_cell(i.wrapping_add(di), j.wrapping_add(dj), seed));
    let low = lerp(corner(0, 0), corner(1, 0), u);
    let high = lerp(corner(0, 1), corner(1, 1), u);
    lerp(low, high, v)
}

/// A sum of [`value`] noise over octaves, in about `-1.0..1.0`; octaves finer than `footprint` (the size of a pixel in
/// the units of `x` and `y`) are left out, as a lens would.
pub fn octaves(x: f32, y: f32, count: u32, footprint: f32, seed: u32) -> f32 {
    let (mut sum, mut amplitude, mut frequency) = (0.0, 0.5, 1.0);
    for octave in 0..count {
        let visible = visible(1.0 / frequency, footprint);
        if visible <= 0.0 {
            break;
        }
        let sample = value(x * frequency, y * frequency, seed.wrapping_add(octave));
        sum += amplitude * visible * (2.0 * sample - 1.0);
        amplitude *= 0.6;
        frequency *= 2.17;
    }
    sum
}

/// [`octaves`] at many places: along x, along y and their footprints, of which none is less than `finest`.
#[inline(always)]
pub(crate) fn octaves_at(
    [x, y, footprint]: [&Lanes; 3],
    finest: f32,
    count: u32,
    seed: u32,
) -> Lanes {
    let (mut sum, mut amplitude, mut frequency) = ([0.0; LANES], 0.5, 1.0);
    for octave in 0..count {
        if visible(1.0 / frequency, finest) <= 0.0 {
            break;
        }
        let seed = seed.wrapping_add(octave);
        for (k, sum) in sum.iter_mut().enumerate() {
            let visible = visible(1.0 / frequency, footprint[k]);
            let sample = value(x[k] * frequency, y[k] * frequency, seed);
            *sum += amplitude * visible * (2.0 * sample - 1.0);
        }
        amplitude *= 0.6;
        frequency *= 2.17;
    }
    sum
}

/// The largest integer that is not greater, for numbers of less than four million; others give some integer.
///
/// Baseline x86-64 has no instruction for `f32::floor`, casts to integers saturate, which no vector instruction does, and
/// this is called some ten million times a picture. The sum has no bits left for a fraction.
#[inline(always)]
pub fn floor(x: f32) -> i32 {
    const SHIFT: f32 = 12_582_912.0; // 1.5 · 2²³
    let shifted = x + SHIFT;
    let nearest = shifted
        .to_bits()
        .cast_signed()
        .wrapping_sub(SHIFT.to_bits().cast_signed());
    nearest.wrapping_sub(i32::from(shifted - SHIFT > x))
}

/// How much contrast of a detail of this size is left when a pixel covers `footprint`: 1 if it spans several pixels,
/// 0 if it is smaller than one.
#[inline(always)]
pub fn visible(detail: f32, footprint: f32) -> f32 {
    (detail / footprint - 1.0).clamp(0.0, 1.0)
}

/// `from` at 0, `to` at 1.
#[inline(always)]
pub fn lerp(from: f32, to: f32, share: f32) -> f32 {
    from + (to - from) * share
}

#[inline(always)]
fn fade(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_noise_has_zero_mean_and_unit_variance() {
        let count = 100_000;
        let samples = (0..count).map(|i| f64::from(normal(at_cell(i, 7, 1))));
        let (sum, squares) = samples.fold((0.0, 0.0), |(s, q), x| (s + x, q + x * x));
        let (mean, variance) = (sum / f64::from(count), squares / f64::from(count));
        // Three standard errors of 100,000 samples.
        assert!(mean.abs() < 0.0095, "mean {mean}");
        assert!((variance - 1.0).abs() < 0.0134, "variance {variance}");
    }

    #[test]
    fn floor_is_that_of_the_standard_library() {
        let near = (-300..300_i16).flat_map(|i| [-1e-3, 0.0, 1e-3].map(|d| f32::from(i) + d));
        let far = [0.5, 0.999_999, -1e-30, 1e6 + 0.5, -1e6 - 0.5, 3.9e6, -3.9e6];
        for x in near.chain(far) {
            assert_eq!(floor(x), x.floor() as i32, "{x}");
        }
    }

    #[test]
    fn noise_is_continuous_across_its_lattice() {
        for i in -5..5 {
            let x = i as f32;
            let step = (value(x - 1e-4, 0.3, 3) - value(x + 1e-4, 0.3, 3)).abs();
            assert!(step < 1e-3, "a step of {step} at {x}");
        }
    }
}
