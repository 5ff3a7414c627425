//! One object under way.

use std::sync::Arc;
use std::time::Duration;

use maps::time::Stamp;

use crate::dialect::Message;
use crate::dialect::tandem::{TANDEM_OBJECT_DATA, TANDEM_SYMBOL_DATA};
use crate::object::estimate::LinkEstimate;
use crate::object::fountain::{Fountain, MAX_SYMBOL_ID};
use crate::object::{Object, SYMBOL_BYTES, Service, TransferState};
use crate::wire::Address;

/// Bytes of the frames that carry the messages; symbols that end in zeros take fewer.
const OBJECT_FRAME_BYTES: usize = 12 + 37;
const SYMBOL_FRAME_BYTES: usize = 12 + 10 + SYMBOL_BYTES;
/// Until the receiver has answered, the announcement is repeated after so many symbols: it may have been lost.
const SYMBOLS_PER_ANNOUNCEMENT: u32 = 32;
/// Silence after the last symbol before the receiver is asked by another announcement.
const FIRST_POLL: Duration = Duration::from_millis(400);
/// The longest silence between such questions.
const MAX_POLL: Duration = Duration::from_secs(4);
/// So often an object may decode to a wrong checksum.
const MAX_DAMAGED: u32 = 3;

/// What a report means for a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Continue,
    Delivered,
    Refused,
}

/// Which goes first: 0 before 1 before 2.
pub(super) fn priority(service: Service) -> u8 {
    match service {
        Service::Latest { .. } => 0,
        Service::Reliable => 1,
        Service::BestEffort => 2,
    }
}

/// How much more than what a mean share of losses asks for is sent, in standard deviations. What has a deadline has little
/// time for another round; for what is reliable, one costs nothing but time.
fn margin(service: Service) -> f64 {
    match service {
        Service::Latest { .. } => 3.0,
        Service::Reliable => 0.0,
        Service::BestEffort => 1.0,
    }
}

/// An object under way.
pub(super) struct Transfer {
    to: Address,
    number: u32,
    object: Arc<Object>,
    offered: Stamp,
    hash: u32,
    source_symbols: u32,
    fountain: Fountain,
    next_symbol: u32,
    /// Symbols still to be sent in this round.
    to_send: u32,
    last_symbol: Stamp,
    announcements: u32,
    announced: Stamp,
    /// Whether the receiver has answered the announcement.
    acknowledged: bool,
    announce_now: bool,
    symbols_since_announcement: u32,
    poll_due: Stamp,
    poll_interval: Duration,
    damaged: u32,
}

impl Transfer {
    pub(super) fn new(
        to: Address,
        number: u32,
        (object, offered): (Arc<Object>, Stamp),
        link: &LinkEstimate,
    ) -> Self {
        let source_symbols = object.bytes.len().div_ceil(SYMBOL_BYTES) as u32;
        let margin = margin(object.service);
        Self {
            to,
            number,
            hash: crc32c::crc32c(&object.bytes),
            object,
            offered,
            source_symbols,
            fountain: Fountain::new(),
            next_symbol: 0,
            to_send: link.to_deliver(source_symbols, margin),
            last_symbol: Stamp::ZERO,
            announcements: 0,
            announced: Stamp::ZERO,
            acknowledged: false,
            announce_now: true,
            symbols_since_announcement: 0,
            poll_due: Stamp::ZERO,
            poll_interval: FIRST_POLL,
            damaged: 0,
        }
    }

    pub(super) fn number(&self) -> u32 {
        self.number
    }

    pub(super) fn object(&self) -> &Arc<Object> {
        &self.object
    }

    pub(super) fn offered(&self) -> Stamp {
        self.offered
    }

    pub(super) fn priority(&self) -> u8 {
        priority(self.object.service)
    }

    /// Whether any symbol was sent.
    pub(super) fn has_begun(&self) -> bool {
        self.next_symbol > 0
    }

    /// Begins anew, for a receiver that knows nothing of it.
    pub(super) fn restart(&mut self, link: &LinkEstimate) {
        self.next_symbol = 0;
        self.to_send = link.to_deliver(self.source_symbols, margin(self.object.service));
        self.acknowledged = false;
        self.announce_now = true;
        self.poll_interval = FIRST_POLL;
    }

    fn announcement_is_due(&self, now: Stamp) -> bool {
        let unheard =
            !self.acknowledged && self.symbols_since_announcement >= SYMBOLS_PER_ANNOUNCEMENT;
        let asking = self.to_send == 0 && now >= self.poll_due;
        self.announce_now || unheard || asking
    }

    pub(super) fn wants_to_send(&self, now: Stamp) -> bool {
        self.to_send > 0 || self.announcement_is_due(now)
    }

    /// Whether nothing more will be sent, whatever the receiver says.
    pub(super) fn is_sent_for_good(&self) -> bool {
        self.object.service == Service::BestEffort && self.to_send == 0
    }

    /// The next message, the bytes of its frame, and how many symbols it carries.
    pub(super) fn next_message(
        &mut self,
        now: Stamp,
        link: &LinkEstimate,
    ) -> (Message, usize, u64) {
        if self.announcement_is_due(now) {
            let (message, bytes) = self.announce(now);
            (message, bytes, 0)
        } else {
            let poll = self.poll_interval.max(link.patience() * 2);
            (self.symbol(now, poll), SYMBOL_FRAME_BYTES, 1)
        }
    }

    /// The announcement, and the bytes of its frame.
    pub(super) fn announce(&mut self, now: Stamp) -> (Message, usize) {
        if self.to_send == 0 {
            self.poll_due = now + self.poll_interval;
            self.poll_interval = (self.poll_interval * 2).min(MAX_POLL);
        }
        self.announcements += 1;
        self.announced = now;
        self.announce_now = false;
        self.symbols_since_announcement = 0;
        let deadline = match self.object.service {
            Service::Latest { deadline } => {
                let left = deadline.saturating_sub(now.since(self.offered));
                u32::try_from(left.as_millis()).unwrap_or(u32::MAX).max(1)
            }
            Service::Reliable | Service::BestEffort => 0,
        };
        let message = Message::TANDEM_OBJECT(TANDEM_OBJECT_DATA {
            key: self.object.id.key,
            version: self.object.id.version,
            transfer: self.number,
            size: self.object.bytes.len() as u32,
            hash: self.hash,
            deadline,
            target_system: self.to.system.0,
            target_component: self.to.component.0,
            stream: self.object.id.stream.0,
            service: self.object.service.to_wire(),
            symbol_size: SYMBOL_BYTES as u8,
        });
        (message, OBJECT_FRAME_BYTES)
    }

    fn symbol(&mut self, now: Stamp, poll: Duration) -> Message {
        let symbol = self.next_symbol;
        self.next_symbol = if symbol == MAX_SYMBOL_ID {
            0
        } else {
            symbol + 1
        };
        self.to_send -= 1;
        self.symbols_since_announcement += 1;
        self.last_symbol = now;
        self.poll_due = now + poll;
        Message::TANDEM_SYMBOL(TANDEM_SYMBOL_DATA {
            transfer: self.number,
            symbol,
            target_system: self.to.system.0,
            target_component: self.to.component.0,
            data: self.fountain.symbol(&self.object.bytes, symbol),
        })
    }

    /// The receiver says in which state it is, and how many symbols it lacks.
    pub(super) fn reported(
        &mut self,
        now: Stamp,
        (state, missing): (TransferState, u16),
        link: &mut LinkEstimate,
    ) -> Verdict {
        let known = state != TransferState::Unknown;
        if known && !self.acknowledged && self.announcements == 1 {
            // Karn's rule: of an announcement that was repeated, nobody knows which one is answered.
            link.round_trip_was(now.since(self.announced));
        }
        self.acknowledged |= known;
        self.poll_interval = FIRST_POLL;
        // Only then does the report count everything that was sent.
        let all_arrived = self.to_send == 0 && now.since(self.last_symbol) >= link.patience();
        if !all_arrived {
            self.poll_due = self.poll_due.max(now + link.patience());
        }
        match state {
            TransferState::Complete => return Verdict::Delivered,
            TransferState::Refused => return Verdict::Refused,
            TransferState::Wanted if all_arrived => {
                let margin = margin(self.object.service).max(1.0);
                self.to_send = link.to_deliver(u32::from(missing).max(1), margin);
            }
            TransferState::Unknown if all_arrived => self.restart(link),
            TransferState::Unknown if now.since(self.announced) >= link.patience() => {
                self.announce_now = true;
            }
            TransferState::Damaged => {
                self.damaged += 1;
                if self.damaged > MAX_DAMAGED {
                    return Verdict::Refused;
                }
                self.restart(link);
            }
            TransferState::Wanted | TransferState::Unknown => {}
        }
        Verdict::Continue
    }
}
