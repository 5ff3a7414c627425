//! Planning that can be asked for more: a first path soon, better ones for more effort.
//!
//! If the search finds no path soon, a second one starts at the goal and goes on beside it: what is hard to get into is
//! easy to get out of, and a goal that cannot be left was never to be reached. Within a rayon pool each has a thread; the
//! path is the same anywhere.
//!
//! The search goes on where it stopped, and only looks at poses from which a cheaper path is possible (E. Hansen, R. Zhou,
//! *Anytime heuristic search*, JAIR 28, 2007). Each cheaper path it finds is shortened, and the cheapest is kept.

use super::cost::CostModel;
use super::footprint::{Checker, Footprint, Margins};
use super::motion::{Motion, Pose2, wrapped};
use super::path::sampled;
use super::search::{Problem, Search, Standing, backwards};
use super::{End, Goal, Path, PlanError, PlanLimits, Unknown, goal, smooth, validate};
use crate::traversability::{Traversability, Vehicle};

/// What more effort has brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// A first path, or one that costs less than the one before.
    Better,
    /// Nothing yet: the effort is spent.
    Unchanged,
    /// Nothing, and more effort will bring nothing.
    Finished,
}

/// A problem that is being solved.
pub struct Planning<'a> {
    problem: Problem<'a>,
    /// Which of the goals each pose of the problem stands for.
    goal_of_pose: Vec<usize>,
    search: Search,
    /// The way back, if there is one goal only, that can be searched from.
    back: Option<Back<'a>>,
    /// The last path found, as it was found.
    raw: Option<Vec<Motion>>,
    best: Option<Found>,
    is_finished: bool,
    spacing_m: f64,
}

/// A problem from the goal to the start.
struct Back<'a> {
    problem: Problem<'a>,
    /// Once it is tried.
    search: Option<Search>,
}

/// A path and what it costs.
pub(super) struct Found {
    pub(super) motions: Vec<Motion>,
    cost: f64,
    path: Path,
}

/// Poses after which the way back is tried, too.
const ALONE: usize = 500;
/// Poses after which the two searches look whether the other has found a path.
const TURN: usize = 500;
/// Poses for which a path is improved at least, once there is one.
const LEAST_IMPROVEMENT: usize = 200;

impl<'a> Planning<'a> {
    /// To whichever of `goals` costs least to reach; those where the vehicle cannot stand are left out, and if none is left,
    /// the reason is that of the first.
    pub fn new(
        grid: &'a Traversability,
        vehicle: &Vehicle,
        start: Pose2,
        goals: &[Goal],
        limits: &PlanLimits,
    ) -> Result<Self, PlanError> {
        validate(vehicle, &start, goals, limits)?;
        let checker = checker(grid, vehicle, start, limits)?;
        let needed_m = checker.footprint.inradius() + limits.clearance_m;
        let mut goal_of_pose = Vec::new();
        let mut poses = Vec::new();
        let mut first_error = None;
        for (i, goal) in goals.iter().enumerate() {
            match goal::settle(&checker, goal, needed_m) {
                Ok(settled) => {
                    goal_of_pose.resize(poses.len() + settled.len(), i);
                    poses.extend(settled);
                }
                Err(error) => first_error = first_error.or(Some(error)),
            }
        }
        if poses.is_empty() {
            return Err(first_error.unwrap_or(PlanError::NoGoal));
        }
        let problem = Problem {
            costs: CostModel::new(grid, &checker.footprint, limits),
            checker,
            radius_m: vehicle.min_turning_radius_m,
            start,
            goals: poses,
        };
        let search = Search::new(&problem)?;
        let back = problem.reversed().map(|problem| Back {
            problem,
            search: None,
        });
        Ok(Self {
            problem,
            goal_of_pose,
            search,
            back,
            raw: None,
            best: None,
            is_finished: false,
            spacing_m: limits.waypoint_spacing_m,
        })
    }

    /// Expands at most `expansions` poses more, and returns as soon as there is a better path.
    pub fn improve(&mut self, expansions: usize) -> Progress {
        let until = self.expansions().saturating_add(expansions);
        while !self.is_finished {
            let left = until.saturating_sub(self.expansions());
            match self.advance(left) {
                Standing::Paused => return Progress::Unchanged,
                Standing::Done => self.is_finished = true,
                Standing::Better => {
                    if self.keep_if_better() {
                        return Progress::Better;
                    }
                }
            }
        }
        Progress::Finished
    }

    /// The cheapest path so far.
    pub fn path(&self) -> Option<&Path> {
        self.best.as_ref().map(|found| &found.path)
    }

    /// What the path costs: its metres, weighted by ground, nearness and gear. It falls with every [`Progress::Better`].
    pub fn cost(&self) -> Option<f64> {
        self.best.as_ref().map(|found| found.cost)
    }

    /// Which of the goals the path leads to.
    pub fn reached(&self) -> Option<usize> {
        let found = self.best.as_ref()?;
        let end = smooth::end_of(&self.problem.start, &found.motions);
        let off = |pose: &Pose2| {
            pose.distance_m(&end) + wrapped(pose.heading_rad - end.heading_rad).abs()
        };
        (self.problem.goals.iter().zip(&self.goal_of_pose))
            .min_by(|a, b| off(a.0).total_cmp(&off(b.0)))
            .map(|(_, &goal)| goal)
    }

    /// Poses expanded so far.
    pub fn expansions(&self) -> usize {
        let back = self.back.as_ref().and_then(|back| back.search.as_ref());
        self.search.expansions() + back.map_or(0, Search::expansions)
    }

    /// The cheapest path so far, or why there is none.
    pub fn into_path(self) -> Result<Path, PlanError> {
        let (expansions, nearest_m) = (self.expansions(), self.search.nearest_m());
        match self.best {
            Some(found) => Ok(found.path),
            None if self.is_finished => Err(PlanError::NoPath {
                expansions,
                nearest_m,
            }),
            None => Err(PlanError::BudgetExhausted {
                expansions,
                nearest_m,
            }),
        }
    }

    /// Looks for a path with at most `budget` poses, then for a better one as long again, and shortens that only.
    pub(super) fn find(&mut self, budget: usize) {
        let mut allowed = budget;
        loop {
            let left = allowed.saturating_sub(self.expansions());
            match self.advance(left) {
                Standing::Paused => break,
                Standing::Done => {
                    self.is_finished = true;
                    break;
                }
                Standing::Better if self.search.is_good_enough() => break,
                Standing::Better => {
                    if allowed == budget {
                        let again = 2 * self.expansions() + LEAST_IMPROVEMENT;
                        allowed = again.min(budget);
                    }
                }
            }
        }
        self.keep_if_better();
    }

    /// Expands at most `count` poses, from both ends until there is a path.
    fn advance(&mut self, count: usize) -> Standing {
        let until = self.expansions().saturating_add(count);
        loop {
            let left = until.saturating_sub(self.expansions());
            if left == 0 {
                return Standing::Paused;
            }
            let alone = ALONE.saturating_sub(self.search.expansions());
            let standing = if self.raw.is_some() || self.back.is_none() || left == 1 {
                self.advance_alone(left)
            } else if alone > 0 {
                self.advance_alone(left.min(alone))
            } else {
                self.advance_both(TURN.min(left / 2))
            };
            if standing != Standing::Paused {
                return standing;
            }
        }
    }

    fn advance_alone(&mut self, count: usize) -> Standing {
        let standing = self.search.advance(&self.problem, count);
        if standing == Standing::Better {
            self.raw = self.search.path();
        }
        standing
    }

    /// Expands at most `count` poses from either end. Neither waits for what the other finds meanwhile, so that it does
    /// not matter whether they take turns.
    fn advance_both(&mut self, count: usize) -> Standing {
        let Some(back) = &mut self.back else {
            return self.advance_alone(count);
        };
        let (search, problem) = (&mut self.search, &self.problem);
        let mut there = || search.advance(problem, count);
        let mut and_back = || back.advance(count);
        let (there, and_back) = match rayon::current_thread_index() {
            Some(_) => rayon::join(there, and_back),
            None => (there(), and_back()),
        };
        let Some(returning) = &back.search else {
            // Not even a disc can go back: the guide of the way there disagrees by rounding.
            self.back = None;
            if there == Standing::Better {
                self.raw = search.path();
            }
            return there;
        };
        if and_back == Standing::Better && returning.bound() < search.bound() {
            self.raw = returning.path().map(|motions| backwards(&motions));
            search.bound_by(returning.bound());
            return Standing::Better;
        }
        match (there, and_back) {
            (Standing::Better, _) => {
                self.raw = search.path();
                Standing::Better
            }
            (Standing::Paused, Standing::Paused) => Standing::Paused,
            _ => Standing::Done,
        }
    }

    fn keep_if_better(&mut self) -> bool {
        let Some(motions) = self.raw.clone() else {
            return false;
        };
        let found = finished(&self.problem, motions, self.spacing_m);
        let is_better = (self.best.as_ref()).is_none_or(|best| found.cost < best.cost);
        if is_better {
            self.best = Some(found);
        }
        is_better
    }

    pub(super) fn into_parts(self) -> (Problem<'a>, Option<Found>) {
        (self.problem, self.best)
    }
}

impl Back<'_> {
    fn advance(&mut self, count: usize) -> Standing {
        if self.search.is_none() {
            self.search = Search::new(&self.problem).ok();
        }
        (self.search.as_mut()).map_or(Standing::Paused, |search| {
            search.advance(&self.problem, count)
        })
    }
}

impl Found {
    pub(super) fn into_parts(self) -> (Vec<Motion>, Path) {
        (self.motions, self.path)
    }
}

/// A path of the search, shortened and made waypoints of.
fn finished(problem: &Problem<'_>, motions: Vec<Motion>, spacing_m: f64) -> Found {
    let motions = smooth::shorten(problem, motions);
    Found {
        cost: problem.costs.of_chain(&problem.start, None, &motions),
        path: sampled(&problem.checker, &problem.start, &motions, spacing_m),
        motions,
    }
}

/// What judges poses for a vehicle that stands at `start`, where it must be free.
pub(super) fn checker<'a>(
    grid: &'a Traversability,
    vehicle: &Vehicle,
    start: Pose2,
    limits: &PlanLimits,
) -> Result<Checker<'a>, PlanError> {
    let footprint = Footprint::new(vehicle);
    let margins = Margins {
        clearance_m: limits.clearance_m,
        cross_unknown: matches!(limits.unknown, Unknown::Cross { .. }),
    };
    let checker = Checker::new(grid, footprint, start, margins);
    goal::check_inside(grid, End::Start, start.x_m, start.y_m)?;
    if checker.is_free(&start) {
        return Ok(checker);
    }
    let [x, y] = footprint.center(&start);
    Err(PlanError::Blocked {
        end: End::Start,
        x_m: start.x_m,
        y_m: start.y_m,
        distance_m: grid.clearance_m(x, y),
        needed_m: footprint.inradius() + limits.clearance_m,
        by: goal::nearest_obstacle(&checker, &[start]),
    })
}
