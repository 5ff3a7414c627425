//! Where the sun does not reach: the scene as the sun sees it, drawn once for what stands still and anew for what moves.
//!
//! Each texel holds how near the sun the nearest surface is. Seen along parallel rays that is linear over a face, as
//! inverse depth is in a picture, so faces are drawn by the same spans.
//!
//! - L. Williams, *Casting curved shadows on curved surfaces*, SIGGRAPH 1978.
//! - W. Reeves, D. Salesin, R. Cook, *Rendering antialiased shadows with depth maps*, SIGGRAPH 1987: the tests are blended,
//!   not the depths.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::raster::{BAND, Outline, Polygon, bands};
use crate::lanes::{Lanes, lanes, vectorised};
use crate::scene::{Face, Sun};

/// The finest texel, in metres.
const TEXEL_M: f64 = 0.06;
/// Most texels along an edge.
const EDGE: usize = 4096;
/// Texels along an edge of a tile of what moves.
const TILE: usize = 32;
/// What lies lower casts no shadow that could be seen.
const GROUND_M: f64 = 0.1;

/// How far up the sun's rays surfaces are.
#[derive(Clone, Debug)]
pub(super) struct ShadowMap {
    /// Right, up and towards the sun.
    axes: [Vector3<f64>; 3],
    /// Least coordinates along the first two.
    low: [f64; 2],
    texel_m: f64,
    width: usize,
    height: usize,
    nearest: Vec<f32>,
}

impl ShadowMap {
    /// An empty map that covers all that these faces could cast.
    pub(super) fn around(faces: &[Face], sun: &Sun) -> Self {
        let towards = sun.direction();
        let right = Vector3::new(-towards.y, towards.x, 0.0)
            .try_normalize(1e-9)
            .unwrap_or(Vector3::x());
        let axes = [right, towards.cross(&right), towards];
        let corners = casters(faces).flat_map(Face::corners);
        let (low, high) = corners.fold(
            ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]),
            |(low, high), corner| {
                let at = |i: usize| corner.raw.coords.dot(&axes[i]);
                (
                    [0, 1].map(|i| at(i).min(low[i])),
                    [0, 1].map(|i| at(i).max(high[i])),
                )
            },
        );
        let size = [0, 1].map(|i| (high[i] - low[i]).max(0.0));
        let texel_m = (size[0].max(size[1]) / (EDGE - 2) as f64).max(TEXEL_M);
        let [width, height] = size.map(|size| (size / texel_m) as usize + 2);
        Self {
            axes,
            low,
            texel_m,
            width,
            height,
            nearest: vec![f32::NEG_INFINITY; width * height],
        }
    }

    /// Draws more faces into it.
    pub(super) fn draw(&mut self, faces: &[Face]) {
        let casting: Vec<_> = casters(faces).filter_map(|face| self.cast(face)).collect();
        let outlines: Vec<_> = casting.iter().map(|(outline, _)| outline).collect();
        let bands = bands(&outlines, self.height);
        let width = self.width;
        self.nearest
            .par_chunks_mut(width * BAND)
            .zip(&bands)
            .enumerate()
            .for_each(|(band, (texels, faces))| {
                for &face in faces {
                    let (outline, [a, b, c]) = &casting[face as usize];
                    for (row, texels) in (band * BAND..).zip(texels.chunks_mut(width)) {
                        let at_row = b * row as f64 + c;
                        for column in outline.span(row as f64, width).into_iter().flatten() {
                            let here = (a * column as f64 + at_row) as f32;
                            texels[column] = texels[column].max(here);
                        }
                    }
                }
            });
    }

    /// Its outline in texels, and how near it is as `plane · (column, row, 1)`. `None` if the sun sees its back or its edge.
    fn cast(&self, face: &Face) -> Option<(Outline, [f64; 3])> {
        let normal = face.edge_u.raw.cross(&face.edge_v.raw).normalize();
        let facing = normal.dot(&self.axes[2]);
        if facing.is_nan() || facing <= 1e-3 {
            return None;
        }
        let mut polygon = Polygon::default();
        for corner in face.corners() {
            polygon.push(self.texel(corner.raw));
        }
        let outline = Outline::of(polygon);
        let distance = normal.dot(&face.corner.raw.coords);
        let [a, b] = [0, 1].map(|i| -normal.dot(&self.axes[i]) / facing);
        let offset = distance / facing + a * self.low[0] + b * self.low[1];
        let plane = [a * self.texel_m, b * self.texel_m, offset];
        outline
            .is_within(self.width, self.height)
            .then_some((outline, plane))
    }

    /// The tile with that texel at its corner; nothing is near the sun beyond the map's edge.
    fn tile(&self, low: usize, left: usize) -> [[f32; TILE]; TILE] {
        let mut tile = [[f32::NEG_INFINITY; TILE]; TILE];
        let columns = left..(left + TILE).min(self.width);
        for (row, texels) in (low..self.height).zip(&mut tile) {
            let drawn = &self.nearest[row * self.width..][columns.clone()];
            texels[..drawn.len()].copy_from_slice(drawn);
        }
        tile
    }

    fn texel(&self, p: Point3<f64>) -> [f64; 2] {
        [0, 1].map(|i| (p.coords.dot(&self.axes[i]) - self.low[i]) / self.texel_m)
    }
}

/// Where the sun does not reach at one moment: the map of all that stands still, and those parts of it anew over which
/// something moves.
#[derive(Clone, Debug)]
pub(super) struct Shadows {
    still: Arc<ShadowMap>,
    /// For each tile of the map, row by row, which of `drawn` replaces it, counted from 1; 0 for none.
    tiles: Vec<u32>,
    /// How near the sun the nearest surfaces of those tiles are.
    drawn: Vec<[[f32; TILE]; TILE]>,
}

impl Shadows {
    /// Adds faces to what stands still.
    pub(super) fn new(still: Arc<ShadowMap>, moving: &[Face]) -> Self {
        let across = still.width.div_ceil(TILE);
        let mut shadows = Self {
            tiles: vec![0; across * still.height.div_ceil(TILE)],
            drawn: Vec::new(),
            still,
        };
        for face in casters(moving) {
            let cast = shadows.still.cast(face);
            if let Some((outline, plane)) = cast {
                shadows.draw(&outline, plane);
            }
        }
        shadows
    }

    fn draw(&mut self, outline: &Outline, [a, b, c]: [f64; 3]) {
        let width = self.still.width;
        for row in outline.rows_within(self.still.height) {
            let at_row = b * row as f64 + c;
            for column in outline.span(row as f64, width).into_iter().flatten() {
                let here = (a * column as f64 + at_row) as f32;
                let texel = self.texel_mut(row, column);
                *texel = texel.max(here);
            }
        }
    }

    fn texel_mut(&mut self, row: usize, column: usize) -> &mut f32 {
        let across = self.still.width.div_ceil(TILE);
        let tile = &mut self.tiles[row / TILE * across + column / TILE];
        if *tile == 0 {
            let [low, left] = [row, column].map(|at| at / TILE * TILE);
            self.drawn.push(self.still.tile(low, left));
            *tile = self.drawn.len() as u32;
        }
        &mut self.drawn[*tile as usize - 1][row % TILE][column % TILE]
    }

    /// How near the sun surfaces are at a texel, right of it, above it and at both.
    fn nearest(&self, row: usize, column: usize) -> [f32; 4] {
        let (width, across) = (self.still.width, self.still.width.div_ceil(TILE));
        let tile = |row: usize, column: usize| self.tiles[row / TILE * across + column / TILE];
        let is_within = row % TILE < TILE - 1 && column % TILE < TILE - 1;
        if is_within && tile(row, column) == 0 {
            let low = &self.still.nearest[row * width + column..][..width + 2];
            return [low[0], low[1], low[width], low[width + 1]];
        }
        let of = |row: usize, column: usize| match tile(row, column) {
            0 => self.still.nearest[row * width + column],
            tile => self.drawn[tile as usize - 1][row % TILE][column % TILE],
        };
        [
            of(row, column),
            of(row, column + 1),
            of(row + 1, column),
            of(row + 1, column + 1),
        ]
    }

    /// Which share of the sun reaches places on a surface with that normal.
    pub(super) fn sunlit(&self, places: &[Lanes<f64>; 3], normal: &Vector3<f64>) -> Lanes {
        let Texels { x, y, depth } = texels(&self.still, places, normal);
        let inside = |at: f64, size: usize| at >= 0.0 && at < (size - 1) as f64;
        lanes!(k => {
            if inside(x[k], self.still.width) && inside(y[k], self.still.height) {
                self.blended([x[k], y[k]], depth[k])
            } else {
                1.0
            }
        })
    }

    fn blended(&self, [x, y]: [f64; 2], depth: f32) -> f32 {
        let (column, row) = (x as usize, y as usize);
        let [right, up] = [x - column as f64, y - row as f64].map(|share| share as f32);
        let nearest = self.nearest(row, column);
        let lit = nearest.map(|nearest| f32::from(u8::from(nearest <= depth)));
        let low = lit[0] * (1.0 - right) + lit[1] * right;
        let high = lit[2] * (1.0 - right) + lit[3] * right;
        low * (1.0 - up) + high * up
    }
}

/// Places in a map, and how near the sun they are.
struct Texels {
    x: Lanes<f64>,
    y: Lanes<f64>,
    depth: Lanes,
}

vectorised! {
fn texels(map: &ShadowMap, places: &[Lanes<f64>; 3], normal: &Vector3<f64>) -> Texels {
    let [x, y, z] = places;
    // A little above the surface, which must not shade itself where a texel covers a slope.
    let raised = normal * (1.5 * map.texel_m);
    let towards = map.axes[2] * 0.02;
    let x = lanes!(k => x[k] + raised.x + towards.x);
    let y = lanes!(k => y[k] + raised.y + towards.y);
    let z = lanes!(k => z[k] + raised.z + towards.z);
    let [right, up, sun] = &map.axes;
    Texels {
        x: lanes!(k => (x[k] * right.x + y[k] * right.y + z[k] * right.z - map.low[0]) / map.texel_m),
        y: lanes!(k => (x[k] * up.x + y[k] * up.y + z[k] * up.z - map.low[1]) / map.texel_m),
        depth: lanes!(k => (x[k] * sun.x + y[k] * sun.y + z[k] * sun.z) as f32),
    }
}
}

fn casters(faces: &[Face]) -> impl Iterator<Item = &Face> {
    let is_above = |face: &&Face| face.corners().iter().any(|corner| corner.raw.z > GROUND_M);
    faces.iter().filter(is_above)
}
