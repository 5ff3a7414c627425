use nalgebra::{Isometry3, Vector3};

use super::seen::{NEAR_M, clip_near};
use super::*;
use crate::depth_camera::d455;
use crate::flight;
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
