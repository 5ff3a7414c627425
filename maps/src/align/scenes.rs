//! Seeded scenes of boxes and poles on a floor, and a lidar that looks at them: for tests and benches, which have it by
//! `#[path]`. Truth shares no code with what is tested.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// Something solid.
#[derive(Clone, Debug)]
enum Solid {
    /// A box turned about the vertical.
    Box {
        middle: Vector3<f64>,
        half: Vector3<f64>,
        yaw: f64,
    },
    /// An upright cylinder from the floor.
    Pole {
        x: f64,
        y: f64,
        radius: f64,
        height: f64,
    },
}

/// What there is to see.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scene {
    solids: Vec<Solid>,
    /// Movable ones: cars, crates.
    movable: Vec<Solid>,
    has_floor: bool,
}

/// The kinds of scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Buildings on both sides, poles, parked cars.
    Street,
    /// Four walls, a ceiling's worth of furniture.
    Room,
    /// Two walls without end.
    Corridor,
    /// One wall without end, on a floor.
    Wall,
    /// Nothing but floor.
    Floor,
    /// Equal columns in a row, 2 m apart, along a wall without end.
    Columns,
}

impl Scene {
    /// The scene of a seed.
    pub(crate) fn new(kind: Kind, random: &mut Pcg64) -> Self {
        let mut scene = Self {
            has_floor: true,
            ..Self::default()
        };
        match kind {
            Kind::Street => scene.street(random),
            Kind::Room => scene.room(random),
            Kind::Corridor => {
                scene.solids.push(slab(0.0, -2.0, 200.0, 0.2, 3.0));
                scene.solids.push(slab(0.0, 2.0, 200.0, 0.2, 3.0));
            }
            Kind::Wall => scene.solids.push(slab(0.0, 5.0, 200.0, 0.2, 4.0)),
            Kind::Floor => {}
            Kind::Columns => {
                scene.solids.push(slab(0.0, 5.0, 200.0, 0.2, 4.0));
                scene.solids.extend((-100..100).map(|i| Solid::Box {
                    middle: Vector3::new(2.0 * f64::from(i), 3.5, 1.5),
                    half: Vector3::new(0.25, 0.25, 1.5),
                    yaw: 0.0,
                }));
            }
        }
        scene
    }

    fn street(&mut self, random: &mut Pcg64) {
        for side in [-1.0, 1.0] {
            let mut x = -45.0;
            while x < 45.0 {
                let width = random.random_range(6.0..14.0);
                let depth = random.random_range(4.0..8.0);
                let setback = random.random_range(7.0..11.0);
                let height = random.random_range(4.0..12.0);
                self.solids.push(Solid::Box {
                    middle: Vector3::new(
                        x + width / 2.0,
                        side * (setback + depth / 2.0),
                        height / 2.0,
                    ),
                    half: Vector3::new(width / 2.0, depth / 2.0, height / 2.0),
                    yaw: random.random_range(-0.06..0.06),
                });
                x += width + random.random_range(0.5..5.0);
            }
            for _ in 0..6 {
                self.solids.push(Solid::Pole {
                    x: random.random_range(-40.0..40.0),
                    y: side * random.random_range(4.5..6.0),
                    radius: random.random_range(0.06..0.2),
                    height: random.random_range(3.0..7.0),
                });
            }
            for _ in 0..7 {
                self.movable.push(car(random, side * 3.6));
            }
        }
    }

    fn room(&mut self, random: &mut Pcg64) {
        let (w, d) = (random.random_range(4.0..8.0), random.random_range(3.0..6.0));
        for side in [-1.0, 1.0] {
            self.solids.push(slab(0.0, side * d, 2.0 * w, 0.2, 3.0));
            self.solids.push(Solid::Box {
                middle: Vector3::new(side * w, 0.0, 1.5),
                half: Vector3::new(0.1, d, 1.5),
                yaw: 0.0,
            });
        }
        for at in 0..10 {
            let half = Vector3::new(
                random.random_range(0.2..0.7),
                random.random_range(0.2..0.7),
                random.random_range(0.2..0.8),
            );
            let piece = Solid::Box {
                middle: Vector3::new(
                    random.random_range(1.2 - w..w - 1.2),
                    random.random_range(1.2 - d..d - 1.2),
                    half.z,
                ),
                half,
                yaw: random.random_range(0.0..3.0),
            };
            if at < 6 {
                self.solids.push(piece);
            } else {
                self.movable.push(piece);
            }
        }
    }

    /// The same scene later: a share of what can move is elsewhere.
    #[must_use]
    pub(crate) fn after_moves(&self, share: f64, random: &mut Pcg64) -> Self {
        let mut later = self.clone();
        for solid in &mut later.movable {
            if random.random_range(0.0..1.0) < share
                && let Solid::Box { middle, yaw, .. } = solid
            {
                middle.x += random.random_range(-6.0..6.0);
                middle.y += random.random_range(-1.0..1.0);
                *yaw += random.random_range(-0.5..0.5);
            }
        }
        later
    }

    /// Where a ray first meets something, within 60 m.
    fn cast(&self, from: &Vector3<f64>, ray: &Vector3<f64>) -> Option<f64> {
        let floor = (self.has_floor && ray.z < -1e-9).then(|| -from.z / ray.z);
        self.solids
            .iter()
            .chain(&self.movable)
            .filter_map(|solid| solid.cast(from, ray))
            .chain(floor)
            .filter(|t| (0.3..60.0).contains(t))
            .min_by(f64::total_cmp)
    }

    /// What a lidar at a pose sees, in its own frame, with noise along the rays.
    pub(crate) fn scan(
        &self,
        pose: &Isometry3<f64>,
        lidar: &Lidar,
        random: &mut Pcg64,
    ) -> Vec<Point3<f64>> {
        let mut points = Vec::new();
        for ring in 0..lidar.rings {
            let share = f64::from(ring) / f64::from(lidar.rings - 1);
            let elevation = lidar.low_rad + share * (lidar.high_rad - lidar.low_rad);
            for column in 0..lidar.columns {
                let azimuth = TAU * (f64::from(column) + 0.5) / f64::from(lidar.columns);
                let ray = Vector3::new(
                    elevation.cos() * azimuth.cos(),
                    elevation.cos() * azimuth.sin(),
                    elevation.sin(),
                );
                if let Some(range) = self.cast(&pose.translation.vector, &(pose.rotation * ray)) {
                    points.push((ray * (range + lidar.noise_m * normal(random))).into());
                }
            }
        }
        points
    }
}

/// A spinning lidar.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lidar {
    /// Of beams.
    pub(crate) rings: u32,
    /// Shots a turn.
    pub(crate) columns: u32,
    /// The lowest beam.
    pub(crate) low_rad: f64,
    /// The highest beam.
    pub(crate) high_rad: f64,
    /// Standard deviation along the ray.
    pub(crate) noise_m: f64,
}

/// Thirty-two beams, two centimetres.
impl Default for Lidar {
    fn default() -> Self {
        Self {
            rings: 32,
            columns: 600,
            low_rad: -0.5,
            high_rad: 0.4,
            noise_m: 0.02,
        }
    }
}

/// A standard normal deviate (Box and Muller).
pub(crate) fn normal(random: &mut Pcg64) -> f64 {
    let u: f64 = random.random_range(f64::MIN_POSITIVE..1.0);
    let v: f64 = random.random_range(0.0..TAU);
    (-2.0 * u.ln()).sqrt() * v.cos()
}

/// A pose on the floor plan, at a height.
pub(crate) fn at(x: f64, y: f64, z: f64, yaw: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry3::from_parts(Vector3::new(x, y, z).into(), turn)
}

/// The random numbers of a trial.
pub(crate) fn random(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

fn slab(x: f64, y: f64, length: f64, thickness: f64, height: f64) -> Solid {
    Solid::Box {
        middle: Vector3::new(x, y, height / 2.0),
        half: Vector3::new(length / 2.0, thickness / 2.0, height / 2.0),
        yaw: 0.0,
    }
}

fn car(random: &mut Pcg64, y: f64) -> Solid {
    Solid::Box {
        middle: Vector3::new(random.random_range(-40.0..40.0), y, 0.8),
        half: Vector3::new(2.2, 0.9, 0.8),
        yaw: random.random_range(-0.1..0.1),
    }
}

impl Solid {
    fn cast(&self, from: &Vector3<f64>, ray: &Vector3<f64>) -> Option<f64> {
        match self {
            Self::Box { middle, half, yaw } => {
                let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw);
                let (o, d) = (turn * (from - middle), turn * ray);
                let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
                for axis in 0..3 {
                    let near = (-half[axis] - o[axis]) / d[axis];
                    let far = (half[axis] - o[axis]) / d[axis];
                    enter = enter.max(near.min(far));
                    leave = leave.min(near.max(far));
                }
                (enter <= leave && enter > 0.0).then_some(enter)
            }
            Self::Pole {
                x,
                y,
                radius,
                height,
            } => {
                let (ox, oy) = (from.x - x, from.y - y);
                let a = ray.x * ray.x + ray.y * ray.y;
                let b = ox * ray.x + oy * ray.y;
                let c = ox * ox + oy * oy - radius * radius;
                let root = b * b - a * c;
                if root < 0.0 || a < 1e-12 {
                    return None;
                }
                let t = (-b - root.sqrt()) / a;
                let z = from.z + t * ray.z;
                (t > 0.0 && (0.0..*height).contains(&z)).then_some(t)
            }
        }
    }
}
