//! What cameras deliver.

use maps::camera::{Pinhole, RgbdFrame};
use maps::time::Stamp;
use sensors::mcap::Topics;
use sensors::message::{self, CAMERA_FRAME, WORLD_FRAME};
use sensors::ros::{
    CAMERA_INFO, COMPRESSED_IMAGE, CompressedImage, IMAGE, POSE_STAMPED, encode_camera_info,
    encode_pose,
};

use super::world::World;
use super::{Rate, Reading, Sensor, Setup};
use crate::camera_model::{CameraModel, Optics, OpticsError};
use crate::depth_camera::{INDOORS_M, OUTDOORS_M, d455, expose};
use crate::noise::{at_cell, mix, normal};
use crate::platform::{self, Platform};
use crate::render::{Picture, PoseAt};
use crate::scene::{Name, Scene};
use crate::sensor::child_seed;

pub(super) fn of(platform: Platform, setup: &Setup) -> Result<Vec<Box<dyn Sensor>>, OpticsError> {
    let eye = |lens, name: &str| Eye::new(lens, setup, child_seed(setup.seed, name));
    Ok(match platform {
        Platform::Uav => vec![Box::new(DepthCamera {
            topics: Topics::default(),
            camera: d455(),
            eye: eye(d455(), "uav/camera")?,
            reach_m: if setup.scene == Name::Room {
                INDOORS_M
            } else {
                OUTDOORS_M
            },
            masks: setup.masks,
        })],
        Platform::Ugv => (0..platform::UGV_CAMERAS.len())
            .map(|index| -> Result<Box<dyn Sensor>, OpticsError> {
                let name = format!("ugv/camera-{}", platform::UGV_CAMERAS[index]);
                Ok(Box::new(GroundCamera {
                    index,
                    seed: child_seed(setup.seed, &name),
                    eye: eye(platform::ugv_lens(), &name)?,
                    name,
                    lens: platform::ugv_lens(),
                }))
            })
            .collect::<Result<_, _>>()?,
    })
}

/// What takes the pictures of one camera.
struct Eye {
    lens: Pinhole,
    /// None takes ideal pictures, which share what is the same for all cameras at one moment.
    model: Option<CameraModel>,
}

impl Eye {
    fn new(lens: Pinhole, setup: &Setup, seed: u64) -> Result<Self, OpticsError> {
        let optics = setup.optics;
        let model = (optics != Optics::IDEAL).then(|| CameraModel::new(lens, optics, seed));
        Ok(Self {
            lens,
            model: model.transpose()?,
        })
    }

    /// Whether its pictures have the noise of pixels already.
    fn is_noisy(&self) -> bool {
        let model = self.model.as_ref();
        model.is_some_and(|model| model.optics().photosites.is_some())
    }

    fn look(&mut self, world: &mut World<'_>, at: Stamp, pose_at: &PoseAt<'_>) -> Picture {
        match &mut self.model {
            None => world.moment(at).picture(&self.lens, pose_at(at)),
            Some(model) => model.shoot(world.stage(), at, pose_at).picture,
        }
    }
}

/// Pictures per second, one of the camera's own rates.
const DEPTH_RATE_HZ: u64 = 15;

/// The drone's camera of colour and depth, with its true pose.
struct DepthCamera {
    topics: Topics,
    camera: Pinhole,
    eye: Eye,
    reach_m: f32,
    masks: bool,
}

impl Sensor for DepthCamera {
    fn name(&self) -> &'static str {
        "uav/camera"
    }

    fn rate(&self) -> Rate {
        Rate::hz(DEPTH_RATE_HZ)
    }

    fn read(&mut self, world: &mut World<'_>, at: Stamp, noise: f64) -> Vec<Reading> {
        let (scene, seed) = (world.scene, world.seed);
        let pose_at = |at| platform::uav_camera(scene, at, seed);
        let pose = pose_at(at);
        let picture = self.eye.look(world, at, &pose_at);
        let mut frame = expose(&picture, &self.camera, self.reach_m, seed);
        if self.eye.is_noisy() {
            frame.rgb.clone_from(&picture.rgb);
        }
        spread(&mut frame, &picture, noise);
        let mut readings = Vec::new();
        // Players that seek need it now and then.
        if at.as_nanos().is_multiple_of(1_000_000_000) {
            let camera = self.camera;
            let encode = move |at| encode_camera_info(at, CAMERA_FRAME, &camera);
            readings.push(Reading::now(
                &*self.topics.camera_info,
                &CAMERA_INFO,
                at,
                encode,
            ));
        }
        let encode = move |at| encode_pose(at, WORLD_FRAME, &pose.raw);
        readings.push(Reading::now(&*self.topics.truth, &POSE_STAMPED, at, encode));
        if self.masks {
            readings.extend(masks(scene, &picture));
        }
        let size = [self.camera.width as u32, self.camera.height as u32];
        let RgbdFrame { rgb, depth_m, .. } = frame;
        let encode = move |at| message::color(at, size, &rgb);
        readings.push(Reading::now(&*self.topics.color, &IMAGE, at, encode));
        let encode = move |at| message::depth(at, size, &depth_m);
        readings.push(Reading::now(&*self.topics.depth, &IMAGE, at, encode));
        readings
    }
}

/// Makes the errors of depth so many times as large.
fn spread(frame: &mut RgbdFrame, picture: &Picture, noise: f64) {
    if (noise - 1.0).abs() < f64::EPSILON {
        return;
    }
    let noise = noise as f32;
    for (depth_m, truth) in frame.depth_m.iter_mut().zip(&picture.depth_m) {
        if *depth_m > 0.0 && *truth > 0.0 {
            *depth_m = (truth + (*depth_m - truth) * noise).max(0.0);
        }
    }
}

/// Which thing and which class each pixel shows, without loss.
fn masks(scene: &Scene, picture: &Picture) -> [Reading; 2] {
    let size = [picture.width as u32, picture.height as u32];
    let instances: Vec<u8> = picture
        .instance
        .iter()
        .flat_map(|i| i.0.to_be_bytes())
        .collect();
    let classes: Vec<u8> = picture
        .instance
        .iter()
        .map(|i| scene.class_of(*i) as u8)
        .collect();
    let image = |topic: &str, bytes: Vec<u8>, depth: png::BitDepth| {
        let encode = move |at| {
            CompressedImage {
                at,
                frame_id: CAMERA_FRAME,
                format: if depth == png::BitDepth::Sixteen {
                    "mono16; png compressed"
                } else {
                    "mono8; png compressed"
                },
                data: &grey_png(size, depth, &bytes),
            }
            .encode()
        };
        Reading::now(topic, &COMPRESSED_IMAGE, picture.at, encode)
    };
    [
        image(
            "/uav/ground_truth/instance/compressed",
            instances,
            png::BitDepth::Sixteen,
        ),
        image(
            "/uav/ground_truth/class/compressed",
            classes,
            png::BitDepth::Eight,
        ),
    ]
}

/// Samples of more than one byte have their high byte first.
fn grey_png([width, height]: [u32; 2], depth: png::BitDepth, samples: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::Fast);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(samples))
        .expect("memory takes as many samples as the picture has");
    file
}

/// One of the ground vehicle's cameras.
struct GroundCamera {
    name: String,
    index: usize,
    seed: u64,
    eye: Eye,
    lens: Pinhole,
}

/// The frame of one of the ground vehicle's cameras, as `tf2` knows it.
pub(super) fn ground_frame(camera: &str) -> String {
    format!("ugv/camera_{camera}_optical_frame")
}

impl Sensor for GroundCamera {
    fn name(&self) -> &str {
        &self.name
    }

    fn rate(&self) -> Rate {
        Rate::hz(10)
    }

    fn read(&mut self, world: &mut World<'_>, at: Stamp, noise: f64) -> Vec<Reading> {
        let camera = platform::UGV_CAMERAS[self.index];
        let (scene, mount) = (world.scene, platform::body_from_ugv_camera(self.index));
        let pose_at = |at| platform::ugv(scene, at) * mount;
        let picture = self.eye.look(world, at, &pose_at);
        // What the optics have added already is not made larger.
        let more = noise as f32 - f32::from(u8::from(self.eye.is_noisy()));
        let rgb = noisy(&picture, more, self.seed);
        let frame = ground_frame(camera);
        let topic = format!("/ugv/camera_{camera}");
        let mut readings = Vec::new();
        if at.as_nanos().is_multiple_of(1_000_000_000) {
            let (frame, lens) = (frame.clone(), self.lens);
            let encode = move |at| encode_camera_info(at, &frame, &lens);
            readings.push(Reading::now(
                format!("{topic}/camera_info"),
                &CAMERA_INFO,
                at,
                encode,
            ));
        }
        let size = [self.lens.width as u16, self.lens.height as u16];
        let encode = move |at| {
            CompressedImage {
                at,
                frame_id: &frame,
                format: "rgb8; jpeg compressed bgr8",
                data: &jpeg(size, &rgb),
            }
            .encode()
        };
        let topic = format!("{topic}/image_raw/compressed");
        readings.push(Reading::now(topic, &COMPRESSED_IMAGE, at, encode));
        readings
    }
}

/// Standard deviation of each colour channel, in grey levels.
const COLOUR_NOISE: f32 = 1.5;

/// A picture's colours with the noise of a sensor, so many times as large.
fn noisy(picture: &Picture, factor: f32, seed: u64) -> Vec<[u8; 3]> {
    let moment = picture.at.as_nanos() ^ seed.rotate_left(32) ^ seed;
    let seed = mix(mix(moment as u32) ^ (moment >> 32) as u32);
    let pixels = (0_i32..).zip(&picture.rgb);
    let noisy = |(i, channel): (i32, u32), level: u8| {
        let noise = COLOUR_NOISE * factor * normal(at_cell(i, 0, seed ^ mix(channel)));
        (f32::from(level) + noise + 0.5).clamp(0.0, 255.0) as u8
    };
    pixels
        .map(|(i, [r, g, b])| [noisy((i, 0), *r), noisy((i, 1), *g), noisy((i, 2), *b)])
        .collect()
}

/// A JPEG file of quality 90, as camera drivers make them.
fn jpeg([width, height]: [u16; 2], rgb: &[[u8; 3]]) -> Vec<u8> {
    let mut file = Vec::new();
    jpeg_encoder::Encoder::new(&mut file, 90)
        .encode(
            rgb.as_flattened(),
            width,
            height,
            jpeg_encoder::ColorType::Rgb,
        )
        .expect("memory takes as many pixels as the picture has");
    file
}
