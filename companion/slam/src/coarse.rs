//! The depth image on a coarse grid, with what is known to move in it.

use maps::camera::RgbdFrame;

use crate::features::DepthRange;
use crate::optics::Optics;

/// Depth by cell, and which cells show something that moves.
#[derive(Clone, Debug, Default)]
pub(crate) struct Coarse {
    /// Depth in the middle of each cell in metres; 0 where unknown.
    pub(crate) depth_m: Vec<f32>,
    /// Least and largest depth of the 3 x 3 cells around each; 0 where fewer than 5 are known.
    pub(crate) near_m: Vec<f32>,
    pub(crate) far_m: Vec<f32>,
    /// Whether the cell shows something that moves, margin included.
    pub(crate) moving: Vec<bool>,
}

/// How much nearer than a surface a measurement must be to lie in front of it: the noise of structured-light depth,
/// which grows with the square of the distance, and the error of the pose.
pub(crate) fn clear_of(depth_m: f32) -> f32 {
    0.08 + 0.008 * depth_m * depth_m
}

impl Coarse {
    pub(crate) fn new(optics: &Optics, frame: &RgbdFrame, depths: DepthRange) -> Self {
        let depth_m: Vec<f32> = (0..optics.cell_count())
            .map(|cell| {
                let [x, y] = optics.cell_center(cell);
                let (left, up) = (x.saturating_sub(1), y.saturating_sub(1));
                let pixels = [(x, y), (left, y), (x, up), (left, up)];
                pixels
                    .into_iter()
                    .find_map(|(x, y)| depths.check(frame.depth_m[y * frame.width + x]))
                    .unwrap_or(0.0)
            })
            .collect();
        let (near_m, far_m) = extremes(&depth_m, optics.cells_across, optics.cells_down);
        Self {
            moving: vec![false; depth_m.len()],
            depth_m,
            near_m,
            far_m,
        }
    }

    /// Whether a point at this depth in this cell is hidden by something nearer.
    pub(crate) fn hides(&self, cell: usize, depth_m: f32) -> bool {
        let far = self.far_m[cell];
        far > 0.0 && depth_m > far + clear_of(far)
    }
}

fn extremes(depth_m: &[f32], across: usize, down: usize) -> (Vec<f32>, Vec<f32>) {
    let mut near = vec![0.0; depth_m.len()];
    let mut far = vec![0.0; depth_m.len()];
    for row in 1..down.saturating_sub(1) {
        for column in 1..across.saturating_sub(1) {
            let at = row * across + column;
            let (mut least, mut most, mut known) = (f32::INFINITY, 0.0f32, 0);
            for line in [at - across, at, at + across] {
                for &d in &depth_m[line - 1..=line + 1] {
                    if d > 0.0 {
                        least = least.min(d);
                        most = most.max(d);
                        known += 1;
                    }
                }
            }
            if known >= 5 {
                (near[at], far[at]) = (least, most);
            }
        }
    }
    (near, far)
}
