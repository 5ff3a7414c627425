//! A process that writes to a store is killed, again and again, at any point.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

use maps::tile::{Tile, TileId};
use maps::time::Stamp;
use maps::voxel::{ClassId, LogOdds, Voxel, VoxelKey, VoxelMap};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use store::{AsOf, Keep, Settings, Store};

const KILLS: u64 = 200;
const SEED: u64 = 20_260_611;
const TILES: i32 = 3;
/// Tells the test that it is the process to be killed, and which store to write to.
const STORE: &str = "STORE_CRASH_TEST_FILE";
const ROUND: &str = "STORE_CRASH_TEST_ROUND";
/// What may be lost. The store itself promises half of it.
const LOSS: Duration = Duration::from_secs(1);

/// What a tile is in a version: nobody else may say otherwise.
fn tile(id: TileId, version: u64) -> Tile {
    let mut map = VoxelMap::new(0.1);
    let corner = id.corner();
    for k in 0..60_u64 {
        let turn = version / (1 + k % 9) + k;
        let key = VoxelKey::new(
            corner.x + (k * 7 % 128) as i32,
            corner.y + (k / 8) as i32,
            corner.z + (turn % 3) as i32,
        );
        let voxel = Voxel {
            class: ClassId((turn % 5) as u8),
            ..Voxel::new(LogOdds((turn % 100) as i8 - 35))
        };
        map.set_voxel(key, voxel);
    }
    let mut tile = map.tile(id).expect("it has voxels");
    tile.version = version;
    tile
}

/// A version that the writer has put in, and when by its own clock.
#[derive(Clone, Copy, Debug)]
struct Acknowledged {
    id: TileId,
    version: u64,
    at: Stamp,
}

/// Writes until it is killed. Its clock runs faster than ours: each version takes up to 150 ms of it.
fn write(path: &Path, round: u64) {
    let mut random = Pcg64::seed_from_u64(SEED ^ round << 20);
    let mut store = Store::open(path, Settings::default()).expect("it opens after every crash");
    let newest = store.versions(AsOf::Newest).expect("readable");
    let mut versions: BTreeMap<TileId, u64> = newest.iter().map(|is| (is.id, is.version)).collect();
    let mut now = Stamp::from_nanos(round * 1_000_000_000_000);
    let mut out = std::io::stdout().lock();
    // An end of its own, should nobody kill it.
    for _ in 0..20_000 {
        now += Duration::from_micros(random.random_range(1..150_000));
        let id = TileId {
            x: random.random_range(0..TILES),
            y: 0,
            z: 0,
        };
        let version = versions.entry(id).or_insert(0);
        *version += random.random_range(1..4);
        store.put(&tile(id, *version), now).expect("it is newer");
        store.tick(now).expect("there is space");
        writeln!(out, "ack {} {version} {}", id.x, now.as_nanos()).expect("somebody listens");
        out.flush().expect("somebody listens");
        if random.random_range(0..40) == 0 {
            let keep = Keep {
                all_since: now,
                one_per: Duration::from_secs(2),
                nothing_before: Stamp::from_nanos(now.as_nanos().saturating_sub(3_000_000_000_000)),
            };
            store.compact(&keep).expect("there is space");
        }
    }
}

fn spawn(path: &Path, round: u64) -> (Child, BufReader<ChildStdout>) {
    let this = std::env::current_exe().expect("a test is a program");
    let mut child = Command::new(this)
        .args([
            "a_store_survives_being_killed_at_any_point",
            "--exact",
            "--nocapture",
        ])
        .env(STORE, path)
        .env(ROUND, round.to_string())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("it runs already");
    let out = child.stdout.take().expect("it is a pipe");
    (child, BufReader::new(out))
}

fn parse(line: &str) -> Option<Acknowledged> {
    let mut words = line.strip_prefix("ack ")?.split(' ');
    let x = words.next()?.parse().ok()?;
    let version = words.next()?.parse().ok()?;
    let at = Stamp::from_nanos(words.next()?.parse().ok()?);
    let id = TileId { x, y: 0, z: 0 };
    Some(Acknowledged { id, version, at })
}

/// Runs a writer, kills it after so many versions and a little more, and gives all it has acknowledged.
fn killed(path: &Path, round: u64, random: &mut Pcg64) -> Vec<Acknowledged> {
    let (mut child, mut out) = spawn(path, round);
    let enough = random.random_range(0..20);
    let mut acknowledged = Vec::new();
    let mut line = String::new();
    while acknowledged.len() < enough && out.read_line(&mut line).is_ok_and(|length| length > 0) {
        acknowledged.extend(parse(line.trim_end()));
        line.clear();
    }
    // Spins, so that the kill falls anywhere within the next version or the next batch.
    for _ in 0..random.random_range(0..300_000_u32) {
        std::hint::spin_loop();
    }
    child.kill().expect("it is a child");
    child.wait().expect("it is a child");
    // What it said before it died counts; a line cut short does not.
    while out.read_line(&mut line).is_ok_and(|length| length > 0) {
        if line.ends_with('\n') {
            acknowledged.extend(parse(line.trim_end()));
        }
        line.clear();
    }
    acknowledged
}

/// What is in the store, tile by tile; every tile must be what its version says.
fn newest(path: &Path) -> BTreeMap<TileId, u64> {
    let store = Store::open(path, Settings::default()).expect("it opens after every crash");
    let versions = store.versions(AsOf::Newest).expect("readable");
    for is in &versions {
        let found = store
            .tile(is.id, AsOf::Newest)
            .expect("whole")
            .expect("it is listed");
        let expected = tile(is.id, is.version);
        assert_eq!((found.version, is.digest), (is.version, expected.digest()));
        assert_eq!(
            found, expected,
            "tile {} is not its version {}",
            is.id, is.version
        );
        let history = store.history(is.id).expect("readable");
        let grows = history.windows(2).all(|pair| {
            pair[0].version < pair[1].version
                && pair[0].sequence < pair[1].sequence
                && pair[0].at <= pair[1].at
        });
        assert!(grows, "the history of {} is out of order", is.id);
    }
    versions.iter().map(|is| (is.id, is.version)).collect()
}

#[test]
fn a_store_survives_being_killed_at_any_point() {
    if let (Some(path), Ok(round)) = (std::env::var_os(STORE), std::env::var(ROUND)) {
        return write(Path::new(&path), round.parse().expect("a number"));
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("map.store");
    let mut random = Pcg64::seed_from_u64(SEED);
    let mut before: BTreeMap<TileId, u64> = BTreeMap::new();
    let (mut all, mut lost, mut longest) = (0, 0, Duration::ZERO);
    for round in 1..=KILLS {
        let acknowledged = killed(&path, round, &mut random);
        let now = newest(&path);
        for (id, version) in &before {
            let is = now.get(id).copied().unwrap_or(0);
            assert!(
                is >= *version,
                "round {round}: tile {id} went back from {version} to {is}"
            );
        }
        let end = acknowledged.last().map_or(Stamp::ZERO, |last| last.at);
        all += acknowledged.len();
        for ack in &acknowledged {
            if now.get(&ack.id).copied().unwrap_or(0) < ack.version {
                let age = end.since(ack.at);
                assert!(
                    age <= LOSS,
                    "round {round}: {ack:?} is lost {age:?} before the end"
                );
                lost += 1;
                longest = longest.max(age);
            }
        }
        before = now;
    }
    let store = Store::open(&path, Settings::default()).expect("it opens");
    let kept = store.check().expect("whole to the last version");
    println!(
        "{KILLS} kills, {all} versions acknowledged, {lost} lost, the oldest {longest:?} before the end; {kept} kept"
    );
    assert!(
        all as u64 > 5 * KILLS,
        "{all} acknowledged: the writer got to work"
    );
}
