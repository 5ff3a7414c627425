//! Whoever reads our figures can have them computed by `evo`, and gets the same.

use std::path::Path;
use std::process::Command;

use crate::{peers, programs};

/// The real recording if it is there, else the simulated room: either has truth.
fn case(data: &Path) -> &'static str {
    if data.join("rgbd/tum_fr1_rpy_a").is_dir() {
        "tum_fr1_rpy_a"
    } else {
        "sitl-room"
    }
}

#[test]
fn evo_finds_the_errors_that_evaluate_reports() {
    let out = tempfile::tempdir().expect("a folder");
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let mut evaluate = Command::new(programs::folder().join("evaluate"));
    evaluate.args([
        "slam",
        "--methods",
        "tandem",
        "--cases",
        case(&data),
        "--out",
    ]);
    evaluate.arg(out.path());
    if data.is_dir() {
        evaluate.arg("--data").arg(&data);
    }
    let output = evaluate.output().expect("it starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");

    let compared = peers::python("evo_slam.py", &[out.path().as_os_str()]);
    assert!(compared.contains("2 figures agree to 1 %"), "{compared}");

    // It would tell of a difference: shift one of the positions on which both agree.
    let estimates = out.path().join("slam").join(case_folder(out.path()));
    let file = estimates.join("tandem.txt");
    let text = std::fs::read_to_string(&file).expect("an estimate");
    std::fs::write(&file, shifted(&text)).expect("written");
    let python = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/peers/bin/python");
    let output = Command::new(python)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/evo_slam.py"))
        .arg(out.path())
        .output()
        .expect("it starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        !output.status.success() && said.contains("more than 1 % apart"),
        "{said}"
    );
}

/// The only case in a folder of results.
fn case_folder(out: &Path) -> std::ffi::OsString {
    let mut entries = std::fs::read_dir(out.join("slam")).expect("results");
    let only = entries.next().expect("one case").expect("readable");
    only.file_name()
}

/// A trajectory whose last pose is a metre off.
fn shifted(text: &str) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let last = lines.last_mut().expect("a pose");
    let mut words: Vec<String> = last.split(' ').map(str::to_owned).collect();
    let x: f64 = words[1].parse().expect("a number");
    words[1] = (x + 1.0).to_string();
    *last = words.join(" ");
    lines.join("\n") + "\n"
}
