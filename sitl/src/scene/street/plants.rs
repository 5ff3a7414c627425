//! Trees along the kerb, and hedges and trees in gardens.

use nalgebra::{Translation3, Vector3};

use super::{ENDS_M, Site, style};
use crate::scene::shape::{Lathe, Look, standing};
use crate::scene::{Class, Material};

/// Plants both sides.
pub(super) fn plant(site: &mut Site) {
    for side in [1.0, -1.0] {
        let pavement = site.style.pavement_m[style::index(side)];
        let mut along = ENDS_M[0] + site.within([2.0, 8.0]);
        while along < ENDS_M[1] {
            if !site.style.is_covered(along - 3.0..along + 3.0) {
                let in_garden = site.style.has_gardens || pavement < 1.6;
                let left = if in_garden {
                    site.style.edge_m(side) + site.within([1.2, 3.6])
                } else {
                    site.style.kerb_m(side) + 0.75
                };
                tree(site, along, side * left);
            }
            let spacing = site.style.trees_m;
            along += spacing * site.within([0.75, 1.4]);
        }
        if site.style.has_gardens {
            hedges(site, side);
            fields(site, side);
        }
    }
}

/// A trunk and a crown of several lobes.
fn tree(site: &mut Site, along: f64, left: f64) {
    let height = site.within([5.0, 9.5]);
    let trunk = height * site.within([0.28, 0.38]);
    let spread = height * site.within([0.2, 0.3]);
    let at = site.course.place(along, left);
    let place = standing(at.x, at.y, -0.05, site.within([0.0, 6.3]));
    let size = Vector3::new(2.0 * spread, 2.0 * spread, height);
    let instance = site.thing(Class::Vegetation, place, size);
    let bark = Look {
        material: Material::Bark,
        instance,
    };
    let leaves = Look {
        material: Material::Leaves { seed: site.seed() },
        instance,
    };
    let r = 0.035 * height;
    let rings = [[r * 1.4, 0.0], [r, 0.4], [r * 0.8, trunk + 0.8]];
    Lathe {
        place,
        rings: &rings,
        sides: 8,
    }
    .add_faces(bark, &mut site.faces);
    site.obstacles.push((at, 0.3));
    for lobe in 0..4 {
        let share = f64::from(lobe) / 4.0;
        let out = if lobe == 0 {
            0.0
        } else {
            spread * site.within([0.25, 0.5])
        };
        let up = trunk + (height - trunk) * (0.1 + 0.4 * share) - 0.2;
        let r = spread * site.within([0.6, 0.85]);
        let tall = ((height - up) * 0.95).min(2.4 * r);
        let (sin, cos) = (2.4 * f64::from(lobe)).sin_cos();
        let place = place * Translation3::new(out * cos, out * sin, up);
        let rings = [
            [0.0, 0.0],
            [r * 0.75, tall * 0.12],
            [r, tall * 0.42],
            [r * 0.78, tall * 0.75],
            [r * 0.35, tall * 0.95],
            [0.0, tall],
        ];
        Lathe {
            place,
            rings: &rings,
            sides: 9,
        }
        .add_faces(leaves, &mut site.faces);
    }
}

/// Hedges and fences between pavement and garden, with gaps for doors.
fn hedges(site: &mut Site, side: f64) {
    let mut along = ENDS_M[0];
    while along < ENDS_M[1] {
        let length = site.within([5.0, 12.0]);
        let left = side * (site.style.edge_m(side) + 0.5);
        let seed = site.seed();
        let (material, class, size) = match seed % 3 {
            0 => (
                Material::Leaves { seed },
                Class::Vegetation,
                [length, 0.7, 1.3],
            ),
            1 => (Material::Wood { seed }, Class::Wall, [length, 0.08, 1.2]),
            _ => (Material::Brick { seed }, Class::Wall, [length, 0.25, 0.8]),
        };
        if site.chance(0.7) {
            // Short pieces follow the bend.
            for piece in 0..3 {
                let third = length / 3.0;
                let place = site.beside(along + third * (f64::from(piece) + 0.5), left, -0.03);
                site.stand(class, place, [third, size[1], size[2]], material);
            }
        }
        along += length + site.within([1.5, 4.0]);
    }
}

/// Trees behind the houses: the horizon of a suburb.
fn fields(site: &mut Site, side: f64) {
    let mut along = ENDS_M[0];
    while along < ENDS_M[1] {
        let left = site.style.edge_m(side) + site.within([22.0, 34.0]);
        tree(site, along, side * left);
        along += site.within([7.0, 15.0]);
    }
}
