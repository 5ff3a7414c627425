//! Vehicles on their lanes: each follows the one ahead, keeps to what the lane allows, and stops at closed gates.
//!
//! ```text
//! v̇ = a·(1 - (v/v₀)⁴ - (s*/s)²)      s* = s₀ + max(0, v·T + v·Δv/(2√(a·b)))
//! ```
//!
//! with the gap `s` to the one ahead, the speed `Δv` at which it closes, and the lane's speed there as `v₀`. A gate
//! that stays closed is one ahead that stands. Whatever the equation says, nobody drives nearer to the one ahead than
//! [`NEAREST_M`], nor over the line of a gate they do not hold (`claim`).
//!
//! - M. Treiber, A. Hennecke, D. Helbing, Physical Review E 62, 2000; with the maximum as in M. Treiber, A. Kesting,
//!   *Traffic Flow Dynamics*, Springer 2013, ch. 11.

mod claim;
mod populate;

use rand::RngExt as _;
use rand_pcg::Pcg64;

use super::STEP_S;
use super::course::Course;
use super::gate::{Gate, Span};
use super::kind::{Kind, Manner};
use super::shared::Shared;
use super::track::{State, Track};

/// Least gap between two vehicles.
const NEAREST_M: f64 = 0.3;
/// Free space beside someone who is passed.
const PASSING_M: f64 = 0.4;
/// Nobody brakes harder, in m/s².
const HARDEST_MPS2: f64 = 8.0;

/// All lanes and who drives on them.
pub(super) struct Road {
    courses: Vec<Course>,
    gates: Vec<Gate>,
    /// The gates of each lane.
    gates_of: Vec<Vec<usize>>,
    vehicles: Vec<Vehicle>,
    /// Stretches of which two lanes have a part.
    shared: Vec<Shared>,
    /// The vehicles of each lane.
    members: Vec<Vec<usize>>,
    /// Who holds each gate.
    holders: Vec<Vec<usize>>,
    /// Where each crossing of the plan leads over lanes.
    spans: Vec<Vec<Span>>,
    random: Pcg64,
}

struct Vehicle {
    kind: Kind,
    seed: u32,
    size_m: [f64; 3],
    manner: Manner,
    /// Share of the speed that is allowed.
    haste: f64,
    lane: usize,
    left_m: f64,
    /// Its middle, from the start of the lane; on a closed lane less than its length.
    along_m: f64,
    speed_mps: f64,
    travelled_m: f64,
    /// Away from an open lane until then.
    away_until_s: Option<f64>,
    held: Vec<Held>,
    waiting: Option<Waiting>,
}

/// A gate that a vehicle holds.
struct Held {
    gate: usize,
    /// When it has travelled that far, its tail is out of the gate.
    until_m: f64,
}

/// What a vehicle waits for that others hold.
struct Waiting {
    gates: Vec<usize>,
    since_s: f64,
}

/// Who is ahead.
#[derive(Clone, Copy)]
struct Leader {
    gap_m: f64,
    speed_mps: f64,
}

impl Vehicle {
    fn drives(&self) -> bool {
        self.away_until_s.is_none()
    }

    fn length_m(&self) -> f64 {
        self.size_m[0]
    }
}

impl Road {
    pub(super) fn gate_count(&self) -> usize {
        self.gates.len()
    }

    /// Where a crossing of the plan leads over lanes.
    pub(super) fn spans(&self, crossing: usize) -> &[Span] {
        self.spans.get(crossing).map_or(&[], Vec::as_slice)
    }

    /// An empty track for each vehicle.
    pub(super) fn tracks(&self) -> Vec<Track> {
        let track = |v: &Vehicle| Track::new(v.kind, v.seed, v.size_m);
        self.vehicles.iter().map(track).collect()
    }

    /// Adds where everyone is to their tracks.
    pub(super) fn record(&self, tracks: &mut [Track]) {
        for (vehicle, track) in self.vehicles.iter().zip(tracks) {
            let pose = self.courses[vehicle.lane].pose(
                vehicle.along_m,
                vehicle.left_m,
                vehicle.length_m(),
            );
            track.push(vehicle.drives().then_some(State {
                position: [pose.x, pose.y],
                heading_rad: pose.heading_rad,
                speed_mps: vehicle.speed_mps,
                travelled_m: vehicle.travelled_m,
            }));
        }
    }

    /// Lets everyone drive for [`STEP_S`]. `closed` says which gates people on foot keep closed.
    pub(super) fn step(&mut self, now_s: f64, closed: &[bool]) {
        for lane in 0..self.members.len() {
            self.let_in(lane, now_s, closed);
        }
        for i in 0..self.vehicles.len() {
            if self.vehicles[i].drives() {
                self.drive(i, now_s, closed);
            }
        }
    }

    fn drive(&mut self, i: usize, now_s: f64, closed: &[bool]) {
        let leader = self.leader(i);
        let gate_m = self.distance_to_stop(i, now_s, closed);
        let stop_m = gate_m
            .into_iter()
            .chain(self.stays_in_m(i))
            .reduce(f64::min);
        let vehicle = &self.vehicles[i];
        let (manner, speed) = (vehicle.manner, vehicle.speed_mps);
        let free_mps = self.free_speed(vehicle, vehicle.along_m);
        let mut pull = follow(&manner, speed, free_mps, leader);
        if let Some(stop_m) = stop_m {
            // The model comes to rest at its gap to the one ahead: let that be at the line.
            let line = Leader {
                gap_m: stop_m + manner.standstill_gap_m,
                speed_mps: 0.0,
            };
            pull = pull.min(follow(&manner, speed, free_mps, Some(line)));
        }
        let wanted = speed + pull.max(-HARDEST_MPS2) * STEP_S;
        let limit = self.free_speed(vehicle, vehicle.along_m + speed * STEP_S);
        let next = wanted.min(limit).max(0.0);
        let mut way_m = f64::midpoint(speed, next) * STEP_S;
        let room_m = leader.map_or(f64::INFINITY, |leader| leader.gap_m - NEAREST_M);
        let room_m = room_m.min(stop_m.unwrap_or(f64::INFINITY));
        let mut next_mps = next;
        if way_m > room_m {
            way_m = room_m.max(0.0);
            next_mps = next.min(way_m / STEP_S);
        }
        self.advance(i, way_m, next_mps, now_s);
    }

    /// How far it is to the end of the lane, for a guest, who stays there.
    fn stays_in_m(&self, i: usize) -> Option<f64> {
        let vehicle = &self.vehicles[i];
        let course = &self.courses[vehicle.lane];
        let stays = vehicle.kind == Kind::Robot && !course.path().is_closed();
        stays.then(|| (course.length_m() - vehicle.along_m - vehicle.length_m()).max(0.0))
    }

    fn advance(&mut self, i: usize, way_m: f64, speed_mps: f64, now_s: f64) {
        let away_s = self.random.random_range(2.0..6.0);
        let vehicle = &mut self.vehicles[i];
        let course = &self.courses[vehicle.lane];
        vehicle.speed_mps = speed_mps;
        vehicle.along_m += way_m;
        vehicle.travelled_m += way_m;
        if course.path().is_closed() {
            vehicle.along_m = vehicle.along_m.rem_euclid(course.length_m());
        } else if vehicle.along_m >= course.length_m() {
            vehicle.away_until_s = Some(now_s + away_s);
        }
        self.let_go(i);
    }

    /// The speed a vehicle would have there if it were alone.
    fn free_speed(&self, vehicle: &Vehicle, along_m: f64) -> f64 {
        let allowed = self.courses[vehicle.lane].speed_mps(vehicle.kind, along_m);
        (allowed * vehicle.haste).min(vehicle.manner.desired_speed_mps)
    }

    /// The nearest one ahead that it cannot pass.
    fn leader(&self, i: usize) -> Option<Leader> {
        let vehicle = &self.vehicles[i];
        let course = &self.courses[vehicle.lane];
        self.others(i)
            .filter(|(other, _)| self.in_the_way(vehicle, other))
            .filter_map(|(other, along_m)| {
                let ahead_m = course.ahead_m(vehicle.along_m, along_m)?;
                Some(Leader {
                    gap_m: ahead_m - f64::midpoint(vehicle.length_m(), other.length_m()),
                    speed_mps: other.speed_mps,
                })
            })
            .min_by(|a, b| a.gap_m.total_cmp(&b.gap_m))
    }

    /// All others who drive on its lane, or on a stretch that this lane shares with theirs, and where on its lane they
    /// are.
    fn others(&self, i: usize) -> impl Iterator<Item = (&Vehicle, f64)> {
        let lane = self.vehicles[i].lane;
        let members = self.members[lane].iter().filter(move |&&j| j != i);
        let on_lane = members.map(|&j| (&self.vehicles[j], self.vehicles[j].along_m));
        let shared = self.shared.iter().flat_map(move |shared| {
            let lanes = shared.lanes.iter().filter(move |&&other| other != lane);
            let visitors = lanes.flat_map(|&other| &self.members[other]);
            visitors.filter_map(move |&j| {
                let visitor = &self.vehicles[j];
                let along_m = shared.on_lane(lane, visitor.lane, visitor.along_m)?;
                Some((visitor, along_m))
            })
        });
        on_lane.chain(shared).filter(|(other, _)| other.drives())
    }

    /// Whether there is too little room for one to pass the other on their lane.
    fn in_the_way(&self, a: &Vehicle, b: &Vehicle) -> bool {
        let course = &self.courses[a.lane];
        let swept_m = course.swept_m(a.kind) + course.swept_m(b.kind);
        let needed_m = f64::midpoint(a.size_m[1], b.size_m[1]) + swept_m + PASSING_M;
        (a.left_m - b.left_m).abs() < needed_m
    }

    /// Lets the one who has been away longest come in at the start of an open lane, if there is room.
    fn let_in(&mut self, lane: usize, now_s: f64, closed: &[bool]) {
        let next = self.members[lane]
            .iter()
            .filter_map(|&i| Some((self.vehicles[i].away_until_s?, i)))
            .filter(|&(until_s, _)| until_s <= now_s)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((until_s, i)) = next else { return };
        let vehicle = &mut self.vehicles[i];
        vehicle.along_m = 0.0;
        vehicle.away_until_s = None;
        vehicle.speed_mps = 0.0;
        let manner = vehicle.manner;
        let leader_m = self.leader(i).map_or(f64::INFINITY, |leader| leader.gap_m);
        let room_m = leader_m - manner.standstill_gap_m;
        let free_mps = self.free_speed(&self.vehicles[i], 0.0);
        if room_m < 2.0 || !self.enters_gates(i, now_s, closed) {
            self.vehicles[i].away_until_s = Some(until_s);
            return;
        }
        let stop_m = self.nearest_gate_m(i).min(room_m);
        let can_stop_mps = (2.0 * manner.braking_mps2 * (stop_m - 1.0).max(0.0)).sqrt();
        self.vehicles[i].speed_mps = free_mps.min(can_stop_mps).min(room_m / manner.headway_s);
    }
}

/// The acceleration of the Intelligent Driver Model, in m/s².
fn follow(manner: &Manner, speed_mps: f64, free_mps: f64, leader: Option<Leader>) -> f64 {
    let a = manner.acceleration_mps2;
    let free = 1.0 - (speed_mps / free_mps.max(0.1)).powi(4);
    let near = leader.map_or(0.0, |leader| {
        let closing = speed_mps - leader.speed_mps;
        let dynamic = speed_mps * manner.headway_s
            + speed_mps * closing / (2.0 * (a * manner.braking_mps2).sqrt());
        let wanted_m = manner.standstill_gap_m + dynamic.max(0.0);
        (wanted_m / leader.gap_m.max(NEAREST_M)).powi(2)
    });
    a * (free - near)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The acceleration of a car at that speed behind one that stands, that far ahead.
    fn towards_a_standing_car(speed_mps: f64, gap_m: f64) -> f64 {
        let leader = Leader {
            gap_m,
            speed_mps: 0.0,
        };
        follow(&Kind::Car.manner(), speed_mps, 13.9, Some(leader))
    }

    #[test]
    fn the_model_starts_on_a_free_road_and_rests_at_its_gap() {
        let manner = Kind::Car.manner();
        let start = follow(&manner, 0.0, 13.9, None);
        assert!((start - manner.acceleration_mps2).abs() < 1e-12);
        assert!(follow(&manner, 13.9, 13.9, None).abs() < 1e-12);
        assert!(towards_a_standing_car(0.0, manner.standstill_gap_m).abs() < 1e-12);
    }

    #[test]
    fn the_model_brakes_harder_the_nearer_the_one_ahead() {
        let pulls = [80.0, 40.0, 20.0, 10.0].map(|gap_m| towards_a_standing_car(10.0, gap_m));
        assert!(pulls.is_sorted_by(|a, b| a > b), "{pulls:?}");
    }
}
