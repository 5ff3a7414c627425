//! The receiving end: asks each sender for what differs.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::tile::TileId;
use maps::time::Stamp;

use super::inventory::{HASHES, Inventory, Item, Region};
use super::{StreamId, question};
use crate::dialect::Message;
use crate::dialect::tandem::TANDEM_DIGEST_ACK_DATA;
use crate::service::is_for;
use crate::wire::Address;

/// Questions that wait for an answer at once: they are small, and what they ask for takes longer than they do.
const WINDOW: usize = 4;
/// From one question to the next, however soon the answers come: a sender that says that everything differs must not make us
/// fill the link.
const SPACING: Duration = Duration::from_millis(20);
/// A question without an answer is asked again after so long.
const AGAIN: Duration = Duration::from_secs(1);
/// So often; then the next round begins anew.
const TRIES: u32 = 8;
/// From a round in which nothing differed to the next.
const REST: Duration = Duration::from_secs(30);
/// From a round in which something did, once nothing more arrives: it may have been lost.
const QUIET: Duration = Duration::from_secs(5);
/// Whether or not something arrives.
const AT_LEAST_EVERY: Duration = Duration::from_mins(1);
/// A sender that was silent for so long may have something new.
const AWAY: Duration = Duration::from_secs(4);
/// Regions remembered that are still to be asked for; those farther away are found again in the next round.
const MAX_REGIONS: usize = 4096;
/// Senders served at once.
const MAX_SENDERS: usize = 8;
/// Places along a path that count.
const MAX_PATH: usize = 256;

/// How far one sender's map has been compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CatchUp {
    /// Tiles that were found to differ in this round so far, or in the last.
    pub lacking: u32,
    /// Rounds that were gone through to their end.
    pub rounds: u64,
}

/// Asks senders for what differs from what we have of them. See the [module](super).
#[derive(Debug)]
pub struct Asker {
    own: Address,
    /// Drawn anew for each round.
    salt: u32,
    senders: BTreeMap<Address, Sender>,
    /// Where the vehicle will go, in tiles.
    path: Vec<TileId>,
}

#[derive(Debug)]
struct Sender {
    has: Inventory,
    last_heard: Stamp,
    /// When the last symbol came.
    last_symbol: Stamp,
    /// The upper half of its transfer numbers.
    session: Option<u32>,
    round: Option<Round>,
    due: Stamp,
    /// The round is put off for what arrives, but not beyond this.
    due_at_last: Stamp,
    progress: CatchUp,
}

#[derive(Debug)]
struct Round {
    salt: u32,
    regions: Vec<Region>,
    /// When each was asked for last, and how often.
    asked: BTreeMap<Region, (Stamp, u32)>,
    asked_last: Option<Stamp>,
    lacking: u32,
}

impl Asker {
    /// One that has nothing yet. `seed` should differ from that of the last start.
    pub fn new(own: Address, seed: u32) -> Self {
        Self {
            own,
            salt: seed,
            senders: BTreeMap::new(),
            path: Vec::new(),
        }
    }

    /// What is nearest to these places is asked for first.
    pub fn toward(&mut self, path: &[TileId]) {
        let step = path.len().div_ceil(MAX_PATH).max(1);
        self.path = path.iter().copied().step_by(step).collect();
    }

    /// A tile of this sender is here now, and safe: from its disk at the start, or as it arrived.
    pub fn has(&mut self, now: Stamp, from: Address, tile: TileId, item: Item) {
        if let Some(sender) = self.sender(now, from) {
            sender.has.insert(tile, item);
        }
    }

    /// How far a sender's map has been compared.
    pub fn progress(&self, from: Address) -> Option<CatchUp> {
        self.senders.get(&from).map(|sender| sender.progress)
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) {
        if !is_for(self.own, message) {
            return;
        }
        match message {
            Message::TANDEM_STATUS(_) | Message::TANDEM_OBJECT(_) => {
                let session = match message {
                    Message::TANDEM_OBJECT(object) => Some(object.transfer >> 16),
                    _ => None,
                };
                if let Some(sender) = self.sender(now, from) {
                    sender.heard(now, session);
                }
            }
            Message::TANDEM_SYMBOL(_) => {
                if let Some(sender) = self.senders.get_mut(&from) {
                    sender.last_heard = now;
                    sender.last_symbol = now;
                }
            }
            Message::TANDEM_DIGEST_ACK(answer) => {
                if let Some(sender) = self.senders.get_mut(&from) {
                    sender.last_heard = now;
                    sender.answered(now, answer);
                }
            }
            _ => {}
        }
    }

    /// Lets time pass: what to send.
    pub fn tick(&mut self, now: Stamp) -> Vec<Message> {
        let mut send = Vec::new();
        for (address, sender) in &mut self.senders {
            if sender.begins(now) {
                self.salt = self.salt.wrapping_add(0x9E37_79B9); // never the same for 2³² rounds
                sender.round = Some(Round::new(self.salt));
            }
            let Some(round) = &mut sender.round else {
                continue;
            };
            if now.since(sender.last_heard) > AWAY {
                continue; // asked again when it is back
            }
            let Some(regions) = round.next(now, &self.path) else {
                sender.ends(now);
                continue;
            };
            let salt = round.salt;
            let ask = |region| question(*address, &sender.has, region, salt);
            send.extend(regions.into_iter().map(ask));
        }
        send
    }

    /// What is known of a sender; `None` if there are too many.
    fn sender(&mut self, now: Stamp, from: Address) -> Option<&mut Sender> {
        if !self.senders.contains_key(&from) && self.senders.len() >= MAX_SENDERS {
            return None;
        }
        Some(self.senders.entry(from).or_insert_with(|| Sender::new(now)))
    }
}

impl Sender {
    fn new(now: Stamp) -> Self {
        Self {
            has: Inventory::default(),
            last_heard: Stamp::ZERO,
            last_symbol: Stamp::ZERO,
            session: None,
            round: None,
            due: now,
            due_at_last: now,
            progress: CatchUp::default(),
        }
    }

    fn heard(&mut self, now: Stamp, session: Option<u32>) {
        let is_another =
            session.is_some_and(|session| self.session.replace(session) != Some(session));
        if is_another || now.since(self.last_heard) > AWAY {
            self.round = None;
            self.due = now;
            self.due_at_last = now;
        }
        self.last_heard = now;
    }

    fn begins(&self, now: Stamp) -> bool {
        let is_quiet = now.since(self.last_symbol) >= QUIET;
        self.round.is_none() && (now >= self.due_at_last || now >= self.due && is_quiet)
    }

    fn ends(&mut self, now: Stamp) {
        let lacking = self.round.take().map_or(0, |round| round.lacking);
        self.progress.lacking = lacking;
        self.progress.rounds += 1;
        self.due = now + if lacking == 0 { REST } else { QUIET };
        self.due_at_last = now + AT_LEAST_EVERY;
    }

    fn answered(&mut self, now: Stamp, answer: &TANDEM_DIGEST_ACK_DATA) {
        let region = Region::new(answer.level, [answer.x, answer.y, answer.z]);
        let (Some(round), Some(region)) = (&mut self.round, region) else {
            return;
        };
        let is_expected = answer.stream == StreamId::TILE.0 && answer.salt == round.salt;
        if !is_expected || round.asked.remove(&region).is_none() {
            return;
        }
        if region.level == Region::LEAST_LEVEL {
            round.lacking += answer.differing.count_ones();
            self.progress.lacking = self.progress.lacking.max(round.lacking);
            // They are on their way now.
            self.last_symbol = now;
        } else if answer.differing != 0 {
            let inner = [answer.inner_x, answer.inner_y, answer.inner_z];
            let inner = Region::new(answer.inner_level, inner);
            if let Some(inner) = inner.filter(|inner| *inner != region && region.contains(*inner)) {
                round.regions.push(inner);
            } else {
                let parts = (0..HASHES).filter(|part| answer.differing >> part & 1 == 1);
                (round.regions).extend(parts.filter_map(|part| region.part(part)));
            }
        }
    }
}

impl Round {
    fn new(salt: u32) -> Self {
        Self {
            salt,
            regions: vec![Region::WORLD],
            asked: BTreeMap::new(),
            asked_last: None,
            lacking: 0,
        }
    }

    /// The regions to ask for now; `None` if the round is over.
    fn next(&mut self, now: Stamp, path: &[TileId]) -> Option<Vec<Region>> {
        let mut ask = Vec::new();
        for (region, (at, tries)) in &mut self.asked {
            if now.since(*at) < AGAIN {
                continue;
            }
            if *tries >= TRIES {
                return None;
            }
            (*at, *tries) = (now, *tries + 1);
            ask.push(*region);
        }
        let is_time = (self.asked_last).is_none_or(|last| now.since(last) >= SPACING);
        if is_time && self.asked.len() < WINDOW && !self.regions.is_empty() {
            // The nearest last; of those as near the smallest, so that there are never many at once.
            let distance = |region: &Region| {
                let distances = path.iter().map(|tile| region.distance_squared(*tile));
                (distances.min().unwrap_or(0), region.level)
            };
            self.regions
                .sort_by_cached_key(|region| std::cmp::Reverse(distance(region)));
            let too_many = self.regions.len().saturating_sub(MAX_REGIONS);
            self.regions.drain(..too_many);
            if let Some(region) = self.regions.pop() {
                self.asked.insert(region, (now, 1));
                self.asked_last = Some(now);
                ask.push(region);
            }
        }
        let is_over = self.asked.is_empty() && self.regions.is_empty();
        (!is_over).then_some(ask)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::tandem::TANDEM_STATUS_DATA;

    const UAV: Address = Address::new(1, 191);
    const TICK: Duration = Duration::from_millis(10);

    #[test]
    fn a_sender_that_says_that_everything_differs_everywhere_costs_little_memory_and_no_flood() {
        let mut asker = Asker::new(Address::new(255, 190), 1);
        let mut now = Stamp::ZERO;
        let (mut questions, mut most_regions) = (0_u128, 0);
        for _ in 0..20_000 {
            now += TICK;
            let status = Message::TANDEM_STATUS(TANDEM_STATUS_DATA::default());
            asker.handle(now, UAV, &status);
            for question in asker.tick(now) {
                questions += 1;
                let Message::TANDEM_DIGEST(asked) = question else {
                    panic!("a question")
                };
                let lie = TANDEM_DIGEST_ACK_DATA {
                    differing: u64::MAX,
                    salt: asked.salt,
                    x: asked.x,
                    y: asked.y,
                    z: asked.z,
                    level: asked.level,
                    inner_level: 99,
                    ..Default::default()
                };
                asker.handle(now, UAV, &Message::TANDEM_DIGEST_ACK(lie));
            }
            let round = asker.senders[&UAV].round.as_ref();
            most_regions = most_regions.max(round.map_or(0, |round| round.regions.len()));
        }
        assert!(most_regions <= MAX_REGIONS + WINDOW * HASHES);
        let most = 20_000 * TICK.as_millis() / SPACING.as_millis();
        assert!(
            (most / 2..=most + 100).contains(&questions),
            "{questions} in 200 s"
        );
    }
}
