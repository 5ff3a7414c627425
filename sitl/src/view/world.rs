//! Where the vehicles truly are, as the run tells it, and where they were.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use maps::frame::{Body, Isometry, World};
use maps::time::Stamp;
use sitl::simulation::{COPTER, Simulation};

/// The window takes them before every picture; hidden, it takes none, and the newer ones are lost.
const QUEUE: usize = 256;
/// Poses that are remembered lie at least this far apart.
const SPACING: Duration = Duration::from_millis(100);
/// An hour of them.
const REMEMBERED: usize = 36_000;

/// Vehicles of which somebody simulates the autopilots; the others are where the scene has them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Poses {
    pub(crate) uav: Option<Isometry<World, Body>>,
    pub(crate) ugv: Option<Isometry<World, Body>>,
}

/// What the run says of one moment.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Snapshot {
    pub(crate) at: Stamp,
    pub(crate) poses: Poses,
    /// What else there is to say of the vehicles, a line each.
    pub(crate) lines: Vec<String>,
}

impl Snapshot {
    fn of(simulation: &Simulation) -> Self {
        let (mut poses, mut lines) = (Poses::default(), Vec::new());
        for autopilot in simulation.vehicles() {
            let pose = autopilot.truth().world_from_body;
            let (place, name) = if autopilot.address() == COPTER {
                (&mut poses.uav, "copter")
            } else {
                (&mut poses.ugv, "rover")
            };
            *place = Some(pose);
            let armed = if autopilot.is_armed() { " armed" } else { "" };
            let [x, y, z]: [f64; 3] = pose.translation().raw.coords.into();
            let mode = autopilot.mode();
            lines.push(format!(
                "{name} {mode}{armed} at ({x:.1}, {y:.1}, {z:.1}) m"
            ));
        }
        Self {
            at: simulation.now(),
            poses,
            lines,
        }
    }
}

/// The run's end: tells where the vehicles are.
pub(crate) struct Teller {
    told: Stamp,
    to: SyncSender<Snapshot>,
}

impl Teller {
    /// Tells it, once a step. Never waits.
    pub(crate) fn tell(&mut self, simulation: &Simulation) {
        if simulation.now() > self.told {
            self.told = simulation.now();
            // Who does not look is told nothing.
            let _unheard = self.to.try_send(Snapshot::of(simulation));
        }
    }
}

/// The window's end.
pub(crate) struct History {
    from: Receiver<Snapshot>,
    past: VecDeque<(Stamp, Poses)>,
    newest: Option<Snapshot>,
}

/// Both ends.
pub(crate) fn channel() -> (Teller, History) {
    let (to, from) = sync_channel(QUEUE);
    let told = Stamp::ZERO;
    (Teller { told, to }, History::new(from))
}

impl History {
    fn new(from: Receiver<Snapshot>) -> Self {
        Self {
            from,
            past: VecDeque::new(),
            newest: None,
        }
    }

    /// Takes what has been told; returns the present, where there is one.
    pub(crate) fn listen(&mut self) -> Option<Stamp> {
        while let Ok(snapshot) = self.from.try_recv() {
            let last = self.past.back().map(|(at, _)| *at);
            if last.is_none_or(|last| snapshot.at >= last + SPACING) {
                if self.past.len() == REMEMBERED {
                    self.past.pop_front();
                }
                self.past.push_back((snapshot.at, snapshot.poses));
            }
            self.newest = Some(snapshot);
        }
        self.newest.as_ref().map(|newest| newest.at)
    }

    /// Where the vehicles were then; before the first that is remembered, there.
    pub(crate) fn poses(&self, at: Stamp) -> Poses {
        let Some(newest) = &self.newest else {
            return Poses::default();
        };
        if at >= newest.at {
            return newest.poses;
        }
        let next = self.past.partition_point(|(then, _)| *then <= at);
        let after = self.past.get(next).copied();
        let after = after.unwrap_or((newest.at, newest.poses));
        let Some(before) = next.checked_sub(1).and_then(|i| self.past.get(i)) else {
            return after.1;
        };
        let span = after.0.since(before.0).as_secs_f64();
        let share = at.since(before.0).as_secs_f64() / span.max(1e-9);
        Poses {
            uav: between(before.1.uav, after.1.uav, share),
            ugv: between(before.1.ugv, after.1.ugv, share),
        }
    }

    /// What is said of the vehicles now.
    pub(crate) fn lines(&self) -> &[String] {
        self.newest.as_ref().map_or(&[], |newest| &newest.lines)
    }
}

fn between(
    from: Option<Isometry<World, Body>>,
    to: Option<Isometry<World, Body>>,
    share: f64,
) -> Option<Isometry<World, Body>> {
    let (from, to) = (from?, to?);
    let between = from.raw.try_lerp_slerp(&to.raw, share, 1e-9);
    Some(Isometry::claim(between.unwrap_or(to.raw)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;

    fn told(to: &SyncSender<Snapshot>, millis: u64) {
        let east = Isometry::claim(Isometry3::translation(millis as f64 / 1000.0, 0.0, 0.0));
        let snapshot = Snapshot {
            at: Stamp::from_nanos(millis * 1_000_000),
            poses: Poses {
                uav: Some(east),
                ugv: None,
            },
            lines: vec![format!("at {millis}")],
        };
        to.try_send(snapshot).expect("room");
    }

    fn east_m(history: &History, millis: u64) -> f64 {
        let poses = history.poses(Stamp::from_nanos(millis * 1_000_000));
        poses.uav.expect("told").raw.translation.x
    }

    #[test]
    fn the_past_is_where_they_were_and_the_present_where_they_are() {
        let (to, from) = sync_channel(QUEUE);
        let mut history = History::new(from);
        assert_eq!(history.listen(), None);
        assert_eq!(history.poses(Stamp::ZERO), Poses::default());
        (1..=100).for_each(|i| told(&to, 20 * i));
        assert_eq!(history.listen(), Some(Stamp::from_nanos(2_000_000_000)));
        assert_eq!(history.lines(), ["at 2000"]);
        for millis in [50, 777, 1000, 1990, 2000] {
            let off = east_m(&history, millis) - millis as f64 / 1000.0;
            assert!(off.abs() < 1e-9, "{off} m at {millis} ms");
        }
        assert!((east_m(&history, 9999) - 2.0).abs() < 1e-9, "no guesses");
        assert!((east_m(&history, 0) - 0.02).abs() < 1e-9, "the first known");
    }

    #[test]
    fn memory_has_an_end() {
        let (to, from) = sync_channel(QUEUE);
        let mut history = History::new(from);
        for i in 0..REMEMBERED as u64 + 100 {
            told(&to, 100 * i);
            history.listen();
        }
        assert_eq!(history.past.len(), REMEMBERED);
        assert!((east_m(&history, 0) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn a_window_that_does_not_listen_stops_no_run() {
        let (mut teller, _history) = channel();
        let origin = "50.7277,7.0866,110".parse().expect("a place");
        let mut simulation = Simulation::new([sitl::simulation::copter(&origin, None, 1)]);
        for _ in 0..2 * QUEUE {
            simulation.step(&sitl::simulation::Event::Tick);
            teller.tell(&simulation);
        }
        let (mut teller, history) = channel();
        drop(history);
        teller.tell(&simulation);
    }
}
