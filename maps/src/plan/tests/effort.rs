//! More effort, more goals, and maps that change.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;

fn planning<'a>(grid: &'a Traversability, start: Pose2, goals: &[Goal]) -> Planning<'a> {
    Planning::new(grid, &rover(), start, goals, &PlanLimits::default()).expect("free ends")
}

#[test]
fn more_effort_never_makes_a_path_dearer_and_ends_some_time() {
    let grid = drawn(&ROOM, 8);
    let (start, goal) = (Pose2::new(4.0, 1.9, FRAC_PI_2), Goal::place(1.0, 3.2));
    let mut planning = planning(&grid, start, &[goal]);
    assert_eq!(planning.path(), None);
    let (mut cost, mut better, mut rounds) = (f64::INFINITY, 0, 0);
    loop {
        rounds += 1;
        assert!(rounds < 10_000, "it does not end");
        match planning.improve(100) {
            Progress::Unchanged => {}
            Progress::Finished => break,
            Progress::Better => {
                better += 1;
                let now = planning.cost().expect("a path");
                assert!(now < cost, "{now} after {cost}");
                cost = now;
                let path = planning.path().expect("a path");
                check_promises(&grid, &rover(), (start, goal), &PlanLimits::default(), path);
            }
        }
    }
    assert!(better >= 1);
    assert_eq!(planning.improve(100), Progress::Finished);
    let once = plan(&grid, &rover(), start, goal, &PlanLimits::default()).expect("a path");
    let last = planning.into_path().expect("a path");
    assert!(
        last.length_m <= once.length_m * 1.2 + 0.5,
        "{} m",
        last.length_m
    );
}

#[test]
fn two_threads_find_the_paths_that_one_finds() {
    let two = rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .build()
        .expect("threads");
    let mut random = Pcg64::seed_from_u64(5);
    let mut hard = 0;
    for _ in 0..100 {
        let boxes: Vec<[usize; 4]> = (0..45)
            .map(|_| {
                let [x, y] = std::array::from_fn(|_| random.random_range(0..200));
                [x, y, random.random_range(1..30), random.random_range(1..30)]
            })
            .collect();
        let grid = field_with_boxes(200, &boxes);
        let mut any = || {
            Pose2::new(
                random.random_range(-0.5..8.5),
                random.random_range(-0.5..8.5),
                random.random_range(-PI..PI),
            )
        };
        let (start, goal) = (any(), Goal::pose(any()));
        let solve = || {
            let limits = PlanLimits {
                max_expansions: 10_000,
                ..PlanLimits::default()
            };
            let mut planning = Planning::new(&grid, &rover(), start, &[goal], &limits)?;
            planning.find(limits.max_expansions);
            Ok((planning.expansions(), planning.into_path()))
        };
        let alone: Result<_, PlanError> = solve();
        hard += usize::from(matches!(alone, Ok((1000.., Ok(_)))));
        assert_eq!(two.install(solve), alone);
    }
    assert!(hard >= 2, "only {hard} were searched from both ends");
}

#[test]
fn of_several_goals_the_nearest_by_the_way_is_reached() {
    // The second is nearer as the crow flies, but behind the wall.
    let grid = field_with_boxes(100, &[[50, 0, 2, 90]]);
    let start = Pose2::new(0.8, 0.0, FRAC_PI_2);
    let goals = [
        Goal::place(-0.2, 1.5),
        Goal::place(2.2, 0.0),
        Goal::place(1.55, 0.0),
    ];
    let mut planning = planning(&grid, start, &goals);
    assert_eq!(planning.improve(100_000), Progress::Better);
    assert_eq!(planning.reached(), Some(0), "the last is inside the wall");
    let only_blocked = [goals[2]];
    let limits = PlanLimits::default();
    let error = Planning::new(&grid, &rover(), start, &only_blocked, &limits).err();
    assert!(matches!(
        error,
        Some(PlanError::Blocked { end: End::Goal, .. })
    ));
    let none = Planning::new(&grid, &rover(), start, &[], &limits).err();
    assert_eq!(none, Some(PlanError::NoGoal));
}

#[test]
fn a_tour_visits_every_goal_each_from_where_the_one_before_ends() {
    let grid = field_with_boxes(120, &[[50, 0, 2, 60]]);
    let start = Pose2::new(-0.5, 0.0, 0.0);
    let goals = [
        Goal::place(4.3, 3.0),
        Goal::place(0.5, 0.5),
        Goal::place(3.5, -0.3),
        Goal::place(0.6, 3.0),
    ];
    let limits = PlanLimits::default();
    let tour = plan_tour(&grid, &rover(), start, &goals, &limits).expect("a tour");
    assert_eq!(tour.order, [1, 3, 0, 2]);
    let mut from = start;
    for (&goal, leg) in tour.order.iter().zip(&tour.legs) {
        check_promises(&grid, &rover(), (from, goals[goal]), &limits, leg);
        from = leg.waypoints.last().expect("a waypoint").pose;
    }
    let too_many = [goals[0]; 13];
    let error = plan_tour(&grid, &rover(), start, &too_many, &limits).expect_err("too many");
    assert_eq!(error.to_string(), "cannot order 13 goals: at most 12 are");
}

#[test]
fn stops_lie_on_the_ground_and_are_slower_in_curves() {
    let hill = Cell::Drivable {
        height_m: 1.5,
        cost: 0.0,
    };
    let grid = Traversability::from_cells([-1.0, -1.0], RESOLUTION_M, 100, vec![hill; 10_000])
        .expect("a grid");
    let (start, goal) = (Pose2::new(0.0, 0.0, 0.0), Pose2::new(2.0, 2.0, PI));
    let path = check_path(&grid, start, Goal::pose(goal));
    let speeds = Speeds::default();
    let stops = path.stops(&grid, &speeds);
    assert_eq!(stops.len(), path.waypoints.len());
    for stop in &stops {
        assert!((stop.place.raw.z - 1.5).abs() < 1e-12);
        assert!(stop.speed_mps > 0.0 && stop.speed_mps <= speeds.cruise_mps);
        assert!(
            (0.05..=0.125 + 1e-9).contains(&stop.accept_radius_m),
            "{stop:?}"
        );
    }
    let slowest = stops
        .iter()
        .map(|s| s.speed_mps)
        .fold(f64::INFINITY, f64::min);
    assert!(
        slowest < 0.8,
        "√(0.8·0.45) = 0.6 m/s at full lock: {slowest}"
    );
}

/// A hall of 8 m × 8 m with a wall across it that has two gaps, and something new in it.
fn hall(new: Option<[usize; 4]>) -> Traversability {
    let mut boxes = vec![[0, 80, 40, 4], [60, 80, 50, 4], [130, 80, 30, 4]];
    boxes.extend(new);
    field_with_boxes(160, &boxes)
}

const BELOW: Pose2 = Pose2::new(1.5, 0.0, FRAC_PI_2);
const ABOVE: Pose2 = Pose2::new(1.5, 6.0, FRAC_PI_2);

fn planner() -> Planner {
    Planner::new(rover(), Goal::pose(ABOVE), PlanLimits::default())
}

#[test]
fn where_nothing_on_the_path_changes_it_is_the_same() {
    let mut planner = planner();
    assert_eq!(planner.update(&hall(None), BELOW), Ok(Update::Planned));
    let before = planner.path().expect("a path").clone();
    // Far from the path.
    let changed = hall(Some([140, 20, 8, 8]));
    assert_eq!(planner.update(&changed, BELOW), Ok(Update::Kept));
    assert_eq!(planner.path(), Some(&before));
}

#[test]
fn a_vehicle_on_its_way_keeps_the_rest_of_its_path() {
    let mut planner = planner();
    planner.update(&hall(None), BELOW).expect("a path");
    let whole = planner.path().expect("a path").clone();
    let at = whole.waypoints[whole.waypoints.len() / 2].pose;
    let off = Pose2::new(at.x_m + 0.04, at.y_m, at.heading_rad + 0.05);
    assert_eq!(planner.update(&hall(None), off), Ok(Update::Kept));
    let rest = planner.path().expect("a path");
    assert!(
        rest.waypoints[0].pose.distance_m(&at) < 0.08,
        "on the path, beside the vehicle"
    );
    assert!(rest.length_m < 0.6 * whole.length_m);
    assert!(
        rest.waypoints
            .last()
            .expect("an end")
            .pose
            .distance_m(&ABOVE)
            < 1e-6
    );
}

#[test]
fn something_new_on_the_path_is_driven_around_and_the_rest_stays() {
    let mut planner = planner();
    planner.update(&hall(None), BELOW).expect("a path");
    let before = planner.path().expect("a path").clone();
    let grid = hall(Some([46, 108, 8, 8]));
    assert_eq!(planner.update(&grid, BELOW), Ok(Update::Repaired));
    let after = planner.path().expect("a path");
    check_promises(
        &grid,
        &rover(),
        (BELOW, Goal::pose(ABOVE)),
        &PlanLimits::default(),
        after,
    );
    for waypoint in &after.waypoints[..4] {
        assert!(
            (waypoint.pose.x_m - 1.5).abs() < 1e-9,
            "straight on where nothing is new"
        );
    }
    assert!(
        after.length_m < before.length_m + 1.5,
        "{} m",
        after.length_m
    );
}

#[test]
fn a_path_that_is_closed_altogether_becomes_another_one_or_an_error() {
    let mut planner = planner();
    planner.update(&hall(None), BELOW).expect("a path");
    let grid = hall(Some([40, 80, 20, 4]));
    let update = planner.update(&grid, BELOW).expect("through the other gap");
    assert_ne!(update, Update::Kept);
    let path = planner.path().expect("a path");
    check_promises(
        &grid,
        &rover(),
        (BELOW, Goal::pose(ABOVE)),
        &PlanLimits::default(),
        path,
    );
    let closed = hall(Some([0, 80, 160, 4]));
    let error = planner.update(&closed, BELOW).expect_err("no way");
    assert!(matches!(error, PlanError::NoPath { .. }), "{error}");
    assert_eq!(planner.path(), None);
}

#[test]
fn a_goal_that_becomes_blocked_is_said_to_be() {
    let mut planner = planner();
    planner.update(&hall(None), BELOW).expect("a path");
    let error = planner
        .update(&hall(Some([46, 136, 8, 8])), BELOW)
        .expect_err("on the goal");
    assert!(
        matches!(error, PlanError::Blocked { end: End::Goal, .. }),
        "{error}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]
    #[test]
    fn an_updated_path_keeps_its_promises(
        boxes in prop::collection::vec((0_usize..60, 0_usize..60, 1_usize..10, 1_usize..10), 0..5),
        new in prop::collection::vec((0_usize..60, 0_usize..60, 1_usize..6, 1_usize..6), 0..4),
        to in (0.0..1.7, 0.0..1.7, -PI..PI)
    ) {
        let mut boxes: Vec<_> = boxes.into_iter().map(|(x, y, w, h)| [x, y, w, h]).collect();
        let (start, goal) = (Pose2::new(-0.3, -0.4, 0.5), Goal::pose(Pose2::new(to.0, to.1, to.2)));
        let limits = PlanLimits { clearance_m: 0.0, max_expansions: 20_000, ..PlanLimits::default() };
        let mut planner = Planner::new(rover(), goal, limits);
        let first = planner.update(&field_with_boxes(60, &boxes), start);
        boxes.extend(new.into_iter().map(|(x, y, w, h)| [x, y, w, h]));
        let grid = field_with_boxes(60, &boxes);
        let second = planner.update(&grid, start);
        if let (Ok(_), Ok(_), Some(path)) = (first, second, planner.path()) {
            check_promises(&grid, &rover(), (start, goal), &limits, path);
        }
    }
}
