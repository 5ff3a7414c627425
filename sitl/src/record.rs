//! Recording what the drone's camera sees, with the truth, as fast as the machine can draw it.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use maps::time::Stamp;
use sensors::mcap::{Topics, WriteError, Writer};
use serde::Serialize;

use crate::depth_camera::{INDOORS_M, OUTDOORS_M, d455, expose};
use crate::platform;
use crate::render::Stage;
use crate::scene::{Name, Scene};

/// Pictures per second, one of the camera's own rates.
const RATE_HZ: u64 = 15;

/// What to record.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The scene.
    pub scene: Name,
    /// Seed of the scene and of all noise.
    pub seed: u64,
    /// The file.
    pub file: PathBuf,
    /// How long.
    pub duration: Duration,
}

/// What was recorded.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recording {
    /// The file.
    pub file: PathBuf,
    /// How many pictures.
    pub frames: u64,
    /// Simulated time that they cover.
    pub seconds: f64,
    /// Whether it was stopped before its end.
    pub stopped: bool,
}

/// Draws and writes every picture, until the end or until `go_on` says no: it is asked before every picture and told
/// how many there are.
pub fn record(plan: &Plan, mut go_on: impl FnMut(u64) -> bool) -> Result<Recording, WriteError> {
    let scene = Scene::generate(plan.scene, plan.seed);
    let stage = Stage::new(&scene);
    let camera = d455();
    let reach_m = if plan.scene == Name::Room {
        INDOORS_M
    } else {
        OUTDOORS_M
    };
    let mut writer = Writer::create(&plan.file, &Topics::default())?;
    writer.describe("simulation", description(plan))?;
    let total = frames_in(plan.duration);
    let mut frames = 0;
    while frames < total && go_on(frames) {
        let at = stamp_of(frames);
        let pose = platform::uav_camera(&scene, at, plan.seed);
        let picture = stage.at(at).picture(&camera, pose);
        if frames % RATE_HZ == 0 {
            writer.camera(at, &camera)?;
        }
        writer.truth(at, &pose)?;
        writer.frame(&expose(&picture, &camera, reach_m, plan.seed))?;
        frames += 1;
    }
    writer.finish()?;
    Ok(Recording {
        file: plan.file.clone(),
        frames,
        seconds: stamp_of(frames).as_secs_f64(),
        stopped: frames < total,
    })
}

/// How many pictures that time has.
pub fn frames_in(duration: Duration) -> u64 {
    (duration.as_secs_f64() * RATE_HZ as f64).ceil() as u64
}

fn stamp_of(frame: u64) -> Stamp {
    Stamp::from_nanos(frame * 1_000_000_000 / RATE_HZ)
}

fn description(plan: &Plan) -> BTreeMap<String, String> {
    let version = env!("CARGO_PKG_VERSION");
    [
        ("scene", plan.scene.to_string()),
        ("seed", plan.seed.to_string()),
        ("made_by", format!("sitl {version}")),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use sensors::RgbdSource as _;
    use sensors::mcap::McapFile;

    use crate::render::render;

    #[test]
    fn a_recording_reads_back_as_the_frames_and_truth_that_were_drawn() {
        let folder = tempfile::tempdir().expect("a folder");
        let plan = Plan {
            scene: Name::Room,
            seed: 4,
            file: folder.path().join("room.mcap"),
            duration: Duration::from_millis(200),
        };
        let recording = record(&plan, |_| true).expect("a file");
        assert_eq!((recording.frames, recording.stopped), (3, false));
        let mut source = McapFile::open(&plan.file, Topics::default()).expect("our own file");
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
            assert!(
                (pose.raw.translation.vector - true_pose.pose.translation.vector).norm() < 1e-12
            );
            let drawn = expose(
                &render(&scene, frame.at, &d455(), pose),
                &d455(),
                INDOORS_M,
                4,
            );
            assert!(drawn.rgb == frame.rgb, "colour at {}", frame.at);
            let worst = drawn
                .depth_m
                .iter()
                .zip(&frame.depth_m)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f32::max);
            assert!(worst < 1e-6, "depth is whole millimetres already: {worst}");
        }
    }

    #[test]
    fn a_recording_has_the_same_bytes_each_time_and_on_any_number_of_threads() {
        let folder = tempfile::tempdir().expect("a folder");
        let bytes = |scene: Name, seed: u64, threads: usize| {
            let file = folder.path().join("scene.mcap");
            let plan = Plan {
                scene,
                seed,
                file: file.clone(),
                duration: Duration::from_millis(200),
            };
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads");
            pool.install(|| record(&plan, |_| true)).expect("a file");
            std::fs::read(file).expect("what was written")
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
        let plan = Plan {
            scene: Name::Room,
            seed: 1,
            file: folder.path().join("room.mcap"),
            duration: Duration::from_secs(100),
        };
        let recording = record(&plan, |frames| frames < 2).expect("a file");
        assert_eq!((recording.frames, recording.stopped), (2, true));
        let source = McapFile::open(&plan.file, Topics::default()).expect("finished");
        assert_eq!(source.frame_count(), Some(2));
    }
}
