//! The search for a rule's best parameters: the same for every rule, with the same number of tries.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::noise::{happens, normal};
use super::rules::Knob;

/// How often a rule may be tried.
pub(super) const TRIES: usize = 70;

/// The values that make `goodness` greatest among [`TRIES`]: from the start, and from the best so far some knobs are turned
/// by chance, further where that helped, less where it did not.
pub(super) fn fit(knobs: &[Knob], mut goodness: impl FnMut(&[f64]) -> f64) -> Vec<f64> {
    let mut random = Pcg64::seed_from_u64(knobs.len() as u64);
    let mut best: Vec<_> = knobs.iter().map(|knob| knob.start).collect();
    let mut most = goodness(&best);
    let mut reach = 0.15;
    // A rule with one knob or none needs no more than a few.
    for _ in 1..TRIES {
        let chosen = random.random_range(0..knobs.len());
        let others = (2.0 / knobs.len() as f64).min(0.5);
        let mut tried = best.clone();
        for (index, (value, knob)) in tried.iter_mut().zip(knobs).enumerate() {
            if index == chosen || happens(&mut random, others) {
                *value = turned(knob, *value, reach * normal(&mut random));
            }
        }
        let good = goodness(&tried);
        if good > most {
            (best, most) = (tried, good);
            reach = (reach * 1.5).min(0.5);
        } else {
            reach = (reach * 0.95).max(0.03);
        }
    }
    best
}

/// A value moved by a share of its knob's range, and kept within it.
fn turned(knob: &Knob, value: f64, share: f64) -> f64 {
    let [low, high] = knob.range;
    if low > 0.0 {
        (value * (high / low).powf(share)).clamp(low, high)
    } else {
        (value + share * (high - low)).clamp(low, high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hill_is_climbed_within_the_ranges() {
        let knob = |range, start| Knob {
            name: "",
            range,
            start,
        };
        let knobs = [knob([0.01, 10.0], 1.0), knob([-1.0, 1.0], 0.0)];
        let best = fit(&knobs, |at| {
            -(at[0].ln() - 0.1_f64.ln()).powi(2) - (at[1] - 2.0).powi(2)
        });
        assert!((best[0] / 0.1).ln().abs() < 0.7, "{best:?}");
        assert!(
            best[1] > 0.9 && best[1] <= 1.0,
            "the top is outside: {best:?}"
        );
    }
}
