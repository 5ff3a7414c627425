//! What is really there: boxes, what can be seen of them, the street from above, and the voxels of all that stands still.
//!
//! It comes from the faces themselves and shares no code with what estimates it.

mod bev;
mod boxes;
mod voxels;

pub use bev::{Bev, bev};
pub use boxes::{Sight, boxes, sight};
pub use voxels::{Voxels, voxels};

#[cfg(test)]
mod tests;
