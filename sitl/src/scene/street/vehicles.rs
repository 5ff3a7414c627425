//! What vehicles look like. Their frame is body (forward, left, up), its origin on the ground below their middle.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::noise::{at_cell, lerp, unit};
use crate::scene::shape::{Block, Lathe, Look, Profile, standing};
use crate::scene::{Face, Instance, Material};

/// A vehicle that stands in the origin.
pub(super) struct Model {
    pub(super) faces: Vec<Face>,
    /// Length, width and height in metres.
    pub(super) size: [f64; 3],
}

/// Builds one vehicle.
struct Workshop {
    faces: Vec<Face>,
    instance: Instance,
    seed: u32,
}

impl Workshop {
    fn new(instance: Instance, seed: u32) -> Self {
        let faces = Vec::new();
        Self {
            faces,
            instance,
            seed,
        }
    }

    fn pick(&self, what: i32, [low, high]: [f32; 2]) -> f64 {
        f64::from(lerp(low, high, unit(at_cell(what, 21, self.seed))))
    }

    fn look(&self, material: Material) -> Look {
        let instance = self.instance;
        Look { material, instance }
    }

    fn paint(&self) -> Look {
        self.look(Material::Paint { seed: self.seed })
    }

    fn profile(&mut self, upper: &[[f64; 2]], low: f64, half_width: [f64; 2], looks: [Look; 2]) {
        let place = Isometry3::identity();
        let profile = Profile {
            place,
            upper,
            low,
            half_width,
        };
        profile.add_faces(looks, &mut self.faces);
    }

    fn block(&mut self, bottom: [f64; 3], size: [f64; 3], look: Look) {
        let block = Block {
            bottom: bottom.into(),
            heading_rad: 0.0,
            size: size.into(),
        };
        block.add_faces(look.material, look.instance, &mut self.faces);
    }

    /// A plate upright across the body, facing forward (1) or backward (-1).
    fn plate(&mut self, x: f64, [left, up]: [f64; 2], [width, height]: [f64; 2], look: Look) {
        let towards = x.signum();
        let corner = Point3::new(x, left - towards * width / 2.0, up);
        let edges = [Vector3::y() * (towards * width), Vector3::z() * height];
        self.faces.push(look.rectangle(corner, edges));
    }

    /// Lamps at both corners of both ends, and the number plates.
    fn ends(&mut self, [front, back]: [f64; 2], half_width: f64, up: f64) {
        for side in [-1.0, 1.0] {
            let left = side * (half_width - 0.26);
            for (x, is_red) in [(front, false), (back, true)] {
                let look = self.look(Material::Lamp { is_red });
                self.plate(x, [left, up], [0.36, 0.15], look);
            }
        }
        let sign = self.look(Material::Sign { seed: self.seed });
        for x in [front, back] {
            self.plate(x, [0.0, up - 0.2], [0.5, 0.12], sign);
        }
    }

    fn wheels(&mut self, axles: &[f64], half_track: f64, radius: f64, width: f64) {
        for &x in axles {
            for side in [-1.0, 1.0] {
                self.wheel(
                    [x, side * half_track, radius],
                    side * FRAC_PI_2,
                    radius,
                    width,
                );
            }
        }
    }

    /// A wheel with its hub towards `turn_rad` about the forward axis from straight up.
    fn wheel(&mut self, [x, y, z]: [f64; 3], turn_rad: f64, radius: f64, width: f64) {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -turn_rad);
        let place = Isometry3::from_parts(Translation3::new(x, y, z), turn);
        let half = width / 2.0;
        let rings = [
            [0.0, -half],
            [radius, -half],
            [radius, half],
            [radius * 0.65, half],
        ];
        let rubber = self.look(Material::Rubber);
        let tyre = Lathe {
            place,
            rings: &rings,
            sides: 12,
        };
        tyre.add_faces(rubber, &mut self.faces);
        let rim = [
            [radius * 0.65, half],
            [radius * 0.2, half + 0.01],
            [0.0, half + 0.01],
        ];
        let hub = Lathe {
            place,
            rings: &rim,
            sides: 12,
        };
        hub.add_faces(self.look(Material::Metal { seed: 3 }), &mut self.faces);
    }

    fn finish(self, size: [f64; 3]) -> Model {
        Model {
            faces: self.faces,
            size,
        }
    }
}

/// A hatchback, saloon, estate, off-road car or van, by seed, of that length and width.
pub(super) fn car(instance: Instance, seed: u32, [length, width]: [f64; 2]) -> Model {
    let mut shop = Workshop::new(instance, seed);
    let kind = shop.pick(0, [0.0, 4.99]) as u8;
    let height = match kind {
        0 => 1.48,
        1 => 1.44,
        2 => 1.50,
        3 => 1.68,
        _ => 1.95,
    };
    let (h, w) = (length / 2.0, width / 2.0);
    let belt = height * if kind == 4 { 0.56 } else { 0.63 };
    let bonnet = belt * 0.93;
    let paint = shop.paint();
    let nose = if kind == 4 { h - 0.9 } else { h - 1.15 };
    let tail = match kind {
        1 => 0.75 - h,
        _ => 0.12 - h,
    };
    let body = [
        [h, belt * 0.62],
        [h - 0.12, belt * 0.8],
        [nose, bonnet],
        [nose - 0.15, belt],
        [tail, belt],
        [-h + 0.08, belt * 0.95],
        [-h, belt * 0.6],
    ];
    shop.profile(&body, 0.2, [w, w * 0.97], [paint, paint]);
    let [rake, slope] = match kind {
        4 => [0.45, 0.12],
        1 => [0.75, 0.85],
        0 => [0.7, 0.35],
        _ => [0.7, 0.25],
    };
    let roof = [nose - 0.1 - rake, tail + slope];
    let cabin = [
        [nose - 0.1, belt],
        [roof[0], height],
        [roof[1], height - 0.03],
        [tail, belt],
    ];
    let glass = shop.look(Material::Glass);
    shop.profile(&cabin, belt - 0.01, [w * 0.94, w * 0.74], [glass, glass]);
    roofing(
        &mut shop,
        [roof[0] + 0.08, roof[1] - 0.08],
        [w * 0.75, height],
        paint,
    );
    pillars(
        &mut shop,
        roof,
        [belt, height],
        [w * 0.945, w * 0.745],
        paint,
    );
    shop.ends([h + 0.01, -h - 0.01], w, belt * 0.62);
    let radius = if kind == 3 { 0.36 } else { 0.32 };
    shop.wheels(&[h - 0.82, 0.85 - h], w - 0.1, radius, 0.2);
    for side in [-1.0, 1.0] {
        shop.block(
            [nose - 0.35, side * (w + 0.09), belt],
            [0.12, 0.18, 0.14],
            paint,
        );
    }
    shop.finish([length, width, height])
}

fn roofing(shop: &mut Workshop, [front, back]: [f64; 2], [half_width, up]: [f64; 2], look: Look) {
    let corner = Point3::new(back, -half_width, up + 0.005);
    let edges = [
        Vector3::x() * (front - back),
        Vector3::y() * (2.0 * half_width),
    ];
    shop.faces.push(look.rectangle(corner, edges));
}

/// The pillars between the side windows.
fn pillars(
    shop: &mut Workshop,
    [front, back]: [f64; 2],
    [low, high]: [f64; 2],
    [wide, narrow]: [f64; 2],
    look: Look,
) {
    let middle = f64::midpoint(front, back);
    for x in [middle + 0.25, back + 0.25] {
        for side in [-1.0, 1.0] {
            let at = |dx: f64, half: f64, z: f64| Point3::new(x + dx, side * (half + 0.004), z);
            let mut corners = [
                at(-0.06, wide, low),
                at(0.06, wide, low),
                at(0.06, narrow, high),
                at(-0.06, narrow, high),
            ];
            if side > 0.0 {
                corners = [corners[1], corners[0], corners[3], corners[2]];
            }
            shop.faces.push(look.trapezoid(corners));
        }
    }
}

/// A lorry with a cab and a box, of that length and width.
pub(super) fn truck(instance: Instance, seed: u32, [length, width]: [f64; 2]) -> Model {
    let mut shop = Workshop::new(instance, seed);
    let height = shop.pick(2, [3.0, 3.6]);
    let (h, w) = (length / 2.0, width / 2.0);
    let paint = shop.paint();
    let cab = [[h, 1.1], [h - 0.08, 2.45], [h - 0.5, 2.75], [h - 1.9, 2.75]];
    shop.profile(&cab, 0.55, [w - 0.06, w - 0.12], [paint, paint]);
    let glass = shop.look(Material::Glass);
    // The windscreen leans with the cab.
    let screen = [[h + 0.004, 1.55], [h - 0.06, 2.4]];
    let corner = Point3::new(screen[0][0], 0.15 - w, screen[0][1]);
    let lean = Vector3::new(
        screen[1][0] - screen[0][0],
        0.0,
        screen[1][1] - screen[0][1],
    );
    shop.faces
        .push(glass.rectangle(corner, [Vector3::y() * (width - 0.3), lean]));
    for side in [-1.0, 1.0] {
        let y = side * (w - 0.055);
        let corner = Point3::new(h - 1.0 + side * 0.5, y, 1.55);
        let edges = [Vector3::x() * -side, Vector3::z() * 0.8];
        shop.faces.push(glass.rectangle(corner, edges));
    }
    let box_look = shop.look(Material::Corrugated { seed });
    let long = length - 2.1;
    shop.block(
        [-h + long / 2.0, 0.0, 1.0],
        [long, width, height - 1.0],
        box_look,
    );
    let frame = shop.look(Material::Metal { seed: 2 });
    shop.block([-0.4, 0.0, 0.6], [length - 1.2, 1.0, 0.35], frame);
    shop.ends([h + 0.01, -h - 0.01], w, 0.85);
    shop.wheels(&[h - 1.2, 2.2 - h, 1.1 - h], w - 0.16, 0.5, 0.28);
    shop.finish([length, width, height])
}

/// A city bus of that length and width: windows all along.
pub(super) fn bus(instance: Instance, seed: u32, [length, width]: [f64; 2]) -> Model {
    let mut shop = Workshop::new(instance, seed);
    let height = 3.05;
    let (h, w) = (length / 2.0, width / 2.0);
    let paint = shop.paint();
    let side = [[h, 2.7], [h - 0.15, height], [0.1 - h, height], [-h, 2.7]];
    shop.profile(&side, 0.32, [w, w - 0.04], [paint, paint]);
    let glass = shop.look(Material::Glass);
    for side in [-1.0, 1.0] {
        let mut x = -h + 0.5;
        while x < h - 1.2 {
            let corner = Point3::new(
                if side < 0.0 { x } else { x + 1.3 },
                side * (w + 0.003),
                1.25,
            );
            let edges = [Vector3::x() * (-side * 1.3), Vector3::z() * 1.25];
            shop.faces.push(glass.rectangle(corner, edges));
            x += 1.45;
        }
    }
    shop.plate(h + 0.01, [0.0, 1.0], [width - 0.25, 1.6], glass);
    shop.plate(-h - 0.01, [0.0, 1.6], [width - 0.6, 0.9], glass);
    let sign = shop.look(Material::Sign { seed });
    shop.plate(h + 0.02, [0.0, 2.62], [1.6, 0.3], sign);
    shop.ends([h + 0.01, -h - 0.01], w, 0.6);
    shop.wheels(&[h - 2.6, 3.2 - h], w - 0.15, 0.48, 0.28);
    shop.finish([length, width, height])
}

/// Our own ground vehicle: a chassis on four wheels, and a mast with cameras and a `LiDAR`. Low enough that its sensors do
/// not see it.
pub(super) fn robot(instance: Instance) -> Model {
    let mut shop = Workshop::new(instance, 40);
    let [length, width, height] = [1.2, 0.9, 1.3];
    let paint = shop.look(Material::Sign { seed: 9 });
    let metal = shop.look(Material::Metal { seed: 6 });
    shop.block([0.0, 0.0, 0.18], [length - 0.1, 0.56, 0.22], metal);
    shop.block([0.0, 0.0, 0.4], [0.9, 0.5, 0.14], paint);
    shop.block([0.0, 0.0, 0.54], [0.06, 0.06, 0.6], metal);
    shop.wheels(&[0.36, -0.36], (width - 0.16) / 2.0, 0.2, 0.15);
    let rings = [[0.0, -0.06], [0.06, -0.06], [0.06, 0.06], [0.0, 0.06]];
    let place = Isometry3::translation(0.0, 0.0, 1.2);
    let rubber = shop.look(Material::Rubber);
    Lathe {
        place,
        rings: &rings,
        sides: 10,
    }
    .add_faces(rubber, &mut shop.faces);
    shop.finish([length, width, height])
}

/// A bicycle, without its rider.
pub(super) fn bicycle(instance: Instance, seed: u32) -> Model {
    let mut shop = Workshop::new(instance, seed);
    for x in [0.53, -0.53] {
        shop.wheel([x, 0.0, 0.34], FRAC_PI_2, 0.34, 0.04);
        shop.wheel([x, 0.0, 0.34], -FRAC_PI_2, 0.34, 0.04);
    }
    let paint = shop.paint();
    let rubber = shop.look(Material::Rubber);
    shop.block([0.05, 0.0, 0.72], [0.85, 0.04, 0.05], paint);
    shop.block([-0.1, 0.0, 0.3], [0.75, 0.04, 0.05], paint);
    shop.block([0.47, 0.0, 0.35], [0.05, 0.04, 0.7], paint);
    shop.block([-0.22, 0.0, 0.35], [0.05, 0.04, 0.6], paint);
    shop.block([0.45, 0.0, 1.03], [0.06, 0.55, 0.04], rubber);
    shop.block([-0.25, 0.0, 0.93], [0.26, 0.16, 0.06], rubber);
    shop.finish([1.75, 0.6, 1.1])
}

/// Where a vehicle stands, turned by half if it shows its back.
pub(super) fn facing(x: f64, y: f64, heading_rad: f64, is_turned: bool) -> Isometry3<f64> {
    standing(x, y, 0.0, heading_rad + if is_turned { PI } else { 0.0 })
}
