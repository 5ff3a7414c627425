//! The shortest ways between two poses for a car that turns within a radius and may reverse, without obstacles.
//!
//! Reeds and Shepp proved that a shortest way is one of 48 words of at most five arcs of the smallest radius and straight
//! lines. Each function below solves one formula of section 8 of their paper for a goal `(x, y, φ)` in units of the radius,
//! seen from the start; the other words follow by driving it in reverse (timeflip), mirrored (reflect) or from the goal
//! to the start (backwards).
//!
//! - J. A. Reeds, L. A. Shepp, *Optimal paths for a car that goes both forwards and backwards*, Pacific Journal of
//!   Mathematics 145 (2), 1990. Formula (8.10) is used with the sign of `v` that reaches the goal.

use std::f64::consts::{FRAC_PI_2, PI};

use super::motion::{Motion, Pose2, wrapped};

/// A word: up to five motions, those of no length left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Word {
    motions: [Motion; 5],
    count: usize,
}

impl Word {
    pub(crate) fn motions(&self) -> &[Motion] {
        &self.motions[..self.count]
    }
}

/// Every word that leads from `start` to `goal`, in a fixed order.
pub(crate) fn words(start: &Pose2, goal: &Pose2, radius_m: f64) -> Vec<Word> {
    let [x, y, phi] = start.local(goal);
    let mut found = Vec::with_capacity(24);
    for_each(x / radius_m, y / radius_m, phi, |turns| {
        found.push(word(turns, radius_m));
    });
    found
}

/// Length of the shortest word.
pub(crate) fn length_m(start: &Pose2, goal: &Pose2, radius_m: f64) -> f64 {
    let [x, y, phi] = start.local(goal);
    let mut shortest = f64::INFINITY;
    for_each(x / radius_m, y / radius_m, phi, |turns| {
        shortest = shortest.min(turns.iter().map(|t| t.1.abs()).sum());
    });
    shortest * radius_m
}

#[derive(Clone, Copy, PartialEq)]
enum Steer {
    Left,
    Straight,
    Right,
}
use Steer::{Left, Right, Straight};

type Turn = (Steer, f64);

fn word(turns: &[Turn], radius_m: f64) -> Word {
    let mut result = Word {
        motions: [Motion {
            curvature: 0.0,
            signed_m: 0.0,
        }; 5],
        count: 0,
    };
    for &(steer, parameter) in turns.iter().filter(|turn| turn.1.abs() > 1e-9) {
        let curvature = match steer {
            Left => 1.0 / radius_m,
            Straight => 0.0,
            Right => -1.0 / radius_m,
        };
        result.motions[result.count] = Motion {
            curvature,
            signed_m: parameter * radius_m,
        };
        result.count += 1;
    }
    result
}

/// Solutions `[t, u, v]` of one formula.
type Formula = fn(f64, f64, f64) -> Option<[f64; 3]>;

/// A formula with the word its solutions stand for.
struct Family {
    solve: Formula,
    spell: fn([f64; 3]) -> ([Turn; 5], usize),
    /// Whether the word driven from the goal to the start is another one.
    backwards: bool,
}

const FAMILIES: [Family; 8] = [
    Family {
        solve: lp_sp_lp,
        spell: |[t, u, v]| spelled(&[(Left, t), (Straight, u), (Left, v)]),
        backwards: false,
    },
    Family {
        solve: lp_sp_rp,
        spell: |[t, u, v]| spelled(&[(Left, t), (Straight, u), (Right, v)]),
        backwards: false,
    },
    Family {
        solve: lp_rm_l,
        spell: |[t, u, v]| spelled(&[(Left, t), (Right, u), (Left, v)]),
        backwards: true,
    },
    Family {
        solve: lp_rup_lum_rm,
        spell: |[t, u, v]| spelled(&[(Left, t), (Right, u), (Left, -u), (Right, v)]),
        backwards: false,
    },
    Family {
        solve: lp_rum_lum_rp,
        spell: |[t, u, v]| spelled(&[(Left, t), (Right, u), (Left, u), (Right, v)]),
        backwards: false,
    },
    Family {
        solve: lp_rm_sm_lm,
        spell: |[t, u, v]| spelled(&[(Left, t), (Right, -FRAC_PI_2), (Straight, u), (Left, v)]),
        backwards: true,
    },
    Family {
        solve: lp_rm_sm_rm,
        spell: |[t, u, v]| spelled(&[(Left, t), (Right, -FRAC_PI_2), (Straight, u), (Right, v)]),
        backwards: true,
    },
    Family {
        solve: lp_rm_sm_lm_rp,
        spell: |[t, u, v]| {
            spelled(&[
                (Left, t),
                (Right, -FRAC_PI_2),
                (Straight, u),
                (Left, -FRAC_PI_2),
                (Right, v),
            ])
        },
        backwards: false,
    },
];

fn spelled(turns: &[Turn]) -> ([Turn; 5], usize) {
    let mut word = [(Straight, 0.0); 5];
    word[..turns.len()].copy_from_slice(turns);
    (word, turns.len())
}

/// Calls `found` with every word that leads to `(x, y, φ)`.
fn for_each(x: f64, y: f64, phi: f64, mut found: impl FnMut(&[Turn])) {
    let (sin, cos) = phi.sin_cos();
    // The start as the goal sees it, for the words driven from the goal to the start.
    let from_goal = (x * cos + y * sin, x * sin - y * cos);
    for family in &FAMILIES {
        for backwards in [false, true] {
            if backwards && !family.backwards {
                continue;
            }
            let (x, y) = if backwards { from_goal } else { (x, y) };
            for (flip, mirror) in [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
                let Some(solution) = (family.solve)(flip * x, mirror * y, flip * mirror * phi)
                else {
                    continue;
                };
                let (mut turns, count) = (family.spell)(solution);
                let turns = &mut turns[..count];
                for turn in turns.iter_mut() {
                    turn.1 *= flip;
                    if mirror < 0.0 {
                        turn.0 = match turn.0 {
                            Left => Right,
                            Straight => Straight,
                            Right => Left,
                        };
                    }
                }
                if backwards {
                    turns.reverse();
                }
                found(turns);
            }
        }
    }
}

fn polar(x: f64, y: f64) -> (f64, f64) {
    (x.hypot(y), y.atan2(x))
}

/// Formula (8.1): L⁺S⁺L⁺.
fn lp_sp_lp(x: f64, y: f64, phi: f64) -> Option<[f64; 3]> {
    let (u, t) = polar(x - phi.sin(), y - 1.0 + phi.cos());
    let v = wrapped(phi - t);
    (t >= 0.0 && v >= 0.0).then_some([t, u, v])
}

/// Formula (8.2): L⁺S⁺R⁺.
fn lp_sp_rp(x: f64, y: f64, phi: f64) -> Option<[f64; 3]> {
    let (rho, theta) = polar(x + phi.sin(), y - 1.0 - phi.cos());
    if rho < 2.0 {
        return None;
    }
    let u = (rho * rho - 4.0).sqrt();
    let t = wrapped(theta + 2.0_f64.atan2(u));
    let v = wrapped(t - phi);
    (t >= 0.0 && v >= 0.0).then_some([t, u, v])
}

/// Formulas (8.3) and (8.4): L⁺R⁻L, the last arc either way.
fn lp_rm_l(x: f64, y: f64, phi: f64) -> Option<[f64; 3]> {
    let (rho, theta) = polar(x - phi.sin(), y - 1.0 + phi.cos());
    if rho > 4.0 {
        return None;
    }
    let u = -2.0 * (0.25 * rho).asin();
    let t = wrapped(theta + 0.5 * u + PI);
    let v = wrapped(phi - t + u);
    (t >= 0.0 && u <= 0.0).then_some([t, u, v])
}

/// The first and the last arc of a word of four, from its inner arcs `u` and `v`: formula (8.6).
fn outer_arcs(u: f64, v: f64, xi: f64, eta: f64, phi: f64) -> (f64, f64) {
    let delta = wrapped(u - v);
    let a = u.sin() - delta.sin();
    let b = u.cos() - delta.cos() - 1.0;
    let theta = (eta * a - xi * b).atan2(xi * a + eta * b);
    let facing = 2.0 * (delta.cos() - v.cos() - u.cos()) + 3.0;
    let tau = wrapped(if facing < 0.0 { theta + PI } else { theta });
    (tau, wrapped(tau - u + v - phi))
}

/// Formula (8.7): L⁺R⁺ L⁻R⁻ with equal inner arcs.
fn lp_rup_lum_rm(x: f64, y: f64, phi: f64) -> Option<[f64; 3]> {
    let (xi, eta) = (x + phi.sin(), y - 1.0 - phi.cos());
    let rho = 0.25 * (2.0 + xi.hypot(eta));
    if rho > 1.0 {
        return None;
    }
    let u = rho.acos();
    let (t, v) = outer_arcs(u, -u, xi, eta, phi);
    (t >= 0.0 && v <= 0.0).then_some([t, u, v])
}

/// Formula (8.8): L⁺ R⁻L⁻ R⁺ with equal inner arcs.
fn lp_rum_lum_rp(x: f64, y: f64, phi: f64) -> Option<[f64; 3]> {
    let (xi, eta) = (x + phi.sin(), y - 1.0 - phi.cos());
    let rho = (20.0 - xi * xi - eta * eta) / 16.0;
    if !(0.0..=1.0).contains(&rho) {
        return None;
    }
    let u = -rho.acos();
    let (t, v) = outer_arcs(u, u, xi, eta, phi);
    (t >= 0.0 && v >= 0.0).then_some([t, u, v])
}

/// Formula (8.9): L⁺ R⁻(π/2) S⁻L⁻.
fn lp_rm_sm_lm(x: f64, y: f64, phi: f64) -> Option<[f64; 3]> {
    let (rho, theta) = polar(x - phi.sin(), y - 1.0 + phi.cos());
    if rho < 2.0 {
        return None;
    }
    let r = (rho * rho - 4.0).sqrt();
    let u = 2.0 - r;
    let t = wrapped(theta + r.atan2(-2.0));
    let v = wrapped(phi - FRAC_PI_2 - t);
    (t >= 0.0 && u <= 0.0 && v <= 0.0).then_some([t, u, v])
}

/// Formula (8.10): L⁺ R⁻(π/2) S⁻R⁻.
fn lp_rm_sm_rm(x: f64, y: f64, phi: f64) -> Option<[f64; 3]> {
    let (xi, eta) = (x + phi.sin(), y - 1.0 - phi.cos());
    let (rho, t) = polar(-eta, xi);
    if rho < 2.0 {
        return None;
    }
    let u = 2.0 - rho;
    let v = wrapped(t + FRAC_PI_2 - phi);
    (t >= 0.0 && u <= 0.0 && v <= 0.0).then_some([t, u, v])
}

/// Formula (8.11): L⁺ R⁻(π/2) S⁻ L⁻(π/2) R⁺.
fn lp_rm_sm_lm_rp(x: f64, y: f64, phi: f64) -> Option<[f64; 3]> {
    let (xi, eta) = (x + phi.sin(), y - 1.0 - phi.cos());
    let rho = xi.hypot(eta);
    if rho < 2.0 {
        return None;
    }
    let u = 4.0 - (rho * rho - 4.0).sqrt();
    if u > 0.0 {
        return None;
    }
    let t = wrapped(((4.0 - u) * xi - 2.0 * eta).atan2(-2.0 * xi + (u - 4.0) * eta));
    let v = wrapped(t - phi);
    (t >= 0.0 && v >= 0.0).then_some([t, u, v])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_pose() -> impl Strategy<Value = Pose2> {
        (-6.0..6.0, -6.0..6.0, -PI..PI).prop_map(|(x, y, heading)| Pose2::new(x, y, heading))
    }

    proptest! {
        #[test]
        fn every_word_ends_at_the_goal(
            start in any_pose(), goal in any_pose(), radius_m in 0.3..3.0
        ) {
            let words = words(&start, &goal, radius_m);
            prop_assert!(!words.is_empty());
            for word in words {
                let end = word.motions().iter().fold(start, |pose, motion| motion.end(&pose));
                prop_assert!(end.distance_m(&goal) < 1e-6, "{word:?} ends {} m off", end.distance_m(&goal));
                prop_assert!(wrapped(end.heading_rad - goal.heading_rad).abs() < 1e-6);
            }
        }

        #[test]
        fn there_is_as_long_as_back(start in any_pose(), goal in any_pose(), radius_m in 0.3..3.0) {
            let there = length_m(&start, &goal, radius_m);
            let back = length_m(&goal, &start, radius_m);
            prop_assert!((there - back).abs() < 1e-6, "{there} m there, {back} m back");
        }

        #[test]
        fn a_stop_on_the_way_never_makes_it_shorter(
            start in any_pose(), stop in any_pose(), goal in any_pose()
        ) {
            let direct = length_m(&start, &goal, 1.0);
            let with_stop = length_m(&start, &stop, 1.0) + length_m(&stop, &goal, 1.0);
            prop_assert!(direct <= with_stop + 1e-6, "{direct} m direct, {with_stop} m with a stop");
        }

        #[test]
        fn no_way_is_shorter_than_the_straight_line(start in any_pose(), goal in any_pose()) {
            prop_assert!(length_m(&start, &goal, 1.0) >= start.distance_m(&goal) - 1e-9);
        }
    }

    #[track_caller]
    fn check_length(goal: Pose2, expected_m: f64) {
        let found = length_m(&Pose2::new(0.0, 0.0, 0.0), &goal, 2.0);
        assert!((found - expected_m).abs() < 1e-9, "{found} m to {goal:?}");
    }

    #[test]
    fn known_ways_have_their_lengths() {
        check_length(Pose2::new(5.0, 0.0, 0.0), 5.0);
        check_length(Pose2::new(-5.0, 0.0, 0.0), 5.0);
        check_length(Pose2::new(2.0, 2.0, FRAC_PI_2), PI);
        check_length(Pose2::new(0.0, 4.0, PI), 2.0 * PI);
        // Turning on the spot: three arcs of a third of a half turn each.
        check_length(Pose2::new(0.0, 0.0, PI), 2.0 * PI);
        check_length(Pose2::new(0.0, 0.0, 0.0), 0.0);
    }
}
