//! From one RGB-D image to features: corners with a description, an undistorted pixel and, where the surface around them
//! is smooth, a depth.

use maps::camera::RgbdFrame;

use crate::brief::{Brief, Descriptor, REACH};
use crate::fast::{Thresholds, corners};
use crate::optics::Optics;
use crate::pyramid::{Gray, Pyramid, SCALE};
use crate::spread::spread;

/// Pyramid levels.
pub(crate) const LEVELS: usize = 8;
const THRESHOLDS: Thresholds = Thresholds {
    strict: 20,
    lenient: 7,
};

/// A corner of the image.
#[derive(Clone, Debug)]
pub(crate) struct Feature {
    /// Pixel in the image as taken.
    pub(crate) raw: [f32; 2],
    /// Pixel without lens distortion.
    pub(crate) ideal: [f64; 2],
    /// Pyramid level on which it was found.
    pub(crate) octave: u8,
    /// Distance along the optical axis; `None` where unknown or at a jump in depth.
    pub(crate) depth_m: Option<f64>,
    /// Whether the sensor sees nothing in reach here: perhaps it is too far.
    pub(crate) is_far: bool,
    pub(crate) descriptor: Descriptor,
}

/// The scale of a pyramid level: its pixels are that many pixels of the image wide.
pub(crate) fn scale_of(octave: u8) -> f64 {
    SCALE.powi(i32::from(octave))
}

/// Finds features in images.
pub(crate) struct Extractor {
    brief: Brief,
    quotas: [usize; LEVELS],
}

impl Extractor {
    /// An extractor of about `count` features an image, fewer on smaller levels.
    pub(crate) fn new(count: usize) -> Self {
        let weights: [f64; LEVELS] = std::array::from_fn(|level| scale_of(level as u8).recip());
        let sum: f64 = weights.iter().sum();
        Self {
            brief: Brief::new(),
            quotas: weights.map(|w| (count as f64 * w / sum).ceil() as usize),
        }
    }

    pub(crate) fn extract(
        &self,
        optics: &Optics,
        frame: &RgbdFrame,
        depths: DepthRange,
    ) -> Vec<Feature> {
        let base = Gray::from_rgb(frame.width, frame.height, &frame.rgb);
        let pyramid = Pyramid::new(base, LEVELS, 2 * REACH + 8);
        let mut features = Vec::with_capacity(self.quotas.iter().sum());
        for (octave, (image, &quota)) in pyramid.levels.iter().zip(&self.quotas).enumerate() {
            let found = corners(image, REACH, THRESHOLDS);
            let smooth = image.blurred();
            let scale = scale_of(octave as u8);
            for corner in spread(found, image.width, image.height, quota) {
                let angle = self.brief.angle(image, corner.x, corner.y);
                let raw = [
                    (corner.x as f64 + 0.5) * scale - 0.5,
                    (corner.y as f64 + 0.5) * scale - 0.5,
                ];
                features.push(Feature {
                    raw: [raw[0] as f32, raw[1] as f32],
                    ideal: optics.ideal(raw),
                    octave: octave as u8,
                    depth_m: depths.smooth_depth(frame, raw),
                    is_far: depths.out_of_reach(frame, raw),
                    descriptor: self.brief.describe(&smooth, corner.x, corner.y, angle),
                });
            }
        }
        features
    }
}

/// The depths that are believed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DepthRange {
    pub(crate) min_m: f32,
    pub(crate) max_m: f32,
}

impl DepthRange {
    /// The depth if it is one the sensor can measure; NaN is not.
    pub(crate) fn check(self, depth_m: f32) -> Option<f32> {
        (depth_m >= self.min_m && depth_m <= self.max_m).then_some(depth_m)
    }

    /// Whether nothing in reach is measured at a pixel and two pixels around it.
    fn out_of_reach(self, frame: &RgbdFrame, raw: [f64; 2]) -> bool {
        let (x, y) = (raw[0].round() as usize, raw[1].round() as usize);
        let columns = x.saturating_sub(2)..=(x + 2).min(frame.width - 1);
        let mut pixels = (y.saturating_sub(2)..=(y + 2).min(frame.height - 1)).flat_map(|row| {
            columns
                .clone()
                .map(move |column| row * frame.width + column)
        });
        pixels.all(|at| {
            let d = frame.depth_m[at];
            self.check(d).is_none() && !(d > 0.0 && d < self.min_m)
        })
    }

    /// The depth at a pixel whose neighbours two pixels away lie on the same surface: at a jump in depth, colour and
    /// depth image disagree about who is in front.
    fn smooth_depth(self, frame: &RgbdFrame, raw: [f64; 2]) -> Option<f64> {
        let (x, y) = (raw[0].round() as isize, raw[1].round() as isize);
        let at = |dx: isize, dy: isize| {
            let (x, y) = (usize::try_from(x + dx).ok()?, usize::try_from(y + dy).ok()?);
            (x < frame.width && y < frame.height)
                .then(|| frame.depth_m[y * frame.width + x])
                .and_then(|d| self.check(d))
        };
        let center = at(0, 0)?;
        let jump = 0.02 + 0.02 * center;
        let around = [at(-2, 0), at(2, 0), at(0, -2), at(0, 2)];
        let known = around.iter().flatten();
        let smooth = known.clone().count() >= 3 && known.clone().all(|d| (d - center).abs() < jump);
        smooth.then_some(f64::from(center))
    }
}

/// Features by place, for searches around a pixel.
#[derive(Clone, Debug, Default)]
pub(crate) struct Grid {
    across: usize,
    down: usize,
    starts: Vec<u32>,
    items: Vec<u32>,
}

const GRID_CELL: f64 = 20.0;

impl Grid {
    pub(crate) fn new(optics: &Optics, features: &[Feature]) -> Self {
        let across = (optics.camera.width as f64 / GRID_CELL).ceil().max(1.0) as usize;
        let down = (optics.camera.height as f64 / GRID_CELL).ceil().max(1.0) as usize;
        let mut grid = Self {
            across,
            down,
            starts: vec![0; across * down + 1],
            items: vec![0; features.len()],
        };
        let cells: Vec<usize> = features.iter().map(|f| grid.cell(f.ideal)).collect();
        for &cell in &cells {
            grid.starts[cell + 1] += 1;
        }
        for cell in 0..across * down {
            grid.starts[cell + 1] += grid.starts[cell];
        }
        let mut next = grid.starts.clone();
        for (i, &cell) in cells.iter().enumerate() {
            grid.items[next[cell] as usize] = i as u32;
            next[cell] += 1;
        }
        grid
    }

    fn column(&self, u: f64) -> usize {
        ((u / GRID_CELL).max(0.0) as usize).min(self.across - 1)
    }

    fn line(&self, v: f64) -> usize {
        ((v / GRID_CELL).max(0.0) as usize).min(self.down - 1)
    }

    fn cell(&self, ideal: [f64; 2]) -> usize {
        self.line(ideal[1]) * self.across + self.column(ideal[0])
    }

    /// The features within `radius` of `center` along each axis.
    pub(crate) fn around<'a>(
        &'a self,
        features: &'a [Feature],
        center: [f64; 2],
        radius: f64,
    ) -> impl Iterator<Item = (usize, &'a Feature)> {
        let [u, v] = center;
        let columns = self.column(u - radius)..self.column(u + radius) + 1;
        let lines = self.line(v - radius)..=self.line(v + radius);
        lines
            .flat_map(move |line| {
                let row = line * self.across;
                let from = self.starts[row + columns.start] as usize;
                let to = self.starts[row + columns.end] as usize;
                self.items[from..to].iter()
            })
            .map(|&i| (i as usize, &features[i as usize]))
            .filter(move |(_, f)| {
                (f.ideal[0] - u).abs() <= radius && (f.ideal[1] - v).abs() <= radius
            })
    }
}
