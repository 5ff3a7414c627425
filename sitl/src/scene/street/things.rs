//! What stands about: lamps, signs, bins, benches, boxes, and goods in yards.

use nalgebra::{Isometry3, Translation3};

use super::{ENDS_M, Site, style};
use crate::scene::shape::{Lathe, Look};
use crate::scene::{Class, Material};

/// Places everything.
pub(super) fn place(site: &mut Site) {
    for side in [1.0, -1.0] {
        lamps(site, side);
        along_pavement(site, side);
        if site.style.has_yards {
            yards(site, side);
        }
    }
}

/// A pole, and what is to stay clear of it.
fn pole(site: &mut Site, place: &Isometry3<f64>, [radius, height]: [f64; 2], look: Look) {
    let rings = [[radius, 0.0], [radius * 0.7, height], [0.0, height]];
    Lathe {
        place: *place,
        rings: &rings,
        sides: 8,
    }
    .add_faces(look, &mut site.faces);
    let at = place.translation.vector;
    site.obstacles.push((at.xy().into(), radius + 0.05));
}

fn kerbside_m(site: &Site, side: f64) -> f64 {
    let pavement = site.style.pavement_m[style::index(side)];
    site.style.kerb_m(side) + if pavement > 0.0 { 0.4 } else { 1.0 }
}

/// Lamps with an arm over the road.
fn lamps(site: &mut Site, side: f64) {
    let mut along = ENDS_M[0]
        + if side > 0.0 {
            5.0
        } else {
            5.0 + site.style.lamps_m / 2.0
        };
    while along < ENDS_M[1] {
        if !site.style.is_covered(along - 1.0..along + 1.0) {
            let place = site.beside(along, side * kerbside_m(site, side), site.pavement_up(side));
            let height = 7.5;
            let instance = site.thing(Class::Pole, place, [0.25, 0.25, height].into());
            let metal = Look {
                material: Material::Metal { seed: 0 },
                instance,
            };
            pole(site, &place, [0.09, height], metal);
            let arm = place * Translation3::new(0.0, -side * 0.8, height - 0.15);
            site.block(arm, [0.08, 1.7, 0.08], metal);
            let head = place * Translation3::new(0.0, -side * 1.7, height - 0.22);
            let lamp = Look {
                material: Material::Lamp { is_red: false },
                instance,
            };
            site.block(head, [0.3, 0.7, 0.14], lamp);
        }
        along += site.style.lamps_m;
    }
}

fn along_pavement(site: &mut Site, side: f64) {
    let mut along = ENDS_M[0] + site.within([1.0, 4.0]);
    while along < ENDS_M[1] {
        if !site.style.is_covered(along - 1.0..along + 1.0) {
            one(site, along, side);
        }
        let spacing = site.style.things_m;
        along += spacing * site.within([0.5, 1.6]);
    }
}

/// A sign at the kerb, or something at the house walls.
fn one(site: &mut Site, along: f64, side: f64) {
    let up = site.pavement_up(side);
    let kerb = side * kerbside_m(site, side);
    let edge = side * (site.style.edge_m(side) - 0.35).max(site.style.kerb_m(side) + 0.8);
    let kind = site.seed() % 8;
    let seed = site.seed();
    match kind {
        0 | 1 => sign(site, along, kerb, up),
        2 => {
            let place = site.beside(along, kerb, up);
            let instance = site.thing(Class::Pole, place, [0.2, 0.2, 1.0].into());
            let look = Look {
                material: Material::Metal { seed },
                instance,
            };
            pole(site, &place, [0.08, 1.0], look);
        }
        3 | 4 => bins(site, along, edge, up),
        5 => {
            let place = site.beside(along, edge, up);
            site.stand(
                Class::Object,
                place,
                [0.9, 0.4, 1.2],
                Material::Metal { seed },
            );
            site.obstacles
                .push((place.translation.vector.xy().into(), 0.5));
        }
        6 => bench(site, along, edge, up),
        _ => {
            let size = [0.5, 0.6, site.within([0.4, 0.9])];
            let place = site.beside(along, edge, up);
            site.stand(Class::Object, place, size, Material::Carton { seed });
            site.obstacles
                .push((place.translation.vector.xy().into(), 0.45));
        }
    }
}

fn sign(site: &mut Site, along: f64, left: f64, up: f64) {
    let place = site.beside(along, left, up);
    let height = 2.6;
    let instance = site.thing(Class::Sign, place, [0.1, 0.7, height].into());
    let metal = Look {
        material: Material::Metal { seed: 0 },
        instance,
    };
    pole(site, &place, [0.035, height], metal);
    let board = Look {
        material: Material::Sign { seed: site.seed() },
        instance,
    };
    let size = [0.03, 0.7, site.within([0.6, 0.9])];
    site.block(
        place * Translation3::new(0.05, 0.0, height - size[2]),
        size,
        board,
    );
}

/// A row of dustbins.
fn bins(site: &mut Site, along: f64, left: f64, up: f64) {
    let count = 1 + site.seed() % 4;
    for i in 0..count {
        let seed = site.seed();
        let place = site.beside(along + 0.65 * f64::from(i), left, up);
        site.stand(
            Class::Object,
            place,
            [0.55, 0.6, 1.05],
            Material::Metal { seed },
        );
        site.obstacles
            .push((place.translation.vector.xy().into(), 0.42));
    }
}

fn bench(site: &mut Site, along: f64, left: f64, up: f64) {
    let place = site.beside(along, left, up);
    let instance = site.thing(Class::Object, place, [1.7, 0.5, 0.85].into());
    let wood = Look {
        material: Material::Wood { seed: site.seed() },
        instance,
    };
    let seat = place * Translation3::new(0.0, 0.0, 0.42);
    site.block(seat, [1.7, 0.45, 0.06], wood);
    let back = place * Translation3::new(0.0, 0.22 * left.signum(), 0.5);
    site.block(back, [1.7, 0.05, 0.35], wood);
    for end in [-0.7, 0.7] {
        site.block(
            place * Translation3::new(end, 0.0, 0.0),
            [0.08, 0.4, 0.42],
            wood,
        );
    }
    for end in [-0.6, 0.0, 0.6] {
        let at = site.course.place(along + end, left);
        site.obstacles.push((at, 0.4));
    }
}

/// Containers, pallets and barrels before the halls.
fn yards(site: &mut Site, side: f64) {
    let [near, _] = site.style.houses.setback_m;
    let mut along = ENDS_M[0] + 4.0;
    while along < ENDS_M[1] {
        let left = side * (site.style.edge_m(side) + near * site.within([0.35, 0.75]));
        let seed = site.seed();
        if !site.style.is_covered(along - 6.0..along + 6.0) {
            match seed % 3 {
                0 => {
                    let place = site.beside(along, left, -0.03);
                    let material = Material::Corrugated { seed };
                    site.stand(Class::Object, place, [6.06, 2.44, 2.59], material);
                    if site.chance(0.4) {
                        let above = place * Translation3::new(0.0, 0.1, 2.59);
                        let material = Material::Corrugated { seed: seed ^ 9 };
                        site.stand(Class::Object, above, [6.06, 2.44, 2.59], material);
                    }
                }
                1 => pallets(site, along, left),
                _ => barrels(site, along, left),
            }
        }
        along += site.within([9.0, 17.0]);
    }
}

fn pallets(site: &mut Site, along: f64, left: f64) {
    for i in 0..3 {
        let seed = site.seed();
        let place = site.beside(along + 1.4 * f64::from(i), left, -0.03);
        let height = site.within([0.3, 1.7]);
        site.stand(
            Class::Object,
            place,
            [1.2, 0.8, 0.15],
            Material::Wood { seed },
        );
        let load = place * Translation3::new(0.0, 0.0, 0.15);
        site.stand(
            Class::Object,
            load,
            [1.15, 0.75, height],
            Material::Carton { seed },
        );
    }
}

fn barrels(site: &mut Site, along: f64, left: f64) {
    for i in 0..5 {
        let row = f64::from(i / 3);
        let place = site.beside(along + 0.65 * f64::from(i % 3), left + 0.65 * row, -0.03);
        let instance = site.thing(Class::Object, place, [0.58, 0.58, 0.9].into());
        let look = Look {
            material: Material::Metal { seed: site.seed() },
            instance,
        };
        let rings = [[0.29, 0.0], [0.29, 0.9], [0.0, 0.9]];
        Lathe {
            place,
            rings: &rings,
            sides: 12,
        }
        .add_faces(look, &mut site.faces);
    }
}
