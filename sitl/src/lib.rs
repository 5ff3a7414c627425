//! A simulated world: scene, cameras, vehicles and their autopilots.
//!
//! - [`scene`]: a room and five kinds of streets, generated from a seed; [`traffic`]: who moves in a street.
//! - [`render`], [`rays`]: what cameras and rays meet; [`camera_model`], [`depth_camera`], [`lidar`]: what sensors make of it.
//! - [`platform`], [`flight`]: where the sensors are; [`truth`]: what is really there; [`poster`]: all of it to look at.
//! - [`record`]: the drone's camera in a file, with exact truth.
//! - [`vehicle`]: how a quadrotor and a small car move, and what their sensors say.
//! - [`sensor`]: what its other sensors make of the truth: inertial, satellite, radar and so on.
//! - [`autopilot`]: flies and drives them, and talks MAVLink like `ArduPilot`.
//! - [`link`]: what a radio does to what is sent over it.
//! - [`simulation`], [`run`], [`report`]: all of it together.
//!
//! Of the maps it uses only frames, time and the camera: truth shares no code with estimates.

pub mod autopilot;
pub mod camera_model;
pub mod depth_camera;
pub mod flight;
mod lanes;
pub mod lidar;
pub mod link;
pub mod noise;
pub mod platform;
pub mod poster;
pub mod rays;
pub mod record;
pub mod render;
pub mod report;
pub mod run;
pub mod scene;
pub mod sensor;
pub mod simulation;
pub mod traffic;
pub mod truth;
pub mod vehicle;
pub mod wgs84;
