//! The sending end: a queue, a few transfers under way, and a pacer.

mod queue;
mod transfer;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use maps::time::Stamp;

use super::estimate::LinkEstimate;
use super::pace::Pacer;
use super::{MAX_OBJECT_BYTES, Object, ObjectId, Service, StreamId, TransferState};
use crate::dialect::Message;
use crate::dialect::tandem::TANDEM_REPORT_DATA;
use crate::service::{Ends, Step};
use crate::wire::Address;
use queue::{Queue, Waiting, replaces};
use transfer::{Conditions, Outgoing, Transfer, Verdict};

/// A receiver that has not reported for so long is gone: only announcements are sent, to find it again.
const PEER_LOST_AFTER: Duration = Duration::from_millis(3500);
/// Time between announcements to nobody.
const PROBE_INTERVAL: Duration = Duration::from_secs(1);
/// Reliable objects under way at once at most: half of what a receiver keeps track of by default.
const MAX_RELIABLE: usize = 2048;
/// Bytes of reliable objects under way at once, in any case.
const LEAST_WINDOW: usize = 32 << 10;
/// Further ones may fill the link for so many times as long as reports take to come: most are complete after so many rounds.
const WINDOWS: f64 = 4.0;
/// From the end of a round to the report of it, while the way back is slow.
const ROUND_LATENCY: Duration = Duration::from_millis(150);
/// What a lost report costs: the receiver tells again after a while, and that report may be lost, too.
const LOST_REPORT: Duration = Duration::from_millis(300);
/// Bytes of them at most: three quarters of what a receiver holds by default.
const MOST_WINDOW: usize = 12 << 20;
/// A link on which there was always something to send for so long is busy.
const BUSY_AFTER: Duration = Duration::from_millis(100);
/// The address that telemetry radios report from, "3D" in ASCII
/// (<https://mavlink.io/en/messages/common.html#RADIO_STATUS>).
const RADIO: Address = Address::new(51, 68);
/// Objects with a deadline under way at once.
const MAX_LATEST: usize = 16;

/// How much may be sent and kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SenderSettings {
    /// Budget of the link, in bytes of MAVLink frames per second: objects get what everything else leaves of it, see
    /// [`Sender::link_has_sent`]. Less is sent where the link carries less.
    pub bytes_per_second: u32,
    /// Objects that wait may fill so much memory.
    pub max_queued_bytes: usize,
}

/// 1 MB/s and 64 MiB waiting.
impl Default for SenderSettings {
    fn default() -> Self {
        Self {
            bytes_per_second: 1_000_000,
            max_queued_bytes: 64 << 20,
        }
    }
}

/// Why an object was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OfferError {
    /// Empty, or larger than the transport takes.
    #[error("object {id} has {bytes} bytes, allowed are 1 to {max}", max = MAX_OBJECT_BYTES)]
    Size {
        /// Which.
        id: ObjectId,
        /// Its size.
        bytes: usize,
    },
    /// The same or a newer version was offered before.
    #[error("object {id} is not newer than version {newest}, which was offered before")]
    Outdated {
        /// Which.
        id: ObjectId,
        /// What is there.
        newest: u64,
    },
    /// Too much waits already.
    #[error("no room for object {id} of {bytes} bytes behind {queued} waiting bytes")]
    Full {
        /// Which.
        id: ObjectId,
        /// Its size.
        bytes: usize,
        /// What waits.
        queued: usize,
    },
}

/// What became of objects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SenderEvent {
    /// The receiver has it, and its checksum is right.
    Delivered {
        /// Which.
        id: ObjectId,
        /// Since it was offered.
        after: Duration,
    },
    /// The receiver does not want it.
    Refused(ObjectId),
    /// Its deadline passed, or a newer object of its stream came.
    Expired(ObjectId),
    /// The receiver has started anew: it may have lost the reliable objects that it had. They can be offered again.
    ReceiverRestarted {
        /// What it had.
        delivered: Vec<ObjectId>,
    },
}

/// Counts since the start, and what is there now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SenderStats {
    /// Objects reported complete.
    pub objects_delivered: u64,
    /// Their bytes.
    pub bytes_delivered: u64,
    /// Objects of which a newer version was offered before they were sent.
    pub objects_replaced: u64,
    /// Symbols sent.
    pub symbols_sent: u64,
    /// Bytes of MAVLink frames sent, announcements too.
    pub wire_bytes: u64,
    /// Keys of reliable objects whose newest version the receiver has.
    pub keys_delivered: usize,
    /// Objects that wait or are under way.
    pub objects_pending: usize,
    /// Their bytes.
    pub bytes_pending: usize,
    /// Share of symbols lost lately; `None` before it is known.
    pub loss: Option<f64>,
    /// What may be sent at present, in bytes per second: the budget, or what the link is found to carry.
    pub pace: f64,
    /// How long symbols wait in the buffers of the link, beyond its shortest way.
    pub wait: Duration,
    /// Whether the receiver reports.
    pub receiver_alive: bool,
}

type Key = (StreamId, u64);

/// Sends objects to one receiver.
pub struct Sender {
    ends: Ends,
    settings: SenderSettings,
    session: u16,
    transfers_begun: u16,
    waiting: Queue,
    active: Vec<Transfer>,
    /// The newest version offered of each reliable key.
    newest: BTreeMap<Key, u64>,
    /// The newest version of each that the receiver has.
    delivered: BTreeMap<Key, u64>,
    receiver_session: Option<u32>,
    last_report: Option<Stamp>,
    probe_due: Stamp,
    link: LinkEstimate,
    pacer: Pacer,
    /// When there was nothing to send.
    last_idle: Stamp,
    /// Bytes of reliable objects that the receiver can hold.
    room: usize,
    /// Bytes that went over the link beside ours.
    others: u64,
    counts: SenderStats,
}

impl Sender {
    /// A sender that starts now. `session` should differ from that of the sender's last start, so that the receiver sees
    /// the restart.
    pub fn new(now: Stamp, ends: Ends, session: u16, settings: SenderSettings) -> Self {
        Self {
            ends,
            settings,
            session,
            transfers_begun: 0,
            waiting: Queue::default(),
            active: Vec::new(),
            newest: BTreeMap::new(),
            delivered: BTreeMap::new(),
            receiver_session: None,
            last_report: None,
            probe_due: now,
            link: LinkEstimate::new(),
            pacer: Pacer::new(now, settings.bytes_per_second),
            last_idle: now,
            room: MOST_WINDOW,
            others: 0,
            counts: SenderStats::default(),
        }
    }

    /// Takes an object to send.
    pub fn offer(&mut self, now: Stamp, object: Object) -> Result<(), OfferError> {
        let id = object.id;
        let bytes = object.bytes.len();
        if !(1..=MAX_OBJECT_BYTES).contains(&bytes) {
            return Err(OfferError::Size { id, bytes });
        }
        let key = (id.stream, id.key);
        let is_reliable = object.service == Service::Reliable;
        if is_reliable
            && let Some(&newest) = self.newest.get(&key)
            && newest >= id.version
        {
            return Err(OfferError::Outdated { id, newest });
        }
        let waiting = Waiting {
            object: Arc::new(object),
            offered: now,
        };
        let object = Arc::clone(&waiting.object);
        let max_bytes = self.settings.max_queued_bytes;
        let has_replaced = self.waiting.push(waiting, max_bytes)?;
        if is_reliable {
            self.newest.insert(key, id.version);
        }
        let under_way = self.active.len();
        self.active
            .retain(|transfer| transfer.has_begun() || !replaces(&object, transfer.object()));
        let unsent = under_way - self.active.len();
        self.counts.objects_replaced += unsent as u64 + u64::from(has_replaced);
        Ok(())
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<SenderEvent> {
        match message {
            Message::TANDEM_REPORT(report) if self.ends.accept(from, message) => {
                self.reported(now, report)
            }
            Message::RADIO_STATUS(status) if from == RADIO => {
                self.pacer.radio_has_room(now, status.txbuf);
                Step::none()
            }
            _ => Step::none(),
        }
    }

    fn reported(&mut self, now: Stamp, report: &TANDEM_REPORT_DATA) -> Step<SenderEvent> {
        let mut step = Step::none();
        let restarted = self
            .receiver_session
            .is_some_and(|session| session != report.session);
        self.receiver_session = Some(report.session);
        let was_lost = !self.receiver_is_alive(now);
        self.last_report = Some(now);
        if restarted {
            step.extend(self.receiver_restarted(now));
        } else if was_lost {
            self.active.iter_mut().for_each(Transfer::ask);
        }
        if let Some(echo) = self.link.reported(now, report) {
            let link = (self.link.round_trip(), self.link.burstiness());
            self.pacer.echoed(now, echo, link);
        }
        self.room = report.room as usize + self.under_way();
        let is_busy = self.is_busy(now);
        let entries = report.transfers.iter().zip(report.missing);
        let count = usize::from(report.count);
        for ((&number, missing), state) in entries.zip(report.states).take(count) {
            let place = self.active.iter().position(|t| t.number() == number);
            let (Some(place), Some(state)) = (place, TransferState::from_wire(state)) else {
                continue;
            };
            let conditions = Conditions {
                link: &self.link,
                is_busy,
            };
            match self.active[place].reported(now, (state, missing), conditions) {
                Verdict::Continue => {}
                Verdict::Delivered => step.events.push(self.delivered(now, place)),
                Verdict::Refused => {
                    let transfer = self.active.remove(place);
                    step.events.push(SenderEvent::Refused(transfer.object().id));
                }
            }
        }
        step
    }

    fn delivered(&mut self, now: Stamp, place: usize) -> SenderEvent {
        let transfer = self.active.remove(place);
        let object = Arc::clone(transfer.object());
        self.counts.objects_delivered += 1;
        self.counts.bytes_delivered += object.bytes.len() as u64;
        let id = object.id;
        if object.service == Service::Reliable {
            self.delivered.insert((id.stream, id.key), id.version);
        }
        SenderEvent::Delivered {
            id,
            after: now.since(transfer.offered()),
        }
    }

    /// The receiver says that it lacks this: if the sender takes it for delivered, it is taken again when it is offered.
    pub fn is_lacking(&mut self, stream: StreamId, key: u64) {
        let key = (stream, key);
        if self.delivered.get(&key) == self.newest.get(&key) {
            self.newest.remove(&key);
        }
        self.delivered.remove(&key);
    }

    /// The receiver says that it has this already: it need not be offered.
    pub fn is_there(&mut self, id: ObjectId) {
        let key = (id.stream, id.key);
        if self
            .newest
            .get(&key)
            .is_none_or(|newest| *newest < id.version)
        {
            self.newest.insert(key, id.version);
        }
        // If the same is on its way, the receiver will say so.
        let is_pending = self.pending().any(|other| other == id);
        if !is_pending {
            self.delivered.insert(key, id.version);
        }
    }

    fn pending(&self) -> impl Iterator<Item = ObjectId> {
        let waiting = self.waiting.iter().map(|w| w.object.id);
        waiting.chain(self.active.iter().map(|t| t.object().id))
    }

    fn receiver_restarted(&mut self, now: Stamp) -> Step<SenderEvent> {
        self.link.peer_restarted();
        let conditions = Conditions {
            link: &self.link,
            is_busy: true,
        };
        for transfer in &mut self.active {
            transfer.restart(now, conditions);
        }
        let delivered = std::mem::take(&mut self.delivered);
        let delivered = delivered.into_iter().map(|((stream, key), version)| {
            if self.newest.get(&(stream, key)) == Some(&version) {
                self.newest.remove(&(stream, key));
            }
            ObjectId {
                stream,
                key,
                version,
            }
        });
        Step::event(SenderEvent::ReceiverRestarted {
            delivered: delivered.collect(),
        })
    }

    /// So many bytes more have left by the link that are not ours: telemetry, commands, signatures. They come first, and
    /// count against the budget.
    pub fn link_has_sent(&mut self, bytes: u64) {
        self.others += bytes;
        self.pacer.spend(bytes as f64);
    }

    /// Lets time pass: sends what the budget allows. Wants to be called every 10 to 20 ms.
    pub fn tick(&mut self, now: Stamp) -> Step<SenderEvent> {
        self.pacer.refill(now);
        let mut step = self.expire(now);
        if !self.receiver_is_alive(now) {
            step.send.extend(self.probe(now));
            return step;
        }
        self.activate(now);
        while let Some(place) = self.next_to_send(now) {
            if !self.pacer.allows() {
                self.pacer.ran_out();
                break;
            }
            let transfer = &mut self.active[place];
            let Outgoing {
                message,
                wire_bytes,
                symbol,
            } = transfer.next_message(now, &self.link);
            self.pacer.spend(wire_bytes as f64);
            self.counts.wire_bytes += wire_bytes as u64;
            if let Some(symbol) = symbol {
                self.counts.symbols_sent += 1;
                let name = (transfer.number(), symbol);
                let bytes = self.counts.wire_bytes + self.others;
                self.link.symbol_sent(now, name, bytes);
            }
            if transfer.is_sent_for_good() {
                self.active.remove(place);
                self.activate(now);
            }
            step.send.push(message);
        }
        if self.pacer.allows() {
            self.last_idle = now;
        }
        step
    }

    fn expire(&mut self, now: Stamp) -> Step<SenderEvent> {
        let mut step = Step::none();
        let mut is_over = |object: &Object, offered: Stamp| {
            let over = match object.service {
                Service::Latest { deadline } => now.since(offered) > deadline,
                Service::Reliable | Service::BestEffort => false,
            };
            if over {
                step.events.push(SenderEvent::Expired(object.id));
            }
            over
        };
        self.waiting
            .retain(|waiting| !is_over(&waiting.object, waiting.offered));
        self.active
            .retain(|transfer| !is_over(transfer.object(), transfer.offered()));
        step
    }

    fn receiver_is_alive(&self, now: Stamp) -> bool {
        self.last_report
            .is_some_and(|last| now.since(last) <= PEER_LOST_AFTER)
    }

    /// Nobody reports: announce something now and then, which a receiver answers at once.
    fn probe(&mut self, now: Stamp) -> Option<Message> {
        if now < self.probe_due {
            return None;
        }
        if self.active.is_empty() {
            self.activate(now);
        }
        let transfer = self.active.first_mut()?;
        self.probe_due = now + PROBE_INTERVAL;
        let announcement = transfer.announce(now);
        self.counts.wire_bytes += announcement.wire_bytes as u64;
        Some(announcement.message)
    }

    /// Takes objects from the queues while there is a place for their class.
    fn activate(&mut self, now: Stamp) {
        while let Some(waiting) = self.next_to_begin(now) {
            let number = self.next_number();
            let conditions = Conditions {
                link: &self.link,
                is_busy: self.is_busy(now),
            };
            let to = (self.ends.peer, number);
            let symbol_bytes = self.pacer.symbol_bytes();
            let begun = Transfer::new(now, to, waiting, symbol_bytes, conditions);
            self.active.push(begun);
        }
    }

    fn is_busy(&self, now: Stamp) -> bool {
        now.since(self.last_idle) > BUSY_AFTER
    }

    /// Bytes of reliable objects under way.
    fn under_way(&self) -> usize {
        let reliable = self.active.iter().filter(|t| t.priority() == 1);
        reliable.map(|t| t.object().bytes.len()).sum()
    }

    fn next_to_begin(&mut self, now: Stamp) -> Option<Waiting> {
        let of = |priority: u8| self.active.iter().filter(move |t| t.priority() == priority);
        let (latest, reliable) = (of(0).count(), of(1).count());
        let under_way = self.under_way();
        if latest < MAX_LATEST
            && let Some(waiting) = self.waiting.pop(0, |_| true)
        {
            return Some(waiting);
        }
        let lost_reports = LOST_REPORT.mul_f64(self.link.loss().unwrap_or(0.0));
        let round = self.link.patience() + ROUND_LATENCY + lost_reports;
        let window = self.pacer.rate(now) * round.as_secs_f64() * WINDOWS;
        let window = (window as usize).clamp(LEAST_WINDOW, MOST_WINDOW);
        let has_room = under_way < window.min(self.room) || reliable == 0;
        if reliable < MAX_RELIABLE && has_room {
            let active = &self.active;
            let is_free = |id: ObjectId| {
                let is_same = |other: ObjectId| (other.stream, other.key) == (id.stream, id.key);
                !active.iter().any(|transfer| is_same(transfer.object().id))
            };
            if let Some(waiting) = self.waiting.pop(1, is_free) {
                return Some(waiting);
            }
        }
        if self.active.is_empty() {
            self.waiting.pop(2, |_| true)
        } else {
            None
        }
    }

    fn next_number(&mut self) -> u32 {
        self.transfers_begun = self.transfers_begun.checked_add(1).unwrap_or(1);
        u32::from(self.session) << 16 | u32::from(self.transfers_begun)
    }

    fn next_to_send(&self, now: Stamp) -> Option<usize> {
        let candidates = self.active.iter().enumerate();
        candidates
            .filter(|(_, transfer)| transfer.wants_to_send(now))
            .min_by_key(|(_, transfer)| transfer.priority())
            .map(|(place, _)| place)
    }

    /// Whether everything offered is delivered, refused or expired.
    pub fn is_idle(&self) -> bool {
        self.pending().next().is_none()
    }

    /// How it goes.
    pub fn stats(&self, now: Stamp) -> SenderStats {
        let active_bytes: usize = self.active.iter().map(|t| t.object().bytes.len()).sum();
        SenderStats {
            keys_delivered: (self.delivered.iter())
                .filter(|(key, version)| self.newest.get(key) == Some(version))
                .count(),
            objects_pending: self.pending().count(),
            bytes_pending: self.waiting.bytes() + active_bytes,
            loss: self.link.loss(),
            pace: self.pacer.rate(now),
            wait: self.pacer.wait(),
            receiver_alive: self.receiver_is_alive(now),
            ..self.counts
        }
    }
}
