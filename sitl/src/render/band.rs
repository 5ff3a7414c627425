//! A few rows of a picture: which face each pixel shows, then the colours of each face's pixels together.

use super::seen::Seen;
use super::shade::{Batch, View};
use crate::lanes::{LANES, lanes, vectorised};
use crate::scene::Instance;

/// Rows of a picture that is being drawn.
pub(super) struct Rows<'a> {
    /// Index of the first.
    pub(super) top: usize,
    pub(super) ink: Ink<'a>,
    pub(super) depth_m: &'a mut [f32],
    pub(super) facing: &'a mut [f32],
    pub(super) instance: &'a mut [Instance],
}

impl<'a> Rows<'a> {
    /// Each row alone, if light is kept.
    pub(super) fn single(self, width: usize) -> impl Iterator<Item = Rows<'a>> {
        let light = match self.ink {
            Ink::Light(light) => light,
            Ink::Developed(_) => &mut [],
        };
        let truth = self.depth_m.chunks_mut(width);
        let truth = truth.zip(self.facing.chunks_mut(width));
        let truth = truth.zip(self.instance.chunks_mut(width));
        let rows = (self.top..).zip(light.chunks_mut(width).zip(truth));
        rows.map(|(top, (light, ((depth_m, facing), instance)))| Rows {
            top,
            ink: Ink::Light(light),
            depth_m,
            facing,
            instance,
        })
    }
}

/// What of the light is kept.
pub(super) enum Ink<'a> {
    /// The colours that a camera makes of it.
    Developed(&'a mut [[u8; 3]]),
    /// The light itself, before any exposure.
    Light(&'a mut [[f32; 3]]),
}

/// What drawing a band needs for itself; kept from band to band.
#[derive(Default)]
pub(super) struct Scratch {
    /// Of the nearest face so far, for each pixel.
    inverse: Vec<f64>,
    /// Which that is: its place in the band's list, counted from 1; 0 for none.
    which: Vec<u32>,
    /// Where the pixels of each face begin in `pixels`.
    begins: Vec<u32>,
    /// Row and column of each pixel, face by face.
    pixels: Vec<[u32; 2]>,
    /// Where the next pixel of each face goes.
    next: Vec<u32>,
}

/// Draws rows in which these faces are seen.
pub(super) fn draw(
    view: &View<'_>,
    rows: &mut Rows<'_>,
    scratch: &mut Scratch,
    seen: &[Seen<'_>],
    faces: &[u32],
) {
    let width = view.camera.width;
    scratch.find(rows.top, [width, rows.depth_m.len()], seen, faces);
    scratch.sort(width, faces.len());
    for face in 0..=faces.len() {
        let [from, to] = [face, face + 1].map(|i| scratch.begins[i] as usize);
        let seen = face.checked_sub(1).map(|face| &seen[faces[face] as usize]);
        for pixels in scratch.pixels[from..to].chunks(LANES) {
            // Lanes without a pixel repeat the last one.
            let pixel = lanes!(k => pixels[k.min(pixels.len() - 1)]);
            let index = pixel.map(|[row, column]| row as usize * width + column as usize);
            let batch = Batch {
                x: lanes!(k => view.columns[pixel[k][1] as usize]),
                y: lanes!(k => view.rows[rows.top + pixel[k][0] as usize]),
                inverse: lanes!(k => scratch.inverse[index[k]]),
            };
            let index = &index[..pixels.len()];
            match seen {
                Some(seen) => {
                    let shaded = view.surface(&batch, seen);
                    for (k, &at) in index.iter().enumerate() {
                        rows.depth_m[at] = shaded.depth_m[k];
                        rows.facing[at] = shaded.facing[k];
                        rows.instance[at] = seen.face.instance;
                    }
                    rows.ink.put(view, &shaded.light, index);
                }
                None => rows.ink.put(view, &view.sky(&batch), index),
            }
        }
    }
}

impl Ink<'_> {
    fn put(&mut self, view: &View<'_>, light: &crate::scene::Colours, index: &[usize]) {
        match self {
            Self::Developed(rgb) => {
                let colours = view.developed(light);
                for (k, &at) in index.iter().enumerate() {
                    rgb[at] = [colours[0][k], colours[1][k], colours[2][k]];
                }
            }
            Self::Light(kept) => {
                for (k, &at) in index.iter().enumerate() {
                    kept[at] = [light[0][k], light[1][k], light[2][k]];
                }
            }
        }
    }
}

impl Scratch {
    /// Finds the nearest face of each pixel.
    fn find(&mut self, top: usize, [width, count]: [usize; 2], seen: &[Seen<'_>], faces: &[u32]) {
        self.inverse.clear();
        self.inverse.resize(count, 0.0);
        self.which.clear();
        self.which.resize(count, 0);
        for (which, seen) in (1..).zip(faces.iter().map(|face| &seen[*face as usize])) {
            let rows = self
                .inverse
                .chunks_mut(width)
                .zip(self.which.chunks_mut(width));
            for (row, (inverse, shown)) in (top..).zip(rows) {
                if let Some(columns) = seen.outline.span(row as f64, width) {
                    let [a, b, c] = seen.inverse;
                    let from = columns.start;
                    let (inverse, shown) = (&mut inverse[columns.clone()], &mut shown[columns]);
                    fill(inverse, shown, [a, b * row as f64 + c], from, which);
                }
            }
        }
    }

    /// Puts the pixels of each face together, in their order.
    fn sort(&mut self, width: usize, faces: usize) {
        self.begins.clear();
        self.begins.resize(faces + 2, 0);
        for &which in &self.which {
            self.begins[which as usize + 1] += 1;
        }
        for face in 0..=faces {
            self.begins[face + 1] += self.begins[face];
        }
        self.pixels.clear();
        self.pixels.resize(self.which.len(), [0; 2]);
        self.next.clone_from(&self.begins);
        for (row, which) in (0..).zip(self.which.chunks(width)) {
            for (column, &which) in (0..).zip(which) {
                let place = &mut self.next[which as usize];
                self.pixels[*place as usize] = [row, column];
                *place += 1;
            }
        }
    }
}

vectorised! {
/// Draws a span from column `from` on of a face whose inverse depth is a `line`, `a · column + at_row`, where it is the nearest.
fn fill(inverse: &mut [f64], which: &mut [u32], line: [f64; 2], from: usize, face: u32) {
    let [a, at_row] = line;
    // An integer that fits 32 bits, which vector instructions convert.
    let from = (from as u32).cast_signed();
    for (i, (inverse, which)) in (0_i32..).zip(inverse.iter_mut().zip(which)) {
        let here = a * f64::from(from.wrapping_add(i)) + at_row;
        let is_nearer = here > *inverse;
        *inverse = if is_nearer { here } else { *inverse };
        *which = if is_nearer { face } else { *which };
    }
}
}
