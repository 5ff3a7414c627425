use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::*;
use crate::traversability::{CellIndex, Layer};
use crate::voxel::{ClassId, LogOdds, Voxel, VoxelKey};

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
    let settings = GroundSettings {
        fill_radius_m,
        ..GroundSettings::default()
    };
    let grid = Traversability::from_map_with(&map, &vehicle(), &settings);
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

#[track_caller]
fn why(grid: &Traversability, x: i32, y: i32) -> Hindrance {
    let middle = |key: i32| (f64::from(key) + 0.5) * RESOLUTION_M;
    let index = grid.index_of(middle(x), middle(y)).expect("on the grid");
    assert_eq!(grid.cell_at(index), Cell::Blocked);
    grid.hindrance(index).expect("a reason")
}

#[test]
fn a_blocked_cell_says_what_blocks_it() {
    let mut map = floor_of(60, |x, y| Some(if x < 20 && y < 30 { -2 } else { 0 }));
    add_box(&mut map, [40, 5, 1], [45, 25, 30]);
    add_box(&mut map, [40, 40, 5], [50, 50, 6]);
    let grid = Traversability::from_map(&map, &vehicle());
    assert_eq!(why(&grid, 19, 10), Hindrance::Step { rise_m: 0.1 });
    let tree = why(&grid, 45, 45);
    assert_eq!(tree, Hindrance::Overhang { gap_m: 0.2 });
    assert_eq!(tree.to_string(), "an overhang at 0.20 m");
    assert_eq!(why(&grid, 42, 15).to_string(), "an obstacle 1.50 m high");
    let steep = floor_of(60, |x, _| Some((f64::from(x) * 0.6).round() as i32));
    let grid = Traversability::from_map(&steep, &vehicle());
    let Hindrance::Slope { angle_rad } = why(&grid, 30, 30) else {
        panic!("{}", why(&grid, 30, 30));
    };
    // Heights are whole voxels: the plane through them is off by a step in the width it is laid through.
    assert!((angle_rad.to_degrees() - 31.0).abs() < 1.5, "{angle_rad}");
}

#[test]
fn layers_show_one_kind_each_and_nothing_where_nothing_is_known() {
    let mut map = floor_of(40, |x, _| (x < 30).then_some(0));
    add_box(&mut map, [10, 10, 20], [19, 19, 20]);
    let grid = Traversability::from_map(&map, &vehicle());
    let layer = |layer, x: f64, y: f64| {
        let index = grid
            .index_of(x * RESOLUTION_M, y * RESOLUTION_M)
            .expect("on the grid");
        grid.layer(layer, index)
    };
    let headroom = layer(Layer::Headroom, 15.5, 15.5).expect("a ceiling");
    assert!((headroom - 0.95).abs() < 1e-6, "{headroom} m");
    assert_eq!(layer(Layer::Headroom, 5.5, 5.5), None, "the sky");
    assert_eq!(layer(Layer::Step, 5.5, 5.5), Some(0.0));
    assert_eq!(layer(Layer::Class, 5.5, 5.5), None, "not classified");
    let beyond = CellIndex { x: 9999, y: 0 };
    for kind in Layer::ALL {
        assert_eq!(
            layer(kind, 35.5, 5.5),
            None,
            "{kind:?} of what nobody has seen"
        );
        assert_eq!(grid.layer(kind, beyond), None, "{kind:?} outside");
    }
}

#[test]
fn ground_of_a_class_costs_or_blocks_as_its_rule_says() {
    let mut map = floor_of(40, |_, _| None);
    for (x, y) in (0..40).flat_map(|x| (0..40).map(move |y| (x, y))) {
        let class = ClassId(if x < 20 { 3 } else { 7 });
        map.set_voxel(VoxelKey::new(x, y, 0), Voxel { class, ..OCCUPIED });
    }
    let rules = [
        (ClassId(3), ClassRule::Cost(0.5)),
        (ClassId(7), ClassRule::Blocked),
    ];
    let settings = GroundSettings {
        classes: rules.into_iter().collect(),
        ..GroundSettings::default()
    };
    let grid = Traversability::from_map_with(&map, &vehicle(), &settings);
    let Cell::Drivable { cost, .. } = cell(&grid, 10, 20) else {
        panic!("{:?}", cell(&grid, 10, 20));
    };
    assert!((cost - 0.5).abs() < 1e-9, "{cost}");
    let class = ClassId(7);
    assert_eq!(why(&grid, 30, 20), Hindrance::Class { class });
}

/// A road at 0 and a bridge over it: ramps up to 1 m at both ends and a deck between them.
fn bridge() -> VoxelMap {
    let mut map = floor_of(160, |_, _| Some(0));
    for x in 20..140 {
        let height = (x - 20).min(139 - x).min(80) / 4;
        let height = height.min(12);
        for y in 70..90 {
            // Earth under the ramps, air under the deck.
            let under = if height < 12 { 0 } else { height };
            for z in under..=height {
                map.set_voxel(VoxelKey::new(x, y, z), OCCUPIED);
            }
        }
    }
    map
}

#[test]
fn a_bridge_is_driven_under_from_the_road_and_over_from_its_deck() {
    let map = bridge();
    let height = |at: Option<Point<World>>, x: i32, y: i32| {
        let settings = GroundSettings {
            at,
            ..GroundSettings::default()
        };
        match cell(
            &Traversability::from_map_with(&map, &vehicle(), &settings),
            x,
            y,
        ) {
            Cell::Drivable { height_m, .. } => Some(height_m),
            Cell::Blocked | Cell::Unknown => None,
        }
    };
    let at = |x: i32, y: i32, z: i32| Some(map.center_of(VoxelKey::new(x, y, z)));
    let (road, deck) = (at(80, 20, 0), at(80, 80, 12));
    assert_eq!(
        height(None, 80, 80),
        Some(0.025),
        "the lowest, if nothing is known"
    );
    assert_eq!(height(road, 80, 80), Some(0.025), "under the deck");
    assert_eq!(height(deck, 80, 80), Some(0.625), "on the deck");
    assert_eq!(
        height(deck, 80, 20),
        Some(0.025),
        "the road, by way of the ramp"
    );
    for x in 20..140 {
        assert!(height(deck, x, 80).is_some(), "along the bridge at {x}");
    }
    for y in 60..100 {
        assert!(height(road, 80, y).is_some(), "under the bridge at {y}");
    }
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
        let at = Point::new(numbers[0], numbers[1], numbers[2]);
        let settings = GroundSettings {
            fill_radius_m: numbers[7], at: Some(at), ..GroundSettings::default()
        };
        for vehicle in [wild, vehicle()] {
            let grid = Traversability::from_map_with(&map, &vehicle, &settings);
            for (_, cell) in grid.cells() {
                if let Cell::Drivable { height_m, cost } = cell {
                    prop_assert!(height_m.is_finite() && cost >= 0.0);
                }
            }
            prop_assert_eq!(&grid, &Traversability::from_map_with(&map, &vehicle, &settings));
        }
    }
}
