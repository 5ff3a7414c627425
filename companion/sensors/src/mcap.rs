//! An MCAP file of ROS 2 messages: colour, depth, the camera and its true pose.
//!
//! MCAP is an append-only container that carries the message definitions with the messages, so that Foxglove and
//! `ros2 bag` open what [`Writer`] wrote, and [`McapFile`] reads what they recorded. The true pose is that of the
//! camera's optical frame in the world.
//!
//! A file is read twice, in constant memory: once for the camera, the truth and which images belong together, once for
//! the images. A file that was cut off gives all its whole frames and then an error.
//!
//! - *MCAP file format specification*, mcap.dev/spec; message encoding `cdr`, schema encoding `ros2msg`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ::mcap::io::MessageReader;
use ::mcap::sans_io::LinearReaderOptions;
use ::mcap::{McapError, Message};
use maps::camera::{Pinhole, RgbdFrame};
use maps::time::Stamp;
use serde::{Deserialize, Serialize};

use crate::beside::{Beside, Collector};
use crate::image::{raw_color, raw_depth};
use crate::pairing::mutual_nearest;
use crate::ros::vehicle::{self, Imu, NavSatFix};
use crate::ros::{self, CameraInfo, Image};
use crate::{RgbdSource, SourceError, TruthPose, checked_camera};

mod writer;

pub use writer::{WriteError, Writer};

/// The names of the channels in a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Topics {
    /// `sensor_msgs/msg/Image`: colour.
    pub color: String,
    /// `sensor_msgs/msg/Image`: depth, registered to the colour image.
    pub depth: String,
    /// `sensor_msgs/msg/CameraInfo` of both.
    pub camera_info: String,
    /// `geometry_msgs/msg/PoseStamped`: the true pose. A file need not have it.
    pub truth: String,
    /// `sensor_msgs/msg/Imu`: the gyroscope. A file need not have it; an empty name is none.
    pub imu: String,
    /// `sensor_msgs/msg/NavSatFix`: the satellite receiver. A file need not have it; an empty name is none.
    pub gnss: String,
}

impl Default for Topics {
    fn default() -> Self {
        Self {
            color: "/uav/camera/color/image_raw".into(),
            depth: "/uav/camera/depth/image_rect_raw".into(),
            camera_info: "/uav/camera/color/camera_info".into(),
            truth: "/uav/ground_truth/pose".into(),
            imu: "/uav/imu/data_raw".into(),
            gnss: "/uav/gnss/fix".into(),
        }
    }
}

/// How far apart in time the colour and the depth image of a frame may be.
const MAX_DIFFERENCE: Duration = Duration::from_millis(20);

/// No record is longer: a chunk of a few images of the largest camera.
const LARGEST_RECORD: usize = 256 << 20;

/// How many images may wait for their partners. Recorders write the two within a few messages of each other.
const MOST_WAITING: usize = 64;

/// A recording in a file.
pub struct McapFile {
    path: PathBuf,
    name: String,
    topics: Topics,
    camera: Pinhole,
    truth: Vec<TruthPose>,
    /// The depth image that belongs to each colour image.
    depth_of_color: BTreeMap<Stamp, Stamp>,
    color_of_depth: BTreeMap<Stamp, Stamp>,
    /// Images whose partners were not read yet, by the colour image's stamp.
    waiting: BTreeMap<Stamp, Half>,
    messages: Option<MessageReader<BufReader<File>>>,
    frames: usize,
    collector: Collector,
    beside: Beside,
}

/// One half of a frame.
enum Half {
    Color(Vec<[u8; 3]>),
    Depth(Vec<f32>),
}

/// What the first reading of a file finds.
#[derive(Default)]
struct Survey {
    camera: Option<Pinhole>,
    truth: Vec<TruthPose>,
    colors: Vec<Stamp>,
    depths: Vec<Stamp>,
    present: BTreeSet<String>,
    damage: Option<McapError>,
}

impl McapFile {
    /// Reads a file once and checks that it has what is needed.
    pub fn open(path: &Path, topics: Topics) -> Result<Self, SourceError> {
        let survey = survey(path, &topics)?;
        let pairs = mutual_nearest(&survey.colors, &survey.depths, MAX_DIFFERENCE);
        let pairs: Vec<(Stamp, Stamp)> = pairs
            .into_iter()
            .map(|(color, depth)| (survey.colors[color], survey.depths[depth]))
            .collect();
        let camera = match (survey.camera, pairs.is_empty(), survey.damage) {
            (Some(camera), false, _) => camera,
            (_, _, Some(McapError::BadMagic)) => {
                return Err(SourceError::NotMcap {
                    path: path.to_owned(),
                });
            }
            (_, _, Some(source)) => {
                return Err(SourceError::Mcap {
                    path: path.to_owned(),
                    frames: 0,
                    source,
                });
            }
            (camera, _, None) => {
                let topic = match (camera, survey.colors.is_empty(), survey.depths.is_empty()) {
                    (None, ..) => topics.camera_info,
                    (_, true, _) => topics.color,
                    (_, _, true) => topics.depth,
                    _ => {
                        return Err(SourceError::NoPairs {
                            path: path.to_owned(),
                            colors: survey.colors.len(),
                            depths: survey.depths.len(),
                            window_ms: MAX_DIFFERENCE.as_millis(),
                        });
                    }
                };
                return Err(SourceError::Topic {
                    path: path.to_owned(),
                    topic,
                    present: survey.present.into_iter().collect(),
                });
            }
        };
        Ok(Self {
            messages: Some(open(path)?),
            path: path.to_owned(),
            name: crate::stem(path),
            topics,
            camera,
            truth: survey.truth,
            depth_of_color: pairs.iter().copied().collect(),
            color_of_depth: pairs.iter().map(|&(color, depth)| (depth, color)).collect(),
            waiting: BTreeMap::new(),
            frames: 0,
            collector: Collector::default(),
            beside: Beside::default(),
        })
    }

    /// Takes one message; a frame if it was the second half of one.
    fn take(&mut self, message: &Message<'_>) -> Result<Option<RgbdFrame>, SourceError> {
        let topic = &message.channel.topic;
        let is_color = *topic == self.topics.color;
        let damaged = |source| SourceError::Message {
            path: self.path.clone(),
            topic: topic.clone(),
            source,
        };
        if *topic == self.topics.imu {
            let imu = Imu::decode(&message.data).map_err(damaged)?;
            self.collector.add_imu(&imu);
        } else if *topic == self.topics.gnss {
            let fix = NavSatFix::decode(&message.data).map_err(damaged)?;
            self.collector.add_fix(&fix);
        }
        if !is_color && *topic != self.topics.depth {
            return Ok(None);
        }
        let image = decode_image(&self.path, topic, &message.data)?;
        let color_at = if is_color {
            self.depth_of_color
                .contains_key(&image.at)
                .then_some(image.at)
        } else {
            self.color_of_depth.get(&image.at).copied()
        };
        let Some(color_at) = color_at else {
            return Ok(None);
        };
        let half = if is_color {
            raw_color(&image).map(Half::Color)
        } else {
            raw_depth(&image).map(Half::Depth)
        };
        let half = half.ok_or_else(|| SourceError::Kind {
            path: self.path.clone(),
            topic: topic.clone(),
            found: format!("`{}` in {} bytes", image.encoding, image.data.len()),
            expected: if is_color {
                "whole images of rgb8, bgr8, rgba8, bgra8 or mono8"
            } else {
                "whole images of 16UC1 or 32FC1"
            },
        })?;
        let found = [image.width as usize, image.height as usize];
        if found != [self.camera.width, self.camera.height] {
            return Err(SourceError::Size {
                path: self.path.clone(),
                found,
                camera: [self.camera.width, self.camera.height],
            });
        }
        self.join(color_at, half)
    }

    fn join(&mut self, color_at: Stamp, half: Half) -> Result<Option<RgbdFrame>, SourceError> {
        let (rgb, depth_m) = match (self.waiting.remove(&color_at), half) {
            (Some(Half::Depth(depth_m)), Half::Color(rgb))
            | (Some(Half::Color(rgb)), Half::Depth(depth_m)) => (rgb, depth_m),
            // The first half, or the same image again.
            (_, half) => {
                self.waiting.insert(color_at, half);
                if self.waiting.len() > MOST_WAITING {
                    return Err(SourceError::Order {
                        path: self.path.clone(),
                        most: MOST_WAITING,
                    });
                }
                return Ok(None);
            }
        };
        // Each pair gives one frame, even if its images are in the file twice.
        if let Some(depth_at) = self.depth_of_color.remove(&color_at) {
            self.color_of_depth.remove(&depth_at);
        }
        self.frames += 1;
        self.beside = self.collector.until(color_at);
        Ok(Some(RgbdFrame {
            at: color_at,
            width: self.camera.width,
            height: self.camera.height,
            rgb,
            depth_m,
        }))
    }
}

impl RgbdSource for McapFile {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Pinhole {
        self.camera
    }

    fn frame_count(&self) -> Option<usize> {
        Some(self.frames + self.depth_of_color.len())
    }

    fn truth(&self) -> &[TruthPose] {
        &self.truth
    }

    fn next_frame(&mut self) -> Result<Option<RgbdFrame>, SourceError> {
        // Taken out for as long as there was neither an error nor the end.
        while let Some(mut messages) = self.messages.take() {
            let message = match messages.next() {
                None => break,
                Some(message) => message.map_err(|source| SourceError::Mcap {
                    path: self.path.clone(),
                    frames: self.frames,
                    source,
                })?,
            };
            let frame = self.take(&message)?;
            self.messages = Some(messages);
            if frame.is_some() {
                return Ok(frame);
            }
        }
        Ok(None)
    }

    fn beside(&self) -> Beside {
        self.beside
    }
}

fn open(path: &Path) -> Result<MessageReader<BufReader<File>>, SourceError> {
    let file = File::open(path).map_err(|source| SourceError::Read {
        path: path.to_owned(),
        source,
    })?;
    let options = LinearReaderOptions::default()
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(LARGEST_RECORD);
    Ok(MessageReader::new_with_options(
        BufReader::new(file),
        options,
    ))
}

fn decode_image<'a>(path: &Path, topic: &str, message: &'a [u8]) -> Result<Image<'a>, SourceError> {
    Image::decode(message).map_err(|source| SourceError::Message {
        path: path.to_owned(),
        topic: topic.to_owned(),
        source,
    })
}

fn survey(path: &Path, topics: &Topics) -> Result<Survey, SourceError> {
    let mut survey = Survey::default();
    for message in open(path)? {
        match message {
            Ok(message) => survey.take(path, topics, &message)?,
            Err(damage) => {
                survey.damage = Some(damage);
                break;
            }
        }
    }
    survey.colors.sort();
    survey.depths.sort();
    survey.truth.sort_by_key(|pose| pose.at);
    Ok(survey)
}

impl Survey {
    fn take(
        &mut self,
        path: &Path,
        topics: &Topics,
        message: &Message<'_>,
    ) -> Result<(), SourceError> {
        let topic = &message.channel.topic;
        if !self.present.contains(topic) {
            self.present.insert(topic.clone());
            check_kind(path, topics, message)?;
        }
        let damaged = |source| SourceError::Message {
            path: path.to_owned(),
            topic: topic.clone(),
            source,
        };
        if *topic == topics.color {
            self.colors
                .push(decode_image(path, topic, &message.data)?.at);
        } else if *topic == topics.depth {
            self.depths
                .push(decode_image(path, topic, &message.data)?.at);
        } else if *topic == topics.camera_info && self.camera.is_none() {
            let info = CameraInfo::decode(&message.data).map_err(damaged)?;
            self.camera = Some(checked_camera(path, &info)?);
        } else if *topic == topics.truth {
            let (at, pose) = ros::decode_pose(&message.data).map_err(damaged)?;
            self.truth.extend(pose.map(|pose| TruthPose { at, pose }));
        }
        Ok(())
    }
}

/// Whether the channel carries what is read from it.
fn check_kind(path: &Path, topics: &Topics, message: &Message<'_>) -> Result<(), SourceError> {
    let topic = &message.channel.topic;
    let expected = if *topic == topics.color || *topic == topics.depth {
        ros::IMAGE.name
    } else if *topic == topics.camera_info {
        ros::CAMERA_INFO.name
    } else if *topic == topics.truth {
        ros::POSE_STAMPED.name
    } else if *topic == topics.imu {
        vehicle::IMU.name
    } else if *topic == topics.gnss {
        vehicle::NAV_SAT_FIX.name
    } else {
        return Ok(());
    };
    let schema = message.channel.schema.as_ref();
    let found = schema.map_or("messages without a type", |schema| &schema.name);
    let encoding = &message.channel.message_encoding;
    if found == expected && encoding == "cdr" {
        return Ok(());
    }
    Err(SourceError::Kind {
        path: path.to_owned(),
        topic: topic.clone(),
        found: format!("{found} in `{encoding}`"),
        expected,
    })
}

#[cfg(test)]
mod tests;
