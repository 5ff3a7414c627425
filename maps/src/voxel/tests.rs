use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;

use super::*;
use crate::frame::Vector;
use crate::scan::Scan;
use crate::time::Stamp;

/// Ten voxels a metre.
const RESOLUTION_M: f64 = 0.1;

fn scan(origin: Point<World>, hits: &[Point<World>]) -> Scan<'_> {
    Scan {
        max_range_m: 30.0,
        ..Scan::new(origin, hits)
    }
}

fn any_point(reach_m: f64) -> impl Strategy<Value = Point<World>> {
    prop::array::uniform3(-reach_m..reach_m).prop_map(|[x, y, z]| Point::new(x, y, z))
}

fn any_voxels() -> impl Strategy<Value = Vec<(VoxelKey, Voxel)>> {
    let key = prop::array::uniform3(-200..200).prop_map(|[x, y, z]| VoxelKey::new(x, y, z));
    let color = prop::option::of(prop::array::uniform3(0..32_u8))
        .prop_map(|c| c.map(|c| Rgb(c.map(|c| c << 3 | c >> 2))));
    let voxel = (-40..=70_i8, color, 0..4_u8).prop_map(|(steps, color, class)| Voxel {
        log_odds: LogOdds(steps),
        color: color.filter(|_| steps > 0),
        class: ClassId(if steps > 0 { class } else { 0 }),
    });
    prop::collection::vec((key, voxel), 0..300)
}

fn map_of(voxels: &[(VoxelKey, Voxel)]) -> VoxelMap {
    let mut map = VoxelMap::new(RESOLUTION_M);
    for &(key, voxel) in voxels {
        map.set_voxel(key, voxel);
    }
    map
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn floor_is_floor(c in prop_oneof![-1e10..1e10, -3.0..3.0, any::<f64>()]) {
        prop_assert_eq!(floor(c), c.floor() as i32);
    }

    #[test]
    fn a_map_holds_what_was_put_into_it_and_nothing_else(voxels in any_voxels()) {
        let map = map_of(&voxels);
        let expected: BTreeMap<_, _> = voxels.iter().copied().collect();
        let known: BTreeMap<_, _> = map.known().collect();
        prop_assert_eq!(&known, &expected);
        prop_assert_eq!(map.known_count(), expected.len());
        let occupied: BTreeSet<_> = map.occupied().map(|(key, _)| key).collect();
        prop_assert_eq!(occupied.len(), map.occupied_count());
        for (key, voxel) in &expected {
            prop_assert_eq!(map.voxel(*key), Some(*voxel));
            prop_assert_eq!(occupied.contains(key), voxel.log_odds.0 > 0);
        }
        let low = |of: fn(&VoxelKey) -> i32| expected.keys().map(of).min();
        let high = |of: fn(&VoxelKey) -> i32| expected.keys().map(of).max();
        let bounds = map.bounds();
        prop_assert_eq!(bounds.map(|b| b.0.x), low(|k| k.x));
        prop_assert_eq!(bounds.map(|b| b.0.y), low(|k| k.y));
        prop_assert_eq!(bounds.map(|b| b.0.z), low(|k| k.z));
        prop_assert_eq!(bounds.map(|b| b.1.x), high(|k| k.x));
        prop_assert_eq!(bounds.map(|b| b.1.y), high(|k| k.y));
        prop_assert_eq!(bounds.map(|b| b.1.z), high(|k| k.z));
    }

    #[test]
    fn the_digest_tells_content_and_not_history(voxels in any_voxels(), at in any::<prop::sample::Index>()) {
        let map = map_of(&voxels);
        let mut backwards = voxels.clone();
        backwards.reverse();
        backwards.sort_by_key(|(key, _)| (key.z, key.y, key.x));
        let mut last: BTreeMap<_, _> = voxels.iter().copied().collect();
        for (key, voxel) in &mut backwards {
            *voxel = last[key];
        }
        prop_assert_eq!(map.digest(), map_of(&backwards).digest());
        if let Some((key, voxel)) = (!voxels.is_empty()).then(|| voxels[at.index(voxels.len())]) {
            let other = last.entry(key).or_insert(voxel);
            other.log_odds = LogOdds(if other.log_odds.0 == 5 { 6 } else { 5 });
            let changed: Vec<_> = last.into_iter().collect();
            prop_assert_ne!(map.digest(), map_of(&changed).digest());
        }
    }

    #[test]
    fn a_scan_does_to_each_voxel_what_its_rays_say_once(
        origin in any_point(3.0), hits in prop::collection::vec(any_point(6.0), 1..60)
    ) {
        let mut map = VoxelMap::new(RESOLUTION_M);
        map.insert_scan(&scan(origin, &hits));
        let ends: BTreeSet<_> = hits.iter().map(|hit| map.key_of(*hit)).collect();
        for (key, voxel) in map.known() {
            let expected = if ends.contains(&key) { LogOdds::HIT } else { LogOdds::MISS };
            prop_assert_eq!(voxel.log_odds, expected, "{:?}", key);
        }
        let hits_found = ends.iter().filter(|key| map.occupancy(**key) == Occupancy::Occupied);
        prop_assert_eq!(hits_found.count(), ends.len(), "no hit is lost to a ray that passes");
        // Along each ray, sampled finely: nothing is left unknown where the ray is well inside of a voxel.
        for end in &ends {
            let ray = map.center_of(*end) - origin;
            for step in 0..1000 {
                let p = origin + ray * (f64::from(step) / 1000.0);
                let inside = p.raw.iter().all(|c| (c / RESOLUTION_M).fract().abs() > 1e-6);
                prop_assert!(!inside || map.voxel(map.key_of(p)).is_some(), "{:?}", p);
            }
        }
    }

    #[test]
    fn the_order_of_the_points_does_not_matter(hits in prop::collection::vec(any_point(40.0), 0..40)) {
        let mut backwards = hits.clone();
        backwards.reverse();
        let [one, other] = [hits, backwards].map(|hits| {
            let mut map = VoxelMap::new(RESOLUTION_M);
            map.insert_scan(&scan(Point::origin(), &hits));
            map.digest()
        });
        prop_assert_eq!(one, other);
    }

    #[test]
    fn any_scan_whatsoever_is_survived(
        origin in prop::array::uniform3(any::<f64>()), hits in prop::collection::vec(prop::array::uniform3(any::<f64>()), 0..8)
    ) {
        let mut map = VoxelMap::new(10.0);
        let hits: Vec<_> = hits.into_iter().map(|[x, y, z]| Point::new(x, y, z)).collect();
        for max_range_m in [30.0, 0.0, -1.0, f64::NAN, f64::INFINITY] {
            for origin in [Point::new(origin[0], origin[1], origin[2]), Point::origin()] {
                map.insert_scan(&Scan { colors: &[Rgb([1, 2, 3])], classes: &[ClassId(4)], max_range_m, ..Scan::new(origin, &hits) });
            }
        }
        prop_assert!(map.known().all(|(key, _)| key.is_in_world()));
    }

    #[test]
    fn a_ray_meets_the_first_occupied_voxel(
        voxels in any_voxels(), origin in any_point(40.0), towards in any_point(20.0)
    ) {
        let map = map_of(&voxels);
        let direction = towards - origin;
        let found = map.cast_ray(origin, direction, f64::INFINITY);
        // Every occupied voxel that the ray enters, by its distance: the slab test on each.
        let unit = direction.raw.normalize();
        let nearest = map.occupied().filter_map(|(key, _)| {
            let half = RESOLUTION_M / 2.0;
            let to_center = map.center_of(key).raw - origin.raw;
            let near = (0..3).map(|i| to_center[i] / unit[i] - half / unit[i].abs()).fold(0.0, f64::max);
            let far = (0..3).map(|i| to_center[i] / unit[i] + half / unit[i].abs()).fold(f64::INFINITY, f64::min);
            // A ray that only grazes an edge may be decided either way.
            (near + 1e-9 < far).then_some(near)
        }).fold(f64::INFINITY, f64::min);
        let distance_m = found.map_or(f64::INFINITY, |hit| hit.distance_m);
        prop_assert!(distance_m <= nearest + 1e-9, "{distance_m} m, but there is one at {nearest} m");
        if let Some(hit) = found {
            prop_assert_eq!(map.occupancy(hit.key), Occupancy::Occupied);
            let off = (map.center_of(hit.key) - hit.point).raw.abs().max() - RESOLUTION_M / 2.0;
            prop_assert!(off < 1e-9, "the point is on the voxel");
        }
    }

    #[test]
    fn all_tiles_of_a_map_make_the_same_map(voxels in any_voxels()) {
        let mut map = map_of(&voxels);
        let mut copy = VoxelMap::new(RESOLUTION_M);
        let changed = map.take_changed_tiles();
        prop_assert_eq!(&changed, &map.tile_ids());
        for id in changed {
            let tile = map.tile(id).expect("it changed");
            prop_assert!(tile.known().eq(map.known().filter(|(key, _)| TileId::of(*key) == id)));
            copy.set_tile(&tile).expect("the same resolution");
            prop_assert_eq!(copy.tile(id), Some(tile), "with its version");
        }
        prop_assert_eq!(copy.digest(), map.digest());
        prop_assert_eq!(copy.take_changed_tiles(), copy.tile_ids());
    }
}

#[test]
fn two_scans_of_one_wall_make_it_surer_and_bounded() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    let wall = [Point::new(2.05, 0.05, 0.05), Point::new(2.06, 0.04, 0.05)];
    let key = map.key_of(wall[0]);
    let log_odds = |map: &VoxelMap| map.voxel(key).map(|voxel| voxel.log_odds);
    for expected in [17, 34, 51, 68, 70, 70] {
        map.insert_scan(&scan(Point::origin(), &wall));
        assert_eq!(log_odds(&map), Some(LogOdds(expected)));
    }
    // Now the wall is gone and rays pass.
    let behind = [Point::new(4.05, 0.05, 0.05)];
    for expected in [
        62, 54, 46, 38, 30, 22, 14, 6, -2, -10, -18, -26, -34, -40, -40,
    ] {
        map.insert_scan(&scan(Point::new(0.0, 0.05, 0.05), &behind));
        assert_eq!(log_odds(&map), Some(LogOdds(expected)));
    }
}

#[test]
fn a_hit_beyond_the_range_frees_the_way_to_it_and_marks_nothing() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    let hits = [Point::new(100.05, 0.05, 0.05)];
    map.insert_scan(&scan(Point::new(0.05, 0.05, 0.05), &hits));
    assert_eq!(map.occupied_count(), 0);
    assert_eq!(map.known_count(), 300, "30 m in steps of 0.1 m");
    assert_eq!(map.occupancy(VoxelKey::new(299, 0, 0)), Occupancy::Free);
}

#[test]
fn seeing_the_same_again_changes_no_tile() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    let hits = [Point::new(2.05, 0.05, 0.05)];
    for _ in 0..5 {
        map.insert_scan(&scan(Point::origin(), &hits));
        assert_eq!(map.take_changed_tiles(), [TileId { x: 0, y: 0, z: 0 }]);
    }
    let version = map
        .tile(TileId { x: 0, y: 0, z: 0 })
        .map(|tile| tile.version);
    assert_eq!(version, Some(5));
    map.insert_scan(&scan(Point::origin(), &hits));
    assert_eq!(
        map.take_changed_tiles(),
        [],
        "everything is as sure as it can be"
    );
}

#[test]
fn a_colour_comes_to_rest_after_a_few_scans_and_goes_with_the_voxel() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    let hits = [Point::new(2.05, 0.05, 0.05), Point::new(2.05, 0.15, 0.05)];
    let key = map.key_of(hits[0]);
    let color = |map: &VoxelMap| map.voxel(key).and_then(|voxel| voxel.color);
    let see = |map: &mut VoxelMap, colors: &[Rgb]| {
        map.insert_scan(&Scan {
            colors,
            ..scan(Point::origin(), &hits)
        });
    };
    see(&mut map, &[]);
    assert_eq!(color(&map), None);
    see(&mut map, &[Rgb([255, 0, 128])]);
    assert_eq!(color(&map), Some(Rgb([255, 0, 132])), "five bits a channel");
    for _ in 0..5 {
        see(&mut map, &[Rgb([0, 255, 128])]);
    }
    let near = color(&map).expect("seen in colour").0;
    assert!(
        near[0] <= 16 && near[1] >= 239 && near[2] == 132,
        "{near:?}"
    );
    map.take_changed_tiles();
    see(&mut map, &[Rgb([9, 246, 120])]);
    assert_eq!(color(&map), Some(Rgb(near)), "that is noise");
    assert_eq!(map.take_changed_tiles(), []);
    assert_eq!(map.voxel(map.key_of(hits[1])).and_then(|v| v.color), None);
    for _ in 0..20 {
        map.insert_scan(&scan(Point::origin(), &[Point::new(4.0, 0.1, 0.1)]));
    }
    assert_eq!(color(&map), None);
}

#[test]
fn the_world_ends_where_an_octomap_ends() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    let hits = [Point::new(3276.75, 0.0, 0.0), Point::new(3276.85, 0.0, 0.0)];
    map.insert_scan(&scan(Point::new(3276.0, 0.0, 0.0), &hits));
    assert_eq!(
        map.occupancy(VoxelKey::new(32_767, 0, 0)),
        Occupancy::Occupied
    );
    assert_eq!(map.occupied_count(), 1);
    map.set_voxel(VoxelKey::new(32_768, 0, 0), Voxel::new(LogOdds::MAX));
    assert_eq!(map.occupied_count(), 1);
}

#[test]
fn a_ray_that_goes_nowhere_meets_nothing() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    assert_eq!(
        map.cast_ray(Point::origin(), Vector::new(1.0, 0.0, 0.0), 10.0),
        None
    );
    map.insert_scan(&scan(Point::origin(), &[Point::new(2.05, 0.05, 0.05)]));
    let cast = |x, y, z, range_m| {
        let origin = Point::new(0.05, 0.05, 0.05);
        map.cast_ray(origin, Vector::new(x, y, z), range_m)
            .map(|hit| hit.key)
    };
    let wall = Some(VoxelKey::new(20, 0, 0));
    assert_eq!(cast(0.3, 0.0, 0.0, 10.0), wall, "along an axis");
    assert_eq!(
        cast(0.3, 0.0, 0.0, 1.96),
        wall,
        "its near side is at 1.95 m"
    );
    assert_eq!(cast(0.3, 0.0, 0.0, 1.94), None);
    assert_eq!(cast(-0.3, 0.0, 0.0, 10.0), None);
    assert_eq!(cast(0.0, 0.0, 0.0, 10.0), None);
    assert_eq!(cast(f64::NAN, 0.0, 0.0, 10.0), None);
    assert_eq!(cast(1.0, 0.0, 0.0, f64::NAN), None);
}

#[test]
fn a_tile_of_another_resolution_or_world_is_refused() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    let id = TileId { x: 0, y: 0, z: 0 };
    let other = map.set_tile(&Tile::unknown(id, 1, 0.2));
    assert_eq!(
        other.map_err(|e| e.to_string()),
        Err("tile 0/0/0 has voxels of 0.2 m, the map has 0.1 m".to_owned())
    );
    let far = TileId { x: 256, y: 0, z: 0 };
    assert_eq!(
        map.set_tile(&Tile::unknown(far, 1, 0.1)),
        Err(TileError::OutsideWorld(far))
    );
}

#[test]
fn a_long_way_leaves_nothing_of_earlier_scans_in_later_ones() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    for step in 0..60 {
        let origin = Point::new(20.0 * f64::from(step), 0.0, 0.0);
        let hits = [[4.0, 3.0, 1.0], [-5.0, 2.0, -1.0]]
            .map(|[x, y, z]| Point::new(origin.raw.x + x, y, z));
        // The same map in new memory.
        let mut other = VoxelMap::new(RESOLUTION_M);
        for id in map.tile_ids() {
            let tile = map.tile(id).expect("it is in the list");
            other.set_tile(&tile).expect("the same resolution");
        }
        for map in [&mut map, &mut other] {
            map.insert_scan(&scan(origin, &hits));
        }
        assert_eq!(map.digest(), other.digest(), "scan {step}");
        assert_eq!(map.tile_ids(), other.tile_ids());
    }
}

#[test]
fn a_voxel_remembers_when_it_was_seen_and_by_whom() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    let hits = [Point::new(2.05, 0.05, 0.05)];
    let (wall, way) = (map.key_of(hits[0]), VoxelKey::new(10, 0, 0));
    let seen = |map: &VoxelMap, key| map.seen(key).map(|s| (s.at.as_secs_f64(), s.sources));
    let see = |map: &mut VoxelMap, source, seconds: f64| {
        map.insert_scan(&Scan {
            source,
            at: Stamp::from_secs_f64(seconds).expect("a moment"),
            ..scan(Point::new(0.05, 0.05, 0.05), &hits)
        });
    };
    assert_eq!(seen(&map, wall), None, "unknown");
    // As recordings count time: from 1970.
    see(&mut map, Sources::UAV, 1_780_000_000.02);
    for key in [wall, way] {
        assert_eq!(seen(&map, key), Some((1_780_000_000.0, Sources::UAV)));
    }
    let digest = map.digest();
    for _ in 0..8 {
        see(&mut map, Sources::UGV, 1_780_000_001.25);
    }
    map.take_changed_tiles();
    see(&mut map, Sources::UGV, 1_780_000_002.5);
    assert_eq!(map.take_changed_tiles(), [], "nothing new");
    // A scan that comes late does not turn the clock back.
    see(&mut map, Sources::UGV, 1_780_000_001.5);
    for key in [wall, way] {
        let both = Sources::UAV | Sources::UGV;
        assert_eq!(seen(&map, key), Some((1_780_000_002.5, both)));
    }
    assert_ne!(digest, map.digest(), "the voxels have become surer");
}

#[test]
fn the_class_that_most_scans_and_most_points_see_wins() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    let hits = [
        Point::new(2.05, 0.05, 0.05),
        Point::new(2.06, 0.05, 0.05),
        Point::new(2.07, 0.05, 0.05),
        Point::new(2.05, 0.55, 0.05),
    ];
    let classes =
        |map: &VoxelMap| [0, 3].map(|i| map.voxel(map.key_of(hits[i])).map(|v| v.class.0));
    let see = |map: &mut VoxelMap, classes: &[u8]| {
        let classes: Vec<_> = classes.iter().map(|c| ClassId(*c)).collect();
        map.insert_scan(&Scan {
            classes: &classes,
            ..scan(Point::origin(), &hits)
        });
    };
    see(&mut map, &[7, 3, 3]);
    assert_eq!(classes(&map), [Some(3), Some(0)], "most points");
    see(&mut map, &[7, 3, 0, 9]);
    assert_eq!(classes(&map), [Some(3), Some(9)], "ties go to the lowest");
    see(&mut map, &[7, 7, 7]);
    assert_eq!(classes(&map), [Some(3), Some(9)], "one against two");
    see(&mut map, &[7, 7, 7]);
    assert_eq!(classes(&map), [Some(7), Some(9)]);
    map.take_changed_tiles();
    let digest = map.digest();
    for _ in 0..5 {
        see(&mut map, &[7, 7, 7]);
    }
    assert_eq!(classes(&map), [Some(7), Some(9)]);
    assert_ne!(digest, map.digest());
    let removed = Voxel::new(LogOdds::MIN);
    let key = map.key_of(hits[0]);
    map.set_voxel(key, removed);
    assert_eq!(map.voxel(key), Some(removed), "free space has no class");
}
