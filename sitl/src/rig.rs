//! All sensors of both vehicles, on the clocks of their vehicles, with what is wrong with them: every message, when it
//! comes.
//!
//! | sensor | topic | a second |
//! |---|---|---|
//! | `uav/camera` | `/uav/camera/…`: colour, depth, camera | 15 |
//! | `uav/imu`, `ugv/imu` | `/…/imu/data_raw` | 200 |
//! | `uav/gnss`, `ugv/gnss` | `/…/gnss/fix` | 5, of 0.12 s before |
//! | `uav/barometer` | `/uav/barometer/pressure` | 25 |
//! | `uav/rangefinder` | `/uav/rangefinder/range` | 20 |
//! | `ugv/camera-front`, `-left`, `-rear`, `-right` | `/ugv/camera_…/image_raw/compressed` | 10 |
//! | `ugv/lidar` | `/ugv/lidar/points` | 10 |
//! | `ugv/radar` | `/ugv/radar/points` | 13.9 |
//! | `ugv/wheels` | `/ugv/wheels/joint_states` | 50 |
//!
//! and beside them the truth: `/…/ground_truth/…`, `/tf`, `/tf_static`, and `/…/clock/reference`, which tells how far a
//! vehicle's clock is off. A message is stamped with what the vehicle's clock shows when it is measured; the recorder's
//! clock shows the truth.
//!
//! A sensor reads when it is due, whatever the others do, and has random numbers of its own: leaving one out, or breaking
//! it, changes no other.

mod body;
mod camera;
mod scan;
mod truth;
mod world;

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;
use sensors::ros::{Schema, restamp};

use crate::camera_model::{Optics, OpticsError};
use crate::platform::Platform;
use crate::scene::{Name, Scene};
use crate::sensor::child_seed;
use crate::sensor::clock::{ClockModel, PlatformClock};
use crate::sensor::fault::{FaultError, FaultScript, Output};
use crate::wgs84::Origin;
use world::World;

/// What there is aboard, and how good.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The scene's name: indoors there is no satellite, and the depth camera sees less far.
    pub scene: Name,
    /// Seed of all noise.
    pub seed: u64,
    /// Where the world's origin is on Earth.
    pub origin: Origin,
    /// Which sensors are read: `uav/camera` is one, `uav` all of the drone's.
    pub aboard: Vec<String>,
    /// The clocks of the drone and of the ground vehicle.
    pub clocks: [ClockModel; 2],
    /// What breaks when.
    pub faults: FaultScript,
    /// What cameras make of the light.
    pub optics: Optics,
    /// Whether the drone's instance and class images are written, as PNG.
    pub masks: bool,
}

impl Setup {
    /// Vehicles with perfect clocks on which nothing breaks: in the room, where no ground vehicle is, the drone alone.
    pub fn new(scene: Name, seed: u64, origin: Origin) -> Self {
        let aboard = match scene {
            Name::Room => vec!["uav".to_owned()],
            _ => vec!["uav".to_owned(), "ugv".to_owned()],
        };
        Self {
            scene,
            seed,
            origin,
            aboard,
            clocks: [ClockModel::IDEAL; 2],
            faults: FaultScript::default(),
            optics: Optics::IDEAL,
            masks: false,
        }
    }
}

/// One message as it comes in.
#[derive(Clone, Debug, PartialEq)]
pub struct Packet {
    /// True time at which it comes in.
    pub logged: Stamp,
    /// Its topic.
    pub topic: String,
    /// Its type.
    pub schema: &'static Schema,
    /// When it was measured, on the vehicle's clock.
    pub at: Stamp,
    /// CDR.
    pub bytes: Vec<u8>,
}

/// How often something happens: so many times in each span.
#[derive(Clone, Copy, Debug)]
struct Rate {
    count: u64,
    span: Duration,
}

impl Rate {
    const fn hz(count: u64) -> Self {
        Self {
            count,
            span: Duration::from_secs(1),
        }
    }

    fn due(self, index: u64) -> Stamp {
        let span_ns = self.span.as_nanos() as u64;
        Stamp::from_nanos(index * span_ns / self.count)
    }
}

/// What a sensor measures, before anything is wrong with it.
struct Reading {
    topic: String,
    schema: &'static Schema,
    /// True time of which it is.
    of: Stamp,
    /// True time at which it is complete.
    complete: Stamp,
    /// Encodes it with this stamp.
    encode: Box<dyn FnOnce(Stamp) -> Vec<u8> + Send>,
}

impl Reading {
    /// One that is complete as soon as it is taken.
    fn now(
        topic: impl Into<String>,
        schema: &'static Schema,
        at: Stamp,
        encode: impl FnOnce(Stamp) -> Vec<u8> + Send + 'static,
    ) -> Self {
        Self {
            topic: topic.into(),
            schema,
            of: at,
            complete: at,
            encode: Box::new(encode),
        }
    }
}

/// Something that is read at its rate.
trait Sensor: Send {
    /// As fault scripts name it; empty for the truth, with which nothing is ever wrong.
    fn name(&self) -> &str;

    fn rate(&self) -> Rate;

    /// What it says at that time, its noise so many times as large.
    fn read(&mut self, world: &mut World<'_>, at: Stamp, noise: f64) -> Vec<Reading>;
}

struct Mounted {
    sensor: Box<dyn Sensor>,
    platform: Platform,
    index: u64,
    /// What it said last, for when it freezes.
    last: Vec<Packet>,
}

/// The sensors of a run.
pub struct Rig<'a> {
    world: World<'a>,
    clocks: [PlatformClock; 2],
    faults: FaultScript,
    mounted: Vec<Mounted>,
    /// What was measured and has not come in yet, in order.
    under_way: BTreeMap<(Stamp, u64), Packet>,
    count: u64,
}

/// Why a rig cannot be switched on.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// Something is to be aboard that there is not.
    #[error("there is no sensor {found:?}, only uav, ugv or one of {known}")]
    UnknownSensor {
        /// Its name.
        found: String,
        /// Those that there are.
        known: String,
    },
    /// The script of faults names a sensor that is not aboard.
    #[error("faults")]
    Faults(#[from] FaultError),
    /// Cameras that cannot be built.
    #[error(transparent)]
    Optics(#[from] OpticsError),
}

impl<'a> Rig<'a> {
    /// Switches everything on for a run that lasts so long.
    pub fn new(scene: &'a Scene, setup: &Setup, lasts: Duration) -> Result<Self, RigError> {
        let mounted = mount(setup)?;
        let names = mounted.iter().map(|mounted| mounted.sensor.name());
        let names: Vec<&str> = names.filter(|name| !name.is_empty()).collect();
        setup.faults.check_sensors(&names)?;
        let clocks = Platform::ALL.map(|platform| {
            let seed = child_seed(setup.seed, &format!("{}/clock", platform.name()));
            PlatformClock::new(setup.clocks[platform as usize], seed, lasts)
        });
        Ok(Self {
            world: World::new(scene, setup),
            clocks,
            faults: setup.faults.clone(),
            mounted,
            under_way: BTreeMap::new(),
            count: 0,
        })
    }

    /// Everything that comes in before that time and has not been handed over yet, in order.
    pub fn until(&mut self, end: Stamp) -> Vec<Packet> {
        while let Some(next) = self.next().filter(|(due, _)| *due < end) {
            self.read(next);
        }
        let later = self.under_way.split_off(&(end, 0));
        std::mem::replace(&mut self.under_way, later)
            .into_values()
            .collect()
    }

    /// When the next sensor is due, and which.
    fn next(&self) -> Option<(Stamp, usize)> {
        let due = |(i, mounted): (usize, &Mounted)| (mounted.sensor.rate().due(mounted.index), i);
        self.mounted.iter().enumerate().map(due).min()
    }

    fn read(&mut self, (at, which): (Stamp, usize)) {
        let mounted = &mut self.mounted[which];
        mounted.index += 1;
        let faults = self.faults.at(mounted.sensor.name(), at);
        let clock = &self.clocks[mounted.platform as usize];
        // Read in any case: what is broken now goes on as if it had never been afterwards.
        let readings = mounted.sensor.read(&mut self.world, at, faults.noise);
        let packets: Vec<Packet> = match faults.output {
            Output::Off => return,
            Output::Frozen => mounted
                .last
                .iter()
                .map(|last| again(last, clock.shows(at), at))
                .collect(),
            Output::Live => readings
                .into_iter()
                .map(|reading| {
                    let shown = clock.shows(reading.of);
                    Packet {
                        logged: reading.complete,
                        topic: reading.topic,
                        schema: reading.schema,
                        at: shown,
                        bytes: (reading.encode)(shown),
                    }
                })
                .collect(),
        };
        if matches!(faults.output, Output::Live) && !packets.is_empty() {
            mounted.last.clone_from(&packets);
        }
        for mut packet in packets {
            packet.logged += faults.delay;
            self.under_way.insert((packet.logged, self.count), packet);
            self.count += 1;
        }
    }
}

/// The same again, with a new stamp.
fn again(last: &Packet, shown: Stamp, at: Stamp) -> Packet {
    let mut packet = Packet {
        logged: at,
        at: shown,
        ..last.clone()
    };
    restamp(&mut packet.bytes, shown);
    packet
}

/// The sensors that are to be aboard, and the truth of the vehicles that carry them.
fn mount(setup: &Setup) -> Result<Vec<Mounted>, RigError> {
    let mut known = Vec::new();
    let mut all = Vec::new();
    for platform in Platform::ALL {
        let sensors = [
            body::of(platform, setup),
            camera::of(platform, setup)?,
            scan::of(platform, setup),
        ];
        let sensors: Vec<_> = sensors.into_iter().flatten().collect();
        known.extend(sensors.iter().map(|sensor| sensor.name().to_owned()));
        let is_wanted = |sensor: &dyn Sensor| {
            let is_it = |name: &String| name == platform.name() || name == sensor.name();
            setup.aboard.iter().any(is_it)
        };
        let mut aboard: Vec<_> = sensors
            .into_iter()
            .filter(|s| is_wanted(s.as_ref()))
            .collect();
        if !aboard.is_empty() {
            aboard.extend(truth::of(platform));
        }
        all.extend(aboard.into_iter().map(|sensor| Mounted {
            sensor,
            platform,
            index: 0,
            last: Vec::new(),
        }));
    }
    let is_known = |name: &&String| {
        known.contains(name)
            || Platform::ALL
                .iter()
                .any(|platform| platform.name() == *name)
    };
    match setup.aboard.iter().find(|name| !is_known(name)) {
        None => Ok(all),
        Some(found) => Err(RigError::UnknownSensor {
            found: found.clone(),
            known: known.join(", "),
        }),
    }
}

#[cfg(test)]
mod tests;
