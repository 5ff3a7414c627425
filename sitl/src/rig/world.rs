//! What sensors look at: a scene at one moment after another, prepared once for all that look at the same.

use maps::time::Stamp;
use nalgebra::{Point3, Vector3};

use crate::platform::Platform;
use crate::rays::{Rays, Snapshot};
use crate::render::{Moment, Stage};
use crate::scene::Scene;
use crate::sensor::gnss::Sky;
use crate::vehicle::Motion;
use crate::wgs84::Origin;

use super::Setup;

/// Farther walls reflect too little to matter.
const WALLS_M: f64 = 40.0;
/// Rays by which the open share of the sky is told.
const SKY_RAYS: u32 = 48;
/// Satellites lower than this are left out by receivers.
const MASK_RAD: f64 = 0.17;

/// A scene and the last moment at which it was looked at.
pub(super) struct World<'a> {
    pub(super) scene: &'a Scene,
    pub(super) seed: u64,
    pub(super) origin: Origin,
    stage: Stage<'a>,
    rays: Rays<'a>,
    moment: Option<Moment<'a>>,
    snapshot: Option<(Stamp, Snapshot)>,
}

impl<'a> World<'a> {
    pub(super) fn new(scene: &'a Scene, setup: &Setup) -> Self {
        Self {
            scene,
            seed: setup.seed,
            origin: setup.origin.clone(),
            stage: Stage::new(scene),
            rays: Rays::new(scene),
            moment: None,
            snapshot: None,
        }
    }

    /// Where a vehicle is and how it moves.
    pub(super) fn motion(&self, platform: Platform, at: Stamp) -> (Motion, Vector3<f64>) {
        let (motion, acceleration) = platform.motion(self.scene, at, self.seed);
        (motion, acceleration.raw)
    }

    /// The scene for cameras that take their time.
    pub(super) fn stage(&self) -> &Stage<'a> {
        &self.stage
    }

    /// The scene for cameras.
    pub(super) fn moment(&mut self, at: Stamp) -> &Moment<'a> {
        let stage = &self.stage;
        let known = self.moment.take().filter(|moment| moment.at() == at);
        self.moment.insert(known.unwrap_or_else(|| stage.at(at)))
    }

    /// The scene for rays.
    pub(super) fn snapshot(&mut self, at: Stamp) -> &Snapshot {
        let rays = &self.rays;
        let known = self.snapshot.take().filter(|(of, _)| *of == at);
        &self
            .snapshot
            .insert(known.unwrap_or_else(|| (at, rays.at(at))))
            .1
    }

    /// The scene for rays that leave one after the other.
    pub(super) fn rays(&self) -> &Rays<'a> {
        &self.rays
    }

    /// How much of the sky an antenna sees, and the nearest wall. Indoors there is no sky.
    pub(super) fn sky(&mut self, antenna: Point3<f64>, at: Stamp) -> Sky {
        if self.scene.street().is_none() {
            return Sky {
                open: 0.0,
                wall: None,
            };
        }
        let snapshot = self.snapshot(at);
        let open =
            (0..SKY_RAYS).filter(|ray| snapshot.cast(antenna, towards_sky(*ray), 300.0).is_none());
        let open = open.count() as f64 / f64::from(SKY_RAYS);
        let walls = (0..16).filter_map(|i| {
            let (left, forward) = (std::f64::consts::TAU * f64::from(i) / 16.0).sin_cos();
            let direction = Vector3::new(forward, left, 0.0);
            let hit = snapshot.cast(antenna, direction, WALLS_M)?;
            Some((hit.range_m, direction))
        });
        let wall = walls.min_by(|(a, _), (b, _)| a.total_cmp(b));
        Sky {
            open,
            wall: wall.map(|(_, direction)| maps::frame::Vector::from_raw(direction)),
        }
    }
}

/// Directions spread evenly over the sky above the mask: equal areas lie between equal steps of the sine of elevation, and
/// the golden angle keeps them apart.
fn towards_sky(ray: u32) -> Vector3<f64> {
    const GOLDEN_RAD: f64 = 2.399_963_229_728_653;
    let low = MASK_RAD.sin();
    let up = low + (1.0 - low) * (f64::from(ray) + 0.5) / f64::from(SKY_RAYS);
    let flat = (1.0 - up * up).sqrt();
    let (left, forward) = (GOLDEN_RAD * f64::from(ray)).sin_cos();
    Vector3::new(flat * forward, flat * left, up)
}
