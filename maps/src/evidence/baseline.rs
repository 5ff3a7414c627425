//! Rules that keep one probability a voxel: the paper's three baselines, and log-odds with a matched sensor model.

use super::{Look, Mass, Observation, UpdateRule};
use crate::time::Stamp;

/// The probability that a voxel is occupied; `None` until it was seen.
pub type Probability = Option<f32>;

fn mass_of(probability: Probability) -> Mass {
    probability
        .and_then(|p| Mass::new(p, 1.0 - p))
        .unwrap_or(Mass::UNKNOWN)
}

/// Direct replacement: the last word counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Replace;

impl UpdateRule for Replace {
    type State = Probability;

    fn observe(&self, state: &mut Probability, _look: &Look, seen: &Observation) {
        if !seen.mass.is_unknown() {
            *state = Some(seen.mass.probability());
        }
    }

    fn mass(&self, state: &Probability, _now: Stamp) -> Mass {
        mass_of(*state)
    }
}

/// Fixed weights: `p ← (1 - w) p + w z`, with a weight for each source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear {
    /// What a new observation weighs, within 0..=1, by the index of [`Source::ALL`](super::Source::ALL).
    pub weights: [f32; 3],
}

/// Half for everybody.
impl Default for Linear {
    fn default() -> Self {
        Self { weights: [0.5; 3] }
    }
}

impl UpdateRule for Linear {
    type State = Probability;

    fn observe(&self, state: &mut Probability, look: &Look, seen: &Observation) {
        if seen.mass.is_unknown() {
            return;
        }
        let z = seen.mass.probability();
        let weight = self.weights[look.source.index()];
        *state = Some(state.map_or(z, |p| (p + weight * (z - p)).clamp(0.0, 1.0)));
    }

    fn mass(&self, state: &Probability, _now: Stamp) -> Mass {
        mass_of(*state)
    }
}

/// How much a source's word counts in log-odds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain {
    /// Factor for what speaks for occupied.
    pub occupied: f32,
    /// Factor for what speaks for free.
    pub free: f32,
}

/// Bayes with clamped log-odds: `l ← clamp(l + g·logit(z))`.
///
/// With gains of 1 ([`Default`]) it takes every observation at its word, as independent of all others. Gains that were
/// fitted for each source, to hits and to passes apart, make it a matched sensor model: the fairest rival.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogOddsRule {
    /// What a source's word counts, by the index of [`Source::ALL`](super::Source::ALL).
    pub gains: [Gain; 3],
    /// The least a voxel may have, in nats.
    pub least: f32,
    /// The most a voxel may have, in nats.
    pub greatest: f32,
}

/// At its word, clamped as `OctoMap` does.
impl Default for LogOddsRule {
    fn default() -> Self {
        let gain = Gain {
            occupied: 1.0,
            free: 1.0,
        };
        Self {
            gains: [gain; 3],
            least: -2.0,
            greatest: 3.5,
        }
    }
}

impl UpdateRule for LogOddsRule {
    /// Log-odds in nats.
    type State = Option<f32>;

    fn observe(&self, state: &mut Option<f32>, look: &Look, seen: &Observation) {
        if seen.mass.is_unknown() {
            return;
        }
        let z = seen.mass.probability().clamp(1e-3, 1.0 - 1e-3);
        let logit = (z / (1.0 - z)).ln();
        let gain = self.gains[look.source.index()];
        let gain = if logit > 0.0 {
            gain.occupied
        } else {
            gain.free
        };
        let sum = state.unwrap_or(0.0) + gain * logit;
        *state = Some(sum.max(self.least).min(self.greatest));
    }

    fn mass(&self, state: &Option<f32>, _now: Stamp) -> Mass {
        mass_of(state.map(|l| 1.0 / (1.0 + (-l).exp())))
    }
}
