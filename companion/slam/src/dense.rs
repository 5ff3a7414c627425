//! The depth of keyframes for dense mapping: static surfaces only, thinned out, without the pixels that hang in the air
//! between a near and a far surface.

use maps::camera::RgbdFrame;
use maps::frame::{Camera, Isometry, Point, World};
use maps::time::Stamp;

use crate::coarse::Coarse;
use crate::features::DepthRange;
use crate::optics::Optics;

/// A keyframe whose pose will not change any more, and the static surface it saw.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseKeyframe {
    /// When it was taken.
    pub at: Stamp,
    /// Where it was taken from.
    pub world_from_camera: Isometry<World, Camera>,
    /// Points of the static surface with their red, green and blue.
    pub points: Vec<(Point<Camera>, [u8; 3])>,
}

/// Thinned-out depth and colour that wait until the keyframe's pose and mask are final.
pub(crate) struct Pending {
    /// Raw pixel, depth and colour.
    samples: Vec<(u16, u16, f32, [u8; 3])>,
}

impl Pending {
    /// Every `stride`th pixel whose surroundings, as far as known, lie on the same surface.
    pub(crate) fn new(frame: &RgbdFrame, depths: DepthRange, stride: usize) -> Self {
        let stride = stride.max(1);
        let mut samples = Vec::new();
        for y in (2..frame.height.saturating_sub(2)).step_by(stride) {
            for x in (2..frame.width.saturating_sub(2)).step_by(stride) {
                let at = y * frame.width + x;
                if let Some(depth) = depths.check(frame.depth_m[at])
                    && on_surface(frame, (x, y), depth)
                {
                    samples.push((x as u16, y as u16, depth, frame.rgb[at]));
                }
            }
        }
        samples.shrink_to_fit();
        Self { samples }
    }

    /// The static points: those that do not move, and that nobody has looked through.
    pub(crate) fn points(
        &self,
        optics: &Optics,
        (coarse, seen_through): (&Coarse, &[bool]),
    ) -> Vec<(Point<Camera>, [u8; 3])> {
        let is_static = |x: u16, y: u16| {
            let cell = optics.cell_at([f32::from(x), f32::from(y)]);
            !coarse.moving[cell] && seen_through.get(cell) != Some(&true)
        };
        self.samples
            .iter()
            .filter(|&&(x, y, ..)| is_static(x, y))
            .map(|&(x, y, depth, rgb)| {
                let pixel = [f64::from(x), f64::from(y)];
                (optics.camera.unproject(pixel, f64::from(depth)), rgb)
            })
            .collect()
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
