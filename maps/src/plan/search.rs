//! Hybrid A\*: a search over continuous poses of which the best is kept per cell, heading and gear.
//!
//! From each pose the vehicle drives one short arc in either gear with each of five curvatures. What is left to the goal is
//! estimated by the larger of the disc's way around obstacles ([`super::field`]) and, near the goal, the shortest way
//! without obstacles ([`super::reeds_shepp`]). Now and then, the more often the nearer, those shortest ways are tried as
//! the rest of the path.
//!
//! The estimate does not see how the vehicle must turn, and a search that trusts the cost alone floods every room with
//! poses before it leaves it. What is left therefore counts more than what was driven ([`GREED`]): the path is not proven
//! to be the cheapest, and is shortened afterwards.

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
    pub(crate) checker: &'a Checker<'a>,
    pub(crate) costs: &'a CostModel<'a>,
    pub(crate) radius_m: f64,
    pub(crate) start: Pose2,
    /// At least one.
    pub(crate) goals: &'a [Pose2],
}

/// How much more what is left counts than what was driven. With 1, the search gives up on 8 of the 200 problems in the
/// bench's maze after 2 s each; with 1.5 it solves all of them, the slowest in 0.2 s.
const GREED: f64 = 1.5;
const HEADINGS: usize = 72;
const NO_NODE: u32 = u32::MAX;
/// A path is accepted if it costs no more than this times the least priority of the open poses.
const GOOD_ENOUGH: f64 = 1.1;
/// The shortest ways tried per pose and goal.
const WORDS_TRIED: usize = 4;
/// Within this many radii of the goal its heading matters to the estimate.
const NEAR_RADII: f64 = 10.0;

struct Node {
    pose: Pose2,
    cost: f64,
    parent: u32,
    /// From the parent; nothing at the start.
    motion: Option<Motion>,
}

struct Entry {
    estimate: f64,
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
}

impl Best {
    fn slot(&mut self, cell: usize, heading_rad: f64, gear: Gear) -> &mut u32 {
        if self.block_of_cell[cell] == NO_NODE {
            self.block_of_cell[cell] = self.blocks.len() as u32;
            self.blocks.push([NO_NODE; 2 * HEADINGS]);
        }
        let turn = (heading_rad.rem_euclid(TAU) / TAU * HEADINGS as f64).round() as usize;
        let side = match gear {
            Gear::Forward => 0,
            Gear::Reverse => HEADINGS,
        };
        &mut self.blocks[self.block_of_cell[cell] as usize][side + turn % HEADINGS]
    }
}

/// The rest of a path from a node to a goal.
struct Finish {
    cost: f64,
    node: u32,
    motions: Vec<Motion>,
}

struct Search<'a> {
    problem: &'a Problem<'a>,
    field: Field,
    arcs: [Motion; 10],
    /// Cells of the search along x, each `coarse` cells of the grid wide.
    width: usize,
    coarse: usize,
    nodes: Vec<Node>,
    open: BinaryHeap<Entry>,
    best: Best,
    finish: Option<Finish>,
    expansions: usize,
}

/// The motions of a path from the start to one of the goals.
pub(crate) fn search(
    problem: &Problem<'_>,
    max_expansions: usize,
) -> Result<Vec<Motion>, PlanError> {
    let footprint = problem.costs.footprint();
    let goals: Vec<[f64; 2]> = problem.goals.iter().map(|g| footprint.center(g)).collect();
    let from = footprint.center(&problem.start);
    let field = Field::new(problem.checker, problem.costs, &goals, from);
    let mut search = Search::new(problem, field);
    if !search.estimate(&problem.start).is_finite() {
        let nearest_m = nearest_reachable(problem.checker, problem.costs, from, goals[0]);
        return Err(PlanError::NoPath {
            expansions: 0,
            nearest_m,
        });
    }
    search.run(max_expansions)
}

impl<'a> Search<'a> {
    fn new(problem: &'a Problem<'a>, field: Field) -> Self {
        let resolution_m = problem.costs.grid().resolution_m();
        let turn = TAU / HEADINGS as f64;
        // An arc leaves its cell and, at full lock, turns by whole steps of heading.
        let turns = (1.5 * resolution_m / (problem.radius_m * turn)).ceil();
        let arc_m = turns * turn * problem.radius_m;
        let coarse = ((arc_m / (2.0 * resolution_m)) as usize).clamp(1, 4);
        let (width, height) = problem.costs.grid().size();
        let (width, height) = (width.div_ceil(coarse), height.div_ceil(coarse));
        let mut search = Self {
            problem,
            field,
            arcs: arcs(arc_m, problem.radius_m),
            width,
            coarse,
            nodes: Vec::new(),
            open: BinaryHeap::new(),
            best: Best {
                block_of_cell: vec![NO_NODE; width * height],
                blocks: Vec::new(),
            },
            finish: None,
            expansions: 0,
        };
        search.add(Node {
            pose: problem.start,
            cost: 0.0,
            parent: NO_NODE,
            motion: None,
        });
        search
    }

    fn run(&mut self, max_expansions: usize) -> Result<Vec<Motion>, PlanError> {
        let mut nearest_m = f64::INFINITY;
        let mut until_try = 0_usize;
        // Once there is a path, better ones are looked for as long again.
        let mut budget = max_expansions;
        while let Some(Entry { estimate, node }) = self.open.pop() {
            if let Some(finish) = &self.finish
                && (finish.cost <= estimate * GOOD_ENOUGH || self.expansions >= budget)
            {
                break;
            }
            let Node { pose, cost, .. } = self.nodes[node as usize];
            if self.is_outdated(node) {
                continue;
            }
            if self.expansions >= max_expansions {
                return Err(PlanError::BudgetExhausted {
                    expansions: self.expansions,
                    nearest_m,
                });
            }
            self.expansions += 1;
            nearest_m = nearest_m.min(self.to_goal_m(&pose));
            if until_try == 0 {
                let had_none = self.finish.is_none();
                self.try_to_finish(node);
                if had_none && self.finish.is_some() {
                    budget = max_expansions.min(2 * self.expansions + 200);
                }
                until_try = ((estimate - cost) / (4.0 * GREED * self.arcs[0].length_m())) as usize;
            } else {
                until_try -= 1;
            }
            self.expand(node);
        }
        match &self.finish {
            Some(finish) => Ok(self.path_of(finish)),
            None => Err(PlanError::NoPath {
                expansions: self.expansions,
                nearest_m,
            }),
        }
    }

    /// Whether a better node has taken its place.
    fn is_outdated(&mut self, node: u32) -> bool {
        let (pose, gear) = (self.nodes[node as usize].pose, self.gear_of(node));
        let Some(cell) = self.search_cell(&pose) else {
            return true;
        };
        let gear = gear.unwrap_or(Gear::Forward);
        *self.best.slot(cell, pose.heading_rad, gear) != node
    }

    fn gear_of(&self, node: u32) -> Option<Gear> {
        self.nodes[node as usize].motion.map(|m| m.gear())
    }

    fn search_cell(&self, pose: &Pose2) -> Option<usize> {
        let index = self.problem.costs.grid().index_of(pose.x_m, pose.y_m)?;
        Some(index.y / self.coarse * self.width + index.x / self.coarse)
    }

    fn expand(&mut self, from: u32) {
        let Node { pose, cost, .. } = self.nodes[from as usize];
        let gear = self.gear_of(from);
        let Some(room) = self.problem.checker.room_m(&pose) else {
            return;
        };
        for arc in self.arcs {
            let next = arc.end(&pose);
            let Some(cell) = self.search_cell(&next) else {
                continue;
            };
            let costs = self.problem.costs;
            let cost = cost + costs.of_change(gear, arc.gear()) + costs.of_motion(&pose, &arc);
            let known = *self.best.slot(cell, next.heading_rad, arc.gear());
            if known != NO_NODE && self.nodes[known as usize].cost <= cost {
                continue;
            }
            if self.problem.checker.is_free_beyond(&pose, &arc, room) {
                self.add(Node {
                    pose: next,
                    cost,
                    parent: from,
                    motion: Some(arc),
                });
            }
        }
    }

    fn add(&mut self, node: Node) {
        let left = self.estimate(&node.pose);
        let Some(cell) = self.search_cell(&node.pose) else {
            return;
        };
        if !left.is_finite() {
            return;
        }
        let id = self.nodes.len() as u32;
        let gear = node.motion.map_or(Gear::Forward, |m| m.gear());
        *self.best.slot(cell, node.pose.heading_rad, gear) = id;
        self.open.push(Entry {
            estimate: node.cost + GREED * left,
            node: id,
        });
        self.nodes.push(node);
    }

    /// What is left to the goal, infinite if no way is.
    fn estimate(&self, pose: &Pose2) -> f64 {
        let grid = self.problem.costs.grid();
        let [x, y] = self.problem.costs.footprint().center(pose);
        let Some(index) = grid.index_of(x, y) else {
            return f64::INFINITY;
        };
        let around = self.field.cost_from(index.x, index.y);
        match self.problem.goals {
            [goal] if pose.distance_m(goal) < NEAR_RADII * self.problem.radius_m => {
                around.max(reeds_shepp::length_m(pose, goal, self.problem.radius_m))
            }
            _ => around,
        }
    }

    fn to_goal_m(&self, pose: &Pose2) -> f64 {
        self.problem
            .goals
            .first()
            .map_or(f64::INFINITY, |goal| pose.distance_m(goal))
    }

    /// Tries the cheapest of the shortest ways to each goal; keeps one that is free and better than any before.
    fn try_to_finish(&mut self, node: u32) {
        let Node { pose, cost, .. } = self.nodes[node as usize];
        let gear = self.gear_of(node);
        let (costs, radius_m) = (self.problem.costs, self.problem.radius_m);
        let mut ways: Vec<(f64, reeds_shepp::Word)> = (self.problem.goals.iter())
            .flat_map(|goal| reeds_shepp::words(&pose, goal, radius_m))
            .map(|word| (costs.at_least(gear, word.motions()), word))
            .collect();
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (least, word) in ways.into_iter().take(WORDS_TRIED) {
            let best = self.finish.as_ref().map_or(f64::INFINITY, |f| f.cost);
            if cost + least >= best {
                return;
            }
            let total = cost + costs.of_chain(&pose, gear, word.motions());
            if total < best && is_free(self.problem.checker, &pose, word.motions()) {
                self.finish = Some(Finish {
                    cost: total,
                    node,
                    motions: word.motions().to_vec(),
                });
            }
        }
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
