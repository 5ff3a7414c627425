//! What is left behind: the report, the trajectory and the map.
//!
//! Each file is written beside its name and then renamed, so that a reader sees the old one or the new one, whole.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use maps::trajectory::Trajectory;
use maps::trajectory::evaluation::{self, Alignment, Tool};
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
    write_atomically(&folder.join("trajectory.txt"), |file| {
        writeln!(file, "# timestamp tx ty tz qx qy qz qw")?;
        for (at, pose) in trajectory {
            let [x, y, z] = pose.translation().raw.coords.into();
            let [i, j, k, w] = pose.rotation().coords.into();
            writeln!(
                file,
                "{at} {x:.6} {y:.6} {z:.6} {i:.8} {j:.8} {k:.8} {w:.8}"
            )?;
        }
        Ok(())
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

/// The absolute trajectory error as the TUM benchmark defines it; `None` where nothing can be compared.
pub fn ate(truth: &[TruthPose], trajectory: &[(Stamp, Isometry<World, Camera>)]) -> Option<Ate> {
    let claim = |pose: &TruthPose| (pose.at, Isometry::claim(pose.pose));
    let mut truth: Vec<_> = truth.iter().map(claim).collect();
    truth.dedup_by_key(|(at, _)| *at);
    let truth = Trajectory::new(truth).ok()?;
    let estimate = Trajectory::new(trajectory.to_vec()).ok()?;
    let errors = evaluation::ate(&truth, &estimate, Tool::TumBenchmark, Alignment::Rigid).ok()?;
    Some(Ate {
        rmse_m: errors.rmse,
        frames: errors.count,
    })
}
