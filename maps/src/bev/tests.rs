use nalgebra::{Isometry3, UnitQuaternion};
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::*;
use crate::evidence::{EvidenceMap, Look, Source, Tandem, View};
use crate::time::Stamp;

const RESOLUTION_M: f64 = 0.1;
/// One sheet of voxels, in the middle of the lowest layer.
const Z: i32 = 2;
const LOW: VoxelKey = VoxelKey::new(-120, -120, Z);
const HIGH: VoxelKey = VoxelKey::new(260, 120, Z);

fn pose(x: f64, y: f64, yaw: f64) -> Isometry<World, Bev> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry::claim(Isometry3::from_parts([x, y, 0.0].into(), rotation))
}

fn covariance(position_m: f64, yaw: f64) -> Matrix6<f64> {
    let (position, yaw) = (position_m * position_m, yaw * yaw);
    Matrix6::from_diagonal(&[position, position, 0.0, 0.0, 0.0, yaw].into())
}

/// One layer in which every cell is free but those whose middle is in `wall`.
fn grid(wall: impl Fn(Point<Bev>) -> bool) -> BevGrid {
    let mut grid = BevGrid::new(1).expect("one layer");
    for y in 0..BevGrid::CELLS {
        for x in 0..BevGrid::CELLS {
            let at = |c: usize| (c as f64 - 63.5) * BevGrid::CELL_M;
            let mass = if wall(Point::new(at(x), at(y), 0.0)) {
                Mass::occupied_by(0.8)
            } else {
                Mass::free_by(0.6)
            };
            grid.cell_mut([x, y, 0]).expect("inside").mass = mass;
        }
    }
    grid
}

fn observed(
    grid: &BevGrid,
    pose: Isometry<World, Bev>,
    covariance: &Matrix6<f64>,
) -> Vec<(VoxelKey, Observation)> {
    let view = BevView {
        grid,
        world_from_bev: pose,
        covariance: *covariance,
    };
    view.observations(RESOLUTION_M, LOW, HIGH)
        .expect("a good pose")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]
    #[test]
    fn a_turned_view_loses_and_gains_nothing(yaw in -3.2_f64..3.2, x in -2.0_f64..2.0, y in -2.0_f64..2.0, blur_m in 0.0_f64..0.4) {
        // Two metres by four, away from the edge of the grid.
        let grid = grid(|p| (3.0..5.0).contains(&p.raw.x) && (-2.0..2.0).contains(&p.raw.y));
        let sum: f64 = observed(&grid, pose(x, y, yaw), &covariance(blur_m, 0.0)).iter()
            .map(|(_, seen)| f64::from(seen.mass.occupied()) * RESOLUTION_M * RESOLUTION_M).sum();
        let area = sum / 0.8;
        // The blots reach three deviations: 0.3 % a side are cut off on each axis.
        prop_assert!((area - 8.0).abs() < 0.08, "{area} m²");
    }
}

#[test]
fn a_turned_view_has_no_holes_and_no_stairs() {
    let grid = grid(|p| p.raw.x.abs() < 8.0 && p.raw.y.abs() < 8.0);
    for step in 0..8 {
        let yaw = f64::from(step) * 0.2;
        let seen = observed(&grid, pose(0.03, -0.02, yaw), &Matrix6::zeros());
        // Every voxel well inside is occupied, every one well outside is free.
        for (key, seen) in &seen {
            let p = Point::<World>::new(
                f64::from(key.x) * 0.1 + 0.05,
                f64::from(key.y) * 0.1 + 0.05,
                0.0,
            );
            let q = pose(0.03, -0.02, yaw).inverse() * p;
            let depth = 8.0 - q.raw.x.abs().max(q.raw.y.abs());
            if depth > 0.15 {
                assert!(seen.mass.occupied() > 0.79, "{key:?} {seen:?}");
            } else if depth < -0.15 {
                assert!(seen.mass.free() > 0.59, "{key:?} {seen:?}");
            }
        }
    }
}

/// How thick, in metres, the wall is across which `occupied` voxels lie, row by row: the mean.
fn thickness_m(map: &EvidenceMap<Tandem>) -> (f64, usize) {
    let rows = -50..50;
    let mut widths = Vec::new();
    let mut pieces = 0;
    for y in rows {
        let row: Vec<_> = (30..80)
            .map(|x| map.mass(VoxelKey::new(x, y, Z), Stamp::ZERO).probability() > 0.5)
            .collect();
        widths.push(row.iter().filter(|occupied| **occupied).count());
        let starts = row.windows(2).filter(|pair| !pair[0] && pair[1]).count();
        pieces = pieces.max(starts);
    }
    let sum: usize = widths.iter().sum();
    (sum as f64 * RESOLUTION_M / widths.len() as f64, pieces)
}

#[test]
fn a_wall_seen_from_fifty_jittered_poses_stays_one_wall() {
    const JITTER_M: f64 = 0.2;
    let mut random = Pcg64::seed_from_u64(5);
    // Half a metre thick, from x = 5 to 5.5 m.
    let grid = grid(|p| (5.0..5.5).contains(&p.raw.x));
    let mut map = EvidenceMap::new(Tandem::default(), RESOLUTION_M);
    for view in 0..50 {
        // Near enough to normal: the sum of four uniform values.
        let mut jitter = || {
            (0..4).map(|_| random.random_range(-0.5..0.5)).sum::<f64>() * JITTER_M * 3_f64.sqrt()
        };
        let seen = observed(
            &grid,
            pose(jitter(), jitter(), 0.0),
            &covariance(JITTER_M, 0.0),
        );
        let look = Look {
            source: Source::Uav,
            at: Stamp::ZERO,
            view: View(view),
        };
        map.observe(&look, &seen);
    }
    let (thickness, pieces) = thickness_m(&map);
    assert_eq!(pieces, 1, "one wall, not several");
    assert!(
        (0.3..=0.5 + 2.0 * JITTER_M).contains(&thickness),
        "{thickness} m thick"
    );
}

#[test]
fn an_uncertain_heading_blurs_what_is_far_more_than_what_is_near() {
    let grid = grid(|p| (0.0..0.5).contains(&p.raw.y));
    let seen = observed(&grid, pose(0.0, 0.0, 0.0), &covariance(0.0, 0.03));
    let peak = |x: i32| {
        seen.iter()
            .filter(|(key, _)| key.x == x)
            .map(|(_, seen)| seen.mass.occupied())
            .fold(0.0, f32::max)
    };
    let (near, far) = (peak(10), peak(250));
    assert!(near > 0.75 && far < 0.3, "{near} at 1 m, {far} at 25 m");
}

#[test]
fn a_pose_that_is_none_is_refused() {
    let grid = grid(|_| false);
    let refused = |world_from_bev, covariance| {
        BevView {
            grid: &grid,
            world_from_bev,
            covariance,
        }
        .observations(RESOLUTION_M, LOW, HIGH)
    };
    assert_eq!(
        refused(pose(f64::NAN, 0.0, 0.0), Matrix6::zeros()),
        Err(BevError::Pose)
    );
    assert_eq!(
        refused(pose(0.0, 0.0, 0.0), Matrix6::repeat(f64::NAN)),
        Err(BevError::Covariance)
    );
    assert_eq!(
        refused(pose(0.0, 0.0, 0.0), -Matrix6::identity()),
        Err(BevError::Covariance)
    );
    assert_eq!(BevGrid::new(0), Err(BevError::Layers(0)));
    assert_eq!(BevGrid::new(33), Err(BevError::Layers(33)));
}

#[test]
fn a_view_far_away_says_nothing_and_costs_nothing() {
    let grid = grid(|_| true);
    assert_eq!(
        observed(&grid, pose(1e7, -1e7, 1.0), &covariance(0.1, 0.1)),
        []
    );
}

#[test]
fn a_point_is_in_the_cell_that_holds_it() {
    let grid = BevGrid::new(2).expect("two layers");
    let at = |x, y, z| grid.cell_at(Point::new(x, y, z));
    assert_eq!(at(0.0, 0.0, 0.0), Some([64, 64, 0]));
    assert_eq!(at(-32.0, 31.9, 0.9), Some([0, 127, 1]));
    for outside in [
        at(32.0, 0.0, 0.0),
        at(0.0, 0.0, 1.0),
        at(0.0, 0.0, -0.1),
        at(f64::NAN, 0.0, 0.0),
    ] {
        assert_eq!(outside, None);
    }
}
