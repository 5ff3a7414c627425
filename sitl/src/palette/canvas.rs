//! Pictures that are put together.

use std::io::Write;

/// A picture of three bytes a pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

impl Canvas {
    /// A picture of these pixels, row by row; missing ones are black.
    pub fn new(width: usize, height: usize, mut pixels: Vec<[u8; 3]>) -> Self {
        pixels.resize(width * height, [0; 3]);
        Self {
            width,
            height,
            pixels,
        }
    }

    /// Its width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Its height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Its pixels, row by row.
    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// All of one colour.
    pub(crate) fn filled(width: usize, height: usize, colour: [u8; 3]) -> Self {
        Self::new(width, height, vec![colour; width * height])
    }

    /// Colours a pixel, if there is one.
    pub(crate) fn set(&mut self, column: usize, row: usize, colour: [u8; 3]) {
        if column < self.width && row < self.height {
            self.pixels[row * self.width + column] = colour;
        }
    }

    /// Scaled, each pixel the mean of what it covers.
    pub(crate) fn scaled(&self, width: usize, height: usize) -> Self {
        let range = |at: usize, to: usize, from: usize| {
            let first = at * from / to;
            first..((at + 1) * from).div_ceil(to).max(first + 1).min(from)
        };
        let mut pixels = Vec::with_capacity(width * height);
        for row in 0..height {
            let rows = range(row, height, self.height);
            for column in 0..width {
                let columns = range(column, width, self.width);
                let covered = rows
                    .clone()
                    .flat_map(|row| columns.clone().map(move |column| row * self.width + column));
                let mut sum = [0_u32; 3];
                let mut count = 0;
                for index in covered {
                    sum = [0, 1, 2].map(|c| sum[c] + u32::from(self.pixels[index][c]));
                    count += 1;
                }
                pixels.push(sum.map(|c| (c / count.max(1)) as u8));
            }
        }
        Self {
            width,
            height,
            pixels,
        }
    }

    /// Beside one another, from left to right.
    pub fn side_by_side(panels: &[Self], gap: usize, background: [u8; 3]) -> Self {
        let width = panels.iter().map(|panel| panel.width + gap).sum::<usize>();
        let height = panels.iter().map(|panel| panel.height).max().unwrap_or(0);
        let mut canvas = Self::filled(width.saturating_sub(gap), height, background);
        let mut left = 0;
        for panel in panels {
            canvas.paste(panel, [left, 0]);
            left += panel.width + gap;
        }
        canvas
    }

    /// Below one another, from the top.
    pub fn stacked(panels: &[Self], gap: usize, background: [u8; 3]) -> Self {
        let height = panels.iter().map(|panel| panel.height + gap).sum::<usize>();
        let width = panels.iter().map(|panel| panel.width).max().unwrap_or(0);
        let mut canvas = Self::filled(width, height.saturating_sub(gap), background);
        let mut top = 0;
        for panel in panels {
            canvas.paste(panel, [0, top]);
            top += panel.height + gap;
        }
        canvas
    }

    fn paste(&mut self, panel: &Self, [left, top]: [usize; 2]) {
        for (row, pixels) in panel.pixels.chunks(panel.width.max(1)).enumerate() {
            for (column, pixel) in pixels.iter().enumerate() {
                self.set(left + column, top + row, *pixel);
            }
        }
    }

    /// Writes it as PNG.
    pub fn write_png(&self, to: impl Write) -> Result<(), png::EncodingError> {
        let size = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let mut encoder = png::Encoder::new(to, size(self.width), size(self.height));
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())
    }
}
