//! The link emulator in simulated time, for tests: messages go through the real codec, from one end to another.

use std::time::Duration;

use maps::time::Stamp;
use sitl::link::{Channel, Loss, Profile};

use crate::dialect::Message;
use crate::wire::{Address, Encoder, RawFrame};

/// Loses nothing, and takes a millisecond.
pub(crate) fn perfect() -> Profile {
    Profile {
        delay: Duration::from_millis(1),
        ..Profile::IDEAL
    }
}

/// Loses this share, repeats some, and half of the messages overtake others or are overtaken.
pub(crate) fn losing(share: f64) -> Profile {
    Profile {
        loss: Loss::Even(share),
        repeat: 0.05,
        delay: Duration::from_millis(20),
        jitter: Duration::from_millis(30),
        overtake: 0.5,
        ..Profile::IDEAL
    }
}

/// Messages under way in one direction.
pub(crate) struct Air {
    encoder: Encoder,
    channel: Channel<RawFrame>,
}

impl Air {
    pub(crate) fn new(from: Address, profile: &Profile, seed: u64) -> Self {
        Self {
            encoder: Encoder::new(from),
            channel: Channel::new(profile.clone(), seed),
        }
    }

    pub(crate) fn send(&mut self, now: Stamp, messages: impl IntoIterator<Item = Message>) {
        for message in messages {
            let frame = self.encoder.encode(&message);
            let bytes = frame.bytes().len();
            self.channel.send(now, frame, bytes);
        }
    }

    /// What has arrived by now.
    pub(crate) fn arrived(&mut self, now: Stamp) -> Vec<(Address, Message)> {
        (self.channel.arrived(now).into_iter())
            .map(|frame| (frame.from(), frame.decode().expect("we encoded it")))
            .collect()
    }
}
