//! Gyroscopes and accelerometers whose errors are those that an Allan curve shows, and those that a calibration leaves.
//!
//! Along each axis, with true value `u` and step `dt`,
//!
//! ```text
//! z = sat( (1 + s)·u + b₀ + b(t) + w(t) + N/√dt·n )
//! b: first-order Gauss-Markov, σ = B/0.618, time T       (bias instability: its Allan curve peaks at B, at 1.89·T)
//! w(t + dt) = w(t) + K·√dt·n                              (rate random walk)
//! b₀ ~ N(0, σ₀²), s ~ N(0, σ_s²)                          (drawn once, when it is switched on)
//! ```
//!
//! `N` is the noise density, `B` what data sheets call bias instability or in-run bias stability. A single Gauss-Markov
//! term stands for flicker noise, whose curve is flat; the walk takes over where that term falls. Noise is that of an
//! ideal filter at half the sampling rate, so `dt` must be the time between samples, not a fraction of it.
//!
//! NaN in the truth gives NaN along its axis, once; infinity is beyond the range. A `dt` not positive and finite moves
//! no error and adds no white noise.
//!
//! - IEEE Std 952-1997, Annex C, as in [`super::allan`].
//! - J. Nikolic et al., *IMU Noise Model*, wiki of ethz-asl/kalibr: discrete white noise `N/√dt`, walk `K·√dt`.
//! - The data sheets named at the presets. They give densities, floors, ranges and turn-on errors, but neither `T` nor
//!   `K`. Ours are `T = 7.5·(N/B)²` and `K = B·√(3/16T)`: with them the lowest point of the curve is `B` within a
//!   tenth, and it stays flat from a fifth of `T` to ten times `T`, as measured ones do. Larger walks, as simulators
//!   used to have, drift as no real unit does (PX4/gazebo-models #81).

use maps::frame::{Body, Vector, World};
use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::allan::GAUSS_MARKOV_PEAK;
use super::process::{Wander, limited, usable_step};
use crate::vehicle::gnss::gaussian;

/// Standard gravity, in m/s².
pub const GRAVITY_MPS2: f64 = 9.806_65;
const MICRO_G: f64 = GRAVITY_MPS2 * 1e-6;
const DEG_PER_HOUR: f64 = std::f64::consts::PI / 180.0 / 3600.0;

/// The errors of a gyroscope, the same for each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroscopeModel {
    /// Density of white noise `N`, in rad/s per √Hz: the angle random walk in rad/√s.
    pub noise_density_radps_per_rthz: f64,
    /// Bias instability `B`: the flat part of the Allan curve.
    pub bias_instability_radps: f64,
    /// How long the bias takes to forget itself, `T`.
    pub bias_correlation_s: f64,
    /// Rate random walk `K`, in rad/s per √s.
    pub rate_random_walk_radps_per_rts: f64,
    /// Standard deviation of the constant bias, which differs each time it is switched on.
    pub turn_on_bias_radps: f64,
    /// Standard deviation of the error of scale, as a share.
    pub scale_error: f64,
    /// Nothing beyond this is reported.
    pub range_radps: f64,
}

/// The errors of an accelerometer, the same for each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccelerometerModel {
    /// Density of white noise `N`, in m/s² per √Hz: the velocity random walk in m/s per √s.
    pub noise_density_mps2_per_rthz: f64,
    /// Bias instability `B`: the flat part of the Allan curve.
    pub bias_instability_mps2: f64,
    /// How long the bias takes to forget itself, `T`.
    pub bias_correlation_s: f64,
    /// Acceleration random walk `K`, in m/s² per √s.
    pub rate_random_walk_mps2_per_rts: f64,
    /// Standard deviation of the constant bias, which differs each time it is switched on.
    pub turn_on_bias_mps2: f64,
    /// Standard deviation of the error of scale, as a share.
    pub scale_error: f64,
    /// Nothing beyond this is reported.
    pub range_mps2: f64,
}

/// An inertial measurement unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuModel {
    /// Its three gyroscopes.
    pub gyroscope: GyroscopeModel,
    /// Its three accelerometers.
    pub accelerometer: AccelerometerModel,
}

impl ImuModel {
    /// A flight controller's: TDK ICM-42688-P, data sheet DS-000347, tables 1 and 2, typical values: 0.0028 °/s/√Hz,
    /// ±0.5 °/s, ±0.5 %, ±2000 °/s; 70 µg/√Hz (its z axis), ±20 mg, ±0.5 %, ±16 g. The sheet has no bias instability:
    /// 2.8 °/h and 30 µg are of the size seen on benches. Turn-on errors are a tenth of the sheet's, as the calibration
    /// of the autopilot leaves them.
    pub const ICM_42688_P: Self = Self {
        gyroscope: GyroscopeModel {
            noise_density_radps_per_rthz: 0.0028_f64.to_radians(),
            bias_instability_radps: 2.8 * DEG_PER_HOUR,
            bias_correlation_s: 100.0,
            rate_random_walk_radps_per_rts: 5.9e-7,
            turn_on_bias_radps: 0.05_f64.to_radians(),
            scale_error: 0.0005,
            range_radps: 2000_f64.to_radians(),
        },
        accelerometer: AccelerometerModel {
            noise_density_mps2_per_rthz: 70.0 * MICRO_G,
            bias_instability_mps2: 30.0 * MICRO_G,
            bias_correlation_s: 40.0,
            rate_random_walk_mps2_per_rts: 2.0e-5,
            turn_on_bias_mps2: 2000.0 * MICRO_G,
            scale_error: 0.0005,
            range_mps2: 16.0 * GRAVITY_MPS2,
        },
    };

    /// A flight controller's on a frame that shakes: Bosch BMI088, data sheet BST-BMI088-DS001, typical values: 0.014
    /// °/s/√Hz, bias stability below 2 °/h, ±1 °/s, ±1 %, ±2000 °/s; 190 µg/√Hz (its z axis), ±20 mg, ±24 g. White
    /// noise hides so low a floor for a quarter of an hour. Turn-on errors are a tenth of the sheet's, as calibrated.
    pub const BMI088: Self = Self {
        gyroscope: GyroscopeModel {
            noise_density_radps_per_rthz: 0.014_f64.to_radians(),
            bias_instability_radps: 2.0 * DEG_PER_HOUR,
            bias_correlation_s: 4800.0,
            rate_random_walk_radps_per_rts: 6.1e-8,
            turn_on_bias_radps: 0.1_f64.to_radians(),
            scale_error: 0.001,
            range_radps: 2000_f64.to_radians(),
        },
        accelerometer: AccelerometerModel {
            noise_density_mps2_per_rthz: 190.0 * MICRO_G,
            bias_instability_mps2: 40.0 * MICRO_G,
            bias_correlation_s: 170.0,
            rate_random_walk_mps2_per_rts: 1.3e-5,
            turn_on_bias_mps2: 2000.0 * MICRO_G,
            scale_error: 0.001,
            range_mps2: 24.0 * GRAVITY_MPS2,
        },
    };

    /// That of a ground vehicle's inertial navigation: Analog Devices ADIS16495-1, typical values: 0.09 °/√h, 0.8 °/h,
    /// ±125 °/s; 0.008 m/s/√h, 3.2 µg, ±8 g. Turn-on errors are those of a unit calibrated in the factory over
    /// temperature.
    pub const ADIS16495_1: Self = Self {
        gyroscope: GyroscopeModel {
            noise_density_radps_per_rthz: (0.09_f64 / 60.0).to_radians(),
            bias_instability_radps: 0.8 * DEG_PER_HOUR,
            bias_correlation_s: 340.0,
            rate_random_walk_radps_per_rts: 9.1e-8,
            turn_on_bias_radps: 0.02_f64.to_radians(),
            scale_error: 0.0003,
            range_radps: 125_f64.to_radians(),
        },
        accelerometer: AccelerometerModel {
            noise_density_mps2_per_rthz: 0.008 / 60.0,
            bias_instability_mps2: 3.2 * MICRO_G,
            bias_correlation_s: 140.0,
            rate_random_walk_mps2_per_rts: 1.15e-6,
            turn_on_bias_mps2: 500.0 * MICRO_G,
            scale_error: 0.0003,
            range_mps2: 8.0 * GRAVITY_MPS2,
        },
    };
}

/// What the unit reports, x forward, y left, z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Angular velocity in rad/s.
    pub rates: Vector<Body>,
    /// Specific force in m/s²: at rest, gravity upwards.
    pub specific_force: Vector<Body>,
}

/// An inertial measurement unit that has been switched on, and its present errors.
#[derive(Clone, Debug)]
pub struct Imu {
    gyroscopes: [Axis; 3],
    accelerometers: [Axis; 3],
    random: Pcg64,
}

impl Imu {
    /// Switches on a unit: turn-on bias and scale errors are drawn, the wandering bias is what it is on average.
    pub fn new(model: ImuModel, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let gyroscope = Errors::from(model.gyroscope);
        let accelerometer = Errors::from(model.accelerometer);
        Self {
            gyroscopes: [(); 3].map(|()| Axis::new(gyroscope, &mut random)),
            accelerometers: [(); 3].map(|()| Axis::new(accelerometer, &mut random)),
            random,
        }
    }

    /// Lets the errors go on for `dt` seconds, the time since the last sample, and measures the true angular velocity
    /// (rad/s) and specific force (m/s²).
    pub fn measure(
        &mut self,
        rates: Vector<Body>,
        specific_force: Vector<Body>,
        dt: f64,
    ) -> ImuSample {
        let dt = usable_step(dt);
        let turned = triad(&mut self.gyroscopes, rates.raw, dt, &mut self.random);
        let pushed = triad(
            &mut self.accelerometers,
            specific_force.raw,
            dt,
            &mut self.random,
        );
        ImuSample {
            rates: Vector::from_raw(turned),
            specific_force: Vector::from_raw(pushed),
        }
    }

    /// The true bias of the gyroscopes (rad/s) and accelerometers (m/s²) at present: what a filter should find.
    pub fn biases(&self) -> [Vector<Body>; 2] {
        [&self.gyroscopes, &self.accelerometers].map(|axes| {
            let [x, y, z] = [0, 1, 2].map(|i| axes[i].bias());
            Vector::new(x, y, z)
        })
    }
}

/// The specific force on a body (m/s²) that is turned so in the world and accelerates so there, in m/s²: what keeps it
/// from falling freely.
pub fn specific_force(
    world_from_body: &UnitQuaternion<f64>,
    acceleration: Vector<World>,
) -> Vector<Body> {
    let up = Vector3::new(0.0, 0.0, GRAVITY_MPS2);
    Vector::from_raw(world_from_body.inverse_transform_vector(&(acceleration.raw + up)))
}

fn triad(axes: &mut [Axis; 3], truth: Vector3<f64>, dt: f64, random: &mut Pcg64) -> Vector3<f64> {
    let [x, y, z] = axes;
    Vector3::new(
        x.measure(truth.x, dt, random),
        y.measure(truth.y, dt, random),
        z.measure(truth.z, dt, random),
    )
}

/// The two models without their units.
#[derive(Clone, Copy, Debug)]
struct Errors {
    density: f64,
    instability: f64,
    correlation_s: f64,
    walk: f64,
    turn_on: f64,
    scale: f64,
    range: f64,
}

impl From<GyroscopeModel> for Errors {
    fn from(model: GyroscopeModel) -> Self {
        Self {
            density: model.noise_density_radps_per_rthz,
            instability: model.bias_instability_radps,
            correlation_s: model.bias_correlation_s,
            walk: model.rate_random_walk_radps_per_rts,
            turn_on: model.turn_on_bias_radps,
            scale: model.scale_error,
            range: model.range_radps,
        }
    }
}

impl From<AccelerometerModel> for Errors {
    fn from(model: AccelerometerModel) -> Self {
        Self {
            density: model.noise_density_mps2_per_rthz,
            instability: model.bias_instability_mps2,
            correlation_s: model.bias_correlation_s,
            walk: model.rate_random_walk_mps2_per_rts,
            turn_on: model.turn_on_bias_mps2,
            scale: model.scale_error,
            range: model.range_mps2,
        }
    }
}

#[derive(Clone, Debug)]
struct Axis {
    errors: Errors,
    turn_on: f64,
    gain: f64,
    wander: Wander,
    /// The wandering bias at present.
    wandered: f64,
    walked: f64,
}

impl Axis {
    fn new(errors: Errors, random: &mut Pcg64) -> Self {
        let turn_on = errors.turn_on * gaussian(random);
        let gain = 1.0 + errors.scale * gaussian(random);
        let mut wander = Wander::new(errors.correlation_s, random);
        let wandered = wander.step(0.0, random) * errors.instability / GAUSS_MARKOV_PEAK;
        Self {
            errors,
            turn_on,
            gain,
            wander,
            wandered,
            walked: 0.0,
        }
    }

    fn bias(&self) -> f64 {
        self.turn_on + self.wandered + self.walked
    }

    fn measure(&mut self, truth: f64, dt: f64, random: &mut Pcg64) -> f64 {
        let errors = &self.errors;
        self.wandered = self.wander.step(dt, random) * errors.instability / GAUSS_MARKOV_PEAK;
        self.walked += errors.walk * dt.sqrt() * gaussian(random);
        let density = if dt > 0.0 {
            errors.density / dt.sqrt()
        } else {
            0.0
        };
        let noise = density * gaussian(random);
        limited(self.gain * truth + self.bias() + noise, errors.range)
    }
}

#[cfg(test)]
mod tests;
