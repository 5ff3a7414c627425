use std::time::Duration;

use maps::time::Stamp;
use nalgebra::{Isometry3, Point3, Vector3};

use super::*;
use crate::lidar::Lidar;
use crate::platform;
use crate::rays::Rays;
use crate::render::Stage;
use crate::scene::{Class, Name, Scene};

const AT: Stamp = Stamp::from_nanos(8_000_000_000);

#[test]
fn returns_from_what_stands_still_lie_in_true_voxels() {
    let scene = Scene::generate(Name::ResidentialAlley, 1003);
    let lidar = Lidar {
        noise_m: 0.0,
        ..Lidar::rs_32()
    };
    let pose = platform::ugv(&scene, AT);
    let returns = lidar.sweep(&Rays::new(&scene), AT, |_| pose, 1);
    let corner = |sign: f64| Point3::new(sign * 20.0, sign * 20.0, 1.0 + sign * 2.0);
    let truth = voxels(
        &scene,
        0.1,
        [corner(-1.0), corner(1.0)].map(|p| p + pose.raw.translation.vector),
    );
    let (mut checked, mut missing, mut wrong) = (0, 0, 0);
    for seen in returns.iter().filter(|seen| !seen.instance.moves()) {
        let p = pose.raw * lidar.body_from_sensor * Point3::from(seen.point.map(f64::from));
        let local = p - pose.raw.translation.vector;
        if local.x.abs() > 19.0 || local.y.abs() > 19.0 || !(-0.5..2.5).contains(&local.z) {
            continue;
        }
        checked += 1;
        // The road lies on a border between voxels: what is on it belongs to the upper one.
        let key = [p.x, p.y, p.z + 1e-4].map(|c| (c / 0.1).floor() as i32);
        match truth.classes.get(&key) {
            None => missing += 1,
            Some(class) if *class != scene.class_of(seen.instance) => wrong += 1,
            Some(_) => {}
        }
    }
    assert!(checked > 8000, "{checked}");
    // Single precision of the returns, on surfaces that lie on a border between voxels; corners cut by a sample's width.
    assert!(missing * 100 < checked, "{missing} of {checked}");
    assert!(
        wrong * 20 < checked,
        "{wrong} of {checked} belong to another class in the same voxel"
    );
}

#[test]
fn what_is_hidden_is_hidden_by_as_much_as_pixels_say() {
    let scene = Scene::generate(Name::UrbanArterial, 1005);
    let moment = Stage::new(&scene).at(AT);
    let lens = platform::ugv_lens();
    let pose = platform::ugv(&scene, AT) * platform::body_from_ugv_camera(0);
    let picture = moment.picture(&lens, pose);
    let sights = sight(&moment, &lens, &[(pose, picture.clone())]);
    assert!(sights.len() > 10);
    for (instance, sight) in &sights {
        assert!(sight.visible <= sight.alone, "{instance:?}: {sight:?}");
        assert!((0.0..=1.0).contains(&sight.occlusion()));
    }
    let seen: std::collections::BTreeSet<_> = picture.instance.iter().copied().collect();
    let users = seen
        .into_iter()
        .filter(|instance| scene.class_of(*instance).is_traffic());
    for instance in users {
        assert!(
            sights.get(&instance).is_some_and(|sight| sight.visible > 0),
            "{instance:?}"
        );
    }
    assert!(sights.values().any(|sight| sight.occlusion() > 0.5));
    assert!(
        sights
            .values()
            .any(|sight| sight.occlusion() < 0.05 && sight.alone > 500)
    );
}

#[test]
fn from_above_the_vehicle_is_on_the_road_and_road_users_are_where_their_boxes_are() {
    for name in Name::STREETS {
        let scene = Scene::generate(name, 1007);
        let body = platform::ugv(&scene, AT);
        let bev = bev(&Rays::new(&scene), AT, body, 128, 0.5);
        assert_eq!(bev.classes.len(), 128 * 128);
        // Ahead is up, left is left: the vehicle is where rows and columns 63 and 64 meet.
        for (row, column) in [(63, 63), (63, 64), (64, 63), (64, 64)] {
            let class = bev.classes[row * 128 + column];
            assert!(
                class == Class::Road || class.is_traffic(),
                "{name}: {class:?}"
            );
        }
        for road_user in boxes(&scene, AT) {
            let p = body.raw.inverse() * road_user.thing.centre();
            let cell = |c: f64| ((32.0 - c) / 0.5).floor();
            let (row, column) = (cell(p.x), cell(p.y));
            if (0.0..128.0).contains(&row)
                && (0.0..128.0).contains(&column)
                && road_user.thing.size.y > 1.5
            {
                let class = bev.classes[row as usize * 128 + column as usize];
                assert_eq!(class, road_user.thing.class, "{name}");
            }
        }
        let houses = bev
            .classes
            .iter()
            .filter(|class| **class == Class::Building)
            .count();
        assert!(houses > 100, "{name}: {houses}");
    }
}

#[test]
fn boxes_move_with_their_velocities() {
    let scene = Scene::generate(Name::UrbanArterial, 1);
    let later = AT + Duration::from_millis(100);
    let (now, then) = (boxes(&scene, AT), boxes(&scene, later));
    let mut moved = 0;
    for one in &now {
        let Some(other) = then
            .iter()
            .find(|other| other.thing.instance == one.thing.instance)
        else {
            continue;
        };
        let way = other.thing.centre() - one.thing.centre();
        let expected = one.velocity * 0.1;
        assert!((way - expected).xy().norm() < 0.05, "{one:?}: {way:?}");
        moved += usize::from(way.norm() > 0.1);
    }
    assert!(moved > 10, "{moved} of {}", now.len());
}

#[test]
fn a_box_covers_what_is_above_its_outline() {
    let scene = Scene::generate(Name::UrbanArterial, 1);
    let mut road_user = boxes(&scene, AT)[0];
    road_user.thing.place = Isometry3::new(Vector3::new(5.0, 2.0, 0.0), Vector3::z() * 0.5);
    road_user.thing.size = Vector3::new(4.0, 2.0, 1.5);
    let at = |x: f64, y: f64| road_user.thing.place * Point3::new(x, y, 7.0);
    assert!(
        road_user.thing.covers(at(1.9, 0.9))
            && !road_user.thing.covers(at(2.1, 0.0))
            && !road_user.thing.covers(at(0.0, -1.1))
    );
}
