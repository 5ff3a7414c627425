//! A reader of OPV2V's layout that is not ours in language, and not Rust's in arithmetic, finds in it what it needs.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

use crate::{peers, programs};

fn dataset(out: &Path, options: &[&str]) -> Output {
    let mut sitl = Command::new(programs::folder().join("sitl"));
    sitl.arg("dataset").arg("--out").arg(out).args(options);
    sitl.output().expect("the simulator runs")
}

#[track_caller]
fn check_success(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    said
}

#[test]
fn opencood_finds_points_in_each_box_and_cars_where_cameras_show_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let (opv2v, tandem) = (folder.path().join("opv2v"), folder.path().join("tandem"));
    let what = "--split val --scenes urban-arterial,suburban-road --seeds 1 --frames 2";
    let options = |more: &str| format!("{what} {more}");
    for (out, more) in [(&opv2v, "--layout opv2v"), (&tandem, "--rate 10")] {
        let options = options(more);
        let options: Vec<_> = options.split(' ').collect();
        let said = check_success(&dataset(out, &options));
        assert!(
            said.contains("2 of 2 sequences to make, 4 frames, about"),
            "{said}"
        );
    }
    let (opv2v, tandem) = (opv2v.join("validate"), tandem.join("val"));
    let found = peers::python("opv2v_reader.py", &[opv2v.as_os_str(), tandem.as_os_str()]);
    let found: Value = serde_json::from_str(&found).expect("JSON");
    assert_eq!(found["scenarios"], 2, "{found}");
    assert_eq!(found["frames"], 4, "{found}");
    for agents in found["agents"].as_array().expect("agents") {
        assert!(
            agents[0].as_i64() > Some(0),
            "the ground vehicle is the ego: {found}"
        );
        assert_eq!(agents[1], -1, "{found}");
    }
    for (name, least) in [("vehicles", 12), ("projected", 4), ("shared", 1)] {
        assert!(found[name].as_i64() >= Some(least), "{name}: {found}");
    }
}

#[test]
fn a_set_is_checked_and_a_fault_in_it_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path();
    let options = [
        "--split",
        "test",
        "--scenes",
        "under-bridge",
        "--seeds",
        "1",
        "--frames",
        "1",
    ];
    check_success(&dataset(out, &options));
    let said = check_success(&dataset(out, &["--check"]));
    assert!(
        said.contains("1 sequences") && said.contains("as written"),
        "{said}"
    );
    std::fs::write(
        out.join("test/under-bridge-1100/000000_bev.png"),
        "no picture",
    )
    .expect("written");
    let output = dataset(out, &["--check"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        !output.status.success() && said.contains("under-bridge-1100"),
        "{said}"
    );
    let output = dataset(out, &["--split", "test", "--seeds", "0..3"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        said.contains("seeds 0..3 are not all test seeds: those are 1100..1200"),
        "{said}"
    );
}
