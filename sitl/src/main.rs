//! The simulator's command line: a clock, the signals, and [`sitl::run`].

mod cli;
mod status;
mod view;

use std::io::{IsTerminal as _, Write as _};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;
use std::time::Instant;

use anyhow::Context as _;
use clap::Parser as _;
use maps::time::Stamp;
use sitl::bridge;
use sitl::dataset;
use sitl::link::Profile;
use sitl::poster::{Canvas, poster};
use sitl::run::{QUEUE, run};
use sitl::scene::Name;
use sitl::simulation::{AIR, Event, STEP};
use tracing_subscriber::EnvFilter;

use crate::cli::{Cli, Command, PosterArgs, RunArgs};
use crate::status::StatusLine;

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
        Command::Run(args) => execute_run(&args),
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

fn execute_run(args: &RunArgs) -> anyhow::Result<()> {
    start_log(if args.headless { "warn" } else { "info" });
    let settings = args.settings()?;
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
