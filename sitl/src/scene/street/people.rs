//! People: on foot, and on bicycles. Their limbs follow the way they have come.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::noise::{at_cell, lerp, unit};
use crate::scene::shape::{Lathe, Look, Profile};
use crate::scene::{Face, Instance, Material};

/// Two steps.
const STRIDE_M: f64 = 1.4;
/// How far a bicycle goes while its pedals turn once.
const TURN_M: f64 = 5.0;

/// Someone, by seed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Person {
    pub(super) instance: Instance,
    pub(super) seed: u32,
}

impl Person {
    /// How tall they are.
    pub(super) fn height_m(self) -> f64 {
        f64::from(lerp(1.55, 1.92, unit(at_cell(4, 31, self.seed))))
    }

    fn look(self, material: Material) -> Look {
        Look {
            material,
            instance: self.instance,
        }
    }

    /// Walking, after so many metres; standing if they do not get on.
    pub(super) fn walk(
        self,
        place: &Isometry3<f64>,
        travelled_m: f64,
        speed: f64,
        faces: &mut Vec<Face>,
    ) {
        let tall = self.height_m();
        let swing = 0.5 * (speed / 1.3).clamp(0.0, 1.2);
        let phase = (TAU * travelled_m / STRIDE_M).sin() * swing;
        let hip = 0.5 * tall;
        let shoulder = 0.82 * tall;
        let mut figure = self.figure(place, faces);
        for side in [1.0, -1.0] {
            let leg = [phase * side, hip - 0.02, 0.085];
            figure.limb([0.0, side * 0.1, hip], leg, figure.trousers);
            let arm = [-phase * side, 0.36 * tall, 0.05];
            figure.limb([0.0, side * 0.23, shoulder], arm, figure.shirt);
        }
        figure.trunk([0.0, hip - 0.06], shoulder + 0.03 - hip, 0.0);
        figure.head([0.02, 0.86 * tall], 0.145 * tall);
    }

    /// On a bicycle.
    pub(super) fn ride(self, place: &Isometry3<f64>, travelled_m: f64, faces: &mut Vec<Face>) {
        let mut figure = self.figure(place, faces);
        let phase = TAU * travelled_m / TURN_M;
        for (side, turn) in [(1.0, phase), (-1.0, phase + PI)] {
            let lift = 0.75 + 0.28 * turn.sin();
            let hip = [-0.18, side * 0.1, 0.98];
            figure.limb(hip, [lift, 0.46, 0.09], figure.trousers);
            let knee = [
                hip[0] + 0.46 * lift.sin(),
                hip[1],
                hip[2] - 0.46 * lift.cos(),
            ];
            figure.limb(
                knee,
                [-0.25 - 0.2 * turn.cos(), 0.45, 0.06],
                figure.trousers,
            );
            figure.limb([0.2, side * 0.2, 1.42], [0.65, 0.5, 0.045], figure.shirt);
        }
        figure.trunk([-0.2, 0.95], 0.56, 0.65);
        figure.head([0.27, 1.48], 0.26);
    }

    fn figure<'a>(self, place: &'a Isometry3<f64>, faces: &'a mut Vec<Face>) -> Figure<'a> {
        let cloth = |seed| self.look(Material::Cloth { seed });
        Figure {
            place,
            faces,
            shirt: cloth(self.seed),
            trousers: cloth(self.seed ^ 0x55),
            skin: self.look(Material::Skin { seed: self.seed }),
        }
    }
}

/// A person whose limbs are being added.
struct Figure<'a> {
    place: &'a Isometry3<f64>,
    faces: &'a mut Vec<Face>,
    shirt: Look,
    trousers: Look,
    skin: Look,
}

impl Figure<'_> {
    /// An arm or a leg that hangs from a joint, swung forward.
    fn limb(&mut self, joint: [f64; 3], [swing, length, radius]: [f64; 3], look: Look) {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -swing);
        let place = self.place * Isometry3::from_parts(Translation3::from(joint), turn);
        let rings = [
            [0.0, -length],
            [radius * 0.75, -length],
            [radius, 0.0],
            [0.0, radius * 0.6],
        ];
        let limb = Lathe {
            place,
            rings: &rings,
            sides: 6,
        };
        limb.add_faces(look, self.faces);
    }

    /// From the hip, forward and up, leaning forward.
    fn trunk(&mut self, [x, z]: [f64; 2], length: f64, lean: f64) {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), lean);
        let place = self.place * Isometry3::from_parts(Translation3::new(x, 0.0, z), turn);
        let upper = [
            [0.11, length * 0.75],
            [0.08, length],
            [-0.09, length],
            [-0.11, length * 0.6],
        ];
        let trunk = Profile {
            place,
            upper: &upper,
            low: 0.0,
            half_width: [0.16, 0.21],
        };
        trunk.add_faces([self.shirt; 2], self.faces);
    }

    fn head(&mut self, [x, z]: [f64; 2], height: f64) {
        let r = height * 0.36;
        let rings = [
            [0.0, 0.0],
            [r * 0.8, height * 0.15],
            [r, height * 0.5],
            [r * 0.75, height * 0.88],
            [0.0, height],
        ];
        let head = Lathe {
            place: self.place * Translation3::new(x, 0.0, z),
            rings: &rings,
            sides: 8,
        };
        head.add_faces(self.skin, self.faces);
    }
}

/// The middle of a person's feet.
pub(super) fn feet(x: f64, y: f64, up: f64, heading_rad: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad);
    Isometry3::from_parts(Translation3::from(Point3::new(x, y, up).coords), turn)
}
