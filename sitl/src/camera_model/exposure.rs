//! How long light is gathered and how much it is amplified: given, or found from the picture before.

use std::time::Duration;

use super::OpticsError;

/// A light of 1, gathered for a second at a gain of 1, makes so many times the full scale.
const SENSITIVITY_PER_S: f32 = 100.0;
/// The darkest picture that still says how much too dark it is: half a grey level.
const DARKEST: f32 = 0.5 / 255.0;

/// How long light is gathered, and how much it is amplified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// The scene's own exposure, taken in an instant: nothing blurs.
    Scene,
    /// Always the same.
    Fixed(Setting),
    /// As the picture before asks for.
    Automatic(Automatic),
}

/// An exposure. Light of 1 on a white surface fills the scale in 10 ms at a gain of 1: scenes have no unit of light, so that
/// streets and rooms are about equally bright.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// How long light is gathered.
    pub time: Duration,
    /// How much it is amplified; noise is, too.
    pub gain: f32,
}

/// Automatic exposure: first longer, then, when that is at its limit, with more gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Automatic {
    /// The mean grey level that it aims at, above 0 and below 1.
    pub target: f32,
    /// After this time, the error of the exposure (its logarithm) is down to 37 %.
    pub settles_in: Duration,
    /// The shortest and the longest exposure.
    pub times: [Duration; 2],
    /// The most gain, at least 1.
    pub most_gain: f32,
    /// What the first picture is taken with, within those limits.
    pub start: Setting,
}

impl Setting {
    /// The share of full scale that a light of 1 makes.
    pub(super) fn factor(self) -> f32 {
        self.time.as_secs_f32() * self.gain * SENSITIVITY_PER_S
    }

    fn check(self) -> Result<(), OpticsError> {
        OpticsError::time("exposure", self.time)?;
        OpticsError::positive("the exposure time in seconds", self.time.as_secs_f32())?;
        OpticsError::positive("gain", self.gain)
    }
}

impl Exposure {
    pub(super) fn check(&self) -> Result<(), OpticsError> {
        match self {
            Self::Scene => Ok(()),
            Self::Fixed(setting) => setting.check(),
            Self::Automatic(automatic) => automatic.check(),
        }
    }

    /// What the first picture is taken with.
    pub(super) fn start(&self) -> Setting {
        match self {
            Self::Scene => Setting {
                time: Duration::ZERO,
                gain: 1.0,
            },
            Self::Fixed(setting) => *setting,
            Self::Automatic(automatic) => automatic.within(automatic.start.factor()),
        }
    }
}

impl Automatic {
    /// From 0.1 ms to 10 ms and 16 times, within a fifth of a second.
    pub const USUAL: Self = Self {
        target: 0.45,
        settles_in: Duration::from_millis(200),
        times: [Duration::from_micros(100), Duration::from_millis(10)],
        most_gain: 16.0,
        start: Setting {
            time: Duration::from_millis(4),
            gain: 1.0,
        },
    };

    fn check(&self) -> Result<(), OpticsError> {
        let [from, to] = self.times;
        if from.is_zero() || from > to {
            return Err(OpticsError::Limits { from, to });
        }
        OpticsError::time("longest exposure", to)?;
        if !(self.target > 0.0 && self.target < 1.0) {
            return Err(OpticsError::Number {
                what: "the target of automatic exposure",
                given: self.target,
                remedy: "a mean level above 0 and below 1",
            });
        }
        if !(self.most_gain.is_finite() && self.most_gain >= 1.0) {
            return Err(OpticsError::Number {
                what: "most_gain",
                given: self.most_gain,
                remedy: "a finite number from 1 up",
            });
        }
        self.start.check()
    }

    /// The setting for the next picture, so much time after one with this mean level.
    ///
    /// Levels are the root of light, nearly: so much too dark squared is so much too little light.
    pub(super) fn after(&self, setting: Setting, level: f32, since: Duration) -> Setting {
        let wanted = (self.target / level.max(DARKEST)).powi(2);
        let settles_s = self.settles_in.as_secs_f32().max(1e-6);
        let share = 1.0 - (-since.as_secs_f32() / settles_s).exp();
        self.within(setting.factor() * wanted.powf(share))
    }

    /// The setting that makes this of a light of 1, or what comes nearest.
    fn within(&self, factor: f32) -> Setting {
        let [shortest, longest] = self.times.map(|time| time.as_secs_f32());
        let wanted_s = factor / SENSITIVITY_PER_S;
        let time_s = wanted_s.clamp(shortest, longest);
        Setting {
            time: Duration::from_secs_f32(time_s),
            gain: (wanted_s / time_s).clamp(1.0, self.most_gain),
        }
    }
}
