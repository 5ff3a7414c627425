//! The fundamental matrix between two frames, by RANSAC.
//!
//! ```text
//! x'ᵀ F x = 0        r = |x'ᵀ F x| / ‖(F x)₁₂‖    distance of x' from its epipolar line, pixels
//! ```
//!
//! - R. Hartley, *In Defense of the Eight-Point Algorithm*, PAMI 1997 (normalised coordinates).

use nalgebra::{DMatrix, Matrix3, Vector3};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng as _;

/// A pixel of the frame before, and the one that shows the same now.
pub(super) type Match = ([f64; 2], [f64; 2]);

/// Matches of one sample.
const SAMPLE: usize = 8;
const ROUNDS: usize = 100;
/// A match with a larger residual does not agree, pixels.
const AGREEING: f64 = 1.5;
/// The fewest matches that must agree.
const FEWEST: usize = 15;

/// The fundamental matrix that most matches agree with; `None` where too few agree on one.
pub(super) fn fundamental(matches: &[Match], rng: &mut Pcg64) -> Option<Matrix3<f64>> {
    if matches.len() < FEWEST {
        return None;
    }
    let agreeing = |f: &Matrix3<f64>| -> Vec<Match> {
        let agrees = |m: &&Match| residual(f, m) < AGREEING;
        matches.iter().filter(agrees).copied().collect()
    };
    let mut best: Vec<Match> = Vec::new();
    for _ in 0..ROUNDS {
        let sample: Vec<Match> = (0..SAMPLE)
            .map(|_| matches[(rng.next_u64() % matches.len() as u64) as usize])
            .collect();
        if let Some(support) = eight_points(&sample).map(|f| agreeing(&f))
            && support.len() > best.len()
        {
            best = support;
        }
    }
    if best.len() < FEWEST {
        return None;
    }
    eight_points(&best)
}

/// Distance of a match's later pixel from its epipolar line; infinite where there is no line.
pub(super) fn residual(f: &Matrix3<f64>, (before, now): &Match) -> f64 {
    let line = f * Vector3::new(before[0], before[1], 1.0);
    let distance = line.dot(&Vector3::new(now[0], now[1], 1.0)).abs() / line.x.hypot(line.y);
    if distance.is_finite() {
        distance
    } else {
        f64::INFINITY
    }
}

/// The matrix of rank 2 that fits eight or more matches best; `None` if they leave it open.
fn eight_points(matches: &[Match]) -> Option<Matrix3<f64>> {
    let from = normalizer(matches.iter().map(|m| m.0))?;
    let to = normalizer(matches.iter().map(|m| m.1))?;
    let place = |n: &Matrix3<f64>, p: [f64; 2]| n * Vector3::new(p[0], p[1], 1.0);
    // The least eigenvector of AᵀA, nine by nine however many matches there are.
    let mut normal = DMatrix::<f64>::zeros(9, 9);
    for &(before, now) in matches {
        let (a, b) = (place(&from, before), place(&to, now));
        let row = DMatrix::from_fn(1, 9, |_, i| b[i / 3] * a[i % 3]);
        normal += row.transpose() * &row;
    }
    let eigen = normal.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let f = Matrix3::from_fn(|row, column| eigen.eigenvectors[(3 * row + column, least)]);
    let mut svd = f.svd(true, true);
    let smallest = svd.singular_values.imin();
    svd.singular_values[smallest] = 0.0;
    let f = to.transpose() * svd.recompose().ok()? * from;
    let norm = f.norm();
    (norm.is_finite() && norm > 0.0).then(|| f / norm)
}

/// Moves points to their centre and scales them to a mean distance of √2.
fn normalizer(points: impl Iterator<Item = [f64; 2]> + Clone) -> Option<Matrix3<f64>> {
    let count = points.clone().count() as f64;
    let [x, y] = [0, 1].map(|i| points.clone().map(|p| p[i]).sum::<f64>() / count);
    let spread = points.map(|p| (p[0] - x).hypot(p[1] - y)).sum::<f64>() / count;
    let scale = std::f64::consts::SQRT_2 / spread;
    (spread > 1e-9 && scale.is_finite()).then(|| {
        Matrix3::new(
            scale,
            0.0,
            -scale * x,
            0.0,
            scale,
            -scale * y,
            0.0,
            0.0,
            1.0,
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Point3};
    use rand_pcg::rand_core::SeedableRng as _;

    /// Points of a static scene before and after a step of the camera, of which every fourth has moved.
    fn matches() -> Vec<(Match, bool)> {
        let mut rng = Pcg64::seed_from_u64(7);
        let mut random = || f64::from(rng.next_u32()) / f64::from(u32::MAX);
        let step = Isometry3::new(
            Vector3::new(0.1, 0.02, 0.05),
            Vector3::new(0.02, -0.03, 0.01),
        );
        let project = |p: &Point3<f64>| [500.0 * p.x / p.z + 320.0, 500.0 * p.y / p.z + 240.0];
        let pair = |i: usize| {
            let p = Point3::new(
                3.0 * random() - 1.5,
                2.0 * random() - 1.0,
                2.0 + 2.0 * random(),
            );
            let moves = i.is_multiple_of(4);
            let mut now = project(&(step * p));
            if moves {
                now[0] += 6.0 + 10.0 * random();
                now[1] += 14.0 + 10.0 * random();
            }
            ((project(&p), now), moves)
        };
        (0..120).map(pair).collect()
    }

    #[test]
    fn static_points_lie_on_their_epipolar_lines_and_others_do_not() {
        let matches = matches();
        let all: Vec<Match> = matches.iter().map(|m| m.0).collect();
        let f = fundamental(&all, &mut Pcg64::seed_from_u64(1)).expect("most are static");
        let far = |moves: bool| {
            let of = matches.iter().filter(move |m| m.1 == moves);
            of.clone().filter(|m| residual(&f, &m.0) > 2.0).count() as f64 / of.count() as f64
        };
        assert!(
            far(false) < 0.02,
            "{} of the static ones are off",
            far(false)
        );
        assert!(
            far(true) > 0.9,
            "only {} of the moving ones are off",
            far(true)
        );
    }

    #[test]
    fn matches_that_agree_on_nothing_have_no_fundamental_matrix() {
        let mut rng = Pcg64::seed_from_u64(3);
        assert!(fundamental(&[], &mut rng).is_none());
        let same = vec![([5.0, 5.0], [6.0, 6.0]); 40];
        assert!(fundamental(&same, &mut rng).is_none());
        let wild = vec![([f64::NAN, 5.0], [6.0, f64::INFINITY]); 40];
        assert!(fundamental(&wild, &mut rng).is_none());
    }
}
