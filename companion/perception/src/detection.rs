//! What a detector finds.

use crate::class::Class;
use crate::image::Image;
use crate::network::DetectError;

/// The most objects that a detector reports of an image.
pub const MOST_DETECTIONS: usize = 100;

/// An object in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// What it is.
    pub class: Class,
    /// How sure the detector is, 0 to 1.
    pub score: f32,
    /// Left, top, right and bottom in pixels, within the image; (0, 0) is the upper left corner of the image.
    pub bounds_px: [f32; 4],
}

/// Something that finds objects in images.
pub trait Detector {
    /// The objects in an image, surest first, at most [`MOST_DETECTIONS`].
    fn detect(&self, image: &Image<'_>) -> Result<Vec<Detection>, DetectError>;
}
