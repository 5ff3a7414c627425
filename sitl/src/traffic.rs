//! Who moves in a street, and how: vehicles on lanes, people on walkways, and what they do where these meet.
//!
//! A [`Plan`] says where lanes, walkways and crossings are and how many are on their way. [`Traffic::generate`] lets
//! them all move in steps of 50 ms and keeps a [`Track`] of each, which is then a pure function of time. One seed gives
//! one traffic, to the last bit.
//!
//! - Vehicles follow each other by the Intelligent Driver Model, slow down for curves, and pass a *gate* (`gate`:
//!   where another lane or a crossing comes in, or a signal stands) only after they have claimed it.
//! - People choose where to step by the heuristics of Moussaïd et al. (`walk`), and cross only where there is a
//!   crossing: at a zebra vehicles wait for them, elsewhere they wait for a gap.
//!
//! Nothing ever overlaps, for these reasons: no vehicle moves nearer to the one ahead than 0.3 m; two that
//! would meet where lanes meet hold rival gates, and only one at a time can; a crossing is free of vehicles before
//! anyone steps on it and closed until they have left; a step that would bring someone too near to another or to an
//! obstacle is not taken. The plan's part is to keep walkways off the lanes, but for crossings.
//!
//! - M. Treiber, A. Hennecke, D. Helbing, *Congested traffic states in empirical observations and microscopic
//!   simulations*, Physical Review E 62, 2000.
//! - M. Moussaïd, D. Helbing, G. Theraulaz, *How simple rules determine pedestrian behavior and crowd disasters*,
//!   PNAS 108, 2011.

mod avoid;
mod course;
mod gate;
mod kind;
mod path;
mod road;
mod shared;
mod track;
mod walk;

use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

pub use kind::{Kind, Manner};
pub use path::{Nearest, Path, Pose2};
pub use track::{State, Track};

use road::Road;
use walk::Crowd;

/// One step of the simulation.
const STEP_S: f64 = 0.05;
const STEPS_PER_SAMPLE: u32 = 2;
/// No plan is simulated for longer: its tracks would not fit into memory.
const LONGEST: Duration = Duration::from_hours(1);

/// What a scene asks for. All in the ground plane, x east and y north, in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Where vehicles drive.
    pub lanes: Vec<Lane>,
    /// Where people walk.
    pub walkways: Vec<Walkway>,
    /// Where people walk over lanes.
    pub crossings: Vec<Crossing>,
    /// Where vehicles wait for green.
    pub signals: Vec<Signal>,
    /// What people walk around.
    pub obstacles: Vec<Obstacle>,
    /// How many are on their way.
    pub agents: Agents,
    /// A vehicle of ours among them.
    pub guest: Option<Guest>,
    /// How long it goes on, at most an hour. Tracks end then.
    pub duration: Duration,
}

impl Default for Plan {
    fn default() -> Self {
        Self {
            lanes: Vec::new(),
            walkways: Vec::new(),
            crossings: Vec::new(),
            signals: Vec::new(),
            obstacles: Vec::new(),
            agents: Agents::default(),
            guest: None,
            duration: Duration::from_mins(3),
        }
    }
}

/// A [`Kind::Robot`] that starts at rest in a place of its own and drives to the end of its lane, where it stays. Its track is
/// the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guest {
    /// On which lane, by its place in the plan.
    pub lane: usize,
    /// Where its middle is at first, from the start of the lane.
    pub at_m: f64,
}

/// How many there are of each kind. Those for whom there is no room are left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Agents {
    /// Cars.
    pub cars: u16,
    /// Trucks.
    pub trucks: u16,
    /// Buses.
    pub buses: u16,
    /// Cyclists, at the right edge of the lanes.
    pub cyclists: u16,
    /// People on foot.
    pub pedestrians: u16,
}

/// A lane, driven in the direction of its path.
///
/// On an open one, who reaches the end is away for some seconds and then comes again at the start; so both ends are
/// best out of sight. Vehicles come and go with their middle at the ends, so that half a length beyond them must be
/// free.
///
/// Lanes side by side are to be 3 m apart. Where they cross, join or come closer, vehicles of one wait for those of the
/// other; so lanes that share a stretch should share a short one.
#[derive(Clone, Debug, PartialEq)]
pub struct Lane {
    /// Its middle. Corners of 6 m radius or more look well; long vehicles want 10 m.
    pub path: Path,
    /// Cars pass cyclists where it is wide enough, from 4.4 m on, and follow them elsewhere.
    pub width_m: f64,
    /// No one drives faster.
    pub speed_limit_mps: f64,
}

/// A pavement. People walk it both ways and turn round at its ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Walkway {
    /// Its middle. Corners should be no tighter than half its width.
    pub path: Path,
    /// From edge to edge. Feet stay 0.3 m inside; below 1.8 m people can hardly pass each other.
    pub width_m: f64,
}

/// A straight way over the lanes, from one walkway to another. Ends that are farther than 3 m from any walkway lead
/// nowhere, and nobody uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Its ends, on the edges of two walkways.
    pub ends: [[f64; 2]; 2],
    /// From edge to edge, at least 1.6 m.
    pub width_m: f64,
    /// Who waits for whom.
    pub priority: Priority,
}

/// Who waits for whom on a crossing. Who has begun to cross is never hurried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Priority {
    /// Vehicles stop for those who wait, as at a zebra crossing.
    Pedestrians,
    /// People wait for a gap, as between parked cars.
    Vehicles,
}

/// A traffic light for one lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signal {
    /// Which lane it is for, by its place in the plan.
    pub lane: usize,
    /// Where its stop line is, from the start of the lane.
    pub at_m: f64,
    /// From one start of green to the next.
    pub cycle_s: f64,
    /// The first start of green.
    pub green_from_s: f64,
    /// How long it is green.
    pub green_for_s: f64,
}

/// Something that stands on a walkway or beside a crossing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Obstacle {
    /// A pole or a tree.
    Circle {
        /// Its middle.
        centre: [f64; 2],
        /// Its radius in metres.
        radius_m: f64,
    },
    /// A parked car or a bench.
    Box {
        /// Its middle.
        centre: [f64; 2],
        /// Where its length points, counter-clockwise from east.
        heading_rad: f64,
        /// Length and width in metres.
        size_m: [f64; 2],
    },
}

/// Everyone who is on their way.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traffic {
    /// Vehicles first, then people.
    pub tracks: Vec<Track>,
}

impl Traffic {
    /// Lets everyone in the plan move. 30 vehicles and 30 people for 180 s take about 0.1 s of processor time, half of
    /// it for people who choose their way; the cost grows with the square of how many are on a lane or on foot.
    pub fn generate(plan: &Plan, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut road = Road::new(plan, &mut random);
        let mut crowd = Crowd::new(plan, &mut random);
        let mut tracks = road.tracks();
        let vehicles = tracks.len();
        tracks.extend(crowd.tracks());
        let samples = (plan.duration.min(LONGEST).as_secs_f64() / 0.1).ceil() as u32;
        for step in 0..=samples * STEPS_PER_SAMPLE {
            if step.is_multiple_of(STEPS_PER_SAMPLE) {
                let (driving, walking) = tracks.split_at_mut(vehicles);
                road.record(driving);
                crowd.record(walking);
            }
            let now_s = f64::from(step) * STEP_S;
            road.step(now_s, crowd.closed(&road));
            crowd.step(now_s, &road);
        }
        Self { tracks }
    }
}

/// Looks and size of one of that kind: no two are quite alike.
fn appearance(kind: Kind, random: &mut Pcg64) -> (u32, [f64; 3]) {
    let [length, width, height] = kind.size_m();
    let mut vary = |size_m: f64, share: f64| size_m * random.random_range(1.0 - share..=1.0);
    let size_m = [vary(length, 0.1), vary(width, 0.04), vary(height, 0.08)];
    (random.random(), size_m)
}

#[cfg(test)]
mod tests;
