//! Which pixels a convex polygon covers, row by row.

use std::ops::Range;

/// Rows that are drawn together.
pub(super) const BAND: usize = 8;

/// The corners of a face, one of which may have become two at the near plane.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Polygon<T> {
    corners: [T; 5],
    count: usize,
}

impl<T: Copy + Default> Polygon<T> {
    /// Adds a corner. A plane cuts a face with four of them at most twice.
    pub(super) fn push(&mut self, corner: T) {
        if let Some(place) = self.corners.get_mut(self.count) {
            *place = corner;
            self.count += 1;
        }
    }

    pub(super) fn len(&self) -> usize {
        self.count
    }

    pub(super) fn map<U: Copy + Default>(&self, to: impl Fn(T) -> U) -> Polygon<U> {
        Polygon {
            corners: self.corners.map(to),
            count: self.count,
        }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = T> {
        self.corners.into_iter().take(self.count)
    }
}

/// A convex polygon in pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outline {
    corners: Polygon<[f64; 2]>,
    columns: [f64; 2],
    rows: [f64; 2],
}

impl Outline {
    pub(super) fn of(corners: Polygon<[f64; 2]>) -> Self {
        let extent = |axis: usize| {
            let none = [f64::INFINITY, f64::NEG_INFINITY];
            let values = corners.iter().map(|corner| corner[axis]);
            values.fold(none, |[low, high], v| [v.min(low), v.max(high)])
        };
        Self {
            corners,
            columns: extent(0),
            rows: extent(1),
        }
    }

    /// Whether any of it may lie within a picture.
    pub(super) fn is_within(&self, width: usize, height: usize) -> bool {
        self.columns[1] >= 0.0
            && self.rows[1] >= 0.0
            && self.columns[0] <= width as f64
            && self.rows[0] <= height as f64
    }

    /// The bands of a picture of this height that it touches.
    fn bands(&self, height: usize) -> Range<usize> {
        let band = |row: f64| row.clamp(0.0, height as f64) as usize / BAND;
        band(self.rows[0])..(band(self.rows[1]) + 1).min(height.div_ceil(BAND))
    }

    /// Whether it may have pixels in a row.
    pub(super) fn is_in_row(&self, row: usize) -> bool {
        (self.rows[0]..=self.rows[1]).contains(&(row as f64))
    }

    /// The rows of a picture of this height that it touches.
    pub(super) fn rows_within(&self, height: usize) -> Range<usize> {
        let row = |row: f64| row.clamp(0.0, height as f64) as usize;
        row(self.rows[0])..(row(self.rows[1]) + 1).min(height)
    }

    /// The pixels of a row whose centres lie within the outline.
    pub(super) fn span(&self, row: f64, width: usize) -> Option<Range<usize>> {
        if row < self.rows[0] || row > self.rows[1] {
            return None;
        }
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        let corners = &self.corners.corners[..self.corners.count];
        for (i, &[x0, y0]) in corners.iter().enumerate() {
            let [x1, y1] = corners[(i + 1) % corners.len()];
            // Half open, so that an edge shared by two faces is counted once and no row falls between them.
            if (y0 <= row) != (y1 <= row) {
                // From the upper end, so that both faces round alike.
                let (top, low) = if y0 < y1 {
                    ([x0, y0], [x1, y1])
                } else {
                    ([x1, y1], [x0, y0])
                };
                let x = top[0] + (row - top[1]) * (low[0] - top[0]) / (low[1] - top[1]);
                left = left.min(x);
                right = right.max(x);
            }
        }
        let from = left.ceil().max(0.0);
        let to = right.ceil().min(width as f64);
        (from < to).then_some(from as usize..to as usize)
    }
}

/// For each band of rows, which of the outlines touch it, in their order.
pub(super) fn bands(outlines: &[&Outline], height: usize) -> Vec<Vec<u32>> {
    let mut bands = vec![Vec::new(); height.div_ceil(BAND)];
    for (index, outline) in (0..).zip(outlines) {
        for band in &mut bands[outline.bands(height)] {
            band.push(index);
        }
    }
    bands
}

/// How many pixels of a picture outlines cover together.
pub(super) fn area(outlines: &[Outline], width: usize, height: usize) -> u32 {
    let first = outlines
        .iter()
        .map(|outline| outline.rows[0])
        .fold(f64::INFINITY, f64::min);
    let last = outlines
        .iter()
        .map(|outline| outline.rows[1])
        .fold(f64::NEG_INFINITY, f64::max);
    let rows = first.max(0.0) as usize..(last.max(0.0) as usize + 1).min(height);
    let mut spans = Vec::new();
    let mut area = 0;
    for row in rows {
        spans.clear();
        let of_row = outlines
            .iter()
            .filter_map(|outline| outline.span(row as f64, width));
        spans.extend(of_row.map(|span| [span.start, span.end]));
        spans.sort_unstable();
        let mut until = 0;
        for [from, to] in &spans {
            area += to.saturating_sub(until.max(*from));
            until = until.max(*to);
        }
    }
    u32::try_from(area).unwrap_or(u32::MAX)
}
