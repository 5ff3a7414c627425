//! One texture for all faces: where each has its patch, and what is painted there.

use rayon::prelude::*;

use crate::lanes::{LANES, Lanes};
use crate::scene::Face;

/// Width and greatest height of the texture; every graphics card takes it.
const SIZE: [usize; 2] = [4096, 4096];
/// Around each patch, in texels: what is blended with it is still its own, down to a quarter of the size.
const RIM: usize = 2;
/// No patch is longer.
const LONGEST: usize = 1024;
/// Nobody looks for details on faces that are larger than this both ways, the land behind the houses, and there is much of it.
const FIELD_M: f64 = 30.0;
/// Texels that are tried, in metres: the finest for which there is room.
const TEXELS_M: [f64; 9] = [0.02, 0.03, 0.04, 0.06, 0.08, 0.12, 0.2, 0.4, 0.8];
/// How many times the texture is halved.
const HALVINGS: usize = 2;

/// The middle of a white patch in the corner.
pub(super) const WHITE: [f32; 2] = [4.0 / SIZE[0] as f32, 4.0 / SIZE[1] as f32];

/// A picture with red, green, blue and opacity, and the same at half its size and so on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Width and height in texels.
    pub size: [usize; 2],
    /// Row by row.
    pub pixels: Vec<[u8; 4]>,
    /// Each of half the size of the one before.
    pub halved: Vec<Self>,
}

impl Texture {
    pub(super) fn black(size: [usize; 2]) -> Self {
        Self {
            size,
            pixels: vec![[0, 0, 0, 255]; size[0] * size[1]],
            halved: Vec::new(),
        }
    }

    pub(super) fn of_one_colour([r, g, b]: [u8; 3]) -> Self {
        Self {
            size: [1, 1],
            pixels: vec![[r, g, b, 255]],
            halved: Vec::new(),
        }
    }

    fn half(&self) -> Self {
        let [width, height] = self.size.map(|n| n / 2);
        let mut half = Self::black([width, height]);
        let rows = half.pixels.par_chunks_mut(width).enumerate();
        rows.for_each(|(row, pixels)| {
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let mut sum = [0_u16; 4];
                for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let of = self.pixels[(2 * row + y) * self.size[0] + 2 * column + x];
                    sum = [0, 1, 2, 3].map(|c| sum[c] + u16::from(of[c]));
                }
                *pixel = sum.map(|c| (c / 4) as u8);
            }
        });
        half
    }
}

/// Where a face is in the texture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// Which face.
    pub(super) face: usize,
    /// Edge of its texels.
    pub(super) texel_m: f64,
    /// Upper left corner, without the rim.
    corner: [usize; 2],
    size: [usize; 2],
    /// Shares of the face's edges that it covers.
    low: [f64; 2],
    high: [f64; 2],
}

impl Patch {
    fn new(face: &Face, index: usize, texel_m: f64) -> Self {
        let low = [face.top[0].min(0.0), 0.0];
        let high = [face.top[1].max(1.0), 1.0];
        let edges = [face.edge_u.raw.norm(), face.edge_v.raw.norm()];
        let is_field = edges.iter().all(|edge| *edge > FIELD_M);
        let longest = if is_field { LONGEST / 16 } else { LONGEST };
        let texel_m = [0, 1].into_iter().fold(texel_m, |texel_m, i| {
            texel_m.max(edges[i] * (high[i] - low[i]) / longest as f64)
        });
        let size = [0, 1].map(|i| {
            let texels = (edges[i] * (high[i] - low[i]) / texel_m).ceil() as usize;
            texels.clamp(1, longest).next_multiple_of(4)
        });
        Self {
            face: index,
            texel_m,
            corner: [0; 2],
            size,
            low,
            high,
        }
    }

    /// With its rim.
    fn room(&self) -> [usize; 2] {
        self.size.map(|n| n + 2 * RIM)
    }

    /// The texture's place for a place on the face, given as shares of its edges.
    pub(super) fn uv(&self, share: [f64; 2]) -> [f32; 2] {
        [0, 1].map(|i| {
            let along = (share[i] - self.low[i]) / (self.high[i] - self.low[i]);
            ((self.corner[i] as f64 + along * self.size[i] as f64) / SIZE[i] as f64) as f32
        })
    }

    /// Shares of the face's edges in the middle of a texel; the rim repeats what it surrounds.
    fn share(&self, texel: [usize; 2]) -> [f64; 2] {
        [0, 1].map(|i| {
            let inside = texel[i].saturating_sub(RIM).min(self.size[i] - 1);
            let along = (inside as f64 + 0.5) / self.size[i] as f64;
            self.low[i] + along * (self.high[i] - self.low[i])
        })
    }
}

/// Finds room for the wanted faces; the second is the edge of a texel. Faces for which there is none, even with the largest
/// texels, are left out.
pub(super) fn lay_out(
    faces: &[Face],
    is_wanted: impl Fn(usize) -> bool + Copy,
) -> (Vec<Patch>, f64) {
    let mut best = (Vec::new(), TEXELS_M[0]);
    for texel_m in TEXELS_M {
        let wanted = (0..faces.len()).filter(|i| is_wanted(*i));
        let mut patches: Vec<_> = wanted.map(|i| Patch::new(&faces[i], i, texel_m)).collect();
        let all = patches.len();
        // Highest first: shelves lose little room then.
        patches.sort_by_key(|patch| (std::cmp::Reverse(patch.size[1]), patch.face));
        let placed = place(&mut patches);
        patches.truncate(placed);
        best = (patches, texel_m);
        if placed == all {
            break;
        }
    }
    best
}

/// Puts patches on shelves, from the top; returns how many found room.
fn place(patches: &mut [Patch]) -> usize {
    // The white patch is in the corner.
    let ([mut left, mut top], mut shelf) = ([8, 0], 8);
    for (index, patch) in patches.iter_mut().enumerate() {
        let [width, height] = patch.room();
        if left + width > SIZE[0] {
            (left, top) = (0, top + shelf);
            shelf = 0;
        }
        shelf = shelf.max(height);
        if top + height > SIZE[1] {
            return index;
        }
        patch.corner = [left + RIM, top + RIM];
        left += width;
    }
    patches.len()
}

/// Paints all patches: `colours` for the shares of a face's edges.
pub(super) fn paint(
    patches: &[Patch],
    colours: impl Fn(&Patch, &[[f64; 2]; LANES]) -> Lanes<[u8; 3]> + Sync,
) -> Texture {
    let painted: Vec<Vec<[u8; 4]>> = patches
        .par_iter()
        .map(|patch| {
            let [width, height] = patch.room();
            let texels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
            let shares: Vec<[f64; 2]> = texels.map(|texel| patch.share(texel)).collect();
            let mut painted = Vec::with_capacity(shares.len() + LANES);
            for some in shares.chunks(LANES) {
                let mut full = [some[0]; LANES];
                full[..some.len()].copy_from_slice(some);
                painted.extend(colours(patch, &full).map(|[r, g, b]| [r, g, b, 255]));
            }
            painted.truncate(shares.len());
            painted
        })
        .collect();
    let mut texture = Texture::black(SIZE);
    for row in 0..8 {
        texture.pixels[row * SIZE[0]..][..8].fill([255; 4]);
    }
    for (patch, pixels) in patches.iter().zip(&painted) {
        let [left, top] = patch.corner.map(|n| n - RIM);
        for (row, pixels) in pixels.chunks(patch.room()[0]).enumerate() {
            let start = (top + row) * SIZE[0] + left;
            texture.pixels[start..start + pixels.len()].copy_from_slice(pixels);
        }
    }
    let mut last = texture.clone();
    for _ in 0..HALVINGS {
        last = last.half();
        texture.halved.push(last.clone());
    }
    texture
}
