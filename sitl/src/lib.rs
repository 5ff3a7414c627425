//! A simulated world: scene, cameras, vehicles and their autopilots.
//!
//! - [`scene`], [`render`], [`depth_camera`], [`flight`], [`record`]: a room with people in it, seen by an RGB-D camera
//!   on a drone, with exact truth.
//! - [`vehicle`]: how a quadrotor and a small car move, and what their sensors say.
//! - [`autopilot`]: flies and drives them, and talks MAVLink like `ArduPilot`.
//! - [`traffic`]: vehicles and people who move in a street.
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
pub mod simulation;
pub mod traffic;
pub mod vehicle;
pub mod wgs84;
