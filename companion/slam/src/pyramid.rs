//! Grey images and the scale pyramid on which features are found.

/// Ratio of the sizes of neighbouring pyramid levels.
pub(crate) const SCALE: f64 = 1.2;

/// Weights, of 256, with which two neighbours of six make one of five: 0.1, 1.3, 2.5, 3.7, 4.9 are where they come from.
const TAPS: [[u16; 2]; 5] = [[230, 26], [179, 77], [128, 128], [77, 179], [26, 230]];

/// An 8-bit grey image, row by row.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gray {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pixels: Vec<u8>,
}

impl Gray {
    /// Luma by the BT.601 weights, in 8-bit fixed point.
    pub(crate) fn from_rgb(width: usize, height: usize, rgb: &[[u8; 3]]) -> Self {
        let luma = |&[r, g, b]: &[u8; 3]| {
            let sum = 77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b);
            (sum >> 8) as u8
        };
        Self {
            width,
            height,
            pixels: rgb.iter().map(luma).collect(),
        }
    }

    pub(crate) fn row(&self, y: usize) -> &[u8] {
        &self.pixels[y * self.width..(y + 1) * self.width]
    }

    /// Five sixths of the size, bilinear. Six pixels become five, always with the same weights: rows are blended in a loop
    /// that vectorises, columns in one without tables. The last pixels stand for those beyond the rim.
    fn shrunk(&self) -> Self {
        let (width, height) = (self.width * 5 / 6, self.height * 5 / 6);
        let mut pixels = Vec::with_capacity(width * height);
        let sixes = self.width.div_ceil(6);
        let mut blended = vec![0u16; 6 * sixes];
        let mut wide = vec![0u8; 5 * sixes];
        for y in 0..height {
            let (top, [w0, w1]) = (y / 5 * 6 + y % 5, TAPS[y % 5]);
            let (above, below) = (self.row(top), self.row((top + 1).min(self.height - 1)));
            for ((out, &a), &b) in blended.iter_mut().zip(above).zip(below) {
                *out = u16::from(a) * w0 + u16::from(b) * w1;
            }
            let rim = blended[self.width - 1];
            blended[self.width..].fill(rim);
            for (five, six) in wide.chunks_exact_mut(5).zip(blended.chunks_exact(6)) {
                for (i, pixel) in five.iter_mut().enumerate() {
                    let [w0, w1] = TAPS[i].map(u32::from);
                    *pixel = ((u32::from(six[i]) * w0 + u32::from(six[i + 1]) * w1) >> 16) as u8;
                }
            }
            pixels.extend_from_slice(&wide[..width]);
        }
        Self {
            width,
            height,
            pixels,
        }
    }

    /// Smoothed by the 5 x 5 binomial kernel, borders copied.
    pub(crate) fn blurred(&self) -> Self {
        let mut out = self.clone();
        if self.width < 5 || self.height < 5 {
            return out;
        }
        let mut column = vec![0u16; self.width];
        for y in 2..self.height - 2 {
            let rows = [-2, -1, 0, 1, 2].map(|d: isize| self.row(y.saturating_add_signed(d)));
            let taps = rows[0]
                .iter()
                .zip(rows[1])
                .zip(rows[2])
                .zip(rows[3])
                .zip(rows[4]);
            for (sum, ((((&a, &b), &c), &d), &e)) in column.iter_mut().zip(taps) {
                *sum = u16::from(a)
                    + 4 * (u16::from(b) + u16::from(d))
                    + 6 * u16::from(c)
                    + u16::from(e);
            }
            let row = &mut out.pixels[y * self.width + 2..(y + 1) * self.width - 2];
            let [_, second, third, fourth, fifth] = [0, 1, 2, 3, 4].map(|from| &column[from..]);
            let taps = column.iter().zip(second).zip(third).zip(fourth).zip(fifth);
            for (pixel, ((((&a, &b), &c), &d), &e)) in row.iter_mut().zip(taps) {
                // At most 16 * 16 * 255 = 65 280: the sum fits, and so does half of it more in the rounding below.
                let sum = a + 4 * (b + d) + 6 * c + e;
                *pixel = (sum.saturating_add(128) >> 8) as u8;
            }
        }
        out
    }
}

/// The same image at ever smaller scales.
pub(crate) struct Pyramid {
    pub(crate) levels: Vec<Gray>,
}

impl Pyramid {
    /// `levels` images, each [`SCALE`] times smaller than the one before; stops before one gets smaller than `smallest`.
    pub(crate) fn new(base: Gray, levels: usize, smallest: usize) -> Self {
        let mut pyramid = Self { levels: vec![base] };
        while let Some(last) = pyramid.levels.last()
            && pyramid.levels.len() < levels
        {
            let next = last.shrunk();
            if next.width.min(next.height) < smallest {
                break;
            }
            pyramid.levels.push(next);
        }
        pyramid
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_at_every_scale() {
        let (width, height) = (128, 96);
        let pixels = (0..width * height).map(|i| (i % width) as u8).collect();
        let base = Gray {
            width,
            height,
            pixels,
        };
        let pyramid = Pyramid::new(base, 4, 16);
        assert_eq!(pyramid.levels.len(), 4);
        for (octave, level) in (0..).zip(&pyramid.levels) {
            let ratio = SCALE.powi(octave);
            let middle = level.row(level.height / 2);
            for (x, &value) in middle.iter().enumerate().skip(2).take(level.width - 4) {
                let expected = (x as f64 + 0.5) * ratio - 0.5;
                assert!(
                    (f64::from(value) - expected).abs() < 5.0,
                    "x {x}: {value} for {expected}"
                );
            }
        }
    }

    #[test]
    fn blurring_keeps_a_flat_image_flat_and_small_images_whole() {
        for (width, height) in [(9, 7), (3, 3), (1, 1)] {
            let flat = Gray {
                width,
                height,
                pixels: vec![255; width * height],
            };
            assert!(flat.blurred().pixels.iter().all(|&p| p == 255));
        }
    }
}
