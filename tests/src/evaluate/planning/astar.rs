//! The baseline: A\* over the cells of a grid for a disc, and smoothing of what it finds.
//!
//! Obstacles and unknown ground are inflated by a radius of the footprint and eight neighbours are searched with the octile
//! heuristic. The way is cut short wherever the straight line is free, resampled, and relaxed towards a smooth curve as
//! long as no point enters the inflation. It is what a planner without a vehicle model can do: it knows no heading, no
//! turning radius and no reverse.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use maps::plan::Pose2;
use maps::traversability::{Cell, CellIndex, Traversability};

/// A grid for a disc.
pub(super) struct Inflated<'a> {
    grid: &'a Traversability,
    free: Vec<bool>,
}

const ROUNDS: usize = 60;
/// Weights of the old place and of smoothness in a round; their sum is stable below 0.5.
const TO_DATA: f64 = 0.1;
const TO_SMOOTH: f64 = 0.3;

impl<'a> Inflated<'a> {
    /// What a disc of `radius_m` may stand on.
    pub(super) fn new(grid: &'a Traversability, radius_m: f64) -> Self {
        let free = grid
            .cells()
            .map(|(index, cell)| {
                let [x, y] = grid.center_of(index);
                matches!(cell, Cell::Drivable { .. }) && grid.clearance_m(x, y) >= radius_m
            })
            .collect();
        Self { grid, free }
    }

    fn cell(&self, x_m: f64, y_m: f64) -> Option<usize> {
        let CellIndex { x, y } = self.grid.index_of(x_m, y_m)?;
        let cell = y * self.grid.size().0 + x;
        self.free[cell].then_some(cell)
    }

    /// A smooth way as points at most `spacing_m` apart; none if the disc cannot get there.
    pub(super) fn plan(
        &self,
        start: [f64; 2],
        goal: [f64; 2],
        spacing_m: f64,
    ) -> Option<Vec<[f64; 2]>> {
        let cells = self.search(self.cell(start[0], start[1])?, self.cell(goal[0], goal[1])?)?;
        let width = self.grid.size().0;
        let mut points: Vec<[f64; 2]> = cells
            .iter()
            .map(|&cell| {
                self.grid.center_of(CellIndex {
                    x: cell % width,
                    y: cell / width,
                })
            })
            .collect();
        if let [first, .., last] = &mut points[..] {
            (*first, *last) = (start, goal);
        }
        let points = resampled(&self.cut_short(&points), spacing_m);
        Some(resampled(&self.relaxed(points), spacing_m))
    }

    fn search(&self, start: usize, goal: usize) -> Option<Vec<usize>> {
        const STRAIGHT: u32 = 985;
        const DIAGONAL: u32 = 1393;
        let (width, height) = self.grid.size();
        let left = |cell: usize| {
            let dx = (cell % width).abs_diff(goal % width) as u32;
            let dy = (cell / width).abs_diff(goal / width) as u32;
            STRAIGHT * dx.abs_diff(dy) + DIAGONAL * dx.min(dy)
        };
        let mut costs = vec![u32::MAX; width * height];
        let mut parents = vec![u32::MAX; width * height];
        let mut open = BinaryHeap::new();
        costs[start] = 0;
        open.push((Reverse(left(start)), 0_u32, start as u32));
        while let Some((_, cost, at)) = open.pop() {
            let at = at as usize;
            if at == goal {
                return Some(chain(&parents, at));
            }
            if cost > costs[at] {
                continue;
            }
            let (x, y) = ((at % width).cast_signed(), (at / width).cast_signed());
            let free = |u: isize, v: isize| {
                let inside = u >= 0 && v >= 0 && (u as usize) < width && (v as usize) < height;
                inside
                    .then(|| v as usize * width + u as usize)
                    .filter(|&c| self.free[c])
            };
            for (dx, dy) in AROUND {
                let Some(to) = free(x + dx, y + dy) else {
                    continue;
                };
                let diagonal = dx != 0 && dy != 0;
                if diagonal && (free(x + dx, y).is_none() || free(x, y + dy).is_none()) {
                    continue;
                }
                let reached = cost + if diagonal { DIAGONAL } else { STRAIGHT };
                if reached < costs[to] {
                    costs[to] = reached;
                    parents[to] = at as u32;
                    open.push((Reverse(reached + left(to)), reached, to as u32));
                }
            }
        }
        None
    }

    /// Only those points between which the straight line is not free.
    fn cut_short(&self, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let mut kept = vec![points[0]];
        let mut from = 0;
        while from + 1 < points.len() {
            let mut to = from + 1;
            while to + 1 < points.len() && self.sees(points[from], points[to + 1]) {
                to += 1;
            }
            kept.push(points[to]);
            from = to;
        }
        kept
    }

    fn sees(&self, from: [f64; 2], to: [f64; 2]) -> bool {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let steps = (dx.hypot(dy) / (0.5 * self.grid.resolution_m()))
            .ceil()
            .max(1.0);
        (1..=steps as usize).all(|i| {
            let share = i as f64 / steps;
            self.cell(from[0] + share * dx, from[1] + share * dy)
                .is_some()
        })
    }

    fn relaxed(&self, mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
        let data = points.clone();
        for _ in 0..ROUNDS {
            for i in 1..points.len().saturating_sub(1) {
                let moved: [f64; 2] = std::array::from_fn(|k| {
                    points[i][k]
                        + TO_DATA * (data[i][k] - points[i][k])
                        + TO_SMOOTH * (points[i - 1][k] + points[i + 1][k] - 2.0 * points[i][k])
                });
                if self.cell(moved[0], moved[1]).is_some() {
                    points[i] = moved;
                }
            }
        }
        points
    }
}

const AROUND: [(isize, isize); 8] = [
    (1, 0),
    (0, 1),
    (-1, 0),
    (0, -1),
    (1, 1),
    (-1, 1),
    (-1, -1),
    (1, -1),
];

fn chain(parents: &[u32], end: usize) -> Vec<usize> {
    let mut cells = vec![end];
    let mut at = end;
    while parents[at] != u32::MAX {
        at = parents[at] as usize;
        cells.push(at);
    }
    cells.reverse();
    cells
}

/// Points evenly spaced along the way.
fn resampled(points: &[[f64; 2]], spacing_m: f64) -> Vec<[f64; 2]> {
    let between = |pair: &[[f64; 2]]| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
    let length: f64 = points.windows(2).map(between).sum();
    let count = (length / spacing_m).ceil().max(1.0);
    let apart = length / count;
    let mut result = vec![points[0]];
    let mut driven = 0.0;
    for pair in points.windows(2) {
        let part = between(pair);
        while result.len() < count as usize && apart * result.len() as f64 <= driven + part {
            let share = (apart * result.len() as f64 - driven) / part.max(1e-12);
            result.push(std::array::from_fn(|k| {
                pair[0][k] + share * (pair[1][k] - pair[0][k])
            }));
        }
        driven += part;
    }
    result.extend(points.last().filter(|_| points.len() > 1));
    result
}

/// The points with the heading of the way: what a vehicle that could turn anywhere would take.
pub(super) fn poses(points: &[[f64; 2]]) -> Vec<Pose2> {
    (0..points.len())
        .map(|i| {
            let (before, after) = (i.saturating_sub(1), (i + 1).min(points.len() - 1));
            let (dx, dy) = (
                points[after][0] - points[before][0],
                points[after][1] - points[before][1],
            );
            Pose2::new(points[i][0], points[i][1], dy.atan2(dx))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAT: Cell = Cell::Drivable {
        height_m: 0.0,
        cost: 0.0,
    };

    fn walled(gap: std::ops::Range<usize>) -> Traversability {
        let cells = (0..50 * 50)
            .map(|i| {
                let (x, y) = (i % 50, i / 50);
                if x == 25 && !gap.contains(&y) {
                    Cell::Blocked
                } else {
                    FLAT
                }
            })
            .collect();
        Traversability::from_cells([0.0, 0.0], 0.2, 50, cells).expect("a grid")
    }

    #[test]
    fn it_goes_through_a_gap_that_its_disc_fits_and_through_no_other() {
        let grid = walled(30..40);
        let (start, goal) = ([2.0, 2.0], [8.0, 2.0]);
        let way = Inflated::new(&grid, 0.5)
            .plan(start, goal, 0.25)
            .expect("a way");
        assert!(way.first() == Some(&start) && way.last() == Some(&goal));
        for point in &way {
            assert!(
                grid.clearance_m(point[0], point[1]) > 0.5 - 0.3,
                "{point:?}"
            );
        }
        for pair in way.windows(2) {
            let apart = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
            assert!(apart <= 0.25 + 1e-9, "{apart} m");
        }
        assert_eq!(Inflated::new(&grid, 1.1).plan(start, goal, 0.25), None);
    }

    #[test]
    fn on_open_ground_it_is_the_straight_line() {
        let grid = walled(0..50);
        let way = Inflated::new(&grid, 0.5)
            .plan([2.0, 2.0], [8.0, 5.0], 0.5)
            .expect("a way");
        let length: f64 = (way.windows(2))
            .map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1]))
            .sum();
        assert!((length - 6.0_f64.hypot(3.0)).abs() < 1e-9, "{length} m");
    }
}
