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
            return Sky::HIDDEN;
        }
        Sky::over(self.snapshot(at), antenna)
    }
}
