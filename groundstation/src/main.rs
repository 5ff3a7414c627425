//! `groundstation`: the operator's program.

use std::io::{IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context as _;
use clap::Parser;
use groundstation::app::{App, Options};
use groundstation::clock::Clock;
use groundstation::config::Config;
use groundstation::headless::Headless;
use groundstation::{render, script, view, window};

/// How long one round of the headless loop waits for a frame.
const PATIENCE: Duration = Duration::from_millis(20);

/// The ground station of Tandem: one map, all vehicles, plans and commands.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// Link to open, such as udpin:0.0.0.0:14550, tcpout:HOST:PORT or serial:DEVICE:BAUD; may be given several times
    #[arg(long, value_name = "URI")]
    connect: Vec<String>,
    /// Recording (.tlog) to replay; nothing can be commanded then
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
    /// Run without a window, for a script or a recording; pictures are drawn all the same
    #[arg(long)]
    headless: bool,
    /// Script that plays the operator, see --script-help
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// Folder for the script's pictures
    #[arg(long, value_name = "DIR", default_value = ".")]
    screenshot: PathBuf,
    /// Record everything sent and received to this telemetry log, which must not exist yet
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Write the figures of the run here at the end, as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Configuration, TOML
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Size of the window and of headless pictures, in pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1600x900", value_parser = size)]
    size: [u32; 2],
    /// Print the commands of scripts and exit
    #[arg(long)]
    script_help: bool,
    /// Print the configuration with all defaults and exit
    #[arg(long)]
    print_config: bool,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text
        .split_once('x')
        .and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    let fits = |sides: &[u32; 2]| sides.iter().all(|side| (320..=7680).contains(side));
    sides
        .filter(fits)
        .ok_or_else(|| "expected WIDTHxHEIGHT, each from 320 to 7680, as 1600x900".to_owned())
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
    let arguments = Arguments::parse();
    let filter = tracing_subscriber::EnvFilter::builder()
        .with_default_directive(tracing::level_filters::LevelFilter::INFO.into())
        .from_env_lossy()
        // What the graphics stack tells about itself concerns nobody.
        .add_directive("wgpu_hal=error".parse()?)
        .add_directive("wgpu_core=error".parse()?)
        .add_directive("eframe=warn".parse()?)
        .add_directive("egui_wgpu=warn".parse()?);
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .init();
    let config = match &arguments.config {
        Some(path) => Config::read(path)?,
        None => Config::default(),
    };
    #[expect(
        clippy::print_stdout,
        reason = "what was asked for on the command line"
    )]
    if arguments.script_help {
        print!("{}", script::HELP);
        return Ok(());
    } else if arguments.print_config {
        print!("{}", toml::to_string(&config)?);
        return Ok(());
    }
    anyhow::ensure!(
        !arguments.headless || arguments.script.is_some() || arguments.record.is_some(),
        "--headless has nothing to do: give it a --script to follow (a --replay needs one, too) or a file to --record to"
    );
    let stop = Arc::new(AtomicBool::new(false));
    let on_signal = Arc::clone(&stop);
    ctrlc::set_handler(move || on_signal.store(true, Ordering::Relaxed))
        .context("cannot watch for signals")?;
    let options = Options {
        script: arguments.script.as_deref().map(read_script).transpose()?,
        connect: arguments.connect,
        replay: arguments.replay,
        pictures: arguments.screenshot,
        record: arguments.record,
        report: arguments.report,
    };
    let app = App::new(config, options, Clock::start())?;
    if arguments.headless {
        run_headless(app, arguments.size, &stop)
    } else {
        window::run(app, arguments.size.map(|side| side as f32), stop)
    }
}

fn read_script(path: &std::path::Path) -> anyhow::Result<Vec<script::Line>> {
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("cannot read the script {}", path.display()))?;
    script::parse(&text).with_context(|| format!("in the script {}", path.display()))
}

fn run_headless(mut app: App, size: [u32; 2], stop: &AtomicBool) -> anyhow::Result<()> {
    let mut headless = None;
    while (app.end().is_none() && !app.script_is_done() || app.wanted_picture().is_some())
        && !stop.load(Ordering::Relaxed)
    {
        app.logic(PATIENCE);
        if app.wanted_picture().is_none() {
            continue;
        }
        // Looked for when first needed: a script without pictures needs no device.
        if headless.is_none() {
            let context = egui::Context::default();
            view::theme::apply(&context);
            let made = Headless::new(context, size)?;
            render::install(made.render_state());
            headless = Some(made);
        }
        if let Some(headless) = &mut headless {
            let picture = headless.picture(app.running_s(), |ui| app.ui(ui))?;
            app.deliver_picture(&picture)?;
        }
    }
    app.finish()
}
