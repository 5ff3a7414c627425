//! What the ground vehicle's `LiDAR` and radar find.

use std::time::Duration;

use maps::frame::{Point, Vector};
use maps::time::Stamp;
use nalgebra::{Isometry3, Point3, Vector3};
use sensors::ros::points::{Cloud, FieldType, POINT_CLOUD2};

use super::world::World;
use super::{Rate, Reading, Sensor, Setup};
use crate::lidar::Lidar;
use crate::platform::{self, Platform};
use crate::scene::{Class, RoadUser};
use crate::sensor::child_seed;
use crate::sensor::radar::{Radar, RadarModel, Source, Target};
use crate::truth::boxes;

pub(super) fn of(platform: Platform, setup: &Setup) -> Vec<Box<dyn Sensor>> {
    if platform == Platform::Uav {
        return Vec::new();
    }
    vec![
        Box::new(Sweeps {
            lidar: Lidar::rs_32(),
            seed: child_seed(setup.seed, "ugv/lidar"),
        }),
        Box::new(Echoes {
            model: RadarModel::ars408(),
            radar: Radar::new(RadarModel::ars408(), child_seed(setup.seed, "ugv/radar")),
        }),
    ]
}

struct Sweeps {
    lidar: Lidar,
    seed: u64,
}

const SWEEP_FIELDS: [(&str, FieldType); 6] = [
    ("x", FieldType::F32),
    ("y", FieldType::F32),
    ("z", FieldType::F32),
    ("intensity", FieldType::F32),
    ("ring", FieldType::U16),
    ("time", FieldType::F32),
];

impl Sensor for Sweeps {
    fn name(&self) -> &'static str {
        "ugv/lidar"
    }

    fn rate(&self) -> Rate {
        Rate {
            count: 1,
            span: self.lidar.turn,
        }
    }

    /// Stamped with the start of the turn; `time` of a point is what has passed since.
    fn read(&mut self, world: &mut World<'_>, at: Stamp, noise: f64) -> Vec<Reading> {
        let scene = world.scene;
        let pose = |at| platform::ugv(scene, at);
        let returns = self.lidar.sweep(world.rays(), at, pose, self.seed);
        let mut data = Vec::with_capacity(returns.len() * 22);
        for seen in &returns {
            let point = Vector3::from(seen.point);
            let range = point.norm();
            let spread = f64::from(range - seen.true_range_m) * noise;
            let range_m = seen.true_range_m + spread as f32;
            let point = point * (range_m / range);
            for number in [point.x, point.y, point.z, f32::from(seen.intensity)] {
                data.extend(number.to_le_bytes());
            }
            data.extend(u16::from(seen.ring).to_le_bytes());
            data.extend(seen.after_s.to_le_bytes());
        }
        let encode = move |at| {
            Cloud {
                at,
                frame_id: "ugv/lidar",
                fields: &SWEEP_FIELDS,
                data: &data,
            }
            .encode()
        };
        vec![Reading {
            complete: at + self.lidar.turn,
            ..Reading::now("/ugv/lidar/points", &POINT_CLOUD2, at, encode)
        }]
    }
}

/// Behind the front bumper.
pub(super) fn body_from_radar() -> Isometry3<f64> {
    Isometry3::translation(0.4, 0.0, 0.5)
}

struct Echoes {
    model: RadarModel,
    radar: Radar,
}

const ECHO_FIELDS: [(&str, FieldType); 5] = [
    ("x", FieldType::F32),
    ("y", FieldType::F32),
    ("z", FieldType::F32),
    ("range_rate", FieldType::F32),
    ("rcs", FieldType::F32),
];

impl Sensor for Echoes {
    fn name(&self) -> &'static str {
        "ugv/radar"
    }

    fn rate(&self) -> Rate {
        Rate {
            count: 1,
            span: self.model.period,
        }
    }

    /// Noise of a radar is a matter of its signal: a factor makes its ranges and rates worse, not its detections.
    fn read(&mut self, world: &mut World<'_>, at: Stamp, noise: f64) -> Vec<Reading> {
        let (motion, _) = world.motion(Platform::Ugv, at);
        let radar = motion.world_from_body.raw * body_from_radar();
        let own = motion.velocity.raw;
        let users = boxes(world.scene, at);
        let snapshot = world.snapshot(at);
        let targets: Vec<Target> = users
            .iter()
            .filter(|user| user.thing.class != Class::Robot)
            .filter(|user| {
                let from: Point3<f64> = radar.translation.vector.into();
                let way = user.thing.centre() - from;
                let range = way.norm();
                let hit = snapshot.cast(from, way / range.max(1e-9), range);
                // In sight if the first thing there is itself; legs and gaps let the ray through to its middle.
                range > 1e-9 && hit.is_none_or(|hit| hit.face.instance == user.thing.instance)
            })
            .map(|user| target(user, &radar, own))
            .collect();
        let back = radar.rotation.inverse();
        let detections = self.radar.scan(&targets, Vector::from_raw(back * own));
        let truth = |index: usize| {
            let place = targets[index].position.raw.coords;
            (
                place.norm(),
                targets[index].velocity.raw.dot(&place) / place.norm(),
            )
        };
        let mut data = Vec::with_capacity(detections.len() * 20);
        for seen in &detections {
            let (range_m, rate) = match seen.source {
                Source::Target(index) => {
                    let (range_m, rate) = truth(index);
                    (
                        range_m + (seen.range_m - range_m) * noise,
                        rate + (seen.range_rate_mps - rate) * noise,
                    )
                }
                Source::Clutter => (seen.range_m, seen.range_rate_mps),
            };
            let (left, forward) = seen.azimuth_rad.sin_cos();
            for number in [range_m * forward, range_m * left, 0.0, rate, seen.rcs_dbsm] {
                data.extend((number as f32).to_le_bytes());
            }
        }
        let encode = move |at| {
            Cloud {
                at,
                frame_id: "ugv/radar",
                fields: &ECHO_FIELDS,
                data: &data,
            }
            .encode()
        };
        vec![Reading {
            complete: at + Duration::from_millis(10),
            ..Reading::now("/ugv/radar/points", &POINT_CLOUD2, at, encode)
        }]
    }
}

/// A road user as a radar there meets it.
fn target(user: &RoadUser, radar: &Isometry3<f64>, own: Vector3<f64>) -> Target {
    let place = radar.inverse() * user.thing.centre();
    Target {
        position: Point::new(place.x, place.y, place.z),
        velocity: Vector::from_raw(radar.rotation.inverse() * (user.velocity - own)),
        // Typical of 77 GHz: a person -8 to 0, a bicycle 0, a car 10, a truck 20 and more.
        rcs_dbsm: match user.thing.class {
            Class::Truck | Class::Bus => 20.0,
            Class::Car => 10.0,
            Class::Cyclist => 0.0,
            _ => -5.0,
        },
    }
}
