//! Where two maps contradict each other.

use std::path::Path;

use maps::evidence::Mass;
use maps::voxel::{Occupancy, VoxelKey, VoxelMap};

use super::MapError;

/// From this conflict on the paper does not combine what two sources say, but decides between them (3.4.3).
pub const CONTRADICTION: f64 = 0.3;

/// What two maps say of the same voxels, the one from the file `other_path` with the other's name.
#[derive(Clone, Copy, Debug)]
pub struct Conflict<'a> {
    map: &'a VoxelMap,
    other: &'a VoxelMap,
}

impl<'a> Conflict<'a> {
    /// Of two maps with voxels of one size in one frame.
    pub fn new(
        map: &'a VoxelMap,
        (other, other_path): (&'a VoxelMap, &Path),
    ) -> Result<Self, MapError> {
        if map.resolution_m().to_bits() == other.resolution_m().to_bits() {
            return Ok(Self { map, other });
        }
        Err(MapError::Resolution {
            path: other_path.to_owned(),
            there_m: other.resolution_m(),
            here_m: map.resolution_m(),
        })
    }

    /// Conflict K of the two maps' masses (paper Eq. 23), each the least committed one with the map's probability: from 0,
    /// they agree or one says nothing, to 1, one is sure of what the other is sure is not; none where only one map knows.
    pub fn at(&self, key: VoxelKey) -> Option<f64> {
        let mass = |map: &VoxelMap| {
            let voxel = map.voxel(key)?;
            Some(Mass::least_committed(voxel.log_odds.probability() as f32))
        };
        Some(f64::from(mass(self.map)?.conflict(mass(self.other)?)))
    }

    /// Voxels that both maps know, and those of which they contradict each other, by [`CONTRADICTION`].
    pub fn count(&self) -> (usize, usize) {
        let both = self.map.known().filter_map(|(key, _)| self.at(key));
        both.fold((0, 0), |(known, contradicting), k| {
            (known + 1, contradicting + usize::from(k >= CONTRADICTION))
        })
    }

    /// The map with what only the other takes for occupied, so that a picture shows both.
    pub fn both(&self) -> VoxelMap {
        let mut both = self.map.clone();
        for (key, voxel) in self.other.occupied() {
            if self.map.occupancy(key) != Occupancy::Occupied {
                both.set_voxel(key, voxel);
            }
        }
        both
    }
}
