//! Replays a recording in TUM layout and says how well and how fast the SLAM tracks it.
//!
//! ```text
//! cargo run --release -p slam --example replay -- FOLDER bonn|tum-fr1|d455 [--frames N] [--pictures DIR]
//!     [--ignore-moving | --paper | --baseline] [--objects FILE] [--max-depth M]
//! ```
//!
//! `d455` is the simulator's depth camera, with depth in millimetres.
//!
//! `--paper` and `--baseline` are methods to compare with: `Moving::Paper`, and `Moving::Ignore` with
//! `Mapping::LastKeyframe`. The objects are those that a detector saw, one a line, as the example `detect` of
//! `perception` writes them: `stamp left top right bottom score mobility class`, in seconds, pixels and 0 to 1, with a
//! mobility of `static`, `movable`, `moving` or `unknown`. A line with a stamp alone says that the frame was looked at.
//!
//! Pictures: green points support the pose, red ones are rejected, red cells move; and every dense point from above.
#![expect(clippy::print_stdout, reason = "a command-line program")]

use std::collections::BTreeMap;
use std::error::Error;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use maps::camera::{Pinhole, RgbdFrame};
use maps::time::Stamp;
use maps::trajectory::evaluation::{self, Alignment, Delta, Tool};
use maps::trajectory::{Trajectory, tum};
use slam::{
    Aid, DenseKeyframe, DenseUpdate, Mapping, Mobility, Moving, Object, Seen, Settings, Slam,
    Stage, State, Tracked,
};

#[path = "../benches/tum/mod.rs"]
mod recording;

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

struct Arguments {
    folder: PathBuf,
    camera: Pinhole,
    depth_factor: f32,
    frames: usize,
    pictures: Option<PathBuf>,
    settings: Settings,
    /// What a detector saw in the frames that it looked at.
    objects: BTreeMap<Stamp, Vec<Object>>,
}

fn arguments() -> Result<Arguments> {
    let mut args = std::env::args().skip(1);
    let folder = args.next().ok_or("which folder?")?.into();
    let (camera, depth_factor) =
        camera(&args.next().ok_or("which camera: bonn, tum-fr1 or d455?")?)?;
    let mut parsed = Arguments {
        folder,
        camera,
        depth_factor,
        frames: usize::MAX,
        pictures: None,
        settings: Settings::default(),
        objects: BTreeMap::new(),
    };
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--frames" => parsed.frames = args.next().ok_or("how many frames?")?.parse()?,
            "--pictures" => parsed.pictures = Some(args.next().ok_or("pictures to where?")?.into()),
            "--ignore-moving" => parsed.settings.moving = Moving::Ignore,
            "--paper" => parsed.settings.moving = Moving::Paper,
            "--baseline" => {
                parsed.settings.moving = Moving::Ignore;
                parsed.settings.mapping = Mapping::LastKeyframe;
            }
            "--max-depth" => {
                let farthest = args.next().ok_or("how far is depth believed?")?;
                parsed.settings.max_depth_m = farthest.parse()?;
            }
            "--objects" => {
                parsed.objects = read_objects(&args.next().ok_or("objects from where?")?)?;
            }
            other => return Err(format!("unknown argument {other}").into()),
        }
    }
    Ok(parsed)
}

/// The camera, and the value of one of its depth pixels at 1 m.
fn camera(name: &str) -> Result<(Pinhole, f32)> {
    let (f, c, distortion, factor) = match name {
        "bonn" => return Ok((recording::BONN, recording::DEPTH_FACTOR)),
        "tum-fr1" => (
            [517.306_408, 516.469_215],
            [318.643_040, 255.313_989],
            [0.262_383, -0.953_104, -0.005_358, 0.002_628, 1.163_314],
            recording::DEPTH_FACTOR,
        ),
        "d455" => ([386.0; 2], [319.5, 239.5], [0.0; 5], 1000.0),
        other => return Err(format!("unknown camera {other}").into()),
    };
    let camera = Pinhole {
        width: 640,
        height: 480,
        fx: f[0],
        fy: f[1],
        cx: c[0],
        cy: c[1],
        distortion,
    };
    Ok((camera, factor))
}

fn read_objects(file: &str) -> Result<BTreeMap<Stamp, Vec<Object>>> {
    let mut objects: BTreeMap<Stamp, Vec<Object>> = BTreeMap::new();
    for line in fs::read_to_string(file)?.lines() {
        let wrong = || format!("{file}: not an object: {line}");
        let mut fields = line.split_whitespace();
        let stamp = fields.next().ok_or_else(wrong)?.parse()?;
        let at = Stamp::from_secs_f64(stamp).ok_or_else(wrong)?;
        let seen = objects.entry(at).or_default();
        let rest: Vec<&str> = fields.collect();
        let [left, top, right, bottom, score, mobility, ..] = rest[..] else {
            if rest.is_empty() {
                continue;
            }
            return Err(wrong().into());
        };
        seen.push(Object {
            mobility: match mobility {
                "moving" => Mobility::Dynamic,
                "movable" => Mobility::Potential,
                _ => Mobility::Static,
            },
            score: score.parse()?,
            bounds_px: [left.parse()?, top.parse()?, right.parse()?, bottom.parse()?],
            mask: None,
        });
    }
    Ok(objects)
}

fn main() -> Result<()> {
    let arguments = arguments()?;
    let mut slam = Slam::new(arguments.camera, arguments.settings.clone());
    let stages = Stages::default();
    stages.watch(&mut slam);
    let mut times: Vec<(Duration, bool)> = Vec::new();
    let mut outcomes: Vec<Tracked> = Vec::new();
    let mut dense = Vec::new();
    let frames =
        recording::frames(&arguments.folder, arguments.depth_factor)?.take(arguments.frames);
    for (i, frame) in frames.enumerate() {
        let frame = frame?;
        let objects = arguments.objects.get(&frame.at);
        let aid = Aid {
            objects: objects.map(|objects| Seen {
                of: frame.at,
                objects,
            }),
            ..Aid::default()
        };
        stages.start();
        let tracked = timed(&mut times, || slam.track_aided(&frame, &aid))?;
        take(&mut dense, slam.take_keyframes());
        if let Some(folder) = &arguments.pictures
            && i % 10 == 0
        {
            fs::create_dir_all(folder)?;
            overlay_picture(&folder.join(format!("{i:04}.png")), &frame, &slam)?;
        }
        if i % 50 == 0 || tracked.state != State::Tracking {
            let p = tracked.world_from_camera.translation();
            println!(
                "{i:4} {:?} points {} rejected {} moving {:.2} map {:?} at {:.2} {:.2} {:.2} sigma {:.4} m",
                tracked.state,
                tracked.points,
                tracked.rejected,
                tracked.moving_share,
                slam.map_size(),
                p.raw.x,
                p.raw.y,
                p.raw.z,
                tracked.covariance[(0, 0)].sqrt()
            );
        }
        times.last_mut().ok_or("no time")?.1 = tracked.keyframe;
        outcomes.push(tracked);
    }
    take(&mut dense, slam.finish());
    report(&outcomes, &times, &dense);
    stages.report();
    accuracy(&arguments.folder, &slam, &outcomes)?;
    if let Some(folder) = &arguments.pictures {
        map_picture(&folder.join("map.png"), &dense)?;
    }
    Ok(())
}

fn take(dense: &mut Vec<DenseKeyframe>, update: DenseUpdate) {
    if update.anew {
        println!(
            "poses were corrected, {} keyframes anew",
            update.keyframes.len()
        );
        dense.clear();
    }
    dense.extend(update.keyframes);
}

/// Milliseconds spent in each stage.
#[derive(Clone)]
struct Stages(Arc<Mutex<(Instant, [Vec<f64>; Stage::ALL.len()])>>);

#[expect(
    clippy::disallowed_methods,
    reason = "a program that measures speed reads the clock"
)]
impl Default for Stages {
    fn default() -> Self {
        Self(Arc::new(Mutex::new((Instant::now(), Default::default()))))
    }
}

#[expect(
    clippy::disallowed_methods,
    reason = "a program that measures speed reads the clock"
)]
impl Stages {
    fn watch(&self, slam: &mut Slam) {
        let stages = self.clone();
        slam.watch(move |stage| {
            if let Ok(mut state) = stages.0.lock() {
                let now = Instant::now();
                let ms = 1e3 * (now - state.0).as_secs_f64();
                state.0 = now;
                state.1[stage as usize].push(ms);
            }
        });
    }

    fn start(&self) {
        if let Ok(mut state) = self.0.lock() {
            state.0 = Instant::now();
        }
    }

    fn report(&self) {
        let Ok(state) = self.0.lock() else { return };
        for (stage, ms) in Stage::ALL.iter().zip(&state.1) {
            let mut ms = ms.clone();
            ms.sort_by(f64::total_cmp);
            let mean = ms.iter().sum::<f64>() / ms.len().max(1) as f64;
            let last = ms.last().copied().unwrap_or(0.0);
            let p99 = ms.get(ms.len() * 99 / 100).copied().unwrap_or(last);
            println!(
                "{stage:?}: {} times, mean {mean:.2} ms, p99 {p99:.1} ms",
                ms.len()
            );
        }
    }
}

#[expect(
    clippy::disallowed_methods,
    reason = "a program that measures speed reads the clock"
)]
fn timed<T>(times: &mut Vec<(Duration, bool)>, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    times.push((start.elapsed(), false));
    result
}

fn report(outcomes: &[Tracked], times: &[(Duration, bool)], dense: &[DenseKeyframe]) {
    let tracked = outcomes
        .iter()
        .filter(|o| o.state == State::Tracking)
        .count();
    let rejecting = outcomes.iter().filter(|o| o.moving_share > 0.0).count();
    println!(
        "frames {} tracked share {:.4} resets {} frames with rejection {:.3}",
        outcomes.len(),
        tracked as f64 / outcomes.len().max(1) as f64,
        outcomes.last().map_or(0, |o| o.reset_counter),
        rejecting as f64 / outcomes.len().max(1) as f64
    );
    let stage = |name: &str, keyframe: Option<bool>| {
        let mut ms: Vec<f64> = times
            .iter()
            .filter(|t| keyframe.is_none_or(|k| t.1 == k))
            .map(|t| 1e3 * t.0.as_secs_f64())
            .collect();
        ms.sort_by(f64::total_cmp);
        let mean = ms.iter().sum::<f64>() / ms.len().max(1) as f64;
        let at = |q: f64| {
            ms.get((q * ms.len() as f64) as usize)
                .copied()
                .unwrap_or(0.0)
        };
        println!(
            "{name}: {} mean {mean:.1} p50 {:.1} p95 {:.1} p99 {:.1} ms, {:.1} frames/s",
            ms.len(),
            at(0.5),
            at(0.95),
            at(0.99),
            1e3 / mean
        );
    };
    stage("all frames", None);
    stage("tracking only", Some(false));
    stage("with keyframe", Some(true));
    let points: usize = dense.iter().map(|d| d.points().count()).sum();
    println!("dense keyframes {} points {points}", dense.len());
}

/// The absolute error as the TUM benchmark has it, and the relative one as `evo` has it.
fn accuracy(folder: &Path, slam: &Slam, outcomes: &[Tracked]) -> Result<()> {
    let truth = tum::parse(&fs::read_to_string(folder.join("groundtruth.txt"))?)?;
    let estimate = Trajectory::new(slam.trajectory())?;
    let live = outcomes.iter().filter(|o| o.state == State::Tracking);
    let variance = |o: &Tracked| o.covariance.fixed_view::<3, 3>(0, 0).trace();
    let mean = live.clone().map(variance).sum::<f64>() / live.clone().count().max(1) as f64;
    println!(
        "told standard deviation of the position, RMS {:.4} m",
        mean.sqrt()
    );
    let live = Trajectory::new(live.map(|o| (o.at, o.world_from_camera)).collect())?;
    let ate = |poses| evaluation::ate(&truth, poses, Tool::TumBenchmark, Alignment::Rigid);
    println!(
        "ATE RMSE {:.4} m, of the poses as first told {:.4} m",
        ate(&estimate)?.rmse,
        ate(&live)?.rmse
    );
    let rpe = |frames| evaluation::rpe(&truth, &estimate, Delta::EveryFrames(frames));
    println!(
        "RPE over one frame {:.4} m, over 30 frames {:.4} m",
        rpe(1)?.translation_m.rmse,
        rpe(30)?.translation_m.rmse
    );
    Ok(())
}

fn overlay_picture(path: &Path, frame: &RgbdFrame, slam: &Slam) -> Result<()> {
    let overlay = slam.overlay();
    let mut rgb = frame.rgb.clone();
    for (i, pixel) in rgb.iter_mut().enumerate() {
        let (x, y) = (
            i % frame.width / overlay.cell_px,
            i / frame.width / overlay.cell_px,
        );
        if overlay.moving.get(y * overlay.cells_across + x) == Some(&true) {
            pixel[0] = 128 + pixel[0] / 2;
            pixel[1] /= 2;
            pixel[2] /= 2;
        }
    }
    let mut dot = |at: [f32; 2], color: [u8; 3]| {
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (at[0] as usize + dx, at[1] as usize + dy);
            if x < frame.width && y < frame.height {
                rgb[y * frame.width + x] = color;
            }
        }
    };
    overlay.rejected.iter().for_each(|&at| dot(at, [255, 0, 0]));
    overlay.tracked.iter().for_each(|&at| dot(at, [0, 255, 0]));
    write_png(path, (frame.width, frame.height), &rgb)
}

/// All dense points from above, higher ones over lower ones, below 2 m, one pixel each 2 cm.
fn map_picture(path: &Path, dense: &[DenseKeyframe]) -> Result<()> {
    let side = 600;
    let mut rgb = vec![[20; 3]; side * side];
    let mut top = vec![f64::NEG_INFINITY; side * side];
    for keyframe in dense {
        for (p, color) in keyframe.points() {
            let p = (keyframe.world_from_camera * p).raw;
            let (x, y) = (100.0 + 50.0 * p.x, 300.0 - 50.0 * p.y);
            if x < 0.0 || y < 0.0 || x >= side as f64 || y >= side as f64 || p.z > 2.0 {
                continue;
            }
            let at = y as usize * side + x as usize;
            if p.z > top[at] {
                (top[at], rgb[at]) = (p.z, color);
            }
        }
    }
    write_png(path, (side, side), &rgb)
}

fn write_png(path: &Path, (width, height): (usize, usize), rgb: &[[u8; 3]]) -> Result<()> {
    let mut encoder = png::Encoder::new(
        BufWriter::new(File::create(path)?),
        width as u32,
        height as u32,
    );
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(rgb.as_flattened())?;
    writer.finish()?;
    std::io::stdout().flush()?;
    Ok(())
}
