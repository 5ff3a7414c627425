//! The Allan deviation: how much the averages of a sensor over neighbouring spans differ, for spans of every length.
//!
//! With `θ` the sum of the samples times their interval, the overlapping estimate at `τ = m·τ₀` is
//!
//! ```text
//! σ²(τ) = 1 / (2τ²(N - 2m)) · Σ (θ(k+2m) - 2θ(k+m) + θ(k))²        k = 0 .. N - 2m
//! ```
//!
//! It tells kinds of noise apart by their slopes on logarithmic axes:
//!
//! ```text
//! white noise (angle random walk)   N/√τ         slope -1/2, N is the value at τ = 1 s
//! bias instability                  0.664·B      slope 0
//! rate random walk                  K·√(τ/3)     slope +1/2
//! Gauss-Markov of σ, T              at most 0.618·σ, at τ = 1.89·T
//! ```
//!
//! - IEEE Std 952-1997 (R2008), *IEEE Standard Specification Format Guide and Test Procedure for Single-Axis
//!   Interferometric Fiber Optic Gyros*, Annex C.
//! - W. J. Riley, *Handbook of Frequency Stability Analysis*, NIST SP 1065, 2008, §5.2 (overlapping), §12 (test data).

/// One point of an Allan curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AllanPoint {
    /// The span averaged over.
    pub tau_s: f64,
    /// The deviation, in the unit of the samples.
    pub deviation: f64,
}

/// The overlapping Allan deviations of evenly spaced samples, at about `per_octave` spans for each doubling, from one
/// sample to a ninth of the record. Longer spans have fewer than eight independent pairs and mean little.
///
/// Empty if there are fewer than nine samples, if one of them is not finite, or if the interval is not positive.
/// Takes time in proportion to samples and points.
pub fn curve(samples: &[f64], interval_s: f64, per_octave: u32) -> Vec<AllanPoint> {
    let valid = interval_s > 0.0 && interval_s.is_finite();
    if !valid || samples.iter().any(|s| !s.is_finite()) {
        return Vec::new();
    }
    let angles = integrated(samples, interval_s);
    spans(samples.len() / 9, per_octave)
        .into_iter()
        .map(|span| {
            let tau_s = span as f64 * interval_s;
            AllanPoint {
                tau_s,
                deviation: deviation(&angles, span, tau_s),
            }
        })
        .collect()
}

/// The sum of the samples times their interval, from zero. Their mean is taken off first, which changes no deviation
/// but keeps digits: a bias of hours would swamp the noise.
fn integrated(samples: &[f64], interval_s: f64) -> Vec<f64> {
    let mean = samples.iter().sum::<f64>() / samples.len().max(1) as f64;
    let mut angle = 0.0;
    std::iter::once(0.0)
        .chain(samples.iter().map(|sample| {
            angle += (sample - mean) * interval_s;
            angle
        }))
        .collect()
}

/// The equation above, over all overlapping triples.
fn deviation(angles: &[f64], span: usize, tau_s: f64) -> f64 {
    let triples = angles.len() - 2 * span;
    let squares: f64 = (0..triples)
        .map(|k| (angles[k + 2 * span] - 2.0 * angles[k + span] + angles[k]).powi(2))
        .sum();
    (squares / (2.0 * tau_s * tau_s * triples as f64)).sqrt()
}

/// Whole numbers from 1 to `largest`, about evenly spaced on a logarithmic axis.
fn spans(largest: usize, per_octave: u32) -> Vec<usize> {
    let mut spans = Vec::new();
    for step in 0.. {
        let span = 2_f64
            .powf(f64::from(step) / f64::from(per_octave.max(1)))
            .round() as usize;
        if span > largest {
            break;
        }
        if spans.last() != Some(&span) {
            spans.push(span);
        }
    }
    spans
}

/// The lowest point of a curve: what data sheets call bias instability or in-run bias stability.
pub fn floor(curve: &[AllanPoint]) -> Option<AllanPoint> {
    curve
        .iter()
        .copied()
        .min_by(|a, b| a.deviation.total_cmp(&b.deviation))
}

/// The slope on logarithmic axes over the points with `from_s <= τ <= to_s`, by least squares. `None` with fewer than
/// two points or where a deviation is zero.
pub fn slope(curve: &[AllanPoint], from_s: f64, to_s: f64) -> Option<f64> {
    let points: Vec<(f64, f64)> = within(curve, from_s, to_s)
        .map(|p| (p.tau_s.ln(), p.deviation.ln()))
        .collect();
    let count = points.len() as f64;
    let (x, y) = points
        .iter()
        .fold((0.0, 0.0), |(x, y), p| (x + p.0 / count, y + p.1 / count));
    let (across, along) = points.iter().fold((0.0, 0.0), |(across, along), p| {
        (
            across + (p.0 - x) * (p.1 - y),
            along + (p.0 - x) * (p.0 - x),
        )
    });
    let slope = across / along;
    slope.is_finite().then_some(slope)
}

/// The density of white noise, in units per √Hz: the geometric mean of `σ(τ)·√τ` over the points with
/// `from_s <= τ <= to_s`, which should be those where the slope is -1/2. `None` without such points.
pub fn white_noise_density(curve: &[AllanPoint], from_s: f64, to_s: f64) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for point in within(curve, from_s, to_s) {
        sum += (point.deviation * point.tau_s.sqrt()).ln();
        count += 1.0;
    }
    (count > 0.0).then(|| (sum / count).exp())
}

fn within(curve: &[AllanPoint], from_s: f64, to_s: f64) -> impl Iterator<Item = &AllanPoint> {
    curve
        .iter()
        .filter(move |p| p.tau_s >= from_s && p.tau_s <= to_s)
}

/// What a first-order Gauss-Markov error of standard deviation `spread` contributes at `tau_s`: always at
/// most [`GAUSS_MARKOV_PEAK`] times `spread`.
pub fn gauss_markov(spread: f64, correlation_s: f64, tau_s: f64) -> f64 {
    let ratio = correlation_s / tau_s;
    let (once, twice) = ((-1.0 / ratio).exp(), (-2.0 / ratio).exp());
    let share = 2.0 * ratio * (1.0 - 0.5 * ratio * (3.0 - 4.0 * once + twice));
    spread * share.max(0.0).sqrt()
}

/// The largest Allan deviation of a Gauss-Markov error of unit variance, reached at 1.89 correlation times.
pub const GAUSS_MARKOV_PEAK: f64 = 0.618;

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;
    use rand_pcg::Pcg64;

    use super::*;
    use crate::sensor::process::statistics::check_recovered;
    use crate::vehicle::gnss::gaussian;

    /// The test data of NIST SP 1065, §12: 1,000 numbers of a linear congruence, averaged over 1, 10 and 100.
    #[test]
    fn the_reference_values_of_nist_come_out() {
        let mut n: u64 = 1_234_567_890;
        let samples: Vec<f64> = std::iter::repeat_with(|| {
            let sample = n as f64 / 2_147_483_647.0;
            n = 16_807 * n % 2_147_483_647;
            sample
        })
        .take(1000)
        .collect();
        let angles = integrated(&samples, 1.0);
        for (span, expected) in [(1, 2.922_319e-1), (10, 9.159_953e-2), (100, 3.241_343e-2)] {
            let found = deviation(&angles, span, span as f64);
            // All seven digits that are printed there.
            assert!((found / expected - 1.0).abs() < 2e-7, "{found} over {span}");
        }
    }

    #[test]
    fn a_ramp_has_the_deviation_of_its_slope() {
        // Averages of a ramp R·t over neighbouring spans differ by R·τ: σ = R·τ/√2.
        let samples: Vec<f64> = (0..1000).map(|i| 0.3 * f64::from(i)).collect();
        for point in curve(&samples, 1.0, 2) {
            let expected = 0.3 * point.tau_s / 2_f64.sqrt();
            assert!((point.deviation / expected - 1.0).abs() < 1e-9, "{point:?}");
        }
    }

    #[test]
    fn white_noise_falls_with_the_root_of_time_and_gives_its_density() {
        let mut random = Pcg64::seed_from_u64(3);
        // 0.02 per √Hz at 100 Hz.
        let samples: Vec<f64> = (0..400_000).map(|_| 0.2 * gaussian(&mut random)).collect();
        let curve = curve(&samples, 0.01, 3);
        let found = slope(&curve, 0.0, 40.0).expect("points");
        assert!((found + 0.5).abs() < 0.02, "slope {found}");
        let density = white_noise_density(&curve, 0.1, 10.0).expect("points");
        check_recovered("density", density, 0.02, 0.02);
    }

    #[test]
    fn the_peak_of_gauss_markov_noise_is_where_the_standard_says() {
        let peak = (1..1000)
            .map(|i| gauss_markov(1.0, 100.0, f64::from(i)))
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .expect("values");
        assert_eq!(peak.0 + 1, 189, "spans of a second, times of 100 s");
        assert!((peak.1 - GAUSS_MARKOV_PEAK).abs() < 1e-3, "{}", peak.1);
    }

    #[test]
    fn too_little_or_spoilt_data_has_no_curve() {
        assert!(curve(&[], 1.0, 1).is_empty());
        assert!(curve(&[1.0; 8], 1.0, 1).is_empty());
        assert!(curve(&[f64::NAN; 100], 1.0, 1).is_empty());
        for interval_s in [0.0, -1.0, f64::NAN] {
            assert!(curve(&[1.0; 100], interval_s, 1).is_empty());
        }
        assert_eq!(floor(&[]), None);
        assert_eq!(slope(&[], 0.0, 1.0), None);
        assert_eq!(white_noise_density(&[], 0.0, 1.0), None);
        let still = curve(&[1.0; 100], 1.0, 1);
        assert_eq!(slope(&still, 0.0, 100.0), None, "a logarithm of zero");
    }
}
