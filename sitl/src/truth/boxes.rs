//! Road users in boxes, and which share of each a camera sees.

use std::collections::BTreeMap;

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::Vector3;

use crate::render::{Moment, Picture};
use crate::scene::{Instance, RoadUser, Scene};

/// All road users at that moment, parked ones first, each with its box.
pub fn boxes(scene: &Scene, at: Stamp) -> Vec<RoadUser> {
    let things = scene.things().iter().copied();
    let parked = things.filter(|thing| thing.class.is_traffic());
    let parked = parked.map(|thing| RoadUser {
        thing,
        velocity: Vector3::zeros(),
    });
    parked.chain(scene.movers(at)).collect()
}

/// What a camera sees of a thing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sight {
    /// Pixels that show it.
    pub visible: u32,
    /// Pixels that would show it if nothing else were there.
    pub alone: u32,
}

impl Sight {
    /// The share of it that other things hide, from 0 to 1.
    pub fn occlusion(self) -> f64 {
        1.0 - f64::from(self.visible) / f64::from(self.alone.max(1))
    }
}

/// What cameras with the same lens see together of each road user that any of them could see: each from its pose, with its
/// picture.
pub fn sight(
    moment: &Moment<'_>,
    lens: &Pinhole,
    views: &[(Isometry<World, Camera>, Picture)],
) -> BTreeMap<Instance, Sight> {
    let scene = moment.scene();
    let is_wanted = |instance| scene.class_of(instance).is_traffic();
    let mut sights: BTreeMap<Instance, Sight> = BTreeMap::new();
    for (pose, picture) in views {
        for (instance, alone) in moment.coverage(lens, *pose, is_wanted) {
            sights.entry(instance).or_default().alone += alone;
        }
        for instance in &picture.instance {
            if let Some(sight) = sights.get_mut(instance) {
                sight.visible += 1;
            }
        }
    }
    sights
}
