//! What one sender is sending us.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use maps::time::Stamp;

use super::{IDLE_INTERVAL, ReceiverLimits, ReceiverStats};
use crate::dialect::Message;
use crate::dialect::tandem::{TANDEM_OBJECT_DATA, TANDEM_REPORT_DATA, TANDEM_SYMBOL_DATA};
use crate::object::estimate::NO_ECHO;
use crate::object::fountain::{Collector, Progress};
use crate::object::{ObjectId, REPORT_ENTRIES, Service, StreamId, TransferState};
use crate::wire::Address;

/// Time between reports while something arrives.
const BUSY_INTERVAL: Duration = Duration::from_millis(100);
/// Time between reports when there is news that the sender waits for.
const URGENT_INTERVAL: Duration = Duration::from_millis(10);
/// More often than every [`BUSY_INTERVAL`] only so many bytes are reported for each that arrives: the way back may be as slow.
const REPORTED_SHARE: f64 = 0.06;
/// What may be saved up of them, and borrowed.
const REPORT_BYTES: f64 = 1000.0;
/// Of one report's frame, and of a symbol's.
const REPORT_FRAME_BYTES: f64 = 111.0;
const SYMBOL_FRAME_BYTES: f64 = 266.0;
/// What an object lacks is told again after so long: the sender may not have heard, or may have sent in vain.
const AGAIN: Duration = Duration::from_millis(150);
/// The same of an object with a deadline.
const AGAIN_IN_HASTE: Duration = Duration::from_millis(40);
/// An object for which nothing came for so long may have been sent as far as it goes: the sender wants to know what it lacks.
const STALLED: Duration = Duration::from_millis(30);
/// After so long without a symbol, reports come slowly again.
const BUSY_FOR: Duration = Duration::from_secs(3);
/// Ended transfers remembered, so that a repeated announcement is answered.
const MAX_SETTLED: usize = 4096;
/// A transfer's end is reported so often, since reports get lost too.
const END_REPORTS: u32 = 3;
/// Symbols kept that overtook their announcement, or whose announcement was lost: what a fast link carries in a round trip.
const MAX_ORPHANS: usize = 4096;
/// Keys whose newest version is remembered.
const MAX_KEYS: usize = 8192;

/// An object on its way.
struct Incoming {
    announcement: TANDEM_OBJECT_DATA,
    collector: Collector,
    last_activity: Stamp,
    /// When it was last reported since it was announced last.
    reported: Option<Stamp>,
    deadline: Option<Stamp>,
}

impl Incoming {
    /// Whether the sender does not know that we know of it, or may wait to hear what is missing.
    fn is_news(&self, now: Stamp) -> bool {
        self.reported.is_none_or(|reported| {
            let has_stalled = now.since(self.last_activity) >= STALLED;
            let is_told = reported.since(self.last_activity) >= STALLED;
            let again = if self.deadline.is_some() {
                AGAIN_IN_HASTE
            } else {
                AGAIN
            };
            has_stalled && (!is_told || now.since(reported) >= again)
        })
    }
}

/// How a transfer ended.
struct Settled {
    state: TransferState,
    received: u32,
    reports_left: u32,
}

/// One sender, as the receiver sees it.
pub(super) struct Peer {
    pub(super) last_heard: Stamp,
    /// The sender's session: the upper half of its transfer numbers.
    session: u16,
    incoming: BTreeMap<u32, Incoming>,
    settled: BTreeMap<u32, Settled>,
    /// Their numbers, the oldest first.
    settled_order: VecDeque<u32>,
    unknown: BTreeSet<u32>,
    /// Symbols of unknown transfers.
    orphans: BTreeMap<u16, Vec<TANDEM_SYMBOL_DATA>>,
    /// The transfer of each, the newest last; also of some that are not kept any more.
    orphan_order: VecDeque<u16>,
    /// Version and checksum of the newest reliable object of each key.
    have: BTreeMap<(StreamId, u64), (u64, u32)>,
    symbols: u32,
    /// Transfer, number and time of the last symbol.
    last_symbol: Option<(u16, u16, Stamp)>,
    /// Bytes that may be reported more often than at leisure.
    report_budget: f64,
    last_report: Option<Stamp>,
    urgent: bool,
    max_bytes: usize,
}

impl Peer {
    pub(super) fn new(now: Stamp, max_bytes: usize) -> Self {
        Self {
            last_heard: now,
            session: 0,
            incoming: BTreeMap::new(),
            settled: BTreeMap::new(),
            settled_order: VecDeque::new(),
            unknown: BTreeSet::new(),
            orphans: BTreeMap::new(),
            orphan_order: VecDeque::new(),
            have: BTreeMap::new(),
            symbols: 0,
            last_symbol: None,
            report_budget: REPORT_BYTES,
            last_report: None,
            urgent: false,
            max_bytes,
        }
    }

    pub(super) fn bytes_under_way(&self) -> usize {
        self.incoming
            .values()
            .map(|incoming| incoming.announcement.size as usize)
            .sum()
    }

    /// An object was announced, perhaps once more. Symbols that overtook the announcement may complete it at once.
    pub(super) fn announced(
        &mut self,
        now: Stamp,
        object: &TANDEM_OBJECT_DATA,
        limits: &ReceiverLimits,
        stats: &mut ReceiverStats,
    ) -> Option<(ObjectId, Vec<u8>)> {
        let transfer = object.transfer;
        self.urgent = true;
        self.unknown.remove(&transfer);
        self.notice_restart((transfer >> 16) as u16);
        if let Some(known) = self.incoming.get_mut(&transfer) {
            if is_same(&known.announcement, object) {
                known.last_activity = now;
                known.reported = None;
                return None;
            }
            self.incoming.remove(&transfer);
        }
        if let Some(settled) = self.settled.get_mut(&transfer) {
            settled.reports_left = settled.reports_left.max(1);
            return None;
        }
        let have = self.have.get(&(StreamId(object.stream), object.key));
        if have.is_some_and(|have| is_covered(*have, object)) {
            self.settle(transfer, TransferState::Complete, 0);
            return None;
        }
        let size = object.size as usize;
        let collector = Collector::new(size, usize::from(object.symbol_size))
            .filter(|_| transfer != 0 && size <= limits.object_bytes.min(limits.bytes));
        let Some(collector) = collector else {
            stats.refused += 1;
            self.settle(transfer, TransferState::Refused, 0);
            return None;
        };
        self.make_room(size, limits, stats);
        let deadline =
            (object.deadline != 0).then(|| now + Duration::from_millis(u64::from(object.deadline)));
        let incoming = Incoming {
            announcement: object.clone(),
            collector,
            last_activity: now,
            reported: None,
            deadline,
        };
        self.incoming.insert(transfer, incoming);
        let orphans = self.orphans.remove(&(transfer as u16)).unwrap_or_default();
        orphans
            .iter()
            .find_map(|symbol| self.collect(now, symbol, stats))
    }

    /// A sender that restarts counts its transfers, and perhaps its versions, anew.
    fn notice_restart(&mut self, session: u16) {
        if session != self.session {
            if self.session != 0 {
                // Of the former session: their numbers begin anew.
                self.orphans.clear();
                self.orphan_order.clear();
            }
            self.session = session;
            self.incoming.clear();
            self.settled.clear();
            self.settled_order.clear();
            self.have.clear();
        }
    }

    /// Drops what was idle for longest, until another object of this size fits.
    fn make_room(&mut self, size: usize, limits: &ReceiverLimits, stats: &mut ReceiverStats) {
        while !self.incoming.is_empty()
            && (self.incoming.len() >= limits.transfers
                || self.bytes_under_way() + size > limits.bytes)
        {
            let idle = self.incoming.iter().min_by_key(|(_, i)| i.last_activity);
            if let Some(transfer) = idle.map(|(transfer, _)| *transfer) {
                self.incoming.remove(&transfer);
                stats.dropped += 1;
            }
        }
    }

    /// A symbol came; perhaps it completes an object.
    pub(super) fn symbol(
        &mut self,
        now: Stamp,
        symbol: &TANDEM_SYMBOL_DATA,
        stats: &mut ReceiverStats,
    ) -> Option<(ObjectId, Vec<u8>)> {
        let transfer = self.number(symbol);
        self.symbols = self.symbols.wrapping_add(1);
        self.last_symbol = Some((symbol.transfer, symbol.symbol, now));
        self.report_budget =
            (self.report_budget + REPORTED_SHARE * SYMBOL_FRAME_BYTES).min(REPORT_BYTES);
        if self.incoming.contains_key(&transfer) {
            return self.collect(now, symbol, stats);
        }
        if let Some(settled) = self.settled.get_mut(&transfer) {
            // The sender has not heard of the end yet.
            settled.reports_left = settled.reports_left.max(1);
            return None;
        }
        if self.unknown.len() < REPORT_ENTRIES {
            self.urgent |= self.unknown.insert(transfer);
        }
        self.adopt(symbol);
        None
    }

    /// Keeps a symbol of an unknown transfer, in place of the oldest.
    fn adopt(&mut self, symbol: &TANDEM_SYMBOL_DATA) {
        if self.orphan_order.len() >= MAX_ORPHANS
            && let Some(transfer) = self.orphan_order.pop_front()
            && let Some(orphans) = self.orphans.get_mut(&transfer)
        {
            orphans.pop();
            if orphans.is_empty() {
                self.orphans.remove(&transfer);
            }
        }
        self.orphan_order.push_back(symbol.transfer);
        let orphans = self.orphans.entry(symbol.transfer).or_default();
        orphans.push(symbol.clone());
    }

    /// The whole number of a symbol's transfer.
    fn number(&self, symbol: &TANDEM_SYMBOL_DATA) -> u32 {
        u32::from(self.session) << 16 | u32::from(symbol.transfer)
    }

    fn collect(
        &mut self,
        now: Stamp,
        symbol: &TANDEM_SYMBOL_DATA,
        stats: &mut ReceiverStats,
    ) -> Option<(ObjectId, Vec<u8>)> {
        let transfer = self.number(symbol);
        let incoming = self.incoming.get_mut(&transfer)?;
        incoming.last_activity = now;
        match incoming.collector.add(symbol.symbol, &symbol.data) {
            Progress::Wanting => None,
            Progress::Complete(bytes) => self.completed(transfer, bytes, stats),
            Progress::Hopeless => {
                self.damaged(transfer, stats);
                None
            }
        }
    }

    fn completed(
        &mut self,
        transfer: u32,
        bytes: Vec<u8>,
        stats: &mut ReceiverStats,
    ) -> Option<(ObjectId, Vec<u8>)> {
        let incoming = self.incoming.get(&transfer)?;
        let object = &incoming.announcement;
        if crc32c::crc32c(&bytes) != object.hash {
            self.damaged(transfer, stats);
            return None;
        }
        let id = ObjectId {
            stream: StreamId(object.stream),
            key: object.key,
            version: object.version,
        };
        let (hash, service) = (object.hash, object.service);
        let received = incoming.collector.received();
        let key = (id.stream, id.key);
        let outdated = self
            .have
            .get(&key)
            .is_some_and(|have| is_covered(*have, object));
        self.incoming.remove(&transfer);
        self.settle(transfer, TransferState::Complete, received);
        if outdated {
            return None; // A newer version overtook it.
        }
        let is_reliable = service == Service::Reliable.to_wire();
        if is_reliable && (self.have.len() < MAX_KEYS || self.have.contains_key(&key)) {
            self.have.insert(key, (id.version, hash));
        }
        Some((id, bytes))
    }

    /// Throws the symbols away and starts the object again, since one of them was wrong.
    fn damaged(&mut self, transfer: u32, stats: &mut ReceiverStats) {
        stats.damaged += 1;
        self.incoming.remove(&transfer);
        self.settle(transfer, TransferState::Damaged, 0);
    }

    fn settle(&mut self, transfer: u32, state: TransferState, received: u32) {
        self.urgent = true;
        self.settled_order.push_back(transfer);
        if self.settled_order.len() > MAX_SETTLED
            && let Some(oldest) = self.settled_order.pop_front()
        {
            self.settled.remove(&oldest);
        }
        let settled = Settled {
            state,
            received,
            reports_left: END_REPORTS,
        };
        self.settled.insert(transfer, settled);
    }

    /// Drops what no symbol came for, and what is past its deadline.
    pub(super) fn drop_old(&mut self, now: Stamp, max_age: Duration, stats: &mut ReceiverStats) {
        let before = self.incoming.len();
        self.incoming.retain(|_, incoming| {
            now.since(incoming.last_activity) <= max_age
                && incoming.deadline.is_none_or(|deadline| now <= deadline)
        });
        stats.dropped += (before - self.incoming.len()) as u64;
    }

    fn since_report(&self, now: Stamp) -> Duration {
        self.last_report
            .map_or(Duration::MAX, |last| now.since(last))
    }

    /// Whether there is news that cannot wait for the next tick.
    pub(super) fn report_is_urgent(&self, now: Stamp) -> bool {
        self.may_hurry() && self.since_report(now) >= URGENT_INTERVAL
    }

    fn may_hurry(&self) -> bool {
        self.urgent && self.report_budget > 0.0
    }

    pub(super) fn report_is_due(&self, now: Stamp) -> bool {
        let busy = self
            .incoming
            .values()
            .any(|incoming| now.since(incoming.last_activity) <= BUSY_FOR)
            || self
                .settled
                .values()
                .any(|settled| settled.reports_left > 0);
        let hurries = (self.incoming.values())
            .any(|incoming| incoming.deadline.is_some() && incoming.is_news(now));
        let interval = if self.may_hurry() || hurries {
            URGENT_INTERVAL
        } else if busy || self.urgent {
            BUSY_INTERVAL
        } else {
            IDLE_INTERVAL
        };
        self.since_report(now) >= interval
    }

    /// What there is to say, in as many reports as it takes; at least one, as a sign of life.
    pub(super) fn reports(&mut self, now: Stamp, to: Address, session: u32) -> Vec<Message> {
        self.last_report = Some(now);
        self.urgent = false;
        let mut entries = Vec::new();
        let mut damaged = Vec::new();
        for (&transfer, settled) in &mut self.settled {
            if settled.reports_left == 0 {
                continue;
            }
            settled.reports_left -= 1;
            entries.push((transfer, settled.state, settled.received, 0));
            if settled.state == TransferState::Damaged {
                damaged.push(transfer); // Told once: then the object may be announced and sent again.
            }
        }
        self.settled
            .retain(|transfer, _| !damaged.contains(transfer));
        for transfer in std::mem::take(&mut self.unknown) {
            entries.push((transfer, TransferState::Unknown, 0, 0));
        }
        for (transfer, incoming) in &mut self.incoming {
            if incoming.is_news(now) {
                incoming.reported = Some(now);
                let collector = &incoming.collector;
                let (received, missing) = (collector.received(), collector.missing());
                entries.push((*transfer, TransferState::Wanted, received, missing));
            }
        }
        let room = self.max_bytes.saturating_sub(self.bytes_under_way());
        let (echo_transfer, echo_symbol, came) = self
            .last_symbol
            .map_or((0, 0, None), |(t, s, at)| (t, s, Some(at)));
        let age = came.map(|at| u32::try_from(now.since(at).as_micros()).unwrap_or(NO_ECHO));
        let mut report = TANDEM_REPORT_DATA {
            session,
            symbols: self.symbols,
            echo_transfer,
            echo_symbol,
            echo_age: age.unwrap_or(NO_ECHO),
            room: u32::try_from(room).unwrap_or(u32::MAX),
            target_system: to.system.0,
            target_component: to.component.0,
            ..TANDEM_REPORT_DATA::default()
        };
        let count = entries.len().div_ceil(REPORT_ENTRIES).max(1);
        self.report_budget =
            (self.report_budget - count as f64 * REPORT_FRAME_BYTES).max(-REPORT_BYTES);
        if entries.is_empty() {
            return vec![Message::TANDEM_REPORT(report)];
        }
        let mut reports = Vec::new();
        for chunk in entries.chunks(REPORT_ENTRIES) {
            report.count = chunk.len() as u8;
            for (slot, &(transfer, state, received, missing)) in chunk.iter().enumerate() {
                report.transfers[slot] = transfer;
                report.states[slot] = state as u8;
                report.received[slot] = u16::try_from(received).unwrap_or(u16::MAX);
                report.missing[slot] = u16::try_from(missing).unwrap_or(u16::MAX);
            }
            reports.push(Message::TANDEM_REPORT(report.clone()));
        }
        reports
    }
}

/// Whether what we have of the key makes the announced object superfluous.
fn is_covered((version, hash): (u64, u32), object: &TANDEM_OBJECT_DATA) -> bool {
    version > object.version || (version == object.version && hash == object.hash)
}

/// Whether both announce the same object; the time left differs each time.
fn is_same(one: &TANDEM_OBJECT_DATA, other: &TANDEM_OBJECT_DATA) -> bool {
    let name = |object: &TANDEM_OBJECT_DATA| (object.stream, object.key, object.version);
    let content = |object: &TANDEM_OBJECT_DATA| (object.size, object.hash, object.symbol_size);
    name(one) == name(other) && content(one) == content(other)
}
