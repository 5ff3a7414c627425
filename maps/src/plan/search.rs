//! Hybrid A\*: a search over continuous poses of which the best is kept per cell, heading and gear.
//!
//! From each pose the vehicle drives one short arc in either gear with each of five curvatures. What is left to the goal is
//! estimated by the larger of the disc's way around obstacles ([`super::field`]) and, near the goal, the shortest way
//! without obstacles ([`super::reeds_shepp`]). Now and then, the more often the nearer, those shortest ways are tried as
//! the rest of the path.
//!
//! The estimate does not see how the vehicle must turn, and a search that trusts the cost alone floods every room with
//! poses before it leaves it. What is left therefore counts more than what was driven ([`GREED`]), crowded cells wait
//! ([`CROWD_M`]), and a search that has found nothing for long draws its guide anew, around the crowds: the path is not
//! proven to be the cheapest, and is shortened afterwards.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::TAU;

use super::PlanError;
use super::cost::CostModel;
use super::field::{Field, nearest_reachable};
use super::footprint::Checker;
use super::motion::{Gear, Motion, Pose2};
use super::reeds_shepp;

/// A planning problem whose start and goals are free.
pub(crate) struct Problem<'a> {
    pub(crate) checker: Checker<'a>,
    pub(crate) costs: CostModel<'a>,
    pub(crate) radius_m: f64,
    pub(crate) start: Pose2,
    /// At least one.
    pub(crate) goals: Vec<Pose2>,
}

/// How much more what is left counts than what was driven. With 2 the paths on sites are half a percent
/// shorter at most, and the slowest searches take two to three times as long.
const GREED: f64 = 3.0;
/// What every pose that a cell has seen already adds to what is left: where many poses lead nowhere, others get their turn
/// (a gap that a disc passes and the vehicle does not).
const CROWD_M: f64 = 1.0;
const HEADINGS: usize = 72;
/// After so many poses without a path, and each time three times as many, the guide is drawn anew.
const FIRST_GUIDE: usize = 1000;
/// So many poses in a cell make a metre in it count twice then.
const CROWDED: f64 = 3.0;
const NO_NODE: u32 = u32::MAX;
/// A path is accepted if it costs no more than this times the least priority of the open poses.
const GOOD_ENOUGH: f64 = 1.1;
/// The shortest ways tried per pose and goal.
const WORDS_TRIED: usize = 4;
/// After that many poses the goal is tried from every second only, after twice as many from every third.
const TRIES: usize = 500;
/// Within this many radii of the goal its heading matters to the estimate.
const NEAR_RADII: f64 = 6.0;
/// Length of an arc, in turning radii: short ones in the open only make more poses of the same.
const ARC_RADII: f64 = 0.25;
/// The field counts straight and diagonal steps, so that it tells up to this share of the straight way.
const DETOUR_OF_CELLS: f64 = 1.0 / 1.0824;

struct Node {
    pose: Pose2,
    cost: f64,
    parent: u32,
    /// From the parent; nothing at the start.
    motion: Option<Motion>,
}

struct Entry {
    estimate: f64,
    /// What is estimated to be left to the goal.
    left: f64,
    node: u32,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Entry {}
impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Entry {
    /// The largest is the one to expand next: the least estimate, the latest node among equals.
    fn cmp(&self, other: &Self) -> Ordering {
        (other.estimate.total_cmp(&self.estimate)).then(self.node.cmp(&other.node))
    }
}

/// The best node by cell, heading and gear, with room made for the headings of a cell when it is first reached.
struct Best {
    block_of_cell: Vec<u32>,
    blocks: Vec<[u32; 2 * HEADINGS]>,
    /// By block: poses that were ever added to it.
    crowds: Vec<f64>,
}

impl Best {
    fn slot(&mut self, cell: usize, heading_rad: f64, gear: Gear) -> &mut u32 {
        if self.block_of_cell[cell] == NO_NODE {
            self.block_of_cell[cell] = self.blocks.len() as u32;
            self.blocks.push([NO_NODE; 2 * HEADINGS]);
            self.crowds.push(0.0);
        }
        // Headings of poses are in [-π, π].
        let turn = ((heading_rad / TAU + 1.0) * HEADINGS as f64 + 0.5) as usize;
        let side = match gear {
            Gear::Forward => 0,
            Gear::Reverse => HEADINGS,
        };
        &mut self.blocks[self.block_of_cell[cell] as usize][side + turn % HEADINGS]
    }
}

/// The rest of a path from a node to a goal.
struct Finish {
    node: u32,
    motions: Vec<Motion>,
}

impl Problem<'_> {
    /// The same from the goal to the start, as it is driven backwards; none if there are several goals.
    pub(crate) fn reversed(&self) -> Option<Self> {
        let [goal] = self.goals[..] else {
            return None;
        };
        Some(Self {
            checker: self.checker.clone(),
            costs: self.costs.reversed(),
            radius_m: self.radius_m,
            start: goal,
            goals: vec![self.start],
        })
    }
}

/// Motions driven backwards, from the last to the first.
pub(crate) fn backwards(motions: &[Motion]) -> Vec<Motion> {
    let back = |motion: &Motion| Motion {
        curvature: motion.curvature,
        signed_m: -motion.signed_m,
    };
    motions.iter().rev().map(back).collect()
}

/// Where a search stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Standing {
    /// A cheaper path was found.
    Better,
    /// The poses it was allowed are used up.
    Paused,
    /// Nothing is left to look at from which the guide expects a cheaper path; without any path, nothing at all.
    Done,
}

/// The state of a search: it can be continued at any time, always with the same problem.
pub(crate) struct Search {
    field: Field,
    arcs: [Motion; 10],
    /// Cells of the search along x, each `coarse` cells of the grid wide.
    width: usize,
    coarse: usize,
    nodes: Vec<Node>,
    open: BinaryHeap<Entry>,
    best: Best,
    finish: Option<Finish>,
    /// No path that costs as much is of interest.
    bound: f64,
    until_try: usize,
    /// After so many poses without a path the guide is drawn anew.
    next_guide: usize,
    expansions: usize,
    nearest_m: f64,
}

impl Search {
    /// Fails if not even a disc can come to a goal.
    pub(crate) fn new(problem: &Problem<'_>) -> Result<Self, PlanError> {
        let grid = problem.checker.grid();
        let resolution_m = grid.resolution_m();
        let turn = TAU / HEADINGS as f64;
        // An arc leaves its cell and, at full lock, turns by whole steps of heading.
        let least_m = (1.5 * resolution_m).max(ARC_RADII * problem.radius_m);
        let arc_m = (least_m / (problem.radius_m * turn)).ceil() * turn * problem.radius_m;
        let coarse = ((arc_m / (1.5 * resolution_m)) as usize).clamp(1, 4);
        let (width, height) = grid.size();
        let (width, height) = (width.div_ceil(coarse), height.div_ceil(coarse));
        let middles: Vec<[f64; 2]> = (problem.goals.iter())
            .map(|goal| problem.checker.footprint.center(goal))
            .collect();
        let from = problem.checker.footprint.center(&problem.start);
        let mut search = Self {
            field: Field::new(grid, &middles, Some(from)),
            arcs: arcs(arc_m, problem.radius_m),
            width,
            coarse,
            nodes: Vec::new(),
            open: BinaryHeap::new(),
            best: Best {
                block_of_cell: vec![NO_NODE; width * height],
                blocks: Vec::new(),
                crowds: Vec::new(),
            },
            finish: None,
            bound: f64::INFINITY,
            until_try: 0,
            next_guide: FIRST_GUIDE,
            expansions: 0,
            nearest_m: f64::INFINITY,
        };
        if !search.estimate(problem, &problem.start).is_finite() {
            let nearest_m = nearest_reachable(&problem.checker, &problem.costs, from, middles[0]);
            return Err(PlanError::NoPath {
                expansions: 0,
                nearest_m,
            });
        }
        let start = Node {
            pose: problem.start,
            cost: 0.0,
            parent: NO_NODE,
            motion: None,
        };
        search.add(problem, start);
        Ok(search)
    }

    /// Poses expanded so far.
    pub(crate) fn expansions(&self) -> usize {
        self.expansions
    }

    /// Least distance to a goal so far.
    pub(crate) fn nearest_m(&self) -> f64 {
        self.nearest_m
    }

    /// Only paths that cost less than this are looked for from now on.
    pub(crate) fn bound_by(&mut self, cost: f64) {
        self.bound = self.bound.min(cost);
    }

    /// Whether what is looked for next is likely to be worse than the path there is.
    pub(crate) fn is_good_enough(&self) -> bool {
        let next = self.open.peek().map_or(f64::INFINITY, |e| e.estimate);
        self.bound <= next * GOOD_ENOUGH
    }

    /// Expands `count` poses at most, until a cheaper path is found.
    pub(crate) fn advance(&mut self, problem: &Problem<'_>, count: usize) -> Standing {
        let until = self.expansions.saturating_add(count);
        while self.expansions < until {
            let Some(Entry { left, node, .. }) = self.open.pop() else {
                return Standing::Done;
            };
            let Node { pose, cost, .. } = self.nodes[node as usize];
            if cost + left * DETOUR_OF_CELLS >= self.bound || self.is_outdated(problem, node) {
                continue;
            }
            self.expansions += 1;
            self.nearest_m = self.nearest_m.min(to_goal_m(problem, &pose));
            let found = if self.until_try == 0 {
                let far = (left / (4.0 * self.arcs[0].length_m())) as usize;
                self.until_try = far.max(self.expansions / TRIES);
                self.try_to_finish(problem, node)
            } else {
                self.until_try -= 1;
                false
            };
            self.expand(problem, node);
            if found {
                return Standing::Better;
            }
            if self.expansions >= self.next_guide && self.bound.is_infinite() {
                self.next_guide *= 3;
                self.draw_guide_anew(problem);
            }
        }
        Standing::Paused
    }

    /// Makes every crowded cell dear in the guide, so that it leads around places where poses pile up, and puts the open
    /// poses into the order it gives.
    fn draw_guide_anew(&mut self, problem: &Problem<'_>) {
        let grid = problem.checker.grid();
        let footprint = &problem.checker.footprint;
        let middles: Vec<[f64; 2]> = (problem.goals.iter())
            .map(|goal| footprint.center(goal))
            .collect();
        let width = grid.size().0;
        let weight_of = |cell: usize| {
            let (x, y) = (cell % width / self.coarse, cell / width / self.coarse);
            let block = self.best.block_of_cell[y * self.width + x];
            let crowd = self.best.crowds.get(block as usize).copied();
            1.0 + (crowd.unwrap_or(0.0) / CROWDED) as f32
        };
        let weights = (0..width * grid.size().1).map(weight_of).collect();
        self.field = Field::new(grid, &middles, Some(footprint.center(&problem.start)))
            .with_ground_of(&self.field)
            .weighted(weights);
        for Entry { node, .. } in std::mem::take(&mut self.open) {
            let pose = self.nodes[node as usize].pose;
            let left = self.estimate(problem, &pose);
            if self.is_outdated(problem, node) || !left.is_finite() {
                continue;
            }
            self.push(problem, node, left);
        }
    }

    fn push(&mut self, problem: &Problem<'_>, node: u32, left: f64) {
        let Node { pose, cost, .. } = self.nodes[node as usize];
        let Some(cell) = self.search_cell(problem, &pose) else {
            return;
        };
        let crowd = self.best.crowds[self.best.block_of_cell[cell] as usize];
        self.open.push(Entry {
            estimate: cost + GREED * left + CROWD_M * crowd,
            left,
            node,
        });
    }

    /// The cheapest path must cost less than this.
    pub(crate) fn bound(&self) -> f64 {
        self.bound
    }

    /// The motions of the cheapest path found.
    pub(crate) fn path(&self) -> Option<Vec<Motion>> {
        self.finish.as_ref().map(|finish| self.path_of(finish))
    }

    /// Whether a better node has taken its place.
    fn is_outdated(&mut self, problem: &Problem<'_>, node: u32) -> bool {
        let (pose, gear) = (self.nodes[node as usize].pose, self.gear_of(node));
        let Some(cell) = self.search_cell(problem, &pose) else {
            return true;
        };
        let gear = gear.unwrap_or(Gear::Forward);
        *self.best.slot(cell, pose.heading_rad, gear) != node
    }

    fn gear_of(&self, node: u32) -> Option<Gear> {
        self.nodes[node as usize].motion.map(|m| m.gear())
    }

    fn search_cell(&self, problem: &Problem<'_>, pose: &Pose2) -> Option<usize> {
        let index = problem.checker.grid().index_of(pose.x_m, pose.y_m)?;
        Some(index.y / self.coarse * self.width + index.x / self.coarse)
    }

    fn expand(&mut self, problem: &Problem<'_>, from: u32) {
        let Node { pose, cost, .. } = self.nodes[from as usize];
        let gear = self.gear_of(from);
        let (checker, costs) = (&problem.checker, &problem.costs);
        let Some(room) = checker.room_m(&pose) else {
            return;
        };
        for arc in self.arcs {
            let next = arc.end(&pose);
            let Some(cell) = self.search_cell(problem, &next) else {
                continue;
            };
            let known = *self.best.slot(cell, next.heading_rad, arc.gear());
            let known = (self.nodes.get(known as usize)).map_or(f64::INFINITY, |node| node.cost);
            let changed = cost + costs.of_change(gear, arc.gear());
            if known <= changed + costs.of_length(&arc) {
                continue;
            }
            let cost = changed + costs.of_motion(&pose, &arc);
            if cost < known && checker.is_free_beyond(&pose, &arc, room) {
                let node = Node {
                    pose: next,
                    cost,
                    parent: from,
                    motion: Some(arc),
                };
                self.add(problem, node);
            }
        }
    }

    fn add(&mut self, problem: &Problem<'_>, node: Node) {
        let left = self.estimate(problem, &node.pose);
        let Some(cell) = self.search_cell(problem, &node.pose) else {
            return;
        };
        if !left.is_finite() {
            return;
        }
        let id = self.nodes.len() as u32;
        let gear = node.motion.map_or(Gear::Forward, |m| m.gear());
        *self.best.slot(cell, node.pose.heading_rad, gear) = id;
        self.best.crowds[self.best.block_of_cell[cell] as usize] += 1.0;
        self.nodes.push(node);
        self.push(problem, id, left);
    }

    /// What is left to the goal, infinite if no way is.
    fn estimate(&mut self, problem: &Problem<'_>, pose: &Pose2) -> f64 {
        let [x, y] = problem.checker.footprint.center(pose);
        let Some(index) = problem.checker.grid().index_of(x, y) else {
            return f64::INFINITY;
        };
        let around = (self.field).cost_from(&problem.checker, &problem.costs, index);
        match problem.goals[..] {
            [goal] if pose.distance_m(&goal) < NEAR_RADII * problem.radius_m => {
                around.max(reeds_shepp::length_m(pose, &goal, problem.radius_m))
            }
            _ => around,
        }
    }

    /// Tries the cheapest of the shortest ways to each goal; keeps one that is free and better than any before.
    fn try_to_finish(&mut self, problem: &Problem<'_>, node: u32) -> bool {
        let Node { pose, cost, .. } = self.nodes[node as usize];
        let gear = self.gear_of(node);
        let (costs, radius_m) = (&problem.costs, problem.radius_m);
        let mut ways: Vec<(f64, reeds_shepp::Word)> = (problem.goals.iter())
            .flat_map(|goal| reeds_shepp::words(&pose, goal, radius_m))
            .map(|word| (costs.at_least(gear, word.motions()), word))
            .collect();
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut found = false;
        for (least, word) in ways.into_iter().take(WORDS_TRIED) {
            if cost + least >= self.bound {
                break;
            }
            let total = cost + costs.of_chain(&pose, gear, word.motions());
            if total < self.bound && is_free(&problem.checker, &pose, word.motions()) {
                self.bound = total;
                self.finish = Some(Finish {
                    node,
                    motions: word.motions().to_vec(),
                });
                found = true;
            }
        }
        found
    }

    fn path_of(&self, finish: &Finish) -> Vec<Motion> {
        let mut backwards = Vec::new();
        let mut at = finish.node;
        while at != NO_NODE {
            backwards.extend(self.nodes[at as usize].motion);
            at = self.nodes[at as usize].parent;
        }
        backwards.reverse();
        backwards.extend_from_slice(&finish.motions);
        backwards
    }
}

fn to_goal_m(problem: &Problem<'_>, pose: &Pose2) -> f64 {
    (problem.goals.iter())
        .map(|goal| pose.distance_m(goal))
        .fold(f64::INFINITY, f64::min)
}

/// Whether motions one after the other from `from` are free.
pub(crate) fn is_free(checker: &Checker<'_>, from: &Pose2, motions: &[Motion]) -> bool {
    let mut pose = *from;
    motions.iter().all(|motion| {
        let free = checker.is_free_along(&pose, motion);
        pose = motion.end(&pose);
        free
    })
}

/// Full and half lock to either side and straight on, in both gears.
fn arcs(length_m: f64, radius_m: f64) -> [Motion; 10] {
    let steers = [0.0, 0.5, -0.5, 1.0, -1.0];
    std::array::from_fn(|i| Motion {
        curvature: steers[i % 5] / radius_m,
        signed_m: if i < 5 { length_m } else { -length_m },
    })
}
