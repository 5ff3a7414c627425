//! The normal distribution.

/// The probability that a standard normal value lies between `low` and `high`, to 2·10⁻⁷.
pub(crate) fn share_within(low: f64, high: f64) -> f64 {
    (cumulative(high) - cumulative(low)).max(0.0)
}

/// Φ, with the rational approximation 7.1.26 of M. Abramowitz and I. Stegun, *Handbook of Mathematical Functions*, 1964.
fn cumulative(x: f64) -> f64 {
    let z = x.abs() * std::f64::consts::FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let series = t
        * (0.254_829_592
            + t * (-0.284_496_736
                + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    let upper = 0.5 * series * (-z * z).exp();
    if x < 0.0 { upper } else { 1.0 - upper }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_those_of_the_tables() {
        for (deviations, share) in [(1.0, 0.682_689), (2.0, 0.954_500), (3.0, 0.997_300)] {
            assert!(
                (share_within(-deviations, deviations) - share).abs() < 1e-6,
                "{deviations}"
            );
        }
        let all = share_within(f64::NEG_INFINITY, f64::INFINITY);
        assert!((all - 1.0).abs() < 1e-12, "{all}");
    }
}
