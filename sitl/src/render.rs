//! Pictures with exact depth: a span rasteriser into a visibility buffer, then shading of what is visible.
//!
//! A plane `n·p = d` seen along the ray `(x, y, 1)` of a pixel has the inverse depth
//!
//! ```text
//! 1/z = (n_x·x + n_y·y + n_z) / d        (x, y) = ((u - cx)/fx, (v - cy)/fy)
//! ```
//!
//! which is linear in the pixel: no interpolation error, and colour, depth and instance of a pixel come from the same
//! face. Bands of rows are independent, so the picture is the same on any number of threads.
//!
//! - J. Burns and W. Hunt, *The Visibility Buffer: A Cache-Friendly Approach to Deferred Shading*, JCGT 2(2), 2013.

pub mod diorama;
mod raster;
mod shade;
mod shadow;

use std::collections::BTreeMap;
use std::sync::Arc;

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::scene::{Face, Instance, Light, Scene};
use raster::{BAND, Outline, Polygon, bands};
use shade::{Pixel, View};
use shadow::ShadowMap;

/// Surfaces nearer than this are not drawn.
const NEAR_M: f64 = 0.05;

/// What an ideal camera sees.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// When.
    pub at: Stamp,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Colour of each pixel, row by row.
    pub rgb: Vec<[u8; 3]>,
    /// True distance along the optical axis in metres; 0 where there is nothing.
    pub depth_m: Vec<f32>,
    /// Cosine between the view ray and the surface's normal; 0 where there is nothing.
    pub facing: Vec<f32>,
    /// What each pixel shows.
    pub instance: Vec<Instance>,
}

/// A scene that is to be drawn, with what its drawings share: the shadows of all that stands still.
#[derive(Clone, Debug)]
pub struct Stage<'a> {
    scene: &'a Scene,
    shadows: Option<Arc<ShadowMap>>,
}

impl<'a> Stage<'a> {
    /// Prepares a scene.
    pub fn new(scene: &'a Scene) -> Self {
        let shadows = match scene.light() {
            Light::Lamps(_) => None,
            Light::Sun(sun) => {
                let mut map = ShadowMap::around(scene.still(), sun);
                map.draw(scene.still());
                Some(Arc::new(map))
            }
        };
        Self { scene, shadows }
    }

    /// The scene at one moment, for as many cameras as look at it.
    pub fn at(&self, at: Stamp) -> Moment<'a> {
        let moving = self.scene.moving(at);
        let mut shadows = self.shadows.clone();
        if let Some(shadows) = &mut shadows
            && !moving.is_empty()
        {
            Arc::make_mut(shadows).draw(&moving);
        }
        Moment {
            scene: self.scene,
            at,
            moving,
            shadows,
        }
    }
}

/// A scene at one moment.
#[derive(Clone, Debug)]
pub struct Moment<'a> {
    scene: &'a Scene,
    at: Stamp,
    moving: Vec<Face>,
    shadows: Option<Arc<ShadowMap>>,
}

impl Moment<'_> {
    /// When.
    pub fn at(&self) -> Stamp {
        self.at
    }

    /// Everything that can be seen.
    pub fn faces(&self) -> impl Iterator<Item = &Face> {
        self.scene.still().iter().chain(&self.moving)
    }

    /// What is drawn.
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// How many pixels each of these instances would cover if nothing else were there; those outside of the picture left out.
    pub fn coverage(
        &self,
        camera: &Pinhole,
        world_from_camera: Isometry<World, Camera>,
        is_wanted: impl Fn(Instance) -> bool,
    ) -> BTreeMap<Instance, u32> {
        let camera_from_world = world_from_camera.inverse();
        let mut outlines: BTreeMap<Instance, Vec<Outline>> = BTreeMap::new();
        for face in self.faces().filter(|face| is_wanted(face.instance)) {
            if let Some(seen) = Seen::new(face, camera, &camera_from_world) {
                outlines
                    .entry(face.instance)
                    .or_default()
                    .push(seen.outline);
            }
        }
        let area = |outlines: &[Outline]| raster::area(outlines, camera.width, camera.height);
        let areas = outlines
            .iter()
            .map(|(instance, outlines)| (*instance, area(outlines)));
        areas.filter(|(_, area)| *area > 0).collect()
    }

    /// What a camera sees from there. The lens distortion is not applied: a simulated lens has none.
    pub fn picture(&self, camera: &Pinhole, world_from_camera: Isometry<World, Camera>) -> Picture {
        let camera_from_world = world_from_camera.inverse();
        let seen: Vec<Seen<'_>> = self
            .faces()
            .filter_map(|face| Seen::new(face, camera, &camera_from_world))
            .collect();
        let outlines: Vec<_> = seen.iter().map(|seen| &seen.outline).collect();
        let bands = bands(&outlines, camera.height);
        let view = View::new(self, camera, world_from_camera);
        let mut pixels = vec![Pixel::default(); camera.width * camera.height];
        pixels
            .par_chunks_mut((camera.width * BAND).max(1))
            .zip(&bands)
            .enumerate()
            .for_each(|(band, (pixels, faces))| {
                draw(&view, band * BAND, pixels, &seen, faces);
            });
        Picture {
            at: self.at,
            width: camera.width,
            height: camera.height,
            rgb: pixels.iter().map(|pixel| pixel.rgb).collect(),
            depth_m: pixels.iter().map(|pixel| pixel.depth_m).collect(),
            facing: pixels.iter().map(|pixel| pixel.facing).collect(),
            instance: pixels.iter().map(|pixel| pixel.instance).collect(),
        }
    }
}

/// Draws the scene as it is at that moment. Who draws more than once keeps a [`Stage`].
pub fn render(
    scene: &Scene,
    at: Stamp,
    camera: &Pinhole,
    world_from_camera: Isometry<World, Camera>,
) -> Picture {
    Stage::new(scene).at(at).picture(camera, world_from_camera)
}

/// A band of rows of which the first is `top`, in which these faces are seen.
fn draw<'a>(
    view: &View<'_>,
    top: usize,
    pixels: &mut [Pixel],
    seen: &'a [Seen<'a>],
    faces: &[u32],
) {
    let width = view.camera.width;
    let mut inverse = vec![0.0_f64; width];
    let mut visible: Vec<Option<&Seen<'_>>> = vec![None; width];
    for (row, pixels) in (top..).zip(pixels.chunks_mut(width)) {
        inverse.fill(0.0);
        visible.fill(None);
        for seen in faces.iter().map(|face| &seen[*face as usize]) {
            let Some(columns) = seen.outline.span(row as f64, width) else {
                continue;
            };
            let [a, b, c] = seen.inverse;
            let at_row = b * row as f64 + c;
            for column in columns {
                let here = a * column as f64 + at_row;
                if here > inverse[column] {
                    (inverse[column], visible[column]) = (here, Some(seen));
                }
            }
        }
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let at = [column as f64, row as f64];
            *pixel = match visible[column] {
                Some(seen) => view.surface(at, 1.0 / inverse[column], seen),
                None => view.sky(at),
            };
        }
    }
}

/// A face as the camera sees it: its outline in pixels and its plane as inverse depth.
struct Seen<'a> {
    face: &'a Face,
    outline: Outline,
    /// `1/z = inverse · (u, v, 1)`.
    inverse: [f64; 3],
    corner: Vector3<f64>,
    u: Vector3<f64>,
    v: Vector3<f64>,
    normal: Vector3<f64>,
    size: [f32; 2],
}

impl<'a> Seen<'a> {
    /// `None` for a face that shows its back, or lies behind the camera or beside the picture.
    fn new(
        face: &'a Face,
        camera: &Pinhole,
        camera_from_world: &Isometry<Camera, World>,
    ) -> Option<Self> {
        let corner = (*camera_from_world * face.corner).raw.coords;
        let edge_u = (*camera_from_world * face.edge_u).raw;
        let edge_v = (*camera_from_world * face.edge_v).raw;
        let normal = edge_u.cross(&edge_v).normalize();
        let distance = normal.dot(&corner);
        // A face without area has no normal.
        if distance.is_nan() || distance >= -1e-9 {
            return None;
        }
        let [left, right] = face.top.map(|share| corner + edge_u * share + edge_v);
        let corners = [corner, corner + edge_u, right, left];
        let in_front = clip_near(&corners)?;
        let outline = Outline::of(in_front.map(|p| {
            [
                camera.fx * p.x / p.z + camera.cx,
                camera.fy * p.y / p.z + camera.cy,
            ]
        }));
        if !outline.is_within(camera.width, camera.height) {
            return None;
        }
        let (x, y) = (
            normal.x / distance / camera.fx,
            normal.y / distance / camera.fy,
        );
        let offset = normal.z / distance - x * camera.cx - y * camera.cy;
        Some(Self {
            face,
            outline,
            inverse: [x, y, offset],
            corner,
            u: edge_u.normalize(),
            v: edge_v.normalize(),
            normal,
            size: [edge_u.norm() as f32, edge_v.norm() as f32],
        })
    }
}

/// The part of a convex polygon in front of the near plane (Sutherland and Hodgman, one plane).
fn clip_near(corners: &[Vector3<f64>; 4]) -> Option<Polygon<Vector3<f64>>> {
    let mut inside = Polygon::default();
    for (i, &from) in corners.iter().enumerate() {
        let to = corners[(i + 1) % corners.len()];
        if from.z >= NEAR_M {
            inside.push(from);
        }
        if (from.z >= NEAR_M) != (to.z >= NEAR_M) {
            inside.push(from + (to - from) * ((NEAR_M - from.z) / (to.z - from.z)));
        }
    }
    (inside.len() >= 3).then_some(inside)
}

#[cfg(test)]
mod tests;
