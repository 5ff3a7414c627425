//! An operator runs one mission with the real programs, and other people's tools read what it leaves behind.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use octomap::referee::Referee;
use tests::demo::{self, Options, Scenario, Window};
use tests::program::Show;

use crate::{peers, programs};

#[test]
fn a_mission_over_signed_links_in_a_street_succeeds_and_others_can_read_it() {
    let folder = tempfile::tempdir().expect("a folder for the mission");
    let out = folder.path().join("mission");
    let key = folder.path().join("link.key");
    let mut make_key = Command::new(programs::folder().join("companion"));
    make_key.arg("key").arg(&key);
    let made = make_key.status().expect("the companion starts");
    assert!(made.success(), "the key is made");
    let options = Options {
        programs: programs::folder(),
        out: out.clone(),
        window: Window::Headless,
        show: Show::Nothing,
        key: Some(key),
    };
    #[expect(
        clippy::disallowed_methods,
        reason = "the mission runs in real time, with real programs"
    )]
    let started = Instant::now();

    let report = demo::run(&Scenario::Street, &options, started).unwrap_or_else(|error| {
        let log = |name: &str| fs::read_to_string(out.join(name)).unwrap_or_default();
        panic!(
            "{error:#}\n--- groundstation\n{}\n--- companion\n{}\n--- sitl\n{}",
            log("groundstation.log"),
            log("companion.log"),
            log("sitl.log")
        )
    });
    // Speed is measured by the demo and the benches; a test build on a busy machine says nothing about it.
    let failures: Vec<_> = report
        .failures()
        .into_iter()
        .filter(|f| !f.starts_with("slam_fps"))
        .collect();
    assert_eq!(failures, Vec::<String>::new(), "{report:#?}");

    a_replay_makes_the_same_map(&out, &report.map_digest_companion);
    liboctomap_counts_the_same_occupied_voxels(&out, report.map_voxels_occupied);
    pymavlink_decodes_every_frame(&out.join("mission.tlog"));
}

/// The companion that flew took images at their pace, with links and threads; one that replays them has none of that.
fn a_replay_makes_the_same_map(out: &Path, digest: &str) {
    let replayed = out.join("replayed");
    let output = Command::new(programs::folder().join("companion"))
        .args(["replay", "-c"])
        .arg(out.join("companion.toml"))
        .arg("--out")
        .arg(&replayed)
        .arg(out.join("street.mcap"))
        .output()
        .expect("the companion starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let report = fs::read_to_string(replayed.join("report.json")).expect("a report");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(report["map_digest"], digest);
}

fn liboctomap_counts_the_same_occupied_voxels(out: &Path, occupied: u64) {
    for name in ["map.ot", "map.bt"] {
        let tree = Referee::read(&out.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(tree.occupied_count(), occupied, "{name}");
    }
}

fn pymavlink_decodes_every_frame(tlog: &Path) {
    let dialect = Path::new(env!("CARGO_MANIFEST_DIR")).join("../mavlink_ext/dialects/tandem.xml");
    let decoded = peers::python("decode_tlog.py", &[dialect.as_os_str(), tlog.as_os_str()]);
    let log: serde_json::Value = serde_json::from_str(&decoded).expect("one JSON object");
    assert_eq!(log["bad"], 0, "{log}");
    for message in [
        "TANDEM_ORIGIN",
        "TANDEM_OBJECT",
        "TANDEM_SYMBOL",
        "TANDEM_REPORT",
        "TANDEM_STATUS",
        "MISSION_ITEM_INT",
    ] {
        assert!(
            log["messages"][message].as_u64().is_some_and(|n| n > 0),
            "no {message} in {log}"
        );
    }
}
