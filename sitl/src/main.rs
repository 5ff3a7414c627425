//! The simulator's command line: a clock, the signals, and [`sitl::run`].

mod status;
mod view;

use std::io::{IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::{Args, Parser, Subcommand};
use maps::time::Stamp;
use sitl::poster::{Canvas, poster};
use sitl::run::{QUEUE, Settings, run};
use sitl::scene::Name;
use sitl::simulation::{Event, STEP, Start};
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
    /// Records what the drone's camera sees, with the truth, as ROS 2 messages in an MCAP file (23 MB a second).
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
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
    /// Where the rover starts: metres east and north of the origin, degrees clockwise from north.
    #[arg(
        long,
        value_name = "X,Y,HEADING_DEG",
        requires = "rover",
        default_value = "0,0,90",
        allow_hyphen_values = true
    )]
    rover_start: Start,
    /// Writes what truly happened, as JSON, at the end.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
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
        Command::View(args) => {
            log_to_stderr("warn");
            view::alone(&args)
        }
    }
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

fn log_to_stderr(level: &str) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_unset| EnvFilter::new(level));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .init();
}

fn execute_run(args: RunArgs) -> anyhow::Result<()> {
    let level = if args.headless { "warn" } else { "info" };
    log_to_stderr(level);
    let settings = Settings {
        scene: args.scene,
        seed: args.seed,
        record: args.record,
        duration: args.duration,
        copter: args.copter,
        rover: args.rover,
        origin: args.origin,
        rover_start: args.rover_start,
        report: args.report,
    };
    if args.view && !settings.has_links() && settings.record.is_none() {
        return view::of(settings.scene, settings.seed);
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
        thread::Builder::new()
            .name("clock".into())
            .spawn(move || tick(start, &ticks))?;
    }
    let clock =
        move || Stamp::from_nanos(u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX));
    let mut line = StatusLine::default();
    let watched = !args.headless && settings.has_links() && std::io::stderr().is_terminal();
    let scene = (settings.scene, settings.seed);
    let for_window = inbox.clone();
    let mut work = move |mut teller: Option<view::Teller>| {
        let report = run(&settings, (&inbox, &events), clock, |simulation| {
            if watched {
                line.show(simulation);
            }
            if let Some(teller) = &mut teller {
                teller.tell(simulation);
            }
        })?;
        if let Some(recording) = &report.recording {
            tracing::info!(frames = recording.frames, seconds = recording.seconds, file = %recording.file.display(), "recorded");
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

/// A tick per step of real time. A machine that falls behind catches up: no step is left out.
#[expect(clippy::disallowed_methods, reason = "the clock of the program")]
fn tick(start: Instant, ticks: &SyncSender<Event>) {
    for step in 1.. {
        let due = STEP * step;
        thread::sleep(due.saturating_sub(start.elapsed()));
        if ticks.send(Event::Tick).is_err() {
            return;
        }
    }
}

#[expect(clippy::disallowed_methods, reason = "the clock of the program")]
fn now() -> Instant {
    Instant::now()
}
