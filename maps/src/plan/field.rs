//! The cost of the way to the goal for a disc that fits inside the vehicle: a guide around obstacles for the search.
//!
//! Dijkstra's algorithm over the cells, from the goal outwards, eight neighbours each, as far as it is asked for. The disc is
//! the largest one around the footprint's middle, with its margins and half a cell's diagonal of benefit of the doubt, so
//! that where the disc cannot go no vehicle can. Where it fits by that benefit only, a metre counts [`DOUBTFUL`] times: the
//! guide is no lower bound there, and leads through such a gap only if there is no other way.
//!
//! It grows towards the start first: cells are taken by their cost and the straight way from there to the start, in a ring of
//! buckets (E. Denardo, B. Fox, *Shortest-route methods*, Operations Research 27, 1979; D. Silver, *Cooperative pathfinding*,
//! 2005, for the search backwards that is continued when asked). The costs do not depend on how far it was asked.

use super::cost::{CostModel, WORST_METRE};
use super::footprint::Checker;
use crate::traversability::{CellIndex, Traversability};

pub(crate) struct Field {
    /// By cell, row by row; infinite where not reached.
    costs: Vec<f32>,
    /// Cost of a metre by cell, not weighted; 0 where not looked at, infinite where the disc may not be.
    per_metre: Vec<f32>,
    buckets: Buckets,
    /// The bucket under way, counted from the first: every smaller cost is final.
    level: usize,
    width: usize,
    resolution_m: f32,
    /// 1 / `resolution_m`
    per_resolution: f32,
    /// By how much a metre in each cell counts more; empty if all count as they cost.
    weights: Vec<f32>,
    /// Where it grows to first, in cells.
    towards: Option<[f32; 2]>,
}

/// Cells with the cost they had when they came in, in a ring of stacks that share their memory.
struct Buckets {
    /// By bucket: the uppermost entry.
    tops: Vec<u32>,
    entries: Vec<Entry>,
    /// The first of the entries that are not in use.
    unused: u32,
    /// Entries in all buckets.
    waiting: usize,
}

#[derive(Clone, Copy)]
struct Entry {
    cell: u32,
    cost: f32,
    /// The one below.
    below: u32,
}

const NO_ENTRY: u32 = u32::MAX;

impl Buckets {
    fn new() -> Self {
        Self {
            tops: vec![NO_ENTRY; BUCKETS],
            entries: Vec::new(),
            unused: NO_ENTRY,
            waiting: 0,
        }
    }

    fn push(&mut self, bucket: usize, cell: u32, cost: f32) {
        let top = &mut self.tops[bucket % BUCKETS];
        let below = std::mem::replace(top, self.unused);
        let entry = Entry { cell, cost, below };
        if let Some(slot) = self.entries.get_mut(*top as usize) {
            self.unused = std::mem::replace(slot, entry).below;
        } else {
            *top = self.entries.len() as u32;
            self.entries.push(entry);
        }
        self.waiting += 1;
    }

    fn pop(&mut self, bucket: usize) -> Option<(u32, f32)> {
        let top = &mut self.tops[bucket % BUCKETS];
        let slot = self.entries.get_mut(*top as usize)?;
        let Entry { cell, cost, below } = *slot;
        slot.below = std::mem::replace(&mut self.unused, *top);
        *top = below;
        self.waiting -= 1;
        Some((cell, cost))
    }
}

/// How much dearer a metre is where the disc fits with the benefit of the doubt only: most gaps that narrow are none.
const DOUBTFUL: f32 = 10.0;
/// What a metre costs at most.
const DEAREST: f32 = DOUBTFUL * WORST_METRE as f32;
/// Goals may differ by this many buckets.
const SPREAD: usize = 24 * FINE;
/// Buckets for what a step in the open costs.
const FINE: usize = 4;
/// More than what the dearest step can be worth.
const BUCKETS: usize =
    (FINE * ((DOUBTFUL as f64 * WORST_METRE * std::f64::consts::SQRT_2) as usize + 6) + SPREAD)
        .next_power_of_two();
/// Of the straight way to the start; less than all of it, so that rounding cannot turn the order of cells.
const STRAIGHT: f32 = 0.999;

impl Field {
    /// The field to any of `goals` (places of the footprint's middle), to be asked about the way from `start` mostly.
    pub(crate) fn new(grid: &Traversability, goals: &[[f64; 2]], start: Option<[f64; 2]>) -> Self {
        let (width, height) = grid.size();
        let mut field = Self {
            costs: vec![f32::INFINITY; width * height],
            per_metre: vec![0.0; width * height],
            buckets: Buckets::new(),
            level: 0,
            width,
            resolution_m: grid.resolution_m() as f32,
            per_resolution: grid.resolution_m().recip() as f32,
            weights: Vec::new(),
            towards: start
                .and_then(|[x, y]| grid.nearest_index(x, y))
                .map(|cell| [cell.x as f32, cell.y as f32]),
        };
        let goals: Vec<usize> = (goals.iter())
            .filter_map(|&[x, y]| grid.index_of(x, y))
            .map(|index| index.y * width + index.x)
            .collect();
        for &goal in &goals {
            field.costs[goal] = 0.0;
        }
        let span = |field: &Self| {
            let buckets = || goals.iter().map(|&goal| field.bucket_of(goal));
            buckets().min().zip(buckets().max()).unwrap_or((0, 0))
        };
        let (mut least, most) = span(&field);
        if most - least > SPREAD {
            // The ring does not hold goals that are so different: from all sides at once.
            field.towards = None;
            least = 0;
        }
        field.level = least;
        for goal in goals {
            field.push(goal % width, goal / width);
        }
        field
    }

    /// Lets a metre in each cell count so many times.
    pub(crate) fn weighted(mut self, weights: Vec<f32>) -> Self {
        self.weights = weights;
        self
    }

    /// Spares looking again at what another field of the same problem knows of the cells.
    pub(crate) fn with_ground_of(mut self, other: &Self) -> Self {
        self.per_metre.copy_from_slice(&other.per_metre);
        self
    }

    /// The cost from a cell to the goal; infinite if there is no way.
    pub(crate) fn cost_from(
        &mut self,
        checker: &Checker<'_>,
        costs: &CostModel<'_>,
        cell: CellIndex,
    ) -> f64 {
        let at = cell.y * self.width + cell.x;
        while self.buckets.waiting > 0 && self.bucket_of(at) >= self.level {
            self.advance(checker, costs);
        }
        f64::from(self.costs[at])
    }

    /// Which bucket a cell belongs to, counted from the first.
    fn bucket_of(&self, cell: usize) -> usize {
        self.bucket_at(cell % self.width, cell / self.width)
    }

    fn bucket_at(&self, x: usize, y: usize) -> usize {
        let left = self.towards.map_or(0.0, |[to_x, to_y]| {
            let (dx, dy) = (x as f32 - to_x, y as f32 - to_y);
            STRAIGHT * (dx * dx + dy * dy).sqrt()
        });
        // Saturates where a cell was not reached.
        ((self.costs[y * self.width + x] * self.per_resolution + left) * FINE as f32) as usize
    }

    fn push(&mut self, x: usize, y: usize) {
        let cell = y * self.width + x;
        self.buckets
            .push(self.bucket_at(x, y), cell as u32, self.costs[cell]);
    }

    /// Empties the bucket under way.
    fn advance(&mut self, checker: &Checker<'_>, costs: &CostModel<'_>) {
        while let Some((cell, cost)) = self.buckets.pop(self.level) {
            // Otherwise a cheaper way was found, and that has its own entry.
            if self.costs[cell as usize].to_bits() == cost.to_bits() {
                self.spread(checker, costs, cell as usize);
            }
        }
        self.level += 1;
    }

    fn spread(&mut self, checker: &Checker<'_>, costs: &CostModel<'_>, at: usize) {
        let (width, height) = (self.width, self.costs.len() / self.width);
        let (x, y) = (at % width, at / width);
        let (cost, here) = (self.costs[at], self.metre_in(checker, costs, x, y));
        // A goal may be where the disc may not.
        let here = if here.is_finite() { here } else { 1.0 };
        for (dx, dy, way) in NEIGHBOURS {
            let (Some(u), Some(v)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else {
                continue;
            };
            if u >= width || v >= height {
                continue;
            }
            let to = v * width + u;
            if self.costs[to] <= cost {
                continue;
            }
            let there = self.metre_in(checker, costs, u, v);
            let reached = cost + 0.5 * way * self.resolution_m * (here + there);
            if reached < self.costs[to] {
                self.costs[to] = reached;
                self.push(u, v);
            }
        }
    }

    fn metre_in(
        &mut self,
        checker: &Checker<'_>,
        costs: &CostModel<'_>,
        x: usize,
        y: usize,
    ) -> f32 {
        let at = y * self.width + x;
        let mut metre = self.per_metre[at];
        if metre <= 0.0 {
            metre = ground_at(checker, costs, CellIndex { x, y });
            self.per_metre[at] = metre;
        }
        match self.weights.get(at) {
            // The ring of buckets has room for no more.
            Some(weight) if metre.is_finite() => (metre * weight).min(DEAREST),
            _ => metre,
        }
    }
}

/// Cost of a metre in a cell, not weighted; infinite where the disc may not be.
fn ground_at(checker: &Checker<'_>, costs: &CostModel<'_>, cell: CellIndex) -> f32 {
    if !checker.disc_may_be(cell) {
        return f32::INFINITY;
    }
    let doubt = if checker.disc_surely_fits(cell) {
        1.0
    } else {
        DOUBTFUL
    };
    costs.of_metre(cell) as f32 * doubt
}

const NEIGHBOURS: [(isize, isize, f32); 8] = [
    (1, 0, 1.0),
    (0, 1, 1.0),
    (-1, 0, 1.0),
    (0, -1, 1.0),
    (1, 1, std::f32::consts::SQRT_2),
    (-1, 1, std::f32::consts::SQRT_2),
    (1, -1, std::f32::consts::SQRT_2),
    (-1, -1, std::f32::consts::SQRT_2),
];

/// The least distance to `goal` among the cells that a disc at `start` can reach.
pub(crate) fn nearest_reachable(
    checker: &Checker<'_>,
    costs: &CostModel<'_>,
    start: [f64; 2],
    goal: [f64; 2],
) -> f64 {
    let grid = checker.grid();
    let mut field = Field::new(grid, &[start], None);
    while field.buckets.waiting > 0 {
        field.advance(checker, costs);
    }
    (grid.cells().zip(&field.costs))
        .filter(|(_, cost)| cost.is_finite())
        .map(|((index, _), _)| {
            let [x, y] = grid.center_of(index);
            (x - goal[0]).hypot(y - goal[1])
        })
        .fold(f64::INFINITY, f64::min)
}
