//! One mission, end to end, with the real programs: a simulator, a companion and a ground station as three processes
//! with only MAVLink between them, and a script in place of the operator's hands.
//!
//! ```text
//! sitl ── copter 1/1 ──► companion 1/191 ──► groundstation 255/190 ◄── rover 2/1 ── sitl
//!                           ▲ recording                 ▲ script
//! ```

use std::io::Write as _;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use std::{env, fs};

use anyhow::{Context as _, ensure};
use serde_json::Value;
use toml::Table;

use crate::program::{Program, Show};

mod report;
mod scenario;

pub use report::{Parts, Report};
pub use scenario::Scenario;

/// The file that marks a folder as a mission's: what the operator did.
const SCRIPT: &str = "operator.script";

/// How long the operator's script may take.
const PATIENCE: Duration = Duration::from_mins(10);

/// How to run a mission.
pub struct Options {
    /// Folder of the programs `companion`, `groundstation` and `sitl`.
    pub programs: PathBuf,
    /// Folder for everything that the mission leaves behind; made anew.
    pub out: PathBuf,
    /// Whether the ground station opens a window.
    pub window: Window,
    /// What people see of the programs' output.
    pub show: Show,
    /// The key with which all links to the ground station are signed; they are not, if none.
    pub key: Option<PathBuf>,
}

impl Options {
    /// What follows the ground links' addresses.
    fn signing(&self) -> String {
        let key = self.key.as_ref();
        key.map_or(String::new(), |key| {
            format!("?signing=required&key={}", key.display())
        })
    }
}

/// How the ground station is seen.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Window {
    /// A window on the display.
    Open,
    /// No window: pictures only.
    Headless,
}

/// Runs the mission that began at `started`, and returns what it measured. `report.json` is written even if a figure is bad.
pub fn run(scenario: &Scenario, options: &Options, started: Instant) -> anyhow::Result<Report> {
    let out = &options.out;
    if out.exists() {
        // Anything else may be somebody's work.
        ensure!(
            out.join(SCRIPT).is_file() || fs::read_dir(out)?.next().is_none(),
            "{} holds something that is no mission: name another folder with --out",
            out.display()
        );
        fs::remove_dir_all(out).with_context(|| format!("cannot clear {}", out.display()))?;
    }
    fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    // First of all: a mission that is interrupted anywhere must not keep the next one from clearing its folder.
    let script = out.join(SCRIPT);
    fs::write(&script, scenario.script())
        .with_context(|| format!("cannot write {}", script.display()))?;
    scenario.prepare(options)?;
    let ports = Ports::free()?;

    let config = scenario.companion_config(options, ports)?;
    let mut companion = start_companion(&config, options)?;
    let mut groundstation = start_groundstation(options, ports)?;
    let mut sitl = start_sitl(scenario, &scenario.origin(&config)?, options, ports)?;
    groundstation.wait(PATIENCE)?;
    companion.stop(Duration::from_secs(30))?;
    sitl.stop(Duration::from_secs(30))?;

    let parts = Parts {
        companion: read_json(&out.join("companion/report.json"))?,
        groundstation: read_json(&out.join("groundstation.json"))?,
        sitl: read_json(&out.join("sitl.json"))?,
    };
    for map in ["map.ot", "map_color.ot", "map.bt"] {
        let from = out.join("companion").join(map);
        fs::rename(&from, out.join(map))
            .with_context(|| format!("the companion left no {}", from.display()))?;
    }
    for left in ["groundstation.png", "mission.tlog"] {
        ensure!(
            out.join(left).is_file(),
            "the ground station left no {left}"
        );
    }
    let report = Report::gather(&parts, started.elapsed().as_secs_f64())?;
    let text = serde_json::to_string_pretty(&report).context("cannot write a report as JSON")?;
    fs::write(out.join("report.json"), text + "\n").context("cannot write report.json")?;
    Ok(report)
}

/// The UDP ports of one mission, so that several can run on one machine.
#[derive(Clone, Copy)]
struct Ports {
    ground: u16,
    autopilot: u16,
}

impl Ports {
    fn free() -> anyhow::Result<Self> {
        let bind = || UdpSocket::bind("127.0.0.1:0").context("no free UDP port on 127.0.0.1");
        // Both at once, so that they differ.
        let (ground, autopilot) = (bind()?, bind()?);
        Ok(Self {
            ground: ground.local_addr()?.port(),
            autopilot: autopilot.local_addr()?.port(),
        })
    }
}

fn start_companion(config: &Table, options: &Options) -> anyhow::Result<Program> {
    let file = options.out.join("companion.toml");
    fs::write(&file, config.to_string())
        .with_context(|| format!("cannot write {}", file.display()))?;
    let mut command = Command::new(options.programs.join("companion"));
    command
        .arg("run")
        .arg("-c")
        .arg(file)
        .arg("--out")
        .arg(options.out.join("companion"));
    Program::start(
        "companion",
        command,
        &options.out.join("companion.log"),
        options.show,
    )
}

fn start_groundstation(options: &Options, ports: Ports) -> anyhow::Result<Program> {
    let mut command = Command::new(options.programs.join("groundstation"));
    command.arg("--connect").arg(format!(
        "udpin:127.0.0.1:{}{}",
        ports.ground,
        options.signing()
    ));
    command
        .arg("--script")
        .arg(options.out.join(SCRIPT))
        .arg("--screenshot")
        .arg(&options.out);
    command
        .arg("--record")
        .arg(options.out.join("mission.tlog"));
    command
        .arg("--report")
        .arg(options.out.join("groundstation.json"));
    if env::var_os("XDG_RUNTIME_DIR").is_none() {
        command.env("XDG_RUNTIME_DIR", std::path::absolute(&options.out)?); // Mesa complains without
    }
    if options.window == Window::Headless {
        command.arg("--headless");
    }
    Program::start(
        "groundstation",
        command,
        &options.out.join("groundstation.log"),
        options.show,
    )
}

fn start_sitl(
    scenario: &Scenario,
    origin: &str,
    options: &Options,
    ports: Ports,
) -> anyhow::Result<Program> {
    let mut command = Command::new(options.programs.join("sitl"));
    command.args(["run", "--headless"]);
    command.args(scenario.scene());
    command
        .arg("--copter")
        .arg(format!("udpout:127.0.0.1:{}", ports.autopilot));
    command.arg("--rover").arg(format!(
        "udpout:127.0.0.1:{}{}",
        ports.ground,
        options.signing()
    ));
    command
        .arg(format!("--origin={origin}"))
        .arg(format!("--rover-start={}", scenario.rover_start()));
    command.arg("--report").arg(options.out.join("sitl.json"));
    Program::start("sitl", command, &options.out.join("sitl.log"), options.show)
}

fn read_json(path: &Path) -> anyhow::Result<Value> {
    let text =
        fs::read_to_string(path).with_context(|| format!("no report in {}", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{} is no JSON", path.display()))
}

/// Says to people what the mission does.
fn say(text: &str) {
    drop(writeln!(std::io::stderr(), "{:>13} | {text}", "demo"));
}
