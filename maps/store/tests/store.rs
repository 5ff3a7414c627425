//! What a store promises, short of a crash.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use maps::scan::Scan;
use maps::tile::{Tile, TileId};
use maps::time::Stamp;
use maps::voxel::{ClassId, LogOdds, Rgb, Sources, Voxel, VoxelKey, VoxelMap};
use store::{AsOf, Keep, RegionId, Sequence, Settings, Store, StoreError};
use tempfile::TempDir;

const HOME: TileId = TileId { x: 0, y: 0, z: 0 };

fn second(n: u64) -> Stamp {
    Stamp::from_nanos(n * 1_000_000_000)
}

/// A tile of a few hundred voxels, of which each version changes some.
fn tile(id: TileId, version: u64) -> Tile {
    let mut map = VoxelMap::new(0.1);
    let corner = id.corner();
    let points: Vec<_> = (0..40)
        .map(|i| {
            map.center_of(VoxelKey::new(
                corner.x + 2 * i,
                corner.y + 50,
                corner.z + i % 7,
            ))
        })
        .collect();
    let origin = map.center_of(VoxelKey::new(corner.x + 20, corner.y + 20, corner.z + 20));
    map.insert_scan(&Scan {
        at: second(version),
        source: Sources::UGV,
        ..Scan::new(origin, &points)
    });
    for k in 0..version.min(60) {
        let z = corner.z + 30 + k as i32;
        let voxel = Voxel {
            color: Some(Rgb([k as u8 * 3, 100, 200])),
            class: ClassId(k as u8 % 4),
            ..Voxel::new(LogOdds(10 + (version % 7) as i8))
        };
        map.set_voxel(VoxelKey::new(corner.x + 3, corner.y + 5, z), voxel);
    }
    let mut tile = map.tile(id).expect("it has voxels");
    tile.version = version;
    tile
}

struct Folder {
    _folder: TempDir,
    path: PathBuf,
}

fn folder() -> Folder {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("map.store");
    Folder {
        _folder: folder,
        path,
    }
}

fn open(path: &Path) -> Store {
    Store::open(path, Settings::default()).expect("a store")
}

/// Three tiles, versions 1 to 20 of each, one a second.
fn filled(path: &Path) -> Store {
    let mut store = open(path);
    for version in 1..=20 {
        for x in 0..3 {
            let id = TileId { x, ..HOME };
            store
                .put(&tile(id, version), second(version))
                .expect("it is newer");
        }
        store.flush().expect("there is space");
    }
    store
}

#[test]
fn every_version_is_there_as_it_was() {
    let folder = folder();
    drop(filled(&folder.path));
    let store = open(&folder.path);
    for x in 0..3 {
        let id = TileId { x, ..HOME };
        let history = store.history(id).expect("readable");
        assert_eq!(history.len(), 20);
        for (is, version) in history.iter().zip(1..) {
            let expected = tile(id, version);
            for as_of in [AsOf::Sequence(is.sequence), AsOf::Time(second(version))] {
                let then = store
                    .tile(id, as_of)
                    .expect("readable")
                    .expect("it was there");
                assert_eq!(then, expected);
                assert_eq!(then.version, version);
                for (key, _) in expected.known() {
                    assert_eq!(then.seen(key), expected.seen(key), "sightings are kept");
                }
            }
        }
        assert_eq!(
            store.tile(id, AsOf::Newest).expect("readable"),
            Some(tile(id, 20))
        );
    }
    let before = AsOf::Time(Stamp::from_nanos(999_999_999));
    assert_eq!(store.tile(HOME, before).expect("readable"), None);
    assert_eq!(store.versions(before).expect("readable"), []);
    assert_eq!(store.check().expect("whole"), 60);
}

#[test]
fn what_waits_can_be_read_and_is_written_when_its_time_has_come() {
    let folder = folder();
    let mut store = open(&folder.path);
    let put =
        |store: &mut Store, version, at| store.put(&tile(HOME, version), Stamp::from_nanos(at));
    put(&mut store, 1, 0).expect("it is new");
    put(&mut store, 2, 499_999_999).expect("it is newer");
    store
        .tick(Stamp::from_nanos(499_999_999))
        .expect("nothing to do");
    assert_eq!(
        store.pending(),
        1,
        "two versions of one tile are one of history"
    );
    assert_eq!(
        store.tile(HOME, AsOf::Newest).expect("readable"),
        Some(tile(HOME, 2))
    );
    assert_eq!(
        store.versions(AsOf::Newest).expect("readable")[0].version,
        2
    );
    store
        .tick(Stamp::from_nanos(500_000_000))
        .expect("there is space");
    assert_eq!(store.pending(), 0);
    assert_eq!(store.history(HOME).expect("readable").len(), 1);
}

#[test]
fn a_version_is_not_overwritten() {
    let folder = folder();
    let mut store = open(&folder.path);
    let five = tile(HOME, 5);
    store.put(&five, second(1)).expect("it is new");
    store
        .put(&five, second(1))
        .expect("the same again is nothing new");
    store.flush().expect("there is space");
    store
        .put(&five, second(2))
        .expect("the same again is nothing new");
    assert_eq!(store.pending(), 0);
    let mut other_five = tile(HOME, 9);
    other_five.version = 5;
    for other in [tile(HOME, 4), other_five] {
        let message = store.put(&other, second(3)).map_err(|e| e.to_string());
        let version = other.version;
        let expected =
            format!("tile 0/0/0: version {version} is not newer than version 5 in the store");
        assert_eq!(message, Err(expected));
    }
}

#[test]
fn changes_take_less_than_whole_tiles_and_their_chains_end() {
    let sizes = [0, 7].map(|chain| {
        let folder = folder();
        let settings = Settings {
            chain,
            ..Settings::default()
        };
        let mut store = Store::open(&folder.path, settings).expect("a store");
        for version in 1..=32 {
            store
                .put(&tile(HOME, version), second(version))
                .expect("it is newer");
            store.flush().expect("there is space");
        }
        let sql = rusqlite::Connection::open(&folder.path).expect("a store is an SQLite file");
        let select = "SELECT sum(length(data)), max(chain), sum(base IS NULL) FROM version";
        let row = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, row.get(1)?, row.get(2)?));
        let (size, longest, whole): (i64, u32, i64) = sql.query_row(select, [], row).expect("rows");
        assert_eq!(longest, chain);
        assert_eq!(whole, 32 / (i64::from(chain) + 1));
        size
    });
    assert!(sizes[1] * 2 < sizes[0], "{sizes:?} bytes");
}

#[test]
fn a_clock_that_goes_back_counts_as_standing_still() {
    let folder = folder();
    let mut store = open(&folder.path);
    store.put(&tile(HOME, 1), second(100)).expect("it is new");
    store.flush().expect("there is space");
    drop(store);
    let mut store = open(&folder.path);
    store.put(&tile(HOME, 2), second(3)).expect("it is newer");
    let newest = store
        .version(HOME, AsOf::Newest)
        .expect("readable")
        .expect("it is there");
    assert_eq!(newest.at, second(100));
    store
        .put(&tile(HOME, 3), Stamp::from_nanos(u64::MAX))
        .expect("it is newer");
    store.flush().expect("there is space");
    let end = AsOf::Time(Stamp::from_nanos(u64::MAX));
    assert_eq!(
        store.tile(HOME, end).expect("readable"),
        Some(tile(HOME, 3))
    );
}

#[test]
fn a_full_disk_is_told_and_nothing_is_lost() {
    let folder = folder();
    let settings = Settings {
        limit_bytes: Some(128 << 10),
        ..Settings::default()
    };
    let mut store = Store::open(&folder.path, settings).expect("a store");
    let mut version = 0;
    let error = loop {
        version += 1;
        store
            .put(&tile(HOME, version), second(version))
            .expect("there is memory");
        if let Err(error) = store.flush() {
            break error;
        }
        assert!(version < 5000, "the limit was reached");
    };
    assert!(
        error.to_string().starts_with("no space left for"),
        "{error}"
    );
    assert_eq!(store.pending(), 1, "the batch waits");
    let newest = store.tile(HOME, AsOf::Newest).expect("readable");
    assert_eq!(newest.map(|tile| tile.version), Some(version));
    assert_eq!(
        store.check().expect("whole") as u64,
        version - 1,
        "all before are there"
    );
    // More tiles are taken as long as memory is to be had for them, then refused.
    let mut taken = 1;
    let refused = loop {
        let id = TileId { x: taken, ..HOME };
        if let Err(error) = store.put(&tile(id, 1), second(version)) {
            break error;
        }
        taken += 1;
        assert!(taken < 1000, "memory is bounded");
    };
    assert!(matches!(refused, StoreError::Full { .. }), "{refused}");
    assert_eq!(store.pending(), taken as usize);
    // Space: history goes, by the hand of whoever runs out of it.
    let sql = rusqlite::Connection::open(&folder.path).expect("a store is an SQLite file");
    sql.execute(
        "DELETE FROM version WHERE sequence < (SELECT max(sequence) FROM version WHERE chain = 0)",
        [],
    )
    .expect("rows");
    drop(sql);
    store.flush().expect("there is space now");
    assert_eq!(store.pending(), 0);
    assert_eq!(
        store.versions(AsOf::Newest).expect("readable").len(),
        taken as usize
    );
    store.check().expect("whole");
}

#[test]
fn a_compaction_keeps_what_it_is_told_and_gives_space_back() {
    let folder = folder();
    let mut store = filled(&folder.path);
    let states: Vec<_> = (1..=20)
        .map(|at| store.tile(HOME, AsOf::Time(second(at))).expect("readable"))
        .collect();
    let size = || fs::metadata(&folder.path).expect("a file").len();
    store
        .compact(&Keep {
            all_since: second(0),
            one_per: Duration::ZERO,
            nothing_before: second(0),
        })
        .expect("nothing to do");
    let before = size();
    let keep = Keep {
        all_since: second(16),
        one_per: Duration::from_secs(5),
        nothing_before: second(7),
    };
    let done = store.compact(&keep).expect("there is space");
    // 9 and 14 are the last of their five seconds; 16 to 20 are all kept; 7 is not the last of any span.
    assert_eq!((done.kept, done.removed, done.damaged), (21, 39, 0));
    let versions: Vec<_> = store
        .history(HOME)
        .expect("readable")
        .iter()
        .map(|is| is.version)
        .collect();
    assert_eq!(versions, [9, 14, 16, 17, 18, 19, 20]);
    for (state, at) in states.iter().zip(1..) {
        let now = store.tile(HOME, AsOf::Time(second(at))).expect("readable");
        if versions.contains(&at) {
            assert_eq!(now, *state, "at {at} s");
        } else {
            let version = now.map(|tile| tile.version);
            assert_eq!(
                version,
                versions.iter().copied().rfind(|v| *v < at),
                "an older one in between"
            );
        }
    }
    assert!(size() < before, "{} bytes, {before} before", size());
    assert_eq!(store.check().expect("whole"), 21);
    // What is put in afterwards goes on from there.
    store.put(&tile(HOME, 21), second(21)).expect("it is newer");
    store.flush().expect("there is space");
    assert_eq!(
        store.tile(HOME, AsOf::Newest).expect("readable"),
        Some(tile(HOME, 21))
    );
}

#[test]
fn two_stores_find_where_they_differ_by_region() {
    let (one, other) = (folder(), folder());
    let (mut one, mut other) = (filled(&one.path), filled(&other.path));
    assert_eq!(
        one.regions(AsOf::Newest).expect("readable"),
        other.regions(AsOf::Newest).expect("readable")
    );
    let far = TileId { x: -9, y: 8, z: 0 };
    one.put(&tile(far, 1), second(30)).expect("it is new");
    other.put(&tile(far, 2), second(30)).expect("it is new");
    let regions = [&one, &other].map(|store| store.regions(AsOf::Newest).expect("readable"));
    assert_eq!(regions[0].len(), 2);
    assert_eq!(regions[0][1], regions[1][1], "the same");
    assert_ne!(regions[0][0].digest, regions[1][0].digest);
    assert_eq!(regions[0][0].id, RegionId { x: -2, y: 1, z: 0 });
    let tiles = one
        .versions_in(RegionId::of(far), AsOf::Newest)
        .expect("readable");
    assert_eq!(tiles.iter().map(|is| is.id).collect::<Vec<_>>(), [far]);
}

#[track_caller]
#[expect(
    clippy::unnecessary_debug_formatting,
    reason = "as the errors quote it"
)]
fn check_refused(path: &Path, ending: &str) {
    let Err(error) = Store::open(path, Settings::default()) else {
        panic!("it was opened");
    };
    let expected = format!("{path:?}{ending}");
    assert!(error.to_string().ends_with(&expected), "{error}");
}

#[test]
fn files_that_are_no_store_are_left_alone() {
    let folder = folder();
    let not_ours = " is not a tile store: give another path, or move the file away";
    let text = "a letter to somebody, as long as a page of a database would be".repeat(100);
    fs::write(&folder.path, &text).expect("written");
    check_refused(&folder.path, not_ours);
    assert_eq!(fs::read_to_string(&folder.path).expect("there"), text);

    fs::remove_file(&folder.path).expect("removed");
    let sql = rusqlite::Connection::open(&folder.path).expect("opened");
    sql.execute_batch("CREATE TABLE accounts (id INTEGER)")
        .expect("made");
    drop(sql);
    let before = fs::read(&folder.path).expect("there");
    check_refused(&folder.path, not_ours);
    assert_eq!(fs::read(&folder.path).expect("there"), before);
}

#[test]
fn a_newer_schema_is_refused_by_name() {
    let folder = folder();
    drop(filled(&folder.path));
    let sql = rusqlite::Connection::open(&folder.path).expect("opened");
    sql.pragma_update(None, "user_version", 9).expect("updated");
    drop(sql);
    check_refused(
        &folder.path,
        " has schema 9, this program knows up to schema 1: use a newer program",
    );
}

#[test]
fn a_store_has_one_owner() {
    let folder = folder();
    let first = open(&folder.path);
    check_refused(&folder.path, " open: stop it, or give another path");
    drop(first);
    open(&folder.path);
}

#[test]
fn a_missing_folder_is_told() {
    let folder = folder();
    let path = folder.path.join("nowhere").join("map.store");
    let Err(error) = Store::open(&path, Settings::default()) else {
        panic!("it was opened");
    };
    assert!(
        error.to_string().contains("check that the folder exists"),
        "{error}"
    );
}

/// Every page is overwritten in turn: what is read then is what was put in, or an error.
#[test]
fn a_damaged_file_never_gives_another_tile() {
    let folder = folder();
    let mut store = filled(&folder.path);
    let keep = Keep {
        all_since: second(0),
        one_per: Duration::ZERO,
        nothing_before: second(0),
    };
    store.compact(&keep).expect("the log is in the file");
    let sequences: Vec<Sequence> = store
        .history(HOME)
        .expect("readable")
        .iter()
        .map(|is| is.sequence)
        .collect();
    drop(store);
    let whole = fs::read(&folder.path).expect("there");
    let mut errors = 0;
    for page in 0..whole.len() / 4096 {
        let mut damaged = whole.clone();
        damaged[page * 4096 + 700..][..1800].fill(0x5a);
        fs::write(&folder.path, damaged).expect("written");
        let Ok(store) = Store::open(&folder.path, Settings::default()) else {
            errors += 1;
            continue;
        };
        for (sequence, version) in sequences.iter().zip(1..) {
            match store.tile(HOME, AsOf::Sequence(*sequence)) {
                Ok(Some(found)) if found.version == version => {
                    assert_eq!(found, tile(HOME, version));
                }
                // A damaged index may hide a version, which is not the same as to change it.
                Ok(Some(found)) => assert_eq!(found, tile(HOME, found.version)),
                Ok(None) => errors += 1,
                Err(error) => {
                    errors += 1;
                    let text = error.to_string();
                    assert!(
                        text.contains("damaged") || text.contains("digest"),
                        "{text}"
                    );
                }
            }
        }
    }
    assert!(errors > 20, "{errors} errors: damage is noticed");
}
