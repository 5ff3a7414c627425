//! Houses and halls along both sides of a street.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{ENDS_M, Site};
use crate::scene::shape::{Lathe, Look, Profile, standing};
use crate::scene::{Class, Instance, Material};

const STOREY_M: f64 = 3.0;

/// Builds both rows.
pub(super) fn build(site: &mut Site) {
    for side in [1.0, -1.0] {
        let mut along = ENDS_M[0] + site.within([0.0, 6.0]);
        while along < ENDS_M[1] {
            let houses = site.style.houses;
            let width = site.within(houses.width_m);
            if !site.style.is_covered(along..along + width) {
                let house = plan(site, side, along + width / 2.0, width);
                raise(site, &house);
            }
            along += width + site.within(houses.gap_m);
        }
    }
}

/// A house: the middle of its front on the ground, with x out to the street and y along its front.
struct House {
    front: Isometry3<f64>,
    width: f64,
    depth: f64,
    height: f64,
    seed: u32,
    instance: Instance,
}

impl House {
    fn at(&self, out: f64, along: f64, up: f64) -> Point3<f64> {
        self.front * Point3::new(out, along, up)
    }

    /// A place on it, turned to the street.
    fn place(&self, out: f64, along: f64, up: f64) -> Isometry3<f64> {
        self.front * standing(out, along, up, 0.0)
    }

    fn look(&self, material: Material) -> Look {
        Look {
            material,
            instance: self.instance,
        }
    }

    fn wall(&self) -> Material {
        Material::Facade { seed: self.seed }
    }
}

fn plan(site: &mut Site, side: f64, middle: f64, width: f64) -> House {
    let houses = site.style.houses;
    let [depth, setback, storeys] =
        [houses.depth_m, houses.setback_m, houses.storeys].map(|range| site.within(range));
    let height = if houses.are_halls {
        storeys * STOREY_M
    } else {
        storeys.round().max(1.0) * STOREY_M + 0.4
    };
    let edge = side * (site.style.edge_m(side) + setback);
    let at = site.course.place(middle, edge);
    let heading = site.course.heading(middle) - side * std::f64::consts::FRAC_PI_2;
    let front = standing(at.x, at.y, -0.05, heading);
    let centre = front * standing(-depth / 2.0, 0.0, 0.0, 0.0);
    House {
        front,
        width,
        depth,
        height,
        seed: site.seed(),
        instance: site.thing(Class::Building, centre, Vector3::new(depth, width, height)),
    }
}

fn raise(site: &mut Site, house: &House) {
    let houses = site.style.houses;
    let wall = if houses.are_halls {
        Material::Corrugated { seed: house.seed }
    } else {
        house.wall()
    };
    let (w, d) = (house.width / 2.0, house.depth);
    let up = Vector3::z() * house.height;
    let corners = [[0.0, -w], [0.0, w], [-d, w], [-d, -w]];
    for i in 0..4 {
        let [a, b] = [corners[i], corners[(i + 1) % 4]].map(|[x, y]| house.at(x, y, 0.0));
        let face = house.look(wall).rectangle(a, [b - a, up]);
        site.faces.push(face);
    }
    let has_shop = site.chance(houses.shops);
    if houses.are_halls {
        gates(site, house);
    } else {
        if has_shop {
            shop(site, house);
        } else {
            door(site, house);
        }
        fittings(site, house, if has_shop { 2 } else { 1 });
    }
    if site.chance(houses.gabled) {
        gable(site, house);
    } else {
        flat_roof(site, house);
    }
}

fn shop(site: &mut Site, house: &House) {
    let height = 3.2;
    let look = house.look(Material::Shopfront {
        seed: house.seed ^ 1,
    });
    let [a, b] = [-1.0, 1.0].map(|s| house.at(0.02, s * house.width / 2.0, 0.05));
    site.faces
        .push(look.rectangle(a, [b - a, Vector3::z() * height]));
    if site.chance(0.5) {
        let width = house.width * site.within([0.3, 0.8]);
        let look = house.look(Material::Cloth {
            seed: house.seed ^ 2,
        });
        let place = house.place(0.6, 0.0, 2.65);
        site.block(place, [1.2, width, 0.06], look);
    }
}

fn door(site: &mut Site, house: &House) {
    let along = site.within([-0.35, 0.35]) * house.width;
    let look = house.look(Material::Wood { seed: house.seed });
    let [a, b] = [-0.55, 0.55].map(|s| house.at(0.03, along + s, 0.15));
    site.faces
        .push(look.rectangle(a, [b - a, Vector3::z() * 2.15]));
    let stone = house.look(Material::Concrete { seed: house.seed });
    site.block(house.place(0.45, along, 0.05), [0.9, 1.6, 0.16], stone);
    if site.chance(0.5) {
        site.block(house.place(0.5, along, 2.5), [1.0, 1.8, 0.1], stone);
    }
}

/// Rain pipes and balconies.
fn fittings(site: &mut Site, house: &House, first: u8) {
    let metal = house.look(Material::Metal { seed: house.seed });
    let pipe = Lathe {
        place: house.place(0.08, house.width / 2.0 - 0.2, 0.0),
        rings: &[[0.05, 0.0], [0.05, house.height]],
        sides: 6,
    };
    pipe.add_faces(metal, &mut site.faces);
    let storeys = (house.height / STOREY_M) as u8;
    if !site.chance(0.4) {
        return;
    }
    let along = site.within([-0.3, 0.3]) * house.width;
    let slab = house.look(Material::Concrete {
        seed: house.seed ^ 3,
    });
    for storey in first..storeys {
        let up = f64::from(storey) * STOREY_M + 0.1;
        site.block(house.place(0.6, along, up), [1.2, 2.8, 0.15], slab);
        site.block(
            house.place(1.17, along, up + 0.15),
            [0.05, 2.8, 0.95],
            metal,
        );
        for end in [-1.37, 1.37] {
            site.block(
                house.place(0.6, along + end, up + 0.15),
                [1.15, 0.05, 0.95],
                metal,
            );
        }
    }
}

/// Gates with ramps in a hall's front, and a strip of windows.
fn gates(site: &mut Site, house: &House) {
    let mut along = -house.width / 2.0 + 3.5;
    while along < house.width / 2.0 - 3.5 {
        let is_gate = site.chance(0.55);
        let (material, width, bottom, height) = if is_gate {
            (Material::Corrugated { seed: site.seed() }, 3.6, 0.05, 4.0)
        } else {
            (Material::Facade { seed: house.seed }, 3.2, 1.0, 2.0)
        };
        let [a, b] = [-0.5, 0.5].map(|s| house.at(0.04, along + s * width, bottom));
        let look = house.look(material);
        site.faces
            .push(look.rectangle(a, [b - a, Vector3::z() * height]));
        if is_gate {
            let yellow = house.look(Material::Sign { seed: site.seed() });
            for post in [-2.1, 2.1] {
                site.block(
                    house.place(0.5, along + post, 0.0),
                    [0.25, 0.25, 1.1],
                    yellow,
                );
            }
        }
        along += 6.5;
    }
}

/// Two slopes that meet above the middle of the house and reach over its walls.
fn gable(site: &mut Site, house: &House) {
    let rise = house.depth * site.within([0.22, 0.42]);
    let over = 0.35;
    let ridge = house.height + rise;
    let eaves = house.height - over * rise / (house.depth / 2.0);
    let tiles = house.look(Material::Tiles { seed: house.seed });
    // Seen from the side, forward is along the house: the ridge runs across.
    let place = house.place(-house.depth / 2.0, 0.0, 0.0);
    let half = house.depth / 2.0;
    let upper = [
        [half + over, eaves + 0.15],
        [0.0, ridge + 0.15],
        [-half - over, eaves + 0.15],
    ];
    let half_width = [house.width / 2.0 + 0.2; 2];
    let roof = Profile {
        place,
        upper: &upper,
        low: eaves,
        half_width,
    };
    let gable = house.look(house.wall());
    roof.add_faces([gable, tiles], &mut site.faces);
    if site.chance(0.7) {
        let along = site.within([-0.35, 0.35]) * house.width;
        let brick = house.look(Material::Brick { seed: house.seed });
        let place = house.place(-house.depth * 0.6, along, ridge - rise * 0.5);
        site.block(place, [0.6, 0.8, rise * 0.5 + 0.7], brick);
    }
}

/// A roof with a parapet and machines on it.
fn flat_roof(site: &mut Site, house: &House) {
    let roof = house.look(Material::Concrete {
        seed: house.seed ^ 7,
    });
    let centre = house.place(-house.depth / 2.0, 0.0, house.height);
    site.block(centre, [house.depth, house.width, 0.08], roof);
    let rim = 0.25;
    for (out, along, size) in [
        (-rim / 2.0, 0.0, [rim, house.width, 0.55]),
        (rim / 2.0 - house.depth, 0.0, [rim, house.width, 0.55]),
        (
            -house.depth / 2.0,
            (house.width - rim) / 2.0,
            [house.depth, rim, 0.55],
        ),
        (
            -house.depth / 2.0,
            (rim - house.width) / 2.0,
            [house.depth, rim, 0.55],
        ),
    ] {
        site.block(house.place(out, along, house.height), size, roof);
    }
    for _ in 0..3 {
        let machine = house.look(Material::Metal { seed: site.seed() });
        let out = -house.depth * site.within([0.25, 0.75]);
        let along = house.width * site.within([-0.35, 0.35]);
        let size = [
            site.within([0.8, 2.2]),
            site.within([0.8, 2.6]),
            site.within([0.6, 1.6]),
        ];
        site.block(house.place(out, along, house.height + 0.08), size, machine);
    }
}
