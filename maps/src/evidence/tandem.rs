//! Our rule: weights of evidence for each source, that fade, that cannot be shouted up, and that movable things lose fast.
//!
//! ```text
//! wₒ = -g ln(1 - m(O))      w_f = -g' ln(1 - m(F))                 what a look weighs; g, g' belong to the source
//! oₛ ← min(oₛ + wₒ, cₛ)     seen from a new place                  Dempster's rule: distinct evidence adds
//! oₛ ← max(oₛ, wₒ)          seen again from the same place         the cautious rule: the same evidence does not
//! o  ← o · (1 - η m(F))     for every source, and f likewise       newer contradicts older; η by mobility
//! oₛ(t) = oₛ(t₀) e^(-λₛ(t - t₀))                                   what is old counts less
//! m(O) ∝ (1 - e^(-Σo)) e^(-Σf)      m(F) ∝ e^(-Σo) (1 - e^(-Σf))      m(Θ) ∝ e^(-Σo) e^(-Σf)       1 - K in all
//! ```
//!
//! What that does, against plain log-odds:
//!
//! - The ceiling `cₛ = -ln(1 - r)` is what a source is worth that is right with probability `r` however often it looks:
//!   an offset or a reflection, seen a hundred times, stays one mistake.
//! - What a class may do decides how fast contradiction counts. A fence that lets most rays through stays; a car that
//!   drove away goes, after at most [`Tandem::GONE_WITHIN`] looks.
//! - What moves leaves no evidence, so no trail.
//! - Evidence for and against is kept apart, so that *never seen* and *disputed* differ.
//!
//! Looks that do not contradict each other give the same in any order; where they do, the newer one counts more. A look
//! that comes late weighs what it would weigh by now, and revises nothing.
//!
//! - A. P. Dempster, *Upper and lower probabilities induced by a multivalued mapping*, 1967; T. Denœux, *Conjunctive and
//!   disjunctive combination of belief functions induced by nondistinct bodies of evidence*, Artificial Intelligence 172,
//!   2008 (the cautious rule).

use super::mass::weight;
use super::{Look, Mass, Mobility, Observation, UpdateRule, View};
use crate::time::Stamp;

/// What a source is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trust {
    /// Factor for what it says is occupied.
    pub occupied: f32,
    /// Factor for what it says is free.
    pub free: f32,
    /// The greatest weight that its word can gather, in nats: `-ln` of the probability that it is wrong all along.
    pub ceiling: f32,
    /// Per second: how fast what it said of a static thing fades.
    pub decay_per_s: f32,
}

/// Whether mobility counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Semantics {
    /// It does.
    #[default]
    Used,
    /// Everything is unclassified.
    Ignored,
}

/// Where ignorance goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Theory {
    /// It stays a mass of its own.
    #[default]
    ThreeMasses,
    /// Half of it counts as occupied and half as free.
    Probabilities,
}

/// Our rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tandem {
    /// What a source is worth, by the index of [`Source::ALL`](super::Source::ALL).
    pub trust: [Trust; 3],
    /// How much newer evidence takes from older that it contradicts, of a static thing, within 0..=1.
    pub static_revision: f32,
    /// The same, of a movable thing. Of an unclassified one it is halfway between.
    pub movable_revision: f32,
    /// How much faster than of a static thing the evidence of a movable one fades.
    pub movable_decay: f32,
    /// Whether mobility counts.
    pub semantics: Semantics,
    /// Where ignorance goes.
    pub theory: Theory,
}

/// Set by hand; `evaluate map-update` fits these parameters, as those of the other rules, on its training seeds.
impl Default for Tandem {
    fn default() -> Self {
        let trust = |occupied, free, ceiling, decay_per_s| Trust {
            occupied,
            free,
            ceiling,
            decay_per_s,
        };
        Self {
            trust: [
                trust(1.0, 1.0, 2.0, 2e-6),
                trust(0.6, 0.6, 1.5, 1e-3),
                trust(1.0, 0.7, 4.0, 1e-3),
            ],
            static_revision: 0.1,
            movable_revision: 0.75,
            movable_decay: 4.0,
            semantics: Semantics::Used,
            theory: Theory::ThreeMasses,
        }
    }
}

/// What one source said of a voxel, as weights of evidence in nats.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Weights {
    occupied: f32,
    free: f32,
    /// Where it looked from last.
    view: Option<View>,
}

/// What our rule keeps of a voxel: 56 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TandemState {
    weights: [Weights; 3],
    /// Between -1, static, and 1, movable.
    mobility: f32,
    at: Stamp,
}

impl TandemState {
    /// How likely what occupies the voxel may drive away: from -1, static, over 0, unknown, to 1, movable.
    pub fn mobility(&self) -> f32 {
        self.mobility
    }

    /// When it was last seen.
    pub fn seen_at(&self) -> Stamp {
        self.at
    }
}

impl UpdateRule for Tandem {
    type State = TandemState;

    fn observe(&self, state: &mut TandemState, look: &Look, seen: &Observation) {
        let mobility = match self.semantics {
            Semantics::Used => seen.mobility,
            Semantics::Ignored => Mobility::Unknown,
        };
        let is_occupied = seen.mass.occupied() > seen.mass.free();
        if seen.mass.is_unknown() || mobility == Mobility::Moving && is_occupied {
            return;
        }
        if is_occupied {
            state.learn(mobility);
        }
        let (mass, trust) = (self.split(seen.mass), &self.trust[look.source.index()]);
        if look.at >= state.at {
            state.weights = self.weights_at(state, look.at);
            state.at = look.at;
            self.revise(state, mass);
        }
        let left = fading(
            trust,
            state.at.since(look.at).as_secs_f32(),
            self.decay(state),
        );
        let weigh = |gain: f32, mass| (gain * weight(mass)).clamp(0.0, trust.ceiling) * left;
        let [occupied, free] = [
            weigh(trust.occupied, mass.occupied()),
            weigh(trust.free, mass.free()),
        ];
        let own = &mut state.weights[look.source.index()];
        if own.view == Some(look.view) {
            own.occupied = own.occupied.max(occupied);
            own.free = own.free.max(free);
        } else {
            own.occupied = (own.occupied + occupied).min(trust.ceiling);
            own.free = (own.free + free).min(trust.ceiling);
            own.view = Some(look.view);
        }
    }

    fn mass(&self, state: &TandemState, now: Stamp) -> Mass {
        let weights = self.weights_at(state, now);
        let sum = |of: fn(&Weights) -> f32| weights.iter().map(of).sum();
        Mass::of_weights(sum(|w| w.occupied), sum(|w| w.free))
    }
}

impl Tandem {
    /// The greatest number of looks, from wherever, after which a movable thing that is gone is gone from the map: even if
    /// all three sources had gathered all the weight they can, with the default parameters and a ground vehicle whose
    /// passing rays speak with a mass of 0.4 for free.
    pub const GONE_WITHIN: usize = 12;

    /// How much all sources contradict each other at `now`: the `K` of Dempster's rule, within 0..=1.
    pub fn conflict(&self, state: &TandemState, now: Stamp) -> f32 {
        let weights = self.weights_at(state, now);
        let support = |of: fn(&Weights) -> f32| 1.0 - (-weights.iter().map(of).sum::<f32>()).exp();
        support(|w| w.occupied) * support(|w| w.free)
    }

    fn split(&self, mass: Mass) -> Mass {
        match self.theory {
            Theory::ThreeMasses => mass,
            Theory::Probabilities => {
                let p = mass.probability();
                Mass::new(p, 1.0 - p).unwrap_or(mass)
            }
        }
    }

    /// Newer evidence takes from older that it contradicts.
    fn revise(&self, state: &mut TandemState, mass: Mass) {
        let share = 0.5 * (state.mobility + 1.0);
        let revision =
            self.static_revision + share * (self.movable_revision - self.static_revision);
        // What a look leaves open, as the edge of a blurred wall, contradicts nothing.
        let lean = revision.clamp(0.0, 1.0) * (mass.free() - mass.occupied());
        for weights in &mut state.weights {
            weights.occupied *= 1.0 - lean.max(0.0);
            weights.free *= 1.0 - (-lean).max(0.0);
        }
    }

    /// What is left of the weights at `now`.
    fn weights_at(&self, state: &TandemState, now: Stamp) -> [Weights; 3] {
        let age_s = now.since(state.at).as_secs_f32();
        if age_s == 0.0 {
            return state.weights;
        }
        let mut weights = state.weights;
        for (weights, trust) in weights.iter_mut().zip(&self.trust) {
            let left = fading(trust, age_s, self.decay(state));
            weights.occupied *= left;
            weights.free *= left;
        }
        weights
    }

    /// How much faster than of a static thing.
    fn decay(&self, state: &TandemState) -> f32 {
        1.0 + state.mobility.max(0.0) * (self.movable_decay - 1.0).max(0.0)
    }
}

impl TandemState {
    fn learn(&mut self, mobility: Mobility) {
        /// What a label counts against those before it.
        const NEW: f32 = 0.3;
        let label = match mobility {
            Mobility::Static => -1.0,
            Mobility::Movable | Mobility::Moving => 1.0,
            Mobility::Unknown => return,
        };
        self.mobility += NEW * (label - self.mobility);
    }
}

/// The share that age leaves.
fn fading(trust: &Trust, age_s: f32, faster: f32) -> f32 {
    (-(trust.decay_per_s * faster).max(0.0) * age_s).exp()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use proptest::prelude::*;

    use super::*;
    use crate::evidence::Source;
    use crate::evidence::mass::tests::any_mass;

    fn look(source: Source, at: Stamp, view: u32) -> Look {
        Look {
            source,
            at,
            view: View(view),
        }
    }

    fn seen(mass: Mass, mobility: Mobility) -> Observation {
        Observation {
            mass,
            mobility,
            detection: None,
        }
    }

    fn hit() -> Mass {
        Mass::occupied_by(0.7)
    }

    fn pass() -> Mass {
        Mass::free_by(0.4)
    }

    /// Everything that all sources can say for a movable thing.
    fn parked_car(rule: &Tandem) -> TandemState {
        let mut state = TandemState::default();
        for source in Source::ALL {
            for view in 0..50 {
                rule.observe(
                    &mut state,
                    &look(source, Stamp::ZERO, view),
                    &seen(hit(), Mobility::Movable),
                );
            }
        }
        state
    }

    fn looks_until_free(
        rule: &Tandem,
        mut state: TandemState,
        view: impl Fn(usize) -> u32,
    ) -> usize {
        (1..1000)
            .find(|&n| {
                let look = look(Source::Ugv, Stamp::ZERO, view(n));
                rule.observe(&mut state, &look, &seen(pass(), Mobility::Unknown));
                rule.mass(&state, Stamp::ZERO).probability() < 0.5
            })
            .expect("it must go")
    }

    #[test]
    fn a_parked_car_that_drives_away_is_gone_within_the_stated_number_of_looks() {
        let rule = Tandem::default();
        let car = parked_car(&rule);
        assert!(rule.mass(&car, Stamp::ZERO).probability() > 0.99);
        let standing = looks_until_free(&rule, car, |_| 50);
        let driving = looks_until_free(&rule, car, |n| 50 + n as u32);
        assert!(standing <= Tandem::GONE_WITHIN, "{standing} from one place");
        assert!(driving <= standing, "{driving} from many");
    }

    #[test]
    fn a_wall_outlasts_what_makes_a_car_disappear() {
        let rule = Tandem::default();
        let mut wall = TandemState::default();
        for view in 0..10 {
            rule.observe(
                &mut wall,
                &look(Source::Ugv, Stamp::ZERO, view),
                &seen(hit(), Mobility::Static),
            );
        }
        for _ in 0..Tandem::GONE_WITHIN {
            rule.observe(
                &mut wall,
                &look(Source::Ugv, Stamp::ZERO, 10),
                &seen(pass(), Mobility::Unknown),
            );
        }
        assert!(rule.mass(&wall, Stamp::ZERO).probability() > 0.5);
    }

    #[test]
    fn what_moves_leaves_no_trail() {
        let rule = Tandem::default();
        let mut state = TandemState::default();
        for view in 0..20 {
            rule.observe(
                &mut state,
                &look(Source::Ugv, Stamp::ZERO, view),
                &seen(hit(), Mobility::Moving),
            );
        }
        assert_eq!(state, TandemState::default());
    }

    #[test]
    fn a_mistake_seen_a_thousand_times_from_one_place_is_one_mistake() {
        let rule = Tandem::default();
        let mut state = TandemState::default();
        let ghost = |state: &mut _| {
            rule.observe(
                state,
                &look(Source::Ugv, Stamp::ZERO, 7),
                &seen(hit(), Mobility::Static),
            );
        };
        ghost(&mut state);
        let once = rule.mass(&state, Stamp::ZERO);
        (0..1000).for_each(|_| ghost(&mut state));
        assert_eq!(rule.mass(&state, Stamp::ZERO), once);
    }

    #[test]
    fn no_source_alone_gathers_more_than_its_ceiling() {
        let rule = Tandem::default();
        let mut state = TandemState::default();
        for view in 0..1000 {
            rule.observe(
                &mut state,
                &look(Source::Uav, Stamp::ZERO, view),
                &seen(hit(), Mobility::Static),
            );
        }
        let most = 1.0 - (-rule.trust[Source::Uav.index()].ceiling).exp();
        let mass = rule.mass(&state, Stamp::ZERO);
        assert!((mass.occupied() - most).abs() < 1e-5, "{mass:?}");
    }

    #[test]
    fn what_was_never_seen_and_what_is_disputed_differ() {
        let rule = Tandem::default();
        let mut state = TandemState::default();
        assert!(rule.mass(&state, Stamp::ZERO).is_unknown());
        assert!(rule.conflict(&state, Stamp::ZERO) < 1e-6);
        let hits = look(Source::Uav, Stamp::ZERO, 0);
        let passes = look(Source::Ugv, Stamp::ZERO, 0);
        rule.observe(&mut state, &hits, &seen(hit(), Mobility::Static));
        rule.observe(&mut state, &passes, &seen(pass(), Mobility::Static));
        let mass = rule.mass(&state, Stamp::ZERO);
        assert!(mass.unknown() < 0.6, "{mass:?}");
        assert!(rule.conflict(&state, Stamp::ZERO) > 0.1);
    }

    prop_compose! {
        fn any_look()(source in 0_usize..3, at_s in 0_u64..200_000, view in 0_u32..5) -> Look {
            look(Source::ALL[source], Stamp::ZERO + Duration::from_secs(at_s), view)
        }
    }

    fn any_mobility() -> impl Strategy<Value = Mobility> {
        prop::sample::select(vec![
            Mobility::Unknown,
            Mobility::Static,
            Mobility::Movable,
            Mobility::Moving,
        ])
    }

    proptest! {
        #[test]
        fn masses_stay_valid_whatever_is_seen_in_whatever_order(
            looks in prop::collection::vec((any_look(), any_mass(), any_mobility()), 1..40)
        ) {
            for rule in [
                Tandem::default(),
                Tandem { semantics: Semantics::Ignored, ..Tandem::default() },
                Tandem { theory: Theory::Probabilities, ..Tandem::default() },
            ] {
                let mut state = TandemState::default();
                for (look, mass, mobility) in &looks {
                    rule.observe(&mut state, look, &seen(*mass, *mobility));
                    for now in [Stamp::ZERO, look.at, Stamp::from_nanos(u64::MAX)] {
                        let mass = rule.mass(&state, now);
                        prop_assert!(Mass::new(mass.occupied(), mass.free()).is_some(), "{mass:?}");
                        prop_assert!((0.0..=1.0).contains(&rule.conflict(&state, now)));
                    }
                }
            }
        }

        #[test]
        fn looks_that_agree_may_come_in_any_order(
            looks in prop::collection::vec((0_usize..3, 0.0_f32..0.9), 1..12)
                .prop_flat_map(|looks| (Just(looks.clone()), Just(looks).prop_shuffle()))
        ) {
            let rule = Tandem::default();
            let after = |looks: &[(usize, f32)]| {
                let mut state = TandemState::default();
                for (at, (source, mass)) in looks.iter().enumerate() {
                    // From places of their own: repetition counts by where it was seen from, not by when.
                    let look = look(Source::ALL[*source], Stamp::ZERO, at as u32);
                    rule.observe(&mut state, &look, &seen(Mass::occupied_by(*mass), Mobility::Static));
                }
                rule.mass(&state, Stamp::ZERO).occupied()
            };
            let (one, other) = (after(&looks.0), after(&looks.1));
            prop_assert!((one - other).abs() < 1e-4, "{one} {other}");
        }

        #[test]
        fn ignorance_changes_nothing(
            looks in prop::collection::vec((any_look(), any_mass(), any_mobility()), 0..10), ignorant in any_look()
        ) {
            let rule = Tandem::default();
            let mut state = TandemState::default();
            for (look, mass, mobility) in &looks {
                rule.observe(&mut state, look, &seen(*mass, *mobility));
            }
            let before = state;
            rule.observe(&mut state, &ignorant, &seen(Mass::UNKNOWN, Mobility::Movable));
            prop_assert_eq!(state, before);
        }

        #[test]
        fn time_brings_ignorance_and_never_changes_sides(
            looks in prop::collection::vec((any_look(), any_mass()), 1..10), later_s in 0_u64..1_000_000
        ) {
            // Where all sources fade alike; else the slowest has the last word.
            let mut rule = Tandem::default();
            rule.trust.iter_mut().for_each(|t| t.decay_per_s = 1e-4);
            let mut state = TandemState::default();
            for (look, mass) in &looks {
                rule.observe(&mut state, look, &seen(*mass, Mobility::Static));
            }
            let now = rule.mass(&state, state.seen_at());
            let later = rule.mass(&state, state.seen_at() + Duration::from_secs(later_s));
            prop_assert!(later.unknown() >= now.unknown() - 1e-5, "{now:?} {later:?}");
            let lean = |m: Mass| m.probability() - 0.5;
            prop_assert!(lean(now) * lean(later) >= -1e-6, "{now:?} {later:?}");
        }
    }

    #[test]
    fn a_look_that_comes_late_revises_nothing_and_weighs_less() {
        let rule = Tandem::default();
        let now = Stamp::ZERO + Duration::from_hours(10);
        let mut state = TandemState::default();
        rule.observe(
            &mut state,
            &look(Source::Ugv, now, 0),
            &seen(pass(), Mobility::Unknown),
        );
        let before = state.weights[Source::Ugv.index()];
        rule.observe(
            &mut state,
            &look(Source::Ugv, Stamp::ZERO, 1),
            &seen(hit(), Mobility::Movable),
        );
        let after = state.weights[Source::Ugv.index()];
        assert_eq!(after.free.to_bits(), before.free.to_bits());
        assert!(after.occupied < 1e-3, "{after:?}");
        assert_eq!(state.seen_at(), now);
    }
}
