//! `report.json`: what was done, in figures.

use std::io::Write as _;
use std::path::Path;

use sensors::live::Losses;
use serde::Serialize;

use crate::output::{OutputError, write_atomically};
use crate::pipeline::detecting::DetectorFigures;

/// The report. All times are wall time of this run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The recording's name.
    pub recording: String,
    /// Whether the recording was played to its end; false in a report written before, or after a stop or an error.
    pub source_finished: bool,
    /// Why it was not, if something failed.
    pub source_error: Option<String>,
    /// What of a live camera's messages was not used, and why; none of a recording.
    pub source_losses: Option<Losses>,
    /// What the detector has done, where there is one.
    pub detector: Option<DetectorFigures>,
    /// Frames processed.
    pub frames: u64,
    /// Frames in the recording, where that is known.
    pub frames_in_recording: Option<usize>,
    /// Of those processed, frames with a known pose.
    pub frames_tracked: u64,
    /// `frames_tracked / frames`.
    pub tracked_share: f64,
    /// How often the pose has jumped.
    pub pose_resets: u32,
    /// Root mean square of the distance to the true positions after rigid alignment, as the TUM benchmark's
    /// `evaluate_ate.py` has it; none without truth.
    pub ate_rmse_m: Option<f64>,
    /// Over how many frames: those tracked that have a true pose within 20 ms.
    pub ate_frames: Option<usize>,
    /// Frames per second of time spent in tracking and mapping, waiting and decoding left out.
    pub slam_fps: f64,
    /// Median time of tracking and mapping of a frame.
    pub slam_p50_ms: f64,
    /// 99th percentile of it.
    pub slam_p99_ms: f64,
    /// Whether the first frame showed the floor, from which heights in the map count; otherwise it was assumed.
    pub floor_found: Option<bool>,
    /// How high the first camera was taken to be above it.
    pub floor_below_m: Option<f64>,
    /// Of the dense points, the share more than 0.25 m beneath that floor: where it is large, a table was taken for it.
    pub beneath_floor_share: Option<f64>,
    /// Edge of a voxel.
    pub map_resolution_m: f64,
    /// Occupied voxels.
    pub map_voxels_occupied: usize,
    /// Free and occupied voxels.
    pub map_voxels_known: usize,
    /// Tiles.
    pub map_tiles: usize,
    /// Digest of the map, 16 hexadecimal digits: equal maps have equal digests.
    pub map_digest: String,
    /// Versions of tiles sent to the ground station, or waiting to be; those replaced by newer ones before are not.
    pub tiles_sent: u64,
    /// Tiles whose newest version the ground station has reported complete.
    pub tiles_delivered: usize,
    /// Bytes of MAVLink frames with Tandem's own messages (announcements, symbols, status, origin) handed to the ground
    /// link, headers and checksums included, UDP and IP headers not; resends count again, other traffic does not.
    pub bytes_on_wire: u64,
    /// From the start of the program to this report.
    pub wall_s: f64,
}

impl Report {
    /// Writes `report.json` into a folder, replacing the one that is there.
    pub fn write(&self, folder: &Path) -> Result<(), OutputError> {
        write_atomically(&folder.join("report.json"), |file| {
            serde_json::to_writer_pretty(&mut *file, self)?;
            file.write_all(b"\n")
        })
    }
}
