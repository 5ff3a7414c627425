//! The viewer: the scene in three dimensions, what each sensor sees, and a time line.
//!
//! - [`app`]: the state and its panels; [`time_line`], [`eye`]: when and from where; [`world`]: what a run tells of its vehicles.
//! - [`worker`], [`sensors`]: exact pictures on a thread of their own; [`sketch`]: what is drawn over the scene.
//! - [`gpu`], [`pipelines`]: the 3-D view on the graphics card; [`window`], [`headless`]: where it is shown.
//!
//! It belongs to the program and not to the library, so that whoever simulates without looking links no window.

mod app;
mod eye;
mod gpu;
mod headless;
mod pipelines;
mod sensors;
mod sketch;
mod time_line;
mod window;
mod worker;
mod world;

use std::path::PathBuf;
use std::thread;

use anyhow::Context as _;
use clap::Args;
use maps::time::Stamp;
use sitl::scene::Name;

use app::{Follow, Layer, Layers, Start};
use sensors::{Kind, Tab};
use sketch::Colouring;
use world::History;
pub(crate) use world::Teller;

/// Width and height of the window.
const SIZE: [u32; 2] = [1440, 860];
/// What can be asked for.
const SIZES: std::ops::RangeInclusive<u32> = 320..=8192;

/// What to show, and how.
#[derive(Args, Debug)]
pub(crate) struct ViewArgs {
    /// The scene.
    #[arg(long, value_enum, default_value = "urban-arterial")]
    scene: Name,
    /// Seed of the scene and all noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Simulated time to start at.
    #[arg(long, value_name = "SECONDS", value_parser = moment, default_value = "8")]
    at: Stamp,
    /// Opens no window: draws what it would show, as a PNG. Works without a display.
    #[arg(long, value_name = "FILE")]
    screenshot: Option<PathBuf>,
    /// Of the window or the picture, in pixels. Default: 1440x860.
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Whose sensors are shown beside the scene.
    #[arg(long, value_enum, default_value = "drone")]
    sensor: Tab,
    /// What of their pictures.
    #[arg(long, value_enum, default_value = "colour")]
    picture: Kind,
    /// Where the eye is. Default: along with the ground vehicle, free in the room.
    #[arg(long, value_enum)]
    eye: Option<Follow>,
    /// What is drawn. Default: surfaces, boxes, frustum, lidar.
    #[arg(long = "layer", value_enum)]
    layers: Vec<Layer>,
    /// What the colours of `LiDAR` returns say.
    #[arg(long, value_enum, default_value = "intensity")]
    lidar_by: Colouring,
}

impl ViewArgs {
    fn start(&self) -> Start {
        let mut layers = Layers {
            colouring: self.lidar_by,
            ..Layers::default()
        };
        if !self.layers.is_empty() {
            layers.shown = Layer::ALL.map(|(layer, _)| self.layers.contains(&layer));
        }
        Start {
            scene: (self.scene, self.seed),
            at: self.at,
            tab: self.sensor,
            kind: self.picture,
            follow: self.eye,
            layers,
        }
    }
}

/// Shows a scene with the vehicles that it has.
pub(crate) fn alone(args: &ViewArgs) -> anyhow::Result<()> {
    let size = args.size.unwrap_or(SIZE);
    match &args.screenshot {
        Some(file) => headless::screenshot(args.start(), size, file),
        None => window::show(args.start(), None, size, || false),
    }
}

/// Shows a scene without vehicles of a run.
pub(crate) fn of(scene: Name, seed: u64) -> anyhow::Result<()> {
    let start = Start {
        scene: (scene, seed),
        ..Start::default()
    };
    window::show(start, None, SIZE, || false)
}

/// Shows the scene of a run, and its vehicles where they truly are. `work` runs on a thread of its own, since windows want the
/// main one, and tells of its vehicles; `stop` makes it end when the window is closed. Its end closes the window.
pub(crate) fn beside(
    scene: (Name, u64),
    stop: impl FnOnce(),
    work: impl FnOnce(Teller) -> anyhow::Result<()> + Send + 'static,
) -> anyhow::Result<()> {
    let start = Start {
        scene,
        ..Start::default()
    };
    alongside(stop, work, |history, has_ended| {
        window::show(start, Some(history), SIZE, has_ended)
    })
}

/// `work` on a thread, `show` on this one until it returns or the work has ended.
fn alongside(
    stop: impl FnOnce(),
    work: impl FnOnce(Teller) -> anyhow::Result<()> + Send + 'static,
    show: impl FnOnce(History, &dyn Fn() -> bool) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let (teller, history) = world::channel();
    let run = thread::Builder::new()
        .name("run".into())
        .spawn(move || work(teller))
        .context("cannot start a thread for the run")?;
    let shown = show(history, &|| run.is_finished());
    stop();
    let ran = run.join();
    shown?;
    ran.map_err(|_panic| anyhow::anyhow!("the run has stopped with a panic"))?
}

fn moment(text: &str) -> Result<Stamp, String> {
    let seconds: f64 = text
        .parse()
        .map_err(|_not_a_number| "not a number of seconds".to_owned())?;
    Stamp::from_secs_f64(seconds).ok_or_else(|| "it must be 0 or later, in seconds".to_owned())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text.split_once('x').and_then(|(width, height)| {
        let size = [width.parse().ok()?, height.parse().ok()?];
        size.iter().all(|n| SIZES.contains(n)).then_some(size)
    });
    parsed.ok_or_else(|| {
        let (least, most) = (SIZES.start(), SIZES.end());
        format!("expected WIDTHxHEIGHT with {least} to {most} pixels each, such as 1440x860")
    })
}

#[cfg(test)]
mod tests;
