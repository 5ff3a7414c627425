//! Local bundle adjustment: the poses of a few keyframes and the points they see, together.
//!
//! Levenberg-Marquardt on the residuals of [`crate::solver`]. Points are eliminated first (Schur complement), so that
//! only a system of 6 unknowns a keyframe is solved:
//!
//! ```text
//! | A  W | |δc|   |a|        S = A - W·B⁻¹·Wᵀ      S·δc = a - W·B⁻¹·b      δp = B⁻¹·(b - Wᵀ·δc)
//! | Wᵀ B | |δp| = |b|
//! ```
//!
//! - B. Triggs et al., *Bundle Adjustment: A Modern Synthesis*, 1999, section 6.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, SMatrix, Vector3, Vector6};

use crate::features::Feature;
use crate::map::{KeyframeId, Map, PointId};
use crate::optics::Optics;
use crate::solver::{DEPTH_GATE, PIXEL_GATE, Seen, boxplus, chi2, residual, robust};

type Matrix3x6 = SMatrix<f64, 3, 6>;
type Matrix6x3 = SMatrix<f64, 6, 3>;

/// One sighting of one point by one camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observation {
    pub(crate) camera: usize,
    pub(crate) point: usize,
    pub(crate) seen: Seen,
}

/// Cameras and points. Invariant: the observations are sorted by point.
pub(crate) struct Problem {
    /// `world_from_camera`; the first `free` of them are adjusted.
    pub(crate) cameras: Vec<Isometry3<f64>>,
    pub(crate) free: usize,
    pub(crate) points: Vec<Vector3<f64>>,
    pub(crate) observations: Vec<Observation>,
}

/// The normal equations with their points eliminated.
struct Reduced {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    points: Vec<Eliminated>,
}

/// What is needed to find a point's step from those of the cameras.
struct Eliminated {
    inverse: Matrix3<f64>,
    right: Vector3<f64>,
    /// `W` by free camera.
    links: Vec<(usize, Matrix6x3)>,
}

impl Problem {
    /// The robust cost.
    pub(crate) fn cost(&self, optics: &Optics) -> f64 {
        let inverses: Vec<Isometry3<f64>> = self.cameras.iter().map(Isometry3::inverse).collect();
        let of = |o: &Observation| {
            let q = inverses[o.camera] * Point3::from(self.points[o.point]);
            residual(optics, &q.coords, &o.seen).map_or(10.0 * PIXEL_GATE, |r| robust(&r.value).1)
        };
        self.observations.iter().map(of).sum()
    }

    /// Up to `steps` steps downhill.
    pub(crate) fn solve(&mut self, optics: &Optics, steps: usize) {
        let mut damping = 1e-4;
        let mut cost = self.cost(optics);
        for _ in 0..steps {
            let reduced = self.reduce(optics, damping);
            let Some(step) = reduced.matrix.cholesky().map(|c| c.solve(&reduced.right)) else {
                damping *= 30.0;
                continue;
            };
            let before = (self.cameras.clone(), self.points.clone());
            self.apply(&step, &reduced.points);
            let next = self.cost(optics);
            if next < cost {
                let gain = cost - next;
                cost = next;
                damping *= 0.1;
                if gain < 1e-3 * cost {
                    break;
                }
            } else {
                (self.cameras, self.points) = before;
                damping *= 30.0;
            }
        }
    }

    /// Which observations fail the χ² tests.
    pub(crate) fn outliers(&self, optics: &Optics) -> Vec<bool> {
        let of = |o: &Observation| {
            let q = self.cameras[o.camera].inverse() * Point3::from(self.points[o.point]);
            residual(optics, &q.coords, &o.seen).is_none_or(|r| {
                let (pixel, depth) = chi2(&r.value);
                pixel > PIXEL_GATE || depth > DEPTH_GATE
            })
        };
        self.observations.iter().map(of).collect()
    }

    fn reduce(&self, optics: &Optics, damping: f64) -> Reduced {
        let size = 6 * self.free;
        let inverses: Vec<Isometry3<f64>> = self.cameras.iter().map(Isometry3::inverse).collect();
        let rotations: Vec<Matrix3<f64>> = inverses
            .iter()
            .map(|i| *i.rotation.to_rotation_matrix().matrix())
            .collect();
        let mut matrix = DMatrix::zeros(size, size);
        let mut right = DVector::zeros(size);
        let mut points = Vec::with_capacity(self.points.len());
        let mut rest = self.observations.as_slice();
        for (index, point) in self.points.iter().enumerate() {
            let count = rest.iter().take_while(|o| o.point == index).count();
            let (mine, others) = rest.split_at(count);
            rest = others;
            let mut b = Matrix3::zeros();
            let mut eliminated = Eliminated {
                inverse: Matrix3::zeros(),
                right: Vector3::zeros(),
                links: Vec::with_capacity(count),
            };
            for o in mine {
                let q = (inverses[o.camera] * Point3::from(*point)).coords;
                let Some(r) = residual(optics, &q, &o.seen) else {
                    continue;
                };
                let weights = Matrix3::from_diagonal(&robust(&r.value).0);
                let by_point = r.by_point * rotations[o.camera];
                let weighted = by_point.transpose() * weights;
                b += weighted * by_point;
                eliminated.right -= weighted * r.value;
                if o.camera < self.free {
                    let mut j = Matrix3x6::zeros();
                    j.fixed_view_mut::<3, 3>(0, 0).copy_from(&-r.by_point);
                    j.fixed_view_mut::<3, 3>(0, 3)
                        .copy_from(&(r.by_point * q.cross_matrix()));
                    let at = 6 * o.camera;
                    let jw = j.transpose() * weights;
                    let mut block = matrix.fixed_view_mut::<6, 6>(at, at);
                    block += jw * j;
                    let mut part = right.fixed_rows_mut::<6>(at);
                    part -= jw * r.value;
                    eliminated.links.push((o.camera, jw * by_point));
                }
            }
            for i in 0..3 {
                b[(i, i)] += damping * b[(i, i)] + 1e-9;
            }
            eliminated.inverse = b.try_inverse().unwrap_or_else(Matrix3::zeros);
            points.push(eliminated);
        }
        for i in 0..size {
            matrix[(i, i)] += damping * matrix[(i, i)] + 1e-9;
        }
        complement(&mut matrix, &mut right, &points);
        Reduced {
            matrix,
            right,
            points,
        }
    }

    fn apply(&mut self, step: &DVector<f64>, eliminated: &[Eliminated]) {
        for (camera, pose) in self.cameras.iter_mut().take(self.free).enumerate() {
            let xi: Vector6<f64> = step.fixed_rows::<6>(6 * camera).into_owned();
            *pose = boxplus(pose, &xi);
        }
        for (point, e) in self.points.iter_mut().zip(eliminated) {
            let mut right = e.right;
            for (camera, link) in &e.links {
                right -= link.transpose() * step.fixed_rows::<6>(6 * camera);
            }
            *point += e.inverse * right;
        }
    }
}

fn complement(matrix: &mut DMatrix<f64>, right: &mut DVector<f64>, points: &[Eliminated]) {
    for e in points {
        for (row, w) in &e.links {
            let half: Matrix6x3 = w * e.inverse;
            let mut part = right.fixed_rows_mut::<6>(6 * row);
            part -= half * e.right;
            for (column, v) in &e.links {
                let mut block = matrix.fixed_view_mut::<6, 6>(6 * row, 6 * column);
                block -= half * v.transpose();
            }
        }
    }
}

/// Views of a point by keyframes outside the window that hold it in place: the first few.
const ANCHORS: usize = 4;

/// A problem that was solved, to be written back into the map.
pub(crate) struct Solved {
    local: Local,
    /// What does not fit.
    dropped: Vec<(PointId, KeyframeId)>,
}

/// A problem cut out of the map: the keyframes of a window and the points they see.
pub(crate) struct Local {
    problem: Problem,
    cameras: Vec<KeyframeId>,
    points: Vec<PointId>,
    /// Point and keyframe of each observation.
    names: Vec<(PointId, KeyframeId)>,
}

impl Local {
    /// The window moves against all older keyframes that share points with it; without any, against its first.
    pub(crate) fn new(map: &Map, window: &[KeyframeId]) -> Option<Self> {
        let mut points: Vec<PointId> = window
            .iter()
            .filter_map(|id| map.keyframes.get(id))
            .flat_map(|k| k.points.iter().flatten().copied())
            .collect();
        points.sort_unstable();
        points.dedup();
        let is_in_window = |k: &KeyframeId| window.contains(k);
        let is_anchored = |id: &PointId| {
            map.point(*id)
                .is_some_and(|p| p.views.iter().any(|(k, _)| !is_in_window(k)))
        };
        let anchored = points.iter().filter(|id| is_anchored(id)).count();
        let free = if anchored < 20 {
            window.get(1..)?
        } else {
            window
        };
        if free.is_empty() {
            return None;
        }
        let mut cameras = free.to_vec();
        // By keyframe; looked up for each observation.
        let mut index = vec![usize::MAX; map.poses.len()];
        for (at, id) in cameras.iter().enumerate() {
            index[id.0 as usize] = at;
        }
        let features = |id: &KeyframeId| Some(map.keyframes.get(id)?.features.as_slice());
        let mut seen_by: Vec<&[Feature]> = cameras.iter().filter_map(features).collect();
        let mut observations = Vec::new();
        let mut names = Vec::new();
        let mut positions = Vec::new();
        for (at, &id) in points.iter().enumerate() {
            let point = map.point(id)?;
            positions.push(point.position);
            let mut anchors = 0;
            for &(k, feature) in &point.views {
                if index[k.0 as usize] >= free.len() && !is_in_window(&k) {
                    anchors += 1;
                    if anchors > ANCHORS {
                        continue;
                    }
                }
                let camera = &mut index[k.0 as usize];
                if *camera == usize::MAX {
                    *camera = cameras.len();
                    cameras.push(k);
                    seen_by.push(features(&k)?);
                }
                observations.push(Observation {
                    camera: *camera,
                    point: at,
                    seen: Seen::from(&seen_by[*camera][feature as usize]),
                });
                names.push((id, k));
            }
        }
        Some(Self {
            problem: Problem {
                cameras: cameras.iter().map(|k| map.poses[k.0 as usize]).collect(),
                free: free.len(),
                points: positions,
                observations,
            },
            cameras,
            points,
            names,
        })
    }

    /// Solves it, leaves out what does not fit, and solves it again.
    pub(crate) fn solve(mut self, optics: &Optics) -> Solved {
        self.problem.solve(optics, 5);
        let mut bad = self.problem.outliers(optics).into_iter();
        let mut dropped = Vec::new();
        let mut kept = Vec::new();
        for (o, name) in self.problem.observations.iter().zip(&self.names) {
            if bad.next() == Some(true) {
                dropped.push(*name);
            } else {
                kept.push(*o);
            }
        }
        self.problem.observations = kept;
        self.problem.solve(optics, 5);
        Solved {
            local: self,
            dropped,
        }
    }
}

impl Solved {
    /// Moves the keyframes and points, as far as they are still there, and removes what does not fit.
    pub(crate) fn write_back(&self, map: &mut Map) {
        self.local.write_back(map);
        for &(point, keyframe) in &self.dropped {
            map.remove_view(point, keyframe);
        }
    }
}

impl Local {
    fn write_back(&self, map: &mut Map) {
        let moved = self.cameras.iter().zip(&self.problem.cameras);
        for (&id, &pose) in moved.take(self.problem.free) {
            map.set_pose(id, pose);
        }
        for (&id, &position) in self.points.iter().zip(&self.problem.points) {
            if let Some(point) = map.point_mut(id)
                && position.iter().all(|c| c.is_finite())
            {
                point.position = position;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use maps::camera::Pinhole;
    use nalgebra::Vector6;

    use super::*;

    /// Four cameras in a row that see 60 points exactly; all but the last camera, and the points, are then disturbed.
    fn disturbed(optics: &Optics) -> (Problem, Vec<Isometry3<f64>>) {
        let truth: Vec<Isometry3<f64>> = (0..4)
            .map(|i| {
                Isometry3::new(
                    Vector3::new(0.2 * f64::from(i), 0.0, 0.0),
                    Vector3::new(0.0, 0.05, 0.0),
                )
            })
            .collect();
        let wave = |i: i32, f: f64| (f64::from(i) * f).sin();
        let mut points = Vec::new();
        let mut observations = Vec::new();
        for i in 0..60 {
            let point = Vector3::new(wave(i, 1.7), wave(i, 2.9), 3.0 + wave(i, 0.7));
            for (camera, pose) in truth.iter().enumerate() {
                let q = (pose.inverse() * Point3::from(point)).coords;
                observations.push(Observation {
                    camera,
                    point: points.len(),
                    seen: Seen {
                        pixel: optics.project(&q).expect("in front"),
                        depth_m: Some(q.z),
                        sigma: 1.0,
                    },
                });
            }
            points.push(point + 0.02 * Vector3::new(wave(i, 5.0), wave(i, 6.0), wave(i, 7.0)));
        }
        let off = Vector6::new(0.02, -0.03, 0.01, 0.01, -0.005, 0.01);
        let mut cameras = truth.clone();
        for pose in cameras.iter_mut().take(3) {
            *pose = boxplus(pose, &off);
        }
        let problem = Problem {
            cameras,
            free: 3,
            points,
            observations,
        };
        (problem, truth)
    }

    #[test]
    fn adjustment_brings_the_cameras_back_against_a_fixed_one() {
        let optics = Optics::new(Pinhole {
            width: 640,
            height: 480,
            fx: 500.0,
            fy: 500.0,
            cx: 320.0,
            cy: 240.0,
            distortion: [0.0; 5],
        });
        let (mut problem, truth) = disturbed(&optics);
        // One sighting is of something else.
        problem.observations[8].seen.pixel[0] += 80.0;
        let before = problem.cost(&optics);
        problem.solve(&optics, 20);
        assert!(
            problem.cost(&optics) < 0.05 * before,
            "from {before} to {}",
            problem.cost(&optics)
        );
        let wrong = problem.observations[8].point;
        let outliers = problem.outliers(&optics);
        assert!(outliers[8]);
        for (o, _) in problem
            .observations
            .iter()
            .zip(outliers)
            .filter(|(_, bad)| *bad)
        {
            assert_eq!(
                o.point, wrong,
                "only the point with the wrong sighting is in doubt"
            );
        }
        for (camera, (found, exact)) in problem.cameras.iter().zip(&truth).enumerate() {
            let off = (exact.inverse() * found).translation.vector.norm();
            assert!(off < 2e-3, "camera {camera} is {off} m off");
        }
    }
}
