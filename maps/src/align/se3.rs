//! Rigid motions as vectors: `ξ = (ρ, φ)`, translation before rotation, as [`crate::frame`] has it.
//!
//! ```text
//! exp(ρ, φ) = (R, V·ρ)   R = exp([φ]×)   V = I + (1 - cos θ)/θ² [φ]× + (θ - sin θ)/θ³ [φ]×²   θ = |φ|
//! ```
//!
//! - T. Barfoot, *State Estimation for Robotics*, Cambridge University Press, 2017, section 7.1.

use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

/// Below this angle, in radians, series take over from quotients.
const SMALL: f64 = 1e-4;

/// The motion that `xi` stands for.
pub(super) fn exp(xi: &Vector6<f64>) -> Isometry3<f64> {
    let (rho, phi) = parts(xi);
    let theta = phi.norm();
    let (a, b) = if theta < SMALL {
        (
            0.5 - theta * theta / 24.0,
            1.0 / 6.0 - theta * theta / 120.0,
        )
    } else {
        (
            (1.0 - theta.cos()) / theta.powi(2),
            (theta - theta.sin()) / theta.powi(3),
        )
    };
    let cross = phi.cross_matrix();
    let v = Matrix3::identity() + cross * a + cross * cross * b;
    Isometry3::from_parts(
        Translation3::from(v * rho),
        UnitQuaternion::from_scaled_axis(phi),
    )
}

/// The vector of a motion: the inverse of [`exp`] for turns of less than π.
pub(super) fn log(motion: &Isometry3<f64>) -> Vector6<f64> {
    let phi = motion.rotation.scaled_axis();
    let theta = phi.norm();
    let c = if theta < SMALL {
        1.0 / 12.0 + theta * theta / 720.0
    } else {
        (1.0 - theta / 2.0 / (theta / 2.0).tan()) / theta.powi(2)
    };
    let cross = phi.cross_matrix();
    let inverse = Matrix3::identity() - cross * 0.5 + cross * cross * c;
    joined(&(inverse * motion.translation.vector), &phi)
}

/// How `log(T · exp(δ))` grows with `δ` where `log(T)` is `xi`: the inverse of the right Jacobian, to second order.
pub(super) fn right_jacobian_inverse(xi: &Vector6<f64>) -> Matrix6<f64> {
    let (rho, phi) = parts(xi);
    let mut ad = Matrix6::zeros();
    for at in [0, 3] {
        ad.fixed_view_mut::<3, 3>(at, at)
            .copy_from(&phi.cross_matrix());
    }
    ad.fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&rho.cross_matrix());
    Matrix6::identity() + ad * 0.5 + ad * ad / 12.0
}

/// Takes a perturbation about `center` to the same perturbation about the origin: `exp(A·ξ) = t · exp(ξ) · t⁻¹`.
pub(super) fn about_origin(center: &Vector3<f64>) -> Matrix6<f64> {
    let mut adjoint = Matrix6::identity();
    adjoint
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&center.cross_matrix());
    adjoint
}

/// The translation and the rotation of a perturbation.
pub(super) fn parts(xi: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (xi.fixed_rows::<3>(0).into(), xi.fixed_rows::<3>(3).into())
}

/// A perturbation of a translation and a rotation.
pub(super) fn joined(rho: &Vector3<f64>, phi: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_vector() -> impl Strategy<Value = Vector6<f64>> {
        (
            prop::array::uniform3(-20.0..20.0),
            prop::array::uniform3(-1.5..1.5),
            prop::sample::select(vec![1.0, 1e-3, 1e-6, 0.0]),
        )
            .prop_map(|(rho, phi, scale): ([f64; 3], [f64; 3], f64)| {
                joined(&rho.into(), &(Vector3::from(phi) * scale))
            })
    }

    proptest! {
        #[test]
        fn the_vector_of_a_motion_stands_for_that_motion(xi in any_vector()) {
            prop_assert!((log(&exp(&xi)) - xi).norm() < 1e-9, "rounding of values up to 35 m");
        }

        #[test]
        fn a_perturbation_about_a_point_is_one_about_the_origin(
            xi in any_vector(), center in prop::array::uniform3(-20.0..20.0)
        ) {
            let center = Vector3::from(center);
            let there = Isometry3::from(center);
            let direct = there * exp(&xi) * there.inverse();
            let moved = exp(&(about_origin(&center) * xi));
            prop_assert!((direct.inverse() * moved).translation.vector.norm() < 1e-9);
        }
    }

    #[test]
    fn the_jacobian_is_that_of_finite_differences() {
        let xi = Vector6::new(2.0, -1.0, 0.5, 0.05, -0.1, 0.15);
        let jacobian = right_jacobian_inverse(&xi);
        for axis in 0..6 {
            let step = Vector6::ith(axis, 1e-6);
            let slope = (log(&(exp(&xi) * exp(&step))) - xi) / 1e-6;
            // The fourth-order term of the series: |φ|³·|ρ| / 720.
            assert!((slope - jacobian.column(axis)).norm() < 1e-4, "axis {axis}");
        }
    }
}
