//! Scripts that play the operator: one command a line, each with a deadline, the first failure ends the program.
//!
//! ```text
//! # comment                                   wait 2.5
//! connect udpin:127.0.0.1:14550               wait-for vehicle 2 timeout 30
//! wait-for map timeout 600                    plan 2 to 1.5 0.8 heading 090
//! upload 2                                    arm 2
//! start 2                                     wait-for mission-complete 2 timeout 120
//! screenshot groundstation                    quit
//! ```
//!
//! [`parse`] reads the text, [`Runner`] executes it against the model: a command is done when telemetry shows its effect.
//! `groundstation --script-help` prints [`HELP`].

mod parse;
mod run;

pub use parse::{ParseError, Problem, parse};
pub(crate) use run::shows;
pub use run::{Failure, Request, Runner, Surroundings};

use std::time::Duration;

use mavlink_ext::SystemId;

use crate::command::{Command, Order};
use crate::modes::Mode;
use crate::view::camera::CameraCommand;
use crate::view::layers::Layer;

/// The whole language, for `--script-help` and for whoever mistypes a command.
pub const HELP: &str = "\
Every command may end in `timeout SECONDS`. Places are metres east and north of the map's origin,
headings degrees clockwise from north, N the system id of a vehicle.
  wait SECONDS                         let time pass
  connect URI                          open a link: udpin:, udpout:, tcpin: or tcpout:HOST:PORT, serial:DEVICE:BAUD
  screenshot NAME                      write NAME.png into the folder of --screenshot
  quit                                 end with success; a headless run also ends after its last line
  wait-for vehicle N                   its autopilot's heartbeat is heard
  wait-for position N                  its place on the map is known
  wait-for ready N                     it says that it can be armed
  wait-for armed N | disarmed N        as its heartbeat tells
  wait-for mode N NAME                 as its heartbeat tells
  wait-for mission-complete N          it has reached the last item of its mission
  wait-for origin                      a companion has told where on earth the map lies
  wait-for map                         the companion has finished and its map digest equals ours
  wait-for replay-end                  the recording has been played to its end
  select N                             make it the active vehicle
  plan N to X Y [heading DEG]          find a path for a ground vehicle
  survey N X0 Y0 X1 Y1 alt A spacing S lay survey lines for an aircraft, A above its take-off point
  upload N                             write the plan, read it back, compare
  arm N | disarm N | start N           wait until telemetry shows it
  takeoff N alt A | land N | rtl N | hold N | mode N NAME
  view top | view fit | view follow N | view free
  view orbit AZIMUTH ELEVATION DISTANCE  look towards AZIMUTH, ELEVATION degrees down, from DISTANCE m
  view look-at X Y Z                   with that place in the middle
  show LAYER | hide LAYER              map grid traversability tracks plans camera axes
  replay play | replay pause | replay speed X (at most 1000) | replay seek SECONDS
";

/// A command and the line it stands in.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Counted from 1.
    pub number: usize,
    /// The line as written, for messages.
    pub text: String,
    /// What to do.
    pub step: Step,
    /// How long it may take.
    pub timeout: Duration,
}

/// What one line asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Let time pass.
    Wait(Duration),
    /// Wait until something is so.
    WaitFor(Condition),
    /// Ask for something and wait until it is done or has failed.
    Do(Command),
    /// Move the camera of the 3-D view.
    View(CameraCommand),
    /// Show or hide a layer of the map.
    Layer(Layer, Visibility),
    /// Write a picture of the whole window.
    Screenshot(String),
    /// Steer the replay.
    Replay(crate::replay::Steer),
    /// End the program with success.
    Quit,
}

/// Whether a layer is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// It is.
    Shown,
    /// It is not.
    Hidden,
}

/// Something that can be seen in the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// The vehicle's autopilot is heard.
    Vehicle(SystemId),
    /// The vehicle's place on the map is known.
    Position(SystemId),
    /// The vehicle says that it can be armed.
    Ready(SystemId),
    /// Its motors run.
    Armed(SystemId),
    /// Its motors do not.
    Disarmed(SystemId),
    /// It is in this mode.
    Mode(SystemId, Mode),
    /// It has reached the last item of its mission.
    MissionComplete(SystemId),
    /// A companion has told where on earth the map lies.
    Origin,
    /// The companion has finished its source and the digests of both maps are equal.
    Map,
    /// The recording is at its end.
    ReplayEnd,
}

/// How long a step may take unless the line says otherwise.
fn default_timeout(step: &Step) -> Duration {
    Duration::from_secs(match step {
        Step::Wait(span) => return *span + Duration::from_secs(1),
        Step::WaitFor(Condition::Map) => 600,
        Step::WaitFor(Condition::MissionComplete(_) | Condition::ReplayEnd) => 300,
        Step::Do(
            Command::PlanPath { .. }
            | Command::Upload(_)
            | Command::Order(_, Order::Takeoff { .. }),
        ) => 60,
        Step::WaitFor(_) | Step::Do(_) => 30,
        Step::View(_) | Step::Layer(..) | Step::Screenshot(_) | Step::Replay(_) | Step::Quit => 20,
    })
}
