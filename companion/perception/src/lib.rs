//! What is in an image: people, animals and vehicles, found by small networks on the processor.
//!
//! ```text
//! image ─ fit into the network's input ─ network ─ decode ─ suppress doubles ─ back to the image ─ Detection
//!         (fit)                          (network) (yolox, fastest_det)   (suppress)
//! ```
//!
//! The weights are the user's: a detector is opened from an ONNX file, [`Yolox::open`] or [`FastestDet::open`], trained
//! on the 80 classes of COCO. Nothing that a network can put out, not even NaN, leaves as a detection: scores are within
//! 0 to 1 and boxes within the image.
//!
//! Deterministic: the same image and weights give the same detections on the same machine.
//!
//! ```
//! use maps::evidence::Mobility;
//! use perception::Class;
//!
//! let person = Class::named("person").ok_or("COCO knows people")?;
//! assert_eq!(person.mobility(), Mobility::Moving);
//! # Ok::<(), &str>(())
//! ```

mod class;
mod detection;
mod fastest_det;
mod fit;
mod image;
mod network;
mod suppress;
mod yolox;

pub use class::Class;
pub use detection::{Detection, Detector, MOST_DETECTIONS};
pub use fastest_det::FastestDet;
pub use image::{Image, WrongLength};
pub use network::{DetectError, OpenError};
pub use yolox::Yolox;
