//! The camera's motion, to guess the next pose: by its velocity, and by what an inertial unit has measured since.
//!
//! ```text
//! R = R_last·ΔR         p = p_last + v·dt + a·dt²/2         a = R_mid·f - g, with ΔR by the gyroscope, f by the accelerometer
//! ```
//!
//! `p_last` and `v` are what an α-β filter makes of all steps so far, `R_mid` is the attitude midway. Where they are not measured,
//! both velocities are constant in the camera.

use maps::time::Stamp;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

use crate::aid::{Aid, GRAVITY_MPS2};
use crate::solver::Prior;

/// The last pose, and the velocity that led to it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Motion {
    at: Stamp,
    pub(crate) pose: Isometry3<f64>,
    /// In the camera, per second.
    linear: Vector3<f64>,
    angular: Vector3<f64>,
    /// In the world, of the steps so far: of several ones where an accelerometer tells how they differ, else of the last.
    place: Vector3<f64>,
    velocity: Vector3<f64>,
    steps: u32,
}

/// Where the camera is thought to be before its picture is looked at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Guess {
    pub(crate) pose: Isometry3<f64>,
    /// How well that is known, where an inertial unit has measured the turn.
    pub(crate) prior: Option<Prior>,
}

/// For how long a velocity is believed.
const LONGEST_S: f64 = 0.3;
/// Standard deviations of a step between two poses, by the noise of both, and of an acceleration that was not measured and
/// of one that was.
const STEP_SIGMA_M: f64 = 0.008;
const STEP_SIGMA_RAD: f64 = 0.002;
const ACCELERATION_SIGMA_MPS2: f64 = 5.0;
const FELT_SIGMA_MPS2: f64 = 0.5;
/// How much of what a pose is off the foreseen one goes into the place and, times the time between two, into the velocity, at least:
/// what an accelerometer tells is off by 0.1 m/s², by how it is held, and a pose by a centimetre.
const LEAST_GAINS: [f64; 2] = [0.2, 0.02];
/// Farther off, the filter begins anew: the unit leans, or what was followed did not stand.
const CONTRADICTED_M: f64 = 0.05;
/// A step this much off the guess is a jump, not motion.
const JUMP_M: f64 = 0.3;
const JUMP_RAD: f64 = 0.35;
/// So much may bundle adjustment move a pose without it being called a jump.
const CORRECTION_M: f64 = 0.05;
const CORRECTION_RAD: f64 = 0.05;

/// Of a filter of place and velocity at its step `k`: as of least squares over all steps, until there are enough.
///
/// - P. R. Kalata, *The Tracking Index*, IEEE T-AES 1984; with the gains of an expanding window at first.
fn gains(k: u32) -> [f64; 2] {
    let k = f64::from(k);
    let window = [2.0 * (2.0 * k - 1.0), 6.0].map(|gain| gain / (k * (k + 1.0)));
    [0, 1].map(|i| window[i].max(LEAST_GAINS[i]))
}

impl Motion {
    pub(crate) fn at_rest(at: Stamp, pose: Isometry3<f64>) -> Self {
        Self {
            at,
            pose,
            place: pose.translation.vector,
            ..Self::default()
        }
    }

    /// Where the camera should be at `at`, by its velocity and by what an inertial unit has measured.
    pub(crate) fn guess(&self, at: Stamp, aid: &Aid<'_>) -> Guess {
        let mut pose = self.predict(at);
        let is_turn = |turn: &UnitQuaternion<f64>| turn.coords.iter().all(|c| c.is_finite());
        let Some(turned) = aid.turned.filter(is_turn) else {
            return Guess { pose, prior: None };
        };
        pose.rotation = self.pose.rotation * turned;
        let dt = at.since(self.at).as_secs_f64();
        if self.steps == 0 || dt > LONGEST_S {
            return Guess { pose, prior: None };
        }
        let mut sigma_mps2 = ACCELERATION_SIGMA_MPS2;
        if let Some(acceleration) = self.acceleration(aid) {
            let step = (self.velocity + acceleration * (dt / 2.0)) * dt;
            pose.translation = Translation3::from(self.place + step);
            sigma_mps2 = FELT_SIGMA_MPS2;
        }
        let prior = Prior {
            pose,
            sigma_m: STEP_SIGMA_M.hypot(sigma_mps2 * dt * dt),
            sigma_rad: STEP_SIGMA_RAD,
        };
        Guess {
            pose,
            prior: Some(prior),
        }
    }

    /// In the world, since the last pose, if an accelerometer has felt it.
    fn acceleration(&self, aid: &Aid<'_>) -> Option<Vector3<f64>> {
        let midway = self.pose.rotation * aid.turned?.powf(0.5);
        let acceleration = midway * aid.felt?.specific_force - GRAVITY_MPS2 * Vector3::z();
        acceleration
            .iter()
            .all(|c| c.is_finite())
            .then_some(acceleration)
    }

    /// Where the camera should be at `at`, by its velocity alone.
    pub(crate) fn predict(&self, at: Stamp) -> Isometry3<f64> {
        let dt = at.since(self.at).as_secs_f64().min(LONGEST_S);
        let step = Isometry3::from_parts(
            Translation3::from(self.linear * dt),
            UnitQuaternion::from_scaled_axis(self.angular * dt),
        );
        self.pose * step
    }

    /// Velocity in the camera: translation first, m/s and rad/s.
    pub(crate) fn twist(&self) -> Vector6<f64> {
        let (v, w) = (&self.linear, &self.angular);
        Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
    }

    /// How fast the camera has turned since the last pose, if it is now at `pose`: radians a second.
    pub(crate) fn turn_rate(&self, at: Stamp, pose: &Isometry3<f64>) -> f64 {
        let dt = at.since(self.at).as_secs_f64();
        let turned = (self.pose.inverse() * pose).rotation.angle();
        if dt > 1e-6 { turned / dt } else { 0.0 }
    }

    /// Whether `pose` is too far from where the camera should be.
    pub(crate) fn jumps_to(&self, at: Stamp, pose: &Isometry3<f64>) -> bool {
        let off = self.predict(at).inverse() * pose;
        off.translation.vector.norm() > JUMP_M || off.rotation.angle() > JUMP_RAD
    }

    /// The camera has moved to `pose`.
    pub(crate) fn advance(&mut self, at: Stamp, pose: Isometry3<f64>, aid: &Aid<'_>) {
        let dt = at.since(self.at).as_secs_f64();
        let step = self.pose.inverse() * pose;
        if dt > 1e-6 {
            let place = pose.translation.vector;
            let acceleration = self.acceleration(aid).filter(|_| self.steps > 0);
            let foreseen = |a: Vector3<f64>| self.place + (self.velocity + a * (dt / 2.0)) * dt;
            let expected = acceleration.map(|a| (a, foreseen(a), place - foreseen(a)));
            let is_believed = |off: &Vector3<f64>| self.steps < 2 || off.norm() < CONTRADICTED_M;
            if let Some((acceleration, foreseen, off)) =
                expected.filter(|(_, _, off)| is_believed(off))
            {
                let [of_place, of_velocity] = gains(self.steps + 1);
                self.place = foreseen + off * of_place;
                self.velocity += acceleration * dt + off * (of_velocity / dt);
                self.steps = self.steps.saturating_add(1);
            } else {
                self.velocity = (place - self.pose.translation.vector) / dt;
                self.place = place;
                self.steps = 1;
            }
            self.linear = step.translation.vector / dt;
            self.angular = step.rotation.scaled_axis() / dt;
        }
        (self.at, self.pose) = (at, pose);
    }

    /// Whether `pose` corrects the last one by so much that a controller must know.
    pub(crate) fn is_off(&self, pose: &Isometry3<f64>) -> bool {
        let off = self.pose.inverse() * pose;
        off.translation.vector.norm() > CORRECTION_M || off.rotation.angle() > CORRECTION_RAD
    }

    /// The last pose was in fact this one; the velocity stays.
    pub(crate) fn correct(&mut self, pose: Isometry3<f64>) {
        let step = pose * self.pose.inverse();
        self.place = (step * Point3::from(self.place)).coords;
        self.velocity = step.rotation * self.velocity;
        self.pose = pose;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aid::Felt;

    #[test]
    fn steady_motion_is_predicted_even_over_a_dropped_frame() {
        let at = |ms: u64| Stamp::from_nanos(ms * 1_000_000);
        let pose = |x: f64| Isometry3::translation(x, 0.0, 0.0);
        let mut motion = Motion::at_rest(at(0), pose(0.0));
        motion.advance(at(30), pose(0.03), &Aid::default());
        let predicted = motion.predict(at(90));
        assert!((predicted.translation.vector.x - 0.09).abs() < 1e-12);
        assert!(!motion.jumps_to(at(90), &pose(0.2)));
        assert!(motion.jumps_to(at(90), &pose(0.5)));
    }

    #[test]
    fn an_inertial_unit_foresees_what_a_velocity_does_not() {
        let at = |ms: u64| Stamp::from_nanos(ms * 1_000_000);
        // Upright, it falls freely from rest: nothing is felt.
        let fallen = |t: f64| Isometry3::translation(0.0, 0.0, -GRAVITY_MPS2 / 2.0 * t * t);
        let aid = |force: f64| Aid {
            turned: Some(UnitQuaternion::identity()),
            felt: Some(Felt {
                specific_force: Vector3::new(0.0, 0.0, force),
                unit_in_camera: Vector3::zeros(),
            }),
            ..Aid::default()
        };
        let mut motion = Motion::at_rest(at(0), fallen(0.0));
        assert!(
            motion.guess(at(40), &aid(0.0)).prior.is_none(),
            "how fast was it?"
        );
        for ms in (40..=400).step_by(40) {
            motion.advance(at(ms), fallen(0.001 * ms as f64), &aid(0.0));
        }
        let off_m = |guess: &Guess| {
            (guess.pose.translation.vector - fallen(0.44).translation.vector).norm()
        };
        let guess = motion.guess(at(440), &aid(0.0));
        assert!(
            off_m(&guess) < 1e-6 && guess.prior.is_some(),
            "{}",
            off_m(&guess)
        );
        let by_velocity = motion.guess(at(440), &Aid::default());
        assert!(off_m(&by_velocity) > 0.01 && by_velocity.prior.is_none());
        let broken = motion.guess(at(440), &aid(f64::NAN));
        assert!(off_m(&broken) < 0.02, "the gyroscope is still heard");
        assert!(
            motion.guess(at(900), &aid(0.0)).prior.is_none(),
            "too long ago"
        );
    }

    #[test]
    fn an_accelerometer_that_leans_does_not_lead_astray_for_long() {
        let at = |ms: u64| Stamp::from_nanos(ms * 1_000_000);
        // At rest; a world that is taken to be level and leans by 20 degrees.
        let pose = Isometry3::rotation(Vector3::new(0.35, 0.0, 0.0));
        let aid = Aid {
            turned: Some(UnitQuaternion::identity()),
            felt: Some(Felt {
                specific_force: Vector3::new(0.0, 0.0, GRAVITY_MPS2),
                unit_in_camera: Vector3::zeros(),
            }),
            ..Aid::default()
        };
        let mut motion = Motion::at_rest(at(0), pose);
        for frame in 1..300 {
            motion.advance(at(33 * frame), pose, &aid);
            let guess = motion.guess(at(33 * frame + 33), &aid);
            let off_m = guess.pose.translation.vector.norm();
            assert!(off_m < 0.07, "frame {frame}: {off_m} m");
        }
    }
}
