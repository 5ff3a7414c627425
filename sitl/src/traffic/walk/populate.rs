//! Who is on which walkway at the start.

use nalgebra::Vector2;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::crossing::Kerb;
use super::{BODY_M, Crowd, INSIDE_M, Intent, NEAREST_M, Walker, Way};
use crate::traffic::gate::NARROWEST_CROSSING_M;
use crate::traffic::kind::Kind;
use crate::traffic::path::{Path, wrapped};
use crate::traffic::{Crossing, Plan, appearance};

/// Shorter walkways stay empty.
const SHORTEST_M: f64 = 3.0;
/// A crossing ends at a walkway that is no farther from it.
const KERB_M: f64 = 3.0;
/// Who finds no free place in so many tries stays at home.
const TRIES: u32 = 100;
/// Speeds are spread so much (Weidmann 1993), within these limits.
const SPEED_DEVIATION_MPS: f64 = 0.26;
const SPEEDS_MPS: [f64; 2] = [0.9, 1.8];

impl Crowd {
    /// All walkways and crossings of the plan with people on them.
    pub(in crate::traffic) fn new(plan: &Plan, random: &mut Pcg64) -> Self {
        let way = |path: Path, width_m: f64| Way {
            path,
            limit_m: (width_m / 2.0 - INSIDE_M).max(0.0),
        };
        let walkways = plan.walkways.iter();
        let mut ways: Vec<Way> = walkways.map(|w| way(w.path.clone(), w.width_m)).collect();
        let kerbs = plan
            .crossings
            .iter()
            .map(|crossing| kerbs(crossing, &ways))
            .collect();
        let walkways = ways.len();
        for crossing in &plan.crossings {
            let path = Path::open(&crossing.ends, 0.0);
            ways.push(way(path, crossing.width_m.max(NARROWEST_CROSSING_M)));
        }
        let mut crowd = Self {
            ways,
            walkways,
            priorities: plan.crossings.iter().map(|c| c.priority).collect(),
            kerbs,
            obstacles: plan.obstacles.clone(),
            walkers: Vec::new(),
            closed: Vec::new(),
            steps: 0,
            random: Pcg64::seed_from_u64(random.random()),
        };
        let mut counts = vec![0_u32; walkways];
        for _ in 0..plan.agents.pedestrians {
            let density = |i: usize| f64::from(counts[i] + 1) / crowd.ways[i].path.length_m();
            let walkway = (0..walkways)
                .filter(|&i| crowd.ways[i].path.length_m() >= SHORTEST_M)
                .min_by(|&a, &b| density(a).total_cmp(&density(b)));
            let Some(walkway) = walkway else { break };
            counts[walkway] += 1;
            crowd.place(walkway, random);
        }
        crowd
    }

    fn place(&mut self, walkway: usize, random: &mut Pcg64) {
        let (seed, size_m) = appearance(Kind::Pedestrian, random);
        let (length_m, limit_m) = {
            let way = &self.ways[walkway];
            (way.path.length_m(), way.limit_m)
        };
        // The sum of twelve even numbers is nearly normal.
        let sum: f64 = (0..12).map(|_| random.random_range(-0.5..0.5)).sum();
        let speed_mps = Kind::Pedestrian.manner().desired_speed_mps + SPEED_DEVIATION_MPS * sum;
        let forward = if random.random_bool(0.5) { 1.0 } else { -1.0 };
        for _ in 0..TRIES {
            let along_m = random.random_range(0.0..length_m);
            let left_m = random.random_range(-1.0..=1.0) * limit_m;
            let pose = self.ways[walkway].path.at(along_m);
            let at = Vector2::from(pose.to_the_left(left_m));
            if !self.has_place(at) {
                continue;
            }
            let turned_rad = if forward > 0.0 {
                0.0
            } else {
                std::f64::consts::PI
            };
            self.walkers.push(Walker {
                seed,
                size_m,
                way: walkway,
                along_m,
                left_m,
                forward,
                keep_m: left_m,
                speed_mps: speed_mps.clamp(SPEEDS_MPS[0], SPEEDS_MPS[1]),
                at,
                velocity: Vector2::zeros(),
                chosen: Vector2::zeros(),
                heading_rad: wrapped(pose.heading_rad + turned_rad),
                travelled_m: 0.0,
                stuck_s: 0.0,
                intent: Intent::Stroll,
                passed: Vec::new(),
            });
            return;
        }
    }

    fn has_place(&self, at: Vector2<f64>) -> bool {
        let mut walkers = self.walkers.iter();
        let mut obstacles = self.obstacles.iter();
        walkers.all(|other| (other.at - at).norm() > 1.2 * NEAREST_M)
            && obstacles.all(|obstacle| obstacle.distance_m(at.into()) > 1.2 * BODY_M)
    }
}

/// The walkways at both ends of a crossing.
fn kerbs(crossing: &Crossing, walkways: &[Way]) -> Option<[Kerb; 2]> {
    let [from, to] = crossing.ends.map(|end| {
        walkways
            .iter()
            .enumerate()
            .map(|(walkway, way)| (walkway, way.path.nearest(end)))
            .filter(|(walkway, nearest)| nearest.distance_m < KERB_M + walkways[*walkway].limit_m)
            .min_by(|a, b| a.1.distance_m.total_cmp(&b.1.distance_m))
            .map(|(walkway, nearest)| Kerb {
                walkway,
                along_m: nearest.along_m,
                at: end.into(),
            })
    });
    let long = Path::open(&crossing.ends, 0.0).length_m() > 1.0;
    Some([from?, to?]).filter(|_| long)
}
