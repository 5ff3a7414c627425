//! A simulated world: scene, cameras, vehicles and their autopilots.
//!
//! - [`scene`]: a room and five kinds of streets, generated from a seed; [`traffic`]: who moves in a street.
//! - [`render`], [`rays`]: what cameras and rays meet; [`camera_model`], [`depth_camera`], [`lidar`]: what sensors make of it.
//! - [`platform`], [`flight`], [`way`]: where the sensors are; [`truth`]: what is really there; [`palette`], [`poster`]: all of it to look at.
//! - [`rig`]: all sensors of both vehicles, message by message; [`record`]: the same in a file.
//! - [`dataset`]: training data of both vehicles, with truth.
//! - [`live`]: what sensors say, over Zenoh.
//! - [`vehicle`]: how a quadrotor and a small car move, and what their sensors say.
//! - [`sensor`]: what its other sensors make of the truth: inertial, satellite, radar and so on.
//! - [`autopilot`]: flies and drives them, and talks MAVLink like `ArduPilot`.
//! - [`bridge`]: the other end of a real `ArduPilot`, which flies and drives them instead.
//! - [`link`]: what a radio does to what is sent over it.
//! - [`simulation`], [`run`], [`report`]: all of it together.
//!
//! Of the maps it uses only frames, time and the camera: truth shares no code with estimates.

pub mod autopilot;
pub mod bridge;
pub mod camera_model;
pub mod dataset;
pub mod depth_camera;
pub mod flight;
mod lanes;
pub mod lidar;
pub mod link;
pub mod live;
pub mod noise;
pub mod palette;
pub mod platform;
pub mod poster;
pub mod rays;
pub mod record;
pub mod render;
pub mod report;
pub mod rig;
pub mod run;
pub mod scene;
pub mod sensor;
pub mod simulation;
pub mod traffic;
pub mod truth;
pub mod vehicle;
pub mod way;
pub mod wgs84;
