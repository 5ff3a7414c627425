//! A simulated world: scene, cameras, vehicles and their autopilots.
//!
//!   on a drone, with exact truth.
//! - [`vehicle`]: how a quadrotor and a small car move, and what their sensors say.
//! - [`autopilot`]: flies and drives them, and talks MAVLink like `ArduPilot`.
//!
//! Of the maps it uses only frames, time and the camera: truth shares no code with estimates.

pub mod autopilot;
pub mod depth_camera;
pub mod flight;
pub mod noise;
pub mod render;
pub mod scene;
pub mod vehicle;
pub mod wgs84;
