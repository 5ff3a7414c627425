//! Road users in boxes, and which share of each a camera sees.

use std::collections::BTreeMap;

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Point3, Vector3};

use crate::render::{Moment, Picture};
use crate::scene::{Class, Instance, Scene};

/// A road user, parked ones included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
    /// Its number in instance images.
    pub instance: Instance,
    /// What it is.
    pub class: Class,
    /// From the frame in the middle of its bottom, x forward, z up.
    pub world_from_box: Isometry3<f64>,
    /// Length, width and height in metres.
    pub size_m: Vector3<f64>,
    /// In the world, in m/s.
    pub velocity_mps: Vector3<f64>,
}

impl Box3 {
    /// Its middle.
    pub fn centre(&self) -> Point3<f64> {
        self.world_from_box * Point3::new(0.0, 0.0, self.size_m.z / 2.0)
    }

    /// Whether a place is inside of its outline on the ground, as seen from above.
    pub fn covers(&self, place: Point3<f64>) -> bool {
        let local = self.world_from_box.inverse() * place;
        local.x.abs() <= self.size_m.x / 2.0 && local.y.abs() <= self.size_m.y / 2.0
    }
}

/// All road users at that moment, by instance.
pub fn boxes(scene: &Scene, at: Stamp) -> Vec<Box3> {
    let parked = scene
        .things()
        .iter()
        .filter(|thing| thing.class.is_traffic());
    let parked = parked.map(|thing| (*thing, Vector3::zeros()));
    let moving = scene
        .movers(at)
        .into_iter()
        .map(|moving| (moving.thing, moving.velocity));
    parked
        .chain(moving)
        .map(|(thing, velocity_mps)| Box3 {
            instance: thing.instance,
            class: thing.class,
            world_from_box: thing.place,
            size_m: thing.size,
            velocity_mps,
        })
        .collect()
}

/// What a camera sees of a thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// What a camera sees of each road user that it could see any of.
pub fn sight(
    moment: &Moment<'_>,
    camera: &Pinhole,
    world_from_camera: Isometry<World, Camera>,
    picture: &Picture,
) -> BTreeMap<Instance, Sight> {
    let scene = moment.scene();
    let is_wanted = |instance| scene.class_of(instance).is_traffic();
    let mut visible: BTreeMap<Instance, u32> = BTreeMap::new();
    for instance in &picture.instance {
        *visible.entry(*instance).or_default() += 1;
    }
    let alone = moment.coverage(camera, world_from_camera, is_wanted);
    alone
        .into_iter()
        .map(|(instance, alone)| {
            let visible = visible.get(&instance).copied().unwrap_or(0);
            (instance, Sight { visible, alone })
        })
        .collect()
}
