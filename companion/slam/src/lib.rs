//! RGB-D SLAM among moving people and vehicles, and dense mapping.
//!
//! [`Slam::track`] takes one frame after the other and says where the camera is. Inside:
//!
//! ```text
//! frame ─ features ─ find the map's points ─ fit the pose ─ reject what moves ─ fit again ─┬─ Tracked
//!         (fast, brief)    (matching)         (solver)       (dynamics)                    └─ keyframe? ─ new points,
//!                               └ none found: relocalise                                      local bundle adjustment,
//!                                 (places), or a new map                                      known place? close the loop
//!                                                                                             (places, loops, pose_graph)
//! ```
//!
//! The map is a set of keyframes and the points they see. Keyframes leave a sliding window of bundle adjustment and come
//! out as [`DenseKeyframe`]s for the voxel map, without what moved. Later their poses change only where a loop is closed, a
//! map joined, or gravity or satellites contradict the way; [`DenseUpdate::anew`] then says that the voxel map must be made anew.
//!
//! Where the place is lost for longer than [`Settings::sought_for`], a new map begins. Until a known place joins it to the
//! old one, the covariance of its poses says that they are a guess, and its keyframes and path are held back.
//!
//! The world has z up and the floor at z = 0, fitted in the frame that starts the map, the first with enough features
//! that have depth; its origin is below the camera of that frame. With an accelerometer ([`Aid::felt`]) it is turned about that place
//! until z is up.
//!
//! Deterministic: the same frames give the same result, bit for bit, with [`Settings::threaded`] or without. Memory is bounded by
//! [`Settings::max_keyframes`] and [`Settings::max_points`], apart from the trajectory (120 bytes a frame).
//!
//! ```
//! use maps::camera::{Pinhole, RgbdFrame};
//! use maps::time::Stamp;
//! use slam::{Settings, Slam, State};
//!
//! let camera = Pinhole { width: 64, height: 48, fx: 50.0, fy: 50.0, cx: 31.5, cy: 23.5, distortion: [0.0; 5] };
//! let mut slam = Slam::new(camera, Settings::default());
//! let black = RgbdFrame {
//!     at: Stamp::ZERO,
//!     width: 64,
//!     height: 48,
//!     rgb: vec![[0; 3]; 64 * 48],
//!     depth_m: vec![0.0; 64 * 48],
//! };
//! let tracked = slam.track(&black)?;
//! assert_eq!(tracked.state, State::Searching, "nothing to see yet");
//! # Ok::<(), slam::FrameError>(())
//! ```

mod ahead;
mod aid;
mod blocks;
mod brief;
mod bundle;
mod coarse;
mod dense;
mod drift;
mod dynamics;
mod fast;
mod features;
mod front_end;
mod georeference;
mod level;
mod loops;
mod map;
mod mapping;
mod matching;
mod motion;
mod optics;
mod places;
mod pose_graph;
mod pyramid;
mod relocalise;
mod revisit;
mod settings;
mod slam;
mod solver;
mod spread;
mod stage;
mod tracked;
mod tracking;
mod triangulate;
mod worker;

pub use ahead::{Ahead, Looked};
pub use aid::{Aid, Felt, Fix, MaskError, Mobility, Object, PixelMask, Seen};
pub use dense::{DenseKeyframe, DenseUpdate};
pub use front_end::{FrontEnd, Look};
pub use level::Floor;
pub use settings::{Mapping, Moving, Settings};
pub use slam::Slam;
pub use stage::Stage;
pub use tracked::{FrameError, Overlay, State, Tracked};
pub use worker::Worker;
