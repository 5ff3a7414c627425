//! The rules that compete, and the parameters of each that are fitted: all in the same way, to the same recordings.

use maps::evidence::{
    Agreement, Gain, Linear, LogOddsRule, Paper, Replace, Semantics, Tandem, Theory, Trust,
};

use super::judge::{Judge, Score};
use super::sensors::Recording;

/// A rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    /// Direct replacement.
    Replace,
    /// Fixed weights.
    Linear,
    /// Log-odds that take everybody at their word.
    Bayes,
    /// Log-odds with a sensor model fitted for each source, hits and passes apart.
    MatchedLogOdds,
    /// The paper's rule as printed.
    Paper,
    /// The paper's rule with its Eq. (25) put right.
    PaperCorrected,
    /// Ours.
    Tandem,
}

/// What is left out of ours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ablation {
    /// Evidence fades.
    Decay,
    /// Classes count.
    Semantics,
    /// Mass for unknown.
    Unknown,
    /// Newer evidence takes from older.
    Revision,
    /// The weight that a source gathers is bounded.
    Ceiling,
}

/// A number that is fitted.
pub(super) struct Knob {
    /// For people.
    pub(super) name: &'static str,
    /// From where to where; searched by ratio if both are above 0.
    pub(super) range: [f64; 2],
    /// Where the search starts.
    pub(super) start: f64,
}

const fn knob(name: &'static str, range: [f64; 2], start: f64) -> Knob {
    Knob { name, range, start }
}

/// Above which probability a voxel is occupied: every rule's first knob.
const THRESHOLD: Knob = knob("threshold", [0.2, 0.8], 0.5);

impl Method {
    pub(super) const ALL: [Self; 7] = [
        Self::Replace,
        Self::Linear,
        Self::Bayes,
        Self::MatchedLogOdds,
        Self::Paper,
        Self::PaperCorrected,
        Self::Tandem,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Replace => "replace",
            Self::Linear => "linear",
            Self::Bayes => "bayes",
            Self::MatchedLogOdds => "matched-log-odds",
            Self::Paper => "paper",
            Self::PaperCorrected => "paper-corrected",
            Self::Tandem => "tandem",
        }
    }

    /// What is fitted.
    pub(super) fn knobs(self) -> Vec<Knob> {
        let gain = |name| knob(name, [0.02, 4.0], 1.0);
        let mut knobs = vec![THRESHOLD];
        match self {
            Self::Replace => {}
            Self::Linear => knobs.extend([
                knob("uav weight", [0.01, 1.0], 0.3),
                knob("ugv weight", [0.01, 1.0], 0.5),
            ]),
            Self::Bayes => knobs.extend([
                knob("least", [-8.0, -0.4], -2.0),
                knob("greatest", [0.4, 8.0], 3.5),
            ]),
            Self::MatchedLogOdds => knobs.extend([
                gain("prior occupied"),
                gain("prior free"),
                gain("uav occupied"),
                gain("uav free"),
                gain("ugv occupied"),
                gain("ugv free"),
                knob("least", [-8.0, -0.4], -2.0),
                knob("greatest", [0.4, 8.0], 3.5),
            ]),
            Self::Paper | Self::PaperCorrected => {
                knobs.push(knob("decay", [1e-8, 1.0], 0.07));
            }
            Self::Tandem => knobs.extend(tandem_knobs()),
        }
        knobs
    }

    /// The score of the rule with these values of its knobs.
    pub(super) fn judge(self, values: &[f64], judge: &Judge, recording: &Recording) -> Score {
        self.with(values, |rule, threshold| match rule {
            Rule::Replace(rule) => judge.judge(rule, threshold, recording),
            Rule::Linear(rule) => judge.judge(rule, threshold, recording),
            Rule::LogOdds(rule) => judge.judge(rule, threshold, recording),
            Rule::Paper(rule) => judge.judge(rule, threshold, recording),
            Rule::Tandem(rule) => judge.judge(rule, threshold, recording),
        })
    }

    /// The same, with every figure.
    pub(super) fn in_full(self, values: &[f64], judge: &Judge, recording: &Recording) -> Score {
        self.with(values, |rule, threshold| match rule {
            Rule::Replace(rule) => judge.in_full(rule, threshold, recording),
            Rule::Linear(rule) => judge.in_full(rule, threshold, recording),
            Rule::LogOdds(rule) => judge.in_full(rule, threshold, recording),
            Rule::Paper(rule) => judge.in_full(rule, threshold, recording),
            Rule::Tandem(rule) => judge.in_full(rule, threshold, recording),
        })
    }

    fn with<T>(self, values: &[f64], then: impl FnOnce(Rule, f64) -> T) -> T {
        // A knob that is missing stays where its search starts.
        let starts = self.knobs();
        let at = |index: usize| values.get(index).copied().unwrap_or(starts[index].start);
        let f = |index: usize| at(index) as f32;
        let paper = |agreement| {
            Rule::Paper(Paper {
                decay_per_s: f(1),
                agreement,
                ..Paper::default()
            })
        };
        let rule = match self {
            Self::Replace => Rule::Replace(Replace),
            Self::Linear => Rule::Linear(Linear {
                weights: [1.0, f(1), f(2)],
            }),
            Self::Bayes => Rule::LogOdds(LogOddsRule {
                least: f(1),
                greatest: f(2),
                ..LogOddsRule::default()
            }),
            Self::MatchedLogOdds => Rule::LogOdds(LogOddsRule {
                gains: [1, 3, 5].map(|first| Gain {
                    occupied: f(first),
                    free: f(first + 1),
                }),
                least: f(7),
                greatest: f(8),
            }),
            Self::Paper => paper(Agreement::AsPrinted),
            Self::PaperCorrected => paper(Agreement::Corrected),
            Self::Tandem => Rule::Tandem(tandem(values)),
        };
        then(rule, at(0))
    }
}

enum Rule {
    Replace(Replace),
    Linear(Linear),
    LogOdds(LogOddsRule),
    Paper(Paper),
    Tandem(Tandem),
}

fn tandem_knobs() -> Vec<Knob> {
    let start = Tandem::default();
    let names = [
        [
            "prior occupied",
            "prior free",
            "prior ceiling",
            "prior decay",
        ],
        ["uav occupied", "uav free", "uav ceiling", "uav decay"],
        ["ugv occupied", "ugv free", "ugv ceiling", "ugv decay"],
    ];
    let mut knobs = Vec::new();
    for (names, trust) in names.into_iter().zip(start.trust) {
        let [occupied, free, ceiling, decay] = names;
        knobs.extend([
            knob(occupied, [0.02, 4.0], f64::from(trust.occupied)),
            knob(free, [0.02, 4.0], f64::from(trust.free)),
            knob(ceiling, [0.3, 8.0], f64::from(trust.ceiling)),
            knob(decay, [1e-9, 1.0], f64::from(trust.decay_per_s)),
        ]);
    }
    knobs.extend([
        knob(
            "static revision",
            [0.0, 0.5],
            f64::from(start.static_revision),
        ),
        knob(
            "movable revision",
            [0.0, 1.0],
            f64::from(start.movable_revision),
        ),
        knob(
            "movable decay",
            [1.0, 100.0],
            f64::from(start.movable_decay),
        ),
    ]);
    knobs
}

/// Ours with these values of its knobs, the threshold before them.
pub(super) fn tandem(values: &[f64]) -> Tandem {
    let starts = tandem_knobs();
    let f = |index: usize| {
        values
            .get(index + 1)
            .copied()
            .unwrap_or(starts[index].start) as f32
    };
    Tandem {
        trust: [0, 4, 8].map(|first| Trust {
            occupied: f(first),
            free: f(first + 1),
            ceiling: f(first + 2),
            decay_per_s: f(first + 3),
        }),
        static_revision: f(12),
        movable_revision: f(13),
        movable_decay: f(14),
        ..Tandem::default()
    }
}

impl Ablation {
    pub(super) const ALL: [Self; 5] = [
        Self::Decay,
        Self::Semantics,
        Self::Unknown,
        Self::Revision,
        Self::Ceiling,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Decay => "tandem-no-decay",
            Self::Semantics => "tandem-no-semantics",
            Self::Unknown => "tandem-no-unknown",
            Self::Revision => "tandem-no-revision",
            Self::Ceiling => "tandem-no-ceiling",
        }
    }

    /// The score of ours, fitted whole, without it.
    pub(super) fn in_full(self, values: &[f64], judge: &Judge, recording: &Recording) -> Score {
        let mut rule = tandem(values);
        match self {
            Self::Decay => rule
                .trust
                .iter_mut()
                .for_each(|trust| trust.decay_per_s = 0.0),
            Self::Semantics => rule.semantics = Semantics::Ignored,
            Self::Unknown => rule.theory = Theory::Probabilities,
            Self::Revision => (rule.static_revision, rule.movable_revision) = (0.0, 0.0),
            Self::Ceiling => rule.trust.iter_mut().for_each(|trust| trust.ceiling = 50.0),
        }
        judge.in_full(rule, values.first().copied().unwrap_or(0.5), recording)
    }
}
