//! A recording played as if it happened now: the same events through the same step.
//!
//! Seeking forward plays everything in between at once; seeking back starts the model anew and plays up to there, so what is
//! shown at a moment never depends on how one got to it.

use std::io::Read;
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::RawFrame;
use mavlink_ext::tlog::TlogReader;

/// Longer recordings are refused: they are held in memory.
const MAX_FRAMES: usize = 5_000_000;
/// A log with more damage than this is none: a telemetry log has hardly any.
const LEAST_FRAMES_PER_DAMAGE: usize = 10;

/// What the operator can do with a replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Steer {
    /// Let it run.
    Play,
    /// Stop where it is.
    Pause,
    /// 1 is real time.
    Speed(f64),
    /// Go to this time from its start.
    Seek(Duration),
}

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// There is no frame in it.
    #[error("the recording holds no MAVLink frame ({damaged} damaged records)")]
    Empty {
        /// Records that could not be read.
        damaged: u64,
    },
    /// It is something else in which a few frames seem to be.
    #[error(
        "this is no telemetry log (.tlog): {frames} frames stand among {damaged} damaged records; flight logs of the autopilot (.bin, .ulg) \
         are not read"
    )]
    NotALog {
        /// Records that could be read.
        frames: usize,
        /// Records that could not.
        damaged: u64,
    },
    /// It is too long to be held in memory.
    #[error("the recording holds more than {MAX_FRAMES} frames: cut it into pieces")]
    TooLong,
}

/// What the model must be fed to get to the new position.
#[derive(Debug)]
pub struct Advance<'a> {
    /// Whether the model must start anew first.
    pub restart: bool,
    /// Frames since the last position, or since the start.
    pub frames: &'a [(Stamp, RawFrame)],
    /// The new position.
    pub now: Stamp,
}

/// A recording and where in it we are.
#[derive(Debug)]
pub struct Replay {
    frames: Vec<(Stamp, RawFrame)>,
    epoch_unix_us: u64,
    damaged: u64,
    length: Stamp,
    position: Stamp,
    played: usize,
    seek: Option<Stamp>,
    playing: bool,
    speed: f64,
}

impl Replay {
    /// Reads a telemetry log; damaged records are skipped and counted.
    pub fn read(log: impl Read) -> Result<Self, ReplayError> {
        let mut frames: Vec<(Stamp, RawFrame)> = Vec::new();
        let (mut damaged, mut epoch_unix_us) = (0, None);
        for record in TlogReader::new(log) {
            let Ok((unix_us, frame)) = record else {
                damaged += 1;
                continue;
            };
            if frames.len() == MAX_FRAMES {
                return Err(ReplayError::TooLong);
            }
            let epoch = *epoch_unix_us.get_or_insert(unix_us);
            let at = Stamp::from_nanos(unix_us.saturating_sub(epoch).saturating_mul(1000));
            // Records of several links may be a little out of order: time does not run backwards.
            let at = frames.last().map_or(at, |(last, _)| at.max(*last));
            frames.push((at, frame));
        }
        let (Some((length, _)), Some(epoch_unix_us)) = (frames.last(), epoch_unix_us) else {
            return Err(ReplayError::Empty { damaged });
        };
        if damaged as usize * LEAST_FRAMES_PER_DAMAGE > frames.len() {
            return Err(ReplayError::NotALog {
                frames: frames.len(),
                damaged,
            });
        }
        Ok(Self {
            length: *length,
            frames,
            epoch_unix_us,
            damaged,
            position: Stamp::ZERO,
            played: 0,
            seek: None,
            playing: true,
            speed: 1.0,
        })
    }

    /// So many times as fast as it was, at most.
    pub const FASTEST: f64 = 1000.0;

    /// Does what the operator wants.
    pub fn steer(&mut self, steer: Steer) {
        match steer {
            Steer::Play if self.is_at_end() => {
                self.seek = Some(Stamp::ZERO);
                self.playing = true;
            }
            Steer::Play => self.playing = true,
            Steer::Pause => self.playing = false,
            Steer::Speed(speed) => {
                if speed > 0.0 && speed.is_finite() {
                    self.speed = speed.min(Self::FASTEST);
                }
            }
            Steer::Seek(to) => self.seek = Some((Stamp::ZERO + to).min(self.length)),
        }
    }

    /// Goes on by `passed` of real time.
    pub fn advance(&mut self, passed: Duration) -> Advance<'_> {
        let mut restart = false;
        if let Some(to) = self.seek.take() {
            if to < self.position {
                (restart, self.played) = (true, 0);
            }
            self.position = to;
        } else if self.playing {
            let span =
                Duration::try_from_secs_f64(passed.as_secs_f64() * self.speed).unwrap_or(passed);
            self.position = (self.position + span).min(self.length);
        }
        let from = self.played;
        self.played = self.frames.partition_point(|(at, _)| *at <= self.position);
        Advance {
            restart,
            frames: &self.frames[from.min(self.played)..self.played],
            now: self.position,
        }
    }

    /// Whether it runs.
    pub fn is_playing(&self) -> bool {
        self.playing && !self.is_at_end()
    }

    /// Whether there is nothing left to play.
    pub fn is_at_end(&self) -> bool {
        self.position == self.length && self.played == self.frames.len() && self.seek.is_none()
    }

    /// 1 is real time.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Where it is, from its start.
    pub fn position(&self) -> Stamp {
        self.position
    }

    /// Where it ends.
    pub fn length(&self) -> Stamp {
        self.length
    }

    /// Unix time of its start in microseconds.
    pub fn epoch_unix_us(&self) -> u64 {
        self.epoch_unix_us
    }

    /// Records that could not be read.
    pub fn damaged(&self) -> u64 {
        self.damaged
    }

    /// Frames in it.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Never: a recording without frames is refused.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }
}
