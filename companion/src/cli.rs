//! The command line.

mod map;

use std::path::PathBuf;

use anyhow::Result;
use clap::{Parser, Subcommand};
use companion::config::Config;

pub(crate) use map::MapCommand;

/// The on-board service: sensors to SLAM to a map on the wire.
#[derive(Parser)]
#[command(version)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Subcommand)]
pub(crate) enum Command {
    /// Maps what the camera sees and serves the map until it is stopped.
    Run {
        #[command(flatten)]
        options: Options,
        /// Folder in TUM layout or MCAP file, instead of the configured one.
        #[arg(long, value_name = "PATH")]
        source: Option<PathBuf>,
        /// Prints the configuration, defaults included, and ends.
        #[arg(long)]
        print_config: bool,
    },
    /// Processes a recording as fast as it goes, without links, and writes its map, trajectory, figures and a page to look at.
    Replay {
        /// Folder in TUM layout or MCAP file.
        source: PathBuf,
        #[command(flatten)]
        options: Options,
    },
    /// Checks configuration, source, camera, detector, links, disk and clock: one line each, ok or what to do.
    Doctor {
        #[command(flatten)]
        options: Options,
        /// Folder in TUM layout or MCAP file, instead of the configured one.
        #[arg(long, value_name = "PATH")]
        source: Option<PathBuf>,
        /// How long to listen for the autopilot.
        #[arg(long, default_value_t = 3.0, value_parser = seconds)]
        listen_s: f64,
    },
    /// Makes a key with which links are signed, in a new file: copy it to the other programs' machines, and put
    /// ?signing=required&key=FILE behind each link.
    Key {
        /// The new file, readable by its owner only.
        file: PathBuf,
    },
    /// Says what is in a map file, converts it, draws it.
    Map {
        #[command(subcommand)]
        command: MapCommand,
    },
}

#[derive(clap::Args)]
pub(crate) struct Options {
    /// Configuration file; the defaults without. Every key is explained in companion/config/reference.toml.
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Folder for what is written, instead of the configured one.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn seconds(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|s| (0.0..=60.0).contains(s));
    value.ok_or_else(|| "expected 0 to 60 seconds".to_owned())
}

impl Options {
    /// The configuration with what the command line says instead, to run with.
    pub(crate) fn read(self, source: Option<PathBuf>) -> Result<Config> {
        let file = self.config.clone();
        let config = self.read_as_written(None)?;
        let mut config = match &file {
            Some(file) => config.relative_to(file),
            None => config,
        };
        instead(&mut config, source);
        Ok(config)
    }

    /// The same with paths as they stand in the file, to print.
    pub(crate) fn read_as_written(self, source: Option<PathBuf>) -> Result<Config> {
        let mut config = self
            .config
            .map_or(Ok(Config::default()), |path| Config::read(&path))?;
        instead(&mut config, source);
        config.output.dir = self.out.unwrap_or(config.output.dir);
        Ok(config)
    }
}

/// A recording of the command line, instead of whatever is configured.
fn instead(config: &mut Config, source: Option<PathBuf>) {
    if let Some(path) = source {
        config.source.path = path;
        config.source.zenoh.clear();
    }
}
