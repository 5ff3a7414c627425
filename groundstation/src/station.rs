//! The ground station's mind: events in, actions out, nothing else.
//!
//! ```text
//! (now, Event) ─► step ─► model changed, Actions
//! ```
//!
//! Flight, replay and test feed the same `step`; only the source of the events differs. In a replay nothing is ever sent.

mod alerts;
mod companions;
mod orders;
mod planning;
mod telemetry;
mod transfers;

use std::collections::BTreeMap;
use std::time::Duration;

use maps::tile::TileId;
use maps::time::Stamp;
use mavlink_ext::dialect::tandem::{HEARTBEAT_DATA, MavAutopilot, MavModeFlag, MavState, MavType};
use mavlink_ext::link::LinkStats;
use mavlink_ext::object::digest::Asker;
use mavlink_ext::object::{Receiver, ReceiverLimits};
use mavlink_ext::repeat::Duplicates;
use mavlink_ext::statustext::Listener;
use mavlink_ext::{Address, ComponentId, Encoder, Message, RawFrame, SystemId};

use crate::command::Command;
use crate::model::log::{LogLine, Severity};
use crate::model::{LinkState, Model, Source};
use crate::plan::{Job, Outcome};

/// Everybody hears of this station this often.
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
/// Received bytes per second are an average over about this time.
const RATE_OVER_S: f64 = 2.0;

/// What has gone over a link so far.
pub type LinkFigures = Option<(LinkStats, Option<String>)>;

/// Everything that can happen to the station.
#[derive(Debug)]
pub enum Event {
    /// A frame came in.
    Frame {
        /// On which link.
        link: usize,
        /// What.
        frame: RawFrame,
    },
    /// The operator wants something.
    Command(Command),
    /// A link was opened, or could not be.
    Opened {
        /// As asked for.
        uri: String,
        /// Why it could not be.
        error: Option<String>,
    },
    /// What has gone over each link.
    Links(Vec<LinkFigures>),
    /// The planner is done.
    Planned(Outcome),
    /// What is sent and received cannot be written down any more.
    RecordingStopped,
    /// The planner has enough to do and gives this back.
    PlannerBusy(Job),
    /// Time has passed.
    Tick,
}

/// Everything the station can do to the world.
#[derive(Debug)]
pub enum Action {
    /// Send a frame.
    Send {
        /// On this link, or on all.
        link: Option<usize>,
        /// What.
        frame: RawFrame,
    },
    /// These commands are not wanted any more at this vehicle: no copy of them is to be sent.
    Forget {
        /// Which vehicle's autopilot.
        vehicle: Address,
        /// Their numbers.
        commands: Vec<u16>,
    },
    /// Open a link.
    Open(String),
    /// Let the planner work.
    Plan(Job),
}

/// The model and the conversations that go on.
pub struct Station {
    model: Model,
    own: Address,
    encoder: Encoder,
    /// Recognises what came over two links, and copies.
    duplicates: Duplicates,
    texts: Listener,
    heartbeat_at: Option<Stamp>,
    rates_at: Stamp,
    conversations: orders::Conversations,
    /// Commands that a newer one has made void, by vehicle.
    void: Vec<(Address, Vec<u16>)>,
    transfers: BTreeMap<SystemId, transfers::Conversation>,
    receiver: Receiver,
    /// Asks companions for what the map lacks.
    asker: Asker,
    asked_at: BTreeMap<SystemId, Stamp>,
    path_number: u64,
    /// The number of each vehicle's newest path: older outcomes are thrown away.
    newest_path: BTreeMap<SystemId, u64>,
}

/// Where a message comes from, and when it came.
#[derive(Clone, Copy, Debug)]
struct Heard {
    at: Stamp,
    link: usize,
    from: Address,
}

/// What a part of the station wants sent, and to whom.
type Outbox = Vec<Message>;

impl Station {
    /// A station that knows `model`.
    pub fn new(model: Model) -> Self {
        let own = model.config.address();
        // Another one at every start: senders then know that what they sent before is lost.
        let session = (model.epoch_unix_us / 1000) as u32;
        Self {
            model,
            own,
            encoder: Encoder::new(own),
            duplicates: Duplicates::new(),
            texts: Listener::new(),
            heartbeat_at: None,
            rates_at: Stamp::ZERO,
            conversations: orders::Conversations::default(),
            void: Vec::new(),
            transfers: BTreeMap::new(),
            receiver: Receiver::new(own, session, ReceiverLimits::default()),
            asker: Asker::new(own, session),
            asked_at: BTreeMap::new(),
            path_number: 0,
            newest_path: BTreeMap::new(),
        }
    }

    /// Everything it knows.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Forgets everything but its configuration, as at the start of a replay.
    pub fn restart(&mut self) {
        let config = self.model.config.clone();
        *self = Self::new(Model::new(
            config,
            self.model.source,
            self.model.epoch_unix_us,
        ));
    }

    /// Tiles that have changed since the last call.
    pub fn take_changed_tiles(&mut self) -> Vec<TileId> {
        self.model
            .map
            .voxels
            .as_mut()
            .map_or_else(Vec::new, maps::voxel::VoxelMap::take_changed_tiles)
    }

    /// What to do about `event`, which happened at `now`.
    pub fn step(&mut self, now: Stamp, event: Event, act: &mut impl FnMut(Action)) {
        // Frames were stamped by their links' threads: one may be a little older than the last tick.
        self.model.now = self.model.now.max(now);
        let mut outbox = Outbox::new();
        match event {
            Event::Frame { link, frame } => self.receive(now, link, &frame, &mut outbox),
            Event::Command(command) => self.command(command, &mut outbox, act),
            Event::Opened { uri, error } => self.opened(uri, error),
            Event::Links(figures) => self.count(&figures),
            Event::Planned(outcome) => self.planned(outcome),
            Event::PlannerBusy(job) => self.planner_busy(&job),
            Event::RecordingStopped => self.say(
                Severity::Error,
                "nothing is recorded any more: is the disk full?".to_owned(),
            ),
            Event::Tick => self.tick(&mut outbox),
        }
        if self.model.source == Source::Replay {
            return;
        }
        for (vehicle, commands) in self.void.drain(..) {
            act(Action::Forget { vehicle, commands });
        }
        for message in outbox {
            let frame = self.encoder.encode(&message);
            let link = frame
                .target()
                .and_then(|target| self.link_to(target.system));
            act(Action::Send { link, frame });
        }
    }

    /// The link on which a vehicle was heard last.
    fn link_to(&self, system: SystemId) -> Option<usize> {
        let vehicle = self.model.vehicles.get(&system)?;
        vehicle
            .link_ages(self.model.now)
            .min_by_key(|(_, age)| *age)
            .map(|(link, _)| link)
    }

    fn receive(&mut self, now: Stamp, link: usize, frame: &RawFrame, outbox: &mut Outbox) {
        if let Some(state) = self.model.links.get_mut(link) {
            state.heard_at = Some(now);
        }
        let from = frame.from();
        // Our own frames come back in a recording, or through a router.
        if from == self.own {
            return;
        }
        if !self.duplicates.is_new(now, frame) {
            return;
        }
        // A message with a value that this program does not know is none of its business.
        let Ok(message) = frame.decode() else { return };
        if from.component == ComponentId::AUTOPILOT {
            self.hear_autopilot(
                Heard {
                    at: now,
                    link,
                    from,
                },
                &message,
                outbox,
            );
        }
        self.hear_companion(now, from, &message, outbox);
        if self.model.source == Source::Live {
            self.hear_answers(now, from, &message, outbox);
        }
    }

    fn command(&mut self, command: Command, outbox: &mut Outbox, act: &mut impl FnMut(Action)) {
        if self.model.source == Source::Replay && !command.suits_a_replay() {
            self.say(
                Severity::Warning,
                "a recording cannot be commanded".to_owned(),
            );
            return;
        }
        match command {
            Command::Connect(uri) => act(Action::Open(uri)),
            Command::Select(id) => {
                if self.model.vehicles.contains_key(&id) {
                    self.model.active = Some(id);
                }
            }
            Command::Order(id, order) => self.order(id, order, outbox),
            Command::PlanPath {
                vehicle,
                x_m,
                y_m,
                heading_deg,
            } => {
                self.plan_path(vehicle, [x_m, y_m], heading_deg, act);
            }
            Command::PlanSurvey { vehicle, area } => self.plan_survey(vehicle, area),
            Command::DiscardPlan(id) => {
                if self
                    .model
                    .missions
                    .get(&id)
                    .is_some_and(|mission| !mission.is_transferring())
                {
                    self.model.missions.remove(&id);
                }
            }
            Command::Upload(id) => self.upload(id, outbox),
            Command::Acknowledge(id) => self.model.alerts.acknowledge(id),
        }
    }

    fn tick(&mut self, outbox: &mut Outbox) {
        let now = self.model.now;
        if self
            .heartbeat_at
            .is_none_or(|at| now.since(at) >= HEARTBEAT_EVERY)
        {
            self.heartbeat_at = Some(now);
            outbox.push(heartbeat());
        }
        self.ask_for_telemetry(outbox);
        self.tick_orders(outbox);
        self.tick_transfers(outbox);
        self.tick_companions(outbox);
        for text in self.texts.tick(now) {
            self.hear_text(now, &text);
        }
        self.model.map.tick(now);
        self.judge();
    }

    fn opened(&mut self, uri: String, error: Option<String>) {
        let (severity, text) = match &error {
            None => (Severity::Notice, format!("link {uri} is open")),
            Some(error) => (Severity::Error, error.clone()),
        };
        self.say(severity, text);
        self.model.links.push(LinkState {
            uri,
            error,
            bytes_received: 0,
            bytes_sent: 0,
            bad_frames: 0,
            heard_at: None,
            receive_rate_bps: 0.0,
        });
    }

    fn count(&mut self, figures: &[LinkFigures]) {
        let passed_s = self.model.now.since(self.rates_at).as_secs_f64();
        self.rates_at = self.model.now;
        let share = 1.0 - (-passed_s / RATE_OVER_S).exp();
        for (link, figures) in self.model.links.iter_mut().zip(figures) {
            let Some((figures, problem)) = figures else {
                continue; // it could not be opened, which it says
            };
            link.error.clone_from(problem);
            let received = figures.bytes_received.saturating_sub(link.bytes_received);
            if passed_s > 0.0 {
                link.receive_rate_bps +=
                    share * (received as f64 / passed_s - link.receive_rate_bps);
            }
            link.bytes_received = figures.bytes_received;
            link.bytes_sent = figures.bytes_sent;
            link.bad_frames = figures.bad_frames;
        }
    }

    /// Puts a line of this station's own into the log.
    fn say(&mut self, severity: Severity, text: String) {
        self.model.log.push(LogLine {
            at: self.model.now,
            from: None,
            severity,
            text,
        });
    }
}

fn heartbeat() -> Message {
    Message::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

#[cfg(test)]
mod tests;
