//! Barometers: the pressure of the standard atmosphere, noise at every sample, and weather that drifts.
//!
//! ```text
//! p(h) = p₀·(1 - L·h/T₀)^(g·M/(R·L))        T₀ = 288.15 K, L = 6.5 K/km, exponent 5.25588
//! z = p(h) + d(t) + σ·n                      d: first-order Gauss-Markov
//! ```
//!
//! 1 Pa is 8.3 cm at sea level. White noise at the full rate matters: without it a filter believes its vertical speed
//! far too much (PX4-Autopilot #24358). The drift is mostly weather: 30 Pa over an hour is what fronts bring. Valid up
//! to 11 km; above 44.3 km the pressure is taken as zero.
//!
//! A height of NaN gives a pressure of NaN, an infinite one none or an infinite one, once.
//!
//! - *U.S. Standard Atmosphere, 1976*, NOAA-S/T 76-1562, Eq. (33a).
//! - TE Connectivity, *MS5611-01BA03* data sheet: resolution 0.012 mbar RMS at an oversampling ratio of 4096.
//! - `AirSim`, *Barometer* settings: white noise of 2.7 Pa at 50 Hz, drift over 3600 s.

use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::process::Wander;
use crate::vehicle::gnss::gaussian;

/// Pressure at sea level in the standard atmosphere.
pub const SEA_LEVEL_PA: f64 = 101_325.0;
const SEA_LEVEL_K: f64 = 288.15;
const LAPSE_K_PER_M: f64 = 0.0065;
const EXPONENT: f64 = 5.255_88;

/// The pressure at a height above sea level, in pascal.
pub fn pressure_pa(altitude_m: f64, sea_level_pa: f64) -> f64 {
    let share = 1.0 - LAPSE_K_PER_M * altitude_m / SEA_LEVEL_K;
    // Not `max`, which would turn NaN into a number.
    if share <= 0.0 {
        return 0.0;
    }
    sea_level_pa * share.powf(EXPONENT)
}

/// The height above sea level at which the pressure is this: undoes [`pressure_pa`].
pub fn altitude_m(pressure_pa: f64, sea_level_pa: f64) -> f64 {
    (1.0 - (pressure_pa / sea_level_pa).powf(1.0 / EXPONENT)) * SEA_LEVEL_K / LAPSE_K_PER_M
}

/// The errors of a barometer, and the weather.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BarometerModel {
    /// The true pressure at sea level on average.
    pub sea_level_pa: f64,
    /// Standard deviation of the white noise of each sample.
    pub white_pa: f64,
    /// Standard deviation of the drift.
    pub drift_pa: f64,
    /// How long the drift takes to forget itself.
    pub drift_correlation_s: f64,
}

impl BarometerModel {
    /// TE MS5611 in still air, at its highest resolution.
    pub const MS5611: Self = Self {
        sea_level_pa: SEA_LEVEL_PA,
        white_pa: 1.2,
        drift_pa: 30.0,
        drift_correlation_s: 3600.0,
    };

    /// The same on a quadrotor, where the wash of the propellers reaches it.
    pub const MS5611_IN_WASH: Self = Self {
        white_pa: 2.7,
        ..Self::MS5611
    };
}

/// A barometer and the present state of the weather.
#[derive(Clone, Debug)]
pub struct Barometer {
    model: BarometerModel,
    drift: Wander,
    random: Pcg64,
}

impl Barometer {
    /// A barometer whose drift is already what it is on average.
    pub fn new(model: BarometerModel, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let drift = Wander::new(model.drift_correlation_s, &mut random);
        Self {
            model,
            drift,
            random,
        }
    }

    /// Lets the weather go on for `dt` seconds, the time since the last sample, and measures the pressure in pascal at
    /// a true height above sea level. A `dt` that is not positive and finite moves nothing.
    pub fn measure(&mut self, altitude_m: f64, dt: f64) -> f64 {
        let drift = self.model.drift_pa * self.drift.step(dt, &mut self.random);
        let white = self.model.white_pa * gaussian(&mut self.random);
        pressure_pa(altitude_m, self.model.sea_level_pa) + drift + white
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::process::statistics::{check_recovered, correlation, spread};

    #[test]
    fn tabulated_heights_have_their_tabulated_pressures() {
        // U.S. Standard Atmosphere, table I: geopotential height in metres, pressure in pascal.
        for (altitude, expected) in [
            (0.0, 101_325.0),
            (1000.0, 89_874.6),
            (5000.0, 54_019.9),
            (11_000.0, 22_632.1),
        ] {
            let found = pressure_pa(altitude, SEA_LEVEL_PA);
            assert!((found - expected).abs() < 0.5, "{found} Pa at {altitude} m");
            let back = altitude_m(found, SEA_LEVEL_PA);
            assert!((back - altitude).abs() < 1e-6, "{back} m");
        }
    }

    #[test]
    fn a_metre_is_twelve_pascal() {
        let metre = pressure_pa(60.0, SEA_LEVEL_PA) - pressure_pa(61.0, SEA_LEVEL_PA);
        assert!((metre - 11.95).abs() < 0.05, "{metre} Pa");
    }

    #[test]
    fn white_noise_and_drift_are_those_of_the_model() {
        let model = BarometerModel::MS5611_IN_WASH;
        let mut barometer = Barometer::new(model, 1);
        let fast: Vec<f64> = (0..50_000).map(|_| barometer.measure(0.0, 0.02)).collect();
        let steps: Vec<f64> = fast.windows(2).map(|w| w[1] - w[0]).collect();
        // Over 20 ms the drift moves by 0.1 Pa at most: steps are two whites.
        let white = spread(&steps) / 2_f64.sqrt();
        println!("white {white} Pa");
        check_recovered("white", white, model.white_pa, 0.02);

        // 139 days: 3,300 correlation times, 2 % at one standard deviation.
        let slow: Vec<f64> = (0..200_000).map(|_| barometer.measure(0.0, 60.0)).collect();
        let drift = (spread(&slow).powi(2) - model.white_pa.powi(2)).sqrt();
        println!("drift {drift} Pa");
        check_recovered("drift", drift, model.drift_pa, 0.06);
        check_recovered("kept", correlation(&slow, 60), (-1.0_f64).exp(), 0.15);
    }

    #[test]
    fn nan_spoils_one_sample_and_no_height_panics() {
        let mut spoilt = Barometer::new(BarometerModel::MS5611, 1);
        let mut clean = spoilt.clone();
        assert!(spoilt.measure(f64::NAN, 0.02).is_nan());
        clean.measure(0.0, 0.02);
        let same = spoilt.measure(10.0, 0.02).to_bits() == clean.measure(10.0, 0.02).to_bits();
        assert!(same, "as if nothing had been");
        assert!(spoilt.measure(10.0, f64::NAN).is_finite());
        assert!(spoilt.measure(1e9, 0.02).abs() < 1000.0, "no air");
        assert!(spoilt.measure(f64::NEG_INFINITY, 0.02).is_infinite());
    }

    #[test]
    fn the_same_seed_gives_the_same_bits_and_another_does_not() {
        let run = |seed| {
            let mut barometer = Barometer::new(BarometerModel::MS5611, seed);
            [(); 20].map(|()| barometer.measure(60.0, 0.02).to_bits())
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
    }
}
