//! The clock of a platform: it was started at another time, runs a little fast or slow, and its rate wanders.
//!
//! ```text
//! c(t) = c₀ + ∫ (1 + f(s)) ds        f(t + 1 s) = f(t) + w·n        (random-walk frequency noise)
//! ```
//!
//! The rate is held for a second of true time; within it the clock is linear. So a clock is a function of true time
//! alone, however often and in whatever order it is read, it never goes back, and it can be turned around.
//!
//! - W. J. Riley, *Handbook of Frequency Stability Analysis*, NIST SP 1065, 2008, ch. 3: power-law clock noise; random
//!   walk of frequency is what temperature does to a free crystal.
//! - Raspberry Pi Stack Exchange 74482: a board's crystal wanders by 6 ppm over a day in an office, and a
//!   temperature-compensated one by a hundredth of that.

use std::time::Duration;

use maps::time::Stamp;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use crate::vehicle::gnss::gaussian;

const SECOND_NS: u64 = 1_000_000_000;
/// A clock is never faster or slower than by this share, whatever its model says: it must not stand still.
const MOST_OFF: f64 = 0.1;
/// Longer runs go on at their last rate: 12 days.
const LONGEST_S: u64 = 1_000_000;

/// How good a clock is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockModel {
    /// What it shows at the start of true time.
    pub start: Stamp,
    /// How much it is too fast at first, in millionths.
    pub drift_ppm: f64,
    /// How much that wanders, in millionths per √s.
    pub wander_ppm_per_rts: f64,
}

impl ClockModel {
    /// The truth.
    pub const IDEAL: Self = Self {
        start: Stamp::ZERO,
        drift_ppm: 0.0,
        wander_ppm_per_rts: 0.0,
    };

    /// A companion computer's crystal: cut to 20 ppm, 3 ppm a day by temperature.
    pub const CRYSTAL: Self = Self {
        drift_ppm: 20.0,
        wander_ppm_per_rts: 0.01,
        ..Self::IDEAL
    };

    /// A temperature-compensated crystal, as in receivers and better boards.
    pub const TEMPERATURE_COMPENSATED: Self = Self {
        drift_ppm: 1.0,
        wander_ppm_per_rts: 0.0001,
        ..Self::IDEAL
    };
}

/// A clock.
#[derive(Clone, Debug)]
pub struct PlatformClock {
    /// What it shows, in nanoseconds, at each whole second of true time. Never fewer than two, ever increasing.
    shows_ns: Vec<u64>,
}

impl PlatformClock {
    /// A clock whose rate wanders for that long, at most 12 days; afterwards it keeps its last rate.
    pub fn new(model: ClockModel, seed: u64, lasts: Duration) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut off = model.drift_ppm * 1e-6;
        let mut shows = model.start.as_nanos();
        let mut shows_ns = vec![shows];
        for _ in 0..=lasts.as_secs().min(LONGEST_S) {
            // NaN becomes 0 ns in the conversion, and the slowest clock there is.
            let second = ((1.0 + off) * SECOND_NS as f64).round() as u64;
            let slowest = ((1.0 - MOST_OFF) * SECOND_NS as f64) as u64;
            let fastest = ((1.0 + MOST_OFF) * SECOND_NS as f64) as u64;
            shows = shows.saturating_add(second.clamp(slowest, fastest));
            shows_ns.push(shows);
            off += model.wander_ppm_per_rts * 1e-6 * gaussian(&mut random);
        }
        Self { shows_ns }
    }

    /// What it shows at a true time. Never less than at an earlier one.
    pub fn shows(&self, truth: Stamp) -> Stamp {
        let second = self.second_of(truth.as_nanos() / SECOND_NS);
        let (shown, length) = self.second(second);
        let past = truth.as_nanos() - second as u64 * SECOND_NS;
        let shown = u128::from(shown) + scaled(past, length, SECOND_NS);
        Stamp::from_nanos(u64::try_from(shown).unwrap_or(u64::MAX))
    }

    /// The first true time at which it shows that, to 1 ns; the start of true time, if that was before.
    pub fn truth(&self, shown: Stamp) -> Stamp {
        let shown = shown.as_nanos();
        let after = self.shows_ns.partition_point(|&ns| ns <= shown);
        let second = self.second_of(after.saturating_sub(1) as u64);
        let (start, length) = self.second(second);
        let past = shown.saturating_sub(start);
        // Rounded up, as `shows` rounds down: the first moment that is not too early.
        let past = (u128::from(past) * u128::from(SECOND_NS)).div_ceil(u128::from(length));
        let truth = second as u128 * u128::from(SECOND_NS) + past;
        Stamp::from_nanos(u64::try_from(truth).unwrap_or(u64::MAX))
    }

    /// How much it is too fast at a true time, in millionths.
    pub fn drift_ppm(&self, truth: Stamp) -> f64 {
        let (_, length) = self.second(self.second_of(truth.as_nanos() / SECOND_NS));
        (length as f64 / SECOND_NS as f64 - 1.0) * 1e6
    }

    /// The number of a second that is known: the last stands for all after it.
    fn second_of(&self, second: u64) -> usize {
        let last = self.shows_ns.len() - 2;
        usize::try_from(second).map_or(last, |second| second.min(last))
    }

    /// What it shows at the start of that second, and how long that second is on it, in nanoseconds.
    fn second(&self, second: usize) -> (u64, u64) {
        let (start, end) = (self.shows_ns[second], self.shows_ns[second + 1]);
        // Never zero, even where the clock is at the end of all stamps.
        (start, (end - start).max(1))
    }
}

/// `value * by / of`, rounded down. Never overflows.
fn scaled(value: u64, by: u64, of: u64) -> u128 {
    u128::from(value) * u128::from(by) / u128::from(of)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::sensor::process::statistics::{check_recovered, spread};

    const HOUR: Duration = Duration::from_hours(1);

    fn clock(seed: u64) -> PlatformClock {
        let model = ClockModel {
            start: Stamp::from_nanos(77_123_456_789),
            ..ClockModel::CRYSTAL
        };
        PlatformClock::new(model, seed, HOUR)
    }

    proptest! {
        #[test]
        fn it_never_goes_back_and_can_be_turned_around(
            seed in 0..20_u64, a in 0..7_200_000_000_000_u64, step in 0..3_000_000_000_u64,
        ) {
            // Both within the hour that wanders and after it.
            let (clock, early, late) = (clock(seed), Stamp::from_nanos(a), Stamp::from_nanos(a + step));
            prop_assert!(clock.shows(early) <= clock.shows(late));
            let back = clock.truth(clock.shows(early));
            prop_assert!(back.distance(early) <= Duration::from_nanos(1), "{back} for {early}");
            let shown = clock.shows(early);
            let again = clock.shows(clock.truth(shown));
            prop_assert!(again.distance(shown) <= Duration::from_nanos(1), "{again} for {shown}");
        }
    }

    #[test]
    fn it_starts_where_the_model_says_and_drifts_as_much() {
        let model = ClockModel {
            start: Stamp::from_nanos(5_000_000_000),
            drift_ppm: -35.0,
            wander_ppm_per_rts: 0.0,
        };
        let clock = PlatformClock::new(model, 1, HOUR);
        assert_eq!(clock.shows(Stamp::ZERO), model.start);
        let end = Stamp::ZERO + HOUR;
        let passed = clock.shows(end).since(model.start);
        // 35 millionths of an hour.
        assert_eq!(passed + Duration::from_millis(126), HOUR);
        assert!((clock.drift_ppm(end) + 35.0).abs() < 1e-3);
    }

    #[test]
    fn the_rate_wanders_as_much_as_the_model_says() {
        let end = Stamp::ZERO + Duration::from_secs(1000);
        let rates: Vec<f64> = (0..2000)
            .map(|seed| {
                let lasts = Duration::from_secs(1000);
                PlatformClock::new(ClockModel::CRYSTAL, seed, lasts).drift_ppm(end)
            })
            .collect();
        // 2,000 clocks: 1.6 % at one standard deviation; rates are rounded to a thousandth of a millionth.
        let expected = ClockModel::CRYSTAL.wander_ppm_per_rts * 1000_f64.sqrt();
        println!("wander {} ppm, expected {expected} ppm", spread(&rates));
        check_recovered("wander", spread(&rates), expected, 0.06);
    }

    #[test]
    fn an_ideal_clock_shows_the_truth() {
        let clock = PlatformClock::new(ClockModel::IDEAL, 1, HOUR);
        for ns in [0, 1, 999_999_999, 1_000_000_000, 12_345_678_901_234_567] {
            let truth = Stamp::from_nanos(ns);
            assert_eq!(clock.shows(truth), truth);
            assert_eq!(clock.truth(truth), truth);
        }
    }

    #[test]
    fn before_it_was_started_it_is_the_start_and_at_the_end_of_time_it_stays() {
        let clock = clock(1);
        assert_eq!(clock.truth(Stamp::ZERO), Stamp::ZERO);
        let end = Stamp::from_nanos(u64::MAX);
        assert_eq!(clock.shows(end), end);
        let late = ClockModel {
            start: end,
            ..ClockModel::CRYSTAL
        };
        assert_eq!(PlatformClock::new(late, 1, HOUR).shows(end), end);
    }

    #[test]
    fn a_model_that_is_no_number_still_gives_a_clock_that_runs() {
        for drift_ppm in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e9] {
            let model = ClockModel {
                drift_ppm,
                ..ClockModel::IDEAL
            };
            let clock = PlatformClock::new(model, 1, HOUR);
            let [a, b] = [1, 2].map(|s| clock.shows(Stamp::ZERO + Duration::from_secs(s)));
            assert!(b > a, "{drift_ppm} ppm");
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_clock() {
        assert_eq!(clock(1).shows_ns, clock(1).shows_ns);
        assert_ne!(clock(1).shows_ns, clock(2).shows_ns);
    }
}
