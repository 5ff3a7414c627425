//! ORB-SLAM3 beside us: the Python package `pyorbslam3` in a virtual environment of its own, by `tools/orbslam3`. It is never a
//! dependency; whoever does not ask for it does not need it.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Context as _;

use super::suite::tail;

/// As figures have it.
pub(super) const NAME: &str = "orb-slam3";

/// ORB-SLAM3, installed and with a vocabulary.
pub(super) struct Peer {
    environment: PathBuf,
}

impl Peer {
    /// Installs what is missing into `environment`, and trains the vocabulary on the colour pictures of these recordings unless
    /// there is one.
    pub(super) fn prepare(environment: &Path, recordings: &[&Path]) -> anyhow::Result<Self> {
        let peer = Self {
            environment: std::path::absolute(environment)?,
        };
        let train = std::iter::once(OsStr::new("train"));
        let recordings = recordings.iter().map(|path| path.as_os_str());
        peer.run(&train.chain(recordings).collect::<Vec<_>>())?;
        Ok(peer)
    }

    /// Runs a job; it leaves the same files as one of ours.
    pub(super) fn measure(&self, job: &Path) -> anyhow::Result<()> {
        self.run(&[OsStr::new("run"), job.as_os_str()])
    }

    fn run(&self, arguments: &[&OsStr]) -> anyhow::Result<()> {
        let tool = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tools/orbslam3");
        let output = Command::new(&tool)
            .arg(&self.environment)
            .args(arguments)
            .output()
            .with_context(|| format!("cannot run {}", tool.display()))?;
        anyhow::ensure!(
            output.status.success(),
            "tools/orbslam3 failed with {}: {}",
            output.status,
            tail(&output.stderr)
        );
        Ok(())
    }
}
