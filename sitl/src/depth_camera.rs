//! What a stereo depth camera makes of a true picture: noise, holes, shadows and frayed edges.
//!
//! Depth is measured as disparity `d = f·b/z`, so that an error of `σ_d` pixels grows with range squared:
//!
//! ```text
//! σ_z = z² · σ_d / (f·b)
//! ```
//!
//! with `b` = 95 mm and `σ_d` ≈ 0.08 pixels for a `RealSense` D455, 2 mm at 1 m and 3.5 cm at 4 m. The right imager does
//! not see what lies just left of a near edge: a hole as wide as the jump in disparity. Matching windows fray edges.
//! All noise is a function of seed, moment and pixel.
//!
//! - A. Grunnet-Jepsen et al., *Best-Known-Methods for Tuning Intel `RealSense` D400 Depth Cameras*, 2018 (RMS error).
//! - K. Khoshelham and S. Oude Elberink, *Accuracy and Resolution of Kinect Depth Data*, Sensors 12(2), 2012, Eq. (10).

#![expect(
    clippy::inline_always,
    reason = "loops over these become vector instructions only if all of them is in the loop"
)]

use maps::camera::{Pinhole, RgbdFrame};
use rayon::prelude::*;

use crate::lanes::{LANES, Lanes, lanes, vectorised};
use crate::noise::{at_cell, floor, lerp, mix, normal, unit, value};
use crate::render::Picture;

/// Between the two imagers, in metres.
pub const BASELINE_M: f32 = 0.095;
/// One standard deviation of the disparity, in pixels.
pub const DISPARITY_NOISE: f32 = 0.08;
/// Nearest depth that is reported, in metres.
const NEAREST_M: f32 = 0.4;
/// The farthest depth that is reported indoors: the range for which the camera is specified.
pub const INDOORS_M: f32 = 6.0;
/// The farthest depth that is reported outdoors, where textures are coarse and there is light enough; noise grows all the same.
pub const OUTDOORS_M: f32 = 20.0;
/// Neighbouring pixels share part of the noise: the matching window is about this many pixels wide.
const WINDOW: f32 = 5.0;
/// Beyond this angle to the surface (its cosine) there is no match.
const GRAZING: f32 = 0.08;
/// Standard deviation of each colour channel, in grey levels.
const COLOUR_NOISE: f32 = 1.5;

/// A D455 in its 640 x 480 mode: 79 degrees wide, without lens distortion.
pub fn d455() -> Pinhole {
    Pinhole {
        width: 640,
        height: 480,
        fx: 386.0,
        fy: 386.0,
        cx: 319.5,
        cy: 239.5,
        distortion: [0.0; 5],
    }
}

/// What the camera delivers of what there is to be seen. Depth beyond `reach_m` is left out.
pub fn expose(picture: &Picture, camera: &Pinhole, reach_m: f32, seed: u64) -> RgbdFrame {
    let moment = picture.at.as_nanos() ^ seed.rotate_left(32) ^ seed;
    let sensor = Sensor {
        picture,
        focal_baseline: camera.fx as f32 * BASELINE_M,
        reach_m,
        seed: mix(mix(moment as u32) ^ (moment >> 32) as u32),
    };
    let (width, pixels) = (picture.width.max(1), picture.width * picture.height);
    let mut frame = RgbdFrame {
        at: picture.at,
        width: picture.width,
        height: picture.height,
        rgb: vec![[0; 3]; pixels],
        depth_m: vec![0.0; pixels],
    };
    let rows = frame.rgb.par_chunks_mut(width);
    let rows = rows.zip(frame.depth_m.par_chunks_mut(width)).enumerate();
    rows.for_each_init(Vec::new, |hidden, (y, (rgb, depth_m))| {
        sensor.hidden(y, hidden);
        expose_row(&sensor, y, hidden, rgb, depth_m);
    });
    frame
}

vectorised! {
fn expose_row(
    sensor: &Sensor<'_>,
    y: usize,
    hidden: &[bool],
    rgb: &mut [[u8; 3]],
    depth_m: &mut [f32],
) {
    let last = signed(sensor.picture.width) - 1;
    let chunks = rgb.chunks_mut(LANES).zip(depth_m.chunks_mut(LANES));
    for (from, (rgb, depth_m)) in (0..).step_by(LANES).zip(chunks) {
        // Lanes beyond the edge repeat its pixel.
        let pixels = Pixels {
            x: lanes!(k => (signed(from) + signed(k)).min(last)),
            y: signed(y),
        };
        let measured = measured(sensor, &pixels, hidden);
        depth_m.copy_from_slice(&measured[..depth_m.len()]);
        let colours = coloured(sensor, &pixels);
        for (k, rgb) in rgb.iter_mut().enumerate() {
            *rgb = [colours[0][k], colours[1][k], colours[2][k]];
        }
    }
}
}

struct Sensor<'a> {
    picture: &'a Picture,
    /// Disparity in pixels times depth in metres.
    focal_baseline: f32,
    reach_m: f32,
    seed: u32,
}

/// Pixels of one row.
struct Pixels {
    x: Lanes<i32>,
    y: i32,
}

impl Pixels {
    #[inline(always)]
    fn index(&self, k: usize, picture: &Picture) -> usize {
        self.y as usize * picture.width + self.x[k] as usize
    }

    /// Smooth noise with cells of so many pixels, in `0.0..1.0`.
    #[inline(always)]
    fn value(&self, cell: f32, seed: u32) -> Lanes {
        let x = lanes!(k => self.x[k] as f32 / cell);
        let y = self.y as f32 / cell;
        lanes!(k => value(x[k], y, seed))
    }
}

impl Sensor<'_> {
    #[inline(always)]
    fn random(&self, pixels: &Pixels, what: u32) -> Lanes<u32> {
        let seed = self.seed ^ mix(what);
        let first = pixels.y.wrapping_mul(signed(self.picture.width));
        lanes!(k => at_cell(first.wrapping_add(pixels.x[k]), 0, seed))
    }

    /// Which pixels of a row the right imager does not see, because something nearer to the right of them hides them.
    ///
    /// A pixel at column `u` appears in the right image at `u - d`. It is hidden if a pixel further right appears to the
    /// left of it there: the largest disparity-minus-column so far, from the right, decides.
    fn hidden(&self, y: usize, hidden: &mut Vec<bool>) {
        let width = self.picture.width;
        hidden.clear();
        hidden.resize(width, false);
        let depths = &self.picture.depth_m[y * width..][..width];
        let mut foremost = f32::NEG_INFINITY;
        for (column, (hidden, &depth_m)) in hidden.iter_mut().zip(depths).enumerate().rev() {
            if depth_m > 0.0 {
                let place = self.focal_baseline / depth_m - column as f32;
                // A pixel of tolerance: surfaces at a slant do not hide themselves.
                *hidden = foremost > place + 1.0;
                foremost = foremost.max(place);
            }
        }
    }

    /// The depth that the matching window takes for a pixel's: near an edge, perhaps a neighbour's or a mixture.
    #[inline(always)]
    fn frayed(&self, pixels: &Pixels) -> Lanes {
        let picture = self.picture;
        // No closures here, which may stay calls; see `lanes!`.
        let right = pixels.value(3.0, self.seed ^ mix(1));
        let down = pixels.value(3.0, self.seed ^ mix(2));
        let wobble = |noise: f32| floor((noise - 0.5) * 5.0 + 0.5);
        let (last_x, last_y) = (signed(picture.width) - 1, signed(picture.height) - 1);
        let x = lanes!(k => (pixels.x[k] + wobble(right[k])).clamp(0, last_x) as usize);
        let y = lanes!(k => (pixels.y + wobble(down[k])).clamp(0, last_y) as usize);
        let here = lanes!(k => picture.depth_m[pixels.index(k, picture)]);
        let there = lanes!(k => picture.depth_m[y[k] * picture.width + x[k]]);
        let (chance, share) = (self.random(pixels, 5), self.random(pixels, 6));
        lanes!(k => {
            let is_jump = (here[k] - there[k]).abs() > 0.05 * here[k].max(there[k]);
            let is_between = is_jump && here[k] > 0.0 && there[k] > 0.0;
            // A flying pixel between foreground and background.
            let flies = is_between && chance[k].is_multiple_of(6);
            let mixed = lerp(here[k], there[k], unit(share[k]));
            if flies { mixed } else { there[k] }
        })
    }

    /// No match: too slanted, or too little light from afar.
    #[inline(always)]
    fn holes(&self, pixels: &Pixels, depth_m: &Lanes) -> Lanes<bool> {
        let patch = pixels.value(9.0, self.seed ^ mix(7));
        let speck = self.random(pixels, 8);
        let facing = lanes!(k => self.picture.facing[pixels.index(k, self.picture)]);
        lanes!(k => {
            let far = depth_m[k] / self.reach_m;
            let lost = 0.05 + 0.09 * (far * far);
            facing[k] < GRAZING || patch[k] < lost || unit(speck[k]) < 0.004
        })
    }
}

/// In whole millimetres, as the camera reports it; 0 where it reports nothing.
#[inline(always)]
fn measured(sensor: &Sensor<'_>, pixels: &Pixels, hidden: &[bool]) -> Lanes {
    let seen = sensor.frayed(pixels);
    let holes = sensor.holes(pixels, &seen);
    // Neighbours share what their windows have in common.
    let window = pixels.value(WINDOW, sensor.seed ^ mix(3));
    let own = sensor.random(pixels, 4);
    let (fb, reach_m) = (sensor.focal_baseline, sensor.reach_m);
    lanes!(k => {
        // The mean of a lattice blend is 1/2; its standard deviation about 0.21 on average over a cell.
        let shared = (window[k] - 0.5) / 0.21;
        let noise = DISPARITY_NOISE * (0.8 * shared + 0.6 * normal(own[k]));
        let measured = fb / (fb / seen[k] + noise);
        let is_lost = seen[k] <= 0.0 || holes[k] || hidden[pixels.x[k] as usize];
        let is_within = measured >= NEAREST_M && measured <= reach_m;
        let millimetres = floor((measured * 1000.0 + 0.5).min(65_535.0));
        if is_within && !is_lost { millimetres as f32 / 1000.0 } else { 0.0 }
    })
}

#[inline(always)]
fn coloured(sensor: &Sensor<'_>, pixels: &Pixels) -> [Lanes<u8>; 3] {
    let rgb = lanes!(k => sensor.picture.rgb[pixels.index(k, sensor.picture)]);
    let mut colours = [[0; LANES]; 3];
    for (c, what) in (0..3).zip(21..) {
        let random = sensor.random(pixels, what);
        for k in 0..LANES {
            let noisy = f32::from(rgb[k][c]) + COLOUR_NOISE * normal(random[k]);
            colours[c][k] = floor((noisy + 0.5).clamp(0.0, 255.0)) as u8;
        }
    }
    colours
}

/// An index or size as a coordinate. No picture has two billion pixels.
#[inline(always)]
fn signed(n: usize) -> i32 {
    (n as u32).cast_signed()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Instance;
    use maps::time::Stamp;

    fn wall(depth_m: f32) -> Picture {
        let pixels = 640 * 480;
        Picture {
            at: Stamp::from_nanos(1),
            width: 640,
            height: 480,
            rgb: vec![[100; 3]; pixels],
            depth_m: vec![depth_m; pixels],
            facing: vec![1.0; pixels],
            instance: vec![Instance(2); pixels],
        }
    }

    fn measured(depth_m: f32) -> Vec<f64> {
        let frame = expose(&wall(depth_m), &d455(), INDOORS_M, 1);
        frame
            .depth_m
            .iter()
            .filter(|&&z| z > 0.0)
            .map(|&z| f64::from(z))
            .collect()
    }

    #[test]
    fn noise_grows_with_range_squared() {
        let spread = |depth_m: f32| {
            let seen = measured(depth_m);
            let mean = seen.iter().sum::<f64>() / seen.len() as f64;
            assert!(
                (mean - f64::from(depth_m)).abs() < 0.01,
                "mean {mean} at {depth_m} m"
            );
            (seen.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / seen.len() as f64).sqrt()
        };
        let [at_1, at_4] = [1.0, 4.0].map(spread);
        assert!((0.0015..0.003).contains(&at_1), "{at_1} m at 1 m");
        assert!(
            (13.0..19.0).contains(&(at_4 / at_1)),
            "{at_4} m at 4 m, {at_1} m at 1 m"
        );
    }

    #[test]
    fn most_of_a_wall_is_measured_and_nothing_beyond_the_range() {
        let share = measured(3.0).len() as f64 / (640.0 * 480.0);
        assert!((0.85..0.995).contains(&share), "{share}");
        assert!(measured(8.0).is_empty());
        assert!(measured(0.2).is_empty());
    }

    #[test]
    fn a_near_edge_hides_what_is_left_of_it() {
        let mut picture = wall(4.0);
        for (i, depth) in picture.depth_m.iter_mut().enumerate() {
            if i % 640 >= 320 {
                *depth = 1.0;
            }
        }
        let frame = expose(&picture, &d455(), INDOORS_M, 1);
        let seen = |columns: std::ops::Range<usize>| {
            let all =
                (0..480).flat_map(|row| columns.clone().map(move |column| row * 640 + column));
            all.clone().filter(|&i| frame.depth_m[i] > 0.0).count() as f64 / all.count() as f64
        };
        // f·b·(1/1 - 1/4) = 27 pixels.
        assert!(seen(300..315) < 0.05, "in the shadow");
        assert!(seen(240..285) > 0.8, "left of the shadow");
        assert!(seen(330..400) > 0.8, "on the near side");
    }

    #[test]
    fn the_same_seed_and_moment_give_the_same_noise_and_others_do_not() {
        let picture = wall(2.0);
        let frame = expose(&picture, &d455(), INDOORS_M, 1);
        assert!(frame == expose(&picture, &d455(), INDOORS_M, 1));
        assert!(frame != expose(&picture, &d455(), INDOORS_M, 2));
        let later = Picture {
            at: Stamp::from_nanos(2),
            ..picture
        };
        assert!(frame.depth_m != expose(&later, &d455(), INDOORS_M, 1).depth_m);
    }
}
