//! The pose of a camera that sees known points.
//!
//! Minimises, by damped Gauss-Newton over the right perturbation `T ⊞ ξ` of `T = world_from_camera`,
//!
//! ```text
//! Σ ρ(‖π(T⁻¹p) - u‖² / σ²) + ρ((1/z(T⁻¹p) - 1/d)² / σ_q²)        q = T⁻¹p,  ∂q/∂ξ = [-I | [q]ₓ]
//! ```
//!
//! with Huber's ρ. Depth enters as inverse depth, in which the noise of a structured-light or stereo sensor is even.
//! After each round the points that fail a χ² test of their pixel (2 degrees of freedom) or depth (1) are set aside.
//!
//! - R. Mur-Artal, J. D. Tardós, *ORB-SLAM2*, IEEE T-RO 2017, section III (motion-only bundle adjustment).

use nalgebra::{
    Isometry3, Matrix3, Matrix6, SMatrix, Translation3, UnitQuaternion, Vector3, Vector6,
};

use crate::features::{Feature, scale_of};
use crate::optics::Optics;

/// Standard deviation of a measured inverse depth, 1/m: 2 cm at 1 m, 18 cm at 3 m. The noise on a flat surface is a
/// fifth of that; but errors of scale, and of colour against depth in time, are common to all points of an image.
pub(crate) const INVERSE_DEPTH_SIGMA: f64 = 0.02;
/// 95 % quantile of χ² with 2 degrees of freedom.
pub(crate) const PIXEL_GATE: f64 = 5.991;
/// 99.5 % quantile of χ² with 1 degree of freedom: depth has heavier tails.
pub(crate) const DEPTH_GATE: f64 = 7.88;

/// Where a camera saw a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// Ideal pixel.
    pub(crate) pixel: [f64; 2],
    pub(crate) depth_m: Option<f64>,
    /// Standard deviation of the pixel.
    pub(crate) sigma: f64,
}

impl From<&Feature> for Seen {
    fn from(feature: &Feature) -> Self {
        Self {
            pixel: feature.ideal,
            depth_m: feature.depth_m,
            sigma: scale_of(feature.octave),
        }
    }
}

/// A known point of the world and where it was seen.
#[derive(Clone, Debug)]
pub(crate) struct Sight {
    pub(crate) point: Vector3<f64>,
    pub(crate) seen: Seen,
}

/// What is known of a pose beside the points: standard deviations of its place and its attitude.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    pub(crate) pose: Isometry3<f64>,
    pub(crate) sigma_m: f64,
    pub(crate) sigma_rad: f64,
}

/// A pose and what supports it.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    pub(crate) world_from_camera: Isometry3<f64>,
    /// Which of the sights agree.
    pub(crate) agrees: Vec<bool>,
    pub(crate) agreeing: usize,
    /// By the points alone, of the right perturbation, translation first.
    pub(crate) covariance: Matrix6<f64>,
    /// What was known of it before.
    pub(crate) prior: Option<Prior>,
}

/// `T · exp(ξ)`, translation first.
pub(crate) fn boxplus(pose: &Isometry3<f64>, xi: &Vector6<f64>) -> Isometry3<f64> {
    let (rho, phi) = (
        Vector3::new(xi[0], xi[1], xi[2]),
        Vector3::new(xi[3], xi[4], xi[5]),
    );
    let angle = phi.norm();
    let hat = phi.cross_matrix();
    let (a, b) = if angle < 1e-6 {
        (0.5, 1.0 / 6.0)
    } else {
        let square = angle * angle;
        (
            (1.0 - angle.cos()) / square,
            (angle - angle.sin()) / (square * angle),
        )
    };
    let left_jacobian = Matrix3::identity() + a * hat + b * hat * hat;
    let step = Isometry3::from_parts(
        Translation3::from(left_jacobian * rho),
        UnitQuaternion::from_scaled_axis(phi),
    );
    let mut moved = pose * step;
    moved.rotation.renormalize();
    moved
}

/// Residuals of one sight and their derivatives by a point in the camera: pixel, then inverse depth.
pub(crate) struct Residual {
    pub(crate) value: Vector3<f64>,
    pub(crate) by_point: Matrix3<f64>,
}

/// Whitened residuals: in standard deviations. Without a measured depth the third one is zero.
pub(crate) fn residual(optics: &Optics, in_camera: &Vector3<f64>, seen: &Seen) -> Option<Residual> {
    let [u, v] = optics.project(in_camera)?;
    let (c, z) = (&optics.camera, in_camera.z);
    let w = seen.sigma.recip();
    let (gx, gy) = (w * c.fx / z, w * c.fy / z);
    let mut by_point = Matrix3::new(
        gx,
        0.0,
        -gx * in_camera.x / z,
        0.0,
        gy,
        -gy * in_camera.y / z,
        0.0,
        0.0,
        0.0,
    );
    let mut value = Vector3::new((u - seen.pixel[0]) * w, (v - seen.pixel[1]) * w, 0.0);
    if let Some(depth_m) = seen.depth_m {
        value.z = (z.recip() - depth_m.recip()) / INVERSE_DEPTH_SIGMA;
        by_point[(2, 2)] = -1.0 / (z * z * INVERSE_DEPTH_SIGMA);
    }
    Some(Residual { value, by_point })
}

/// χ² of the pixel and of the depth.
pub(crate) fn chi2(value: &Vector3<f64>) -> (f64, f64) {
    (value.x * value.x + value.y * value.y, value.z * value.z)
}

/// Huber's weight and cost of a χ².
pub(crate) fn huber(chi2: f64, gate: f64) -> (f64, f64) {
    if chi2 <= gate {
        (1.0, chi2)
    } else {
        let root = (gate / chi2).sqrt();
        (root, 2.0 * gate / root - gate)
    }
}

/// Robust weights of the three residuals, and the cost.
pub(crate) fn robust(value: &Vector3<f64>) -> (Vector3<f64>, f64) {
    let (pixel, depth) = chi2(value);
    let (wp, cp) = huber(pixel, PIXEL_GATE);
    let (wd, cd) = huber(depth, DEPTH_GATE);
    (Vector3::new(wp, wp, wd), cp + cd)
}

struct Normal {
    h: Matrix6<f64>,
    b: Vector6<f64>,
    cost: f64,
}

impl Normal {
    /// Residuals `R_priorᵀ·(t - t_prior)` and the rotation vector of `R_priorᵀ·R`; both change by ξ itself, next to it.
    fn add_prior(&mut self, pose: &Isometry3<f64>, prior: &Prior) {
        let off = prior.pose.inverse() * pose;
        let parts = [
            (off.translation.vector, prior.sigma_m),
            (off.rotation.scaled_axis(), prior.sigma_rad),
        ];
        for (first, (off, sigma)) in [0, 3].into_iter().zip(parts) {
            let information = sigma.powi(-2);
            for i in 0..3 {
                self.h[(first + i, first + i)] += information;
                self.b[first + i] += information * off[i];
            }
            self.cost += information * off.norm_squared();
        }
    }
}

fn linearise(optics: &Optics, pose: &Isometry3<f64>, sights: &[Sight], agrees: &[bool]) -> Normal {
    let inverse = pose.inverse();
    let mut normal = Normal {
        h: Matrix6::zeros(),
        b: Vector6::zeros(),
        cost: 0.0,
    };
    for (sight, _) in sights.iter().zip(agrees).filter(|&(_, &a)| a) {
        let q = inverse * nalgebra::Point3::from(sight.point);
        let Some(r) = residual(optics, &q.coords, &sight.seen) else {
            normal.cost += PIXEL_GATE + DEPTH_GATE;
            continue;
        };
        let (weights, cost) = robust(&r.value);
        let mut j = SMatrix::<f64, 3, 6>::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&-r.by_point);
        j.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(r.by_point * q.coords.cross_matrix()));
        let weighted = j.transpose() * Matrix3::from_diagonal(&weights);
        normal.h += weighted * j;
        normal.b += weighted * r.value;
        normal.cost += cost;
    }
    normal
}

/// Fits the pose, from a start near it; `None` if too few points agree or they leave it undetermined.
pub(crate) fn fit_pose(
    optics: &Optics,
    start: &Isometry3<f64>,
    sights: &[Sight],
    prior: Option<Prior>,
) -> Option<Fit> {
    const FEWEST: usize = 6;
    let mut pose = *start;
    let mut agrees = vec![true; sights.len()];
    let mut agreeing = sights.len();
    for _ in 0..4 {
        if agreeing < FEWEST {
            return None;
        }
        pose = descend(optics, pose, (sights, &agrees), prior.as_ref())?;
        let inverse = pose.inverse();
        for (sight, agree) in sights.iter().zip(&mut agrees) {
            let q = inverse * nalgebra::Point3::from(sight.point);
            *agree = residual(optics, &q.coords, &sight.seen).is_some_and(|r| {
                let (pixel, depth) = chi2(&r.value);
                pixel <= PIXEL_GATE && depth <= DEPTH_GATE
            });
        }
        agreeing = agrees.iter().filter(|&&a| a).count();
    }
    if agreeing < FEWEST {
        return None;
    }
    let normal = linearise(optics, &pose, sights, &agrees);
    // The residuals say how far the assumed noise is off; the covariance never gets smaller by it.
    let freedom = (3 * agreeing).saturating_sub(6).max(1) as f64;
    let spread = (normal.cost / freedom).max(1.0);
    let covariance = normal.h.try_inverse()? * spread;
    let valid =
        covariance.iter().all(|c| c.is_finite()) && pose.translation.vector.norm().is_finite();
    valid.then_some(Fit {
        world_from_camera: pose,
        agrees,
        agreeing,
        covariance,
        prior,
    })
}

fn descend(
    optics: &Optics,
    start: Isometry3<f64>,
    (sights, agrees): (&[Sight], &[bool]),
    prior: Option<&Prior>,
) -> Option<Isometry3<f64>> {
    let mut pose = start;
    let linearise = |pose: &Isometry3<f64>| {
        let mut normal = linearise(optics, pose, sights, agrees);
        if let Some(prior) = prior {
            normal.add_prior(pose, prior);
        }
        normal
    };
    let mut normal = linearise(&pose);
    let mut damping = 1e-4;
    for _ in 0..10 {
        let mut damped = normal.h;
        for i in 0..6 {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = -damped.cholesky()?.solve(&normal.b);
        let tried = boxplus(&pose, &step);
        let next = linearise(&tried);
        if next.cost < normal.cost {
            let gain = normal.cost - next.cost;
            (pose, normal) = (tried, next);
            damping *= 0.1;
            if gain < 1e-4 * normal.cost {
                break;
            }
        } else {
            damping *= 30.0;
            if step.norm() < 1e-6 || damping > 1e3 {
                break;
            }
        }
    }
    Some(pose)
}

#[cfg(test)]
mod tests {
    use maps::camera::Pinhole;
    use rand_pcg::Pcg64;
    use rand_pcg::rand_core::{Rng as _, SeedableRng as _};

    use super::*;

    const CAMERA: Pinhole = Pinhole {
        width: 640,
        height: 480,
        fx: 540.0,
        fy: 540.0,
        cx: 320.0,
        cy: 240.0,
        distortion: [0.0; 5],
    };

    /// About normal, with standard deviation 1: a sum of uniform numbers.
    fn normal(rng: &mut Pcg64) -> f64 {
        (0..12).map(|_| uniform(rng)).sum::<f64>() - 6.0
    }

    fn uniform(rng: &mut Pcg64) -> f64 {
        (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Sights of random points with the assumed noise; every `wrong`th is of somewhere else.
    fn sights(
        optics: &Optics,
        truth: &Isometry3<f64>,
        rng: &mut Pcg64,
        wrong: usize,
    ) -> Vec<Sight> {
        (0..100)
            .map(|i| {
                let depth = 1.0 + 3.0 * uniform(rng);
                let pixel = [640.0 * uniform(rng), 480.0 * uniform(rng)];
                let in_camera = optics.lift(pixel, depth);
                let shift = if i % wrong == wrong - 1 { 60.0 } else { 0.0 };
                let inverse = depth.recip() + INVERSE_DEPTH_SIGMA * normal(rng);
                Sight {
                    point: (truth * nalgebra::Point3::from(in_camera)).coords,
                    seen: Seen {
                        pixel: [pixel[0] + shift + normal(rng), pixel[1] + normal(rng)],
                        depth_m: (i % 3 > 0).then_some(inverse.recip()),
                        sigma: 1.0,
                    },
                }
            })
            .collect()
    }

    fn truth() -> Isometry3<f64> {
        Isometry3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.3, 1.1, -0.4))
    }

    #[test]
    fn the_pose_is_found_among_wrong_matches() {
        let optics = Optics::new(CAMERA);
        let sights = sights(&optics, &truth(), &mut Pcg64::seed_from_u64(3), 4);
        let start = boxplus(
            &truth(),
            &Vector6::new(0.05, -0.04, 0.06, 0.03, 0.02, -0.03),
        );
        let fit = fit_pose(&optics, &start, &sights, None).expect("75 good sights");
        let off = truth().inverse() * fit.world_from_camera;
        assert!(off.translation.vector.norm() < 0.02, "{off:?}");
        let wrong = fit.agrees.iter().skip(3).step_by(4).filter(|&&a| a).count();
        assert_eq!(wrong, 0, "no wrong match may agree");
        assert!(fit.agreeing >= 65, "{} of 75 good ones agree", fit.agreeing);
    }

    #[test]
    fn the_error_is_as_large_as_the_covariance_says() {
        let optics = Optics::new(CAMERA);
        let mut rng = Pcg64::seed_from_u64(5);
        let runs = 200;
        let mut sum = 0.0;
        for _ in 0..runs {
            let sights = sights(&optics, &truth(), &mut rng, 1000);
            let fit = fit_pose(&optics, &truth(), &sights, None).expect("100 good sights");
            let off = truth().inverse() * fit.world_from_camera;
            let (t, r) = (off.translation.vector, off.rotation.scaled_axis());
            let xi = Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z);
            let information = fit.covariance.try_inverse().expect("a covariance");
            sum += (xi.transpose() * information * xi)[0];
        }
        // χ² with 6 degrees of freedom: 6 on average, ±0.25 (one standard deviation) over 200 runs. Tails cut by the
        // gates and a covariance that never shrinks leave it a little off.
        let mean = sum / f64::from(runs);
        assert!(
            (4.5..=7.5).contains(&mean),
            "squared error of {mean} covariances"
        );
    }

    #[test]
    fn too_few_or_degenerate_points_give_no_pose() {
        let optics = Optics::new(CAMERA);
        let few = &sights(&optics, &truth(), &mut Pcg64::seed_from_u64(3), 1000)[..5];
        assert!(
            fit_pose(&optics, &truth(), few, None).is_none(),
            "five points"
        );
        let behind = vec![
            Sight {
                point: Vector3::new(0.0, 0.0, -1.0),
                seen: few[0].seen,
            };
            20
        ];
        assert!(
            fit_pose(&optics, &Isometry3::identity(), &behind, None).is_none(),
            "all behind"
        );
    }

    #[test]
    fn the_derivatives_are_those_of_the_residuals() {
        let optics = Optics::new(CAMERA);
        let sight = sights(&optics, &truth(), &mut Pcg64::seed_from_u64(9), 1000).remove(1);
        let q = Vector3::new(0.4, -0.3, 2.0);
        let at = |q: &Vector3<f64>| residual(&optics, q, &sight.seen).expect("in front");
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = 1e-6;
            let numeric = (at(&(q + step)).value - at(&(q - step)).value) / 2e-6;
            let off = (numeric - at(&q).by_point.column(axis)).norm();
            assert!(off < 1e-3, "axis {axis}: {off} off, of hundreds");
        }
    }
}
