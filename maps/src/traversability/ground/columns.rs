//! The occupied runs of each column, and which of their tops are the ground.

use std::cmp::Reverse;

use super::{Limits, Window};
use crate::traversability::Hindrance;
use crate::voxel::{ClassId, Occupancy, VoxelMap};

/// Occupied voxels above each other without a gap; keys along z, both inclusive.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Run {
    bottom: i32,
    top: i32,
    /// Of the topmost voxel.
    class: ClassId,
}

/// The columns of a window, cell by cell.
pub(super) struct Columns {
    width: usize,
    runs: Vec<Run>,
    /// The first run of each cell, and one more.
    first: Vec<u32>,
    /// The lowest free voxel of each cell.
    lowest_free: Vec<i32>,
}

impl Columns {
    pub(super) fn of(map: &VoxelMap, window: Window) -> Self {
        let count = window.width * window.height;
        let mut occupied: Vec<(u32, i32, ClassId)> = Vec::new();
        let mut lowest_free = vec![i32::MAX; count];
        for (key, voxel) in map.known() {
            let Some(cell) = window.cell(key.x, key.y) else {
                continue;
            };
            match voxel.occupancy() {
                Occupancy::Occupied => occupied.push((cell as u32, key.z, voxel.class)),
                Occupancy::Free => lowest_free[cell] = lowest_free[cell].min(key.z),
                Occupancy::Unknown => {}
            }
        }
        occupied.sort_unstable();
        let (mut runs, mut first) = (Vec::<Run>::new(), Vec::with_capacity(count + 1));
        let mut next = occupied.iter().peekable();
        for cell in 0..count as u32 {
            let begin = runs.len();
            first.push(begin as u32);
            while let Some(&(_, z, class)) = next.next_if(|(c, ..)| *c == cell) {
                match runs[begin..].last_mut() {
                    Some(run) if run.top + 1 == z => (run.top, run.class) = (z, class),
                    _ => runs.push(Run {
                        bottom: z,
                        top: z,
                        class,
                    }),
                }
            }
        }
        first.push(runs.len() as u32);
        Self {
            width: window.width,
            runs,
            first,
            lowest_free,
        }
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    fn len(&self) -> usize {
        self.lowest_free.len()
    }

    fn runs(&self, cell: usize) -> &[Run] {
        &self.runs[self.first[cell] as usize..self.first[cell + 1] as usize]
    }

    pub(super) fn has_occupied(&self, cell: usize) -> bool {
        !self.runs(cell).is_empty()
    }

    /// What stands higher than a step and hangs lower than the vehicle's height over ground at `height`: the lowest of it.
    pub(super) fn hinders_above(
        &self,
        cell: usize,
        height: f32,
        limits: &Limits,
    ) -> Option<Hindrance> {
        let run = self.runs(cell).iter().find(|run| {
            run.top as f32 > height + limits.step
                && run.bottom as f32 - height <= limits.height as f32
        })?;
        let metres = |voxels: f32| (f64::from(voxels) * limits.resolution_m) as f32;
        let gap = run.bottom as f32 - height - 1.0;
        Some(if gap > limits.step {
            Hindrance::Overhang { gap_m: metres(gap) }
        } else {
            Hindrance::Obstacle {
                height_m: metres(run.top as f32 - height),
            }
        })
    }

    /// Free voxels between ground at `height` and what hangs over it; infinite under the sky.
    pub(super) fn headroom(&self, cell: usize, height: f32) -> f32 {
        (self.runs(cell).iter())
            .map(|run| run.bottom as f32 - height - 1.0)
            .find(|gap| *gap > 0.0)
            .unwrap_or(f32::INFINITY)
    }

    /// The class of the surface that is the ground at about `height`.
    pub(super) fn class_of_ground(&self, cell: usize, height: f32, limits: &Limits) -> ClassId {
        (self.runs(cell).iter())
            .find(|run| (run.top as f32 - height).abs() <= limits.step)
            .map_or(ClassId::NONE, |run| run.class)
    }

    /// Whether a ray went clearly deeper than ground at `height`.
    pub(super) fn is_seen_below(&self, cell: usize, height: f32, limits: &Limits) -> bool {
        (self.lowest_free[cell] as f32) < height - limits.step - 2.0
    }
}

/// A top with enough room for the vehicle above it.
#[derive(Clone, Copy)]
struct Top {
    cell: usize,
    z: i32,
}

/// The height of the ground in each cell, as the key of its topmost voxel. `seed` is the cell and height at which the vehicle
/// stands.
pub(super) fn ground(
    columns: &Columns,
    seed: Option<(usize, i32)>,
    limits: &Limits,
) -> Vec<Option<i32>> {
    let (tops, first) = tops(columns, limits);
    let patches = patches(columns, &tops, &first, limits);
    let mut ground = vec![None; columns.len()];
    let mut left = patches;
    let under = seed.and_then(|(cell, z)| {
        let of_cell = first[cell]..first[cell + 1];
        of_cell.min_by_key(|&top| tops[top as usize].z.abs_diff(z))
    });
    if let Some(under) = under {
        left.retain(|patch| !patch.contains(&under));
        reach(&mut ground, (columns, &tops, &first), under, limits);
    } else {
        let Some(main) = lowest_of_the_large(&left, &tops) else {
            return ground;
        };
        accept(&mut ground, &tops, &left.remove(main));
    }
    // Each round may bring in what continues the round before; the largest patches decide first.
    for _ in 0..ROUNDS {
        let nearest = nearest_with_height(&ground, columns.width());
        let before = left.len();
        left.retain(|patch| {
            let continues = continues(patch, &tops, &nearest, columns.width(), limits);
            if continues && under.is_some() {
                accept_beside(&mut ground, &tops, patch);
            } else if continues {
                accept(&mut ground, &tops, patch);
            }
            !continues
        });
        if left.len() == before {
            break;
        }
    }
    ground
}

/// What is connected to a top, nearest first: each column has one height, and nothing beyond one it already has is reached
/// through it.
fn reach(
    ground: &mut [Option<i32>],
    (columns, tops, first): (&Columns, &[Top], &[u32]),
    from: u32,
    limits: &Limits,
) {
    let link = link(limits);
    let Top { cell, z } = tops[from as usize];
    ground[cell] = Some(z);
    let mut wave = vec![(cell, z)];
    let mut next = 0;
    while let Some(&(cell, z)) = wave.get(next) {
        next += 1;
        for neighbour in neighbours(cell, columns.width(), columns.len()) {
            if ground[neighbour].is_some() {
                continue;
            }
            let near = (first[neighbour]..first[neighbour + 1])
                .map(|top| tops[top as usize].z)
                .filter(|other| (other - z).abs() as f32 <= link)
                .min_by_key(|other| other.abs_diff(z));
            if let Some(other) = near {
                ground[neighbour] = Some(other);
                wave.push((neighbour, other));
            }
        }
    }
}

/// Heights of neighbours that differ by more do not belong together.
fn link(limits: &Limits) -> f32 {
    limits.step.max(2.0) + limits.slope()
}

const ROUNDS: usize = 4;
/// A patch of at least this share of the largest one may be the ground.
const LARGE: f64 = 0.25;
/// How much ground may rise per metre between patches, besides a step: more would make tables of it.
const DRIFT: f32 = 0.05;

fn tops(columns: &Columns, limits: &Limits) -> (Vec<Top>, Vec<u32>) {
    let (mut tops, mut first) = (Vec::new(), Vec::with_capacity(columns.len() + 1));
    for cell in 0..columns.len() {
        first.push(tops.len() as u32);
        let runs = columns.runs(cell);
        for (i, run) in runs.iter().enumerate() {
            let room = runs
                .get(i + 1)
                .map_or(i32::MAX, |above| above.bottom - run.top - 1);
            if room >= limits.height {
                tops.push(Top { cell, z: run.top });
            }
        }
    }
    first.push(tops.len() as u32);
    (tops, first)
}

/// Tops connected from neighbour to neighbour, as indices; the largest patch first.
fn patches(columns: &Columns, tops: &[Top], first: &[u32], limits: &Limits) -> Vec<Vec<u32>> {
    let width = columns.width();
    let link = link(limits);
    let of_cell = |cell: usize| first[cell]..first[cell + 1];
    let mut seen = vec![false; tops.len()];
    let mut patches = Vec::new();
    for seed in 0..tops.len() as u32 {
        if std::mem::replace(&mut seen[seed as usize], true) {
            continue;
        }
        let mut patch = vec![seed];
        let mut next = 0;
        while let Some(&at) = patch.get(next) {
            next += 1;
            let Top { cell, z } = tops[at as usize];
            for neighbour in neighbours(cell, width, columns.len()) {
                for other in of_cell(neighbour) {
                    let near = (tops[other as usize].z - z).abs() as f32 <= link;
                    if near && !std::mem::replace(&mut seen[other as usize], true) {
                        patch.push(other);
                    }
                }
            }
        }
        patches.push(patch);
    }
    patches.sort_by_key(|patch| (Reverse(patch.len()), patch[0]));
    patches
}

/// The up to eight cells around one, in a fixed order.
pub(super) fn neighbours(cell: usize, width: usize, count: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (cell % width, cell / width);
    let rows = y.saturating_sub(1)..=(y + 1).min(count / width - 1);
    rows.flat_map(move |v| {
        let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
        columns.map(move |u| v * width + u)
    })
    .filter(move |&other| other != cell)
}

fn lowest_of_the_large(patches: &[Vec<u32>], tops: &[Top]) -> Option<usize> {
    let largest = patches.first()?.len();
    let mean = |patch: &Vec<u32>| {
        let sum: f64 = patch.iter().map(|&t| f64::from(tops[t as usize].z)).sum();
        sum / patch.len() as f64
    };
    (0..patches.len())
        .take_while(|&i| patches[i].len() as f64 >= LARGE * largest as f64)
        .min_by(|&a, &b| mean(&patches[a]).total_cmp(&mean(&patches[b])))
}

/// Where a column has several, the lowest is the ground.
fn accept(ground: &mut [Option<i32>], tops: &[Top], patch: &[u32]) {
    for &top in patch {
        let Top { cell, z } = tops[top as usize];
        let height = &mut ground[cell];
        *height = Some(height.map_or(z, |before: i32| before.min(z)));
    }
}

/// Takes a patch where a column has no height yet.
fn accept_beside(ground: &mut [Option<i32>], tops: &[Top], patch: &[u32]) {
    for &top in patch {
        let Top { cell, z } = tops[top as usize];
        ground[cell].get_or_insert(z);
    }
}

/// Whether most of a patch lies at the height of the ground nearest to it. Ground that is found already is none of its.
fn continues(
    patch: &[u32],
    tops: &[Top],
    nearest: &[Option<(usize, i32)>],
    width: usize,
    limits: &Limits,
) -> bool {
    let (mut level, mut all) = (0, 0);
    for &top in patch {
        let Top { cell, z } = tops[top as usize];
        let Some((from, height)) = nearest[cell] else {
            continue;
        };
        if from == cell {
            continue;
        }
        let (dx, dy) = (
            (cell % width).abs_diff(from % width),
            (cell / width).abs_diff(from / width),
        );
        let rise = limits.step.max(2.0) + DRIFT * (dx as f32).hypot(dy as f32);
        all += 1;
        level += usize::from((z - height).abs() as f32 <= rise);
    }
    2 * level > all
}

/// The nearest cell that has a height, by steps to eight neighbours, with that height; itself where it has one.
pub(super) fn nearest_with_height<T: Copy>(
    heights: &[Option<T>],
    width: usize,
) -> Vec<Option<(usize, T)>> {
    let mut nearest: Vec<_> = (heights.iter().enumerate())
        .map(|(cell, height)| height.map(|h| (cell, h)))
        .collect();
    let mut wave: Vec<usize> = (0..heights.len())
        .filter(|&cell| nearest[cell].is_some())
        .collect();
    let mut next = Vec::new();
    while !wave.is_empty() {
        for &cell in &wave {
            for neighbour in neighbours(cell, width, heights.len()) {
                if nearest[neighbour].is_none() {
                    nearest[neighbour] = nearest[cell];
                    next.push(neighbour);
                }
            }
        }
        wave.clear();
        std::mem::swap(&mut wave, &mut next);
    }
    nearest
}
