//! What there is to be seen: flat faces with a material, and people who walk.
//!
//! A scene is generated from a seed and is a pure function of time, so that a picture, its depth and its truth are of
//! one instant by construction. World axes as everywhere: x east, y north, z up, the floor at z = 0. The scene's origin
//! lies below the place where the camera of [`crate::flight`] starts.

mod material;
mod room;
mod walker;

use maps::frame::{Point, Vector, World};
use maps::time::Stamp;
use nalgebra::{Point3, UnitQuaternion, Vector3};

pub use material::{Material, Spot};
pub(crate) use room::CENTRE as ROOM_CENTRE;
pub use walker::Walker;

/// Which thing a pixel shows. Everything made of one piece shares an instance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instance(pub u16);

impl Instance {
    /// No surface at all: the light above the walls.
    pub const NOTHING: Self = Self(0);
    /// The floor.
    pub const FLOOR: Self = Self(1);
    /// The first of those that move.
    pub const FIRST_MOVER: Self = Self(0x8000);

    /// Whether it moves.
    pub fn moves(self) -> bool {
        self >= Self::FIRST_MOVER
    }
}

/// A rectangle, seen from the side that `edge_u × edge_v` points to.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// One corner.
    pub corner: Point<World>,
    /// From the corner along one side, in metres.
    pub edge_u: Vector<World>,
    /// From the corner along the other side, at a right angle to the first.
    pub edge_v: Vector<World>,
    /// What it looks like.
    pub material: Material,
    /// What it belongs to.
    pub instance: Instance,
}

/// Everything that can be seen, at any time.
#[derive(Clone, Debug)]
pub struct Scene {
    still: Vec<Face>,
    walkers: Vec<Walker>,
}

/// Scenes that can be asked for by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Name {
    /// A furnished room of 7 m by 5.8 m with three people walking in it.
    Room,
}

impl Scene {
    /// Builds the scene of that name. The same seed gives the same scene.
    pub fn generate(name: Name, seed: u64) -> Self {
        match name {
            Name::Room => room::room(seed),
        }
    }

    /// The faces of everything, where it is at that moment.
    pub fn faces(&self, at: Stamp) -> Vec<Face> {
        let mut faces = self.still.clone();
        for walker in &self.walkers {
            walker.add_faces(at, &mut faces);
        }
        faces
    }

    /// Those who move.
    pub fn walkers(&self) -> &[Walker] {
        &self.walkers
    }
}

/// An upright box: where the middle of its bottom is, how it is turned, how long its sides are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    pub(crate) bottom: Point3<f64>,
    pub(crate) heading_rad: f64,
    /// Along its heading, across it, and up.
    pub(crate) size: Vector3<f64>,
}

impl Block {
    /// Adds its five faces that can be seen (not the one it stands on, unless it floats).
    fn add_faces(&self, material: Material, instance: Instance, faces: &mut Vec<Face>) {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.heading_rad);
        let half = self.size / 2.0;
        let mut add = |corner: [f64; 3], edge_u: [f64; 3], edge_v: [f64; 3]| {
            let at = |v: [f64; 3]| turn * Vector3::from(v);
            faces.push(Face {
                corner: Point::from_raw(self.bottom + at(corner)),
                edge_u: Vector::from_raw(at(edge_u)),
                edge_v: Vector::from_raw(at(edge_v)),
                material,
                instance,
            });
        };
        let ([x, y, _], [lx, ly, lz]) = (<[f64; 3]>::from(half), <[f64; 3]>::from(self.size));
        add([x, -y, 0.0], [0.0, ly, 0.0], [0.0, 0.0, lz]);
        add([-x, y, 0.0], [0.0, -ly, 0.0], [0.0, 0.0, lz]);
        add([x, y, 0.0], [-lx, 0.0, 0.0], [0.0, 0.0, lz]);
        add([-x, -y, 0.0], [lx, 0.0, 0.0], [0.0, 0.0, lz]);
        add([-x, -y, lz], [lx, 0.0, 0.0], [0.0, ly, 0.0]);
        if self.bottom.z > 0.0 {
            add([-x, y, 0.0], [lx, 0.0, 0.0], [0.0, -ly, 0.0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_seen_from_outside() {
        let block = Block {
            bottom: Point3::new(1.0, 2.0, 0.5),
            heading_rad: 0.4,
            size: Vector3::new(0.4, 0.6, 0.8),
        };
        let mut faces = Vec::new();
        block.add_faces(Material::Wood { seed: 1 }, Instance(7), &mut faces);
        assert_eq!(faces.len(), 6, "a floating box shows all its sides");
        let middle = block.bottom + Vector3::new(0.0, 0.0, 0.4);
        for face in faces {
            let normal = face.edge_u.raw.cross(&face.edge_v.raw);
            let centre = face.corner.raw + (face.edge_u.raw + face.edge_v.raw) / 2.0;
            assert!(normal.dot(&(centre - middle)) > 0.0, "{face:?}");
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_room_and_another_seed_another() {
        let corners = |seed| -> Vec<_> {
            let faces = Scene::generate(Name::Room, seed).faces(Stamp::from_nanos(1_000_000_000));
            faces.iter().map(|face| face.corner).collect()
        };
        assert_eq!(corners(1), corners(1));
        assert_ne!(corners(1), corners(2));
    }
}
