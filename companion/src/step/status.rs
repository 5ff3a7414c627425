//! `TANDEM_STATUS`, once a second.

use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::Message;
use mavlink_ext::dialect::tandem::{
    TANDEM_STATUS_DATA, TandemMode, TandemModeReason, TandemStatusFlags, TandemTracking,
};
use slam::State;

use super::Companion;
use crate::pipeline::Ending;

/// How often it is sent.
const EVERY: Duration = Duration::from_secs(1);

/// What a field says that is not known.
const UNKNOWN: u16 = u16::MAX;

/// Rates over the time from one status to the next.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Status {
    due: Stamp,
    at: Stamp,
    frames: u64,
    bytes: u64,
    frame_rate_hz: f64,
    link_rate: f64,
}

impl Status {
    pub(super) fn is_due(&self, now: Stamp) -> bool {
        now >= self.due
    }

    /// Begins the next second with these counts of frames and bytes so far.
    pub(super) fn begin(&mut self, now: Stamp, frames: u64, bytes: u64) {
        let span_s = now.since(self.at).as_secs_f64().max(1e-3);
        *self = Self {
            due: now + EVERY,
            at: now,
            frames,
            bytes,
            frame_rate_hz: (frames - self.frames) as f64 / span_s,
            link_rate: (bytes - self.bytes) as f64 / span_s,
        };
    }
}

impl Companion {
    pub(super) fn status_message(&self, now: Stamp) -> Message {
        let map = self.figures.map();
        let (mode, reason) = self.mode();
        let ms = |time: Option<Duration>| {
            time.map_or(UNKNOWN, |t| {
                t.as_millis().min(u128::from(UNKNOWN - 1)) as u16
            })
        };
        Message::TANDEM_STATUS(TANDEM_STATUS_DATA {
            time_usec: now.as_nanos() / 1000,
            map_digest: map.digest.0,
            voxels_occupied: map.voxels_occupied as u32,
            tiles_known: map.tiles as u32,
            tiles_delivered: self.map_link.delivered(now) as u32,
            frames: self.figures.frames() as u32,
            frames_tracked: self.figures.frames_tracked() as u32,
            queued: self.map_link.queued_bytes(now) as u32,
            link_rate: self.status.link_rate as u32,
            frame_rate: (self.status.frame_rate_hz * 100.0).round() as u16,
            latency_slam: ms(self.figures.tracking_p99()),
            latency_map: ms(self.figures.mapping_p99()),
            latency_delivery: ms(self.map_link.delivery_p99()),
            loss: self
                .map_link
                .loss(now)
                .map_or(UNKNOWN, |loss| (loss * 1000.0).round() as u16),
            mode: mode as u8,
            mode_reason: reason as u8,
            tracking: match self.tracking {
                None | Some(State::Searching) => TandemTracking::TANDEM_TRACKING_NONE,
                Some(State::Tracking) => TandemTracking::TANDEM_TRACKING_GOOD,
                Some(State::Lost { .. }) => TandemTracking::TANDEM_TRACKING_LOST,
            } as u8,
            flags: self.flags(now).bits() as u8,
        })
    }

    fn flags(&self, now: Stamp) -> TandemStatusFlags {
        let ended = self.ending().is_some();
        let all_delivered = self.map_link.delivered(now) == self.figures.map().tiles;
        let heard = self.presence.is_alive(self.autopilot);
        let mut flags = TandemStatusFlags::empty();
        flags.set(
            TandemStatusFlags::TANDEM_STATUS_FLAGS_SOURCE_FINISHED,
            ended,
        );
        flags.set(
            TandemStatusFlags::TANDEM_STATUS_FLAGS_ALL_DELIVERED,
            all_delivered,
        );
        flags.set(
            TandemStatusFlags::TANDEM_STATUS_FLAGS_AUTOPILOT_HEARD,
            heard,
        );
        flags
    }

    /// This role maps alone, so the mode is never collaborative.
    fn mode(&self) -> (TandemMode, TandemModeReason) {
        let (uav, starting) = (
            TandemMode::TANDEM_MODE_UAV_ONLY,
            TandemMode::TANDEM_MODE_STARTING,
        );
        match (self.ending(), self.tracking) {
            (Some(Ending::Failed(_)), _) => (uav, TandemModeReason::TANDEM_MODE_REASON_SENSOR_LOST),
            (_, None) => (starting, TandemModeReason::TANDEM_MODE_REASON_NONE),
            (_, Some(State::Searching | State::Lost { .. })) => {
                (uav, TandemModeReason::TANDEM_MODE_REASON_NOT_LOCALIZED)
            }
            (_, Some(State::Tracking)) => (uav, TandemModeReason::TANDEM_MODE_REASON_CONFIGURED),
        }
    }
}
