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
use crate::traversability::{Cell, Traversability};

/// How much worse a metre along an obstacle is than one in the open.
const NEARNESS_WEIGHT: f64 = 2.0;

pub(crate) struct CostModel<'a> {
    grid: &'a Traversability,
    footprint: Footprint,
    /// Cost of a metre by cell, row by row.
    per_metre: Vec<f32>,
    reverse_factor: f64,
    gear_change_m: f64,
}

impl<'a> CostModel<'a> {
    pub(crate) fn new(
        grid: &'a Traversability,
        footprint: &Footprint,
        limits: &PlanLimits,
    ) -> Self {
        let unknown_cost = match limits.unknown {
            // Only what is under the vehicle at the start.
            Unknown::Avoid => 0.0,
            Unknown::Cross { cost } => cost,
        };
        let room_needed = footprint.inradius();
        let per_metre = (grid.cells().zip(grid.to_blocked()))
            .map(|((_, cell), &distance)| {
                let terrain = match cell {
                    Cell::Drivable { cost, .. } if cost >= 0.0 => cost,
                    Cell::Drivable { .. } | Cell::Blocked => 0.0,
                    Cell::Unknown => unknown_cost,
                };
                let room = (f64::from(distance) - room_needed).max(0.0);
                let near = if room < limits.preferred_clearance_m {
                    1.0 - room / limits.preferred_clearance_m
                } else {
                    0.0
                };
                (1.0 + terrain + NEARNESS_WEIGHT * near * near) as f32
            })
            .collect();
        Self {
            grid,
            footprint: *footprint,
            per_metre,
            reverse_factor: limits.reverse_factor,
            gear_change_m: limits.gear_change_m,
        }
    }

    /// Cost of a metre by cell, row by row.
    pub(crate) fn per_metre(&self) -> &[f32] {
        &self.per_metre
    }

    pub(crate) fn grid(&self) -> &'a Traversability {
        self.grid
    }

    pub(crate) fn footprint(&self) -> &Footprint {
        &self.footprint
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
            Gear::Forward => motion.length_m(),
            Gear::Reverse => motion.length_m() * self.reverse_factor,
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
        let (width, _) = self.grid.size();
        self.grid
            .nearest_index(x, y)
            .map_or(1.0, |i| f64::from(self.per_metre[i.y * width + i.x]))
    }
}
