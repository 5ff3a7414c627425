//! What a run costs: time on the wall, processor time of all threads, and memory.

use std::fs;
use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};

/// Takes the time of what is measured, and takes out what is not.
pub(super) struct Meter {
    started: Duration,
    /// Processor time of this thread in what is not measured.
    outside: Duration,
}

impl Meter {
    pub(super) fn start() -> Self {
        Self {
            started: spent(ClockId::ProcessCPUTime),
            outside: Duration::ZERO,
        }
    }

    /// Does what is to be measured; how long it took on the wall.
    #[expect(
        clippy::disallowed_methods,
        reason = "how long it takes is what is measured"
    )]
    pub(super) fn inside<T>(work: impl FnOnce() -> T) -> (Duration, T) {
        let start = Instant::now();
        let result = work();
        (start.elapsed(), result)
    }

    /// Does in this thread what is not to be measured. Threads behind what is measured may go on meanwhile and count.
    pub(super) fn outside<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let before = spent(ClockId::ThreadCPUTime);
        let result = work();
        self.outside += spent(ClockId::ThreadCPUTime).saturating_sub(before);
        result
    }

    /// Processor time of all threads since the start, without what is not measured.
    pub(super) fn cpu(&self) -> Duration {
        let all = spent(ClockId::ProcessCPUTime).saturating_sub(self.started);
        all.saturating_sub(self.outside)
    }
}

fn spent(clock: ClockId) -> Duration {
    let time = clock_gettime(clock);
    let seconds = u64::try_from(time.tv_sec).unwrap_or_default();
    let nanos = u32::try_from(time.tv_nsec).unwrap_or_default();
    Duration::new(seconds, nanos)
}

/// The most memory of this process that was ever resident, in 10⁶ bytes, as Linux counts it (`VmHWM`: unlike `ru_maxrss`, it
/// does not remember the process that started this one); none where the system does not tell.
pub(super) fn peak_mb() -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kibibytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kibibytes * 1024.0 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Something that takes processor time and cannot be left out.
    fn work() -> u64 {
        (0..3_000_000_u64).fold(1, |hash, i| std::hint::black_box(hash.wrapping_mul(31) ^ i))
    }

    #[test]
    fn only_what_is_measured_counts() {
        let mut meter = Meter::start();
        let (wall, _) = Meter::inside(work);
        let inside = meter.cpu();
        assert!(wall > Duration::ZERO && inside > Duration::ZERO);
        for _ in 0..20 {
            meter.outside(work);
        }
        // Other tests run in this process at the same time and count, so that there is no upper bound; but what was done
        // outside is known.
        assert!(
            meter.outside > inside / 4,
            "{:?} of {inside:?}",
            meter.outside
        );
    }

    #[test]
    fn memory_that_was_used_is_remembered() {
        let before = peak_mb().expect("Linux tells");
        let block = std::hint::black_box(vec![1_u8; 300_000_000]);
        assert_eq!(block.len(), 300_000_000);
        drop(block);
        let after = peak_mb().expect("Linux tells");
        assert!(after >= 300.0 && after >= before, "{before} then {after}");
    }
}
