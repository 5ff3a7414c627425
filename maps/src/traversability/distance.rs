//! Exact distance from every cell's centre to the nearest marked cell, measured to that cell's edge.
//!
//! A marked cell is a filled square, so that along one axis the distance over `d` cells is `g(d) = max(|d| - ½, 0)`, and
//!
//! ```text
//! D²(x, y) = min over marked (u, v) of g²(x - u) + g²(y - v)
//! ```
//!
//! `g²` is convex, so the difference of two shifted copies never decreases and the minimum over `u` is a lower envelope
//! that one sweep along each row finds after one sweep along each column.
//!
//! - A. Meijster, J. Roerdink, W. Hesselink, *A general algorithm for computing distance transforms in linear time*,
//!   2000, whose envelope this is, with `g` in place of the Euclidean parabola.

/// Distances in metres, row by row; infinite everywhere if nothing is marked.
pub(crate) fn to_marked(marked: &[bool], width: usize, resolution_m: f64) -> Vec<f32> {
    if width == 0 {
        return Vec::new();
    }
    let mut squared = along_columns(marked, width);
    let mut envelope = Envelope::default();
    let mut result = vec![0.0; width];
    for row in squared.chunks_exact_mut(width) {
        envelope.build(row);
        envelope.evaluate(row, &mut result);
        row.copy_from_slice(&result);
    }
    for value in &mut squared {
        *value = (f64::from(*value).sqrt() * resolution_m) as f32;
    }
    squared
}

/// `g²` to the nearest marked cell of the same column, in cells².
fn along_columns(marked: &[bool], width: usize) -> Vec<f32> {
    let mut steps = vec![u32::MAX; marked.len()];
    let count = marked.len();
    for i in 0..count {
        if marked[i] {
            steps[i] = 0;
        } else if i >= width {
            steps[i] = steps[i - width].saturating_add(1);
        }
    }
    for i in (0..count.saturating_sub(width)).rev() {
        steps[i] = steps[i].min(steps[i + width].saturating_add(1));
    }
    steps
        .into_iter()
        .map(|d| {
            if d == u32::MAX {
                f32::INFINITY
            } else {
                axis_squared(d as usize)
            }
        })
        .collect()
}

/// `g²(d)`, in cells².
fn axis_squared(d: usize) -> f32 {
    let beyond = (d as f32 - 0.5).max(0.0);
    beyond * beyond
}

/// The columns that are nearest somewhere in a row, each with the first cell where it is.
#[derive(Default)]
struct Envelope {
    parts: Vec<Part>,
}

#[derive(Clone, Copy)]
struct Part {
    column: usize,
    height: f32,
    from: usize,
}

impl Part {
    fn at(&self, x: usize) -> f32 {
        self.height + axis_squared(x.abs_diff(self.column))
    }
}

impl Envelope {
    fn build(&mut self, row: &[f32]) {
        self.parts.clear();
        for (column, &height) in row.iter().enumerate().filter(|(_, h)| h.is_finite()) {
            let mut new = Part {
                column,
                height,
                from: 0,
            };
            while let Some(last) = self.parts.last() {
                if new.at(last.from) <= last.at(last.from) {
                    self.parts.pop();
                    continue;
                }
                new.from = first_where(last.from + 1, row.len(), |x| new.at(x) <= last.at(x));
                break;
            }
            if new.from < row.len() {
                self.parts.push(new);
            }
        }
    }

    fn evaluate(&self, row: &[f32], result: &mut [f32]) {
        let mut end = row.len();
        for part in self.parts.iter().rev() {
            for (x, value) in result.iter_mut().enumerate().take(end).skip(part.from) {
                *value = part.at(x);
            }
            end = part.from;
        }
        if self.parts.is_empty() {
            result.fill(f32::INFINITY);
        }
    }
}

/// The first of `from..to` that satisfies a condition which, once true, stays true; `to` if none does.
fn first_where(from: usize, to: usize, holds: impl Fn(usize) -> bool) -> usize {
    let (mut low, mut high) = (from, to);
    while low < high {
        let middle = usize::midpoint(low, high);
        if holds(middle) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn by_brute_force(marked: &[bool], width: usize, resolution_m: f64) -> Vec<f32> {
        let at = |i: usize| ((i % width) as f64, (i / width) as f64);
        (0..marked.len())
            .map(|i| {
                let (x, y) = at(i);
                let nearest = (0..marked.len())
                    .filter(|&j| marked[j])
                    .map(|j| {
                        let (u, v) = at(j);
                        ((x - u).abs() - 0.5)
                            .max(0.0)
                            .hypot(((y - v).abs() - 0.5).max(0.0))
                    })
                    .fold(f64::INFINITY, f64::min);
                (nearest * resolution_m) as f32
            })
            .collect()
    }

    proptest! {
        #[test]
        fn distances_are_those_of_brute_force(
            width in 1_usize..20, height in 1_usize..20, seed in prop::collection::vec(0_u8..12, 400)
        ) {
            let marked: Vec<bool> = seed[..width * height].iter().map(|&s| s == 0).collect();
            let fast = to_marked(&marked, width, 0.05);
            let slow = by_brute_force(&marked, width, 0.05);
            for (f, s) in fast.iter().zip(&slow) {
                prop_assert!((f.is_infinite() && s.is_infinite()) || (f - s).abs() < 1e-6, "{f} m instead of {s} m");
            }
        }
    }

    #[test]
    fn an_empty_grid_has_no_distances_and_an_unmarked_one_infinite_ones() {
        assert!(to_marked(&[], 0, 0.1).is_empty());
        assert!(
            to_marked(&[false; 6], 3, 0.1)
                .iter()
                .all(|d| d.is_infinite())
        );
    }
}
