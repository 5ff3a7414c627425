//! The simulator's command line: a clock, the signals, and [`sitl::run`].

mod status;
mod view;

use std::io::{IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::{Args, Parser, Subcommand};
use maps::time::Stamp;
use sitl::bridge;
use sitl::camera_model::Optics;
use sitl::dataset;
use sitl::link::Profile;
use sitl::poster::{Canvas, poster};
use sitl::rig::Setup;
use sitl::run::{QUEUE, Settings, run};
use sitl::scene::Name;
use sitl::sensor::clock::ClockModel;
use sitl::simulation::{AIR, Event, STEP, Start};
use sitl::wgs84::Origin;
use tracing_subscriber::EnvFilter;

use crate::status::StatusLine;

/// A simulated world: streets and a room that are filmed, a copter and a rover with their autopilots.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Runs vehicles in real time where they have links, and records as fast as it can.
    Run(RunArgs),
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
struct PosterArgs {
    /// The scenes. Default: all streets.
    #[arg(long = "scene", value_enum)]
    scenes: Vec<Name>,
    /// Seed of the scenes and all noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Simulated time at which they are looked at.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "8")]
    at: Duration,
    /// The picture, a PNG.
    #[arg(long, value_name = "FILE", default_value = "poster.png")]
    out: PathBuf,
}

#[derive(Args)]
struct RunArgs {
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
    headless: bool,
    /// Shows the scene, each camera and where the vehicles truly are, in a window; closing it ends the run.
    #[arg(long, conflicts_with = "headless")]
    view: bool,
    /// Ends after this much simulated time. Default: a recording takes one round (36 s), vehicles run until stopped.
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
    /// Where the rover starts: metres east and north of the origin, degrees clockwise from north. Default: where the scene has its ground vehicle, in the room 0,0,90.
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

fn main() -> ExitCode {
    let done = execute();
    done.map_or_else(
        |error| {
            // One line with all causes; nowhere else to say it if that fails.
            writeln!(std::io::stderr(), "error: {error:#}").unwrap_or_default();
            ExitCode::FAILURE
        },
        |()| ExitCode::SUCCESS,
    )
}

fn execute() -> anyhow::Result<()> {
    match Cli::parse().command {
        Command::Run(args) => execute_run(args),
        Command::Poster(args) => draw_poster(&args),
        Command::Dataset(args) => dataset::cli::execute(&args, clock(now())),
        Command::Bridge(args) => {
            start_log("info");
            let stop = Arc::new(AtomicBool::new(false));
            let stopped = Arc::clone(&stop);
            ctrlc::set_handler(move || stopped.store(true, Ordering::Relaxed))
                .context("cannot listen for ctrl-c")?;
            bridge::cli::run(&args, &stop)
        }
        Command::View(args) => {
            start_log("warn");
            view::alone(&args)
        }
    }
}

fn start_log(level: &str) {
    let filter = EnvFilter::try_from_default_env()
        .unwrap_or_else(|_unset| EnvFilter::new(format!("{level},zenoh=warn")));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .init();
}

fn draw_poster(args: &PosterArgs) -> anyhow::Result<()> {
    let scenes = if args.scenes.is_empty() {
        Name::STREETS.to_vec()
    } else {
        args.scenes.clone()
    };
    let sheets: Vec<_> = scenes
        .iter()
        .map(|name| poster(*name, args.seed, Stamp::ZERO + args.at))
        .collect();
    let sheet = Canvas::stacked(&sheets, 24, [255; 3]);
    let cannot = || format!("cannot write {}", args.out.display());
    let file = std::fs::File::create(&args.out).with_context(cannot)?;
    let mut file = std::io::BufWriter::new(file);
    sheet.write_png(&mut file).with_context(cannot)?;
    file.flush().with_context(cannot)
}

fn execute_run(args: RunArgs) -> anyhow::Result<()> {
    start_log(if args.headless { "warn" } else { "info" });
    let mut setup = Setup::new(args.scene, args.seed, args.origin);
    setup.clocks = args.clocks.models();
    setup.masks = args.masks;
    setup.optics = args.optics.optics();
    if !args.aboard.is_empty() {
        setup.aboard = args.aboard;
    }
    if let Some(file) = &args.faults {
        let text = std::fs::read_to_string(file)
            .with_context(|| format!("cannot read {}", file.display()))?;
        setup.faults = text.parse().with_context(|| file.display().to_string())?;
    }
    let settings = Settings {
        setup,
        record: args.record,
        zenoh: args.zenoh,
        duration: args.duration,
        copter: args.copter,
        rover: args.rover,
        rover_start: args.rover_start,
        link: Profile::named(&args.link).context("no such link")?,
        report: args.report,
    };
    if args.view && settings.is_idle() {
        return view::of(settings.setup.scene, settings.setup.seed);
    }
    let (inbox, events) = sync_channel(QUEUE);
    let start = now();
    let for_signal = inbox.clone();
    ctrlc::set_handler(move || {
        // Nobody listens any more only if the run has ended already.
        let _already_ended = for_signal.send(Event::Stop);
    })
    .context("cannot listen for ctrl-c")?;
    if settings.has_links() {
        let ticks = inbox.clone();
        let is_emulated = settings.link != Profile::IDEAL;
        thread::Builder::new()
            .name("clock".into())
            .spawn(move || tick(start, is_emulated, &ticks))?;
    }
    let clock = clock(start);
    let mut line = StatusLine::default();
    let watched = !args.headless && settings.has_links() && std::io::stderr().is_terminal();
    let scene = (settings.setup.scene, settings.setup.seed);
    let for_window = inbox.clone();
    let work = move |mut teller: Option<view::Teller>| {
        let report = run(&settings, (&inbox, &events), clock, |simulation| {
            if watched {
                line.show(simulation);
            }
            if let Some(teller) = &mut teller {
                teller.tell(simulation);
            }
        })?;
        if let Some(recording) = &report.recording {
            let messages: u64 = recording.messages.values().sum();
            tracing::info!(messages, seconds = recording.seconds, "recorded");
        }
        Ok(())
    };
    if !args.view {
        return work(None);
    }
    let stop = move || {
        // Nobody listens any more only if the run has ended already.
        let _already_ended = for_window.send(Event::Stop);
    };
    view::beside(scene, stop, move |teller| work(Some(teller)))
}

/// A tick per step of real time, and between them one more often for emulated links. A machine that falls behind catches
/// up: no step is left out.
#[expect(clippy::disallowed_methods, reason = "the clock of the program")]
fn tick(start: Instant, is_emulated: bool, ticks: &SyncSender<Event>) {
    let per_step = if is_emulated {
        STEP.as_millis() / AIR.as_millis()
    } else {
        1
    } as u32;
    for count in 1.. {
        let due = STEP * count / per_step;
        thread::sleep(due.saturating_sub(start.elapsed()));
        let event = if count.is_multiple_of(per_step) {
            Event::Tick
        } else {
            Event::Air
        };
        if ticks.send(event).is_err() {
            return;
        }
    }
}

/// Tells how long ago that was.
fn clock(start: Instant) -> impl Fn() -> Stamp + Clone + Send + 'static {
    move || Stamp::from_nanos(u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX))
}

#[expect(clippy::disallowed_methods, reason = "the clock of the program")]
fn now() -> Instant {
    Instant::now()
}
