//! What can be asked for at the command line.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context as _;
use clap::{Args, Parser, Subcommand};
use maps::time::Stamp;
use sitl::camera_model::Optics;
use sitl::link::Profile;
use sitl::rig::Setup;
use sitl::run::Settings;
use sitl::scene::Name;
use sitl::sensor::clock::ClockModel;
use sitl::simulation::Start;
use sitl::wgs84::Origin;
use sitl::{bridge, dataset};

use crate::view;

/// A simulated world: streets and a room that are filmed, a copter and a rover with their autopilots.
#[derive(Parser)]
#[command(version)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Subcommand)]
pub(crate) enum Command {
    /// Runs vehicles in real time where they have links, and records as fast as it can.
    Run(Box<RunArgs>),
    /// Draws a contact sheet: what all sensors see of each scene, and the truth.
    Poster(PosterArgs),
    /// Writes training data with truth: what both vehicles see of streets, frame by frame. Goes on where it was ended.
    Dataset(dataset::cli::Args),
    /// Lets a real `ArduPilot` fly or drive in a scene, through its JSON interface.
    Bridge(bridge::cli::Args),
    /// Shows a scene in a window: in three dimensions, with all sensors and the truth, at any time.
    View(view::ViewArgs),
}

#[derive(Args)]
pub(crate) struct PosterArgs {
    /// The scenes. Default: all streets.
    #[arg(long = "scene", value_enum)]
    pub(crate) scenes: Vec<Name>,
    /// Seed of the scenes and all noise.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Simulated time at which they are looked at.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "8")]
    pub(crate) at: Duration,
    /// The picture, a PNG.
    #[arg(long, value_name = "FILE", default_value = "poster.png")]
    pub(crate) out: PathBuf,
}

#[derive(Args)]
pub(crate) struct RunArgs {
    /// The scene.
    #[arg(long, value_enum, default_value = "room")]
    scene: Name,
    /// Seed of the scene and all noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Records what all sensors say, with the truth, as ROS 2 messages in an MCAP file: 30 MB a second in a street.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Publishes what all sensors say as ROS 2 messages over Zenoh, in real time: tcp/HOST:PORT of a router, or
    /// listen:tcp/HOST:PORT to be one.
    #[arg(long, value_name = "ENDPOINT")]
    zenoh: Option<String>,
    /// Which sensors are recorded and published, such as uav,ugv/lidar. Default: all of uav and ugv, in the room of uav.
    #[arg(long, value_name = "SENSOR", value_delimiter = ',')]
    aboard: Vec<String>,
    /// Records which thing and which class each pixel of the drone's camera shows, too.
    #[arg(long)]
    masks: bool,
    /// A script of what breaks when, a line each: TIME SENSOR off|frozen|noise FACTOR|delay SECONDS [SPAN].
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// What cameras make of the light.
    #[arg(long, value_enum, default_value = "ideal")]
    optics: OpticsKind,
    /// The vehicles' clocks.
    #[arg(long, value_enum, default_value = "ideal")]
    clocks: Clocks,
    /// What happens to frames between the autopilots and their links.
    #[arg(long, value_name = "PROFILE", default_value = "ideal", value_parser = Profile::NAMES)]
    link: String,
    /// Shows nothing but warnings and errors: no line with where the vehicles are, no news.
    #[arg(long)]
    pub(crate) headless: bool,
    /// Shows the scene, each camera and where the vehicles truly are, in a window; closing it ends the run.
    #[arg(long, conflicts_with = "headless")]
    pub(crate) view: bool,
    /// Ends after this much simulated time. Default: a recording takes 36 s, whatever has links or is published runs until
    /// stopped.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_hyphen_values = true)]
    duration: Option<Duration>,
    /// Link of the copter (1/1), such as udpout:127.0.0.1:14561.
    #[arg(long, value_name = "URI")]
    copter: Option<String>,
    /// Link of the rover (2/1), such as udpout:127.0.0.1:14550.
    #[arg(long, value_name = "URI")]
    rover: Option<String>,
    /// Where the world's origin is on Earth.
    #[arg(
        long,
        value_name = "LAT,LON,ALT",
        default_value = "50.7277,7.0866,110",
        allow_hyphen_values = true
    )]
    origin: Origin,
    /// Where the rover starts: metres east and north of the origin, degrees clockwise from north. Default: where the scene
    /// has its ground vehicle, in the room 0,0,90.
    #[arg(
        long,
        value_name = "X,Y,HEADING_DEG",
        requires = "rover",
        allow_hyphen_values = true
    )]
    rover_start: Option<Start>,
    /// Writes what truly happened, as JSON, at the end.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

impl RunArgs {
    /// What is to be run.
    pub(crate) fn settings(&self) -> anyhow::Result<Settings> {
        let mut setup = Setup::new(self.scene, self.seed, self.origin.clone());
        setup.clocks = self.clocks.models();
        setup.masks = self.masks;
        setup.optics = self.optics.optics();
        if !self.aboard.is_empty() {
            setup.aboard.clone_from(&self.aboard);
        }
        if let Some(file) = &self.faults {
            let text = std::fs::read_to_string(file)
                .with_context(|| format!("cannot read {}", file.display()))?;
            setup.faults = text.parse().with_context(|| file.display().to_string())?;
        }
        Ok(Settings {
            setup,
            record: self.record.clone(),
            zenoh: self.zenoh.clone(),
            duration: self.duration,
            copter: self.copter.clone(),
            rover: self.rover.clone(),
            rover_start: self.rover_start,
            link: Profile::named(&self.link).context("no such link")?,
            report: self.report.clone(),
        })
    }
}

/// What cameras make of the light.
#[derive(Clone, Copy, clap::ValueEnum)]
enum OpticsKind {
    /// All rows at once, sharp.
    Ideal,
    /// All rows at once, with blur, noise and automatic exposure.
    Global,
    /// One row after the other, with blur, noise and automatic exposure.
    Rolling,
}

impl OpticsKind {
    fn optics(self) -> Optics {
        match self {
            Self::Ideal => Optics::IDEAL,
            Self::Global => Optics::GLOBAL_SHUTTER,
            Self::Rolling => Optics::ROLLING_SHUTTER,
        }
    }
}

/// How good the vehicles' clocks are.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Clocks {
    /// The truth.
    Ideal,
    /// Crystals that were set by hand: 0.3 s ahead and 20 ppm fast on the drone, 20 ppm slow on the ground vehicle.
    Crystal,
    /// Disciplined by satellites: they drift by 1 ppm.
    Gnss,
}

impl Clocks {
    fn models(self) -> [ClockModel; 2] {
        match self {
            Self::Ideal => [ClockModel::IDEAL; 2],
            Self::Crystal => [
                ClockModel {
                    start: Stamp::from_nanos(300_000_000),
                    ..ClockModel::CRYSTAL
                },
                ClockModel {
                    drift_ppm: -ClockModel::CRYSTAL.drift_ppm,
                    ..ClockModel::CRYSTAL
                },
            ],
            Self::Gnss => [ClockModel::TEMPERATURE_COMPENSATED; 2],
        }
    }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text
        .parse()
        .map_err(|_not_a_number| "not a number of seconds".to_owned())?;
    if seconds <= 0.0 {
        return Err("it must be longer than 0".to_owned());
    }
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}
