//! The on-board service: sensors to SLAM to a map on the wire.
//!
//! ```text
//! source ─► sensor-decode ─► slam ─► tile-encode ─┐
//! autopilot link ─────────────────────────────────┼─► events ─► step ─► actions ─► links, report
//! ground link ────────────────────────────────────┘
//! ```
//!
//! - [`config`]: the configuration file and what it means.
//! - [`pipeline`]: from camera frames to encoded map tiles, on threads of its own.
//! - [`event`], [`step`]: all that can happen, and the one pure function that decides what to do about it.
//! - [`net`], [`runtime`], [`output`], [`clock`]: all that touches the world.
//! - [`replay`], [`doctor`], [`map`]: the other commands.

pub mod clock;
pub mod config;
pub mod doctor;
pub mod event;
pub mod figures;
pub mod histogram;
pub mod map;
pub mod net;
pub mod odometry;
pub mod origin;
pub mod output;
pub mod pipeline;
pub mod replay;
pub mod report;
pub mod runtime;
pub mod step;
