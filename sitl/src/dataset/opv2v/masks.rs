//! The street from above as OPV2V's `additional` data has it: 256 x 256 pixels of 0.39 m, the agent in the middle and
//! heading up, 255 where there is what the picture is about.
//!
//! - `OpenCOOD`, `logreplay/map/map_manager.py`: `radius: 50`, `raster_size: [256, 256]`.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point2, Point3};

use crate::dataset::files::{Image, Png};
use crate::dataset::grid::Grid;
use crate::scene::{Class, Face, Instance, Material, RoadUser, Scene};
use crate::truth::Sight;

const GRID: Grid = Grid {
    cells: 256,
    cell_m: 100.0 / 256.0,
};
/// How many pixels of its cameras an agent must see of a vehicle to see it.
const LEAST_PIXELS: u32 = 20;

/// Those whose vehicles are drawn.
pub(super) struct Views<'a> {
    pub(super) vehicles: &'a [RoadUser],
    /// What the agent's own cameras see.
    pub(super) own: &'a BTreeMap<Instance, Sight>,
    /// What each agent's cameras see.
    pub(super) all: [&'a BTreeMap<Instance, Sight>; 2],
}

/// The five pictures around an agent that is at `world_from_body`.
pub(super) fn masks<'a>(
    scene: &Scene,
    world_from_body: &Isometry3<f64>,
    views: &Views<'_>,
    stem: &str,
) -> Vec<Png<'a>> {
    let sees = |sight: &BTreeMap<Instance, Sight>, instance: Instance| {
        let sight = sight.get(&instance);
        sight.is_some_and(|sight| sight.visible >= LEAST_PIXELS)
    };
    let body_from_world = world_from_body.inverse();
    let vehicles = |is_drawn: &dyn Fn(Instance) -> bool| {
        let drawn = views.vehicles.iter();
        let drawn = drawn.filter(|user| is_drawn(user.thing.instance));
        draw(drawn.map(|user| footprint(user, &body_from_world)), 0.0)
    };
    let ground = |is_drawn: &dyn Fn(&Face) -> bool, near_m: f64| {
        let road = |face: &&Face| scene.class_of(face.instance) == Class::Road && is_drawn(face);
        let faces = scene.still().iter().filter(road);
        let outline = |face: &Face| {
            let corners = face.corners().map(|corner| body_from_world * corner.raw);
            corners.map(|corner| corner.xy())
        };
        draw(faces.map(outline), near_m)
    };
    let is_marking = |face: &Face| matches!(face.material, Material::Marking);
    let pictures = [
        ("dynamic", vehicles(&|_| true)),
        (
            "visibility",
            vehicles(&|instance| sees(views.own, instance)),
        ),
        (
            "visibility_corp",
            vehicles(&|instance| views.all.iter().any(|sight| sees(sight, instance))),
        ),
        ("static", ground(&|_| true, 0.0)),
        // Lines are narrower than a pixel.
        ("lane", ground(&is_marking, GRID.cell_m / 2.0)),
    ];
    let png = |(what, pixels)| Png {
        name: format!("{stem}_bev_{what}.png"),
        width: GRID.cells,
        image: Image::Grey(pixels),
    };
    pictures.into_iter().map(png).collect()
}

fn draw(outlines: impl Iterator<Item = [Point2<f64>; 4]>, near_m: f64) -> Vec<u8> {
    let mut pixels = vec![0; GRID.cells * GRID.cells];
    for outline in outlines {
        GRID.fill(&outline, near_m, |pixel| pixels[pixel] = 255);
    }
    pixels
}

fn footprint(user: &RoadUser, body_from_world: &Isometry3<f64>) -> [Point2<f64>; 4] {
    let body_from_thing = body_from_world * user.thing.place;
    let (length, width) = (user.thing.size.x / 2.0, user.thing.size.y / 2.0);
    let corners = [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)];
    corners.map(|(x, y)| (body_from_thing * Point3::new(x * length, y * width, 0.0)).xy())
}
