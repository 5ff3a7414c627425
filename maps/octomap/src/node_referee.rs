//! Debian's liboctomap voxel by voxel, with log-odds and colours, as a judge of our files in tests.

use std::path::Path;

use cxx::UniquePtr;
use maps::voxel::VoxelKey;

use crate::TreeType;
use crate::referee::Refused;

#[cxx::bridge(namespace = "tandem")]
mod ffi {
    unsafe extern "C++" {
        include!("octomap/src/node_referee.h");

        type NodeReferee;

        fn plain_nodes(resolution: f64) -> UniquePtr<NodeReferee>;
        fn colored_nodes(resolution: f64) -> UniquePtr<NodeReferee>;
        fn read_nodes(path: &str) -> Result<UniquePtr<NodeReferee>>;
        fn set(self: Pin<&mut NodeReferee>, key: [u16; 3], log_odds: f32);
        fn set_color(self: Pin<&mut NodeReferee>, key: [u16; 3], color: [u8; 3]);
        fn update_inner(self: Pin<&mut NodeReferee>);
        fn prune(self: Pin<&mut NodeReferee>);
        fn nodes(&self) -> usize;
        fn is_colored(&self) -> bool;
        fn log_odds(&self, key: [u16; 3]) -> f32;
        fn color(&self, key: [u16; 3]) -> [u8; 3];
        fn write_ot(&self, path: &str) -> bool;
        fn write_bt(&self, path: &str) -> bool;
    }
}

/// An `OcTree` or a `ColorOcTree` of liboctomap.
pub struct NodeReferee(UniquePtr<ffi::NodeReferee>);

impl NodeReferee {
    /// An empty tree; what is not [`TreeType::Color`] is plain.
    pub fn new(tree: TreeType, resolution_m: f64) -> Self {
        Self(match tree {
            TreeType::Color => ffi::colored_nodes(resolution_m),
            TreeType::Plain | TreeType::Stamped => ffi::plain_nodes(resolution_m),
        })
    }

    /// Reads a `.bt` or, whatever else its name ends in, a `.ot` file.
    pub fn read(path: &Path) -> Result<Self, Refused> {
        ffi::read_nodes(&path.to_string_lossy())
            .map(Self)
            .map_err(|e| Refused(e.what().to_owned()))
    }

    /// Whether its nodes have colours.
    pub fn is_colored(&self) -> bool {
        self.0.is_colored()
    }

    /// How many nodes it has, inner ones included.
    pub fn nodes(&self) -> usize {
        self.0.nodes()
    }

    /// Gives a voxel its log-odds.
    pub fn set(&mut self, key: VoxelKey, log_odds: f32) {
        self.0.pin_mut().set(its(key), log_odds);
    }

    /// Gives a known voxel its colour.
    pub fn set_color(&mut self, key: VoxelKey, color: [u8; 3]) {
        self.0.pin_mut().set_color(its(key), color);
    }

    /// Brings the inner nodes up to date.
    pub fn update_inner(&mut self) {
        self.0.pin_mut().update_inner();
    }

    /// Merges equal leaves.
    pub fn prune(&mut self) {
        self.0.pin_mut().prune();
    }

    /// The log-odds of a voxel that is known.
    pub fn log_odds(&self, key: VoxelKey) -> Option<f32> {
        let log_odds = self.0.log_odds(its(key));
        (!log_odds.is_nan()).then_some(log_odds)
    }

    /// The colour of a voxel that has one.
    pub fn color(&self, key: VoxelKey) -> Option<[u8; 3]> {
        let color = self.0.color(its(key));
        (color != crate::NO_COLOR).then_some(color)
    }

    /// Writes a `.ot` file of the tree as it is.
    pub fn write_ot(&self, path: &Path) -> Result<(), Refused> {
        let written = self.0.write_ot(&path.to_string_lossy());
        written.then_some(()).ok_or_else(|| refusal(path))
    }

    /// Writes a `.bt` file of the tree as it is.
    pub fn write_bt(&self, path: &Path) -> Result<(), Refused> {
        let written = self.0.write_bt(&path.to_string_lossy());
        written.then_some(()).ok_or_else(|| refusal(path))
    }
}

fn refusal(path: &Path) -> Refused {
    Refused(format!("liboctomap does not write {}", path.display()))
}

/// Its keys begin at the corner of the world.
fn its(key: VoxelKey) -> [u16; 3] {
    [key.x, key.y, key.z].map(|c| (c - VoxelKey::RANGE.start()) as u16)
}
