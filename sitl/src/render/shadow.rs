//! Where the sun does not reach: the scene as the sun sees it, drawn once for what stands still and anew for what moves.
//!
//! Each texel holds how near the sun the nearest surface is. Seen along parallel rays that is linear over a face, as
//! inverse depth is in a picture, so faces are drawn by the same spans.
//!
//! - L. Williams, *Casting curved shadows on curved surfaces*, SIGGRAPH 1978.
//! - W. Reeves, D. Salesin, R. Cook, *Rendering antialiased shadows with depth maps*, SIGGRAPH 1987: the tests are blended,
//!   not the depths.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::raster::{BAND, Outline, Polygon, bands};
use crate::scene::{Face, Sun};

/// The finest texel, in metres.
const TEXEL_M: f64 = 0.06;
/// Most texels along an edge.
const EDGE: usize = 4096;
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

    fn texel(&self, p: Point3<f64>) -> [f64; 2] {
        [0, 1].map(|i| (p.coords.dot(&self.axes[i]) - self.low[i]) / self.texel_m)
    }

    /// Which share of the sun reaches a place on a surface with that normal.
    pub(super) fn sunlit(&self, p: Point3<f64>, normal: &Vector3<f64>) -> f32 {
        // A little above the surface, which must not shade itself where a texel covers a slope.
        let p = p + normal * (1.5 * self.texel_m) + self.axes[2] * 0.02;
        let [x, y] = self.texel(p);
        let depth = p.coords.dot(&self.axes[2]) as f32;
        let inside = |at: f64, size: usize| at >= 0.0 && at < (size - 1) as f64;
        if !inside(x, self.width) || !inside(y, self.height) {
            return 1.0;
        }
        let (column, row) = (x as usize, y as usize);
        let [right, up] = [x - column as f64, y - row as f64].map(|share| share as f32);
        let lit = |column: usize, row: usize| {
            f32::from(u8::from(self.nearest[row * self.width + column] <= depth))
        };
        let low = lit(column, row) * (1.0 - right) + lit(column + 1, row) * right;
        let high = lit(column, row + 1) * (1.0 - right) + lit(column + 1, row + 1) * right;
        low * (1.0 - up) + high * up
    }
}

fn casters(faces: &[Face]) -> impl Iterator<Item = &Face> {
    let is_above = |face: &&Face| face.corners().iter().any(|corner| corner.raw.z > GROUND_M);
    faces.iter().filter(is_above)
}
