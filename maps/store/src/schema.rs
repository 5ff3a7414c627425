//! The file: what makes it a store, and the tables in it.
//!
//! `version` holds every version that is kept, in the order in which they were put in; `tile` which of them is the newest of
//! each tile. Numbers without a sign are stored as the signed ones with the same bits.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

use maps::tile::TileId;
use maps::time::Stamp;
use rusqlite::{Connection, OpenFlags, Row, TransactionBehavior};

use crate::{Sequence, Settings, StoreError, TileVersion};

/// `TDTL`: marks the file as ours, for `file` too.
const APPLICATION: i64 = 0x5444_544c;
/// Counted up when the tables change.
const SCHEMA: i64 = 1;
/// How long another process may keep us waiting.
const PATIENCE: Duration = Duration::from_secs(5);
const PAGE: u64 = 4096;

const TABLES: &str = "
CREATE TABLE version (
    sequence INTEGER PRIMARY KEY,
    x INTEGER NOT NULL,
    y INTEGER NOT NULL,
    z INTEGER NOT NULL,
    version INTEGER NOT NULL,
    digest INTEGER NOT NULL,
    at_ns INTEGER NOT NULL,     -- never less than that of the row before
    base INTEGER,               -- the sequence that `data` is a change of; NULL if it is whole
    chain INTEGER NOT NULL,     -- changes from a whole one to here
    data BLOB NOT NULL
) STRICT;
CREATE INDEX version_of_tile ON version (x, y, z, sequence);
CREATE INDEX version_at ON version (at_ns, sequence);
CREATE TABLE tile (
    x INTEGER NOT NULL,
    y INTEGER NOT NULL,
    z INTEGER NOT NULL,
    newest INTEGER NOT NULL REFERENCES version (sequence),
    PRIMARY KEY (x, y, z)
) STRICT, WITHOUT ROWID;
";

/// The columns of [`read_version`].
pub(crate) const COLUMNS: &str = "v.x, v.y, v.z, v.version, v.digest, v.sequence, v.at_ns";

/// A row that begins with [`COLUMNS`].
pub(crate) fn read_version(row: &Row<'_>) -> rusqlite::Result<TileVersion> {
    let number = |column| row.get::<_, i64>(column).map(i64::cast_unsigned);
    Ok(TileVersion {
        id: TileId {
            x: row.get(0)?,
            y: row.get(1)?,
            z: row.get(2)?,
        },
        version: number(3)?,
        digest: number(4)?,
        sequence: Sequence(number(5)?),
        at: Stamp::from_nanos(number(6)?),
    })
}

/// Makes sure that no other process has the store.
pub(crate) fn lock(store: &Path) -> Result<File, StoreError> {
    let mut path = store.as_os_str().to_owned();
    path.push(".lock");
    let path = PathBuf::from(path);
    let file = File::options()
        .create(true)
        .write(true)
        .truncate(false)
        .open(&path);
    match file.map(|file| file.try_lock().map(|()| file)) {
        Ok(Ok(file)) => Ok(file),
        Ok(Err(TryLockError::WouldBlock)) => Err(StoreError::Busy {
            path: store.to_owned(),
        }),
        Ok(Err(TryLockError::Error(source))) | Err(source) => {
            Err(StoreError::CannotLock { path, source })
        }
    }
}

/// Opens the file, or makes it.
pub(crate) fn open(path: &Path, settings: &Settings) -> Result<Connection, StoreError> {
    let wrap = |source| StoreError::from_sqlite(path, source);
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
        | OpenFlags::SQLITE_OPEN_CREATE
        | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let mut connection = Connection::open_with_flags(path, flags).map_err(wrap)?;
    connection.busy_timeout(PATIENCE).map_err(wrap)?;
    check(path, &connection)?;
    prepare(&mut connection, settings).map_err(wrap)?;
    check(path, &connection)?;
    Ok(connection)
}

/// The last sequence number and the latest moment.
pub(crate) fn last(connection: &Connection) -> rusqlite::Result<(Sequence, Stamp)> {
    let row = "SELECT coalesce(max(sequence), 0), coalesce(max(at_ns), 0) FROM version";
    let number = |row: &Row<'_>, column| row.get::<_, i64>(column).map(i64::cast_unsigned);
    connection.query_row(row, [], |row| {
        let at = Stamp::from_nanos(number(row, 1)?);
        Ok((Sequence(number(row, 0)?), at))
    })
}

/// Whether it is an empty file or a store that we know.
fn check(path: &Path, connection: &Connection) -> Result<(), StoreError> {
    let wrap = |source| StoreError::from_sqlite(path, source);
    let number = |pragma| connection.pragma_query_value(None, pragma, |row| row.get::<_, i64>(0));
    let tables = "SELECT count(*) FROM sqlite_schema";
    let tables: i64 = connection
        .query_row(tables, [], |row| row.get(0))
        .map_err(wrap)?;
    let application = number("application_id").map_err(wrap)?;
    if tables == 0 && application == 0 {
        return Ok(());
    }
    let path = path.to_owned();
    if application != APPLICATION {
        return Err(StoreError::NotAStore { path });
    }
    let found = number("user_version").map_err(wrap)?;
    if found > SCHEMA {
        return Err(StoreError::NewerSchema {
            path,
            found,
            known: SCHEMA,
        });
    }
    Ok(())
}

fn prepare(connection: &mut Connection, settings: &Settings) -> rusqlite::Result<()> {
    // Takes effect in a file without tables only; gives pages back after a compaction.
    connection.pragma_update(None, "auto_vacuum", "INCREMENTAL")?;
    connection.pragma_update_and_check(None, "journal_mode", "WAL", |_| Ok(()))?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "journal_size_limit", 4 << 20)?;
    if let Some(limit) = settings.limit_bytes {
        let pages = i64::try_from(limit / PAGE).unwrap_or(i64::MAX);
        connection.pragma_update_and_check(None, "max_page_count", pages, |_| Ok(()))?;
    }
    let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    let tables = "SELECT count(*) FROM sqlite_schema";
    if transaction.query_row(tables, [], |row| row.get::<_, i64>(0))? == 0 {
        transaction.execute_batch(TABLES)?;
        transaction.pragma_update(None, "application_id", APPLICATION)?;
        transaction.pragma_update(None, "user_version", SCHEMA)?;
    }
    transaction.commit()
}
