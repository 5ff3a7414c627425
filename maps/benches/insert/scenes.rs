//! What is inserted: real sweeps and images if they are there, and seeded synthetic ones.
//!
//! All coordinates are rounded to `f32`, so that liboctomap, which keeps them so, gets the very same points.

use std::fs;
use std::path::{Path, PathBuf};

use maps::camera::Pinhole;
use maps::frame::{Point, World};
use nalgebra::{Matrix4, Point3, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

const SEED: u64 = 20_260_621;

/// The points of one moment, as each library wants them.
pub(crate) struct Sweep {
    pub(crate) origin: Point<World>,
    pub(crate) points: Vec<Point<World>>,
    pub(crate) floats: Vec<f32>,
}

impl Sweep {
    fn new(origin: Point3<f64>, points: impl Iterator<Item = Point3<f64>>) -> Self {
        let round = |p: Point3<f64>| p.map(|c| f64::from(c as f32));
        let points: Vec<_> = points.map(|p| Point::from_raw(round(p))).collect();
        let floats = points
            .iter()
            .flat_map(|p| [p.raw.x as f32, p.raw.y as f32, p.raw.z as f32])
            .collect();
        Self {
            origin: Point::from_raw(round(origin)),
            points,
            floats,
        }
    }

    pub(crate) fn origin_f32(&self) -> [f32; 3] {
        let p = self.origin.raw;
        [p.x as f32, p.y as f32, p.z as f32]
    }
}

/// Sweeps that make one map.
pub(crate) struct Scene {
    pub(crate) name: &'static str,
    pub(crate) max_range_m: f64,
    pub(crate) sweeps: Vec<Sweep>,
}

impl Scene {
    pub(crate) const NAMES: [&'static str; 4] = ["kitti", "street", "uav", "rgbd"];

    /// The scene of this name; `None` if its recording is not there.
    pub(crate) fn load(name: &str, data: &Path, sweeps: usize) -> Option<Self> {
        let (name, max_range_m, all) = match name {
            "kitti" => (
                "kitti",
                30.0,
                kitti(&data.join("lidar/kitti_0926"), sweeps)?,
            ),
            "rgbd" => (
                "rgbd",
                30.0,
                rgbd(&data.join("rgbd/sevenscenes_a"), sweeps)?,
            ),
            "street" => ("street", 30.0, street(sweeps)),
            _ => ("uav", 30.0, uav(2 * sweeps)),
        };
        Some(Self {
            name,
            max_range_m,
            sweeps: all,
        })
    }

    pub(crate) fn points(&self) -> usize {
        self.sweeps.iter().map(|sweep| sweep.points.len()).sum()
    }
}

/// Where the recordings are unless told otherwise: beside the repository.
pub(crate) fn default_data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data")
}

/// Velodyne sweeps of KITTI, each placed by its pose.
fn kitti(folder: &Path, sweeps: usize) -> Option<Vec<Sweep>> {
    let poses: Vec<Matrix4<f64>> = fs::read_to_string(folder.join("poses.txt"))
        .ok()?
        .lines()
        .map(|line| matrix(line.split_whitespace()))
        .collect();
    let mut files: Vec<_> = fs::read_dir(folder)
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "bin"))
        .collect();
    files.sort();
    let placed = files.iter().zip(&poses).take(sweeps);
    placed
        .map(|(file, pose)| {
            let bytes = fs::read(file).ok()?;
            let float = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            let points = bytes
                .chunks_exact(16)
                .map(|b| Point3::new(float(b), float(&b[4..]), float(&b[8..])));
            let origin = pose.transform_point(&Point3::origin());
            Some(Sweep::new(origin, points.map(|p| pose.transform_point(&p))))
        })
        .collect()
}

/// Kinect depth images of 7-Scenes, each placed by its pose.
fn rgbd(folder: &Path, images: usize) -> Option<Vec<Sweep>> {
    let camera = Pinhole {
        width: 640,
        height: 480,
        fx: 585.0,
        fy: 585.0,
        cx: 320.0,
        cy: 240.0,
        distortion: [0.0; 5],
    };
    (0..images)
        .map(|i| {
            let frame = folder.join(format!("frame-{:06}", 8 * i));
            let pose = fs::read_to_string(frame.with_extension("pose.txt")).ok()?;
            let pose = matrix(pose.split_whitespace());
            let file = fs::File::open(frame.with_extension("depth.png")).ok()?;
            let mut reader = png::Decoder::new(std::io::BufReader::new(file))
                .read_info()
                .ok()?;
            let mut bytes = vec![0; reader.output_buffer_size()?];
            reader.next_frame(&mut bytes).ok()?;
            let pixels = (0..480).flat_map(|v| (0..640).map(move |u| [f64::from(u), f64::from(v)]));
            let depths = bytes
                .chunks_exact(2)
                .map(|b| u16::from_be_bytes([b[0], b[1]]));
            let points = pixels
                .zip(depths)
                .filter(|(_, d)| ![0, u16::MAX].contains(d));
            let points = points.map(|(pixel, d)| camera.unproject(pixel, f64::from(d) * 1e-3).raw);
            let origin = pose.transform_point(&Point3::origin());
            Some(Sweep::new(origin, points.map(|p| pose.transform_point(&p))))
        })
        .collect()
}

/// A pose, row by row; the last row may be left out.
fn matrix<'a>(numbers: impl Iterator<Item = &'a str>) -> Matrix4<f64> {
    let mut pose = Matrix4::identity();
    for (i, number) in numbers.enumerate().take(12) {
        pose[(i / 4, i % 4)] = number.parse().unwrap_or(f64::NAN);
    }
    pose
}

/// A box: its least and its greatest corner.
type Solid = [Vector3<f64>; 2];

/// Where a ray first meets a box or the ground.
fn meet(solids: &[Solid], origin: Point3<f64>, ray: Vector3<f64>) -> Option<Point3<f64>> {
    let ground = -origin.z / ray.z;
    let mut nearest = if ground > 0.0 { ground } else { f64::INFINITY };
    for [low, high] in solids {
        let to_low = (low - origin.coords).component_div(&ray);
        let to_high = (high - origin.coords).component_div(&ray);
        let enter = to_low.inf(&to_high).max();
        let leave = to_low.sup(&to_high).min();
        if enter > 0.0 && enter <= leave {
            nearest = nearest.min(enter);
        }
    }
    (nearest < 120.0).then(|| origin + ray * nearest)
}

/// Houses on both sides of a street along x, cars and poles at its edges.
fn town(random: &mut Pcg64) -> Vec<Solid> {
    let mut solids = Vec::new();
    for i in -6..6 {
        let x = f64::from(i) * 14.0;
        for side in [-1.0, 1.0] {
            let (near, height) = (
                random.random_range(8.0..14.0),
                random.random_range(4.0..12.0),
            );
            let [a, b]: [f64; 2] = [side * near, side * (near + 10.0)];
            let low = Vector3::new(x, a.min(b), 0.0);
            solids.push([low, Vector3::new(x + 11.0, a.max(b), height)]);
            let (along, y) = (x + random.random_range(0.0..9.0), side * 4.5 - 0.9);
            let low = Vector3::new(along, y, 0.2);
            solids.push([low, low + Vector3::new(4.4, 1.8, 1.3)]);
            let low = Vector3::new(x + random.random_range(0.0..9.0), side * 6.5, 0.0);
            solids.push([low, low + Vector3::new(0.15, 0.15, 6.0)]);
        }
    }
    solids
}

/// A spinning `LiDAR` of 64 beams, 1.8 m above the street, every two metres.
fn street(sweeps: usize) -> Vec<Sweep> {
    let mut random = Pcg64::seed_from_u64(SEED);
    let solids = town(&mut random);
    let place = |i: usize| Point3::new(-10.0 + 2.0 * i as f64, 0.3, 1.8);
    (0..sweeps)
        .map(|i| {
            let origin = place(i);
            let mut points = Vec::new();
            for turn in 0..1024 {
                for beam in 0..64 {
                    let azimuth = f64::from(turn) * std::f64::consts::TAU / 1024.0;
                    let elevation = (2.0 - 26.8 * f64::from(beam) / 63.0).to_radians();
                    let (s, c) = azimuth.sin_cos();
                    let ray =
                        Vector3::new(c * elevation.cos(), s * elevation.cos(), elevation.sin());
                    let noise: f64 = random.random_range(-0.02..0.02);
                    points.extend(meet(&solids, origin, ray).map(|p| p + ray * noise));
                }
            }
            Sweep::new(origin, points.into_iter())
        })
        .collect()
}

/// A depth camera that looks straight down from 20 m, every four metres; depth noise grows with the square of the range.
fn uav(images: usize) -> Vec<Sweep> {
    let mut random = Pcg64::seed_from_u64(SEED + 1);
    let solids = town(&mut random);
    (0..images)
        .map(|i| {
            let origin = Point3::new(-20.0 + 4.0 * i as f64, 1.0, 20.0);
            let mut points = Vec::new();
            for v in -60..60 {
                for u in -80..80 {
                    let ray =
                        Vector3::new(f64::from(u) / 90.0, f64::from(v) / 90.0, -1.0).normalize();
                    let Some(p) = meet(&solids, origin, ray) else {
                        continue;
                    };
                    let spread = 0.0002 * (p - origin).norm_squared();
                    points.push(p + ray * random.random_range(-spread..spread));
                }
            }
            Sweep::new(origin, points.into_iter())
        })
        .collect()
}
