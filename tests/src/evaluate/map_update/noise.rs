//! Chance.

use rand::RngExt as _;
use rand_pcg::Pcg64;

/// A normal value with mean 0 and deviation 1, after G. Box and M. Muller.
pub(super) fn normal(random: &mut Pcg64) -> f64 {
    let (u, v): (f64, f64) = (random.random_range(f64::MIN_POSITIVE..1.0), random.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Whether something happens that does with this probability.
pub(super) fn happens(random: &mut Pcg64, probability: f64) -> bool {
    random.random::<f64>() < probability
}

/// A number within 0..1 that is always the same for the same place: chance that does not change its mind.
pub(super) fn fate(seed: u64, [x, y, z]: [i64; 3]) -> f64 {
    let mut hash = seed ^ 0x9e37_79b9_7f4a_7c15;
    for c in [x, y, z] {
        // The finaliser of SplitMix64.
        hash = (hash ^ c.cast_unsigned()).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = (hash ^ hash >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        hash ^= hash >> 31;
    }
    (hash >> 11) as f64 / (1_u64 << 53) as f64
}
