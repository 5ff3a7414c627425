//! An inertial unit: what moves does not carry the pose away where it tells how the camera has moved, and z is up.

use maps::frame::Isometry;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use slam::{Aid, Felt, Settings, Slam, State, Tracked};

use crate::scene::{Block, CAMERA, Scene, apart, looking, render, render_scene};
use crate::{TABLE, slam, walk};

const GRAVITY_MPS2: f64 = 9.806_65;
const RATE_HZ: f64 = 30.0;
/// Where the accelerometer is in the camera.
const UNIT: Vector3<f64> = Vector3::new(0.05, -0.1, -0.08);

/// What a unit measures between frame `i - 1` and frame `i` of a way, where `up` is up.
fn measured(way: &dyn Fn(f64) -> Isometry3<f64>, i: u64, up: &Vector3<f64>) -> Aid<'static> {
    if i == 0 {
        return Aid::default();
    }
    let at = |frames: f64| way(i as f64 + frames);
    let place = |frames: f64| (at(frames) * nalgebra::Point3::from(UNIT)).coords;
    let span = 0.5 / RATE_HZ;
    let acceleration = (place(0.0) - 2.0 * place(-0.5) + place(-1.0)) / (span * span);
    let force = acceleration + GRAVITY_MPS2 * up;
    Aid {
        turned: Some(at(-1.0).rotation.inverse() * at(0.0).rotation),
        felt: Some(Felt {
            specific_force: at(-0.5).rotation.inverse() * force,
            unit_in_camera: UNIT,
        }),
        ..Aid::default()
    }
}

/// Along a road at 6 m/s, looking down.
fn along(frames: f64) -> Isometry3<f64> {
    let t = frames / RATE_HZ;
    // It takes a second to get going.
    let way_m = 6.0 * if t < 1.0 { t * t / 2.0 } else { t - 0.5 };
    looking([way_m, 0.1 * (0.7 * t).sin(), 4.0], 0.03 * t.sin(), 0.7).raw
}

/// A lorry that goes ahead at a third of that: the camera catches up with it, and is over it for a while.
fn lorry(i: u64) -> Block {
    let x = 10.0 + 2.0 * i as f64 / RATE_HZ;
    Block {
        min: [x, -0.9, 0.0],
        max: [x + 5.0, 0.4, 1.8],
    }
}

/// How far the pose is off at the end of the road, if it is known then.
fn end_of_road(has_unit: bool) -> Option<f64> {
    const FRAMES: u64 = 180;
    let mut slam = slam();
    let mut last: Option<Tracked> = None;
    for i in 0..FRAMES {
        let room = Block {
            min: [-3.0, -2.5, 0.0],
            max: [80.0, 2.5, 7.0],
        };
        let scene = Scene::new(room, vec![lorry(i)]);
        let frame = render_scene(i, Isometry::claim(along(i as f64)), &scene);
        let aid = measured(&along, i, &Vector3::z());
        let aid = if has_unit { aid } else { Aid::default() };
        last = Some(slam.track_aided(&frame, &aid).expect("a good frame"));
    }
    let last = last.filter(|l| l.state == State::Tracking && l.covariance[(0, 0)] < 1.0)?;
    let went = along(0.0).inverse() * along((FRAMES - 1) as f64);
    let first = slam.trajectory().first().map(|(_, pose)| pose.raw)?;
    let told = first.inverse() * last.world_from_camera.raw;
    Some((told.translation.vector - went.translation.vector).norm())
}

#[test]
fn a_lorry_that_fills_half_of_the_view_carries_the_pose_away_unless_there_is_an_inertial_unit() {
    let without = end_of_road(false);
    assert!(
        without.is_none_or(|off_m| off_m > 1.0),
        "{without:?} m off without it: this shows nothing"
    );
    let with = end_of_road(true).expect("the place is known");
    assert!(with < 0.3, "{with} m off");
}

/// Once around in the middle of the room in 12 s.
fn around(frames: f64) -> Isometry3<f64> {
    let t = (frames / RATE_HZ).max(0.0);
    let turned =
        std::f64::consts::TAU * (t / 12.0 - (std::f64::consts::TAU * t / 12.0).sin() / 8.0);
    looking([1.2 + 0.2 * t.cos(), 0.2 * t.sin(), 1.3], turned, 0.35).raw
}

/// How far the SLAM's z is from up after a turn in a room whose floor slopes.
fn off_upright_rad(slope_rad: f64, has_unit: bool) -> f64 {
    const FRAMES: u64 = 390;
    let up = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), slope_rad) * Vector3::z();
    let mut slam = slam();
    let mut last = None;
    for i in 0..FRAMES {
        let pose = around(i as f64);
        let frame = render(i, Isometry::claim(pose), &[TABLE]);
        let aid = measured(&around, i, &up);
        let aid = if has_unit { aid } else { Aid::default() };
        last = Some(slam.track_aided(&frame, &aid).expect("a good frame"));
    }
    let told = last.expect("frames").world_from_camera.raw.rotation;
    let up = told * around((FRAMES - 1) as f64).rotation.inverse() * up;
    up.angle(&Vector3::z())
}

#[test]
fn z_becomes_up_where_the_floor_slopes() {
    let slope_rad = 0.03;
    let without = off_upright_rad(slope_rad, false);
    assert!(without > 0.02, "{without} rad: this shows nothing");
    let with = off_upright_rad(slope_rad, true);
    assert!(with < 0.01, "{with} rad off");
    let level = off_upright_rad(0.0, true);
    assert!(level < 0.01, "{level} rad off on a level floor");
}

#[test]
fn threads_change_no_bit_of_a_map_that_is_turned_upright() {
    let once = |threaded: bool| {
        let settings = Settings {
            threaded,
            ..Settings::default()
        };
        let mut slam = Slam::new(CAMERA, settings);
        let up = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.02) * Vector3::z();
        let mut outcomes = Vec::new();
        for i in 0..240 {
            let frame = render(i, Isometry::claim(around(i as f64)), &[TABLE]);
            let aid = measured(&around, i, &up);
            outcomes.push(slam.track_aided(&frame, &aid).expect("a good frame"));
        }
        (outcomes, slam.trajectory())
    };
    assert!(once(true) == once(false));
}

#[test]
fn a_unit_that_tells_nonsense_changes_nothing() {
    let mut slam = slam();
    for i in 0..90 {
        let force = match i % 3 {
            0 => Vector3::repeat(f64::NAN),
            1 => Vector3::new(0.0, 0.0, 1e9),
            _ => Vector3::zeros(),
        };
        let aid = Aid {
            felt: Some(Felt {
                specific_force: force,
                unit_in_camera: UNIT,
            }),
            ..measured(&|f| walk(f.max(0.0) as u64).raw, i, &Vector3::z())
        };
        let frame = render(i, walk(i), &[TABLE]);
        let outcome = slam.track_aided(&frame, &aid).expect("a good frame");
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
        let (off_m, _) = apart(outcome.world_from_camera, crate::truth(i));
        assert!(off_m < 0.1, "frame {i}: {off_m} m off");
    }
}
