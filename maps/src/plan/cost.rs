//! What a metre costs, by where it is and how it is driven.
//!
//! ```text
//! cost = ∫ (1 + terrain + 2·(1 - c/c₀)²) ds  · reverse factor      (the last term for clearance c < c₀ only)
//! ```
//!
//! `c` is the room beside the vehicle: the distance of its middle to the nearest blocked cell less half its width.

use super::footprint::Footprint;
use super::motion::{Gear, Motion, Pose2};
use super::{PlanLimits, Unknown};
use crate::traversability::{Cell, CellIndex, Traversability};

/// How much worse a metre along an obstacle is than one in the open.
const NEARNESS_WEIGHT: f64 = 2.0;

/// What bad ground adds to a metre at most, so that costs stay comparable.
const WORST_TERRAIN: f64 = 50.0;
/// What a metre costs at most.
pub(crate) const WORST_METRE: f64 = 1.0 + WORST_TERRAIN + NEARNESS_WEIGHT;

#[derive(Clone)]
pub(crate) struct CostModel<'a> {
    grid: &'a Traversability,
    footprint: Footprint,
    unknown_cost: f64,
    preferred_clearance_m: f64,
    /// What a metre forward and one in reverse is worth.
    factors: [f64; 2],
    gear_change_m: f64,
}

impl<'a> CostModel<'a> {
    pub(crate) fn new(
        grid: &'a Traversability,
        footprint: &Footprint,
        limits: &PlanLimits,
    ) -> Self {
        Self {
            grid,
            footprint: *footprint,
            unknown_cost: match limits.unknown {
                // Only what is under the vehicle at the start.
                Unknown::Avoid => 0.0,
                Unknown::Cross { cost } => cost,
            },
            preferred_clearance_m: limits.preferred_clearance_m,
            factors: [1.0, limits.reverse_factor],
            gear_change_m: limits.gear_change_m,
        }
    }

    /// The same for motions that are driven backwards.
    pub(crate) fn reversed(&self) -> Self {
        let [forward, reverse] = self.factors;
        Self {
            factors: [reverse, forward],
            ..self.clone()
        }
    }

    /// Cost of a metre in a cell: at least 1.
    pub(crate) fn of_metre(&self, cell: CellIndex) -> f64 {
        let terrain = match self.grid.cell_at(cell) {
            Cell::Drivable { cost, .. } => cost,
            Cell::Blocked => 0.0,
            Cell::Unknown => self.unknown_cost,
        };
        let terrain = if terrain > 0.0 {
            terrain.min(WORST_TERRAIN)
        } else {
            0.0 // so does a NaN
        };
        let distance = f64::from(self.grid.to_blocked()[cell.y * self.grid.size().0 + cell.x]);
        let room = (distance - self.footprint.inradius()).max(0.0);
        let near = if room < self.preferred_clearance_m {
            1.0 - room / self.preferred_clearance_m
        } else {
            0.0
        };
        1.0 + terrain + NEARNESS_WEIGHT * near * near
    }

    /// Cost of driving `motion` from `from`.
    pub(crate) fn of_motion(&self, from: &Pose2, motion: &Motion) -> f64 {
        let length = motion.length_m();
        let samples = (length / (1.5 * self.grid.resolution_m())).ceil().max(1.0);
        let apart = length / samples;
        let mean = (0..samples as usize)
            .map(|i| self.at(&motion.at(from, (i as f64 + 0.5) * apart)))
            .sum::<f64>()
            / samples;
        mean * self.of_length(motion)
    }

    /// The least that driving `motion` costs, wherever it is.
    pub(crate) fn of_length(&self, motion: &Motion) -> f64 {
        match motion.gear() {
            Gear::Forward => motion.length_m() * self.factors[0],
            Gear::Reverse => motion.length_m() * self.factors[1],
        }
    }

    /// Cost of driving in `next` after driving in `before`.
    pub(crate) fn of_change(&self, before: Option<Gear>, next: Gear) -> f64 {
        if before.is_some_and(|gear| gear != next) {
            self.gear_change_m
        } else {
            0.0
        }
    }

    /// Cost of driving motions one after the other from `from`, after driving in `before`.
    pub(crate) fn of_chain(&self, from: &Pose2, before: Option<Gear>, motions: &[Motion]) -> f64 {
        let (mut cost, mut pose, mut gear) = (0.0, *from, before);
        for motion in motions {
            cost += self.of_change(gear, motion.gear()) + self.of_motion(&pose, motion);
            pose = motion.end(&pose);
            gear = Some(motion.gear());
        }
        cost
    }

    /// The least that motions one after the other cost, wherever they are.
    pub(crate) fn at_least(&self, before: Option<Gear>, motions: &[Motion]) -> f64 {
        let (mut cost, mut gear) = (0.0, before);
        for motion in motions {
            cost += self.of_change(gear, motion.gear()) + self.of_length(motion);
            gear = Some(motion.gear());
        }
        cost
    }

    fn at(&self, pose: &Pose2) -> f64 {
        let [x, y] = self.footprint.center(pose);
        (self.grid.nearest_index(x, y)).map_or(1.0, |cell| self.of_metre(cell))
    }
}
