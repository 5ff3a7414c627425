//! Paper: rectangles and letters on pixels.

use super::{Picture, font};

/// The paper.
pub(super) const PAPER: [u8; 3] = [252, 252, 250];
/// Letters and scales.
pub(super) const INK: [u8; 3] = [32, 36, 42];
/// Frames.
pub(super) const FRAME: [u8; 3] = [208, 212, 216];
/// Pixels a dot of a letter is wide.
const DOT: usize = 2;
/// Pixels that a line of letters is high, tails included.
pub(super) const LINE: usize = font::ROWS * DOT;

/// A part of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Area {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Area {
    pub(super) const fn new(left: usize, top: usize, width: usize, height: usize) -> Self {
        Self {
            left,
            top,
            width,
            height,
        }
    }
}

/// How wide a text is.
pub(super) fn width_of(text: &str) -> usize {
    text.chars().count() * font::ADVANCE * DOT
}

impl Picture {
    pub(super) fn paper(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            rgb: PAPER.repeat(width * height),
        }
    }

    /// Colours a pixel, if it is on the paper.
    pub(super) fn put(&mut self, x: usize, y: usize, color: [u8; 3]) {
        if x < self.width && y < self.height {
            let at = 3 * (y * self.width + x);
            self.rgb[at..at + 3].copy_from_slice(&color);
        }
    }

    pub(super) fn fill(&mut self, area: Area, color: [u8; 3]) {
        for y in area.top..area.top + area.height {
            for x in area.left..area.left + area.width {
                self.put(x, y, color);
            }
        }
    }

    /// A line of one pixel just within an area.
    pub(super) fn frame(&mut self, area: Area, color: [u8; 3]) {
        let Area {
            left,
            top,
            width,
            height,
        } = area;
        self.fill(Area::new(left, top, width, 1), color);
        self.fill(Area::new(left, top + height - 1, width, 1), color);
        self.fill(Area::new(left, top, 1, height), color);
        self.fill(Area::new(left + width - 1, top, 1, height), color);
    }

    /// A line of text whose upper left corner is here.
    pub(super) fn text(&mut self, left: usize, top: usize, text: &str) {
        for (place, letter) in text.chars().enumerate() {
            let left = left + place * font::ADVANCE * DOT;
            for (row, column) in
                (0..font::ROWS).flat_map(|row| (0..font::ADVANCE).map(move |c| (row, c)))
            {
                if font::has_dot(letter, column, row) {
                    let dot = Area::new(left + column * DOT, top + row * DOT, DOT, DOT);
                    self.fill(dot, INK);
                }
            }
        }
    }
}
