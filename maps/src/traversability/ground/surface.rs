//! The shape of the ground: its height without noise, its edges, and the plane under the vehicle.

use rayon::prelude::*;

use super::Limits;
use super::columns::{nearest_with_height, neighbours};

/// The least-squares plane through the ground around a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Plane {
    /// Rise per run.
    pub(super) slope: f32,
    /// Root of the mean squared deviation from it, in voxels.
    pub(super) roughness: f32,
}

/// The ground of a window, cell by cell.
pub(super) struct Surface {
    width: usize,
    /// Median height, in voxels; none where there is no ground.
    heights: Vec<Option<f32>>,
    /// Largest difference to a neighbour or of the ground itself to its median, in voxels.
    steps: Vec<f32>,
    edges: Vec<bool>,
    planes: Vec<Plane>,
}

/// Cells to either side of the median.
const MEDIAN_CELLS: usize = 2;
/// A plane needs this many heights.
const LEAST_HEIGHTS: i64 = 6;

impl Surface {
    /// From the topmost voxel of the ground in each cell.
    pub(super) fn of(ground: &[Option<i32>], width: usize, limits: &Limits) -> Self {
        let medians: Vec<Option<f32>> = (0..ground.len())
            .into_par_iter()
            .map(|cell| ground[cell].and_then(|_| median_around(ground, width, cell)))
            .collect();
        // A cell much lower than what is around it was seen badly or is a hole: it is no ground.
        let heights: Vec<Option<f32>> = (medians.iter().zip(ground))
            .map(|(median, top)| {
                median.filter(|m| top.is_some_and(|z| *m - z as f32 <= limits.step))
            })
            .collect();
        let (steps, edges): (Vec<f32>, Vec<bool>) = (0..ground.len())
            .into_par_iter()
            .map(|cell| {
                let out =
                    (ground[cell].zip(heights[cell])).map_or(0.0, |(z, height)| z as f32 - height);
                let beside = step_beside(&heights, width, cell);
                let is_edge = out > limits.step || beside > limits.step + limits.slope();
                (out.max(beside), is_edge)
            })
            .unzip();
        let labels = labels(&heights, &edges, width, limits);
        let planes = (0..ground.len())
            .into_par_iter()
            .map(|cell| plane_around(ground, &labels, width, cell, limits.plane_cells))
            .collect();
        Self {
            width,
            heights,
            steps,
            edges,
            planes,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.heights.len()
    }

    /// Height of the ground's topmost voxel, in voxels.
    pub(super) fn height(&self, cell: usize) -> Option<f32> {
        self.heights[cell]
    }

    /// Whether the ground has a step here or something sticks out of it.
    pub(super) fn is_edge(&self, cell: usize) -> bool {
        self.edges[cell]
    }

    /// Largest difference of height, in voxels, to a neighbour or of what sticks out.
    pub(super) fn step(&self, cell: usize) -> f32 {
        self.steps[cell]
    }

    pub(super) fn plane(&self, cell: usize) -> Plane {
        self.planes[cell]
    }

    /// The height of the ground nearest to each cell.
    pub(super) fn nearest_height(&self) -> Vec<Option<f32>> {
        nearest_with_height(&self.heights, self.width)
            .into_iter()
            .map(|nearest| nearest.map(|(_, height)| height))
            .collect()
    }
}

/// The cells at most `reach` away along both axes.
fn square(cell: usize, width: usize, count: usize, reach: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (cell % width, cell / width);
    let rows = y.saturating_sub(reach)..=(y + reach).min(count / width - 1);
    rows.flat_map(move |v| {
        let columns = x.saturating_sub(reach)..=(x + reach).min(width - 1);
        columns.map(move |u| v * width + u)
    })
}

fn median_around(ground: &[Option<i32>], width: usize, cell: usize) -> Option<f32> {
    let mut heights = [0; (2 * MEDIAN_CELLS + 1).pow(2)];
    let mut count = 0;
    for other in square(cell, width, ground.len(), MEDIAN_CELLS) {
        if let Some(z) = ground[other] {
            heights[count] = z;
            count += 1;
        }
    }
    let heights = &mut heights[..count];
    heights.sort_unstable();
    let last = count.checked_sub(1)?;
    Some(0.5 * (heights[last / 2] + heights[last.div_ceil(2)]) as f32)
}

/// The largest difference to a neighbour, in voxels.
fn step_beside(heights: &[Option<f32>], width: usize, cell: usize) -> f32 {
    let Some(height) = heights[cell] else {
        return 0.0;
    };
    neighbours(cell, width, heights.len())
        .filter_map(|other| heights[other])
        .map(|other| (other - height).abs())
        .fold(0.0, f32::max)
}

/// Numbers the parts of the ground between edges, from 1; 0 where there is none.
fn labels(heights: &[Option<f32>], edges: &[bool], width: usize, limits: &Limits) -> Vec<u32> {
    let mut labels = vec![0; heights.len()];
    let mut count = 0;
    let mut open = Vec::new();
    for seed in 0..heights.len() {
        if labels[seed] != 0 || edges[seed] || heights[seed].is_none() {
            continue;
        }
        count += 1;
        labels[seed] = count;
        open.push(seed);
        while let Some(cell) = open.pop() {
            for other in neighbours(cell, width, heights.len()) {
                let near = heights[cell]
                    .zip(heights[other])
                    .is_some_and(|(a, b)| (a - b).abs() <= limits.step + limits.slope());
                if labels[other] == 0 && !edges[other] && near {
                    labels[other] = count;
                    open.push(other);
                }
            }
        }
    }
    labels
}

/// The plane through the ground of the same part around a cell; flat where there is too little of it.
fn plane_around(
    ground: &[Option<i32>],
    labels: &[u32],
    width: usize,
    cell: usize,
    reach: usize,
) -> Plane {
    if labels[cell] == 0 {
        return Plane::default();
    }
    let (x, y) = (cell % width, cell / width);
    let base = ground[cell].unwrap_or(0);
    // Sums of 1, x, y, z and of their products, exact in integers; all seen from the cell.
    let (mut n, mut s, mut m) = (0_i64, [0_i64; 3], [0_i64; 6]);
    for other in square(cell, width, ground.len(), reach) {
        if labels[other] != labels[cell] {
            continue;
        }
        let Some(z) = ground[other] else {
            continue;
        };
        let along = |to: usize, from: usize| {
            let distance = to.abs_diff(from) as u32;
            if to < from {
                -i64::from(distance)
            } else {
                i64::from(distance)
            }
        };
        let (dx, dy) = (along(other % width, x), along(other / width, y));
        let dz = i64::from(z) - i64::from(base);
        n += 1;
        for (sum, value) in s.iter_mut().zip([dx, dy, dz]) {
            *sum += value;
        }
        let products = [dx * dx, dx * dy, dy * dy, dx * dz, dy * dz, dz * dz];
        for (sum, value) in m.iter_mut().zip(products) {
            *sum += value;
        }
    }
    if n < LEAST_HEIGHTS {
        return Plane::default();
    }
    plane(n, s, m)
}

/// The plane z = a + b·x + c·y from the sums `s` of x, y, z and `m` of xx, xy, yy, xz, yz, zz over `n` points.
fn plane(n: i64, s: [i64; 3], m: [i64; 6]) -> Plane {
    let n = n as f32;
    let mean = s.map(|sum| sum as f32 / n);
    let moment = |sum: i64, a: usize, b: usize| sum as f32 / n - mean[a] * mean[b];
    let (xx, xy, yy) = (moment(m[0], 0, 0), moment(m[1], 0, 1), moment(m[2], 1, 1));
    let (xz, yz, zz) = (moment(m[3], 0, 2), moment(m[4], 1, 2), moment(m[5], 2, 2));
    let determinant = xx * yy - xy * xy;
    // A single line of cells says nothing about the slope across it.
    if determinant < 0.05 {
        return Plane::default();
    }
    let along_x = (xz * yy - yz * xy) / determinant;
    let along_y = (yz * xx - xz * xy) / determinant;
    let explained = along_x * xz + along_y * yz;
    Plane {
        slope: along_x.hypot(along_y),
        roughness: (zz - explained).max(0.0).sqrt(),
    }
}
