//! The mathematics and data of Tandem: everything the programs agree on, and nothing that touches a file, a clock, a
//! socket or a log.
//!
//! - [`frame`]: points, vectors and transforms that carry their coordinate frames.
//! - [`time`]: [`time::Stamp`], a moment on one monotonic clock, always passed in.
//! - [`align`]: laying a scan or a local map on the global one.
//! - [`camera`]: the pinhole camera and the RGB-D image it takes.
//! - [`voxel`]: the voxel map, free and occupied; [`scan`]: adding what a sensor saw to it.
//! - [`palette`]: the colours of classes, and from low to high; [`picture`]: a map drawn from above and from aside.
//! - [`evidence`]: what several sources say of a voxel, and the rules that make one map of it; [`bev`]: bird's-eye views
//!   as such evidence.
//! - [`metrics`]: how far a map is from the truth.
//! - [`tile`]: cubes of the map with a version, and their compressed form.
//! - [`traversability`]: where a ground vehicle can drive, on a grid.
//! - [`plan`]: paths for a car-like vehicle on that grid.
//! - [`trajectory`]: stamped poses, their files, and the errors of an estimate.

pub mod align;
pub mod bev;
pub mod camera;
pub mod evidence;
pub mod frame;
pub mod metrics;
pub mod palette;
pub mod picture;
pub mod plan;
pub mod scan;
pub mod tile;
pub mod time;
pub mod trajectory;
pub mod traversability;
pub mod voxel;
