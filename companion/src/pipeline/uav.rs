//! From camera frames to a map, without threads and clocks.
//!
//! Every frame is tracked. A keyframe goes into the map when its pose has settled, so that nothing has to be taken out
//! again; changed tiles are handed out once in a period of the *recording's* time, all with one version. The same
//! recording thus gives the same map and the same tiles, however fast it is played.

use std::time::Duration;

use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Camera, Isometry, World};
use maps::scan::Scan;
use maps::tile::Tile;
use maps::time::Stamp;
use maps::voxel::{MapDigest, Rgb, Sources, VoxelMap};
use slam::{DenseKeyframe, Floor, FrameError, Overlay, Slam, Tracked};

use crate::config::MappingSettings;

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

/// SLAM and the map it fills.
pub struct Mapper {
    slam: Slam,
    map: VoxelMap,
    points: u64,
    points_beneath: u64,
    warned: bool,
    max_range_m: f64,
    tile_period: Duration,
    last_update: Option<Stamp>,
    version: u64,
}

impl Mapper {
    /// Starts with an empty map.
    pub fn new(camera: Pinhole, settings: &MappingSettings) -> Self {
        let [lowest, highest] = settings.floor_below_m;
        let slam = slam::Settings {
            initial_heading_rad: settings.initial_heading_rad,
            initial_height_m: settings.initial_height_m,
            floor_below_m: lowest..=highest,
            max_depth_m: settings.max_depth_m,
            ..slam::Settings::default()
        };
        Self {
            slam: Slam::new(camera, slam),
            map: VoxelMap::new(settings.resolution_m),
            points: 0,
            points_beneath: 0,
            warned: false,
            max_range_m: settings.max_range_m,
            tile_period: settings.tile_period,
            last_update: None,
            version: 0,
        }
    }

    /// Where the camera was when it took the frame.
    pub fn track(&mut self, frame: &RgbdFrame) -> Result<Tracked, FrameError> {
        let had_floor = self.slam.floor().is_some();
        let tracked = self.slam.track(frame)?;
        if let (false, Some(floor)) = (had_floor, self.slam.floor()) {
            tracing::info!("floor {floor}");
        }
        Ok(tracked)
    }

    /// The floor on which the map stands; none before the first frame that could be used.
    pub fn floor(&self) -> Option<FloorFigures> {
        let beneath_share = self.points_beneath as f64 / self.points.max(1) as f64;
        self.slam.floor().map(|floor| FloorFigures {
            floor,
            beneath_share,
        })
    }

    /// Puts the keyframes that have settled into the map; how many there were.
    pub fn insert_settled(&mut self) -> usize {
        let keyframes = self.slam.take_keyframes();
        self.insert(&keyframes);
        keyframes.len()
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
        let keyframes = self.slam.finish();
        self.insert(&keyframes);
        self.changed()
    }

    /// The map so far.
    pub fn map(&self) -> &VoxelMap {
        &self.map
    }

    /// How large the map is so far; takes time in proportion.
    pub fn figures(&self) -> MapFigures {
        MapFigures {
            digest: self.map.digest(),
            tiles: self.map.tile_ids().len(),
            voxels_occupied: self.map.occupied_count(),
            voxels_known: self.map.known_count(),
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

    fn insert(&mut self, keyframes: &[DenseKeyframe]) {
        for keyframe in keyframes {
            let place = |(p, _): &(_, _)| keyframe.world_from_camera * *p;
            let hits: Vec<_> = keyframe.points.iter().map(place).collect();
            let beneath = hits.iter().filter(|p| p.raw.z < -CLEARLY_BENEATH_M).count();
            self.points += hits.len() as u64;
            self.points_beneath += beneath as u64;
            let colors: Vec<Rgb> = keyframe.points.iter().map(|&(_, c)| Rgb(c)).collect();
            self.map.insert_scan(&Scan {
                colors: &colors,
                max_range_m: self.max_range_m,
                at: keyframe.at,
                source: Sources::UAV,
                ..Scan::new(keyframe.world_from_camera.translation(), &hits)
            });
        }
        self.doubt_floor();
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
        if !self.warned && self.points >= ENOUGH_POINTS && beneath_share > SUSPICIOUS_SHARE {
            self.warned = true;
            tracing::warn!(
                "{:.0} % of what is seen lies beneath the floor ({floor}): perhaps that is a table; heights in the map \
                 count from it. Start in view of the floor, or exclude the table with slam.floor_below_m",
                100.0 * beneath_share
            );
        }
    }

    fn changed(&mut self) -> Option<MapUpdate> {
        let ids = self.map.take_changed_tiles();
        if ids.is_empty() {
            return None;
        }
        self.version += 1;
        let versioned = |id| {
            let mut tile = self.map.tile(id)?;
            tile.version = self.version;
            Some(tile)
        };
        Some(MapUpdate {
            tiles: ids.into_iter().filter_map(versioned).collect(),
            map: self.figures(),
        })
    }
}
