//! YOLOX: boxes without anchors on three grids.
//!
//! For each cell (column `c`, row `r`) of the grids of stride 8, 16 and 32 the network puts out 85 numbers:
//!
//! ```text
//! centre = (c + tx, r + ty)·stride    size = exp(tw, th)·stride    score = objectness · class
//! ```
//!
//! - Z. Ge et al., *YOLOX: Exceeding YOLO Series in 2021*, arXiv 2107.08430, section 2.1.

use std::path::Path;

use crate::class::Class;
use crate::detection::{Detection, Detector};
use crate::fit::Fit;
use crate::image::Image;
use crate::network::{DetectError, Network, OpenError};
use crate::suppress::suppress;

const STRIDES: [usize; 3] = [8, 16, 32];
/// Box, objectness and the classes.
const NUMBERS: usize = 5 + Class::COUNT;
/// What YOLOX is trained to see where there is no image.
const PADDING: f32 = 114.0;

/// A YOLOX network, of any size, as its authors' exporter writes it without decoding.
pub struct Yolox {
    network: Network,
    least_score: f32,
}

impl Yolox {
    /// Reads the weights from an ONNX file. Objects with a score below `least_score` (0 to 1) are not reported; the
    /// network runs on `threads` threads.
    pub fn open(path: &Path, least_score: f32, threads: usize) -> Result<Self, OpenError> {
        Ok(Self {
            network: Network::open(path, STRIDES[2], threads)?,
            least_score,
        })
    }
}

impl Detector for Yolox {
    fn detect(&self, image: &Image<'_>) -> Result<Vec<Detection>, DetectError> {
        let size = self.network.size;
        let fit = Fit::letterbox(image, size);
        let cells: usize = STRIDES.iter().map(|s| size[0] / s * (size[1] / s)).sum();
        let planes = fit.planes(image, 1.0, PADDING);
        let numbers = self.network.run(planes, &[1, cells, NUMBERS])?;
        let found = decode(&numbers, size, self.least_score);
        Ok(suppress(found.filter_map(|d| fit.back(d)).collect()))
    }
}

/// The detections of every cell, in pixels of the input; they may be nonsense where the network is.
fn decode(
    numbers: &[f32],
    [width, height]: [usize; 2],
    least_score: f32,
) -> impl Iterator<Item = Detection> {
    let cells = STRIDES.into_iter().flat_map(move |stride| {
        let across = width / stride;
        (0..across * (height / stride)).map(move |i| (stride, i % across, i / across))
    });
    let rows = numbers.chunks_exact(NUMBERS);
    cells.zip(rows).filter_map(move |(cell, row)| {
        let [tx, ty, tw, th, objectness, ref classes @ ..] = *row else {
            return None;
        };
        let (index, best) = surest(classes)?;
        let score = probability(objectness)? * best;
        if score < least_score {
            return None;
        }
        let (stride, column, row) = cell;
        let stride = stride as f32;
        let center = [(column as f32 + tx) * stride, (row as f32 + ty) * stride];
        let half = [tw.exp() * stride / 2.0, th.exp() * stride / 2.0];
        Some(Detection {
            class: Class::from_index(index)?,
            score,
            bounds_px: [
                center[0] - half[0],
                center[1] - half[1],
                center[0] + half[0],
                center[1] + half[1],
            ],
        })
    })
}

/// A network's probability; none if it is anything else.
pub(crate) fn probability(value: f32) -> Option<f32> {
    /// What rounding in a softmax may add.
    const ROUNDING: f32 = 1e-3;
    (0.0..=1.0 + ROUNDING)
        .contains(&value)
        .then_some(value.min(1.0))
}

/// The surest class and its score; none if one of the scores is no probability.
pub(crate) fn surest(classes: &[f32]) -> Option<(usize, f32)> {
    let mut best: Option<(usize, f32)> = None;
    for (index, &score) in classes.iter().enumerate() {
        let score = probability(score)?;
        if best.is_none_or(|(_, most)| score > most) {
            best = Some((index, score));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The output for a 32 x 32 input: 16 + 4 + 1 cells, of which one sees a car.
    fn one_car(cell: usize, numbers: [f32; 5]) -> Vec<f32> {
        let mut output = vec![0.0; 21 * NUMBERS];
        output[cell * NUMBERS..cell * NUMBERS + 5].copy_from_slice(&numbers);
        output[cell * NUMBERS + 5 + 2] = 0.5;
        output
    }

    #[test]
    fn a_box_is_decoded_from_its_cell_and_stride() {
        // Cell 18 is in the second row, first column of the grid of stride 16.
        let output = one_car(18, [0.5, 0.25, 0.0, 2f32.ln(), 0.8]);
        let found: Vec<_> = decode(&output, [32, 32], 0.3).collect();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].class.name(), "car");
        assert!((found[0].score - 0.4).abs() < 1e-6);
        let expected = [0.0, 4.0, 16.0, 36.0];
        for (a, b) in found[0].bounds_px.iter().zip(expected) {
            assert!((a - b).abs() < 1e-4, "{:?}", found[0].bounds_px);
        }
    }

    #[test]
    fn what_is_not_sure_enough_or_no_probability_is_no_detection() {
        for objectness in [0.5, 2.0, f32::NAN] {
            let output = one_car(18, [0.0, 0.0, 0.0, 0.0, objectness]);
            assert_eq!(decode(&output, [32, 32], 0.3).count(), 0);
        }
        let mut output = one_car(18, [0.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(decode(&output, [32, 32], 0.3).count(), 1);
        output[18 * NUMBERS + 40] = f32::NAN;
        assert_eq!(decode(&output, [32, 32], 0.3).count(), 0);
    }
}
