//! Executes a script against the model: a step is done when telemetry shows its effect, never because it was asked for.

use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::SystemId;

use super::{Condition, Line, Step, Visibility};
use crate::command::{Command, Order};
use crate::model::map::Agreement;
use crate::model::missions::{PlanState, Transfer};
use crate::model::orders::{OrderState, SentOrder};
use crate::model::vehicle::{Presence, Vehicle};
use crate::model::{Model, Source};
use crate::modes::Mode;
use crate::replay::Steer;
use crate::view::camera::CameraCommand;
use crate::view::layers::Layer;

/// What a script wants from the program.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// What an operator would ask for.
    Do(Command),
    /// Move the camera.
    View(CameraCommand),
    /// Show or hide a layer.
    Layer(Layer, Visibility),
    /// Write a picture with this name.
    Screenshot(String),
    /// Steer the replay.
    Replay(Steer),
    /// End with success.
    Quit,
}

/// Why a script ends early. Its message names the line and the cause.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("line {line} `{text}`: {cause}")]
pub struct Failure {
    /// Counted from 1.
    pub line: usize,
    /// As written.
    pub text: String,
    /// What went wrong.
    pub cause: String,
}

/// Facts outside the model that conditions are about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Surroundings {
    /// The recording is at its end.
    pub replay_ended: bool,
    /// Pictures that were asked for and are not written yet.
    pub pictures_pending: usize,
    /// Whether the overlay of drivable ground is shown, but not made yet.
    pub overlay_pending: bool,
}

/// A script under way.
#[derive(Debug)]
pub struct Runner {
    lines: Vec<Line>,
    next: usize,
    started: Option<Stamp>,
}

/// How a step stands.
enum Progress {
    Done,
    /// What is still missing, for the message of a timeout.
    Waiting(String),
    Failed(String),
}

impl Runner {
    /// At the first line.
    pub fn new(lines: Vec<Line>) -> Self {
        Self {
            lines,
            next: 0,
            started: None,
        }
    }

    /// Whether every line is done.
    pub fn is_finished(&self) -> bool {
        self.next == self.lines.len()
    }

    /// The line under way.
    pub fn current(&self) -> Option<&Line> {
        self.lines.get(self.next)
    }

    /// Goes on as far as it can at `now`, which is this program's own time, also in a replay.
    pub fn poll(
        &mut self,
        now: Stamp,
        model: &Model,
        around: Surroundings,
        mut request: impl FnMut(Request),
    ) -> Result<(), Failure> {
        while let Some(line) = self.lines.get(self.next) {
            let Some(started) = self.started else {
                self.started = Some(now);
                // Effects show in the model after the request was carried out: look at it next time.
                if let Some(wanted) = request_of(&line.step) {
                    request(wanted);
                    return Ok(());
                }
                continue;
            };
            match progress(line, started, now, model, around) {
                Progress::Done => {
                    self.started = None;
                    self.next += 1;
                }
                Progress::Failed(cause) => return Err(failure(line, cause)),
                Progress::Waiting(missing) if now.since(started) > line.timeout => {
                    let cause = format!(
                        "timed out after {} s: {missing}",
                        line.timeout.as_secs_f64()
                    );
                    return Err(failure(line, cause));
                }
                Progress::Waiting(_) => return Ok(()),
            }
        }
        Ok(())
    }
}

fn failure(line: &Line, cause: String) -> Failure {
    Failure {
        line: line.number,
        text: line.text.clone(),
        cause,
    }
}

fn request_of(step: &Step) -> Option<Request> {
    Some(match step {
        Step::Wait(_) | Step::WaitFor(_) => return None,
        Step::Do(command) => Request::Do(command.clone()),
        Step::View(command) => Request::View(*command),
        Step::Layer(layer, visibility) => Request::Layer(*layer, *visibility),
        Step::Screenshot(name) => Request::Screenshot(name.clone()),
        Step::Replay(steer) => Request::Replay(*steer),
        Step::Quit => Request::Quit,
    })
}

fn progress(
    line: &Line,
    started: Stamp,
    now: Stamp,
    model: &Model,
    around: Surroundings,
) -> Progress {
    match &line.step {
        Step::Wait(span) if now.since(started) >= *span => Progress::Done,
        Step::Wait(_) => Progress::Waiting("time".to_owned()),
        Step::WaitFor(Condition::ReplayEnd) if around.replay_ended => Progress::Done,
        Step::WaitFor(condition) => condition_progress(*condition, model),
        Step::Screenshot(_) if around.pictures_pending > 0 => {
            Progress::Waiting("the picture is not written".to_owned())
        }
        Step::Layer(Layer::Traversability, Visibility::Shown) if around.overlay_pending => {
            Progress::Waiting("the overlay of drivable ground is not made".to_owned())
        }
        Step::Screenshot(_) | Step::View(_) | Step::Layer(..) | Step::Replay(_) | Step::Quit => {
            Progress::Done
        }
        Step::Do(command) => command_progress(command, model),
    }
}

fn condition_progress(condition: Condition, model: &Model) -> Progress {
    let about = |id: SystemId, seen: &dyn Fn(&Vehicle) -> bool, missing: &str| match model
        .vehicles
        .get(&id)
    {
        None => Progress::Waiting(format!("no heartbeat of vehicle {} was heard", id.0)),
        Some(vehicle) if vehicle.presence(model.now) == Presence::Lost => {
            Progress::Waiting(format!("the link to {} is lost", vehicle.name()))
        }
        Some(vehicle) if seen(vehicle) => Progress::Done,
        Some(vehicle) => Progress::Waiting(format!("{} {missing}", vehicle.name())),
    };
    match condition {
        Condition::Vehicle(id) => about(id, &|_| true, ""),
        Condition::Position(id) => about(
            id,
            &|v| v.position.is_some() && v.attitude.is_some(),
            "has not told its pose",
        ),
        Condition::Ready(id) => {
            let why = model.vehicles.get(&id).and_then(|v| v.not_ready.back());
            let why = why.map_or_else(String::new, |text| format!(": {}", text.value));
            about(
                id,
                &|v| v.ready.is_some_and(|ready| ready.value),
                &format!("is not ready to arm{why}"),
            )
        }
        Condition::Armed(id) => about(id, &Vehicle::is_armed, "is not armed"),
        Condition::Disarmed(id) => about(id, &|v| !v.is_armed(), "is armed"),
        Condition::Mode(id, mode) => {
            let is = model
                .vehicles
                .get(&id)
                .map_or(mode, |v| v.heartbeat.value.mode);
            about(
                id,
                &|v| v.heartbeat.value.mode == mode,
                &format!("is in mode {is}, not {mode}"),
            )
        }
        Condition::MissionComplete(id) => {
            let at = model.vehicles.get(&id).and_then(|v| v.mission);
            let at = at.map_or_else(String::new, |m| {
                format!(", it is at item {}", m.value.current)
            });
            about(
                id,
                &|v| v.mission.is_some_and(|m| m.value.complete),
                &format!("has not completed its mission{at}"),
            )
        }
        Condition::Origin => match &model.map.origin {
            Some(origin) if origin.from.is_some() => Progress::Done,
            _ => Progress::Waiting("no companion has told the map's origin".to_owned()),
        },
        Condition::Map => map_progress(model),
        Condition::ReplayEnd => Progress::Waiting("the recording is not at its end".to_owned()),
    }
}

fn map_progress(model: &Model) -> Progress {
    let map = &model.map;
    if map.agreement() == Agreement::Equal && map.tiles() > 0 {
        return Progress::Done;
    }
    let Some(status) = map.status() else {
        return Progress::Waiting("no companion has told its status".to_owned());
    };
    let ours = map
        .digest
        .map_or_else(|| "none".to_owned(), |digest| digest.value.to_string());
    Progress::Waiting(format!(
        "companion finished: {}, its digest {:016x}, ours {ours}, {} of {} tiles here",
        if status.value.finished { "yes" } else { "no" },
        status.value.map_digest,
        map.tiles(),
        status.value.tiles_known,
    ))
}

fn command_progress(command: &Command, model: &Model) -> Progress {
    let mission = |id: &SystemId| model.missions.get(id);
    if model.source == Source::Replay && !command.suits_a_replay() {
        return Progress::Failed("a recording cannot be commanded".to_owned());
    }
    match command {
        Command::Acknowledge(_) | Command::DiscardPlan(_) => Progress::Done,
        Command::Select(id) if model.active == Some(*id) => Progress::Done,
        Command::Select(id) => Progress::Failed(format!("vehicle {} is not known", id.0)),
        Command::Connect(uri) => match model.links.iter().find(|link| link.uri == *uri) {
            None => Progress::Waiting("the link is not open".to_owned()),
            Some(link) => link.error.clone().map_or(Progress::Done, Progress::Failed),
        },
        Command::PlanPath { vehicle, .. } | Command::PlanSurvey { vehicle, .. } => {
            match mission(vehicle).map(|mission| &mission.plan) {
                Some(PlanState::Ready(_)) => Progress::Done,
                Some(PlanState::Refused { reason, .. }) => Progress::Failed(reason.clone()),
                Some(PlanState::Planning { .. }) => {
                    Progress::Waiting("the planner is still working".to_owned())
                }
                Some(PlanState::None) | None => Progress::Failed("it was not planned".to_owned()),
            }
        }
        Command::Upload(id) => match mission(id).map(|mission| &mission.transfer) {
            Some(Transfer::Verified { .. }) => Progress::Done,
            Some(Transfer::Differs { differences, .. }) => Progress::Failed(format!(
                "the vehicle has something else: {}",
                differences.join("; ")
            )),
            Some(Transfer::Failed { reason, .. }) => Progress::Failed(reason.clone()),
            Some(Transfer::Uploading { done, total }) => {
                Progress::Waiting(format!("{done} of {total} items sent"))
            }
            Some(Transfer::ReadingBack { done, total }) => {
                Progress::Waiting(format!("{done} of {total} items read back"))
            }
            Some(Transfer::None) | None => {
                Progress::Failed("there is nothing to upload".to_owned())
            }
        },
        Command::Order(id, order) => order_progress(*id, *order, model),
    }
}

/// An order is done when telemetry shows its effect, whatever the answer was.
fn order_progress(id: SystemId, order: Order, model: &Model) -> Progress {
    let latest = model
        .orders
        .iter()
        .find(|sent| sent.vehicle == id && sent.order == order);
    let Some(sent) = latest else {
        return Progress::Failed("it was not sent".to_owned());
    };
    if let Some(cause) = sent.failure() {
        // A vehicle explains a denial shortly after it.
        let explained = !sent.texts.is_empty()
            || matches!(
                sent.state,
                OrderState::Refused(_) | OrderState::NoAnswer | OrderState::Superseded
            );
        let waited = sent
            .answered_at
            .is_none_or(|at| model.now.since(at) > Duration::from_secs(1));
        return if explained || waited {
            Progress::Failed(cause)
        } else {
            Progress::Waiting(cause)
        };
    }
    if sent.confirmed_at.is_some() {
        return Progress::Done;
    }
    Progress::Waiting(if sent.is_open() {
        "the vehicle has not answered".to_owned()
    } else {
        "accepted, but telemetry does not show it".to_owned()
    })
}

/// Whether telemetry shows what was ordered.
pub(crate) fn shows(vehicle: &Vehicle, sent: &SentOrder, now: Stamp) -> bool {
    let heartbeat = vehicle.heartbeat;
    let told_since = heartbeat.at >= sent.sent_at && vehicle.presence(now) == Presence::Present;
    if !told_since {
        return false;
    }
    let mode = heartbeat.value.mode;
    match sent.order {
        Order::Arm => heartbeat.value.armed,
        Order::Disarm => !heartbeat.value.armed,
        Order::Takeoff { altitude_m } => {
            let fix = vehicle.fix.filter(|fix| fix.at >= sent.sent_at);
            fix.is_some_and(|fix| fix.value.above_home_m >= altitude_m * 0.9)
        }
        Order::StartMission => mode == Mode::Auto,
        Order::Hold => [Mode::Hold, Mode::Loiter, Mode::Brake, Mode::PosHold].contains(&mode),
        Order::ReturnToLaunch => mode == Mode::Rtl,
        Order::Land => mode == Mode::Land,
        Order::Mode(wanted) => mode == wanted,
    }
}
