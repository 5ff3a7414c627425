//! The depth image on a coarse grid, with what is known to move in it.

use std::borrow::Cow;

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
    /// What a detector adds to that; none where none looks.
    pub(crate) named: Option<Box<Named>>,
    /// By how many cells the depth may be displaced against the colour, because the camera turned meanwhile.
    pub(crate) slip: usize,
}

/// What a detector knows of cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct Named {
    /// Whether the cell shows somebody, margin included, who may hold still now and serve tracking as well as any
    /// furniture, and is to be left out of the map all the same.
    pub(crate) unmapped: Vec<bool>,
    /// What would be known to move without the detector: of what is known by name alone, witnesses may say that it stands.
    pub(crate) evident: Vec<bool>,
}

/// The colour and the depth of a frame are each exposed row by row, and paired where they are not taken at once: what is
/// in one may be that much older than what is beside it in the other. At 30 frames a second, one frame.
const SPREAD_S: f64 = 1.0 / 30.0;
/// More cannot be said of a frame than that it is of little use.
const MOST_SLIP: usize = 8;

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
            named: None,
            slip: 0,
            depth_m,
            near_m,
            far_m,
        }
    }

    /// Notes that the camera turned at so many radians a second when the frame was taken.
    pub(crate) fn turned(&mut self, optics: &Optics, rate: f64) {
        let pixels = rate * SPREAD_S * optics.camera.fx;
        self.slip = ((pixels / optics.stride as f64).round() as usize).min(MOST_SLIP);
    }

    /// `near_m` over `reach` more cells on each side; unknown where it is.
    pub(crate) fn near_within(&self, across: usize, reach: usize) -> Cow<'_, [f32]> {
        if reach == 0 {
            return Cow::Borrowed(&self.near_m);
        }
        let known = |&d: &f32| if d > 0.0 { d } else { f32::INFINITY };
        let mut least: Vec<f32> = self.near_m.iter().map(known).collect();
        let mut spare = vec![0.0; least.len()];
        for row in least.chunks_exact_mut(across) {
            slide_minimum(row, (1, reach), &mut spare);
        }
        slide_minimum(&mut least, (across, reach), &mut spare);
        let unknown = self
            .near_m
            .iter()
            .zip(&mut least)
            .filter(|(d, _)| **d <= 0.0);
        unknown.for_each(|(_, least)| *least = 0.0);
        Cow::Owned(least)
    }

    /// Whether the cell is to be left out of the map.
    pub(crate) fn is_unmapped(&self, cell: usize) -> bool {
        self.moving[cell] || self.named.as_ref().is_some_and(|n| n.unmapped[cell])
    }

    /// Whether there is evidence, apart from its name, that what the cell shows moves.
    pub(crate) fn moves_evidently(&self, cell: usize) -> bool {
        let named = self.named.as_ref();
        named.map_or(self.moving[cell], |named| named.evident[cell])
    }

    /// Whether a point at this depth in this cell is hidden by something nearer.
    pub(crate) fn hides(&self, cell: usize, depth_m: f32) -> bool {
        let far = self.far_m[cell];
        far > 0.0 && depth_m > far + clear_of(far)
    }
}

/// Replaces each value by the least of those up to `reach` times `step` before and after it, in windows that double. `spare`
/// is room for as many values: loops over two slices vectorise.
fn slide_minimum(values: &mut [f32], (step, reach): (usize, usize), spare: &mut [f32]) {
    let mut widest = 0;
    while widest < reach {
        // Windows of `widest` become windows of `widest + more`: first to the right, then to the left.
        let more = (widest + 1).min(reach - widest);
        let Some(kept) = values.len().checked_sub(more * step) else {
            break;
        };
        let spare = &mut spare[..kept];
        spare.copy_from_slice(&values[more * step..]);
        lessen(&mut values[..kept], spare);
        widest += more;
    }
    let mut widest = 0;
    while widest < reach {
        let more = (widest + 1).min(reach - widest);
        let Some(kept) = values.len().checked_sub(more * step) else {
            break;
        };
        let spare = &mut spare[..kept];
        spare.copy_from_slice(&values[..kept]);
        lessen(&mut values[more * step..], spare);
        widest += more;
    }
}

fn lessen(values: &mut [f32], others: &[f32]) {
    for (value, &other) in values.iter_mut().zip(others) {
        // Not `f32::min`, which takes three times as long for the sake of NaN.
        *value = if other < *value { other } else { *value };
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_sliding_minimum_is_the_least_of_its_window(
            values in prop::collection::vec(0.0f32..9.0, 1..40),
            reach in 0usize..9,
        ) {
            let mut slid = values.clone();
            slide_minimum(&mut slid, (1, reach), &mut vec![0.0; values.len()]);
            for (i, least) in slid.iter().enumerate() {
                let window = &values[i.saturating_sub(reach)..values.len().min(i + reach + 1)];
                let expected = window.iter().copied().fold(f32::INFINITY, f32::min);
                prop_assert!((least - expected).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn near_surfaces_reach_as_far_as_the_image_may_be_displaced() {
        let mut near_m = vec![3.0; 11 * 9];
        near_m[4 * 11 + 5] = 1.0;
        near_m[4 * 11 + 6] = 0.0;
        let coarse = Coarse {
            near_m,
            ..Coarse::default()
        };
        let wide = coarse.near_within(11, 2);
        for (cell, &near) in wide.iter().enumerate() {
            let (column, row) = (cell % 11, cell / 11);
            let expected = match (column.abs_diff(5), row.abs_diff(4)) {
                _ if (column, row) == (6, 4) => 0.0,
                (0..=2, 0..=2) => 1.0,
                _ => 3.0,
            };
            assert!((near - expected).abs() < 1e-6, "{column} {row}: {near}");
        }
        assert_eq!(coarse.near_within(11, 0), coarse.near_m);
    }
}
