//! Where the programs under test are.

use std::path::{Path, PathBuf};

/// The folder of the programs that this test run has built.
pub(crate) fn folder() -> PathBuf {
    let test = std::env::current_exe().expect("a running test has a path");
    let folder = test
        .parent()
        .and_then(Path::parent)
        .expect("target/PROFILE/deps/test")
        .to_owned();
    for name in ["companion", "groundstation", "sitl"] {
        assert!(
            folder.join(name).is_file(),
            "{name} is not built: run `make test`, or `cargo build --bins` first"
        );
    }
    folder
}
