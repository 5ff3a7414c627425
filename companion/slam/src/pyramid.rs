//! Grey images and the scale pyramid on which features are found.

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

    /// Bilinear resize: the two source rows are blended first, in a loop that vectorises, then the columns are gathered.
    fn resized(&self, width: usize, height: usize) -> Self {
        let columns: Vec<(usize, u32)> = (0..width).map(|x| tap(x, width, self.width)).collect();
        let mut pixels = Vec::with_capacity(width * height);
        let mut blended = vec![0u16; self.width];
        for y in 0..height {
            let (top, weight) = tap(y, height, self.height);
            let (above, below) = (self.row(top), self.row(top + 1));
            let (w1, w0) = (weight as u16, 256 - weight as u16);
            for ((out, &a), &b) in blended.iter_mut().zip(above).zip(below) {
                *out = u16::from(a) * w0 + u16::from(b) * w1;
            }
            pixels.extend(columns.iter().map(|&(left, weight)| {
                let (a, b) = (u32::from(blended[left]), u32::from(blended[left + 1]));
                ((a * (256 - weight) + b * weight) >> 16) as u8
            }));
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
            for (pixel, s) in row.iter_mut().zip(column.windows(5)) {
                // At most 16 * 16 * 255 = 65 280: the sum fits, and so does half of it more in the rounding below.
                let sum = s[0] + 4 * (s[1] + s[3]) + 6 * s[2] + s[4];
                *pixel = (sum.saturating_add(128) >> 8) as u8;
            }
        }
        out
    }
}

/// The left one of the two source samples for output sample `i`, and the weight of the right one out of 256.
fn tap(i: usize, out: usize, source: usize) -> (usize, u32) {
    let at =
        ((i as f64 + 0.5) * source as f64 / out as f64 - 0.5).clamp(0.0, source as f64 - 1.001);
    let left = at.floor();
    (left as usize, ((at - left) * 256.0) as u32)
}

/// The same image at ever smaller scales.
pub(crate) struct Pyramid {
    pub(crate) levels: Vec<Gray>,
}

impl Pyramid {
    /// `levels` images, each smaller than the one before by `scale`; stops before an image gets smaller than `smallest`.
    pub(crate) fn new(base: Gray, levels: usize, scale: f64, smallest: usize) -> Self {
        let mut pyramid = Self { levels: vec![base] };
        while let Some(last) = pyramid.levels.last()
            && pyramid.levels.len() < levels
        {
            let (width, height) = (
                (last.width as f64 / scale).round() as usize,
                (last.height as f64 / scale).round() as usize,
            );
            if width.min(height) < smallest {
                break;
            }
            pyramid.levels.push(last.resized(width, height));
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
        let pyramid = Pyramid::new(base, 4, 1.2, 16);
        assert_eq!(pyramid.levels.len(), 4);
        for level in &pyramid.levels {
            let ratio = width as f64 / level.width as f64;
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
