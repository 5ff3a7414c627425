//! Pictures of a map as PNG files.

use std::path::Path;

use maps::picture::{self, Request};
use maps::voxel::VoxelMap;

use super::MapError;
use crate::output::{png, write_atomically};

/// Draws the map that was read from `from` into `to`.
pub fn draw(map: &VoxelMap, from: &Path, request: &Request<'_>, to: &Path) -> Result<(), MapError> {
    if to.extension().is_none_or(|ending| ending != "png") {
        return Err(MapError::Ending {
            path: to.to_owned(),
            known: ".png",
        });
    }
    let picture = picture::sheet(map, request).map_err(|source| MapError::Draw {
        path: from.to_owned(),
        source,
    })?;
    Ok(write_atomically(to, |file| png(&picture, file))?)
}
