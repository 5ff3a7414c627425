//! A furnished room: a floor of planks, four walls with pictures, furniture along the walls and a table in the middle.
//!
//! The camera of [`crate::flight`] circles [`CENTRE`] well inside the ring on which people walk, and the furniture
//! stands outside that ring: nothing ever passes through anything else.

use std::f64::consts::{FRAC_PI_2, PI};

use maps::frame::{Point, Vector};
use nalgebra::{Point3, Rotation2, Vector2, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::{Block, Face, Instance, Light, Material, Scene, walker};

/// The middle of the room.
pub(crate) const CENTRE: [f64; 2] = [1.3, 0.0];
/// From the middle to the walls, east and north.
const HALF: [f64; 2] = [3.5, 2.9];
const WALL_HEIGHT: f64 = 2.6;
/// Where the lamps hang.
const LAMPS: [[f64; 3]; 2] = [[0.2, 1.0, 2.8], [2.6, -0.9, 2.8]];
/// The ring on which people walk.
const RING: [f64; 2] = [2.4, 1.9];

/// One wall, as seen from the room: furniture on it is placed by distance along it.
struct Wall {
    /// Its left end, on the floor.
    left: Vector2<f64>,
    /// From left to right.
    along: Vector2<f64>,
    /// Into the room.
    inward: Vector2<f64>,
    length: f64,
}

struct Builder {
    faces: Vec<Face>,
    next: u16,
    random: Pcg64,
}

pub(super) fn room(seed: u64) -> Scene {
    let mut builder = Builder {
        faces: Vec::new(),
        next: Instance::FLOOR.0,
        random: Pcg64::seed_from_u64(seed),
    };
    builder.floor();
    let walls = [0, 1, 2, 3].map(wall);
    for wall in &walls {
        builder.wall(wall);
    }
    for wall in &walls {
        builder.furnish(wall);
    }
    builder.middle();
    let seed = builder.seed();
    Scene {
        still: builder.faces,
        walkers: walker::on_ring(CENTRE, RING, seed),
        things: Vec::new(),
        street: None,
        ways: [None, None],
        light: Light::Lamps(LAMPS.into()),
    }
}

/// East, north, west and south.
fn wall(index: u8) -> Wall {
    let turn = Rotation2::new(f64::from(index) * FRAC_PI_2);
    let across = usize::from(index % 2);
    let outward = turn * Vector2::x();
    let along = -(turn * Vector2::y());
    let length = 2.0 * HALF[1 - across];
    Wall {
        left: Vector2::from(CENTRE) + outward * HALF[across] - along * (length / 2.0),
        along,
        inward: -outward,
        length,
    }
}

fn flat(v: Vector2<f64>, z: f64) -> Vector3<f64> {
    Vector3::new(v.x, v.y, z)
}

impl Builder {
    fn instance(&mut self) -> Instance {
        self.next += 1;
        Instance(self.next - 1)
    }

    fn seed(&mut self) -> u32 {
        self.random.random()
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        self.random.random_range(low..high)
    }

    fn face(
        &mut self,
        corner: Vector3<f64>,
        edges: [Vector3<f64>; 2],
        material: Material,
        instance: Instance,
    ) {
        self.faces.push(Face {
            corner: Point::from_raw(corner.into()),
            edge_u: Vector::from_raw(edges[0]),
            edge_v: Vector::from_raw(edges[1]),
            top: [0.0, 1.0],
            material,
            instance,
        });
    }

    fn floor(&mut self) {
        let (material, instance) = (Material::Planks { seed: self.seed() }, self.instance());
        let corner = Vector3::new(CENTRE[0] - HALF[0], CENTRE[1] - HALF[1], 0.0);
        let edges = [
            Vector3::x() * (2.0 * HALF[0]),
            Vector3::y() * (2.0 * HALF[1]),
        ];
        self.face(corner, edges, material, instance);
    }

    /// The wall and the pictures on it, which hang 1 cm before it.
    fn wall(&mut self, wall: &Wall) {
        let (seed, instance) = (self.seed(), self.instance());
        let material = if seed.is_multiple_of(2) {
            Material::Plaster { seed }
        } else {
            Material::Brick { seed }
        };
        let up = Vector3::z() * WALL_HEIGHT;
        // Seen from inside, `left` to `right` along u and up along v faces the room.
        self.face(
            flat(wall.left, 0.0),
            [flat(wall.along * wall.length, 0.0), up],
            material,
            instance,
        );
        let mut at = self.within(0.2, 0.5);
        while at < wall.length - 1.0 {
            let (width, height) = (self.within(0.45, 1.0), self.within(0.35, 0.8));
            let bottom = self.within(1.1, 1.5);
            let corner = wall.left + wall.along * at + wall.inward * 0.01;
            let poster = Material::Poster { seed: self.seed() };
            let edges = [flat(wall.along * width, 0.0), Vector3::z() * height];
            self.face(flat(corner, bottom), edges, poster, instance);
            at += width + self.within(0.15, 0.6);
        }
    }

    fn furnish(&mut self, wall: &Wall) {
        // Corners stay free by the depth of the furniture on the next wall.
        let mut at = 0.65;
        loop {
            at += self.within(0.05, 0.5);
            let width = self.within(0.5, 1.3);
            if at + width > wall.length - 0.65 {
                return;
            }
            let middle = at + width / 2.0;
            match self.random.random_range(0..4_u8) {
                0 => self.bookcase(wall, middle, width),
                1 => self.table(wall, middle, width),
                2 => self.pile(wall, middle, width),
                _ => self.chest(wall, middle, width),
            }
            at += width;
        }
    }

    /// A box that stands `gap` before the wall.
    fn against(wall: &Wall, middle: f64, size: [f64; 3], z: f64) -> Block {
        let gap = 0.02;
        let centre = wall.left + wall.along * middle + wall.inward * (gap + size[0] / 2.0);
        Block {
            bottom: Point3::new(centre.x, centre.y, z),
            heading_rad: wall.inward.y.atan2(wall.inward.x),
            size: size.into(),
        }
    }

    fn bookcase(&mut self, wall: &Wall, middle: f64, width: f64) {
        let height = self.within(1.3, 2.1);
        let (material, instance) = (Material::Books { seed: self.seed() }, self.instance());
        Self::against(wall, middle, [0.32, width, height], 0.0).add_faces(
            material,
            instance,
            &mut self.faces,
        );
    }

    fn chest(&mut self, wall: &Wall, middle: f64, width: f64) {
        let (depth, height) = (self.within(0.35, 0.5), self.within(0.45, 1.1));
        let (material, instance) = (Material::Wood { seed: self.seed() }, self.instance());
        Self::against(wall, middle, [depth, width, height], 0.0).add_faces(
            material,
            instance,
            &mut self.faces,
        );
        let (size, top) = (
            self.within(0.15, 0.3),
            Material::Poster { seed: self.seed() },
        );
        let instance = self.instance();
        Self::against(wall, middle, [size, size * 1.3, size * 0.9], height).add_faces(
            top,
            instance,
            &mut self.faces,
        );
    }

    fn pile(&mut self, wall: &Wall, middle: f64, width: f64) {
        let mut z = 0.0;
        for _ in 0..3 {
            let [depth, height] = [self.within(0.3, 0.48), self.within(0.22, 0.42)];
            let width = width * self.within(0.5, 0.95);
            let (material, instance) = (Material::Carton { seed: self.seed() }, self.instance());
            let mut block = Self::against(wall, middle, [depth, width, height], z);
            block.heading_rad += self.within(-0.04, 0.04);
            block.add_faces(material, instance, &mut self.faces);
            z += height;
        }
    }

    fn table(&mut self, wall: &Wall, middle: f64, width: f64) {
        let top = Self::against(wall, middle, [0.5, width, 0.04], 0.7);
        self.table_of(&top);
    }

    /// A table whose top is that block, with four legs and something on it.
    fn table_of(&mut self, top: &Block) {
        let (material, instance) = (Material::Wood { seed: self.seed() }, self.instance());
        top.add_faces(material, instance, &mut self.faces);
        let turn = Rotation2::new(top.heading_rad);
        for [x, y] in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
            let corner =
                turn * Vector2::new(x * (top.size.x / 2.0 - 0.05), y * (top.size.y / 2.0 - 0.05));
            let leg = Block {
                bottom: Point3::new(top.bottom.x + corner.x, top.bottom.y + corner.y, 0.0),
                heading_rad: top.heading_rad,
                size: Vector3::new(0.05, 0.05, top.bottom.z),
            };
            leg.add_faces(material, instance, &mut self.faces);
        }
        let load = Block {
            bottom: top.bottom + Vector3::z() * top.size.z,
            heading_rad: top.heading_rad + self.within(-0.5, 0.5),
            size: Vector3::new(
                self.within(0.15, 0.3),
                self.within(0.2, 0.35),
                self.within(0.08, 0.3),
            ),
        };
        let (material, instance) = (Material::Poster { seed: self.seed() }, self.instance());
        load.add_faces(material, instance, &mut self.faces);
    }

    /// A low table in the middle, below the way of the camera.
    fn middle(&mut self) {
        let top = Block {
            bottom: Point3::new(CENTRE[0], CENTRE[1], 0.42),
            heading_rad: self.within(0.0, PI),
            size: Vector3::new(self.within(0.4, 0.55), self.within(0.6, 0.8), 0.05),
        };
        self.table_of(&top);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn furniture_leaves_the_ring_to_those_who_walk() {
        for seed in 0..20 {
            let scene = room(seed);
            let furniture = scene.still.iter().filter(|face| face.instance.0 > 5);
            for face in furniture {
                let p = face.corner.raw.xy() - Point3::new(CENTRE[0], CENTRE[1], 0.0).xy();
                let on_table = p.norm() < 0.6;
                let against_wall = p.x.abs() > RING[0] + 0.4 || p.y.abs() > RING[1] + 0.4;
                assert!(on_table || against_wall, "seed {seed}: {face:?}");
            }
        }
    }

    #[test]
    fn the_walls_look_into_the_room() {
        let scene = room(1);
        for face in scene
            .still()
            .iter()
            .filter(|face| (1..6).contains(&face.instance.0))
        {
            let normal = face.edge_u.raw.cross(&face.edge_v.raw);
            let eye = Vector3::new(CENTRE[0], CENTRE[1], 1.5);
            assert!(
                normal.dot(&(eye - face.corner.raw.coords)) > 0.0,
                "{face:?}"
            );
        }
    }
}
