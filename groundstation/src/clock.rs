//! The one clock of the program: time since its start, and what time of day that was.

use std::time::{Duration, Instant, SystemTime};

use maps::time::Stamp;

/// Started once by `main` and handed to every thread that stamps what it receives.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start: Instant,
    epoch_unix_us: u64,
}

impl Clock {
    /// Starts now.
    #[expect(
        clippy::disallowed_methods,
        reason = "the clock itself; everything else is given its stamps"
    )]
    pub fn start() -> Self {
        let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let micros = since_1970.unwrap_or(Duration::ZERO).as_micros();
        Self {
            start: Instant::now(),
            epoch_unix_us: u64::try_from(micros).unwrap_or(u64::MAX),
        }
    }

    /// Time since the start.
    pub fn now(&self) -> Stamp {
        Stamp::ZERO + self.start.elapsed()
    }

    /// Unix time of the start in microseconds.
    pub fn epoch_unix_us(&self) -> u64 {
        self.epoch_unix_us
    }
}
