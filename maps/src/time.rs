//! Moments on one monotonic clock.
//!
//! Nothing below `main` reads a clock: a [`Stamp`] is an argument, so that a replay is exact and a test needs no sleep.
//! Each platform has its own clock; a peer's stamps are translated once, where they arrive, by the TIMESYNC estimate.

use std::fmt;
use std::ops::{Add, AddAssign, Sub};
use std::time::Duration;

/// Nanoseconds since the start of one monotonic clock: a program's start, or the epoch of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Stamp(u64);

impl Stamp {
    /// The start of the clock.
    pub const ZERO: Self = Self(0);

    /// The moment `nanos` after the start of the clock.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// The moment `seconds` after the start of the clock; `None` unless finite, not negative and below 584 years.
    pub fn from_secs_f64(seconds: f64) -> Option<Self> {
        Duration::try_from_secs_f64(seconds)
            .ok()
            .and_then(|d| u64::try_from(d.as_nanos()).ok())
            .map(Self)
    }

    /// Nanoseconds since the start of the clock.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Seconds since the start of the clock.
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// Time passed since `earlier`; zero if `earlier` is in fact later.
    pub fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// Distance in time to `other`, in either direction.
    pub fn distance(self, other: Self) -> Duration {
        Duration::from_nanos(self.0.abs_diff(other.0))
    }
}

impl Add<Duration> for Stamp {
    type Output = Self;

    /// Saturates at the end of the clock, 584 years after its start.
    fn add(self, span: Duration) -> Self {
        Self(
            self.0
                .saturating_add(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)),
        )
    }
}

impl AddAssign<Duration> for Stamp {
    fn add_assign(&mut self, span: Duration) {
        *self = *self + span;
    }
}

impl Sub<Duration> for Stamp {
    type Output = Self;

    /// Saturates at the start of the clock.
    fn sub(self, span: Duration) -> Self {
        Self(
            self.0
                .saturating_sub(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)),
        )
    }
}

/// Seconds with nine digits, as TUM trajectory files write them.
impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}.{:09}",
            self.0 / 1_000_000_000,
            self.0 % 1_000_000_000
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_between_stamps_is_exact_to_the_nanosecond() {
        let start = Stamp::from_nanos(1_548_339_819_874_260_000);
        assert_eq!(
            (start + Duration::from_nanos(1)).since(start),
            Duration::from_nanos(1)
        );
        assert_eq!(
            start.since(start + Duration::from_secs(1)),
            Duration::ZERO,
            "never negative"
        );
        assert_eq!(start.to_string(), "1548339819.874260000");
    }

    #[test]
    fn seconds_that_are_no_moment_are_refused() {
        for seconds in [f64::NAN, f64::INFINITY, -1.0, 1e300] {
            assert_eq!(Stamp::from_secs_f64(seconds), None, "{seconds} s");
        }
        assert_eq!(
            Stamp::from_secs_f64(1.5),
            Some(Stamp::from_nanos(1_500_000_000))
        );
    }
}
