//! The loop around [`Companion::step`]: what `companion run` does.
//!
//! One queue brings everything that happens, each with its stamp; the loop adds a tick every few milliseconds and does
//! what the step says. A full queue makes the pipeline wait and the links drop (see [`crate::net`]).

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::link::LinkError;
use sensors::SourceError;

use crate::clock::{Clock, since_1970};
use crate::config::Settings;
use crate::event::{Action, Event, Severity};
use crate::figures::Figures;
use crate::net::Links;
use crate::output::OutputError;
use crate::pipeline::detecting::{DetectorError, Lookout};
use crate::pipeline::{self, Ending, Pipeline, Plan};
use crate::report::Report;
use crate::step::Companion;

/// Time between ticks: how finely map symbols are spread over time.
const TICK: Duration = Duration::from_millis(5);

/// Events that may wait: a third of a second of the busiest links.
const EVENTS_WAITING: usize = 1024;

/// Why the service could not start or did not end well.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The source cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The detector cannot be used.
    #[error("the detector cannot be used: correct [detector]")]
    Detector(#[from] DetectorError),
    /// A link cannot be opened.
    #[error(
        "cannot open the links: is another companion running, or another program on this port?"
    )]
    Link(#[source] LinkError),
    /// A link leads nowhere, or has no key.
    #[error(transparent)]
    Nowhere(LinkError),
    /// The system gives no thread.
    #[error("cannot start a thread")]
    Thread(#[from] std::io::Error),
    /// The report cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The source failed in flight; the map was served to the end all the same.
    #[error("the source failed: {0}")]
    SourceFailed(String),
}

impl From<LinkError> for RunError {
    fn from(error: LinkError) -> Self {
        match error {
            LinkError::Open { .. } => Self::Link(error),
            LinkError::Uri { .. }
            | LinkError::Key(_)
            | LinkError::Resolve { .. }
            | LinkError::Send { .. } => Self::Nowhere(error),
        }
    }
}

/// The queue of everything that happens.
pub struct Events {
    sender: SyncSender<(Stamp, Event)>,
    receiver: Receiver<(Stamp, Event)>,
}

impl Default for Events {
    fn default() -> Self {
        let (sender, receiver) = sync_channel(EVENTS_WAITING);
        Self { sender, receiver }
    }
}

impl Events {
    /// For those to whom things happen.
    pub fn sender(&self) -> SyncSender<(Stamp, Event)> {
        self.sender.clone()
    }
}

/// Runs until [`Event::Stop`]. After the source has ended the map is still served.
pub fn run(settings: &Settings, clock: Clock, events: Events) -> Result<(), RunError> {
    let lookout = Lookout::open(settings.detector.as_ref())?;
    let source = pipeline::open_source(&settings.source)?;
    let figures = Figures::new(source.name(), source.frame_count(), &settings.mapping);
    let links = Links::open(settings, clock, &events.sender)?;
    let plan = Plan {
        mapping: settings.mapping,
        lookout,
        pace: settings.source.pace,
        out: settings.out.clone(),
    };
    tracing::info!(address = %settings.address, source = source.name(), "companion started");
    // Two starts share it only if they are a multiple of 18.2 hours apart, to the second.
    let session = since_1970().as_secs() as u16;
    let pipeline = Pipeline::start(source, plan, clock, events.sender.clone())?;
    let mut service = Service {
        companion: Companion::new(settings, figures, session),
        links,
        pipeline,
        settings,
        exit: false,
        output: Ok(()),
    };
    service.serve(clock, &events.receiver);
    // Threads that still wait to deliver something end when nobody listens.
    drop(events);
    let dropped = service.links.dropped();
    if dropped > 0 {
        tracing::warn!(dropped, "frames were dropped: the program did not keep up");
    }
    service.output?;
    match service.companion.ending() {
        Some(Ending::Failed(error)) => Err(RunError::SourceFailed(error.clone())),
        Some(Ending::Finished | Ending::Stopped) | None => Ok(()),
    }
}

struct Service<'a> {
    companion: Companion,
    links: Links,
    pipeline: Pipeline,
    settings: &'a Settings,
    exit: bool,
    /// The first failure to write the report.
    output: Result<(), OutputError>,
}

impl Service<'_> {
    fn serve(&mut self, clock: Clock, events: &Receiver<(Stamp, Event)>) {
        let mut next_tick = clock.now();
        while !self.exit {
            let now = clock.now();
            // Copies of commands have times of their own.
            next_tick = (self.companion.copies_due()).map_or(next_tick, |due| due.min(next_tick));
            if now >= next_tick {
                next_tick = now + TICK;
                self.step(now, Event::Tick);
            }
            match events.recv_timeout(next_tick.since(clock.now())) {
                Ok((at, event)) => self.step(at, event),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    fn step(&mut self, at: Stamp, event: Event) {
        let Self {
            companion,
            links,
            pipeline,
            ..
        } = self;
        let mut report = None;
        companion.step(at, event, |action| match action {
            Action::Send(link, frame) => links.send(link, &frame),
            Action::Log(severity, text) => log(severity, &text),
            Action::WriteReport(figures) => report = Some(figures),
            Action::StopSource => pipeline.stop(),
            Action::Exit => self.exit = true,
        });
        if let Some(report) = report {
            self.write(&report);
        }
    }

    fn write(&mut self, report: &Report) {
        let written = report.write(&self.settings.out);
        if self.output.is_ok() {
            self.output = written;
        }
    }
}

fn log(severity: Severity, text: &str) {
    match severity {
        Severity::Error => tracing::error!("{text}"),
        Severity::Warning => tracing::warn!("{text}"),
        Severity::Info => tracing::info!("{text}"),
    }
}
