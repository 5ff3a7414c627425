//! Encoders on the two driven wheels of an axle: whole ticks, wheels of not quite the same size, and slip.
//!
//! With speed `v` of the middle of the axle, yaw rate `ω` and track `b`, the wheel at the right (+) or left (-) has
//!
//! ```text
//! v_w = v ± ω·b/2          κ = c·a·sign(v_w) + σ_κ·x(t)          θ̇ = v_w·(1 + κ) / (r·(1 + s))
//! ```
//!
//! where `κ` is the slip of a tyre that pulls with acceleration `a` (linear, as below a third of what it can hold),
//! `x` a Gauss-Markov process that stands for the ground, and `s` the error of that wheel's radius. Pulling makes the
//! wheel turn further than it rolls, braking less far. Ticks are counted down as well as up, and never lost.
//!
//! A speed or yaw rate that is not finite turns no wheel, nor does a `dt` that is not positive and finite.
//!
//! - J. Borenstein, L. Feng, *Measurement and Correction of Systematic Odometry Errors in Mobile Robots*, IEEE T-RA
//!   12(6), 1996: unequal wheels and track are what matters.
//! - J. Y. Wong, *Theory of Ground Vehicles*, 4th ed., Wiley, 2008, §1.3: slip and tractive force.

use std::f64::consts::TAU;

use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::process::{Wander, limited, usable_step};
use crate::vehicle::gnss::gaussian;

/// How long the ground keeps its influence on slip.
const GROUND_CORRELATION_S: f64 = 0.5;
/// A wheel that slips by more than this does not hold any more, and the linear law is over.
const MOST_SLIP: f64 = 0.3;

/// An axle with encoders, and its errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelModel {
    /// Radius that the vehicle believes its wheels have.
    pub radius_m: f64,
    /// Between the middles of the two wheels.
    pub track_m: f64,
    /// Counts for each turn of a wheel.
    pub ticks_per_turn: f64,
    /// Standard deviation of the error of each wheel's radius, as a share.
    pub scale_error: f64,
    /// Slip for each m/s² of acceleration, as a share.
    pub slip_per_mps2: f64,
    /// Standard deviation of the slip that the ground adds, as a share.
    pub slip_noise: f64,
}

impl WheelModel {
    /// A car of 0.4 m with gear motors and Hall encoders of 11 pulses, all four edges counted, behind a gear of 30:1.
    pub const SMALL_CAR: Self = Self {
        radius_m: 0.0325,
        track_m: 0.2,
        ticks_per_turn: 1320.0,
        scale_error: 0.005,
        slip_per_mps2: 0.01,
        slip_noise: 0.01,
    };

    /// Clearpath Husky A200, user manual: wheels of 0.33 m, track 0.555 m, 78,000 ticks per metre. Skid steering slips
    /// more.
    pub const HUSKY_A200: Self = Self {
        radius_m: 0.165,
        track_m: 0.555,
        ticks_per_turn: 78_000.0 * TAU * 0.165,
        scale_error: 0.005,
        slip_per_mps2: 0.02,
        slip_noise: 0.03,
    };

    /// How far a vehicle believes a wheel rolls for each tick.
    pub fn metres_per_tick(&self) -> f64 {
        TAU * self.radius_m / self.ticks_per_turn
    }
}

/// Counts since the start; negative backwards.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ticks {
    /// Of the left wheel.
    pub left: i64,
    /// Of the right wheel.
    pub right: i64,
}

/// Two wheels and their encoders.
#[derive(Clone, Debug)]
pub struct WheelOdometry {
    model: WheelModel,
    wheels: [Wheel; 2],
    random: Pcg64,
}

#[derive(Clone, Debug)]
struct Wheel {
    /// -1 for the left, 1 for the right.
    side: f64,
    /// Its true radius over the one believed.
    size: f64,
    /// How far it has turned, in ticks.
    turned: f64,
    /// Its speed along the ground in the last step.
    speed_mps: f64,
    ground: Wander,
}

impl WheelOdometry {
    /// An axle at rest, whose wheels have sizes of their own.
    pub fn new(model: WheelModel, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let wheels = [-1.0, 1.0].map(|side| Wheel {
            side,
            size: 1.0 + model.scale_error * gaussian(&mut random),
            turned: 0.0,
            speed_mps: 0.0,
            ground: Wander::new(GROUND_CORRELATION_S, &mut random),
        });
        Self {
            model,
            wheels,
            random,
        }
    }

    /// Rolls on for `dt` seconds at a true speed (m/s, negative backwards) and yaw rate (rad/s, positive to the left),
    /// and reads both encoders.
    pub fn roll(&mut self, speed_mps: f64, turn_radps: f64, dt: f64) -> Ticks {
        let moves = speed_mps.is_finite() && turn_radps.is_finite();
        let dt = usable_step(dt);
        for wheel in &mut self.wheels {
            let slip = self.model.slip_noise * wheel.ground.step(dt, &mut self.random);
            if moves && dt > 0.0 {
                let along = speed_mps + wheel.side * turn_radps * self.model.track_m / 2.0;
                wheel.roll(&self.model, along, slip, dt);
            }
        }
        let [left, right] = [0, 1].map(|i| self.wheels[i].turned.floor() as i64);
        Ticks { left, right }
    }
}

impl Wheel {
    fn roll(&mut self, model: &WheelModel, speed_mps: f64, ground: f64, dt: f64) {
        let acceleration = (speed_mps - self.speed_mps) / dt;
        self.speed_mps = speed_mps;
        // Faster backwards is pulling, too.
        let pulled = model.slip_per_mps2 * acceleration * speed_mps.signum();
        let slip = limited(pulled + ground, MOST_SLIP);
        let rolled = speed_mps * (1.0 + slip) / self.size * dt;
        let ticks = rolled / model.metres_per_tick();
        // Numbers beyond all speeds overflow; they must not spoil the count.
        if ticks.is_finite() {
            self.turned += ticks;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::process::statistics::{check_recovered, mean, spread};

    const DT: f64 = 0.02;

    /// Wheels as believed, on firm ground.
    fn perfect() -> WheelModel {
        WheelModel {
            scale_error: 0.0,
            slip_per_mps2: 0.0,
            slip_noise: 0.0,
            ..WheelModel::SMALL_CAR
        }
    }

    #[test]
    fn without_errors_ticks_are_the_way_to_within_one() {
        let model = perfect();
        let mut wheels = WheelOdometry::new(model, 1);
        let mut way = [0.0, 0.0];
        for i in 0..5000 {
            let (speed, turn) = ((f64::from(i) / 200.0).sin(), 0.3);
            let ticks = wheels.roll(speed, turn, DT);
            way[0] += (speed - turn * model.track_m / 2.0) * DT;
            way[1] += (speed + turn * model.track_m / 2.0) * DT;
            let read = [ticks.left, ticks.right].map(|t| t as f64 * model.metres_per_tick());
            for (read, way) in read.iter().zip(way) {
                let missing = (way - read) / model.metres_per_tick();
                assert!(
                    (-1e-6..1.0 + 1e-6).contains(&missing),
                    "{missing} ticks at step {i}"
                );
            }
        }
    }

    #[test]
    fn wheels_differ_in_size_by_what_the_model_says() {
        let model = WheelModel {
            scale_error: 0.01,
            ..perfect()
        };
        let errors: Vec<f64> = (0..2000)
            .flat_map(|seed| {
                let mut wheels = WheelOdometry::new(model, seed);
                let ticks = wheels.roll(1.0, 0.0, 100.0);
                [ticks.left, ticks.right].map(|t| t as f64 * model.metres_per_tick() / 100.0 - 1.0)
            })
            .collect();
        check_recovered("scale", spread(&errors), model.scale_error, 0.05);
        let halves: Vec<f64> = errors.chunks(2).map(|pair| pair[0] * pair[1]).collect();
        assert!(
            mean(&halves).abs() < 0.1 * model.scale_error.powi(2),
            "independent"
        );
    }

    /// What the encoders of a car add to a true way while its speed changes steadily, as a share.
    fn slip(from_mps: f64, to_mps: f64, acceleration_mps2: f64) -> f64 {
        let model = WheelModel {
            slip_per_mps2: 0.02,
            ..perfect()
        };
        let mut wheels = WheelOdometry::new(model, 1);
        let before = wheels.roll(from_mps, 0.0, 1000.0);
        let (mut way, mut after) = (0.0, before);
        for i in 1..=((to_mps - from_mps) / acceleration_mps2 / DT) as i32 {
            let speed = from_mps + acceleration_mps2 * f64::from(i) * DT;
            after = wheels.roll(speed, 0.0, DT);
            way += speed * DT;
        }
        (after.left - before.left) as f64 * model.metres_per_tick() / way - 1.0
    }

    #[test]
    fn wheels_turn_too_far_when_they_pull_and_too_little_when_they_brake() {
        // 0.02 for each m/s²; a tick over some metres is a few hundredths of a per cent.
        for (from, to, rate) in [(0.0, 6.0, 0.5), (6.0, 0.5, -1.0), (0.0, -6.0, -0.5)] {
            let expected = 0.02 * rate * f64::signum(from + to);
            let found = slip(from, to, rate);
            assert!(
                (found - expected).abs() < 3e-4,
                "{found} from {from} to {to} m/s"
            );
        }
    }

    #[test]
    fn the_ground_adds_slip_of_the_stated_size() {
        let model = WheelModel {
            slip_noise: 0.03,
            ..perfect()
        };
        let mut wheels = WheelOdometry::new(model, 1);
        // A metre at a time, far more than the ground remembers; a tick is 0.02 % of it.
        let mut last = wheels.roll(1.0, 0.0, 1.0);
        let slips: Vec<f64> = (0..20_000)
            .map(|_| {
                // Most of the time passes at rest, so that each metre has a ground of its own.
                wheels.roll(0.0, 0.0, 10.0);
                let ticks = wheels.roll(1.0, 0.0, 1.0);
                let way = (ticks.left - last.left) as f64 * model.metres_per_tick();
                last = ticks;
                way - 1.0
            })
            .collect();
        check_recovered("slip", spread(&slips), model.slip_noise, 0.03);
    }

    #[test]
    fn what_is_no_motion_turns_no_wheel_and_changes_nothing_after_it() {
        let mut wheels = WheelOdometry::new(WheelModel::SMALL_CAR, 1);
        let mut clean = wheels.clone();
        let before = [&mut wheels, &mut clean].map(|w| w.roll(1.0, 0.1, 1.0))[0];
        for (speed, turn, dt) in [
            (f64::NAN, 0.0, DT),
            (1.0, f64::INFINITY, DT),
            (1.0, 0.0, f64::NAN),
            (1.0, 0.0, -1.0),
        ] {
            assert_eq!(wheels.roll(speed, turn, dt), before, "{speed} {turn} {dt}");
            clean.roll(f64::NAN, turn, dt);
        }
        let [after, expected] = [&mut wheels, &mut clean].map(|w| w.roll(1.0, 0.1, 1.0));
        assert_eq!(after, expected);
        let way = (after.right - before.right) as f64 * WheelModel::SMALL_CAR.metres_per_tick();
        assert!(
            (way - 1.01).abs() < 0.05,
            "no slip for having stopped: {way} m"
        );
        let overflown = wheels.roll(1e300, 0.0, 1e300);
        assert!(overflown.right >= after.right, "an overflow adds nothing");
    }

    #[test]
    fn the_same_seed_gives_the_same_ticks_and_another_does_not() {
        let run = |seed| {
            let mut wheels = WheelOdometry::new(WheelModel::HUSKY_A200, seed);
            (0..200)
                .map(|_| wheels.roll(0.8, 0.2, DT))
                .collect::<Vec<_>>()
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
    }
}
