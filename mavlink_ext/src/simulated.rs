//! A bad radio in simulated time, for tests: loses, repeats, delays and reorders messages between two ends.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use crate::dialect::Message;
use crate::wire::{Address, Encoder, RawFrame};

/// How bad the radio is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Radio {
    /// Probability that a message is lost.
    pub(crate) loss: f64,
    /// Probability that it arrives twice.
    pub(crate) repeat: f64,
    /// Least delay.
    pub(crate) delay: Duration,
    /// Added to the delay, evenly from none to this: messages overtake one another.
    pub(crate) jitter: Duration,
}

impl Radio {
    pub(crate) const PERFECT: Self = Self {
        loss: 0.0,
        repeat: 0.0,
        delay: Duration::from_millis(1),
        jitter: Duration::ZERO,
    };

    pub(crate) fn losing(loss: f64) -> Self {
        Self {
            loss,
            repeat: 0.05,
            delay: Duration::from_millis(20),
            jitter: Duration::from_millis(30),
        }
    }
}

/// Messages under way in one direction.
pub(crate) struct Air {
    radio: Radio,
    random: Pcg64,
    encoder: Encoder,
    under_way: BTreeMap<(Stamp, u64), RawFrame>,
    sent: u64,
}

impl Air {
    pub(crate) fn new(from: Address, radio: Radio, seed: u64) -> Self {
        Self {
            radio,
            random: Pcg64::seed_from_u64(seed),
            encoder: Encoder::new(from),
            under_way: BTreeMap::new(),
            sent: 0,
        }
    }

    /// With other losses and delays.
    pub(crate) fn seeded(self, seed: u64) -> Self {
        Self {
            random: Pcg64::seed_from_u64(seed),
            ..self
        }
    }

    pub(crate) fn send(&mut self, now: Stamp, messages: impl IntoIterator<Item = Message>) {
        for message in messages {
            let frame = self.encoder.encode(&message);
            let copies = 1 + usize::from(self.random.random_bool(self.radio.repeat));
            for _ in 0..copies {
                if !self.random.random_bool(self.radio.loss) {
                    let jitter = self.radio.jitter.mul_f64(self.random.random());
                    self.sent += 1;
                    let arrival = now + self.radio.delay + jitter;
                    self.under_way.insert((arrival, self.sent), frame.clone());
                }
            }
        }
    }

    /// What has arrived by now, through the real codec.
    pub(crate) fn arrived(&mut self, now: Stamp) -> Vec<(Address, Message)> {
        let later = self.under_way.split_off(&(now, u64::MAX));
        let arrived = std::mem::replace(&mut self.under_way, later);
        arrived
            .into_values()
            .map(|frame| (frame.from(), frame.decode().expect("we encoded it")))
            .collect()
    }
}
