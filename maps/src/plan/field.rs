//! The cost of the way to the goal for a disc that fits inside the vehicle: a guide around obstacles for the search.
//!
//! Dijkstra's algorithm over the cells, from the goal outwards, eight neighbours each. The disc is the largest one around
//! the footprint's middle, with its margins and half a cell's diagonal of benefit of the doubt, so that where the disc
//! cannot go no vehicle can. It stops soon after the start is reached.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::cost::CostModel;
use super::footprint::Checker;

pub(crate) struct Field {
    /// By cell, row by row; infinite where not reached.
    costs: Vec<f32>,
    /// What every cell that was not reached costs at least; infinite if all that can be reached were.
    frontier: f32,
    width: usize,
}

/// How much farther than the start the field reaches: the detours a search may look at.
const MARGIN: f32 = 1.5;

impl Field {
    /// The field to any of `goals` (places of the footprint's middle), reaching to `start` and somewhat beyond.
    pub(crate) fn new(
        checker: &Checker<'_>,
        costs: &CostModel<'_>,
        goals: &[[f64; 2]],
        start: [f64; 2],
    ) -> Self {
        let grid = costs.grid();
        let (width, height) = grid.size();
        let index = |[x, y]: [f64; 2]| grid.index_of(x, y).map(|i| i.y * width + i.x);
        let mut field = Self {
            costs: vec![f32::INFINITY; width * height],
            frontier: f32::INFINITY,
            width,
        };
        let mut queue = BinaryHeap::new();
        for goal in goals.iter().filter_map(|&goal| index(goal)) {
            field.costs[goal] = 0.0;
            queue.push(Reverse(entry(0.0, goal)));
        }
        let (passable, per_metre) = (checker.disc_may_be(), costs.per_metre());
        let start = index(start);
        let mut enough = f32::INFINITY;
        let half = 0.5 * grid.resolution_m() as f32;
        while let Some(Reverse(next)) = queue.pop() {
            let (cost, at) = (f32::from_bits((next >> 32) as u32), next as u32 as usize);
            if cost > field.costs[at] {
                continue;
            }
            if cost > enough {
                field.frontier = cost;
                break;
            }
            if Some(at) == start {
                enough = cost * MARGIN + 1.0;
            }
            let (x, y) = (at % width, at / width);
            for (dx, dy, way) in NEIGHBOURS {
                let (Some(u), Some(v)) = (x.checked_add_signed(dx), y.checked_add_signed(dy))
                else {
                    continue;
                };
                if u >= width || v >= height || !passable[v * width + u] {
                    continue;
                }
                let to = v * width + u;
                let reached = cost + way * half * (per_metre[at] + per_metre[to]);
                if reached < field.costs[to] {
                    field.costs[to] = reached;
                    queue.push(Reverse(entry(reached, to)));
                }
            }
        }
        field
    }

    /// The cost from a cell to the goal; infinite if there is no way.
    pub(crate) fn cost_from(&self, x: usize, y: usize) -> f64 {
        f64::from(self.costs[y * self.width + x].min(self.frontier))
    }
}

/// Costs are not negative, so their bits are in their order.
fn entry(cost: f32, cell: usize) -> u64 {
    u64::from(cost.to_bits()) << 32 | cell as u64
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
    let everywhere = Field::new(checker, costs, &[start], [f64::NAN, f64::NAN]);
    costs
        .grid()
        .cells()
        .filter(|(index, _)| everywhere.cost_from(index.x, index.y).is_finite())
        .map(|(index, _)| {
            let [x, y] = costs.grid().center_of(index);
            (x - goal[0]).hypot(y - goal[1])
        })
        .fold(f64::INFINITY, f64::min)
}
