//! Positions by satellites: they tell how the map lies on the Earth, and what is far off is not believed.

use maps::time::Stamp;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use slam::{Aid, Fix, Slam, State, Tracked};

use crate::scene::{apart, render};
use crate::{TABLE, slam, truth, walk};

const FRAMES: u64 = 420;
const SIGMA_M: f64 = 0.02;
/// Above and behind the camera.
const ANTENNA: Vector3<f64> = Vector3::new(0.0, -0.3, -0.2);

/// How the Earth lies in the world of the test.
fn world_from_enu() -> Isometry3<f64> {
    Isometry3::new(Vector3::new(5.0, -3.0, 400.0), Vector3::new(0.0, 0.0, 1.1))
}

/// What a receiver says of frame `i`, two centimetres off at most.
fn fix(i: u64, at: Stamp) -> Fix {
    let t = i as f64;
    let error = 0.01 * Vector3::new((0.7 * t).sin(), (1.3 * t).sin(), (2.1 * t).sin());
    let place = truth(i).raw * Point3::from(ANTENNA);
    Fix {
        at,
        position: (world_from_enu().inverse() * place).coords + error,
        covariance: Matrix3::identity() * SIGMA_M * SIGMA_M,
        antenna_in_camera: ANTENNA,
    }
}

/// All frames; every fifth has a position of the one three before, which `change` may spoil.
fn run(change: impl Fn(u64, &mut Fix)) -> (Slam, Vec<Tracked>) {
    let mut slam = slam();
    let mut outcomes: Vec<Tracked> = Vec::new();
    for i in 0..FRAMES {
        let position = (i >= 3 && i % 5 == 0).then(|| {
            let mut fix = fix(i - 3, outcomes[i as usize - 3].at);
            change(i, &mut fix);
            fix
        });
        let aid = Aid {
            position,
            ..Aid::default()
        };
        let frame = render(i, walk(i), &[TABLE]);
        outcomes.push(slam.track_aided(&frame, &aid).expect("a good frame"));
    }
    (slam, outcomes)
}

#[track_caller]
fn check_georeference(slam: &Slam) {
    let found = slam.world_from_enu().expect("the way tells");
    let off = world_from_enu().inverse() * found;
    assert!(off.rotation.angle() < 0.03, "{} rad", off.rotation.angle());
    let here = Point3::from(world_from_enu().inverse() * Point3::origin() - Point3::origin());
    let off_m = (found * here).coords.norm();
    assert!(off_m < 0.03, "{off_m} m off");
}

#[track_caller]
fn check_path(outcomes: &[Tracked]) {
    for (i, outcome) in (0..).zip(outcomes) {
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
        let (off_m, _) = apart(outcome.world_from_camera, truth(i));
        assert!(off_m < 0.04, "frame {i}: {off_m} m off");
    }
}

#[test]
fn positions_tell_where_north_is_and_leave_a_good_path_alone() {
    let (slam, outcomes) = run(|_, _| {});
    check_georeference(&slam);
    check_path(&outcomes);
    assert_eq!(outcomes.last().map(|o| o.reset_counter), Some(0));
}

#[test]
fn a_reflection_a_number_that_is_none_and_a_position_out_of_the_past_change_nothing() {
    let (slam, outcomes) = run(|i, fix| match i {
        100 | 250 => fix.position.x += 60.0,
        150 => fix.position.y = f64::NAN,
        200 => fix.covariance[(1, 1)] = f64::INFINITY,
        300 => fix.at = Stamp::ZERO,
        _ => {}
    });
    check_georeference(&slam);
    check_path(&outcomes);
}

#[test]
fn positions_too_rough_for_the_way_tell_nothing() {
    let (slam, outcomes) = run(|_, fix| fix.covariance *= 1e4);
    assert!(slam.world_from_enu().is_none());
    check_path(&outcomes);
}
