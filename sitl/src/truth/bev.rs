//! The street from above: the class of each cell of a grid around the ground vehicle.

use maps::frame::{Body, Isometry, World};
use maps::time::Stamp;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::boxes::boxes;
use crate::rays::Rays;
use crate::scene::Class;

/// From where rays look down: below bridges and most of the crowns, above cars, people and hedges.
const EYE_M: f64 = 3.9;

/// Classes in a square grid, x forward: row 0 is farthest ahead, column 0 farthest to the left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bev {
    /// Cells along an edge.
    pub size: usize,
    /// Row by row.
    pub classes: Vec<Class>,
}

/// The classes around a vehicle. Where road users stand, theirs; within houses, that of the house; under bridges
/// what is below them; under a crown what is below it, where none of it is lower than 3.9 m.
pub fn bev(
    rays: &Rays<'_>,
    at: Stamp,
    world_from_body: Isometry<World, Body>,
    size: usize,
    cell_m: f64,
) -> Bev {
    let scene = rays.scene();
    let boxes = boxes(scene, at);
    let houses: Vec<_> = scene
        .things()
        .iter()
        .filter(|thing| thing.class == Class::Building)
        .collect();
    let snapshot = rays.at(at);
    let classes = (0..size * size)
        .into_par_iter()
        .map(|i| {
            let from_middle = |index: usize| (size as f64 / 2.0 - index as f64 - 0.5) * cell_m;
            let place = Point3::new(from_middle(i / size), from_middle(i % size), 0.0);
            let place = world_from_body.raw * place;
            if let Some(road_user) = boxes.iter().find(|user| user.thing.covers(place)) {
                return road_user.thing.class;
            }
            if houses.iter().any(|house| house.covers(place)) {
                return Class::Building;
            }
            let eye = Point3::new(place.x, place.y, EYE_M);
            snapshot
                .cast(eye, -Vector3::z(), 2.0 * EYE_M)
                .map_or(Class::Sky, |hit| scene.class_of(hit.face.instance))
        })
        .collect();
    Bev { size, classes }
}
