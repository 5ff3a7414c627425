//! A bridge to a real `ArduPilot`: its software in the loop sends what its motors are to do, and gets what its sensors feel here.
//!
//! ```text
//! ArduPilot → bridge   18458 or 29569, frame rate, frame count, 16 or 32 pulse widths          (binary, little-endian)
//! bridge → ArduPilot   {"timestamp":..,"imu":{"gyro":..,"accel_body":..},"position":..,..}     (one line of JSON)
//! ```
//!
//! The two go in lockstep: `ArduPilot` waits for each answer, so that its time is the simulation's, and the bridge needs no clock. A
//! frame that comes twice is answered twice and simulated once; frames that count from the beginning again are an `ArduPilot` that
//! has restarted, and so does the world. [`Bridge::handle`] is all of that, without sockets; [`serve()`] is the socket.
//!
//! - [`packet`]: what comes in. [`plant`]: what moves. [`mod@line`]: what goes out.
//!
//! Source: `ArduPilot`, `libraries/SITL/examples/JSON/readme.md` (the interface).

pub mod cli;
pub mod line;
pub mod packet;
pub mod plant;
pub mod serve;
#[cfg(test)]
mod tests;

use std::time::Duration;

use serde::Serialize;

use crate::rays::Rays;
use crate::scene::Scene;
use crate::simulation::Start;
use packet::{Packet, PacketError};
use plant::{Plant, VehicleKind};

pub use serve::serve;

/// What is bridged.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a> {
    /// The vehicle that `ArduPilot` flies or drives.
    pub vehicle: VehicleKind,
    /// What its rangefinder meets, and what a copter lands on.
    pub scene: &'a Scene,
    /// Where it starts.
    pub start: Start,
}

/// How often what happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counters {
    /// Frames that were simulated.
    pub frames: u64,
    /// Frames that came again and were answered again.
    pub duplicates: u64,
    /// Frames that never came.
    pub missed: u64,
    /// How often `ArduPilot` began anew.
    pub restarts: u64,
    /// Packets that were none of `ArduPilot`'s, or from somebody else, and were not answered.
    pub refused: u64,
}

/// What a packet was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The next frame, or the first.
    Simulated,
    /// The same frame again.
    Repeated,
    /// The first frame of an `ArduPilot` that has restarted.
    Restarted,
}

/// The world at the other end of one `ArduPilot`.
pub struct Bridge<'a> {
    setup: Setup<'a>,
    rays: Rays<'a>,
    plant: Plant<'a>,
    /// The last frame and what was answered to it.
    last: Option<(u32, Vec<u8>)>,
    clock: Clock,
    counters: Counters,
}

/// Simulated time, without the sum of many roundings.
#[derive(Clone, Copy, Debug, Default)]
struct Clock {
    /// Time at which the present frame rate began.
    since_s: f64,
    rate_hz: u16,
    /// Frames at that rate.
    frames: u64,
}

impl Clock {
    fn now_s(self) -> f64 {
        self.since_s + self.frames as f64 / f64::from(self.rate_hz.max(1))
    }

    /// One frame later.
    fn advance(&mut self, rate_hz: u16) {
        if rate_hz != self.rate_hz {
            *self = Self {
                since_s: self.now_s(),
                rate_hz,
                frames: 0,
            };
        }
        self.frames += 1;
    }
}

/// Older frames than this many are an `ArduPilot` that has restarted, not ones that were late.
const LATE_FRAMES: u32 = 5;

impl<'a> Bridge<'a> {
    /// A vehicle that stands at its start and waits for the first frame.
    pub fn new(setup: Setup<'a>) -> Self {
        let rays = Rays::new(setup.scene);
        Self {
            plant: Plant::new(&setup, rays.clone()),
            rays,
            setup,
            last: None,
            clock: Clock::default(),
            counters: Counters::default(),
        }
    }

    /// Takes a packet in and returns the answer; a packet that is refused changes nothing but a counter.
    pub fn handle(&mut self, bytes: &[u8]) -> Result<(Step, &[u8]), PacketError> {
        let step = self
            .take(bytes)
            .inspect_err(|_| self.counters.refused += 1)?;
        let answer = self
            .last
            .as_ref()
            .map_or(&[] as &[u8], |(_, answer)| answer);
        Ok((step, answer))
    }

    fn take(&mut self, bytes: &[u8]) -> Result<Step, PacketError> {
        let packet = Packet::parse(bytes)?;
        let count = packet.frame_count;
        let step = match self.last.as_ref().map(|(last, _)| *last) {
            Some(last) if count == last => {
                self.counters.duplicates += 1;
                return Ok(Step::Repeated);
            }
            Some(last) if count < last && count > 0 && last - count <= LATE_FRAMES => {
                return Err(PacketError::Late { count, last });
            }
            Some(last) if count < last => {
                self.counters.restarts += 1;
                self.plant = Plant::new(&self.setup, self.rays.clone());
                self.clock = Clock::default();
                Step::Restarted
            }
            Some(last) => {
                self.counters.missed += u64::from(count - last - 1);
                Step::Simulated
            }
            None => Step::Simulated,
        };
        let dt = 1.0 / f64::from(packet.frame_rate_hz);
        self.clock.advance(packet.frame_rate_hz);
        let now_s = self.clock.now_s();
        self.counters.frames += 1;
        self.plant.step(&packet, now_s, dt);
        self.last = Some((count, line::of(now_s, &self.plant.senses())));
        Ok(step)
    }

    /// Counts a packet that was not handled, because it came from somebody else.
    fn refuse(&mut self) {
        self.counters.refused += 1;
    }

    /// Time that was simulated since `ArduPilot` last began.
    pub fn simulated(&self) -> Duration {
        Duration::from_secs_f64(self.clock.now_s())
    }

    /// How often what happened.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// What moves.
    pub fn plant(&self) -> &Plant<'a> {
        &self.plant
    }
}
