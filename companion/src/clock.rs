//! The program's one monotonic clock.
//!
//! It is made in `main` and passed to the threads; everything else gets its readings as [`Stamp`]s.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use maps::time::Stamp;

/// Counts from the program's start.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    started: Instant,
}

impl Clock {
    /// Starts at [`Stamp::ZERO`].
    #[expect(
        clippy::disallowed_methods,
        reason = "the one place where monotonic time comes from"
    )]
    pub fn start() -> Self {
        Self {
            started: Instant::now(),
        }
    }

    /// The time since the start.
    pub fn now(self) -> Stamp {
        Stamp::ZERO + self.started.elapsed()
    }
}

/// The time since 1970 by the system's calendar clock, for the number of the session and the doctor; zero before that.
#[expect(
    clippy::disallowed_methods,
    reason = "the one place where calendar time comes from"
)]
pub fn since_1970() -> Duration {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default()
}
