//! Time-of-flight rangefinders with one beam: noise that grows with range, echoes that get lost near the end of it, and
//! less range in sunlight.
//!
//! ```text
//! z = round( (1 + s)·r + √(σ₀² + (k·r)²)·n )        s ~ N(0, σ_s²), drawn once
//! P(no echo) = d + (1 - d)·fade(r / r_max)           fade: 0 up to 0.8, 1 from 1.0 on, smooth between
//! ```
//!
//! What the beam meets nearer than the shortest range gives no echo either: the sensor is blinded. A true range that is
//! not finite counts as nothing met.
//!
//! - Benewake, *`TFmini`* data sheet SJ-GU-TFmini-01: 12 m indoors at 90 % reflectivity, 5 m at 10 %, 1 % up to 6 m and
//!   2 % beyond. Its Plus model measures from 0.1 m on. Neither the 7 m in sunlight nor how echoes fade is in it.

use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::process::happens;
use crate::vehicle::gnss::gaussian;

/// From this share of the longest range on, echoes get lost.
const SURE_SHARE: f64 = 0.8;

/// What it can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangefinderModel {
    /// Nothing nearer is measured.
    pub nearest_m: f64,
    /// Nothing farther is measured indoors.
    pub farthest_indoors_m: f64,
    /// Nothing farther is measured in sunlight.
    pub farthest_outdoors_m: f64,
    /// Standard deviation of the noise at no distance.
    pub noise_m: f64,
    /// What noise grows by, as a share of the range.
    pub noise_share: f64,
    /// Standard deviation of the error of scale, as a share.
    pub scale_error: f64,
    /// Probability that an echo is lost at any range.
    pub dropout: f64,
    /// Ranges are reported in whole multiples of this.
    pub resolution_m: f64,
}

impl RangefinderModel {
    /// Benewake `TFmini` Plus, which sends whole centimetres. Its accuracy of 1 % is taken half as noise, half as
    /// scale.
    pub const TFMINI_PLUS: Self = Self {
        nearest_m: 0.1,
        farthest_indoors_m: 12.0,
        farthest_outdoors_m: 7.0,
        noise_m: 0.01,
        noise_share: 0.005,
        scale_error: 0.005,
        dropout: 0.002,
        resolution_m: 0.01,
    };
}

/// How much light there is beside its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    /// Rooms, clouds and night.
    Indoors,
    /// Sunlight on what the beam meets.
    Outdoors,
}

/// A rangefinder.
#[derive(Clone, Debug)]
pub struct Rangefinder {
    model: RangefinderModel,
    gain: f64,
    random: Pcg64,
}

impl Rangefinder {
    /// One of that model, with its own error of scale.
    pub fn new(model: RangefinderModel, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let gain = 1.0 + model.scale_error * gaussian(&mut random);
        Self {
            model,
            gain,
            random,
        }
    }

    /// Measures the true distance in metres to what the beam meets, `None` if it meets nothing; answers `None` if no
    /// echo comes back.
    pub fn measure(&mut self, true_range_m: Option<f64>, light: Light) -> Option<f64> {
        // Drawn even if there is no echo, so that what comes later does not depend on it.
        let noise = gaussian(&mut self.random);
        let range = true_range_m.filter(|r| r.is_finite());
        let lost = happens(range.map_or(1.0, |r| self.loss(r, light)), &mut self.random);
        let range = range.filter(|&r| !lost && r >= self.model.nearest_m)?;
        let spread = self.model.noise_m.hypot(self.model.noise_share * range);
        let measured = self.gain * range + spread * noise;
        let steps = (measured / self.model.resolution_m).round();
        Some((steps * self.model.resolution_m).max(0.0))
    }

    /// The probability that no echo comes back from there.
    fn loss(&self, range_m: f64, light: Light) -> f64 {
        let farthest = match light {
            Light::Indoors => self.model.farthest_indoors_m,
            Light::Outdoors => self.model.farthest_outdoors_m,
        };
        let way = ((range_m / farthest - SURE_SHARE) / (1.0 - SURE_SHARE)).clamp(0.0, 1.0);
        let fade = way * way * (3.0 - 2.0 * way);
        self.model.dropout + (1.0 - self.model.dropout) * fade
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::process::statistics::{check_recovered, mean, spread};

    const MODEL: RangefinderModel = RangefinderModel::TFMINI_PLUS;

    fn echoes(range_m: f64, light: Light) -> Vec<f64> {
        let mut sensor = Rangefinder::new(MODEL, 1);
        (0..20_000)
            .filter_map(|_| sensor.measure(Some(range_m), light))
            .collect()
    }

    #[test]
    fn noise_at_each_range_is_that_of_the_model() {
        for range in [1.0, 5.0, 9.0] {
            let seen = echoes(range, Light::Indoors);
            // Rounding to steps of a centimetre adds a twelfth of its square.
            let rounding = MODEL.resolution_m / 12_f64.sqrt();
            let expected = MODEL
                .noise_m
                .hypot(MODEL.noise_share * range)
                .hypot(rounding);
            check_recovered("noise", spread(&seen), expected, 0.03);
            assert!((mean(&seen) / range - 1.0).abs() < 4.0 * MODEL.scale_error);
            let lost = 1.0 - seen.len() as f64 / 20_000.0;
            assert!(
                (lost - MODEL.dropout).abs() < 0.0015,
                "{lost} lost at {range} m"
            );
        }
    }

    #[test]
    fn errors_of_scale_are_those_of_the_model() {
        let gains: Vec<f64> = (0..4000)
            .map(|seed| Rangefinder::new(MODEL, seed).gain)
            .collect();
        check_recovered("scale", spread(&gains), MODEL.scale_error, 0.05);
    }

    #[test]
    fn echoes_get_lost_towards_the_end_of_the_range_and_sooner_in_sunlight() {
        let share = |range, light| echoes(range, light).len() as f64 / 20_000.0;
        // Half way of fading at 0.9 of the range.
        assert!((share(10.8, Light::Indoors) - 0.5).abs() < 0.02);
        assert!((share(6.3, Light::Outdoors) - 0.5).abs() < 0.02);
        assert!(share(12.0, Light::Indoors) < 1e-9, "at the end");
        assert!(share(40.0, Light::Indoors) < 1e-9, "beyond it");
        assert!(share(9.0, Light::Outdoors) < 1e-9, "in sunlight");
        assert!(share(0.05, Light::Indoors) < 1e-9, "too near");
    }

    #[test]
    fn what_is_no_range_gives_no_echo_and_changes_nothing_after_it() {
        for nothing in [None, Some(f64::NAN), Some(f64::INFINITY), Some(-1.0)] {
            let mut spoilt = Rangefinder::new(MODEL, 3);
            let mut clean = spoilt.clone();
            assert_eq!(spoilt.measure(nothing, Light::Indoors), None);
            clean.measure(Some(2.0), Light::Indoors);
            let [a, b] = [&mut spoilt, &mut clean].map(|s| s.measure(Some(2.0), Light::Indoors));
            assert_eq!(a, b, "after {nothing:?}");
        }
    }
}
