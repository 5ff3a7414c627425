//! `companion`: the on-board service of a vehicle.

mod cli;
mod progress;

use std::io::{self, IsTerminal as _, Write as _};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use clap::Parser as _;
use companion::clock::Clock;
use companion::config::{Config, Settings};
use companion::doctor::{self, Check, Finding};
use companion::event::Event;
use companion::replay::{Continue, replay};
use companion::runtime::{self, Events};
use mavlink_ext::signing::{KeyFile, SigningKey};
use tracing_subscriber::EnvFilter;

use crate::cli::{Arguments, Command};
use crate::progress::ProgressLine;

fn main() -> ExitCode {
    execute().unwrap_or_else(|error| {
        // One line with all causes; nowhere else to say it if that fails.
        writeln!(io::stderr(), "error: {error:#}").unwrap_or_default();
        ExitCode::FAILURE
    })
}

fn execute() -> Result<ExitCode> {
    // Zenoh tells of every peer at `info`.
    let usual = || EnvFilter::new("info,zenoh=warn");
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_unset| usual());
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        .init();
    let clock = Clock::start();
    match Arguments::parse().command {
        Command::Run {
            options,
            source,
            print_config,
        } => {
            if print_config {
                let config = options.read_as_written(source)?;
                write!(io::stdout(), "{}", config.to_toml()?)?;
            } else {
                run(&options.read(source)?.check()?, clock)?;
            }
            Ok(ExitCode::SUCCESS)
        }
        Command::Replay { source, options } => {
            replay_one(&options.read(Some(source))?.check()?, clock)?;
            Ok(ExitCode::SUCCESS)
        }
        Command::Doctor {
            options,
            source,
            listen_s,
        } => {
            let listen = Duration::from_secs_f64(listen_s);
            Ok(examine(options.read(source), clock, listen))
        }
        Command::Key { file } => {
            KeyFile::new(&file).create(&SigningKey::random()?)?;
            writeln!(io::stdout(), "{}", file.display())?;
            Ok(ExitCode::SUCCESS)
        }
        Command::Map { command } => command.run().map(|()| ExitCode::SUCCESS),
    }
}

fn run(settings: &Settings, clock: Clock) -> Result<()> {
    let events = Events::default();
    let sender = events.sender();
    // Waits if the queue is full; fails only when the service has ended anyway.
    let stop = move || sender.send((clock.now(), Event::Stop)).unwrap_or_default();
    ctrlc::set_handler(stop).context("cannot handle ctrl-c and SIGTERM")?;
    Ok(runtime::run(settings, clock, events)?)
}

fn replay_one(settings: &Settings, clock: Clock) -> Result<()> {
    let stopped = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&stopped);
    ctrlc::set_handler(move || stop.store(true, Ordering::Relaxed))
        .context("cannot handle ctrl-c and SIGTERM")?;
    let mut bar = ProgressLine::new();
    let report = replay(settings, clock, |progress| {
        bar.show(progress);
        if stopped.load(Ordering::Relaxed) {
            Continue::No
        } else {
            Continue::Yes
        }
    })?;
    writeln!(io::stdout(), "{}", serde_json::to_string_pretty(&report)?)?;
    if !report.source_finished {
        bail!(
            "stopped after {} frames; what was there is in {}",
            report.frames,
            settings.out.display()
        );
    }
    if report.frames_tracked == 0 {
        bail!(
            "the place of the camera was never found, so there is no map: are the images sharp, and does enough of them have \
             depth (source.depth_factor)?"
        );
    }
    Ok(())
}

fn examine(config: Result<Config>, clock: Clock, listen: Duration) -> ExitCode {
    let mut sound = true;
    let mut tell = |check: Check| {
        sound &= !check.has_failed();
        writeln!(io::stdout(), "{check}").unwrap_or_default();
    };
    let checked = config.and_then(|config| Ok(config.check()?));
    let finding = checked.as_ref().map_or_else(
        |e| Finding::Failed(format!("{e:#}")),
        |_| Finding::Ok("sound".into()),
    );
    tell(Check {
        name: "config",
        finding,
    });
    if let Ok(settings) = checked {
        doctor::examine(&settings, clock, listen, tell);
    }
    if sound {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
