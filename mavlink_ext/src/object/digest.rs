//! Anti-entropy: a receiver that was away, or kept its map while the sender started anew, gets what it lacks and nothing else.
//!
//! Both ends have an [`Inventory`]: which version of which tile, with a hash of its content. The receiver hashes a region in
//! 4³ parts (`TANDEM_DIGEST`); the sender answers in which of them it has something else (`TANDEM_DIGEST_ACK`), and the
//! receiver asks for these parts in turn, those nearest to its vehicle's path first, down to single tiles. What differs there
//! the sender offers again.
//!
//! ```text
//! receiver: whole world, 64 hashes      sender: part 21 differs, and all I have is in region 3/2/4 of level 4
//! receiver: region 3/2/4, 64 hashes     sender: parts 7 and 50 differ
//! receiver: part 7, 64 hashes           sender: tiles 0 and 12 differ          then the object transport sends them
//! ```
//!
//! - The receiver keeps all state and asks again what is not answered; the sender answers and forgets.
//! - Hashes are of 24 bits and salted, another salt each round: two that are equal by chance differ in the next.
//! - What only the receiver has is no difference: it may know of places that this sender was never at.

mod asker;
mod inventory;

pub use asker::{Asker, CatchUp};
pub use inventory::{Inventory, Item};

use inventory::{HASHES, Region};

use super::StreamId;
use crate::dialect::Message;
use crate::dialect::tandem::{TANDEM_DIGEST_ACK_DATA, TANDEM_DIGEST_DATA};
use crate::service::Ends;
use crate::wire::Address;
use maps::tile::TileId;
use maps::time::Stamp;

/// Answers at once at most, and in a second: hashing a whole map takes its time, and a question is cheap.
const ANSWERS: f64 = 100.0;

/// What follows from a question.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// To be sent.
    pub message: Message,
    /// Tiles that the receiver lacks: to be offered, in this order after those that were asked for before.
    pub lacking: Vec<TileId>,
    /// Tiles of which the receiver has the very same.
    pub same: Vec<TileId>,
}

/// The sending end: knows what there is, and answers.
#[derive(Clone, Debug)]
pub struct Answerer {
    inventory: Inventory,
    /// Answers that may be given, as of a moment.
    answers: f64,
    at: Stamp,
}

impl Default for Answerer {
    fn default() -> Self {
        Self {
            inventory: Inventory::default(),
            answers: ANSWERS,
            at: Stamp::ZERO,
        }
    }
}

impl Answerer {
    /// There is a new tile, or a new version of one; `false` if a coordinate does not fit 21 bits.
    pub fn has(&mut self, tile: TileId, item: Item) -> bool {
        self.inventory.insert(tile, item)
    }

    /// Tells it of any message that came in; `None` if it is no question of this peer, malformed, or one too many.
    pub fn handle(
        &mut self,
        now: Stamp,
        ends: Ends,
        from: Address,
        message: &Message,
    ) -> Option<Answer> {
        let Message::TANDEM_DIGEST(digest) = message else {
            return None;
        };
        if !ends.accept(from, message) || digest.stream != StreamId::TILE.0 {
            return None;
        }
        let region = Region::new(digest.level, [digest.x, digest.y, digest.z])?;
        let earned = now.since(self.at).as_secs_f64() * ANSWERS;
        (self.answers, self.at) = ((self.answers + earned).min(ANSWERS), now);
        if self.answers < 1.0 {
            return None;
        }
        self.answers -= 1.0;
        let inventory = &self.inventory;
        let differing = inventory.differing(region, digest.salt, &unpacked(&digest.hashes));
        let inner = inventory.bounds(region).unwrap_or(region);
        let lacking = match region.level {
            Region::LEAST_LEVEL => inventory.tiles_of(region, differing),
            _ => Vec::new(),
        };
        let message = TANDEM_DIGEST_ACK_DATA {
            differing,
            salt: digest.salt,
            x: region.at[0],
            y: region.at[1],
            z: region.at[2],
            inner_x: inner.at[0],
            inner_y: inner.at[1],
            inner_z: inner.at[2],
            target_system: ends.peer.system.0,
            target_component: ends.peer.component.0,
            stream: digest.stream,
            level: region.level,
            inner_level: inner.level,
        };
        Some(Answer {
            message: Message::TANDEM_DIGEST_ACK(message),
            lacking,
            same: inventory.tiles_of(region, !differing),
        })
    }
}

fn question(to: Address, inventory: &Inventory, region: Region, salt: u32) -> Message {
    Message::TANDEM_DIGEST(TANDEM_DIGEST_DATA {
        salt,
        x: region.at[0],
        y: region.at[1],
        z: region.at[2],
        target_system: to.system.0,
        target_component: to.component.0,
        stream: StreamId::TILE.0,
        level: region.level,
        hashes: packed(&inventory.hashes(region, salt)),
    })
}

/// Three bytes each, the lowest first.
fn packed(hashes: &[u32; HASHES]) -> [u8; 3 * HASHES] {
    let mut bytes = [0; 3 * HASHES];
    for (three, hash) in bytes.chunks_exact_mut(3).zip(hashes) {
        three.copy_from_slice(&hash.to_le_bytes()[..3]);
    }
    bytes
}

fn unpacked(bytes: &[u8; 3 * HASHES]) -> [u32; HASHES] {
    std::array::from_fn(|i| {
        u32::from_le_bytes([bytes[3 * i], bytes[3 * i + 1], bytes[3 * i + 2], 0])
    })
}

#[cfg(test)]
mod tests;
