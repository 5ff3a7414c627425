//! From camera frames to a map, without threads and clocks.
//!
//! Every frame is tracked. A keyframe goes into the map when its pose has settled; where a closed loop corrects the poses
//! all the same, the map is made anew (`remaking`). Changed tiles are handed out once in a period of the *recording's*
//! time, all with one version. The same recording thus gives the same map and the same tiles, however fast it is played.

mod remaking;

use std::time::Duration;

use geodesy::{Geodetic, Origin};
use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Body, Camera, Isometry, World};
use maps::tile::Tile;
use maps::time::Stamp;
use maps::voxel::{MapDigest, VoxelMap};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use sensors::beside::{Beside, SatelliteFix};
use slam::{Aid, Felt, Fix, Floor, FrameError, FrontEnd, Look, Overlay, Seen, Slam, Tracked};

use super::detecting::{DetectorFigures, Lookout};
use crate::config::MappingSettings;
use remaking::DenseMap;

/// Tiles that have changed, and the map they are part of.
#[derive(Clone, Debug)]
pub struct MapUpdate {
    /// The changed tiles, in order of their ids, with their new version.
    pub tiles: Vec<Tile>,
    /// The whole map with these tiles in it.
    pub map: MapFigures,
}

/// How large the map is, and which it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapFigures {
    /// Digest of the whole map.
    pub digest: MapDigest,
    /// Tiles in it.
    pub tiles: usize,
    /// Occupied voxels in it.
    pub voxels_occupied: usize,
    /// Free and occupied voxels in it.
    pub voxels_known: usize,
}

/// The floor on which the map stands, and whether the map agrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorFigures {
    /// What the floor was taken to be in the first frame.
    pub floor: Floor,
    /// Of the dense points so far, those more than [`CLEARLY_BENEATH_M`] below it; 0 to 1. A floor has next to none: where
    /// this is large, a table was taken for it, or the ground falls away.
    pub beneath_share: f64,
}

/// Farther below the floor than this is no noise of the depth camera.
pub const CLEARLY_BENEATH_M: f64 = 0.25;
/// A larger share of points beneath the floor says that it is none.
const SUSPICIOUS_SHARE: f64 = 0.05;
/// Fewer points say nothing.
const ENOUGH_POINTS: u64 = 20_000;

fn slam_settings(settings: &MappingSettings) -> slam::Settings {
    let [lowest, highest] = settings.floor_below_m;
    slam::Settings {
        initial_heading_rad: settings.initial_heading_rad,
        initial_height_m: settings.initial_height_m,
        floor_below_m: lowest..=highest,
        max_depth_m: settings.max_depth_m,
        ..slam::Settings::default()
    }
}

/// SLAM and the map it fills.
pub struct Mapper {
    slam: Slam,
    lookout: Option<Lookout>,
    dense: DenseMap,
    camera_from_body: Isometry<Camera, Body>,
    /// From where positions by satellites count: the first of them.
    first_fix: Option<Origin>,
    warned: bool,
    tile_period: Duration,
    last_update: Option<Stamp>,
    version: u64,
}

impl Mapper {
    /// Starts with an empty map; people and vehicles are known by how they move, and by `lookout`.
    pub fn new(camera: Pinhole, settings: &MappingSettings, lookout: Option<Lookout>) -> Self {
        Self {
            lookout,
            slam: Slam::new(camera, slam_settings(settings)),
            dense: DenseMap::new(settings.resolution_m, settings.max_range_m),
            camera_from_body: settings.body_from_camera.inverse(),
            first_fix: None,
            warned: false,
            tile_period: settings.tile_period,
            last_update: None,
            version: 0,
        }
    }

    /// Finds features in frames, in another thread, for [`Mapper::track_seen`].
    pub fn front_end(camera: Pinhole, settings: &MappingSettings) -> FrontEnd {
        FrontEnd::new(camera, &slam_settings(settings))
    }

    /// Where the camera was when it took the frame.
    pub fn track(&mut self, frame: &RgbdFrame) -> Result<Tracked, FrameError> {
        let look = self.slam.front_end().look(frame)?;
        self.track_seen(frame, look, &Beside::default())
    }

    /// The same for a frame in which features were sought before, with what other sensors say.
    pub fn track_seen(
        &mut self,
        frame: &RgbdFrame,
        look: Look,
        beside: &Beside,
    ) -> Result<Tracked, FrameError> {
        let had_floor = self.slam.floor().is_some();
        let in_camera = |turn: UnitQuaternion<f64>| {
            let axes = self.camera_from_body.rotation();
            axes * turn * axes.inverse()
        };
        let answer = self.lookout.as_mut().and_then(|l| l.pass(frame));
        let aid = Aid {
            turned: beside.turned.map(in_camera),
            // The unit, like the antenna, is taken to be where the body's axes meet.
            felt: beside.specific_force.map(|force| Felt {
                specific_force: self.camera_from_body.rotation() * force,
                unit_in_camera: self.camera_from_body.raw.translation.vector,
            }),
            position: beside.fix.and_then(|fix| self.locate(&fix)),
            objects: answer.as_ref().map(|answer| Seen {
                of: answer.of,
                objects: &answer.objects,
            }),
        };
        let unheard = self.slam.unheard();
        let tracked = self.slam.track_look(frame, look, &aid)?;
        if unheard == 0 && self.slam.unheard() > 0 {
            tracing::warn!(
                "what the detector says is of a frame that was not tracked; later ones are counted alone"
            );
        }
        if let (false, Some(floor)) = (had_floor, self.slam.floor()) {
            tracing::info!("floor {floor}");
        }
        Ok(tracked)
    }

    /// A position east, north and up of the first one.
    fn locate(&mut self, fix: &SatelliteFix) -> Option<Fix> {
        let place = Geodetic {
            lat_deg: fix.latitude_deg,
            lon_deg: fix.longitude_deg,
            alt_m: fix.altitude_m,
        };
        if self.first_fix.is_none() {
            self.first_fix = Origin::new(place.lat_deg, place.lon_deg, place.alt_m).ok();
        }
        let position = self.first_fix?.to_world(place).raw.coords;
        Some(Fix {
            at: fix.at,
            position,
            covariance: Matrix3::from_diagonal(&Vector3::from(fix.variances_m2)),
            // The antenna is taken to be where the body's axes meet.
            antenna_in_camera: self.camera_from_body.raw.translation.vector,
        })
    }

    /// What the detector has done so far, where there is one.
    pub fn detector(&self) -> Option<DetectorFigures> {
        let figures = self.lookout.as_ref()?.figures();
        let unheard = self.slam.unheard();
        Some(DetectorFigures { unheard, ..figures })
    }

    /// The floor on which the map stands; none before the first frame that could be used.
    pub fn floor(&self) -> Option<FloorFigures> {
        let points = self.dense.points();
        let beneath_share = points.beneath as f64 / points.all.max(1) as f64;
        self.slam.floor().map(|floor| FloorFigures {
            floor,
            beneath_share,
        })
    }

    /// Puts keyframes that have settled into the map; how many.
    pub fn insert_settled(&mut self) -> usize {
        self.dense.take(self.slam.take_keyframes());
        let inserted = self.dense.insert_some();
        self.doubt_floor();
        inserted
    }

    /// The tiles that have changed since the last update, if a period of the recording has gone by.
    pub fn update(&mut self, at: Stamp) -> Option<MapUpdate> {
        let last = *self.last_update.get_or_insert(at);
        if at.since(last) < self.tile_period {
            return None;
        }
        self.last_update = Some(at);
        self.changed()
    }

    /// Ends the recording: the keyframes that had not settled go into the map, and the last tiles are handed out.
    pub fn finish(&mut self) -> Option<MapUpdate> {
        self.dense.take(self.slam.finish());
        while self.dense.insert_some() > 0 {}
        self.doubt_floor();
        self.changed()
    }

    /// The map so far.
    pub fn map(&self) -> &VoxelMap {
        self.dense.map()
    }

    /// How large the map is so far; takes time in proportion.
    pub fn figures(&self) -> MapFigures {
        MapFigures {
            digest: self.map().digest(),
            tiles: self.map().tile_ids().len(),
            voxels_occupied: self.map().occupied_count(),
            voxels_known: self.map().known_count(),
        }
    }

    /// Where the camera was in every tracked frame, by all that is known now.
    pub fn trajectory(&self) -> Vec<(Stamp, Isometry<World, Camera>)> {
        self.slam.trajectory()
    }

    /// What was made of the last frame, for pictures.
    pub fn overlay(&self) -> Overlay {
        self.slam.overlay()
    }

    /// Says once, in the log, that the floor is none.
    fn doubt_floor(&mut self) {
        let Some(FloorFigures {
            floor,
            beneath_share,
        }) = self.floor()
        else {
            return;
        };
        if !self.warned
            && self.dense.points().all >= ENOUGH_POINTS
            && beneath_share > SUSPICIOUS_SHARE
        {
            self.warned = true;
            tracing::warn!(
                "{:.0} % of what is seen lies beneath the floor ({floor}): perhaps that is a table; heights in the map \
                 count from it. Start in view of the floor, or exclude the table with slam.floor_below_m",
                100.0 * beneath_share
            );
        }
    }

    fn changed(&mut self) -> Option<MapUpdate> {
        let tiles = self.dense.take_changed(self.version + 1);
        if tiles.is_empty() {
            return None;
        }
        self.version += 1;
        Some(MapUpdate {
            tiles,
            map: self.figures(),
        })
    }
}
