//! What can be wrong with a file.

use std::io;

use crate::DEPTH;
use crate::header::LONGEST_HEADER;

/// Why an `OctoMap` file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file itself; `UnexpectedEof` where it ends in the midst of the tree.
    #[error("cannot read the file: {0}")]
    Io(#[from] io::Error),
    /// Another kind of file.
    #[error("the file does not begin as an OctoMap .ot or .bt file does")]
    NotOctomap,
    /// A `.ot` file where a `.bt` file was expected, or the other way.
    #[error("the file is an OctoMap file, but not of kind {expected}")]
    OtherFormat {
        /// The ending of the expected kind.
        expected: &'static str,
    },
    /// A tree whose nodes are of unknown size.
    #[error(
        "the file holds a tree of type {found:?}, only OcTree, ColorOcTree and OcTreeStamped are understood"
    )]
    OtherTree {
        /// What the header says.
        found: String,
    },
    /// Missing, no number, or no resolution that a map can have.
    #[error("the header gives the resolution as {found:?}, a map has 0.001 m to 100 m")]
    BadResolution {
        /// What it says.
        found: String,
    },
    /// The header does not come to an end.
    #[error("the header has no line \"data\" in its first {LONGEST_HEADER} bytes")]
    NoData,
    /// A node below the lowest level.
    #[error("the tree is deeper than {DEPTH} levels at node {node}")]
    TooDeep {
        /// Counted from the root, which is 1.
        node: u64,
    },
    /// Log-odds that are no number.
    #[error("the log-odds of node {node} are not a number")]
    NotANumber {
        /// Counted from the root, which is 1.
        node: u64,
    },
    /// A `.bt` file of which nodes are missing or too many, as far as its header knows. In a `.ot` file `OctoMap` does
    /// not mind.
    #[error("the header announces {said} nodes, the tree has {found}")]
    OtherCount {
        /// By the header.
        said: u64,
        /// By the tree.
        found: u64,
    },
    /// Its leaves stand for too much to hold.
    #[error(
        "the map would take more than {most_mib} MiB: a leaf {edge_m} m wide at node {node} stands for {voxels} voxels; \
         read it {coarser} or more levels coarser, or allow more memory"
    )]
    TooLarge {
        /// What was allowed.
        most_mib: u64,
        /// The leaf that was too much, counted from the root, which is 1.
        node: u64,
        /// Its edge.
        edge_m: f64,
        /// The voxels that it stands for.
        voxels: u64,
        /// So many levels coarser, that leaf alone is not too much.
        coarser: u32,
    },
    /// There are not so many levels.
    #[error("a tree of {DEPTH} levels cannot be read {coarser} levels coarser")]
    TooCoarse {
        /// What was asked for.
        coarser: u32,
    },
}
