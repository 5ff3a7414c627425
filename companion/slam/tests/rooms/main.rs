//! SLAM in rendered rooms, where the truth is known: claims about what comes out of the crate.

mod disturbed;
mod inertial;
mod loops;
mod lost;
mod objects;
mod positions;
mod scene;

use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::Vector6;
use proptest::prelude::*;
use scene::{Block, CAMERA, apart, looking, point, render};
use slam::{DenseKeyframe, FrameError, Moving, Settings, Slam, State, Tracked};

const TABLE: Block = Block {
    min: [2.6, -1.6, 0.0],
    max: [3.4, -0.6, 0.7],
};

/// A camera that walks to the side and turns, 1.2 m over the floor.
fn walk(i: u64) -> Isometry<World, Camera> {
    let t = i as f64 / 30.0;
    let sway = (1.3 * t).sin();
    looking(
        [
            0.15 * sway,
            0.4 * (0.8 * t).sin(),
            1.2 + 0.05 * (2.1 * t).sin(),
        ],
        0.25 * (0.9 * t).sin(),
        0.35 + 0.05 * sway,
    )
}

/// A block as large as a person, walking across the view from frame 30 on.
fn walker(i: u64) -> Vec<Block> {
    let mut blocks = vec![TABLE];
    if i >= 30 {
        let y = 2.4 - 0.045 * (i - 30) as f64;
        blocks.push(Block {
            min: [1.6, y - 0.25, 0.0],
            max: [1.9, y + 0.25, 1.7],
        });
    }
    blocks
}

fn slam() -> Slam {
    Slam::new(CAMERA, Settings::default())
}

fn run(slam: &mut Slam, frames: u64, blocks: impl Fn(u64) -> Vec<Block>) -> Vec<Tracked> {
    (0..frames)
        .map(|i| {
            slam.track(&render(i, walk(i), &blocks(i)))
                .expect("a good frame")
        })
        .collect()
}

/// The truth in the world of the SLAM, whose origin is below the first camera and whose x axis is its heading.
fn truth(i: u64) -> Isometry<World, Camera> {
    let first = walk(0).raw;
    let mut pose = walk(i).raw;
    pose.translation.vector.x -= first.translation.vector.x;
    pose.translation.vector.y -= first.translation.vector.y;
    Isometry::claim(pose)
}

#[test]
fn the_path_of_the_camera_and_the_height_of_the_floor_are_found() {
    let mut slam = slam();
    let outcomes = run(&mut slam, 75, |_| vec![TABLE]);
    for (i, outcome) in (0..).zip(&outcomes) {
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
        let (off_m, off_rad) = apart(outcome.world_from_camera, truth(i));
        assert!(
            off_m < 0.02 && off_rad < 0.01,
            "frame {i}: {off_m} m, {off_rad} rad off"
        );
    }
    let path = slam.trajectory();
    assert_eq!(path.len(), 75);
    let (off_m, _) = apart(path[74].1, truth(74));
    assert!(off_m < 0.02, "{off_m} m off at the end");
}

/// The normalised error: eᵀ·P⁻¹·e of the six coordinates of a pose is distributed as χ², with a mean of 6, if the covariance is
/// honest. The room has neither a lens nor a clock that is off, which the covariance allows for: it may be too large.
#[test]
fn a_pose_is_no_farther_off_than_its_covariance_says() {
    let mut slam = slam();
    let outcomes = run(&mut slam, 150, |_| vec![TABLE]);
    let errors = (1..150).map(|i| {
        let outcome = &outcomes[i as usize];
        let off = outcome.world_from_camera.raw.inverse() * truth(i).raw;
        let (t, r) = (off.translation.vector, off.rotation.scaled_axis());
        let e = Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z);
        let covariance = outcome.covariance.cholesky();
        e.dot(&covariance.expect("positive definite").solve(&e))
    });
    let errors: Vec<f64> = errors.collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64 / 6.0;
    assert!((0.01..1.0).contains(&mean), "{mean}");
    let unlikely = errors.iter().filter(|e| **e > 12.592).count();
    assert!(20 * unlikely <= errors.len(), "{unlikely} beyond 95 %");
}

#[test]
fn nothing_moves_in_a_room_where_nothing_moves() {
    let outcomes = run(&mut slam(), 60, |_| vec![TABLE]);
    let most = outcomes.iter().map(|o| o.moving_share).fold(0.0, f64::max);
    assert!(most < 1e-9, "{most} of a frame is said to move");
}

#[test]
fn somebody_who_walks_by_disturbs_neither_the_pose_nor_the_map() {
    let mut slam = slam();
    let outcomes = run(&mut slam, 110, walker);
    let dense = all_keyframes(&mut slam);
    for (i, outcome) in (0..).zip(&outcomes) {
        let (off_m, _) = apart(outcome.world_from_camera, truth(i));
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
        assert!(off_m < 0.03, "frame {i}: {off_m} m off");
    }
    assert!(
        outcomes[70].moving_share > 0.05,
        "{} in full view",
        outcomes[70].moving_share
    );
    let (ghosts, all) = count_ghosts(&dense);
    assert!(
        ghosts * 500 < all,
        "{ghosts} of {all} points are where only the walker was"
    );
}

/// Everything for the dense map, from a run in which no loop was closed.
fn all_keyframes(slam: &mut Slam) -> Vec<DenseKeyframe> {
    let taken = slam.take_keyframes();
    let rest = slam.finish();
    assert!(!taken.anew && !rest.anew, "nothing was corrected");
    [taken.keyframes, rest.keyframes].concat()
}

/// Points in the aisle where only the walker ever was, clear of floor and walls; and all points.
fn count_ghosts(dense: &[DenseKeyframe]) -> (usize, usize) {
    let aisle = Block {
        min: [1.55, -2.2, 0.15],
        max: [1.95, 2.2, 1.75],
    };
    let place = |k: &DenseKeyframe| {
        let points = k.points().map(|(p, _)| k.world_from_camera * p);
        points.collect::<Vec<_>>()
    };
    let points: Vec<_> = dense.iter().flat_map(place).collect();
    let ghosts = points.iter().filter(|p| aisle.contains(**p, 0.0)).count();
    (ghosts, points.len())
}

#[test]
fn without_rejection_the_walker_ends_in_the_map() {
    let settings = Settings {
        moving: Moving::Ignore,
        ..Settings::default()
    };
    let mut slam = Slam::new(CAMERA, settings);
    let outcomes = run(&mut slam, 110, walker);
    let dense = all_keyframes(&mut slam);
    assert!(
        outcomes
            .iter()
            .all(|o| o.rejected == 0 && o.moving_share < 1e-9)
    );
    assert!(
        count_ghosts(&dense).0 > 100,
        "else the test above shows nothing"
    );
}

#[test]
fn dense_points_lie_on_the_surfaces_of_the_room() {
    let mut slam = slam();
    run(&mut slam, 60, |_| vec![TABLE]);
    let dense = slam.finish().keyframes;
    assert!(dense.iter().map(|k| k.at).is_sorted());
    let mut counted = 0;
    for keyframe in &dense {
        for (p, _) in keyframe.points() {
            let p = keyframe.world_from_camera * p;
            let off = |v: f64, surfaces: &[f64]| {
                surfaces.iter().map(|s| (v - s).abs()).fold(9.0, f64::min)
            };
            let on_room = off(p.raw.z, &[0.0, 2.6])
                .min(off(p.raw.x, &[4.0]))
                .min(off(p.raw.y, &[2.5, -2.5]));
            assert!(
                on_room < 0.04 || TABLE.contains(p, 0.04),
                "{p:?} hangs in the air"
            );
            counted += 1;
        }
    }
    assert!(counted > 10_000, "{counted} points");
    assert!(!TABLE.contains(point(0.0, 0.0, 0.0), 0.04));
}

#[test]
fn what_was_seen_for_less_than_a_second_is_mapped_though_there_are_not_two_to_confirm_it() {
    let mut slam = slam();
    run(&mut slam, 20, |_| vec![TABLE]);
    let dense = slam.finish().keyframes;
    let points: usize = dense.iter().map(|k| k.points().count()).sum();
    assert_eq!(dense.len(), 2, "else the test shows nothing");
    assert!(points > 5_000, "{points} points");
}

#[test]
fn the_same_frames_give_the_same_bits() {
    let once = || {
        let mut slam = slam();
        let outcomes = run(&mut slam, 50, walker);
        let dense = all_keyframes(&mut slam);
        (outcomes, slam.trajectory(), dense)
    };
    assert!(once() == once());
}

#[test]
fn nothing_starts_in_the_dark() {
    let mut slam = slam();
    for i in 0..3 {
        assert_eq!(
            slam.track(&lost::black(i)).map(|o| o.state),
            Ok(State::Searching)
        );
    }
    assert!(slam.trajectory().is_empty() && slam.finish().keyframes.is_empty());
}

#[test]
fn a_frame_of_the_wrong_size_or_time_is_refused_with_the_numbers() {
    let mut slam = slam();
    let good = render(1, walk(0), &[TABLE]);
    let mut narrow = good.clone();
    narrow.width = 319;
    let mut short = good.clone();
    short.depth_m.pop();
    assert_eq!(
        slam.track(&narrow).map_err(|e| e.to_string()),
        Err("the frame is 319 x 240 pixels, the camera takes 320 x 240".to_owned())
    );
    assert_eq!(
        slam.track(&short),
        Err(FrameError::Length {
            expected: 76_800,
            rgb: 76_800,
            depth: 76_799,
        })
    );
    assert!(
        slam.track(&good).is_ok(),
        "what was refused has done no harm"
    );
    assert_eq!(
        slam.track(&good),
        Err(FrameError::Order {
            at: good.at,
            before: good.at,
        })
    );
}

#[test]
fn the_map_stays_within_its_limits() {
    let settings = Settings {
        max_keyframes: 6,
        max_points: 700,
        window: 3,
        ..Settings::default()
    };
    let mut slam = Slam::new(CAMERA, settings);
    for i in 0..80 {
        slam.track(&render(i, walk(3 * i), &[TABLE]))
            .expect("a good frame");
        let (points, keyframes) = slam.map_size();
        assert!(
            points <= 700 && keyframes <= 6,
            "{points} points, {keyframes} keyframes"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn no_image_makes_it_panic(seed: u64, wild in prop::collection::vec(any::<f32>(), 1..64), noise: bool) {
        let mut slam = slam();
        let mut h = seed;
        let mut next = || {
            h = h.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (h >> 33) as usize
        };
        for i in 0..3u64 {
            let mut frame = render(i, walk(4 * i), &[TABLE]);
            for depth in &mut frame.depth_m {
                if next() % 3 == 0 {
                    *depth = wild[next() % wild.len()];
                }
            }
            if noise {
                frame.rgb.iter_mut().for_each(|p| *p = [next() as u8; 3]);
            }
            let outcome = slam.track(&frame).expect("well formed");
            prop_assert!(outcome.world_from_camera.is_finite());
        }
        for keyframe in slam.finish().keyframes {
            prop_assert!(keyframe.points().all(|(p, _)| p.is_finite()));
        }
        prop_assert!(slam.trajectory().iter().all(|(at, _)| *at >= Stamp::ZERO));
    }
}
