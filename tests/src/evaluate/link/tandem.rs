//! Our object transport.

use maps::time::Stamp;
use mavlink_ext::dialect::Message;
use mavlink_ext::object::{Object, ObjectId, Receiver, ReceiverLimits, Sender, SenderSettings};
use mavlink_ext::service::Ends;

use super::Case;
use super::team::{GROUND, Transport, UAV};

pub(super) struct Tandem {
    sender: Sender,
    receiver: Receiver,
}

impl Tandem {
    pub(super) fn new(case: &Case) -> Self {
        let ends = Ends {
            own: UAV,
            peer: GROUND,
        };
        let settings = SenderSettings {
            bytes_per_second: case.rate() as u32,
            ..SenderSettings::default()
        };
        Self {
            sender: Sender::new(Stamp::ZERO, ends, 7, settings),
            receiver: Receiver::new(GROUND, 1, ReceiverLimits::default()),
        }
    }
}

impl Transport for Tandem {
    fn offer(&mut self, now: Stamp, object: Object) {
        let _full = self.sender.offer(now, object);
    }

    fn waiting_bytes(&self, now: Stamp) -> usize {
        self.sender.stats(now).bytes_pending
    }

    fn repeats_commands(&self) -> bool {
        true
    }

    fn link_has_sent(&mut self, bytes: u64) {
        self.sender.link_has_sent(bytes);
    }

    fn tick_uav(&mut self, now: Stamp) -> Vec<Message> {
        self.sender.tick(now).send
    }

    fn at_uav(&mut self, now: Stamp, message: &Message) -> Vec<Message> {
        self.sender.handle(now, GROUND, message).send
    }

    fn tick_ground(&mut self, now: Stamp) -> Vec<Message> {
        self.receiver.tick(now).send
    }

    fn at_ground(&mut self, now: Stamp, message: &Message) -> (Vec<Message>, Vec<ObjectId>) {
        let step = self.receiver.handle(now, UAV, message);
        let delivered = step.events.into_iter().map(|received| received.id);
        (step.send, delivered.collect())
    }
}
