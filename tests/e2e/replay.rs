//! An operator opens recorded telemetry in the ground station.

use std::fs;
use std::path::Path;
use std::process::Command;

use mavlink_ext::presence::companion_heartbeat;
use mavlink_ext::tlog::TlogWriter;
use mavlink_ext::{Address, Encoder, Message};

use crate::programs;

#[test]
fn real_telemetry_replays_to_its_end_and_leaves_a_picture() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/telemetry");
    let Ok(files) = fs::read_dir(&folder) else {
        println!("skipped: no recorded telemetry beside the repository");
        return;
    };
    let out = tempfile::tempdir().expect("a folder for the pictures");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("demo/telemetry.script");
    let logs = files.map(|file| file.expect("a readable folder").path());
    for log in logs.filter(|path| {
        path.extension()
            .is_some_and(|extension| extension == "tlog")
    }) {
        let picture = out.path().join("replay.png");
        let output = Command::new(programs::folder().join("groundstation"))
            .args(["--headless", "--replay"])
            .arg(&log)
            .arg("--script")
            .arg(&script)
            .arg("--screenshot")
            .arg(out.path())
            .output()
            .expect("the ground station starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}: {said}", log.display());
        let size = fs::metadata(&picture)
            .unwrap_or_else(|error| panic!("{}: {error}: {said}", log.display()))
            .len();
        assert!(
            size > 10_000,
            "{}: a picture of {size} bytes is blank",
            log.display()
        );
        fs::remove_file(&picture).expect("a picture to remove");
    }
}

/// Two seconds of a rover's heartbeats.
fn heartbeats_of_a_rover() -> Vec<u8> {
    let mut log = TlogWriter::new(Vec::new());
    let mut encoder = Encoder::new(Address::new(2, 1));
    for tenth in 0..20 {
        let frame = encoder.encode(&Message::HEARTBEAT(companion_heartbeat()));
        log.write(1_790_000_000_000_000 + 100_000 * tenth, &frame)
            .expect("memory");
    }
    log.into_inner()
}

/// What the ground station says when it must fail.
#[track_caller]
fn refusal(arguments: &[&str]) -> String {
    let output = Command::new(programs::folder().join("groundstation"))
        .args(arguments)
        .output()
        .expect("the ground station starts");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success(), "{said}");
    said
}

#[test]
fn an_order_in_a_replay_fails_with_the_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let place = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    fs::write(place("rover.tlog"), heartbeats_of_a_rover()).expect("writes");
    fs::write(
        place("arm.script"),
        "wait-for replay-end timeout 30\narm 2\nquit\n",
    )
    .expect("writes");
    let said = refusal(&[
        "--headless",
        "--replay",
        &place("rover.tlog"),
        "--script",
        &place("arm.script"),
    ]);
    assert!(said.contains("a recording cannot be commanded"), "{said}");
}

#[test]
fn a_recording_that_is_there_is_never_written_over() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("rover.tlog");
    let before = heartbeats_of_a_rover();
    fs::write(&log, &before).expect("writes");
    let said = refusal(&["--headless", "--record", &log.to_string_lossy()]);
    assert!(said.contains("choose another name"), "{said}");
    assert_eq!(fs::read(&log).expect("still there"), before);
}
