//! How much speaks for *occupied*, for *free*, and how much for nothing.

/// A split of a mass of 1 between occupied `O`, free `F` and unknown `Θ = {O, F}`.
///
/// Invariant: both kept masses are within 0..=1 and add up to at most 1; the rest is ignorance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mass {
    occupied: f32,
    free: f32,
}

/// What sums of masses may be off by, from rounding.
const ROUNDING: f32 = 1e-6;

impl Mass {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self {
        occupied: 0.0,
        free: 0.0,
    };

    /// These masses; `None` unless they are numbers, not negative, and at most 1 together.
    pub fn new(occupied: f32, free: f32) -> Option<Self> {
        // NaN fails every comparison.
        let is_valid = occupied >= 0.0 && free >= 0.0 && occupied + free <= 1.0 + ROUNDING;
        is_valid.then(|| Self::normalized(occupied, free))
    }

    /// This much for occupied; within 0..=1, NaN counts as nothing.
    pub fn occupied_by(mass: f32) -> Self {
        Self {
            occupied: unit(mass),
            free: 0.0,
        }
    }

    /// This much for free; within 0..=1, NaN counts as nothing.
    pub fn free_by(mass: f32) -> Self {
        Self {
            occupied: 0.0,
            free: unit(mass),
        }
    }

    /// The least that somebody who claims this probability of being occupied must believe: what is above one half for
    /// occupied, or below it for free, and the rest for nothing. NaN gives ignorance.
    pub fn least_committed(probability: f32) -> Self {
        let lean = 2.0 * probability - 1.0;
        if lean > 0.0 {
            Self::occupied_by(lean)
        } else {
            Self::free_by(-lean)
        }
    }

    /// The masses of weights of evidence, see [`weight`]: `m(O) ∝ (1 - e⁻ᵒ) e⁻ᶠ`, `m(F) ∝ e⁻ᵒ (1 - e⁻ᶠ)`, `m(Θ) ∝ e⁻ᵒ e⁻ᶠ`.
    pub(crate) fn of_weights(occupied: f32, free: f32) -> Self {
        let (against_occupied, against_free) = ((-occupied).exp(), (-free).exp());
        // 1 - K, without the difference of two numbers near 1.
        let agreement = against_occupied + against_free - against_occupied * against_free;
        if agreement <= f32::MIN_POSITIVE {
            return Self::UNKNOWN;
        }
        Self::normalized(
            (1.0 - against_occupied) * against_free / agreement,
            (1.0 - against_free) * against_occupied / agreement,
        )
    }

    /// What speaks for occupied.
    pub fn occupied(self) -> f32 {
        self.occupied
    }

    /// What speaks for free.
    pub fn free(self) -> f32 {
        self.free
    }

    /// What speaks for neither.
    pub fn unknown(self) -> f32 {
        (1.0 - self.occupied - self.free).max(0.0)
    }

    /// Whether nothing is known at all.
    pub fn is_unknown(self) -> bool {
        self == Self::UNKNOWN
    }

    /// The probability of being occupied that one would bet on: ignorance counts half (the pignistic probability).
    pub fn probability(self) -> f32 {
        unit(self.occupied + 0.5 * self.unknown())
    }

    /// What is left of it for somebody who trusts its source this much: the rest becomes ignorance. Within 0..=1.
    #[must_use]
    pub fn discounted(self, trust: f32) -> Self {
        let trust = unit(trust);
        Self {
            occupied: self.occupied * trust,
            free: self.free * trust,
        }
    }

    /// How much two sources contradict each other: `K = m₁(O)·m₂(F) + m₁(F)·m₂(O)`, within 0..=1.
    pub fn conflict(self, other: Self) -> f32 {
        unit(self.occupied * other.free + self.free * other.occupied)
    }

    /// What two independent sources say together, by Dempster's rule; `None` if they contradict each other wholly.
    pub fn combined(self, other: Self) -> Option<Self> {
        let agreement = 1.0 - self.conflict(other);
        if agreement < ROUNDING {
            return None;
        }
        let joint = |a: f32, b: f32| (a * b + a * other.unknown() + self.unknown() * b) / agreement;
        Some(Self::normalized(
            joint(self.occupied, other.occupied),
            joint(self.free, other.free),
        ))
    }

    /// Within the invariant, whatever rounding did.
    fn normalized(occupied: f32, free: f32) -> Self {
        let (occupied, free) = (unit(occupied), unit(free));
        let excess = (occupied + free).max(1.0);
        Self {
            occupied: occupied / excess,
            free: free / excess,
        }
    }
}

/// The weight of evidence of a mass, `-ln(1 - m)`: weights of independent evidence for the same thing add. A certainty
/// counts as 1 - 10⁻⁴.
///
/// - G. Shafer, *A Mathematical Theory of Evidence*, Princeton University Press, 1976, ch. 5.
pub(crate) fn weight(mass: f32) -> f32 {
    -(-mass.clamp(0.0, 1.0 - 1e-4)).ln_1p()
}

/// Within 0..=1; NaN becomes 0.
fn unit(value: f32) -> f32 {
    if value > 0.0 { value.min(1.0) } else { 0.0 }
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;

    pub(crate) fn any_mass() -> impl Strategy<Value = Mass> {
        (0.0_f32..=1.0, 0.0_f32..=1.0).prop_map(|(share, known)| {
            Mass::new(share * known, (1.0 - share) * known).expect("within the invariant")
        })
    }

    #[track_caller]
    fn check_valid(mass: Mass) {
        let sum = mass.occupied() + mass.free() + mass.unknown();
        assert!(mass.occupied() >= 0.0 && mass.free() >= 0.0, "{mass:?}");
        assert!(
            (sum - 1.0).abs() <= 2.0 * ROUNDING,
            "{mass:?} adds up to {sum}"
        );
    }

    fn near(a: Mass, b: Mass) -> bool {
        (a.occupied - b.occupied).abs() < 1e-4 && (a.free - b.free).abs() < 1e-4
    }

    proptest! {
        #[test]
        fn masses_stay_valid(a in any_mass(), b in any_mass(), trust in -1.0_f32..2.0) {
            check_valid(a);
            check_valid(a.discounted(trust));
            a.combined(b).into_iter().for_each(check_valid);
            prop_assert!((0.0..=1.0).contains(&a.probability()));
        }

        #[test]
        fn the_order_of_independent_sources_does_not_matter(a in any_mass(), b in any_mass(), c in any_mass()) {
            // Away from total conflict, where rounding is all that is left.
            let [a, b, c] = [a, b, c].map(|m| m.discounted(0.9));
            let left = a.combined(b).and_then(|ab| ab.combined(c)).expect("no total conflict");
            let right = c.combined(b).and_then(|cb| a.combined(cb)).expect("no total conflict");
            prop_assert!(near(left, right), "{left:?} {right:?}");
        }

        #[test]
        fn ignorance_changes_nothing(a in any_mass()) {
            let same = a.combined(Mass::UNKNOWN).expect("no conflict");
            prop_assert!(near(same, a), "{same:?}");
        }

        #[test]
        fn weights_add_where_masses_combine(o in 0.0_f32..0.95, p in 0.0_f32..0.95, f in 0.0_f32..0.95) {
            let combined = Mass::occupied_by(o).combined(Mass::occupied_by(p))
                .and_then(|m| m.combined(Mass::free_by(f))).expect("no total conflict");
            let added = Mass::of_weights(weight(o) + weight(p), weight(f));
            prop_assert!(near(combined, added), "{combined:?} {added:?}");
        }

        #[test]
        fn any_weights_make_a_valid_mass(o in 0.0_f32..1e6, f in 0.0_f32..1e6) {
            check_valid(Mass::of_weights(o, f));
        }
    }

    #[test]
    fn what_is_no_mass_is_refused_or_counts_as_nothing() {
        for (occupied, free) in [
            (f32::NAN, 0.0),
            (0.0, f32::NAN),
            (-0.1, 0.5),
            (0.7, 0.4),
            (f32::INFINITY, 0.0),
        ] {
            assert_eq!(Mass::new(occupied, free), None, "{occupied} {free}");
        }
        assert_eq!(Mass::occupied_by(f32::NAN), Mass::UNKNOWN);
        assert_eq!(Mass::new(0.0, 1.0), Some(Mass::free_by(f32::INFINITY)));
        assert_eq!(Mass::least_committed(f32::NAN), Mass::UNKNOWN);
    }

    #[test]
    fn total_conflict_has_no_combination() {
        assert_eq!(Mass::occupied_by(1.0).combined(Mass::free_by(1.0)), None);
    }

    #[test]
    fn with_singletons_only_dempster_is_bayes() {
        let (p, q) = (0.8_f32, 0.7_f32);
        let [a, b] = [p, q].map(|p| Mass::new(p, 1.0 - p).expect("valid"));
        let bayes = p * q / (p * q + (1.0 - p) * (1.0 - q));
        let dempster = a.combined(b).expect("no total conflict").probability();
        assert!((dempster - bayes).abs() < 1e-6, "{dempster} {bayes}");
    }
}
