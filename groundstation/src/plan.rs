//! Plans: paths over the map for ground vehicles, survey lines for aircraft, and both as mission items.
//!
//! Finding a path takes up to seconds, so it happens on a thread of its own, which is given a copy of the map; everything
//! else is done at once. A plan that cannot be made says why, with numbers.

pub mod items;
pub mod survey;

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{Builder, JoinHandle};

use egui::Color32;
use maps::frame::{Point, World};
use maps::plan::{Goal, Path, PlanLimits, Pose2};
use maps::traversability::{Cell, Traversability, Vehicle};
use maps::voxel::VoxelMap;
use mavlink_ext::SystemId;

use crate::render::{GroundCell, Overlay};

/// The path follower needs some lock left to correct with.
const TURNING_RESERVE: f64 = 1.1;
/// A path may end this far from where the operator clicked, if the vehicle cannot stand exactly there.
const GOAL_TOLERANCE_M: f64 = 0.15;
/// The overlay and paths are drawn this far above the ground, so that they are not hidden in it.
const ABOVE_GROUND_M: f64 = 0.03;

/// Work for the planner.
#[derive(Debug)]
pub enum Job {
    /// Find a path.
    Path(Box<PathJob>),
    /// Show where the vehicle can drive.
    Drivable(Box<DrivableJob>),
}

/// What the overlay of drivable ground is made of.
#[derive(Debug)]
pub struct DrivableJob {
    /// The map as it is.
    pub map: VoxelMap,
    /// The vehicle.
    pub ugv: Vehicle,
}

/// What a path is to be found for.
#[derive(Debug)]
pub struct PathJob {
    /// Counted by the station: the answer to an older question is thrown away.
    pub number: u64,
    /// Who shall drive it.
    pub vehicle: SystemId,
    /// The map as it is.
    pub map: VoxelMap,
    /// The vehicle.
    pub ugv: Vehicle,
    /// What the path must keep to.
    pub limits: PlanLimits,
    /// Where it stands.
    pub start: Pose2,
    /// East and north.
    pub goal_m: [f64; 2],
    /// Counter-clockwise from east; any, if none.
    pub goal_heading_rad: Option<f64>,
}

/// What the planner has found.
#[derive(Debug)]
pub enum Outcome {
    /// A path, or why there is none.
    Path {
        /// Of the job.
        number: u64,
        /// Who shall drive it.
        vehicle: SystemId,
        /// The path, and how it runs over the map.
        found: Result<FoundPath, String>,
        /// Which way it shall face at the end.
        goal_heading_rad: Option<f64>,
    },
    /// Where the vehicle can drive.
    Drivable(Arc<Overlay>),
}

/// A path and where it runs.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundPath {
    /// What is driven.
    pub path: Path,
    /// The same on the ground, a little above it.
    pub line: Vec<Point<World>>,
}

/// Does the work, however long it takes.
pub fn run(job: Job) -> Outcome {
    match job {
        Job::Path(job) => {
            let grid = Traversability::from_map(&job.map, &job.ugv);
            let found = find(&job, &grid);
            let PathJob {
                number,
                vehicle,
                goal_heading_rad,
                ..
            } = *job;
            Outcome::Path {
                number,
                vehicle,
                found,
                goal_heading_rad,
            }
        }
        Job::Drivable(job) => {
            let grid = Traversability::from_map(&job.map, &job.ugv);
            Outcome::Drivable(Arc::new(overlay(&grid)))
        }
    }
}

fn find(job: &PathJob, grid: &Traversability) -> Result<FoundPath, String> {
    let goal = Goal {
        x_m: job.goal_m[0],
        y_m: job.goal_m[1],
        heading_rad: job.goal_heading_rad,
        tolerance_m: GOAL_TOLERANCE_M,
    };
    let ugv = Vehicle {
        min_turning_radius_m: job.ugv.min_turning_radius_m * TURNING_RESERVE,
        ..job.ugv
    };
    let path = maps::plan::plan(grid, &ugv, job.start, goal, &job.limits)
        .map_err(|error| error.to_string())?;
    let on_ground = |pose: &Pose2| {
        let ground = grid
            .on_ground(pose.x_m, pose.y_m)
            .map_or(0.0, |point| point.raw.z);
        Point::new(pose.x_m, pose.y_m, ground + ABOVE_GROUND_M)
    };
    let line = path
        .waypoints
        .iter()
        .map(|waypoint| on_ground(&waypoint.pose))
        .collect();
    Ok(FoundPath { path, line })
}

/// Squares over the ground: bluish where it is easy to drive, brown where it is costly, dark where it is blocked.
fn overlay(grid: &Traversability) -> Overlay {
    let cells = grid.cells().filter_map(|(index, cell)| {
        let [x, y] = grid.center_of(index);
        let (height_m, color) = match cell {
            Cell::Unknown => return None,
            Cell::Drivable { height_m, cost } => (height_m, drivable_color(cost)),
            Cell::Blocked => (0.0, Color32::from_rgba_unmultiplied(0x18, 0x10, 0x28, 0x90)),
        };
        let color = color.to_srgba_unmultiplied();
        Some(GroundCell {
            center: Point::new(x, y, height_m + ABOVE_GROUND_M),
            color,
        })
    });
    Overlay {
        cell_m: grid.resolution_m(),
        cells: cells.collect(),
    }
}

fn drivable_color(cost: f64) -> Color32 {
    // In a few steps, so that rows of equal cells are drawn at once.
    let share = ((cost / (1.0 + cost)).clamp(0.0, 1.0) * 6.0).round() / 6.0;
    let mix = |easy: f64, hard: f64| (easy + (hard - easy) * share) as u8;
    Color32::from_rgba_unmultiplied(mix(80.0, 200.0), mix(150.0, 140.0), mix(255.0, 90.0), 0x60)
}

/// The planner's thread: takes one job at a time.
#[derive(Debug)]
pub struct Worker {
    jobs: Option<SyncSender<Job>>,
    outcomes: Receiver<Outcome>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread.
    pub fn start() -> std::io::Result<Self> {
        let (jobs, todo) = sync_channel::<Job>(2);
        let (done, outcomes) = sync_channel(4);
        let work = move || {
            for job in todo {
                // In rayon's pool the planner searches from both ends at once.
                let outcome = rayon::scope(|_| run(job));
                if done.send(outcome).is_err() {
                    return;
                }
            }
        };
        let thread = Builder::new().name("planner".to_owned()).spawn(work)?;
        Ok(Self {
            jobs: Some(jobs),
            outcomes,
            thread: Some(thread),
        })
    }

    /// Hands over a job; gives it back if the thread has enough to do.
    pub fn submit(&self, job: Job) -> Result<(), Job> {
        let Some(jobs) = &self.jobs else {
            return Err(job);
        };
        jobs.try_send(job).map_err(|error| match error {
            TrySendError::Full(job) | TrySendError::Disconnected(job) => job,
        })
    }

    /// What has been found since the last call.
    pub fn outcome(&self) -> Option<Outcome> {
        self.outcomes.try_recv().ok()
    }
}

impl Drop for Worker {
    /// Waits for the job under way, which is bounded.
    fn drop(&mut self) {
        self.jobs = None;
        while self.outcomes.try_recv().is_ok() {}
        if let Some(thread) = self.thread.take() {
            // A panic of the planner was printed when it happened.
            drop(thread.join());
        }
    }
}
