//! The mathematics and data of Tandem: everything the programs agree on, and nothing that touches a file, a clock, a
//! socket or a log.
//!
//! - [`frame`]: points, vectors and transforms that carry their coordinate frames.
//! - [`time`]: [`time::Stamp`], a moment on one monotonic clock, always passed in.
//! - [`align`]: laying a scan or a local map on the global one.
//! - [`camera`]: the pinhole camera and the RGB-D image it takes.
//! - [`voxel`]: the voxel map, free and occupied; [`scan`]: adding what a sensor saw to it.
//! - [`tile`]: cubes of the map with a version, and their compressed form.
//! - [`traversability`]: where a ground vehicle can drive, on a grid.
//! - [`plan`]: paths for a car-like vehicle on that grid.
//! - [`trajectory`]: stamped poses, their files, and the errors of an estimate.

pub mod align;
pub mod camera;
pub mod frame;
pub mod plan;
pub mod scan;
pub mod tile;
pub mod time;
pub mod trajectory;
pub mod traversability;
pub mod voxel;
