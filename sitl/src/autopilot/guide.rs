//! From where to go to what the vehicle is to do.
//!
//! ```text
//! copter:  v = e/|e| · min(v_max, √(2·a·|e|), k·|e|)      rover: pure pursuit, see `pursuit`
//! ```

use std::time::Duration;

use maps::frame::{Point, Vector, World};
use maps::time::Stamp;

use super::mode::Mode;
use super::parameters::Parameter;
use super::pursuit::{Line, Style};
use super::{Autopilot, STAND};
use crate::vehicle::{copter, rover};

/// Loss of speed that a copter counts on when it approaches a place, m/s².
const APPROACH_MPS2: f64 = 0.8;
/// Speed per distance, close by, in 1/s.
const POSITION_GAIN: f64 = 1.0;
/// A velocity asked for by a companion holds this long.
const VELOCITY_PATIENCE: Duration = Duration::from_secs(3);

/// Where to go.
#[derive(Clone, Debug)]
pub(super) enum Goal {
    /// Rover: stand. Copter: stay where it is when it gets this goal.
    Stay,
    /// Copter: be there.
    Hover(Point<World>),
    /// Copter: straight up to that height of the world.
    TakeOff(Point<World>),
    /// Copter: down, and disarm.
    Land(Point<World>),
    /// Rover: along the line; the numbers are the mission items of its waypoints.
    Drive { line: Line, items: Vec<usize> },
}

/// What a companion or ground station has asked for in GUIDED.
#[derive(Clone, Debug, Default)]
pub(super) struct Guided {
    /// Fly or drive with this velocity, from that moment on.
    pub(super) velocity: Option<(Vector<World>, Stamp)>,
    /// Heading to turn to, counter-clockwise from east.
    pub(super) heading_rad: Option<f64>,
}

impl Autopilot {
    /// What the copter's motors are to do.
    pub(super) fn fly(&mut self, now: Stamp) -> copter::Control {
        if !self.armed {
            self.goal = Goal::Stay;
            return copter::Control::Off;
        }
        let here = self.estimate.position();
        if self.on_ground()
            && !matches!(self.goal, Goal::TakeOff(_))
            && self.takes_off_only_when_told()
        {
            return copter::Control::Off;
        }
        if let Some(velocity) = self.guided_velocity(now) {
            return self.fly_with(velocity);
        }
        if matches!(self.goal, Goal::Stay) {
            self.goal = Goal::Hover(here);
        }
        let wanted = match self.goal {
            Goal::Hover(to) | Goal::TakeOff(to) => self.approach(to),
            Goal::Land(above) => {
                let mut velocity = self.approach(Point::new(above.raw.x, above.raw.y, here.raw.z));
                let pauses = self.failsafe.pause_until.is_some_and(|until| now < until);
                velocity.raw.z = if pauses { 0.0 } else { -self.landing_speed() };
                velocity
            }
            Goal::Stay | Goal::Drive { .. } => Vector::new(0.0, 0.0, 0.0),
        };
        self.fly_with(wanted)
    }

    /// On the ground it stays there, whatever its goal, until it is told to take off.
    fn takes_off_only_when_told(&self) -> bool {
        match self.goal {
            Goal::TakeOff(_) => false,
            Goal::Stay | Goal::Hover(_) | Goal::Land(_) | Goal::Drive { .. } => true,
        }
    }

    /// Slower far up than near the ground would waste time; faster near the ground would break it.
    fn landing_speed(&self) -> f64 {
        let final_mps = self.parameters.get(Parameter::LandSpeed) / 100.0;
        let cruise_mps = self.parameters.get(Parameter::CopterSpeedDown) / 100.0;
        if self.height() > 3.0 {
            cruise_mps.max(final_mps)
        } else {
            final_mps
        }
    }

    /// Above home.
    pub(super) fn height(&self) -> f64 {
        self.estimate.position().raw.z - self.home.map_or(0.0, |home| home.raw.z)
    }

    /// The velocity of a copter towards a place, in a straight line.
    fn approach(&self, to: Point<World>) -> Vector<World> {
        let get = |parameter| self.parameters.get(parameter) / 100.0;
        let error = to - self.estimate.position();
        let limited = |distance: f64, top: f64| {
            top.min((2.0 * APPROACH_MPS2 * distance).sqrt())
                .min(POSITION_GAIN * distance)
        };
        let across = error.raw.xy();
        let distance = across.norm();
        let speed = limited(
            distance,
            self.speed_mps
                .unwrap_or_else(|| get(Parameter::CopterSpeed)),
        );
        let level = if distance > 1e-9 {
            across * (speed / distance)
        } else {
            across
        };
        let up = error.raw.z;
        let top = if up > 0.0 {
            get(Parameter::CopterSpeedUp)
        } else {
            get(Parameter::CopterSpeedDown)
        };
        Vector::new(level.x, level.y, limited(up.abs(), top).copysign(up))
    }

    /// Turns to where it flies, if it flies somewhere.
    fn fly_with(&self, velocity: Vector<World>) -> copter::Control {
        let goes = velocity.raw.xy().norm() > 0.3 && self.mode != Mode::Land;
        let along = if goes {
            velocity.raw.y.atan2(velocity.raw.x)
        } else {
            self.estimate.heading_rad()
        };
        let told = (self.mode == Mode::Guided)
            .then_some(self.guided.heading_rad)
            .flatten();
        copter::Control::Fly {
            velocity,
            heading_rad: told.unwrap_or(along),
        }
    }

    /// The velocity asked for in GUIDED, until it is too old: then it stops.
    fn guided_velocity(&mut self, now: Stamp) -> Option<Vector<World>> {
        let (velocity, since) = self.guided.velocity?;
        if self.mode != Mode::Guided || now.since(since) > VELOCITY_PATIENCE {
            self.guided.velocity = None;
            self.goal = Goal::Stay;
            return None;
        }
        Some(velocity)
    }

    /// What the rover's wheels are to do.
    pub(super) fn drive(&mut self, now: Stamp) -> rover::Control {
        if !self.armed {
            self.goal = Goal::Stay;
            return STAND;
        }
        if let Some(velocity) = self.guided_velocity(now) {
            return self.drive_with(velocity);
        }
        let style = self.style();
        let Goal::Drive { line, items } = &mut self.goal else {
            return STAND;
        };
        let progress = line.follow(&self.estimate, &style);
        let reached: Vec<usize> = items.drain(..progress.reached.min(items.len())).collect();
        if line.is_done() {
            self.goal = Goal::Stay;
        }
        for item in reached {
            self.item_reached(item);
        }
        progress.control
    }

    /// A rover cannot go sideways: it drives with the part of the velocity that lies ahead, and steers towards it.
    fn drive_with(&self, velocity: Vector<World>) -> rover::Control {
        let (sin, cos) = self.estimate.heading_rad().sin_cos();
        let (ahead, left) = (
            velocity.raw.x * cos + velocity.raw.y * sin,
            velocity.raw.y * cos - velocity.raw.x * sin,
        );
        let limit = 1.0 / self.parameters.get(Parameter::TurnRadius);
        rover::Control {
            speed_mps: ahead,
            curvature_per_m: (2.0 * left.atan2(ahead.abs())).clamp(-limit, limit),
        }
    }

    fn style(&self) -> Style {
        let get = |parameter| self.parameters.get(parameter);
        Style {
            speed_mps: self
                .speed_mps
                .unwrap_or_else(|| get(Parameter::CruiseSpeed)),
            reverse: self.reverse,
            look_ahead_m: get(Parameter::LookAhead),
            braking_mps2: get(Parameter::Braking),
            radius_m: get(Parameter::RoverWaypointRadius),
            min_turning_radius_m: get(Parameter::TurnRadius),
        }
    }

    /// Lands, then stops the motors; a copter on the ground that does not want to fly is disarmed after a while.
    pub(super) fn disarm_on_the_ground(&mut self, now: Stamp) {
        let idle = self.armed
            && self.kind == super::Kind::Copter
            && self.on_ground()
            && !matches!(self.goal, Goal::TakeOff(_));
        if !idle {
            self.idle_since = None;
            return;
        }
        let since = *self.idle_since.get_or_insert(now);
        let landing = matches!(self.goal, Goal::Land(_));
        let delay_s = self.parameters.get(Parameter::DisarmDelay);
        let patience = if landing {
            Duration::from_secs(1)
        } else {
            Duration::from_secs_f64(delay_s)
        };
        if (landing || delay_s > 0.0) && now.since(since) >= patience {
            self.landed();
        }
    }
}
