//! The random processes that sensor errors are made of.
//!
//! ```text
//! b(t + dt) = b(t)·exp(-dt/T) + σ·√(1 - exp(-2dt/T))·n        (first-order Gauss-Markov, exact for any dt)
//! ```
//!
//! - R. G. Brown, P. Y. C. Hwang, *Introduction to Random Signals and Applied Kalman Filtering*, 4th ed., §9.3.

use rand::{Rng, RngExt as _};

use crate::vehicle::gnss::gaussian;

/// An error that wanders about zero with unit variance and forgets itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wander {
    correlation_s: f64,
    value: f64,
}

impl Wander {
    /// One that is already what it is on average.
    pub(super) fn new(correlation_s: f64, random: &mut impl Rng) -> Self {
        Self {
            correlation_s,
            value: gaussian(random),
        }
    }

    /// Its value `dt` seconds later; see [`usable_step`].
    pub(super) fn step(&mut self, dt: f64, random: &mut impl Rng) -> f64 {
        let noise = gaussian(random);
        let dt = usable_step(dt);
        if dt > 0.0 {
            let keep = (-dt / self.correlation_s).exp();
            self.value = self.value * keep + (1.0 - keep * keep).sqrt() * noise;
        }
        self.value
    }
}

/// A step in seconds; one that is not positive and finite counts as none at all.
pub(super) fn usable_step(dt: f64) -> f64 {
    if dt > 0.0 && dt.is_finite() { dt } else { 0.0 }
}

/// Whether something of this probability happens. Always draws once, and NaN never happens.
pub(super) fn happens(probability: f64, random: &mut impl Rng) -> bool {
    random.random::<f64>() < probability
}

/// `value` within `-limit..=limit`; NaN stays NaN, and no limit panics.
pub(super) fn limited(value: f64, limit: f64) -> f64 {
    if value > limit {
        limit
    } else if value < -limit {
        -limit
    } else {
        value
    }
}

/// Measures of samples, for the tests of all sensors.
#[cfg(test)]
pub(super) mod statistics {
    pub(crate) fn mean(samples: &[f64]) -> f64 {
        samples.iter().sum::<f64>() / samples.len() as f64
    }

    /// The standard deviation.
    pub(crate) fn spread(samples: &[f64]) -> f64 {
        let middle = mean(samples);
        let squares: Vec<f64> = samples.iter().map(|s| (s - middle).powi(2)).collect();
        mean(&squares).sqrt()
    }

    /// How much of it is left `lag` samples later.
    pub(crate) fn correlation(samples: &[f64], lag: usize) -> f64 {
        let middle = mean(samples);
        let products: Vec<f64> = samples
            .iter()
            .zip(&samples[lag..])
            .map(|(a, b)| (a - middle) * (b - middle))
            .collect();
        mean(&products) / spread(samples).powi(2)
    }

    /// Panics unless `measured` is within this share of what was `configured`.
    #[track_caller]
    pub(crate) fn check_recovered(what: &str, measured: f64, configured: f64, tolerance: f64) {
        assert!(
            (measured / configured - 1.0).abs() <= tolerance,
            "{what}: measured {measured:e}, configured {configured:e}, off by {:.1} %",
            100.0 * (measured / configured - 1.0)
        );
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;
    use rand_pcg::Pcg64;

    use super::statistics::{check_recovered, correlation, spread};
    use super::*;

    #[test]
    fn a_wandering_error_has_unit_variance_and_its_correlation_time_at_any_step() {
        for dt in [1.0, 7.0] {
            let mut random = Pcg64::seed_from_u64(1);
            let mut wander = Wander::new(21.0, &mut random);
            let values: Vec<f64> = (0..200_000).map(|_| wander.step(dt, &mut random)).collect();
            // 200,000 s hold 4,800 independent values: 1 % at one standard deviation.
            check_recovered("spread", spread(&values), 1.0, 0.04);
            let kept = correlation(&values, (21.0 / dt) as usize);
            check_recovered("kept", kept, (-1.0_f64).exp(), 0.1);
        }
    }

    #[test]
    fn a_step_that_is_no_time_changes_nothing() {
        let mut random = Pcg64::seed_from_u64(1);
        let mut wander = Wander::new(10.0, &mut random);
        let before = wander.value;
        for dt in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
            assert_eq!(
                wander.step(dt, &mut random).to_bits(),
                before.to_bits(),
                "{dt} s"
            );
        }
        assert!(wander.step(1.0, &mut random).is_finite());
    }

    #[test]
    fn a_limit_cuts_numbers_and_leaves_nan() {
        assert!((limited(5.0, 2.0) - 2.0).abs() < 1e-12);
        assert!((limited(-5.0, 2.0) + 2.0).abs() < 1e-12);
        assert!(limited(f64::NAN, 2.0).is_nan());
        assert!((limited(5.0, f64::NAN) - 5.0).abs() < 1e-12);
    }
}
