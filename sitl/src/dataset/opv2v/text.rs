//! The metadata, as YAML: block mappings of flow sequences, every number with a point, as `PyYAML` wants it.

use std::fmt::Write as _;

use maps::time::Stamp;
use nalgebra::{Isometry3, Matrix4};

use super::carla::{Pose, camera, mirrored, pose};
use super::{AHEAD, Agent, is_vehicle};
use crate::noise::{at_cell, mix, normal};
use crate::scene::{Class, RoadUser};

/// What a receiver errs by: the values of `OpenCOOD`'s `wild_setting`.
const ERROR_M: f64 = 0.2;
const ERROR_DEG: f64 = 0.2;

/// `NNNNNN.yaml` of an agent, with those whom it has met.
pub(super) fn metadata(agent: &Agent, met: &[RoadUser], (at, seed): (Stamp, u64)) -> String {
    let mut text = String::new();
    let lidar = agent.world_from_lidar;
    for (index, (pose_of_camera, _)) in agent.cameras.iter().enumerate() {
        let world_from_camera = camera(*pose_of_camera);
        let lens = &agent.lens;
        let intrinsic = [
            [lens.fx, 0.0, lens.cx],
            [0.0, lens.fy, lens.cy],
            [0.0, 0.0, 1.0],
        ];
        line(&mut text, &format!("camera{index}:"));
        line(
            &mut text,
            &format!("  cords: {}", list(&pose(&world_from_camera))),
        );
        let camera_from_lidar = mirrored(&(world_from_camera.inverse() * lidar));
        line(
            &mut text,
            &format!("  extrinsic: {}", table(&rows(&camera_from_lidar))),
        );
        line(
            &mut text,
            &format!("  intrinsic: {}", table(&intrinsic.map(Vec::from))),
        );
    }
    let true_pose = pose(&agent.world_from_body);
    line(
        &mut text,
        &format!("ego_speed: {}", number(agent.speed_mps * 3.6)),
    );
    line(&mut text, &format!("lidar_pose: {}", list(&pose(&lidar))));
    line(
        &mut text,
        &format!("plan_trajectory: {}", table(&way(agent))),
    );
    let predicted = predicted(true_pose, at, seed ^ agent.id.unsigned_abs());
    line(
        &mut text,
        &format!("predicted_ego_pos: {}", list(&predicted)),
    );
    line(&mut text, &format!("true_ego_pos: {}", list(&true_pose)));
    let of = |class: Class| move |user: &&RoadUser| user.thing.class == class;
    objects(
        &mut text,
        "vehicles",
        met.iter().filter(|user| is_vehicle(user)),
    );
    objects(&mut text, "cyclists", met.iter().filter(of(Class::Cyclist)));
    objects(
        &mut text,
        "pedestrians",
        met.iter().filter(of(Class::Pedestrian)),
    );
    text
}

/// `data_protocol.yaml`: where a scenario comes from.
pub(in crate::dataset) fn protocol(scene: &str, seed: u64, rate_hz: f64) -> String {
    let mut text = String::new();
    line(
        &mut text,
        &format!("generator: sitl {}", env!("CARGO_PKG_VERSION")),
    );
    line(&mut text, "world:");
    line(&mut text, &format!("  scene: {scene}"));
    line(&mut text, &format!("  seed: {seed}"));
    line(
        &mut text,
        &format!("  frame_interval: {}", number(1.0 / rate_hz)),
    );
    line(&mut text, "agents:");
    line(
        &mut text,
        "  ground_vehicle: the positive id, RS-LiDAR-32, four cameras",
    );
    line(
        &mut text,
        "  drone: id -1, the points of its depth camera, level, 1.2 m above the ground",
    );
    text
}

fn objects<'a>(text: &mut String, name: &str, users: impl Iterator<Item = &'a RoadUser>) {
    let mut users = users.peekable();
    if users.peek().is_none() {
        line(text, &format!("{name}: {{}}"));
        return;
    }
    line(text, &format!("{name}:"));
    for user in users {
        let thing = &user.thing;
        let [x, y, z, roll, yaw, pitch] = pose(&thing.place);
        let half = thing.size / 2.0;
        line(text, &format!("  {}:", thing.instance.0));
        line(text, &format!("    angle: {}", list(&[roll, yaw, pitch])));
        line(text, &format!("    center: {}", list(&[0.0, 0.0, half.z])));
        line(
            text,
            &format!("    extent: {}", list(&[half.x, half.y, half.z])),
        );
        line(text, &format!("    location: {}", list(&[x, y, z])));
        let speed_kmh = user.velocity.norm() * 3.6;
        line(text, &format!("    speed: {}", number(speed_kmh)));
    }
}

/// Where the agent goes, `[x, y, speed in km/h]`.
fn way(agent: &Agent) -> Vec<Vec<f64>> {
    let mut from: (Isometry3<f64>, f64) = (agent.world_from_body, 0.0);
    let mut way = Vec::new();
    for (place, later) in agent.way.iter().zip(AHEAD) {
        let later_s = later.as_secs_f64();
        let moved = place.translation.vector - from.0.translation.vector;
        let speed_kmh = moved.norm() / (later_s - from.1) * 3.6;
        let [x, y, ..] = pose(place);
        way.push(vec![x, y, speed_kmh]);
        from = (*place, later_s);
    }
    way
}

fn predicted(true_pose: Pose, at: Stamp, seed: u64) -> Pose {
    let seed = mix(at.as_nanos() as u32 ^ mix(seed as u32));
    let mut axis = 0;
    true_pose.map(|c| {
        let sigma = if axis < 3 { ERROR_M } else { ERROR_DEG };
        axis += 1;
        c + sigma * f64::from(normal(at_cell(axis, 7, seed)))
    })
}

fn rows(matrix: &Matrix4<f64>) -> Vec<Vec<f64>> {
    let row = |i: usize| matrix.row(i).iter().copied().collect();
    (0..4).map(row).collect()
}

fn line(text: &mut String, line: &str) {
    // Writing to a string cannot fail.
    let _written = writeln!(text, "{line}");
}

fn number(value: f64) -> String {
    format!("{value:.6}")
}

fn list(values: &[f64]) -> String {
    let values: Vec<_> = values.iter().map(|value| number(*value)).collect();
    format!("[{}]", values.join(", "))
}

fn table(rows: &[Vec<f64>]) -> String {
    let rows: Vec<_> = rows.iter().map(|row| list(row)).collect();
    format!("[{}]", rows.join(", "))
}
