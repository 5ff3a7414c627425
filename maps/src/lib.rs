//! The mathematics and data of Tandem: everything the programs agree on, and nothing that touches a file, a clock, a
//! socket or a log.
//!
//! - [`frame`]: points, vectors and transforms that carry their coordinate frames.
//! - [`time`]: [`time::Stamp`], a moment on one monotonic clock, always passed in.
//! - [`camera`]: the pinhole camera and the RGB-D image it takes.

pub mod camera;
pub mod frame;
pub mod time;
