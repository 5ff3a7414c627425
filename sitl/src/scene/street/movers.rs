//! Who is on their way in a street.

use std::sync::Arc;
use std::time::Duration;

use maps::time::Stamp;
use nalgebra::{Isometry3, Vector3};

use super::people::{Person, feet};
use super::vehicles::{bicycle, bus, car, facing, robot, truck};
use super::{ENDS_M, KERB_M, Site, ground, style};
use crate::scene::shape::placed;
use crate::scene::{Class, Face, Instance};
use crate::traffic::{
    Agents, Crossing, Guest, Kind, Lane, Obstacle, Path, Plan, Priority, State, Track, Traffic,
    Walkway,
};
use crate::way::Way;

/// How long traffic goes on.
pub(crate) const DURATION: Duration = Duration::from_mins(4);

/// A road user.
#[derive(Clone, Debug)]
pub(in crate::scene) struct Mover {
    pub(in crate::scene) instance: Instance,
    pub(in crate::scene) class: Class,
    /// Length, width and height in metres.
    pub(in crate::scene) size: Vector3<f64>,
    track: Track,
    /// Where it went instead.
    driven: Option<Arc<Way>>,
    look: Look,
    /// Where the pavement is higher than the road: distance from the middle, at the left and at the right.
    kerbs: [f64; 2],
}

#[derive(Clone, Debug)]
enum Look {
    Vehicle(Vec<Face>),
    Cyclist(Person, Vec<Face>),
    Pedestrian(Person),
}

/// Lets traffic loose.
pub(super) fn set_out(site: &mut Site, seed: u64) -> Vec<Mover> {
    let plan = plan(site);
    let traffic = Traffic::generate(&plan, seed ^ 0x7_4aff1c);
    let kerbs = [1.0, -1.0].map(|side| {
        if site.pavement_up(side) > 0.0 {
            site.style.kerb_m(side)
        } else {
            f64::INFINITY
        }
    });
    let tracks = traffic.tracks.into_iter();
    (Instance::FIRST_MOVER.0..)
        .zip(tracks)
        .map(|(instance, track)| Mover::new(Instance(instance), track, kerbs))
        .collect()
}

fn plan(site: &Site) -> Plan {
    let style = &site.style;
    let mut lanes = Vec::new();
    for lane in 0..style.lanes {
        let left = style.lane_m * (lane as f64 + 0.5);
        for left in [-left, left] {
            let mut points = line(site, left);
            if left > 0.0 {
                points.reverse(); // traffic keeps to the right
            }
            lanes.push(Lane {
                path: Path::open(&points, 10.0),
                width_m: style.lane_m,
                speed_limit_mps: style.speed_mps,
            });
        }
    }
    let mut walkways = Vec::new();
    for side in [1.0, -1.0] {
        let width = style.pavement_m[style::index(side)];
        if width > 1.0 {
            let middle = side * (style.kerb_m(side) + width / 2.0);
            walkways.push(Walkway {
                path: Path::open(&line(site, middle), 2.0),
                width_m: width,
            });
        }
    }
    let start_m = lanes.first().map_or(0.0, |lane| {
        let origin = site.course.place(0.0, -style.lane_m / 2.0);
        lane.path.nearest(origin.into()).along_m
    });
    let movers = style.movers;
    let count = |n: usize| u16::try_from(n).unwrap_or(u16::MAX);
    Plan {
        lanes,
        walkways,
        crossings: crossings(site),
        obstacles: obstacles(site),
        agents: Agents {
            cars: count(movers.cars),
            trucks: count(movers.trucks),
            buses: count(movers.buses),
            cyclists: count(movers.cyclists),
            pedestrians: count(movers.pedestrians),
        },
        // On the right lane, which leads east from the start of the street.
        guest: Some(Guest {
            lane: 0,
            at_m: start_m,
        }),
        duration: DURATION,
        ..Plan::default()
    }
}

/// A line along the whole street.
fn line(site: &Site, left: f64) -> Vec<[f64; 2]> {
    let step = 5.0;
    let count = ((ENDS_M[1] - ENDS_M[0]) / step) as usize;
    let at = |i: usize| site.course.place(ENDS_M[0] + step * i as f64, left);
    (0..=count).map(|i| at(i).into()).collect()
}

fn crossings(site: &Site) -> Vec<Crossing> {
    let style = &site.style;
    let is_free = |at: &&f64| !style.is_covered(**at - 2.0..**at + 2.0);
    let at = |along: f64, side: f64| site.course.place(along, side * (style.kerb_m(side) + 0.1));
    ground::CROSSINGS_M
        .iter()
        .filter(is_free)
        .map(|&along| Crossing {
            ends: [1.0, -1.0].map(|side| at(along, side).into()),
            width_m: 2.8,
            priority: if style.is_marked {
                Priority::Pedestrians
            } else {
                Priority::Vehicles
            },
        })
        .collect()
}

fn obstacles(site: &Site) -> Vec<Obstacle> {
    let circles = site
        .obstacles
        .iter()
        .map(|(at, radius_m)| Obstacle::Circle {
            centre: [at.x, at.y],
            radius_m: *radius_m,
        });
    let parked = site.things.iter().filter(|thing| thing.class.is_traffic());
    let boxes = parked.map(|thing| Obstacle::Box {
        centre: thing.place.translation.vector.xy().into(),
        heading_rad: thing.place.rotation.euler_angles().2,
        size_m: [thing.size.x, thing.size.y],
    });
    circles.chain(boxes).collect()
}

impl Mover {
    fn new(instance: Instance, track: Track, kerbs: [f64; 2]) -> Self {
        let seed = track.seed;
        let person = Person { instance, seed };
        let [length, width, _] = track.size_m;
        let footprint = [length, width];
        let (class, look, size) = match track.kind {
            Kind::Car => rigid(Class::Car, car(instance, seed, footprint)),
            Kind::Truck => rigid(Class::Truck, truck(instance, seed, footprint)),
            Kind::Bus => rigid(Class::Bus, bus(instance, seed, footprint)),
            Kind::Robot => rigid(Class::Robot, robot(instance)),
            Kind::Cyclist => {
                let bicycle = bicycle(instance, seed);
                let size = Vector3::new(bicycle.size[0], bicycle.size[1], 1.75);
                (Class::Cyclist, Look::Cyclist(person, bicycle.faces), size)
            }
            Kind::Pedestrian => {
                let size = Vector3::new(0.6, 0.6, person.height_m());
                (Class::Pedestrian, Look::Pedestrian(person), size)
            }
        };
        Self {
            instance,
            class,
            size,
            track,
            driven: None,
            look,
            kerbs,
        }
    }

    /// Lets it go its own way.
    pub(super) fn drive(&mut self, way: Arc<Way>) {
        self.driven = Some(way);
    }

    /// Where it is and how it moves; `None` while it is not there.
    pub(in crate::scene) fn state(&self, at: Stamp) -> Option<State> {
        let driven = self.driven.as_ref();
        driven.map_or_else(|| self.track.state(at), |way| Some(way.state(at)))
    }

    /// Where the middle of its bottom is.
    pub(in crate::scene) fn place(&self, state: &State, course: super::Course) -> Isometry3<f64> {
        let [x, y] = state.position;
        match &self.look {
            Look::Pedestrian(_) => feet(x, y, self.ground_m([x, y], course), state.heading_rad),
            _ => facing(x, y, state.heading_rad, false),
        }
    }

    /// How high people stand: the kerb is a ramp half a metre long.
    fn ground_m(&self, [x, y]: [f64; 2], course: super::Course) -> f64 {
        let middle = course.place(x, 0.0).y;
        let left = (y - middle) * course.heading(x).cos();
        let kerb = if left > 0.0 {
            self.kerbs[0]
        } else {
            self.kerbs[1]
        };
        KERB_M * ((left.abs() - kerb) / 0.3 + 0.5).clamp(0.0, 1.0)
    }

    /// Adds its faces, where it is.
    pub(in crate::scene) fn add_faces(
        &self,
        at: Stamp,
        course: super::Course,
        faces: &mut Vec<Face>,
    ) {
        let Some(state) = self.state(at) else { return };
        let place = self.place(&state, course);
        match &self.look {
            Look::Vehicle(model) => faces.extend(placed(model, &place)),
            Look::Cyclist(person, bicycle) => {
                faces.extend(placed(bicycle, &place));
                person.ride(&place, state.travelled_m, faces);
            }
            Look::Pedestrian(person) => {
                person.walk(&place, state.travelled_m, state.speed_mps, faces);
            }
        }
    }
}

fn rigid(class: Class, model: super::vehicles::Model) -> (Class, Look, Vector3<f64>) {
    (class, Look::Vehicle(model.faces), model.size.into())
}
