//! From evidence about single cells to regions that move.

use std::collections::VecDeque;

use nalgebra::{Isometry3, Point3};

use super::memory::Trace;
use super::witness::Votes;
use crate::coarse::Coarse;
use crate::optics::Optics;

/// Frames for which a mask lives on without new evidence.
const MEMORY: u8 = 45;
/// Cells over which a mask grows into the unknown, from evidence or from the mask of the frame before.
const GROWTH: u16 = 10;
/// The least share of a component for which there is strong evidence.
const STRONG_SHARE: f64 = 0.25;
/// The least share of the image that is believed to move: smaller spots are noise.
const SMALLEST_SHARE: f64 = 0.002;
/// The fewest cells about which there is no doubt that make a component move: a person 10 m away.
const FEWEST_CERTAIN: usize = 4;
/// What a cell adds to the doubt about itself in each frame in which it and all around it stand, weakly or clearly, where
/// space was free, as those say from whom the frame has not drifted. A rim that is seen a little displaced is too thin for that.
const DOUBT_WEAK: f32 = 0.7;
const DOUBT_STRONG: f32 = 1.3;
/// Below this height over the floor the mask does not grow into what no witness speaks of: feet touch the floor.
pub(super) const FLOOR_M: f64 = 0.06;
/// How far around what moves nothing is believed: colour and depth are a moment apart, in which a person in a hurry goes
/// so far, and clothes and hair have no sharp depth.
const MARGIN_M: f32 = 0.025;
/// Wider near the floor, below the height of ankles: shoes are too low to stand out from it.
const ANKLE_M: f64 = 0.2;
const SHOE_M: f32 = 0.12;
/// The margin in cells, at least and at most.
const LEAST_MARGIN: usize = 2;
const MOST_MARGIN: usize = 10;

/// From a part of a person that is known to move to one that is not.
const BODY_M: f32 = 0.8;
/// Cells from the rim of a mask, margin included, to what it was grown for.
const CORE: usize = 4;

/// So many witnesses of free space before or after all who confirm a surface are enough.
const ENOUGH_APART: u8 = 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Label {
    /// No depth.
    Empty,
    /// A keyframe saw the same surface.
    Confirmed,
    /// Nobody looked here.
    Unknown,
    /// Nobody looked here since it was masked, so many frames ago.
    Remembered(u8),
    /// Slightly in front of what was there.
    Weak,
    /// Clearly in front of what was there.
    Strong,
    /// Its features move.
    Certain,
    /// A detector says what it is, and what around it is not.
    Named,
}

/// What free space and the mask of the frame before say of each cell.
pub(super) fn label(coarse: &Coarse, votes: &[Votes], recalled: &[Trace]) -> Vec<Label> {
    let of = |(cell, v): (usize, &Votes)| match v {
        _ if coarse.depth_m[cell] <= 0.0 => Label::Empty,
        v if v.strong > v.confirm || v.apart >= ENOUGH_APART => Label::Strong,
        v if v.weak > 0 && v.weak >= v.confirm => Label::Weak,
        v if v.confirm > 0 => Label::Confirmed,
        _ => match recalled[cell].age {
            Some(age) if age <= MEMORY => Label::Remembered(age),
            Some(_) | None => Label::Unknown,
        },
    };
    votes.iter().enumerate().map(of).collect()
}

/// By cell, what free space adds to the doubt whether it is static: too little for a single frame, enough for a few.
pub(super) fn suspicion(optics: &Optics, votes: &[Votes], labels: &[Label]) -> Vec<f32> {
    let (across, down) = (optics.cells_across, optics.cells_down);
    let mut suspicion = vec![0.0; labels.len()];
    for row in 1..down.saturating_sub(1) {
        for column in 1..across.saturating_sub(1) {
            let cell = row * across + column;
            if votes[cell].sound == 0 || !matches!(labels[cell], Label::Weak | Label::Strong) {
                continue;
            }
            let around = [cell - across, cell, cell + across];
            let around = around.iter().flat_map(|&at| &labels[at - 1..=at + 1]);
            let strong = around.clone().filter(|l| **l == Label::Strong).count();
            let weak = around.filter(|l| **l == Label::Weak).count();
            suspicion[cell] = match (strong, strong + weak) {
                (5.., 7..) => DOUBT_STRONG,
                (_, 7..) => DOUBT_WEAK,
                _ => 0.0,
            };
        }
    }
    suspicion
}

/// Grows the mask from its seeds, component by component; keeps those with enough evidence. Returns the age by cell.
pub(super) fn grow(
    optics: &Optics,
    coarse: &Coarse,
    labels: &[Label],
    pose: &Isometry3<f64>,
) -> Vec<Option<u8>> {
    let smallest = smallest(optics);
    let mut age = vec![None; labels.len()];
    let mut visited = vec![false; labels.len()];
    for start in 0..labels.len() {
        if visited[start]
            || !matches!(
                labels[start],
                Label::Named | Label::Certain | Label::Strong | Label::Remembered(_)
            )
        {
            continue;
        }
        let component = collect(optics, coarse, labels, (start, &mut visited), pose);
        if let Some(since) = judge(optics, labels, &component, smallest) {
            for cell in component {
                age[cell] = Some(since);
            }
        }
    }
    age
}

/// The fewest cells that are believed to move.
pub(super) fn smallest(optics: &Optics) -> usize {
    (SMALLEST_SHARE * optics.cell_count() as f64).ceil() as usize
}

/// Frames since there was enough evidence for a component; none if there is not.
fn judge(optics: &Optics, labels: &[Label], component: &[usize], smallest: usize) -> Option<u8> {
    let count = |wanted: &dyn Fn(usize) -> bool| component.iter().filter(|&&c| wanted(c)).count();
    let certain = count(&|c| matches!(labels[c], Label::Certain | Label::Named));
    let strong = count(&|c| is_strong(labels, c));
    let solid = count(&|c| is_solid(optics, labels, c));
    let free_before = solid >= smallest && strong as f64 >= STRONG_SHARE * component.len() as f64;
    if certain >= FEWEST_CERTAIN.min(smallest) || free_before {
        return Some(0);
    }
    let ages = component.iter().filter_map(|&c| match labels[c] {
        Label::Remembered(age) => Some(age),
        _ => None,
    });
    ages.min().filter(|_| component.len() >= smallest)
}

fn is_strong(labels: &[Label], cell: usize) -> bool {
    matches!(labels[cell], Label::Strong | Label::Certain | Label::Named)
}

/// Whether a cell and those around it are all strong evidence: the rims of static things, seen a little displaced, are
/// thin.
fn is_solid(optics: &Optics, labels: &[Label], cell: usize) -> bool {
    let strong = |c: usize| is_strong(labels, c);
    let full = |c: usize| strong(c) && neighbors(optics, c).all(strong);
    full(cell) && neighbors(optics, cell).all(full)
}

/// The cells connected in depth to a seed, breadth first; only so far into the unknown.
fn collect(
    optics: &Optics,
    coarse: &Coarse,
    labels: &[Label],
    (start, visited): (usize, &mut [bool]),
    pose: &Isometry3<f64>,
) -> Vec<usize> {
    let mut component = vec![(start, 0u16)];
    visited[start] = true;
    let mut next = 0;
    while let Some(&(cell, distance)) = component.get(next) {
        next += 1;
        for neighbor in neighbors(optics, cell) {
            let further = match labels[neighbor] {
                Label::Named
                | Label::Certain
                | Label::Strong
                | Label::Weak
                | Label::Remembered(_) => 0,
                Label::Unknown if labels[cell] == Label::Named => continue,
                Label::Unknown => distance + 1,
                Label::Empty | Label::Confirmed => continue,
            };
            let (a, b) = (coarse.depth_m[cell], coarse.depth_m[neighbor]);
            if visited[neighbor] || !connected(a, b) || further > GROWTH {
                continue;
            }
            if further > 0 && height(optics, neighbor, b, pose) < FLOOR_M {
                continue;
            }
            visited[neighbor] = true;
            component.push((neighbor, further));
        }
    }
    component.into_iter().map(|(cell, _)| cell).collect()
}

/// Whether depths of neighbouring cells can belong to one surface; so can two cells without depth.
pub(super) fn connected(a: f32, b: f32) -> bool {
    (a > 0.0) == (b > 0.0) && (a - b).abs() < 0.03 + 0.02 * a
}

/// Height over the floor.
pub(super) fn height(optics: &Optics, cell: usize, depth_m: f32, pose: &Isometry3<f64>) -> f64 {
    let p = optics.cell_point(cell, depth_m).map(f64::from);
    (pose * Point3::from(p)).z
}

pub(super) fn neighbors(optics: &Optics, cell: usize) -> impl Iterator<Item = usize> + use<> {
    let (across, count) = (optics.cells_across, optics.cell_count());
    let column = cell % across;
    [
        (column > 0).then(|| cell - 1),
        (column + 1 < across).then_some(cell + 1),
        cell.checked_sub(across),
        Some(cell + across).filter(|&below| below < count),
    ]
    .into_iter()
    .flatten()
}

/// The mask with a margin of [`MARGIN_M`], as wide in cells as it looks from here, wider by as much as the images are
/// likely displaced, and twice as wide where there is no depth.
pub(super) fn with_margin(
    optics: &Optics,
    (pose, coarse): (&Isometry3<f64>, &Coarse),
    masked: impl Iterator<Item = bool>,
) -> Vec<bool> {
    let cells_per_ray = optics.camera.fx as f32 / optics.stride as f32;
    let reach_of = |cell: usize| {
        let depth = coarse.depth_m[cell];
        let cells = if depth > 0.0 {
            let low = height(optics, cell, depth, pose) < ANKLE_M;
            let margin = if low { SHOE_M } else { MARGIN_M };
            (margin * cells_per_ray / depth).ceil() as usize
        } else {
            LEAST_MARGIN
        };
        (cells.max(LEAST_MARGIN) + coarse.slip / 2).min(MOST_MARGIN)
    };
    let mut moving: Vec<bool> = masked.collect();
    // Cells by how much farther the margin may go from them, in halves of a cell; the farthest first.
    let mut going: Vec<Vec<usize>> = vec![Vec::new(); 2 * MOST_MARGIN + 1];
    let rim = |&cell: &usize| moving[cell] && neighbors(optics, cell).any(|n| !moving[n]);
    for cell in (0..moving.len()).filter(rim) {
        going[2 * reach_of(cell)].push(cell);
    }
    for left in (1..going.len()).rev() {
        for cell in std::mem::take(&mut going[left]) {
            for n in neighbors(optics, cell) {
                let cost = if coarse.depth_m[n] > 0.0 { 2 } else { 1 };
                if !moving[n] && cost <= left {
                    moving[n] = true;
                    going[left - cost].push(n);
                }
            }
        }
    }
    moving
}

/// What is connected in depth, over so short a way that it is likely a part of the same, to something that moves.
pub(super) fn part_of_movers(optics: &Optics, coarse: &Coarse, pose: &Isometry3<f64>) -> Vec<bool> {
    let ray_step = optics.stride as f32 / optics.camera.fx as f32;
    let mut part = coarse.moving.clone();
    // The margin lies on what is behind.
    for _ in 0..CORE {
        let all = |cell: &usize| part[*cell] && neighbors(optics, *cell).all(|n| part[n]);
        let core: Vec<usize> = (0..part.len()).filter(all).collect();
        part.fill(false);
        for cell in core {
            part[cell] = true;
        }
    }
    let mut going: VecDeque<(usize, f32)> = (0..part.len())
        .filter(|&cell| part[cell] && coarse.depth_m[cell] > 0.0)
        .map(|cell| (cell, 0.0))
        .collect();
    while let Some((cell, way_m)) = going.pop_front() {
        let depth = coarse.depth_m[cell];
        let way_m = way_m + depth * ray_step;
        for n in neighbors(optics, cell) {
            let there = coarse.depth_m[n];
            let goes_on = !part[n] && way_m <= BODY_M && connected(depth, there);
            if goes_on && height(optics, n, there, pose) > FLOOR_M {
                part[n] = true;
                going.push_back((n, way_m));
            }
        }
    }
    part
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::features::tests::optics;

    #[test]
    fn a_patch_where_space_was_free_is_suspect_a_rim_and_a_drifted_view_are_not() {
        let optics = optics();
        let at = |column: usize, row: usize| row * optics.cells_across + column;
        let suspect = |columns: usize, label: Label, sound: u8| {
            let mut labels = vec![Label::Confirmed; optics.cell_count()];
            for row in 20..40 {
                for column in 50..50 + columns {
                    labels[at(column, row)] = label;
                }
            }
            let votes = vec![
                Votes {
                    sound,
                    ..Votes::default()
                };
                labels.len()
            ];
            suspicion(&optics, &votes, &labels)[at(51, 30)]
        };
        assert!((suspect(6, Label::Strong, 1) - DOUBT_STRONG).abs() < 1e-6);
        assert!((suspect(6, Label::Weak, 1) - DOUBT_WEAK).abs() < 1e-6);
        assert!(suspect(2, Label::Strong, 1) < 1e-6, "as thin as a rim");
        assert!(suspect(6, Label::Weak, 0) < 1e-6, "the frame has drifted");
        assert!(suspect(6, Label::Unknown, 1) < 1e-6);
    }

    #[test]
    fn what_hangs_on_a_mover_is_part_of_it_and_what_is_behind_is_not() {
        let optics = optics();
        let (across, count) = (optics.cells_across, optics.cell_count());
        // Somebody 2 m away, from the 40th to the 60th column, before a wall at 4 m: known to move down to the 30th row.
        let depth_m = (0..count).map(|c| {
            let is_body = (40..60).contains(&(c % across));
            if is_body { 2.0 } else { 4.0 }
        });
        let mut coarse = Coarse {
            depth_m: depth_m.collect(),
            moving: vec![false; count],
            ..Coarse::default()
        };
        for (cell, moving) in coarse.moving.iter_mut().enumerate() {
            // With a margin of two cells on the wall.
            *moving = (38..62).contains(&(cell % across)) && cell / across < 30;
        }
        // High over the floor.
        let part = part_of_movers(&optics, &coarse, &Isometry3::translation(0.0, 0.0, 99.0));
        let at = |column: usize, row: usize| part[row * across + column];
        assert!(at(50, 20) && at(50, 35) && at(41, 35), "the body");
        assert!(!at(36, 20) && !at(50 + 20, 35) && !at(36, 35), "the wall");
        let nobody = Coarse {
            moving: vec![false; count],
            ..coarse
        };
        let part = part_of_movers(&optics, &nobody, &Isometry3::identity());
        assert!(part.iter().all(|p| !p));
    }
}
