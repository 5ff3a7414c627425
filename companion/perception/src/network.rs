//! A network from an ONNX file: one image in, one tensor of numbers out.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rten::{Dimension, Model, ModelOptions, NodeId, RunOptions, ThreadPool};
use rten_tensor::prelude::*;
use rten_tensor::{NdTensor, Tensor};

/// Inputs with longer sides are refused: no detector has them, and they would take memory without end.
const LONGEST_SIDE: usize = 4096;

/// Why weights cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The file cannot be read.
    #[error("cannot read the weights {}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is no ONNX network, or one with unknown operators.
    #[error("{} is no ONNX network that can be run: {reason}", path.display())]
    NotANetwork {
        /// The file.
        path: PathBuf,
        /// What the engine says.
        reason: String,
    },
    /// It is a network, but does not take one colour image of fixed size.
    #[error(
        "the network {} takes {found} and should take one image, 1 x 3 x height x width with both sides a multiple of {multiple} and at most 4096",
        path.display()
    )]
    Input {
        /// The file.
        path: PathBuf,
        /// What it takes.
        found: String,
        /// What its sides must be divisible by.
        multiple: usize,
    },
}

/// Why an image could not be looked at.
#[derive(Debug, thiserror::Error)]
pub enum DetectError {
    /// The engine gave up.
    #[error("the network failed: {0}")]
    Run(String),
    /// The weights are of another kind of detector.
    #[error(
        "the network put out {found:?} numbers and should put out {expected:?}: is it of another kind?"
    )]
    Output {
        /// Shape of what it put out.
        found: Vec<usize>,
        /// Shape that this kind of detector has for this size of input.
        expected: Vec<usize>,
    },
}

/// A network that takes one image.
pub(crate) struct Network {
    model: Model,
    input: NodeId,
    output: NodeId,
    /// Width and height of the image that it takes.
    pub(crate) size: [usize; 2],
    threads: Arc<ThreadPool>,
}

impl Network {
    /// Reads a network whose input has sides that are multiples of `multiple`, to be run on so many threads.
    pub(crate) fn open(path: &Path, multiple: usize, threads: usize) -> Result<Self, OpenError> {
        let bytes = std::fs::read(path).map_err(|source| OpenError::Unreadable {
            path: path.to_owned(),
            source,
        })?;
        let not_a_network = |reason: String| OpenError::NotANetwork {
            path: path.to_owned(),
            reason,
        };
        let model = ModelOptions::with_all_ops()
            .prepack_weights(true)
            .load(bytes)
            .map_err(|e| not_a_network(e.to_string()))?;
        let (&[input], &[output, ..]) = (model.input_ids(), model.output_ids()) else {
            return Err(not_a_network(
                "it has not one input and an output".to_owned(),
            ));
        };
        let shape = model.input_shape(0).unwrap_or_default();
        let size = image_size(&shape, multiple).ok_or_else(|| OpenError::Input {
            path: path.to_owned(),
            found: describe(&shape),
            multiple,
        })?;
        Ok(Self {
            model,
            input,
            output,
            size,
            threads: Arc::new(ThreadPool::with_num_threads(threads.max(1))),
        })
    }

    /// Runs the network on the values of an image, plane by plane; what comes out must have the expected shape.
    pub(crate) fn run(
        &self,
        planes: Vec<f32>,
        expected: &[usize],
    ) -> Result<Vec<f32>, DetectError> {
        let failed = |e: &dyn std::fmt::Display| DetectError::Run(e.to_string());
        let [width, height] = self.size;
        let input =
            NdTensor::try_from_data([1, 3, height, width], planes).map_err(|e| failed(&e))?;
        let mut options = RunOptions::default();
        options.thread_pool = Some(Arc::clone(&self.threads));
        let inputs = vec![(self.input, input.into())];
        let outputs = self.model.run(inputs, &[self.output], Some(options));
        let output = outputs.map_err(|e| failed(&e))?.pop();
        let output = output.ok_or_else(|| failed(&"it put out nothing"))?;
        let numbers: Tensor<f32> = output.try_into().map_err(|e| failed(&e))?;
        if numbers.shape() != expected {
            return Err(DetectError::Output {
                found: numbers.shape().to_vec(),
                expected: expected.to_vec(),
            });
        }
        Ok(numbers.into_data())
    }
}

/// Width and height of the image that an input of this shape takes.
fn image_size(shape: &[Dimension], multiple: usize) -> Option<[usize; 2]> {
    let [batch, channels, height, width] = shape else {
        return None;
    };
    let fixed = |d: &Dimension| match d {
        Dimension::Fixed(size) => Some(*size),
        Dimension::Symbolic(_) => None,
    };
    let side = |d: &Dimension| {
        fixed(d).filter(|s| (1..=LONGEST_SIDE).contains(s) && s.is_multiple_of(multiple))
    };
    // Some exports leave the number of images open; it is one.
    let one = fixed(batch).is_none_or(|count| count == 1);
    (one && fixed(channels) == Some(3)).then_some([side(width)?, side(height)?])
}

fn describe(shape: &[Dimension]) -> String {
    let size = |d: &Dimension| match d {
        Dimension::Fixed(size) => size.to_string(),
        Dimension::Symbolic(name) => name.clone(),
    };
    match shape.iter().map(size).collect::<Vec<_>>().join(" x ") {
        none if none.is_empty() => "a value without a shape".to_owned(),
        sizes => sizes,
    }
}
