//! The place is lost and found again, or a new map begins and is joined to the old one.

use std::time::Duration;

use maps::camera::RgbdFrame;
use maps::frame::{Camera, Isometry, World};
use slam::{Settings, Slam, State, Tracked};

use crate::scene::{Block, CAMERA, Scene, apart, looking, render, render_scene};
use crate::{TABLE, run, slam, truth, walk};

/// Nothing, because the lens is covered.
pub(crate) fn black(i: u64) -> RgbdFrame {
    let mut frame = render(i, walk(i), &[]);
    frame.rgb.fill([0; 3]);
    frame.depth_m.fill(0.0);
    frame
}

#[test]
fn a_covered_lens_loses_the_place_and_an_uncovered_one_finds_it_again() {
    let mut slam = slam();
    run(&mut slam, 30, |_| vec![TABLE]);
    let since = black(30).at;
    for i in 30..36 {
        let outcome = slam.track(&black(i)).expect("black, but well formed");
        assert_eq!(outcome.state, State::Lost { since });
        assert_eq!((outcome.points, outcome.keyframe), (0, false));
    }
    let found = slam
        .track(&render(36, walk(10), &[TABLE]))
        .expect("a good frame");
    assert_eq!((found.state, found.reset_counter), (State::Tracking, 1));
    let (off_m, _) = apart(found.world_from_camera, truth(10));
    assert!(off_m < 0.03, "{off_m} m off");
    assert_eq!(slam.trajectory().len(), 31, "lost frames have no pose");
}

#[test]
fn a_view_that_was_never_seen_is_not_taken_for_a_known_one() {
    let mut slam = slam();
    run(&mut slam, 30, |_| vec![TABLE]);
    let behind = looking([0.0, 0.0, 1.2], 3.0, 0.3);
    let outcome = slam
        .track(&render(30, behind, &[TABLE]))
        .expect("a good frame");
    assert!(
        matches!(outcome.state, State::Lost { .. }),
        "{:?}",
        outcome.state
    );
    assert!(outcome.covariance[(0, 0)] > 1e5, "an unknown pose says so");
}

/// Two rooms with a door between them: the western one, x below 4 m, and the eastern one.
fn two_rooms() -> Scene {
    let block = |min, max| Block { min, max };
    let room = block([-1.0, -2.5, 0.0], [9.0, 2.5, 2.6]);
    let blocks = vec![
        TABLE,
        block([3.9, -2.5, 0.0], [4.1, -0.7, 2.6]),
        block([3.9, 0.7, 0.0], [4.1, 2.5, 2.6]),
        block([7.0, 1.0, 0.0], [7.8, 2.0, 0.9]),
        block([5.2, -2.3, 0.0], [6.4, -1.6, 1.8]),
    ];
    Scene::new(room, blocks)
}

/// Somewhere between two poses, given as place, heading and angle down.
fn between(from: ([f64; 2], f64), to: ([f64; 2], f64), share: f64) -> Isometry<World, Camera> {
    let mix = |a: f64, b: f64| a + share * (b - a);
    let place = [mix(from.0[0], to.0[0]), mix(from.0[1], to.0[1]), 1.2];
    looking(place, mix(from.1, to.1), 0.3)
}

/// The camera in both rooms: 40 frames in the western one, then it is covered and carried into the eastern one, looks
/// around there from frame 50 on, turns, and walks back through the door.
fn kidnapped(i: u64) -> Option<Isometry<World, Camera>> {
    let turn = std::f64::consts::PI;
    let share = |from: u64, frames: u64| (i - from) as f64 / frames as f64;
    match i {
        0..40 => Some(between(
            ([0.0, -0.2], 0.0),
            ([0.6, 0.2], 0.25),
            share(0, 40),
        )),
        40..50 => None,
        50..110 => Some(between(([5.2, 0.0], 0.0), ([6.4, 0.0], 0.3), share(50, 60))),
        110..190 => Some(between(
            ([6.4, 0.0], 0.3),
            ([6.4, 0.0], turn),
            share(110, 80),
        )),
        190..330 => Some(between(
            ([6.4, 0.0], turn),
            ([1.0, 0.0], turn),
            share(190, 140),
        )),
        _ => Some(between(
            ([1.0, 0.0], turn),
            ([0.6, 0.0], 2.0 * turn),
            share(330, 80).min(1.0),
        )),
    }
}

fn kidnap(slam: &mut Slam, frames: u64, mut each: impl FnMut(u64, &mut Slam, Tracked)) {
    let scene = two_rooms();
    for i in 0..frames {
        let frame = kidnapped(i).map_or_else(|| black(i), |pose| render_scene(i, pose, &scene));
        let outcome = slam.track(&frame).expect("a good frame");
        each(i, slam, outcome);
    }
}

fn impatient() -> Slam {
    let settings = Settings {
        sought_for: Duration::from_millis(500),
        ..Settings::default()
    };
    Slam::new(CAMERA, settings)
}

#[test]
fn a_camera_carried_into_an_unknown_room_begins_a_new_map_which_is_joined_on_the_way_back() {
    let mut slam = impatient();
    let mut outcomes: Vec<Tracked> = Vec::new();
    let mut dense = Vec::new();
    let mut joined_at = None;
    kidnap(&mut slam, 450, |i, slam, outcome| {
        let update = slam.take_keyframes();
        let adrift = outcome.state == State::Tracking && outcome.covariance[(0, 0)] > 1e5;
        if adrift {
            assert!(
                !update.anew && update.keyframes.iter().all(|k| k.at < black(40).at),
                "frame {i}"
            );
        } else if update.anew {
            joined_at.get_or_insert(i);
            dense.clear();
        }
        dense.extend(update.keyframes);
        outcomes.push(outcome);
    });
    let joined_at = joined_at.expect("the maps are joined") as usize;
    assert!((330..430).contains(&joined_at), "at frame {joined_at}");
    check_no_silent_jump(&outcomes);
    let counter = |i: usize| outcomes[i].reset_counter;
    assert_eq!(counter(39), 0);
    // Corrections within the new map may count, too.
    let before = counter(joined_at - 1);
    assert!((1..4).contains(&before), "a new map: {before}");
    assert_eq!(counter(joined_at), before + 1, "one join");
    let origin = kidnapped(0).expect("it sees").raw.translation.vector;
    let truth = |i: u64| {
        let mut pose = kidnapped(i).expect("it sees").raw;
        pose.translation.vector.x -= origin.x;
        pose.translation.vector.y -= origin.y;
        Isometry::claim(pose)
    };
    for (i, outcome) in outcomes.iter().enumerate().skip(joined_at) {
        let (off_m, _) = apart(outcome.world_from_camera, truth(i as u64));
        assert!(off_m < 0.1, "frame {i}: {off_m} m off");
    }
    // What was seen while the place was not known is now in the right place too.
    let path = slam.trajectory();
    assert!(path.len() > 410, "{} frames", path.len());
    for (at, pose) in path {
        let i = outcomes.iter().position(|o| o.at == at).expect("a frame") as u64;
        let (off_m, _) = apart(pose, truth(i));
        assert!(off_m < 0.12, "frame {i}: {off_m} m off in the end");
    }
    dense.extend(slam.finish().keyframes);
    assert!(
        dense
            .iter()
            .any(|k| (black(60).at..black(180).at).contains(&k.at))
    );
    assert!(dense.is_sorted_by_key(|k| k.at));
}

/// A pose may move by more than a camera can in a frame only where the counter says so.
#[track_caller]
fn check_no_silent_jump(outcomes: &[Tracked]) {
    for (i, pair) in outcomes.windows(2).enumerate() {
        let (step_m, _) = apart(pair[0].world_from_camera, pair[1].world_from_camera);
        assert!(
            step_m < 0.3 || pair[0].reset_counter != pair[1].reset_counter,
            "frame {}: a silent jump of {step_m} m",
            i + 1
        );
    }
}

#[test]
fn a_map_that_is_not_joined_is_neither_in_the_path_nor_in_the_dense_map() {
    let mut slam = impatient();
    let mut last = None;
    kidnap(&mut slam, 130, |_, _, outcome| last = Some(outcome));
    let last = last.expect("130 frames");
    assert_eq!((last.state, last.reset_counter), (State::Tracking, 1));
    assert!(last.covariance[(0, 0)] > 1e5, "where that is, is not known");
    let path = slam.trajectory();
    assert_eq!(path.len(), 40, "{:?}", path.last());
    let dense = slam.finish();
    assert!(!dense.anew && !dense.keyframes.is_empty());
    assert!(dense.keyframes.iter().all(|k| k.at < black(40).at));
}

#[test]
fn a_camera_carried_back_is_found_in_the_old_map() {
    let mut slam = impatient();
    kidnap(&mut slam, 130, |_, _, _| {});
    for i in 130..134 {
        let outcome = slam.track(&black(i)).expect("black, but well formed");
        assert!(matches!(outcome.state, State::Lost { .. }));
    }
    let back = kidnapped(20).expect("it sees");
    let found = (134..140)
        .map(|i| {
            slam.track(&render_scene(i, back, &two_rooms()))
                .expect("a good frame")
        })
        .last()
        .expect("six frames");
    assert_eq!((found.state, found.reset_counter), (State::Tracking, 2));
    assert!(found.covariance[(0, 0)] < 1.0, "the place is known");
    let mut truth = back.raw;
    truth.translation.vector.y += 0.2;
    let (off_m, _) = apart(found.world_from_camera, Isometry::claim(truth));
    assert!(off_m < 0.03, "{off_m} m off");
}
