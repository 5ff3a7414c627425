//! One run: links, recorder and vehicles around the pure [`Simulation`].
//!
//! Without links the scene's own vehicles are recorded, as fast as the machine can draw. With links, vehicles go where
//! their autopilots take them, in real time; their sensors go along, and what they see is drawn as soon as it can be:
//! the recording of a run is late, never incomplete.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use anyhow::{Context as _, bail};
use maps::time::Stamp;
use mavlink_ext::RawFrame;
use mavlink_ext::link::Link;

use crate::link::{Channel, Profile};
use crate::platform::Platform;
use crate::record::{Follow, Heard};
use crate::report::Report;
use crate::rig::Setup;
use crate::scene::Scene;
use crate::sensor::child_seed;
use crate::simulation::{Event, STEP, Simulation, Start, copter, rover};
use crate::way::Way;
use recorder::Recorder;

mod recorder;

/// Frames of links that may wait to be recorded: about half an hour of two vehicles.
const BEHIND: usize = 1 << 18;

/// Frames and ticks that may wait. A tick that finds no room waits, a frame is lost as in the air.
pub const QUEUE: usize = 1024;

/// What to run.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The scene, its seed and place on Earth, and the sensors in it.
    pub setup: Setup,
    /// Where to record what sensors see.
    pub record: Option<PathBuf>,
    /// Where to publish what sensors see, as [`crate::live::Live::open`] takes it.
    pub zenoh: Option<String>,
    /// How long to run; without it until it is stopped.
    pub duration: Option<Duration>,
    /// Link of the copter's autopilot.
    pub copter: Option<String>,
    /// Link of the rover's autopilot.
    pub rover: Option<String>,
    /// Where the rover starts; where the scene has its ground vehicle, if none.
    pub rover_start: Option<Start>,
    /// What happens to frames between the autopilots and their links.
    pub link: Profile,
    /// Where to write the report.
    pub report: Option<PathBuf>,
}

impl Settings {
    /// Whether there is nothing to do.
    pub fn is_idle(&self) -> bool {
        !self.has_links() && !self.has_sensors()
    }

    /// Whether anybody is told what sensors see.
    fn has_sensors(&self) -> bool {
        self.record.is_some() || self.zenoh.is_some()
    }

    /// Whether vehicles move as their autopilots have them.
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
    mut watch: impl FnMut(&Simulation),
) -> anyhow::Result<Report> {
    check(settings)?;
    let mut party = Party::open(settings, inbox, &clock)?;
    let follow = settings.has_links().then(|| party.follow());
    let recorder = settings
        .has_sensors()
        .then(|| Recorder::start(settings, follow, inbox, clock.clone()))
        .transpose()?;
    if recorder.is_none() {
        party.forget();
    }
    let end = settings
        .duration
        .filter(|_| settings.has_links())
        .map(|duration| Stamp::ZERO + duration);
    while let Ok(event) = events.recv() {
        if matches!(event, Event::Stop) || end.is_some_and(|end| party.simulation.now() >= end) {
            break;
        }
        party.attend(&event, clock());
        watch(&party.simulation);
    }
    party.end();
    let recording = recorder
        .map(|mut recorder| {
            if settings.has_links() {
                recorder.catch_up(events);
            } else {
                recorder.stop();
            }
            recorder.finish()
        })
        .transpose()?;
    let setup = &settings.setup;
    let report = Report::new(
        &setup.scene.to_string(),
        setup.seed,
        &party.simulation,
        recording,
    );
    if let Some(path) = &settings.report {
        let file = File::create(path)
            .with_context(|| format!("cannot write the report to {}", path.display()))?;
        serde_json::to_writer_pretty(BufWriter::new(file), &report)?;
    }
    Ok(report)
}

fn check(settings: &Settings) -> anyhow::Result<()> {
    if settings.is_idle() {
        bail!("nothing to do: give --copter URI, --rover URI, --record FILE or --zenoh ENDPOINT");
    }
    for file in settings.record.iter().chain(&settings.report) {
        let folder = file.parent().unwrap_or(Path::new(""));
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    Ok(())
}

/// A vehicle's connection: its link, what the air does to it, and where the vehicle goes.
struct Station {
    name: &'static str,
    platform: Platform,
    link: Link,
    up: Channel<RawFrame>,
    down: Channel<RawFrame>,
    way: Arc<Way>,
}

/// The vehicles with their links.
struct Party {
    simulation: Simulation,
    /// In the order of the simulation's vehicles.
    stations: Vec<Station>,
    /// To the recorder, if there is one.
    heard: Option<SyncSender<Heard>>,
    /// Frames that the recorder is too far behind to take.
    unrecorded: u64,
}

impl Party {
    fn open(
        settings: &Settings,
        inbox: &SyncSender<Event>,
        clock: &(impl Fn() -> Stamp + Clone + Send + 'static),
    ) -> anyhow::Result<Self> {
        let Setup { origin, seed, .. } = &settings.setup;
        let mut autopilots = Vec::new();
        let mut stations = Vec::new();
        for (name, platform, uri) in [
            ("copter", Platform::Uav, &settings.copter),
            ("rover", Platform::Ugv, &settings.rover),
        ] {
            let Some(uri) = uri else { continue };
            let autopilot = match platform {
                Platform::Uav => copter(origin, beside_rover(settings), *seed),
                Platform::Ugv => rover(origin, rover_start(settings), *seed),
            };
            let deliver = deliver(inbox.clone(), stations.len(), clock.clone());
            let channel = |direction| {
                let seed = child_seed(*seed, &format!("{name}/{direction}"));
                Channel::new(settings.link.clone(), seed)
            };
            stations.push(Station {
                name,
                platform,
                link: Link::open(uri, deliver)?,
                up: channel("up"),
                down: channel("down"),
                way: Arc::new(Way::new(STEP, autopilot.truth().world_from_body)),
            });
            tracing::info!(address = %autopilot.address(), uri, "autopilot is up");
            autopilots.push(autopilot);
        }
        Ok(Self {
            simulation: Simulation::new(autopilots),
            stations,
            heard: None,
            unrecorded: 0,
        })
    }

    /// What a recorder needs to go along.
    fn follow(&mut self) -> Follow {
        let (heard, frames) = sync_channel(BEHIND);
        self.heard = Some(heard);
        let ways = self.stations.iter();
        Follow {
            ways: ways.map(|s| (s.platform, Arc::clone(&s.way))).collect(),
            frames,
        }
    }

    /// Nobody records.
    fn forget(&mut self) {
        self.heard = None;
    }

    /// One event, and what it has to do with the air.
    fn attend(&mut self, event: &Event, now: Stamp) {
        if let Event::Frame { vehicle, frame, .. } = event {
            let bytes = frame.bytes().len();
            self.stations[*vehicle].up.send(now, frame.clone(), bytes);
        } else {
            let frames = self.simulation.step(event);
            self.send(frames, now);
        }
        if matches!(event, Event::Tick) {
            for (station, vehicle) in self.stations.iter().zip(self.simulation.vehicles()) {
                station.way.push(vehicle.truth().world_from_body);
            }
        }
        for vehicle in 0..self.stations.len() {
            for frame in self.stations[vehicle].up.arrived(now) {
                self.record(vehicle, false, &frame);
                let event = Event::Frame {
                    vehicle,
                    at: now,
                    frame,
                };
                let answers = self.simulation.step(&event);
                self.send(answers, now);
            }
        }
        for station in &mut self.stations {
            for frame in station.down.arrived(now) {
                if let Err(error) = station.link.send(&frame) {
                    tracing::warn!(%error, vehicle = station.name, "a frame is lost");
                }
            }
        }
    }

    fn send(&mut self, frames: Vec<(usize, RawFrame)>, now: Stamp) {
        for (vehicle, frame) in frames {
            self.record(vehicle, true, &frame);
            let bytes = frame.bytes().len();
            self.stations[vehicle].down.send(now, frame, bytes);
        }
    }

    fn record(&mut self, vehicle: usize, is_sent: bool, frame: &RawFrame) {
        let Some(recorder) = &self.heard else { return };
        let heard = Heard {
            at: self.simulation.now(),
            vehicle: self.stations[vehicle].name,
            is_sent,
            frame: frame.clone(),
        };
        match recorder.try_send(heard) {
            Ok(()) => {}
            // It says why at the end.
            Err(TrySendError::Disconnected(_)) => self.heard = None,
            Err(TrySendError::Full(_)) => {
                if self.unrecorded == 0 {
                    tracing::warn!(
                        "the recording is half an hour behind: frames of links are left out of it; leave sensors out with --aboard"
                    );
                }
                self.unrecorded += 1;
            }
        }
    }

    fn end(&mut self) {
        self.heard = None;
        if self.unrecorded > 0 {
            tracing::warn!(frames = self.unrecorded, "left out of the recording");
        }
        for station in &self.stations {
            station.way.end();
        }
    }
}

/// Where the rover starts.
fn rover_start(settings: &Settings) -> Start {
    settings.rover_start.unwrap_or_else(|| {
        let scene = Scene::generate(settings.setup.scene, settings.setup.seed);
        Start::of(crate::platform::ugv(&scene, Stamp::ZERO))
    })
}

/// Where the copter starts in a street: on the roadway beside the rover.
fn beside_rover(settings: &Settings) -> Option<Start> {
    (settings.setup.scene != crate::scene::Name::Room).then(|| {
        let rover = rover_start(settings);
        let left = rover.heading_deg.to_radians();
        Start {
            x_m: rover.x_m - 1.2 * left.cos(),
            y_m: rover.y_m + 1.2 * left.sin(),
            ..rover
        }
    })
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
