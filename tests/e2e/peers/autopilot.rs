//! Ground stations of others use the simulated autopilots.

use std::path::Path;

use serde::Deserialize;

use super::{free_port, python, start_vehicle, stop};

/// Runs `tests/peers/SCRIPT USE` against a simulated vehicle; returns what it prints. The address is as the script's library
/// writes it.
#[track_caller]
pub(super) fn use_vehicle(script: &str, what: &[&str], address: &str, options: &[&str]) -> String {
    let folder = tempfile::tempdir().expect("a folder for the log");
    let port = free_port();
    let sitl = start_vehicle(port, options, &folder.path().join("sitl.log"));
    let endpoint = format!("{address}:{port}");
    let mut arguments: Vec<&std::ffi::OsStr> = what.iter().map(AsRef::as_ref).collect();
    arguments.push(endpoint.as_ref());
    let told = python(script, &arguments);
    stop(sitl);
    told
}

const MAVSDK: &str = "udpin://127.0.0.1";
pub(super) const OTHERS: &str = "udpin:127.0.0.1";

/// Uploads a mission with MAVSDK, reads it back and flies or drives it to its end.
#[track_caller]
fn check_mission_with_mavsdk(vehicle: &str) {
    let told = use_vehicle("mavsdk_mission.py", &["--fly", "90"], MAVSDK, &[vehicle]);
    assert!(
        told.ends_with("read back and equal\narmed\nmission done\n"),
        "{told}"
    );
    let complaints = ["error", "fail", "warn", "timeout"];
    let is_complaint = |line: &&str| {
        complaints
            .iter()
            .any(|word| line.to_lowercase().contains(word))
    };
    assert_eq!(told.lines().find(is_complaint), None, "{told}");
}

#[test]
fn mavsdk_flies_a_mission_on_the_simulated_copter_without_an_error_line() {
    check_mission_with_mavsdk("--copter");
}

#[test]
fn mavsdk_drives_a_mission_on_the_simulated_rover_without_an_error_line() {
    check_mission_with_mavsdk("--rover");
}

#[test]
fn pymavlink_uploads_reads_and_clears_a_mission() {
    let told = use_vehicle(
        "pymavlink_autopilot.py",
        &["mission"],
        OTHERS,
        &["--copter"],
    );
    let expected = "6 items uploaded and read back equal\nan item beyond the last refused\n\
                    an impossible mission refused, the old one kept\nmission cleared\n";
    assert_eq!(told, expected);
}

#[test]
fn pymavlink_lists_reads_and_sets_parameters() {
    let told = use_vehicle(
        "pymavlink_autopilot.py",
        &["parameters"],
        OTHERS,
        &["--copter"],
    );
    let expected = "41 parameters listed\ntwo set and read back\nunknown names unanswered\n\
                    nothing else changed\n";
    assert_eq!(told, expected);
}

#[test]
fn mavsdk_gets_and_sets_parameters_of_both_types() {
    let told = use_vehicle(
        "mavsdk_autopilot.py",
        &["parameters"],
        MAVSDK,
        &["--copter"],
    );
    let expected = "24 of whole numbers, 17 of any\nset\nrefused\nread back by another\n";
    assert_eq!(told, expected);
}

/// What `mavsdk_autopilot.py telemetry` prints.
#[derive(Debug, Deserialize)]
struct Telemetry {
    vehicle: String,
    position: [f64; 3],
    relative_altitude_m: f64,
    home: [f64; 3],
    raw_gps: [f64; 3],
    satellites: u32,
    local_ned_m: [f64; 3],
    velocity_ned_mps: [f64; 3],
    heading_deg: f64,
    attitude_deg: [f64; 3],
    battery_v: f64,
    battery_a: f64,
    battery_percent: f64,
    landed_state: String,
    flight_mode: String,
    armed: bool,
    in_air: bool,
}

#[track_caller]
fn check_near(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    let near = found
        .iter()
        .zip(expected)
        .all(|(a, b)| (a - b).abs() <= tolerance);
    assert!(near, "{what} is {found:?}, expected {expected:?}");
}

/// Metres east, north and up from one place to another near it: latitude, longitude in degrees and height, on WGS 84.
fn from_to(origin: [f64; 3], place: [f64; 3]) -> [f64; 3] {
    let (equator_m, eccentricity_squared) = (6_378_137.0, 6.694_379_990_14e-3);
    let (sin, cos) = origin[0].to_radians().sin_cos();
    let w = 1.0 - eccentricity_squared * sin * sin;
    let meridian_m = equator_m * (1.0 - eccentricity_squared) / w.powf(1.5);
    let parallel_m = equator_m / w.sqrt() * cos;
    [
        (place[1] - origin[1]).to_radians() * parallel_m,
        (place[0] - origin[0]).to_radians() * meridian_m,
        place[2] - origin[2],
    ]
}

#[test]
fn mavsdk_sees_where_the_rover_stands_and_that_it_is_well() {
    // South and west, where signs go wrong.
    let options = [
        "--rover",
        "--origin=-33.8568,-70.6693,520.5",
        "--rover-start=3,-4,210",
    ];
    let told = use_vehicle("mavsdk_autopilot.py", &["telemetry"], MAVSDK, &options);
    let told: Telemetry = serde_json::from_str(&told).expect("one JSON object");

    // Three times what the receiver wanders by, upwards.
    let receiver_m = 0.15;
    for (name, place) in [
        ("position", told.position),
        ("home", told.home),
        ("raw_gps", told.raw_gps),
    ] {
        let found = from_to([-33.8568, -70.6693, 520.5], place);
        check_near(name, &found, &[3.0, -4.0, 0.0], receiver_m);
    }
    check_near("local", &told.local_ned_m, &[-4.0, 3.0, 0.0], receiver_m);
    check_near(
        "height",
        &[told.relative_altitude_m],
        &[0.0],
        2.0 * receiver_m,
    );
    check_near("velocity", &told.velocity_ned_mps, &[0.0; 3], 1e-3);
    check_near("heading", &[told.heading_deg], &[210.0], 0.02);
    check_near("attitude", &told.attitude_deg, &[0.0, 0.0, -150.0], 0.01);
    // Three full cells, and what the electronics draw.
    check_near(
        "battery",
        &[told.battery_v, told.battery_a],
        &[12.6, 0.6],
        0.02,
    );
    check_near("charge", &[told.battery_percent], &[100.0], 0.0);
    assert_eq!(told.satellites, 18);
    let words = [&told.vehicle, &told.landed_state, &told.flight_mode];
    assert_eq!(words, ["ROVER", "ON_GROUND", "MANUAL"]);
    assert!(!told.armed && !told.in_air);
}

#[test]
fn mavproxy_loads_parameters_and_a_mission_without_a_complaint() {
    let folder = tempfile::tempdir().expect("a folder for the logs");
    for (vehicle, parameters) in [("--copter", 41), ("--rover", 35)] {
        let port = free_port();
        let sitl = start_vehicle(port, &[vehicle], &folder.path().join("sitl.log"));
        let told = mavproxy(port, folder.path(), "autopilot");
        assert!(told.contains("by file"), "{vehicle}: {told}");
        let loaded = format!("{parameters} parameters");
        assert!(told.contains(&loaded), "{vehicle}: {told}");
        assert!(told.contains("mission of 3 items"), "{vehicle}: {told}");
        stop(sitl);
    }
}

#[test]
fn mavproxy_flies_a_mission_on_both_vehicles_without_a_complaint() {
    let folder = tempfile::tempdir().expect("a folder for the logs");
    for vehicle in ["--copter", "--rover"] {
        let port = free_port();
        let sitl = start_vehicle(port, &[vehicle], &folder.path().join("sitl.log"));
        let told = mavproxy(port, folder.path(), "mission");
        assert!(
            told.ends_with("mission flown\nfence of 4 items\n"),
            "{vehicle}: {told}"
        );
        stop(sitl);
    }
}

/// A session of `MAVProxy` that listens at this port and expects `whom`; returns what the script prints.
pub(super) fn mavproxy(port: u16, folder: &Path, whom: &str) -> String {
    let endpoint = format!("udpin:127.0.0.1:{port}");
    python(
        "mavproxy_session.py",
        &[endpoint.as_ref(), folder.as_os_str(), whom.as_ref()],
    )
}
