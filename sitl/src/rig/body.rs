//! What a vehicle feels of its own motion and place.

use std::f64::consts::TAU;

use maps::frame::{Body, Point, Vector};
use maps::time::Stamp;
use nalgebra::{Point3, Vector3};
use sensors::ros::vehicle::{
    FLUID_PRESSURE, IMU, Imu as ImuMessage, JOINT_STATE, NAV_SAT_FIX, NavSatFix, RANGE,
    RangeLimits, encode_joints, encode_pressure, encode_range,
};

use super::truth::base;
use super::world::World;
use super::{Rate, Reading, Sensor, Setup};
use crate::platform::Platform;
use crate::scene::Name;
use crate::sensor::barometer::{Barometer, BarometerModel, pressure_pa};
use crate::sensor::child_seed;
use crate::sensor::gnss::{FixType, GnssReading, Receiver, ReceiverModel, Sky};
use crate::sensor::imu::{Imu, ImuModel, specific_force};
use crate::sensor::rangefinder::{Light, Rangefinder, RangefinderModel};
use crate::sensor::wheel_odometry::{WheelModel, WheelOdometry};

pub(super) fn of(platform: Platform, setup: &Setup) -> Vec<Box<dyn Sensor>> {
    let named = |what: &str| format!("{}/{what}", platform.name());
    let seed = |what: &str| child_seed(setup.seed, &named(what));
    let mut sensors: Vec<Box<dyn Sensor>> = vec![
        Box::new(Inertial {
            name: named("imu"),
            platform,
            model: model(platform),
            unit: Imu::new(model(platform), seed("imu")),
        }),
        Box::new(Satellites {
            name: named("gnss"),
            platform,
            receiver: Receiver::new(ReceiverModel::rtk(), seed("gnss")),
        }),
    ];
    match platform {
        Platform::Uav => {
            let outdoors = setup.scene != Name::Room;
            let model = RangefinderModel::TFMINI_PLUS;
            sensors.push(Box::new(Pressure {
                name: named("barometer"),
                model: BarometerModel::MS5611_IN_WASH,
                unit: Barometer::new(BarometerModel::MS5611_IN_WASH, seed("barometer")),
            }));
            sensors.push(Box::new(Altimeter {
                name: named("rangefinder"),
                model,
                light: if outdoors {
                    Light::Outdoors
                } else {
                    Light::Indoors
                },
                unit: Rangefinder::new(model, seed("rangefinder")),
            }));
        }
        Platform::Ugv => sensors.push(Box::new(Wheels {
            name: named("wheels"),
            ticks_per_turn: WheelModel::SMALL_CAR.ticks_per_turn,
            axle: WheelOdometry::new(WheelModel::SMALL_CAR, seed("wheels")),
        })),
    }
    sensors
}

fn model(platform: Platform) -> ImuModel {
    match platform {
        Platform::Uav => ImuModel::ICM_42688_P,
        Platform::Ugv => ImuModel::BMI088,
    }
}

struct Inertial {
    name: String,
    platform: Platform,
    model: ImuModel,
    unit: Imu,
}

const IMU_RATE: Rate = Rate::hz(200);

impl Sensor for Inertial {
    fn name(&self) -> &str {
        &self.name
    }

    fn rate(&self) -> Rate {
        IMU_RATE
    }

    fn read(&mut self, world: &mut World<'_>, at: Stamp, noise: f64) -> Vec<Reading> {
        let rate_hz = IMU_RATE.count as f64;
        let (motion, acceleration) = world.motion(self.platform, at);
        let turn = motion.world_from_body.raw.rotation;
        let force = specific_force(&turn, Vector::from_raw(acceleration));
        let sample = self.unit.measure(motion.rates, force, 1.0 / rate_hz);
        let spread = |true_value: Vector<Body>, measured: Vector<Body>| {
            true_value.raw + (measured.raw - true_value.raw) * noise
        };
        let rates = spread(motion.rates, sample.rates);
        let specific_force = spread(force, sample.specific_force);
        let variance = |density: f64| density * density * rate_hz * noise * noise;
        let rates_variance = variance(self.model.gyroscope.noise_density_radps_per_rthz);
        let specific_force_variance =
            variance(self.model.accelerometer.noise_density_mps2_per_rthz);
        let frame = self.name.clone();
        let encode = move |at| {
            ImuMessage {
                at,
                frame_id: &frame,
                rates,
                rates_variance,
                specific_force,
                specific_force_variance,
            }
            .encode()
        };
        let topic = format!("/{}/imu/data_raw", self.platform.name());
        vec![Reading::now(topic, &IMU, at, encode)]
    }
}

struct Satellites {
    name: String,
    platform: Platform,
    receiver: Receiver,
}

impl Sensor for Satellites {
    fn name(&self) -> &str {
        &self.name
    }

    /// Asked more often than there are fixes, since those come late.
    fn rate(&self) -> Rate {
        Rate::hz(25)
    }

    fn read(&mut self, world: &mut World<'_>, at: Stamp, noise: f64) -> Vec<Reading> {
        let (motion, _) = world.motion(self.platform, at);
        // Above the cameras and the LiDAR.
        let antenna = motion.world_from_body.raw * Point3::new(0.0, 0.0, 0.3);
        let sky = if self.receiver.is_due(at) {
            world.sky(antenna, at)
        } else {
            Sky::OPEN
        };
        let Some(reading) = self.receiver.step(at, &motion, sky) else {
            return Vec::new();
        };
        let (then, _) = world.motion(self.platform, reading.at);
        let fix = fix(world, &reading, then.position(), noise);
        let topic = format!("/{}/gnss/fix", self.platform.name());
        let frame = self.name.clone();
        let encode = move |shown| {
            NavSatFix {
                at: shown,
                frame_id: &frame,
                ..fix
            }
            .encode()
        };
        vec![Reading {
            complete: at,
            ..Reading::now(topic, &NAV_SAT_FIX, reading.at, encode)
        }]
    }
}

/// What the receiver says of that reading.
fn fix(
    world: &World<'_>,
    reading: &GnssReading,
    truth: Point<maps::frame::World>,
    noise: f64,
) -> NavSatFix<'static> {
    let status = match reading.fix {
        FixType::None => -1,
        FixType::TwoD | FixType::ThreeD => 0,
        FixType::RtkFloat | FixType::RtkFixed => 2,
    };
    let none = NavSatFix {
        at: Stamp::ZERO,
        frame_id: "",
        status,
        latitude_deg: f64::NAN,
        longitude_deg: f64::NAN,
        altitude_m: f64::NAN,
        variances_m2: [0.0; 3],
    };
    let Some(solution) = reading.solution else {
        return none;
    };
    let truth = truth.raw.coords;
    let place = truth + (solution.position.raw.coords - truth) * noise;
    let place = world
        .origin
        .to_geodetic(Point::new(place.x, place.y, place.z));
    let variance = |accuracy_m: f64| (accuracy_m * noise).powi(2);
    let across = variance(solution.horizontal_accuracy_m);
    NavSatFix {
        latitude_deg: place.lat_deg,
        longitude_deg: place.lon_deg,
        altitude_m: place.alt_m,
        variances_m2: [across, across, variance(solution.vertical_accuracy_m)],
        ..none
    }
}

struct Pressure {
    name: String,
    model: BarometerModel,
    unit: Barometer,
}

const PRESSURE_RATE: Rate = Rate::hz(25);

impl Sensor for Pressure {
    fn name(&self) -> &str {
        &self.name
    }

    fn rate(&self) -> Rate {
        PRESSURE_RATE
    }

    fn read(&mut self, world: &mut World<'_>, at: Stamp, noise: f64) -> Vec<Reading> {
        let (motion, _) = world.motion(Platform::Uav, at);
        let altitude_m = world.origin.to_geodetic(motion.position()).alt_m;
        let measured = self
            .unit
            .measure(altitude_m, 1.0 / PRESSURE_RATE.count as f64);
        let truth = pressure_pa(altitude_m, self.model.sea_level_pa);
        let pressure = truth + (measured - truth) * noise;
        let variance = (self.model.white_pa * noise).powi(2);
        let encode = move |at| encode_pressure(at, base(Platform::Uav), pressure, variance);
        vec![Reading::now(
            "/uav/barometer/pressure",
            &FLUID_PRESSURE,
            at,
            encode,
        )]
    }
}

struct Altimeter {
    name: String,
    model: RangefinderModel,
    light: Light,
    unit: Rangefinder,
}

impl Sensor for Altimeter {
    fn name(&self) -> &str {
        &self.name
    }

    fn rate(&self) -> Rate {
        Rate::hz(20)
    }

    fn read(&mut self, world: &mut World<'_>, at: Stamp, noise: f64) -> Vec<Reading> {
        let (motion, _) = world.motion(Platform::Uav, at);
        let pose = motion.world_from_body.raw;
        let from: Point3<f64> = pose.translation.vector.into();
        let down = pose.rotation * -Vector3::z();
        let hit = world
            .snapshot(at)
            .cast(from, down, self.model.farthest_indoors_m * 2.0);
        let truth = hit.map(|hit| hit.range_m);
        let measured = self.unit.measure(truth, self.light);
        let spread =
            |measured: f64| truth.map_or(measured, |truth| truth + (measured - truth) * noise);
        let range = measured.map(|range| spread(range) as f32);
        let limits = RangeLimits {
            field_of_view_rad: 3.6_f32.to_radians(),
            nearest_m: self.model.nearest_m as f32,
            farthest_m: match self.light {
                Light::Outdoors => self.model.farthest_outdoors_m,
                Light::Indoors => self.model.farthest_indoors_m,
            } as f32,
            variance_m2: (self.model.noise_m * noise).powi(2) as f32,
        };
        let encode = move |at| encode_range(at, "uav/rangefinder", range, limits);
        vec![Reading::now("/uav/rangefinder/range", &RANGE, at, encode)]
    }
}

struct Wheels {
    name: String,
    ticks_per_turn: f64,
    axle: WheelOdometry,
}

const WHEEL_RATE: Rate = Rate::hz(50);

impl Sensor for Wheels {
    fn name(&self) -> &str {
        &self.name
    }

    fn rate(&self) -> Rate {
        WHEEL_RATE
    }

    /// Counts have no noise that could be larger: slip and wrong radii are in them from the start.
    fn read(&mut self, world: &mut World<'_>, at: Stamp, _: f64) -> Vec<Reading> {
        let (motion, _) = world.motion(Platform::Ugv, at);
        let forward = motion.world_from_body.raw.rotation * Vector3::x();
        let speed = forward.dot(&motion.velocity.raw);
        let ticks = self
            .axle
            .roll(speed, motion.rates.raw.z, 1.0 / WHEEL_RATE.count as f64);
        let angle = |ticks: i64| ticks as f64 / self.ticks_per_turn * TAU;
        let joints = [
            ("left_wheel", angle(ticks.left)),
            ("right_wheel", angle(ticks.right)),
        ];
        let encode = move |at| encode_joints(at, &joints);
        vec![Reading::now(
            "/ugv/wheels/joint_states",
            &JOINT_STATE,
            at,
            encode,
        )]
    }
}
