//! What ties poses to the world outside, and what of that is unknown: how the Earth lies in the poses' world, and how
//! much an accelerometer leans.
//!
//! ```text
//! position    r = t + a - (R_ψ·e + s)         e east, north, up;   a from the pose to the antenna;   ψ, s unknown
//! upright     r = [R·(u - l)]_xy              u up, as felt in the axes of the pose;   l its lean, unknown, ~ N(0, σ_l²)
//! ```
//!
//! Positions alone leave the world where the fixed pose puts it. Uprights turn it so that z is up, about the fixed
//! pose and not about z. An accelerometer's bias, and a camera that is mounted a little askew, lean with the
//! camera: its turns tell them from how the world leans.

use nalgebra::{
    Isometry3, Matrix3, Matrix6, SMatrix, Translation3, UnitQuaternion, Vector3, Vector6,
};

use super::GraphError;
use crate::blocks::BlockSystem;
use crate::solver::huber;

/// A position that was measured at a pose.
#[derive(Clone, Debug)]
pub(crate) struct Position {
    pub(crate) node: usize,
    /// From the pose to the antenna, in the axes of the world.
    pub(crate) beside: Vector3<f64>,
    /// East, north, up.
    pub(crate) in_enu: Vector3<f64>,
    /// m².
    pub(crate) covariance: Matrix3<f64>,
}

/// Which way is up at a pose.
#[derive(Clone, Debug)]
pub(crate) struct Upright {
    pub(crate) node: usize,
    /// As felt, in the axes of the pose; of length 1.
    pub(crate) up: Vector3<f64>,
    pub(crate) sigma_rad: f64,
}

/// What ties poses to the world outside, and the unknowns in it.
#[derive(Clone, Debug)]
pub(crate) struct Outside {
    pub(crate) positions: Vec<Position>,
    pub(crate) world_from_enu: Isometry3<f64>,
    pub(crate) uprights: Vec<Upright>,
    /// As a vector of length 1 for 1 g.
    pub(crate) lean: Vector3<f64>,
}

impl Default for Outside {
    fn default() -> Self {
        Self {
            positions: Vec::new(),
            world_from_enu: Isometry3::identity(),
            uprights: Vec::new(),
            lean: Vector3::zeros(),
        }
    }
}

/// The lean of a calibrated accelerometer on a camera that is mounted within half a degree.
const LEAN_SIGMA: f64 = 0.01;
/// How upright the first pose is: it stands on a floor, and few are farther from level.
const FIRST_SIGMA_RAD: f64 = 0.005;
/// How well it stays where it is, and its heading what it is.
const HELD: f64 = 1e-4;
/// 99 % quantile of χ² with 2 degrees of freedom: more is doubtful.
const DOUBTFUL: f64 = 9.21;

/// Unknowns beside the poses: the Earth, then the lean.
pub(super) const UNKNOWNS: usize = 2;

impl Outside {
    pub(super) fn check(&self, poses: usize) -> Result<(), GraphError> {
        let named = self.positions.iter().map(|p| p.node);
        let mut named = named.chain(self.uprights.iter().map(|u| u.node));
        if let Some(index) = named.find(|&i| i >= poses) {
            return Err(GraphError::NoSuchPose { index, poses });
        }
        let is_sound = |p: &Position| {
            let numbers = p.in_enu.iter().chain(&p.beside).chain(&p.covariance);
            numbers.copied().all(f64::is_finite) && p.covariance.cholesky().is_some()
        };
        let is_upright = |u: &Upright| {
            u.up.iter().all(|c| c.is_finite()) && u.sigma_rad.is_finite() && u.sigma_rad > 0.0
        };
        let is_sound = self.positions.iter().all(is_sound) && self.uprights.iter().all(is_upright);
        is_sound.then_some(()).ok_or(GraphError::Senseless)
    }

    /// Whether the fixed pose may turn.
    pub(super) fn rights(&self) -> bool {
        !self.uprights.is_empty()
    }

    pub(super) fn cost(&self, poses: &[Isometry3<f64>], anchor: &Anchor) -> f64 {
        let position = |p: &Position| {
            let (r, information) = self.position_error(p, &poses[p.node]);
            r.dot(&(information * r))
        };
        let upright = |u: &Upright| {
            let r = self.upright_error(u, &poses[u.node]);
            huber(r.norm_squared(), DOUBTFUL).1
        };
        let mut cost = self.positions.iter().map(position).sum::<f64>()
            + self.uprights.iter().map(upright).sum::<f64>()
            + self.lean.norm_squared() / LEAN_SIGMA.powi(2);
        if self.rights() {
            let (e, information) = anchor.error(&poses[anchor.node]);
            cost += e.dot(&(information * e));
        }
        cost
    }

    /// The residual in the world's axes, and its information.
    fn position_error(&self, p: &Position, pose: &Isometry3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let turn = *self.world_from_enu.rotation.to_rotation_matrix().matrix();
        let there = turn * p.in_enu + self.world_from_enu.translation.vector;
        let covariance = turn * p.covariance * turn.transpose();
        let information = covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        (pose.translation.vector + p.beside - there, information)
    }

    /// The residual in standard deviations.
    fn upright_error(&self, u: &Upright, pose: &Isometry3<f64>) -> nalgebra::Vector2<f64> {
        (pose.rotation * (u.up - self.lean)).xy() / u.sigma_rad
    }

    pub(super) fn add_to(
        &self,
        system: &mut BlockSystem,
        poses: &[Isometry3<f64>],
        anchor: &Anchor,
    ) {
        let (earth, lean) = (poses.len(), poses.len() + 1);
        let moves = |node: usize| self.rights() || node != anchor.node;
        for p in &self.positions {
            let (r, information) = self.position_error(p, &poses[p.node]);
            // A step ξ moves the position by R·ρ, and the Earth by s and a turn about z.
            let rotation = *poses[p.node].rotation.to_rotation_matrix().matrix();
            let arm = self.world_from_enu.rotation * p.in_enu;
            let mut by_pose = SMatrix::<f64, 3, 6>::zeros();
            by_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
            let mut by_earth = SMatrix::<f64, 3, 6>::zeros();
            by_earth
                .fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&-Matrix3::identity());
            by_earth.set_column(3, &-Vector3::z().cross(&arm));
            let side = by_earth.transpose() * information;
            system.add_diagonal(earth, &(side * by_earth));
            system.add_right(earth, &-(side * r));
            if moves(p.node) {
                let side = by_pose.transpose() * information;
                system.add_diagonal(p.node, &(side * by_pose));
                system.add_right(p.node, &-(side * r));
                system.add_pair(p.node, earth, &(side * by_earth));
            }
        }
        for u in &self.uprights {
            let r = self.upright_error(u, &poses[u.node]);
            let weight = huber(r.norm_squared(), DOUBTFUL).0;
            let rotation = *poses[u.node].rotation.to_rotation_matrix().matrix() / u.sigma_rad;
            let by_turn = -(rotation * (u.up - self.lean).cross_matrix());
            let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
            by_pose
                .fixed_view_mut::<2, 3>(0, 3)
                .copy_from(&by_turn.fixed_rows::<2>(0));
            let mut by_lean = SMatrix::<f64, 2, 6>::zeros();
            by_lean
                .fixed_view_mut::<2, 3>(0, 0)
                .copy_from(&-rotation.fixed_rows::<2>(0));
            let (pose_side, lean_side) =
                (by_pose.transpose() * weight, by_lean.transpose() * weight);
            system.add_diagonal(u.node, &(pose_side * by_pose));
            system.add_right(u.node, &-(pose_side * r));
            system.add_diagonal(lean, &(lean_side * by_lean));
            system.add_right(lean, &-(lean_side * r));
            system.add_pair(u.node, lean, &(pose_side * by_lean));
        }
        let mut prior = Matrix6::identity();
        prior
            .fixed_view_mut::<3, 3>(0, 0)
            .fill_diagonal(LEAN_SIGMA.powi(-2));
        let mut pull = Vector6::zeros();
        pull.fixed_rows_mut::<3>(0)
            .copy_from(&(-self.lean * LEAN_SIGMA.powi(-2)));
        system.add_diagonal(lean, &prior);
        system.add_right(lean, &pull);
        // What is not unknown has an equation of its own: its step is zero.
        let known = if self.positions.is_empty() { 0 } else { 4 };
        system.add_diagonal(
            earth,
            &Matrix6::from_diagonal(&Vector6::from_fn(|i, _| if i < known { 0.0 } else { 1.0 })),
        );
        if self.rights() {
            anchor.add_to(system, &poses[anchor.node]);
        } else {
            system.add_diagonal(anchor.node, &Matrix6::identity());
        }
    }

    /// After a step of the unknowns.
    pub(super) fn stepped(&self, [earth, lean]: [&Vector6<f64>; UNKNOWNS]) -> Self {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), earth[3]);
        let shift = self.world_from_enu.translation.vector + earth.fixed_rows::<3>(0);
        Self {
            world_from_enu: Isometry3::from_parts(
                Translation3::from(shift),
                turn * self.world_from_enu.rotation,
            ),
            lean: self.lean + lean.fixed_rows::<3>(0),
            ..self.clone()
        }
    }
}

/// The fixed pose where it was at first: it stays there, but may be turned upright.
pub(super) struct Anchor {
    pub(super) node: usize,
    pub(super) pose: Isometry3<f64>,
}

impl Anchor {
    /// How far it went and how it turned, in the world's axes, and the information of that.
    fn error(&self, pose: &Isometry3<f64>) -> (Vector6<f64>, Matrix6<f64>) {
        let off = pose.translation.vector - self.pose.translation.vector;
        let turned = (pose.rotation * self.pose.rotation.inverse()).scaled_axis();
        let (held, first) = (HELD.powi(-2), FIRST_SIGMA_RAD.powi(-2));
        (
            Vector6::new(off.x, off.y, off.z, turned.x, turned.y, turned.z),
            Matrix6::from_diagonal(&Vector6::new(held, held, held, first, first, held)),
        )
    }

    fn add_to(&self, system: &mut BlockSystem, pose: &Isometry3<f64>) {
        let (e, information) = self.error(pose);
        // Both change by R·ξ.
        let rotation = *pose.rotation.to_rotation_matrix().matrix();
        let mut by = Matrix6::zeros();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
        by.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
        let side = by.transpose() * information;
        system.add_diagonal(self.node, &(side * by));
        system.add_right(self.node, &-(side * e));
    }
}
