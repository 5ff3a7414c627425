//! Other people's MAVLink programs talk to ours.

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

/// A simulated vehicle, and the port of this machine that it sends to.
fn start_vehicle(vehicle: &str, log: &Path) -> (Program, u16) {
    let free = UdpSocket::bind("127.0.0.1:0")
        .and_then(|socket| socket.local_addr())
        .expect("a free port");
    let mut sitl = Command::new(programs::folder().join("sitl"));
    sitl.args([
        "run",
        "--scene",
        "room",
        "--seed",
        "1",
        "--headless",
        vehicle,
    ]);
    sitl.arg(format!("udpout:127.0.0.1:{}", free.port()));
    let sitl = Program::start("sitl", sitl, log, Show::Nothing).expect("the simulator starts");
    (sitl, free.port())
}

/// MAVSDK connects to one simulated vehicle, uploads a mission, downloads it, finds it equal, and arms.
fn check_mavsdk(vehicle: &str) {
    let folder = tempfile::tempdir().expect("a folder for the log");
    let (mut sitl, port) = start_vehicle(vehicle, &folder.path().join("sitl.log"));
    python(
        "mavsdk_mission.py",
        &[format!("udpin://127.0.0.1:{port}").as_ref()],
    );
    sitl.stop(Duration::from_secs(10))
        .expect("the simulator ends when asked to");
}

#[test]
fn mavsdk_arms_the_simulated_copter_and_reads_back_its_mission() {
    check_mavsdk("--copter");
}

#[test]
fn mavsdk_arms_the_simulated_rover_and_reads_back_its_mission() {
    check_mavsdk("--rover");
}

#[test]
fn mavproxy_loads_parameters_and_a_mission_without_a_complaint() {
    let folder = tempfile::tempdir().expect("a folder for the logs");
    for (vehicle, parameters) in [("--copter", 23), ("--rover", 18)] {
        let (mut sitl, port) = start_vehicle(vehicle, &folder.path().join("sitl.log"));
        let endpoint = format!("udpin:127.0.0.1:{port}");
        let told = python(
            "mavproxy_session.py",
            &[endpoint.as_ref(), folder.path().as_os_str()],
        );
        assert!(told.contains("by file"), "{vehicle}: {told}");
        let loaded = format!("{parameters} parameters");
        assert!(told.contains(&loaded), "{vehicle}: {told}");
        assert!(told.contains("mission of 3 items"), "{vehicle}: {told}");
        sitl.stop(Duration::from_secs(10))
            .expect("the simulator ends when asked to");
    }
}
