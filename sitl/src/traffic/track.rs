//! Where someone is at any time: samples every 0.1 s and a smooth curve through them.
//!
//! ```text
//! p(u) = h₀₀(u)·pᵢ + h₁₀(u)·mᵢ + h₀₁(u)·pᵢ₊₁ + h₁₁(u)·mᵢ₊₁      mᵢ = (pᵢ₊₁ - pᵢ₋₁)/2
//! ```
//!
//! The curve's derivative is the speed reported, so that the two agree at any time and not just at the samples.
//!
//! - E. Catmull, R. Rom, *A class of local interpolating splines*, Computer Aided Geometric Design, 1974.

use maps::time::Stamp;
use nalgebra::Vector2;

use super::kind::Kind;

/// Time between samples.
pub(super) const PERIOD_NANOS: u64 = 100_000_000;
const PERIOD_S: f64 = PERIOD_NANOS as f64 * 1e-9;

/// One road user's way through time.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// What it is.
    pub kind: Kind,
    /// Chooses its looks.
    pub seed: u32,
    /// Length, width and height in metres.
    pub size_m: [f64; 3],
    nodes: Vec<Node>,
}

/// Where a road user is, and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Its middle, on the ground: east and north in metres.
    pub position: [f64; 2],
    /// Where its front points, counter-clockwise from east. Not wrapped: it goes on beyond π, without a jump.
    pub heading_rad: f64,
    /// How fast its middle moves over the ground.
    pub speed_mps: f64,
    /// How far it has come, for wheels and legs. Never less than a moment before.
    pub travelled_m: f64,
}

/// A sample. Single precision is 0.06 mm at 1 km.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    /// Not a number while it is away.
    position: [f32; 2],
    heading_rad: f32,
    travelled_m: f32,
}

impl Track {
    pub(super) fn new(kind: Kind, seed: u32, size_m: [f64; 3]) -> Self {
        Self {
            kind,
            seed,
            size_m,
            nodes: Vec::new(),
        }
    }

    /// Adds the next sample: where it is, or nothing while it is away. The heading may be wrapped.
    pub(super) fn push(&mut self, state: Option<State>) {
        let node = match state {
            None => Node {
                position: [f32::NAN; 2],
                heading_rad: 0.0,
                travelled_m: 0.0,
            },
            Some(state) => {
                let before = self.nodes.last().filter(|node| node.is_present());
                let heading_rad = before.map_or(state.heading_rad, |node| {
                    let before_rad = f64::from(node.heading_rad);
                    before_rad + super::path::wrapped(state.heading_rad - before_rad)
                });
                Node {
                    position: state.position.map(|x| x as f32),
                    heading_rad: heading_rad as f32,
                    travelled_m: state.travelled_m as f32,
                }
            }
        };
        self.nodes.push(node);
    }

    /// Where it is at that moment; `None` while it is away, and from the end of the simulation on.
    pub fn state(&self, at: Stamp) -> Option<State> {
        let index = usize::try_from(at.as_nanos() / PERIOD_NANOS).ok()?;
        let u = (at.as_nanos() % PERIOD_NANOS) as f64 / PERIOD_NANOS as f64;
        let from = self.node(index)?;
        let to = self.node(index.checked_add(1)?)?;
        let (p, q) = (from.place(), to.place());
        let before = index.checked_sub(1).and_then(|i| self.node(i));
        let after = self.node(index + 2);
        let m = before.map_or(q - p, |before| (q - before.place()) / 2.0);
        let n = after.map_or(q - p, |after| (after.place() - p) / 2.0);
        let (u2, u3) = (u * u, u * u * u);
        let position = p * (2.0 * u3 - 3.0 * u2 + 1.0)
            + m * (u3 - 2.0 * u2 + u)
            + q * (3.0 * u2 - 2.0 * u3)
            + n * (u3 - u2);
        let per_period = (q - p) * (6.0 * u - 6.0 * u2)
            + m * (3.0 * u2 - 4.0 * u + 1.0)
            + n * (3.0 * u2 - 2.0 * u);
        Some(State {
            position: position.into(),
            heading_rad: between(from.heading_rad, to.heading_rad, u),
            speed_mps: per_period.norm() / PERIOD_S,
            travelled_m: between(from.travelled_m, to.travelled_m, u),
        })
    }

    fn node(&self, index: usize) -> Option<&Node> {
        self.nodes.get(index).filter(|node| node.is_present())
    }
}

impl Node {
    fn is_present(&self) -> bool {
        !self.position[0].is_nan()
    }

    fn place(&self) -> Vector2<f64> {
        Vector2::from(self.position.map(f64::from))
    }
}

fn between(from: f32, to: f32, share: f64) -> f64 {
    f64::from(from) + (f64::from(to) - f64::from(from)) * share
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Someone who drives round a circle of 10 m at 5 m/s, away in the third second.
    fn on_a_circle() -> Track {
        let mut track = Track::new(Kind::Car, 1, Kind::Car.size_m());
        for i in 0..60 {
            let angle = f64::from(i) * 0.05;
            let state = State {
                position: [10.0 * angle.cos(), 10.0 * angle.sin()],
                heading_rad: crate::traffic::path::wrapped(angle + PI / 2.0),
                speed_mps: 5.0,
                travelled_m: 10.0 * angle,
            };
            track.push((!(20..30).contains(&i)).then_some(state));
        }
        track
    }

    #[test]
    fn between_samples_it_stays_on_its_way_at_its_speed() {
        let track = on_a_circle();
        for nanos in (0..5_900_000_000).step_by(7_300_000) {
            let Some(state) = track.state(Stamp::from_nanos(nanos)) else {
                continue;
            };
            let radius = Vector2::from(state.position).norm();
            // Where it comes or goes the curve has one neighbour less.
            assert!((radius - 10.0).abs() < 5e-3, "{radius} m at {nanos}");
            assert!((state.speed_mps - 5.0).abs() < 0.05, "{state:?}");
        }
    }

    #[test]
    fn it_is_nowhere_while_away_and_after_the_end() {
        let track = on_a_circle();
        let present = |millis: u64| track.state(Stamp::from_nanos(millis * 1_000_000)).is_some();
        assert!(present(0) && present(1899) && !present(1900) && !present(2999) && present(3000));
        assert!(present(5899) && !present(5900));
        assert!(track.state(Stamp::from_nanos(u64::MAX)).is_none());
    }
}
