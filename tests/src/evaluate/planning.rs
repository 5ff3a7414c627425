//! Path planning against the usual way of doing it.
//!
//! On maps of the `MovingAI` benchmark, on maps that ship with Nav2 and on sites made of voxels from a seed, every problem is
//! solved by ours and by A\* over the cells with smoothing ([`astar`]), inflated by the circle around the footprint
//! (`astar`) and by the circle within it (`astar-inscribed`). Problems that no disc as wide as the vehicle can solve are
//! left out. A path is judged from its waypoints by a referee of its own ([`referee`]):
//!
//! - `success`: share of problems with a path whose footprint touches nothing at any waypoint,
//! - `length_ratio`: mean length over the length of the shortest of all paths found for the same problem that touch nothing,
//!   whether or not a vehicle can steer them,
//! - `min_clearance_m`: least distance between footprint and obstacle on any path, at most 3 m,
//! - `curvature_violations`: waypoints at which a path is tighter than the vehicle turns,
//! - `p50_ms`, `p99_ms`: what the clock on the wall says of one call in a pool of two threads, the median of three; failures
//!   count. Ours uses the second thread where a path is hard to find, the baseline never.
//!
//! On the sites, something new is then put into the middle of each path: `site-change` compares the repair of the path with
//! planning `anew`.
//!
//! The baseline knows no heading and is not asked for one: it begins and ends with its circle at the middle of the footprint.

mod astar;
mod change;
mod files;
mod referee;
mod sets;
mod site;

use std::time::{Duration, Instant};

use anyhow::Context as _;
use maps::plan::{Gear, Goal, Pose2};
use maps::traversability::{Traversability, Vehicle};

use super::{Figures, Outcome, Request, Table};
use referee::{Stop, Verdict};
use sets::{Problem, Robot, Set};

/// Problems of a set, so that its 99th percentile is not its maximum.
const PROBLEMS: usize = 120;
/// Threads that a planner may use.
const THREADS: usize = 2;
/// Of the problems that the figures are quoted for; the planner was tuned on others.
const SEED: u64 = 470;

/// Runs every set of the folder of recordings.
pub(super) fn run(request: &mut Request<'_>) -> anyhow::Result<Outcome> {
    let data = (request.data).context(
        "the maps are not part of the program: name the folder of recordings with --data",
    )?;
    let seed = request.seed.unwrap_or(SEED);
    let mut report = Report::new();
    let pool = (rayon::ThreadPoolBuilder::new().num_threads(THREADS).build())
        .context("no threads to plan with")?;
    for set in sets::all(data, seed, PROBLEMS)? {
        let attempts = pool.install(|| compare(&set));
        report.add(set.name, &METHODS, &attempts)?;
        (request.say)(&format!("{}: {} problems", set.name, attempts.len()));
        if set.name == sets::SITE {
            let changed = pool.install(|| change::compare(&set));
            report.add("site-change", &["tandem", "anew"], &changed)?;
        }
    }
    Ok(Outcome {
        figures: report.figures,
        text: report.table.to_string(),
    })
}

/// What was measured, for programs and for people.
struct Report {
    figures: Figures,
    table: Table,
}

impl Report {
    fn new() -> Self {
        let header = ["", "problems"].into_iter().chain(METRICS);
        Self {
            figures: Figures::default(),
            table: Table {
                title: "Paths, and what they cost".to_owned(),
                header: header.map(str::to_owned).collect(),
                rows: Vec::new(),
            },
        }
    }

    fn add<const N: usize>(
        &mut self,
        case: &str,
        methods: &[&str; N],
        attempts: &[[Attempt; N]],
    ) -> anyhow::Result<()> {
        for (i, method) in methods.iter().enumerate() {
            let mut row = vec![format!("{case} {method}"), attempts.len().to_string()];
            for (metric, value) in METRICS.into_iter().zip(metrics(attempts, i)) {
                row.push(format!("{value:.3}"));
                // Of no success there is no length.
                if value.is_finite() {
                    self.figures.set(&[case, method, metric], value)?;
                }
            }
            self.table.rows.push(row);
        }
        Ok(())
    }
}

/// The middle of the footprint, (x, y).
fn middle(vehicle: &Vehicle, pose: &Pose2) -> [f64; 2] {
    let (sin, cos) = pose.heading_rad.sin_cos();
    let ahead = 0.5 * vehicle.wheelbase_m;
    [pose.x_m + ahead * cos, pose.y_m + ahead * sin]
}

/// One method on one problem.
struct Attempt {
    verdict: Option<Verdict>,
    took: Duration,
}

impl Attempt {
    /// A path that touches nothing.
    fn is_success(&self) -> bool {
        self.length_m().is_finite()
    }

    fn length_m(&self) -> f64 {
        (self.verdict.as_ref())
            .filter(|verdict| verdict.clearance_m > 0.0 && verdict.over_unknown == 0)
            .map_or(f64::INFINITY, |verdict| verdict.length_m)
    }
}

const METHODS: [&str; 3] = ["tandem", "astar", "astar-inscribed"];

const METRICS: [&str; 6] = [
    "success",
    "length_ratio",
    "min_clearance_m",
    "curvature_violations",
    "p50_ms",
    "p99_ms",
];

/// Every method on every problem.
fn compare(set: &Set) -> Vec<[Attempt; 3]> {
    let Vehicle {
        length_m, width_m, ..
    } = set.robot.vehicle;
    let mut attempts = Vec::new();
    for ground in &set.grounds {
        let around = astar::Inflated::new(&ground.grid, 0.5 * length_m.hypot(width_m));
        let within = astar::Inflated::new(&ground.grid, 0.5 * width_m);
        for problem in &ground.problems {
            attempts.push([
                ours(&ground.grid, &set.robot, problem),
                baseline(&ground.grid, &around, &set.robot, problem),
                baseline(&ground.grid, &within, &set.robot, problem),
            ]);
        }
    }
    attempts
}

fn metrics<const N: usize>(attempts: &[[Attempt; N]], method: usize) -> [f64; 6] {
    let count = attempts.len() as f64;
    let (mut successes, mut ratio) = (0.0, 0.0);
    let (mut clearance_m, mut violations) = (referee::FAR_M, 0);
    let mut times: Vec<Duration> = Vec::new();
    for problem in attempts {
        let attempt = &problem[method];
        times.push(attempt.took);
        if let Some(verdict) = &attempt.verdict {
            clearance_m = clearance_m.min(verdict.clearance_m);
            violations += verdict.curvature_violations;
        }
        if attempt.is_success() {
            let shortest = problem
                .iter()
                .map(Attempt::length_m)
                .fold(f64::INFINITY, f64::min);
            successes += 1.0;
            ratio += attempt.length_m() / shortest;
        }
    }
    times.sort_unstable();
    let at = |share: f64| {
        let index = ((times.len() - 1) as f64 * share).ceil() as usize;
        times[index].as_secs_f64() * 1e3
    };
    [
        successes / count,
        ratio / successes,
        clearance_m,
        violations as f64,
        at(0.5),
        at(0.99),
    ]
}

fn ours(grid: &Traversability, robot: &Robot, problem: &Problem) -> Attempt {
    let (took, found) = timed(|| {
        let goal = Goal::pose(problem.goal);
        maps::plan::plan(grid, &robot.vehicle, problem.start, goal, &robot.limits)
    });
    let judged = |path: maps::plan::Path| {
        let stops: Vec<Stop> = path.waypoints.iter().map(|w| (w.pose, w.gear)).collect();
        referee::judge(grid, &robot.vehicle, &stops)
    };
    Attempt {
        verdict: found.ok().map(judged),
        took,
    }
}

fn baseline(
    grid: &Traversability,
    inflated: &astar::Inflated<'_>,
    robot: &Robot,
    problem: &Problem,
) -> Attempt {
    let vehicle = &robot.vehicle;
    let (start, goal) = (
        middle(vehicle, &problem.start),
        middle(vehicle, &problem.goal),
    );
    let (took, found) = timed(|| inflated.plan(start, goal, robot.limits.waypoint_spacing_m));
    // The way is that of the footprint's middle, so the vehicle is judged as if that were its reference point.
    let centred = Vehicle {
        wheelbase_m: 0.0,
        ..*vehicle
    };
    let judged = |points: Vec<[f64; 2]>| {
        let poses = astar::poses(&points).into_iter();
        let stops: Vec<Stop> = poses.map(|pose| (pose, Gear::Forward)).collect();
        referee::judge(grid, &centred, &stops)
    };
    Attempt {
        verdict: found.map(judged),
        took,
    }
}

/// The median of three runs and the result of the last.
#[expect(
    clippy::disallowed_methods,
    reason = "a benchmark reads the clock on the wall"
)]
fn timed<T>(mut run: impl FnMut() -> T) -> (Duration, T) {
    let mut once = || {
        let begun = Instant::now();
        let result = run();
        (begun.elapsed(), result)
    };
    let [(a, _), (b, _), (c, result)] = [once(), once(), once()];
    (a.max(b).min(a.min(b).max(c)), result)
}
