use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;

use super::*;
use crate::voxel::{LogOdds, Occupancy};

const RESOLUTION_M: f64 = 0.1;

fn any_points(reach_m: f64, most: usize) -> impl Strategy<Value = Vec<Point<World>>> {
    // Some on a grid, to make ties.
    let c = prop_oneof![
        4 => -reach_m..reach_m,
        1 => (-20..20_i32).prop_map(|c| f64::from(c) * 0.05)
    ];
    let point = prop::array::uniform3(c).prop_map(|[x, y, z]| Point::new(x, y, z));
    prop::collection::vec(point, 1..most)
}

fn any_rays() -> impl Strategy<Value = Rays> {
    prop_oneof![Just(Rays::EachPoint), Just(Rays::EachVoxel)]
}

fn any_carving() -> impl Strategy<Value = Carving> {
    prop_oneof![Just(Carving::EveryVoxel), Just(Carving::SparesSurfaces)]
}

/// The voxels a ray is in for longer than `least` of it, its last one left out: all its crossings of borders, sorted.
fn crossed(from: Point<World>, to: Point<World>, least: f64) -> BTreeSet<VoxelKey> {
    let per_m = 1.0 / RESOLUTION_M; // as the map does it, for points on borders
    let (start, end) = (from.raw.coords * per_m, to.raw.coords * per_m);
    let mut crossings = vec![0.0, 1.0];
    for axis in 0..3 {
        let (a, b) = (start[axis].min(end[axis]), start[axis].max(end[axis]));
        let mut border = a.ceil();
        while border <= b && a < b {
            crossings.push((border - start[axis]) / (end[axis] - start[axis]));
            border += 1.0;
        }
    }
    crossings.sort_by(f64::total_cmp);
    let key = |share: f64| key_at(Point::from_raw((start + (end - start) * share).into()), 1.0);
    crossings
        .windows(2)
        .filter(|pair| pair[1] - pair[0] > least)
        .map(|pair| key(f64::midpoint(pair[0], pair[1])))
        .filter(|voxel| *voxel != key_at(to, 1.0 / RESOLUTION_M))
        .collect()
}

/// The map after one scan, as `OctoMap` has it: rays one by one, sets, hits before free.
fn naive(scan: &Scan<'_>, least: f64) -> BTreeMap<VoxelKey, LogOdds> {
    let map = VoxelMap::new(RESOLUTION_M);
    let (mut free, mut hit) = (BTreeSet::new(), BTreeSet::new());
    for point in scan.hits {
        let ray = *point - scan.origin;
        let is_cut = ray.norm() > scan.max_range_m;
        let end = if is_cut {
            scan.origin + ray * (scan.max_range_m / ray.norm())
        } else {
            *point
        };
        let key = map.key_of(end);
        let to = match scan.rays {
            Rays::EachPoint => end,
            Rays::EachVoxel => map.center_of(key),
        };
        free.extend(crossed(scan.origin, to, least));
        if !is_cut {
            hit.insert(key);
        }
    }
    let free = free.into_iter().map(|key| (key, LogOdds::MISS));
    free.chain(hit.into_iter().map(|key| (key, LogOdds::HIT)))
        .collect()
}

fn inserted(scans: &[Scan<'_>]) -> VoxelMap {
    let mut map = VoxelMap::new(RESOLUTION_M);
    for scan in scans {
        map.insert_scan(scan);
    }
    map
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn a_scan_is_what_its_rays_are_one_by_one(
        origin in any_points(3.0, 2), hits in any_points(9.0, 80), rays in any_rays()
    ) {
        let scan = Scan { rays, max_range_m: 8.0, carving: Carving::EveryVoxel, ..Scan::new(origin[0], &hits) };
        let map: BTreeMap<_, _> = inserted(&[scan]).known().map(|(key, v)| (key, v.log_odds)).collect();
        // Where a ray runs along an edge, either of the voxels beside it may count as crossed.
        let must = naive(&scan, 1e-9);
        for (key, log_odds) in &must {
            prop_assert_eq!(map.get(key), Some(log_odds), "{:?}", key);
        }
        let steps = |key: &VoxelKey, near: &VoxelKey| {
            [key.x - near.x, key.y - near.y, key.z - near.z].iter().all(|c| c.abs() <= 1)
        };
        for key in map.keys().filter(|key| !must.contains_key(key)) {
            prop_assert!(must.keys().any(|near| steps(key, near)), "{:?} is on no ray", key);
        }
        let on_grid = hits.iter().chain(&origin).any(|p| p.raw.iter().any(|c| (c * 20.0).fract() == 0.0));
        prop_assert!(on_grid || map.len() == must.len(), "{} voxels, not {}", map.len(), must.len());
    }

    #[test]
    fn threads_and_the_order_of_the_points_change_nothing(
        origin in any_points(2.0, 2), hits in any_points(20.0, 200), rays in any_rays(), carving in any_carving(),
        classes in prop::collection::vec((0..4_u8).prop_map(ClassId), 200)
    ) {
        let colors: Vec<_> = (0..hits.len()).map(|i| Rgb([i as u8, 7, 200])).collect();
        let scan = Scan {
            rays, carving, colors: &colors, classes: &classes, max_range_m: 15.0, ..Scan::new(origin[0], &hits)
        };
        let scans = [scan; 3];
        let digest = inserted(&scans).digest();
        for threads in [1, 2, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            prop_assert_eq!(pool.install(|| inserted(&scans).digest()), digest, "{} threads", threads);
        }
        let backwards: Vec<_> = hits.iter().rev().copied().collect();
        let [one, other] = [&hits, &backwards].map(|hits| {
            inserted(&[Scan { hits, colors: &[], classes: &[], ..scan }; 3]).digest()
        });
        prop_assert_eq!(one, other);
    }

    #[test]
    fn a_box_bounds_what_is_updated_and_nothing_else(
        hits in any_points(9.0, 60), corners in any_points(6.0, 3), rays in any_rays()
    ) {
        let corner = |i: usize| corners[i % corners.len()].raw;
        let (low, high) = (corner(0).inf(&corner(1)), corner(0).sup(&corner(1)));
        let scan = Scan { rays, ..Scan::new(Point::new(0.01, 0.02, 0.03), &hits) };
        let whole = inserted(&[scan]);
        let within = Some([Point::from_raw(low), Point::from_raw(high)]);
        let part: Vec<_> = inserted(&[Scan { within, ..scan }]).known().collect();
        let [low, high] = [low, high].map(|p| whole.key_of(Point::from_raw(p)));
        let expected: Vec<_> = whole.known().filter(|(key, _)| {
            (low.x..=high.x).contains(&key.x) && (low.y..=high.y).contains(&key.y) && (low.z..=high.z).contains(&key.z)
        }).collect();
        prop_assert_eq!(part, expected);
    }

    #[test]
    fn a_cube_counts_its_voxels(hits in any_points(14.0, 60), at in any_points(14.0, 2), level in 0..=9_u32) {
        let map = inserted(&[Scan::new(Point::origin(), &hits)]);
        let key = map.key_of(at[0]);
        let cube = map.cube(key, level);
        let coarse = |key: VoxelKey| [key.x, key.y, key.z].map(|c| c >> level);
        let inside: Vec<_> = map.known().filter(|(k, _)| coarse(*k) == coarse(key)).collect();
        prop_assert_eq!(cube.known, inside.len() as u64);
        prop_assert_eq!(cube.occupied, inside.iter().filter(|(_, v)| v.log_odds.is_occupied()).count() as u64);
        prop_assert_eq!(cube.volume, 1 << (3 * level));
        let cubes: BTreeSet<_> = map.occupied().map(|(k, _)| coarse(k)).collect();
        let found: BTreeSet<_> = map.occupied_cubes(level).into_iter().map(coarse).collect();
        prop_assert_eq!(found, cubes);
    }
}

#[test]
fn points_below_the_least_height_are_as_if_they_were_not_there() {
    let hits = [Point::new(3.0, 0.0, -0.5), Point::new(3.0, 0.0, 0.5)];
    let origin = Point::new(0.0, 0.0, 1.0);
    let filtered = Scan {
        min_height_m: 0.0,
        ..Scan::new(origin, &hits)
    };
    let without = Scan::new(origin, &hits[1..]);
    assert_eq!(
        inserted(&[filtered]).digest(),
        inserted(&[without]).digest()
    );
}

/// How many of the floor's voxels up to 10 m away are occupied after driving by: near at first, then far away for long.
fn floor_left(carving: Carving) -> f64 {
    let mut map = VoxelMap::new(RESOLUTION_M);
    for scan in 0..100 {
        let back_m = 0.13 * f64::from(scan);
        let origin = Point::new(-back_m, 0.0, 1.7);
        let hits: Vec<_> = (0..64)
            .flat_map(|beam| (-30..=30).map(move |turn| (beam, turn)))
            .map(|(beam, turn)| {
                let down = (2.0 + 0.4 * f64::from(beam)).to_radians();
                let (s, c) = (f64::from(turn) * 0.3).to_radians().sin_cos();
                let reach = (1.7 - 0.05) / down.tan();
                Point::new(origin.raw.x + reach * c, reach * s, 0.05)
            })
            .collect();
        map.insert_scan(&Scan {
            rays: Rays::EachPoint,
            carving,
            max_range_m: 40.0,
            ..Scan::new(origin, &hits)
        });
    }
    let floor = (35..65).flat_map(|x| (-6..6).map(move |y| VoxelKey::new(x, y, 0)));
    let (mut left, mut all) = (0.0, 0.0);
    for key in floor {
        all += 1.0;
        left += f64::from(u8::from(map.occupancy(key) == Occupancy::Occupied));
    }
    left / all
}

#[test]
fn a_floor_survives_a_hundred_scans_that_graze_it() {
    let (spared, carved) = (
        floor_left(Carving::SparesSurfaces),
        floor_left(Carving::EveryVoxel),
    );
    assert!(spared > 0.95, "{spared} of the floor is left");
    assert!(carved < 0.8 * spared, "{carved} is left when it is carved");
}

#[test]
fn a_thin_pole_before_a_wall_survives_a_hundred_scans_and_goes_when_it_is_taken_away() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    let pole = VoxelKey::new(50, 0, 10);
    let scan = |map: &mut VoxelMap, offset: i32, is_there: bool| {
        let origin = Point::new(0.0, 0.05, 1.05);
        // Rays 3 cm apart at the pole, which is 4 cm thick; the wall is at 8 m.
        let hits: Vec<_> = (-100..100)
            .map(|ray| {
                let y = 0.03 * f64::from(ray) + 0.001 * f64::from(offset % 30);
                if is_there && y.abs() < 0.02 {
                    Point::new(5.05, 0.05 + y, 1.05)
                } else {
                    Point::new(8.05, 0.05 + y * 8.0 / 5.0, 1.05)
                }
            })
            .collect();
        map.insert_scan(&Scan {
            rays: Rays::EachPoint,
            ..Scan::new(origin, &hits)
        });
    };
    for offset in 0..100 {
        scan(&mut map, offset, true);
        assert_eq!(map.occupancy(pole), Occupancy::Occupied, "scan {offset}");
    }
    for offset in 0..9 {
        scan(&mut map, offset, false);
    }
    assert_eq!(map.occupancy(pole), Occupancy::Free);
}

#[test]
fn known_noise_makes_a_hit_weigh_less_and_leaves_what_is_near_it_alone() {
    let hits = [Point::new(5.05, 0.05, 0.05)];
    let noise = Noise {
        constant_m: 0.05,
        per_m2: 0.0,
    };
    let map = inserted(&[Scan {
        noise,
        ..Scan::new(Point::new(0.05, 0.05, 0.05), &hits)
    }]);
    let log_odds = |x| map.voxel(VoxelKey::new(x, 0, 0)).map(|v| v.log_odds.0);
    assert_eq!(log_odds(50), Some(11), "one sigma to each border");
    assert_eq!(log_odds(49), None, "within two sigma");
    assert_eq!(log_odds(48), Some(-8));
}

#[test]
fn a_voxel_where_one_ray_is_cut_and_another_ends_is_occupied_whichever_comes_first() {
    // The greatest range ends inside of the voxel: one point is before it, the other beyond.
    let [near, far] = [5.01, 6.0].map(|x| Point::new(x, 0.05, 0.05));
    for hits in [[near, far], [far, near]] {
        for rays in [Rays::EachPoint, Rays::EachVoxel] {
            let scan = Scan {
                rays,
                max_range_m: 5.0,
                ..Scan::new(Point::new(0.05, 0.05, 0.05), &hits)
            };
            let map = inserted(&[scan]);
            assert_eq!(map.occupancy(map.key_of(near)), Occupancy::Occupied);
        }
    }
}
