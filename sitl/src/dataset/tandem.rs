//! Our own layout: all that a network for both vehicles is trained on, with truth. `docs/dataset.md` tells each file.

use std::collections::BTreeMap;

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World as Ground};
use maps::time::Stamp;
use nalgebra::Isometry3;
use png::EncodingError;
use serde::Serialize;

use super::files::{self, File, Image, Png};
use super::grid::{self, BEV_CELL_M, BEV_CELLS, LAYERS, LOWEST_M};
use super::world::{Echo, Seen, Sweep, World, hits};
use crate::depth_camera::{OUTDOORS_M, d455, expose};
use crate::platform;
use crate::scene::{Class, Instance, RoadUser};
use crate::truth::{Sight, bev, sight};

/// The files of one frame, of which the name starts with `stem`.
pub(super) fn frame(world: &World<'_>, at: Stamp, stem: &str) -> Result<Vec<File>, EncodingError> {
    let moment = world.stage.at(at);
    let (lens, camera) = (platform::ugv_lens(), d455());
    let ugv = platform::ugv_views(&moment);
    let pose = platform::uav_camera(world.scene, at, world.seed);
    let uav = [(pose, moment.picture(&camera, pose))];
    let exposed = expose(&uav[0].1, &camera, OUTDOORS_M, world.seed);
    let echoes = world.sweep(at, Sweep::Turning);
    let users = world.road_users(at);
    let told = Told {
        ugv: sight(&moment, &lens, &ugv),
        uav: sight(&moment, &camera, &uav),
        points: hits(
            echoes.iter().map(|echo| (echo.point, echo.instance)),
            &world.world_from_lidar(at),
            &users,
        ),
    };
    let mut pictures = Vec::new();
    for ((_, picture), name) in ugv.iter().zip(platform::UGV_CAMERAS) {
        let name = format!("{stem}_ugv_{name}");
        pictures.push(Png {
            name: format!("{name}.png"),
            width: picture.width,
            image: Image::Rgb(&picture.rgb),
        });
        pictures.extend(masks(world, &name, &picture.instance, picture.width));
    }
    let name = format!("{stem}_uav");
    pictures.push(Png {
        name: format!("{name}.png"),
        width: exposed.width,
        image: Image::Rgb(&exposed.rgb),
    });
    pictures.push(Png {
        name: format!("{name}_depth.png"),
        width: exposed.width,
        image: Image::Grey16(exposed.depth_m.iter().map(|z| millimetres(*z)).collect()),
    });
    pictures.extend(masks(world, &name, &uav[0].1.instance, exposed.width));
    let body = world.ugv(at);
    let cells = bev(&world.rays, at, body, BEV_CELLS, BEV_CELL_M).classes;
    pictures.push(grey(format!("{stem}_bev.png"), &cells));
    let voxels = grid::voxels(&moment, &body.raw);
    pictures.push(grey(format!("{stem}_voxels.png"), &voxels));
    let mut files = files::encode(&pictures)?;
    files.push(cloud(format!("{stem}_lidar.bin"), &echoes));
    files.push(labels(format!("{stem}_lidar.label"), world, &echoes));
    let text = FrameText::new(world, at, (&lens, &ugv), (&camera, &uav[0]));
    files.push(
        text.with_objects(&users, &told)
            .file(format!("{stem}.json")),
    );
    Ok(files)
}

/// The instances and classes of a picture.
fn masks<'a>(world: &World<'_>, name: &str, instances: &[Instance], width: usize) -> [Png<'a>; 2] {
    let class = |instance: &Instance| world.scene.class_of(*instance) as u8;
    [
        Png {
            name: format!("{name}_instance.png"),
            width,
            image: Image::Grey16(instances.iter().map(|instance| instance.0).collect()),
        },
        Png {
            name: format!("{name}_class.png"),
            width,
            image: Image::Grey(instances.iter().map(class).collect()),
        },
    ]
}

fn grey<'a>(name: String, classes: &[Class]) -> Png<'a> {
    Png {
        name,
        width: BEV_CELLS,
        image: Image::Grey(classes.iter().map(|class| *class as u8).collect()),
    }
}

fn millimetres(depth_m: f32) -> u16 {
    (depth_m * 1000.0 + 0.5) as u16
}

/// Rows of six numbers in single precision: x, y, z, intensity, ring, time.
fn cloud(name: String, echoes: &[Echo]) -> File {
    let row = |echo: &Echo| {
        let [x, y, z] = echo.point;
        let (intensity, ring) = (f32::from(echo.intensity), f32::from(echo.ring));
        [x, y, z, intensity, ring, echo.time_s].map(f32::to_le_bytes)
    };
    let bytes = echoes.iter().flat_map(row).flatten().collect();
    File { name, bytes }
}

/// The class of each return, and its instance above it, as in `SemanticKITTI`.
fn labels(name: String, world: &World<'_>, echoes: &[Echo]) -> File {
    let label = |echo: &Echo| {
        let class = world.scene.class_of(echo.instance) as u32;
        (class | u32::from(echo.instance.0) << 16).to_le_bytes()
    };
    let bytes = echoes.iter().flat_map(label).collect();
    File { name, bytes }
}

/// What sensors see of road users.
struct Told {
    ugv: BTreeMap<Instance, Sight>,
    uav: BTreeMap<Instance, Sight>,
    points: BTreeMap<Instance, u32>,
}

/// A transform as rows of a 4 x 4 matrix.
type Rows = [[f64; 4]; 4];

fn rows(transform: &Isometry3<f64>) -> Rows {
    transform.to_homogeneous().transpose().into()
}

/// `NNNNNN.json`.
#[derive(Serialize)]
struct FrameText {
    time_s: f64,
    world_from_ugv: Rows,
    world_from_uav: Rows,
    world_from_lidar: Rows,
    cameras: Vec<CameraText>,
    bev: GridText,
    objects: Vec<ObjectText>,
}

#[derive(Serialize)]
struct CameraText {
    name: String,
    width: usize,
    height: usize,
    /// Rows of the matrix.
    intrinsic: [[f64; 3]; 3],
    world_from_camera: Rows,
}

/// The grids around the ground vehicle.
#[derive(Serialize)]
struct GridText {
    cells: usize,
    cell_m: f64,
    layers: usize,
    lowest_m: f64,
}

#[derive(Serialize)]
struct ObjectText {
    instance: u16,
    class: u8,
    centre_m: [f64; 3],
    /// Length, width, height.
    size_m: [f64; 3],
    heading_rad: f64,
    velocity_mps: [f64; 3],
    lidar_points: u32,
    ugv: Option<SightText>,
    uav: Option<SightText>,
}

#[derive(Serialize)]
struct SightText {
    visible_pixels: u32,
    alone_pixels: u32,
    occlusion: f64,
}

impl From<&Sight> for SightText {
    fn from(sight: &Sight) -> Self {
        Self {
            visible_pixels: sight.visible,
            alone_pixels: sight.alone,
            occlusion: sight.occlusion(),
        }
    }
}

impl FrameText {
    fn new(
        world: &World<'_>,
        at: Stamp,
        (lens, ugv): (&Pinhole, &[Seen]),
        (camera, uav): (&Pinhole, &Seen),
    ) -> Self {
        let names = platform::UGV_CAMERAS.map(|name| format!("ugv_{name}"));
        let ugv = ugv.iter().zip(names);
        let ugv = ugv.map(|((pose, _), name)| CameraText::new(name, lens, *pose));
        let uav = CameraText::new("uav".into(), camera, uav.0);
        Self {
            time_s: at.as_secs_f64(),
            world_from_ugv: rows(&world.ugv(at).raw),
            world_from_uav: rows(&platform::uav(world.scene, at, world.seed).raw),
            world_from_lidar: rows(&world.world_from_lidar(at)),
            cameras: ugv.chain([uav]).collect(),
            bev: GridText {
                cells: BEV_CELLS,
                cell_m: BEV_CELL_M,
                layers: LAYERS,
                lowest_m: LOWEST_M,
            },
            objects: Vec::new(),
        }
    }

    fn with_objects(self, users: &[RoadUser], told: &Told) -> Self {
        let objects = users.iter().map(|user| ObjectText::new(user, told));
        Self {
            objects: objects.collect(),
            ..self
        }
    }

    fn file(&self, name: String) -> File {
        let text = serde_json::to_string(self).expect("numbers and names have a JSON form");
        let bytes = (text + "\n").into_bytes();
        File { name, bytes }
    }
}

impl CameraText {
    fn new(name: String, lens: &Pinhole, pose: Isometry<Ground, Camera>) -> Self {
        Self {
            name,
            width: lens.width,
            height: lens.height,
            intrinsic: [
                [lens.fx, 0.0, lens.cx],
                [0.0, lens.fy, lens.cy],
                [0.0, 0.0, 1.0],
            ],
            world_from_camera: rows(&pose.raw),
        }
    }
}

impl ObjectText {
    fn new(user: &RoadUser, told: &Told) -> Self {
        let thing = &user.thing;
        let instance = &thing.instance;
        Self {
            instance: instance.0,
            class: thing.class as u8,
            centre_m: thing.centre().into(),
            size_m: thing.size.into(),
            heading_rad: thing.place.rotation.euler_angles().2,
            velocity_mps: user.velocity.into(),
            lidar_points: told.points.get(instance).copied().unwrap_or(0),
            ugv: told.ugv.get(instance).map(SightText::from),
            uav: told.uav.get(instance).map(SightText::from),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix4, Point3};
    use serde_json::Value;

    use super::*;
    use crate::scene::{Name, Scene};

    fn matrix(value: &Value) -> Matrix4<f64> {
        let rows: Rows = serde_json::from_value(value.clone()).expect("rows");
        Matrix4::from_row_slice(rows.as_flattened())
    }

    fn number(value: &Value) -> f64 {
        value.as_f64().expect("a number")
    }

    /// Two bytes a pixel.
    fn wide(bytes: &[u8]) -> Vec<u16> {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .expect("a picture");
        let mut pixels = vec![0; reader.output_buffer_size().expect("small")];
        reader.next_frame(&mut pixels).expect("pixels");
        let pairs = pixels.chunks_exact(2);
        pairs
            .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
            .collect()
    }

    #[test]
    fn poses_masks_points_and_objects_of_a_frame_agree() {
        let scene = Scene::generate(Name::UrbanArterial, 1003);
        let world = World::new(&scene, 1003);
        let files = frame(&world, Stamp::from_nanos(8_000_000_000), "000015").expect("pictures");
        let files: BTreeMap<_, _> = files
            .into_iter()
            .map(|file| (file.name, file.bytes))
            .collect();
        assert_eq!(files.len(), 21);
        let told: Value = serde_json::from_slice(&files["000015.json"]).expect("JSON");
        let objects = told["objects"].as_array().expect("objects");
        let mut seen = 0;
        for camera in told["cameras"].as_array().expect("cameras") {
            let name = camera["name"].as_str().expect("a name");
            let mask = wide(&files[&format!("000015_{name}_instance.png")]);
            let width = camera["width"].as_u64().expect("a width") as usize;
            let camera_from_world = matrix(&camera["world_from_camera"])
                .try_inverse()
                .expect("rigid");
            for object in objects
                .iter()
                .filter(|object| object["class"] == Class::Car as u8)
            {
                let sight = &object[&name[..3]];
                if sight.is_null()
                    || number(&sight["occlusion"]) > 0.02
                    || number(&sight["visible_pixels"]) < 200.0
                {
                    continue;
                }
                let centre: [f64; 3] =
                    serde_json::from_value(object["centre_m"].clone()).expect("three");
                let p = camera_from_world.transform_point(&Point3::from(centre));
                let k = |row: usize, column: usize| number(&camera["intrinsic"][row][column]);
                let (u, v) = (k(0, 0) * p.x / p.z + k(0, 2), k(1, 1) * p.y / p.z + k(1, 2));
                let height = mask.len() / width;
                if p.z > 0.0
                    && (0.0..width as f64 - 1.0).contains(&u)
                    && (0.0..height as f64 - 1.0).contains(&v)
                {
                    let pixel = v.round() as usize * width + u.round() as usize;
                    assert_eq!(
                        u64::from(mask[pixel]),
                        object["instance"].as_u64().expect("one"),
                        "{name}"
                    );
                    seen += 1;
                }
            }
        }
        assert!(seen > 0, "no car in clear sight");
        let points = files["000015_lidar.bin"].chunks_exact(24).count();
        let labels: Vec<u32> = files["000015_lidar.label"]
            .chunks_exact(4)
            .map(|label| u32::from_le_bytes(label.try_into().expect("four")))
            .collect();
        assert_eq!(labels.len(), points);
        for object in objects {
            let instance = object["instance"].as_u64().expect("one");
            let labelled = labels
                .iter()
                .filter(|label| u64::from(**label >> 16) == instance);
            let labelled: Vec<_> = labelled.collect();
            assert!(number(&object["lidar_points"]) <= labelled.len() as f64);
            assert!(
                labelled
                    .iter()
                    .all(|label| u64::from(**label & 0xffff)
                        == object["class"].as_u64().expect("one"))
            );
        }
        assert!(
            objects
                .iter()
                .any(|object| number(&object["lidar_points"]) > 100.0)
        );
    }
}
