//! What stands at each end of an emulated link, in tests and in `evaluate`.

use maps::time::Stamp;
use mavlink_ext::repeat::{Duplicates, Reception, Repeater};
use mavlink_ext::{Address, Encoder, Message, RawFrame};
use sitl::link::Channel;

/// One end of an emulated link: frames out and in, copies of commands made and dropped as Tandem's programs do.
pub struct End {
    encoder: Encoder,
    /// The way out.
    pub channel: Channel<RawFrame>,
    repeats: bool,
    repeater: Repeater,
    duplicates: Duplicates,
    reception: Reception,
}

impl End {
    /// Sends by this channel; `repeats` commands on a link that loses.
    pub fn new(address: Address, channel: Channel<RawFrame>, repeats: bool) -> Self {
        Self {
            encoder: Encoder::new(address),
            channel,
            repeats,
            repeater: Repeater::new(),
            duplicates: Duplicates::new(),
            reception: Reception::new(),
        }
    }

    /// Sends messages.
    pub fn send(&mut self, now: Stamp, messages: impl IntoIterator<Item = Message>) {
        for message in messages {
            let frame = self.encoder.encode(&message);
            if self.repeats {
                self.repeater.sent(now, &frame);
            }
            self.put(now, frame);
        }
    }

    /// Sends the copies whose time has come.
    pub fn repeat(&mut self, now: Stamp) {
        for frame in self.repeater.tick(now) {
            self.put(now, frame);
        }
    }

    fn put(&mut self, now: Stamp, frame: RawFrame) {
        let bytes = frame.bytes().len();
        self.channel.send(now, frame, bytes);
    }

    /// The message in a frame that came; `None` if it is a copy.
    pub fn heard(&mut self, now: Stamp, frame: &RawFrame) -> Option<Message> {
        let is_copy = !self.duplicates.is_new(now, frame);
        self.repeater.heard(now, frame, is_copy);
        if is_copy {
            return None;
        }
        self.reception.heard(frame);
        self.repeater
            .set_loss(self.reception.loss().unwrap_or_default());
        frame.decode().ok()
    }
}
