//! One scene, all libraries, one table.

use std::hint::black_box;
use std::path::PathBuf;

use maps::frame::{Point, Vector, World};
use maps::scan::{Carving, Rays, Scan};
use maps::voxel::{Occupancy, VoxelKey, VoxelMap};
use octomap::referee::{Insertion, Referee};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use crate::measure::{median, peak, thread_s, timed, wall_s, weighed};
use crate::scenes::Scene;

pub(crate) const RESOLUTION_M: f64 = 0.1;
const QUERIES: usize = 1_000_000;
const RAYS: usize = 20_000;
/// How often threads are timed for each repeat of the rest.
const THREAD_REPEATS: usize = 5;

pub(crate) struct Settings {
    pub(crate) scene: Option<String>,
    pub(crate) sweeps: usize,
    pub(crate) repeats: usize,
    pub(crate) data: PathBuf,
    pub(crate) rivals: bool,
    pub(crate) child: Option<String>,
}

/// How we insert: as one of liboctomap's modes does, or so that thin surfaces survive.
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct Ours(pub(crate) Rays, pub(crate) Carving);

impl Ours {
    pub(crate) const ALL: [(Self, &str, Option<Insertion>); 3] = [
        (
            Self(Rays::EachPoint, Carving::EveryVoxel),
            "ours, each point",
            Some(Insertion::Plain),
        ),
        (
            Self(Rays::EachVoxel, Carving::EveryVoxel),
            "ours, each voxel",
            Some(Insertion::Discretized),
        ),
        (
            Self(Rays::EachVoxel, Carving::SparesSurfaces),
            "ours, spares surfaces",
            None,
        ),
    ];

    pub(crate) fn insert(self, map: &mut VoxelMap, scene: &Scene) {
        for sweep in &scene.sweeps {
            map.insert_scan(&Scan {
                max_range_m: scene.max_range_m,
                rays: self.0,
                carving: self.1,
                ..Scan::new(sweep.origin, &sweep.points)
            });
        }
    }
}

/// CPU seconds of the insertion alone: handing over the points is not timed.
pub(crate) fn insert_octomap(tree: &mut Referee, scene: &Scene, mode: Insertion) -> f64 {
    let mut seconds = 0.0;
    for sweep in &scene.sweeps {
        tree.set_cloud(&sweep.floats);
        let origin = sweep.origin_f32();
        seconds += timed(|| tree.insert_cloud(origin, scene.max_range_m, mode)).0;
    }
    tree.set_cloud(&[]);
    if mode == Insertion::DiscretizedLazy {
        seconds += timed(|| tree.update_inner()).0;
    }
    seconds
}

/// The rows of a table that are timed.
#[derive(Default)]
struct Row {
    insert_s: Vec<f64>,
    uniform_s: Vec<f64>,
    near_s: Vec<f64>,
    cast_s: Vec<f64>,
    heap: usize,
    hits: usize,
}

pub(crate) fn run(scene: &Scene, settings: &Settings) {
    println!(
        "\n{}: {} sweeps, {} points, {} m range, {RESOLUTION_M} m voxels",
        scene.name,
        scene.sweeps.len(),
        scene.points(),
        scene.max_range_m,
    );
    let modes: &[Insertion] = if settings.rivals {
        &[
            Insertion::Plain,
            Insertion::Discretized,
            Insertion::DiscretizedLazy,
        ]
    } else {
        &[]
    };
    let mut ours: Vec<Row> = Ours::ALL.iter().map(|_| Row::default()).collect();
    let mut theirs: Vec<Row> = modes.iter().map(|_| Row::default()).collect();
    let mut probes = None;
    for repeat in 0..settings.repeats {
        let mut maps = Vec::new();
        for ((how, ..), row) in Ours::ALL.iter().zip(&mut ours) {
            let (heap, map) = weighed(|| {
                let mut map = VoxelMap::new(RESOLUTION_M);
                row.insert_s.push(timed(|| how.insert(&mut map, scene)).0);
                map.forget_scratch();
                map
            });
            row.heap = heap;
            let probes = probes.get_or_insert_with(|| Probes::new(&map, scene));
            probes.time_ours(&map, row);
            maps.push(map);
        }
        let probes = probes.get_or_insert_with(|| Probes::new(&maps[0], scene));
        for (mode, row) in modes.iter().zip(&mut theirs) {
            let (heap, tree) = weighed(|| {
                let mut tree = Referee::new(RESOLUTION_M);
                row.insert_s.push(insert_octomap(&mut tree, scene, *mode));
                tree
            });
            row.heap = heap;
            probes.time_octomap(&tree, row);
            if repeat == 0 {
                for ((_, name, same), map) in Ours::ALL.iter().zip(&maps) {
                    let found = Agreement::of(map, &tree);
                    println!(
                        "{name} and octomap {mode:?}: IoU of occupied {:.4}, of free {:.4}",
                        found.occupied, found.free
                    );
                    let same = *same == Some(*mode);
                    assert!(
                        !same || found.occupied >= 0.98,
                        "maps must agree before their speed is compared"
                    );
                }
            }
            if repeat == 0 && *mode == Insertion::Plain {
                files(&maps[0], tree);
            }
        }
    }
    table(scene, &ours, modes, &theirs);
    threads(scene, settings);
    if settings.rivals {
        let peaks = ["nothing", "ours", "octomap"].map(|who| peak(who, scene, settings));
        let [base, one, other] = peaks.map(|p| p.unwrap_or_default() as f64 / 1e6);
        println!(
            "peak resident memory, above that of the points: ours {:.0} MB, octomap {:.0} MB",
            one - base,
            other - base
        );
    }
}

fn table(scene: &Scene, ours: &[Row], modes: &[Insertion], theirs: &[Row]) {
    println!(
        "                              Mpts/s  heap MB   queries M/s: uniform  near   rays k/s    hit"
    );
    let line = |name: &str, row: &Row| {
        println!(
            "{name:<26} {:>9.3} {:>8.2} {:>22.1} {:>5.1} {:>10.1} {:.4}",
            scene.points() as f64 / median(row.insert_s.clone()) * 1e-6,
            row.heap as f64 / 1e6,
            QUERIES as f64 / median(row.uniform_s.clone()) * 1e-6,
            QUERIES as f64 / median(row.near_s.clone()) * 1e-6,
            RAYS as f64 / median(row.cast_s.clone()) * 1e-3,
            row.hits as f64 / RAYS as f64,
        );
    };
    for ((_, name, _), row) in Ours::ALL.iter().zip(ours) {
        line(name, row);
    }
    for (mode, row) in modes.iter().zip(theirs) {
        line(&format!("octomap {mode:?}"), row);
    }
    for ((_, name, same), row) in Ours::ALL.iter().zip(ours) {
        for (mode, their) in modes.iter().zip(theirs) {
            let ratio =
                |of: fn(&Row) -> &Vec<f64>| median(of(their).clone()) / median(of(row).clone());
            println!(
                "{name} / octomap {mode:?}{}: insertion ×{:.1}, ray casts ×{:.1}, memory ×{:.3}",
                if *same == Some(*mode) {
                    " (the same rays)"
                } else {
                    ""
                },
                ratio(|row| &row.insert_s),
                ratio(|row| &row.cast_s),
                row.heap as f64 / their.heap as f64
            );
        }
    }
}

/// Where the maps are asked.
struct Probes {
    uniform: Vec<VoxelKey>,
    near: Vec<VoxelKey>,
    origin: Point<World>,
    origin_f32: [f32; 3],
    directions: Vec<f32>,
    range_m: f64,
}

impl Probes {
    fn new(map: &VoxelMap, scene: &Scene) -> Self {
        let mut random = Pcg64::seed_from_u64(7);
        let origin = VoxelKey::new(0, 0, 0);
        let (low, high) = map.bounds().unwrap_or((origin, origin));
        let within = |random: &mut Pcg64, low: i32, high: i32| random.random_range(low..=high);
        let uniform = (0..QUERIES)
            .map(|_| {
                let x = within(&mut random, low.x, high.x);
                let y = within(&mut random, low.y, high.y);
                VoxelKey::new(x, y, within(&mut random, low.z, high.z))
            })
            .collect();
        let surface: Vec<_> = map.occupied().map(|(key, _)| key).collect();
        let near = (0..QUERIES)
            .map(|_| {
                let key = surface[random.random_range(0..surface.len())];
                let [x, y, z] = [key.x, key.y, key.z].map(|c| c + within(&mut random, -2, 2));
                VoxelKey::new(x, y, z)
            })
            .collect();
        let directions = (0..RAYS)
            .flat_map(|_| {
                let z: f64 = random.random_range(-1.0..1.0);
                let (s, c) = random.random_range(0.0..std::f64::consts::TAU).sin_cos();
                let flat = (1.0 - z * z).sqrt();
                [flat * c, flat * s, z].map(|c| c as f32)
            })
            .collect();
        let middle = &scene.sweeps[scene.sweeps.len() / 2];
        Self {
            uniform,
            near,
            origin: middle.origin,
            origin_f32: middle.origin_f32(),
            directions,
            range_m: scene.max_range_m,
        }
    }

    fn time_ours(&self, map: &VoxelMap, row: &mut Row) {
        let count = |keys: &[VoxelKey]| {
            let is_occupied = |key: &&VoxelKey| map.occupancy(**key) == Occupancy::Occupied;
            timed(|| black_box(keys.iter().filter(is_occupied).count())).0
        };
        row.uniform_s.push(count(&self.uniform));
        row.near_s.push(count(&self.near));
        let (seconds, hits) = timed(|| {
            self.directions
                .chunks_exact(3)
                .filter(|d| {
                    let [x, y, z] = [d[0], d[1], d[2]].map(f64::from);
                    let hit = map.cast_ray(self.origin, Vector::new(x, y, z), self.range_m);
                    black_box(hit).is_some()
                })
                .count()
        });
        row.cast_s.push(seconds);
        row.hits = hits;
    }

    fn time_octomap(&self, tree: &Referee, row: &mut Row) {
        let flat = |keys: &[VoxelKey]| {
            keys.iter()
                .flat_map(|k| [k.x, k.y, k.z])
                .collect::<Vec<_>>()
        };
        let count = |keys: Vec<i32>| timed(|| black_box(tree.count_occupied(&keys))).0;
        row.uniform_s.push(count(flat(&self.uniform)));
        row.near_s.push(count(flat(&self.near)));
        let (seconds, distances) =
            timed(|| tree.cast_rays(self.origin_f32, &self.directions, self.range_m));
        row.cast_s.push(seconds);
        row.hits = distances.iter().filter(|d| **d >= 0.0).count();
    }
}

/// Intersections over unions of what is occupied and of what is free in both maps.
struct Agreement {
    occupied: f64,
    free: f64,
}

impl Agreement {
    fn of(map: &VoxelMap, tree: &Referee) -> Self {
        let (mut keys, mut states) = (Vec::new(), Vec::new());
        for (key, voxel) in map.known() {
            keys.extend([key.x, key.y, key.z]);
            states.push(voxel.occupancy());
        }
        let judged = tree.occupancies(&keys);
        let iou = |which: Occupancy, theirs: u64| {
            let pairs = states.iter().zip(&judged);
            let both = pairs.filter(|(a, b)| **a == which && **b == which).count();
            let ours = states.iter().filter(|state| **state == which).count();
            both as f64 / (ours + theirs as usize - both) as f64
        };
        let occupied = tree.occupied_count();
        Self {
            occupied: iou(Occupancy::Occupied, occupied),
            free: iou(Occupancy::Free, tree.known_count() - occupied),
        }
    }
}

/// Bytes on disk of the same map. Writing `.bt` makes the tree forget how sure it was, so it is used up.
fn files(map: &VoxelMap, mut tree: Referee) {
    let tiles: usize = map
        .tile_ids()
        .into_iter()
        .filter_map(|id| map.tile(id))
        .map(|tile| tile.encode().len())
        .sum();
    let Ok(folder) = tempfile::tempdir() else {
        return;
    };
    let size = |name: &str| {
        let length = std::fs::metadata(folder.path().join(name)).map(|m| m.len());
        length.unwrap_or_default() as f64 / 1e6
    };
    let written = [
        tree.write_ot(&folder.path().join("map.ot")),
        tree.write_bt(&folder.path().join("map.bt")),
    ];
    if written.iter().all(Result::is_ok) {
        println!(
            "on disk: tiles {:.3} MB (log-odds included), octomap .ot {:.3} MB, .bt {:.3} MB (free and occupied only)",
            tiles as f64 / 1e6,
            size("map.ot"),
            size("map.bt")
        );
    }
}

/// One thread against two, on the wall and by the busiest thread's CPU time. Beside it, what two threads do that have nothing to
/// do with each other, each with a map of its own: no program gets more out of the machine's cores, caches and memory.
fn threads(scene: &Scene, settings: &Settings) {
    let Ok(pools) = [1, 2]
        .into_iter()
        .map(|n| rayon::ThreadPoolBuilder::new().num_threads(n).build())
        .collect::<Result<Vec<_>, _>>()
    else {
        return;
    };
    let mut digests = Vec::new();
    let (mut walls, mut busiest) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    let mut apart = Vec::new();
    // They take turns, so that what disturbs one disturbs the other.
    for _ in 0..THREAD_REPEATS * settings.repeats {
        for (i, pool) in pools.iter().enumerate() {
            let mut map = VoxelMap::new(RESOLUTION_M);
            let before = pool.broadcast(|_| thread_s());
            let start = wall_s();
            pool.install(|| Ours::ALL[0].0.insert(&mut map, scene));
            walls[i].push(wall_s() - start);
            let after = pool.broadcast(|_| thread_s());
            let busy = before.iter().zip(after).map(|(b, a)| a - b);
            busiest[i].push(busy.fold(0.0, f64::max));
            digests.push(map.digest());
        }
        let start = wall_s();
        std::thread::scope(|both| {
            for _ in 0..2 {
                both.spawn(|| {
                    Ours::ALL[0]
                        .0
                        .insert(&mut VoxelMap::new(RESOLUTION_M), scene);
                });
            }
        });
        apart.push(wall_s() - start);
    }
    assert!(
        digests.windows(2).all(|d| d[0] == d[1]),
        "threads change nothing"
    );
    let [one, two] = &walls;
    let ratio = |by: &[f64]| median(one.iter().zip(by).map(|(one, by)| one / by).collect());
    let best = |of: &[f64]| of.iter().copied().fold(f64::INFINITY, f64::min);
    let [busy_one, busy_two] = busiest;
    println!(
        "two threads: ×{:.2} on the wall (×{:.2} the best of each), ×{:.2} by the busiest thread's CPU time; the maps are equal",
        ratio(two),
        best(one) / best(two),
        median(busy_one) / median(busy_two)
    );
    println!(
        "two threads that share nothing, each with a map of its own: ×{:.2} on the wall (×{:.2} the best of each)",
        2.0 * ratio(&apart),
        2.0 * best(one) / best(&apart)
    );
}
