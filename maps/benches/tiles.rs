//! What tiles take on a link, against `OctoMap` files compressed by zstd at level 19, of the same maps.
//!
//! `cargo bench -p maps --bench tiles -- --data DIR` prints, for each map, the bytes of the `.bt` and the `.ot` file (pruned,
//! as liboctomap writes them: the tests of the crate `octomap` compare) after zstd, the bytes of all tiles with each
//! detail, headers included, and how fast they are encoded and decoded on one thread. Then the same for changes: each sweep
//! of a recording against the map before it. Everything that is encoded is decoded and compared.
//!
//! The real maps are in DIR: `lidar/kitti_0926` (13 sweeps of a 64-beam LiDAR and their poses) and `octomap/geb079.bt`. They
//! are left out where DIR, by default `shared/data` beside the repository, is missing. The synthetic ones are seeded.
//! Speeds count the size of the `.ot` file, uncompressed.

#![expect(clippy::print_stdout, reason = "a bench reports on its output")]
#![expect(clippy::disallowed_methods, reason = "a bench measures time")]

use std::error::Error;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use maps::frame::{Point, World};
use maps::scan::Scan;
use maps::tile::{Detail, Tile};
use maps::time::Stamp;
use maps::voxel::{ClassId, Rgb, Sources, VoxelMap};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

const LEVEL: i32 = 19;
const RESOLUTION_M: f64 = 0.1;
const MAX_RANGE_M: f64 = 30.0;
const SEED: u64 = 20_260_612;

/// One sweep of a LiDAR, in the world.
struct Sweep {
    origin: Point<World>,
    hits: Vec<Point<World>>,
    colors: Vec<Rgb>,
    classes: Vec<ClassId>,
}

impl Sweep {
    fn insert(&self, map: &mut VoxelMap, number: usize) {
        map.insert_scan(&Scan {
            colors: &self.colors,
            classes: &self.classes,
            max_range_m: MAX_RANGE_M,
            at: Stamp::from_nanos(number as u64 * 500_000_000),
            source: Sources::UGV,
            ..Scan::new(self.origin, &self.hits)
        });
    }
}

fn kitti(folder: &Path) -> Result<Vec<Sweep>, Box<dyn Error>> {
    let poses = std::fs::read_to_string(folder.join("poses.txt"))?;
    let mut sweeps = Vec::new();
    for (number, line) in poses.lines().enumerate() {
        let numbers: Result<Vec<f64>, _> = line.split_whitespace().map(str::parse).collect();
        let m: [f64; 12] = numbers?
            .try_into()
            .map_err(|_not_12: Vec<f64>| "a pose has 12 numbers")?;
        let bytes = std::fs::read(folder.join(format!("{:010}.bin", number * 5)))?;
        let (points, _) = bytes.as_chunks::<16>();
        let hits = points.iter().map(|point| {
            let [x, y, z] = [0, 4, 8]
                .map(|at| f64::from(f32::from_le_bytes(std::array::from_fn(|i| point[at + i]))));
            let [x, y, z] =
                [0, 4, 8].map(|row| m[row] * x + m[row + 1] * y + m[row + 2] * z + m[row + 3]);
            Point::new(x, y, z)
        });
        sweeps.push(Sweep {
            origin: Point::new(m[3], m[7], m[11]),
            hits: hits.collect(),
            colors: Vec::new(),
            classes: Vec::new(),
        });
    }
    Ok(sweeps)
}

/// A box with faces along the axes, its colour and its class.
struct Solid {
    low: [f64; 3],
    high: [f64; 3],
    color: [u8; 3],
    class: u8,
}

/// A street 80 m long between houses, with cars, poles and trees' crowns, seen by a LiDAR of `beams` beams that drives along.
fn street(beams: u32, columns: u32, sweeps: u32) -> Vec<Sweep> {
    let mut random = Pcg64::seed_from_u64(SEED);
    let mut solids = vec![Solid {
        low: [-40.0, -40.0, -1.0],
        high: [60.0, 40.0, 0.0],
        color: [90, 90, 95],
        class: 1,
    }];
    let mut add = |center: [f64; 2], size: [f64; 2], z: [f64; 2], class: u8| {
        let color = std::array::from_fn(|_| random.random_range(40..220));
        solids.push(Solid {
            low: [center[0] - size[0] / 2.0, center[1] - size[1] / 2.0, z[0]],
            high: [center[0] + size[0] / 2.0, center[1] + size[1] / 2.0, z[1]],
            color,
            class,
        });
    };
    for i in 0..8 {
        let x = f64::from(i) * 10.0 - 30.0;
        for side in [-1.0, 1.0] {
            let depth = 9.0 + f64::from(i % 3) * 0.7;
            add(
                [x, side * (9.0 + depth / 2.0)],
                [9.3, depth],
                [0.0, 6.0 + f64::from(i % 4)],
                2,
            );
            add([x + 3.3, side * 5.1], [4.2, 1.8], [0.3, 1.5], 3);
            add([x - 2.1, side * 7.0], [0.2, 0.2], [0.0, 5.0], 4);
            add([x - 2.1, side * 7.0], [2.1, 2.3], [3.0, 5.2], 5);
        }
    }
    let along = |sweep| f64::from(sweep) * 1.3 - 8.0;
    let cast = |sweep| {
        scanned(
            &solids,
            [along(sweep), -1.6, 1.8],
            beams,
            columns,
            &mut Pcg64::seed_from_u64(SEED + u64::from(sweep)),
        )
    };
    (0..sweeps).map(cast).collect()
}

fn scanned(
    solids: &[Solid],
    from: [f64; 3],
    beams: u32,
    columns: u32,
    random: &mut Pcg64,
) -> Sweep {
    let mut sweep = Sweep {
        origin: Point::new(from[0], from[1], from[2]),
        hits: Vec::new(),
        colors: Vec::new(),
        classes: Vec::new(),
    };
    for beam in 0..beams {
        let pitch = (2.0 - 26.8 * f64::from(beam) / f64::from(beams)).to_radians();
        for column in 0..columns {
            let yaw = std::f64::consts::TAU * f64::from(column) / f64::from(columns);
            let ray = [
                pitch.cos() * yaw.cos(),
                pitch.cos() * yaw.sin(),
                pitch.sin(),
            ];
            let entries = solids
                .iter()
                .filter_map(|solid| Some((entry(solid, from, ray)?, solid)));
            let nearest = entries.min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((range, solid)) = nearest else {
                continue;
            };
            let range = range + random.random_range(-0.02..0.02);
            let [x, y, z]: [f64; 3] = std::array::from_fn(|i| from[i] + ray[i] * range);
            sweep.hits.push(Point::new(x, y, z));
            let shade = random.random_range(0..12);
            sweep.colors.push(Rgb(solid.color.map(|c| c + shade)));
            sweep.classes.push(ClassId(solid.class));
        }
    }
    sweep
}

/// How far along a ray a box begins.
fn entry(solid: &Solid, from: [f64; 3], ray: [f64; 3]) -> Option<f64> {
    let (mut near, mut far) = (0.0_f64, 80.0_f64);
    for axis in 0..3 {
        let bounds = [solid.low[axis], solid.high[axis]].map(|at| (at - from[axis]) / ray[axis]);
        near = near.max(bounds[0].min(bounds[1]));
        far = far.min(bounds[0].max(bounds[1]));
    }
    (near < far).then_some(near)
}

fn zstd_size(bytes: &[u8]) -> Result<usize, Box<dyn Error>> {
    Ok(zstd::bulk::compress(bytes, LEVEL)?.len())
}

/// Bytes and time.
#[derive(Clone, Copy, Default)]
struct Cost {
    bytes: usize,
    encoding: Duration,
    decoding: Duration,
}

/// All tiles of a map with this detail, decoded and compared.
fn whole(map: &VoxelMap, detail: Detail) -> Result<Cost, Box<dyn Error>> {
    let mut cost = Cost::default();
    for tile in map.tile_ids().into_iter().filter_map(|id| map.tile(id)) {
        let start = Instant::now();
        let bytes = tile.encode_as(detail);
        cost.encoding += start.elapsed();
        let start = Instant::now();
        let decoded = Tile::decode(&bytes)?;
        cost.decoding += start.elapsed();
        cost.bytes += bytes.len();
        if decoded != tile.reduced(detail) {
            return Err(format!("tile {} came back as another", tile.id).into());
        }
    }
    Ok(cost)
}

fn report(name: &str, map: &VoxelMap) -> Result<(), Box<dyn Error>> {
    let (mut bt, mut ot) = (Vec::new(), Vec::new());
    octomap::write_bt(map, &mut bt)?;
    octomap::write_ot(map, &mut ot)?;
    let rivals = [zstd_size(&bt)?, zstd_size(&ot)?];
    println!(
        "\n{name}: {} tiles, {} known voxels, {} occupied",
        map.tile_ids().len(),
        map.known_count(),
        map.occupied_count()
    );
    println!(
        "  .bt {:>9} B, with zstd -{LEVEL} {:>8} B",
        bt.len(),
        rivals[0]
    );
    println!(
        "  .ot {:>9} B, with zstd -{LEVEL} {:>8} B",
        ot.len(),
        rivals[1]
    );
    for detail in Detail::ALL {
        let cost = whole(map, detail)?;
        let (rival, file) = if detail == Detail::State {
            (rivals[0], ".bt")
        } else {
            (rivals[1], ".ot")
        };
        let speed = |time: Duration| ot.len() as f64 * 1e-6 / time.as_secs_f64();
        println!(
            "  tiles, {:<9} {:>9} B = {:.3} of {file} + zstd; {:.1} MB/s encoded, {:.1} MB/s decoded",
            format!("{detail:?}"),
            cost.bytes,
            cost.bytes as f64 / rival as f64,
            speed(cost.encoding),
            speed(cost.decoding),
        );
    }
    Ok(())
}

/// Each sweep's changed tiles: whole, and as a change of what they were before it.
fn report_changes(name: &str, sweeps: &[Sweep]) -> Result<(), Box<dyn Error>> {
    println!("\n{name}: tiles changed by a sweep, bytes a tile");
    for detail in Detail::ALL {
        let mut map = VoxelMap::new(RESOLUTION_M);
        let (mut tiles, mut whole, mut change) = (0, 0, Cost::default());
        for (number, sweep) in sweeps.iter().enumerate() {
            let before = map.clone();
            sweep.insert(&mut map, number);
            for id in map.take_changed_tiles() {
                let (Some(base), Some(tile)) = (before.tile(id), map.tile(id)) else {
                    continue;
                };
                let start = Instant::now();
                let bytes = tile.encode_change(&base, detail);
                change.encoding += start.elapsed();
                let start = Instant::now();
                let decoded = Tile::decode_change(&bytes, &base)?;
                change.decoding += start.elapsed();
                if decoded != tile.reduced(detail) {
                    return Err(format!("a change of tile {id} came back as another").into());
                }
                tiles += 1;
                change.bytes += bytes.len();
                whole += tile.encode_as(detail).len();
            }
        }
        let each = |bytes: usize| bytes as f64 / f64::from(tiles.max(1));
        let speed = |time: Duration| f64::from(tiles) / time.as_secs_f64();
        println!(
            "  {:<9} whole {:>7.0} B, change {:>7.0} B = {:.3}; {:.0} tiles/s encoded, {:.0} tiles/s decoded ({tiles} tiles)",
            format!("{detail:?}"),
            each(whole),
            each(change.bytes),
            change.bytes as f64 / whole as f64,
            speed(change.encoding),
            speed(change.decoding),
        );
    }
    Ok(())
}

fn built(sweeps: &[Sweep]) -> VoxelMap {
    let mut map = VoxelMap::new(RESOLUTION_M);
    for (number, sweep) in sweeps.iter().enumerate() {
        sweep.insert(&mut map, number);
    }
    map
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.iter().any(|argument| argument == "--test") {
        let sweeps = street(8, 90, 2);
        report("a small street", &built(&sweeps))?;
        return report_changes("a small street", &sweeps);
    }
    let named = arguments.windows(2).find(|pair| pair[0] == "--data");
    let data = named.map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        |pair| PathBuf::from(&pair[1]),
    );
    let street = street(64, 1800, 10);
    report(
        "synthetic street, colours and classes, 10 sweeps",
        &built(&street),
    )?;
    report_changes("synthetic street", &street)?;
    if !data.is_dir() {
        println!("\nno {}: the real maps are left out", data.display());
        return Ok(());
    }
    let building = File::open(data.join("octomap/geb079.bt"))?;
    let building = octomap::read_bt(BufReader::new(building))?;
    report("geb079.bt, a building", &building)?;
    let sweeps = kitti(&data.join("lidar/kitti_0926"))?;
    report("KITTI 2011_09_26, 1 sweep", &built(&sweeps[..1]))?;
    report("KITTI 2011_09_26, 13 sweeps", &built(&sweeps))?;
    report_changes("KITTI 2011_09_26", &sweeps)
}
