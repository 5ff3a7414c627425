//! What is written, read as a reader of OPV2V reads it, lies where the truth is.

use std::cell::Cell;
use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix4, Point3};

use super::carla::Pose;
use super::carla::tests::matrix;
use super::*;
use crate::scene::{Name, Scene};

/// The values of a file by their keys, `vehicles/3/angle`; flow sequences of YAML are JSON.
fn read(text: &[u8]) -> BTreeMap<String, serde_json::Value> {
    let mut path: Vec<String> = Vec::new();
    let mut values = BTreeMap::new();
    for line in String::from_utf8_lossy(text).lines() {
        let indent = line.len() - line.trim_start().len();
        let (key, value) = line.trim().split_once(':').expect("a key");
        path.truncate(indent / 2);
        path.push(key.to_owned());
        if !value.is_empty() {
            let value = serde_json::from_str(value.trim()).expect("JSON");
            values.insert(path.join("/"), value);
        }
    }
    values
}

fn numbers<const N: usize>(value: &serde_json::Value) -> [f64; N] {
    let numbers: Vec<f64> = serde_json::from_value(value.clone()).expect("numbers");
    numbers.try_into().expect("so many")
}

fn rows(value: &serde_json::Value) -> Vec<f64> {
    let rows: Vec<Vec<f64>> = serde_json::from_value(value.clone()).expect("rows");
    rows.concat()
}

fn points(pcd: &[u8]) -> Vec<Point3<f64>> {
    let start = b"DATA binary\n";
    let header = pcd.windows(start.len()).position(|at| at == start);
    let data = &pcd[header.expect("a header") + start.len()..];
    let float = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().expect("four")));
    let rows = data.chunks_exact(16);
    rows.map(|row| Point3::new(float(&row[..4]), float(&row[4..8]), float(&row[8..12])))
        .collect()
}

/// Ids of `vehicles` with the transform of each box's middle into CARLA's world, and its half sizes.
fn vehicles(
    values: &BTreeMap<String, serde_json::Value>,
) -> BTreeMap<u16, (Matrix4<f64>, [f64; 3])> {
    let mut found = BTreeMap::new();
    for key in values.keys() {
        let Some(id) = key
            .strip_prefix("vehicles/")
            .and_then(|key| key.strip_suffix("/angle"))
        else {
            continue;
        };
        let of = |what: &str| numbers::<3>(&values[&format!("vehicles/{id}/{what}")]);
        let ([x, y, z], [a, b, c], [roll, yaw, pitch]) =
            (of("location"), of("center"), of("angle"));
        let world_from_box = matrix([x + a, y + b, z + c, roll, yaw, pitch]);
        found.insert(id.parse().expect("an id"), (world_from_box, of("extent")));
    }
    found
}

fn pose_of(value: &serde_json::Value) -> Pose {
    numbers(value)
}

struct Written {
    files: BTreeMap<String, Vec<u8>>,
    robot: u16,
}

impl Written {
    fn new(world: &World<'_>, at: Stamp) -> Self {
        let files = frame(world, at, "000007").expect("pictures");
        Self {
            files: files
                .into_iter()
                .map(|file| (file.name, file.bytes))
                .collect(),
            robot: world.robot(at).expect("there").thing.instance.0,
        }
    }

    fn agents(&self) -> [String; 2] {
        [self.robot.to_string(), "-1".to_owned()]
    }

    fn values(&self, agent: &str) -> BTreeMap<String, serde_json::Value> {
        read(&self.files[&format!("{agent}/000007.yaml")])
    }
}

fn each_world(check: impl Fn(&World<'_>, Stamp)) {
    for (name, seconds) in [(Name::UrbanArterial, 1), (Name::SuburbanRoad, 21)] {
        let scene = Scene::generate(name, 1000);
        check(
            &World::new(&scene, 1000),
            Stamp::from_nanos(seconds * 1_000_000_000),
        );
    }
}

#[test]
fn points_in_the_box_of_a_vehicle_are_those_that_truth_has_there() {
    each_world(|world, at| {
        let written = Written::new(world, at);
        let users = world.road_users(at);
        let mut listed = 0;
        for agent in written.agents() {
            let values = written.values(&agent);
            let world_from_lidar = matrix(pose_of(&values["lidar_pose"]));
            let points = points(&written.files[&format!("{agent}/000007.pcd")]);
            for (id, (world_from_box, extent)) in vehicles(&values) {
                let user = users.iter().find(|user| user.thing.instance.0 == id);
                let user = user.expect("a vehicle of the truth");
                let box_from_lidar =
                    world_from_box.try_inverse().expect("rigid") * world_from_lidar;
                let (mut inside, mut true_inside) = (0, 0);
                for point in &points {
                    let local = box_from_lidar.transform_point(point);
                    inside += usize::from((0..3).all(|i| local[i].abs() <= extent[i]));
                    let theirs = world_from_lidar.transform_point(point);
                    let ours = Point3::new(theirs.x, -theirs.y, theirs.z);
                    true_inside += usize::from(super::super::world::is_within(user, ours));
                }
                assert!(inside > 0, "vehicle {id} of agent {agent} has no point");
                // Numbers are rounded to micrometres and angles to millionths of a degree.
                assert!(
                    inside.abs_diff(true_inside) <= 2 + inside / 500,
                    "{inside}, {true_inside}"
                );
                listed += 1;
            }
        }
        assert!(listed >= 3, "{listed} vehicles");
    });
}

#[test]
fn extrinsics_and_intrinsics_take_the_middle_of_a_car_to_where_the_camera_shows_it() {
    let seen = Cell::new(0);
    each_world(|world, at| {
        let written = Written::new(world, at);
        let moment = world.stage.at(at);
        let agents = [ground_vehicle(world, &moment), drone(world, &moment)];
        for (agent, name) in agents.iter().zip(written.agents()) {
            let values = written.values(&name);
            let lidar_from_world = matrix(pose_of(&values["lidar_pose"]))
                .try_inverse()
                .expect("rigid");
            for (id, (world_from_box, _)) in vehicles(&values) {
                let instance = Instance(id);
                let sight = agent.sight.get(&instance).copied().unwrap_or_default();
                let is_clear = sight.visible >= 200 && sight.occlusion() < 0.02;
                if !is_clear || world.scene.class_of(instance) != Class::Car {
                    continue;
                }
                let middle = (lidar_from_world * world_from_box).transform_point(&Point3::origin());
                for (index, (_, picture)) in agent.cameras.iter().enumerate() {
                    let of = |what: &str| &values[&format!("camera{index}/{what}")];
                    let extrinsic = Matrix4::from_row_slice(&rows(of("extrinsic")));
                    let intrinsic = Matrix3::from_row_slice(&rows(of("intrinsic")));
                    let p = extrinsic.transform_point(&middle);
                    let pixel = intrinsic * nalgebra::Vector3::new(p.y, -p.z, p.x);
                    let [u, v] = [pixel.x / pixel.z, pixel.y / pixel.z].map(f64::round);
                    let is_inside = pixel.z > 0.0
                        && (0.0..picture.width as f64).contains(&u)
                        && (0.0..picture.height as f64).contains(&v);
                    if is_inside {
                        let shown = picture.instance[v as usize * picture.width + u as usize];
                        assert_eq!(shown, instance, "camera {index} of agent {name}");
                        seen.set(seen.get() + 1);
                    }
                }
            }
        }
    });
    assert!(seen.get() >= 2, "{} cars are in clear sight", seen.get());
}

#[test]
fn the_cloud_of_the_drone_has_the_road_where_that_of_a_lidar_on_the_ground_has_it() {
    each_world(|world, at| {
        let moment = world.stage.at(at);
        let drone = drone(world, &moment);
        let road = drone.cloud.iter();
        let road = road.filter(|(_, _, instance)| world.scene.class_of(*instance) == Class::Road);
        let mut heights: Vec<f32> = road.map(|(point, ..)| point[2]).collect();
        heights.sort_by(f32::total_cmp);
        assert!(heights.len() > 10_000, "{} points", heights.len());
        let middle = heights[heights.len() / 2];
        // Noise of stereo depth is skewed by a few centimetres at this range.
        assert!((middle + 1.2).abs() < 0.05, "{middle}");
    });
}

#[test]
fn an_agent_lists_neither_itself_nor_what_it_has_no_point_of() {
    each_world(|world, at| {
        let written = Written::new(world, at);
        let values = written.values(&written.robot.to_string());
        assert!(!vehicles(&values).contains_key(&written.robot));
        let cars = world.road_users(at).into_iter().filter(is_vehicle).count();
        assert!(vehicles(&values).len() < cars, "some are hidden or far");
    });
}

#[test]
fn pictures_from_above_have_each_vehicle_ahead_above_the_middle() {
    let scene = Scene::generate(Name::UrbanArterial, 1000);
    let world = World::new(&scene, 1000);
    let at = Stamp::from_nanos(9_000_000_000);
    let body_from_world = world.ugv(at).raw.inverse();
    let users: Vec<_> = world
        .road_users(at)
        .into_iter()
        .filter(is_vehicle)
        .collect();
    let nobody = BTreeMap::new();
    let views = Views {
        vehicles: &users,
        own: &nobody,
        all: [&nobody, &nobody],
    };
    let pictures = masks::masks(&scene, &world.ugv(at).raw, &views, "s");
    let pixels = |name: &str| {
        let picture = pictures.iter().find(|picture| picture.name == name);
        match &picture.expect("a picture").image {
            Image::Grey(pixels) => pixels.clone(),
            _ => panic!("grey"),
        }
    };
    let (dynamic, road) = (pixels("s_bev_dynamic.png"), pixels("s_bev_static.png"));
    let mut seen = 0;
    for user in &users {
        let p = body_from_world * user.thing.centre();
        let (row, column) = (128.0 - p.x * 2.56, 128.0 - p.y * 2.56);
        if (0.0..256.0).contains(&row) && (0.0..256.0).contains(&column) {
            assert_eq!(
                dynamic[row as usize * 256 + column as usize],
                255,
                "{user:?}"
            );
            seen += 1;
        }
    }
    assert!(seen > 3, "{seen} vehicles");
    assert_eq!(road[128 * 256 + 128], 255, "we stand on the road");
    assert!(
        pixels("s_bev_visibility.png")
            .iter()
            .all(|pixel| *pixel == 0),
        "nobody is seen"
    );
}
