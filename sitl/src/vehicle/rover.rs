//! A small car with front-wheel steering: the kinematic bicycle, with limits on what its servo and motor can do.
//!
//! ```text
//! ẋ = v cos θ    ẏ = v sin θ    θ̇ = v·tan(δ)/L        |δ| ≤ atan(L/R_min)    |δ̇| ≤ δ̇_max    |v̇| ≤ a_max
//! ```
//!
//! The reference point is the middle of the rear axle, which cannot move sideways.
//!
//! - S. M. `LaValle`, *Planning Algorithms*, Cambridge University Press, 2006, Eq. (13.15).

use maps::frame::{Isometry, Point, Vector, World};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::{Motion, towards, wrapped};

/// The chassis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chassis {
    /// Between the axles.
    pub wheelbase_m: f64,
    /// Tightest turn of the middle of the rear axle.
    pub min_turning_radius_m: f64,
    /// How fast the wheels can be steered, in rad/s.
    pub steering_radps: f64,
    /// Gain of speed, in m/s².
    pub acceleration_mps2: f64,
    /// Loss of speed, in m/s².
    pub braking_mps2: f64,
    /// Top speed in either direction, in m/s.
    pub top_speed_mps: f64,
}

impl Default for Chassis {
    fn default() -> Self {
        Self {
            wheelbase_m: 0.26,
            min_turning_radius_m: 0.45,
            steering_radps: 2.0,
            acceleration_mps2: 0.6,
            braking_mps2: 1.2,
            top_speed_mps: 1.5,
        }
    }
}

impl Chassis {
    /// The largest angle of the front wheels.
    pub fn max_steering_rad(&self) -> f64 {
        (self.wheelbase_m / self.min_turning_radius_m).atan()
    }
}

/// What the autopilot asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Control {
    /// Wanted speed in m/s, negative backwards.
    pub speed_mps: f64,
    /// Wanted curvature of the path in 1/m, positive to the left, whichever way it drives.
    pub curvature_per_m: f64,
}

/// The car.
#[derive(Clone, Debug)]
pub struct Rover {
    /// What it can do.
    pub chassis: Chassis,
    x: f64,
    y: f64,
    z: f64,
    heading_rad: f64,
    speed_mps: f64,
    steering_rad: f64,
}

impl Rover {
    /// A car that stands still.
    pub fn new(place: Point<World>, heading_rad: f64, chassis: Chassis) -> Self {
        Self {
            chassis,
            x: place.raw.x,
            y: place.raw.y,
            z: place.raw.z,
            heading_rad,
            speed_mps: 0.0,
            steering_rad: 0.0,
        }
    }

    /// Its speed in m/s, negative backwards.
    pub fn speed_mps(&self) -> f64 {
        self.speed_mps
    }

    /// Moves on by `dt` seconds.
    pub fn step(&mut self, control: Control, dt: f64) {
        let chassis = &self.chassis;
        let wanted = control
            .speed_mps
            .clamp(-chassis.top_speed_mps, chassis.top_speed_mps);
        // Towards zero it brakes, away from it the motor pulls; never both within one step.
        let braking = wanted.abs() < self.speed_mps.abs() || wanted * self.speed_mps < 0.0;
        let rate = if braking {
            chassis.braking_mps2
        } else {
            chassis.acceleration_mps2
        };
        let goal = if wanted * self.speed_mps < 0.0 {
            0.0
        } else {
            wanted
        };
        self.speed_mps = towards(self.speed_mps, goal, rate * dt);
        let limit = chassis.max_steering_rad();
        let steering = (control.curvature_per_m * chassis.wheelbase_m)
            .atan()
            .clamp(-limit, limit);
        self.steering_rad = towards(self.steering_rad, steering, chassis.steering_radps * dt);
        // The middle of the step: exact for a straight line, third order on an arc.
        let turned = self.turn_radps() * dt;
        let middle = self.heading_rad + turned / 2.0;
        self.x += self.speed_mps * dt * middle.cos();
        self.y += self.speed_mps * dt * middle.sin();
        self.heading_rad = wrapped(self.heading_rad + turned);
    }

    fn turn_radps(&self) -> f64 {
        self.speed_mps * self.steering_rad.tan() / self.chassis.wheelbase_m
    }

    /// Where it truly is.
    pub fn motion(&self) -> Motion {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.heading_rad);
        let (sin, cos) = self.heading_rad.sin_cos();
        Motion {
            world_from_body: Isometry::claim(Isometry3::from_parts(
                Vector3::new(self.x, self.y, self.z).into(),
                turn,
            )),
            velocity: Vector::new(self.speed_mps * cos, self.speed_mps * sin, 0.0),
            rates: Vector::new(0.0, 0.0, self.turn_radps()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.02;

    fn rover() -> Rover {
        Rover::new(Point::origin(), 0.0, Chassis::default())
    }

    #[test]
    fn its_tightest_circle_has_the_minimum_radius() {
        let mut rover = rover();
        let control = Control {
            speed_mps: 0.3,
            curvature_per_m: 100.0,
        };
        (0..200).for_each(|_| rover.step(control, DT));
        let (mut far, start) = (0.0_f64, rover.motion().position());
        for _ in 0..1000 {
            rover.step(control, DT);
            far = far.max((rover.motion().position() - start).norm());
        }
        assert!((far - 0.9).abs() < 1e-3, "the diameter is {far} m");
    }

    #[test]
    fn speed_and_steering_change_no_faster_than_they_can() {
        let mut rover = rover();
        for i in 0..500 {
            let forward = i / 50 % 2 == 0;
            let control = Control {
                speed_mps: if forward { 9.0 } else { -9.0 },
                curvature_per_m: if i / 20 % 2 == 0 { 9.0 } else { -9.0 },
            };
            let (speed, steering) = (rover.speed_mps, rover.steering_rad);
            rover.step(control, DT);
            assert!((rover.speed_mps - speed).abs() <= rover.chassis.braking_mps2 * DT + 1e-12);
            assert!(
                (rover.steering_rad - steering).abs() <= rover.chassis.steering_radps * DT + 1e-12
            );
            assert!(rover.speed_mps.abs() <= rover.chassis.top_speed_mps);
        }
    }

    #[test]
    fn backwards_it_follows_the_same_circle() {
        let mut rover = rover();
        let at = |speed_mps| Control {
            speed_mps,
            curvature_per_m: 1.0,
        };
        (0..300).for_each(|_| rover.step(at(-0.4), DT));
        let p = rover.motion().position().raw;
        // A circle of 1 m radius about (0, 1), but for the time the wheels take to turn.
        let radius = (p.x).hypot(p.y - 1.0);
        assert!((radius - 1.0).abs() < 0.05, "{radius} m from the centre");
        assert!(
            rover.motion().heading_rad() < 0.0,
            "driving backwards with wheels to the left turns right"
        );
    }
}
