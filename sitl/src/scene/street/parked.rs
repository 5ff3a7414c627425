//! Vehicles that stand at the kerb.

use nalgebra::Vector3;

use super::vehicles::{car, facing, truck};
use super::{ENDS_M, Site, style};
use crate::scene::shape::placed;
use crate::scene::{Class, Instance};

/// Between the bumpers of two parked vehicles.
const GAP_M: [f64; 2] = [0.7, 1.8];
/// Trucks park where there is more than this between kerb and lane.
const TRUCKS_M: f64 = 2.8;

/// Parks both sides.
pub(super) fn park(site: &mut Site) {
    for side in [1.0, -1.0] {
        let strip = site.style.parking_m[style::index(side)];
        if strip <= 0.0 {
            continue;
        }
        let mut along = ENDS_M[0] + 2.0;
        while along < ENDS_M[1] - 10.0 {
            if site.style.is_marked && is_kept_free(along) {
                along += 2.0;
                continue;
            }
            if !site.chance(site.style.parked) {
                along += site.within([4.0, 7.0]);
                continue;
            }
            let is_truck = strip > TRUCKS_M && site.chance(site.style.parked_trucks);
            let seed = site.seed();
            let model = if is_truck {
                let footprint = [site.within([7.2, 9.6]), 2.45];
                truck(Instance::NOTHING, seed, footprint)
            } else {
                let footprint = [site.within([3.7, 4.9]), site.within([1.72, 1.88])];
                car(Instance::NOTHING, seed, footprint)
            };
            let [length, width, height] = model.size;
            let left = side * (site.style.kerb_m(side) - width / 2.0 - site.within([0.12, 0.3]));
            let middle = along + length / 2.0;
            let at = site.course.place(middle, left);
            let heading = site.course.heading(middle) + site.within([-0.02, 0.02]);
            let place = facing(at.x, at.y, heading, side > 0.0);
            let class = if is_truck { Class::Truck } else { Class::Car };
            let instance = site.thing(class, place, Vector3::new(length, width, height));
            let faces = placed(&model.faces, &place);
            site.faces
                .extend(faces.map(|face| crate::scene::Face { instance, ..face }));
            along += length + site.within(GAP_M);
        }
    }
}

/// Before crossings nobody parks.
fn is_kept_free(along: f64) -> bool {
    let near = |at: &f64| (-6.5..12.0).contains(&(at - along));
    super::ground::CROSSINGS_M.iter().any(near)
}
