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

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};

/// A place in the world of the SLAM, and what the receiver said of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sighted {
    pub(crate) in_world: Vector3<f64>,
    /// East, north, up.
    pub(crate) in_enu: Vector3<f64>,
    /// Of the receiver's error, m².
    pub(crate) covariance: Matrix3<f64>,
}

/// A position that a wall has reflected is off by metres: it must not turn the whole map. Pairs of positions are asked which
/// turn and shift most of the others agree with, before the least squares.
///
/// - M. A. Fischler, R. C. Bolles, *Random Sample Consensus*, CACM 1981; here over pairs in a fixed order.
const PAIRS: usize = 60;
/// Standard deviations, and metres of drift, within which a position agrees.
const AGREEING: f64 = 5.0;
const DRIFT_M: f64 = 1.0;
/// Fewer positions say nothing.
const FEWEST: usize = 8;
/// The heading must be known to so much; standing still or flying straight up tells none.
const HEADING_RAD: f64 = 0.1;

/// `world_from_enu`, and which positions agree with it; `None` where they do not tell the heading.
pub(crate) fn align(sighted: &[Sighted]) -> Option<(Isometry3<f64>, Vec<bool>)> {
    let count = sighted.len();
    let pairs = (0..PAIRS.min(count)).map(|k| {
        (
            k * count / PAIRS.min(count),
            count / 3 + k % (count / 3).max(1),
        )
    });
    let guesses = pairs.filter_map(|(i, k)| turn_by_two(&sighted[i], &sighted[(i + k) % count]));
    let votes = guesses.map(|guess| agreeing(sighted, &guess));
    let agrees = votes.max_by_key(|agrees| agrees.iter().filter(|&&a| a).count())?;
    let chosen: Vec<Sighted> = sighted
        .iter()
        .zip(&agrees)
        .filter_map(|(s, a)| a.then_some(*s))
        .collect();
    let aligned = least_squares(&chosen)?;
    Some((aligned, agreeing(sighted, &aligned)))
}

fn agreeing(sighted: &[Sighted], world_from_enu: &Isometry3<f64>) -> Vec<bool> {
    let agrees = |s: &Sighted| {
        let off = (world_from_enu * Point3::from(s.in_enu)).coords - s.in_world;
        let variance = s.covariance.trace() / 3.0 + DRIFT_M * DRIFT_M;
        off.norm_squared() <= AGREEING * AGREEING * variance
    };
    sighted.iter().map(agrees).collect()
}

/// The turn and shift that bring two positions onto their places, as far as that goes.
fn turn_by_two(a: &Sighted, b: &Sighted) -> Option<Isometry3<f64>> {
    let (p, e) = ((b.in_world - a.in_world).xy(), (b.in_enu - a.in_enu).xy());
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), e.perp(&p).atan2(e.dot(&p)));
    let middle = (a.in_world + b.in_world) / 2.0;
    let shift = middle - turn * ((a.in_enu + b.in_enu) / 2.0);
    let is_sound = shift.iter().all(|c| c.is_finite());
    is_sound.then(|| Isometry3::from_parts(Translation3::from(shift), turn))
}

fn least_squares(sighted: &[Sighted]) -> Option<Isometry3<f64>> {
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
                in_world: truth * Point3::from(in_enu) - Point3::origin(),
                in_enu: in_enu + error_m * error,
                covariance: Matrix3::identity() * sigma_m * sigma_m,
            }
        };
        (truth, (0..21).map(at).collect())
    }

    #[test]
    fn a_way_tells_heading_and_place() {
        let (truth, exact) = sighted(100.0, 1.0, 0.0);
        let off = truth.inverse() * align(&exact).expect("100 m of way").0;
        assert!(off.rotation.angle() < 1e-9 && off.translation.vector.norm() < 1e-6);
        let (truth, noisy) = sighted(100.0, 1.0, 1.0);
        let off = truth.inverse() * align(&noisy).expect("100 m of way").0;
        assert!(off.rotation.angle() < 0.03, "{}", off.rotation.angle());
    }

    #[test]
    fn reflections_do_not_turn_the_map_and_are_named() {
        let (truth, mut sighted) = sighted(20.0, 0.5, 0.3);
        let reflected = [2, 9, 10, 17, 18];
        for i in reflected {
            sighted[i].in_enu += Vector3::new(15.0, 60.0, 5.0);
        }
        let (found, agrees) = align(&sighted).expect("16 agree");
        let off = truth.inverse() * found;
        assert!(off.rotation.angle() < 0.05, "{}", off.rotation.angle());
        let named: Vec<usize> = (0..21).filter(|&i| !agrees[i]).collect();
        assert_eq!(named, reflected);
    }

    #[test]
    fn too_short_a_way_and_too_few_positions_tell_none() {
        assert!(align(&sighted(1.0, 2.0, 0.0).1).is_none());
        assert!(align(&sighted(100.0, 1.0, 0.0).1[..7]).is_none());
        let (_, mut broken) = sighted(100.0, 1.0, 0.0);
        broken[3].in_enu.x = f64::NAN;
        assert_eq!(align(&broken).map(|(_, agrees)| agrees[3]), Some(false));
        assert!(align(&[]).is_none());
    }
}
