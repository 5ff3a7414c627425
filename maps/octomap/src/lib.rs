//! `OctoMap` files, written and read.
//!
//! An `OctoMap` is an octree of depth 16. A node's child `i` lies on the upper side of x, y and z where bits 0, 1 and 2
//! of `i` are set; a leaf above depth 16 stands for all voxels below it. Both kinds of file have a text header and then
//! the nodes, depth first:
//!
//! - `.ot`: for each node its log-odds as an f32 (for an inner node the greatest below it), then a byte with a bit for each child;
//! - `.bt`: for each inner node two bytes with two bits for each child: unknown, free leaf, occupied leaf, inner node.
//!
//! What is written as `.ot` comes back as it was, colours aside; `.bt` keeps only free and occupied. Our voxels at even odds are
//! free and `OctoMap`'s are occupied, so those are written a hair below.
//!
//! ```
//! use maps::voxel::{LogOdds, Voxel, VoxelKey, VoxelMap};
//!
//! let mut map = VoxelMap::new(0.05);
//! map.set_voxel(VoxelKey::new(1, 2, 3), Voxel::new(LogOdds::HIT));
//! let mut file = Vec::new();
//! octomap::write_ot(&map, &mut file)?;
//! assert_eq!(octomap::read_ot(&file[..])?.digest(), map.digest());
//! # Ok::<(), octomap::ReadError>(())
//! ```
//!
//! - A. Hornung et al., *`OctoMap`: an efficient probabilistic 3D mapping framework based on octrees*, Autonomous Robots
//!   34, 2013, section 4.

mod read;
#[cfg(feature = "referee")]
#[expect(
    unsafe_code,
    unreachable_pub,
    reason = "cxx generates both for the C++ side"
)]
pub mod referee;
mod write;

pub use read::{ReadError, read_bt, read_ot};
pub use write::{write_bt, write_ot};

/// Levels below the root.
const DEPTH: u32 = 16;

/// The comment that `OctoMap` puts below the first line, and the first line of each kind.
const OT_MAGIC: &str = "# Octomap OcTree file";
const BT_MAGIC: &str = "# Octomap OcTree binary file";
