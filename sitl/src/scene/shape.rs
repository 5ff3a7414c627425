//! Solids made of flat faces, from which everything in a scene is built.

use std::f64::consts::TAU;

use maps::frame::{Point, Vector, World};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::{Face, Instance, Material};

/// What a face belongs to and looks like.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look {
    pub(crate) material: Material,
    pub(crate) instance: Instance,
}

impl Look {
    fn face(self, corner: Point3<f64>, edges: [Vector3<f64>; 2], top: [f64; 2]) -> Face {
        Face {
            corner: Point::from_raw(corner),
            edge_u: Vector::from_raw(edges[0]),
            edge_v: Vector::from_raw(edges[1]),
            top,
            material: self.material,
            instance: self.instance,
        }
    }

    /// A rectangle; its edges are at a right angle.
    pub(crate) fn rectangle(self, corner: Point3<f64>, edges: [Vector3<f64>; 2]) -> Face {
        self.face(corner, edges, [0.0, 1.0])
    }

    /// A triangle, counter-clockwise as seen.
    pub(crate) fn triangle(self, [a, b, c]: [Point3<f64>; 3]) -> Face {
        let edge_u = b - a;
        let at = (c - a).dot(&edge_u) / edge_u.norm_squared();
        self.face(a, [edge_u, c - a - edge_u * at], [at, at])
    }

    /// A flat surface with four corners of which the sides from first to second and from fourth to third are parallel.
    pub(crate) fn trapezoid(self, [a, b, c, d]: [Point3<f64>; 4]) -> Face {
        let edge_u = b - a;
        let share = |p: Point3<f64>| (p - a).dot(&edge_u) / edge_u.norm_squared();
        let top = [share(d), share(c)];
        self.face(a, [edge_u, d - a - edge_u * top[0]], top)
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
    pub(crate) fn add_faces(&self, material: Material, instance: Instance, faces: &mut Vec<Face>) {
        let look = Look { material, instance };
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.heading_rad);
        let half = self.size / 2.0;
        let mut add = |corner: [f64; 3], edge_u: [f64; 3], edge_v: [f64; 3]| {
            let at = |v: [f64; 3]| turn * Vector3::from(v);
            faces.push(look.rectangle(self.bottom + at(corner), [at(edge_u), at(edge_v)]));
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

/// What a polygon on a potter's wheel leaves: a pole, a trunk, a crown, a head, a wheel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lathe<'a> {
    /// From its own frame, whose z axis it turns about.
    pub(crate) place: Isometry3<f64>,
    /// Radius and height of each ring, upwards.
    pub(crate) rings: &'a [[f64; 2]],
    pub(crate) sides: u8,
}

impl Lathe<'_> {
    /// Adds a face for each side of each pair of rings. Ends with a radius above zero are open.
    pub(crate) fn add_faces(&self, look: Look, faces: &mut Vec<Face>) {
        let sides = f64::from(self.sides.max(3));
        let at = |ring: [f64; 2], side: u8| {
            let (sin, cos) = (TAU * f64::from(side) / sides).sin_cos();
            self.place * Point3::new(ring[0] * cos, ring[0] * sin, ring[1])
        };
        for (low, high) in self.rings.iter().zip(self.rings.iter().skip(1)) {
            for side in 0..self.sides {
                let next = (side + 1) % self.sides.max(1);
                let [a, b] = [at(*low, side), at(*low, next)];
                let [c, d] = [at(*high, next), at(*high, side)];
                faces.push(match (low[0] > 0.0, high[0] > 0.0) {
                    (true, true) => look.trapezoid([a, b, c, d]),
                    (true, false) => look.triangle([a, b, c]),
                    (false, true) => look.triangle([a, c, d]),
                    (false, false) => continue,
                });
            }
        }
    }
}

/// What a side view makes when it is pulled across: the body of a car, a roof. Its frame is forward, left, up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Profile<'a> {
    pub(crate) place: Isometry3<f64>,
    /// Forward and upward coordinates of its upper edge, from front to back.
    pub(crate) upper: &'a [[f64; 2]],
    /// How high its lower edge is.
    pub(crate) low: f64,
    /// Half its width at the lower and at the upper edge.
    pub(crate) half_width: [f64; 2],
}

impl Profile<'_> {
    /// Adds both sides, of one look, and what is in front, above, behind and below, of another.
    pub(crate) fn add_faces(&self, [side, across]: [Look; 2], faces: &mut Vec<Face>) {
        let [wide, narrow] = self.half_width;
        let top = self.upper.iter().fold(self.low, |top, p| p[1].max(top));
        let half = |z: f64| wide + (narrow - wide) * (z - self.low) / (top - self.low).max(1e-9);
        let at = |x: f64, left: f64, z: f64| self.place * Point3::new(x, left * half(z), z);
        let mut pull = |[x0, z0]: [f64; 2], [x1, z1]: [f64; 2]| {
            let corners = [
                at(x0, -1.0, z0),
                at(x0, 1.0, z0),
                at(x1, 1.0, z1),
                at(x1, -1.0, z1),
            ];
            faces.push(across.trapezoid(corners));
        };
        let (first, last) = (self.upper[0], self.upper[self.upper.len() - 1]);
        pull([first[0], self.low], first);
        for pair in self.upper.windows(2) {
            pull(pair[0], pair[1]);
        }
        pull(last, [last[0], self.low]);
        pull([last[0], self.low], [first[0], self.low]);
        for pair in self.upper.windows(2) {
            let ([x0, z0], [x1, z1]) = (pair[0], pair[1]);
            for left in [-1.0, 1.0] {
                let [mut a, mut b] = [at(x0, left, self.low), at(x1, left, self.low)];
                let [mut c, mut d] = [at(x1, left, z1), at(x0, left, z0)];
                if left < 0.0 {
                    (a, b, c, d) = (b, a, d, c);
                }
                faces.extend(flat(side, [a, b, c, d]));
            }
        }
    }
}

/// The triangles of a surface with four corners, counter-clockwise as seen, that need not be flat.
pub(crate) fn flat(look: Look, [a, b, c, d]: [Point3<f64>; 4]) -> impl Iterator<Item = Face> {
    let area = |p: [Point3<f64>; 3]| (p[1] - p[0]).cross(&(p[2] - p[0])).norm();
    [[a, b, c], [a, c, d]]
        .into_iter()
        .filter(move |triangle| area(*triangle) > 1e-9)
        .map(move |triangle| look.triangle(triangle))
}

/// Moves faces made in a frame of their own.
pub(crate) fn placed(faces: &[Face], place: &Isometry3<f64>) -> impl Iterator<Item = Face> {
    faces.iter().map(move |face| Face {
        corner: Point::<World>::from_raw(place * face.corner.raw),
        edge_u: Vector::from_raw(place * face.edge_u.raw),
        edge_v: Vector::from_raw(place * face.edge_v.raw),
        ..*face
    })
}

/// Where a thing stands that is turned about the vertical.
pub(crate) fn standing(x: f64, y: f64, z: f64, heading_rad: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad);
    Isometry3::from_parts(Vector3::new(x, y, z).into(), turn)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOK: Look = Look {
        material: Material::Wood { seed: 1 },
        instance: Instance(7),
    };

    /// Whether all faces of a convex solid show outwards.
    fn all_outwards(faces: &[Face], middle: Point3<f64>) {
        for face in faces {
            let normal = face.edge_u.raw.cross(&face.edge_v.raw);
            let corners = face.corners().map(|corner| corner.raw.coords);
            let centre = corners.iter().sum::<Vector3<f64>>() / 4.0;
            assert!(normal.dot(&(centre - middle.coords)) > 0.0, "{face:?}");
        }
    }

    /// The volume within faces that close a solid, by the divergence theorem.
    fn volume(faces: &[Face]) -> f64 {
        let solid = |face: &Face| {
            let [a, b, c, d] = face.corners().map(|corner| corner.raw.coords);
            a.dot(&b.cross(&c)) + a.dot(&c.cross(&d))
        };
        faces.iter().map(solid).sum::<f64>() / 6.0
    }

    #[test]
    fn a_box_is_seen_from_outside() {
        let block = Block {
            bottom: Point3::new(1.0, 2.0, 0.5),
            heading_rad: 0.4,
            size: Vector3::new(0.4, 0.6, 0.8),
        };
        let mut faces = Vec::new();
        block.add_faces(LOOK.material, LOOK.instance, &mut faces);
        assert_eq!(faces.len(), 6, "a floating box shows all its sides");
        all_outwards(&faces, block.bottom + Vector3::new(0.0, 0.0, 0.4));
        assert!((volume(&faces) - 0.4 * 0.6 * 0.8).abs() < 1e-12);
    }

    #[test]
    fn a_lathe_with_closed_ends_is_a_solid_seen_from_outside() {
        let rings = [[0.0, 0.0], [2.0, 1.0], [1.0, 3.0], [0.0, 3.5]];
        let place = standing(4.0, -3.0, 1.0, 0.7);
        let mut faces = Vec::new();
        Lathe {
            place,
            rings: &rings,
            sides: 12,
        }
        .add_faces(LOOK, &mut faces);
        assert_eq!(faces.len(), 36);
        all_outwards(&faces, place * Point3::new(0.0, 0.0, 1.8));
        // Frusta over a polygon of 12 sides, whose area is 3 r².
        let expected = 3.0 * (4.0 * 1.0 + (4.0 + 2.0 + 1.0) * 2.0 + 1.0 * 0.5) / 3.0;
        assert!(
            (volume(&faces) - expected).abs() < 1e-9,
            "{}",
            volume(&faces)
        );
    }

    #[test]
    fn a_profile_is_seen_from_outside_whether_it_narrows_or_not() {
        let upper = [[2.0, 0.8], [1.0, 1.4], [-1.0, 1.4], [-2.0, 0.9]];
        let place = standing(1.0, 1.0, 0.0, -2.0);
        for half_width in [[0.9, 0.9], [0.9, 0.6]] {
            let profile = Profile {
                place,
                upper: &upper,
                low: 0.3,
                half_width,
            };
            let mut faces = Vec::new();
            profile.add_faces([LOOK; 2], &mut faces);
            all_outwards(&faces, place * Point3::new(0.0, 0.0, 0.6));
            let narrows = half_width[1] < half_width[0];
            if !narrows {
                let area = 0.5 * 1.0 * (0.5 + 1.1) + 1.1 * 2.0 + 0.5 * 1.0 * (1.1 + 0.6);
                assert!(
                    (volume(&faces) - area * 1.8).abs() < 1e-9,
                    "{}",
                    volume(&faces)
                );
            }
        }
    }
}
