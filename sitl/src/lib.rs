//! A simulated world: scene, cameras, vehicles and their autopilots.
//!
//! - [`scene`], [`render`], [`depth_camera`], [`flight`]: a room with people in it, seen by an RGB-D camera on a drone.

pub mod depth_camera;
pub mod flight;
pub mod noise;
pub mod render;
pub mod scene;
pub mod vehicle;
pub mod wgs84;
