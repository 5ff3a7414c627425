//! The program without a window: links, recording, planner, script and views around one station.
//!
//! [`App::logic`] takes in what happened and lets the station react; [`App::ui`] draws. The window calls both, the headless
//! mode calls the second only when a picture is wanted.

use std::collections::VecDeque;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use maps::time::Stamp;

use crate::clock::Clock;
use crate::config::Config;
use crate::model::{LinkState, Model, Source};
use crate::net::{Net, Recorder};
use crate::picture::Picture;
use crate::plan::Worker;
use crate::replay::{Replay, Steer};
use crate::report::Report;
use crate::script::{Failure, Line, Request, Runner, Surroundings, Visibility};
use crate::station::{Action, Event, Station};
use crate::view::layers::Layer;
use crate::view::workspace::{Workspace, window_ui};

/// So many frames are handled before the window is drawn again.
const FRAMES_AT_ONCE: usize = 2000;
/// The station looks at the time this often.
const TICK_EVERY: Duration = Duration::from_millis(50);
/// The overlay of drivable ground is made anew this often, while it is shown and the map changes.
const DRIVABLE_EVERY: Duration = Duration::from_secs(3);

/// Where it listens if nobody says otherwise: where vehicles send to a ground station.
const DEFAULT_LINK: &str = "udpin:0.0.0.0:14550";

/// What the program was started with.
#[derive(Debug, Default)]
pub struct Options {
    /// Links to open, besides the configured ones.
    pub connect: Vec<String>,
    /// A recording to play.
    pub replay: Option<PathBuf>,
    /// A script to execute.
    pub script: Option<Vec<Line>>,
    /// Where pictures go.
    pub pictures: PathBuf,
    /// Where everything sent and received goes.
    pub record: Option<PathBuf>,
    /// Where the figures go at the end.
    pub report: Option<PathBuf>,
}

/// The program.
pub struct App {
    clock: Clock,
    station: Station,
    net: Net,
    recorder: Option<Recorder>,
    planner: Worker,
    replay: Option<Replay>,
    runner: Option<Runner>,
    scripted: bool,
    /// The operator has been told that the recording has stopped.
    recording_stopped: bool,
    end: Option<Result<(), Failure>>,
    workspace: Workspace,
    pictures: PathBuf,
    wanted: VecDeque<PathBuf>,
    report: Option<PathBuf>,
    ticked_at: Option<Stamp>,
    advanced_at: Stamp,
    drivable_at: Option<Stamp>,
}

impl App {
    /// Opens the links and files that the options name.
    pub fn new(config: Config, options: Options, clock: Clock) -> anyhow::Result<Self> {
        let replay = options.replay.as_deref().map(open_replay).transpose()?;
        let (source, epoch) = match &replay {
            Some(replay) => (Source::Replay, replay.epoch_unix_us()),
            None => (Source::Live, clock.epoch_unix_us()),
        };
        let mut links = config
            .links
            .iter()
            .chain(&options.connect)
            .cloned()
            .collect::<Vec<_>>();
        anyhow::ensure!(
            replay.is_none() || (links.is_empty() && options.record.is_none()),
            "a replay has no links and records nothing: leave out --connect and --record"
        );
        if links.is_empty() && replay.is_none() && options.script.is_none() {
            links.push(DEFAULT_LINK.to_owned());
        }
        let mut app = Self {
            clock,
            station: Station::new(Model::new(config, source, epoch)),
            net: Net::new(clock).context("cannot start the thread of copies")?,
            recorder: options
                .record
                .as_deref()
                .map(Recorder::create)
                .transpose()?,
            planner: Worker::start().context("cannot start the planner's thread")?,
            replay,
            scripted: options.script.is_some(),
            runner: options.script.map(Runner::new),
            recording_stopped: false,
            end: None,
            workspace: Workspace::default(),
            pictures: options.pictures,
            wanted: VecDeque::new(),
            report: options.report,
            ticked_at: None,
            advanced_at: clock.now(),
            drivable_at: None,
        };
        for uri in links {
            app.open(&uri);
        }
        let failed = app
            .station
            .model()
            .links
            .iter()
            .find(|link| link.error.is_some());
        match failed {
            Some(LinkState {
                error: Some(error), ..
            }) => Err(anyhow::anyhow!(error.clone())),
            _ => Ok(app),
        }
    }

    /// Everything that is known.
    pub fn model(&self) -> &Model {
        self.station.model()
    }

    /// Whether there was a script and all of it is done, `quit` or not.
    pub fn script_is_done(&self) -> bool {
        self.scripted && self.runner.is_none()
    }

    /// How the script ended; `None` while it runs, or without a script.
    pub fn end(&self) -> Option<&Result<(), Failure>> {
        self.end.as_ref()
    }

    /// Takes in what has happened, waiting for it at most `patience`, and reacts.
    pub fn logic(&mut self, patience: Duration) {
        if self.replay.is_some() {
            // Nothing comes from a link that is not there: this only waits.
            self.take_frames(patience);
            self.advance_replay();
        } else {
            self.take_frames(patience);
            let now = self.clock.now();
            if self.ticked_at.is_none_or(|at| now.since(at) >= TICK_EVERY) {
                self.ticked_at = Some(now);
                self.feed(now, Event::Links(self.link_states()));
                self.feed(now, Event::Tick);
            }
        }
        while let Some(outcome) = self.planner.outcome() {
            if let crate::plan::Outcome::Drivable(overlay) = &outcome {
                self.workspace.map.drivable = Some(overlay.clone());
            }
            self.feed(self.model().now, Event::Planned(outcome));
        }
        self.want_drivable();
        self.run_script();
    }

    /// Draws the window and does what is asked for in it.
    pub fn ui(&mut self, ui: &mut egui::Ui) {
        let changed = self.station.take_changed_tiles();
        self.workspace.map.update(self.station.model(), &changed);
        let asked = window_ui(
            ui,
            self.station.model(),
            &mut self.workspace,
            self.replay.as_ref(),
        );
        for command in asked.commands {
            self.feed(self.now(), Event::Command(command));
        }
        for steer in asked.steers {
            self.steer(steer);
        }
    }

    /// Where the next picture that was asked for goes.
    pub fn wanted_picture(&self) -> Option<&Path> {
        self.wanted.front().map(PathBuf::as_path)
    }

    /// Writes the picture that was asked for.
    pub fn deliver_picture(&mut self, picture: &Picture) -> anyhow::Result<()> {
        if let Some(path) = self.wanted.pop_front() {
            picture.write(&path)?;
            tracing::info!(path = %path.display(), "picture written");
        }
        Ok(())
    }

    /// Writes what is to be left behind; the error of a script that failed comes last.
    pub fn finish(mut self) -> anyhow::Result<()> {
        let mut report = Report::of(self.model());
        report.frames_dropped = self.net.dropped();
        report.wall_s = self.clock.now().as_secs_f64();
        report.failure = match &self.end {
            Some(Err(failure)) => Some(failure.to_string()),
            Some(Ok(())) | None => None,
        };
        if let Some(recorder) = self.recorder.take() {
            recorder.finish()?;
        }
        if let Some(path) = &self.report {
            let text = serde_json::to_string_pretty(&report)? + "\n";
            if let Some(folder) = path.parent() {
                std::fs::create_dir_all(folder)
                    .with_context(|| format!("cannot create {}", folder.display()))?;
            }
            std::fs::write(path, text)
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        match self.end {
            Some(Err(failure)) => Err(failure.into()),
            Some(Ok(())) | None => Ok(()),
        }
    }

    /// The time of the events: that of the recording in a replay.
    fn now(&self) -> Stamp {
        match &self.replay {
            Some(replay) => replay.position(),
            None => self.clock.now(),
        }
    }

    fn take_frames(&mut self, patience: Duration) {
        for (at, copy) in self.net.take_copies() {
            self.record(at, &copy);
        }
        let mut patience = patience;
        for _ in 0..FRAMES_AT_ONCE {
            let Some(received) = self.net.next(patience) else {
                return;
            };
            patience = Duration::ZERO;
            self.record(received.at, &received.frame);
            self.feed(
                received.at,
                Event::Frame {
                    link: received.link,
                    frame: received.frame,
                },
            );
        }
    }

    fn record(&mut self, at: Stamp, frame: &mavlink_ext::RawFrame) {
        let unix_us = self.station.model().unix_us(at);
        if let Some(recorder) = &mut self.recorder {
            recorder.record(unix_us, frame);
            if !recorder.is_recording() && !self.recording_stopped {
                self.recording_stopped = true;
                self.feed(at, Event::RecordingStopped);
            }
        }
    }

    fn feed(&mut self, now: Stamp, event: Event) {
        let mut actions = Vec::new();
        self.station
            .step(now, event, &mut |action| actions.push(action));
        for action in actions {
            self.act(action);
        }
    }

    fn act(&mut self, action: Action) {
        match action {
            Action::Send { link, frame } => {
                if let Err(error) = self.net.send(link, &frame) {
                    tracing::warn!(%error, "cannot send");
                }
                self.record(self.clock.now(), &frame);
            }
            Action::Forget { vehicle, commands } => self.net.forget(vehicle, &commands),
            Action::Open(uri) => self.open(&uri),
            Action::Plan(job) => {
                if let Err(refused) = self.planner.submit(job) {
                    self.feed(self.now(), Event::PlannerBusy(refused));
                }
            }
        }
    }

    fn open(&mut self, uri: &str) {
        let error = self.net.open(uri).err().map(|error| chain(&error));
        self.feed(
            self.now(),
            Event::Opened {
                uri: uri.to_owned(),
                error,
            },
        );
    }

    fn link_states(&self) -> Vec<crate::station::LinkFigures> {
        self.net.stats().collect()
    }

    fn advance_replay(&mut self) {
        let now = self.clock.now();
        let passed = now.since(self.advanced_at);
        self.advanced_at = now;
        let Some(replay) = &mut self.replay else {
            return;
        };
        let advance = replay.advance(passed);
        if advance.restart {
            self.station.restart();
            self.workspace.map.forget_map();
        }
        let mut ignore = |_: Action| {};
        let mut ticked = self.station.model().now;
        for (at, frame) in advance.frames {
            // What depends on silence must be seen in a replay that jumps, too.
            while at.since(ticked) >= TICK_EVERY * 10 {
                ticked += TICK_EVERY * 10;
                self.station.step(ticked, Event::Tick, &mut ignore);
            }
            self.station.step(
                *at,
                Event::Frame {
                    link: 0,
                    frame: frame.clone(),
                },
                &mut ignore,
            );
        }
        self.station.step(advance.now, Event::Tick, &mut ignore);
    }

    /// Seconds since the program started: unlike the moment that is shown, it never goes back, which egui relies on.
    pub fn running_s(&self) -> f64 {
        self.clock.now().as_secs_f64()
    }

    fn steer(&mut self, steer: Steer) {
        if let Some(replay) = &mut self.replay {
            replay.steer(steer);
        }
    }

    fn want_drivable(&mut self) {
        let model = self.station.model();
        let shown = self.workspace.map.layers.shows(Layer::Traversability);
        let Some(changed_at) = model.map.changed_at.filter(|_| shown) else {
            return;
        };
        let now = self.clock.now();
        let due = match self.drivable_at {
            None => true,
            Some(at) => {
                self.workspace.map.drivable.is_none()
                    || at <= changed_at && now.since(at) >= DRIVABLE_EVERY
            }
        };
        let waited = self
            .drivable_at
            .is_none_or(|at| now.since(at) >= Duration::from_secs(1));
        if let (true, true, Some(map)) = (due, waited, &model.map.voxels) {
            self.drivable_at = Some(now);
            let job = crate::plan::Job::Drivable(Box::new(crate::plan::DrivableJob {
                map: map.clone(),
                ugv: model.config.vehicle(),
            }));
            // A planner that has enough to do is asked again later.
            drop(self.planner.submit(job));
        }
    }

    fn is_drivable_pending(&self) -> bool {
        let map = &self.station.model().map;
        map.voxels.is_some()
            && map.changed_at.is_some()
            && self.workspace.map.layers.shows(Layer::Traversability)
            && self.workspace.map.drivable.is_none()
    }

    fn run_script(&mut self) {
        let Some(mut runner) = self.runner.take() else {
            return;
        };
        let around = Surroundings {
            replay_ended: self.replay.as_ref().is_some_and(Replay::is_at_end),
            pictures_pending: self.wanted.len(),
            overlay_pending: self.is_drivable_pending(),
        };
        let mut requests = Vec::new();
        let polled = runner.poll(self.clock.now(), self.station.model(), around, |request| {
            requests.push(request);
        });
        for request in requests {
            self.carry_out(request);
        }
        if let Err(failure) = polled {
            self.end = Some(Err(failure));
        } else if runner.is_finished() && self.end.is_none() {
            tracing::info!("the script is done");
        }
        if self.end.is_none() {
            self.runner = Some(runner).filter(|runner| !runner.is_finished());
        }
    }

    fn carry_out(&mut self, request: Request) {
        match request {
            Request::Do(command) => self.feed(self.now(), Event::Command(command)),
            Request::View(command) => self.workspace.map.command(command),
            Request::Layer(layer, Visibility::Shown) => self.workspace.map.layers.show(layer),
            Request::Layer(layer, Visibility::Hidden) => self.workspace.map.layers.hide(layer),
            Request::Screenshot(name) => self.wanted.push_back(self.pictures.join(name + ".png")),
            Request::Replay(steer) => self.steer(steer),
            Request::Quit => self.end = Some(Ok(())),
        }
    }
}

fn open_replay(path: &Path) -> anyhow::Result<Replay> {
    let file = File::open(path)
        .with_context(|| format!("cannot open the recording {}", path.display()))?;
    let replay = Replay::read(BufReader::new(file))
        .with_context(|| format!("cannot replay {}", path.display()))?;
    tracing::info!(
        frames = replay.len(),
        damaged = replay.damaged(),
        "recording read"
    );
    Ok(replay)
}

/// An error with its causes, in one line.
fn chain(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(error.source(), |cause| cause.source());
    causes.fold(error.to_string(), |text, cause| format!("{text}: {cause}"))
}
