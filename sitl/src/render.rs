//! Pictures with exact depth: a span rasteriser into a visibility buffer, then shading of what is visible.
//!
//! A plane `n·p = d` seen along the ray `(x, y, 1)` of a pixel has the inverse depth
//!
//! ```text
//! 1/z = (n_x·x + n_y·y + n_z) / d        (x, y) = ((u - cx)/fx, (v - cy)/fy)
//! ```
//!
//! which is linear in the pixel: no interpolation error, and colour, depth and instance of a pixel come from the same
//! face. Rows are independent, so the picture is the same on any number of threads.
//!
//! - J. Burns and W. Hunt, *The Visibility Buffer: A Cache-Friendly Approach to Deferred Shading*, JCGT 2(2), 2013.

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::scene::{Face, Instance, Material, Scene, Spot};

/// Surfaces nearer than this are not drawn.
const NEAR_M: f64 = 0.05;
/// Where the lamps hang, in the world; each lights what faces it.
const LAMPS: [[f64; 3]; 2] = [[0.2, 1.0, 2.8], [2.6, -0.9, 2.8]];
/// What is seen above the walls.
const SKY: [u8; 3] = [226, 231, 238];

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

/// A face as the camera sees it: its outline in pixels and its plane as inverse depth.
struct Seen {
    outline: Vec<[f64; 2]>,
    rows: [f64; 2],
    /// `1/z = inverse · (u, v, 1)`.
    inverse: [f64; 3],
    corner: Vector3<f64>,
    u: Vector3<f64>,
    v: Vector3<f64>,
    normal: Vector3<f64>,
    size: [f32; 2],
    material: Material,
    instance: Instance,
}

#[derive(Clone, Copy, Default)]
struct Pixel {
    rgb: [u8; 3],
    depth_m: f32,
    facing: f32,
    instance: Instance,
}

/// Draws the scene as it is at that moment. The camera's lens distortion is not applied: a simulated lens has none.
pub fn render(
    scene: &Scene,
    at: Stamp,
    camera: &Pinhole,
    world_from_camera: Isometry<World, Camera>,
) -> Picture {
    let camera_from_world = world_from_camera.inverse();
    let seen: Vec<Seen> = scene
        .faces(at)
        .iter()
        .filter_map(|face| see(face, camera, &camera_from_world))
        .collect();
    let lamps = LAMPS.map(|lamp| camera_from_world.raw * Point3::from(lamp));
    let view = View {
        camera,
        seen: &seen,
        lamps,
    };
    let mut pixels = vec![Pixel::default(); camera.width * camera.height];
    pixels
        .par_chunks_mut(camera.width.max(1))
        .enumerate()
        .for_each(|(row, pixels)| view.draw_row(row, pixels));
    Picture {
        at,
        width: camera.width,
        height: camera.height,
        rgb: pixels.iter().map(|pixel| pixel.rgb).collect(),
        depth_m: pixels.iter().map(|pixel| pixel.depth_m).collect(),
        facing: pixels.iter().map(|pixel| pixel.facing).collect(),
        instance: pixels.iter().map(|pixel| pixel.instance).collect(),
    }
}

/// `None` for a face that shows its back, or lies behind the camera or beside the picture.
fn see(face: &Face, camera: &Pinhole, camera_from_world: &Isometry<Camera, World>) -> Option<Seen> {
    let corner = (*camera_from_world * face.corner).raw.coords;
    let edge_u = (*camera_from_world * face.edge_u).raw;
    let edge_v = (*camera_from_world * face.edge_v).raw;
    let normal = edge_u.cross(&edge_v).normalize();
    let distance = normal.dot(&corner);
    if distance >= -1e-9 {
        return None;
    }
    let corners = [
        corner,
        corner + edge_u,
        corner + edge_u + edge_v,
        corner + edge_v,
    ];
    let outline: Vec<[f64; 2]> = clip_near(&corners)
        .iter()
        .map(|p| {
            [
                camera.fx * p.x / p.z + camera.cx,
                camera.fy * p.y / p.z + camera.cy,
            ]
        })
        .collect();
    let (left, right) = extent(outline.iter().map(|p| p[0]));
    let (top, bottom) = extent(outline.iter().map(|p| p[1]));
    let outside = outline.len() < 3
        || right < 0.0
        || bottom < 0.0
        || left > camera.width as f64
        || top > camera.height as f64;
    if outside {
        return None;
    }
    let (x, y) = (
        normal.x / distance / camera.fx,
        normal.y / distance / camera.fy,
    );
    let offset = normal.z / distance - x * camera.cx - y * camera.cy;
    Some(Seen {
        outline,
        rows: [top, bottom],
        inverse: [x, y, offset],
        corner,
        u: edge_u.normalize(),
        v: edge_v.normalize(),
        normal,
        size: [edge_u.norm() as f32, edge_v.norm() as f32],
        material: face.material,
        instance: face.instance,
    })
}

fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    })
}

/// The part of a convex polygon in front of the near plane (Sutherland and Hodgman, one plane).
fn clip_near(corners: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut inside = Vec::with_capacity(corners.len() + 1);
    for (i, &from) in corners.iter().enumerate() {
        let to = corners[(i + 1) % corners.len()];
        if from.z >= NEAR_M {
            inside.push(from);
        }
        if (from.z >= NEAR_M) != (to.z >= NEAR_M) {
            inside.push(from + (to - from) * ((NEAR_M - from.z) / (to.z - from.z)));
        }
    }
    inside
}

struct View<'a> {
    camera: &'a Pinhole,
    seen: &'a [Seen],
    lamps: [Point3<f64>; 2],
}

impl View<'_> {
    fn draw_row(&self, row: usize, pixels: &mut [Pixel]) {
        let v = row as f64;
        let mut inverse = vec![0.0_f64; pixels.len()];
        let mut visible = vec![usize::MAX; pixels.len()];
        for (index, seen) in self.seen.iter().enumerate() {
            let Some(columns) = seen.span(v, pixels.len()) else {
                continue;
            };
            let [a, b, c] = seen.inverse;
            let at_row = b * v + c;
            for column in columns {
                let here = a * column as f64 + at_row;
                if here > inverse[column] {
                    (inverse[column], visible[column]) = (here, index);
                }
            }
        }
        for (column, pixel) in pixels.iter_mut().enumerate() {
            *pixel = self.seen.get(visible[column]).map_or(
                Pixel {
                    rgb: SKY,
                    ..Pixel::default()
                },
                |seen| self.shade([column as f64, v], 1.0 / inverse[column], seen),
            );
        }
    }

    fn shade(&self, [column, row]: [f64; 2], depth_m: f64, seen: &Seen) -> Pixel {
        let camera = self.camera;
        let ray = Vector3::new(
            (column - camera.cx) / camera.fx,
            (row - camera.cy) / camera.fy,
            1.0,
        );
        let p = ray * depth_m;
        let from_corner = p - seen.corner;
        let facing = (-seen.normal.dot(&ray) / ray.norm()).max(0.0);
        // A pixel covers depth/f metres across; seen at a slant, more.
        let footprint = depth_m / camera.fx / facing.max(0.1).sqrt();
        let reflectance = seen.material.reflectance(Spot {
            u: from_corner.dot(&seen.u) as f32,
            v: from_corner.dot(&seen.v) as f32,
            size: seen.size,
            footprint: footprint as f32,
        });
        let light = self.light(&p, &seen.normal);
        Pixel {
            // The camera's gamma of 2.2, nearly.
            rgb: reflectance.map(|share| ((share * light).clamp(0.0, 1.0).sqrt() * 255.0) as u8),
            depth_m: depth_m as f32,
            facing: facing as f32,
            instance: seen.instance,
        }
    }

    /// Lambert's law for each lamp, and light from everywhere.
    fn light(&self, p: &Vector3<f64>, normal: &Vector3<f64>) -> f32 {
        let lamps: f64 = self
            .lamps
            .iter()
            .map(|lamp| {
                let to_lamp = lamp.coords - p;
                let square = to_lamp.norm_squared();
                1.6 * (normal.dot(&to_lamp) / square.sqrt()).max(0.0) / (1.0 + 0.35 * square)
            })
            .sum();
        (0.42 + lamps) as f32
    }
}

impl Seen {
    /// The pixels of a row whose centres lie within the outline.
    fn span(&self, v: f64, width: usize) -> Option<std::ops::Range<usize>> {
        if v < self.rows[0] || v > self.rows[1] {
            return None;
        }
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for (i, &[x0, y0]) in self.outline.iter().enumerate() {
            let [x1, y1] = self.outline[(i + 1) % self.outline.len()];
            // Half open, so that an edge shared by two faces is counted once and no row falls between them.
            if (y0 <= v) != (y1 <= v) {
                // From the upper end, so that both faces round alike.
                let (top, low) = if y0 < y1 {
                    ([x0, y0], [x1, y1])
                } else {
                    ([x1, y1], [x0, y0])
                };
                let x = top[0] + (v - top[1]) * (low[0] - top[0]) / (low[1] - top[1]);
                left = left.min(x);
                right = right.max(x);
            }
        }
        let from = left.ceil().max(0.0);
        let to = right.ceil().min(width as f64);
        (from < to).then_some(from as usize..to as usize)
    }
}

#[cfg(test)]
mod tests;
