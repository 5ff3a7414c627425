//! Taking versions out.

use std::collections::BTreeMap;

use maps::tile::{Tile, TileError, TileId};
use maps::time::Stamp;
use rusqlite::{OptionalExtension as _, params};

use crate::schema::{COLUMNS, read_version};
use crate::{AsOf, Sequence, Store, StoreError, TileVersion};

/// What a row of the table `version` holds.
struct Stored {
    is: TileVersion,
    base: Option<Sequence>,
    data: Vec<u8>,
}

impl Store {
    /// The tiles of the map as it was, sorted by id.
    pub fn versions(&self, as_of: AsOf) -> Result<Vec<TileVersion>, StoreError> {
        let written = self.written(as_of).map_err(self.wrap())?;
        let mut versions: BTreeMap<TileId, TileVersion> =
            written.into_iter().map(|is| (is.id, is)).collect();
        let pending = self.pending.values().map(|pending| pending.is);
        versions.extend(
            pending
                .filter(|is| is_within(is, as_of))
                .map(|is| (is.id, is)),
        );
        Ok(versions.into_values().collect())
    }

    /// Every version of a tile that is kept, oldest first.
    pub fn history(&self, id: TileId) -> Result<Vec<TileVersion>, StoreError> {
        let select = format!(
            "SELECT {COLUMNS} FROM version v WHERE v.x = ?1 AND v.y = ?2 AND v.z = ?3 ORDER BY v.sequence"
        );
        let read = || {
            let mut select = self.connection.prepare_cached(&select)?;
            let rows = select.query_map(params![id.x, id.y, id.z], read_version)?;
            rows.collect::<rusqlite::Result<Vec<_>>>()
        };
        let mut versions = read().map_err(self.wrap())?;
        versions.extend(self.pending.get(&id).map(|pending| pending.is));
        Ok(versions)
    }

    /// Which version of a tile was the newest; `None` if there was none.
    pub fn version(&self, id: TileId, as_of: AsOf) -> Result<Option<TileVersion>, StoreError> {
        let pending = self.pending.get(&id).map(|pending| pending.is);
        if let Some(is) = pending.filter(|is| is_within(is, as_of)) {
            return Ok(Some(is));
        }
        let select = format!(
            "SELECT {COLUMNS} FROM version v WHERE v.x = ?1 AND v.y = ?2 AND v.z = ?3 AND v.sequence <= ?4 \
             ORDER BY v.sequence DESC LIMIT 1"
        );
        let read = || {
            let until = self.until(as_of)?;
            let mut select = self.connection.prepare_cached(&select)?;
            let of = params![id.x, id.y, id.z, until];
            select.query_row(of, read_version).optional()
        };
        read().map_err(self.wrap())
    }

    /// A tile as it was, with all that it knew; `None` if there was none.
    pub fn tile(&self, id: TileId, as_of: AsOf) -> Result<Option<Tile>, StoreError> {
        if let Some(pending) = self.pending.get(&id).filter(|p| is_within(&p.is, as_of)) {
            return Ok(Some(pending.tile.clone()));
        }
        let Some(version) = self.version(id, as_of)? else {
            return Ok(None);
        };
        self.read(version.sequence).map(|(_, tile)| Some(tile))
    }

    /// Reads everything, to see whether it is whole; slow. Gives how many versions there are.
    pub fn check(&self) -> Result<usize, StoreError> {
        let sequences = || {
            let mut select = self
                .connection
                .prepare("SELECT sequence FROM version ORDER BY sequence")?;
            let rows = select.query_map([], |row| row.get::<_, i64>(0))?;
            rows.collect::<rusqlite::Result<Vec<_>>>()
        };
        let sequences = sequences().map_err(self.wrap())?;
        for sequence in &sequences {
            self.read(Sequence(sequence.cast_unsigned()))?;
        }
        Ok(sequences.len())
    }

    /// One version, put together from its chain and compared with its digest.
    pub(crate) fn read(&self, sequence: Sequence) -> Result<(TileVersion, Tile), StoreError> {
        let mut chain = vec![self.stored(sequence).map_err(self.wrap())?];
        while let Some(base) = chain.last().and_then(|stored| stored.base) {
            // A base was always there before, so that this comes to an end.
            if chain
                .last()
                .is_some_and(|stored| stored.is.sequence <= base)
            {
                let source = rusqlite::Error::IntegralValueOutOfRange(0, base.0.cast_signed());
                let path = self.path.clone();
                return Err(StoreError::Corrupt { path, source });
            }
            chain.push(self.stored(base).map_err(self.wrap())?);
        }
        let is = chain[0].is;
        let damaged = |source: TileError| StoreError::DamagedTile {
            path: self.path.clone(),
            id: is.id,
            version: is.version,
            source,
        };
        let mut tile = Tile::unknown(is.id, 0, 1.0);
        for stored in chain.iter().rev() {
            tile = Tile::decode_change(&stored.data, &tile).map_err(damaged)?;
        }
        let found = tile.digest();
        if (found, tile.version, tile.id) != (is.digest, is.version, is.id) {
            return Err(StoreError::OtherContent {
                path: self.path.clone(),
                id: is.id,
                version: is.version,
                expected: is.digest,
                found,
            });
        }
        Ok((is, tile))
    }

    fn stored(&self, sequence: Sequence) -> rusqlite::Result<Stored> {
        let select =
            format!("SELECT {COLUMNS}, v.base, v.data FROM version v WHERE v.sequence = ?1");
        let mut select = self.connection.prepare_cached(&select)?;
        select.query_row([sequence.0.cast_signed()], |row| {
            Ok(Stored {
                is: read_version(row)?,
                base: row
                    .get::<_, Option<i64>>(7)?
                    .map(|base| Sequence(base.cast_unsigned())),
                data: row.get(8)?,
            })
        })
    }

    fn written(&self, as_of: AsOf) -> rusqlite::Result<Vec<TileVersion>> {
        if as_of == AsOf::Newest {
            let select =
                format!("SELECT {COLUMNS} FROM tile t JOIN version v ON v.sequence = t.newest");
            let mut select = self.connection.prepare_cached(&select)?;
            return select.query_map([], read_version)?.collect();
        }
        let select = format!(
            "SELECT {COLUMNS} FROM tile t JOIN version v ON v.sequence = (\
             SELECT max(w.sequence) FROM version w \
             WHERE w.x = t.x AND w.y = t.y AND w.z = t.z AND w.sequence <= ?1)"
        );
        let until = self.until(as_of)?;
        let mut select = self.connection.prepare_cached(&select)?;
        select.query_map([until], read_version)?.collect()
    }

    /// The last sequence number that counts.
    fn until(&self, as_of: AsOf) -> rusqlite::Result<i64> {
        match as_of {
            AsOf::Newest => Ok(i64::MAX),
            AsOf::Sequence(sequence) => Ok(i64::try_from(sequence.0).unwrap_or(i64::MAX)),
            AsOf::Time(at) => {
                let select = "SELECT sequence FROM version WHERE at_ns <= ?1 \
                    ORDER BY at_ns DESC, sequence DESC LIMIT 1";
                let mut select = self.connection.prepare_cached(select)?;
                let found = select
                    .query_row([clamped(at)], |row| row.get(0))
                    .optional()?;
                Ok(found.unwrap_or(0))
            }
        }
    }
}

/// Moments beyond what the file can tell apart, 292 years, are its last.
fn clamped(at: Stamp) -> i64 {
    i64::try_from(at.as_nanos()).unwrap_or(i64::MAX)
}

fn is_within(is: &TileVersion, as_of: AsOf) -> bool {
    match as_of {
        AsOf::Newest => true,
        AsOf::Time(at) => is.at <= at,
        AsOf::Sequence(sequence) => is.sequence <= sequence,
    }
}
