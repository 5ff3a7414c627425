//! What comes out of the tracking of a frame.

use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::Matrix6;

/// Whether the SLAM knows where the camera is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// No frame yet had enough features with depth to start a map.
    Searching,
    /// The pose is known.
    Tracking,
    /// The place was lost; it is sought among the keyframes of all maps.
    Lost {
        /// The first frame without a pose.
        since: Stamp,
    },
}

/// The outcome of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracked {
    /// When the frame was taken.
    pub at: Stamp,
    /// Whether the pose is known.
    pub state: State,
    /// The camera's pose; unless tracking, the last one known.
    pub world_from_camera: Isometry<World, Camera>,
    /// Covariance of the pose's right perturbation, translation first (m², m·rad, rad²), relative to the first pose: of
    /// the fit, and of the map it was fitted to. 10⁶ on the diagonal: unknown, because the place is lost, or was and the map
    /// begun since is not yet joined to the old one.
    pub covariance: Matrix6<f64>,
    /// How often the pose has jumped so far, because it was found again, corrected, or a map begun or joined: no motion
    /// happened between the poses before and after.
    pub reset_counter: u32,
    /// Map points that support the pose.
    pub points: usize,
    /// Features that were left out because they are on something that moves now.
    pub rejected: usize,
    /// Share of the measured depth that is left out of the map: what moves, and what a detector says will, margin included.
    pub moving_share: f64,
    /// Whether the frame became a keyframe.
    pub keyframe: bool,
}

/// What the SLAM made of the last frame, for pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overlay {
    /// Pixels of the features that support the pose.
    pub tracked: Vec<[f32; 2]>,
    /// Pixels of the features on something that moves.
    pub rejected: Vec<[f32; 2]>,
    /// Pixels along the side of a cell of `moving`.
    pub cell_px: usize,
    /// Cells in a row of `moving`.
    pub cells_across: usize,
    /// Whether each cell is left out of the map, row by row: it shows something that moves, or that a detector says will.
    pub moving: Vec<bool>,
}

/// Why a frame could not be used. The SLAM stays as it was.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The frame is not of the camera's size.
    #[error(
        "the frame is {found_width} x {found_height} pixels, the camera takes {width} x {height}"
    )]
    Size {
        /// Width of the frame.
        found_width: usize,
        /// Height of the frame.
        found_height: usize,
        /// Width of the camera.
        width: usize,
        /// Height of the camera.
        height: usize,
    },
    /// An image has too few or too many pixels for the frame's size.
    #[error("the frame should have {expected} pixels, it has {rgb} in colour and {depth} of depth")]
    Length {
        /// Width times height.
        expected: usize,
        /// Pixels of the colour image.
        rgb: usize,
        /// Pixels of the depth image.
        depth: usize,
    },
    /// Features were sought in another frame.
    #[error("the features are of the frame of {look} s, the frame is of {at} s")]
    OtherLook {
        /// When the frame was taken.
        at: Stamp,
        /// When the frame was taken in which features were sought.
        look: Stamp,
    },
    /// The frame is not later than the one before.
    #[error("the frame of {at} s is not later than the one before, of {before} s")]
    Order {
        /// When the frame was taken.
        at: Stamp,
        /// When the one before was taken.
        before: Stamp,
    },
}
