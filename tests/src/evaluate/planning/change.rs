//! Something new stands on the path: repairing it against planning anew.

use maps::plan::{Goal, Path, Planner, Update};
use maps::traversability::{Cell, Traversability};

use super::referee::{self, Stop};
use super::sets::{Problem, Robot, Set};
use super::{Attempt, timed};

/// Half the edge of what is new.
const HALF_M: f64 = 0.6;

/// Both on every problem of a set that has a path: repaired, then anew.
pub(super) fn compare(set: &Set) -> Vec<[Attempt; 2]> {
    let mut attempts = Vec::new();
    for ground in &set.grounds {
        for problem in &ground.problems {
            attempts.extend(changed(&ground.grid, &set.robot, problem));
        }
    }
    attempts
}

fn changed(grid: &Traversability, robot: &Robot, problem: &Problem) -> Option<[Attempt; 2]> {
    let goal = Goal::pose(problem.goal);
    let mut planner = Planner::new(robot.vehicle, goal, robot.limits);
    planner.update(grid, problem.start).ok()?;
    let waypoints = &planner.path()?.waypoints;
    let middle = waypoints[waypoints.len() / 2].pose;
    let grid = with_a_box(grid, [middle.x_m, middle.y_m])?;
    let attempt = |took, path: Option<&Path>| Attempt {
        verdict: path.map(|path| {
            let stops: Vec<Stop> = path.waypoints.iter().map(|w| (w.pose, w.gear)).collect();
            referee::judge(&grid, &robot.vehicle, &stops)
        }),
        took,
    };
    let (took, repaired) = timed(|| {
        let mut planner = planner.clone();
        let update = planner.update(&grid, problem.start);
        (planner, update)
    });
    let path = (repaired.1 != Ok(Update::Kept))
        .then(|| repaired.0.path())
        .flatten();
    let repaired = attempt(took, path);
    let (took, anew) =
        timed(|| maps::plan::plan(&grid, &robot.vehicle, problem.start, goal, &robot.limits));
    Some([repaired, attempt(took, anew.ok().as_ref())])
}

/// The grid with one more thing on it.
fn with_a_box(grid: &Traversability, [x_m, y_m]: [f64; 2]) -> Option<Traversability> {
    let cells = grid
        .cells()
        .map(|(index, cell)| {
            let [x, y] = grid.center_of(index);
            if (x - x_m).abs().max((y - y_m).abs()) <= HALF_M {
                Cell::Blocked
            } else {
                cell
            }
        })
        .collect();
    Traversability::from_cells(grid.origin_m(), grid.resolution_m(), grid.size().0, cells).ok()
}
