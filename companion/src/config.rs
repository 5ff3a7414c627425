//! The configuration file: what flies, where its pictures come from, where its links go.
//!
//! Every key but `source.path` or `source.zenoh` has a default with which the companion runs against the simulator; names end in their units; a key that
//! does not exist is an error. [`Config::check`] turns the file into [`Settings`], where nothing can be wrong any more.

mod settings;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use sensors::mcap::Topics;
use sensors::tum::{self, MissingImages};
use sensors::zenoh::Patience;
use serde::{Deserialize, Serialize};

pub use settings::{DetectorSettings, MappingSettings, Settings, SourcePlace, SourceSettings};

/// Why a configuration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read {}: check the path given with -c", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file is not TOML, or has a key that does not exist.
    #[error("cannot understand {}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: Box<toml::de::Error>,
    },
    /// Values that make no sense, all of them.
    #[error("{}", listed(.0))]
    Values(Vec<Fault>),
}

/// A value that makes no sense.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The key with its table.
    pub key: &'static str,
    /// What it is.
    pub value: String,
    /// What it should be.
    pub expected: &'static str,
}

fn listed(faults: &[Fault]) -> String {
    let line = |fault: &Fault| {
        let Fault {
            key,
            value,
            expected,
        } = fault;
        format!("{key} is {value}, expected {expected}")
    };
    faults.iter().map(line).collect::<Vec<_>>().join("; ")
}

/// The whole file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// `[vehicle]`
    pub vehicle: VehicleTable,
    /// `[source]`
    pub source: SourceTable,
    /// `[camera]`
    pub camera: CameraTable,
    /// `[mount]`
    pub mount: MountTable,
    /// `[slam]`
    pub slam: SlamTable,
    /// `[map]`
    pub map: MapTable,
    /// `[links]`
    pub links: LinksTable,
    /// `[detector]`; without it, people and vehicles are known by how they move alone.
    pub detector: Option<DetectorTable>,
    /// `[origin]`; without it the origin is the autopilot's home.
    pub origin: Option<OriginTable>,
    /// `[output]`
    pub output: OutputTable,
}

/// `[vehicle]`: whose companion this is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VehicleTable {
    /// What it does.
    pub role: Role,
    /// MAVLink system id of the vehicle, 1..=254; its autopilot has the same.
    pub system_id: u8,
    /// MAVLink component id of the companion: 191 is the first on-board computer.
    pub component_id: u8,
}

/// What a companion does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// On the drone: maps what its camera sees and streams the map.
    Uav,
}

/// `[source]`: where colour and depth come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SourceTable {
    /// A folder in TUM layout or an MCAP file. A relative path starts at the configuration file.
    pub path: PathBuf,
    /// Instead of `path`: a live camera's ROS 2 node with `rmw_zenoh`. `tcp/HOST:PORT` is where its router is,
    /// `listen:tcp/HOST:PORT` makes the companion the router.
    pub zenoh: String,
    /// Live: `ROS_DOMAIN_ID`.
    pub domain_id: u32,
    /// Live: how long the camera's description is waited for at the start.
    pub wait_s: f64,
    /// Live: how long no frame may come before the camera is given up.
    pub silence_s: f64,
    /// How fast a recording is played.
    pub pace: Pace,
    /// TUM folders: the value of a depth pixel at 1 m.
    pub depth_factor: f64,
    /// TUM folders: how far apart the colour and the depth image of a frame may be.
    pub max_difference_ms: f64,
    /// TUM folders: `"error"` refuses a folder in which listed images are missing, `"skip"` leaves their frames out.
    pub missing_images: MissingImages,
    /// MCAP files and live: the names of the channels.
    pub topics: Topics,
}

/// How fast a recording is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pace {
    /// As it was recorded; falls behind rather than leave out a frame.
    Recorded,
    /// As fast as it can be processed.
    Fast,
}

/// `[camera]`: the camera of a TUM folder; an MCAP file and a live camera bring their own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraTable {
    /// Image width.
    pub width_px: usize,
    /// Image height.
    pub height_px: usize,
    /// Focal length along x.
    pub fx_px: f64,
    /// Focal length along y.
    pub fy_px: f64,
    /// Principal point.
    pub cx_px: f64,
    /// Principal point.
    pub cy_px: f64,
    /// `[k1, k2, p1, p2, k3]`, as ROS's `plumb_bob` and `OpenCV` have them.
    pub distortion: [f64; 5],
}

/// `[mount]`: where the camera sits on the vehicle; all zero is at its reference point, looking ahead.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MountTable {
    /// Ahead of the reference point.
    pub forward_m: f64,
    /// To its left.
    pub left_m: f64,
    /// Above it.
    pub up_m: f64,
    /// Turned to the left about the vertical.
    pub turned_left_deg: f64,
    /// Tilted down; 90 looks at the ground.
    pub tilted_down_deg: f64,
    /// Rolled to the right about the view ray.
    pub rolled_right_deg: f64,
}

/// `[slam]`: where the world is at the start, and what is believed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SlamTable {
    /// Where the camera looks at the start: clockwise from north; 90 is east.
    pub initial_heading_deg: f64,
    /// How high it is above the floor where no floor is in view at the start.
    pub initial_height_m: f64,
    /// The least and the greatest height above the floor that the camera can have at the start: planes at other heights,
    /// tables say, are not taken for it.
    pub floor_below_m: [f64; 2],
    /// Depth from farther away is not believed: 6 m is what small depth cameras are good for indoors.
    pub max_depth_m: f64,
}

/// `[map]`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MapTable {
    /// Edge of a voxel.
    pub resolution_m: f64,
    /// What is seen from farther away is not mapped.
    pub max_range_m: f64,
    /// How often changed tiles are given to the link, in the recording's time.
    pub tile_period_s: f64,
}

/// `[links]`: MAVLink. An empty string is no link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LinksTable {
    /// The vehicle's autopilot; Tandem's own messages never go there.
    pub autopilot: String,
    /// The ground station: the companion's own radio, not one behind the autopilot.
    pub ground: String,
    /// What may be sent on the ground link: the map gets what everything else leaves of it.
    pub ground_bytes_per_s: u32,
}

/// `[detector]`: a network that knows people and vehicles in the colour images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectorTable {
    /// What the weights are of.
    pub kind: DetectorKind,
    /// An ONNX file, trained on the 80 classes of COCO. A relative path starts at the configuration file.
    pub weights: PathBuf,
    /// Objects less sure are not believed, 0 to 1; the kind's own where absent, see [`DetectorKind::least_score`].
    pub least_score: Option<f64>,
    /// It looks at every so many frames, and its answer is heard so many frames later.
    #[serde(default = "every_third")]
    pub every_frames: usize,
}

/// At 30 frames a second, ten looks.
fn every_third() -> usize {
    3
}

/// Which network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DetectorKind {
    /// [`perception::Yolox`].
    Yolox,
    /// [`perception::FastestDet`].
    FastestDet,
}

impl DetectorKind {
    /// From which score on its objects are mostly right; those of `FastestDet`, geometric means, are higher.
    pub fn least_score(self) -> f64 {
        match self {
            Self::Yolox => 0.3,
            Self::FastestDet => 0.65,
        }
    }
}

/// `[origin]`: where the world's origin is on earth (WGS-84).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OriginTable {
    /// Latitude, north positive.
    pub lat_deg: f64,
    /// Longitude, east positive.
    pub lon_deg: f64,
    /// Height above the ellipsoid.
    pub alt_m: f64,
}

/// `[output]`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputTable {
    /// Folder for the report, the trajectory and the map; made if absent. A relative path starts where the program
    /// was started, as that of `--out`.
    pub dir: PathBuf,
}

impl Default for VehicleTable {
    fn default() -> Self {
        Self {
            role: Role::Uav,
            system_id: 1,
            component_id: 191,
        }
    }
}

impl Default for SourceTable {
    fn default() -> Self {
        let tum = tum::Settings::default();
        let Patience { camera, frame } = Patience::default();
        Self {
            path: PathBuf::new(),
            zenoh: String::new(),
            domain_id: 0,
            wait_s: camera.as_secs_f64(),
            silence_s: frame.as_secs_f64(),
            pace: Pace::Recorded,
            depth_factor: tum.depth_factor,
            max_difference_ms: tum.max_difference.as_secs_f64() * 1e3,
            missing_images: tum.missing_images,
            topics: Topics::default(),
        }
    }
}

/// The camera that TUM recommends for its recordings where no calibration is at hand.
impl Default for CameraTable {
    fn default() -> Self {
        Self {
            width_px: 640,
            height_px: 480,
            fx_px: 525.0,
            fy_px: 525.0,
            cx_px: 319.5,
            cy_px: 239.5,
            distortion: [0.0; 5],
        }
    }
}

impl Default for SlamTable {
    fn default() -> Self {
        Self {
            initial_heading_deg: 90.0,
            initial_height_m: 1.5,
            floor_below_m: [0.15, 20.0],
            max_depth_m: 6.0,
        }
    }
}

impl Default for MapTable {
    fn default() -> Self {
        Self {
            resolution_m: 0.05,
            max_range_m: 5.0,
            tile_period_s: 1.0,
        }
    }
}

impl Default for LinksTable {
    fn default() -> Self {
        Self {
            autopilot: "udpin:127.0.0.1:14561".into(),
            ground: "udpout:127.0.0.1:14550".into(),
            ground_bytes_per_s: 500_000,
        }
    }
}

impl Default for OutputTable {
    fn default() -> Self {
        Self { dir: "out".into() }
    }
}

impl Config {
    /// Reads a file as it is written: see [`Self::relative_to`] for what paths in it mean.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = fs::read_to_string(path).map_err(|source| ConfigError::Read {
            path: path.to_owned(),
            source,
        })?;
        toml::from_str(&text).map_err(|source| ConfigError::Parse {
            path: path.to_owned(),
            source: Box::new(source),
        })
    }

    /// The same with relative paths of source and weights starting at the file they were read from.
    #[must_use]
    pub fn relative_to(mut self, file: &Path) -> Self {
        let folder = file.parent().unwrap_or(Path::new(""));
        let weights = self.detector.as_mut().map(|detector| &mut detector.weights);
        for path in std::iter::once(&mut self.source.path).chain(weights) {
            if !path.as_os_str().is_empty() {
                *path = folder.join(&path);
            }
        }
        self
    }

    /// The file as it would have to be written to get this.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string_pretty(self)
    }
}

#[cfg(test)]
mod tests;
