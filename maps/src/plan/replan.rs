//! Keeping a path while the map changes.
//!
//! What is left of the path is judged on the new grid. If all of it is free, it stays as it is, even if a shorter one has
//! become possible: a vehicle that is on its way shall not be turned around by every tile. If a part is blocked, the way
//! around that part alone is looked for, from some turning radii before to some after it; only if there is none, or if it
//! is a long detour, everything is planned anew.

use super::anytime::{Planning, checker};
use super::cost::CostModel;
use super::motion::{Motion, Pose2, wrapped};
use super::path::sampled;
use super::search::{Problem, Search, Standing};
use super::smooth::{end_of, joined, shorten, split};
use super::{Goal, Path, PlanError, PlanLimits};
use crate::traversability::{Traversability, Vehicle};

/// What has become of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Update {
    /// It is as it was, less what has been driven.
    Kept,
    /// It leads around something new.
    Repaired,
    /// It is another one.
    Planned,
}

/// Plans a path once and keeps it drivable.
#[derive(Clone, Debug)]
pub struct Planner {
    vehicle: Vehicle,
    goal: Goal,
    limits: PlanLimits,
    current: Option<Current>,
}

#[derive(Clone, Debug)]
struct Current {
    start: Pose2,
    motions: Vec<Motion>,
    path: Path,
}

/// A vehicle farther from its path than this many cells is not on it.
const OFF_CELLS: f64 = 3.0;
/// Nor is one turned more than this.
const OFF_RAD: f64 = 0.35;
/// A way around leaves the path this many radii before what blocks it and comes back as many after.
const LEAD_RADII: f64 = 3.0;
/// A way around may cost as many times what it replaces; else another path may be better.
const LONG_DETOUR: f64 = 2.0;
/// A way around that is not found within so many poses takes longer than to plan anew.
const NEARBY: usize = 1000;

impl Planner {
    /// Without a path so far.
    pub fn new(vehicle: Vehicle, goal: Goal, limits: PlanLimits) -> Self {
        Self {
            vehicle,
            goal,
            limits,
            current: None,
        }
    }

    /// The path to follow: of the last [`Self::update`], if that did not fail.
    pub fn path(&self) -> Option<&Path> {
        self.current.as_ref().map(|current| &current.path)
    }

    /// Makes the path fit the grid and the vehicle's place `at`. After an error there is no path.
    pub fn update(&mut self, grid: &Traversability, at: Pose2) -> Result<Update, PlanError> {
        if let Some(current) = self.current.take()
            && let Some((updated, update)) = self.adapted(&current, grid, at)
        {
            self.current = Some(updated);
            return Ok(update);
        }
        let limits = &self.limits;
        let mut planning = Planning::new(grid, &self.vehicle, at, &[self.goal], limits)?;
        planning.find(limits.max_expansions);
        if planning.path().is_none() {
            return planning.into_path().map(|_| Update::Planned);
        }
        let (problem, found) = planning.into_parts();
        self.current = found.map(|found| {
            let (motions, path) = found.into_parts();
            Current {
                start: problem.start,
                motions,
                path,
            }
        });
        Ok(Update::Planned)
    }

    /// The rest of the path, as it is or repaired; none if it cannot be.
    fn adapted(
        &self,
        current: &Current,
        grid: &Traversability,
        at: Pose2,
    ) -> Option<(Current, Update)> {
        let (start, motions) = left_from(current, at, OFF_CELLS * grid.resolution_m())?;
        let checker = checker(grid, &self.vehicle, start, &self.limits).ok()?;
        let mut problem = Problem {
            costs: CostModel::new(grid, &checker.footprint, &self.limits),
            checker,
            radius_m: self.vehicle.min_turning_radius_m,
            start,
            goals: Vec::new(),
        };
        let (motions, update) = match blocked(&problem, &motions) {
            None => (motions, Update::Kept),
            Some(between) => {
                let repaired = self.around(&mut problem, &motions, between)?;
                (repaired, Update::Repaired)
            }
        };
        let path = sampled(
            &problem.checker,
            &start,
            &motions,
            self.limits.waypoint_spacing_m,
        );
        let updated = Current {
            start,
            motions,
            path,
        };
        Some((updated, update))
    }

    /// The path with a way around what is blocked between two places along it; none if there is no good one.
    fn around(
        &self,
        problem: &mut Problem<'_>,
        motions: &[Motion],
        [from_m, to_m]: [f64; 2],
    ) -> Option<Vec<Motion>> {
        let start = problem.start;
        let length: f64 = motions.iter().map(Motion::length_m).sum();
        let lead_m = LEAD_RADII * problem.radius_m;
        let (before, rest) = split(motions.to_vec(), (from_m - lead_m).max(0.0));
        let leave = end_of(&start, &before);
        let driven: f64 = before.iter().map(Motion::length_m).sum();
        let (blocked, after) = split(rest, (to_m + lead_m).min(length) - driven);
        let back = end_of(&leave, &blocked);
        if !problem.checker.is_free(&leave) || !problem.checker.is_free(&back) {
            return None;
        }
        (problem.start, problem.goals) = (leave, vec![back]);
        let mut search = Search::new(problem).ok()?;
        let replaced = problem.costs.of_chain(&leave, None, &blocked);
        search.bound_by(LONG_DETOUR * replaced);
        let found = search.advance(problem, NEARBY.min(self.limits.max_expansions));
        let way = (found == Standing::Better).then(|| search.path()).flatten();
        let way = way.map(|way| shorten(problem, way));
        problem.start = start;
        Some(joined([before, way?, after].concat()))
    }
}

/// The pose on the path nearest to the vehicle, and the path from there; none if the vehicle is not on it.
fn left_from(current: &Current, at: Pose2, off_m: f64) -> Option<(Pose2, Vec<Motion>)> {
    if at == current.start {
        return Some((at, current.motions.clone()));
    }
    let mut nearest = (f64::INFINITY, 0.0);
    let (mut pose, mut driven) = (current.start, 0.0);
    for motion in &current.motions {
        let steps = (motion.length_m() / (0.25 * off_m)).ceil().max(1.0);
        for i in 0..=steps as usize {
            let along = motion.length_m() * i as f64 / steps;
            let here = motion.at(&pose, along);
            let turned = wrapped(here.heading_rad - at.heading_rad).abs();
            let off = here.distance_m(&at);
            if turned <= OFF_RAD && off < nearest.0 {
                nearest = (off, driven + along);
            }
        }
        pose = motion.end(&pose);
        driven += motion.length_m();
    }
    let (before, rest) = split(current.motions.clone(), nearest.1);
    (nearest.0 <= off_m).then(|| (end_of(&current.start, &before), rest))
}

/// From where to where along the path the vehicle cannot drive any more.
fn blocked(problem: &Problem<'_>, motions: &[Motion]) -> Option<[f64; 2]> {
    let step_m = 0.5 * problem.radius_m;
    let mut found: Option<[f64; 2]> = None;
    let (mut pose, mut driven) = (problem.start, 0.0);
    for motion in motions {
        let mut begun = 0.0;
        while begun < motion.length_m() {
            let end = (begun + step_m).min(motion.length_m());
            let piece = motion.until(end).after(begun);
            let from = motion.at(&pose, begun);
            if !problem.checker.is_free_along(&from, &piece) {
                let first = found.map_or(driven + begun, |[first, _]| first);
                found = Some([first, driven + end]);
            }
            begun = end;
        }
        pose = motion.end(&pose);
        driven += motion.length_m();
    }
    found
}
