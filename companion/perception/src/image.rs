//! A colour image to look at.

/// A colour image, borrowed.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) rgb: &'a [[u8; 3]],
}

/// The pixels are not as many as the size says, or there are none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("an image of {width} x {height} pixels cannot have {found}")]
pub struct WrongLength {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Pixels that are there.
    pub found: usize,
}

impl<'a> Image<'a> {
    /// An image of red, green and blue pixels, row by row.
    pub fn new(width: usize, height: usize, rgb: &'a [[u8; 3]]) -> Result<Self, WrongLength> {
        let found = rgb.len();
        if found == 0 || width.checked_mul(height) != Some(found) {
            return Err(WrongLength {
                width,
                height,
                found,
            });
        }
        Ok(Self { width, height, rgb })
    }

    /// Red, green and blue of its pixels, row by row.
    pub fn rgb(&self) -> &'a [[u8; 3]] {
        self.rgb
    }

    /// Red, green and blue between pixels, bilinear; outside of the image its rim.
    pub(crate) fn at(&self, x: f32, y: f32) -> [f32; 3] {
        let place = |v: f32, count: usize| {
            let v = v.clamp(0.0, (count - 1) as f32);
            let low = v as usize;
            (low, (low + 1).min(count - 1), v - low as f32)
        };
        let (left, right, across) = place(x, self.width);
        let (top, bottom, down) = place(y, self.height);
        let pixel =
            |x: usize, y: usize, channel: usize| f32::from(self.rgb[y * self.width + x][channel]);
        std::array::from_fn(|c| {
            let upper = pixel(left, top, c) * (1.0 - across) + pixel(right, top, c) * across;
            let lower = pixel(left, bottom, c) * (1.0 - across) + pixel(right, bottom, c) * across;
            upper * (1.0 - down) + lower * down
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_needs_as_many_pixels_as_its_size_says() {
        let pixels = [[0; 3]; 6];
        assert!(Image::new(3, 2, &pixels).is_ok());
        for (width, height, count) in [(3, 3, 6), (0, 0, 0), (usize::MAX, 2, 6)] {
            let refused = Image::new(width, height, &pixels[..count]).map(|_| ());
            assert_eq!(
                refused,
                Err(WrongLength {
                    width,
                    height,
                    found: count
                })
            );
        }
    }

    #[test]
    fn colour_between_pixels_is_bilinear_and_beyond_the_rim_it_stays() {
        let pixels = [[0; 3], [100; 3], [50; 3], [150; 3]];
        let image = Image::new(2, 2, &pixels).expect("four pixels");
        assert_eq!(image.at(0.5, 0.5).to_vec(), vec![75.0; 3]);
        assert_eq!(image.at(-3.0, 9.0).to_vec(), vec![50.0; 3]);
    }
}
