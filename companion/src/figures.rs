//! Counts what has been done, for the report and for `TANDEM_STATUS`.

use std::time::Duration;

use maps::time::Stamp;
use maps::voxel::{MapDigest, VoxelMap};
use slam::{Floor, State};

use crate::config::MappingSettings;
use crate::histogram::Histogram;
use crate::pipeline::uav::MapFigures;
use crate::pipeline::{Ending, FrameDone, SourceEnded};
use crate::report::Report;

/// What has been done so far.
#[derive(Clone, Debug)]
pub struct Figures {
    recording: String,
    frames_in_recording: Option<usize>,
    resolution_m: f64,
    frames: u64,
    frames_tracked: u64,
    pose_resets: u32,
    durations: Histogram,
    tracking: Histogram,
    mapping: Histogram,
    map: MapFigures,
    ended: Option<SourceEnded>,
    /// What went to the ground station.
    pub wire: WireFigures,
}

/// What went to the ground station, as [`Report`] explains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WireFigures {
    /// Versions of tiles sent, or waiting to be.
    pub tiles_sent: u64,
    /// Tiles whose newest version has arrived.
    pub tiles_delivered: usize,
    /// Bytes of frames with Tandem's own messages.
    pub bytes: u64,
}

impl Figures {
    /// Nothing done yet of this recording.
    pub fn new(recording: &str, frames: Option<usize>, mapping: &MappingSettings) -> Self {
        let empty = VoxelMap::new(mapping.resolution_m);
        Self {
            recording: recording.to_owned(),
            frames_in_recording: frames,
            resolution_m: mapping.resolution_m,
            frames: 0,
            frames_tracked: 0,
            pose_resets: 0,
            durations: Histogram::default(),
            tracking: Histogram::default(),
            mapping: Histogram::default(),
            map: MapFigures {
                digest: empty.digest(),
                tiles: 0,
                voxels_occupied: 0,
                voxels_known: 0,
            },
            ended: None,
            wire: WireFigures::default(),
        }
    }

    /// One more frame.
    pub fn add_frame(&mut self, done: &FrameDone) {
        self.frames += 1;
        self.durations.add(done.duration());
        self.tracking.add(done.tracking);
        // Most frames bring no keyframe.
        if done.keyframes > 0 {
            self.mapping.add(done.mapping);
        }
        if let Some(tracked) = &done.tracked {
            self.frames_tracked += u64::from(tracked.state == State::Tracking);
            self.pose_resets = tracked.reset_counter;
        }
    }

    /// The map has changed.
    pub fn set_map(&mut self, map: MapFigures) {
        self.map = map;
    }

    /// The source has ended.
    pub fn end(&mut self, ended: &SourceEnded) {
        self.map = ended.map;
        self.ended = Some(ended.clone());
    }

    /// Frames processed.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Of these, those with a known pose.
    pub fn frames_tracked(&self) -> u64 {
        self.frames_tracked
    }

    /// The map, as the ground station could have it by now.
    pub fn map(&self) -> MapFigures {
        self.map
    }

    /// How the source ended, if it has.
    pub fn ended(&self) -> Option<&SourceEnded> {
        self.ended.as_ref()
    }

    /// 99th percentile of the time to track a frame.
    pub fn tracking_p99(&self) -> Option<Duration> {
        self.tracking.quantile(0.99)
    }

    /// 99th percentile of the time to put a frame's settled keyframes into the map.
    pub fn mapping_p99(&self) -> Option<Duration> {
        self.mapping.quantile(0.99)
    }

    /// The report at `now`.
    pub fn report(&self, now: Stamp) -> Report {
        let ms = |q| self.durations.quantile(q).unwrap_or_default().as_secs_f64() * 1e3;
        let busy_s = self.durations.sum().as_secs_f64();
        let per = |n: u64, of: f64| if of > 0.0 { n as f64 / of } else { 0.0 };
        let ending = self.ended.as_ref().map(|ended| &ended.ending);
        let floor = self.ended.as_ref().and_then(|ended| ended.floor);
        let ate = self.ended.as_ref().and_then(|ended| ended.ate);
        let MapDigest(digest) = self.map.digest;
        Report {
            recording: self.recording.clone(),
            source_finished: ending == Some(&Ending::Finished),
            source_error: match ending {
                Some(Ending::Failed(error)) => Some(error.clone()),
                Some(Ending::Finished | Ending::Stopped) | None => None,
            },
            source_losses: self.ended.as_ref().and_then(|ended| ended.losses),
            detector: self.ended.as_ref().and_then(|ended| ended.detector),
            frames: self.frames,
            frames_in_recording: self.frames_in_recording,
            frames_tracked: self.frames_tracked,
            tracked_share: per(self.frames_tracked, self.frames as f64),
            pose_resets: self.pose_resets,
            ate_rmse_m: ate.map(|ate| ate.rmse_m),
            ate_frames: ate.map(|ate| ate.frames),
            slam_fps: per(self.frames, busy_s),
            slam_p50_ms: ms(0.5),
            slam_p99_ms: ms(0.99),
            floor_found: floor.map(|f| matches!(f.floor, Floor::Found { .. })),
            floor_below_m: floor.map(|f| f.floor.height_m()),
            beneath_floor_share: floor.map(|f| f.beneath_share),
            map_resolution_m: self.resolution_m,
            map_voxels_occupied: self.map.voxels_occupied,
            map_voxels_known: self.map.voxels_known,
            map_tiles: self.map.tiles,
            map_digest: format!("{digest:016x}"),
            tiles_sent: self.wire.tiles_sent,
            tiles_delivered: self.wire.tiles_delivered,
            bytes_on_wire: self.wire.bytes,
            wall_s: now.as_secs_f64(),
        }
    }
}
