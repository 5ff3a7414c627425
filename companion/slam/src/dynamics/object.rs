//! Which cells of its box belong to an object: its mask where the detector gives one, else its depth.
//!
//! A box shows the object and what is behind and beside it. The cells that measure depth fall into surfaces, connected
//! in depth; the object is the nearest of those that fill enough of the box's middle, with whatever else in the box is as
//! near as that: a second leg, an arm. The floor is never part of it.
//!
//! - J. Ji, W. Wang et al., *Towards Real-Time Semantic RGB-D SLAM in Dynamic Environments*, ICRA 2021 (clusters of depth in
//!   a detector's box).

use nalgebra::Isometry3;

use super::features::Count;
use super::region::{FLOOR_M, Label, connected, height, neighbors};
use crate::aid::{Mobility, Object, PixelMask};
use crate::optics::Optics;

/// Objects less sure than this are not believed.
const LEAST_SCORE: f32 = 0.3;
/// The least part of the box's middle that the object fills.
const LEAST_FILL: f32 = 0.2;
/// Other surfaces that are this much nearer or farther are parts of it.
const THICKNESS_M: f32 = 0.35;
/// A surface of which the map has confirmed this share is background, if there is another one.
const BACKGROUND_SHARE: f32 = 0.8;
/// An object that may move does so if that share of its surface stands where space was free, or is doubted.
const MOVING_SHARE: f64 = 0.25;

/// A frame as far as objects are concerned.
pub(super) struct View<'a> {
    pub(super) optics: &'a Optics,
    /// By cell; 0 where unknown.
    pub(super) depth_m: &'a [f32],
    pub(super) pose: &'a Isometry3<f64>,
}

/// Columns and rows of cells that a box covers, the last ones included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Span {
    columns: [usize; 2],
    rows: [usize; 2],
}

impl Span {
    fn cells(self, across: usize) -> impl Iterator<Item = usize> {
        (self.rows[0]..=self.rows[1])
            .flat_map(move |row| (self.columns[0]..=self.columns[1]).map(move |c| row * across + c))
    }

    fn contains(self, across: usize, cell: usize) -> bool {
        let (column, row) = (cell % across, cell / across);
        (self.columns[0]..=self.columns[1]).contains(&column)
            && (self.rows[0]..=self.rows[1]).contains(&row)
    }

    /// 1 in the middle, less towards the rim.
    fn weight(self, across: usize, cell: usize) -> f32 {
        let along = |v: usize, [low, high]: [usize; 2]| {
            let half = (high - low + 1) as f32 / 2.0;
            1.0 - ((v - low) as f32 + 0.5 - half).abs() / half
        };
        along(cell % across, self.columns) * along(cell / across, self.rows)
    }
}

/// A surface in a box.
struct Surface {
    cells: Vec<usize>,
    /// Share of the box's middle.
    fill: f32,
    depth_m: f32,
    background: bool,
}

/// Notes by cell in `named` what a detector sees that moves. Of what proves to move, all cells are certain.
pub(super) fn name(
    view: &View<'_>,
    objects: &[Object],
    (labels, counts): (&mut [Label], &[Count]),
    named: &mut [Option<u8>],
) {
    for object in objects {
        let cells = match object.mobility {
            Mobility::Static => continue,
            Mobility::Potential | Mobility::Dynamic => cells_of(view, object, labels),
        };
        let is_proven = is_moving(&cells, labels, counts);
        let moves = is_proven || object.mobility == Mobility::Dynamic;
        for cell in cells {
            // If it stands, what was remembered of it is no longer true.
            named[cell] = moves.then_some(0);
            if is_proven && labels[cell] != Label::Confirmed {
                labels[cell] = Label::Certain;
            }
        }
    }
}

/// Whether an object that may move does: by the free space it stands in, or by most of its features.
fn is_moving(cells: &[usize], labels: &[Label], counts: &[Count]) -> bool {
    let moves = |&&cell: &&usize| matches!(labels[cell], Label::Strong | Label::Certain);
    let moving = cells.iter().filter(moves).count();
    let sum = cells.iter().fold(Count::default(), |sum, &cell| Count {
        agree: sum.agree.saturating_add(counts[cell].agree),
        contradict: sum.contradict.saturating_add(counts[cell].contradict),
    });
    sum.moves() || (moving > 0 && moving as f64 >= MOVING_SHARE * cells.len() as f64)
}

/// The cells of an object; none if it is not believed or there is nothing to tell it by. Without a mask, of something that
/// may move or stand cells that a keyframe has confirmed are left out where they are the exception.
pub(super) fn cells_of(view: &View<'_>, object: &Object, labels: &[Label]) -> Vec<usize> {
    let Some(span) = span(view.optics, object) else {
        return Vec::new();
    };
    if let Some(mask) = &object.mask {
        return in_mask(view.optics, span, mask);
    }
    let nearest_is_whole = object.mobility == Mobility::Dynamic;
    let surfaces = surfaces(view, span, labels);
    let filling = || surfaces.iter().filter(|s| s.fill >= LEAST_FILL);
    let nearest = |a: &&Surface, b: &&Surface| a.depth_m.total_cmp(&b.depth_m);
    let seen = filling().filter(|s| !s.background).min_by(nearest);
    let Some(object) = seen.or_else(|| filling().min_by(nearest)) else {
        return Vec::new();
    };
    let whole = nearest_is_whole || object.background;
    let near = |s: &&Surface| (s.depth_m - object.depth_m).abs() < THICKNESS_M;
    surfaces
        .iter()
        .filter(near)
        .filter(|s| whole || !s.background)
        .flat_map(|s| &s.cells)
        .copied()
        .filter(|&cell| whole || labels[cell] != Label::Confirmed)
        .collect()
}

/// The cells that the object's box covers; `None` if there are none, or the detector is not sure or not sane.
fn span(optics: &Optics, object: &Object) -> Option<Span> {
    let sure = object.score >= LEAST_SCORE && object.score.is_finite();
    let [left, top, right, bottom] = object.bounds_px;
    if !sure || object.bounds_px.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let stride = optics.stride as f32;
    let cells = |low: f32, high: f32, count: usize| {
        // Cells whose middle is inside.
        let first = (low / stride - 0.5).ceil().max(0.0);
        let last = (high / stride - 0.5).floor().min(count as f32 - 1.0);
        (first <= last).then_some([first as usize, last as usize])
    };
    Some(Span {
        columns: cells(left, right, optics.cells_across)?,
        rows: cells(top, bottom, optics.cells_down)?,
    })
}

fn in_mask(optics: &Optics, span: Span, mask: &PixelMask) -> Vec<usize> {
    span.cells(optics.cells_across)
        .filter(|&cell| mask.contains(optics.cell_center(cell)))
        .collect()
}

/// The surfaces in a box, connected in depth, without the floor.
fn surfaces(view: &View<'_>, span: Span, labels: &[Label]) -> Vec<Surface> {
    let (optics, across) = (view.optics, view.optics.cells_across);
    let depth = |cell: usize| view.depth_m[cell];
    let usable =
        |cell: usize| depth(cell) > 0.0 && height(optics, cell, depth(cell), view.pose) > FLOOR_M;
    let mut open: Vec<bool> = vec![false; optics.cell_count()];
    let mut all = 0.0;
    for cell in span.cells(across) {
        open[cell] = usable(cell);
        all += span.weight(across, cell);
    }
    let mut found = Vec::new();
    for start in span.cells(across) {
        if !std::mem::take(&mut open[start]) {
            continue;
        }
        let mut cells = vec![start];
        let mut next = 0;
        while let Some(&cell) = cells.get(next) {
            next += 1;
            for n in neighbors(optics, cell).filter(|&n| span.contains(across, n)) {
                if open[n] && connected(depth(cell), depth(n)) {
                    open[n] = false;
                    cells.push(n);
                }
            }
        }
        let confirmed = cells.iter().filter(|&&c| labels[c] == Label::Confirmed);
        let background = confirmed.count() as f32 >= BACKGROUND_SHARE * cells.len() as f32;
        let weight: f32 = cells.iter().map(|&c| span.weight(across, c)).sum();
        let mut depths: Vec<f32> = cells.iter().map(|&c| depth(c)).collect();
        let middle = depths.len() / 2;
        let (_, &mut depth_m, _) = depths.select_nth_unstable_by(middle, f32::total_cmp);
        found.push(Surface {
            cells,
            fill: weight / all.max(f32::MIN_POSITIVE),
            depth_m,
            background,
        });
    }
    found
}
