//! What may be known of a frame beside its images: by a gyroscope, a detector, a satellite receiver. Nothing of it is
//! needed; what is there helps.

use maps::time::Stamp;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// What else is known of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Aid<'a> {
    /// How the camera has turned since the frame before: `last_camera_from_this_camera`, integrated from a gyroscope and
    /// turned into the camera's axes.
    pub turned: Option<UnitQuaternion<f64>>,
    /// What a detector sees in this frame; `None` where no detector has looked, an empty list where it has found nothing.
    pub objects: Option<&'a [Object]>,
    /// Where the camera was, by a satellite receiver.
    pub position: Option<Fix>,
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

/// An object that a detector sees in a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Whether it can move.
    pub mobility: Mobility,
    /// How sure the detector is, 0 to 1.
    pub score: f32,
    /// Left, top, right and bottom of its box in raw pixels.
    pub bounds_px: [f32; 4],
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
