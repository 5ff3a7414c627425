//! Text to steps. Every refusal names its line.

use std::str::FromStr;
use std::time::Duration;

use mavlink_ext::SystemId;

use super::{Condition, Line, Step, Visibility, default_timeout};
use crate::command::{Command, Order, SurveyArea};
use crate::modes::Mode;
use crate::replay::{Replay, Steer};
use crate::view::camera::CameraCommand;
use crate::view::layers::Layer;

/// Why a script cannot be read, and where.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("line {line}: {problem}")]
pub struct ParseError {
    /// Counted from 1.
    pub line: usize,
    /// What is wrong there.
    pub problem: Problem,
}

/// What can be wrong with a line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// No such command.
    #[error("unknown command `{0}`; --script-help lists all")]
    UnknownCommand(String),
    /// The line stops where something should follow.
    #[error("`{command}` lacks {what}")]
    Missing {
        /// The command.
        command: &'static str,
        /// What should follow.
        what: &'static str,
    },
    /// Something else stands there.
    #[error("expected {what}, found `{found}`")]
    Unexpected {
        /// What should stand there.
        what: &'static str,
        /// What does.
        found: String,
    },
    /// The line goes on after its end.
    #[error("do not understand `{0}` at the end of the line")]
    TooMuch(String),
}

/// The steps of a script.
pub fn parse(text: &str) -> Result<Vec<Line>, ParseError> {
    let numbered = text
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()));
    numbered
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
        .map(|(number, line)| {
            let parsed = Words::new(line).line();
            let (step, timeout) = parsed.map_err(|problem| ParseError {
                line: number,
                problem,
            })?;
            Ok(Line {
                number,
                text: line.to_owned(),
                step,
                timeout,
            })
        })
        .collect()
}

/// The words of one line, taken from the front.
struct Words<'a> {
    command: &'static str,
    rest: std::str::SplitWhitespace<'a>,
}

type Parsed<T> = Result<T, Problem>;

impl<'a> Words<'a> {
    fn new(line: &'a str) -> Self {
        Self {
            command: "the line",
            rest: line.split_whitespace(),
        }
    }

    fn line(mut self) -> Parsed<(Step, Duration)> {
        let step = self.step()?;
        let timeout = match self.rest.next() {
            None => default_timeout(&step),
            Some("timeout") => self.duration("a timeout in seconds")?,
            Some(other) => return Err(Problem::TooMuch(other.to_owned())),
        };
        match self.rest.next() {
            None => Ok((step, timeout)),
            Some(more) => Err(Problem::TooMuch(more.to_owned())),
        }
    }

    fn step(&mut self) -> Parsed<Step> {
        let name = self.word("a command")?;
        Ok(match name {
            "wait" => Step::Wait(self.named("wait").duration("seconds")?),
            "quit" => Step::Quit,
            "connect" => Step::Do(Command::Connect(
                self.named("connect").word("a URI")?.to_owned(),
            )),
            "screenshot" => Step::Screenshot(self.named("screenshot").file_name()?),
            "wait-for" => Step::WaitFor(self.named("wait-for").condition()?),
            "select" => Step::Do(Command::Select(self.named("select").vehicle()?)),
            "plan" => Step::Do(self.named("plan").plan()?),
            "survey" => Step::Do(self.named("survey").survey()?),
            "upload" => Step::Do(Command::Upload(self.named("upload").vehicle()?)),
            "view" => Step::View(self.named("view").view()?),
            "show" => Step::Layer(self.named("show").layer()?, Visibility::Shown),
            "hide" => Step::Layer(self.named("hide").layer()?, Visibility::Hidden),
            "replay" => Step::Replay(self.named("replay").replay()?),
            order => Step::Do(self.order(order)?),
        })
    }

    fn order(&mut self, name: &str) -> Parsed<Command> {
        let plain = |order: Order| move |vehicle: SystemId| Command::Order(vehicle, order);
        Ok(match name {
            "arm" => plain(Order::Arm)(self.named("arm").vehicle()?),
            "disarm" => plain(Order::Disarm)(self.named("disarm").vehicle()?),
            "start" => plain(Order::StartMission)(self.named("start").vehicle()?),
            "land" => plain(Order::Land)(self.named("land").vehicle()?),
            "rtl" => plain(Order::ReturnToLaunch)(self.named("rtl").vehicle()?),
            "hold" => plain(Order::Hold)(self.named("hold").vehicle()?),
            "takeoff" => {
                let vehicle = self.named("takeoff").vehicle()?;
                self.keyword("alt")?;
                let altitude_m = self.positive("an altitude in metres")?;
                Command::Order(vehicle, Order::Takeoff { altitude_m })
            }
            "mode" => {
                let vehicle = self.named("mode").vehicle()?;
                Command::Order(vehicle, Order::Mode(self.mode()?))
            }
            unknown => return Err(Problem::UnknownCommand(unknown.to_owned())),
        })
    }

    fn condition(&mut self) -> Parsed<Condition> {
        Ok(match self.word("what to wait for")? {
            "vehicle" => Condition::Vehicle(self.vehicle()?),
            "position" => Condition::Position(self.vehicle()?),
            "ready" => Condition::Ready(self.vehicle()?),
            "armed" => Condition::Armed(self.vehicle()?),
            "disarmed" => Condition::Disarmed(self.vehicle()?),
            "mission-complete" => Condition::MissionComplete(self.vehicle()?),
            "mode" => Condition::Mode(self.vehicle()?, self.mode()?),
            "origin" => Condition::Origin,
            "map" => Condition::Map,
            "replay-end" => Condition::ReplayEnd,
            other => {
                return Err(Problem::Unexpected {
                    what: "vehicle, position, ready, armed, disarmed, mode, mission-complete, origin, map or replay-end",
                    found: other.to_owned(),
                });
            }
        })
    }

    fn plan(&mut self) -> Parsed<Command> {
        let vehicle = self.vehicle()?;
        self.keyword("to")?;
        let (x_m, y_m) = (self.number("metres east")?, self.number("metres north")?);
        let heading_deg = if self.peek() == Some("heading") {
            self.keyword("heading")?;
            Some(self.number("degrees clockwise from north")?)
        } else {
            None
        };
        Ok(Command::PlanPath {
            vehicle,
            x_m,
            y_m,
            heading_deg,
        })
    }

    fn survey(&mut self) -> Parsed<Command> {
        let vehicle = self.vehicle()?;
        let from_m = [self.number("metres east")?, self.number("metres north")?];
        let to_m = [self.number("metres east")?, self.number("metres north")?];
        self.keyword("alt")?;
        let altitude_m = self.positive("an altitude in metres")?;
        self.keyword("spacing")?;
        let spacing_m = self.positive("a distance in metres")?;
        let area = SurveyArea {
            from_m,
            to_m,
            altitude_m,
            spacing_m,
        };
        Ok(Command::PlanSurvey { vehicle, area })
    }

    fn view(&mut self) -> Parsed<CameraCommand> {
        Ok(
            match self.word("top, fit, follow, free, orbit or look-at")? {
                "top" => CameraCommand::Top,
                "fit" => CameraCommand::Fit,
                "free" => CameraCommand::Free,
                "follow" => CameraCommand::Follow(self.vehicle()?),
                "orbit" => CameraCommand::Orbit {
                    azimuth_deg: self.number("an azimuth in degrees")?,
                    elevation_deg: self.number("an elevation in degrees")?,
                    distance_m: self.positive("a distance in metres")?,
                },
                "look-at" => CameraCommand::LookAt {
                    x_m: self.number("metres east")?,
                    y_m: self.number("metres north")?,
                    z_m: self.number("metres up")?,
                },
                other => {
                    let found = other.to_owned();
                    return Err(Problem::Unexpected {
                        what: "top, fit, follow, free, orbit or look-at",
                        found,
                    });
                }
            },
        )
    }

    fn layer(&mut self) -> Parsed<Layer> {
        let name = self.word("a layer")?;
        Layer::ALL
            .into_iter()
            .find(|layer| layer.word() == name)
            .ok_or_else(|| Problem::Unexpected {
                what: "map, grid, traversability, tracks, plans, camera or axes",
                found: name.to_owned(),
            })
    }

    fn replay(&mut self) -> Parsed<Steer> {
        Ok(match self.word("play, pause, speed or seek")? {
            "play" => Steer::Play,
            "pause" => Steer::Pause,
            "speed" => Steer::Speed(self.speed()?),
            "seek" => Steer::Seek(self.duration("seconds from the start")?),
            other => {
                let found = other.to_owned();
                return Err(Problem::Unexpected {
                    what: "play, pause, speed or seek",
                    found,
                });
            }
        })
    }

    fn speed(&mut self) -> Parsed<f64> {
        const WHAT: &str = "a speed up to 1000, 1 being real time";
        let speed = self.positive(WHAT)?;
        if speed <= Replay::FASTEST {
            return Ok(speed);
        }
        Err(Problem::Unexpected {
            what: WHAT,
            found: speed.to_string(),
        })
    }

    fn named(&mut self, command: &'static str) -> &mut Self {
        self.command = command;
        self
    }

    fn peek(&self) -> Option<&'a str> {
        self.rest.clone().next()
    }

    fn word(&mut self, what: &'static str) -> Parsed<&'a str> {
        self.rest.next().ok_or(Problem::Missing {
            command: self.command,
            what,
        })
    }

    fn keyword(&mut self, keyword: &'static str) -> Parsed<()> {
        match self.word(keyword)? {
            word if word == keyword => Ok(()),
            other => Err(Problem::Unexpected {
                what: keyword,
                found: other.to_owned(),
            }),
        }
    }

    fn parsed<T: FromStr>(&mut self, what: &'static str) -> Parsed<(T, &'a str)> {
        let word = self.word(what)?;
        let value = word.parse().map_err(|_error: T::Err| Problem::Unexpected {
            what,
            found: word.to_owned(),
        })?;
        Ok((value, word))
    }

    fn number(&mut self, what: &'static str) -> Parsed<f64> {
        let (value, word) = self.parsed::<f64>(what)?;
        if value.is_finite() {
            Ok(value)
        } else {
            Err(Problem::Unexpected {
                what,
                found: word.to_owned(),
            })
        }
    }

    fn positive(&mut self, what: &'static str) -> Parsed<f64> {
        let value = self.number(what)?;
        if value > 0.0 {
            Ok(value)
        } else {
            Err(Problem::Unexpected {
                what,
                found: value.to_string(),
            })
        }
    }

    fn duration(&mut self, what: &'static str) -> Parsed<Duration> {
        let seconds = self.number(what)?;
        Duration::try_from_secs_f64(seconds).map_err(|_error| Problem::Unexpected {
            what,
            found: seconds.to_string(),
        })
    }

    fn vehicle(&mut self) -> Parsed<SystemId> {
        let what = "a system id from 1 to 255";
        match self.parsed::<u8>(what)? {
            (0, word) => Err(Problem::Unexpected {
                what,
                found: word.to_owned(),
            }),
            (id, _) => Ok(SystemId(id)),
        }
    }

    fn mode(&mut self) -> Parsed<Mode> {
        let word = self.word("a mode, as AUTO")?;
        Mode::from_name(word).ok_or_else(|| Problem::Unexpected {
            what: "a mode, as AUTO",
            found: word.to_owned(),
        })
    }

    /// A name that stays inside the folder it is written to.
    fn file_name(&mut self) -> Parsed<String> {
        let what = "a file name of letters, digits, `-`, `_` and `.`";
        let word = self.word("a name")?;
        let fits = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if word.chars().all(fits) && !word.starts_with('.') {
            Ok(word.strip_suffix(".png").unwrap_or(word).to_owned())
        } else {
            Err(Problem::Unexpected {
                what,
                found: word.to_owned(),
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[track_caller]
    fn check_step(text: &str, expected: Step) {
        let lines = parse(text).expect(text);
        assert_eq!(
            lines.into_iter().map(|line| line.step).collect::<Vec<_>>(),
            [expected],
            "{text}"
        );
    }

    #[track_caller]
    fn check_refused(text: &str, message: &str) {
        let error = parse(text).expect_err(text);
        assert_eq!(error.to_string(), message, "{text}");
    }

    #[test]
    fn each_command_is_understood() {
        let two = SystemId(2);
        check_step("wait 2.5", Step::Wait(Duration::from_millis(2500)));
        check_step(
            "wait-for vehicle 2 timeout 3",
            Step::WaitFor(Condition::Vehicle(two)),
        );
        check_step(
            "wait-for mode 2 auto",
            Step::WaitFor(Condition::Mode(two, Mode::Auto)),
        );
        check_step("arm 2", Step::Do(Command::Order(two, Order::Arm)));
        check_step("screenshot room.png", Step::Screenshot("room".to_owned()));
        check_step(
            "plan 2 to 1.5 -0.25 heading 090",
            Step::Do(Command::PlanPath {
                vehicle: two,
                x_m: 1.5,
                y_m: -0.25,
                heading_deg: Some(90.0),
            }),
        );
        check_step(
            "plan 2 to 1 2 timeout 9",
            Step::Do(Command::PlanPath {
                vehicle: two,
                x_m: 1.0,
                y_m: 2.0,
                heading_deg: None,
            }),
        );
        let area = SurveyArea {
            from_m: [0.0, 1.0],
            to_m: [4.0, 5.0],
            altitude_m: 2.0,
            spacing_m: 0.5,
        };
        check_step(
            "survey 1 0 1 4 5 alt 2 spacing 0.5",
            Step::Do(Command::PlanSurvey {
                vehicle: SystemId(1),
                area,
            }),
        );
        check_step("hide grid", Step::Layer(Layer::Grid, Visibility::Hidden));
        check_step(
            "view orbit 225 35 9",
            Step::View(CameraCommand::Orbit {
                azimuth_deg: 225.0,
                elevation_deg: 35.0,
                distance_m: 9.0,
            }),
        );
        check_step(
            "replay seek 12.5",
            Step::Replay(Steer::Seek(Duration::from_millis(12_500))),
        );
    }

    #[test]
    fn a_timeout_may_stand_at_the_end_of_every_line() {
        let lines = parse("# the map first\n\n  wait-for map timeout 90\nquit").expect("valid");
        assert_eq!(
            (lines[0].number, lines[0].timeout),
            (3, Duration::from_secs(90))
        );
        assert_eq!(lines[1].number, 4);
    }

    #[test]
    fn a_refusal_names_the_line_and_what_was_expected() {
        check_refused(
            "quit\nfly 1",
            "line 2: unknown command `fly`; --script-help lists all",
        );
        check_refused("wait", "line 1: `wait` lacks seconds");
        check_refused("wait -1", "line 1: expected seconds, found `-1`");
        check_refused("wait nan", "line 1: expected seconds, found `nan`");
        check_refused(
            "arm 300",
            "line 1: expected a system id from 1 to 255, found `300`",
        );
        check_refused(
            "arm 2 now",
            "line 1: do not understand `now` at the end of the line",
        );
        check_refused("takeoff 1 2", "line 1: expected alt, found `2`");
        check_refused(
            "screenshot ../x",
            "line 1: expected a file name of letters, digits, `-`, `_` and `.`, found `../x`",
        );
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in ".{0,200}") {
            drop(parse(&text));
        }

        #[test]
        fn any_words_of_the_language_are_read_or_refused(
            words in prop::collection::vec(prop::sample::select(vec![
                "wait", "wait-for", "plan", "survey", "upload", "arm", "view", "orbit", "replay", "seek", "mode",
                "vehicle", "to", "heading", "alt", "spacing", "timeout", "1", "-2.5", "1e308", "1e400", "nan", "\n",
            ]), 0..12)
        ) {
            drop(parse(&words.join(" ")));
        }
    }
}
