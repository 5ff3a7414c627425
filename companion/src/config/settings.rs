//! The configuration, looked at: typed, in SI units, every value in its range.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

use geodesy::Geodetic;
use maps::camera::Pinhole;
use maps::frame::{Body, Camera, Isometry};
use mavlink_ext::link::LinkUri;
use mavlink_ext::{Address, ComponentId, SystemId};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use sensors::mcap::Topics;
use sensors::zenoh::Patience;
use sensors::{tum, zenoh};
use slam::Seen;

use super::{
    CameraTable, Config, ConfigError, DetectorKind, DetectorTable, Fault, MapTable, MountTable,
    OriginTable, Pace, SlamTable, SourceTable,
};

/// What the companion runs with: a [`Config`] in which every value has been looked at.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Us.
    pub address: Address,
    /// Where colour and depth come from.
    pub source: SourceSettings,
    /// Where the camera is on the vehicle.
    pub body_from_camera: Isometry<Body, Camera>,
    /// Localisation and mapping.
    pub mapping: MappingSettings,
    /// What knows people and vehicles in the colour images.
    pub detector: Option<DetectorSettings>,
    /// The autopilot's link.
    pub autopilot: Option<LinkUri>,
    /// The ground station's link.
    pub ground: Option<LinkUri>,
    /// What may be sent on the ground link: the map gets what everything else leaves of it.
    pub ground_bytes_per_s: u32,
    /// Where the world's origin is; the autopilot is asked if the configuration does not say.
    pub origin: Option<Geodetic>,
    /// Folder for what is written.
    pub out: PathBuf,
}

/// Where colour and depth come from.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceSettings {
    /// A recording or a live camera.
    pub place: SourcePlace,
    /// How fast a recording is played.
    pub pace: Pace,
    /// How to read a TUM folder.
    pub tum: tum::Settings,
    /// The camera of a TUM folder.
    pub camera: Pinhole,
    /// The channels of an MCAP file or of a live camera.
    pub topics: Topics,
}

/// A recording or a live camera.
#[derive(Clone, Debug, PartialEq)]
pub enum SourcePlace {
    /// A folder in TUM layout or an MCAP file; never empty.
    Recording(PathBuf),
    /// A ROS 2 node with `rmw_zenoh`.
    Live(zenoh::Settings, Patience),
}

/// Localisation and mapping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MappingSettings {
    /// Where the camera is on the vehicle, in whose axes its gyroscope measures.
    pub body_from_camera: Isometry<Body, Camera>,
    /// Where the camera looks at the start: counter-clockwise from east.
    pub initial_heading_rad: f64,
    /// How high it is above the floor where no floor is in view at the start.
    pub initial_height_m: f64,
    /// How far below the camera the floor can be at the start.
    pub floor_below_m: [f64; 2],
    /// Depth from farther away is not believed.
    pub max_depth_m: f64,
    /// Edge of a voxel.
    pub resolution_m: f64,
    /// What is seen from farther away is not mapped.
    pub max_range_m: f64,
    /// How often changed tiles are given to the link, in the recording's time.
    pub tile_period: Duration,
}

/// A network that knows people and vehicles.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectorSettings {
    /// What the weights are of.
    pub kind: DetectorKind,
    /// An ONNX file.
    pub weights: PathBuf,
    /// Objects less sure are not believed, 0 to 1.
    pub least_score: f32,
    /// It looks at every so many frames, and its answer is heard so many frames later; at least 1.
    pub every_frames: usize,
}

impl Config {
    /// Looks at every value; the error names all that make no sense.
    pub fn check(&self) -> Result<Settings, ConfigError> {
        let mut faults = Faults::default();
        let settings = self.look(&mut faults);
        faults.into_result(settings)
    }

    fn look(&self, faults: &mut Faults) -> Settings {
        let Self {
            vehicle,
            source,
            map,
            slam,
            links,
            ..
        } = self;
        faults.ensure(
            (1..=254).contains(&vehicle.system_id),
            "vehicle.system_id",
            &vehicle.system_id,
            "1 to 254",
        );
        faults.ensure(
            vehicle.component_id >= 2,
            "vehicle.component_id",
            &vehicle.component_id,
            "2 to 255, as 1 is the autopilot; 191 is the first on-board computer",
        );
        faults.ensure(
            links.ground_bytes_per_s >= 1000,
            "links.ground_bytes_per_s",
            &links.ground_bytes_per_s,
            "at least 1000 bytes/s",
        );
        let body_from_camera = self.mount.check(faults);
        Settings {
            address: Address {
                system: SystemId(vehicle.system_id),
                component: ComponentId(vehicle.component_id),
            },
            source: source.check(&self.camera, faults),
            body_from_camera,
            mapping: slam.check(map, body_from_camera, faults),
            detector: self.detector.as_ref().map(|table| table.check(faults)),
            autopilot: faults.link("links.autopilot", &links.autopilot),
            ground: faults.link("links.ground", &links.ground),
            ground_bytes_per_s: links.ground_bytes_per_s,
            origin: self.origin.as_ref().map(|origin| origin.check(faults)),
            out: self.output.dir.clone(),
        }
    }
}

impl SlamTable {
    fn check(
        &self,
        map: &MapTable,
        body_from_camera: Isometry<Body, Camera>,
        faults: &mut Faults,
    ) -> MappingSettings {
        MappingSettings {
            body_from_camera,
            initial_heading_rad: (90.0
                - faults.within(
                    "slam.initial_heading_deg",
                    self.initial_heading_deg,
                    -360.0..=360.0,
                    "-360 to 360 degrees",
                ))
            .to_radians(),
            initial_height_m: faults.within(
                "slam.initial_height_m",
                self.initial_height_m,
                0.0..=1000.0,
                "0 to 1000 m",
            ),
            floor_below_m: faults.ordered(
                "slam.floor_below_m",
                self.floor_below_m,
                0.0..=1000.0,
                "two heights from 0 to 1000 m, the lower one first",
            ),
            max_depth_m: faults.within(
                "slam.max_depth_m",
                self.max_depth_m,
                0.5..=200.0,
                "0.5 to 200 m",
            ),
            resolution_m: faults.within(
                "map.resolution_m",
                map.resolution_m,
                0.01..=10.0,
                "0.01 to 10 m",
            ),
            max_range_m: faults.within(
                "map.max_range_m",
                map.max_range_m,
                0.1..=1000.0,
                "0.1 to 1000 m",
            ),
            tile_period: seconds(faults.within(
                "map.tile_period_s",
                map.tile_period_s,
                0.0..=3600.0,
                "0 to 3600 s",
            )),
        }
    }
}

impl DetectorTable {
    fn check(&self, faults: &mut Faults) -> DetectorSettings {
        faults.ensure(
            !self.weights.as_os_str().is_empty(),
            "detector.weights",
            &"empty",
            "an ONNX file, trained on the 80 classes of COCO",
        );
        faults.ensure(
            (1..=Seen::KEPT).contains(&self.every_frames),
            "detector.every_frames",
            &self.every_frames,
            "1 to 15 frames: later answers are of no use",
        );
        let least_score = self.least_score.unwrap_or(self.kind.least_score());
        let least_score =
            faults.within("detector.least_score", least_score, 0.0..=1.0, "0 to 1") as f32;
        DetectorSettings {
            kind: self.kind,
            weights: self.weights.clone(),
            least_score,
            every_frames: self.every_frames,
        }
    }
}

impl SourceTable {
    fn check(&self, camera: &CameraTable, faults: &mut Faults) -> SourceSettings {
        let depth_factor = faults.within(
            "source.depth_factor",
            self.depth_factor,
            1.0..=65_535.0,
            "1 to 65535; 5000 for TUM and Bonn recordings, 1000 for millimetres",
        );
        let max_difference_ms = faults.within(
            "source.max_difference_ms",
            self.max_difference_ms,
            0.0..=1000.0,
            "0 to 1000 ms",
        );
        SourceSettings {
            place: self.place(faults),
            pace: self.pace,
            tum: tum::Settings {
                depth_factor,
                max_difference: seconds(max_difference_ms * 1e-3),
                missing_images: self.missing_images,
            },
            camera: camera.check(faults),
            topics: self.topics.clone(),
        }
    }
}

impl SourceTable {
    fn place(&self, faults: &mut Faults) -> SourcePlace {
        let time = "0.1 to 600 s";
        let patience = Patience {
            camera: seconds(faults.within("source.wait_s", self.wait_s, 0.1..=600.0, time)),
            frame: seconds(faults.within("source.silence_s", self.silence_s, 0.1..=600.0, time)),
        };
        faults.ensure(
            self.domain_id <= 232,
            "source.domain_id",
            &self.domain_id,
            "0 to 232, as ROS_DOMAIN_ID of the camera's node",
        );
        let path = self.path.clone();
        match (path.as_os_str().is_empty(), self.zenoh.is_empty()) {
            (false, true) => return SourcePlace::Recording(path),
            (true, false) => {}
            (is_empty, _) => {
                let value = if is_empty {
                    "empty".to_owned()
                } else {
                    format!("{}, beside source.zenoh", path.display())
                };
                faults.ensure(
                    false,
                    "source.path",
                    &value,
                    "either a TUM folder or an MCAP file, which --source gives for this run, or a live camera at source.zenoh",
                );
                return SourcePlace::Recording(path);
            }
        }
        let session = zenoh::Settings::at(&self.zenoh);
        faults.ensure(
            session.is_ok(),
            "source.zenoh",
            &format!("\"{}\"", self.zenoh),
            "tcp/HOST:PORT, where the router of the camera's node is, or listen:tcp/HOST:PORT to be the router",
        );
        let session = zenoh::Settings {
            domain: self.domain_id,
            node: "companion".into(),
            ..session.unwrap_or_default()
        };
        SourcePlace::Live(session, patience)
    }
}

impl CameraTable {
    fn check(&self, faults: &mut Faults) -> Pinhole {
        let sides = "1 to 16384 pixels";
        faults.ensure(
            (1..=16_384).contains(&self.width_px),
            "camera.width_px",
            &self.width_px,
            sides,
        );
        faults.ensure(
            (1..=16_384).contains(&self.height_px),
            "camera.height_px",
            &self.height_px,
            sides,
        );
        let [width, height] = [self.width_px as f64, self.height_px as f64];
        let focal = "a tenth to ten times the image width";
        let center = "a pixel in the image";
        Pinhole {
            width: self.width_px,
            height: self.height_px,
            fx: faults.within(
                "camera.fx_px",
                self.fx_px,
                0.1 * width..=10.0 * width,
                focal,
            ),
            fy: faults.within(
                "camera.fy_px",
                self.fy_px,
                0.1 * width..=10.0 * width,
                focal,
            ),
            cx: faults.within("camera.cx_px", self.cx_px, 0.0..=width, center),
            cy: faults.within("camera.cy_px", self.cy_px, 0.0..=height, center),
            distortion: self.distortion_checked(faults),
        }
    }

    fn distortion_checked(&self, faults: &mut Faults) -> [f64; 5] {
        for &coefficient in &self.distortion {
            faults.within(
                "camera.distortion",
                coefficient,
                -10.0..=10.0,
                "coefficients k1, k2, p1, p2, k3 between -10 and 10",
            );
        }
        self.distortion
    }
}

impl MountTable {
    pub(super) fn check(&self, faults: &mut Faults) -> Isometry<Body, Camera> {
        let mut metres = |key, value| faults.within(key, value, -100.0..=100.0, "-100 to 100 m");
        let position = Translation3::new(
            metres("mount.forward_m", self.forward_m),
            metres("mount.left_m", self.left_m),
            metres("mount.up_m", self.up_m),
        );
        let mut radians = |key, value| {
            let degrees = faults.within(key, value, -360.0..=360.0, "-360 to 360 degrees");
            degrees.to_radians()
        };
        let turned = Rotation3::from_axis_angle(
            &Vector3::z_axis(),
            radians("mount.turned_left_deg", self.turned_left_deg),
        );
        let tilted = Rotation3::from_axis_angle(
            &Vector3::y_axis(),
            radians("mount.tilted_down_deg", self.tilted_down_deg),
        );
        let rolled = Rotation3::from_axis_angle(
            &Vector3::x_axis(),
            radians("mount.rolled_right_deg", self.rolled_right_deg),
        );
        // A camera that looks ahead: its right is the body's -y, its down the body's -z.
        let ahead = Rotation3::from_basis_unchecked(&[-Vector3::y(), -Vector3::z(), Vector3::x()]);
        let rotation = UnitQuaternion::from_rotation_matrix(&(turned * tilted * rolled * ahead));
        Isometry::claim(Isometry3::from_parts(position, rotation))
    }
}

impl OriginTable {
    fn check(&self, faults: &mut Faults) -> Geodetic {
        Geodetic {
            lat_deg: faults.within(
                "origin.lat_deg",
                self.lat_deg,
                -90.0..=90.0,
                "-90 to 90 degrees",
            ),
            lon_deg: faults.within(
                "origin.lon_deg",
                self.lon_deg,
                -180.0..=180.0,
                "-180 to 180 degrees",
            ),
            alt_m: faults.within(
                "origin.alt_m",
                self.alt_m,
                -1000.0..=100_000.0,
                "-1000 to 100000 m above the ellipsoid",
            ),
        }
    }
}

/// What makes no sense so far. Each check gives the value back, so that the next ones are looked at too.
#[derive(Default)]
pub(super) struct Faults(Vec<Fault>);

impl Faults {
    pub(super) fn into_result<T>(self, checked: T) -> Result<T, ConfigError> {
        if self.0.is_empty() {
            Ok(checked)
        } else {
            Err(ConfigError::Values(self.0))
        }
    }

    fn ensure(
        &mut self,
        holds: bool,
        key: &'static str,
        value: &dyn ToString,
        expected: &'static str,
    ) {
        if !holds {
            self.0.push(Fault {
                key,
                value: value.to_string(),
                expected,
            });
        }
    }

    fn within(
        &mut self,
        key: &'static str,
        value: f64,
        range: RangeInclusive<f64>,
        expected: &'static str,
    ) -> f64 {
        // A NaN is in no range.
        self.ensure(range.contains(&value), key, &value, expected);
        value
    }

    /// Two ends of a range, both in `range`.
    fn ordered(
        &mut self,
        key: &'static str,
        [low, high]: [f64; 2],
        range: RangeInclusive<f64>,
        expected: &'static str,
    ) -> [f64; 2] {
        let fits = range.contains(&low) && range.contains(&high) && low <= high;
        self.ensure(fits, key, &format!("[{low}, {high}]"), expected);
        [low, high]
    }

    fn link(&mut self, key: &'static str, uri: &str) -> Option<LinkUri> {
        if uri.is_empty() {
            return None;
        }
        let parsed = uri.parse().ok();
        self.ensure(
            parsed.is_some(),
            key,
            &format!("\"{uri}\""),
            "udpin:HOST:PORT, udpout:HOST:PORT, udpbcast:ADDRESS:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT, \
             serial:DEVICE:BAUD, or nothing for no link",
        );
        parsed
    }
}

/// What is no time has been found fault with before.
fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}
