//! Who is on which lane at the start.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::{Road, Vehicle};
use crate::traffic::course::Course;
use crate::traffic::gate;
use crate::traffic::kind::Kind;
use crate::traffic::{Agents, Plan, appearance};

/// Shorter lanes stay empty.
const SHORTEST_M: f64 = 30.0;
/// On a closed lane this much stays free, so that nobody waits for their own tail.
const SLACK_M: f64 = 15.0;
/// Someone who does not fit where they should start tries again so much farther on.
const SHIFT_M: f64 = 2.0;

impl Road {
    /// All lanes of the plan with its vehicles on them.
    pub(in crate::traffic) fn new(plan: &Plan, random: &mut Pcg64) -> Self {
        let course = |lane| Course::new(lane, &plan.agents);
        let courses: Vec<Course> = plan.lanes.iter().map(course).collect();
        let mut gates = Vec::new();
        let shared = gate::junctions(&courses, &mut gates);
        gate::signals(&plan.signals, &courses, &mut gates);
        let crossings = plan.crossings.iter();
        let spans = crossings
            .map(|crossing| gate::crossing(crossing, &courses, &mut gates))
            .collect();
        let mut gates_of = vec![Vec::new(); courses.len()];
        for (i, gate) in gates.iter().enumerate() {
            gates_of[gate.lane].push(i);
        }
        let mut road = Self {
            members: vec![Vec::new(); courses.len()],
            holders: vec![Vec::new(); gates.len()],
            courses,
            gates,
            gates_of,
            shared,
            vehicles: Vec::new(),
            spans,
            random: Pcg64::seed_from_u64(random.random()),
        };
        if let Some(guest) = plan.guest
            && guest.lane < road.courses.len()
        {
            let mut vehicle = road.vehicle(Kind::Robot, guest.lane, random);
            vehicle.manner = Kind::Robot.manner();
            vehicle.size_m = Kind::Robot.size_m();
            // A place that is no number is the start.
            vehicle.along_m = guest.at_m.max(0.0).min(road.courses[guest.lane].length_m());
            road.vehicles.push(vehicle);
            road.members[guest.lane].push(0);
        }
        for (lane, kinds) in road.shares(&plan.agents, random).into_iter().enumerate() {
            let count = kinds.len() as f64;
            for (k, kind) in kinds.into_iter().enumerate() {
                let share = (k as f64 + random.random_range(0.0..0.6)) / count;
                let vehicle = road.vehicle(kind, lane, random);
                road.place(vehicle, share);
            }
        }
        for i in 0..road.vehicles.len() {
            if road.vehicles[i].kind != Kind::Robot {
                road.vehicles[i].speed_mps = road.starting_speed(i);
            }
        }
        road
    }

    /// The kinds on each lane, in a random order: as many everywhere, per metre.
    fn shares(&self, agents: &Agents, random: &mut Pcg64) -> Vec<Vec<Kind>> {
        let mut kinds = Vec::new();
        for (kind, count) in [
            (Kind::Car, agents.cars),
            (Kind::Truck, agents.trucks),
            (Kind::Bus, agents.buses),
            (Kind::Cyclist, agents.cyclists),
        ] {
            kinds.extend((0..count).map(|_| kind));
        }
        for i in (1..kinds.len()).rev() {
            kinds.swap(i, random.random_range(0..=i));
        }
        let mut shares = vec![Vec::new(); self.courses.len()];
        for kind in kinds {
            let density = |lane: usize| {
                let on_lane: &Vec<Kind> = &shares[lane];
                (on_lane.len() + 1) as f64 / self.courses[lane].length_m()
            };
            let lane = (0..self.courses.len())
                .filter(|&lane| self.courses[lane].length_m() >= SHORTEST_M)
                .min_by(|&a, &b| density(a).total_cmp(&density(b)));
            if let Some(lane) = lane {
                shares[lane].push(kind);
            }
        }
        shares
    }

    fn vehicle(&self, kind: Kind, lane: usize, random: &mut Pcg64) -> Vehicle {
        let (seed, size_m) = appearance(kind, random);
        let mut manner = kind.manner();
        manner.desired_speed_mps *= random.random_range(0.85..1.15);
        manner.headway_s *= random.random_range(0.9..1.3);
        Vehicle {
            kind,
            seed,
            size_m,
            manner,
            haste: random.random_range(0.88..1.0),
            lane,
            left_m: self.courses[lane].left_m(kind),
            along_m: 0.0,
            speed_mps: 0.0,
            travelled_m: 0.0,
            away_until_s: None,
            held: Vec::new(),
            waiting: None,
        }
    }

    /// Puts a vehicle on its lane, at that share of its length or farther on. One that does not fit comes in later on
    /// an open lane, and is left out on a closed one.
    fn place(&mut self, vehicle: Vehicle, share: f64) {
        let (lane, i) = (vehicle.lane, self.vehicles.len());
        let (length_m, closed) = {
            let course = &self.courses[lane];
            (course.length_m(), course.path().is_closed())
        };
        let has_slack =
            !closed || self.slack_m(lane) > vehicle.length_m() + vehicle.manner.standstill_gap_m;
        self.vehicles.push(vehicle);
        self.members[lane].push(i);
        for tried in 0..(length_m / SHIFT_M) as u32 {
            let along_m = (share * length_m + f64::from(tried) * SHIFT_M).rem_euclid(length_m);
            self.vehicles[i].along_m = along_m;
            if has_slack && self.fits(i) {
                return;
            }
        }
        if closed {
            self.vehicles.pop();
            self.members[lane].pop();
        } else {
            self.vehicles[i].along_m = 0.0;
            self.vehicles[i].away_until_s = Some(0.0);
        }
    }

    /// As fast as it would like to be, if it can stop before the next gate and behind the one ahead.
    fn starting_speed(&self, i: usize) -> f64 {
        let vehicle = &self.vehicles[i];
        let leader_m = self.leader(i).map_or(f64::INFINITY, |leader| leader.gap_m);
        let clear_m = leader_m.min(self.nearest_gate_m(i)) - vehicle.manner.standstill_gap_m;
        let can_stop_mps = (2.0 * vehicle.manner.braking_mps2 * clear_m.max(0.0)).sqrt();
        self.free_speed(vehicle, vehicle.along_m).min(can_stop_mps)
    }

    /// Whether a vehicle is clear of gates and of others on its lane, in front and behind.
    fn fits(&self, i: usize) -> bool {
        let vehicle = &self.vehicles[i];
        let course = &self.courses[vehicle.lane];
        let clear = |(other, along_m): (&Vehicle, f64)| {
            let bodies_m = f64::midpoint(vehicle.length_m(), other.length_m());
            let gap_m = vehicle
                .manner
                .standstill_gap_m
                .max(other.manner.standstill_gap_m);
            let far = |from_m, to_m| {
                let ahead_m = course.ahead_m(from_m, to_m);
                ahead_m.is_none_or(|ahead_m| ahead_m > bodies_m + gap_m)
            };
            let apart = far(vehicle.along_m, along_m) && far(along_m, vehicle.along_m);
            apart || !self.in_the_way(vehicle, other)
        };
        !self.touches_gate(i) && self.others(i).all(clear)
    }

    /// What is left of a closed lane once everyone on it stands, beyond what they need to clear its gates.
    fn slack_m(&self, lane: usize) -> f64 {
        let bodies_m: f64 = self.members[lane]
            .iter()
            .map(|&i| self.vehicles[i].length_m() + self.vehicles[i].manner.standstill_gap_m)
            .sum();
        let gates_m: f64 = self.gates_of[lane]
            .iter()
            .map(|&gate| self.gates[gate].end_m - self.gates[gate].start_m + SHIFT_M)
            .sum();
        self.courses[lane].length_m() - bodies_m - gates_m - SLACK_M
    }
}
