mod effort;

use std::f64::consts::{FRAC_PI_2, PI};

use proptest::prelude::*;

use super::motion::wrapped;
use super::*;
use crate::traversability::{Cell, CellIndex};

const FLAT: Cell = Cell::Drivable {
    height_m: 0.0,
    cost: 0.0,
};
const RESOLUTION_M: f64 = 0.05;

/// A map drawn as text, north up: `#` blocked, `?` unknown, `.` flat; every character is `scale` cells wide and high.
fn drawn(rows: &[&str], scale: usize) -> Traversability {
    let width = rows[0].len() * scale;
    let cells = rows
        .iter()
        .rev()
        .flat_map(|row| {
            let line: Vec<Cell> = row
                .chars()
                .flat_map(|c| {
                    let cell = match c {
                        '#' => Cell::Blocked,
                        '?' => Cell::Unknown,
                        _ => FLAT,
                    };
                    std::iter::repeat_n(cell, scale)
                })
                .collect();
            std::iter::repeat_n(line, scale).flatten()
        })
        .collect();
    Traversability::from_cells([0.0, 0.0], RESOLUTION_M, width, cells).expect("a grid")
}

/// A flat square field of `edge` cells with blocked boxes.
fn field_with_boxes(edge: usize, boxes: &[[usize; 4]]) -> Traversability {
    let mut cells = vec![FLAT; edge * edge];
    for &[x, y, w, h] in boxes {
        for row in y..(y + h).min(edge) {
            for column in x..(x + w).min(edge) {
                cells[row * edge + column] = Cell::Blocked;
            }
        }
    }
    Traversability::from_cells([-1.0, -1.0], RESOLUTION_M, edge, cells).expect("a grid")
}

/// Distance from the footprint to the nearest blocked cell, by points on both outlines and inside: independent of the
/// planner's own geometry, and at most `fine` too large.
fn clearance_by_points(grid: &Traversability, vehicle: &Vehicle, pose: &Pose2, fine: f64) -> f64 {
    let steps = |length: f64| (length / fine).ceil() as usize;
    let (n, m) = (steps(vehicle.length_m), steps(vehicle.width_m));
    let rear = 0.5 * (vehicle.length_m - vehicle.wheelbase_m);
    let (sin, cos) = pose.heading_rad.sin_cos();
    let mut least = f64::INFINITY;
    for i in 0..=n {
        for j in 0..=m {
            let ahead = vehicle.length_m * i as f64 / n as f64 - rear;
            let left = vehicle.width_m * (j as f64 / m as f64 - 0.5);
            let x = pose.x_m + ahead * cos - left * sin;
            let y = pose.y_m + ahead * sin + left * cos;
            for (index, cell) in grid.cells() {
                if cell == Cell::Blocked {
                    let [cx, cy] = grid.center_of(index);
                    let half = 0.5 * grid.resolution_m();
                    let apart = ((x - cx).abs() - half)
                        .max(0.0)
                        .hypot(((y - cy).abs() - half).max(0.0));
                    least = least.min(apart);
                }
            }
        }
    }
    least
}

/// The cells whose middle the footprint covers.
fn under(grid: &Traversability, vehicle: &Vehicle, pose: &Pose2) -> Vec<CellIndex> {
    let (sin, cos) = pose.heading_rad.sin_cos();
    let rear = 0.5 * (vehicle.length_m - vehicle.wheelbase_m);
    grid.cells()
        .map(|(index, _)| index)
        .filter(|&index| {
            let [x, y] = grid.center_of(index);
            let (dx, dy) = (x - pose.x_m, y - pose.y_m);
            let (ahead, left) = (dx * cos + dy * sin, dy * cos - dx * sin);
            (-rear..=vehicle.length_m - rear).contains(&ahead)
                && left.abs() <= 0.5 * vehicle.width_m
        })
        .collect()
}

/// Everything that a path promises, whatever the map.
#[track_caller]
fn check_promises(
    grid: &Traversability,
    vehicle: &Vehicle,
    (start, goal): (Pose2, Goal),
    limits: &PlanLimits,
    path: &Path,
) {
    let first = path.waypoints.first().expect("a waypoint");
    let last = path.waypoints.last().expect("a waypoint");
    assert_eq!(first.pose, start, "begins where the vehicle stands");
    let off = last.pose.distance_m(&Pose2::new(goal.x_m, goal.y_m, 0.0));
    assert!(off <= goal.tolerance_m + 1e-6, "ends {off} m from the goal");
    if let Some(heading) = goal.heading_rad {
        let turn = wrapped(last.pose.heading_rad - heading).abs();
        assert!(turn < 1e-6, "ends turned by {turn} rad");
    }
    let mut length = 0.0;
    for pair in path.waypoints.windows(2) {
        let (a, b) = (&pair[0].pose, &pair[1].pose);
        let (chord, turn) = (
            a.distance_m(b),
            wrapped(b.heading_rad - a.heading_rad).abs(),
        );
        // An arc of radius r that turns by t has the chord 2·r·sin(t/2).
        let tightest = 2.0 * vehicle.min_turning_radius_m * (0.5 * turn).sin();
        assert!(
            chord >= tightest - 1e-9,
            "{pair:?} is tighter than the vehicle turns"
        );
        assert!(
            chord <= limits.waypoint_spacing_m + 1e-9,
            "{pair:?} are far apart"
        );
        let [ahead, _, _] = a.local(b);
        let signed = if pair[1].gear == Gear::Forward {
            ahead
        } else {
            -ahead
        };
        assert!(signed > 0.0, "{pair:?} go against their gear");
        length += chord;
    }
    assert!(path.length_m >= length - 1e-9 && path.length_m <= 1.1 * length + 1e-9);
    let fine = 0.02;
    let mut least = f64::INFINITY;
    for waypoint in &path.waypoints {
        least = least.min(clearance_by_points(grid, vehicle, &waypoint.pose, fine));
    }
    assert!(
        least >= path.min_clearance_m - 0.01,
        "{least} m < {} m",
        path.min_clearance_m
    );
    assert!(
        path.min_clearance_m >= limits.clearance_m - 1e-9,
        "{} m of clearance",
        path.min_clearance_m
    );
}

fn rover() -> Vehicle {
    Vehicle::default()
}

#[track_caller]
fn check_path(grid: &Traversability, start: Pose2, goal: Goal) -> Path {
    let limits = PlanLimits::default();
    let path = plan(grid, &rover(), start, goal, &limits).expect("a path");
    check_promises(grid, &rover(), (start, goal), &limits, &path);
    path
}

const ROOM: [&str; 10] = [
    "####################",
    "#..................#",
    "#..................#",
    "#.......####.......#",
    "#.......#..#.......#",
    "#.......#..#.......#",
    "#.......#..#.......#",
    "#..................#",
    "#..................#",
    "####################",
];

#[test]
fn on_open_ground_the_path_is_the_straight_line() {
    let path = check_path(
        &field_with_boxes(100, &[]),
        Pose2::new(0.0, 0.0, 0.0),
        Goal::pose(Pose2::new(3.0, 0.0, 0.0)),
    );
    assert!((path.length_m - 3.0).abs() < 1e-9);
    assert_eq!(path.gear_changes(), 0);
    assert!(path.min_clearance_m.is_infinite(), "nothing is blocked");
    assert_eq!(path.waypoints.len(), 13, "every 0.25 m");
}

#[test]
fn a_path_to_where_the_vehicle_stands_is_one_waypoint() {
    let start = Pose2::new(0.0, 0.0, 0.3);
    let path = check_path(&field_with_boxes(60, &[]), start, Goal::pose(start));
    assert_eq!(path.waypoints.len(), 1);
    assert!(path.length_m.abs() < 1e-9);
}

#[test]
fn obstacles_are_driven_around() {
    let grid = drawn(&ROOM, 8);
    let (start, goal) = (Pose2::new(1.0, 2.0, 0.0), Pose2::new(6.5, 2.0, 0.0));
    let path = check_path(&grid, start, Goal::pose(goal));
    assert!(
        path.length_m > 5.5 && path.length_m < 8.5,
        "{} m",
        path.length_m
    );
}

#[test]
fn a_pocket_is_entered_and_left_in_reverse() {
    let grid = drawn(&ROOM, 8);
    let pocket = Pose2::new(4.0, 1.9, FRAC_PI_2);
    let path = check_path(&grid, pocket, Goal::pose(Pose2::new(1.0, 3.2, PI)));
    assert_eq!(path.waypoints[0].gear, Gear::Reverse);
}

#[test]
fn without_a_heading_the_path_is_no_longer_than_with_the_worst() {
    let grid = field_with_boxes(120, &[]);
    let start = Pose2::new(1.0, 1.0, 0.0);
    let any = check_path(&grid, start, Goal::place(3.0, 1.0));
    let turned = check_path(&grid, start, Goal::pose(Pose2::new(3.0, 1.0, PI)));
    assert!((any.length_m - 2.0).abs() < 1e-6);
    assert!(any.length_m < turned.length_m);
}

#[test]
fn the_path_is_the_same_every_time() {
    let grid = drawn(&ROOM, 8);
    let (start, goal) = (Pose2::new(1.0, 2.0, 0.0), Goal::place(6.5, 2.0));
    assert_eq!(
        check_path(&grid, start, goal),
        check_path(&grid, start, goal)
    );
}

#[track_caller]
fn error(grid: &Traversability, start: Pose2, goal: Goal, limits: &PlanLimits) -> PlanError {
    plan(grid, &rover(), start, goal, limits).expect_err("no path")
}

#[test]
fn a_start_on_an_obstacle_is_refused_with_the_distance() {
    let grid = field_with_boxes(100, &[[40, 10, 10, 10]]);
    let found = error(
        &grid,
        Pose2::new(1.1, -0.2, 0.0),
        Goal::place(3.0, 3.0),
        &PlanLimits::default(),
    );
    assert!(
        matches!(
            found,
            PlanError::Blocked {
                end: End::Start,
                ..
            }
        ),
        "{found}"
    );
    assert_eq!(
        found.to_string(),
        "the start (1.10, -0.20) m is blocked by an obstacle at (1.02, -0.38) m, 0.00 m from the vehicle's middle, which needs 0.20 m around it"
    );
}

#[test]
fn a_goal_on_an_obstacle_beside_one_or_outside_is_refused_each_in_its_way() {
    let grid = field_with_boxes(100, &[[40, 10, 10, 10]]);
    let (start, limits) = (Pose2::new(0.0, 0.0, 0.0), PlanLimits::default());
    let on = error(&grid, start, Goal::place(1.25, -0.25), &limits);
    assert!(
        matches!(on, PlanError::Blocked { end: End::Goal, .. }),
        "{on}"
    );
    let beside = Goal::pose(Pose2::new(1.2, 0.18, 0.0));
    let beside = error(&grid, start, beside, &limits);
    let PlanError::GoalTooClose {
        clearance_m,
        needed_m,
        ..
    } = beside
    else {
        panic!("{beside}");
    };
    assert!(
        (clearance_m - 0.03).abs() < 1e-6,
        "0.18 m less half the width: {clearance_m}"
    );
    assert!((0.05..0.1).contains(&needed_m));
    let outside = error(&grid, start, Goal::place(4.1, 0.0), &limits);
    assert!(
        matches!(outside, PlanError::Outside { end: End::Goal, .. }),
        "{outside}"
    );
}

#[test]
fn within_its_tolerance_a_blocked_goal_moves_to_the_nearest_free_place() {
    let grid = field_with_boxes(100, &[[40, 10, 10, 10]]);
    let goal = Goal {
        tolerance_m: 0.8,
        ..Goal::place(1.25, -0.25)
    };
    let path = check_path(&grid, Pose2::new(0.0, 0.0, 0.0), goal);
    let end = path.waypoints.last().expect("a waypoint").pose;
    let moved = end.distance_m(&Pose2::new(1.25, -0.25, 0.0));
    assert!((0.3..0.6).contains(&moved), "moved by {moved} m");
}

#[test]
fn behind_a_wall_there_is_no_path_and_the_error_says_how_near_it_gets() {
    let grid = field_with_boxes(100, &[[50, 0, 2, 100]]);
    let start = Pose2::new(0.0, 1.0, 0.0);
    let found = error(&grid, start, Goal::place(3.0, 1.0), &PlanLimits::default());
    let PlanError::NoPath { nearest_m, .. } = found else {
        panic!("{found}");
    };
    assert!(
        (1.4..2.0).contains(&nearest_m),
        "the wall is 1.5 m from the goal: {nearest_m} m"
    );
}

#[test]
fn a_budget_of_one_pose_is_reported_as_used_up() {
    let grid = drawn(&ROOM, 8);
    let limits = PlanLimits {
        max_expansions: 1,
        ..PlanLimits::default()
    };
    let start = Pose2::new(4.0, 1.9, FRAC_PI_2);
    let found = error(&grid, start, Goal::pose(Pose2::new(4.0, 3.3, 0.0)), &limits);
    assert!(
        matches!(found, PlanError::BudgetExhausted { expansions: 1, .. }),
        "{found}"
    );
}

#[test]
fn unknown_ground_is_avoided_or_crossed_as_asked() {
    let rows = [
        "....????....",
        "....????....",
        "....????....",
        "............",
    ];
    let grid = drawn(&rows, 10);
    let (start, goal) = (Pose2::new(0.5, 1.4, 0.0), Pose2::new(5.0, 1.4, 0.0));
    let around = check_path(&grid, start, Goal::pose(goal));
    let crossing = PlanLimits {
        unknown: Unknown::Cross { cost: 0.1 },
        ..PlanLimits::default()
    };
    let across = plan(&grid, &rover(), start, Goal::pose(goal), &crossing).expect("a path");
    assert!((across.length_m - 4.5).abs() < 1e-6, "straight across");
    assert!(around.length_m > across.length_m + 0.2, "{around:?}");
    for waypoint in &around.waypoints {
        for index in under(&grid, &rover(), &waypoint.pose) {
            assert_eq!(grid.cell_at(index), FLAT, "under {waypoint:?}");
        }
    }
    let into = error(&grid, start, Goal::place(3.0, 1.4), &PlanLimits::default());
    let PlanError::GoalUnknown { known_m, .. } = into else {
        panic!("{into}");
    };
    assert!((0.85..1.2).contains(&known_m), "{known_m} m");
}

#[test]
fn a_vehicle_on_a_small_unknown_patch_may_leave_it() {
    let mut cells = vec![FLAT; 100 * 100];
    for y in 47..53 {
        for x in 47..55 {
            cells[y * 100 + x] = Cell::Unknown;
        }
    }
    let grid = Traversability::from_cells([0.0, 0.0], RESOLUTION_M, 100, cells).expect("a grid");
    check_path(&grid, Pose2::new(2.45, 2.5, 0.0), Goal::place(4.0, 4.0));
}

#[test]
fn a_vehicle_parked_at_a_wall_may_leave_it() {
    let grid = field_with_boxes(100, &[[0, 0, 100, 10]]);
    // 0.02 m between its side and the wall, whose edge is at y = -0.5 m.
    let start = Pose2::new(1.0, -0.33, 0.0);
    let limits = PlanLimits::default();
    let path = plan(&grid, &rover(), start, Goal::place(3.0, 2.0), &limits).expect("a path");
    let least = path.min_clearance_m;
    assert!((0.01..=0.02).contains(&least), "{least} m");
}

#[test]
fn arguments_that_make_no_sense_are_refused_by_name() {
    let grid = field_with_boxes(40, &[]);
    let (start, goal) = (Pose2::new(0.0, 0.0, 0.0), Goal::place(0.5, 0.0));
    let refused = |vehicle: Vehicle, start: Pose2, goal: Goal, limits: PlanLimits| {
        let found = plan(&grid, &vehicle, start, goal, &limits);
        assert!(matches!(found, Err(PlanError::Invalid { .. })), "{found:?}");
    };
    for wrong in [f64::NAN, f64::INFINITY, -1.0] {
        let limits = PlanLimits::default();
        refused(
            Vehicle {
                length_m: wrong,
                ..rover()
            },
            start,
            goal,
            limits,
        );
        refused(
            Vehicle {
                min_turning_radius_m: wrong,
                ..rover()
            },
            start,
            goal,
            limits,
        );
        refused(
            rover(),
            start,
            Goal {
                tolerance_m: wrong,
                ..goal
            },
            limits,
        );
        let limits = PlanLimits {
            clearance_m: wrong,
            ..limits
        };
        refused(rover(), start, goal, limits);
    }
    for wrong in [f64::NAN, f64::INFINITY] {
        let limits = PlanLimits::default();
        refused(rover(), Pose2::new(wrong, 0.0, 0.0), goal, limits);
        refused(rover(), start, Goal::place(0.0, wrong), limits);
    }
}

#[test]
fn a_grid_without_cells_contains_neither_start_nor_goal() {
    let grid = Traversability::from_cells([0.0, 0.0], 0.05, 0, Vec::new()).expect("no cells");
    let found = error(
        &grid,
        Pose2::new(0.0, 0.0, 0.0),
        Goal::place(0.0, 0.0),
        &PlanLimits::default(),
    );
    assert!(matches!(
        found,
        PlanError::Outside {
            end: End::Start,
            ..
        }
    ));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]
    #[test]
    fn every_path_keeps_its_promises(
        boxes in prop::collection::vec((0_usize..60, 0_usize..60, 1_usize..12, 1_usize..12), 0..8),
        from in (-0.9..1.9, -0.9..1.9, -PI..PI), to in (-0.9..1.9, -0.9..1.9, -PI..PI), any_heading: bool
    ) {
        let boxes: Vec<_> = boxes.into_iter().map(|(x, y, w, h)| [x, y, w, h]).collect();
        let grid = field_with_boxes(60, &boxes);
        let start = Pose2::new(from.0, from.1, from.2);
        let mut goal = Goal::pose(Pose2::new(to.0, to.1, to.2));
        if any_heading {
            goal.heading_rad = None;
        }
        // Without a margin nothing is relaxed near the start, so that all must hold everywhere.
        let limits = PlanLimits { clearance_m: 0.0, max_expansions: 20_000, ..PlanLimits::default() };
        if let Ok(path) = plan(&grid, &rover(), start, goal, &limits) {
            check_promises(&grid, &rover(), (start, goal), &limits, &path);
        }
    }

    #[test]
    fn no_input_makes_the_planner_panic(
        numbers in prop::collection::vec(prop_oneof![
            -3.0..3.0_f64, Just(f64::NAN), Just(f64::INFINITY), Just(1e300), Just(-1e300), Just(0.0), Just(1e-300)
        ], 12),
        kinds in prop::collection::vec(0_u8..4, 30), width in 0_usize..7
    ) {
        let cells: Vec<Cell> = kinds.iter().take(width * (30 / width.max(1))).map(|kind| match kind {
            0 => Cell::Unknown,
            1 => Cell::Blocked,
            2 => Cell::Drivable { height_m: numbers[0], cost: numbers[1] },
            _ => FLAT,
        }).collect();
        let grid = Traversability::from_cells([numbers[2], numbers[3]], 0.2, width, cells);
        if let Ok(grid) = grid {
            let start = Pose2::new(numbers[4], numbers[5], numbers[6]);
            let goal = Goal { x_m: numbers[7], y_m: numbers[8], heading_rad: Some(numbers[9]), tolerance_m: numbers[10] };
            let limits = PlanLimits { clearance_m: numbers[11], max_expansions: 200, ..PlanLimits::default() };
            let vehicle = Vehicle { length_m: numbers[1], wheelbase_m: numbers[0], ..rover() };
            drop(plan(&grid, &vehicle, start, goal, &limits));
            drop(plan(&grid, &rover(), start, goal, &limits));
        }
    }
}
