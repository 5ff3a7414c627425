//! Other people's MAVLink programs talk to ours.

mod autopilot;
mod companion;
mod dialect;
mod failures;
mod host;
mod services;

use std::ffi::OsStr;
use std::net::UdpSocket;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use tests::program::{Program, Show};

use crate::programs;

/// Runs `tests/peers/SCRIPT` with the pinned peers and returns its standard output; panics if it fails.
pub(crate) fn python(script: &str, arguments: &[&OsStr]) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join("../target/peers/bin/python");
    assert!(
        python.is_file(),
        "the Python peers are not installed: run `tools/setup peers`"
    );
    let output = Command::new(python)
        .arg(root.join("peers").join(script))
        .args(arguments)
        .output()
        .unwrap_or_else(|error| panic!("cannot run {script}: {error}"));
    assert!(
        output.status.success(),
        "{script} failed with {}\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).expect("Python prints UTF-8")
}

/// A UDP port of this machine that nobody listens at.
fn free_port() -> u16 {
    let free = UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    free.expect("a free port").port()
}

/// A simulated vehicle that sends to a port of this machine, started with these options too.
fn start_vehicle(port: u16, options: &[&str], log: &Path) -> Program {
    let mut sitl = Command::new(programs::folder().join("sitl"));
    sitl.args(["run", "--scene", "room", "--seed", "1", "--headless"]);
    let (vehicle, more) = options.split_first().expect("which vehicle");
    sitl.arg(vehicle).arg(format!("udpout:127.0.0.1:{port}"));
    sitl.args(more);
    Program::start("sitl", sitl, log, Show::Nothing).expect("the simulator starts")
}

/// Asks a program to end and waits until it has.
#[track_caller]
fn stop(mut program: Program) {
    program
        .stop(Duration::from_secs(20))
        .expect("it ends when asked to");
}
