//! Whether two road users overlap.

use std::f64::consts::PI;

use nalgebra::{Rotation2, Vector2};

use crate::traffic::{Kind, Obstacle, State, Track};

/// Half the width of a body that must not touch another.
pub(super) const BODY_M: f64 = 0.24;

fn axes(heading_rad: f64) -> [Vector2<f64>; 2] {
    [0.0, PI / 2.0].map(|turn| Rotation2::new(heading_rad + turn) * Vector2::x())
}

/// Whether two oriented boxes share a point: no side of either separates them.
fn boxes_overlap(a: (&Track, State), b: (&Track, State)) -> bool {
    let reach = |(track, state): (&Track, State), axis: Vector2<f64>| {
        let [along, across] = axes(state.heading_rad);
        track.size_m[0] / 2.0 * along.dot(&axis).abs()
            + track.size_m[1] / 2.0 * across.dot(&axis).abs()
    };
    let apart = Vector2::from(a.1.position) - Vector2::from(b.1.position);
    [a, b]
        .iter()
        .flat_map(|(_, state)| axes(state.heading_rad))
        .all(|axis| apart.dot(&axis).abs() < reach(a, axis) + reach(b, axis))
}

pub(super) fn overlap(a: (&Track, State), b: (&Track, State)) -> bool {
    let apart = Vector2::from(a.1.position) - Vector2::from(b.1.position);
    if apart.norm() > 13.0 {
        return false;
    }
    let on_foot = |(track, _): (&Track, State)| track.kind == Kind::Pedestrian;
    match (on_foot(a), on_foot(b)) {
        (true, true) => apart.norm() < 2.0 * BODY_M,
        (false, false) => boxes_overlap(a, b),
        (first, _) => {
            let (person, vehicle) = if first { (a, b) } else { (b, a) };
            let [x, y] = vehicle.1.position;
            let body = Obstacle::Box {
                centre: [x, y],
                heading_rad: vehicle.1.heading_rad,
                size_m: [vehicle.0.size_m[0], vehicle.0.size_m[1]],
            };
            body.distance_m(person.1.position) < BODY_M
        }
    }
}
