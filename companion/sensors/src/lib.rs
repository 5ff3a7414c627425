//! Sensor messages and where they come from: TUM folders, MCAP files and live ROS 2 nodes.
//!
//! Everything that sees colour and depth is an [`RgbdSource`]; what comes after cannot tell a recording from another.
//!
//! - [`tum`]: a folder in the layout of the TUM and Bonn RGB-D data sets.
//! - [`mcap`]: a file of ROS 2 messages, read and written.
//! - [`zenoh`]: the same messages live, from and to nodes with `rmw_zenoh`.
//! - [`beside`]: what other sensors say beside a frame.
//! - [`prefetch`]: any source, decoded ahead on a thread of its own.
//! - [`message`], [`ros`], [`cdr`]: the messages and their encoding.

use std::path::Path;

use maps::camera::{Pinhole, RgbdFrame};
use maps::time::Stamp;
use nalgebra::Isometry3;

use crate::beside::Beside;
use crate::live::Live;
use crate::ros::CameraInfo;

pub mod beside;
pub mod cdr;
mod error;
mod image;
pub mod live;
pub mod mcap;
pub mod message;
mod pairing;
pub mod prefetch;
pub mod ros;
pub mod tum;
pub mod zenoh;

pub use error::{Silence, SourceError};

/// A pose by which an estimate can be judged: of the tracked body (a marker, or the camera itself) in a frame of the
/// recording's own. Only its shape in time is known, so that it is compared after alignment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthPose {
    /// When the body was there.
    pub at: Stamp,
    /// The body in the recording's frame.
    pub pose: Isometry3<f64>,
}

/// Where colour and depth images come from, in order of time.
pub trait RgbdSource: Send {
    /// The recording's name, for reports: its folder or file without ending.
    fn name(&self) -> &str;

    /// The camera that took every frame.
    fn camera(&self) -> Pinhole;

    /// How many frames there are in all, from the first; `None` where that is not known.
    fn frame_count(&self) -> Option<usize>;

    /// The true poses, in order of time; none where they are not known.
    fn truth(&self) -> &[TruthPose];

    /// The next frame; `None` after the last one. After an error there are no more frames.
    fn next_frame(&mut self) -> Result<Option<RgbdFrame>, SourceError>;

    /// What other sensors measured up to the frame that was given last.
    fn beside(&self) -> Beside {
        Beside::default()
    }

    /// A handle by which others end the wait for a frame; `None` where frames need not be waited for.
    fn live(&self) -> Option<Live> {
        None
    }
}

/// A recording's name: the last part of its path, a file's without ending.
fn stem(path: &Path) -> String {
    // `folder/.` and `..` have no name of their own.
    let whole = path
        .canonicalize()
        .unwrap_or_else(|_unreadable| path.to_owned());
    let part = if whole.is_dir() {
        whole.file_name()
    } else {
        whole.file_stem()
    };
    let name = part.unwrap_or(whole.as_os_str());
    name.to_string_lossy().into_owned()
}

/// Refuses a camera through which nothing could be seen.
fn check_camera(path: &Path, camera: &Pinhole) -> Result<(), SourceError> {
    let Pinhole {
        width,
        height,
        fx,
        fy,
        cx,
        cy,
        distortion,
    } = *camera;
    let finite = [fx, fy, cx, cy]
        .iter()
        .chain(&distortion)
        .all(|n| n.is_finite());
    let reason = if width == 0 || height == 0 || width.max(height) > image::LARGEST_SIDE {
        format!("its image is {width} x {height} pixels")
    } else if !finite || fx <= 0.0 || fy <= 0.0 {
        format!("its focal length is {fx} x {fy} pixels and its centre {cx}, {cy}")
    } else {
        return Ok(());
    };
    Err(SourceError::Camera {
        path: path.to_owned(),
        reason,
    })
}

/// The camera that a message describes, if everything there is to say of it is understood.
fn checked_camera(path: &Path, info: &CameraInfo<'_>) -> Result<Pinhole, SourceError> {
    check_camera(path, &info.camera)?;
    if info.is_understood() {
        return Ok(info.camera);
    }
    Err(SourceError::Camera {
        path: path.to_owned(),
        reason: format!(
            "its lens model is `{}` with {:?}: rectify the recording, or use a camera with `plumb_bob`",
            info.model, info.coefficients
        ),
    })
}
