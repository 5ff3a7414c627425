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

use maps::camera::{Pinhole, RgbdFrame};
use rayon::prelude::*;

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
    let focal_baseline = camera.fx as f32 * BASELINE_M;
    let sensor = Sensor {
        picture,
        focal_baseline,
        reach_m,
        hidden: shadows(picture, focal_baseline),
        seed: mix(mix(moment as u32) ^ (moment >> 32) as u32),
    };
    let pixels = picture.width * picture.height;
    let depth_m = (0..pixels)
        .into_par_iter()
        .map(|i| sensor.depth_m(i))
        .collect();
    let rgb = (0..pixels)
        .into_par_iter()
        .map(|i| sensor.colour(i))
        .collect();
    RgbdFrame {
        at: picture.at,
        width: picture.width,
        height: picture.height,
        rgb,
        depth_m,
    }
}

struct Sensor<'a> {
    picture: &'a Picture,
    /// Disparity in pixels times depth in metres.
    focal_baseline: f32,
    reach_m: f32,
    hidden: Vec<bool>,
    seed: u32,
}

impl Sensor<'_> {
    fn random(&self, i: usize, what: u32) -> u32 {
        at_cell(signed(i), 0, self.seed ^ mix(what))
    }

    fn true_depth(&self, x: i32, y: i32) -> f32 {
        let x = x.clamp(0, signed(self.picture.width) - 1) as usize;
        let y = y.clamp(0, signed(self.picture.height) - 1) as usize;
        self.picture.depth_m[y * self.picture.width + x]
    }

    fn colour(&self, i: usize) -> [u8; 3] {
        let mut channel = 20;
        self.picture.rgb[i].map(|level| {
            channel += 1;
            let noisy = f32::from(level) + COLOUR_NOISE * normal(self.random(i, channel));
            (noisy + 0.5).clamp(0.0, 255.0) as u8
        })
    }

    /// In whole millimetres, as the camera reports it; 0 where it reports nothing.
    fn depth_m(&self, i: usize) -> f32 {
        let (x, y) = (
            signed(i % self.picture.width),
            signed(i / self.picture.width),
        );
        let seen = self.frayed(i, x, y);
        if seen <= 0.0 || self.is_hole(i, seen) || self.hidden[i] {
            return 0.0;
        }
        let window =
            |what| normal_field(x as f32 / WINDOW, y as f32 / WINDOW, self.seed ^ mix(what));
        let noise = DISPARITY_NOISE * (0.8 * window(3) + 0.6 * normal(self.random(i, 4)));
        let measured = self.focal_baseline / (self.focal_baseline / seen + noise);
        if !(NEAREST_M..=self.reach_m).contains(&measured) {
            return 0.0;
        }
        f32::from((measured * 1000.0 + 0.5) as u16) / 1000.0
    }

    /// The depth that the matching window takes for this pixel's: near an edge, perhaps a neighbour's or a mixture.
    fn frayed(&self, i: usize, x: i32, y: i32) -> f32 {
        let wobble = |what| {
            let noise = value(x as f32 / 3.0, y as f32 / 3.0, self.seed ^ mix(what));
            floor((noise - 0.5) * 5.0 + 0.5)
        };
        let here = self.true_depth(x, y);
        let there = self.true_depth(x + wobble(1), y + wobble(2));
        let jump = (here - there).abs() > 0.05 * here.max(there);
        if jump && here > 0.0 && there > 0.0 && self.random(i, 5).is_multiple_of(6) {
            // A flying pixel between foreground and background.
            return lerp(here, there, unit(self.random(i, 6)));
        }
        there
    }

    /// No match: too slanted, or too little light from afar.
    fn is_hole(&self, i: usize, depth_m: f32) -> bool {
        let (x, y) = (
            (i % self.picture.width) as f32,
            (i / self.picture.width) as f32,
        );
        let patch = value(x / 9.0, y / 9.0, self.seed ^ mix(7));
        let lost = 0.05 + 0.09 * (depth_m / self.reach_m).powi(2);
        self.picture.facing[i] < GRAZING || patch < lost || unit(self.random(i, 8)) < 0.004
    }
}

/// Which pixels the right imager does not see, because something nearer to the right of them hides them.
///
/// A pixel at column `u` appears in the right image at `u - d`. It is hidden if a pixel further right appears to the
/// left of it there: the largest disparity-minus-column so far, from the right, decides.
fn shadows(picture: &Picture, focal_baseline: f32) -> Vec<bool> {
    let mut hidden = vec![false; picture.depth_m.len()];
    let rows = hidden.par_chunks_mut(picture.width.max(1));
    let depths = picture.depth_m.par_chunks(picture.width.max(1));
    rows.zip(depths).for_each(|(hidden, depths)| {
        let mut foremost = f32::NEG_INFINITY;
        for (column, (hidden, &depth_m)) in hidden.iter_mut().zip(depths).enumerate().rev() {
            if depth_m > 0.0 {
                let place = focal_baseline / depth_m - column as f32;
                // A pixel of tolerance: surfaces at a slant do not hide themselves.
                *hidden = foremost > place + 1.0;
                foremost = foremost.max(place);
            }
        }
    });
    hidden
}

/// An index or size as a coordinate. No picture has two billion pixels.
fn signed(n: usize) -> i32 {
    i32::try_from(n).unwrap_or(i32::MAX)
}

/// Smooth noise of about unit variance.
fn normal_field(x: f32, y: f32, seed: u32) -> f32 {
    // The mean of a lattice blend is 1/2; its standard deviation about 0.21 on average over a cell.
    (value(x, y, seed) - 0.5) / 0.21
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
