//! Putting versions in.

use maps::tile::{Detail, Tile, TileId};
use maps::time::Stamp;
use rusqlite::{OptionalExtension as _, Transaction, TransactionBehavior, params};

use crate::{AsOf, Pending, Sequence, Store, StoreError, TileVersion};

/// Tiles that are remembered to encode changes of them. Each may take 15 MB, most take less than one.
const RECENT: usize = 24;
/// Tiles that wait at most; one more, and they are written however young they are.
const MOST_PENDING: usize = 64;

/// A version as it is written.
struct Encoded {
    is: TileVersion,
    base: Option<Sequence>,
    chain: u32,
    data: Vec<u8>,
}

impl Store {
    /// Takes a version of a tile. It is written by the first [`Self::tick`] after [`crate::Settings::flush_after`], or before.
    /// The version that the store has already is taken without a word.
    ///
    /// On any error the version was not taken: it is older, or the same with other content; or so much waits already, for want
    /// of space say, that no more fits in memory.
    pub fn put(&mut self, tile: &Tile, now: Stamp) -> Result<(), StoreError> {
        self.advance(now);
        if self.pending.len() >= MOST_PENDING && !self.pending.contains_key(&tile.id) {
            self.flush()?;
        }
        let digest = tile.digest();
        if let Some(newest) = self.version(tile.id, AsOf::Newest)? {
            if (newest.version, newest.digest) == (tile.version, digest) {
                return Ok(());
            }
            if newest.version >= tile.version {
                return Err(StoreError::OldVersion {
                    id: tile.id,
                    given: tile.version,
                    newest: newest.version,
                });
            }
        }
        self.sequence.0 += 1;
        let is = TileVersion {
            id: tile.id,
            version: tile.version,
            digest,
            sequence: self.sequence,
            at: self.now,
        };
        let tile = tile.clone();
        self.pending.insert(is.id, Pending { tile, is });
        self.pending_since.get_or_insert(self.now);
        Ok(())
    }

    /// Writes what has waited long enough; to be called a few times a second. On an error it goes on waiting.
    pub fn tick(&mut self, now: Stamp) -> Result<(), StoreError> {
        self.advance(now);
        let is_due = |since| self.now.since(since) >= self.settings.flush_after;
        if self.pending_since.is_some_and(is_due) {
            return self.flush();
        }
        Ok(())
    }

    /// Writes all that waits, in one transaction: all of it or nothing. On an error it goes on waiting.
    pub fn flush(&mut self) -> Result<(), StoreError> {
        if self.pending.is_empty() {
            return Ok(());
        }
        let mut ids: Vec<(Sequence, TileId)> = self
            .pending
            .values()
            .map(|pending| (pending.is.sequence, pending.is.id))
            .collect();
        ids.sort_unstable();
        let mut batch = Vec::with_capacity(ids.len());
        for (_, id) in ids {
            if let Some(pending) = self.pending.get(&id) {
                batch.push(self.encode(pending)?);
            }
        }
        let wrap = self.wrap();
        self.write(&batch).map_err(wrap)?;
        self.pending_since = None;
        for (id, pending) in std::mem::take(&mut self.pending) {
            self.recent.insert(id, (pending.is.sequence, pending.tile));
        }
        while self.recent.len() > RECENT {
            let oldest = self
                .recent
                .iter()
                .min_by_key(|(_, (sequence, _))| *sequence);
            let Some(id) = oldest.map(|(id, _)| *id) else {
                break;
            };
            self.recent.remove(&id);
        }
        Ok(())
    }

    fn encode(&self, pending: &Pending) -> Result<Encoded, StoreError> {
        let tile = &pending.tile;
        let (base, chain, data) = match self.base_for(tile.id)? {
            Some((sequence, chain, base)) => {
                let data = tile.encode_change(&base, Detail::Sightings);
                (Some(sequence), chain + 1, data)
            }
            None => (None, 0, tile.encode_as(Detail::Sightings)),
        };
        Ok(Encoded {
            is: pending.is,
            base,
            chain,
            data,
        })
    }

    /// The version to encode a change of: the newest that is written, unless its chain is too long or it cannot be read.
    fn base_for(&self, id: TileId) -> Result<Option<(Sequence, u32, Tile)>, StoreError> {
        let newest = "SELECT v.sequence, v.chain FROM tile t JOIN version v ON v.sequence = t.newest \
            WHERE t.x = ?1 AND t.y = ?2 AND t.z = ?3";
        let newest = self
            .connection
            .prepare_cached(newest)
            .and_then(|mut newest| {
                newest
                    .query_row(params![id.x, id.y, id.z], |row| {
                        Ok((row.get::<_, i64>(0)?, row.get::<_, u32>(1)?))
                    })
                    .optional()
            })
            .map_err(self.wrap())?;
        let Some((sequence, chain)) = newest.filter(|(_, chain)| *chain < self.settings.chain)
        else {
            return Ok(None);
        };
        let sequence = Sequence(sequence.cast_unsigned());
        if let Some((_, tile)) = self.recent.get(&id).filter(|(at, _)| *at == sequence) {
            return Ok(Some((sequence, chain, tile.clone())));
        }
        // What is damaged is not built upon, and the new version is written all the same.
        let base = self.read(sequence).ok();
        Ok(base.map(|(_, tile)| (sequence, chain, tile)))
    }

    fn write(&mut self, batch: &[Encoded]) -> rusqlite::Result<()> {
        let transaction = self
            .connection
            .transaction_with_behavior(TransactionBehavior::Immediate)?;
        for encoded in batch {
            insert(&transaction, encoded)?;
        }
        transaction.commit()
    }
}

fn insert(transaction: &Transaction<'_>, encoded: &Encoded) -> rusqlite::Result<()> {
    let is = &encoded.is;
    transaction
        .prepare_cached(
            "INSERT INTO version (sequence, x, y, z, version, digest, at_ns, base, chain, data) \
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)",
        )?
        .execute(params![
            is.sequence.0.cast_signed(),
            is.id.x,
            is.id.y,
            is.id.z,
            is.version.cast_signed(),
            is.digest.cast_signed(),
            is.at.as_nanos().cast_signed(),
            encoded.base.map(|base| base.0.cast_signed()),
            encoded.chain,
            encoded.data,
        ])?;
    transaction
        .prepare_cached(
            "INSERT INTO tile (x, y, z, newest) VALUES (?1, ?2, ?3, ?4) \
             ON CONFLICT (x, y, z) DO UPDATE SET newest = excluded.newest",
        )?
        .execute(params![
            is.id.x,
            is.id.y,
            is.id.z,
            is.sequence.0.cast_signed()
        ])?;
    Ok(())
}
