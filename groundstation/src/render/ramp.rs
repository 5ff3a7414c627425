//! The colour ramp of the maps, for heights and for how sure a voxel is.

pub use maps::palette::ramp;
