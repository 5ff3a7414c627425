//! A quadrotor down to its motors: a rigid body that four propellers push and turn, for whoever closes the loops himself.
//!
//! ```text
//! τ_m·u̇ = u_wanted - u        Tᵢ = T_max·((1 - e)·uᵢ + e·uᵢ²)
//! m·v̇ = R·ẑ·ΣTᵢ - m·g·ẑ - m·c·v        I·ω̇ = Σ rᵢ × ẑ·Tᵢ + ẑ·k·Σ sᵢ·Tᵢ - ω × I·ω - c_ω·I·ω        Ṙ = R·[ω]×
//! ```
//!
//! with sᵢ = -1 for a propeller that turns counter-clockwise seen from above and 1 for one that turns clockwise. [`super::copter`] is
//! the same kind of vehicle with its inner loops closed.
//!
//! - R. Mahony, V. Kumar, P. Corke, *Multirotor Aerial Vehicles*, IEEE RAM 19(3), 2012, Eqs. (1), (4), (15).

use maps::frame::{Isometry, Point, Vector};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};

use super::{Motion, copter::GRAVITY};

/// Longest step of the integration; longer ones are cut.
const STEP_S: f64 = 0.0025;

/// How it is built: about 1.5 kg and 0.45 m across.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Mass in kg.
    pub mass_kg: f64,
    /// From the middle to each motor, forward and sideways alike, in m.
    pub arm_m: f64,
    /// Moments of inertia about forward, left and up, in kg·m².
    pub inertia: [f64; 3],
    /// Thrust of one motor at full power, in N.
    pub thrust_n: f64,
    /// How far thrust grows with the square of the power: 0 linearly, 1 all of it. `ArduPilot`'s `MOT_THST_EXPO`.
    pub exponent: f64,
    /// Torque of a propeller per thrust, in m.
    pub torque_m: f64,
    /// How long a motor takes to follow, in s.
    pub lag_s: f64,
    /// Drag per mass, in 1/s.
    pub drag: f64,
    /// Loss of turning by drag, in 1/s.
    pub turn_drag: f64,
}

impl Default for Frame {
    /// Hovers at 0.39 of its thrust, where `ArduPilot`'s own simulated copters do; its exponent is the default of
    /// `MOT_THST_EXPO`.
    fn default() -> Self {
        let mass_kg = 1.5;
        Self {
            mass_kg,
            arm_m: 0.16,
            inertia: [0.022, 0.022, 0.035],
            thrust_n: mass_kg * GRAVITY / 4.0 / 0.39,
            exponent: 0.65,
            torque_m: 0.03,
            lag_s: 0.03,
            drag: 0.25,
            turn_drag: 0.5,
        }
    }
}

/// Forward and left of each motor as signs, and the sign of its torque about up: front right, rear left (both turning
/// counter-clockwise), front left, rear right (clockwise). `ArduPilot`'s order of a quad X.
const MOTORS: [[f64; 3]; 4] = [
    [1.0, -1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [1.0, 1.0, 1.0],
    [-1.0, -1.0, 1.0],
];

/// The quadrotor.
#[derive(Clone, Debug)]
pub struct Quadrotor {
    /// How it is built.
    pub frame: Frame,
    /// Height of the ground below it, in m.
    pub ground_m: f64,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    world_from_body: UnitQuaternion<f64>,
    rates: Vector3<f64>,
    power: [f64; 4],
    acceleration: Vector3<f64>,
}

impl Quadrotor {
    /// A quadrotor that stands on the ground.
    pub fn new(place: Point<maps::frame::World>, heading_rad: f64, frame: Frame) -> Self {
        Self {
            frame,
            ground_m: place.raw.z,
            position: place.raw.coords,
            velocity: Vector3::zeros(),
            world_from_body: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad),
            rates: Vector3::zeros(),
            power: [0.0; 4],
            acceleration: Vector3::zeros(),
        }
    }

    /// Moves on by `dt` seconds with these powers of the motors, 0 to 1: front right, rear left, front left, rear right.
    pub fn step(&mut self, power: [f64; 4], dt: f64) {
        let steps = (dt / STEP_S).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.integrate(power, dt / steps);
        }
    }

    fn integrate(&mut self, power: [f64; 4], dt: f64) {
        let frame = self.frame;
        let follow = 1.0 - (-dt / frame.lag_s).exp();
        let (mut thrust, mut torque) = (0.0, Vector3::zeros());
        for ((now, wanted), [forward, left, turn]) in self.power.iter_mut().zip(power).zip(MOTORS) {
            *now += (wanted.clamp(0.0, 1.0) - *now) * follow;
            let push =
                frame.thrust_n * ((1.0 - frame.exponent) * *now + frame.exponent * *now * *now);
            thrust += push;
            torque += Vector3::new(
                left * frame.arm_m,
                -forward * frame.arm_m,
                turn * frame.torque_m,
            ) * push;
        }
        let lift = self.world_from_body * Vector3::z() * (thrust / frame.mass_kg);
        self.acceleration = lift - Vector3::z() * GRAVITY - self.velocity * frame.drag;
        if self.position.z <= self.ground_m && self.acceleration.z <= 0.0 && self.velocity.z <= 0.0
        {
            self.rest();
            return;
        }
        self.velocity += self.acceleration * dt;
        self.position += self.velocity * dt;
        let inertia = Matrix3::from_diagonal(&Vector3::from(frame.inertia));
        let momentum = inertia * self.rates;
        let turning = torque - self.rates.cross(&momentum) - momentum * frame.turn_drag;
        self.rates += turning.component_div(&Vector3::from(frame.inertia)) * dt;
        self.world_from_body *= UnitQuaternion::from_scaled_axis(self.rates * dt);
        self.world_from_body.renormalize();
        if self.position.z < self.ground_m && self.velocity.z < 0.0 {
            self.rest();
        }
    }

    /// On its skids: level, without sliding.
    fn rest(&mut self) {
        let heading_rad = self.motion().heading_rad();
        self.position.z = self.ground_m;
        self.velocity = Vector3::zeros();
        self.acceleration = Vector3::zeros();
        self.rates = Vector3::zeros();
        self.world_from_body = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad);
    }

    /// Where it truly is.
    pub fn motion(&self) -> Motion {
        Motion {
            world_from_body: Isometry::claim(Isometry3::from_parts(
                self.position.into(),
                self.world_from_body,
            )),
            velocity: Vector::from_raw(self.velocity),
            rates: Vector::from_raw(self.rates),
        }
    }

    /// Its acceleration in the world, in m/s²; the blow of a landing is not in it.
    pub fn acceleration(&self) -> Vector<maps::frame::World> {
        Vector::from_raw(self.acceleration)
    }
}

#[cfg(test)]
mod gains;

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1.0 / 400.0;
    /// Where thrust is weight: the root of 0.35·u + 0.65·u² = 0.39.
    const HOVER: f64 = 0.550_8;

    fn flying() -> Quadrotor {
        let mut quad = Quadrotor::new(Point::new(0.0, 0.0, 50.0), 0.0, Frame::default());
        quad.ground_m = 0.0;
        quad.power = [HOVER; 4];
        quad
    }

    #[test]
    fn it_hovers_where_thrust_is_weight_and_climbs_with_more() {
        let mut quad = flying();
        for _ in 0..400 {
            quad.step([HOVER; 4], DT);
        }
        assert!((quad.motion().position().raw.z - 50.0).abs() < 0.05);
        for _ in 0..400 {
            quad.step([HOVER + 0.1; 4], DT);
        }
        assert!(quad.motion().velocity.raw.z > 1.0);
    }

    /// Which way it turns about forward, left and up with some motors stronger.
    #[track_caller]
    fn check_turn(stronger: [usize; 2], axis: usize, sign: f64) {
        let mut quad = flying();
        let mut power = [HOVER - 0.02; 4];
        for motor in stronger {
            power[motor] += 0.04;
        }
        for _ in 0..40 {
            quad.step(power, DT);
        }
        let rates = quad.motion().rates.raw;
        assert!(rates[axis] * sign > 0.02, "{stronger:?}: {rates}");
        let others = (0..3).filter(|other| *other != axis);
        others.for_each(|other| assert!(rates[other].abs() < 1e-9, "{stronger:?}: {rates}"));
    }

    #[test]
    fn motors_turn_it_as_those_of_a_quad_x_do() {
        check_turn([1, 2], 0, 1.0); // left motors: to the right
        check_turn([0, 2], 1, -1.0); // front motors: nose up
        check_turn([2, 3], 2, 1.0); // clockwise propellers: nose to the left
        check_turn([0, 1], 2, -1.0);
    }

    #[test]
    fn steps_of_any_length_end_in_nearly_the_same_place() {
        let fly = |dt: f64| {
            let mut quad = flying();
            let steps = (1.0 / dt).round() as usize;
            (0..steps).for_each(|_| quad.step([0.6, 0.58, 0.59, 0.6], dt));
            quad.motion().position()
        };
        let error = (fly(1.0 / 1200.0) - fly(1.0 / 50.0)).norm();
        assert!(error < 0.05, "{error} m after a second");
    }

    #[test]
    fn on_the_ground_it_stands_level_until_thrust_lifts_it() {
        let mut quad = Quadrotor::new(Point::new(1.0, 2.0, 0.5), 0.7, Frame::default());
        for _ in 0..400 {
            quad.step([0.5, 0.1, 0.4, 0.0], DT);
        }
        let motion = quad.motion();
        assert_eq!(motion.position(), Point::new(1.0, 2.0, 0.5));
        assert!((motion.heading_rad() - 0.7).abs() < 1e-9 && motion.rates.norm() < 1e-12);
        assert!(quad.acceleration().norm() < 1e-12);
        for _ in 0..400 {
            quad.step([0.8; 4], DT);
        }
        assert!(quad.motion().position().raw.z > 1.0);
        for _ in 0..4000 {
            quad.step([0.0; 4], DT);
        }
        assert!(
            (quad.motion().position().raw.z - 0.5).abs() < 1e-9,
            "and it falls back"
        );
    }
}
