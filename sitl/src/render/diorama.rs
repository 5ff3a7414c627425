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
use super::shade::{developed, lamplit};
use super::shadow::Shadows;
use crate::lanes::{LANES, Lanes};
use crate::scene::{Colours, Daylight, Face, Light, Material, Scene, Spots, Sun};

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
    Sun(Sun, Shadows),
}

impl Diorama {
    /// Bakes a scene.
    pub fn new(stage: &Stage<'_>) -> Self {
        let light = match (stage.scene.light(), &stage.shadows) {
            (Light::Sun(sun), Some(still)) => Lit::Sun(*sun, Shadows::new(Arc::clone(still), &[])),
            (Light::Lamps(lamps), _) => {
                Lit::Lamps(lamps.iter().map(|lamp| Point3::from(*lamp)).collect())
            }
            // A stage has shadows wherever there is a sun.
            (Light::Sun(_), None) => Lit::Lamps(Vec::new()),
        };
        let faces = stage.scene.still();
        let areas: Vec<_> = faces.iter().map(area_m2).collect();
        let (patches, texel_m) = atlas::lay_out(faces, |i| areas[i] >= SMALL_M2);
        let atlas = atlas::paint(&patches, |patch, shares| {
            light.colours(&faces[patch.face], shares, patch.texel_m as f32)
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
                (one(&developed(&every(air), sun.exposure)), sun.haze)
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
            let colour = self.light.colour(face, middle(face), 0.3);
            triangles(face, |_| (WHITE, opaque(colour)))
        });
        vertices.collect()
    }
}

/// The middle of a face, as shares of its edges.
fn middle(face: &Face) -> [f64; 2] {
    [0.25 + 0.25 * (face.top[0] + face.top[1]), 0.5]
}

impl Lit {
    /// The colour of a face at a place, given as shares of its edges: the mean over a `footprint` in metres.
    fn colour(&self, face: &Face, share: [f64; 2], footprint: f32) -> [u8; 3] {
        self.colours(face, &[share; LANES], footprint)[0]
    }

    /// The same at several places.
    fn colours(&self, face: &Face, shares: &[[f64; 2]; LANES], footprint: f32) -> Lanes<[u8; 3]> {
        let size = [face.edge_u.raw.norm(), face.edge_v.raw.norm()];
        let places =
            shares.map(|[s, t]| face.corner.raw + face.edge_u.raw * s + face.edge_v.raw * t);
        let places = [0, 1, 2].map(|axis| places.map(|place| place[axis]));
        let along = if face.material.follows_the_world() {
            [0, 1].map(|axis| places[axis].map(|metres| metres as f32))
        } else {
            [0, 1].map(|edge| shares.map(|share| (share[edge] * size[edge]) as f32))
        };
        let spots = Spots::new(along, size.map(|m| m as f32), [footprint; LANES]);
        let reflectance = face.material.reflectance(&spots);
        let normal = face.edge_u.raw.cross(&face.edge_v.raw);
        let normal = normal.try_normalize(1e-12).unwrap_or(Vector3::z());
        let levels = match self {
            Self::Lamps(lamps) => developed(&lamplit(lamps, &places, &normal, &reflectance), 1.0),
            Self::Sun(sun, shadows) => {
                let day = Daylight::of(sun);
                let falling = day.on(&normal);
                let is_lit = normal.dot(&day.towards) > 0.0;
                let sunlit = if is_lit {
                    shadows.sunlit(&places, &normal)
                } else {
                    [0.0; LANES]
                };
                let mut colours = reflectance;
                for (k, sunlit) in sunlit.into_iter().enumerate() {
                    let light = day.light(falling, sunlit);
                    for c in 0..3 {
                        colours[c][k] *= light[c];
                    }
                }
                let colours = mirrored(face.material, &day, &normal, colours);
                developed(&colours, sun.exposure)
            }
        };
        std::array::from_fn(|k| [levels[0][k], levels[1][k], levels[2][k]])
    }

    /// A face with a colour at each corner.
    fn plain(&self, face: &Face, footprint: f32) -> Vec<Vertex> {
        triangles(face, |share| {
            // A little inwards: corners of what stands on the ground would lie in its shadow.
            let middle = middle(face);
            let inner = [0, 1].map(|i| share[i] + 0.2 * (middle[i] - share[i]));
            let colour = self.colour(face, inner, footprint);
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
                let sky = day.sky_towards(&every([flat * east, flat * north, up]));
                *pixel = opaque(one(&developed(&sky, sun.exposure)));
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
    mut colours: Colours,
) -> Colours {
    let share = 1.4 * material.gloss();
    if share <= 0.0 {
        return colours;
    }
    let towards = (normal + Vector3::z() * 0.6).normalize();
    let sky = day.sky_towards(&every(towards.into()));
    for (levels, sky) in colours.iter_mut().zip(sky) {
        for level in levels {
            *level += (sky[0] - *level) * share;
        }
    }
    colours
}

/// The same in every lane.
fn every<T: Copy>(values: [T; 3]) -> [Lanes<T>; 3] {
    values.map(|value| [value; LANES])
}

/// The first lane.
fn one<T: Copy>(lanes: &[Lanes<T>; 3]) -> [T; 3] {
    [0, 1, 2].map(|c| lanes[c][0])
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
