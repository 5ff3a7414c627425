//! The receiving end: collects symbols, reports what it has and lacks, and hands out whole objects.

mod peer;

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use super::estimate::NO_ECHO;
use super::{MAX_OBJECT_BYTES, ObjectId};
use crate::dialect::Message;
use crate::dialect::tandem::TANDEM_REPORT_DATA;
use crate::service::{Step, is_for};
use crate::wire::Address;
use peer::Peer;

/// Time between signs of life.
const IDLE_INTERVAL: Duration = Duration::from_secs(1);

/// How much memory senders may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReceiverLimits {
    /// Larger objects are refused.
    pub object_bytes: usize,
    /// Objects of one sender under way at once; beyond this the one idle for longest is dropped.
    pub transfers: usize,
    /// Their announced bytes together.
    pub bytes: usize,
    /// An unfinished object is dropped after so long without a symbol.
    pub age: Duration,
    /// Senders served at once; a further one has to wait until another falls silent for `age`.
    pub senders: usize,
}

/// Objects of 4 MiB, 16 MiB under way from each of 8 senders, half a minute of patience.
impl Default for ReceiverLimits {
    fn default() -> Self {
        Self {
            object_bytes: MAX_OBJECT_BYTES,
            transfers: 4096,
            bytes: 16 << 20,
            age: Duration::from_secs(30),
            senders: 8,
        }
    }
}

/// A whole object, its checksum verified.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// Who sent it.
    pub from: Address,
    /// Its name.
    pub id: ObjectId,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiverStats {
    /// Whole objects handed out.
    pub objects: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Symbols received, useful or not.
    pub symbols: u64,
    /// Announcements refused.
    pub refused: u64,
    /// Objects whose checksum was wrong.
    pub damaged: u64,
    /// Unfinished objects that were dropped for age, for room or at their deadline.
    pub dropped: u64,
}

/// Receives objects from any sender.
pub struct Receiver {
    own: Address,
    session: u32,
    limits: ReceiverLimits,
    peers: BTreeMap<Address, Peer>,
    sign_of_life_due: Stamp,
    stats: ReceiverStats,
}

impl Receiver {
    /// A receiver that has nothing yet. `session` should differ from that of the receiver's last start, so that senders
    /// see that it has lost what it had.
    pub fn new(own: Address, session: u32, limits: ReceiverLimits) -> Self {
        Self {
            own,
            session,
            limits,
            peers: BTreeMap::new(),
            sign_of_life_due: Stamp::ZERO,
            stats: ReceiverStats::default(),
        }
    }

    /// Tells it of any message that came in. Its events are whole objects.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<Received> {
        let ours = matches!(
            message,
            Message::TANDEM_OBJECT(_) | Message::TANDEM_SYMBOL(_)
        );
        if !ours || !is_for(self.own, message) || !self.admit(now, from) {
            return Step::none();
        }
        let Some(peer) = self.peers.get_mut(&from) else {
            return Step::none();
        };
        peer.last_heard = now;
        let complete = match message {
            Message::TANDEM_OBJECT(object) => {
                peer.announced(now, object, &self.limits, &mut self.stats)
            }
            Message::TANDEM_SYMBOL(symbol) => {
                self.stats.symbols += 1;
                peer.symbol(now, symbol, &mut self.stats)
            }
            _ => None,
        };
        let mut step = Step::none();
        if let Some((id, bytes)) = complete {
            self.stats.objects += 1;
            self.stats.bytes += bytes.len() as u64;
            step.events.push(Received { from, id, bytes });
        }
        if peer.report_is_urgent(now) {
            step.send.extend(peer.reports(now, from, self.session));
        }
        step
    }

    /// Makes room for a sender; `false` if there is none.
    fn admit(&mut self, now: Stamp, from: Address) -> bool {
        if self.peers.contains_key(&from) {
            return true;
        }
        if self.peers.len() >= self.limits.senders {
            let age = self.limits.age;
            let silent = self
                .peers
                .iter()
                .find(|(_, peer)| now.since(peer.last_heard) > age)
                .map(|(address, _)| *address);
            match silent {
                Some(address) => self.peers.remove(&address),
                None => return false,
            };
        }
        self.peers.insert(from, Peer::new(now, self.limits.bytes));
        true
    }

    /// Lets time pass: reports, and drops what is too old.
    pub fn tick(&mut self, now: Stamp) -> Step<Received> {
        let mut step = Step::none();
        for (address, peer) in &mut self.peers {
            peer.drop_old(now, self.limits.age, &mut self.stats);
            if peer.report_is_due(now) {
                step.send.extend(peer.reports(now, *address, self.session));
            }
        }
        // A sender that we have not heard must be able to notice that we restarted.
        if self.peers.is_empty() && now >= self.sign_of_life_due {
            self.sign_of_life_due = now + IDLE_INTERVAL;
            step.send.push(Message::TANDEM_REPORT(TANDEM_REPORT_DATA {
                session: self.session,
                room: u32::try_from(self.limits.bytes).unwrap_or(u32::MAX),
                echo_age: NO_ECHO,
                ..TANDEM_REPORT_DATA::default()
            }));
        }
        step
    }

    /// How it goes.
    pub fn stats(&self) -> ReceiverStats {
        self.stats
    }

    /// Announced bytes of objects under way.
    pub fn bytes_under_way(&self) -> usize {
        self.peers.values().map(Peer::bytes_under_way).sum()
    }
}
