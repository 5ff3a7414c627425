//! `FastestDet`: one grid, one box a cell, for processors of phones.
//!
//! For each cell (column `c`, row `r`) of the only grid (stride 16) the network puts out 85 planes:
//!
//! ```text
//! centre = (c + tanh tx, r + tanh ty)/grid    size = σ(tw, th)    score = objectness^0.6 · class^0.4
//! ```
//!
//! in parts of the image, which is stretched over the input.
//!
//! - X. Ma, *`FastestDet`*, <https://github.com/dog-qiuqiu/FastestDet>, 2022: its `README` and post-processing.

use std::path::Path;

use crate::class::Class;
use crate::detection::{Detection, Detector};
use crate::fit::Fit;
use crate::image::Image;
use crate::network::{DetectError, Network, OpenError};
use crate::suppress::suppress;
use crate::yolox::{probability, surest};

const STRIDE: usize = 16;
/// Objectness, box and the classes.
const NUMBERS: usize = 5 + Class::COUNT;

/// A `FastestDet` network as its authors' exporter writes it.
pub struct FastestDet {
    network: Network,
    least_score: f32,
}

impl FastestDet {
    /// Reads the weights from an ONNX file. Objects with a score below `least_score` (0 to 1) are not reported; the
    /// network runs on `threads` threads.
    pub fn open(path: &Path, least_score: f32, threads: usize) -> Result<Self, OpenError> {
        Ok(Self {
            network: Network::open(path, STRIDE, threads)?,
            least_score,
        })
    }
}

impl Detector for FastestDet {
    fn detect(&self, image: &Image<'_>) -> Result<Vec<Detection>, DetectError> {
        let size = self.network.size;
        let fit = Fit::stretch(image, size);
        let grid = size.map(|side| side / STRIDE);
        let planes = fit.planes(image, 1.0 / 255.0, 0.0);
        let numbers = self.network.run(planes, &[1, NUMBERS, grid[1], grid[0]])?;
        let found = decode(&numbers, grid, self.least_score);
        Ok(suppress(found.filter_map(|d| fit.back(d)).collect()))
    }
}

/// The detections of every cell, in pixels of the input; they may be nonsense where the network is.
fn decode(
    numbers: &[f32],
    [across, down]: [usize; 2],
    least_score: f32,
) -> impl Iterator<Item = Detection> {
    let cells = across * down;
    (0..cells).filter_map(move |cell| {
        let number = |plane: usize| numbers.get(plane * cells + cell).copied();
        let mut classes = [0.0; Class::COUNT];
        for (index, score) in classes.iter_mut().enumerate() {
            *score = number(5 + index)?;
        }
        let (index, best) = surest(&classes)?;
        let score = probability(number(0)?)?.powf(0.6) * best.powf(0.4);
        if score < least_score {
            return None;
        }
        let logistic = |v: f32| 1.0 / (1.0 + (-v).exp());
        let place = [(cell % across) as f32, (cell / across) as f32];
        let extent = [across, down].map(|count| (count * STRIDE) as f32);
        let mut bounds_px = [0.0; 4];
        for axis in 0..2 {
            let center = (place[axis] + number(1 + axis)?.tanh()) * STRIDE as f32;
            let half = logistic(number(3 + axis)?) * extent[axis] / 2.0;
            bounds_px[axis] = center - half;
            bounds_px[axis + 2] = center + half;
        }
        Some(Detection {
            class: Class::from_index(index)?,
            score,
            bounds_px,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The output for a 48 x 32 input, 3 x 2 cells, of which one sees a dog.
    fn one_dog(cell: usize, numbers: [f32; 5]) -> Vec<f32> {
        let mut output = vec![0.0; 6 * NUMBERS];
        for (plane, number) in numbers.into_iter().enumerate() {
            output[plane * 6 + cell] = number;
        }
        output[(5 + 16) * 6 + cell] = 0.9;
        output
    }

    #[test]
    fn a_box_is_decoded_from_its_cell() {
        // Cell 4 is in the second row, second column.
        let output = one_dog(4, [0.8, 0.0, 0.5f32.atanh(), 0.0, 0.0]);
        let found: Vec<_> = decode(&output, [3, 2], 0.5).collect();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].class.name(), "dog");
        let score = 0.8f32.powf(0.6) * 0.9f32.powf(0.4);
        assert!((found[0].score - score).abs() < 1e-6);
        // The centre is (16, 24), and the box half as wide and high as the input.
        let expected = [4.0, 16.0, 28.0, 32.0];
        for (a, b) in found[0].bounds_px.iter().zip(expected) {
            assert!((a - b).abs() < 1e-4, "{:?}", found[0].bounds_px);
        }
    }

    #[test]
    fn what_is_not_sure_enough_or_no_probability_is_no_detection() {
        for objectness in [0.1, -1.0, f32::NAN] {
            let output = one_dog(4, [objectness, 0.0, 0.0, 0.0, 0.0]);
            assert_eq!(decode(&output, [3, 2], 0.5).count(), 0);
        }
    }
}
