//! What the surface is like around each place: a flat piece, a thin line, or neither, from the points nearby.
//!
//! Points are summed up in cubic cells. The 27 cells around one give the mean `μ` and the covariance `C` of its
//! neighbourhood, and the eigenvalues `λ₀ ≤ λ₁ ≤ λ₂` of `C` say what is there: a plane is thin along one axis, a line along
//! two. A plane tells the distance along its normal only, a line those across it: how far a point is from one along the
//! surface is not information but an accident of sampling.
//!
//! Errors within a surface are alike. A wall along the axes of the map is off by up to half a voxel as a whole, however many
//! voxels it has, and if it is seen in two layers at one end and in one at the other, it is turned. Surfaces that err
//! together are therefore one *group* with one unknown small motion, of which [`Group::precision`] is known;
//! [`super::normal`] takes it out of the equations.
//!
//! - K. Koide et al., *Voxelized GICP for fast and accurate 3D point cloud registration*, ICRA 2021 (distributions of
//!   voxels in place of nearest neighbours).
//! - A. Segal et al., *Generalized-ICP*, RSS 2009 (planes against planes).

use std::hash::BuildHasherDefault;

use nalgebra::{Matrix3, Matrix6, SymmetricEigen, Vector3};
use rayon::prelude::*;

use super::cells::{Index, packed};

/// The greatest `λ₀ / λ₁` of a plane and `λ₁ / λ₂` of a line.
const THIN: f64 = 0.1;
/// The least `|z|` of a line's direction. Poles and trunks stand; a level line is as likely a ring that a lidar drew on the
/// floor, which is no feature of the world: it counts as nothing.
const UPRIGHT: f64 = 0.7;
/// Planes whose normal is within about 8° of an axis of the map err together along a whole layer of voxels.
const ALIGNED: f64 = 0.99;
/// Others do within a cube of this edge, and by this share of it, as their voxels are cut at many depths.
const GROUP_M: f64 = 2.0;
const CUT_SHARE: f64 = 0.35;
/// A group is taken to be no smaller than this when it tilts.
const LEAST_ARM_M: f64 = 0.5;
/// The mean of a bush depends on what was seen of it.
const BLOB_STD_M: f64 = 0.1;
/// How far off a group may be along its own surface: of that it tells nothing.
const SLIDE_STD_M: f64 = 10.0;

/// What a neighbourhood looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Shape {
    Plane,
    Line,
    Blob,
}

/// What becomes of neighbourhoods that are neither flat nor thin. Where their mean is depends on what was seen of them: they
/// help to come near, but would bend the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Blobs {
    Kept,
    Dropped,
}

/// The surface in a cell.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    /// The mean of the cell's own points.
    pub(super) center: Vector3<f64>,
    /// The mean of the neighbourhood.
    pub(super) mean: Vector3<f64>,
    /// The normal of a plane, the direction of a line.
    pub(super) axis: Vector3<f64>,
    /// How thick a plane or a line is, how wide a blob: the variance across it, in m².
    pub(super) variance: f64,
    pub(super) shape: Shape,
    pub(super) group: u32,
}

impl Surface {
    /// The surface of a neighbourhood: the mean of its own cell and that of all, and their covariance.
    pub(super) fn of(
        [center, mean]: [Vector3<f64>; 2],
        covariance: Matrix3<f64>,
        grain_m: f64,
    ) -> Option<Self> {
        let eigen = SymmetricEigen::new(covariance);
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let floor = grain_m * grain_m / 12.0;
        let [low, middle, high] = order.map(|at| eigen.eigenvalues[at].max(floor));
        let axis_of = |at: usize| Vector3::from(eigen.eigenvectors.column(order[at]));
        let (shape, axis, variance) = if middle < THIN * high {
            let direction = axis_of(2);
            if direction.z.abs() < UPRIGHT {
                return None;
            }
            (Shape::Line, direction, middle)
        } else if low < THIN * middle {
            (Shape::Plane, axis_of(0), low)
        } else {
            (Shape::Blob, axis_of(2), (low + middle + high) / 3.0)
        };
        let finite = mean.iter().chain(&axis).all(|c| c.is_finite());
        finite.then_some(Self {
            center,
            mean,
            axis,
            variance: variance + floor,
            shape,
            group: 0,
        })
    }

    /// The part of an offset from the surface that the surface can tell.
    pub(super) fn across(&self, offset: &Vector3<f64>) -> Vector3<f64> {
        let along_axis = self.axis * self.axis.dot(offset);
        match self.shape {
            Shape::Plane => along_axis,
            Shape::Line => offset - along_axis,
            Shape::Blob => *offset,
        }
    }

    /// The unit vectors along which the surface tells the distance from it.
    pub(super) fn told(&self) -> impl Iterator<Item = Vector3<f64>> {
        let (all, count) = match self.shape {
            Shape::Plane => ([self.axis; 3], 1),
            Shape::Line => {
                let least = Vector3::ith(self.axis.iamin(), 1.0);
                let across = self.axis.cross(&least).normalize();
                ([across, self.axis.cross(&across), across], 2)
            }
            Shape::Blob => ([Vector3::x(), Vector3::y(), Vector3::z()], 3),
        };
        all.into_iter().take(count)
    }

    /// Whether a piece of surface with this shape and axis may be the same one.
    pub(super) fn may_be(&self, shape: Shape, axis: &Vector3<f64>) -> bool {
        match (self.shape, shape) {
            (Shape::Plane, Shape::Plane) | (Shape::Line, Shape::Line) => {
                self.axis.dot(axis).abs() > 0.7 // 45°
            }
            (Shape::Plane, Shape::Line) | (Shape::Line, Shape::Plane) => {
                self.axis.dot(axis).abs() < 0.7
            }
            _ => true,
        }
    }
}

/// Surfaces that are off together, by a small motion about their middle.
#[derive(Clone, Debug)]
pub(super) struct Group {
    pub(super) middle: Vector3<f64>,
    /// The inverse of the covariance of that motion, translation before rotation.
    pub(super) precision: Matrix6<f64>,
}

/// All surfaces at one size of cell.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub(super) cell_m: f64,
    pub(super) surfaces: Vec<Surface>,
    pub(super) groups: Vec<Group>,
    /// The median standard deviation across the planes and lines.
    pub(super) typical_std_m: f64,
    /// Where in `surfaces` the surface of a cell is; cells without a shape have none.
    index: Index,
}

impl Level {
    /// The surfaces of cells, each with its key.
    pub(super) fn new(shaped: Vec<(u64, Surface)>, cell_m: f64, grain_m: f64) -> Self {
        let mut index =
            Index::with_capacity_and_hasher(shaped.len(), BuildHasherDefault::default());
        let mut surfaces = Vec::with_capacity(shaped.len());
        for (at, (key, surface)) in shaped.into_iter().enumerate() {
            index.insert(key, at as u32);
            surfaces.push(surface);
        }
        Self {
            cell_m,
            typical_std_m: typical_std(&surfaces, grain_m),
            groups: grouped(&mut surfaces, grain_m),
            surfaces,
            index,
        }
    }

    /// The surface at a place: that of its cell or else the nearest of the six beside it.
    pub(super) fn find(&self, p: &Vector3<f64>) -> Option<&Surface> {
        let key = p.map(|c| (c / self.cell_m).floor() as i32);
        if let Some(surface) = self.at(key) {
            return Some(surface);
        }
        let beside = (0..3).flat_map(|axis| [-1, 1].map(|step| (axis, step)));
        beside
            .filter_map(|(axis, step)| {
                let mut key = key;
                key[axis] = key[axis].saturating_add(step);
                self.at(key)
            })
            .min_by(|a, b| {
                let far = |s: &Surface| (s.center - p).norm_squared();
                far(a).total_cmp(&far(b))
            })
    }

    fn at(&self, key: Vector3<i32>) -> Option<&Surface> {
        let at = *self.index.get(&packed(key)?)?;
        self.surfaces.get(at as usize)
    }
}

fn typical_std(surfaces: &[Surface], grain_m: f64) -> f64 {
    let mut variances: Vec<f64> = surfaces
        .iter()
        .filter(|surface| surface.shape != Shape::Blob)
        .map(|surface| surface.variance)
        .collect();
    variances.sort_by(f64::total_cmp);
    variances
        .get(variances.len() / 2)
        .map_or(grain_m, |v| v.sqrt())
}

/// Numbers the groups of the surfaces, in the order of their keys, and tells how well each is placed.
fn grouped(surfaces: &mut [Surface], grain_m: f64) -> Vec<Group> {
    let mut keyed: Vec<(GroupKey, usize)> = surfaces
        .iter()
        .enumerate()
        .map(|(at, surface)| (group_key(surface, grain_m), at))
        .collect();
    keyed.par_sort_unstable();
    let mut groups = Vec::new();
    for same in keyed.chunk_by(|a, b| a.0 == b.0) {
        for &(_, at) in same {
            surfaces[at].group = groups.len() as u32;
        }
        let members: Vec<&Surface> = same.iter().map(|(_, at)| &surfaces[*at]).collect();
        let (aligned, shape, ..) = same[0].0;
        groups.push(group(&members, aligned, shape, grain_m));
    }
    groups
}

fn group(members: &[&Surface], aligned: bool, shape: Shape, grain_m: f64) -> Group {
    let count = members.len() as f64;
    let middle = members.iter().map(|s| s.mean).sum::<Vector3<f64>>() / count;
    let spread = members
        .iter()
        .map(|s| (s.mean - middle).norm_squared())
        .sum::<f64>()
        / count;
    let axis = dominant(members.iter().map(|s| s.axis * s.axis.transpose()).sum());
    let along = axis * axis.transpose();
    let across = Matrix3::identity() - along;
    let grain_std = grain_m / 12.0_f64.sqrt();
    let std = if aligned {
        grain_std
    } else {
        CUT_SHARE * grain_std
    };
    let (tight, loose) = (std.powi(-2), SLIDE_STD_M.powi(-2));
    let offset = match shape {
        Shape::Plane => along * tight + across * loose,
        Shape::Line => across * tight + along * loose,
        Shape::Blob => Matrix3::identity() * BLOB_STD_M.powi(-2),
    };
    // Tilted so that its ends are off by as much as the whole is.
    let tilt = Matrix3::identity() * tight * spread.max(LEAST_ARM_M.powi(2));
    let mut precision = Matrix6::zeros();
    precision.fixed_view_mut::<3, 3>(0, 0).copy_from(&offset);
    precision.fixed_view_mut::<3, 3>(3, 3).copy_from(&tilt);
    Group { middle, precision }
}

/// Whether aligned with the axes, the shape, the axis it is most along, and the layer or the cube it is in.
type GroupKey = (bool, Shape, usize, [i32; 3]);

fn group_key(surface: &Surface, grain_m: f64) -> GroupKey {
    let axis = surface.axis.iamax();
    let aligned = surface.shape == Shape::Plane && surface.axis[axis].abs() > ALIGNED;
    let place = if aligned {
        [(surface.mean[axis] / grain_m).floor() as i32, 0, 0]
    } else {
        surface.mean.map(|c| (c / GROUP_M).floor() as i32).into()
    };
    (aligned, surface.shape, axis, place)
}

/// The eigenvector of the greatest eigenvalue.
fn dominant(symmetric: Matrix3<f64>) -> Vector3<f64> {
    let eigen = SymmetricEigen::new(symmetric);
    eigen.eigenvectors.column(eigen.eigenvalues.imax()).into()
}
