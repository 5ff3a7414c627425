//! An operator opens recorded telemetry in the ground station.

use std::fs;
use std::path::Path;
use std::process::Command;

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
