//! Messages that a companion computer sends about itself and about what its map shows.
//!
//! Pure conversions from plain values, with the protocol's special values for what is not known.
//! <https://mavlink.io/en/messages/common.html>

mod computer;
mod obstacles;

pub use computer::{Computer, ComputerLink, Role, Storage, StorageKind, Usage};
pub use obstacles::{SECTORS, Sight, Surroundings};
