//! Where a vehicle has been in a run: its true pose at every step.
//!
//! A run adds to it while others look back along it, so that pictures may be drawn later than what they show.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use maps::frame::{Body, Isometry, World};
use maps::time::Stamp;
use nalgebra::Isometry3;

use crate::traffic::State;

/// A way that grows.
#[derive(Debug)]
pub struct Way {
    step: Duration,
    steps: Mutex<Steps>,
    grown: Condvar,
}

#[derive(Debug)]
struct Steps {
    poses: Vec<Isometry3<f64>>,
    /// How far it had come at each.
    travelled_m: Vec<f64>,
    has_ended: bool,
}

impl Way {
    /// One that starts there at time zero and goes on by such steps.
    pub fn new(step: Duration, start: Isometry<World, Body>) -> Self {
        Self {
            step,
            steps: Mutex::new(Steps {
                poses: vec![start.raw],
                travelled_m: vec![0.0],
                has_ended: false,
            }),
            grown: Condvar::new(),
        }
    }

    /// One step on.
    pub fn push(&self, pose: Isometry<World, Body>) {
        let mut steps = self.steps();
        let before = steps
            .poses
            .last()
            .map_or(pose.raw.translation.vector, |p| p.translation.vector);
        let travelled = steps.travelled_m.last().copied().unwrap_or(0.0);
        let moved = (pose.raw.translation.vector - before).norm();
        steps.poses.push(pose.raw);
        steps.travelled_m.push(travelled + moved);
        drop(steps);
        self.grown.notify_all();
    }

    /// There are no more steps.
    pub fn end(&self) {
        self.steps().has_ended = true;
        self.grown.notify_all();
    }

    /// Waits until it is known up to that time, at most; `false` if it ended before.
    pub fn reaches(&self, at: Stamp) -> bool {
        let steps = self.steps();
        let is_short = |steps: &mut Steps| !steps.has_ended && self.known(steps) < at;
        let steps = self
            .grown
            .wait_while(steps, is_short)
            .unwrap_or_else(PoisonError::into_inner);
        self.known(&steps) >= at
    }

    /// Where it was, between steps in a straight line; where it was last, if that is later.
    pub fn pose(&self, at: Stamp) -> Isometry<World, Body> {
        let steps = self.steps();
        let (index, share) = self.index(&steps, at);
        let [from, to] = [index, index + 1].map(|i| steps.poses[i.min(steps.poses.len() - 1)]);
        let turn = from.rotation.slerp(&to.rotation, share);
        let place = from.translation.vector.lerp(&to.translation.vector, share);
        Isometry::claim(Isometry3::from_parts(place.into(), turn))
    }

    /// The same as road users are told of.
    pub(crate) fn state(&self, at: Stamp) -> State {
        let pose = self.pose(at).raw;
        let soon = self.pose(at + self.step).raw;
        let steps = self.steps();
        let (index, share) = self.index(&steps, at);
        let last = steps.travelled_m.len() - 1;
        let [from, to] = [index, index + 1].map(|i| steps.travelled_m[i.min(last)]);
        let forward = pose.rotation * nalgebra::Vector3::x();
        let way = soon.translation.vector - pose.translation.vector;
        State {
            position: [pose.translation.x, pose.translation.y],
            heading_rad: forward.y.atan2(forward.x),
            speed_mps: way.norm() / self.step.as_secs_f64(),
            travelled_m: from + (to - from) * share,
        }
    }

    /// The step before that time, and how much of the next has passed.
    fn index(&self, steps: &Steps, at: Stamp) -> (usize, f64) {
        let step_ns = self.step.as_nanos().max(1) as u64;
        let index = usize::try_from(at.as_nanos() / step_ns).unwrap_or(usize::MAX);
        let share = (at.as_nanos() % step_ns) as f64 / step_ns as f64;
        let last = steps.poses.len() - 1;
        if index >= last {
            (last, 0.0)
        } else {
            (index, share)
        }
    }

    fn known(&self, steps: &Steps) -> Stamp {
        let count = u32::try_from(steps.poses.len() - 1).unwrap_or(u32::MAX);
        Stamp::ZERO + self.step * count
    }

    fn steps(&self) -> MutexGuard<'_, Steps> {
        // Poses are whole whoever panics.
        self.steps.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::thread;

    use super::*;

    const STEP: Duration = Duration::from_millis(20);

    fn east(x: f64) -> Isometry<World, Body> {
        Isometry::claim(Isometry3::translation(x, 0.0, 0.0))
    }

    fn at(ms: u64) -> Stamp {
        Stamp::ZERO + Duration::from_millis(ms)
    }

    #[test]
    fn poses_between_steps_lie_on_the_way_and_the_last_one_stays() {
        let way = Way::new(STEP, east(0.0));
        way.push(east(1.0));
        way.push(east(3.0));
        let x = |ms| way.pose(at(ms)).translation().raw.x;
        assert!((x(10) - 0.5).abs() < 1e-12 && (x(30) - 2.0).abs() < 1e-12);
        assert!((x(40) - 3.0).abs() < 1e-12 && (x(5000) - 3.0).abs() < 1e-12);
        assert!((way.state(at(10)).travelled_m - 0.5).abs() < 1e-12);
        assert!((way.state(at(0)).speed_mps - 50.0).abs() < 1e-9);
    }

    #[test]
    fn who_waits_for_a_way_goes_on_when_it_is_long_enough_or_ends() {
        let way = Arc::new(Way::new(STEP, east(0.0)));
        let waits = |until| {
            let way = Arc::clone(&way);
            thread::Builder::new()
                .spawn(move || way.reaches(at(until)))
                .expect("a thread")
        };
        let (near, far) = (waits(40), waits(60));
        way.push(east(1.0));
        way.push(east(2.0));
        assert!(near.join().expect("no panic"), "two steps");
        way.end();
        assert!(!far.join().expect("no panic"), "it ended before");
    }
}
