//! What blinds the drone: a bridge across the street, and a stretch of it with a roof.

use nalgebra::Vector3;

use super::Site;
use crate::scene::shape::{Look, standing};
use crate::scene::{Class, Material};

/// Builds what the style asks for.
pub(super) fn build(site: &mut Site) {
    if let Some(ends) = site.style.bridge {
        bridge(site, ends);
    }
    if let Some(ends) = site.style.roof {
        roof(site, ends);
    }
}

/// The deck of a motorway on two rows of pillars, with rails and abutments.
fn bridge(site: &mut Site, [from, to]: [f64; 2]) {
    let (middle, width) = (f64::midpoint(from, to), to - from);
    let clearance = 5.2;
    let seed = site.seed();
    let place = site.beside(middle, 0.0, clearance);
    let size = [width, 70.0, 1.3];
    let instance = site.thing(Class::Bridge, place, size.into());
    let concrete = Look {
        material: Material::Concrete { seed },
        instance,
    };
    site.block(place, size, concrete);
    for end in [from + 0.15, to - 0.15] {
        let rail = site.beside(end, 0.0, clearance + 1.3);
        site.block(rail, [0.25, 70.0, 0.9], concrete);
    }
    for side in [1.0, -1.0] {
        let left = side * (site.style.edge_m(side) + 0.6);
        let mut along = from + 3.0;
        while along < to - 2.0 {
            let pillar = site.beside(along, left, -0.05);
            site.block(pillar, [1.1, 0.9, clearance + 0.1], concrete);
            along += 6.5;
        }
        // The abutment: a wall behind the pillars.
        let wall = site.beside(middle, side * (site.style.edge_m(side) + 7.0), -0.05);
        site.block(wall, [width, 0.8, clearance + 0.05], concrete);
    }
}

/// A passage between two walls, with columns along the kerbs: as good as indoors.
fn roof(site: &mut Site, [from, to]: [f64; 2]) {
    let (middle, length) = (f64::midpoint(from, to), to - from);
    let height = 4.4;
    let edges = [1.0, -1.0].map(|side| site.style.edge_m(side) + 1.5);
    let width = edges[0] + edges[1] + 1.0;
    let left = (edges[0] - edges[1]) / 2.0;
    let (seed, other) = (site.seed(), site.seed());
    let place = site.beside(middle, left, height);
    let size = Vector3::new(length, width, 3.6);
    let instance = site.thing(Class::Bridge, place, size);
    let concrete = Look {
        material: Material::Concrete { seed },
        instance,
    };
    let front = Look {
        material: Material::Facade { seed: other },
        instance,
    };
    site.block(place, size.into(), front);
    for (side, edge) in [(1.0, edges[0]), (-1.0, edges[1])] {
        let wall = site.beside(middle, side * edge, -0.05);
        site.block(wall, [length, 0.4, height + 0.06], concrete);
        let kerb = site.style.kerb_m(side) + 0.3;
        let mut along = from + 1.0;
        while along < to {
            let column = site.beside(along, side * kerb, 0.0);
            site.block(column, [0.45, 0.45, height + 0.02], concrete);
            site.obstacles
                .push((site.course.place(along, side * kerb), 0.35));
            along += 6.0;
        }
    }
    // Beams below the ceiling.
    let mut along = from + 1.0;
    while along < to {
        let beam = standing(0.0, 0.0, height - 0.45, 0.0);
        let at = site.beside(along, left, 0.0) * beam;
        site.block(at, [0.4, width, 0.45], concrete);
        along += 6.0;
    }
}
