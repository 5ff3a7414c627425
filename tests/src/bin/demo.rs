//! `make demo`: one mission end to end, its figures in a table and in `out/demo/report.json`.

use std::env;
use std::io::{self, Write as _};
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, bail};
use clap::Parser;
use tests::demo::{self, Options, Scenario, Window};
use tests::program::Show;

/// Runs one mission end to end: what a drone sees of a street becomes a map, the map crosses MAVLink, a rover drives a path planned on it.
#[derive(Parser)]
#[command(name = "demo", version)]
struct Arguments {
    /// Folder for what the mission leaves behind; cleared first
    #[arg(long, default_value = "out/demo")]
    out: PathBuf,
    /// Map a recording instead: folder of Bonn's `rgbd_bonn_crowd`, or a part of it, in the TUM layout
    #[arg(long, value_name = "DIR")]
    recording: Option<PathBuf>,
    /// Take pictures, open no window even if there is a display
    #[arg(long)]
    headless: bool,
}

fn main() -> anyhow::Result<()> {
    #[expect(
        clippy::disallowed_methods,
        reason = "main reads the clock, for the duration of the mission"
    )]
    let started = Instant::now();
    let arguments = Arguments::parse();
    let has_display = env::var_os("DISPLAY").is_some_and(|display| !display.is_empty());
    let window = if has_display && !arguments.headless {
        Window::Open
    } else {
        Window::Headless
    };
    let programs = env::current_exe().context("where is this program?")?;
    let programs = programs
        .parent()
        .context("this program is in no folder")?
        .to_owned();
    let scenario = match arguments.recording {
        Some(recording) => Scenario::office(&recording)?,
        None => Scenario::Street,
    };

    let options = Options {
        programs,
        out: arguments.out,
        window,
        show: Show::Lines,
        key: None,
    };
    let report = demo::run(&scenario, &options, started)?;
    let text = serde_json::to_string_pretty(&report).context("cannot show the report")?;
    writeln!(
        io::stdout(),
        "{text}\n\nin {}: report.json groundstation.png map.ot map_color.ot map.bt mission.tlog",
        options.out.display()
    )?;
    let failures = report.failures();
    if !failures.is_empty() {
        bail!("the mission failed: {}", failures.join("; "));
    }
    Ok(())
}
