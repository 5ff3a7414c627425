//! A live RGB-D camera: frames from the topics of a ROS 2 driver.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use maps::camera::{Pinhole, RgbdFrame};

use super::names::Topic;
use super::pairs::{Kind, More, Pairs, Unused};
use super::{LARGEST_MESSAGE, Session, Settings, Subscription};
use crate::beside::{Beside, Collector};
use crate::cdr::CdrError;
use crate::error::Silence;
use crate::image::{raw_color, raw_depth};
use crate::live::{Inbox, Live, Received, Taken};
use crate::mcap::Topics;
use crate::ros::vehicle::{self, Imu, NavSatFix};
use crate::ros::{self, CameraInfo, Image, Schema};
use crate::{RgbdSource, SourceError, TruthPose, checked_camera};

/// How long a source waits before it says that something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// For the camera's first description.
    pub camera: Duration,
    /// For the next frame.
    pub frame: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            camera: Duration::from_secs(10),
            frame: Duration::from_secs(5),
        }
    }
}

/// How far apart in time the colour and the depth image of a frame may be, as in a file.
const MAX_DIFFERENCE: Duration = Duration::from_millis(20);

/// How many images may wait. A quarter of a second at 30 Hz: what is older, a slow reader is better without.
const MOST_WAITING: usize = 8;

/// How many true poses are kept: four hours at 15 Hz.
const MOST_TRUTH: usize = 1 << 18;

/// The queues of the inbox.
const COLOR: usize = 0;
const DEPTH: usize = 1;
const CAMERA_INFO: usize = 2;
const TRUTH: usize = 3;
const IMU: usize = 4;
const GNSS: usize = 5;

/// How many messages of each queue may wait. The gyroscope's are small, many, and of no use with gaps.
const WAITING: [usize; 6] = [
    MOST_WAITING,
    MOST_WAITING,
    MOST_WAITING,
    MOST_WAITING,
    512,
    MOST_WAITING,
];

/// A camera that is looking now.
pub struct ZenohSource {
    session: Session,
    inbox: Arc<Inbox>,
    _subscriptions: Vec<Subscription>,
    /// The endpoint, where errors name a file.
    place: PathBuf,
    topics: Topics,
    patience: Patience,
    camera: Pinhole,
    truth: Vec<TruthPose>,
    pairs: Pairs<Vec<u8>>,
    /// Of the pairs' losses, those that are noted in the inbox.
    noted: Unused,
    collector: Collector,
    beside: Beside,
    ended: bool,
}

/// What has come since the last frame.
#[derive(Default)]
struct Heard {
    color: bool,
    depth: bool,
    late: bool,
    damage: Option<(usize, CdrError)>,
}

impl ZenohSource {
    /// Subscribes to the topics and waits for the camera's description.
    pub fn open(
        settings: &Settings,
        topics: Topics,
        patience: Patience,
    ) -> Result<Self, SourceError> {
        let session = Session::open(settings)?;
        let inbox = Arc::new(Inbox::new(&WAITING, LARGEST_MESSAGE));
        let mut subscriptions = Vec::new();
        for (queue, topic) in named(&topics) {
            // Truth is for simulators, and not every vehicle has the others; an empty name is none.
            if queue < TRUTH || !topic.is_empty() {
                let into = (&inbox, queue);
                subscriptions.push(session.subscribe(
                    topic,
                    schema(queue),
                    WAITING[queue],
                    into,
                )?);
            }
        }
        let place = PathBuf::from(session.endpoint());
        let camera = wait_for_camera(&session, &inbox, &topics, patience.camera)?;
        // What came before the camera was known is no loss.
        inbox.lose(|losses| *losses = crate::live::Losses::default());
        Ok(Self {
            session,
            inbox,
            _subscriptions: subscriptions,
            place,
            topics,
            patience,
            camera,
            truth: Vec::new(),
            pairs: Pairs::new(MAX_DIFFERENCE),
            noted: Unused::default(),
            collector: Collector::default(),
            beside: Beside::default(),
            ended: false,
        })
    }

    fn wait_for_frame(&mut self) -> Result<Option<RgbdFrame>, SourceError> {
        let deadline = now() + self.patience.frame;
        let mut heard = Heard::default();
        loop {
            if let Some(frame) = self.next_pair(More::Yes)? {
                return Ok(Some(frame));
            }
            let left = deadline.saturating_duration_since(now());
            let taken = if left.is_zero() {
                Taken::Nothing
            } else {
                self.inbox.take(|_any| true, left)
            };
            match taken {
                Taken::Message(queue, message) => self.sort(queue, message, &mut heard),
                Taken::Stopped => return Ok(None),
                Taken::Nothing => {
                    let last = self.next_pair(More::No)?;
                    return last.map_or_else(|| Err(self.silent(heard)), |frame| Ok(Some(frame)));
                }
            }
        }
    }

    fn next_pair(&mut self, more: More) -> Result<Option<RgbdFrame>, SourceError> {
        let pair = self.pairs.next(more);
        self.note_unused();
        pair.map(|pair| self.frame(pair)).transpose()
    }

    fn note_unused(&mut self) {
        let before = std::mem::replace(&mut self.noted, self.pairs.unused);
        if before != self.noted {
            self.inbox.lose(|losses| {
                losses.unpaired += self.noted.unpaired - before.unpaired;
                losses.late += self.noted.late - before.late;
            });
        }
    }

    /// Puts a message where it belongs. One that is damaged is left out: the next may be whole.
    fn sort(&mut self, queue: usize, message: Received, heard: &mut Heard) {
        let outcome = match queue {
            COLOR | DEPTH => self.add_image(queue, message.bytes, heard),
            TRUTH => self.add_truth(&message.bytes),
            IMU => Imu::decode(&message.bytes).map(|imu| self.collector.add_imu(&imu)),
            GNSS => NavSatFix::decode(&message.bytes).map(|fix| self.collector.add_fix(&fix)),
            // The camera is known by now.
            _ => Ok(()),
        };
        if let Err(damage) = outcome {
            self.inbox.lose(|losses| losses.damaged += 1);
            heard.damage = Some((queue, damage));
        }
    }

    fn add_image(
        &mut self,
        queue: usize,
        message: Vec<u8>,
        heard: &mut Heard,
    ) -> Result<(), CdrError> {
        let at = Image::decode(&message)?.at;
        let kind = if queue == COLOR {
            heard.color = true;
            Kind::Color
        } else {
            heard.depth = true;
            Kind::Depth
        };
        let late_before = self.pairs.unused.late;
        self.pairs.add(kind, at, message);
        heard.late |= self.pairs.unused.late > late_before;
        self.note_unused();
        Ok(())
    }

    fn add_truth(&mut self, message: &[u8]) -> Result<(), CdrError> {
        let (at, pose) = ros::decode_pose(message)?;
        let is_next = self.truth.last().is_none_or(|last| last.at < at);
        if let Some(pose) = pose.filter(|_| is_next && self.truth.len() < MOST_TRUTH) {
            self.truth.push(TruthPose { at, pose });
        }
        Ok(())
    }

    /// Decodes the two images of a frame.
    fn frame(&self, (color, depth): (Vec<u8>, Vec<u8>)) -> Result<RgbdFrame, SourceError> {
        let color = self.image(&self.topics.color, &color)?;
        let depth = self.image(&self.topics.depth, &depth)?;
        let rgb = raw_color(&color).ok_or_else(|| {
            let expected = "whole images of rgb8, bgr8, rgba8, bgra8 or mono8";
            self.unusable(&self.topics.color, &color, expected)
        })?;
        let depth_m = raw_depth(&depth).ok_or_else(|| {
            let expected = "whole images of 16UC1 or 32FC1";
            self.unusable(&self.topics.depth, &depth, expected)
        })?;
        Ok(RgbdFrame {
            at: color.at,
            width: self.camera.width,
            height: self.camera.height,
            rgb,
            depth_m,
        })
    }

    fn image<'a>(&self, topic: &str, message: &'a [u8]) -> Result<Image<'a>, SourceError> {
        let image = Image::decode(message).map_err(|source| damaged(&self.place, topic, source))?;
        let found = [image.width as usize, image.height as usize];
        let camera = [self.camera.width, self.camera.height];
        if found != camera {
            return Err(SourceError::Size {
                path: self.place.join(topic.trim_start_matches('/')),
                found,
                camera,
            });
        }
        Ok(image)
    }

    fn unusable(&self, topic: &str, image: &Image<'_>, expected: &'static str) -> SourceError {
        SourceError::Kind {
            path: self.place.clone(),
            topic: topic.to_owned(),
            found: format!("`{}` in {} bytes", image.encoding, image.data.len()),
            expected,
        }
    }

    /// Why there is no frame.
    fn silent(&self, heard: Heard) -> SourceError {
        let topics = &self.topics;
        let queue = if heard.color && !heard.depth {
            DEPTH
        } else {
            COLOR
        };
        let after = self.patience.frame;
        match heard {
            Heard {
                damage: Some((queue, source)),
                ..
            } => damaged(&self.place, name(topics, queue), source),
            Heard { late: true, .. } => self.report(queue, after, Silence::BackInTime),
            Heard {
                color: true,
                depth: true,
                ..
            } => {
                let window_ms = MAX_DIFFERENCE.as_millis();
                self.report(queue, after, Silence::Apart { window_ms })
            }
            _ => silence(&self.session, topics, queue, after),
        }
    }

    fn report(&self, queue: usize, after: Duration, why: Silence) -> SourceError {
        SourceError::Silent {
            endpoint: self.session.endpoint().to_owned(),
            topic: name(&self.topics, queue).to_owned(),
            seconds: after.as_secs_f64(),
            why,
        }
    }
}

impl RgbdSource for ZenohSource {
    /// The endpoint.
    fn name(&self) -> &str {
        self.session.endpoint()
    }

    fn camera(&self) -> Pinhole {
        self.camera
    }

    fn frame_count(&self) -> Option<usize> {
        None
    }

    /// As far as it has come.
    fn truth(&self) -> &[TruthPose] {
        &self.truth
    }

    fn next_frame(&mut self) -> Result<Option<RgbdFrame>, SourceError> {
        if self.ended {
            return Ok(None);
        }
        let frame = self.wait_for_frame();
        if let Ok(Some(frame)) = &frame {
            self.beside = self.collector.until(frame.at);
        }
        self.ended = !matches!(frame, Ok(Some(_)));
        frame
    }

    fn beside(&self) -> Beside {
        self.beside
    }

    fn live(&self) -> Option<Live> {
        Some(Live(Arc::clone(&self.inbox)))
    }
}

fn wait_for_camera(
    session: &Session,
    inbox: &Inbox,
    topics: &Topics,
    patience: Duration,
) -> Result<Pinhole, SourceError> {
    let place = Path::new(session.endpoint());
    let deadline = now() + patience;
    let mut damage = None;
    loop {
        let left = deadline.saturating_duration_since(now());
        let taken = if left.is_zero() {
            Taken::Nothing
        } else {
            inbox.take(|queue| queue == CAMERA_INFO, left)
        };
        let Taken::Message(_, message) = taken else {
            return Err(match damage {
                Some(source) => damaged(place, &topics.camera_info, source),
                None => silence(session, topics, CAMERA_INFO, patience),
            });
        };
        match CameraInfo::decode(&message.bytes) {
            Ok(info) => return checked_camera(place, &info),
            Err(source) => damage = Some(source),
        }
    }
}

/// Asks the graph why nothing comes.
fn silence(session: &Session, topics: &Topics, queue: usize, after: Duration) -> SourceError {
    let topic = name(topics, queue);
    let publishers = match session.publishers(topic) {
        Ok(publishers) => publishers,
        Err(error) => return error.into(),
    };
    let expected = schema(queue);
    let named = Topic::new(topic, expected);
    let is_ours = |info: &&super::PublisherInfo| named.as_ref().is_ok_and(|t| info.is_of(t));
    let why = match (publishers.iter().find(is_ours), publishers.first()) {
        (Some(publisher), _) => Silence::Mute {
            node: publisher.node.clone(),
        },
        (None, Some(other)) => {
            let found = if other.kind == expected.name {
                format!("{} of another definition ({})", other.kind, other.hash)
            } else {
                other.kind.clone()
            };
            return SourceError::Kind {
                path: session.endpoint().into(),
                topic: topic.to_owned(),
                found,
                expected: expected.name,
            };
        }
        (None, None) if session.is_connected() => Silence::Unpublished,
        (None, None) => Silence::Unconnected,
    };
    SourceError::Silent {
        endpoint: session.endpoint().to_owned(),
        topic: topic.to_owned(),
        seconds: after.as_secs_f64(),
        why,
    }
}

fn damaged(place: &Path, topic: &str, source: CdrError) -> SourceError {
    SourceError::Message {
        path: place.to_owned(),
        topic: topic.to_owned(),
        source,
    }
}

fn named(topics: &Topics) -> [(usize, &str); 6] {
    [COLOR, DEPTH, CAMERA_INFO, TRUTH, IMU, GNSS].map(|queue| (queue, name(topics, queue)))
}

fn name(topics: &Topics, queue: usize) -> &str {
    match queue {
        COLOR => &topics.color,
        DEPTH => &topics.depth,
        CAMERA_INFO => &topics.camera_info,
        IMU => &topics.imu,
        GNSS => &topics.gnss,
        _ => &topics.truth,
    }
}

fn schema(queue: usize) -> &'static Schema {
    match queue {
        COLOR | DEPTH => &ros::IMAGE,
        CAMERA_INFO => &ros::CAMERA_INFO,
        IMU => &vehicle::IMU,
        GNSS => &vehicle::NAV_SAT_FIX,
        _ => &ros::POSE_STAMPED,
    }
}

#[expect(
    clippy::disallowed_methods,
    reason = "how long a live camera has been silent is real time, and of no replay"
)]
fn now() -> Instant {
    Instant::now()
}
