//! One object under way.

use std::sync::Arc;
use std::time::Duration;

use maps::time::Stamp;

use super::Waiting;
use crate::dialect::Message;
use crate::dialect::tandem::{TANDEM_OBJECT_DATA, TANDEM_SYMBOL_DATA};
use crate::object::estimate::LinkEstimate;
use crate::object::fountain::{Fountain, source_symbols};
use crate::object::{Object, SYMBOL_BYTES, SYMBOL_FRAME_BYTES, Service, TransferState};
use crate::wire::Address;

/// Bytes of the frame of an announcement.
const OBJECT_FRAME_BYTES: usize = 12 + 37;
/// Symbols from one announcement to the next, as long as none is answered: it may have been lost.
const SYMBOLS_PER_ANNOUNCEMENT: u32 = 32;
/// Silence after the last symbol before the receiver is asked by another announcement.
const FIRST_POLL: Duration = Duration::from_millis(400);
/// The longest silence between such questions.
const MAX_POLL: Duration = Duration::from_secs(1);
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

/// What decides how many symbols a round has.
#[derive(Clone, Copy)]
pub(super) struct Conditions<'a> {
    pub(super) link: &'a LinkEstimate,
    /// Whether the link has been full for a while.
    pub(super) is_busy: bool,
}

/// A message that is sent, and the bytes of its frame.
pub(super) struct Outgoing {
    pub(super) message: Message,
    pub(super) wire_bytes: usize,
    /// The symbol that it carries.
    pub(super) symbol: Option<u16>,
}

/// By how many standard deviations more symbols are sent to meet a deadline than arrive on average, where no, one or more
/// further rounds are possible in time.
const MARGINS: [f64; 3] = [3.0, 1.5, 0.5];
/// The same for other objects, on a link that has room.
const SPARE_MARGIN: f64 = 1.0;

/// An object under way.
pub(super) struct Transfer {
    to: Address,
    number: u32,
    object: Arc<Object>,
    offered: Stamp,
    hash: u32,
    symbol_bytes: usize,
    source_symbols: u32,
    fountain: Fountain,
    next_symbol: u16,
    /// Symbols still to be sent in this round.
    to_send: u32,
    last_symbol: Stamp,
    announced: Stamp,
    /// Whether the receiver has answered the announcement.
    acknowledged: bool,
    announce_now: bool,
    /// Until the receiver has answered the announcement, it is repeated after so many symbols.
    announce_every: u32,
    symbols_since_announcement: u32,
    poll_due: Stamp,
    poll_interval: Duration,
    damaged: u32,
}

impl Transfer {
    /// The number `number` to `to`, in symbols of so many bytes.
    pub(super) fn new(
        now: Stamp,
        (to, number): (Address, u32),
        Waiting { object, offered }: Waiting,
        symbol_bytes: usize,
        conditions: Conditions<'_>,
    ) -> Self {
        let size = object.bytes.len();
        // A large object may have too many small symbols.
        let symbol_bytes = if source_symbols(size, symbol_bytes).is_some() {
            symbol_bytes
        } else {
            SYMBOL_BYTES
        };
        let mut transfer = Self {
            to,
            number,
            hash: crc32c::crc32c(&object.bytes),
            symbol_bytes,
            source_symbols: size.div_ceil(symbol_bytes) as u32,
            object,
            offered,
            fountain: Fountain::new(symbol_bytes),
            next_symbol: 0,
            to_send: 0,
            last_symbol: Stamp::ZERO,
            announced: Stamp::ZERO,
            acknowledged: false,
            announce_now: true,
            announce_every: SYMBOLS_PER_ANNOUNCEMENT,
            symbols_since_announcement: 0,
            poll_due: Stamp::ZERO,
            poll_interval: FIRST_POLL,
            damaged: 0,
        };
        transfer.to_send = transfer.round(now, transfer.source_symbols, conditions);
        if matches!(transfer.object.service, Service::Latest { .. }) {
            // There is no time to find out that the announcement was lost.
            let apart = transfer.to_send / conditions.link.copies();
            transfer.announce_every = apart.clamp(1, SYMBOLS_PER_ANNOUNCEMENT);
        }
        transfer
    }

    /// How many symbols to send when so many are missing.
    ///
    /// What has no deadline shares a busy link: each symbol that arrives helps some object, as long as none gets more than
    /// it lacks. So nothing is sent in advance, and it takes rounds. Where nothing else waits, symbols in advance cost
    /// nothing and save rounds. What has a deadline is given as many as the rounds left in time ask for.
    fn round(&self, now: Stamp, missing: u32, Conditions { link, is_busy }: Conditions<'_>) -> u32 {
        match self.object.service {
            Service::Reliable if is_busy => missing,
            Service::Reliable | Service::BestEffort => link.to_deliver(missing, SPARE_MARGIN),
            Service::Latest { deadline } => {
                let left = deadline.saturating_sub(now.since(self.offered));
                let further = (link.further_rounds(left) as usize).min(MARGINS.len() - 1);
                link.to_deliver(missing, MARGINS[further])
            }
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
    pub(super) fn restart(&mut self, now: Stamp, conditions: Conditions<'_>) {
        self.next_symbol = 0;
        self.to_send = self.round(now, self.source_symbols, conditions);
        self.acknowledged = false;
        self.announce_now = true;
        self.poll_interval = FIRST_POLL;
    }

    fn announcement_is_due(&self, now: Stamp) -> bool {
        let unheard = !self.acknowledged && self.symbols_since_announcement >= self.announce_every;
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

    /// The next message.
    pub(super) fn next_message(&mut self, now: Stamp, link: &LinkEstimate) -> Outgoing {
        if self.announcement_is_due(now) {
            self.announce(now)
        } else {
            let poll = self.poll_interval.max(link.patience() * 2);
            self.symbol(now, poll)
        }
    }

    /// Asks the receiver what it has, unless symbols are to be sent that make it tell.
    pub(super) fn ask(&mut self) {
        self.poll_interval = FIRST_POLL;
        self.announce_now |= self.to_send == 0;
    }

    /// The announcement.
    pub(super) fn announce(&mut self, now: Stamp) -> Outgoing {
        if self.to_send == 0 {
            self.poll_due = now + self.poll_interval;
            self.poll_interval = (self.poll_interval * 2).min(MAX_POLL);
        }
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
            symbol_size: self.symbol_bytes as u8,
        });
        Outgoing {
            message,
            wire_bytes: OBJECT_FRAME_BYTES,
            symbol: None,
        }
    }

    fn symbol(&mut self, now: Stamp, poll: Duration) -> Outgoing {
        let symbol = self.next_symbol;
        self.next_symbol = symbol.wrapping_add(1);
        self.to_send -= 1;
        self.symbols_since_announcement += 1;
        self.last_symbol = now;
        self.poll_due = now + poll;
        let data = self.fountain.symbol(&self.object.bytes, symbol);
        // MAVLink 2 leaves zeros at the end out: most objects do not fill their last source symbol.
        let length = data
            .iter()
            .rposition(|byte| *byte != 0)
            .map_or(0, |last| last + 1);
        let message = Message::TANDEM_SYMBOL(TANDEM_SYMBOL_DATA {
            transfer: self.number as u16,
            symbol,
            target_system: self.to.system.0,
            target_component: self.to.component.0,
            data,
        });
        Outgoing {
            message,
            wire_bytes: SYMBOL_FRAME_BYTES + length,
            symbol: Some(symbol),
        }
    }

    /// The receiver says in which state it is, and how many symbols it lacks.
    pub(super) fn reported(
        &mut self,
        now: Stamp,
        (state, missing): (TransferState, u16),
        conditions: Conditions<'_>,
    ) -> Verdict {
        let link = conditions.link;
        self.acknowledged |= state != TransferState::Unknown;
        self.poll_interval = FIRST_POLL;
        // Only then does the report count everything that was sent.
        let all_arrived = self.to_send == 0
            && (link.has_passed(self.last_symbol)
                || now.since(self.last_symbol) >= link.patience());
        if !all_arrived {
            self.poll_due = self.poll_due.max(now + link.patience());
        }
        match state {
            TransferState::Complete => return Verdict::Delivered,
            TransferState::Refused => return Verdict::Refused,
            TransferState::Wanted if all_arrived => {
                self.to_send = self.round(now, u32::from(missing).max(1), conditions);
            }
            TransferState::Unknown if all_arrived => self.restart(now, conditions),
            TransferState::Unknown if now.since(self.announced) >= link.patience() => {
                self.announce_now = true;
            }
            TransferState::Damaged => {
                self.damaged += 1;
                if self.damaged > MAX_DAMAGED {
                    return Verdict::Refused;
                }
                self.restart(now, conditions);
            }
            TransferState::Wanted | TransferState::Unknown => {}
        }
        Verdict::Continue
    }
}
