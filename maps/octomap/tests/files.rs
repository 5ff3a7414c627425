//! Our files before the judge: liboctomap reads what we write and we read what it writes, voxel for voxel.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};

use maps::frame::Point;
use maps::scan::Scan;
use maps::voxel::{LogOdds, Occupancy, Voxel, VoxelKey, VoxelMap};
use octomap::referee::Referee;
use octomap::{ReadError, read_bt, read_ot, write_bt, write_ot};
use proptest::prelude::*;

fn any_map() -> impl Strategy<Value = VoxelMap> {
    let key = prop::array::uniform3(-40..40).prop_map(|[x, y, z]| VoxelKey::new(x, y, z));
    let voxels = prop::collection::vec((key, -40..=70_i8), 0..200);
    // Boxes of equal voxels, so that there is something to prune.
    let boxes = prop::collection::vec((prop::array::uniform3(-5..3), 1..4_u32, -40..=70_i8), 0..4);
    (voxels, boxes, prop::sample::select(vec![0.05, 0.1, 0.08])).prop_map(
        |(voxels, boxes, resolution_m)| {
            let mut map = VoxelMap::new(resolution_m);
            let mut set = |key, steps| {
                let log_odds = LogOdds(steps);
                map.set_voxel(key, Voxel::new(log_odds));
            };
            for ([x, y, z], level, steps) in boxes {
                let edge = 1 << level;
                for i in 0..edge * edge * edge {
                    let key = VoxelKey::new(
                        x * edge + i % edge,
                        y * edge + i / edge % edge,
                        z * edge + i / edge / edge,
                    );
                    set(key, steps);
                }
            }
            for (key, steps) in voxels {
                set(key, steps);
            }
            map
        },
    )
}

fn write(map: &VoxelMap, folder: &Path) -> (PathBuf, PathBuf) {
    let (ot, bt) = (folder.join("map.ot"), folder.join("map.bt"));
    let create = |path| BufWriter::new(File::create(path).expect("a new file"));
    write_ot(map, create(&ot)).expect("written");
    write_bt(map, create(&bt)).expect("written");
    (ot, bt)
}

fn open(path: &Path) -> BufReader<File> {
    BufReader::new(File::open(path).expect("it was written"))
}

/// Whether liboctomap knows of every voxel, and of no other, what the map knows.
#[track_caller]
fn check_agreement(map: &VoxelMap, judge: &Referee) {
    assert!((judge.resolution_m() - map.resolution_m()).abs() < 1e-12);
    assert_eq!(judge.occupied_count(), map.occupied_count() as u64);
    assert_eq!(judge.known_count(), map.known_count() as u64);
    for (key, voxel) in map.known() {
        assert_eq!(
            judge.occupancy(map.center_of(key)),
            voxel.occupancy(),
            "{key:?}"
        );
    }
}

fn occupancies(map: &VoxelMap) -> BTreeMap<VoxelKey, Occupancy> {
    map.known()
        .map(|(key, voxel)| (key, voxel.occupancy()))
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn liboctomap_reads_our_files_and_agrees_on_every_voxel(map in any_map()) {
        let folder = tempfile::tempdir().expect("a folder");
        let (ot, bt) = write(&map, folder.path());
        for path in [&ot, &bt] {
            let judge = Referee::read(path).expect("liboctomap reads it");
            check_agreement(&map, &judge);
        }
        prop_assert_eq!(read_ot(open(&ot)).expect("ours").digest(), map.digest());
        prop_assert_eq!(occupancies(&read_bt(open(&bt)).expect("ours")), occupancies(&map));
    }

    #[test]
    fn any_bytes_are_refused_or_read(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(read_ot(&bytes[..]).is_err());
        let header = |magic| format!("{magic}\nid OcTree\nsize 9\nres 0.1\ndata\n").into_bytes();
        let with_header = |magic| [header(magic), bytes.clone()].concat();
        // Either outcome is right; what matters is that there is one.
        let full = read_ot(&with_header("# Octomap OcTree file")[..]);
        let binary = read_bt(&with_header("# Octomap OcTree binary file")[..]);
        prop_assert!(bytes.len() > 1 || full.is_err() && binary.is_err(), "no tree is that short");
    }
}

#[test]
fn our_files_are_pruned_as_far_as_liboctomap_prunes() {
    let mut map = VoxelMap::new(0.1);
    for i in 0..16 * 16 * 16 {
        let key = VoxelKey::new(i & 15, i >> 4 & 15, i >> 8);
        map.set_voxel(key, Voxel::new(LogOdds::MIN));
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (ot, bt) = write(&map, folder.path());
    for path in [&ot, &bt] {
        let judge = Referee::read(path).expect("liboctomap reads it");
        assert_eq!(judge.nodes(), 13, "a leaf at depth 12 and all above it");
        check_agreement(&map, &judge);
    }
    assert!(
        fs::read(&bt)
            .expect("written")
            .windows(8)
            .any(|w| w == b"size 13\n")
    );
}

#[test]
fn an_empty_map_is_an_empty_file_and_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let (ot, bt) = write(&VoxelMap::new(0.1), folder.path());
    for path in [&ot, &bt] {
        assert_eq!(
            Referee::read(path)
                .expect("liboctomap reads it")
                .known_count(),
            0
        );
    }
    assert_eq!(read_ot(open(&ot)).expect("ours").known_count(), 0);
    assert_eq!(read_bt(open(&bt)).expect("ours").known_count(), 0);
}

#[test]
fn we_read_what_liboctomap_writes() {
    let folder = tempfile::tempdir().expect("a folder");
    let (ot, bt) = (folder.path().join("its.ot"), folder.path().join("its.bt"));
    let mut judge = Referee::new(0.1);
    let hits: Vec<_> = (0..500)
        .map(|i| f64::from(i) * 0.013)
        .map(|a| Point::new(4.0 * a.cos(), 3.0 * a.sin(), 0.7 * (5.0 * a).sin()))
        .collect();
    for step in 0..4 {
        judge.insert_scan(Point::new(0.2 * f64::from(step), 0.03, 0.04), &hits);
    }
    judge.write_ot(&ot).expect("written");
    judge.write_bt(&bt).expect("written");
    check_agreement(&read_ot(open(&ot)).expect("we read its .ot"), &judge);
    check_agreement(&read_bt(open(&bt)).expect("we read its .bt"), &judge);
}

#[test]
fn one_scan_leaves_the_voxels_that_liboctomap_leaves() {
    let mut judge = Referee::new(0.1);
    let mut map = VoxelMap::new(0.1);
    // liboctomap takes points in f32.
    let at = |p: [f64; 3]| {
        let [x, y, z] = p.map(|c| f64::from(c as f32));
        Point::new(x, y, z)
    };
    let origin = at([0.03, 0.02, 0.04]);
    let hits: Vec<_> = (0..4000)
        .map(|i| (f64::from(i) * 2.399_963, 1.0 - f64::from(i) / 2000.0))
        .map(|(turn, z)| {
            let reach = (1.0 - z * z).max(0.0).sqrt() * (3.0 + 2.0 * (3.0 * turn).sin());
            at([reach * turn.cos(), reach * turn.sin(), 2.0 * z])
        })
        .collect();
    judge.insert_scan(origin, &hits);
    map.insert_scan(&Scan {
        max_range_m: 100.0,
        ..Scan::new(origin, &hits)
    });
    assert_eq!(map.occupied_count() as u64, judge.occupied_count());
    let different = map
        .known()
        .filter(|(key, voxel)| judge.occupancy(map.center_of(*key)) != voxel.occupancy())
        .count();
    let known = map.known_count();
    assert!(known > 20_000, "{known} voxels");
    // liboctomap counts along the ray in f32: at an edge it may take the other neighbour.
    assert!(
        different * 1000 < known,
        "{different} of {known} voxels differ"
    );
    assert!(known.abs_diff(judge.known_count() as usize) * 1000 < known);
}

#[test]
fn a_building_that_others_mapped_is_read_voxel_for_voxel() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../shared/data/octomap/geb079.bt"
    );
    let path = Path::new(path);
    if !path.exists() {
        println!("no {}: nothing to compare", path.display());
        return;
    }
    let judge = Referee::read(path).expect("liboctomap reads its own");
    let map = read_bt(open(path)).expect("we read it");
    check_agreement(&map, &judge);
    let folder = tempfile::tempdir().expect("a folder");
    let (ot, bt) = write(&map, folder.path());
    for written in [&ot, &bt] {
        let again = Referee::read(written).expect("liboctomap reads ours");
        check_agreement(&map, &again);
        assert_eq!(again.nodes(), judge.nodes(), "pruned alike");
    }
}

#[test]
fn hostile_files_are_refused_with_a_reason() {
    let check = |file: &[u8], reason: &str| {
        let error = read_bt(file).expect_err("hostile");
        assert_eq!(error.to_string(), reason);
    };
    let magic = "# Octomap OcTree binary file\n";
    let file = |rest: &str, data: &[u8]| [magic.as_bytes(), rest.as_bytes(), data].concat();
    check(
        b"",
        "the file does not begin with \"# Octomap OcTree binary file\"",
    );
    check(
        &file("id ColorOcTree\n", &[]),
        "the file holds a tree of type \"ColorOcTree\", only OcTree is understood",
    );
    check(
        &file("size 1\nres nan\ndata\n", &[]),
        "the header gives the resolution as \"nan\"",
    );
    check(
        &file("size 1\n", &[]),
        "the header has no line \"data\" in its first 65536 bytes",
    );
    check(
        &file("size 1\nres 0.1\ndata\n", &[2, 0]),
        "the leaves stand for more than 67108864 voxels",
    );
    check(
        &file("size 1\nres 0.1\ndata\n", &[3; 64]),
        "the tree is deeper than 16 levels",
    );
    let cut = read_bt(&file("size 1\nres 0.1\ndata\n", &[3])[..]);
    assert!(matches!(cut, Err(ReadError::Io(_))), "{cut:?}");
}
