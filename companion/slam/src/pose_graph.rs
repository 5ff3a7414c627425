//! Poses that are tied to one another by what was measured between them: what a closed loop is spread over.
//!
//! ```text
//! Σ ρ(eᵀ·Ω·e) + what ties them to the world outside ([`outside`])      E = Z⁻¹·Tᵢ⁻¹·Tⱼ,   e = (translation of E, rotation vector of E)
//! ∂e/∂ξⱼ = diag(R_E, J_r⁻¹)      ∂e/∂ξᵢ = -∂e/∂ξⱼ · Ad(Tⱼ⁻¹·Tᵢ)
//! ```
//!
//! with right perturbations as in [`crate::solver`]. Levenberg-Marquardt. Edges of doubtful origin, the loops, have Geman
//! and `McClure`'s kernel, which gives up on an edge that all others contradict; it starts so wide that it is convex and is
//! narrowed step by step, so that a right edge is not given up only because the drift it corrects is large.
//!
//! - G. Grisetti et al., *A Tutorial on Graph-Based SLAM*, IEEE ITS Magazine 2010.
//! - H. Yang et al., *Graduated Non-Convexity for Robust Spatial Perception*, RA-L 2020, section III.

mod outside;

use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3, Vector6};

use crate::blocks::BlockSystem;
use crate::solver::boxplus;
use outside::{Anchor, UNKNOWNS};
pub(crate) use outside::{Outside, Position, Upright};

/// Whether an edge may be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trust {
    /// It was tracked.
    Certain,
    /// It was recognised: outvoted if all others contradict it.
    Robust,
}

/// What was measured between two poses.
#[derive(Clone, Debug)]
pub(crate) struct Edge {
    pub(crate) from: usize,
    pub(crate) to: usize,
    /// The pose of `to` in the frame of `from`.
    pub(crate) from_from_to: Isometry3<f64>,
    /// Inverse covariance of its right perturbation, translation first.
    pub(crate) information: Matrix6<f64>,
    pub(crate) trust: Trust,
}

/// Poses and what is known of them.
#[derive(Clone, Debug)]
pub(crate) struct PoseGraph {
    /// Where the poses are thought to be.
    pub(crate) poses: Vec<Isometry3<f64>>,
    /// The pose that stays where it is.
    pub(crate) fixed: usize,
    pub(crate) edges: Vec<Edge>,
    pub(crate) outside: Outside,
}

/// Why a graph was not solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum GraphError {
    /// Some poses are not tied to the fixed one.
    #[error("{loose} of {poses} poses are not tied to the fixed one")]
    Disconnected { loose: usize, poses: usize },
    /// An edge, a tie to the world outside or the fixed pose names a pose that is not there.
    #[error("pose {index} of {poses} is named")]
    NoSuchPose { index: usize, poses: usize },
    /// A number is NaN or infinite, or a covariance or information is not positive definite.
    #[error("a number in the graph makes no sense")]
    Senseless,
}

/// 99 % quantile of χ² with 6 degrees of freedom: more is doubtful.
const DOUBTFUL: f64 = 16.8;
/// How much the kernel is narrowed from one step to the next.
const NARROWING: f64 = 1.6;
/// Steps at most, and how many of them with the kernel at its final width.
const MOST_STEPS: usize = 60;
const FINAL_STEPS: usize = 8;

impl PoseGraph {
    /// The same with the poses, and what else is unknown, that fit best.
    pub(crate) fn solve(mut self) -> Result<Self, GraphError> {
        self.check()?;
        let anchor = Anchor {
            node: self.fixed,
            pose: self.poses[self.fixed],
        };
        let mut width = self.first_width();
        let mut damping = 1e-6;
        let mut final_steps = 0;
        for _ in 0..MOST_STEPS {
            let weights = self.weights(width);
            let cost = self.cost(&weights, &anchor);
            let step = self.linearise(&weights, &anchor, damping).solve();
            let before = (self.poses.clone(), self.outside.clone());
            let mut gain = 0.0;
            if let Some(step) = step {
                self.take(&step);
                gain = cost - self.cost(&weights, &anchor);
            }
            if gain > 0.0 {
                damping = (damping * 0.1f64).max(1e-9);
            } else {
                (self.poses, self.outside) = before;
                damping = (damping * 30.0).min(1e6);
            }
            if width > 1.0 {
                width = (width / NARROWING).max(1.0);
                continue;
            }
            final_steps += 1;
            let settled = gain >= 0.0 && gain < 1e-6 * cost + 1e-9 && damping < 1.0;
            if settled || final_steps > FINAL_STEPS {
                break;
            }
        }
        Ok(self)
    }

    fn take(&mut self, step: &[Vector6<f64>]) {
        let (poses, unknowns) = step.split_at(self.poses.len());
        for (pose, xi) in self.poses.iter_mut().zip(poses) {
            *pose = boxplus(pose, xi);
        }
        if let [earth, lean] = unknowns {
            self.outside = self.outside.stepped([earth, lean]);
        }
    }

    /// Whether all numbers make sense.
    fn check(&self) -> Result<(), GraphError> {
        let poses = self.poses.len();
        let ends = self.edges.iter().flat_map(|e| [e.from, e.to]);
        if let Some(index) = ends.chain([self.fixed]).find(|&i| i >= poses) {
            return Err(GraphError::NoSuchPose { index, poses });
        }
        let finite = |pose: &Isometry3<f64>| pose.to_homogeneous().iter().all(|c| c.is_finite());
        let edge = |e: &Edge| {
            finite(&e.from_from_to)
                && e.from != e.to
                && e.information.iter().all(|c| c.is_finite())
                && e.information.cholesky().is_some()
        };
        if !self.poses.iter().all(finite) || !self.edges.iter().all(edge) {
            return Err(GraphError::Senseless);
        }
        let loose = self.loose();
        if loose > 0 {
            return Err(GraphError::Disconnected { loose, poses });
        }
        self.outside.check(poses)
    }

    /// How many poses no chain of edges ties to the fixed one.
    fn loose(&self) -> usize {
        let mut neighbours = vec![Vec::new(); self.poses.len()];
        for edge in &self.edges {
            neighbours[edge.from].push(edge.to);
            neighbours[edge.to].push(edge.from);
        }
        let mut reached = vec![false; self.poses.len()];
        reached[self.fixed] = true;
        let mut open = vec![self.fixed];
        while let Some(node) = open.pop() {
            for &next in &neighbours[node] {
                if !std::mem::replace(&mut reached[next], true) {
                    open.push(next);
                }
            }
        }
        reached.iter().filter(|&&r| !r).count()
    }

    /// A width of the kernel at which the edge that is farthest off still pulls with most of its weight.
    fn first_width(&self) -> f64 {
        let doubtful = self.edges.iter().filter(|e| e.trust == Trust::Robust);
        let farthest = doubtful.map(|e| self.chi2(e)).fold(0.0, f64::max);
        (2.0 * farthest / DOUBTFUL).max(1.0)
    }

    fn error(&self, edge: &Edge) -> (Isometry3<f64>, Vector6<f64>) {
        let off =
            edge.from_from_to.inverse() * self.poses[edge.from].inverse() * self.poses[edge.to];
        let (t, r) = (off.translation.vector, off.rotation.scaled_axis());
        (off, Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z))
    }

    fn chi2(&self, edge: &Edge) -> f64 {
        let e = self.error(edge).1;
        e.dot(&(edge.information * e))
    }

    /// Geman and `McClure`'s weights at this width.
    fn weights(&self, width: f64) -> Vec<f64> {
        let of = |edge: &Edge| match edge.trust {
            Trust::Certain => 1.0,
            Trust::Robust => {
                let c = DOUBTFUL * width;
                (c / (c + self.chi2(edge))).powi(2)
            }
        };
        self.edges.iter().map(of).collect()
    }

    fn cost(&self, weights: &[f64], anchor: &Anchor) -> f64 {
        let weighted = self.edges.iter().zip(weights);
        let edges: f64 = weighted.map(|(e, w)| w * self.chi2(e)).sum();
        edges + self.outside.cost(&self.poses, anchor)
    }

    fn linearise(&self, weights: &[f64], anchor: &Anchor, damping: f64) -> BlockSystem {
        let mut system = BlockSystem::new(self.poses.len() + UNKNOWNS);
        for (edge, weight) in self.edges.iter().zip(weights) {
            let (off, e) = self.error(edge);
            let (by_from, by_to) = self.derivatives(edge, &off);
            let information = edge.information * *weight;
            let (from_side, to_side) = (
                by_from.transpose() * information,
                by_to.transpose() * information,
            );
            let moves = |node: usize| node != self.fixed || self.outside.rights();
            if moves(edge.from) {
                system.add_diagonal(edge.from, &(from_side * by_from));
                system.add_right(edge.from, &-(from_side * e));
            }
            if moves(edge.to) {
                system.add_diagonal(edge.to, &(to_side * by_to));
                system.add_right(edge.to, &-(to_side * e));
            }
            if moves(edge.from) && moves(edge.to) {
                system.add_pair(edge.from, edge.to, &(from_side * by_to));
            }
        }
        self.outside.add_to(&mut system, &self.poses, anchor);
        system.damp(damping);
        system
    }

    /// Of the error, by the perturbations of the edge's ends.
    fn derivatives(&self, edge: &Edge, off: &Isometry3<f64>) -> (Matrix6<f64>, Matrix6<f64>) {
        let mut by_to = Matrix6::zeros();
        by_to
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(off.rotation.to_rotation_matrix().matrix());
        by_to
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&inverse_right_jacobian(&off.rotation.scaled_axis()));
        let to_from_from = self.poses[edge.to].inverse() * self.poses[edge.from];
        (-(by_to * adjoint(&to_from_from)), by_to)
    }
}

/// How a perturbation on one side of a transform looks on the other, translation first.
fn adjoint(t: &Isometry3<f64>) -> Matrix6<f64> {
    let rotation = *t.rotation.to_rotation_matrix().matrix();
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    matrix
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(t.translation.vector.cross_matrix() * rotation));
    matrix
}

/// Of the logarithm of rotations.
fn inverse_right_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let angle = phi.norm();
    let hat = phi.cross_matrix();
    let square = if angle < 1e-4 {
        1.0 / 12.0
    } else {
        (1.0 - 0.5 * angle / (0.5 * angle).tan()) / (angle * angle)
    };
    Matrix3::identity() + 0.5 * hat + square * hat * hat
}

#[cfg(test)]
mod tests;
