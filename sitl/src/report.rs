//! What is written at the end of a run, from the truth that only a simulator knows.

use mavlink_ext::dialect::cmd;
use serde::Serialize;

use crate::autopilot::Autopilot;
use crate::record::Recording;
use crate::simulation::{COPTER, ROVER, Simulation};

/// A run in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Name of the scene.
    pub scene: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Simulated time of the vehicles.
    pub simulated_s: f64,
    /// The recording, if one was asked for.
    pub recording: Option<Recording>,
    /// The copter, if there is one.
    pub copter: Option<VehicleReport>,
    /// The rover, if there is one.
    pub rover: Option<VehicleReport>,
}

/// A vehicle at the end of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VehicleReport {
    /// Its mode, as operators know it.
    pub mode: String,
    /// Whether its motors may run.
    pub armed: bool,
    /// Where it truly is: east, north, up.
    pub true_position_m: [f64; 3],
    /// Where it truly heads, clockwise from north, 0 to 360.
    pub true_heading_deg: f64,
    /// Where it thinks it is.
    pub estimated_position_m: [f64; 3],
    /// Items of its mission.
    pub mission_items: usize,
    /// Numbers of those that it reached.
    pub mission_items_reached: Vec<usize>,
    /// Whether it did the mission to its end.
    pub mission_completed: bool,
    /// Whether it did the mission to its end and was at every waypoint of it: of a copter, that the survey was flown.
    pub survey_completed: bool,
    /// The last waypoint of its mission.
    pub last_target_m: Option<[f64; 3]>,
    /// How far from it the vehicle truly is, over ground.
    pub final_error_m: Option<f64>,
    /// What is left of its battery, 0 to 1.
    pub battery_share: f64,
    /// ODOMETRY messages it took from its companion.
    pub odometry_accepted: u64,
    /// Those it did not take: other frames, or not finite.
    pub odometry_refused: u64,
    /// Quality of the last one, -1..=100.
    pub odometry_quality: Option<i8>,
}

impl Report {
    /// The figures of a simulation as it is now.
    pub fn new(
        scene: &str,
        seed: u64,
        simulation: &Simulation,
        recording: Option<Recording>,
    ) -> Self {
        let of = |address| {
            let mut vehicles = simulation.vehicles();
            vehicles
                .find(|autopilot| autopilot.address() == address)
                .map(VehicleReport::new)
        };
        Self {
            scene: scene.to_owned(),
            seed,
            simulated_s: simulation.now().as_secs_f64(),
            recording,
            copter: of(COPTER),
            rover: of(ROVER),
        }
    }
}

impl VehicleReport {
    /// The figures of a vehicle as it is now.
    pub fn new(autopilot: &Autopilot) -> Self {
        let truth = autopilot.truth();
        let here = truth.position().raw;
        let target = autopilot.last_mission_target().map(|target| target.raw);
        let execution = autopilot.execution();
        let items = autopilot.mission_items();
        let waypoints = items
            .iter()
            .enumerate()
            .skip(autopilot.first_item())
            .filter(|(_, item)| item.command == cmd::NAV_WAYPOINT);
        let mut indices = waypoints.map(|(index, _)| index);
        let everywhere = indices.all(|index| execution.reached().contains(&index));
        Self {
            mode: autopilot.mode().to_string(),
            armed: autopilot.is_armed(),
            true_position_m: here.coords.into(),
            true_heading_deg: (90.0 - truth.heading_rad().to_degrees()).rem_euclid(360.0),
            estimated_position_m: autopilot.estimate().position().raw.coords.into(),
            mission_items: items.len(),
            mission_items_reached: execution.reached().iter().copied().collect(),
            mission_completed: execution.is_complete(),
            survey_completed: execution.is_complete() && everywhere,
            last_target_m: target.map(|target| target.coords.into()),
            final_error_m: target.map(|target| (target.xy() - here.xy()).norm()),
            battery_share: autopilot.battery_share(),
            odometry_accepted: autopilot.odometry().accepted,
            odometry_refused: autopilot.odometry().refused,
            odometry_quality: autopilot.odometry().last_quality,
        }
    }
}
