//! How fast the SLAM is, by stage: as a drone runs it, with features sought ahead in one thread, tracking in a second and
//! the map adjusted in a third.
//!
//! ```text
//! cargo bench -p slam --bench speed [-- FOLDER]
//! ```
//!
//! Takes the crowd recording (640 x 480, people walking) from `../shared/data`, or a folder in the same layout; without,
//! rooms are rendered, which says little of real images. Frames are decoded first, so that only the SLAM is timed.
//! Processor time does not depend on what else the machine does; frames/s do.
#![expect(clippy::print_stdout, reason = "a command-line program")]
#![expect(clippy::disallowed_methods, reason = "it measures time")]

use std::error::Error;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use maps::camera::{Pinhole, RgbdFrame};
use rustix::time::{ClockId, clock_gettime};
use slam::{Ahead, FrontEnd, Settings, Slam, Stage, State};

#[path = "../tests/rooms/scene.rs"]
#[expect(dead_code, reason = "the tests use more of it")]
mod scene;
mod tum;

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// Frames that are enough to see people come and go, and fit into memory.
const FRAMES: usize = 450;
/// Passes over the recording; the best counts, others were disturbed.
const PASSES: usize = 3;

fn main() -> Result<()> {
    let (name, camera, frames) = recording()?;
    println!(
        "{name}: {} frames of {} x {}",
        frames.len(),
        camera.width,
        camera.height
    );
    let frames = Arc::new(frames);
    println!("stage      times  cpu ms: mean   p99");
    for (stage, mut ms) in Stage::ALL.into_iter().zip(by_stage(camera, &frames)?) {
        ms.sort_by(f64::total_cmp);
        let mean = ms.iter().sum::<f64>() / ms.len().max(1) as f64;
        let p99 = ms.get(ms.len() * 99 / 100).copied().unwrap_or(0.0);
        println!(
            "{:<10} {:>5}  {mean:>12.2}  {p99:>4.1}",
            format!("{stage:?}"),
            ms.len()
        );
    }
    let passes = (0..PASSES).map(|_| pipelined(camera, &frames));
    let passes = passes.collect::<Result<Vec<Pass>>>()?;
    let best = passes
        .iter()
        .max_by(|a, b| a.fps.total_cmp(&b.fps))
        .ok_or("no pass")?;
    println!(
        "pipelined: {:.1} frames/s, latency of tracking p50 {:.1} p99 {:.1} ms, {:.1} ms of processor time a frame (all threads), {} of {} tracked",
        best.fps,
        best.p50_ms,
        best.p99_ms,
        best.cpu_ms,
        best.tracked,
        frames.len()
    );
    Ok(())
}

fn recording() -> Result<(String, Pinhole, Vec<RgbdFrame>)> {
    let named = std::env::args().skip(1).find(|a| !a.starts_with("--"));
    let shared =
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/rgbd/bonn_crowd_a");
    let folder = named.map_or(shared, PathBuf::from);
    if folder.is_dir() {
        let frames = tum::frames(&folder, tum::DEPTH_FACTOR)?
            .take(FRAMES)
            .collect::<Result<Vec<_>>>()?;
        return Ok((folder.display().to_string(), tum::BONN, frames));
    }
    let render = |i: u64| {
        let t = i as f64 / 30.0;
        let place = [0.15 * (1.3 * t).sin(), 0.4 * (0.8 * t).sin(), 1.2];
        scene::render(i, scene::looking(place, 0.25 * (0.9 * t).sin(), 0.35), &[])
    };
    Ok((
        "rendered rooms".into(),
        scene::CAMERA,
        (0..150).map(render).collect(),
    ))
}

fn cpu_ms(clock: ClockId) -> f64 {
    let t = clock_gettime(clock);
    1e3 * t.tv_sec as f64 + 1e-6 * t.tv_nsec as f64
}

/// Processor time of every stage, all in one thread; adjusting the map is left out.
fn by_stage(camera: Pinhole, frames: &[RgbdFrame]) -> Result<[Vec<f64>; Stage::ALL.len()]> {
    let mut slam = Slam::new(camera, Settings::default());
    let state = Arc::new(Mutex::new((0.0, <[Vec<f64>; Stage::ALL.len()]>::default())));
    let laps = Arc::clone(&state);
    slam.watch(move |stage| {
        if let Ok(mut laps) = laps.lock() {
            let now = cpu_ms(ClockId::ThreadCPUTime);
            let spent = now - laps.0;
            laps.0 = now;
            laps.1[stage as usize].push(spent);
        }
    });
    for frame in frames {
        state.lock().unwrap_or_else(PoisonError::into_inner).0 = cpu_ms(ClockId::ThreadCPUTime);
        slam.track(frame)?;
        slam.take_keyframes();
    }
    let laps = state.lock().unwrap_or_else(PoisonError::into_inner);
    Ok(laps.1.clone())
}

struct Pass {
    fps: f64,
    p50_ms: f64,
    p99_ms: f64,
    cpu_ms: f64,
    tracked: usize,
}

fn pipelined(camera: Pinhole, frames: &Arc<Vec<RgbdFrame>>) -> Result<Pass> {
    let mut slam = Slam::new(camera, Settings::default());
    let all = Arc::clone(frames);
    // Copying the frames is not part of it, but happens in a thread that has the time.
    let feed = (0..all.len()).map(move |i| Ok::<_, String>(all[i].clone()));
    let front_end = FrontEnd::new(camera, &Settings::default());
    let (started, cpu) = (Instant::now(), cpu_ms(ClockId::ProcessCPUTime));
    let (mut ms, mut tracked) = (Vec::new(), 0);
    for looked in Ahead::new(feed, front_end, 2)? {
        let (frame, look) = looked?;
        let before = Instant::now();
        let outcome = slam.track_look(&frame, look?, &slam::Aid::default())?;
        slam.take_keyframes();
        ms.push(1e3 * before.elapsed().as_secs_f64());
        tracked += usize::from(outcome.state == State::Tracking);
    }
    let count = frames.len() as f64;
    let fps = count / started.elapsed().as_secs_f64();
    let cpu_ms = (cpu_ms(ClockId::ProcessCPUTime) - cpu) / count;
    ms.sort_by(f64::total_cmp);
    Ok(Pass {
        fps,
        p50_ms: ms[ms.len() / 2],
        p99_ms: ms[ms.len() * 99 / 100],
        cpu_ms,
        tracked,
    })
}
