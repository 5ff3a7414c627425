//! One run: links, recorder and vehicles around the pure [`Simulation`].

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context as _, bail};
use maps::time::Stamp;
use mavlink_ext::RawFrame;
use mavlink_ext::link::Link;

use crate::flight::LAP;
use crate::record::{self, Plan, Recording};
use crate::report::Report;
use crate::scene::Name;
use crate::simulation::{Event, Simulation, Start, copter, rover};
use crate::wgs84::Origin;

/// Frames and ticks that may wait. A tick that finds no room waits, a frame is lost as in the air.
pub const QUEUE: usize = 1024;

/// What to run.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The scene.
    pub scene: Name,
    /// Seed of everything random.
    pub seed: u64,
    /// Where to record what the drone's camera sees.
    pub record: Option<PathBuf>,
    /// How long to run; without it until it is stopped.
    pub duration: Option<Duration>,
    /// Link of the copter's autopilot.
    pub copter: Option<String>,
    /// Link of the rover's autopilot.
    pub rover: Option<String>,
    /// Where the world is on Earth.
    pub origin: Origin,
    /// Where the rover starts.
    pub rover_start: Start,
    /// Where to write the report.
    pub report: Option<PathBuf>,
}

impl Settings {
    /// Whether anything has to keep step with real time.
    pub fn has_links(&self) -> bool {
        self.copter.is_some() || self.rover.is_some()
    }
}

/// Runs until the end of the duration, of the recording, or until [`Event::Stop`]; writes the report.
///
/// `events` gets a [`Event::Tick`] per step from whoever has the clock, and everything else through `inbox`, its other
/// end. `clock` tells when a frame comes in. `watch` is shown the vehicles after every event.
pub fn run(
    settings: &Settings,
    (inbox, events): (&SyncSender<Event>, &Receiver<Event>),
    clock: impl Fn() -> Stamp + Clone + Send + 'static,
    watch: impl FnMut(&Simulation),
) -> anyhow::Result<Report> {
    check(settings)?;
    let mut autopilots = Vec::new();
    let mut links = Vec::new();
    for (uri, autopilot) in [
        (&settings.copter, copter(&settings.origin, settings.seed)),
        (
            &settings.rover,
            rover(&settings.origin, settings.rover_start, settings.seed),
        ),
    ] {
        if let Some(uri) = uri {
            let deliver = deliver(inbox.clone(), links.len(), clock.clone());
            links.push(Link::open(uri, deliver)?);
            tracing::info!(address = %autopilot.address(), uri, "autopilot is up");
            autopilots.push(autopilot);
        }
    }
    let mut simulation = Simulation::new(autopilots);
    let recorder = settings
        .record
        .as_ref()
        .map(|file| Recorder::start(settings, file, inbox))
        .transpose()?;
    attend(settings, &mut simulation, (events, &links), watch);
    let recording = recorder.map(Recorder::finish).transpose()?;
    if let Some(recording) = recording.as_ref().filter(|recording| recording.stopped) {
        tracing::warn!(
            frames = recording.frames,
            "the run ended before the recording: without --copter and --rover it is as long as --duration says"
        );
    }
    let scene = settings.scene.to_string();
    let report = Report::new(&scene, settings.seed, &simulation, recording);
    if let Some(path) = &settings.report {
        let file = File::create(path)
            .with_context(|| format!("cannot write the report to {}", path.display()))?;
        serde_json::to_writer_pretty(BufWriter::new(file), &report)?;
    }
    Ok(report)
}

fn check(settings: &Settings) -> anyhow::Result<()> {
    if !settings.has_links() && settings.record.is_none() {
        bail!("nothing to do: give --copter URI, --rover URI or --record FILE");
    }
    for file in settings.record.iter().chain(&settings.report) {
        let folder = file.parent().unwrap_or(Path::new(""));
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    Ok(())
}

fn deliver(
    inbox: SyncSender<Event>,
    vehicle: usize,
    clock: impl Fn() -> Stamp + Send + 'static,
) -> impl FnMut(RawFrame) + Send + 'static {
    move |frame| {
        let event = Event::Frame {
            vehicle,
            at: clock(),
            frame,
        };
        if inbox.try_send(event).is_err() {
            tracing::debug!(vehicle, "queue is full, a frame is lost");
        }
    }
}

/// The loop: events in, frames out. Without links it only waits for the recorder.
fn attend(
    settings: &Settings,
    simulation: &mut Simulation,
    (events, links): (&Receiver<Event>, &[Link]),
    mut watch: impl FnMut(&Simulation),
) {
    let end = settings
        .duration
        .filter(|_| settings.has_links())
        .map(|duration| Stamp::ZERO + duration);
    while let Ok(event) = events.recv() {
        if matches!(event, Event::Stop) || end.is_some_and(|end| simulation.now() >= end) {
            return;
        }
        for (vehicle, frame) in simulation.step(&event) {
            if let Err(error) = links[vehicle].send(&frame) {
                tracing::warn!(%error, "a frame is lost");
            }
        }
        watch(simulation);
    }
}

/// A thread that records.
struct Recorder {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<Recording, sensors::mcap::WriteError>>,
}

impl Recorder {
    /// Where there are no links, the end of the recording is the end of the run.
    fn start(
        settings: &Settings,
        file: &std::path::Path,
        inbox: &SyncSender<Event>,
    ) -> anyhow::Result<Self> {
        let plan = Plan {
            scene: settings.scene,
            seed: settings.seed,
            file: file.to_owned(),
            duration: settings.duration.unwrap_or(LAP),
        };
        let at_end = (!settings.has_links()).then(|| inbox.clone());
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let total = record::frames_in(plan.duration);
        let work = move || {
            let recording = record::record(&plan, |frames| {
                if frames % 150 == 0 {
                    tracing::info!(frames, total, "recording");
                }
                !stopped.load(Ordering::Relaxed)
            });
            if let Some(inbox) = at_end {
                // Nobody listens any more only if the run has been stopped already.
                let _already_stopped = inbox.send(Event::Stop);
            }
            recording
        };
        let thread = thread::Builder::new().name("recorder".into()).spawn(work)?;
        Ok(Self { stop, thread })
    }

    fn finish(self) -> anyhow::Result<Recording> {
        self.stop.store(true, Ordering::Relaxed);
        match self.thread.join() {
            Ok(recording) => Ok(recording?),
            Err(_panic) => bail!("the recorder has stopped with a panic"),
        }
    }
}
