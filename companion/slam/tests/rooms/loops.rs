//! Coming back to a place after a long way.

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use slam::{DenseKeyframe, Settings, Slam, State, Tracked};

use crate::scene::{Block, CAMERA, Scene, apart, looking, render_scene};

/// A corridor around a square block.
fn corridor() -> Scene {
    let block = |min, max| Block { min, max };
    Scene::new(
        block([0.0, 0.0, 0.0], [10.0, 10.0, 2.6]),
        vec![block([2.4, 2.4, 0.0], [7.6, 7.6, 2.6])],
    )
}

const SIDE_M: f64 = 7.6;
/// Frames along a side, and for a turn.
const ALONG: u64 = 95;
const TURN: u64 = 30;
const LAP: u64 = 4 * (ALONG + TURN);

/// Round and round the corridor, counter-clockwise, looking ahead and a little down.
fn round(i: u64) -> Isometry<World, Camera> {
    let (side, step) = (i / (ALONG + TURN) % 4, i % (ALONG + TURN));
    let along = step.min(ALONG) as f64 / ALONG as f64 * SIDE_M;
    let turned = step.saturating_sub(ALONG) as f64 / TURN as f64;
    let (near, far) = (1.2, 1.2 + SIDE_M);
    let [x, y] = match side {
        0 => [near + along, near],
        1 => [far, near + along],
        2 => [far - along, far],
        _ => [near, far - along],
    };
    let heading = (side as f64 + turned) * std::f64::consts::FRAC_PI_2;
    looking([x, y, 1.2], heading, 0.2)
}

/// The truth in the world of the SLAM, whose origin is below the first camera.
fn truth(i: u64) -> Isometry<World, Camera> {
    let mut pose = round(i).raw;
    pose.translation.vector.x -= 1.2;
    pose.translation.vector.y -= 1.2;
    Isometry::claim(pose)
}

/// Share of the points that are within 12 cm of a surface.
fn on_surface(scene: &Scene, dense: &[DenseKeyframe]) -> f64 {
    let (mut on, mut all) = (0u32, 0u32);
    for keyframe in dense {
        for (p, _) in keyframe.points().step_by(7) {
            let mut p = keyframe.world_from_camera * p;
            p.raw.x += 1.2;
            p.raw.y += 1.2;
            all += 1;
            on += u32::from(scene.distance(p) < 0.12);
        }
    }
    f64::from(on) / f64::from(all.max(1))
}

#[test]
fn drift_around_a_corridor_is_corrected_and_the_dense_map_made_anew() {
    // A focal length that is 1.5 % off turns every corner too far: the path does not close by itself.
    let wrong = Pinhole {
        fx: CAMERA.fx * 1.015,
        fy: CAMERA.fy * 1.015,
        ..CAMERA
    };
    let mut slam = Slam::new(wrong, Settings::default());
    let scene = corridor();
    let mut outcomes: Vec<Tracked> = Vec::new();
    let (mut dense, mut never_forgotten) = (Vec::new(), Vec::new());
    let mut anew_at = None;
    for i in 0..LAP + ALONG {
        let outcome = slam
            .track(&render_scene(i, round(i), &scene))
            .expect("a good frame");
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
        let update = slam.take_keyframes();
        if update.anew {
            anew_at.get_or_insert(i as usize);
            dense.clear();
        }
        never_forgotten.extend(update.keyframes.iter().filter(|_| !update.anew).cloned());
        dense.extend(update.keyframes);
        outcomes.push(outcome);
    }
    let anew_at = anew_at.expect("the loop is closed");
    let off = |i: usize| apart(outcomes[i].world_from_camera, truth(i as u64)).0;
    assert!(
        anew_at > LAP as usize - 60,
        "closed at {anew_at}, before the place was seen again"
    );
    let (before, after) = (off(anew_at - 1), off(anew_at));
    assert!(
        before > 0.25,
        "{before} m of drift, else this shows nothing"
    );
    assert!(after < 0.3 * before, "{after} m left of {before} m");
    assert!(outcomes[anew_at].reset_counter > outcomes[anew_at - 1].reset_counter);
    let path = (0..).zip(slam.trajectory());
    let worst = path
        .map(|(i, (_, pose))| apart(pose, truth(i)).0)
        .fold(0.0, f64::max);
    assert!(
        worst < 0.6 * before,
        "the correction is spread over the whole path: {worst} m of {before} m"
    );
    let corrected = on_surface(&scene, &dense);
    let uncorrected = on_surface(&scene, &never_forgotten);
    assert!(
        corrected > uncorrected + 0.05,
        "{corrected} of the points on a surface, {uncorrected} without"
    );
    let mut stamps: Vec<_> = dense.iter().map(|k| k.at).collect();
    assert!(stamps.is_sorted());
    stamps.dedup();
    assert_eq!(stamps.len(), dense.len(), "no keyframe twice");
}

#[test]
fn two_rooms_that_look_alike_are_not_taken_for_one() {
    let block = |min, max| Block { min, max };
    // Two rooms of 5 m with the same pattern on all walls, a door between them, and different tables.
    let scene = Scene {
        period_m: 5.0,
        ..Scene::new(
            block([-1.0, -2.5, 0.0], [9.0, 2.5, 2.6]),
            vec![
                block([1.9, -2.3, 0.0], [2.9, -1.3, 0.7]),
                block([3.9, -2.5, 0.0], [4.1, -0.7, 2.6]),
                block([3.9, 0.7, 0.0], [4.1, 2.5, 2.6]),
                block([7.2, 1.3, 0.0], [8.2, 2.3, 0.9]),
            ],
        )
    };
    let pose = |i: u64| {
        let x = 0.04 * i as f64;
        looking([x, 0.0, 1.2], 0.5 * (0.05 * i as f64).sin(), 0.25)
    };
    let mut slam = Slam::new(CAMERA, Settings::default());
    for i in 0..165 {
        let outcome = slam
            .track(&render_scene(i, pose(i), &scene))
            .expect("a good frame");
        let (off_m, _) = apart(outcome.world_from_camera, pose(i));
        assert_eq!(
            (outcome.state, outcome.reset_counter),
            (State::Tracking, 0),
            "frame {i}"
        );
        assert!(off_m < 0.1, "frame {i}: {off_m} m off");
        assert!(!slam.take_keyframes().anew);
    }
}
