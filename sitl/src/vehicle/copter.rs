//! A quadrotor: a point mass that is pushed where its thrust points, with a lag before it points there.
//!
//! ```text
//! v̇ = f/m - g·ẑ - c·(v - w)        τ·ḟ = f_wanted - f        |f_xy| ≤ g·tan(tilt_max)
//! ẇ = -w/τ_w + σ√(2/τ_w)·n(t)      (gusts, Dryden's first-order form)
//! ```
//!
//! The inner loop is a velocity controller, as autopilots have; attitude follows from the direction of thrust.
//!
//! - R. Mahony, V. Kumar, P. Corke, *Multirotor Aerial Vehicles*, IEEE RAM 19(3), 2012, Eqs. (1), (15).
//! - MIL-HDBK-1797B, app. A: continuous gusts.

use maps::frame::{Isometry, Point, Vector, World};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::gnss::gaussian;
use super::{Motion, towards, wrapped};

/// Standard gravity, in m/s².
pub(crate) const GRAVITY: f64 = 9.806_65;
/// How long attitude and thrust take to follow, in seconds.
const LAG_S: f64 = 0.15;
/// Drag per mass, in 1/s.
const DRAG: f64 = 0.25;
/// Acceleration wanted per velocity error, in 1/s.
const VELOCITY_GAIN: f64 = 1.8;
/// Share of a steady velocity error that is learned per second.
const INTEGRAL_GAIN: f64 = 0.5;
const GUST_CORRELATION_S: f64 = 3.0;

/// What the frame and motors can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest tilt from level.
    pub tilt_rad: f64,
    /// Largest vertical acceleration, in m/s².
    pub lift_mps2: f64,
    /// Fastest turn, in rad/s.
    pub turn_radps: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            tilt_rad: 30_f64.to_radians(),
            lift_mps2: 3.0,
            turn_radps: 1.2,
        }
    }
}

/// The air it flies in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wind {
    /// Mean velocity, in m/s.
    pub mean: Vector<World>,
    /// Standard deviation of the gusts along each axis, in m/s.
    pub gust_mps: f64,
}

/// What the autopilot asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Control {
    /// Motors stopped.
    Off,
    /// Fly with this velocity, turning to this heading.
    Fly {
        /// Wanted velocity in m/s.
        velocity: Vector<World>,
        /// Wanted heading, counter-clockwise from east.
        heading_rad: f64,
    },
}

/// A quadrotor and the air around it.
#[derive(Clone, Debug)]
pub struct Copter {
    /// What it can do.
    pub limits: Limits,
    /// Steady wind and the strength of gusts.
    pub wind: Wind,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    /// Thrust per mass minus what holds it up.
    push: Vector3<f64>,
    learned: Vector3<f64>,
    gust: Vector3<f64>,
    heading_rad: f64,
    turn_radps: f64,
    tilt_rates: [f64; 2],
    /// Height of the ground below it.
    ground_m: f64,
    random: Pcg64,
}

impl Copter {
    /// A copter that stands on the ground.
    pub fn new(place: Point<World>, heading_rad: f64, wind: Wind, seed: u64) -> Self {
        Self {
            limits: Limits::default(),
            wind,
            position: place.raw.coords,
            velocity: Vector3::zeros(),
            push: Vector3::zeros(),
            learned: Vector3::zeros(),
            gust: Vector3::zeros(),
            heading_rad,
            turn_radps: 0.0,
            tilt_rates: [0.0; 2],
            ground_m: place.raw.z,
            random: Pcg64::seed_from_u64(seed),
        }
    }

    /// Whether it stands on the ground.
    pub fn on_ground(&self) -> bool {
        self.position.z <= self.ground_m + 1e-3
    }

    /// How hard the motors work: 1 is hovering.
    pub fn effort(&self) -> f64 {
        ((self.push + Vector3::z() * GRAVITY).norm() / GRAVITY).powf(1.5)
    }

    /// Moves on by `dt` seconds.
    pub fn step(&mut self, control: Control, dt: f64) {
        self.blow(dt);
        match control {
            Control::Off => self.fall(dt),
            Control::Fly {
                velocity,
                heading_rad,
            } => self.fly(velocity.raw, heading_rad, dt),
        }
        self.position += self.velocity * dt;
        if self.position.z <= self.ground_m {
            self.position.z = self.ground_m;
            if self.velocity.z <= 0.0 {
                // Skids on the ground: no sliding, no rest of tilt.
                self.velocity = Vector3::zeros();
                self.push = Vector3::new(0.0, 0.0, self.push.z.max(0.0));
                self.learned = Vector3::zeros();
            }
        }
    }

    fn blow(&mut self, dt: f64) {
        let keep = (-dt / GUST_CORRELATION_S).exp();
        let spread = self.wind.gust_mps * (1.0 - keep * keep).sqrt();
        let noise = [(); 3].map(|()| gaussian(&mut self.random));
        self.gust = self.gust * keep + Vector3::from(noise) * spread;
    }

    fn fall(&mut self, dt: f64) {
        self.push = Vector3::zeros();
        self.learned = Vector3::zeros();
        self.turn_radps = 0.0;
        self.tilt_rates = [0.0; 2];
        if !self.on_ground() {
            self.velocity += (Vector3::z() * -GRAVITY - self.drag()) * dt;
        }
    }

    fn fly(&mut self, wanted: Vector3<f64>, heading_rad: f64, dt: f64) {
        let error = wanted - self.velocity;
        let sideways = GRAVITY * self.limits.tilt_rad.tan();
        self.learned = capped(
            self.learned + error * (INTEGRAL_GAIN * dt),
            sideways / 2.0,
            self.limits.lift_mps2,
        );
        let push = capped(
            error * VELOCITY_GAIN + self.learned,
            sideways,
            self.limits.lift_mps2,
        );
        let before = self.tilt();
        self.push += (push - self.push) * (1.0 - (-dt / LAG_S).exp());
        let turn = (wrapped(heading_rad - self.heading_rad) * 2.0)
            .clamp(-self.limits.turn_radps, self.limits.turn_radps);
        self.turn_radps = towards(self.turn_radps, turn, 4.0 * dt);
        self.heading_rad = wrapped(self.heading_rad + self.turn_radps * dt);
        let after = self.tilt();
        self.tilt_rates = [0, 1].map(|i| (after[i] - before[i]) / dt);
        self.velocity += (self.push - self.drag()) * dt;
    }

    fn drag(&self) -> Vector3<f64> {
        if self.on_ground() {
            return Vector3::zeros();
        }
        (self.velocity - self.wind.mean.raw - self.gust) * DRAG
    }

    /// Roll and pitch, right-handed about forward and left.
    fn tilt(&self) -> [f64; 2] {
        let (sin, cos) = self.heading_rad.sin_cos();
        let forward = self.push.x * cos + self.push.y * sin;
        let left = -self.push.x * sin + self.push.y * cos;
        let up = GRAVITY + self.push.z;
        [(-left).atan2(up), forward.atan2(up)]
    }

    /// Where it truly is.
    pub fn motion(&self) -> Motion {
        let [roll, pitch] = self.tilt();
        let turn = UnitQuaternion::from_euler_angles(roll, pitch, self.heading_rad);
        let [roll_rate, pitch_rate] = self.tilt_rates;
        Motion {
            world_from_body: Isometry::claim(Isometry3::from_parts(self.position.into(), turn)),
            velocity: Vector::from_raw(self.velocity),
            rates: Vector::new(roll_rate, pitch_rate, self.turn_radps),
        }
    }
}

/// The vector with its horizontal part at most `sideways` long and its vertical part at most `up`.
fn capped(v: Vector3<f64>, sideways: f64, up: f64) -> Vector3<f64> {
    let long = v.xy().norm();
    let scale = if long > sideways {
        sideways / long
    } else {
        1.0
    };
    Vector3::new(v.x * scale, v.y * scale, v.z.clamp(-up, up))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.02;

    fn calm() -> Wind {
        Wind {
            mean: Vector::new(0.0, 0.0, 0.0),
            gust_mps: 0.0,
        }
    }

    fn fly(x: f64, y: f64, z: f64) -> Control {
        Control::Fly {
            velocity: Vector::new(x, y, z),
            heading_rad: 0.0,
        }
    }

    #[test]
    fn it_never_tilts_beyond_its_limit_nor_turns_faster() {
        let mut copter = Copter::new(Point::origin(), 0.0, calm(), 1);
        for i in 0..2000 {
            let way = if i / 100 % 2 == 0 { 20.0 } else { -20.0 };
            let control = Control::Fly {
                velocity: Vector::new(way, 0.5 * way, 3.0),
                heading_rad: way,
            };
            copter.step(control, DT);
            let motion = copter.motion();
            let up = motion.world_from_body.rotation() * Vector3::z();
            // Euler angles of roll and pitch together tilt a little more than each; and less thrust tilts more.
            assert!(
                up.z.acos() <= 42_f64.to_radians(),
                "{} at step {i}",
                up.z.acos().to_degrees()
            );
            assert!(motion.rates.raw.z.abs() <= copter.limits.turn_radps + 1e-9);
        }
    }

    #[test]
    fn it_reaches_the_wanted_velocity_in_the_wind() {
        let wind = Wind {
            mean: Vector::new(2.0, -1.0, 0.0),
            gust_mps: 0.0,
        };
        let mut copter = Copter::new(Point::origin(), 0.0, wind, 1);
        for _ in 0..600 {
            copter.step(fly(1.0, 0.5, 0.8), DT);
        }
        let error = copter.motion().velocity + Vector::new(-1.0, -0.5, -0.8);
        assert!(error.norm() < 0.05, "{error:?} m/s after 12 s");
    }

    #[test]
    fn without_motors_it_falls_to_the_ground_and_stays_there() {
        let mut copter = Copter::new(Point::origin(), 0.0, calm(), 1);
        for _ in 0..200 {
            copter.step(fly(0.0, 0.0, 2.0), DT);
        }
        assert!(!copter.on_ground());
        for _ in 0..300 {
            copter.step(Control::Off, DT);
        }
        assert!(copter.on_ground());
        let still = copter.motion();
        copter.step(Control::Off, DT);
        assert_eq!(copter.motion(), still);
    }

    #[test]
    fn gusts_are_those_of_the_seed() {
        let run = |seed| {
            let wind = Wind {
                gust_mps: 0.5,
                ..calm()
            };
            let mut copter = Copter::new(Point::origin(), 0.0, wind, seed);
            (0..300).for_each(|_| copter.step(fly(0.0, 0.0, 0.5), DT));
            copter.motion().position()
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
    }
}
