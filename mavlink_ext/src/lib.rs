//! Tandem's MAVLink: the dialect, frames, links, services and the object transport.
//!
//! Wire units and frames (degrees times 10⁷, NED, FRD) exist only in here. Below [`link`] nothing touches a socket, a
//! file or a clock: services take `(now, message)` and return what to send.
//!
//! - [`dialect`]: the generated messages of `dialects/tandem.xml`, which includes `common.xml`.
//! - [`wire`]: addresses, raw frames, parsing and encoding.
//! - [`link`]: UDP links.

pub mod dialect;
pub mod link;
pub mod wire;

pub use dialect::Message;
pub use wire::{Address, ComponentId, Encoder, Parser, RawFrame, SystemId, WireError};
