//! The depth of keyframes for dense mapping: static surfaces only, thinned out, without the pixels that hang in the air
//! between a near and a far surface.

use std::sync::Arc;

use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Camera, Isometry, Point, World};
use maps::time::Stamp;

use crate::coarse::Coarse;
use crate::features::DepthRange;
use crate::optics::Optics;

/// A keyframe and the static surface it saw. Cheap to copy: copies share the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseKeyframe {
    /// When it was taken.
    pub at: Stamp,
    /// Where it was taken from, by all that is known now.
    pub world_from_camera: Isometry<World, Camera>,
    pub(crate) camera: Pinhole,
    pub(crate) surface: Arc<Surface>,
}

impl DenseKeyframe {
    /// Points of the static surface with their red, green and blue.
    pub fn points(&self) -> impl Iterator<Item = (Point<Camera>, [u8; 3])> + '_ {
        self.surface
            .samples()
            .map(|(pixel, depth_m, rgb)| (self.camera.unproject(pixel, depth_m), rgb))
    }
}

/// What has become known of the dense map.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseUpdate {
    /// Whether poses of keyframes handed out before were corrected: the map made of them is to be forgotten and made anew
    /// of `keyframes`, which then are all there are.
    pub anew: bool,
    /// Keyframes to be put into the map, oldest first.
    pub keyframes: Vec<DenseKeyframe>,
}

/// The static surface of a keyframe, as a grid of samples: a bit for each, and for those that are there the depth in 65 535
/// steps and the colour. Five bytes a sample.
#[derive(Debug, PartialEq)]
pub(crate) struct Surface {
    /// Pixels from one sample to the next, and samples across.
    stride: usize,
    across: usize,
    there: Vec<u64>,
    depth: Vec<u16>,
    step_m: f32,
    rgb: Vec<[u8; 3]>,
}

impl Surface {
    fn samples(&self) -> impl Iterator<Item = ([f64; 2], f64, [u8; 3])> + '_ {
        let set = |&at: &usize| self.there[at / 64] >> (at % 64) & 1 == 1;
        let place = |at: usize| {
            let (column, row) = (at % self.across, at / self.across);
            [MARGIN + column * self.stride, MARGIN + row * self.stride].map(|c| c as f64)
        };
        let values = self.depth.iter().zip(&self.rgb);
        (0..64 * self.there.len())
            .filter(set)
            .zip(values)
            .map(move |(at, (&depth, &rgb))| {
                let depth_m = f64::from(f32::from(depth) * self.step_m);
                (place(at), depth_m, rgb)
            })
    }
}

/// Pixels at the rim that are left out.
const MARGIN: usize = 2;

/// Thinned-out depth and colour that wait until the keyframe's mask is final.
pub(crate) struct Pending {
    /// Raw pixel, depth and colour.
    samples: Vec<(u16, u16, f32, [u8; 3])>,
    stride: usize,
    across: usize,
    down: usize,
}

impl Pending {
    /// Every `stride`th pixel whose surroundings, as far as known, lie on the same surface.
    pub(crate) fn new(frame: &RgbdFrame, depths: DepthRange, stride: usize) -> Self {
        let stride = stride.max(1);
        let columns = (MARGIN..frame.width.saturating_sub(MARGIN)).step_by(stride);
        let rows = (MARGIN..frame.height.saturating_sub(MARGIN)).step_by(stride);
        let (across, down) = (columns.len(), rows.len());
        let mut samples = Vec::new();
        for y in rows {
            for x in columns.clone() {
                let at = y * frame.width + x;
                if let Some(depth) = depths.check(frame.depth_m[at])
                    && on_surface(frame, (x, y), depth)
                {
                    samples.push((x as u16, y as u16, depth, frame.rgb[at]));
                }
            }
        }
        samples.shrink_to_fit();
        Self {
            samples,
            stride,
            across,
            down,
        }
    }

    /// The static part: what does not move, and what nobody has looked through.
    pub(crate) fn surface(
        &self,
        optics: &Optics,
        (coarse, seen_through): (&Coarse, &[bool]),
    ) -> Surface {
        let farthest = self.samples.iter().map(|s| s.2).fold(0.0, f32::max);
        let mut surface = Surface {
            stride: self.stride,
            across: self.across.max(1),
            there: vec![0; (self.across * self.down).div_ceil(64)],
            depth: Vec::new(),
            step_m: farthest.max(1e-3) / f32::from(u16::MAX),
            rgb: Vec::new(),
        };
        for &(x, y, depth_m, rgb) in &self.samples {
            let cell = optics.cell_at([f32::from(x), f32::from(y)]);
            if coarse.is_unmapped(cell) || seen_through.get(cell) == Some(&true) {
                continue;
            }
            let (column, row) = (usize::from(x) - MARGIN, usize::from(y) - MARGIN);
            let at = row / self.stride * self.across + column / self.stride;
            surface.there[at / 64] |= 1 << (at % 64);
            surface
                .depth
                .push((depth_m / surface.step_m).round() as u16);
            surface.rgb.push(rgb);
        }
        surface.depth.shrink_to_fit();
        surface.rgb.shrink_to_fit();
        surface
    }
}

/// Whether the eight pixels two away have no jump in depth to this one and at most two are unknown. The tolerance
/// allows for a floor seen at a low angle.
fn on_surface(frame: &RgbdFrame, (x, y): (usize, usize), depth: f32) -> bool {
    let jump = 0.02 + 0.012 * depth * depth;
    let mut unknown = 0;
    for row in [y - 2, y, y + 2] {
        for column in [x - 2, x, x + 2] {
            let d = frame.depth_m[row * frame.width + column];
            if d.is_nan() || d <= 0.0 {
                unknown += 1;
            } else if (d - depth).abs() > jump {
                return false;
            }
        }
    }
    unknown <= 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packed_surface_gives_back_its_samples_to_a_tenth_of_a_millimetre() {
        let camera = Pinhole {
            width: 64,
            height: 48,
            fx: 50.0,
            fy: 50.0,
            cx: 31.5,
            cy: 23.5,
            distortion: [0.0; 5],
        };
        let optics = Optics::new(camera);
        let depth_of = |i: usize| 1.0 + (i % 64) as f32 * 0.001 + (i / 64) as f32 * 0.002;
        let frame = RgbdFrame {
            at: Stamp::ZERO,
            width: 64,
            height: 48,
            rgb: (0..64 * 48).map(|i| [i as u8, 1, 2]).collect(),
            depth_m: (0..64 * 48).map(depth_of).collect(),
        };
        let depths = DepthRange {
            min_m: 0.3,
            max_m: 6.0,
        };
        let mut coarse = Coarse::new(&optics, &frame, depths);
        let pending = Pending::new(&frame, depths, 3);
        let masked = optics.cell_at([20.0, 20.0]);
        coarse.moving[masked] = true;
        let surface = pending.surface(&optics, (&coarse, &[]));
        let unmasked = |s: &&(u16, u16, f32, [u8; 3])| {
            optics.cell_at([f32::from(s.0), f32::from(s.1)]) != masked
        };
        let wanted: Vec<_> = pending.samples.iter().filter(unmasked).collect();
        assert!(wanted.len() > 250 && wanted.len() < pending.samples.len());
        assert_eq!(surface.samples().count(), wanted.len());
        for ((pixel, depth_m, rgb), (x, y, exact, color)) in surface.samples().zip(wanted) {
            assert_eq!((pixel, rgb), ([f64::from(*x), f64::from(*y)], *color));
            assert!((depth_m - f64::from(*exact)).abs() < 1e-4);
        }
    }
}
