//! OPV2V's layout, as `OpenCOOD` and what is built on it read it: `SPLIT/SCENARIO/AGENT/NNNNNN.{yaml,pcd}` and pictures.
//!
//! The ground vehicle is a connected vehicle, its id that of its boxes. The drone is agent -1: `OpenCOOD` never takes an
//! agent with a negative id, a roadside unit in `V2XSet`, for the one whose view counts. Its point cloud is that of its depth
//! camera, in the frame of a `LiDAR` that there is not: level, below the camera, as high as that of the ground vehicle,
//! so that one range of heights fits both.
//!
//! - R. Xu et al., *OPV2V*, ICRA 2022; *V2X-ViT* (`V2XSet`), ECCV 2022; *`CoBEVT`*, `CoRL` 2022 (pictures from above).
//! - `OpenCDA`, `opencda/core/common/data_dumper.py`: how each field was written.

mod carla;
mod masks;
mod text;

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::time::Duration;

use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Camera, Isometry, World as Ground};
use maps::time::Stamp;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use png::EncodingError;

use super::files::{self, File, Image, Png};
use super::world::{Seen, Sweep, World, hits};
use crate::depth_camera::{OUTDOORS_M, d455, expose};
use crate::platform;
use crate::render::{Moment, Picture};
use crate::scene::{Class, Instance, RoadUser};
use crate::truth::{Sight, sight};
use masks::Views;

pub(super) use text::protocol;

/// The drone's agent id.
const DRONE: i64 = -1;
/// [`platform::UGV_CAMERAS`] in OPV2V's order: front, right, left, back.
const ORDER: [usize; 4] = [0, 3, 1, 2];
/// How the drone's four cameras are turned from where its only real one looks, in the same order.
const TURNS_RAD: [f64; 4] = [0.0, -FRAC_PI_2, FRAC_PI_2, PI];
/// Of the drone's depth pictures, every second column and row.
const STEP: usize = 2;
/// The way ahead: one place each half second.
const AHEAD: [Duration; 6] = [
    Duration::from_millis(500),
    Duration::from_secs(1),
    Duration::from_millis(1500),
    Duration::from_secs(2),
    Duration::from_millis(2500),
    Duration::from_secs(3),
];

/// One agent at one moment.
struct Agent {
    id: i64,
    world_from_body: Isometry3<f64>,
    /// Where it is at [`AHEAD`].
    way: [Isometry3<f64>; AHEAD.len()],
    speed_mps: f64,
    world_from_lidar: Isometry3<f64>,
    cloud: Vec<([f32; 3], u8, Instance)>,
    lens: Pinhole,
    cameras: Vec<Seen>,
    sight: BTreeMap<Instance, Sight>,
}

/// The files of one frame, of which the names start with `stem`, in a folder of each agent.
pub(super) fn frame(world: &World<'_>, at: Stamp, stem: &str) -> Result<Vec<File>, EncodingError> {
    let moment = world.stage.at(at);
    let users = world.road_users(at);
    let agents = [ground_vehicle(world, &moment), drone(world, &moment)];
    let mut files = Vec::new();
    let mut pictures = Vec::new();
    for agent in &agents {
        let stem = format!("{}/{stem}", agent.id);
        let vehicles: Vec<RoadUser> = users
            .iter()
            .filter(|user| is_vehicle(user) && i64::from(user.thing.instance.0) != agent.id)
            .copied()
            .collect();
        let views = Views {
            vehicles: &vehicles,
            own: &agent.sight,
            all: [&agents[0].sight, &agents[1].sight],
        };
        pictures.extend(masks::masks(
            world.scene,
            &agent.world_from_body,
            &views,
            &stem,
        ));
        for (index, (_, picture)) in agent.cameras.iter().enumerate() {
            pictures.push(Png {
                name: format!("{stem}_camera{index}.png"),
                width: picture.width,
                image: Image::Rgb(&picture.rgb),
            });
        }
        let points = agent.cloud.iter();
        let points = points.map(|(point, intensity, _)| (mirrored(*point), *intensity));
        files.push(files::pcd(format!("{stem}.pcd"), points));
        files.push(File {
            name: format!("{stem}.yaml"),
            bytes: text::metadata(agent, &met(agent, &users), (at, world.seed)).into_bytes(),
        });
    }
    files.extend(files::encode(&pictures)?);
    Ok(files)
}

fn is_vehicle(user: &RoadUser) -> bool {
    use Class::{Bus, Car, Robot, Truck};
    matches!(user.thing.class, Car | Truck | Bus | Robot)
}

/// Those of whom the agent has at least one point in their box.
fn met(agent: &Agent, users: &[RoadUser]) -> Vec<RoadUser> {
    let points = agent
        .cloud
        .iter()
        .map(|(point, _, instance)| (*point, *instance));
    let hits = hits(points, &agent.world_from_lidar, users);
    let is_met = |user: &&RoadUser| {
        let instance = user.thing.instance;
        hits.contains_key(&instance) && i64::from(instance.0) != agent.id
    };
    users.iter().filter(is_met).copied().collect()
}

/// To CARLA's axes.
fn mirrored([x, y, z]: [f32; 3]) -> [f32; 3] {
    [x, -y, z]
}

fn ground_vehicle(world: &World<'_>, moment: &Moment<'_>) -> Agent {
    let at = moment.at();
    let lens = platform::ugv_lens();
    let mut views: Vec<_> = platform::ugv_views(moment).into_iter().map(Some).collect();
    let cameras: Vec<Seen> = ORDER
        .iter()
        .filter_map(|index| views[*index].take())
        .collect();
    let robot = world.robot(at);
    let echoes = world.sweep(at, Sweep::Frozen);
    let echoes = echoes.iter();
    Agent {
        id: robot.map_or(0, |robot| i64::from(robot.thing.instance.0)),
        world_from_body: world.ugv(at).raw,
        way: AHEAD.map(|later| world.ugv(at + later).raw),
        speed_mps: robot.map_or(0.0, |robot| robot.velocity.norm()),
        world_from_lidar: world.world_from_lidar(at),
        cloud: echoes
            .map(|echo| (echo.point, echo.intensity, echo.instance))
            .collect(),
        sight: sight(moment, &lens, &cameras),
        lens,
        cameras,
    }
}

fn drone(world: &World<'_>, moment: &Moment<'_>) -> Agent {
    let (scene, seed, at) = (world.scene, world.seed, moment.at());
    let lens = d455();
    let body = platform::uav(scene, at, seed);
    let front = platform::uav_camera(scene, at, seed);
    let mut cameras = Vec::new();
    for turn_rad in TURNS_RAD {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_rad);
        let pose = Isometry::claim(body.raw * turn * (body.inverse() * front).raw);
        cameras.push((pose, moment.picture(&lens, pose)));
    }
    let sight = sight(moment, &lens, &cameras);
    let below = below(world, front);
    let exposed = expose(&cameras[0].1, &lens, OUTDOORS_M, seed);
    let cloud = depth_points(
        &exposed,
        &cameras[0].1,
        &lens,
        &(below.inverse() * front.raw),
    );
    for (_, picture) in &mut cameras {
        picture.rgb = expose(picture, &lens, OUTDOORS_M, seed).rgb;
    }
    let shortly = Duration::from_millis(10);
    let later = platform::uav(scene, at + shortly, seed);
    Agent {
        id: DRONE,
        world_from_body: body.raw,
        way: AHEAD.map(|later| platform::uav(scene, at + later, seed).raw),
        speed_mps: (later.translation() - body.translation()).norm() / shortly.as_secs_f64(),
        world_from_lidar: below,
        cloud,
        lens,
        cameras,
        sight,
    }
}

/// Below the drone's camera, as high as the ground vehicle's `LiDAR`, level, turned as the camera looks.
fn below(world: &World<'_>, front: Isometry<Ground, Camera>) -> Isometry3<f64> {
    let place = front.raw.translation.vector;
    let ahead = front.raw * Vector3::z();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), ahead.y.atan2(ahead.x));
    let up = world.lidar.body_from_sensor.translation.vector.z;
    Isometry3::from_parts(Translation3::new(place.x, place.y, up), turn)
}

/// What a depth picture shows, in the frame of a `LiDAR`; its brightness instead of an intensity.
fn depth_points(
    exposed: &RgbdFrame,
    picture: &Picture,
    lens: &Pinhole,
    lidar_from_camera: &Isometry3<f64>,
) -> Vec<([f32; 3], u8, Instance)> {
    let mut points = Vec::new();
    for row in (0..lens.height).step_by(STEP) {
        for column in (0..lens.width).step_by(STEP) {
            let i = row * lens.width + column;
            let depth_m = f64::from(exposed.depth_m[i]);
            if depth_m > 0.0 {
                let point = lens.unproject([column as f64, row as f64], depth_m).raw;
                let point = (lidar_from_camera * point).coords.map(|c| c as f32).into();
                let [red, green, blue] = exposed.rgb[i].map(u32::from);
                let brightness = (299 * red + 587 * green + 114 * blue) / 1000;
                points.push((point, brightness as u8, picture.instance[i]));
            }
        }
    }
    points
}

#[cfg(test)]
mod tests;
