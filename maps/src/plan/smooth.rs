//! Makes a path shorter and calmer by shortest ways between its own poses.
//!
//! Every piece of a path, from long to short, gives way to the shortest way between its ends where that is free and
//! cheaper. Each way is a chain of arcs that the vehicle can follow and is judged like any other, so that the turning
//! radius and the clearance hold throughout; nothing is fitted or averaged. Wider circles are tried before the narrowest.

use super::motion::{Motion, Pose2};
use super::reeds_shepp;
use super::search::{Problem, is_free};

/// The poses of a path at which it may be cut.
const PIECES: usize = 48;
/// Circles tried, in turning radii.
const RADII: [f64; 3] = [3.0, 1.5, 1.0];
/// Nearer than this to a joint is at it.
const JOINT_M: f64 = 1e-6;
/// A piece is replaced only by one that is cheaper by more than rounding.
const CHEAPER: f64 = 1.0 - 1e-6;

/// The motions of a path no more expensive than that of `motions`.
pub(crate) fn shorten(problem: &Problem<'_>, motions: Vec<Motion>) -> Vec<Motion> {
    let mut path = joined(motions);
    let mut span = PIECES;
    while span >= 2 {
        path = pass(problem, path, span);
        span /= 2;
    }
    path
}

/// One pass over the path, by pieces of `span` of its [`PIECES`] parts that overlap by half.
fn pass(problem: &Problem<'_>, mut path: Vec<Motion>, span: usize) -> Vec<Motion> {
    let length: f64 = path.iter().map(Motion::length_m).sum();
    let part = length / PIECES as f64;
    if part <= 0.0 {
        return path;
    }
    let mut first = 0;
    loop {
        // The path becomes shorter on the way, so that a piece may begin beyond its end.
        let (from, to) = (first as f64 * part, (first + span) as f64 * part);
        let length: f64 = path.iter().map(Motion::length_m).sum();
        if from >= length {
            return joined(path);
        }
        let (before, rest) = split(path, from);
        let (piece, after) = split(rest, to - from);
        let start = end_of(&problem.start, &before);
        let piece = better(problem, &start, &before, piece, &after);
        path = before;
        path.extend(piece);
        path.extend(after);
        first += span.div_ceil(2);
    }
}

/// A cheaper free way to the end of `piece`, or `piece` itself.
fn better(
    problem: &Problem<'_>,
    start: &Pose2,
    before: &[Motion],
    piece: Vec<Motion>,
    after: &[Motion],
) -> Vec<Motion> {
    let costs = &problem.costs;
    let goal = end_of(start, &piece);
    let gear = before.last().map(Motion::gear);
    // What follows may be in another gear.
    let cost = |motions: &[Motion]| {
        let change = motions.last().map(Motion::gear).or(gear);
        let then = after
            .first()
            .map_or(0.0, |next| costs.of_change(change, next.gear()));
        costs.of_chain(start, gear, motions) + then
    };
    let mut cheapest = cost(&piece);
    let mut best = piece;
    for radius in RADII {
        let mut ways: Vec<_> = reeds_shepp::words(start, &goal, radius * problem.radius_m)
            .into_iter()
            .map(|word| (costs.at_least(gear, word.motions()), word))
            .filter(|(least, _)| *least < cheapest * CHEAPER)
            .collect();
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (least, word) in ways.into_iter().take(2) {
            if least >= cheapest * CHEAPER {
                break;
            }
            let total = cost(word.motions());
            if total < cheapest * CHEAPER && is_free(&problem.checker, start, word.motions()) {
                cheapest = total;
                best = word.motions().to_vec();
            }
        }
    }
    best
}

pub(crate) fn end_of(start: &Pose2, motions: &[Motion]) -> Pose2 {
    motions
        .iter()
        .fold(*start, |pose, motion| motion.end(&pose))
}

/// The path up to about `at_m` along it, and the rest. Where a joint of two motions is as near as [`JOINT_M`], it is cut
/// there: a sliver left over would become a change of gear for nothing.
pub(crate) fn split(path: Vec<Motion>, at_m: f64) -> (Vec<Motion>, Vec<Motion>) {
    let (mut before, mut after) = (Vec::new(), Vec::new());
    let mut left = at_m;
    for motion in path {
        let length = motion.length_m();
        if left >= length - JOINT_M {
            before.push(motion);
        } else if left > JOINT_M {
            before.push(motion.until(left));
            after.push(motion.after(left));
        } else {
            after.push(motion);
        }
        left -= length;
    }
    (before, after)
}

/// The same path with motions along the same circle in the same gear made one.
pub(crate) fn joined(path: Vec<Motion>) -> Vec<Motion> {
    let mut result: Vec<Motion> = Vec::with_capacity(path.len());
    for motion in path {
        match result.last_mut() {
            Some(last)
                if (last.curvature - motion.curvature).abs() < 1e-9
                    && last.gear() == motion.gear() =>
            {
                last.signed_m += motion.signed_m;
            }
            _ => result.push(motion),
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_beside_a_joint_is_made_at_the_joint() {
        let there = Motion {
            curvature: 0.3,
            signed_m: 1.0,
        };
        let back = Motion {
            curvature: 0.3,
            signed_m: -2.0,
        };
        for at_m in [1.0 - 1e-15, 1.0, 1.0 + 1e-15, 1.0 + 1e-7] {
            let (before, after) = split(vec![there, back], at_m);
            assert_eq!((before, after), (vec![there], vec![back]), "at {at_m} m");
        }
        let (before, after) = split(vec![there, back], 1.5);
        assert_eq!(before, [there, back.until(0.5)]);
        assert_eq!(after, [back.after(0.5)]);
    }
}
