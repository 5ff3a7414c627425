//! The symbols of vehicles: a copter and a rover, solid or hollow, that tell their heading from every side.

use std::f64::consts::TAU;

use maps::frame::{Body, Isometry, Point, Vector, World};
use nalgebra::Vector3;

use super::sketch::{CORNERS, Sketch, WHITE, opaque, quad, triangle};

const DARK: [u8; 3] = [38, 40, 46];

/// A vehicle's symbol, made of parts in lengths of the vehicle.
pub(crate) struct Glyph {
    pub(crate) world_from_body: Isometry<World, Body>,
    pub(crate) size_m: f64,
    pub(crate) color: [u8; 3],
}

const ROTORS: [[f64; 2]; 4] = [[0.33, 0.33], [0.33, -0.33], [-0.33, 0.33], [-0.33, -0.33]];
const ROTOR_RADIUS: f64 = 0.23;

impl Glyph {
    fn at(&self, [x, y, z]: [f64; 3]) -> Point<World> {
        self.world_from_body * Point::new(x * self.size_m, y * self.size_m, z * self.size_m)
    }

    pub(crate) fn copter(&self, sketch: &mut Sketch) {
        self.block(
            sketch,
            [[-0.2, -0.12, -0.06], [0.2, 0.12, 0.07]],
            self.color,
        );
        for [x, y] in ROTORS {
            self.beam(sketch, [x, y], DARK);
            let front = x > 0.0;
            // The front rotors are bright: the symbol tells its heading without its nose.
            let color = if front { WHITE } else { self.color };
            let rim: Vec<_> = (0..=CORNERS)
                .map(|i| {
                    let (sin, cos) = (i as f64 / CORNERS as f64 * TAU).sin_cos();
                    self.at([x + ROTOR_RADIUS * cos, y + ROTOR_RADIUS * sin, 0.09])
                })
                .collect();
            for pair in rim.windows(2) {
                let corners = [self.at([x, y, 0.09]).raw, pair[0].raw, pair[1].raw];
                triangle(&mut sketch.glass, corners, opaque(color, 120), false);
            }
            sketch.line(&rim, opaque(color, 255), 1.8);
        }
        self.nose(sketch, 0.2, 0.42, [0.0, 0.09]);
    }

    pub(crate) fn rover(&self, sketch: &mut Sketch) {
        for [x, y] in [[0.3, 0.3], [0.3, -0.3], [-0.3, 0.3], [-0.3, -0.3]] {
            self.block(
                sketch,
                [[x - 0.14, y - 0.06, 0.0], [x + 0.14, y + 0.06, 0.26]],
                DARK,
            );
        }
        self.block(sketch, [[-0.5, -0.24, 0.1], [0.5, 0.24, 0.32]], self.color);
        self.block(sketch, [[-0.42, -0.2, 0.32], [0.12, 0.2, 0.48]], self.color);
        self.nose(sketch, 0.16, 0.46, [0.325, 0.16]);
    }

    pub(crate) fn hollow_copter(&self, sketch: &mut Sketch) {
        let color = opaque(self.color, 255);
        for [x, y] in ROTORS {
            let rim: Vec<_> = (0..=CORNERS)
                .map(|i| {
                    let (sin, cos) = (i as f64 / CORNERS as f64 * TAU).sin_cos();
                    self.at([x + ROTOR_RADIUS * cos, y + ROTOR_RADIUS * sin, 0.0])
                })
                .collect();
            sketch.line(&rim, color, 1.8);
            sketch.line(&[self.at([0.0; 3]), self.at([x, y, 0.0])], color, 1.8);
        }
        let tip = [
            self.at([0.25, 0.1, 0.0]),
            self.at([0.5, 0.0, 0.0]),
            self.at([0.25, -0.1, 0.0]),
        ];
        sketch.line(&tip, color, 1.8);
    }

    pub(crate) fn hollow_rover(&self, sketch: &mut Sketch) {
        let color = opaque(self.color, 255);
        let around = |z: f64| {
            [
                [0.5, 0.3],
                [-0.5, 0.3],
                [-0.5, -0.3],
                [0.5, -0.3],
                [0.5, 0.3],
            ]
            .map(|[x, y]| self.at([x, y, z]))
        };
        let (floor, roof) = (around(0.0), around(0.35));
        sketch.line(&floor, color, 1.8);
        sketch.line(&roof, color, 1.8);
        for (below, above) in floor.iter().zip(&roof).take(4) {
            sketch.line(&[*below, *above], color, 1.8);
        }
        let tip = [
            self.at([0.1, 0.18, 0.35]),
            self.at([0.4, 0.0, 0.35]),
            self.at([0.1, -0.18, 0.35]),
        ];
        sketch.line(&tip, color, 1.8);
    }

    /// A white arrow head from `from` to `to` ahead, on top.
    fn nose(&self, sketch: &mut Sketch, from: f64, to: f64, [height, half_width]: [f64; 2]) {
        let z = height + 0.012;
        let corners =
            [[from, half_width, z], [from, -half_width, z], [to, 0.0, z]].map(|p| self.at(p).raw);
        triangle(&mut sketch.solid, corners, opaque(WHITE, 255), false);
    }

    fn beam(&self, sketch: &mut Sketch, [x, y]: [f64; 2], color: [u8; 3]) {
        // Across the arm, level.
        let (across_x, across_y) = (-y * 0.09, x * 0.09);
        let corners = [
            [across_x, across_y, 0.03],
            [-across_x, -across_y, 0.03],
            [x - across_x, y - across_y, 0.03],
            [x + across_x, y + across_y, 0.03],
        ];
        let up = self.world_from_body * Vector::new(0.0, 0.0, 1.0);
        quad(
            &mut sketch.solid,
            corners.map(|p| self.at(p).raw),
            opaque(color, 255),
            Some(up.raw),
        );
    }

    fn block(&self, sketch: &mut Sketch, [low, high]: [[f64; 3]; 2], color: [u8; 3]) {
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (level, sign) in [(low[axis], -1.0), (high[axis], 1.0)] {
                let corner = |along_u: f64, along_v: f64| {
                    let mut p = [0.0; 3];
                    (p[axis], p[u], p[v]) = (level, along_u, along_v);
                    self.at(p).raw
                };
                let mut normal = Vector3::zeros();
                normal[axis] = sign;
                let normal = (self.world_from_body * Vector::from_raw(normal)).raw;
                let corners = [
                    corner(low[u], low[v]),
                    corner(high[u], low[v]),
                    corner(high[u], high[v]),
                    corner(low[u], high[v]),
                ];
                quad(&mut sketch.solid, corners, opaque(color, 255), Some(normal));
            }
        }
    }
}
