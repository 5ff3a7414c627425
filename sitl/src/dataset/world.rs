//! One street at work: what its sensors see at any moment, for any layout.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::frame::{Body, Camera, Isometry, World as Ground};
use maps::time::Stamp;
use nalgebra::{Isometry3, Point3};

use crate::lidar::Lidar;
use crate::platform;
use crate::rays::Rays;
use crate::render::{Picture, Stage};
use crate::scene::{Class, Instance, RoadUser, Scene};
use crate::truth::boxes;

/// A camera's pose, and what it sees.
pub(super) type Seen = (Isometry<Ground, Camera>, Picture);

/// A scene with all that its moments share.
pub(super) struct World<'a> {
    pub(super) scene: &'a Scene,
    pub(super) stage: Stage<'a>,
    pub(super) rays: Rays<'a>,
    pub(super) lidar: Lidar,
    pub(super) seed: u64,
}

/// A return of the `LiDAR`, where it is in the sensor's frame at the time of its frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Echo {
    pub(super) point: [f32; 3],
    /// After the time of the frame, in seconds: 0 or less.
    pub(super) time_s: f32,
    pub(super) intensity: u8,
    pub(super) ring: u8,
    pub(super) instance: Instance,
}

/// Whether the world moves while the `LiDAR` turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sweep {
    /// As in reality: a turn takes a tenth of a second and ends at the time of the frame.
    Turning,
    /// All returns are of the time of the frame, as in CARLA.
    Frozen,
}

impl<'a> World<'a> {
    pub(super) fn new(scene: &'a Scene, seed: u64) -> Self {
        Self {
            scene,
            stage: Stage::new(scene),
            rays: Rays::new(scene),
            lidar: Lidar::rs_32(),
            seed,
        }
    }

    pub(super) fn ugv(&self, at: Stamp) -> Isometry<Ground, Body> {
        platform::ugv(self.scene, at)
    }

    /// Where the `LiDAR` is.
    pub(super) fn world_from_lidar(&self, at: Stamp) -> Isometry3<f64> {
        self.ugv(at).raw * self.lidar.body_from_sensor
    }

    /// All road users, our ground vehicle among them.
    pub(super) fn road_users(&self, at: Stamp) -> Vec<RoadUser> {
        boxes(self.scene, at)
    }

    /// Our ground vehicle among the road users.
    pub(super) fn robot(&self, at: Stamp) -> Option<RoadUser> {
        let mut movers = self.scene.movers(at).into_iter();
        movers.find(|user| user.thing.class == Class::Robot)
    }

    /// One sweep. How the vehicle moves during it is taken out with its true poses; how others move is not.
    pub(super) fn sweep(&self, at: Stamp, how: Sweep) -> Vec<Echo> {
        let turn = match how {
            Sweep::Turning => self.lidar.turn,
            Sweep::Frozen => Duration::ZERO,
        };
        let lidar = Lidar {
            turn,
            ..self.lidar.clone()
        };
        let start = Stamp::ZERO + at.since(Stamp::ZERO).saturating_sub(turn);
        let returns = lidar.sweep(&self.rays, start, |at| self.ugv(at), self.seed);
        let sensor_from_world = self.world_from_lidar(at).inverse();
        let echo = |seen: &crate::lidar::Return| {
            let after = Duration::from_secs_f32(seen.after_s);
            let then = sensor_from_world * self.world_from_lidar(start + after);
            let point = then * Point3::from(seen.point.map(f64::from));
            Echo {
                point: point.coords.map(|c| c as f32).into(),
                time_s: seen.after_s - turn.as_secs_f32(),
                intensity: seen.intensity,
                ring: seen.ring,
                instance: seen.instance,
            }
        };
        returns.iter().map(echo).collect()
    }
}

/// How many of these points, given in a frame, each thing has that they belong to and in whose box they lie.
pub(super) fn hits(
    points: impl Iterator<Item = ([f32; 3], Instance)>,
    world_from_points: &Isometry3<f64>,
    users: &[RoadUser],
) -> BTreeMap<Instance, u32> {
    let users: BTreeMap<_, _> = users
        .iter()
        .map(|user| (user.thing.instance, user))
        .collect();
    let mut hits = BTreeMap::new();
    for (point, instance) in points {
        let Some(user) = users.get(&instance) else {
            continue;
        };
        let place = world_from_points * Point3::from(point.map(f64::from));
        if is_within(user, place) {
            *hits.entry(instance).or_default() += 1;
        }
    }
    hits
}

/// Whether a place is in the box of a road user.
pub(super) fn is_within(user: &RoadUser, place: Point3<f64>) -> bool {
    let thing = &user.thing;
    let local = thing.place.inverse() * place;
    thing.covers(place) && (0.0..=thing.size.z).contains(&local.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Name;

    #[test]
    fn a_sweep_of_a_driving_vehicle_lies_on_what_stands_still_as_if_it_had_stopped() {
        let scene = Scene::generate(Name::IndustrialPark, 7);
        let mut world = World::new(&scene, 7);
        world.lidar.noise_m = 0.0;
        let at = Stamp::from_nanos(20_000_000_000);
        let way = world.ugv(at).raw.translation.vector
            - world
                .ugv(Stamp::from_nanos(19_900_000_000))
                .raw
                .translation
                .vector;
        assert!(way.norm() > 0.1, "it drives: {} m", way.norm());
        let (snapshot, sensor) = (world.rays.at(at), world.world_from_lidar(at));
        let from = Point3::from(sensor.translation.vector);
        for how in [Sweep::Turning, Sweep::Frozen] {
            let echoes = world.sweep(at, how);
            let echoes: Vec<_> = echoes
                .iter()
                .filter(|echo| !echo.instance.moves())
                .step_by(5)
                .collect();
            let is_on = |echo: &&&Echo| {
                let ray = sensor * Point3::from(echo.point.map(f64::from)) - from;
                let hit = snapshot.cast(from, ray.normalize(), 200.0);
                hit.is_some_and(|hit| (hit.range_m - ray.norm()).abs() < 0.02)
            };
            let on = echoes.iter().filter(is_on).count() as f64 / echoes.len() as f64;
            // Seen from elsewhere, something else may be in between.
            assert!(on > 0.9, "{how:?}: {on}");
            assert!(
                echoes
                    .iter()
                    .all(|echo| (-0.1001..=0.0).contains(&echo.time_s))
            );
        }
    }
}
