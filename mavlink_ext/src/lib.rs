//! Tandem's MAVLink: the dialect, frames, links, services and the object transport.
//!
//! Wire units and frames (degrees times 10⁷, NED, FRD) exist only in here. Below [`link`] nothing touches a socket, a
//! file or a clock: services take `(now, message)` and return what to send.
//!
//! - [`dialect`]: the generated messages of `dialects/tandem.xml`, which includes `common.xml`.
//! - [`wire`]: addresses, raw frames, parsing and encoding.
//! - [`convert`]: wire units and frames to ours, and back.
//! - [`link`]: UDP links.
//! - [`presence`]: heartbeats, ours and others'.
//! - [`command`]: commands and their acknowledgements, both ends.
//! - [`intervals`]: how often messages are sent, both ends.
//! - [`metadata`]: files that describe a component.
//! - [`mission`]: the mission protocol, both ends.
//! - [`object`]: whole objects over lossy links, with a fountain code.
//! - [`params`]: parameters, both ends.
//! - [`router`]: which links a frame goes out on.
//! - [`telemetry`]: a companion about itself and its surroundings.
//! - [`timesync`]: how a peer's clock relates to ours.
//! - [`tlog`]: telemetry logs.
//! - [`service`]: the form that all services have.

pub mod command;
pub mod convert;
pub mod dialect;
pub mod ftp;
pub mod intervals;
pub mod link;
pub mod metadata;
pub mod mission;
pub mod object;
pub mod params;
pub mod presence;
pub mod repeat;
pub mod router;
pub mod service;
pub mod signing;
pub mod statustext;
pub mod telemetry;
pub mod timesync;
pub mod tlog;
pub mod wire;

#[cfg(test)]
mod simulated;

pub use dialect::Message;
pub use wire::{Address, ComponentId, Encoder, Parser, RawFrame, SystemId, WireError};
