//! Pictures of a map as PNG files.

use std::io;
use std::path::Path;

use maps::picture::{self, Picture, Request};
use maps::voxel::VoxelMap;

use super::MapError;
use crate::output::write_atomically;

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
    Ok(write_atomically(to, |file| write_png(&picture, file))?)
}

fn write_png(picture: &Picture, file: impl io::Write) -> io::Result<()> {
    // A picture has at most 8192 pixels a side.
    let mut encoder = png::Encoder::new(file, picture.width as u32, picture.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    writer
        .write_image_data(&picture.rgb)
        .map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)
}
