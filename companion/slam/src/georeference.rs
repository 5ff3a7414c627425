//! How the world of the SLAM lies on the Earth: by positions of a satellite receiver along the way.
//!
//! Both have z up, so that only a turn about it and a shift are sought:
//!
//! ```text
//! min Σ wᵢ·|R(ψ)·eᵢ + t - pᵢ|²       ψ = atan2(Σ wᵢ·(e'ᵢ × p'ᵢ), Σ wᵢ·(e'ᵢ · p'ᵢ)),   t = p̄ - R(ψ)·ē
//! ```
//!
//! with `e` east, north, up, `p` the same place in the world of the SLAM, `'` without the weighted mean, products of
//! horizontal parts.
//!
//! - B. K. P. Horn, *Closed-form solution of absolute orientation using unit quaternions*, JOSA A 1987; here with one axis.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

/// A place in the world of the SLAM, and what the receiver said of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sighted {
    pub(crate) in_world: Vector3<f64>,
    /// East, north, up.
    pub(crate) in_enu: Vector3<f64>,
    /// Of the receiver's error, m².
    pub(crate) covariance: Matrix3<f64>,
}

/// Fewer positions say nothing.
const FEWEST: usize = 8;
/// The heading must be known to so much; standing still or flying straight up tells none.
const HEADING_RAD: f64 = 0.1;

/// `world_from_enu`; `None` where the positions do not tell the heading.
pub(crate) fn align(sighted: &[Sighted]) -> Option<Isometry3<f64>> {
    if sighted.len() < FEWEST {
        return None;
    }
    let weight = |s: &Sighted| 3.0 / s.covariance.trace();
    let total: f64 = sighted.iter().map(weight).sum();
    let mean = |of: &dyn Fn(&Sighted) -> Vector3<f64>| -> Vector3<f64> {
        sighted
            .iter()
            .map(|s| of(s) * weight(s))
            .sum::<Vector3<f64>>()
            / total
    };
    let (world, enu) = (mean(&|s| s.in_world), mean(&|s| s.in_enu));
    let (mut sin, mut cos, mut spread) = (0.0, 0.0, 0.0);
    for s in sighted {
        let (p, e, w) = ((s.in_world - world).xy(), (s.in_enu - enu).xy(), weight(s));
        sin += w * e.perp(&p);
        cos += w * e.dot(&p);
        spread += w * p.norm_squared();
    }
    // The variance of the heading is one over the information: Σ w·|p'|².
    let is_told = spread.is_finite() && spread > HEADING_RAD.powi(-2);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), sin.atan2(cos));
    let shift = world - turn * enu;
    let aligned = Isometry3::from_parts(Translation3::from(shift), turn);
    (is_told && shift.iter().all(|c| c.is_finite())).then_some(aligned)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A way of so many metres to the east, seen in a world that is turned and shifted, with errors up to `error_m`.
    fn sighted(way_m: f64, sigma_m: f64, error_m: f64) -> (Isometry3<f64>, Vec<Sighted>) {
        let truth = Isometry3::new(Vector3::new(3.0, -7.0, 120.0), Vector3::new(0.0, 0.0, 2.4));
        let at = |i: i32| {
            let in_enu = Vector3::new(
                way_m * f64::from(i) / 20.0,
                f64::from(i % 3),
                0.1 * f64::from(i),
            );
            let error = Vector3::new((1.7 * f64::from(i)).sin(), (2.9 * f64::from(i)).sin(), 0.0);
            Sighted {
                in_world: truth * nalgebra::Point3::from(in_enu) - nalgebra::Point3::origin(),
                in_enu: in_enu + error_m * error,
                covariance: Matrix3::identity() * sigma_m * sigma_m,
            }
        };
        (truth, (0..21).map(at).collect())
    }

    #[test]
    fn a_way_tells_heading_and_place() {
        let (truth, exact) = sighted(100.0, 1.0, 0.0);
        let off = truth.inverse() * align(&exact).expect("100 m of way");
        assert!(off.rotation.angle() < 1e-9 && off.translation.vector.norm() < 1e-6);
        let (truth, noisy) = sighted(100.0, 1.0, 1.0);
        let off = truth.inverse() * align(&noisy).expect("100 m of way");
        assert!(off.rotation.angle() < 0.03, "{}", off.rotation.angle());
    }

    #[test]
    fn too_short_a_way_and_too_few_positions_tell_none() {
        assert!(align(&sighted(1.0, 2.0, 0.0).1).is_none());
        assert!(align(&sighted(100.0, 1.0, 0.0).1[..7]).is_none());
        let (_, mut broken) = sighted(100.0, 1.0, 0.0);
        broken[3].in_enu.x = f64::NAN;
        assert!(align(&broken).is_none());
    }
}
