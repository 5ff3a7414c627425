use nalgebra::{Isometry3, Vector3};

use super::seen::{NEAR_M, Sway, clip_near};
use super::shadow::{ShadowMap, Shadows};
use super::*;
use crate::depth_camera::d455;
use crate::flight;
use crate::lanes::lanes;
use crate::noise::{at_cell, unit};
use crate::platform;
use crate::scene::Name;

#[test]
fn a_picture_is_the_same_on_one_thread_and_on_two() {
    let scene = Scene::generate(Name::Room, 1);
    let at = Stamp::from_nanos(3_000_000_000);
    let pose = flight::world_from_camera(at, 1);
    let draw = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| render(&scene, at, &d455(), pose))
    };
    assert!(draw(1) == draw(2));
}

#[test]
fn the_depth_of_the_floor_and_the_walls_is_that_of_their_planes() {
    let scene = Scene::generate(Name::Room, 2);
    let camera = d455();
    let pose = flight::world_from_camera(Stamp::ZERO, 2);
    let picture = render(&scene, Stamp::ZERO, &camera, pose);
    let mut checked = [0; 2];
    for (i, &instance) in picture.instance.iter().enumerate() {
        let pixel = [(i % camera.width) as f64, (i / camera.width) as f64];
        let p = pose * camera.unproject(pixel, f64::from(picture.depth_m[i]));
        let error = match instance {
            Instance::FLOOR => p.raw.z,
            // The east wall is 3.5 m east of the middle; the pictures hang 1 cm before it.
            Instance(2) => (p.raw.x - 4.795).abs() - 0.005,
            _ => continue,
        };
        checked[usize::from(instance != Instance::FLOOR)] += 1;
        assert!(
            error.abs() < 2e-6 || error < 0.0,
            "pixel {pixel:?} is {error} m off the plane of {instance:?}"
        );
    }
    assert!(
        checked.iter().all(|&n| n > 5000),
        "floor and wall are seen: {checked:?}"
    );
}

#[test]
fn no_pixel_below_the_top_of_the_walls_falls_between_two_faces() {
    let scene = Scene::generate(Name::Room, 3);
    for second in 0..20 {
        let at = Stamp::from_nanos(second * 1_500_000_000);
        let picture = render(&scene, at, &d455(), flight::world_from_camera(at, 3));
        for column in 0..picture.width {
            let rows =
                (0..picture.height).map(|row| picture.instance[row * picture.width + column]);
            let seen: Vec<bool> = rows.map(|instance| instance != Instance::NOTHING).collect();
            let first = seen
                .iter()
                .position(|&seen| seen)
                .expect("the floor at least");
            assert!(
                seen[first..].iter().all(|&seen| seen),
                "a hole in column {column} at {at} s"
            );
        }
    }
}

#[test]
fn a_face_through_the_camera_plane_is_cut_and_not_mirrored() {
    let corners = [
        [-1.0, 1.0, -1.0],
        [1.0, 1.0, -1.0],
        [1.0, 1.0, 2.0],
        [-1.0, 1.0, 2.0],
    ]
    .map(Vector3::from);
    let cut = clip_near(&corners).expect("in front");
    assert_eq!(cut.len(), 4);
    assert!(cut.iter().all(|p| p.z >= NEAR_M - 1e-12), "{cut:?}");
}

#[test]
fn the_pose_of_the_camera_is_where_it_was_asked_to_be() {
    // Looking straight down from 2 m at the middle of the room: the floor, or the table on it, at the centre.
    let scene = Scene::generate(Name::Room, 1);
    let down = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let pose = Isometry::claim(Isometry3::from_parts(
        Vector3::new(-0.3, 0.0, 2.0).into(),
        down,
    ));
    let camera = d455();
    let picture = render(&scene, Stamp::ZERO, &camera, pose);
    let centre = picture.depth_m[(camera.height / 2) * camera.width + camera.width / 2];
    assert!((centre - 2.0).abs() < 1e-3, "{centre} m");
}

#[test]
fn no_face_that_can_be_seen_is_left_out_by_the_ball_around_it() {
    let scene = Scene::generate(Name::SuburbanRoad, 1);
    let camera = d455();
    let faces = scene.still();
    let bounds: Vec<_> = faces.iter().map(Bound::of).collect();
    let mut left_out = 0;
    for second in 0..12 {
        let at = Stamp::from_nanos(second * 2_000_000_000);
        let pose = platform::uav_camera(&scene, at, 1);
        let near = platform::uav_camera(&scene, at + std::time::Duration::from_millis(200), 1);
        let frustum = Frustum::of(&camera, pose);
        let sway = Sway::around(pose, &[near]);
        for (face, bound) in faces.iter().zip(&bounds) {
            let is_seen =
                |pose: Isometry<_, _>| Seen::new(face, &camera, &pose.inverse()).is_some();
            let may_be_seen = frustum.may_see(bound);
            left_out += usize::from(!may_be_seen);
            assert!(may_be_seen || !is_seen(pose), "{face:?} at {at} s");
            let may_be_seen = frustum.may_see_swaying(bound, sway);
            assert!(may_be_seen || !is_seen(near), "{face:?} after {at} s");
        }
    }
    assert!(left_out > 12 * faces.len() / 2, "{left_out} are left out");
}

#[test]
fn what_moves_shades_as_if_it_stood_there() {
    let scene = Scene::generate(Name::UrbanArterial, 2);
    let Light::Sun(sun) = scene.light() else {
        panic!("a street has a sun")
    };
    let moving = scene.moving(Stamp::from_nanos(5_000_000_000));
    let mut still = ShadowMap::around(scene.still(), sun);
    still.draw(scene.still());
    let mut both = still.clone();
    both.draw(&moving);
    let quick = Shadows::new(Arc::new(still.clone()), &moving);
    let slow = Shadows::new(Arc::new(both), &[]);
    let empty = Shadows::new(Arc::new(still), &[]);
    let mut shaded = 0;
    for block in 0..4000 {
        // Where the road users are, up to the roofs of cars.
        let random = |what: i32| lanes!(k => f64::from(unit(at_cell(block * 16 + (k as u32).cast_signed(), what, 5))));
        let [x, y, z] = [1, 2, 3].map(random);
        let places = [
            x.map(|x| x * 200.0 - 50.0),
            y.map(|y| y * 24.0 - 12.0),
            z.map(|z| z * 1.5),
        ];
        let light = quick.sunlit(&places, &Vector3::z());
        let expected = slow.sunlit(&places, &Vector3::z()).map(f32::to_bits);
        assert_eq!(light.map(f32::to_bits), expected, "{places:?}");
        let before = empty.sunlit(&places, &Vector3::z());
        shaded += light.iter().zip(before).filter(|(l, b)| **l < *b).count();
    }
    assert!(shaded > 20, "{shaded} places are shaded by who moves");
}
