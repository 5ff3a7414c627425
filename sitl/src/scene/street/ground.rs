//! The road with its markings, pavements with their kerbs, and the land around.

use nalgebra::{Point2, Point3, Vector3};

use super::{ENDS_M, KERB_M, Site};
use crate::scene::shape::{Look, flat};
use crate::scene::{Class, Material};

/// The land lies a little lower than the road.
const LAND_M: f64 = -0.03;
/// Paint lies on the road.
const PAINT_M: f64 = 0.004;
/// How far the land reaches.
const FAR_M: f64 = 260.0;
const PAINT_WIDTH_M: f64 = 0.14;

/// Where pedestrians cross the road, along the street, in marked streets.
pub(super) const CROSSINGS_M: [f64; 2] = [-14.0, 62.0];

/// Lays it all.
pub(super) fn lay(site: &mut Site) {
    let seed = site.seed();
    let land = if site.style.has_gardens {
        Material::Grass { seed }
    } else if site.style.has_yards {
        Material::Asphalt { seed }
    } else {
        Material::Paving { seed }
    };
    let look = Look {
        material: land,
        instance: site.instance(Class::Terrain),
    };
    // In pieces, so that what lies outside of a picture costs nothing.
    let step = FAR_M / 4.0;
    for i in -4..4 {
        for j in -4..4 {
            let corner = Point3::new(40.0 + f64::from(i) * step, f64::from(j) * step, LAND_M);
            let edges = [Vector3::x() * step, Vector3::y() * step];
            site.faces.push(look.rectangle(corner, edges));
        }
    }
    let road = Look {
        material: Material::Asphalt { seed: site.seed() },
        instance: site.instance(Class::Road),
    };
    let edges = [1.0, -1.0].map(|side| side * site.style.kerb_m(side));
    strip(site, [edges[0], edges[1]], 0.0, road);
    for side in [1.0, -1.0] {
        pavement(site, side);
    }
    if site.style.is_marked {
        let paint = Look {
            material: Material::Marking,
            ..road
        };
        markings(site, paint);
    }
}

/// A level strip along the whole street, from its left edge to its right edge.
fn strip(site: &mut Site, [left, right]: [f64; 2], up: f64, look: Look) {
    for [from, to] in stations(site) {
        let corners = [(from, right), (to, right), (to, left), (from, left)];
        let corners = corners.map(|(along, left)| above(site.course.place(along, left), up));
        site.faces.extend(flat(look, corners));
    }
}

/// The street in pieces: long where it is straight.
fn stations(site: &Site) -> Vec<[f64; 2]> {
    let step = if site.course.is_straight() { 15.0 } else { 5.0 };
    let count = ((ENDS_M[1] - ENDS_M[0]) / step).round() as usize;
    let at = |i: usize| ENDS_M[0] + step * i as f64;
    (0..count).map(|i| [at(i), at(i + 1)]).collect()
}

fn above(at: Point2<f64>, up: f64) -> Point3<f64> {
    Point3::new(at.x, at.y, up)
}

fn pavement(site: &mut Site, side: f64) {
    let (kerb, edge) = (site.style.kerb_m(side), site.style.edge_m(side));
    if edge <= kerb {
        return;
    }
    let look = Look {
        material: Material::Paving { seed: site.seed() },
        instance: site.instance(Class::Sidewalk),
    };
    let stone = Look {
        material: Material::Concrete { seed: site.seed() },
        ..look
    };
    let inner = side * (kerb + 0.15);
    let mut edges = [inner, side * edge];
    let mut stones = [side * kerb, inner];
    if side > 0.0 {
        edges.swap(0, 1);
        stones.swap(0, 1);
    }
    strip(site, edges, KERB_M, look);
    strip(site, stones, KERB_M, stone);
    for (at, foot, towards) in [(kerb, 0.0, -side), (edge, LAND_M, side)] {
        for [from, to] in stations(site) {
            // Seen from the side it faces, its foot runs from left to right.
            let [from, to] = if towards < 0.0 {
                [from, to]
            } else {
                [to, from]
            };
            let [a, b] = [from, to].map(|along| site.course.place(along, side * at));
            let corners = [
                above(a, foot),
                above(b, foot),
                above(b, KERB_M),
                above(a, KERB_M),
            ];
            site.faces.extend(flat(stone, corners));
        }
    }
}

fn markings(site: &mut Site, paint: Look) {
    let lanes = site.style.lanes as f64 * site.style.lane_m;
    let is_wide = site.style.lanes > 1;
    let mut along = ENDS_M[0];
    while along < ENDS_M[1] {
        if is_crossing(along) || is_crossing(along + 3.0) {
            along += 1.0;
            continue;
        }
        if is_wide {
            // A double line in the middle, dashes between lanes.
            for left in [-0.16, 0.16] {
                line(site, [along, along + 6.0], left, paint);
            }
            for left in [-site.style.lane_m, site.style.lane_m] {
                line(site, [along, along + 3.0], left, paint);
            }
        } else {
            line(site, [along, along + 3.0], 0.0, paint);
        }
        for left in [lanes - 0.2, 0.2 - lanes] {
            line(site, [along, along + 6.0], left, paint);
        }
        along += 6.0;
    }
    for crossing in CROSSINGS_M {
        if site.style.is_covered(crossing - 2.0..crossing + 2.0) {
            continue;
        }
        let mut left = 0.3 - lanes;
        while left < lanes - 0.3 {
            stripe(
                site,
                [crossing - 1.6, crossing + 1.6],
                left + 0.25,
                0.5,
                paint,
            );
            left += 1.0;
        }
        for (at, lanes) in [(-2.6, [-lanes, 0.0]), (2.6, [0.0, lanes])] {
            let middle = f64::midpoint(lanes[0], lanes[1]);
            let width = lanes[1] - lanes[0] - 0.4;
            stripe(
                site,
                [crossing + at - 0.2, crossing + at + 0.2],
                middle,
                width,
                paint,
            );
        }
    }
}

fn is_crossing(along: f64) -> bool {
    CROSSINGS_M.iter().any(|at| (along - at).abs() < 4.5)
}

fn line(site: &mut Site, [from, to]: [f64; 2], left: f64, paint: Look) {
    let middle = f64::midpoint(from, to);
    for [from, to] in [[from, middle], [middle, to]] {
        stripe(site, [from, to], left, PAINT_WIDTH_M, paint);
    }
}

fn stripe(site: &mut Site, [from, to]: [f64; 2], left: f64, width: f64, paint: Look) {
    let [l, r] = [left + width / 2.0, left - width / 2.0];
    let corners = [(from, r), (to, r), (to, l), (from, l)];
    let corners = corners.map(|(along, left)| above(site.course.place(along, left), PAINT_M));
    site.faces.extend(flat(paint, corners));
}
