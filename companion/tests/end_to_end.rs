//! From camera frames to the same map in the ground station, through everything but sockets.

mod room;

use std::error::Error as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver as Queue, sync_channel};
use std::time::Duration;

use companion::clock::Clock;
use companion::config::{Config, DetectorKind, DetectorSettings, Pace, Settings};
use companion::event::{Action, Event, LinkId};
use companion::figures::Figures;
use companion::pipeline::detecting::{DetectorFigures, Lookout};
use companion::pipeline::uav::Mapper;
use companion::pipeline::{Pipeline, Plan};
use companion::replay::{Continue, Progress, replay};
use companion::step::Companion;
use maps::camera::Pinhole;
use maps::tile::Tile;
use maps::time::Stamp;
use maps::voxel::VoxelMap;
use mavlink_ext::dialect::tandem::{HEARTBEAT_DATA, MavAutopilot, MavType};
use mavlink_ext::object::digest::{Asker, Item};
use mavlink_ext::object::{Receiver, ReceiverLimits};
use mavlink_ext::{Address, Encoder, Message};
use perception::{Class, DetectError, Detection, Detector, Image};
use room::Room;
use sensors::RgbdSource as _;
use sensors::mcap::{Topics, Writer};

const STATION: Address = Address::new(255, 190);
const FRAMES: usize = 45;

fn settings(out: &Path, source: &Path) -> Settings {
    let mut config = Config::default();
    source.clone_into(&mut config.source.path);
    config.source.pace = Pace::Fast;
    config.map.tile_period_s = 0.5;
    out.clone_into(&mut config.output.dir);
    config.check().expect("sound")
}

/// A ground station that only receives the map.
struct Station {
    encoder: Encoder,
    receiver: Receiver,
    asker: Asker,
    map: VoxelMap,
    status: Option<(u64, u8)>,
}

impl Station {
    fn new(resolution_m: f64) -> Self {
        Self {
            encoder: Encoder::new(STATION),
            receiver: Receiver::new(STATION, 1, ReceiverLimits::default()),
            asker: Asker::new(STATION, 1),
            map: VoxelMap::new(resolution_m),
            status: None,
        }
    }

    fn hear(&mut self, now: Stamp, message: &Message) -> Vec<Message> {
        if let Message::TANDEM_STATUS(status) = message {
            self.status = Some((status.map_digest, status.flags));
        }
        let from = Address::new(1, 191);
        self.asker.handle(now, from, message);
        let step = self.receiver.handle(now, from, message);
        for received in step.events {
            let tile = Tile::decode(&received.bytes).expect("a sound tile");
            self.map.set_tile(&tile).expect("of our resolution");
            let item = Item::new(tile.version, &received.bytes);
            self.asker.has(now, from, tile.id, item);
        }
        step.send
    }
}

/// Companion and station until the map has arrived: simulated time that goes on 10 ms at a time, and events as they come.
fn fly(settings: &Settings, events: &Queue<(Stamp, Event)>, figures: Figures) -> Station {
    let mut companion = Companion::new(settings, figures, 1);
    let mut station = Station::new(settings.mapping.resolution_m);
    let beat = Message::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        ..HEARTBEAT_DATA::default()
    });
    let mut ended = false;
    for tick in 0..20_000_u64 {
        let now = Stamp::from_nanos(tick * 10_000_000);
        let mut inbox = Vec::new();
        if tick % 100 == 0 {
            inbox.push(beat.clone());
        }
        let mut happened = vec![Event::Tick];
        // Until the source has ended real threads are waited for; what they take is not what this test measures.
        if !ended && let Ok((_, event)) = events.recv_timeout(Duration::from_mins(1)) {
            ended = matches!(event, Event::SourceEnded(_));
            happened.push(event);
        }
        let mut reports = station.receiver.tick(now).send;
        reports.extend(station.asker.tick(now));
        for message in inbox.into_iter().chain(reports) {
            let frame = station.encoder.encode(&message);
            happened.push(Event::Received(LinkId::Ground, frame));
        }
        for event in happened {
            let mut answers = Vec::new();
            companion.step(now, event, |action| {
                if let Action::Send(LinkId::Ground, frame) = action {
                    let message = frame.decode().expect("our own");
                    answers.extend(station.hear(now, &message));
                }
            });
            for answer in answers {
                let frame = station.encoder.encode(&answer);
                companion.step(now, Event::Received(LinkId::Ground, frame), |_| ());
            }
        }
        let source_finished_and_all_delivered = 3;
        if station
            .status
            .is_some_and(|(_, flags)| flags & 3 == source_finished_and_all_delivered)
        {
            return station;
        }
    }
    panic!(
        "the map has not arrived after 200 s, status {:?}",
        station.status
    );
}

#[test]
fn the_ground_station_ends_up_with_the_map_of_the_companion() {
    let folder = tempfile::tempdir().expect("a folder");
    let settings = settings(folder.path(), Path::new("unused"));
    let room = Room::new(FRAMES);
    let figures = Figures::new(room.name(), room.frame_count(), &settings.mapping);
    let (sender, events) = sync_channel(4);
    let plan = Plan {
        mapping: settings.mapping,
        lookout: None,
        pace: Pace::Fast,
        out: settings.out.clone(),
    };
    let pipeline = Pipeline::start(Box::new(room), plan, Clock::start(), sender).expect("threads");
    let station = fly(&settings, &events, figures);
    drop(events);
    drop(pipeline);
    let (digest, _) = station.status.expect("told");
    assert_eq!(station.map.digest().0, digest);
    // The floor and four walls within 5 m, of voxels of 0.05 m.
    let occupied = station.map.occupied_count();
    assert!(occupied > 3000, "{occupied} voxels of a room");
    for name in ["trajectory.txt", "map.ot", "map_color.ot", "map.bt"] {
        let length = std::fs::metadata(folder.path().join(name))
            .expect(name)
            .len();
        assert!(length > 500, "{name} has {length} bytes");
    }
}

#[test]
fn the_room_is_mapped_where_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let settings = settings(folder.path(), Path::new("unused"));
    let mut room = Room::new(FRAMES);
    let mut mapper = Mapper::new(room.camera(), &settings.mapping, None);
    while let Some(frame) = room.next_frame().expect("drawn") {
        mapper.track(&frame).expect("of the camera's size");
        mapper.insert_settled();
    }
    mapper.finish();
    let low = mapper
        .map()
        .occupied()
        .map(|(key, _)| mapper.map().center_of(key).raw.z);
    let (mut floor, mut below) = (0, 0);
    for z in low {
        floor += usize::from(z.abs() < 0.1);
        below += usize::from(z < -0.1);
    }
    assert!(floor > 500, "{floor} voxels of floor at z = 0");
    assert!(
        below * 50 < floor,
        "{below} voxels below the floor, {floor} on it"
    );
}

/// Records the room as `sitl` does.
fn record(path: &Path, frames: usize) {
    let mut room = Room::new(frames);
    let truth = room.truth().to_vec();
    let mut writer = Writer::create(path, &Topics::default()).expect("creates");
    writer.camera(truth[0].at, &room.camera()).expect("camera");
    for pose in &truth {
        let world_from_camera = maps::frame::Isometry::claim(pose.pose);
        writer.truth(pose.at, &world_from_camera).expect("truth");
        let frame = room.next_frame().expect("drawn").expect("as many as poses");
        writer.frame(&frame).expect("frame");
    }
    writer.finish().expect("finishes");
}

#[test]
fn a_replay_is_exact_and_close_to_the_truth() {
    let folder = tempfile::tempdir().expect("a folder");
    let recording = folder.path().join("room.mcap");
    record(&recording, FRAMES);
    let run = |name: &str| {
        let settings = settings(&folder.path().join(name), &recording);
        replay(&settings, Clock::start(), |_| Continue::Yes).expect("replays")
    };
    let (first, second) = (run("a"), run("b"));
    assert_eq!(
        first.map_digest, second.map_digest,
        "the same recording, the same map"
    );
    assert_eq!(
        (first.frames, first.recording.as_str()),
        (FRAMES as u64, "room")
    );
    assert!(
        first.source_finished && first.tracked_share > 0.95,
        "{first:?}"
    );
    let ate_m = first.ate_rmse_m.expect("there is truth");
    assert!(
        ate_m < 0.03,
        "{ate_m} m over a path of a third of a metre, depth to the millimetre"
    );
    for name in [
        "report.json",
        "trajectory.txt",
        "map.ot",
        "map_color.ot",
        "map.bt",
    ] {
        let [a, b] = ["a", "b"].map(|run| std::fs::read(folder.path().join(run).join(name)));
        let (a, b) = (a.expect(name), b.expect(name));
        assert!(!a.is_empty() && (name == "report.json" || a == b), "{name}");
    }
    let table = std::fs::read_to_string(folder.path().join("a/frames.csv")).expect("a table");
    assert_eq!(table.lines().count(), 1 + FRAMES, "a line for each frame");
}

/// Takes the middle of each image for a person, whatever is there.
struct Believer;

impl Detector for Believer {
    fn detect(&self, image: &Image<'_>) -> Result<Vec<Detection>, DetectError> {
        let camera = Room::new(1).camera();
        assert_eq!(image.rgb().len(), camera.width * camera.height);
        let [width, height] = [camera.width, camera.height].map(|side| side as f32);
        Ok(vec![Detection {
            class: Class::named("person").expect("COCO knows people"),
            score: 0.9,
            bounds_px: [0.4 * width, 0.3 * height, 0.6 * width, 0.6 * height],
        }])
    }
}

#[test]
fn what_a_detector_names_is_not_in_the_map_and_the_map_is_always_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let settings = settings(folder.path(), Path::new("unused"));
    let map = |detector: Option<Believer>| {
        let mut room = Room::new(FRAMES);
        let lookout = detector.map(|detector| Lookout::new(Arc::new(detector), 3));
        let mut mapper = Mapper::new(room.camera(), &settings.mapping, lookout);
        while let Some(frame) = room.next_frame().expect("drawn") {
            mapper.track(&frame).expect("of the camera's size");
            mapper.insert_settled();
        }
        mapper.finish();
        (mapper.figures(), mapper.detector())
    };
    let (first, looks) = map(Some(Believer));
    assert_eq!(first.digest, map(Some(Believer)).0.digest);
    let (without, none) = map(None);
    assert!(first.voxels_occupied < without.voxels_occupied);
    assert_eq!(none, None);
    // The answer to the last look is not due any more.
    let frames = FRAMES as u64 / 3 - 1;
    let expected = DetectorFigures {
        frames,
        objects: frames,
        failed: 0,
        unheard: 0,
    };
    assert_eq!(looks, Some(expected));
}

/// With the weights of `YOLOX` beside the repository, where they are there.
#[test]
fn a_replay_with_a_detector_is_exact() {
    let weights = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/data/weights/yolox_nano_bigisland.onnx"
    ));
    if !weights.exists() {
        println!("skipped: {} is not there", weights.display());
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let recording = folder.path().join("room.mcap");
    record(&recording, 12);
    let reports = ["a", "b"].map(|name| {
        let mut settings = settings(&folder.path().join(name), &recording);
        settings.detector = Some(DetectorSettings {
            kind: DetectorKind::Yolox,
            weights: weights.to_owned(),
            least_score: 0.3,
            every_frames: 3,
        });
        replay(&settings, Clock::start(), |_| Continue::Yes).expect("replays")
    });
    assert_eq!(reports[0].map_digest, reports[1].map_digest);
    let looks = reports[0].detector.expect("there is one");
    assert_eq!((looks.frames, looks.failed, looks.unheard), (3, 0, 0));
}

#[test]
fn weights_that_cannot_be_opened_end_a_replay_before_it_begins() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut settings = settings(folder.path(), Path::new("unused"));
    settings.detector = Some(DetectorSettings {
        kind: DetectorKind::FastestDet,
        weights: folder.path().join("missing.onnx"),
        least_score: 0.65,
        every_frames: 3,
    });
    let error = replay(&settings, Clock::start(), |_| Continue::Yes).expect_err("no weights");
    assert!(error.to_string().contains("[detector]"), "{error}");
    let cause = error.source().expect("why").to_string();
    assert!(cause.contains("missing.onnx"), "{cause}");
}

#[test]
fn a_replay_that_is_stopped_leaves_what_there_was() {
    let folder = tempfile::tempdir().expect("a folder");
    let recording = folder.path().join("room.mcap");
    record(&recording, 6);
    let settings = settings(&folder.path().join("out"), &recording);
    let stop_at_three = |progress: Progress| {
        if progress.frames < 3 {
            Continue::Yes
        } else {
            Continue::No
        }
    };
    let report = replay(&settings, Clock::start(), stop_at_three).expect("stops");
    assert_eq!((report.frames, report.source_finished), (3, false));
    assert!(folder.path().join("out/report.json").exists());
}

/// The first second of TUM's `freiburg1_rpy` beside the repository; the room is its twin where it is absent.
#[test]
fn a_real_office_is_tracked() {
    let source = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/data/rgbd/tum_fr1_rpy_a"
    ));
    if !source.exists() {
        println!("skipped: {} is not there", source.display());
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let mut settings = settings(folder.path(), source);
    settings.source.camera = Pinhole {
        width: 640,
        height: 480,
        fx: 517.306_408,
        fy: 516.469_215,
        cx: 318.643_040,
        cy: 255.313_989,
        distortion: [0.262_383, -0.953_104, -0.005_358, 0.002_628, 1.163_314],
    };
    let a_second = |progress: Progress| {
        if progress.frames < 30 {
            Continue::Yes
        } else {
            Continue::No
        }
    };
    let report = replay(&settings, Clock::start(), a_second).expect("replays");
    assert_eq!(report.frames, 30);
    assert!(report.tracked_share > 0.9, "{report:?}");
    assert!(report.map_voxels_occupied > 1000, "{report:?}");
    let ate_m = report.ate_rmse_m.expect("there is truth");
    assert!(ate_m < 0.1, "{ate_m} m in the first second");
}
