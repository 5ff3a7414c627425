//! One drive to several goals, in the order that costs least.
//!
//! What a leg costs is estimated by the way of a disc ([`super::field`]); the best order for these costs is found exactly (M.
//! Held, R. Karp, *A dynamic programming approach to sequencing problems*, 1962), and then each leg is planned from where
//! the one before ends. The drive does not return to its start.

use super::anytime::{Planning, checker};
use super::cost::CostModel;
use super::field::Field;
use super::motion::Pose2;
use super::{Goal, Path, PlanError, PlanLimits, goal, validate};
use crate::traversability::{Traversability, Vehicle};

/// A drive to several goals.
#[derive(Clone, Debug, PartialEq)]
pub struct Tour {
    /// The goals, by their number, in the order in which they are visited.
    pub order: Vec<usize>,
    /// The path to each of them; every one begins where the one before ends.
    pub legs: Vec<Path>,
}

/// More goals are not put in order: the effort doubles with each.
const MOST_GOALS: usize = 12;

/// A drive from `start` to all of `goals`. Fails if one of them cannot be reached.
pub fn plan_tour(
    grid: &Traversability,
    vehicle: &Vehicle,
    start: Pose2,
    goals: &[Goal],
    limits: &PlanLimits,
) -> Result<Tour, PlanError> {
    validate(vehicle, &start, goals, limits)?;
    if goals.is_empty() {
        return Err(PlanError::NoGoal);
    }
    if goals.len() > MOST_GOALS {
        return Err(PlanError::TooManyGoals {
            goals: goals.len(),
            most: MOST_GOALS,
        });
    }
    let order = best_order(&costs(grid, vehicle, start, goals, limits)?);
    let mut legs = Vec::with_capacity(goals.len());
    let mut from = start;
    for &goal in &order {
        let mut planning = Planning::new(grid, vehicle, from, &[goals[goal]], limits)?;
        planning.find(limits.max_expansions);
        let path = planning.into_path()?;
        from = path.waypoints.last().map_or(from, |waypoint| waypoint.pose);
        legs.push(path);
    }
    Ok(Tour { order, legs })
}

/// What it costs about to each goal, by row: from the start, then from each goal.
fn costs(
    grid: &Traversability,
    vehicle: &Vehicle,
    start: Pose2,
    goals: &[Goal],
    limits: &PlanLimits,
) -> Result<Vec<Vec<f64>>, PlanError> {
    let checker = checker(grid, vehicle, start, limits)?;
    let needed_m = checker.footprint.inradius() + limits.clearance_m;
    let model = CostModel::new(grid, &checker.footprint, limits);
    let mut places = vec![checker.footprint.center(&start)];
    for goal in goals {
        let poses = goal::settle(&checker, goal, needed_m)?;
        places.extend(poses.first().map(|pose| checker.footprint.center(pose)));
    }
    let mut costs = vec![vec![f64::INFINITY; goals.len()]; places.len()];
    for (to, &place) in places[1..].iter().enumerate() {
        let mut field = Field::new(grid, &[place], None);
        for (row, &[x, y]) in costs.iter_mut().zip(&places) {
            if let Some(cell) = grid.nearest_index(x, y) {
                row[to] = field.cost_from(&checker, &model, cell);
            }
        }
    }
    Ok(costs)
}

/// The cheapest order of all goals, of equals the first.
fn best_order(costs: &[Vec<f64>]) -> Vec<usize> {
    let count = costs[0].len();
    // By the set of goals visited and the last of them: what it costs, and which was the last but one.
    let mut best = vec![vec![(f64::INFINITY, usize::MAX); count]; 1 << count];
    for first in 0..count {
        best[1 << first][first] = (costs[0][first], usize::MAX);
    }
    for visited in 1..1_usize << count {
        for last in (0..count).filter(|last| visited & (1 << last) != 0) {
            let (cost, _) = best[visited][last];
            for next in (0..count).filter(|next| visited & (1 << next) == 0) {
                let reached = cost + costs[last + 1][next];
                let known = &mut best[visited | (1 << next)][next];
                // An infinite one is taken too, so that there always is an order, whose planning then says what is wrong.
                if known.1 == usize::MAX || reached < known.0 {
                    *known = (reached, last);
                }
            }
        }
    }
    let mut visited = (1 << count) - 1;
    let mut last = (0..count)
        .min_by(|&a, &b| best[visited][a].0.total_cmp(&best[visited][b].0))
        .unwrap_or(0);
    let mut order = vec![last];
    while order.len() < count {
        let before = best[visited][last].1;
        visited &= !(1 << last);
        last = before;
        order.push(last);
    }
    order.reverse();
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_on_a_line_are_visited_from_the_near_to_the_far_end() {
        let at: [f64; 5] = [0.0, 7.0, 2.0, 9.0, 4.0];
        let costs: Vec<Vec<f64>> = (at.iter())
            .map(|from| at[1..].iter().map(|to| (to - from).abs()).collect())
            .collect();
        assert_eq!(best_order(&costs), [1, 3, 0, 2]);
    }

    #[test]
    fn where_a_goal_cannot_be_reached_there_still_is_an_order() {
        let costs = vec![vec![f64::INFINITY; 3]; 4];
        let mut order = best_order(&costs);
        order.sort_unstable();
        assert_eq!(order, [0, 1, 2]);
    }
}
