//! What may be known of a frame beside its images: by an inertial unit, a detector, a satellite receiver. Nothing of it is
//! needed; what is there helps.

use maps::evidence;
use maps::time::Stamp;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::dynamics::NAMED;

/// What else is known of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Aid<'a> {
    /// How the camera has turned since the frame before: `last_camera_from_this_camera`, integrated from a gyroscope and
    /// turned into the camera's axes.
    pub turned: Option<UnitQuaternion<f64>>,
    /// What an accelerometer felt since the frame before.
    pub felt: Option<Felt>,
    /// What a detector has answered since the frame before; `None` where it has not.
    pub objects: Option<Seen<'a>>,
    /// Where the vehicle was, by a satellite receiver.
    pub position: Option<Fix>,
}

/// What an accelerometer feels at rest: standard gravity.
pub(crate) const GRAVITY_MPS2: f64 = 9.806_65;

/// What an accelerometer felt between two frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Felt {
    /// The mean specific force in m/s², at rest gravity upwards: in the axes that the camera had midway.
    pub specific_force: Vector3<f64>,
    /// Where the accelerometer is in the camera's axes, in metres.
    pub unit_in_camera: Vector3<f64>,
}

/// What a detector sees in one frame: this one, or one of the last [`Seen::KEPT`] that were tracked. What it says of that
/// one is carried to where it is seen now, and out of the keyframes made since. Answers come in the order of their frames; one
/// of a frame that is not kept, or older than one that was heard, changes nothing and is counted:
/// [`Slam::unheard`](crate::Slam::unheard). [`Moving::Paper`](crate::Moving::Paper) hears of this frame alone.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// When the frame was taken in which the detector has looked.
    pub of: Stamp,
    /// What is in it; empty where it has found nothing.
    pub objects: &'a [Object],
}

impl Seen<'_> {
    /// How many tracked frames late an answer may be, at most: so long is an object known again without one.
    pub const KEPT: usize = NAMED as usize;
}

/// Whether something can move, by what it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mobility {
    /// It stays where it is: a chair, a traffic light.
    Static,
    /// It may stand or move: a parked car, an unattended bicycle.
    Potential,
    /// It moves by itself: a person, an animal.
    Dynamic,
}

/// What is not classified is taken to stay.
impl From<evidence::Mobility> for Mobility {
    fn from(mobility: evidence::Mobility) -> Self {
        match mobility {
            evidence::Mobility::Unknown | evidence::Mobility::Static => Self::Static,
            evidence::Mobility::Movable => Self::Potential,
            evidence::Mobility::Moving => Self::Dynamic,
        }
    }
}

/// An object that a detector sees in a frame. One whose box is empty or not finite, or whose score is not a number, is
/// taken for none.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Whether it can move.
    pub mobility: Mobility,
    /// How sure the detector is, 0 to 1.
    pub score: f32,
    /// Left, top, right and bottom of its box in raw pixels.
    pub bounds_px: [f32; 4],
    /// Which pixels of the image are its own, where the detector says so; without it, the depth in the box decides.
    pub mask: Option<PixelMask>,
}

/// Which pixels belong to an object: one bit for each pixel of a rectangle of the image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PixelMask {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
    bits: Vec<u64>,
}

/// The rectangle of a mask is not as large as what is said of its pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a mask of {width} x {height} pixels cannot have {found}")]
pub struct MaskError {
    /// Width of the rectangle in pixels.
    pub width: usize,
    /// Height of the rectangle in pixels.
    pub height: usize,
    /// Pixels of which something is said.
    pub found: usize,
}

impl PixelMask {
    /// A mask over the rectangle whose upper left pixel is `[left, top]` and which has `[width, height]` pixels, given row
    /// by row. It may reach out of the image.
    pub fn new(
        [left, top]: [usize; 2],
        [width, height]: [usize; 2],
        inside: &[bool],
    ) -> Result<Self, MaskError> {
        if width.checked_mul(height) != Some(inside.len()) {
            return Err(MaskError {
                width,
                height,
                found: inside.len(),
            });
        }
        let mut bits = vec![0u64; inside.len().div_ceil(64)];
        for at in (0..inside.len()).filter(|&at| inside[at]) {
            bits[at / 64] |= 1 << (at % 64);
        }
        Ok(Self {
            left,
            top,
            width,
            height,
            bits,
        })
    }

    /// Whether a pixel of the image, column and row, is the object's; no pixel outside of the rectangle is.
    pub fn contains(&self, [x, y]: [usize; 2]) -> bool {
        let (Some(x), Some(y)) = (x.checked_sub(self.left), y.checked_sub(self.top)) else {
            return false;
        };
        if x >= self.width || y >= self.height {
            return false;
        }
        let at = y * self.width + x;
        self.bits[at / 64] >> (at % 64) & 1 == 1
    }
}

/// A position by a satellite receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// The moment that it is of; it may come later.
    pub at: Stamp,
    /// Of the antenna: east, north, up of any origin in metres, always the same one.
    pub position: Vector3<f64>,
    /// Of its error, m².
    pub covariance: Matrix3<f64>,
    /// Where the antenna is, in the camera's axes, in metres.
    pub antenna_in_camera: Vector3<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_knows_its_pixels_and_no_others() {
        // More than 64 pixels, of which the last one alone is inside.
        let mut inside = vec![false; 9 * 8];
        inside[71] = true;
        let mask = PixelMask::new([100, 50], [9, 8], &inside).expect("as many as needed");
        let all = (0..300).flat_map(|y| (0..300).map(move |x| [x, y]));
        let within: Vec<_> = all.filter(|&pixel| mask.contains(pixel)).collect();
        assert_eq!(within, [[108, 57]]);
    }

    #[test]
    fn a_mask_needs_one_bit_for_each_pixel() {
        for (width, height) in [(3, 3), (usize::MAX, 2), (0, 4)] {
            let refused = PixelMask::new([0, 0], [width, height], &[true; 8]);
            assert_eq!(
                refused,
                Err(MaskError {
                    width,
                    height,
                    found: 8
                })
            );
        }
    }
}
