//! The paper's rule, with the flaws it was printed with, and as it was probably meant.
//!
//! ```text
//! w = exp(-λΔt)                                 the age of what is known
//! P = P_bev P_w / (P_bev P_w + (1 - P_bev)(1 - P_w))       P_w = w P_prior + (1 - w)/2            (20)
//! m_prior(O) = w P_prior     m_prior(F) = w (1 - P_prior)     m_prior(Θ) = 1 - w                  (21)
//! m_bev(O) = P               m_bev(F) = 1 - P                                                     (22)
//! K = m_bev(O) m_prior(F) + m_bev(F) m_prior(O)                                                   (23)
//! K ≥ 0.3:  m(O) = confidence of the box, else m_bev(O) if dynamic, else m_prior(O)               (24)
//! K < 0.3:  m(O) = m_bev(O) m_prior(F) / (1 - K)           as printed                             (25)
//! ```
//!
//! What is wrong with it, kept here on purpose: (20) and (22) put the prior into the BEV's masses, so that combining
//! them with (21) counts it twice; (25) as printed multiplies *occupied* by *free*, so that two sources which agree on
//! occupied make the voxel free. [`Agreement::Corrected`] replaces (25) alone, by Dempster's rule.
//!
//! This is our reading of section 3.4.3: how (20) takes in `w` and what a dynamic voxel without a box gets is not spelt
//! out there. Where (24) falls back to the prior, its ignorance counts half.

use super::{Look, Mass, Mobility, Observation, UpdateRule};
use crate::time::Stamp;

/// What happens without conflict: Eq. (25).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Agreement {
    /// `m_bev(O) · m_prior(F) / (1 - K)`.
    #[default]
    AsPrinted,
    /// Dempster's rule.
    Corrected,
}

/// The paper's rule, Eq. (20) to (25).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paper {
    /// Per second: how fast what is known loses weight.
    pub decay_per_s: f32,
    /// The conflict from which semantics decide.
    pub conflict: f32,
    /// Which Eq. (25).
    pub agreement: Agreement,
}

/// The paper's threshold; it prints no λ, so ours halves the weight in ten seconds.
impl Default for Paper {
    fn default() -> Self {
        Self {
            decay_per_s: 0.07,
            conflict: 0.3,
            agreement: Agreement::AsPrinted,
        }
    }
}

/// What the paper's rule keeps of a voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PaperState {
    probability: Option<f32>,
    at: Stamp,
}

impl UpdateRule for Paper {
    type State = PaperState;

    fn observe(&self, state: &mut PaperState, look: &Look, seen: &Observation) {
        if seen.mass.is_unknown() {
            return;
        }
        let z = seen.mass.probability();
        let age_s = look.at.since(state.at).as_secs_f32();
        let w = (-self.decay_per_s.max(0.0) * age_s).exp();
        let p = state
            .probability
            .map_or(z, |known| self.updated(known, w, z, seen));
        *state = PaperState {
            probability: Some(p.clamp(1e-3, 1.0 - 1e-3)),
            at: state.at.max(look.at),
        };
    }

    fn mass(&self, state: &PaperState, _now: Stamp) -> Mass {
        state
            .probability
            .and_then(|p| Mass::new(p, 1.0 - p))
            .unwrap_or(Mass::UNKNOWN)
    }
}

impl Paper {
    /// The probability after seeing `z`, where `known` has kept the share `w` of its weight.
    fn updated(&self, known: f32, w: f32, z: f32, seen: &Observation) -> f32 {
        let aged = w * known + 0.5 * (1.0 - w);
        let evidence = z * aged + (1.0 - z) * (1.0 - aged);
        let bayes = if evidence > 0.0 {
            z * aged / evidence
        } else {
            0.5
        }; // Eq. (20)
        let prior = Mass::new(w * known, w * (1.0 - known)).unwrap_or(Mass::UNKNOWN); // Eq. (21)
        let bev = Mass::new(bayes, 1.0 - bayes).unwrap_or(Mass::UNKNOWN); // Eq. (22)
        let conflict = bev.conflict(prior); // Eq. (23)
        if conflict >= self.conflict {
            return match (seen.detection, seen.mobility) {
                (Some(confidence), _) => confidence,
                (None, Mobility::Movable | Mobility::Moving) => bev.occupied(),
                (None, Mobility::Static | Mobility::Unknown) => prior.probability(),
            }; // Eq. (24)
        }
        match self.agreement {
            Agreement::AsPrinted => bev.occupied() * prior.free() / (1.0 - conflict), // Eq. (25)
            Agreement::Corrected => bev.combined(prior).map_or(0.5, Mass::probability),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Source, View};

    fn after(rule: &Paper, seen: &[(Source, Mass)]) -> f32 {
        let mut state = PaperState::default();
        for &(source, mass) in seen {
            let look = Look {
                source,
                at: Stamp::ZERO,
                view: View(0),
            };
            let seen = Observation {
                mass,
                ..Observation::default()
            };
            rule.observe(&mut state, &look, &seen);
        }
        rule.mass(&state, Stamp::ZERO).probability()
    }

    #[test]
    fn as_printed_two_sources_that_agree_on_occupied_make_it_free() {
        let occupied = Mass::new(0.9, 0.1).expect("valid");
        let seen = [(Source::Prior, occupied), (Source::Ugv, occupied)];
        assert!(after(&Paper::default(), &seen) < 0.15);
        let corrected = Paper {
            agreement: Agreement::Corrected,
            ..Paper::default()
        };
        assert!(after(&corrected, &seen) > 0.99);
    }

    #[test]
    fn the_prior_counts_twice() {
        let (prior, bev) = (0.9_f32, 0.5_f32);
        let rule = Paper {
            agreement: Agreement::Corrected,
            ..Paper::default()
        };
        let masses = [prior, bev].map(|p| Mass::new(p, 1.0 - p).expect("valid"));
        let p = after(
            &rule,
            &[(Source::Prior, masses[0]), (Source::Ugv, masses[1])],
        );
        let squared = prior * prior / (prior * prior + (1.0 - prior) * (1.0 - prior));
        assert!(
            (p - squared).abs() < 1e-3,
            "{p}: a coin's toss must leave {prior}"
        );
    }
}
