//! Streets: the outdoor scenes, built along a centre line from a [`style`](Name) and a seed.
//!
//! The street leads east from the scene's origin, which is on its centre line, and bends a little. What is fixed comes
//! first: ground, bridges, houses, trees, what stands about, parked vehicles. Then traffic is let loose on its lanes and
//! pavements.

mod cover;
mod ground;
mod houses;
mod movers;
mod parked;
mod people;
mod plants;
mod style;
mod things;
mod vehicles;

use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Duration;

use maps::time::Stamp;
use nalgebra::{Isometry3, Point2, Vector2, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::shape::{Block, Look, standing};
use super::{Class, Face, Instance, Light, Material, Name, RoadUser, Scene, Sun, Thing};
use crate::way::Way;
use movers::Mover;
use style::{Style, style};

/// Where the street starts and ends, along it.
pub(crate) const ENDS_M: [f64; 2] = [-60.0, 150.0];
/// The height of a kerb.
const KERB_M: f64 = 0.12;

/// A street of that name; `None` for the room.
pub(super) fn street(name: Name, seed: u64) -> Option<Scene> {
    let style = style(name)?;
    let mut site = Site::new(&style, seed);
    ground::lay(&mut site);
    cover::build(&mut site);
    houses::build(&mut site);
    parked::park(&mut site);
    plants::plant(&mut site);
    things::place(&mut site);
    let movers = movers::set_out(&mut site, seed);
    let light = Sun {
        seed: site.seed(),
        ..site.style.light
    };
    let street = Street {
        course: site.course,
        flight_m: site.style.flight_m,
        movers,
    };
    Some(Scene {
        still: site.faces,
        things: site.things,
        walkers: Vec::new(),
        street: Some(street),
        light: Light::Sun(light),
        ways: [None, None],
    })
}

/// A street when it is built: its course, and who is on their way in it.
#[derive(Clone, Debug)]
pub(crate) struct Street {
    course: Course,
    flight_m: f64,
    movers: Vec<Mover>,
}

impl Street {
    /// Its centre line.
    pub(crate) fn course(&self) -> Course {
        self.course
    }

    /// Where our ground vehicle is on the ground, and its heading. After the end of the traffic it stays where it was.
    pub(crate) fn guest(&self, at: Stamp) -> (Point2<f64>, f64) {
        let last = Stamp::ZERO + movers::DURATION - Duration::from_millis(1);
        let guest = self.movers.iter().find(|mover| mover.class == Class::Robot);
        let state = guest.and_then(|guest| guest.state(at).or_else(|| guest.state(last)));
        state.map_or((Point2::origin(), 0.0), |state| {
            (state.position.into(), state.heading_rad)
        })
    }

    /// Lets our ground vehicle go its own way.
    pub(super) fn drive(&mut self, way: &Arc<Way>) {
        let robots = self
            .movers
            .iter_mut()
            .filter(|mover| mover.class == Class::Robot);
        robots.for_each(|robot| robot.drive(Arc::clone(way)));
    }

    /// How high the drone flies.
    pub(crate) fn flight_m(&self) -> f64 {
        self.flight_m
    }

    pub(super) fn add_movers(&self, at: Stamp, faces: &mut Vec<Face>) {
        for mover in &self.movers {
            mover.add_faces(at, self.course, faces);
        }
    }

    pub(super) fn movers(&self, at: Stamp) -> impl Iterator<Item = RoadUser> {
        self.movers.iter().filter_map(move |mover| {
            let state = mover.state(at)?;
            let thing = Thing {
                instance: mover.instance,
                class: mover.class,
                place: mover.place(&state, self.course),
                size: mover.size,
            };
            // People may look elsewhere than they go.
            let soon = mover.state(at + Duration::from_millis(1))?;
            let way = Vector2::from(soon.position) - Vector2::from(state.position);
            let ahead = way.try_normalize(1e-9).unwrap_or_default();
            let velocity = Vector3::new(ahead.x, ahead.y, 0.0) * state.speed_mps;
            Some(RoadUser { thing, velocity })
        })
    }

    pub(super) fn class_of(&self, instance: Instance) -> Option<Class> {
        let index = usize::from(instance.0 - Instance::FIRST_MOVER.0);
        self.movers.get(index).map(|mover| mover.class)
    }
}

/// The centre line of a street: `y = a (1 - cos 2πx/l)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Course {
    bend_m: f64,
    length_m: f64,
}

impl Course {
    /// A place this far along the street, and this far to the left of its centre line.
    pub(crate) fn place(self, along: f64, left: f64) -> Point2<f64> {
        let angle = TAU * along / self.length_m;
        let heading = self.heading(along);
        let left = Vector2::new(-heading.sin(), heading.cos()) * left;
        Point2::new(along, self.bend_m * (1.0 - angle.cos())) + left
    }

    /// Its direction there, counter-clockwise from east.
    pub(crate) fn heading(self, along: f64) -> f64 {
        let slope = self.bend_m * TAU / self.length_m * (TAU * along / self.length_m).sin();
        slope.atan()
    }

    fn is_straight(self) -> bool {
        self.bend_m == 0.0
    }
}

/// What is being built.
struct Site {
    style: Style,
    course: Course,
    faces: Vec<Face>,
    things: Vec<Thing>,
    /// What people have to walk around: place and radius.
    obstacles: Vec<(Point2<f64>, f64)>,
    random: Pcg64,
}

impl Site {
    fn new(style: &Style, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed ^ 0x57_3ee7);
        let [bend_m, length_m] = style.bend_m;
        let mirrored = if random.random::<bool>() { -1.0 } else { 1.0 };
        Self {
            style: *style,
            course: Course {
                bend_m: bend_m * mirrored / 2.0,
                length_m: length_m * random.random_range(0.9..1.1),
            },
            faces: Vec::new(),
            things: Vec::new(),
            obstacles: Vec::new(),
            random,
        }
    }

    fn seed(&mut self) -> u32 {
        self.random.random()
    }

    fn within(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.random.random::<f64>()
    }

    fn chance(&mut self, share: f64) -> bool {
        self.random.random::<f64>() < share
    }

    /// A new thing without a box of its own.
    fn instance(&mut self, class: Class) -> Instance {
        self.thing(class, Isometry3::identity(), Vector3::zeros())
    }

    /// A new thing that stands in the middle of the bottom of a box.
    fn thing(&mut self, class: Class, place: Isometry3<f64>, size: Vector3<f64>) -> Instance {
        let instance = Instance(1 + u16::try_from(self.things.len()).unwrap_or(u16::MAX / 2));
        self.things.push(Thing {
            instance,
            class,
            place,
            size,
        });
        instance
    }

    fn block(&mut self, place: Isometry3<f64>, size: [f64; 3], look: Look) {
        let block = Block {
            bottom: place.translation.vector.into(),
            heading_rad: place.rotation.euler_angles().2,
            size: size.into(),
        };
        block.add_faces(look.material, look.instance, &mut self.faces);
    }

    /// A box that is a thing.
    fn stand(&mut self, class: Class, place: Isometry3<f64>, size: [f64; 3], material: Material) {
        let instance = self.thing(class, place, size.into());
        self.block(place, size, Look { material, instance });
    }

    /// Beside the street, turned along it.
    fn beside(&self, along: f64, left: f64, up: f64) -> Isometry3<f64> {
        let at = self.course.place(along, left);
        standing(at.x, at.y, up, self.course.heading(along))
    }

    /// How high the ground is at the edge of the road.
    fn pavement_up(&self, side: f64) -> f64 {
        if self.style.pavement_m[style::index(side)] > 0.0 {
            KERB_M
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests;
