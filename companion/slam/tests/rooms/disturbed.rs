//! What goes wrong in flight: blur, lost depth, somebody before the lens, a jerk. The SLAM goes on or says that it is
//! lost; it never tells a wrong pose, and no jump without counting it.

use maps::camera::RgbdFrame;
use maps::frame::{Camera, Isometry, World};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use slam::{Aid, Settings, Slam, State, Tracked};

use crate::scene::{Block, apart, looking, render};
use crate::{TABLE, slam, truth, walk};

/// Farther than this a pose is wrong.
const WRONG_M: f64 = 0.1;
/// The camera of `walk` moves 2 cm from frame to frame at most.
const JUMP_M: f64 = 0.1;

/// Fails where a told pose is wrong or jumps without being counted.
#[track_caller]
fn check_honest(outcomes: &[(u64, Tracked)]) {
    let told = || outcomes.iter().filter(|(_, o)| o.state == State::Tracking);
    for (i, outcome) in told() {
        let (off_m, _) = apart(outcome.world_from_camera, truth(*i));
        assert!(off_m < WRONG_M, "frame {i}: {off_m} m off and not told");
    }
    for ((i, a), (j, b)) in told().zip(told().skip(1)) {
        let (moved_m, _) = apart(a.world_from_camera, b.world_from_camera);
        let counted = a.reset_counter != b.reset_counter || j - i > 1;
        assert!(
            moved_m < JUMP_M || counted,
            "{moved_m} m from frame {i} to {j}"
        );
    }
}

/// Frames 0 to 150, those from 40 to 99 disturbed.
fn run(disturb: impl Fn(u64) -> RgbdFrame) -> Vec<(u64, Tracked)> {
    let mut slam = slam();
    let frame = |i| {
        if (40..100).contains(&i) {
            disturb(i)
        } else {
            render(i, walk(i), &[TABLE])
        }
    };
    (0..150)
        .map(|i| (i, slam.track(&frame(i)).expect("a good frame")))
        .collect()
}

#[track_caller]
fn check_recovered(outcomes: &[(u64, Tracked)]) {
    for (i, outcome) in &outcomes[105..] {
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
    }
}

/// Smeared over 41 pixels across and 11 down: two seconds of a shaken camera.
fn smear(mut frame: RgbdFrame) -> RgbdFrame {
    let (width, height) = (frame.width, frame.height);
    let gray: Vec<u32> = frame.rgb.iter().map(|p| u32::from(p[0])).collect();
    let mean = |x: usize, y: usize| {
        let (rows, columns) = (
            y.saturating_sub(5)..(y + 6).min(height),
            x.saturating_sub(20)..(x + 21).min(width),
        );
        let count = (rows.len() * columns.len()) as u32;
        let sum: u32 = rows
            .map(|r| {
                gray[r * width + columns.start..r * width + columns.end]
                    .iter()
                    .sum::<u32>()
            })
            .sum();
        (sum / count) as u8
    };
    for (at, pixel) in frame.rgb.iter_mut().enumerate() {
        *pixel = [mean(at % width, at / width); 3];
    }
    frame
}

#[test]
fn two_seconds_of_blur_lead_to_no_wrong_pose_and_are_recovered_from() {
    let outcomes = run(|i| smear(render(i, walk(i), &[TABLE])));
    check_honest(&outcomes);
    check_recovered(&outcomes);
}

#[test]
fn without_depth_the_known_points_still_carry_the_pose() {
    let outcomes = run(|i| {
        let mut frame = render(i, walk(i), &[TABLE]);
        frame.depth_m.fill(0.0);
        frame
    });
    check_honest(&outcomes);
    check_recovered(&outcomes);
    let tracked = outcomes.iter().filter(|(_, o)| o.state == State::Tracking);
    assert_eq!(tracked.count(), 150);
}

#[test]
fn black_frames_are_lost_and_recovered_from() {
    let outcomes = run(crate::lost::black);
    check_honest(&outcomes);
    check_recovered(&outcomes);
    assert!(matches!(outcomes[70].1.state, State::Lost { .. }));
    assert!(
        outcomes[149].1.reset_counter > 0,
        "found again: it may have jumped"
    );
}

/// Somebody steps before the lens, sways there, and steps aside.
fn before_the_lens(i: u64) -> Vec<Block> {
    let t = (i - 40) as f64;
    let aside = 2.0 * ((10.0 - t).max(t - 50.0).max(0.0) / 10.0);
    let y = aside + 0.05 * (0.4 * t).sin() + walk(i).raw.translation.vector.y;
    vec![
        TABLE,
        Block {
            min: [0.75, y - 0.45, 0.0],
            max: [0.95, y + 0.45, 1.75],
        },
    ]
}

#[test]
fn somebody_who_fills_most_of_the_view_does_not_carry_the_pose_away() {
    let covered = |i| {
        let nearer = render(i, walk(i), &before_the_lens(i));
        let free = render(i, walk(i), &[TABLE]);
        let depths = nearer.depth_m.iter().zip(&free.depth_m);
        depths.filter(|(a, b)| **a + 0.1 < **b).count() as f64 / nearer.depth_m.len() as f64
    };
    assert!(covered(70) > 0.7, "{} of the view", covered(70));
    let outcomes = run(|i| render(i, walk(i), &before_the_lens(i)));
    check_honest(&outcomes);
    check_recovered(&outcomes);
}

/// From frame 40 on the camera is turned by `jerk` radians within one frame.
fn jerked(i: u64, jerk: f64) -> Isometry<World, Camera> {
    let heading = if i < 40 { 0.0 } else { jerk };
    looking([0.0, 0.0, 1.2], heading, 0.35)
}

#[test]
fn a_gyroscope_carries_the_pose_through_a_jerk() {
    let jerk = 0.45;
    let turned = |i: u64| {
        let step = jerked(i - 1, jerk).raw.inverse() * jerked(i, jerk).raw;
        step.rotation
    };
    let states = |with_gyroscope: bool| -> Vec<Tracked> {
        let mut slam = slam();
        let mut outcomes = Vec::new();
        for i in 0..60 {
            let frame = render(i, jerked(i, jerk), &[TABLE]);
            let aid = Aid {
                turned: (with_gyroscope && i > 0).then(|| turned(i)),
                ..Aid::default()
            };
            outcomes.push(slam.track_aided(&frame, &aid).expect("a good frame"));
        }
        outcomes
    };
    let with = states(true);
    assert!(with.iter().all(|o| o.state == State::Tracking));
    let (_, off_rad) = apart(with[40].world_from_camera, jerked(40, jerk));
    assert!(off_rad < 0.01, "{off_rad} rad off after the jerk");
    let without = states(false);
    let (_, off_rad) = apart(without[40].world_from_camera, jerked(40, jerk));
    let honest =
        without[40].state != State::Tracking || without[40].reset_counter > 0 || off_rad < 0.01;
    assert!(honest, "without it: lost, counted, or right");
}

#[test]
fn a_gyroscope_that_tells_nonsense_is_not_believed() {
    let mut slam = slam();
    for i in 0..60 {
        let wrong = Rotation3::from_matrix_unchecked(Matrix3::from_element(f64::NAN));
        let aid = Aid {
            turned: Some(if i % 2 == 0 {
                UnitQuaternion::from_euler_angles(0.0, 2.0, 0.0)
            } else {
                UnitQuaternion::from_rotation_matrix(&wrong)
            }),
            ..Aid::default()
        };
        let outcome = slam
            .track_aided(&render(i, walk(i), &[TABLE]), &aid)
            .expect("a good frame");
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
        let (off_m, _) = apart(outcome.world_from_camera, truth(i));
        assert!(off_m < WRONG_M, "frame {i}: {off_m} m off");
    }
}

#[test]
fn a_thread_of_its_own_changes_no_bit() {
    let once = |threaded: bool| {
        let settings = Settings {
            threaded,
            ..Settings::default()
        };
        let mut slam = Slam::new(crate::scene::CAMERA, settings);
        let outcomes = crate::run(&mut slam, 90, crate::walker);
        (outcomes, slam.finish(), slam.trajectory())
    };
    assert!(once(true) == once(false));
}
