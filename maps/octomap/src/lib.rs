//! `OctoMap` files, written and read.
//!
//! An `OctoMap` is an octree of depth 16. A node's child `i` lies on the upper side of x, y and z where bits 0, 1 and 2
//! of `i` are set; a leaf above depth 16 stands for all voxels below it. Both kinds of file have a text header and then
//! the nodes, depth first:
//!
//! - `.ot`: for each node its log-odds as an f32 (for an inner node the greatest below it), then a byte with a bit for
//!   each child;
//! - `.bt`: for each inner node two bytes with two bits for each child: unknown, free leaf, occupied leaf, inner node.
//!
//! A `ColorOcTree` has a colour for each node of its `.ot` file. What is written as `.ot` comes back as it was, colours
//! included if they were asked for; `.bt` keeps only free and occupied. Our voxels at even odds are free and
//! `OctoMap`'s are occupied, so those are written a hair below.
//!
//! Semantic maps travel as a `ColorOcTree` too: [`Content::Class`] writes the documented colour of each class
//! ([`maps::palette`]), and a reader that is told so ([`Colors::Classes`]) takes them back. Nothing in the file says
//! which it is.
//!
//! - [`read()`] takes either kind of file, [`write_ot`] and [`write_bt`] write them pruned; [`Shape`] asks for other trees.
//! - `node_referee` and `referee`, for tests and benches, are Debian's liboctomap.
//!
//! ```
//! use maps::voxel::{LogOdds, Voxel, VoxelKey, VoxelMap};
//!
//! let mut map = VoxelMap::new(0.05);
//! map.set_voxel(VoxelKey::new(1, 2, 3), Voxel::new(LogOdds::HIT));
//! let mut file = Vec::new();
//! octomap::write_ot(&map, &mut file)?;
//! assert_eq!(octomap::read(&file[..], &octomap::ReadOptions::default())?.map.digest(), map.digest());
//! # Ok::<(), octomap::ReadError>(())
//! ```
//!
//! - A. Hornung et al., *`OctoMap`: an efficient probabilistic 3D mapping framework based on octrees*, Autonomous Robots
//!   34, 2013, section 4.

mod error;
mod header;
mod memory;
#[cfg(feature = "referee")]
#[expect(
    unsafe_code,
    unreachable_pub,
    reason = "cxx generates both for the C++ side"
)]
pub mod node_referee;
mod read;
#[cfg(feature = "referee")]
#[expect(
    unsafe_code,
    unreachable_pub,
    reason = "cxx generates both for the C++ side"
)]
pub mod referee;
mod write;

pub use error::ReadError;
pub use header::{Format, Header, TreeType};
pub use read::{Colors, Opened, ReadOptions, read, read_bt, read_ot};
pub use write::{Content, Pruning, Shape, write_bt, write_bt_as, write_ot, write_ot_as};

/// Levels below the root.
const DEPTH: u32 = 16;
/// The colour by which `OctoMap` says that there is none.
const NO_COLOR: [u8; 3] = [255; 3];
