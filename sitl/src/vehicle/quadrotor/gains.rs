//! Whether loops with `ArduCopter`'s default gains hold it: proportional on angles, PID on rates, its mixer and its curve of
//! thrust, at 400 Hz. Its shaping of what pilots ask for, which makes all of it gentler, is left out.
//!
//! Source: `ArduPilot` 4.6, defaults of `ATC_ANG_*`, `ATC_RAT_*` and `MOT_*`.

use std::f64::consts::TAU;

use super::*;

const DT: f64 = 1.0 / 400.0;
const ANGLE_GAIN: f64 = 4.5;
const SPIN: [f64; 2] = [0.15, 0.95];

/// One rate loop: gains, filters in Hz, and what it remembers.
struct RateLoop {
    gains: [f64; 3],
    target_hz: f64,
    slope_hz: f64,
    target: f64,
    error: f64,
    sum: f64,
    slope: f64,
}

impl RateLoop {
    fn new(gains: [f64; 3], slope_hz: f64) -> Self {
        let (target, error, sum, slope) = (0.0, 0.0, 0.0, 0.0);
        Self {
            gains,
            target_hz: 20.0,
            slope_hz,
            target,
            error,
            sum,
            slope,
        }
    }

    fn step(&mut self, wanted: f64, rate: f64) -> f64 {
        let share = |hz: f64| DT / (DT + 1.0 / (TAU * hz));
        self.target += (wanted - self.target) * share(self.target_hz);
        let error = self.target - rate;
        self.slope += ((error - self.error) / DT - self.slope) * share(self.slope_hz);
        self.error = error;
        let [p, i, d] = self.gains;
        self.sum = (self.sum + error * i * DT).clamp(-0.5, 0.5);
        p * error + self.sum + d * self.slope
    }
}

/// Steps one angle (roll, pitch, yaw, in the body's axes) by 10 degrees in the hover; returns how long it takes to 90 % of it,
/// its peak as a share of the step, and how far it is from it after 3 s, as a share.
fn step_response(axis: usize) -> [f64; 3] {
    let mut quad = Quadrotor::new(Point::new(0.0, 0.0, 100.0), 0.0, Frame::default());
    quad.ground_m = 0.0;
    quad.power = [0.55; 4];
    let roll_or_pitch = || RateLoop::new([0.135, 0.135, 0.0036], 20.0);
    let mut loops = [
        roll_or_pitch(),
        roll_or_pitch(),
        RateLoop::new([0.18, 0.018, 0.0], 2.5),
    ];
    let step_rad = 10_f64.to_radians();
    let (mut rise_s, mut peak, mut last) = (f64::INFINITY, 0.0_f64, 0.0);
    for i in 0..1600 {
        let motion = quad.motion();
        let (roll, pitch, yaw) = motion.world_from_body.rotation().euler_angles();
        let t = f64::from(i) * DT - 1.0;
        let mut error = [-roll, -pitch, -yaw];
        error[axis] += if t >= 0.0 { step_rad } else { 0.0 };
        let turn: Vec<f64> = (0..3)
            .map(|k| loops[k].step(ANGLE_GAIN * error[k], motion.rates.raw[k]))
            .collect();
        // Held up by what it weighs; the signs are those of the torques.
        let power = MOTORS.map(|[forward, left, torque]| {
            let thrust = 0.33 + 0.5 * (left * turn[0] - forward * turn[1] + torque * turn[2]);
            let curve =
                ((0.35_f64.powi(2) + 4.0 * 0.65 * thrust.clamp(0.0, 1.0)).sqrt() - 0.35) / 1.3;
            SPIN[0] + (SPIN[1] - SPIN[0]) * curve
        });
        quad.step(power, DT);
        let share = [roll, pitch, yaw][axis] / step_rad;
        if share >= 0.9 {
            rise_s = rise_s.min(t);
        }
        peak = peak.max(share);
        last = share;
    }
    [rise_s, peak, (last - 1.0).abs()]
}

#[test]
fn roll_and_pitch_follow_a_step_within_half_a_second_and_hardly_overshoot() {
    for axis in [0, 1] {
        let [rise_s, peak, off] = step_response(axis);
        assert!(
            rise_s < 0.5 && peak < 1.1 && off < 0.02,
            "{rise_s} s, {peak}, {off}"
        );
    }
}

#[test]
fn yaw_follows_more_slowly_and_settles() {
    let [rise_s, peak, off] = step_response(2);
    assert!(
        rise_s < 1.0 && peak < 1.4 && off < 0.05,
        "{rise_s} s, {peak}, {off}"
    );
}
