//! A scene as triangles for a graphics card: all that stands still with its light and shadows baked into one texture, all that
//! moves with one colour a face.
//!
//! It is for looking at only: what sensors see comes from [`Moment`](super::Moment), pixel by pixel. Every large face has a
//! patch of the texture, of which the finest texel is as small as the texture's size allows; small faces have a colour at
//! each corner. A place `corner + s·u + t·v` of a face lies at the texel `offset + (s, t)·size` of its patch, which is
//! exact for trapezoids, too.

mod atlas;

use std::sync::Arc;

use maps::time::Stamp;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::Stage;
use super::shade::{developed, lamplight};
use super::shadow::ShadowMap;
use crate::scene::{Daylight, Face, Light, Material, Scene, Spot};

pub use atlas::Texture;
use atlas::{Patch, WHITE};

/// Azimuths and elevations of the sky's texture.
const SKY: [usize; 2] = [512, 128];
/// What is around a room.
const AROUND: [u8; 3] = [34, 37, 43];
/// Faces with less than this have a colour at each corner.
const SMALL_M2: f64 = 0.25;

/// A corner of a triangle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    /// In the world, in metres.
    pub position: [f32; 3],
    /// In the texture, from 0 to 1, from its upper left corner.
    pub uv: [f32; 2],
    /// What the texture is multiplied with: red, green, blue, opacity.
    pub colour: [u8; 4],
}

impl Vertex {
    /// A corner of something that has no texture.
    pub fn plain(position: Point3<f64>, colour: [u8; 4]) -> Self {
        Self {
            position: position.coords.map(|c| c as f32).into(),
            uv: WHITE,
            colour,
        }
    }
}

/// A scene's triangles and what they look like.
#[derive(Clone, Debug)]
pub struct Diorama {
    /// All that stands still: three corners a triangle, counter-clockwise as seen.
    pub still: Vec<Vertex>,
    /// What they are covered with.
    pub atlas: Texture,
    /// The sky by azimuth (counter-clockwise from east, a full turn) and elevation (from a right angle down to 0).
    pub sky: Texture,
    /// What distance fades into.
    pub air: [u8; 3],
    /// Share of contrast that is lost over 100 m.
    pub haze: f32,
    /// Edge of a texel of most faces, in metres.
    pub texel_m: f64,
    light: Lit,
}

#[derive(Clone, Debug)]
enum Lit {
    Lamps(Vec<Point3<f64>>),
    Sun(crate::scene::Sun, Arc<ShadowMap>),
}

impl Diorama {
    /// Bakes a scene.
    pub fn new(stage: &Stage<'_>) -> Self {
        let light = match (stage.scene.light(), &stage.shadows) {
            (Light::Sun(sun), Some(shadows)) => Lit::Sun(*sun, Arc::clone(shadows)),
            (Light::Lamps(lamps), _) => {
                Lit::Lamps(lamps.iter().map(|lamp| Point3::from(*lamp)).collect())
            }
            // A stage has shadows wherever there is a sun.
            (Light::Sun(_), None) => Lit::Lamps(Vec::new()),
        };
        let faces = stage.scene.still();
        let areas: Vec<_> = faces.iter().map(area_m2).collect();
        let (patches, texel_m) = atlas::lay_out(faces, |i| areas[i] >= SMALL_M2);
        let atlas = atlas::paint(&patches, |patch, share| {
            let face = &faces[patch.face];
            light.colour(face, Place::of(face, share), patch.texel_m as f32)
        });
        let mut uvs: Vec<Option<&Patch>> = vec![None; faces.len()];
        for patch in &patches {
            uvs[patch.face] = Some(patch);
        }
        let still = faces.par_iter().zip(&uvs);
        let still = still.flat_map_iter(|(face, patch)| match patch {
            Some(patch) => triangles(face, |share| (patch.uv(share), [255; 4])),
            None => light.plain(face, 0.3),
        });
        let still = still.collect();
        let (air, haze) = match &light {
            Lit::Lamps(_) => (AROUND, 0.0),
            Lit::Sun(sun, _) => {
                let air = [0, 1, 2].map(|c| sun.sky[c] * 1.25 + sun.direct[c] * 0.06);
                (developed(air, sun.exposure), sun.haze)
            }
        };
        Self {
            still,
            sky: light.sky(),
            atlas,
            air,
            haze,
            texel_m,
            light,
        }
    }

    /// All that moves, where it is at that moment.
    pub fn moving(&self, scene: &Scene, at: Stamp) -> Vec<Vertex> {
        let faces = scene.moving(at);
        let vertices = faces.par_iter().flat_map_iter(|face| {
            let colour = self.light.colour(face, Place::middle(face), 0.3);
            triangles(face, |_| (WHITE, opaque(colour)))
        });
        vertices.collect()
    }
}

/// A place on a face.
#[derive(Clone, Copy)]
struct Place {
    /// As shares of its edges.
    share: [f64; 2],
    at: Point3<f64>,
}

impl Place {
    fn of(face: &Face, share: [f64; 2]) -> Self {
        let at = face.corner.raw + face.edge_u.raw * share[0] + face.edge_v.raw * share[1];
        Self { share, at }
    }

    fn middle(face: &Face) -> Self {
        Self::of(face, [0.25 + 0.25 * (face.top[0] + face.top[1]), 0.5])
    }
}

impl Lit {
    /// The colour of a face at a place, the mean over a `footprint` in metres.
    fn colour(&self, face: &Face, place: Place, footprint: f32) -> [u8; 3] {
        let size = [face.edge_u.raw.norm(), face.edge_v.raw.norm()];
        let [u, v] = if face.material.follows_the_world() {
            [place.at.x, place.at.y]
        } else {
            [0, 1].map(|i| place.share[i] * size[i])
        };
        let reflectance = face.material.reflectance(Spot {
            u: u as f32,
            v: v as f32,
            size: size.map(|m| m as f32),
            footprint,
        });
        let normal = face.edge_u.raw.cross(&face.edge_v.raw);
        let normal = normal.try_normalize(1e-12).unwrap_or(Vector3::z());
        match self {
            Self::Lamps(lamps) => {
                let light = lamplight(lamps, &place.at.coords, &normal);
                developed(reflectance.map(|share| share * light), 1.0)
            }
            Self::Sun(sun, shadows) => {
                let day = Daylight::of(sun);
                let is_lit = normal.dot(&day.towards) > 0.0;
                let sunlit = if is_lit {
                    shadows.sunlit(place.at, &normal)
                } else {
                    0.0
                };
                let light = day.on(&normal, sunlit);
                let colour = [0, 1, 2].map(|c| reflectance[c] * light[c]);
                let colour = mirrored(face.material, &day, &normal, colour);
                developed(colour, sun.exposure)
            }
        }
    }

    /// A face with a colour at each corner.
    fn plain(&self, face: &Face, footprint: f32) -> Vec<Vertex> {
        triangles(face, |share| {
            // A little inwards: corners of what stands on the ground would lie in its shadow.
            let middle = Place::middle(face).share;
            let inner = [0, 1].map(|i| share[i] + 0.2 * (middle[i] - share[i]));
            let colour = self.colour(face, Place::of(face, inner), footprint);
            (WHITE, opaque(colour))
        })
    }

    fn sky(&self) -> Texture {
        let [width, height] = SKY;
        let Self::Sun(sun, _) = self else {
            return Texture::of_one_colour(AROUND);
        };
        let day = Daylight::of(sun);
        let mut sky = Texture::black([width, height]);
        let rows = sky.pixels.par_chunks_mut(width).enumerate();
        rows.for_each(|(row, pixels)| {
            let share = (row as f64 + 0.5) / height as f64;
            let (up, flat) = ((1.0 - share) * std::f64::consts::FRAC_PI_2).sin_cos();
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let azimuth = (column as f64 + 0.5) / width as f64 * std::f64::consts::TAU;
                let (north, east) = azimuth.sin_cos();
                let direction = Vector3::new(flat * east, flat * north, up);
                *pixel = opaque(developed(day.sky_towards(&direction), sun.exposure));
            }
        });
        sky
    }
}

/// What a glossy surface mirrors to one who looks at it from somewhat above: the sky. Which part of it is left open.
fn mirrored(
    material: Material,
    day: &Daylight<'_>,
    normal: &Vector3<f64>,
    colour: [f32; 3],
) -> [f32; 3] {
    let share = 1.4 * material.gloss();
    if share <= 0.0 {
        return colour;
    }
    let towards = (normal + Vector3::z() * 0.6).normalize();
    let sky = day.sky_towards(&towards);
    [0, 1, 2].map(|c| colour[c] + (sky[c] - colour[c]) * share)
}

fn opaque([r, g, b]: [u8; 3]) -> [u8; 4] {
    [r, g, b, 255]
}

fn area_m2(face: &Face) -> f64 {
    let width = (1.0 + face.top[1] - face.top[0]) / 2.0;
    width * face.edge_u.raw.norm() * face.edge_v.raw.norm()
}

/// The one or two triangles of a face. `look` gives the texture's place and the colour for a corner by its shares
/// of the edges.
fn triangles(face: &Face, look: impl Fn([f64; 2]) -> ([f32; 2], [u8; 4])) -> Vec<Vertex> {
    let shares = [
        [0.0, 0.0],
        [1.0, 0.0],
        [face.top[1], 1.0],
        [face.top[0], 1.0],
    ];
    let corners = face.corners();
    let vertex = |i: usize| {
        let (uv, colour) = look(shares[i]);
        Vertex {
            position: corners[i].raw.coords.map(|c| c as f32).into(),
            uv,
            colour,
        }
    };
    let is_triangle = (face.top[1] - face.top[0]).abs() < 1e-9;
    let order: &[usize] = if is_triangle {
        &[0, 1, 2]
    } else {
        &[0, 1, 2, 0, 2, 3]
    };
    let all = [0, 1, 2, 3].map(vertex);
    order.iter().map(|&i| all[i]).collect()
}

#[cfg(test)]
mod tests;
