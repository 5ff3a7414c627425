//! A simulated world: scene, cameras, vehicles and their autopilots.
//!
//! - [`scene`], [`render`], [`depth_camera`], [`flight`], [`record`]: a room with people in it, seen by an RGB-D camera
//!   on a drone, with exact truth.
//! - [`vehicle`]: how a quadrotor and a small car move, and what their sensors say.
//! - [`sensor`]: what its other sensors make of the truth: inertial, satellite, radar and so on.
//! - [`autopilot`]: flies and drives them, and talks MAVLink like `ArduPilot`.
//! - [`link`]: what a radio does to what is sent over it.
//! - [`simulation`], [`run`], [`report`]: all of it together.
//!
//! Of the maps it uses only frames, time and the camera: truth shares no code with estimates.

pub mod autopilot;
pub mod depth_camera;
pub mod flight;
pub mod link;
pub mod noise;
pub mod record;
pub mod render;
pub mod report;
pub mod run;
pub mod scene;
pub mod sensor;
pub mod simulation;
pub mod vehicle;
pub mod wgs84;
