//! Satellite receivers: errors that wander, walls that hide the sky and reflect it, and fixes that come late or not at
//! all.
//!
//! With `q` the share of the sky that is open and `w` the unit vector towards the nearest wall, a fix is off by
//!
//! ```text
//! e = (σ_w·x + σ_s·y + σ·n) / q  +  m·(1 - q)·(x'/2 + |x''|·w)        x, x', x'': Gauss-Markov, y: the same, slower
//! ```
//!
//! - `x` and `n` are what orbits, clocks and the ionosphere leave, and white noise; `y` is a bias that walks over half
//!   an hour, but not for ever.
//! - Dilution of precision grows as `1/q`: `1/√q` since there are fewer satellites, and as much again since those left
//!   stand to one side.
//! - Multipath: what a wall reflects arrives late, so that satellites on the open side seem farther and the fix is
//!   pushed towards the wall, by `0.8·m·(1 - q)` on average. Carrier phase feels far less of it than code.
//!
//! The kind of fix follows the open sky: it drops at once and climbs one grade at a time, each after the sky has
//! allowed it for a while. An error changes its size with the grade but not its direction, so that a float solution
//! converges to, and jumps away from, the fixed one. What is reported as accuracy is what the receiver believes: no
//! multipath.
//!
//! Autopilots, whose own filter stands between this and their estimate, err by the simpler [`crate::vehicle::gnss`].
//!
//! A true position or velocity that is not finite has no fix. An open sky of NaN counts as none.
//!
//! - R. G. Brown, P. Y. C. Hwang, *Introduction to Random Signals and Applied Kalman Filtering*, 4th ed., §9.3.
//! - E. D. Kaplan, C. J. Hegarty, *Understanding GPS/GNSS*, 3rd ed., Artech House, 2017, ch. 9 (multipath), ch. 11
//!   (dilution of precision, circular error probable).
//! - P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems*, 2nd ed., Artech
//!   House, 2013, ch. 9, ch. 10.
//! - The data sheets named at the presets.

mod sky;

use std::collections::VecDeque;
use std::time::Duration;

use maps::frame::{Point, Vector, World};
use maps::time::Stamp;
use nalgebra::Vector3;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::process::Wander;
use crate::link::Outage;
use crate::vehicle::Motion;
use crate::vehicle::gnss::gaussian;

/// What kind of solution a receiver has, from the worst to the best.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FixType {
    /// None: no position.
    None,
    /// With a height that is hardly known.
    TwoD,
    /// From code ranges.
    ThreeD,
    /// From carrier phases whose whole cycles are not known.
    RtkFloat,
    /// From carrier phases.
    RtkFixed,
}

/// A standard deviation along each horizontal axis, and upwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Along east and along north.
    pub horizontal_m: f64,
    /// Upwards.
    pub vertical_m: f64,
}

/// How good one kind of fix is under an open sky, and how much sky it needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grade {
    /// Its kind.
    pub fix: FixType,
    /// Below this share of open sky there is no such fix.
    pub least_open_sky: f64,
    /// How long the sky must have allowed a better fix before this one comes about.
    pub settles: Duration,
    /// The part that wanders.
    pub wander: Spread,
    /// The bias that walks.
    pub walk: Spread,
    /// White noise.
    pub white: Spread,
    /// Multipath when the whole sky is hidden.
    pub multipath_m: f64,
}

/// A receiver.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceiverModel {
    /// Fixes a second.
    pub rate_hz: f64,
    /// How much later than its moment a fix comes.
    pub latency: Duration,
    /// How long the part that wanders takes to forget itself.
    pub wander_correlation_s: f64,
    /// The same for the bias that walks.
    pub walk_correlation_s: f64,
    /// The same for multipath, of a vehicle that moves.
    pub multipath_correlation_s: f64,
    /// Standard deviation of each axis of velocity under an open sky.
    pub velocity_noise_mps: f64,
    /// Satellites used under an open sky.
    pub satellites: u8,
    /// Horizontal dilution of precision under an open sky.
    pub hdop: f64,
    /// Vertical dilution of precision under an open sky.
    pub vdop: f64,
    /// The kinds of fix that it can have, the best first.
    pub grades: Vec<Grade>,
    /// When it is jammed, or its antenna covered.
    pub outages: Vec<Outage>,
}

impl ReceiverModel {
    /// u-blox NEO-M8N, data sheet UBX-13003366: 2.5 m circular error probable, that is 2.1 m along each axis; 0.05 m/s
    /// for half of all speeds. Its lag of 0.12 s is what `ArduPilot` assumes. How the error is split, and what walls
    /// do, is ours.
    pub fn m8n() -> Self {
        Self {
            rate_hz: 5.0,
            latency: Duration::from_millis(120),
            wander_correlation_s: 60.0,
            walk_correlation_s: 1800.0,
            multipath_correlation_s: 10.0,
            velocity_noise_mps: 0.074,
            satellites: 20,
            hdop: 0.7,
            vdop: 1.1,
            grades: code_grades(spread(1.5, 2.6), spread(1.46, 2.4), spread(0.3, 0.5), 6.0),
            outages: Vec::new(),
        }
    }

    /// u-blox ZED-F9P with corrections from a base near by, data sheet UBX-17051259: 1 cm circular error probable when
    /// fixed, 1.5 m without corrections, fixed within 10 s.
    pub fn rtk() -> Self {
        let mut grades = vec![
            Grade {
                fix: FixType::RtkFixed,
                least_open_sky: 0.65,
                settles: Duration::from_secs(10),
                wander: spread(0.007, 0.012),
                walk: spread(0.003, 0.006),
                white: spread(0.004, 0.006),
                multipath_m: 0.03,
            },
            Grade {
                fix: FixType::RtkFloat,
                least_open_sky: 0.4,
                settles: Duration::from_secs(2),
                wander: spread(0.3, 0.5),
                walk: spread(0.2, 0.3),
                white: spread(0.02, 0.03),
                multipath_m: 0.4,
            },
        ];
        let code = [spread(0.9, 1.5), spread(0.87, 1.5), spread(0.2, 0.35)];
        grades.extend(code_grades(code[0], code[1], code[2], 5.0));
        Self {
            satellites: 28,
            hdop: 0.55,
            vdop: 0.9,
            grades,
            ..Self::m8n()
        }
    }

    /// The same too far from its base to fix the cycles.
    pub fn rtk_float() -> Self {
        let mut model = Self::rtk();
        model.grades.remove(0);
        model
    }
}

fn spread(horizontal_m: f64, vertical_m: f64) -> Spread {
    Spread {
        horizontal_m,
        vertical_m,
    }
}

/// A fix in three dimensions, and one whose height is three times as uncertain, for less sky.
fn code_grades(wander: Spread, walk: Spread, white: Spread, multipath_m: f64) -> Vec<Grade> {
    let full = Grade {
        fix: FixType::ThreeD,
        least_open_sky: 0.25,
        settles: Duration::from_secs(1),
        wander,
        walk,
        white,
        multipath_m,
    };
    let flat = |s: Spread| spread(s.horizontal_m, 3.0 * s.vertical_m);
    let flat = Grade {
        fix: FixType::TwoD,
        least_open_sky: 0.12,
        wander: flat(wander),
        walk: flat(walk),
        ..full
    };
    vec![full, flat]
}

/// What the antenna sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sky {
    /// Which share of it is not hidden, 0 to 1.
    pub open: f64,
    /// Towards the nearest wall, of any length; `None` if there is none.
    pub wall: Option<Vector<World>>,
}

impl Sky {
    /// All of it, and no wall.
    pub const OPEN: Self = Self {
        open: 1.0,
        wall: None,
    };
}

/// What a receiver reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GnssReading {
    /// The moment that it is of, before its latency.
    pub at: Stamp,
    /// What kind of fix it is.
    pub fix: FixType,
    /// Satellites used.
    pub satellites: u8,
    /// Horizontal dilution of precision; 99.99, as receivers say, without a fix.
    pub hdop: f64,
    /// Where and how fast, if there is a fix.
    pub solution: Option<Solution>,
}

/// A position and velocity, and how good the receiver believes them to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Where it says it is.
    pub position: Point<World>,
    /// How fast it says it is, in m/s.
    pub velocity: Vector<World>,
    /// One standard deviation along each horizontal axis.
    pub horizontal_accuracy_m: f64,
    /// One standard deviation upwards.
    pub vertical_accuracy_m: f64,
    /// One standard deviation of each axis of velocity.
    pub speed_accuracy_mps: f64,
}

/// A receiver and its present errors.
#[derive(Clone, Debug)]
pub struct Receiver {
    model: ReceiverModel,
    /// Errors of unit variance: they keep their direction when a grade changes their size.
    wander: [Wander; 3],
    walk: [Wander; 3],
    reflections: [Wander; 3],
    push: Wander,
    state: State,
    under_way: VecDeque<(Stamp, GnssReading)>,
    random: Pcg64,
}

/// How far the receiver has come.
#[derive(Clone, Copy, Debug)]
enum State {
    /// Not asked yet: its first fix is as good as its sky allows.
    Warm,
    /// It has measured before.
    Running {
        /// When last.
        last: Stamp,
        /// Index of the grade it has; the number of grades if there is no fix.
        grade: usize,
        /// Since when the sky has allowed a better one.
        better_since: Stamp,
    },
}

impl Receiver {
    /// A receiver that has been on for long: its errors are what they are on average.
    pub fn new(model: ReceiverModel, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut three =
            |correlation_s: f64| [(); 3].map(|()| Wander::new(correlation_s, &mut random));
        let wander = three(model.wander_correlation_s);
        let walk = three(model.walk_correlation_s);
        let reflections = three(model.multipath_correlation_s);
        let push = Wander::new(model.multipath_correlation_s, &mut random);
        Self {
            model,
            wander,
            walk,
            reflections,
            push,
            state: State::Warm,
            under_way: VecDeque::new(),
            random,
        }
    }

    /// Whether the next [`Self::step`] measures, if it is then: only then it looks at the sky.
    pub fn is_due(&self, now: Stamp) -> bool {
        match self.state {
            State::Warm => true,
            State::Running { last, .. } => self.epoch(now) > self.epoch(last),
        }
    }

    fn epoch(&self, at: Stamp) -> u64 {
        // NaN and zero become no time at all, and a fix in each step.
        let period_ns = ((1e9 / self.model.rate_hz) as u64).max(1);
        at.as_nanos() / period_ns
    }

    /// Measures if it is time to, and hands over what has come through by now. Call it at least as often as there are
    /// fixes: each call measures once and hands over one reading at most. `now` must not go back.
    pub fn step(&mut self, now: Stamp, truth: &Motion, sky: Sky) -> Option<GnssReading> {
        if self.is_due(now) {
            let dt = match self.state {
                State::Warm => Duration::ZERO,
                State::Running { last, .. } => now.since(last),
            };
            let reading = self.measure(now, dt.as_secs_f64(), truth, sky);
            self.under_way
                .push_back((now + self.model.latency, reading));
        }
        let (due, _) = self.under_way.front()?;
        if *due > now {
            return None;
        }
        self.under_way.pop_front().map(|(_, reading)| reading)
    }

    fn measure(&mut self, now: Stamp, dt: f64, truth: &Motion, sky: Sky) -> GnssReading {
        let is_jammed = self.model.outages.iter().any(|o| covers(o, now));
        let is_somewhere = truth.position().is_finite() && truth.velocity.norm().is_finite();
        let open = if is_jammed || !is_somewhere || sky.open.is_nan() {
            0.0
        } else {
            sky.open.clamp(0.0, 1.0)
        };
        let grade = self.grade(now, open);
        // Errors go on and draw their numbers whether or not there is a fix.
        let errors = self.errors(dt);
        let velocity_noise = noise(&mut self.random);
        let solution = grade.map(|grade| {
            let error = errors.add_up(&grade, Sky { open, ..sky });
            self.solution(truth, &grade, open, [error, velocity_noise])
        });
        GnssReading {
            at: now,
            fix: grade.map_or(FixType::None, |grade| grade.fix),
            satellites: (f64::from(self.model.satellites) * open).round() as u8,
            hdop: grade.map_or(99.99, |_| self.model.hdop / open),
            solution,
        }
    }

    fn solution(
        &self,
        truth: &Motion,
        grade: &Grade,
        open: f64,
        [error, velocity_noise]: [Vector3<f64>; 2],
    ) -> Solution {
        let speed_accuracy_mps = self.model.velocity_noise_mps / open;
        let believed = |of: fn(&Spread) -> f64| {
            let parts = [grade.wander, grade.walk, grade.white];
            parts.iter().map(|s| of(s).powi(2)).sum::<f64>().sqrt() / open
        };
        Solution {
            position: truth.position() + Vector::from_raw(error),
            velocity: truth.velocity + Vector::from_raw(velocity_noise * speed_accuracy_mps),
            horizontal_accuracy_m: believed(|s| s.horizontal_m),
            vertical_accuracy_m: believed(|s| s.vertical_m),
            speed_accuracy_mps,
        }
    }

    /// The grade that this much open sky gives now.
    fn grade(&mut self, now: Stamp, open: f64) -> Option<Grade> {
        let grades = &self.model.grades;
        // No sky is no fix, whatever the model asks for: errors go as 1 / open.
        let allowed = grades
            .iter()
            .position(|g| open > 0.0 && open >= g.least_open_sky)
            .unwrap_or(grades.len());
        let (grade, better_since) = match self.state {
            State::Running {
                grade,
                better_since,
                ..
            } if allowed < grade => {
                if now.since(better_since) >= grades[grade - 1].settles {
                    (grade - 1, now)
                } else {
                    (grade, better_since)
                }
            }
            State::Warm | State::Running { .. } => (allowed, now),
        };
        self.state = State::Running {
            last: now,
            grade,
            better_since,
        };
        grades.get(grade).copied()
    }

    fn errors(&mut self, dt: f64) -> UnitErrors {
        let mut step = |axes: &mut [Wander; 3]| {
            let [x, y, z] = axes;
            Vector3::new(
                x.step(dt, &mut self.random),
                y.step(dt, &mut self.random),
                z.step(dt, &mut self.random),
            )
        };
        let [wander, walk] = [&mut self.wander, &mut self.walk].map(&mut step);
        let reflections = step(&mut self.reflections);
        UnitErrors {
            wander,
            walk,
            reflections,
            push: self.push.step(dt, &mut self.random).abs(),
            white: noise(&mut self.random),
        }
    }
}

/// Errors of unit variance at one moment.
struct UnitErrors {
    wander: Vector3<f64>,
    walk: Vector3<f64>,
    reflections: Vector3<f64>,
    push: f64,
    white: Vector3<f64>,
}

impl UnitErrors {
    /// What they amount to: the equation of the module.
    fn add_up(&self, grade: &Grade, sky: Sky) -> Vector3<f64> {
        let sized = |unit: &Vector3<f64>, s: Spread| {
            unit.component_mul(&Vector3::new(s.horizontal_m, s.horizontal_m, s.vertical_m))
        };
        let receiver = sized(&self.wander, grade.wander)
            + sized(&self.walk, grade.walk)
            + sized(&self.white, grade.white);
        let wall = sky.wall.and_then(|wall| wall.raw.try_normalize(1e-9));
        // A direction that is not finite is none.
        let wall = wall.filter(|w| w.iter().all(|c| c.is_finite()));
        let pushed = wall.map_or(Vector3::zeros(), |wall| wall * self.push);
        let multipath = self.reflections / 2.0 + pushed;
        receiver / sky.open + multipath * (grade.multipath_m * (1.0 - sky.open))
    }
}

fn noise(random: &mut Pcg64) -> Vector3<f64> {
    Vector3::from([(); 3].map(|()| gaussian(random)))
}

fn covers(outage: &Outage, at: Stamp) -> bool {
    at >= outage.from && at < outage.from + outage.span
}

#[cfg(test)]
mod tests;
