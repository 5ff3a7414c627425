//! Which poses stand for a goal, or why none does.

use std::f64::consts::TAU;

use super::footprint::Checker;
use super::motion::{Pose2, wrapped};
use super::{End, Goal, Obstacle, PlanError};
use crate::traversability::{Cell, CellIndex, Traversability};

/// Headings tried where any will do.
const HEADINGS: usize = 16;
/// How far from the goal a pose within its tolerance is looked for.
const SEARCH_CELLS: f64 = 64.0;

pub(crate) fn check_inside(
    grid: &Traversability,
    end: End,
    x_m: f64,
    y_m: f64,
) -> Result<CellIndex, PlanError> {
    let ([west_m, south_m], (width, height)) = (grid.origin_m(), grid.size());
    grid.index_of(x_m, y_m).ok_or(PlanError::Outside {
        end,
        x_m,
        y_m,
        west_m,
        east_m: west_m + width as f64 * grid.resolution_m(),
        south_m,
        north_m: south_m + height as f64 * grid.resolution_m(),
    })
}

/// The blocked cell that is nearest to the footprint in any of the poses. There must be one.
pub(crate) fn nearest_obstacle(checker: &Checker<'_>, poses: &[Pose2]) -> Obstacle {
    let grid = checker.grid();
    let nearest = (poses.iter())
        .filter_map(|pose| checker.nearest_blocked(pose))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let (at, why) = nearest.map_or(([f64::NAN; 2], None), |(_, cell)| {
        (grid.center_of(cell), grid.hindrance(cell))
    });
    Obstacle {
        x_m: at[0],
        y_m: at[1],
        why,
    }
}

/// The free poses at the place nearest to the goal that has any: one, if the goal has a heading.
pub(crate) fn settle(
    checker: &Checker<'_>,
    goal: &Goal,
    needed_m: f64,
) -> Result<Vec<Pose2>, PlanError> {
    let grid = checker.grid();
    let middle = check_inside(grid, End::Goal, goal.x_m, goal.y_m)?;
    let at_place = |[x_m, y_m]: [f64; 2]| -> Vec<Pose2> {
        headings(goal)
            .map(|heading_rad| Pose2::new(x_m, y_m, heading_rad))
            .filter(|pose| checker.is_free(pose))
            .collect()
    };
    let exact = at_place([goal.x_m, goal.y_m]);
    if !exact.is_empty() {
        return Ok(exact);
    }
    for place in places_around(grid, goal, middle) {
        let poses = at_place(place);
        if !poses.is_empty() {
            return Ok(poses);
        }
    }
    Err(why_not(checker, goal, needed_m))
}

fn headings(goal: &Goal) -> impl Iterator<Item = f64> {
    let (first, count) = match goal.heading_rad {
        Some(heading) => (wrapped(heading), 1),
        None => (0.0, HEADINGS),
    };
    (0..count).map(move |i| wrapped(first + i as f64 * TAU / HEADINGS as f64))
}

/// The middles of the cells within the tolerance, nearest first.
fn places_around(grid: &Traversability, goal: &Goal, middle: CellIndex) -> Vec<[f64; 2]> {
    let reach = (goal.tolerance_m / grid.resolution_m()).min(SEARCH_CELLS) as usize;
    let (width, height) = grid.size();
    let mut places = Vec::new();
    for y in middle.y.saturating_sub(reach)..=(middle.y + reach).min(height - 1) {
        for x in middle.x.saturating_sub(reach)..=(middle.x + reach).min(width - 1) {
            let [px, py] = grid.center_of(CellIndex { x, y });
            let distance = (px - goal.x_m).hypot(py - goal.y_m);
            if distance <= goal.tolerance_m {
                places.push((distance, [px, py]));
            }
        }
    }
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    places.into_iter().map(|(_, place)| place).collect()
}

fn why_not(checker: &Checker<'_>, goal: &Goal, needed_m: f64) -> PlanError {
    let (x_m, y_m) = (goal.x_m, goal.y_m);
    let poses: Vec<Pose2> = headings(goal)
        .map(|heading_rad| Pose2::new(x_m, y_m, heading_rad))
        .collect();
    let clearance_m = poses
        .iter()
        .map(|pose| checker.clearance_m(pose, checker.margin_m()))
        .fold(0.0, f64::max);
    if clearance_m <= 0.0 {
        let distance_m = poses
            .iter()
            .map(|pose| {
                let [x, y] = checker.footprint.center(pose);
                checker.grid().clearance_m(x, y)
            })
            .fold(0.0, f64::max);
        return PlanError::Blocked {
            end: End::Goal,
            x_m,
            y_m,
            distance_m,
            needed_m,
            by: nearest_obstacle(checker, &poses),
        };
    }
    if clearance_m < checker.margin_m() && poses.iter().any(|p| checker.is_on_known_ground(p)) {
        return PlanError::GoalTooClose {
            x_m,
            y_m,
            clearance_m,
            needed_m: checker.margin_m(),
            of: nearest_obstacle(checker, &poses),
        };
    }
    let known_m = checker
        .grid()
        .cells()
        .filter(|(_, cell)| matches!(cell, Cell::Drivable { .. }))
        .map(|(index, _)| {
            let [x, y] = checker.grid().center_of(index);
            (x - x_m).hypot(y - y_m)
        })
        .fold(f64::INFINITY, f64::min);
    PlanError::GoalUnknown { x_m, y_m, known_m }
}
