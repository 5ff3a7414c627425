//! Tiles that wait to be handed over, each once.

use std::collections::{BTreeSet, VecDeque};

use maps::tile::TileId;

/// A queue in which nothing is twice.
#[derive(Clone, Debug, Default)]
pub(super) struct Backlog {
    order: VecDeque<TileId>,
    members: BTreeSet<TileId>,
}

impl Backlog {
    /// Puts a tile at the end, unless it waits already.
    pub(super) fn push(&mut self, tile: TileId) {
        if self.members.insert(tile) {
            self.order.push_back(tile);
        }
    }

    pub(super) fn first(&self) -> Option<TileId> {
        self.order.front().copied()
    }

    pub(super) fn pop(&mut self) {
        if let Some(tile) = self.order.pop_front() {
            self.members.remove(&tile);
        }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = TileId> {
        self.order.iter().copied()
    }
}
