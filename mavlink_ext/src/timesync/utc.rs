//! How a clock relates to UTC, as `SYSTEM_TIME` tells it.
//!
//! The message pairs UTC with the sender's clock at one moment, so that the time it was under way does not matter.

use std::time::Duration;

use maps::time::Stamp;

use super::filter::SKEW_SIGMA;
use crate::dialect::Message;
use crate::dialect::tandem::SYSTEM_TIME_DATA;

/// How far what an autopilot calls UTC is off, one sigma. ArduPilot takes it from the receiver's messages, without its pulse,
/// which come some hundredths of a second late, and lets it run on by its own oscillator while armed. The message does
/// not say how good it is.
const OF_SENDER: Duration = Duration::from_millis(20);
/// Before 2022 no clock is right that says so, and ArduPilot too takes none for set.
const EARLIEST: i64 = 1_640_995_200_000_000_000;

/// How a clock relates to UTC (Unix time: nanoseconds since 1970 without leap seconds).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Utc {
    /// UTC minus the clock, in nanoseconds.
    pub offset: i64,
    /// Its standard uncertainty (one sigma) when it was found.
    pub sigma: Duration,
    /// When it was found, on our clock.
    pub at: Stamp,
}

impl Utc {
    /// Older than this it is not used: the receiver may have lost its satellites, or its clock been set.
    pub const LIFE: Duration = Duration::from_secs(10);

    /// How the sender's clock relates to UTC; `None` if it does not know.
    pub(super) fn of_sender(now: Stamp, time: &SYSTEM_TIME_DATA) -> Option<Self> {
        let utc = i64::try_from(time.time_unix_usec).ok()?.checked_mul(1000)?;
        // Its clock is cut to a millisecond: it is half of one later on average.
        let clock = i64::from(time.time_boot_ms) * 1_000_000 + 500_000;
        (utc >= EARLIEST).then_some(Self {
            offset: utc - clock,
            sigma: OF_SENDER,
            at: now,
        })
    }

    /// Whether it is still used.
    pub fn is_fresh(&self, now: Stamp) -> bool {
        now.since(self.at) <= Self::LIFE
    }

    /// Its standard uncertainty now: the clock may have drifted since.
    pub fn sigma(&self, now: Stamp) -> Duration {
        let drifted = now.distance(self.at).mul_f64(SKEW_SIGMA);
        self.sigma.saturating_add(drifted)
    }

    /// The same for another clock, of which this one is ahead by so much.
    pub(super) fn moved(self, ahead: i64, sigma: Duration) -> Self {
        Self {
            offset: self.offset.saturating_add(ahead),
            sigma: together(self.sigma, sigma),
            ..self
        }
    }
}

/// Two independent standard uncertainties together.
pub(super) fn together(a: Duration, b: Duration) -> Duration {
    let sigma = a.as_secs_f64().hypot(b.as_secs_f64());
    Duration::try_from_secs_f64(sigma).unwrap_or(Duration::MAX)
}

/// `SYSTEM_TIME` of a clock that has this relation to UTC; `None` where UTC would be before 1970.
pub fn system_time(now: Stamp, utc: &Utc) -> Option<Message> {
    let unix = i128::from(now.as_nanos()) + i128::from(utc.offset);
    Some(Message::SYSTEM_TIME(SYSTEM_TIME_DATA {
        time_unix_usec: u64::try_from(unix / 1000).ok()?,
        // Starts again after 49.7 days, as the message has it.
        time_boot_ms: (now.as_nanos() / 1_000_000) as u32,
    }))
}
