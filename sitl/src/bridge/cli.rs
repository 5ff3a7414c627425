//! `sitl bridge`: its arguments, its run and its report.

use std::fs::File;
use std::io::BufWriter;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::Context as _;
use serde::Serialize;

use super::plant::VehicleKind;
use super::serve::{Until, serve};
use super::{Bridge, Counters, Setup};
use crate::scene::{Name, Scene};
use crate::simulation::Start;

/// Arguments of `sitl bridge`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// What `ArduPilot` flies or drives.
    #[arg(long, value_enum)]
    vehicle: VehicleKind,
    /// UDP port, or address and port, at which `ArduPilot` is awaited: 9002, and 10 more for each further instance of it.
    #[arg(long, value_name = "[ADDRESS:]PORT", value_parser = endpoint, default_value = "9002")]
    listen: SocketAddr,
    /// The scene.
    #[arg(long, value_enum, default_value = "room")]
    scene: Name,
    /// Seed of the scene.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where the vehicle starts: metres east and north of the origin, degrees clockwise from north.
    #[arg(
        long,
        value_name = "X,Y,HEADING_DEG",
        default_value = "0,0,90",
        allow_hyphen_values = true
    )]
    start: Start,
    /// Ends after this much simulated time. Default: runs until stopped.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_hyphen_values = true)]
    duration: Option<Duration>,
    /// Writes what truly happened, as JSON, at the end.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// What happened, as written at the end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// `copter` or `rover`.
    pub vehicle: String,
    /// Name of the scene.
    pub scene: String,
    /// Seed of the scene.
    pub seed: u64,
    /// Simulated time since `ArduPilot` last began.
    pub simulated_s: f64,
    /// How often what happened.
    pub counters: Counters,
    /// Where the vehicle truly is: east, north, up.
    pub true_position_m: [f64; 3],
    /// Where it truly heads, clockwise from north, 0 to 360.
    pub true_heading_deg: f64,
    /// The highest that it has been.
    pub highest_m: f64,
    /// How long its way was.
    pub travelled_m: f64,
}

fn endpoint(text: &str) -> Result<SocketAddr, String> {
    let port = text
        .parse()
        .map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    port.or_else(|_no_port| text.parse())
        .map_err(|_no_address| {
            "expected a port, such as 9002, or an address with one, such as 0.0.0.0:9002".to_owned()
        })
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text
        .parse()
        .map_err(|_not_a_number| "not a number of seconds".to_owned())?;
    Duration::try_from_secs_f64(seconds)
        .ok()
        .filter(|duration| !duration.is_zero())
        .ok_or_else(|| "it must be longer than 0".to_owned())
}

/// Serves one `ArduPilot` until `stop` is set or the duration is over; writes the report.
pub fn run(args: &Args, stop: &AtomicBool) -> anyhow::Result<()> {
    let scene = Scene::generate(args.scene, args.seed);
    let mut bridge = Bridge::new(Setup {
        vehicle: args.vehicle,
        scene: &scene,
        start: args.start,
    });
    let listen = args.listen;
    let socket = UdpSocket::bind(listen).with_context(|| {
        format!("cannot listen at {listen} (is another bridge there? then choose another --listen)")
    })?;
    let local = socket
        .local_addr()
        .context("a bound socket has an address")?;
    tracing::info!(vehicle = %args.vehicle, scene = %args.scene, at = %local, "waiting for ArduPilot");
    let until = Until {
        stop,
        simulated: args.duration,
    };
    serve(&mut bridge, &socket, until).with_context(|| format!("cannot receive at {listen}"))?;
    let report = report(args, &bridge);
    let counters = report.counters;
    tracing::info!(
        simulated_s = report.simulated_s,
        ?counters,
        "the bridge has ended"
    );
    if let Some(path) = &args.report {
        let file = File::create(path)
            .with_context(|| format!("cannot write the report to {}", path.display()))?;
        serde_json::to_writer_pretty(BufWriter::new(file), &report)
            .with_context(|| format!("cannot write the report to {}", path.display()))?;
    }
    Ok(())
}

fn report(args: &Args, bridge: &Bridge<'_>) -> Report {
    let (plant, motion) = (bridge.plant(), bridge.plant().motion());
    Report {
        vehicle: args.vehicle.to_string(),
        scene: args.scene.to_string(),
        seed: args.seed,
        simulated_s: bridge.simulated().as_secs_f64(),
        counters: bridge.counters(),
        true_position_m: motion.position().raw.coords.into(),
        true_heading_deg: (90.0 - motion.heading_rad().to_degrees()).rem_euclid(360.0),
        highest_m: plant.highest_m(),
        travelled_m: plant.travelled_m(),
    }
}
