//! The vehicles of one run and their conversations, as one pure step from event to frames.

use std::time::Duration;

use maps::frame::{Body, Isometry, Point, World};
use maps::time::Stamp;
use mavlink_ext::{Address, Encoder, Message, RawFrame};
use nalgebra::Vector3;

use crate::autopilot::{Autopilot, Setup, Vehicle};
use crate::vehicle::copter::{Copter, Wind};
use crate::vehicle::gnss::Quality;
use crate::vehicle::rover::{Chassis, Rover};
use crate::wgs84::Origin;

/// How often emulated links are looked after.
pub const AIR: Duration = Duration::from_millis(2);
/// The step of the simulation.
pub const STEP: Duration = Duration::from_millis(20);
/// The copter's address.
pub const COPTER: Address = Address::new(1, 1);
/// The rover's address.
pub const ROVER: Address = Address::new(2, 1);

/// Where a vehicle stands at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// East, in metres.
    pub x_m: f64,
    /// North, in metres.
    pub y_m: f64,
    /// Clockwise from north, in degrees.
    pub heading_deg: f64,
}

/// `X,Y,HEADING_DEG` that is no place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is no start, expected X,Y,HEADING_DEG, such as 0.5,-1,90")]
pub struct StartError {
    text: String,
}

impl Start {
    /// Where a vehicle is.
    pub fn of(pose: Isometry<World, Body>) -> Self {
        let [x_m, y_m, _] = pose.translation().raw.coords.into();
        let forward = pose.rotation() * Vector3::x();
        Self {
            x_m,
            y_m,
            heading_deg: forward.x.atan2(forward.y).to_degrees(),
        }
    }

    fn yaw_rad(self) -> f64 {
        (90.0 - self.heading_deg).to_radians()
    }
}

impl std::str::FromStr for Start {
    type Err = StartError;

    fn from_str(text: &str) -> Result<Self, StartError> {
        let numbers: Vec<f64> = text
            .split(',')
            .map_while(|part| part.trim().parse().ok())
            .collect();
        match *numbers.as_slice() {
            [x_m, y_m, heading_deg] if numbers.iter().all(|n| n.abs() < 1e5) => Ok(Self {
                x_m,
                y_m,
                heading_deg,
            }),
            _ => Err(StartError {
                text: text.to_owned(),
            }),
        }
    }
}

/// Everything that can happen.
#[derive(Clone, Debug)]
pub enum Event {
    /// [`STEP`] has passed.
    Tick,
    /// A frame has come in for that vehicle.
    Frame {
        /// Which, by its place in [`Simulation::vehicles`].
        vehicle: usize,
        /// When.
        at: Stamp,
        /// What.
        frame: RawFrame,
    },
    /// A little time has passed: something may have arrived over an emulated link.
    Air,
    /// The operator has had enough.
    Stop,
}

struct Station {
    autopilot: Autopilot,
    encoder: Encoder,
}

/// The vehicles, at a moment.
pub struct Simulation {
    now: Stamp,
    stations: Vec<Station>,
}

impl Simulation {
    /// A simulation of these autopilots.
    pub fn new(autopilots: impl IntoIterator<Item = Autopilot>) -> Self {
        let stations = autopilots.into_iter().map(|autopilot| Station {
            encoder: Encoder::new(autopilot.address()),
            autopilot,
        });
        Self {
            now: Stamp::ZERO,
            stations: stations.collect(),
        }
    }

    /// What happens then; returns frames to send, each with the vehicle that sends it.
    pub fn step(&mut self, event: &Event) -> Vec<(usize, RawFrame)> {
        match event {
            Event::Tick => {
                self.now += STEP;
                let now = self.now;
                self.tell(|autopilot, _| autopilot.step(now, STEP.as_secs_f64()))
            }
            Event::Frame { vehicle, at, frame } => {
                let Ok(message) = frame.decode() else {
                    return Vec::new(); // Not in the dialect, or a value that it does not know: not for an autopilot.
                };
                let only = *vehicle;
                self.tell(|autopilot, index| {
                    if index == only {
                        autopilot.handle(*at, frame.from(), &message)
                    } else {
                        Vec::new()
                    }
                })
            }
            Event::Air | Event::Stop => Vec::new(),
        }
    }

    fn tell(
        &mut self,
        mut what: impl FnMut(&mut Autopilot, usize) -> Vec<Message>,
    ) -> Vec<(usize, RawFrame)> {
        let mut frames = Vec::new();
        for (index, station) in self.stations.iter_mut().enumerate() {
            for message in what(&mut station.autopilot, index) {
                frames.push((index, station.encoder.encode(&message)));
            }
        }
        frames
    }

    /// Simulated time.
    pub fn now(&self) -> Stamp {
        self.now
    }

    /// The vehicles.
    pub fn vehicles(&self) -> impl Iterator<Item = &Autopilot> {
        self.stations.iter().map(|station| &station.autopilot)
    }
}

/// A copter on the ground; if it is not told where, in the room a little behind the start of the camera's flight.
pub fn copter(origin: &Origin, start: Option<Start>, seed: u64) -> Autopilot {
    let wind = Wind {
        mean: maps::frame::Vector::from_raw(Vector3::zeros()),
        gust_mps: 0.0,
    };
    let start = start.unwrap_or(Start {
        x_m: -0.6,
        y_m: 0.0,
        heading_deg: 90.0,
    });
    let place = Point::new(start.x_m, start.y_m, 0.0);
    let yaw_rad = start.yaw_rad();
    Autopilot::new(Setup {
        address: COPTER,
        vehicle: Vehicle::Copter(Box::new(Copter::new(
            place,
            yaw_rad,
            wind,
            seed ^ 0xc0_97e4,
        ))),
        origin: origin.clone(),
        gnss: Quality::RTK_FIXED,
        seed: seed ^ 0x91,
    })
}

/// The small car, where it is to start.
pub fn rover(origin: &Origin, start: Start, seed: u64) -> Autopilot {
    let place = Point::new(start.x_m, start.y_m, 0.0);
    let car = Rover::new(place, start.yaw_rad(), Chassis::default());
    Autopilot::new(Setup {
        address: ROVER,
        vehicle: Vehicle::Rover(car),
        origin: origin.clone(),
        gnss: Quality::RTK_FIXED,
        seed: seed ^ 0x92,
    })
}

#[cfg(test)]
mod tests {
    use mavlink_ext::dialect::tandem::HEARTBEAT_DATA;

    use super::*;

    #[test]
    fn the_same_seed_and_events_give_the_same_frames() {
        let origin: Origin = "50.7268,7.0865,60".parse().expect("a place");
        let run = |seed| {
            let start = Start {
                x_m: 0.0,
                y_m: 0.0,
                heading_deg: 0.0,
            };
            let mut simulation =
                Simulation::new([copter(&origin, None, seed), rover(&origin, start, seed)]);
            let heartbeat = Encoder::new(Address::new(255, 190))
                .encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()));
            let mut frames = Vec::new();
            for vehicle in 0..2 {
                frames.extend(simulation.step(&Event::Frame {
                    vehicle,
                    at: Stamp::ZERO,
                    frame: heartbeat.clone(),
                }));
            }
            (0..250).for_each(|_| frames.extend(simulation.step(&Event::Tick)));
            frames
        };
        assert!(run(1).len() > 300, "telemetry flows");
        assert!(run(1) == run(1));
        assert!(run(1) != run(2));
    }

    #[test]
    fn text_that_is_no_start_is_refused() {
        for text in ["", "1,2", "1,2,x", "NaN,0,0", "1,2,3,4"] {
            assert!(text.parse::<Start>().is_err(), "{text}");
        }
    }
}
