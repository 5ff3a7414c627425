use nalgebra::{Point3, Vector3};

use super::*;
use crate::platform;

fn streets() -> impl Iterator<Item = (Name, u64)> {
    Name::STREETS
        .into_iter()
        .flat_map(|name| [0, 1001, 1102].map(|seed| (name, seed)))
}

/// Whether the outlines of two boxes on the ground overlap: no axis of either separates them.
fn overlap(a: &Thing, b: &Thing) -> bool {
    let corners = |thing: &Thing| {
        let (x, y) = (thing.size.x / 2.0, thing.size.y / 2.0);
        [[x, y], [-x, y], [-x, -y], [x, -y]].map(|[x, y]| thing.place * Point3::new(x, y, 0.0))
    };
    let axes = [a, b]
        .into_iter()
        .flat_map(|thing| [Vector3::x(), Vector3::y()].map(|axis| thing.place.rotation * axis));
    let span = |thing: &Thing, axis: &Vector3<f64>| {
        let along = corners(thing).map(|corner| corner.coords.dot(axis));
        let least = along.iter().copied().fold(f64::INFINITY, f64::min);
        (
            least,
            along.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        )
    };
    axes.into_iter().all(|axis| {
        let ((low, high), (from, to)) = (span(a, &axis), span(b, &axis));
        low < to && from < high
    })
}

#[test]
fn the_same_seed_gives_the_same_street_and_another_seed_another() {
    for name in Name::STREETS {
        let build = |seed| {
            let scene = Scene::generate(name, seed);
            let moving = scene.moving(Stamp::from_nanos(9_000_000_000));
            format!("{:?} {moving:?}", scene.still())
        };
        assert!(build(7) == build(7), "{name}");
        assert!(build(7) != build(8), "{name}");
    }
}

#[test]
fn every_face_is_a_flat_surface_with_an_area() {
    for (name, seed) in streets() {
        let scene = Scene::generate(name, seed);
        let moving = scene.moving(Stamp::from_nanos(9_000_000_000));
        for face in scene.still().iter().chain(&moving) {
            let (u, v) = (face.edge_u.raw, face.edge_v.raw);
            let area = u.cross(&v).norm();
            assert!(area > 1e-9 && area.is_finite(), "{name} {seed}: {face:?}");
            let cosine = u.dot(&v) / (u.norm() * v.norm());
            assert!(cosine.abs() < 1e-6, "{name} {seed}: {face:?}");
        }
    }
}

#[test]
fn nothing_fixed_stands_in_the_lane_of_the_ground_vehicle() {
    for (name, seed) in streets() {
        let scene = Scene::generate(name, seed);
        for second in 0..45_u64 {
            let at = Stamp::from_nanos(second * 1_000_000_000);
            let vehicle = Thing {
                instance: Instance::NOTHING,
                class: Class::Car,
                place: platform::ugv(&scene, at).raw,
                size: Vector3::new(1.2, 1.0, 1.5),
            };
            let low = |thing: &&Thing| thing.place.translation.z < 2.0 && thing.size.z > 0.2;
            let solid = |thing: &&Thing| thing.class != Class::Vegetation;
            for thing in scene.things().iter().filter(low).filter(solid) {
                assert!(
                    !overlap(&vehicle, thing),
                    "{name} {seed} at {second} s: {thing:?}"
                );
            }
        }
    }
}

#[test]
fn parked_vehicles_stand_clear_of_one_another_and_of_moving_ones() {
    for (name, seed) in streets() {
        let scene = Scene::generate(name, seed);
        let parked: Vec<_> = scene
            .things()
            .iter()
            .filter(|t| t.class.is_traffic())
            .collect();
        for (i, one) in parked.iter().enumerate() {
            for other in &parked[..i] {
                assert!(!overlap(one, other), "{name} {seed}: {one:?} {other:?}");
            }
        }
        for second in 0..20_u64 {
            let movers = scene.movers(Stamp::from_nanos(second * 5_000_000_000));
            let driving = movers.iter().filter(|m| m.thing.class != Class::Pedestrian);
            for mover in driving {
                for one in &parked {
                    assert!(
                        !overlap(one, &mover.thing),
                        "{name} {seed} at {second}: {one:?} {mover:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn road_users_are_within_their_boxes() {
    for (name, seed) in streets() {
        let scene = Scene::generate(name, seed);
        let at = Stamp::from_nanos(21_000_000_000);
        let movers = scene.movers(at);
        let boxes: std::collections::BTreeMap<_, _> = scene
            .things()
            .iter()
            .copied()
            .chain(movers.iter().map(|mover| mover.thing))
            .filter(|thing| thing.class.is_traffic())
            .map(|thing| (thing.instance, thing))
            .collect();
        let moving = scene.moving(at);
        let mut checked = 0;
        for face in scene.still().iter().chain(&moving) {
            let Some(thing) = boxes.get(&face.instance) else {
                continue;
            };
            // Limbs swing and mirrors stick out.
            let margin = if thing.class == Class::Pedestrian {
                0.35
            } else {
                0.25
            };
            for corner in face.corners() {
                let p = thing.place.inverse() * corner.raw;
                let inside = p.x.abs() <= thing.size.x / 2.0 + margin
                    && p.y.abs() <= thing.size.y / 2.0 + margin
                    && p.z >= -0.01
                    && p.z <= thing.size.z + 0.15;
                assert!(inside, "{name} {seed}: {p:?} of {thing:?}");
                checked += 1;
            }
        }
        assert!(checked > 2000, "{name} {seed}: {checked}");
        assert!(!movers.is_empty());
    }
}

#[test]
fn a_course_bends_without_a_kink_and_starts_in_the_origin() {
    let course = Course {
        bend_m: -4.5,
        length_m: 190.0,
    };
    assert_eq!(course.place(0.0, 0.0), Point2::origin());
    assert!(course.heading(0.0).abs() < 1e-12);
    for along in 0..150 {
        let along = f64::from(along);
        let step = course.place(along + 1e-4, 0.0) - course.place(along - 1e-4, 0.0);
        assert!((step.y.atan2(step.x) - course.heading(along)).abs() < 1e-6);
        let aside = course.place(along, 3.0) - course.place(along, 0.0);
        assert!((aside.norm() - 3.0).abs() < 1e-9 && aside.dot(&step).abs() < 1e-6);
    }
}
