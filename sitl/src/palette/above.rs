//! What surrounds a vehicle, from above: ahead is up, left is left.

use std::collections::BTreeMap;

use maps::frame::{Body, Camera, Isometry, World};
use nalgebra::Point3;

use super::{Canvas, hidden_share};
use crate::lidar::Return;
use crate::platform;
use crate::rays::Rays;
use crate::render::{Moment, Picture};
use crate::scene::{Class, Scene};
use crate::truth::{bev, boxes, sight, voxels};

/// How far the views from above reach from their middle.
const REACH_M: f64 = 32.0;
const BACKGROUND: [u8; 3] = [24, 26, 30];

/// A square picture from above.
#[derive(Clone, Copy, Debug)]
pub struct Above {
    /// The vehicle in its middle.
    pub body: Isometry<World, Body>,
    /// Its edge in pixels.
    pub size: usize,
}

impl Above {
    /// Where something at these body coordinates is; x is up.
    fn pixel(&self, x: f64, y: f64) -> Option<(usize, usize)> {
        let scale = self.size as f64 / (2.0 * REACH_M);
        let place = |c: f64| {
            let at = (REACH_M - c) * scale;
            (at >= 0.0 && at < self.size as f64).then_some(at as usize)
        };
        Some((place(y)?, place(x)?))
    }

    fn blank(&self) -> Canvas {
        Canvas::filled(self.size, self.size, BACKGROUND)
    }

    /// What a `LiDAR` has met, in the colour of its class.
    pub fn lidar(&self, scene: &Scene, returns: &[Return]) -> Canvas {
        let mut canvas = self.blank();
        for seen in returns {
            let [x, y, _] = seen.point.map(f64::from);
            if let Some((column, row)) = self.pixel(x, y) {
                canvas.set(column, row, scene.class_of(seen.instance).colour());
            }
        }
        canvas
    }

    /// The true classes of the street, in cells of half a metre.
    pub fn street(&self, moment: &Moment<'_>, rays: &Rays<'_>) -> Canvas {
        let truth = bev(rays, moment.at(), self.body, 128, 0.5);
        let pixels = truth.classes.iter().map(|class| class.colour()).collect();
        Canvas::new(truth.size, truth.size, pixels).scaled(self.size, self.size)
    }

    /// The highest voxel below 4 m of each column, brighter the higher it is.
    pub fn voxels(&self, scene: &Scene) -> Canvas {
        let middle = self.body.raw.translation.vector;
        let corner = |sign: f64, z: f64| {
            Point3::new(middle.x + sign * REACH_M, middle.y + sign * REACH_M, z)
        };
        let truth = voxels(scene, 0.1, [corner(-1.0, -0.3), corner(1.0, 4.0)]);
        let mut highest: BTreeMap<(usize, usize), (i32, Class)> = BTreeMap::new();
        for ([x, y, z], class) in &truth.classes {
            let at = Point3::new(f64::from(*x), f64::from(*y), 0.0) * 0.1;
            let local = self.body.raw.inverse() * at;
            if let Some(place) = self.pixel(local.x, local.y) {
                let highest = highest.entry(place).or_insert((*z, *class));
                *highest = (*z, *class).max(*highest);
            }
        }
        let mut canvas = self.blank();
        for ((column, row), (z, class)) in highest {
            let shade = 0.35 + 0.65 * f64::from(z.clamp(0, 40)) / 40.0;
            let colour = class
                .colour()
                .map(|c| (f64::from(c).max(40.0) * shade) as u8);
            canvas.set(column, row, colour);
        }
        canvas
    }

    /// Each road user's box: green where the ground vehicle's cameras see all of it, red where they see nothing.
    pub fn occlusions(
        &self,
        moment: &Moment<'_>,
        views: &[(Isometry<World, Camera>, Picture)],
    ) -> Canvas {
        let seen = sight(moment, &platform::ugv_lens(), views);
        let mut canvas = self.blank();
        let boxes = boxes(moment.scene(), moment.at());
        for row in 0..self.size {
            for column in 0..self.size {
                let from_middle =
                    |at: usize| REACH_M - (at as f64 + 0.5) * 2.0 * REACH_M / self.size as f64;
                let place = self.body.raw * Point3::new(from_middle(row), from_middle(column), 0.0);
                if let Some(road_user) = boxes.iter().find(|user| user.thing.covers(place)) {
                    let sight = seen.get(&road_user.thing.instance);
                    let hidden = sight.map_or(1.0, |sight| sight.occlusion());
                    canvas.set(column, row, hidden_share(hidden));
                }
            }
        }
        if let Some((column, row)) = self.pixel(0.0, 0.0) {
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                canvas.set(column + dx, row + dy, [255; 3]);
            }
        }
        canvas
    }
}
