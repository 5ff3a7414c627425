//! What all sensors say, with the truth, in a file and over Zenoh.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::RawFrame;
use sensors::mcap::{Topics, WriteError, Writer};
use sensors::message::Message;
use sensors::ros::mavlink::{MAVLINK, encode_frame};
use sensors::zenoh::ZenohError;
use serde::Serialize;

use crate::live::Live;
use crate::platform::Platform;
use crate::rig::{Packet, Rig, RigError, Setup};
use crate::scene::Scene;
use crate::way::Way;

/// How much simulated time is drawn between two questions whether to go on.
const STEP: Duration = Duration::from_millis(20);

/// What to record.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The scene, its seed, and what is aboard.
    pub setup: Setup,
    /// The file, if there is to be one.
    pub file: Option<PathBuf>,
    /// Where to publish, as [`Live::open`] takes it, if it is to be published.
    pub zenoh: Option<String>,
    /// How long.
    pub duration: Duration,
}

/// A run that goes on while it is recorded.
pub struct Follow {
    /// Where its vehicles go.
    pub ways: Vec<(Platform, Arc<Way>)>,
    /// What goes over their links, in order.
    pub frames: Receiver<Heard>,
}

/// A frame that went over a vehicle's link.
#[derive(Clone, Debug)]
pub struct Heard {
    /// Simulated time.
    pub at: Stamp,
    /// The vehicle, as its topic is named: `copter` or `rover`.
    pub vehicle: &'static str,
    /// Whether the vehicle sent it.
    pub is_sent: bool,
    /// The frame.
    pub frame: RawFrame,
}

impl Heard {
    fn packet(&self) -> Option<Packet> {
        let direction = if self.is_sent { "sent" } else { "received" };
        Some(Packet {
            logged: self.at,
            topic: format!("/mavlink/{}", self.vehicle),
            schema: &MAVLINK,
            at: self.at,
            bytes: encode_frame(self.at, direction, self.frame.bytes())?,
        })
    }
}

/// What was recorded.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recording {
    /// The file, if there is one.
    pub file: Option<PathBuf>,
    /// How many pictures of the drone's camera.
    pub frames: u64,
    /// How many messages on each topic.
    pub messages: BTreeMap<String, u64>,
    /// Simulated time that they cover.
    pub seconds: f64,
    /// Whether it was stopped before its end.
    pub stopped: bool,
}

/// Why there is no recording.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Nothing can be published.
    #[error(transparent)]
    Zenoh(#[from] ZenohError),
    /// The sensors cannot be switched on.
    #[error(transparent)]
    Rig(#[from] RigError),
}

/// How far sensors look ahead of the moment at which they start to measure: a sweep, and what speeds are taken from.
const LOOK_AHEAD: Duration = Duration::from_millis(120);

/// Draws, writes and publishes everything that comes in, until the end or until `go_on` says no: it is asked every 20 ms
/// of simulated time and told how much has passed. A run that is followed is waited for, and its end is that of the recording.
pub fn record(
    plan: &Plan,
    follow: Option<&Follow>,
    mut go_on: impl FnMut(Duration) -> bool,
) -> Result<Recording, RecordError> {
    let setup = &plan.setup;
    let mut scene = Scene::generate(setup.scene, setup.seed);
    for (platform, way) in follow.iter().flat_map(|follow| &follow.ways) {
        scene.follow(*platform, Arc::clone(way));
    }
    let mut rig = Rig::new(&scene, setup, plan.duration)?;
    let topics = Topics::default();
    let mut writer = match &plan.file {
        Some(file) => Some(Writer::create(file, &topics)?),
        None => None,
    };
    if let Some(writer) = &mut writer {
        writer.describe("simulation", description(setup))?;
    }
    let mut live = plan.zenoh.as_deref().map(Live::open).transpose()?;
    let mut messages: BTreeMap<String, u64> = BTreeMap::new();
    let mut waiting: Option<Packet> = None;
    let mut done = Duration::ZERO;
    while done < plan.duration && go_on(done) {
        let next = (done + STEP).min(plan.duration);
        let end = Stamp::ZERO + next;
        if let Some(follow) = follow
            && !follow
                .ways
                .iter()
                .all(|(_, way)| way.reaches(end + LOOK_AHEAD))
        {
            break;
        }
        let mut packets = rig.until(end);
        if let Some(follow) = follow {
            let frames = waiting.take().into_iter();
            for packet in frames.chain(follow.frames.try_iter().filter_map(|heard| heard.packet()))
            {
                if packet.logged >= end {
                    waiting = Some(packet);
                    break;
                }
                packets.push(packet);
            }
            packets.sort_by_key(|packet| packet.logged);
        }
        for packet in packets {
            let message = Message {
                topic: &packet.topic,
                schema: packet.schema,
                at: packet.at,
                bytes: packet.bytes,
            };
            if let Some(live) = &mut live {
                live.publish(&message)?;
            }
            if let Some(writer) = &mut writer {
                writer.write(packet.logged, &message)?;
            }
            *messages.entry(packet.topic).or_default() += 1;
        }
        done = next;
    }
    if let Some(writer) = writer {
        writer.finish()?;
    }
    Ok(Recording {
        file: plan.file.clone(),
        frames: messages.get(&topics.color).copied().unwrap_or(0),
        messages,
        seconds: done.as_secs_f64(),
        stopped: follow.is_none() && done < plan.duration,
    })
}

fn description(setup: &Setup) -> BTreeMap<String, String> {
    let version = env!("CARGO_PKG_VERSION");
    let place = setup.origin.place();
    [
        ("scene", setup.scene.to_string()),
        ("seed", setup.seed.to_string()),
        (
            "origin",
            format!("{},{},{}", place.lat_deg, place.lon_deg, place.alt_m),
        ),
        ("made_by", format!("sitl {version}")),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into()
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::mpsc::sync_channel;

    use maps::frame::Isometry;
    use mavlink_ext::dialect::tandem::HEARTBEAT_DATA;
    use mavlink_ext::{Encoder, Message};
    use nalgebra::Isometry3;
    use sensors::RgbdSource as _;
    use sensors::mcap::McapFile;

    use super::*;
    use crate::depth_camera::{INDOORS_M, d455, expose};
    use crate::render::render;
    use crate::scene::Name;
    use crate::simulation::{ROVER, STEP as TICK};

    fn plan(setup: Setup, folder: &tempfile::TempDir, ms: u64) -> Plan {
        Plan {
            setup,
            file: Some(folder.path().join("run.mcap")),
            zenoh: None,
            duration: Duration::from_millis(ms),
        }
    }

    fn file(plan: &Plan) -> &Path {
        plan.file.as_deref().expect("a file")
    }

    fn setup(scene: Name, seed: u64) -> Setup {
        let origin = "50.7277,7.0866,110".parse().expect("a place");
        Setup::new(scene, seed, origin)
    }

    #[test]
    fn a_recording_reads_back_as_the_frames_and_truth_that_were_drawn() {
        let folder = tempfile::tempdir().expect("a folder");
        let plan = plan(setup(Name::Room, 4), &folder, 200);
        let recording = record(&plan, None, |_| true).expect("a file");
        assert_eq!((recording.frames, recording.stopped), (3, false));
        let mut source = McapFile::open(file(&plan), Topics::default()).expect("our own file");
        assert_eq!(source.camera(), d455());
        let truth: Vec<_> = source.truth().to_vec();
        assert_eq!(truth.len(), 3);
        let scene = Scene::generate(Name::Room, 4);
        for true_pose in truth {
            let frame = source
                .next_frame()
                .expect("readable")
                .expect("as many as poses");
            assert_eq!(frame.at, true_pose.at);
            let pose = crate::flight::world_from_camera(frame.at, 4);
            let off = pose.raw.translation.vector - true_pose.pose.translation.vector;
            assert!(off.norm() < 1e-12);
            let picture = render(&scene, frame.at, &d455(), pose);
            let drawn = expose(&picture, &d455(), INDOORS_M, 4);
            assert!(drawn.rgb == frame.rgb, "colour at {}", frame.at);
            let depths = drawn.depth_m.iter().zip(&frame.depth_m);
            let worst = depths.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-6, "depth is whole millimetres already: {worst}");
        }
    }

    #[test]
    fn a_recording_has_the_same_bytes_each_time_and_on_any_number_of_threads() {
        let folder = tempfile::tempdir().expect("a folder");
        let bytes = |scene: Name, seed: u64, threads: usize| {
            let mut setup = setup(scene, seed);
            setup.masks = true;
            let plan = plan(setup, &folder, 200);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("threads")
                .install(|| record(&plan, None, |_| true))
                .expect("a file");
            std::fs::read(file(&plan)).expect("what was written")
        };
        for scene in [Name::Room, Name::UrbanArterial] {
            let once = bytes(scene, 1100, 1);
            assert!(once == bytes(scene, 1100, 1), "{scene}: twice");
            assert!(once == bytes(scene, 1100, 2), "{scene}: two threads");
            assert!(once != bytes(scene, 1101, 1), "{scene}: another seed");
        }
    }

    #[test]
    fn a_stopped_recording_is_whole_up_to_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let plan = plan(setup(Name::Room, 1), &folder, 99_999);
        let recording = record(&plan, None, |done| done.as_millis() < 200).expect("a file");
        assert_eq!((recording.frames, recording.stopped), (3, true));
        let source = McapFile::open(file(&plan), Topics::default()).expect("finished");
        assert_eq!(source.frame_count(), Some(3));
    }

    #[test]
    fn the_recording_of_a_run_has_the_way_and_the_frames_of_the_run_and_ends_with_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut setup = setup(Name::ResidentialAlley, 1);
        setup.aboard = vec!["uav/camera".to_owned()];
        let plan = plan(setup, &folder, 99_999);
        let pose = |step: u32| {
            let east = 0.1 * f64::from(step);
            Isometry::claim(Isometry3::translation(east, 2.0, 5.0))
        };
        let way = Arc::new(Way::new(TICK, pose(0)));
        (1..=40).for_each(|step| way.push(pose(step)));
        way.end();
        let (heard, frames) = sync_channel(60);
        let mut encoder = Encoder::new(ROVER);
        let sent: Vec<Heard> = (0..60)
            .map(|step| Heard {
                at: Stamp::ZERO + TICK * step,
                vehicle: "rover",
                is_sent: step % 2 == 0,
                frame: encoder.encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default())),
            })
            .collect();
        for frame in &sent {
            heard.send(frame.clone()).expect("the recorder listens");
        }
        let follow = Follow {
            ways: vec![(Platform::Uav, Arc::clone(&way))],
            frames,
        };
        let recording = record(&plan, Some(&follow), |_| true).expect("a file");
        // 0.8 s, of which the last 0.12 s cannot be looked ahead of.
        assert!(
            (recording.seconds - 0.68).abs() < 1e-9,
            "{}",
            recording.seconds
        );
        assert!(!recording.stopped, "it ended with the run");
        assert_eq!(recording.messages["/mavlink/rover"], 34);
        let source = McapFile::open(file(&plan), Topics::default()).expect("our own file");
        let scene = Scene::generate(Name::ResidentialAlley, 1);
        let mount = crate::platform::body_from_uav_camera(&scene);
        for truth in source.truth() {
            let expected = (way.pose(truth.at) * mount).raw;
            let off = expected.translation.vector - truth.pose.translation.vector;
            assert!(off.norm() < 1e-9, "at {}", truth.at);
        }
        assert_eq!(source.truth().len(), 11);
    }
}
