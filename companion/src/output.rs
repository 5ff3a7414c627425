//! What is left behind: the report, the trajectory and the map.
//!
//! Each file is written beside its name and then renamed, so that a reader sees the old one or the new one, whole.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use maps::frame::{Camera, Isometry, World};
use maps::picture::Picture;
use maps::time::Stamp;
use maps::trajectory::evaluation::{self, Alignment, Tool};
use maps::trajectory::{Trajectory, tum};
use maps::voxel::VoxelMap;
use octomap::{Content, Shape};
use sensors::TruthPose;

/// Why something could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: check the folder, its permissions and the free space", path.display())]
pub struct OutputError {
    /// The file.
    pub path: PathBuf,
    /// What the system says.
    pub source: io::Error,
}

/// Writes a file so that it is there whole or not at all.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), OutputError> {
    let error = |source| OutputError {
        path: path.to_owned(),
        source,
    };
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(error)?;
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = folder.join(name);
    let write = || {
        let mut writer = BufWriter::new(File::create(&part)?);
        fill(&mut writer)?;
        writer.flush()?;
        writer.get_ref().sync_all()?;
        fs::rename(&part, path)
    };
    write().map_err(error)
}

/// Writes `trajectory.txt` (TUM format, the camera in the world), `map.ot`, `map.bt` and, with the colours that a camera
/// saw, `map_color.ot`, which not every `OctoMap` program can read.
pub fn write_map(
    folder: &Path,
    map: &VoxelMap,
    trajectory: &[(Stamp, Isometry<World, Camera>)],
) -> Result<(), OutputError> {
    let text = tum::format_poses(trajectory);
    write_atomically(&folder.join("trajectory.txt"), |file| {
        file.write_all(text.as_bytes())
    })?;
    write_atomically(&folder.join("map.ot"), |file| {
        octomap::write_ot(map, file).map_err(io::Error::other)
    })?;
    write_atomically(&folder.join("map_color.ot"), |file| {
        octomap::write_ot_as(map, Content::Color, Shape::default(), file).map_err(io::Error::other)
    })?;
    write_atomically(&folder.join("map.bt"), |file| {
        octomap::write_bt(map, file).map_err(io::Error::other)
    })
}

/// How far a trajectory is from the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ate {
    /// Root mean square of the distances after the best rigid alignment.
    pub rmse_m: f64,
    /// Frames that could be compared: those with a true pose within 20 ms.
    pub frames: usize,
}

/// A recording's truth; `None` where it has none. Of poses with the same stamp the first counts, and what is not finite or
/// goes back in time makes all of it useless.
pub fn truth(truth: &[TruthPose]) -> Option<Trajectory<Camera>> {
    let claim = |pose: &TruthPose| (pose.at, Isometry::claim(pose.pose));
    let mut poses: Vec<_> = truth.iter().map(claim).collect();
    poses.dedup_by_key(|(at, _)| *at);
    Trajectory::new(poses)
        .ok()
        .filter(|truth| !truth.is_empty())
}

/// The absolute trajectory error as the TUM benchmark defines it; `None` where nothing can be compared.
pub fn ate(poses: &[TruthPose], trajectory: &[(Stamp, Isometry<World, Camera>)]) -> Option<Ate> {
    let truth = truth(poses)?;
    let estimate = Trajectory::new(trajectory.to_vec()).ok()?;
    let errors = evaluation::ate(&truth, &estimate, Tool::TumBenchmark, Alignment::Rigid).ok()?;
    Some(Ate {
        rmse_m: errors.rmse,
        frames: errors.count,
    })
}

/// Writes a picture as a PNG file of eight bits.
pub(crate) fn png(picture: &Picture, file: impl io::Write) -> io::Result<()> {
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
