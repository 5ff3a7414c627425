//! From the model to a scene: the map's new tiles, and everything that moves.

use std::sync::Arc;

use egui::Color32;
use maps::frame::{Body, Isometry, Point, World};
use maps::tile::TileId;

use super::MapView;
use crate::model::missions::{Plan, PlanKind};
use crate::model::vehicle::{Presence, Vehicle};
use crate::model::{LINK_LOST_AFTER, Model};
use crate::render::{Freshness, GoalMarker, Look, Marker, MarkerKind, Polyline, Scene, Stroke};
use crate::view::layers::Layer;
use crate::view::theme;

/// A lost vehicle may have gone this fast in any direction.
const LOST_SPEED_MPS: f64 = 1.0;
/// An axis of the map's frame is this long.
const AXIS_M: f64 = 0.5;

/// Makes the scene of `view` show `model`.
pub(super) fn update(view: &mut MapView, model: &Model, changed: &[TileId]) {
    let scene = Arc::make_mut(&mut view.scene);
    let ground = theme::GROUND;
    scene.look = Look {
        coloring: view.coloring,
        surfaces: view.surfaces,
        heights_m: None,
        grid: view.layers.shows(Layer::Grid),
        background: [ground.r(), ground.g(), ground.b()],
    };
    let cut_m = if view.layers.shows(Layer::Map) {
        view.cut_m
    } else {
        Some(f64::MIN)
    };
    let cut_changed = scene.clip_above_m != cut_m;
    scene.clip_above_m = cut_m;
    if let Some(map) = &model.map.voxels
        && (cut_changed || !changed.is_empty())
    {
        scene.update_map(map, changed);
    }
    scene.overlay = view
        .drivable
        .clone()
        .filter(|_| view.layers.shows(Layer::Traversability));
    scene.lines.clear();
    scene.markers.clear();
    scene.goal = None;
    if view.layers.shows(Layer::Axes) {
        scene.lines.extend(axes());
    }
    for vehicle in model.vehicles.values() {
        if view.layers.shows(Layer::Tracks) {
            scene.lines.push(track(vehicle));
        }
        scene.markers.extend(marker(model, vehicle));
    }
    if view.layers.shows(Layer::Camera) {
        scene.lines.extend(cameras(model));
    }
    if view.layers.shows(Layer::Plans) {
        plans(scene, model);
    }
}

fn rgb(color: Color32) -> [u8; 3] {
    [color.r(), color.g(), color.b()]
}

fn rgba(color: Color32, alpha: u8) -> [u8; 4] {
    let [r, g, b] = rgb(color);
    [r, g, b, alpha]
}

fn solid(points: Vec<Point<World>>, color: [u8; 4], width_px: f32) -> Polyline {
    Polyline {
        points,
        color,
        width_px,
        stroke: Stroke::Solid,
    }
}

/// East red-brown, north teal, up blue: of the palette, so that none is taken for a warning.
fn axes() -> [Polyline; 3] {
    let axis = |x: f64, y: f64, z: f64, color: [u8; 4]| {
        solid(
            vec![
                Point::origin(),
                Point::new(x * AXIS_M, y * AXIS_M, z * AXIS_M),
            ],
            color,
            2.5,
        )
    };
    [
        axis(1.0, 0.0, 0.0, [0xc9, 0x9a, 0x6b, 0xff]),
        axis(0.0, 1.0, 0.0, [0x3f, 0xb8, 0xa5, 0xff]),
        axis(0.0, 0.0, 1.0, [0x7a, 0xa2, 0xff, 0xff]),
    ]
}

fn track(vehicle: &Vehicle) -> Polyline {
    let points = vehicle
        .track
        .iter()
        .filter_map(|point| point.world)
        .collect();
    solid(points, rgba(theme::vehicle(vehicle.id), 170), 2.0)
}

fn marker(model: &Model, vehicle: &Vehicle) -> Option<Marker> {
    let world_from_body = vehicle.world_from_body()?;
    let position = vehicle.position?;
    let age = position.age(model.now);
    let lost = vehicle.presence(model.now) == Presence::Lost || age > LINK_LOST_AFTER;
    Some(Marker {
        kind: if vehicle.kind.drives() {
            MarkerKind::Rover
        } else {
            MarkerKind::Copter
        },
        world_from_body,
        color: rgb(theme::vehicle(vehicle.id)),
        length_m: if vehicle.kind.drives() {
            model.config.ugv.length_m
        } else {
            0.5
        },
        freshness: if lost {
            Freshness::Stale {
                radius_m: (age.as_secs_f64() * LOST_SPEED_MPS).min(50.0),
            }
        } else {
            Freshness::Fresh
        },
        selected: model.active == Some(vehicle.id),
    })
}

/// Where each companion's camera is by its own odometry: a pyramid that opens to where it looks, dashed once it is old.
fn cameras(model: &Model) -> impl Iterator<Item = Polyline> {
    model.map.companions.values().filter_map(|companion| {
        let pose = companion.world_from_body.as_ref()?;
        let stroke = if pose.age(model.now) > LINK_LOST_AFTER {
            Stroke::Dashed { length_m: 0.04 }
        } else {
            Stroke::Solid
        };
        Some(Polyline {
            points: pyramid(pose.value),
            color: rgba(theme::TEXT, 220),
            width_px: 2.0,
            stroke,
        })
    })
}

/// The edges of a pyramid in one stroke.
fn pyramid(world_from_body: Isometry<World, Body>) -> Vec<Point<World>> {
    let [ahead_m, left_m, up_m] = [0.3, 0.17, 0.13];
    let [apex, a, b, c, d] = [
        Point::origin(),
        Point::new(ahead_m, left_m, up_m),
        Point::new(ahead_m, -left_m, up_m),
        Point::new(ahead_m, -left_m, -up_m),
        Point::new(ahead_m, left_m, -up_m),
    ]
    .map(|p| world_from_body * p);
    vec![apex, a, b, apex, c, d, apex, d, a, b, c]
}

/// Every plan in its vehicle's colour: dashed until the vehicle is known to have it.
fn plans(scene: &mut Scene, model: &Model) {
    for (id, mission) in &model.missions {
        let Some(plan) = mission.plan() else { continue };
        let color = theme::vehicle(*id);
        let stroke = if mission.is_verified() {
            Stroke::Solid
        } else {
            Stroke::Dashed { length_m: 0.12 }
        };
        scene.lines.push(Polyline {
            points: plan.line.clone(),
            color: rgba(color, 255),
            width_px: 3.5,
            stroke,
        });
        if model.active == Some(*id) || scene.goal.is_none() {
            scene.goal = goal(plan, rgb(color)).or(scene.goal);
        }
    }
}

fn goal(plan: &Plan, color: [u8; 3]) -> Option<GoalMarker> {
    match plan.kind {
        PlanKind::Survey { .. } => None,
        PlanKind::Path {
            goal_heading_rad, ..
        } => {
            let position = *plan.line.last()?;
            Some(GoalMarker {
                position,
                heading_rad: goal_heading_rad,
                color,
            })
        }
    }
}
