//! What there is to be seen: flat faces with a material, and things that move.
//!
//! A scene is generated from a seed and is a pure function of time, so that a picture, its depth and its truth are of
//! one instant by construction. World axes as everywhere: x east, y north, z up, the floor at z = 0. The scene's origin
//! lies below the place where the camera of [`crate::flight`] starts.

mod class;
mod light;
mod material;
mod room;
mod shape;
mod street;
mod walker;

use std::sync::Arc;

use maps::frame::{Point, Vector, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Point3, Vector3};

use crate::platform::Platform;
use crate::way::Way;

pub use class::Class;
pub(crate) use light::Daylight;
pub use light::{Light, Sun};
pub use material::Material;
pub(crate) use material::{Colours, Spots};
pub(crate) use room::CENTRE as ROOM_CENTRE;
pub(crate) use shape::Block;
pub use walker::Walker;

/// Which thing a pixel shows. Everything made of one piece shares an instance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instance(pub u16);

impl Instance {
    /// No surface at all: the light above the walls.
    pub const NOTHING: Self = Self(0);
    /// The floor.
    pub const FLOOR: Self = Self(1);
    /// The first of those that move.
    pub const FIRST_MOVER: Self = Self(0x8000);

    /// Whether it moves.
    pub fn moves(self) -> bool {
        self >= Self::FIRST_MOVER
    }
}

/// A flat surface with two parallel edges, seen from the side that `edge_u × edge_v` points to: a rectangle if `top` is
/// `[0, 1]`, a triangle if both are the same, else a trapezoid.
///
/// ```text
///      corner + edge_v + top[0]·edge_u ┌────────┐ corner + edge_v + top[1]·edge_u
///                                     /          \
///                              corner └────────────┘ corner + edge_u
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// One corner.
    pub corner: Point<World>,
    /// From the corner along one side, in metres.
    pub edge_u: Vector<World>,
    /// From the corner towards the opposite side, at a right angle to the first.
    pub edge_v: Vector<World>,
    /// Where the opposite side starts and ends, as shares of `edge_u`.
    pub top: [f64; 2],
    /// What it looks like.
    pub material: Material,
    /// What it belongs to.
    pub instance: Instance,
}

impl Face {
    /// Its corners, counter-clockwise as seen; the last two are one if it is a triangle.
    pub fn corners(&self) -> [Point<World>; 4] {
        let along = |share: f64| self.corner + self.edge_u * share;
        let [left, right] = self.top.map(|share| along(share) + self.edge_v);
        [self.corner, along(1.0), right, left]
    }
}

/// Something with a name of its own: what its faces belong to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thing {
    /// Its number in instance images.
    pub instance: Instance,
    /// What it is.
    pub class: Class,
    /// From its own frame, whose origin is in the middle of the bottom of its box and whose x axis points forward.
    pub place: Isometry3<f64>,
    /// Length, width and height of its box in metres; zeros if it has none, as the ground.
    pub size: Vector3<f64>,
}

impl Thing {
    /// The middle of its box.
    pub fn centre(&self) -> Point3<f64> {
        self.place * Point3::new(0.0, 0.0, self.size.z / 2.0)
    }

    /// Whether a place is inside of its box as seen from above.
    pub fn covers(&self, place: Point3<f64>) -> bool {
        let local = self.place.inverse() * place;
        local.x.abs() <= self.size.x / 2.0 && local.y.abs() <= self.size.y / 2.0
    }
}

/// A [`Thing`] that takes part in traffic, or is parked, at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoadUser {
    /// What and where it is.
    pub thing: Thing,
    /// How fast it goes, in m/s.
    pub velocity: Vector3<f64>,
}

/// Everything that can be seen, at any time.
#[derive(Clone, Debug)]
pub struct Scene {
    still: Vec<Face>,
    things: Vec<Thing>,
    walkers: Vec<Walker>,
    street: Option<street::Street>,
    light: Light,
    /// Where vehicles went that do not move as the scene would have them: the drone and the ground vehicle.
    ways: [Option<Arc<Way>>; 2],
}

/// Scenes that can be asked for by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Name {
    /// A furnished room of 7 m by 5.8 m with three people walking in it.
    Room,
    /// A narrow street between rows of houses, with cars parked on both sides.
    ResidentialAlley,
    /// Four lanes, shops, high houses, much traffic.
    UrbanArterial,
    /// Halls, yards with goods, trucks; a low sun.
    IndustrialPark,
    /// A road that bends between gardens, against the setting sun.
    SuburbanRoad,
    /// A street that leads below a bridge and through a roofed passage.
    UnderBridge,
}

impl Name {
    /// The outdoor scenes.
    pub const STREETS: [Self; 5] = [
        Self::ResidentialAlley,
        Self::UrbanArterial,
        Self::IndustrialPark,
        Self::SuburbanRoad,
        Self::UnderBridge,
    ];
}

impl std::fmt::Display for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Room => "room",
            Self::ResidentialAlley => "residential-alley",
            Self::UrbanArterial => "urban-arterial",
            Self::IndustrialPark => "industrial-park",
            Self::SuburbanRoad => "suburban-road",
            Self::UnderBridge => "under-bridge",
        })
    }
}

impl Scene {
    /// Builds the scene of that name. The same seed gives the same scene.
    pub fn generate(name: Name, seed: u64) -> Self {
        street::street(name, seed).unwrap_or_else(|| room::room(seed))
    }

    /// Lets a vehicle go its own way from now on: others see it there, but traffic does not know.
    pub fn follow(&mut self, platform: Platform, way: Arc<Way>) {
        if let (Platform::Ugv, Some(street)) = (platform, &mut self.street) {
            street.drive(&way);
        }
        self.ways[platform as usize] = Some(way);
    }

    /// The way of a vehicle that has its own.
    pub(crate) fn way(&self, platform: Platform) -> Option<&Way> {
        self.ways[platform as usize].as_deref()
    }

    /// Faces that stand in a light, for tests.
    #[cfg(test)]
    pub(crate) fn of(still: Vec<Face>, light: Light) -> Self {
        Self {
            still,
            things: Vec::new(),
            walkers: Vec::new(),
            street: None,
            light,
            ways: [None, None],
        }
    }

    /// The faces of all that stands still.
    pub fn still(&self) -> &[Face] {
        &self.still
    }

    /// The faces of all that moves, where it is at that moment.
    pub fn moving(&self, at: Stamp) -> Vec<Face> {
        let mut faces = Vec::new();
        for walker in &self.walkers {
            walker.add_faces(at, &mut faces);
        }
        if let Some(street) = &self.street {
            street.add_movers(at, &mut faces);
        }
        faces
    }

    /// What stands still and has a name of its own.
    pub fn things(&self) -> &[Thing] {
        &self.things
    }

    /// Road users that are on their way at that moment.
    pub fn movers(&self, at: Stamp) -> Vec<RoadUser> {
        let street = self.street.iter();
        street.flat_map(|street| street.movers(at)).collect()
    }

    /// What an instance is. In the room, whatever stands there is an object and whoever walks there a pedestrian.
    pub fn class_of(&self, instance: Instance) -> Class {
        if instance == Instance::NOTHING {
            return Class::Sky;
        }
        let index = usize::from(instance.0);
        if instance.moves() {
            let street = self.street.as_ref();
            return street
                .and_then(|street| street.class_of(instance))
                .unwrap_or(Class::Pedestrian);
        }
        let thing = self.things.get(index - 1);
        thing.map_or(Class::Object, |thing| thing.class)
    }

    /// The street, for where vehicles go; `None` for the room.
    pub(crate) fn street(&self) -> Option<&street::Street> {
        self.street.as_ref()
    }

    /// Those who move.
    pub fn walkers(&self) -> &[Walker] {
        &self.walkers
    }

    /// What lights it.
    pub fn light(&self) -> &Light {
        &self.light
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_room_and_another_seed_another() {
        let corners = |seed| -> Vec<_> {
            let scene = Scene::generate(Name::Room, seed);
            let moving = scene.moving(Stamp::from_nanos(1_000_000_000));
            let faces = scene.still().iter().chain(&moving);
            faces.map(|face| face.corner).collect()
        };
        assert_eq!(corners(1), corners(1));
        assert_ne!(corners(1), corners(2));
    }
}
