//! FAST corners: a pixel is one if 9 neighbours in a row on a circle of 16 are all brighter or all darker than it.
//!
//! The image is cut into cells. Where a cell has no corner at the strict threshold it is searched again at the lenient
//! one, so that dim and flat parts of the room also give points.
//!
//! - E. Rosten, T. Drummond, *Machine learning for high-speed corner detection*, ECCV 2006.

use crate::pyramid::Gray;

/// A corner, at a pixel of its pyramid level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Corner {
    pub(crate) x: usize,
    pub(crate) y: usize,
    /// The highest threshold at which it is still a corner.
    pub(crate) score: u8,
}

/// Strict and lenient threshold in grey levels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Thresholds {
    pub(crate) strict: u8,
    pub(crate) lenient: u8,
}

const CELL: usize = 32;
/// Pixels that are looked at together.
const LANES: usize = 16;
const CIRCLE: [(isize, isize); 16] = [
    (0, -3),
    (1, -3),
    (2, -2),
    (3, -1),
    (3, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 3),
    (-1, 3),
    (-2, 2),
    (-3, 1),
    (-3, 0),
    (-3, -1),
    (-2, -2),
    (-1, -3),
];

/// Finds corners at least `margin` (3 or more) pixels from the border, strongest of each 3 x 3 only, row by row.
pub(crate) fn corners(image: &Gray, margin: usize, thresholds: Thresholds) -> Vec<Corner> {
    let margin = margin.max(3);
    if image.width <= 2 * margin || image.height <= 2 * margin {
        return Vec::new();
    }
    let mut search = Search::new(image);
    let (right, bottom) = (image.width - margin, image.height - margin);
    let cells_across = (right - margin).div_ceil(CELL);
    let mut hits = vec![0u32; cells_across * (bottom - margin).div_ceil(CELL)];
    for y in margin..bottom {
        for x in search.row(y, margin..right, thresholds.strict) {
            hits[(y - margin) / CELL * cells_across + (x - margin) / CELL] += 1;
        }
    }
    for (cell, _) in hits.iter().enumerate().filter(|&(_, &count)| count == 0) {
        let left = margin + cell % cells_across * CELL;
        let top = margin + cell / cells_across * CELL;
        for y in top..(top + CELL).min(bottom) {
            search.row(y, left..(left + CELL).min(right), thresholds.lenient);
        }
    }
    search.strongest()
}

struct Search<'a> {
    image: &'a Gray,
    offsets: [isize; 16],
    scores: Vec<u8>,
    found: Vec<usize>,
    candidates: Vec<u8>,
}

impl<'a> Search<'a> {
    fn new(image: &'a Gray) -> Self {
        let stride = isize::try_from(image.width).unwrap_or(isize::MAX);
        Self {
            image,
            offsets: CIRCLE.map(|(dx, dy)| dy * stride + dx),
            scores: vec![0; image.pixels.len()],
            found: Vec::new(),
            candidates: Vec::new(),
        }
    }

    /// Records the corners of part of a row; returns their columns.
    fn row(&mut self, y: usize, columns: std::ops::Range<usize>, threshold: u8) -> Vec<usize> {
        self.mark_candidates(y, columns.clone(), threshold);
        let mut found = Vec::new();
        for (i, chunk) in self.candidates.chunks(LANES).enumerate() {
            if chunk.iter().fold(0, |any, &c| any | c) == 0 {
                continue;
            }
            let at = y * self.image.width + columns.start + LANES * i;
            let corner = self.arcs(at, threshold);
            for (j, _) in corner[..chunk.len()]
                .iter()
                .enumerate()
                .filter(|&(_, &c)| c != 0)
            {
                self.scores[at + j] = self.score(at + j);
                self.found.push(at + j);
                found.push(columns.start + LANES * i + j);
            }
        }
        found
    }

    /// Which of the pixels from `at` on are corners. Loops over neighbouring pixels vectorise: 16 of them take hardly
    /// longer than one. Near the end of the image the last ones are not looked at; the margin keeps them out anyway.
    fn arcs(&self, at: usize, threshold: u8) -> [u8; LANES] {
        let lanes = |offset: isize| -> [u8; LANES] {
            let from = at.saturating_add_signed(offset);
            let part = self.image.pixels.get(from..from + LANES);
            part.and_then(|p| p.try_into().ok())
                .unwrap_or_else(|| self.ragged(from))
        };
        let center = lanes(0);
        let above = center.map(|c| c.saturating_add(threshold));
        let below = center.map(|c| c.saturating_sub(threshold));
        let ring = self.offsets.map(lanes);
        let longest_bright = longest_run(|k, i| ring[k][i] > above[i]);
        let longest_dark = longest_run(|k, i| ring[k][i] < below[i]);
        std::array::from_fn(|i| u8::from(longest_bright[i].max(longest_dark[i]) >= 9))
    }

    /// The pixels from here to the end of the image, and black ones after it.
    fn ragged(&self, from: usize) -> [u8; LANES] {
        std::array::from_fn(|i| self.image.pixels.get(from + i).copied().unwrap_or(0))
    }

    /// Nine in a row cover at least one end of each diameter, all on the same side of the threshold: two diameters are
    /// looked at. A loop over whole rows, which vectorises.
    fn mark_candidates(&mut self, y: usize, columns: std::ops::Range<usize>, threshold: u8) {
        let part = |dx: isize, dy: isize| {
            let row = self.image.row(y.saturating_add_signed(dy));
            &row[columns.start.saturating_add_signed(dx)..columns.end.saturating_add_signed(dx)]
        };
        let (center, up, down) = (part(0, 0), part(0, -3), part(0, 3));
        let (left, right) = (part(-3, 0), part(3, 0));
        self.candidates.clear();
        self.candidates.resize(columns.len(), 0);
        let ends = center.iter().zip(up).zip(down).zip(left).zip(right);
        for (mark, ((((&c, &u), &d), &l), &r)) in self.candidates.iter_mut().zip(ends) {
            let brightest = u.max(d).min(l.max(r));
            let darkest = u.min(d).max(l.min(r));
            let is_bright = brightest > c.saturating_add(threshold);
            let is_dark = darkest < c.saturating_sub(threshold);
            *mark = u8::from(is_bright) | u8::from(is_dark);
        }
    }

    /// The highest threshold at which a corner still is one.
    fn score(&self, at: usize) -> u8 {
        let center = i16::from(self.image.pixels[at]);
        let mut difference = [0i16; 16];
        for (d, &o) in difference.iter_mut().zip(&self.offsets) {
            *d = i16::from(self.image.pixels[at.saturating_add_signed(o)]) - center;
        }
        let bright = weakest_of_best_arc(&difference);
        let dark = weakest_of_best_arc(&difference.map(|d| -d));
        bright.max(dark).clamp(1, 255) as u8
    }

    /// Those that beat their eight neighbours; of equals, the first.
    fn strongest(mut self) -> Vec<Corner> {
        self.found.sort_unstable();
        let (width, scores) = (self.image.width, &self.scores);
        let is_peak = |at: usize| {
            let score = scores[at];
            let before = [at - width - 1, at - width, at - width + 1, at - 1];
            let after = [at + 1, at + width - 1, at + width, at + width + 1];
            before.iter().all(|&n| scores[n] < score) && after.iter().all(|&n| scores[n] <= score)
        };
        self.found
            .iter()
            .filter(|&&at| is_peak(at))
            .map(|&at| Corner {
                x: at % width,
                y: at / width,
                score: scores[at],
            })
            .collect()
    }
}

/// Of each lane, the most neighbours in a row, around the circle, for which `holds`.
fn longest_run(holds: impl Fn(usize, usize) -> bool) -> [u8; LANES] {
    let mut run = [0u8; LANES];
    let mut longest = [0u8; LANES];
    // A run that ends at the last neighbour but eight and goes on at the first is seen in the second round.
    for k in 0..24 {
        for i in 0..LANES {
            let counts = if holds(k % 16, i) { 0xff } else { 0 };
            run[i] = (run[i] + 1) & counts;
            longest[i] = longest[i].max(run[i]);
        }
    }
    longest
}

fn weakest_of_best_arc(difference: &[i16; 16]) -> i16 {
    let least = |of: &[i16; 16], step: usize| -> [i16; 16] {
        std::array::from_fn(|i| of[i].min(of[(i + step) % 16]))
    };
    let eight = least(&least(&least(difference, 1), 2), 4);
    (0..16)
        .map(|i| eight[i].min(difference[(i + 8) % 16]))
        .max()
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const THRESHOLDS: Thresholds = Thresholds {
        strict: 20,
        lenient: 7,
    };

    fn square(contrast: u8) -> Gray {
        let (width, height) = (64, 64);
        let inside = |i: usize| (20..40).contains(&(i % width)) && (20..40).contains(&(i / width));
        Gray {
            width,
            height,
            pixels: (0..width * height)
                .map(|i| if inside(i) { 100 + contrast } else { 100 })
                .collect(),
        }
    }

    #[track_caller]
    fn check_square(contrast: u8, expected: usize) {
        let found = corners(&square(contrast), 4, THRESHOLDS);
        let near = |c: &Corner| {
            let off = |v: usize| v.abs_diff(20).min(v.abs_diff(39));
            off(c.x) <= 2 && off(c.y) <= 2
        };
        assert!(found.iter().all(near), "contrast {contrast}: {found:?}");
        assert_eq!(found.len(), expected, "contrast {contrast}: {found:?}");
    }

    #[test]
    fn a_square_has_four_corners_and_a_dim_one_needs_the_lenient_threshold() {
        check_square(100, 4);
        check_square(12, 4);
        check_square(5, 0);
    }

    #[test]
    fn nine_in_a_row_wraps_around_the_circle_and_eight_are_not_enough() {
        let lengths = [0, 8, 9, 16];
        for (length, start) in lengths
            .into_iter()
            .flat_map(|l| (0..16).map(move |s| (l, s)))
        {
            let is_set = |k: usize| (k + 16 - start) % 16 < length;
            let longest = longest_run(|k, lane| lane == 3 && is_set(k));
            let expected = if length == 16 { 24 } else { length };
            assert_eq!(usize::from(longest[3]), expected, "{length} from {start}");
            assert_eq!(longest[4], 0, "lanes do not mix");
        }
    }

    /// By the definition, one pixel after the other.
    fn is_corner(image: &Gray, x: usize, y: usize, threshold: u8) -> bool {
        let center = i16::from(image.row(y)[x]);
        let ring = CIRCLE.map(|(dx, dy)| {
            i16::from(image.row(y.saturating_add_signed(dy))[x.saturating_add_signed(dx)]) - center
        });
        let arc = |sign: i16| {
            (0..16).any(|from| (0..9).all(|k| sign * ring[(from + k) % 16] > i16::from(threshold)))
        };
        arc(1) || arc(-1)
    }

    proptest! {
        #[test]
        fn a_row_has_the_corners_of_the_definition(
            pixels in proptest::collection::vec(prop_oneof![0..=60u8, 190..=255u8, any::<u8>()], 45 * 9),
            threshold in 1..120u8,
        ) {
            let image = Gray { width: 45, height: 9, pixels };
            for y in [3, 4, 5] {
                let found = Search::new(&image).row(y, 3..42, threshold);
                let expected: Vec<usize> = (3..42).filter(|&x| is_corner(&image, x, y, threshold)).collect();
                prop_assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn an_image_smaller_than_its_margin_has_no_corners() {
        let tiny = Gray {
            width: 5,
            height: 5,
            pixels: vec![0; 25],
        };
        assert!(corners(&tiny, 3, THRESHOLDS).is_empty());
    }
}
