//! Which way someone on foot turns: the direction that leads nearest to where they want to go before they would have
//! to stop.
//!
//! ```text
//! d(α)² = d_max² + f(α)² - 2·d_max·f(α)·cos(α₀ - α)      v ≤ f(α)/τ
//! ```
//!
//! where `f(α)` is how far they get in the direction `α` until they would touch someone, as these move now, or
//! something, and `α₀` leads to the goal.
//!
//! - M. Moussaïd, D. Helbing, G. Theraulaz, PNAS 108, 2011.

use nalgebra::{Rotation2, Vector2};

use super::Obstacle;
use super::path::direction;

/// Nobody looks farther.
pub(super) const SIGHT_M: f64 = 6.0;
/// Half the width of a body.
pub(super) const BODY_M: f64 = 0.25;
/// People plan to leave so much free beside others.
const BERTH_M: f64 = 0.12;
/// Half of what they see, and the angle between the directions they try.
const VIEW_RAD: f64 = 1.3;
const TURN_RAD: f64 = 0.22;
/// As [`VIEW_RAD`], for those who got stuck and look round.
const LOOK_ROUND_RAD: f64 = 2.9;

/// Someone near.
pub(super) struct Neighbour {
    pub(super) at: Vector2<f64>,
    pub(super) velocity: Vector2<f64>,
}

/// What someone who wants to go somewhere sees.
pub(super) struct View<'a> {
    pub(super) at: Vector2<f64>,
    pub(super) wanted_rad: f64,
    pub(super) speed_mps: f64,
    pub(super) neighbours: &'a [Neighbour],
    pub(super) obstacles: &'a [Obstacle],
    pub(super) edges: Option<Edges>,
    pub(super) stuck: bool,
}

/// The edges of the way someone is on.
pub(super) struct Edges {
    /// Direction of the way.
    pub(super) heading_rad: f64,
    /// Room to its left and to its right.
    pub(super) room_m: [f64; 2],
}

/// A direction, and how far one gets in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Choice {
    pub(super) heading_rad: f64,
    pub(super) free_m: f64,
}

/// The best direction. To the right if it does not matter, so that two who meet do not dance.
pub(super) fn choose(view: &View<'_>) -> Choice {
    let widest_rad = if view.stuck { LOOK_ROUND_RAD } else { VIEW_RAD };
    let tries = (widest_rad / TURN_RAD) as u32;
    let mut best = Choice {
        heading_rad: view.wanted_rad,
        free_m: view.free_m(view.wanted_rad),
    };
    let mut least = cost(best, view.wanted_rad);
    for i in 1..=tries {
        for side in [-1.0, 1.0] {
            let heading_rad = view.wanted_rad + side * f64::from(i) * TURN_RAD;
            // Not even a free way this far aside would be better.
            if cost(
                Choice {
                    heading_rad,
                    free_m: SIGHT_M * (heading_rad - view.wanted_rad).cos().max(0.0),
                },
                view.wanted_rad,
            ) >= least
            {
                continue;
            }
            let choice = Choice {
                heading_rad,
                free_m: view.free_m(heading_rad),
            };
            let cost = cost(choice, view.wanted_rad);
            if cost < least {
                (best, least) = (choice, cost);
            }
        }
    }
    best
}

/// The squared distance to the goal from where the direction ends.
fn cost(choice: Choice, wanted_rad: f64) -> f64 {
    let f = choice.free_m;
    SIGHT_M * SIGHT_M + f * f - 2.0 * SIGHT_M * f * (wanted_rad - choice.heading_rad).cos()
}

impl View<'_> {
    fn free_m(&self, heading_rad: f64) -> f64 {
        let ahead = direction(heading_rad);
        let mut free_m = SIGHT_M;
        for other in self.neighbours {
            let closing = ahead * self.speed_mps - other.velocity;
            let reach_m = 2.0 * BODY_M + BERTH_M;
            if let Some(time_s) = contact(other.at - self.at, closing, reach_m) {
                free_m = free_m.min(time_s * self.speed_mps);
            }
        }
        for obstacle in self.obstacles {
            if let Some(way_m) = obstacle.contact_m(self.at, ahead) {
                free_m = free_m.min(way_m);
            }
        }
        if let Some(edges) = &self.edges {
            let aside = (heading_rad - edges.heading_rad).sin();
            let room_m = edges.room_m[usize::from(aside < 0.0)].max(0.0);
            // Along the edge one gets as far as one likes.
            if aside.abs() > 0.05 {
                free_m = free_m.min(room_m / aside.abs());
            }
        }
        free_m
    }
}

/// When something at `offset` that comes nearer by `closing` per unit of time is at the distance `reach`.
fn contact(offset: Vector2<f64>, closing: Vector2<f64>, reach: f64) -> Option<f64> {
    let nearing = offset.dot(&closing);
    if nearing <= 0.0 {
        return None;
    }
    let excess = offset.norm_squared() - reach * reach;
    if excess <= 0.0 {
        return Some(0.0);
    }
    let discriminant = nearing * nearing - closing.norm_squared() * excess;
    (discriminant >= 0.0).then(|| (nearing - discriminant.sqrt()) / closing.norm_squared())
}

impl Obstacle {
    /// From its surface to a point; zero inside it.
    pub fn distance_m(&self, point: [f64; 2]) -> f64 {
        match *self {
            Self::Circle { centre, radius_m } => {
                let away = Vector2::from(point) - Vector2::from(centre);
                (away.norm() - radius_m).max(0.0)
            }
            Self::Box { size_m, .. } => {
                let outside = self.in_its_frame(point.into()).abs() - Vector2::from(size_m) / 2.0;
                outside.sup(&Vector2::zeros()).norm()
            }
        }
    }

    /// How far someone gets in that direction until they touch it.
    fn contact_m(&self, from: Vector2<f64>, ahead: Vector2<f64>) -> Option<f64> {
        let reach_m = BODY_M + BERTH_M;
        match *self {
            Self::Circle { centre, radius_m } => {
                contact(Vector2::from(centre) - from, ahead, radius_m + reach_m)
            }
            Self::Box {
                heading_rad,
                size_m,
                ..
            } => {
                let half = Vector2::from(size_m) / 2.0 + Vector2::repeat(reach_m);
                let place = self.in_its_frame(from);
                let way = Rotation2::new(-heading_rad) * ahead;
                let (mut enters_m, mut leaves_m) = (f64::NEG_INFINITY, f64::INFINITY);
                for axis in 0..2 {
                    // A way along a side never meets that pair of sides: the quotients are infinite, as they should be.
                    let speed = if way[axis].abs() < 1e-9 {
                        1e-9
                    } else {
                        way[axis]
                    };
                    let [a, b] = [-half[axis], half[axis]].map(|side| (side - place[axis]) / speed);
                    enters_m = enters_m.max(a.min(b));
                    leaves_m = leaves_m.min(a.max(b));
                }
                let nearing = place.dot(&way) < 0.0;
                (enters_m <= leaves_m && leaves_m > 0.0 && (enters_m > 0.0 || nearing))
                    .then_some(enters_m.max(0.0))
            }
        }
    }

    fn in_its_frame(&self, point: Vector2<f64>) -> Vector2<f64> {
        match *self {
            Self::Circle { centre, .. } => point - Vector2::from(centre),
            Self::Box {
                centre,
                heading_rad,
                ..
            } => Rotation2::new(-heading_rad) * (point - Vector2::from(centre)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where someone at the origin who wants to go east turns, with that before them.
    fn choose_before(neighbours: &[Neighbour], obstacles: &[Obstacle]) -> Choice {
        choose(&View {
            at: Vector2::zeros(),
            wanted_rad: 0.0,
            speed_mps: 1.3,
            neighbours,
            obstacles,
            edges: None,
            stuck: false,
        })
    }

    #[test]
    fn on_a_free_way_people_go_straight() {
        let choice = choose_before(&[], &[]);
        assert!(choice.heading_rad.abs() < 1e-12 && choice.free_m >= SIGHT_M);
    }

    #[test]
    fn people_step_aside_to_the_right_for_someone_who_comes() {
        let other = Neighbour {
            at: Vector2::new(4.0, 0.0),
            velocity: Vector2::new(-1.3, 0.0),
        };
        let choice = choose_before(&[other], &[]);
        assert!((-0.7..-0.1).contains(&choice.heading_rad), "{choice:?}");
    }

    #[test]
    fn people_walk_round_poles_and_boxes() {
        let centre = [2.0, 0.1];
        for obstacle in [
            Obstacle::Circle {
                centre,
                radius_m: 0.2,
            },
            Obstacle::Box {
                centre,
                heading_rad: 0.3,
                size_m: [0.4, 0.3],
            },
        ] {
            let choice = choose_before(&[], &[obstacle]);
            assert!((-0.7..-0.1).contains(&choice.heading_rad), "{choice:?}");
        }
    }

    #[test]
    fn the_distance_of_a_box_is_that_of_its_sides_and_corners() {
        let obstacle = Obstacle::Box {
            centre: [1.0, 1.0],
            heading_rad: std::f64::consts::FRAC_PI_2,
            size_m: [4.0, 2.0],
        };
        for (point, expected_m) in [
            ([4.0, 1.0], 2.0),
            ([1.0, 4.0], 1.0),
            ([5.0, 7.0], 5.0),
            ([1.5, 2.5], 0.0),
        ] {
            assert!(
                (obstacle.distance_m(point) - expected_m).abs() < 1e-12,
                "{point:?}"
            );
        }
    }
}
