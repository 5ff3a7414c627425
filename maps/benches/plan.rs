//! Planning time on grids of 400 × 400 cells of 0.05 m, and the time it takes to make such a grid from voxels.
//!
//! `cargo bench -p maps --bench plan` prints, besides criterion's figures, the median and the 99th percentile over 200
//! seeded problems of each kind, with how many had a path.

#![expect(clippy::print_stdout, reason = "a bench reports on its output")]

use std::f64::consts::PI;
use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use maps::plan::{Goal, Path, PlanError, PlanLimits, Pose2, plan};
use maps::traversability::{Cell, Traversability, Vehicle};
use maps::voxel::{LogOdds, Voxel, VoxelKey, VoxelMap};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

const EDGE: usize = 400;
const RESOLUTION_M: f64 = 0.05;
const FLAT: Cell = Cell::Drivable {
    height_m: 0.0,
    cost: 0.0,
};
const SEED: u64 = 20_260_610;
const PROBLEMS: usize = 200;

/// A hall with boxes of 0.2 to 2 m in it, about a tenth of its floor.
fn hall(random: &mut Pcg64) -> Vec<Cell> {
    let mut cells = vec![FLAT; EDGE * EDGE];
    for _ in 0..35 {
        let (w, h) = (random.random_range(4..40), random.random_range(4..40));
        let (x, y) = (
            random.random_range(0..EDGE - w),
            random.random_range(0..EDGE - h),
        );
        fill(&mut cells, [x, y, w, h], Cell::Blocked);
    }
    cells
}

/// A building of 2.5 m × 2.5 m rooms: a tree of doors 0.9 m wide leads to every room.
fn maze(random: &mut Pcg64) -> Vec<Cell> {
    const ROOM: usize = 50;
    let rooms = EDGE / ROOM;
    let mut cells = vec![FLAT; EDGE * EDGE];
    for i in 0..=rooms {
        let wall = (i * ROOM).min(EDGE - 2);
        fill(&mut cells, [wall, 0, 2, EDGE], Cell::Blocked);
        fill(&mut cells, [0, wall, EDGE, 2], Cell::Blocked);
    }
    // A random walk that opens a door into every room it enters for the first time.
    let (mut x, mut y, mut entered) = (0_usize, 0_usize, vec![false; rooms * rooms]);
    entered[0] = true;
    while entered.contains(&false) {
        let (dx, dy): (isize, isize) =
            [(1, 0), (-1, 0), (0, 1), (0, -1)][random.random_range(0..4)];
        let (Some(u), Some(v)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else {
            continue;
        };
        if u >= rooms || v >= rooms {
            continue;
        }
        if !std::mem::replace(&mut entered[v * rooms + u], true) {
            let along = random.random_range(5..ROOM - 25);
            let door = if dx == 0 {
                [x * ROOM + along, y.max(v) * ROOM, 18, 2]
            } else {
                [x.max(u) * ROOM, y * ROOM + along, 2, 18]
            };
            fill(&mut cells, door, FLAT);
        }
        (x, y) = (u, v);
    }
    cells
}

fn fill(cells: &mut [Cell], [x, y, w, h]: [usize; 4], with: Cell) {
    for row in y..(y + h).min(EDGE) {
        cells[row * EDGE + x..row * EDGE + (x + w).min(EDGE)].fill(with);
    }
}

struct Problem {
    grid: Traversability,
    start: Pose2,
    goal: Goal,
}

/// Problems whose start and goal are free, on ten grids.
fn problems(make: fn(&mut Pcg64) -> Vec<Cell>) -> Vec<Problem> {
    let mut random = Pcg64::seed_from_u64(SEED);
    let mut problems = Vec::new();
    while problems.len() < PROBLEMS {
        let grid = Traversability::from_cells([0.0, 0.0], RESOLUTION_M, EDGE, make(&mut random))
            .expect("a grid");
        let mut pose = || {
            Pose2::new(
                random.random_range(0.5..19.5),
                random.random_range(0.5..19.5),
                random.random_range(-PI..PI),
            )
        };
        let mut on_this_grid = 0;
        while on_this_grid < PROBLEMS / 10 {
            let (start, goal) = (pose(), pose());
            let room = |p: &Pose2| grid.clearance_m(p.x_m, p.y_m) > 0.6;
            if room(&start) && room(&goal) {
                problems.push(Problem {
                    grid: grid.clone(),
                    start,
                    goal: Goal::pose(goal),
                });
                on_this_grid += 1;
            }
        }
    }
    problems
}

fn solve(problem: &Problem) -> Result<Path, PlanError> {
    plan(
        &problem.grid,
        &Vehicle::default(),
        problem.start,
        problem.goal,
        &PlanLimits::default(),
    )
}

#[expect(clippy::disallowed_methods, reason = "a bench measures the clock")]
fn timed(problem: &Problem) -> (Duration, Result<Path, PlanError>) {
    let begun = Instant::now();
    let path = black_box(solve(black_box(problem)));
    (begun.elapsed(), path)
}

fn report(name: &str, problems: &[Problem]) {
    let (mut times, mut solved, mut changes, mut length_m) = (Vec::new(), 0, 0, 0.0);
    for problem in problems {
        let (time, path) = timed(problem);
        times.push(time);
        if let Ok(path) = path {
            solved += 1;
            changes += path.gear_changes();
            length_m += path.length_m;
        }
    }
    times.sort_unstable();
    let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
    println!(
        "plan/{name}: {solved} of {} have a path, {length_m:.0} m with {changes} changes of gear; p50 {:.1?}, p99 {:.1?}, max {:.1?}",
        times.len(),
        at(0.5),
        at(0.99),
        at(1.0)
    );
}

/// A floor with noise of a voxel and boxes on it, as a map.
fn floor() -> VoxelMap {
    let mut random = Pcg64::seed_from_u64(SEED);
    let boxes = hall(&mut random);
    let mut map = VoxelMap::new(RESOLUTION_M);
    let occupied = Voxel::new(LogOdds::MAX);
    let keys = (0_i32..).flat_map(|y| (0..EDGE as u16).map(move |x| (i32::from(x), y)));
    for (cell, (x, y)) in boxes.iter().zip(keys) {
        let top = match cell {
            Cell::Blocked => 10,
            Cell::Unknown | Cell::Drivable { .. } => random.random_range(-1..=1),
        };
        for z in top.min(0)..=top {
            map.set_voxel(VoxelKey::new(x, y, z), occupied);
        }
    }
    map
}

fn benches(criterion: &mut Criterion) {
    for (name, make) in [
        ("hall", hall as fn(&mut Pcg64) -> Vec<Cell>),
        ("maze", maze),
    ] {
        let problems = problems(make);
        report(name, &problems);
        let mut next = problems.iter().cycle();
        criterion.bench_function(&format!("plan/{name}"), |bencher| {
            bencher.iter_batched(
                || next.next().expect("endless"),
                solve,
                BatchSize::SmallInput,
            );
        });
    }
    let (map, vehicle) = (floor(), Vehicle::default());
    criterion.bench_function("traversability/from_map", |bencher| {
        bencher.iter(|| Traversability::from_map(black_box(&map), &vehicle));
    });
}

criterion_group! {
    name = group;
    config = Criterion::default().sample_size(50);
    targets = benches
}
criterion_main!(group);
