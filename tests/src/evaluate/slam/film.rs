//! Films a simulated scene from the drone: colour and depth as its camera delivers them, in TUM layout, with the truth and with
//! what a perfect detector would see.
//!
//! 30 frames a second of the depth camera with its default noise; depth in whole millimetres, as it comes. All of it is lossless.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::Path;

use anyhow::Context as _;
use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use maps::trajectory::{Trajectory, tum};
use rayon::prelude::*;
use sitl::depth_camera::{INDOORS_M, OUTDOORS_M, d455, expose};
use sitl::platform;
use sitl::render::{Picture, Stage};
use sitl::scene::{Instance, Name, Scene};

use super::flight::take_off;
use super::inertial;
use super::job::Shown;
use super::positions;

const RATE_HZ: u64 = 30;
/// The value of a depth pixel at 1 m.
pub(super) const DEPTH_FACTOR: f64 = 1000.0;
/// Fewer pixels are no detection.
const LEAST_PIXELS: u32 = 100;

/// Films the scene into `folder`, which is there; its truth, which the folder also has. `objects.txt` beside the pictures
/// is in the format of [`super::objects`].
pub(super) fn film(
    shown: &Shown,
    folder: &Path,
    say: &mut dyn FnMut(&str),
) -> anyhow::Result<Trajectory<Camera>> {
    let name = shown.name()?;
    let mut scene = shown.build()?;
    let lasts = take_off(&mut scene, name, shown.seed)?;
    let count = lasts.as_secs_f64() * RATE_HZ as f64;
    let stamps: Vec<Stamp> = (0..count as u64)
        .map(|i| Stamp::from_nanos(i * 1_000_000_000 / RATE_HZ))
        .collect();
    say(&format!("filming {} frames", stamps.len()));
    for part in ["rgb", "depth"] {
        fs::create_dir_all(folder.join(part))?;
    }
    let studio = Studio {
        stage: Stage::new(&scene),
        camera: d455(),
        reach_m: if name == Name::Room {
            INDOORS_M
        } else {
            OUTDOORS_M
        },
        seed: shown.seed,
        folder,
    };
    let shots: Vec<Shot> = stamps
        .par_iter()
        .enumerate()
        .map(|(index, at)| studio.shoot(index, *at))
        .collect::<io::Result<_>>()
        .with_context(|| format!("cannot film into {}", folder.display()))?;
    inertial::film(&scene, &stamps, shown.seed, folder)?;
    // Indoors there are no satellites.
    if name != Name::Room {
        positions::film(&scene, &stamps, shown.seed, folder)?;
    }
    lists(&shots, &scene, folder).with_context(|| format!("cannot film into {}", folder.display()))
}

struct Studio<'a> {
    stage: Stage<'a>,
    camera: Pinhole,
    reach_m: f32,
    seed: u64,
    folder: &'a Path,
}

/// One picture that was taken.
struct Shot {
    at: Stamp,
    pose: Isometry<World, Camera>,
    /// Left, top, right and bottom pixel of what can move.
    boxes: Vec<(Instance, [u32; 4])>,
}

impl Studio<'_> {
    fn shoot(&self, index: usize, at: Stamp) -> io::Result<Shot> {
        let moment = self.stage.at(at);
        let pose = platform::uav_camera(moment.scene(), at, self.seed);
        let picture = moment.picture(&self.camera, pose);
        let frame = expose(&picture, &self.camera, self.reach_m, self.seed);
        let millimetres = frame.depth_m.iter().flat_map(|depth| {
            let value = (f64::from(*depth) * DEPTH_FACTOR).round();
            (value.clamp(0.0, 65_535.0) as u16).to_be_bytes()
        });
        let rgb = self.folder.join(format!("rgb/{index:06}.png"));
        write_png(&rgb, &self.camera, frame.rgb.as_flattened())?;
        let depth = self.folder.join(format!("depth/{index:06}.png"));
        write_png(&depth, &self.camera, &millimetres.collect::<Vec<_>>())?;
        Ok(Shot {
            at,
            pose,
            boxes: boxes(&picture, moment.scene()),
        })
    }
}

/// Three bytes a pixel are a colour, two are depth.
fn write_png(path: &Path, camera: &Pinhole, bytes: &[u8]) -> io::Result<()> {
    let file = BufWriter::new(File::create(path)?);
    let (width, height) = (camera.width as u32, camera.height as u32);
    let mut encoder = png::Encoder::new(file, width, height);
    let (color, depth) = if bytes.len() == 3 * camera.width * camera.height {
        (png::ColorType::Rgb, png::BitDepth::Eight)
    } else {
        (png::ColorType::Grayscale, png::BitDepth::Sixteen)
    };
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    writer.write_image_data(bytes).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)
}

/// The boxes around what the picture shows of road users and of people, parked or not.
fn boxes(picture: &Picture, scene: &Scene) -> Vec<(Instance, [u32; 4])> {
    let mut found: BTreeMap<Instance, ([u32; 4], u32)> = BTreeMap::new();
    for (i, instance) in picture.instance.iter().enumerate() {
        if *instance == Instance::NOTHING || !scene.class_of(*instance).is_traffic() {
            continue;
        }
        let (x, y) = ((i % picture.width) as u32, (i / picture.width) as u32);
        let (bounds, pixels) = found.entry(*instance).or_insert(([x, y, x, y], 0));
        *bounds = [
            bounds[0].min(x),
            bounds[1].min(y),
            bounds[2].max(x),
            bounds[3].max(y),
        ];
        *pixels += 1;
    }
    let large = (found.into_iter()).filter(|(_, (_, pixels))| *pixels >= LEAST_PIXELS);
    large
        .map(|(instance, (bounds, _))| (instance, bounds))
        .collect()
}

fn lists(shots: &[Shot], scene: &Scene, folder: &Path) -> anyhow::Result<Trajectory<Camera>> {
    let (mut associations, mut objects) = (String::new(), String::new());
    for (index, shot) in shots.iter().enumerate() {
        let at = shot.at;
        // Writing to a string cannot fail.
        let _ = writeln!(
            associations,
            "{at} rgb/{index:06}.png {at} depth/{index:06}.png"
        );
        for (instance, [left, top, right, bottom]) in &shot.boxes {
            let class = format!("{:?}", scene.class_of(*instance)).to_lowercase();
            let _ = writeln!(objects, "{at} {left} {top} {right} {bottom} 1.0 {class}");
        }
    }
    let truth = shots.iter().map(|shot| (shot.at, shot.pose)).collect();
    let truth = Trajectory::new(truth)?;
    fs::write(folder.join("associations.txt"), associations)?;
    fs::write(folder.join("objects.txt"), objects)?;
    fs::write(folder.join("groundtruth.txt"), tum::format(&truth))?;
    Ok(truth)
}
