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
    /// By how many grey levels nine neighbours in a row differ at least: below that threshold it is a corner.
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
/// Of the circle.
const RADIUS: usize = 3;
/// From the left and from the top of the square around it.
const CIRCLE: [(usize, usize); 16] = [
    (3, 0),
    (4, 0),
    (5, 1),
    (6, 2),
    (6, 3),
    (6, 4),
    (5, 5),
    (4, 6),
    (3, 6),
    (2, 6),
    (1, 5),
    (0, 4),
    (0, 3),
    (0, 2),
    (1, 1),
    (2, 0),
];

/// Finds corners at least `margin` (3 or more) pixels from the border, strongest of each 3 x 3 only, row by row.
pub(crate) fn corners(image: &Gray, margin: usize, thresholds: Thresholds) -> Vec<Corner> {
    let margin = margin.max(RADIUS);
    if image.width <= 2 * margin || image.height <= 2 * margin {
        return Vec::new();
    }
    let mut search = Search::new(image);
    let (right, bottom) = (image.width - margin, image.height - margin);
    for y in margin..bottom {
        search.row(y, margin..right, thresholds.strict);
    }
    for top in (margin..bottom).step_by(CELL) {
        for left in (margin..right).step_by(CELL) {
            let rows = top..(top + CELL).min(bottom);
            let columns = left..(left + CELL).min(right);
            if search.is_empty(rows.clone(), columns.clone()) {
                for y in rows {
                    search.row(y, columns.clone(), thresholds.lenient);
                }
            }
        }
    }
    search.strongest()
}

struct Search<'a> {
    image: &'a Gray,
    /// By pixel, what [`Corner::score`] says; 0 where there is no corner.
    scores: Vec<u8>,
    candidates: Vec<u8>,
}

/// By which side of the threshold a pixel may be a corner.
const BRIGHT: u8 = 1;
const DARK: u8 = 2;

impl<'a> Search<'a> {
    fn new(image: &'a Gray) -> Self {
        Self {
            image,
            scores: vec![0; image.pixels.len()],
            candidates: Vec::new(),
        }
    }

    /// Records the corners of part of a row.
    fn row(&mut self, y: usize, columns: std::ops::Range<usize>, threshold: u8) {
        self.mark_candidates(y, columns.clone(), threshold);
        for (i, chunk) in self.candidates.chunks(LANES).enumerate() {
            let sides = chunk.iter().fold(0, |any, &c| any | c);
            if sides == 0 {
                continue;
            }
            let at = y * self.image.width + columns.start + LANES * i;
            let strengths = self.strengths(at, sides);
            for (score, strength) in self.scores[at..].iter_mut().zip(&strengths[..chunk.len()]) {
                *score = if *strength > threshold { *strength } else { 0 };
            }
        }
    }

    /// How far nine neighbours in a row, on one of these sides, differ at least from each of the pixels from `at` on. Loops over
    /// neighbouring pixels vectorise: 16 of them take hardly longer than one. Near the end of the image the last ones
    /// are not looked at; the margin keeps them out anyway.
    fn strengths(&self, at: usize, sides: u8) -> Lanes {
        let (width, pixels) = (self.image.width, &self.image.pixels);
        let from = at - RADIUS * width - RADIUS;
        let mut center = [0; LANES];
        read(&mut center, pixels, at);
        let mut ring = [[0; LANES]; 16];
        for (neighbours, &(dx, dy)) in ring.iter_mut().zip(&CIRCLE) {
            read(neighbours, pixels, from + dy * width + dx);
        }
        let mut best = [0; LANES];
        if sides & BRIGHT != 0 {
            let mut brighter = ring;
            for neighbours in &mut brighter {
                *neighbours = join(neighbours, &center, u8::saturating_sub);
            }
            best = weakest_of_best_arc(&brighter);
        }
        if sides & DARK != 0 {
            for neighbours in &mut ring {
                *neighbours = join(&center, neighbours, u8::saturating_sub);
            }
            best = join(&best, &weakest_of_best_arc(&ring), u8::max);
        }
        best
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
            *mark = (BRIGHT * u8::from(is_bright)) | (DARK * u8::from(is_dark));
        }
    }

    /// Whether no corner is recorded there.
    fn is_empty(&self, rows: std::ops::Range<usize>, columns: std::ops::Range<usize>) -> bool {
        let width = self.image.width;
        rows.into_iter().all(|y| {
            let part = &self.scores[y * width + columns.start..y * width + columns.end];
            part.iter().fold(0, |any, &score| any | score) == 0
        })
    }

    /// Those that beat their eight neighbours; of equals, the first.
    fn strongest(&self) -> Vec<Corner> {
        let (width, scores) = (self.image.width, &self.scores);
        let is_peak = |at: usize| {
            let score = scores[at];
            let before = [at - width - 1, at - width, at - width + 1, at - 1];
            let after = [at + 1, at + width - 1, at + width, at + width + 1];
            before.iter().all(|&n| scores[n] < score) && after.iter().all(|&n| scores[n] <= score)
        };
        let mut strongest = Vec::new();
        for (i, chunk) in scores.chunks(LANES).enumerate() {
            if chunk.iter().fold(0, |any, &score| any | score) == 0 {
                continue;
            }
            let found = (LANES * i..).zip(chunk).filter(|(_, score)| **score > 0);
            strongest.extend(
                found
                    .filter(|&(at, _)| is_peak(at))
                    .map(|(at, &score)| Corner {
                        x: at % width,
                        y: at / width,
                        score,
                    }),
            );
        }
        strongest
    }
}

/// A value for each of neighbouring pixels.
type Lanes = [u8; LANES];

/// Reads the pixels from there on; what is after the end stays as it is.
#[inline]
fn read(lanes: &mut Lanes, pixels: &[u8], from: usize) {
    match pixels.get(from..).and_then(<[u8]>::first_chunk) {
        Some(all) => lanes.copy_from_slice(all as &Lanes),
        None => read_last(lanes, pixels.get(from..).unwrap_or_default()),
    }
}

#[cold]
#[inline(never)]
fn read_last(lanes: &mut Lanes, pixels: &[u8]) {
    lanes[..pixels.len()].copy_from_slice(pixels);
}

#[inline]
fn join(a: &Lanes, b: &Lanes, by: impl Fn(u8, u8) -> u8) -> Lanes {
    std::array::from_fn(|i| by(a[i], b[i]))
}

/// Of each lane, the least of nine neighbours in a row around the circle, for the nine of which that is most. Eight in a row from
/// every second neighbour on make nine with the one before them or the one after.
fn weakest_of_best_arc(ring: &[Lanes; 16]) -> Lanes {
    let least = |a: &Lanes, b: &Lanes| join(a, b, u8::min);
    let (mut two, mut four) = ([[0; LANES]; 8], [[0; LANES]; 8]);
    for k in 0..8 {
        two[k] = least(&ring[2 * k + 1], &ring[(2 * k + 2) % 16]);
    }
    for k in 0..8 {
        four[k] = least(&two[k], &two[(k + 1) % 8]);
    }
    let mut best = [0; LANES];
    for k in 0..8 {
        let eight = least(&four[k], &four[(k + 2) % 8]);
        let ninth = join(&ring[2 * k], &ring[(2 * k + 9) % 16], u8::max);
        best = join(&best, &least(&eight, &ninth), u8::max);
    }
    best
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
            let value = |k: usize| {
                if (k + 16 - start) % 16 < length {
                    70
                } else {
                    3
                }
            };
            let ring = std::array::from_fn(|k| {
                std::array::from_fn(|lane| if lane == 3 { value(k) } else { 0 })
            });
            let weakest = weakest_of_best_arc(&ring);
            let expected = if length >= 9 { 70 } else { 3 };
            assert_eq!(weakest[3], expected, "{length} from {start}");
            assert_eq!(weakest[4], 0, "lanes do not mix");
        }
    }

    /// By the definition, one pixel after the other: by how much all of some nine in a row differ on the same side.
    fn strength(image: &Gray, x: usize, y: usize) -> u8 {
        let center = i16::from(image.row(y)[x]);
        let ring =
            CIRCLE.map(|(dx, dy)| i16::from(image.row(y + dy - RADIUS)[x + dx - RADIUS]) - center);
        let arc = |sign: i16, from: usize| (0..9).map(|k| sign * ring[(from + k) % 16]).min();
        let arcs = (0..16).flat_map(|from| [arc(1, from), arc(-1, from)]);
        arcs.flatten().max().map_or(0, |best| best.max(0) as u8)
    }

    proptest! {
        #[test]
        fn a_row_has_the_corners_of_the_definition(
            pixels in proptest::collection::vec(prop_oneof![0..=60u8, 190..=255u8, any::<u8>()], 45 * 9),
            threshold in 1..120u8,
        ) {
            let image = Gray { width: 45, height: 9, pixels };
            for y in [3, 4, 5] {
                let mut search = Search::new(&image);
                search.row(y, 3..42, threshold);
                for x in 3..42 {
                    let strength = strength(&image, x, y);
                    let expected = if strength > threshold { strength } else { 0 };
                    prop_assert_eq!(search.scores[y * 45 + x], expected);
                }
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
