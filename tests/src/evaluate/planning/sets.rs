//! The problems: maps, vehicles, starts and goals.

use std::f64::consts::PI;
use std::path::Path;

use anyhow::ensure;
use maps::plan::{PlanLimits, Pose2};
use maps::traversability::{Cell, Traversability, Vehicle};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::astar::Inflated;
use super::files::{Raster, Scenario, scenarios};
use super::{referee, site};

/// Name of the set of our own sites.
pub(super) const SITE: &str = "site";

/// From a pose to a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Problem {
    pub(super) start: Pose2,
    pub(super) goal: Pose2,
}

/// Problems on one map.
pub(super) struct Ground {
    pub(super) grid: Traversability,
    pub(super) problems: Vec<Problem>,
}

/// Problems that are judged together.
pub(super) struct Set {
    pub(super) name: &'static str,
    pub(super) robot: Robot,
    pub(super) grounds: Vec<Ground>,
}

/// A vehicle with what its paths must keep to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Robot {
    pub(super) vehicle: Vehicle,
    pub(super) limits: PlanLimits,
    /// Starts and goals are at least this far apart.
    pub(super) least_way_m: f64,
}

/// A car-like ground vehicle of 2.7 m × 1.6 m, as small utility vehicles are, that turns within 3 m.
pub(super) fn utility_vehicle() -> Robot {
    Robot {
        vehicle: Vehicle {
            length_m: 2.7,
            width_m: 1.6,
            height_m: 2.0,
            wheelbase_m: 1.8,
            min_turning_radius_m: 3.0,
            max_step_m: 0.15,
            max_slope_rad: 0.35,
        },
        limits: PlanLimits {
            clearance_m: 0.1,
            preferred_clearance_m: 0.8,
            gear_change_m: 2.0,
            waypoint_spacing_m: 0.5,
            ..PlanLimits::default()
        },
        least_way_m: 20.0,
    }
}

/// A robot of 0.9 m × 0.65 m for the narrower Nav2 maps, that turns within 0.8 m.
fn warehouse_robot() -> Robot {
    Robot {
        vehicle: Vehicle {
            length_m: 0.9,
            width_m: 0.65,
            height_m: 0.8,
            wheelbase_m: 0.6,
            min_turning_radius_m: 0.8,
            max_step_m: 0.05,
            max_slope_rad: 0.2,
        },
        limits: PlanLimits::default(),
        least_way_m: 8.0,
    }
}

/// A published map: its file, the edge of a character in metres, and into how many cells a side each is split.
struct Published {
    name: &'static str,
    file: &'static str,
    scenarios: Option<&'static str>,
    cell_m: f64,
    split: usize,
}

const MOVINGAI: [Published; 5] = [
    Published {
        name: "movingai-berlin",
        file: "Berlin_0_256.map",
        scenarios: Some("Berlin_0_256.map.scen"),
        cell_m: 0.4,
        split: 2,
    },
    Published {
        name: "movingai-boston",
        file: "Boston_2_512.map",
        scenarios: Some("Boston_2_512.map.scen"),
        cell_m: 0.2,
        split: 1,
    },
    Published {
        name: "movingai-den520d",
        file: "den520d.map",
        scenarios: None,
        cell_m: 0.4,
        split: 2,
    },
    Published {
        name: "movingai-maze",
        file: "maze-128-128-10.map",
        scenarios: None,
        cell_m: 0.8,
        split: 4,
    },
    Published {
        name: "movingai-random",
        file: "random-32-32-10.map",
        scenarios: Some("random-32-32-10-random-1.scen"),
        cell_m: 3.2,
        split: 16,
    },
];

/// File, name, and the coarsest cell that still is read from it.
const NAV2: [(&str, &str, f64); 3] = [
    ("100by100_10.yaml", "nav2-100by100", 0.2),
    ("depot.yaml", "nav2-depot", 0.06),
    ("warehouse.yaml", "nav2-warehouse", 0.06),
];

/// Every set that `data` has the files of, and ours; each with `count` problems at most.
pub(super) fn all(data: &Path, seed: u64, count: usize) -> anyhow::Result<Vec<Set>> {
    let mut sets = Vec::new();
    for published in &MOVINGAI {
        sets.push(movingai(
            &data.join("planning/movingai"),
            published,
            seed,
            count,
        )?);
    }
    for (file, name, cell_m) in NAV2 {
        let raster = Raster::nav2(&data.join("planning/nav2_maps").join(file))?;
        let fine_m = raster.cell_m.unwrap_or(cell_m);
        let by = (cell_m / fine_m + 1e-6).floor().max(1.0);
        let grid = raster.coarser(by as usize).grid(fine_m * by, 1)?;
        let robot = if cell_m < 0.1 {
            warehouse_robot()
        } else {
            utility_vehicle()
        };
        let problems = drawn(&grid, &robot, seed, count);
        sets.push(set(name, robot, vec![Ground { grid, problems }])?);
    }
    sets.push(sites(seed, count)?);
    Ok(sets)
}

/// Five sites of consecutive seeds.
fn sites(seed: u64, count: usize) -> anyhow::Result<Set> {
    const SITES: usize = 5;
    let robot = utility_vehicle();
    let grounds = (0..SITES as u64)
        .map(|i| {
            let grid = Traversability::from_map(&site::site(seed + i), &robot.vehicle);
            let problems = drawn(&grid, &robot, seed + i, count.div_ceil(SITES));
            Ground { grid, problems }
        })
        .collect();
    set(SITE, robot, grounds)
}

fn set(name: &'static str, robot: Robot, grounds: Vec<Ground>) -> anyhow::Result<Set> {
    let some = grounds.iter().any(|ground| !ground.problems.is_empty());
    ensure!(some, "{name}: no problem fits the vehicle");
    Ok(Set {
        name,
        robot,
        grounds,
    })
}

fn movingai(folder: &Path, from: &Published, seed: u64, count: usize) -> anyhow::Result<Set> {
    let robot = utility_vehicle();
    let raster = Raster::movingai(&folder.join(from.file))?;
    let rows = raster.rows();
    let grid = raster.grid(from.cell_m, from.split)?;
    let problems = match from.scenarios {
        None => drawn(&grid, &robot, seed, count),
        Some(file) => {
            let mut random = Pcg64::seed_from_u64(seed);
            let mut left = scenarios(&folder.join(file))?;
            let mut draw = Draw::new(&grid, &robot);
            let place = |[x, y]: [usize; 2]| {
                [x as f64 + 0.5, (rows - 1 - y) as f64 + 0.5].map(|cells| cells * from.cell_m)
            };
            let mut problems = Vec::new();
            while problems.len() < count && !left.is_empty() {
                let Scenario { start, goal } = left.swap_remove(random.random_range(0..left.len()));
                problems.extend(draw.between(&mut random, place(start), place(goal)));
            }
            problems
        }
    };
    set(from.name, robot, vec![Ground { grid, problems }])
}

/// Problems anywhere on a grid.
fn drawn(grid: &Traversability, robot: &Robot, seed: u64, count: usize) -> Vec<Problem> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut draw = Draw::new(grid, robot);
    let ([x, y], (width, height)) = (grid.origin_m(), grid.size());
    let (wide, high) = (
        width as f64 * grid.resolution_m(),
        height as f64 * grid.resolution_m(),
    );
    let mut problems = Vec::new();
    for _ in 0..100 * count {
        if problems.len() == count {
            break;
        }
        let mut place = || {
            [
                x + random.random_range(0.0..wide),
                y + random.random_range(0.0..high),
            ]
        };
        let (start, goal) = (place(), place());
        problems.extend(draw.between(&mut random, start, goal));
    }
    problems
}

/// Makes problems of places, and leaves out those that no vehicle as wide can solve.
struct Draw<'a> {
    grid: &'a Traversability,
    robot: &'a Robot,
    narrowest: Inflated<'a>,
}

impl<'a> Draw<'a> {
    fn new(grid: &'a Traversability, robot: &'a Robot) -> Self {
        Self {
            grid,
            robot,
            narrowest: Inflated::new(grid, 0.5 * robot.vehicle.width_m),
        }
    }

    /// A problem from one place to another, the headings drawn; none if a place is no place for the vehicle or there is
    /// no way for a disc as wide as it.
    fn between(&mut self, random: &mut Pcg64, start: [f64; 2], goal: [f64; 2]) -> Option<Problem> {
        let start = self.pose(random, start);
        let goal = self.pose(random, goal);
        let (start, goal) = (start?, goal?);
        let middle = |pose: &Pose2| super::middle(&self.robot.vehicle, pose);
        let far = start.distance_m(&goal) >= self.robot.least_way_m;
        let way = far
            && (self.narrowest)
                .plan(middle(&start), middle(&goal), 1.0)
                .is_some();
        way.then_some(Problem { start, goal })
    }

    /// The first of eight drawn headings with which the vehicle stands clear of everything.
    fn pose(&self, random: &mut Pcg64, [x, y]: [f64; 2]) -> Option<Pose2> {
        let poses: [Pose2; 8] =
            std::array::from_fn(|_| Pose2::new(x, y, random.random_range(-PI..PI)));
        poses.into_iter().find(|pose| {
            // With the pad of the planner's collision check and something to spare.
            let needed_m = self.robot.limits.clearance_m + self.grid.resolution_m();
            referee::stands_free(self.grid, &self.robot.vehicle, pose, needed_m)
                && matches!(self.grid.cell(x, y), Cell::Drivable { .. })
        })
    }
}
