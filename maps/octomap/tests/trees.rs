//! Trees of every shape before the judge: colours, pruning and depth, log-odds by log-odds.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;

use maps::palette;
use maps::voxel::{ClassId, LogOdds, Rgb, Voxel, VoxelKey, VoxelMap};
use octomap::node_referee::NodeReferee;
use octomap::{
    Colors, Content, Format, Opened, Pruning, ReadOptions, Shape, TreeType, read, write_bt_as,
    write_ot_as,
};
use proptest::prelude::*;

/// What a random voxel is given: log-odds in steps, and perhaps a colour.
type Given = (i8, Option<[u8; 3]>);

fn any_given() -> impl Strategy<Value = Given> {
    // Few values, so that there is something to prune.
    let steps = prop_oneof![Just(-40_i8), Just(70), Just(0), -40..=70_i8];
    let color = prop_oneof![
        Just(None),
        Just(Some([8, 200, 96])),
        Just(Some([255; 3])),
        any::<[u8; 3]>().prop_map(Some)
    ];
    (steps, color)
}

fn any_map() -> impl Strategy<Value = VoxelMap> {
    let key = prop::array::uniform3(-20..20).prop_map(|[x, y, z]| VoxelKey::new(x, y, z));
    let voxels = prop::collection::vec((key, any_given()), 0..120);
    let boxes = prop::collection::vec((prop::array::uniform3(-3..3), 1..4_u32, any_given()), 0..4);
    (voxels, boxes).prop_map(|(voxels, boxes)| {
        let mut map = VoxelMap::new(0.1);
        for ([x, y, z], level, given) in boxes {
            let edge = 1 << level;
            for i in 0..edge * edge * edge {
                let at = [
                    x * edge + i % edge,
                    y * edge + i / edge % edge,
                    z * edge + i / edge / edge,
                ];
                map.set_voxel(VoxelKey::new(at[0], at[1], at[2]), voxel(given));
            }
        }
        for (key, given) in voxels {
            map.set_voxel(key, voxel(given));
        }
        map
    })
}

fn voxel((steps, color): Given) -> Voxel {
    Voxel {
        color: color.map(Rgb),
        ..Voxel::new(LogOdds(steps))
    }
}

fn any_shape() -> impl Strategy<Value = Shape> {
    let pruning = prop::sample::select(vec![Pruning::EqualLeaves, Pruning::Nothing]);
    pruning.prop_map(|pruning| Shape {
        pruning,
        cut_levels: 0,
    })
}

fn opened(path: &Path, options: &ReadOptions) -> Opened {
    let file = File::open(path).expect("it was written");
    read(BufReader::new(file), options).expect("a file we read")
}

/// What stands below the header.
fn data(path: &Path) -> Vec<u8> {
    let file = fs::read(path).expect("it was written");
    let end = file.windows(6).position(|w| w == b"\ndata\n");
    file[end.expect("a header") + 6..].to_vec()
}

/// What a map knows, at voxels twice as wide so many times: the most occupied, and free only if nothing in it is occupied.
fn coarse(map: &VoxelMap, levels: u32) -> BTreeMap<VoxelKey, LogOdds> {
    let mut most = BTreeMap::new();
    for (key, voxel) in map.known() {
        let up = VoxelKey::new(key.x >> levels, key.y >> levels, key.z >> levels);
        let log_odds = most.entry(up).or_insert(LogOdds::MIN);
        *log_odds = voxel.log_odds.max(*log_odds);
    }
    most
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn liboctomap_reads_our_colours_and_log_odds(map in any_map(), shape in any_shape()) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ours.ot");
        write_ot_as(&map, Content::Color, shape, File::create(&path).expect("a file")).expect("written");
        let judge = NodeReferee::read(&path).expect("liboctomap reads it");
        prop_assert!(judge.is_colored());
        for (key, voxel) in map.known() {
            let its = judge.log_odds(key).expect("known");
            prop_assert!((f64::from(its) - voxel.log_odds.value()).abs() < 1e-5, "{its} at {key:?}");
            prop_assert_eq!(its >= 0.0, voxel.log_odds.is_occupied());
            let expected = voxel.color.map(|Rgb(color)| if color == [255; 3] { [254; 3] } else { color });
            prop_assert_eq!(judge.color(key), expected, "at {:?}", key);
        }
        let back = opened(&path, &ReadOptions::default());
        prop_assert_eq!(back.map.digest(), map.digest());
        prop_assert_eq!(back.nodes, judge.nodes() as u64);
        prop_assert_eq!(back.header.nodes, Some(back.nodes));
        prop_assert_eq!(back.pruned > 0 && shape.pruning == Pruning::Nothing, false);
    }

    /// Children, their order, the greatest log-odds and the average colour of inner nodes are what it would write itself.
    #[test]
    fn our_nodes_are_those_that_liboctomap_writes(map in any_map(), shape in any_shape()) {
        let folder = tempfile::tempdir().expect("a folder");
        let (ours, its) = (folder.path().join("ours.ot"), folder.path().join("its.ot"));
        for content in [Content::Occupancy, Content::Color] {
            write_ot_as(&map, content, shape, File::create(&ours).expect("a file")).expect("written");
            let mut judge = NodeReferee::read(&ours).expect("liboctomap reads it");
            judge.update_inner();
            judge.write_ot(&its).expect("written");
            prop_assert_eq!(data(&ours), data(&its), "{:?}", content);
        }
        let (ours, its) = (folder.path().join("ours.bt"), folder.path().join("its.bt"));
        write_bt_as(&map, shape, File::create(&ours).expect("a file")).expect("written");
        let judge = NodeReferee::read(&ours).expect("liboctomap reads it");
        judge.write_bt(&its).expect("written");
        prop_assert_eq!(data(&ours), data(&its));
    }

    #[test]
    fn we_read_what_liboctomap_says_of_every_voxel(
        voxels in prop::collection::btree_map(prop::array::uniform3(-9..9), (-5.0..5.0_f32, any::<[u8; 3]>()), 0..150),
        tree in prop::sample::select(vec![TreeType::Plain, TreeType::Color]), pruned: bool
    ) {
        let folder = tempfile::tempdir().expect("a folder");
        let (ot, bt) = (folder.path().join("its.ot"), folder.path().join("its.bt"));
        let mut judge = NodeReferee::new(tree, 0.1);
        // A box as large as a leaf of depth 13, which is one when pruned.
        for i in 0..512 {
            judge.set(VoxelKey::new(16 + i % 8, i / 8 % 8, i / 64), 0.0);
        }
        for ([x, y, z], (log_odds, color)) in &voxels {
            let key = VoxelKey::new(*x, *y, *z);
            judge.set(key, *log_odds);
            judge.set_color(key, *color);
        }
        judge.update_inner();
        if pruned {
            judge.prune();
        }
        judge.write_ot(&ot).expect("written");
        judge.write_bt(&bt).expect("written");
        let ours = opened(&ot, &ReadOptions::default());
        prop_assert_eq!(ours.header.tree, tree);
        prop_assert_eq!(ours.nodes, judge.nodes() as u64);
        prop_assert_eq!(ours.map.known_count(), 512 + voxels.len());
        let binary = opened(&bt, &ReadOptions::default());
        prop_assert_eq!(binary.map.known_count(), 512 + voxels.len());
        for (key, voxel) in ours.map.known() {
            let its = judge.log_odds(key).expect("it is known to both");
            prop_assert_eq!(voxel.log_odds.is_occupied(), its >= 0.0, "{} at {:?}", its, key);
            let off = voxel.log_odds.value() - f64::from(its.clamp(-2.0, 3.5));
            prop_assert!(off.abs() <= 0.05, "{off} at {key:?}, where it says {its}");
            let seen = judge.color(key).filter(|_| its >= 0.0);
            prop_assert_eq!(voxel.color.map(|c| c.0.map(|c| c >> 3)), seen.map(|c| c.map(|c| c >> 3)));
            prop_assert_eq!(binary.map.occupancy(key), voxel.occupancy());
        }
    }

    #[test]
    fn coarser_voxels_are_as_occupied_as_the_most_occupied_in_them(map in any_map(), shape in any_shape(), levels in 0..4_u32) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("map.ot");
        write_ot_as(&map, Content::Color, shape, File::create(&path).expect("a file")).expect("written");
        let options = ReadOptions { coarser: levels, ..ReadOptions::default() };
        let read = opened(&path, &options).map;
        prop_assert!((read.resolution_m() - 0.1 * f64::from(1 << levels)).abs() < 1e-12);
        let known: BTreeMap<_, _> = read.known().map(|(key, voxel)| (key, voxel.log_odds)).collect();
        // Where a whole leaf fills it, a voxel is what the leaf is; so are the voxels that several share.
        prop_assert_eq!(known, coarse(&map, levels));
    }

    #[test]
    fn what_is_cut_off_is_summed_up_above(map in any_map(), shape in any_shape(), levels in 1..5_u32) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("map.ot");
        let shape = Shape { cut_levels: levels, ..shape };
        write_ot_as(&map, Content::Color, shape, File::create(&path).expect("a file")).expect("written");
        let judge = NodeReferee::read(&path).expect("liboctomap reads it");
        let expected = coarse(&map, levels);
        for (key, log_odds) in &expected {
            let low = VoxelKey::new(key.x << levels, key.y << levels, key.z << levels);
            let its = judge.log_odds(low).expect("known");
            prop_assert!((f64::from(its) - log_odds.value()).abs() < 1e-5);
        }
        let read = opened(&path, &ReadOptions::default()).map;
        prop_assert_eq!(read.known_count(), expected.len() << (3 * levels));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn classes_travel_as_the_colours_of_the_palette(
        voxels in prop::collection::btree_map(prop::array::uniform3(-9..9), (-40..=70_i8, 0..=255_u8), 1..150),
        shape in any_shape()
    ) {
        let mut map = VoxelMap::new(0.1);
        for ([x, y, z], (steps, class)) in &voxels {
            let voxel = Voxel { class: ClassId(*class), ..Voxel::new(LogOdds(*steps)) };
            map.set_voxel(VoxelKey::new(*x, *y, *z), voxel);
        }
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("classes.ot");
        write_ot_as(&map, Content::Class, shape, File::create(&path).expect("a file")).expect("written");
        let judge = NodeReferee::read(&path).expect("liboctomap reads it");
        for (key, voxel) in map.known() {
            prop_assert_eq!(judge.color(key), palette::color_of(voxel.class).map(|c| c.0));
        }
        let options = ReadOptions { colors: Colors::Classes, ..ReadOptions::default() };
        let back = opened(&path, &options);
        prop_assert_eq!(back.map.digest(), map.digest());
        prop_assert_eq!(back.unclassified, 0);
        let as_colors = opened(&path, &ReadOptions::default()).map;
        prop_assert!(as_colors.known().all(|(_, voxel)| voxel.class == ClassId::NONE), "only if asked");
    }
}

#[test]
fn colours_that_are_no_class_are_counted() {
    let mut map = VoxelMap::new(0.1);
    let colors = [[128, 0, 0], [17, 200, 3], [99, 99, 99]];
    for (x, color) in (0..).zip(colors) {
        map.set_voxel(VoxelKey::new(x, 0, 0), voxel((70, Some(color))));
    }
    let mut file = Vec::new();
    write_ot_as(&map, Content::Color, Shape::default(), &mut file).expect("written");
    let options = ReadOptions {
        colors: Colors::Classes,
        ..ReadOptions::default()
    };
    assert_eq!(
        read(&file[..], &options).expect("a file").unclassified,
        3,
        "five bits of red are not the palette's"
    );
}

#[test]
fn every_beginning_of_a_file_is_refused() {
    let mut map = VoxelMap::new(0.1);
    for i in 0..40_i32 {
        let key = VoxelKey::new(i * 37 % 64 - 30, i * 11 % 50, i % 9);
        map.set_voxel(key, voxel(((i % 100) as i8 - 20, Some([i as u8; 3]))));
    }
    for content in [Content::Occupancy, Content::Color] {
        let mut file = Vec::new();
        write_ot_as(&map, content, Shape::default(), &mut file).expect("written");
        let cut = (0..file.len()).find(|&end| read(&file[..end], &ReadOptions::default()).is_ok());
        assert_eq!(cut, None, "a file cut off there was read");
    }
    let mut file = Vec::new();
    write_bt_as(&map, Shape::default(), &mut file).expect("written");
    let cut = (0..file.len()).find(|&end| read(&file[..end], &ReadOptions::default()).is_ok());
    assert_eq!(cut, None, "a file cut off there was read");
}

#[test]
fn a_file_of_before_2010_is_read_as_liboctomap_reads_it() {
    let mut map = VoxelMap::new(0.2);
    for i in 0..100 {
        let steps = if i % 3 == 0 { -40 } else { 70 };
        map.set_voxel(VoxelKey::new(i % 10, i / 10, 3), voxel((steps, None)));
    }
    let folder = tempfile::tempdir().expect("a folder");
    let new = folder.path().join("new.bt");
    write_bt_as(&map, Shape::default(), File::create(&new).expect("a file")).expect("written");
    let old = folder.path().join("old.bt");
    let nodes = opened(&new, &ReadOptions::default()).nodes as u32;
    let header = [
        &3_u32.to_le_bytes()[..],
        &0.2_f64.to_le_bytes(),
        &nodes.to_le_bytes(),
    ]
    .concat();
    fs::write(&old, [header, data(&new)].concat()).expect("written");
    let judge = NodeReferee::read(&old).expect("liboctomap reads it");
    let ours = opened(&old, &ReadOptions::default());
    assert_eq!(ours.map.digest(), map.digest());
    assert_eq!(ours.header.format, Format::OldBinary);
    assert_eq!(ours.nodes, judge.nodes() as u64);
}

#[test]
fn nodes_that_are_missing_in_a_binary_file_are_missed() {
    let file = b"# Octomap OcTree binary file\nid OcTree\nsize 5\nres 0.1\ndata\n\x00\x00";
    let error = read(&file[..], &ReadOptions::default()).expect_err("one node");
    assert_eq!(
        error.to_string(),
        "the header announces 5 nodes, the tree has 1"
    );
}

#[test]
fn a_tree_of_time_stamps_is_read_without_them() {
    let mut file = Vec::new();
    let mut map = VoxelMap::new(0.1);
    map.set_voxel(VoxelKey::new(1, 2, 3), voxel((5, None)));
    write_ot_as(&map, Content::Occupancy, Shape::default(), &mut file).expect("written");
    let text = String::from_utf8_lossy(&file)
        .find("OcTree\nsize")
        .expect("a header");
    let stamped = [&file[..text], b"OcTreeStamped\nsize", &file[text + 11..]].concat();
    let opened =
        read(&stamped[..], &ReadOptions::default()).expect("it has the nodes of an OcTree");
    assert_eq!(opened.header.tree, TreeType::Stamped);
    assert_eq!(opened.map.digest(), map.digest());
}

#[test]
fn log_odds_that_are_no_number_are_refused_and_infinite_ones_are_as_sure_as_can_be() {
    let file = |value: f32| {
        let path = [[0, 0, 0, 0, 1]; 16].concat();
        let header = b"# Octomap OcTree file\nid OcTree\nsize 17\nres 0.1\ndata\n";
        [&header[..], &path, &value.to_le_bytes(), &[0]].concat()
    };
    let read = |value| read(&file(value)[..], &ReadOptions::default());
    let error = read(f32::NAN).expect_err("NaN").to_string();
    assert_eq!(error, "the log-odds of node 17 are not a number");
    let corner = VoxelKey::new(-32_768, -32_768, -32_768);
    let of = |value| {
        read(value)
            .expect("a number")
            .map
            .voxel(corner)
            .map(|v| v.log_odds)
    };
    assert_eq!(of(f32::INFINITY), Some(LogOdds::MAX));
    assert_eq!(of(f32::NEG_INFINITY), Some(LogOdds::MIN));
    assert_eq!(of(f32::MAX), Some(LogOdds::MAX));
    assert_eq!(of(-0.001), Some(LogOdds(0)), "free stays free");
    assert_eq!(of(0.001), Some(LogOdds(1)), "occupied stays occupied");
}

#[test]
fn a_leaf_high_in_the_tree_is_refused_and_read_when_coarser() {
    // The root's first child is a free leaf: an eighth of the world.
    let file = b"# Octomap OcTree binary file\nid OcTree\nsize 2\nres 0.05\ndata\n\x01\x00";
    let error = read(&file[..], &ReadOptions::default())
        .expect_err("too large")
        .to_string();
    assert_eq!(
        error,
        "the map would take more than 2048 MiB: a leaf 1638.4 m wide at node 2 stands for 35184372088832 voxels; read it \
         6 or more levels coarser, or allow more memory"
    );
    let coarser = ReadOptions {
        coarser: 10,
        ..ReadOptions::default()
    };
    let opened = read(&file[..], &coarser).expect("32³ voxels of 51.2 m");
    assert_eq!(opened.map.known_count(), 32 * 32 * 32);
}

#[test]
fn voxels_far_from_one_another_count_as_the_memory_they_take() {
    // Each leaf at depth 16 in a tile of its own: 512³ of them would be 15 bytes of file and 14 KB of memory each.
    let mut map = VoxelMap::new(0.1);
    for i in 0..500 {
        map.set_voxel(
            VoxelKey::new(i % 10 * 128, i / 10 % 10 * 128, i / 100 * 128),
            voxel((70, None)),
        );
    }
    let mut file = Vec::new();
    write_bt_as(&map, Shape::default(), &mut file).expect("written");
    let options = ReadOptions {
        most_bytes: 8 << 20,
        ..ReadOptions::default()
    };
    let error = read(&file[..], &options)
        .expect_err("500 tiles of 18 KB")
        .to_string();
    assert!(
        error.starts_with("the map would take more than 8 MiB"),
        "{error}"
    );
    assert!(read(&file[..], &ReadOptions::default()).is_ok());
}
