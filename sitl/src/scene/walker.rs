//! People, made of boxes, who walk to and fro along an arc.
//!
//! ```text
//! φ(t) = φ₀ + a·sin(2πt/T + ψ)      p(t) = c + (r_x cos φ, r_y sin φ)
//! ```

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use maps::frame::{Point, World};
use maps::time::Stamp;
use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::{Block, Face, Instance, Material};

/// Someone who walks. Their position and all their limbs are functions of time alone.
#[derive(Clone, Debug)]
pub struct Walker {
    /// Who it is, in the instance image.
    pub instance: Instance,
    pub(super) centre: [f64; 2],
    pub(super) radii: [f64; 2],
    pub(super) angle_rad: f64,
    pub(super) swing_rad: f64,
    pub(super) period_s: f64,
    pub(super) phase_rad: f64,
    pub(super) height_m: f64,
    pub(super) seed: u32,
}

impl Walker {
    /// Where they stand, on the floor.
    pub fn position(&self, at: Stamp) -> Point<World> {
        let (sin, cos) = self.angle(at).sin_cos();
        let [x, y] = self.centre;
        Point::new(x + self.radii[0] * cos, y + self.radii[1] * sin, 0.0)
    }

    /// How fast they can be at most, in m/s.
    pub fn top_speed_mps(&self) -> f64 {
        self.radii[0].max(self.radii[1]) * self.swing_rad * TAU / self.period_s
    }

    fn angle(&self, at: Stamp) -> f64 {
        self.angle_rad + self.swing_rad * self.phase(at).sin()
    }

    fn phase(&self, at: Stamp) -> f64 {
        TAU * at.as_secs_f64() / self.period_s + self.phase_rad
    }

    /// Along the arc, turning round smoothly at its ends.
    fn heading(&self, at: Stamp) -> f64 {
        let speed = self.phase(at).cos();
        self.angle(at) + FRAC_PI_2 + (1.0 - (speed * 6.0).tanh()) * FRAC_PI_2
    }

    /// Adds trunk, head, arms and swinging legs.
    pub(super) fn add_faces(&self, at: Stamp, faces: &mut Vec<Face>) {
        let foot = self.position(at).raw;
        let heading_rad = self.heading(at);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad);
        // A full step every 1.3 m: the legs keep pace with the ground covered.
        let stride =
            0.22 * (self.angle(at) * self.radii[0] * TAU / 1.3).sin() * self.phase(at).cos().abs();
        let tall = self.height_m;
        let mut add = |offset: [f64; 3], size: [f64; 3], material: Material| {
            let block = Block {
                bottom: Point3::from(foot.coords + turn * Vector3::from(offset)),
                heading_rad,
                size: size.into(),
            };
            block.add_faces(material, self.instance, faces);
        };
        let shirt = Material::Cloth { seed: self.seed };
        let trousers = Material::Cloth {
            seed: self.seed ^ 0x55,
        };
        let skin = Material::Skin { seed: self.seed };
        for (side, step) in [(0.11, stride), (-0.11, -stride)] {
            add([step, side, 0.0], [0.16, 0.16, 0.48 * tall], trousers);
            add(
                [-step * 0.8, side * 2.5, 0.45 * tall],
                [0.11, 0.10, 0.36 * tall],
                shirt,
            );
        }
        add([0.0, 0.0, 0.46 * tall], [0.24, 0.42, 0.38 * tall], shirt);
        add([0.02, 0.0, 0.85 * tall], [0.2, 0.17, 0.15 * tall], skin);
    }
}

/// Spreads walkers of the seed over the ring around `centre`.
pub(super) fn on_ring(centre: [f64; 2], radii: [f64; 2], seed: u32) -> Vec<Walker> {
    use crate::noise::{at_cell, unit};
    (0..3_u16)
        .map(|i| {
            let random = |what: i32| f64::from(unit(at_cell(i32::from(i), what, seed)));
            let swing_rad = 0.9 + 0.5 * random(0);
            let speed_mps = 0.6 + 0.4 * random(1);
            Walker {
                instance: Instance(Instance::FIRST_MOVER.0 + i),
                centre,
                radii,
                angle_rad: f64::from(i) * TAU / 3.0 + random(2) * 0.6 - 0.3,
                swing_rad,
                period_s: radii[0] * swing_rad * TAU / speed_mps,
                phase_rad: random(3) * PI,
                height_m: 1.62 + 0.22 * random(4),
                seed: at_cell(i32::from(i), 5, seed),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walker_never_exceeds_their_top_speed() {
        for walker in on_ring([1.3, 0.0], [2.4, 1.9], 3) {
            let fastest = (0..2000_u64)
                .map(|i| {
                    let [now, next] =
                        [i, i + 1].map(|i| walker.position(Stamp::from_nanos(i * 20_000_000)));
                    (next - now).norm() / 0.02
                })
                .fold(0.0, f64::max);
            let top = walker.top_speed_mps();
            assert!(fastest <= top + 1e-9, "{fastest} m/s, at most {top}");
            assert!(fastest > 0.4, "it walks: {fastest} m/s");
        }
    }
}
