//! Forgetting history that nobody will ask for.

use std::time::Duration;

use maps::tile::{Detail, Tile, TileId};
use maps::time::Stamp;
use rusqlite::{Transaction, TransactionBehavior, params};

use crate::{AsOf, Sequence, Store, StoreError, TileVersion};

/// Which versions a compaction keeps. The newest of each tile is kept whatever this says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Keep {
    /// Every state of the map from this moment on is kept.
    pub all_since: Stamp,
    /// Of those before, the last version of each tile in each span of this length, counted from the start of the clock; all
    /// if zero.
    pub one_per: Duration,
    /// No state of the map before this moment is kept.
    pub nothing_before: Stamp,
}

/// What a compaction did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Compaction {
    /// How many versions are gone.
    pub removed: usize,
    /// How many are there still.
    pub kept: usize,
    /// Tiles that were left as they are, because a version of theirs is damaged.
    pub damaged: usize,
}

/// A kept version and how it is to be written again.
struct Rewrite {
    sequence: Sequence,
    base: Option<Sequence>,
    chain: u32,
    data: Vec<u8>,
}

impl Store {
    /// Forgets the versions that `keep` does not name and gives the space back. A crash leaves each tile as before or after.
    ///
    /// The map as of a moment that is kept stays what it was; in between, a tile shows an older version than it had.
    pub fn compact(&mut self, keep: &Keep) -> Result<Compaction, StoreError> {
        self.flush()?;
        let mut done = Compaction::default();
        for tile in self.versions(AsOf::Newest)? {
            let history = self.history(tile.id)?;
            let kept = kept(&history, keep);
            done.kept += kept.len();
            let gone = history.len() - kept.len();
            if gone == 0 {
                continue;
            }
            match self.keep_only(tile.id, &history, &kept) {
                Ok(()) => done.removed += gone,
                Err(StoreError::DamagedTile { .. } | StoreError::OtherContent { .. }) => {
                    done.damaged += 1;
                    done.kept += gone;
                }
                Err(error) => return Err(error),
            }
        }
        self.give_back().map_err(self.wrap())?;
        Ok(done)
    }

    /// Removes all other versions of a tile, after writing anew those that were changes of one that goes.
    fn keep_only(
        &mut self,
        id: TileId,
        history: &[TileVersion],
        kept: &[TileVersion],
    ) -> Result<(), StoreError> {
        let rewrites = self.rewrites(kept)?;
        let wrap = self.wrap();
        let gone = history
            .iter()
            .filter(|is| !kept.contains(is))
            .map(|is| is.sequence);
        let gone: Vec<_> = gone.collect();
        let mut write = || {
            let transaction = self
                .connection
                .transaction_with_behavior(TransactionBehavior::Immediate)?;
            replace(&transaction, &rewrites, &gone)?;
            transaction.commit()
        };
        write().map_err(wrap)?;
        self.recent.remove(&id);
        Ok(())
    }

    /// All kept versions of a tile, encoded as a new sequence of chains.
    fn rewrites(&self, kept: &[TileVersion]) -> Result<Vec<Rewrite>, StoreError> {
        let mut rewrites = Vec::with_capacity(kept.len());
        let mut before: Option<(Sequence, u32, Tile)> = None;
        for is in kept {
            let (_, tile) = self.read(is.sequence)?;
            let base = before.filter(|(_, chain, _)| *chain < self.settings.chain);
            let (base, chain, data) = match base {
                Some((sequence, chain, base)) => {
                    let data = tile.encode_change(&base, Detail::Sightings);
                    (Some(sequence), chain + 1, data)
                }
                None => (None, 0, tile.encode_as(Detail::Sightings)),
            };
            rewrites.push(Rewrite {
                sequence: is.sequence,
                base,
                chain,
                data,
            });
            before = Some((is.sequence, chain, tile));
        }
        Ok(rewrites)
    }

    /// Gives free pages back to the file system, and the log's content to the file.
    fn give_back(&self) -> rusqlite::Result<()> {
        let mut vacuum = self.connection.prepare("PRAGMA incremental_vacuum")?;
        let mut rows = vacuum.query([])?;
        while rows.next()?.is_some() {}
        self.connection
            .query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))
    }
}

fn replace(
    transaction: &Transaction<'_>,
    rewrites: &[Rewrite],
    gone: &[Sequence],
) -> rusqlite::Result<()> {
    let mut update = transaction.prepare_cached(
        "UPDATE version SET base = ?2, chain = ?3, data = ?4 WHERE sequence = ?1",
    )?;
    for rewrite in rewrites {
        update.execute(params![
            rewrite.sequence.0.cast_signed(),
            rewrite.base.map(|base| base.0.cast_signed()),
            rewrite.chain,
            rewrite.data,
        ])?;
    }
    let mut delete = transaction.prepare_cached("DELETE FROM version WHERE sequence = ?1")?;
    for sequence in gone {
        delete.execute([sequence.0.cast_signed()])?;
    }
    Ok(())
}

/// Those of a tile's versions, oldest first, that are to be kept.
fn kept(history: &[TileVersion], keep: &Keep) -> Vec<TileVersion> {
    let span = keep.one_per.as_nanos();
    let span_of = |at: Stamp| (u128::from(at.as_nanos())).checked_div(span);
    let is_kept = |is: &TileVersion, next: Option<&TileVersion>| {
        let Some(next) = next else {
            return true;
        };
        if next.at <= keep.nothing_before {
            return false;
        }
        next.at > keep.all_since || span == 0 || span_of(is.at) != span_of(next.at)
    };
    let nexts = history.iter().skip(1).map(Some).chain([None]);
    let pairs = history.iter().zip(nexts);
    pairs
        .filter(|(is, next)| is_kept(is, *next))
        .map(|(is, _)| *is)
        .collect()
}
