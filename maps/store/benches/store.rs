//! How fast a store opens, takes and gives, and what it takes on disk.
//!
//! `cargo bench -p store` fills a store in a temporary folder with versions of synthetic tiles, 12 m of a street with changes
//! as a vehicle passes, and prints times and sizes. Tiles are encoded within `put` and `tick`, decoded within `tile`.

#![expect(clippy::print_stdout, reason = "a bench reports on its output")]
#![expect(clippy::disallowed_methods, reason = "a bench measures time")]

use std::error::Error;
use std::time::{Duration, Instant};

use maps::scan::Scan;
use maps::tile::{Tile, TileId};
use maps::time::Stamp;
use maps::voxel::{VoxelKey, VoxelMap};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use store::{AsOf, Keep, Settings, Store};

const SEED: u64 = 20_260_613;

/// The versions of a tile that several scans leave: a floor and a wall, seen from ever new places.
fn versions(id: TileId, count: u64) -> Vec<Tile> {
    let mut random = Pcg64::seed_from_u64(SEED ^ u64::from(id.x.unsigned_abs()));
    let mut map = VoxelMap::new(0.1);
    let corner = id.corner();
    let at = |map: &VoxelMap, [x, y, z]: [i32; 3]| {
        map.center_of(VoxelKey::new(corner.x + x, corner.y + y, corner.z + z))
    };
    (1..=count)
        .map(|version| {
            let origin = at(&map, [(version as i32 * 9) % 128, 20, 18]);
            let hits: Vec<_> = (0..3000)
                .map(|_| {
                    let x = random.random_range(0..128);
                    let place = if random.random_range(0..2) == 0 {
                        [x, random.random_range(0..90), 2]
                    } else {
                        [x, 90, random.random_range(2..60)]
                    };
                    at(&map, place)
                })
                .collect();
            map.insert_scan(&Scan {
                at: moment(version),
                ..Scan::new(origin, &hits)
            });
            let mut tile = map.tile(id).unwrap_or_else(|| Tile::unknown(id, 0, 0.1));
            tile.version = version;
            tile
        })
        .collect()
}

fn moment(version: u64) -> Stamp {
    Stamp::from_nanos(version * 1_000_000_000)
}

fn time<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed())
}

fn main() -> Result<(), Box<dyn Error>> {
    let test = std::env::args().any(|argument| argument == "--test");
    let (tiles, count) = if test { (4, 3) } else { (16, 12) };
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("map.store");
    let kinds: Vec<Vec<Tile>> = (0..8.min(tiles))
        .map(|x| versions(TileId { x, y: 0, z: 0 }, count))
        .collect();

    let mut store = Store::open(&path, Settings::default())?;
    let (filled, filling) = time(|| {
        for version in 0..count {
            for x in 0..tiles {
                let id = TileId { x, y: 0, z: 0 };
                let mut tile = kinds[x as usize % kinds.len()][version as usize].clone();
                tile.id = id;
                store.put(&tile, moment(version))?;
            }
            store.tick(moment(version + 1))?;
        }
        store.flush()
    });
    filled?;
    let all = u64::from(tiles.unsigned_abs()) * count;
    println!(
        "{tiles} tiles, {count} versions each, {} known voxels in each newest",
        kinds[0][count as usize - 1].known_count()
    );
    println!("put: {:.0} versions/s", all as f64 / filling.as_secs_f64());
    drop(store);

    let size = |path: &std::path::Path| std::fs::metadata(path).map(|file| file.len());
    println!(
        "file: {} B, {:.0} B a version",
        size(&path)?,
        size(&path)? as f64 / all as f64
    );
    let (opened, opening) = time(|| Store::open(&path, Settings::default()));
    let mut store = opened?;
    println!("open: {:.2} ms", opening.as_secs_f64() * 1e3);
    let (versions, listing) = time(|| store.versions(AsOf::Newest));
    println!(
        "list of {} tiles: {:.2} ms",
        versions?.len(),
        listing.as_secs_f64() * 1e3
    );
    let (regions, digesting) = time(|| store.regions(AsOf::Newest));
    println!(
        "digests of {} regions: {:.2} ms",
        regions?.len(),
        digesting.as_secs_f64() * 1e3
    );
    for (name, as_of) in [
        ("newest", AsOf::Newest),
        ("halfway", AsOf::Time(moment(count / 2))),
    ] {
        let (read, reading) = time(|| {
            let ids = (0..tiles.min(100)).map(|x| TileId { x, y: 0, z: 0 });
            ids.filter(|id| store.tile(*id, as_of).is_ok()).count()
        });
        println!(
            "get, {name}: {:.1} tiles/s",
            read as f64 / reading.as_secs_f64()
        );
    }
    let keep = Keep {
        all_since: moment(count),
        one_per: Duration::from_secs(4),
        nothing_before: Stamp::ZERO,
    };
    let (done, compacting) = time(|| store.compact(&keep));
    let done = done?;
    println!(
        "compaction to {} of {} versions: {:.1} s, file: {} B",
        done.kept,
        done.kept + done.removed,
        compacting.as_secs_f64(),
        size(&path)?
    );
    Ok(())
}
