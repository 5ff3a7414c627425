use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::*;
use crate::voxel::{LogOdds, Voxel, VoxelKey};

const OCCUPIED: Voxel = Voxel::new(LogOdds::MAX);
const FREE: Voxel = Voxel::new(LogOdds::MIN);
const RESOLUTION_M: f64 = 0.05;

/// A map whose floor is at key 0 where `floor` gives a height, in voxels.
fn floor_of(edge: i32, floor: impl Fn(i32, i32) -> Option<i32>) -> VoxelMap {
    let mut map = VoxelMap::new(RESOLUTION_M);
    for x in 0..edge {
        for y in 0..edge {
            if let Some(z) = floor(x, y) {
                map.set_voxel(VoxelKey::new(x, y, z), OCCUPIED);
            }
        }
    }
    map
}

/// Occupied voxels in a box, all bounds inclusive.
fn add_box(map: &mut VoxelMap, low: [i32; 3], high: [i32; 3]) {
    for x in low[0]..=high[0] {
        for y in low[1]..=high[1] {
            for z in low[2]..=high[2] {
                map.set_voxel(VoxelKey::new(x, y, z), OCCUPIED);
            }
        }
    }
}

/// The cell over the voxel column `(x, y)`.
fn cell(grid: &Traversability, x: i32, y: i32) -> Cell {
    let middle = |key: i32| (f64::from(key) + 0.5) * RESOLUTION_M;
    grid.cell(middle(x), middle(y))
}

fn is_drivable(cell: Cell) -> bool {
    matches!(cell, Cell::Drivable { .. })
}

fn vehicle() -> Vehicle {
    Vehicle::default()
}

#[test]
fn a_flat_floor_is_drivable_at_no_extra_cost_and_ends_where_it_ends() {
    let grid = Traversability::from_map(&floor_of(40, |_, _| Some(0)), &vehicle());
    for x in 0..40 {
        let Cell::Drivable { height_m, cost } = cell(&grid, x, 20) else {
            panic!("{x}: {:?}", cell(&grid, x, 20));
        };
        assert!((height_m - 0.025).abs() < 1e-9 && cost.abs() < 1e-9);
    }
    assert_eq!(cell(&grid, -1, 20), Cell::Unknown);
    assert_eq!(cell(&grid, 40, 20), Cell::Unknown);
    assert!(grid.clearance_m(1.0, 1.0).is_infinite());
}

#[test]
fn a_floor_that_is_a_voxel_too_high_or_low_here_and_there_is_no_obstacle() {
    for seed in 0..4 {
        let mut noise = Pcg64::seed_from_u64(seed);
        let mut heights = vec![0; 60 * 60];
        for height in &mut heights {
            *height = match noise.random_range(0..10) {
                0..2 => -1,
                2..4 => 1,
                _ => 0,
            };
        }
        let map = floor_of(60, |x, y| Some(heights[(y * 60 + x) as usize]));
        let grid = Traversability::from_map(&map, &vehicle());
        let drivable = (0..60)
            .flat_map(|x| (0..60).map(move |y| (x, y)))
            .filter(|&(x, y)| is_drivable(cell(&grid, x, y)))
            .count();
        assert_eq!(drivable, 3600, "seed {seed}");
    }
}

#[test]
fn a_kerb_of_two_voxels_is_a_step_and_one_of_one_voxel_is_not() {
    for (height, passable) in [(1, true), (2, false), (-1, true), (-2, false)] {
        let map = floor_of(40, |x, _| Some(if x < 20 { 0 } else { height }));
        let grid = Traversability::from_map(&map, &vehicle());
        let crossing = (0..40).all(|x| is_drivable(cell(&grid, x, 20)));
        assert_eq!(crossing, passable, "{height} voxels");
        assert!(is_drivable(cell(&grid, 5, 20)) && is_drivable(cell(&grid, 35, 20)));
    }
}

#[test]
fn a_vehicle_that_climbs_higher_steps_passes_a_higher_kerb() {
    let map = floor_of(40, |x, _| Some(if x < 20 { 0 } else { 3 }));
    let climber = Vehicle {
        max_step_m: 0.16,
        ..vehicle()
    };
    let grid = Traversability::from_map(&map, &climber);
    assert!((0..40).all(|x| cell(&grid, x, 20) != Cell::Blocked));
}

#[test]
fn a_platform_too_high_to_climb_is_blocked_all_over() {
    let map = floor_of(40, |x, _| Some(if x < 20 { 0 } else { 4 }));
    let grid = Traversability::from_map(&map, &vehicle());
    assert!((0..20).all(|x| is_drivable(cell(&grid, x, 20))));
    assert!((20..40).all(|x| cell(&grid, x, 20) == Cell::Blocked));
}

#[test]
fn a_thin_plank_on_the_floor_is_an_obstacle() {
    let mut map = floor_of(40, |_, _| Some(0));
    add_box(&mut map, [10, 5, 1], [11, 35, 2]);
    let grid = Traversability::from_map(&map, &vehicle());
    assert_eq!(cell(&grid, 10, 20), Cell::Blocked);
    assert_eq!(cell(&grid, 11, 20), Cell::Blocked);
    assert!(is_drivable(cell(&grid, 6, 20)));
}

#[track_caller]
fn check_ramp(slope: f64, passable: bool) {
    let map = floor_of(60, |x, _| Some((f64::from(x) * slope).round() as i32));
    let grid = Traversability::from_map(&map, &vehicle());
    let drivable = (10..50)
        .filter(|&x| is_drivable(cell(&grid, x, 30)))
        .count();
    if passable {
        assert_eq!(drivable, 40, "slope {slope}");
    } else {
        assert_eq!(drivable, 0, "slope {slope}");
    }
}

#[test]
fn a_ramp_is_drivable_up_to_the_slope_limit_whatever_its_stairs_of_voxels() {
    // The limit is 0.35 rad, a slope of 0.365, and half a voxel over 11 is 0.045.
    check_ramp(0.1, true);
    check_ramp(0.3, true);
    check_ramp(0.5, false);
    check_ramp(0.9, false);
}

#[test]
fn steeper_ground_costs_more() {
    let cost = |slope: f64| {
        let map = floor_of(60, |x, _| Some((f64::from(x) * slope).round() as i32));
        match cell(&Traversability::from_map(&map, &vehicle()), 30, 30) {
            Cell::Drivable { cost, .. } => cost,
            other => panic!("{other:?}"),
        }
    };
    assert!(cost(0.0) < cost(0.2) && cost(0.2) < cost(0.33));
}

/// Is the floor under a table whose top begins `gap` voxels above it drivable for a vehicle 0.35 m (7 voxels) high?
#[track_caller]
fn check_table(gap: i32, passable: bool) {
    let mut map = floor_of(40, |_, _| Some(0));
    add_box(&mut map, [10, 10, gap + 1], [29, 29, gap + 1]);
    let grid = Traversability::from_map(&map, &vehicle());
    assert_eq!(is_drivable(cell(&grid, 20, 20)), passable, "gap {gap}");
    assert_eq!(cell(&grid, 20, 20) == Cell::Blocked, !passable, "gap {gap}");
    assert!(is_drivable(cell(&grid, 5, 5)));
}

#[test]
fn a_table_is_driven_under_only_if_it_is_higher_than_the_vehicle() {
    check_table(7, true);
    check_table(14, true);
    check_table(6, false);
    check_table(2, false);
}

#[test]
fn a_table_over_unseen_floor_is_unknown_and_a_box_there_is_blocked() {
    let unseen = |x: i32, y: i32| (10..30).contains(&x) && (10..30).contains(&y);
    let mut map = floor_of(40, |x, y| (!unseen(x, y)).then_some(0));
    add_box(&mut map, [10, 10, 15], [29, 29, 15]);
    let grid = Traversability::from_map(&map, &vehicle());
    assert_eq!(
        cell(&grid, 20, 20),
        Cell::Unknown,
        "a table top seen from above"
    );
    add_box(&mut map, [10, 10, 6], [29, 29, 6]);
    let grid = Traversability::from_map(&map, &vehicle());
    assert_eq!(
        cell(&grid, 20, 20),
        Cell::Blocked,
        "a box 0.35 m high seen from above"
    );
}

#[test]
fn a_ceiling_larger_than_the_floor_is_not_the_ground() {
    let mut map = floor_of(40, |x, _| (x < 25).then_some(0));
    add_box(&mut map, [0, 0, 50], [39, 39, 50]);
    let grid = Traversability::from_map(&map, &vehicle());
    assert!(is_drivable(cell(&grid, 10, 10)));
    assert_eq!(cell(&grid, 35, 10), Cell::Unknown, "under the ceiling only");
}

#[test]
fn walls_are_blocked_from_the_floor_up() {
    let mut map = floor_of(40, |_, _| Some(0));
    add_box(&mut map, [0, 39, 0], [39, 39, 40]);
    let grid = Traversability::from_map(&map, &vehicle());
    assert_eq!(cell(&grid, 20, 39), Cell::Blocked);
    assert!(is_drivable(cell(&grid, 20, 37)));
    let in_front = grid.clearance_m(1.025, 38.5 * RESOLUTION_M);
    assert!((in_front - 0.025).abs() < 1e-6, "{in_front} m");
}

/// Is a square hole of `edge` cells in the seen floor drivable if gaps of 0.15 m to either side are bridged?
#[track_caller]
fn check_hole(edge: i32, fill_radius_m: f64, bridged: bool) {
    let hole = |x: i32, y: i32| (15..15 + edge).contains(&x) && (15..15 + edge).contains(&y);
    let map = floor_of(40, |x, y| (!hole(x, y)).then_some(0));
    let settings = GroundSettings { fill_radius_m };
    let grid = Traversability::from_map_with(&map, &vehicle(), settings);
    for x in 15..15 + edge {
        for y in 15..15 + edge {
            assert_eq!(
                is_drivable(cell(&grid, x, y)),
                bridged,
                "{edge} cells, ({x}, {y})"
            );
        }
    }
}

#[test]
fn gaps_up_to_twice_the_fill_radius_are_bridged() {
    check_hole(1, 0.15, true);
    check_hole(4, 0.15, true);
    check_hole(6, 0.15, true);
    check_hole(1, 0.0, false);
}

#[test]
fn the_middle_of_a_wide_hole_stays_unknown() {
    let hole = |x: i32, y: i32| (10..30).contains(&x) && (10..30).contains(&y);
    let map = floor_of(40, |x, y| (!hole(x, y)).then_some(0));
    let grid = Traversability::from_map(&map, &vehicle());
    assert_eq!(cell(&grid, 20, 20), Cell::Unknown);
    assert_eq!(cell(&grid, 12, 20), Cell::Unknown, "its edge is not moved");
}

#[test]
fn a_bridged_gap_costs_more_than_seen_ground() {
    let map = floor_of(40, |x, y| (x != 20 || y != 20).then_some(0));
    let grid = Traversability::from_map(&map, &vehicle());
    let Cell::Drivable { height_m, cost } = cell(&grid, 20, 20) else {
        panic!("not bridged");
    };
    assert!((height_m - 0.025).abs() < 1e-9 && cost > 0.5);
}

#[test]
fn a_hole_that_rays_went_into_is_not_bridged() {
    let hole = |x: i32, y: i32| (18..22).contains(&x) && (18..22).contains(&y);
    let mut map = floor_of(40, |x, y| (!hole(x, y)).then_some(0));
    for x in 18..22 {
        for y in 18..22 {
            for z in -10..0 {
                map.set_voxel(VoxelKey::new(x, y, z), FREE);
            }
        }
    }
    let grid = Traversability::from_map(&map, &vehicle());
    assert_eq!(cell(&grid, 20, 20), Cell::Unknown);
}

#[test]
fn a_gap_between_two_heights_is_not_bridged() {
    let map = floor_of(40, |x, _| match x {
        ..18 => Some(0),
        18..22 => None,
        _ => Some(8),
    });
    let grid = Traversability::from_map(&map, &vehicle());
    assert!((18..22).all(|x| cell(&grid, x, 20) == Cell::Unknown));
}

#[test]
fn a_map_without_anything_has_no_cells_and_one_without_ground_no_drivable_ones() {
    let empty = Traversability::from_map(&VoxelMap::new(RESOLUTION_M), &vehicle());
    assert_eq!(empty.size(), (0, 0));
    let mut map = VoxelMap::new(RESOLUTION_M);
    map.set_voxel(VoxelKey::new(0, 0, 0), FREE);
    let grid = Traversability::from_map(&map, &vehicle());
    assert!(grid.cells().all(|(_, cell)| cell == Cell::Unknown));
}

#[test]
fn two_voxels_at_opposite_ends_of_the_world_make_a_grid_of_bounded_size() {
    let mut map = VoxelMap::new(RESOLUTION_M);
    map.set_voxel(VoxelKey::new(-32_768, -32_768, 0), OCCUPIED);
    map.set_voxel(VoxelKey::new(32_767, 32_767, 0), OCCUPIED);
    let grid = Traversability::from_map(&map, &vehicle());
    assert_eq!(grid.size(), (MAX_EDGE_CELLS, MAX_EDGE_CELLS));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
    #[test]
    fn no_map_and_no_vehicle_makes_it_panic_and_costs_are_never_negative(
        voxels in prop::collection::vec((-20_i32..20, -20_i32..20, -6_i32..12, any::<bool>()), 0..400),
        numbers in prop::collection::vec(
            prop_oneof![0.0..2.0_f64, Just(f64::NAN), Just(f64::INFINITY), Just(-1.0), Just(1e300)], 8)
    ) {
        let mut map = VoxelMap::new(0.1);
        for (x, y, z, occupied) in voxels {
            map.set_voxel(VoxelKey::new(x, y, z), if occupied { OCCUPIED } else { FREE });
        }
        let wild = Vehicle {
            length_m: numbers[0], width_m: numbers[1], height_m: numbers[2], wheelbase_m: numbers[3],
            min_turning_radius_m: numbers[4], max_step_m: numbers[5], max_slope_rad: numbers[6],
        };
        let settings = GroundSettings { fill_radius_m: numbers[7] };
        for vehicle in [wild, vehicle()] {
            let grid = Traversability::from_map_with(&map, &vehicle, settings);
            for (_, cell) in grid.cells() {
                if let Cell::Drivable { height_m, cost } = cell {
                    prop_assert!(height_m.is_finite() && cost >= 0.0);
                }
            }
            prop_assert_eq!(&grid, &Traversability::from_map_with(&map, &vehicle, settings));
        }
    }
}
