//! Other people's MAVLink programs talk to ours.

use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;

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
