//! A script of what breaks when: lines of text that say which sensor fails, how, and for how long.
//!
//! ```text
//! script = { line }                      one fault a line; # starts a comment, blank lines are skipped
//! line   = TIME SENSOR fault [ SPAN ]    TIME and SPAN in seconds; without SPAN it lasts until the end
//! fault  = off                           nothing comes
//!        | frozen                        the last reading comes again and again
//!        | noise FACTOR                  its noise is so many times as large
//!        | delay SECONDS                 readings come so much later
//! ```
//!
//! for example
//!
//! ```text
//! 12.5 camera-front off 3
//! 20   gnss noise 5 10        # five times the noise from 20 s to 30 s
//! 60   imu frozen             # for the rest of the run
//! ```
//!
//! A sensor's name is any word; [`FaultScript::check_sensors`] tells those that do not exist. A fault holds from its
//! time on and no more at its end. Where faults of a sensor overlap, noise multiplies, delays add up, and off hides
//! frozen. The order of lines does not matter.
//!
//! This says what is wrong; whoever steps a sensor makes it so. Noise so many times as large is an error so many times
//! as large: `truth + factor·(reading - truth)`.

use std::time::Duration;

use maps::time::Stamp;

/// Why a script cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// A line ends too early.
    #[error(
        "line {line}: {missing} is missing, expected TIME SENSOR FAULT, such as: 12.5 gnss off 3"
    )]
    Incomplete {
        /// Counted from 1.
        line: usize,
        /// What should come next.
        missing: &'static str,
    },
    /// A fault that there is not.
    #[error(
        "line {line}: {found:?} is no fault, expected off, frozen, noise FACTOR or delay SECONDS"
    )]
    UnknownFault {
        /// Counted from 1.
        line: usize,
        /// What stands there.
        found: String,
    },
    /// A number that is none, or that cannot be meant.
    #[error("line {line}: {found:?} is no {what}, expected {expected}")]
    Number {
        /// Counted from 1.
        line: usize,
        /// What stands there.
        found: String,
        /// What it should be.
        what: &'static str,
        /// How to write that.
        expected: &'static str,
    },
    /// Words after the end.
    #[error("line {line}: nothing may follow the span, remove {found:?} or start a comment with #")]
    TooLong {
        /// Counted from 1.
        line: usize,
        /// The first word too many.
        found: String,
    },
    /// A sensor that the vehicle does not have.
    #[error("line {line}: there is no sensor {found:?}, expected one of {known}")]
    UnknownSensor {
        /// Counted from 1.
        line: usize,
        /// What stands there.
        found: String,
        /// Those there are, with commas.
        known: String,
    },
}

/// What is wrong with a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultKind {
    /// Nothing comes.
    Off,
    /// The last reading comes again and again.
    Frozen,
    /// Its noise is so many times as large.
    Noise(f64),
    /// Readings come so much later.
    Delay(Duration),
}

/// One line of a script.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// Which sensor fails.
    pub sensor: String,
    /// How.
    pub kind: FaultKind,
    /// From when on.
    pub from: Stamp,
    /// Until when; `None` for the rest of the run.
    pub until: Option<Stamp>,
    /// Its line in the script, counted from 1.
    pub line: usize,
}

impl Fault {
    /// Whether it holds at that time.
    pub fn covers(&self, at: Stamp) -> bool {
        at >= self.from && self.until.is_none_or(|until| at < until)
    }
}

/// Whether readings come at all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Output {
    /// They do.
    #[default]
    Live,
    /// The last one does again and again.
    Frozen,
    /// None does.
    Off,
}

/// All that is wrong with one sensor at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActiveFaults {
    /// Whether readings come.
    pub output: Output,
    /// What to multiply its noise by; 1 when nothing is wrong.
    pub noise: f64,
    /// How much later readings come.
    pub delay: Duration,
}

impl ActiveFaults {
    /// Nothing is wrong.
    pub const NONE: Self = Self {
        output: Output::Live,
        noise: 1.0,
        delay: Duration::ZERO,
    };
}

impl Default for ActiveFaults {
    fn default() -> Self {
        Self::NONE
    }
}

/// What breaks when.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaultScript {
    faults: Vec<Fault>,
}

impl std::str::FromStr for FaultScript {
    type Err = FaultError;

    /// Reads a script as the module describes it.
    fn from_str(text: &str) -> Result<Self, FaultError> {
        let mut faults = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let words = line.split('#').next().unwrap_or_default();
            let mut words = Words {
                line: number + 1,
                rest: words.split_whitespace().peekable(),
            };
            if words.rest.peek().is_some() {
                faults.push(words.fault()?);
            }
        }
        Ok(Self { faults })
    }
}

impl FaultScript {
    /// What is wrong with a sensor at that time. Takes time in proportion to the lines of the script.
    pub fn at(&self, sensor: &str, now: Stamp) -> ActiveFaults {
        let mut active = ActiveFaults::NONE;
        let all = self.faults.iter();
        for fault in all.filter(|fault| fault.sensor == sensor && fault.covers(now)) {
            match fault.kind {
                FaultKind::Off => active.output = Output::Off,
                FaultKind::Frozen => active.output = active.output.max(Output::Frozen),
                // Finite, so that a factor of zero silences whatever else there is.
                FaultKind::Noise(factor) => active.noise = (active.noise * factor).min(f64::MAX),
                FaultKind::Delay(span) => active.delay = active.delay.saturating_add(span),
            }
        }
        active
    }

    /// Every fault, in the order of lines.
    pub fn faults(&self) -> &[Fault] {
        &self.faults
    }

    /// Whether all faults are of sensors that there are.
    pub fn check_sensors(&self, known: &[&str]) -> Result<(), FaultError> {
        let stranger = self
            .faults
            .iter()
            .find(|fault| !known.contains(&fault.sensor.as_str()));
        stranger.map_or(Ok(()), |fault| {
            Err(FaultError::UnknownSensor {
                line: fault.line,
                found: fault.sensor.clone(),
                known: known.join(", "),
            })
        })
    }
}

/// The words of a line that have not been read yet.
struct Words<'a> {
    line: usize,
    rest: std::iter::Peekable<std::str::SplitWhitespace<'a>>,
}

impl Words<'_> {
    fn fault(mut self) -> Result<Fault, FaultError> {
        let from = Stamp::ZERO + self.seconds("time")?;
        let sensor = self.word("sensor")?;
        let kind = self.kind()?;
        let until = match self.rest.peek() {
            Some(_) => Some(from + self.seconds("span")?),
            None => None,
        };
        match self.rest.next() {
            None => Ok(Fault {
                sensor,
                kind,
                from,
                until,
                line: self.line,
            }),
            Some(word) => Err(FaultError::TooLong {
                line: self.line,
                found: word.to_owned(),
            }),
        }
    }

    fn kind(&mut self) -> Result<FaultKind, FaultError> {
        let word = self.word("fault")?;
        match word.as_str() {
            "off" => Ok(FaultKind::Off),
            "frozen" => Ok(FaultKind::Frozen),
            "noise" => Ok(FaultKind::Noise(self.factor()?)),
            "delay" => Ok(FaultKind::Delay(self.seconds("delay")?)),
            _ => Err(FaultError::UnknownFault {
                line: self.line,
                found: word,
            }),
        }
    }

    fn factor(&mut self) -> Result<f64, FaultError> {
        let word = self.word("factor")?;
        let factor: Option<f64> = word.parse().ok();
        factor
            .filter(|f| f.is_finite() && *f >= 0.0)
            .ok_or(FaultError::Number {
                line: self.line,
                found: word,
                what: "factor",
                expected: "a number that is not negative, such as 5",
            })
    }

    fn seconds(&mut self, what: &'static str) -> Result<Duration, FaultError> {
        let word = self.word(what)?;
        let seconds = word.parse().ok().and_then(Stamp::from_secs_f64);
        let seconds = seconds.ok_or(FaultError::Number {
            line: self.line,
            found: word,
            what,
            expected: "seconds that are not negative, such as 12.5",
        })?;
        Ok(seconds.since(Stamp::ZERO))
    }

    fn word(&mut self, missing: &'static str) -> Result<String, FaultError> {
        let word = self.rest.next().map(str::to_owned);
        word.ok_or(FaultError::Incomplete {
            line: self.line,
            missing,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn script(text: &str) -> FaultScript {
        text.parse().expect("a script")
    }

    fn at(seconds: f64) -> Stamp {
        Stamp::from_secs_f64(seconds).expect("a moment")
    }

    #[test]
    fn the_example_of_the_module_does_what_it_says() {
        let faults = script(
            "12.5 camera-front off 3\n\n20   gnss noise 5 10  # comment\n60 imu frozen\n# end\n",
        );
        assert_eq!(faults.faults().len(), 3);
        assert_eq!(faults.at("camera-front", at(12.499)), ActiveFaults::NONE);
        assert_eq!(faults.at("camera-front", at(12.5)).output, Output::Off);
        assert_eq!(faults.at("camera-front", at(15.499)).output, Output::Off);
        assert_eq!(
            faults.at("camera-front", at(15.5)),
            ActiveFaults::NONE,
            "over"
        );
        assert!((faults.at("gnss", at(25.0)).noise - 5.0).abs() < 1e-12);
        assert_eq!(faults.at("imu", at(1e6)).output, Output::Frozen, "for ever");
        assert_eq!(
            faults.at("lidar", at(25.0)),
            ActiveFaults::NONE,
            "not in it"
        );
    }

    #[test]
    fn faults_that_overlap_add_up() {
        let faults = script(
            "0 a noise 2\n0 a noise 3 5\n0 a delay 0.1\n0 a delay 0.25\n0 a off 4\n0 a frozen 8",
        );
        let first = faults.at("a", at(1.0));
        let expected = ActiveFaults {
            output: Output::Off,
            noise: 6.0,
            delay: Duration::from_millis(350),
        };
        assert_eq!(first, expected);
        assert_eq!(faults.at("a", at(4.0)).output, Output::Frozen);
        assert_eq!(faults.at("a", at(8.0)).output, Output::Live);
    }

    #[track_caller]
    fn check_refused(text: &str, message: &str) {
        let error = text.parse::<FaultScript>().expect_err(text);
        assert_eq!(error.to_string(), message);
    }

    #[test]
    fn errors_name_the_line_and_what_to_write_there() {
        check_refused(
            "# none\n\n12.5 gnss",
            "line 3: fault is missing, expected TIME SENSOR FAULT, such as: 12.5 gnss off 3",
        );
        check_refused(
            "1 gnss blur 3",
            "line 1: \"blur\" is no fault, expected off, frozen, noise FACTOR or delay SECONDS",
        );
        check_refused(
            "soon gnss off",
            "line 1: \"soon\" is no time, expected seconds that are not negative, such as 12.5",
        );
        check_refused(
            "1 gnss noise loud",
            "line 1: \"loud\" is no factor, expected a number that is not negative, such as 5",
        );
        check_refused(
            "1 gnss off 3 now",
            "line 1: nothing may follow the span, remove \"now\" or start a comment with #",
        );
        for number in ["NaN", "-1", "inf", "1e300"] {
            assert!(format!("{number} gnss off").parse::<FaultScript>().is_err());
            assert!(
                format!("1 gnss off {number}")
                    .parse::<FaultScript>()
                    .is_err()
            );
            assert!(
                format!("1 gnss delay {number}")
                    .parse::<FaultScript>()
                    .is_err()
            );
        }
        assert!("1 gnss noise NaN".parse::<FaultScript>().is_err());
    }

    #[test]
    fn sensors_that_do_not_exist_are_told_with_those_that_do() {
        let faults = script("1 gnss off\n2 gsnn off");
        assert_eq!(faults.check_sensors(&["gnss", "gsnn"]), Ok(()));
        let error = faults.check_sensors(&["imu", "gnss"]).expect_err("a typo");
        assert_eq!(
            error.to_string(),
            "line 2: there is no sensor \"gsnn\", expected one of imu, gnss"
        );
    }

    proptest! {
        #[test]
        fn no_text_and_no_time_panics(text in "[0-9a-z.# \\n-]{0,80}|\\PC{0,40}", ns in any::<u64>()) {
            if let Ok(faults) = text.parse::<FaultScript>() {
                for fault in faults.faults() {
                    let active = faults.at(&fault.sensor, Stamp::from_nanos(ns));
                    prop_assert!(active.noise >= 0.0);
                }
            }
        }
    }
}
