//! Where a mission takes place: the recording that the companion sees, and what the operator does there.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use anyhow::{Context as _, bail, ensure};
use toml::{Table, Value};

use maps::frame::Point;
use maps::time::Stamp;
use sitl::platform;
use sitl::scene::{Name, Scene};
use sitl::wgs84::{Geodetic, Origin};

use super::{Options, Ports, say};
use crate::program::Program;

/// A place for a mission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Scenario {
    /// An office through which people walk, recorded by the University of Bonn (`rgbd_bonn_crowd`).
    Office {
        /// The folder of the recording.
        recording: PathBuf,
    },
    /// A residential alley that the simulator renders, with cars and people on their ways.
    Street,
}

/// The street of the mission, and its seed.
const STREET: (Name, u64) = (Name::ResidentialAlley, 1);
/// Where the street's origin is on Earth.
const STREET_ORIGIN: Geodetic = Geodetic {
    lat_deg: 50.7277,
    lon_deg: 7.0866,
    alt_m: 110.0,
};
/// How long the drone films the street.
const STREET_SECONDS: &str = "16";

impl Scenario {
    /// The office, if its recording is there.
    pub fn office(recording: &Path) -> anyhow::Result<Self> {
        ensure!(
            recording.join("rgb.txt").is_file(),
            "{} is no recording in the TUM layout: it has no rgb.txt",
            recording.display()
        );
        Ok(Self::Office {
            recording: recording.to_owned(),
        })
    }

    /// Makes what the mission needs before it begins.
    pub(super) fn prepare(&self, options: &Options) -> anyhow::Result<()> {
        match self {
            Self::Office { recording } => say(&format!("recording: {}", recording.display())),
            Self::Street => {
                let file = self.source(options);
                say("the simulator films a street from the drone (0.4 GB)");
                let (scene, seed) = STREET;
                let mut command = Command::new(options.programs.join("sitl"));
                command.args(["run", "--headless", "--aboard", "uav/camera"]);
                command.args(["--scene", &scene.to_string(), "--seed", &seed.to_string()]);
                command
                    .args(["--duration", STREET_SECONDS, "--record"])
                    .arg(&file);
                let log = options.out.join("record.log");
                Program::start("record", command, &log, options.show)?
                    .wait(Duration::from_mins(8))?;
                ensure!(file.is_file(), "the simulator left no {}", file.display());
            }
        }
        Ok(())
    }

    /// The companion's configuration: the one that ships with it, on this mission's recording and ports.
    pub(super) fn companion_config(
        &self,
        options: &Options,
        ports: Ports,
    ) -> anyhow::Result<Table> {
        let shipped = match self {
            Self::Office { .. } => include_str!("../../../companion/config/demo-bonn.toml"),
            Self::Street => include_str!("../../../companion/config/demo-sitl.toml"),
        };
        let mut config: Table = shipped
            .parse()
            .context("the companion's configuration for the demo is no TOML")?;
        let source = std::path::absolute(self.source(options))
            .context("cannot find the working directory")?;
        set(&mut config, "source", "path", source.display().to_string());
        set(
            &mut config,
            "links",
            "autopilot",
            format!("udpin:127.0.0.1:{}", ports.autopilot),
        );
        set(
            &mut config,
            "links",
            "ground",
            format!("udpout:127.0.0.1:{}{}", ports.ground, options.signing()),
        );
        if *self == Self::Street {
            let table = config.get_mut("origin").and_then(Value::as_table_mut);
            let table = table.context("the configuration has no [origin]")?;
            let place = map_origin();
            for (key, value) in [
                ("lat_deg", place.lat_deg),
                ("lon_deg", place.lon_deg),
                ("alt_m", place.alt_m),
            ] {
                table.insert(key.to_owned(), Value::Float(value));
            }
        }
        Ok(config)
    }

    /// The scene in which vehicles drive, as `sitl run` takes it. What they do is told apart from what the recording shows.
    pub(super) fn scene(&self) -> [String; 4] {
        let (scene, seed) = match self {
            Self::Office { .. } => (Name::Room, 1),
            Self::Street => STREET,
        };
        let [scene, seed] = [scene.to_string(), seed.to_string()];
        ["--scene".to_owned(), scene, "--seed".to_owned(), seed]
    }

    /// Where the scene's origin is on Earth, as `sitl run --origin` takes it.
    pub(super) fn origin(&self, config: &Table) -> anyhow::Result<String> {
        let Geodetic {
            lat_deg,
            lon_deg,
            alt_m,
        } = STREET_ORIGIN;
        match self {
            Self::Office { .. } => origin(config),
            Self::Street => Ok(format!("{lat_deg},{lon_deg},{alt_m}")),
        }
    }

    /// What the operator does, for the ground station's `--script`.
    pub(super) fn script(&self) -> &'static str {
        match self {
            Self::Office { .. } => include_str!("../../demo/office.script"),
            Self::Street => include_str!("../../demo/street.script"),
        }
    }

    /// Where the rover stands at first, on floor that the recording shows, as `sitl run --rover-start` takes it: metres east
    /// and north of the scene's origin, degrees clockwise from north.
    pub(super) fn rover_start(&self) -> &'static str {
        match self {
            Self::Office { .. } => "1.85,-0.4,210",
            Self::Street => "14,-1.4,90",
        }
    }

    fn source(&self, options: &Options) -> PathBuf {
        match self {
            Self::Office { recording } => recording.clone(),
            Self::Street => options.out.join("street.mcap"),
        }
    }
}

fn set(config: &mut Table, section: &str, key: &str, value: String) {
    if let Some(section) = config.get_mut(section).and_then(Value::as_table_mut) {
        section.insert(key.to_owned(), Value::String(value));
    }
}

/// Where on Earth the map of the street has its origin: on the ground below the drone's camera when it starts to film.
fn map_origin() -> Geodetic {
    let (scene, seed) = STREET;
    let scene = Scene::generate(scene, seed);
    let camera = platform::uav_camera(&scene, Stamp::ZERO, seed).translation();
    let ground = Point::new(camera.raw.x, camera.raw.y, 0.0);
    Origin::new(STREET_ORIGIN).to_geodetic(ground)
}

/// The mission's origin in a companion's configuration, as `sitl run --origin` takes it.
fn origin(config: &Table) -> anyhow::Result<String> {
    let origin = config
        .get("origin")
        .and_then(Value::as_table)
        .context("the configuration has no [origin]")?;
    let numbers =
        ["lat_deg", "lon_deg", "alt_m"].map(|key| origin.get(key).and_then(Value::as_float));
    let [Some(lat_deg), Some(lon_deg), Some(alt_m)] = numbers else {
        bail!("[origin] lacks lat_deg, lon_deg or alt_m")
    };
    Ok(format!("{lat_deg},{lon_deg},{alt_m}"))
}
