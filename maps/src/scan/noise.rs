//! How much a scan says of a place, given how far its points may be off.
//!
//! ```text
//! σ(r) = a + b r²                          along the ray, a from the sensor's data sheet, b from its stereo base
//! q    = erf(w / (2√2 σ))                  the chance that a point measured in the middle of a voxel is of that voxel
//! Δhit = log(p / (1 - p))   p = 0.5 + (0.7 - 0.5) q
//! ```
//!
//! What lies within 2σ before the end of a ray is neither free nor occupied: the surface may as well be there.

use crate::voxel::LogOdds;

/// The standard deviation of a range: constant, and growing with its square as that of stereo and RGB-D cameras does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// At any range.
    pub constant_m: f64,
    /// Added for each square metre of squared range.
    pub per_m2: f64,
}

/// What a hit and a miss add to a voxel, in steps of [`LogOdds`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Weights {
    pub(super) hit: i8,
    pub(super) miss: i8,
}

impl Weights {
    pub(super) const FULL: Self = Self {
        hit: LogOdds::HIT.0,
        miss: LogOdds::MISS.0,
    };
}

impl Noise {
    /// Points are where they were measured.
    pub const NONE: Self = Self {
        constant_m: 0.0,
        per_m2: 0.0,
    };
    /// This many standard deviations before its end a ray says nothing.
    const MARGIN: f64 = 2.0;

    /// The standard deviation at a range, in metres; 0 if it makes no sense.
    pub fn sigma_m(&self, range_m: f64) -> f64 {
        let sigma = self.constant_m + self.per_m2 * range_m * range_m;
        if sigma > 0.0 { sigma } else { 0.0 }
    }

    /// How long before its end a ray of this length stops being free.
    pub(super) fn margin_m(&self, range_m: f64) -> f64 {
        Self::MARGIN * self.sigma_m(range_m)
    }

    /// What hits and misses at this range are worth. A miss is worth its full weight: it is outside of the margin.
    pub(super) fn weights(&self, range_m: f64, edge_m: f64) -> Weights {
        let sigma = self.sigma_m(range_m);
        if sigma == 0.0 {
            return Weights::FULL;
        }
        let inside = erf(edge_m / (2.0 * std::f64::consts::SQRT_2 * sigma));
        let best = LogOdds::HIT.probability();
        let p = 0.5 + (best - 0.5) * inside;
        let steps = (p / (1.0 - p)).ln() / LogOdds::STEP;
        Weights {
            hit: (steps.round() as i8).clamp(1, LogOdds::HIT.0),
            ..Weights::FULL
        }
    }
}

/// The error function of a positive number, to 2e-7: Abramowitz and Stegun, *Handbook of Mathematical Functions*, 7.1.26.
fn erf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let terms = [
        1.061_405_429,
        -1.453_152_027,
        1.421_413_741,
        -0.284_496_736,
        0.254_829_592,
    ];
    let sum = terms.iter().fold(0.0, |sum, term| sum * t + term);
    1.0 - sum * t * (-x * x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hit_counts_in_full_without_noise_and_less_the_more_there_is() {
        let hit = |constant_m| {
            let noise = Noise {
                constant_m,
                per_m2: 0.0,
            };
            noise.weights(10.0, 0.1).hit
        };
        assert_eq!(hit(0.0), LogOdds::HIT.0);
        assert_eq!(hit(0.01), LogOdds::HIT.0, "five sigma to each border");
        // One sigma to each border: q = 0.683, p = 0.637, 0.56 = 11 steps.
        assert_eq!(hit(0.05), 11);
        assert_eq!(hit(0.1), 6);
        assert_eq!(hit(100.0), 1, "never nothing");
        assert_eq!(hit(f64::NAN), LogOdds::HIT.0);
        assert!((erf(0.5) - 0.520_499_878).abs() < 2e-7);
    }
}
