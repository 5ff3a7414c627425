//! How long something takes, as quantiles in constant memory.
//!
//! Durations are counted in bins of 0.1 ms up to 2 s; longer ones share the last bin, where the longest seen stands
//! for all of them.

use std::time::Duration;

const BIN: Duration = Duration::from_micros(100);
const BINS: usize = 20_000;

/// Counts of durations.
#[derive(Clone, Debug)]
pub struct Histogram {
    counts: Vec<u32>,
    total: u64,
    longest: Duration,
    sum: Duration,
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            counts: vec![0; BINS],
            total: 0,
            longest: Duration::ZERO,
            sum: Duration::ZERO,
        }
    }
}

impl Histogram {
    /// Counts one.
    pub fn add(&mut self, duration: Duration) {
        let bin = (duration.as_nanos() / BIN.as_nanos()).min(BINS as u128 - 1) as usize;
        self.counts[bin] = self.counts[bin].saturating_add(1);
        self.total += 1;
        self.longest = self.longest.max(duration);
        self.sum += duration;
    }

    /// All of them together.
    pub fn sum(&self) -> Duration {
        self.sum
    }

    /// The duration that a share `q` (0 to 1) of those counted do not exceed, rounded up to the bin; `None` before the
    /// first.
    pub fn quantile(&self, q: f64) -> Option<Duration> {
        let rank = (q * self.total as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        for (bin, &count) in self.counts.iter().enumerate() {
            seen += u64::from(count);
            if seen >= rank {
                let end = BIN * (bin as u32 + 1);
                let last = bin + 1 == BINS;
                return Some(if last {
                    self.longest
                } else {
                    end.min(self.longest)
                });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_exact_to_a_bin() {
        let mut histogram = Histogram::default();
        assert_eq!(histogram.quantile(0.5), None);
        for ms in 1..=100 {
            histogram.add(Duration::from_millis(ms));
        }
        for (q, ms) in [(0.0, 1), (0.5, 50), (0.99, 99), (1.0, 100)] {
            let found = histogram.quantile(q).expect("counted");
            let expected = Duration::from_millis(ms);
            assert!(
                found >= expected && found <= expected + BIN,
                "{q}: {found:?}"
            );
        }
        assert_eq!(histogram.sum(), Duration::from_millis(5050));
    }

    #[test]
    fn what_takes_very_long_is_told_as_it_was() {
        let mut histogram = Histogram::default();
        histogram.add(Duration::from_secs(30));
        assert_eq!(histogram.quantile(0.99), Some(Duration::from_secs(30)));
    }
}
