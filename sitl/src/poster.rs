//! A contact sheet: what all sensors see of a scene at one moment, beside the truth, in one picture to look at.
//!
//! ```text
//! drone: colour       depth            classes
//! ground: front       left             rear              right        (colour, below it classes)
//! LiDAR from above    street from above (truth)   voxels from above (truth)   occlusion of road users
//! ```

mod canvas;

use std::collections::BTreeMap;

use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Point3};

pub use canvas::Canvas;

use crate::depth_camera::d455;
use crate::lidar::Lidar;
use crate::platform;
use crate::rays::Rays;
use crate::render::{Moment, Picture, Stage};
use crate::scene::{Class, Instance, Name, Scene};
use crate::truth::{bev, sight, voxels};

/// Between panels.
const GAP: usize = 6;
/// The width of one of four panels side by side.
const PANEL: usize = 368;
/// How far the views from above reach from their middle.
const REACH_M: f64 = 32.0;
const BACKGROUND: [u8; 3] = [24, 26, 30];

/// A camera's pose, and what it sees.
type View = (Isometry<World, Camera>, Picture);

/// The sheet of one scene at one moment.
pub fn poster(name: Name, seed: u64, at: Stamp) -> Canvas {
    let scene = Scene::generate(name, seed);
    let moment = Stage::new(&scene).at(at);
    let rays = Rays::new(&scene);
    let views = platform::ugv_views(&moment);
    let width = 4 * PANEL + 3 * GAP;
    let rows = [
        drone(&moment, seed, width),
        ground(&scene, &views),
        above(&moment, &views, &rays, seed),
    ];
    Canvas::stacked(&rows, GAP, BACKGROUND)
}

/// Classes as colours, darker where a surface is seen at a slant.
pub fn classes(scene: &Scene, picture: &Picture) -> Canvas {
    let pixels = picture.instance.iter().zip(&picture.facing);
    let colour = |(instance, facing): (&Instance, &f32)| {
        let shade = if *instance == Instance::NOTHING {
            1.0
        } else {
            0.55 + 0.45 * facing
        };
        scene
            .class_of(*instance)
            .colour()
            .map(|c| (f32::from(c) * shade) as u8)
    };
    Canvas::new(picture.width, picture.height, pixels.map(colour).collect())
}

/// Depth as brightness: near is bright, nothing is black.
pub fn depths(picture: &Picture) -> Canvas {
    let colour = |depth_m: &f32| {
        let near = if *depth_m > 0.0 {
            (4.0 / depth_m).min(1.0).sqrt()
        } else {
            0.0
        };
        [near, near * near.sqrt(), 0.25 + 0.5 * (1.0 - near)].map(|c| (c * 255.0) as u8)
    };
    let pixels = picture.depth_m.iter().map(colour).collect();
    Canvas::new(picture.width, picture.height, pixels)
}

fn colours(picture: &Picture) -> Canvas {
    Canvas::new(picture.width, picture.height, picture.rgb.clone())
}

fn drone(moment: &Moment<'_>, seed: u64, width: usize) -> Canvas {
    let camera = d455();
    let pose = platform::uav_camera(moment.scene(), moment.at(), seed);
    let picture = moment.picture(&camera, pose);
    let each = (width - 2 * GAP) / 3;
    let panels = [
        colours(&picture),
        depths(&picture),
        classes(moment.scene(), &picture),
    ];
    let panels = panels.map(|panel| panel.scaled(each, each * 3 / 4));
    Canvas::side_by_side(&panels, GAP, BACKGROUND)
}

fn ground(scene: &Scene, views: &[View]) -> Canvas {
    let lens = platform::ugv_lens();
    let height = PANEL * lens.height / lens.width;
    let row = |of: &dyn Fn(&Picture) -> Canvas| {
        let panels: Vec<_> = views
            .iter()
            .map(|(_, picture)| of(picture).scaled(PANEL, height))
            .collect();
        Canvas::side_by_side(&panels, GAP, BACKGROUND)
    };
    let rows = [row(&colours), row(&|picture| classes(scene, picture))];
    Canvas::stacked(&rows, GAP, BACKGROUND)
}

fn above(moment: &Moment<'_>, views: &[View], rays: &Rays<'_>, seed: u64) -> Canvas {
    let scene = moment.scene();
    let panels = [
        lidar_from_above(moment, rays, seed),
        street_from_above(moment, rays),
        voxels_from_above(scene, platform::ugv(scene, moment.at()).raw),
        occlusions(moment, views),
    ];
    Canvas::side_by_side(&panels, GAP, BACKGROUND)
}

/// Where something at these body coordinates is in a panel; x is up.
fn from_above(x: f64, y: f64) -> Option<(usize, usize)> {
    let scale = PANEL as f64 / (2.0 * REACH_M);
    let place = |c: f64| {
        let at = (REACH_M - c) * scale;
        (at >= 0.0 && at < PANEL as f64).then_some(at as usize)
    };
    Some((place(y)?, place(x)?))
}

fn lidar_from_above(moment: &Moment<'_>, rays: &Rays<'_>, seed: u64) -> Canvas {
    let scene = moment.scene();
    let lidar = Lidar::rs_32();
    let start = Stamp::from_nanos(moment.at().as_nanos().saturating_sub(100_000_000));
    let returns = lidar.sweep(rays, start, |at| platform::ugv(scene, at), seed);
    let mut canvas = Canvas::filled(PANEL, PANEL, BACKGROUND);
    for seen in returns {
        let [x, y, _] = seen.point.map(f64::from);
        if let Some((column, row)) = from_above(x, y) {
            canvas.set(column, row, scene.class_of(seen.instance).colour());
        }
    }
    canvas
}

fn street_from_above(moment: &Moment<'_>, rays: &Rays<'_>) -> Canvas {
    let scene = moment.scene();
    let body = platform::ugv(scene, moment.at());
    let truth = bev(rays, moment.at(), body, 128, 0.5);
    let pixels = truth.classes.iter().map(|class| class.colour()).collect();
    Canvas::new(truth.size, truth.size, pixels).scaled(PANEL, PANEL)
}

/// The highest voxel below 4 m of each column, brighter the higher it is.
fn voxels_from_above(scene: &Scene, world_from_body: Isometry3<f64>) -> Canvas {
    let middle = world_from_body.translation.vector;
    let corner =
        |sign: f64, z: f64| Point3::new(middle.x + sign * REACH_M, middle.y + sign * REACH_M, z);
    let truth = voxels(scene, 0.1, [corner(-1.0, -0.3), corner(1.0, 4.0)]);
    let mut highest: BTreeMap<(usize, usize), (i32, Class)> = BTreeMap::new();
    for ([x, y, z], class) in &truth.classes {
        let at = Point3::new(f64::from(*x), f64::from(*y), 0.0) * 0.1;
        let local = world_from_body.inverse() * at;
        if let Some(place) = from_above(local.x, local.y) {
            let highest = highest.entry(place).or_insert((*z, *class));
            *highest = (*z, *class).max(*highest);
        }
    }
    let mut canvas = Canvas::filled(PANEL, PANEL, BACKGROUND);
    for ((column, row), (z, class)) in highest {
        let shade = 0.35 + 0.65 * f64::from(z.clamp(0, 40)) / 40.0;
        canvas.set(
            column,
            row,
            class
                .colour()
                .map(|c| (f64::from(c).max(40.0) * shade) as u8),
        );
    }
    canvas
}

/// Each road user's box from above: green where the ground vehicle's cameras see all of it, red where they see nothing.
fn occlusions(moment: &Moment<'_>, views: &[View]) -> Canvas {
    let scene = moment.scene();
    let body = platform::ugv(scene, moment.at());
    let seen = sight(moment, &platform::ugv_lens(), views);
    let mut canvas = Canvas::filled(PANEL, PANEL, BACKGROUND);
    let boxes = crate::truth::boxes(scene, moment.at());
    for row in 0..PANEL {
        for column in 0..PANEL {
            let from_middle =
                |at: usize| REACH_M - (at as f64 + 0.5) * 2.0 * REACH_M / PANEL as f64;
            let place = body.raw * Point3::new(from_middle(row), from_middle(column), 0.0);
            if let Some(road_user) = boxes.iter().find(|user| user.thing.covers(place)) {
                let hidden = seen
                    .get(&road_user.thing.instance)
                    .map_or(1.0, |sight| sight.occlusion());
                let colour = [hidden, 1.0 - hidden, 0.15].map(|c| (c * 255.0) as u8);
                canvas.set(column, row, colour);
            }
        }
    }
    if let Some((column, row)) = from_above(0.0, 0.0) {
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            canvas.set(column + dx, row + dy, [255; 3]);
        }
    }
    canvas
}
