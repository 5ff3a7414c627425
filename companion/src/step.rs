//! What the companion does about everything that happens: one function, no thread, no socket, no clock.
//!
//! Frames between the links are forwarded as they are. What is for us goes through the services of `mavlink_ext`; map
//! tiles go through its object transport to the ground station. Tandem's own messages go to the ground link only: a
//! flight controller would drop them.

mod commands;
mod map_link;
mod status;

use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::convert::odometry_message;
use mavlink_ext::dialect::tandem::MavSeverity;
use mavlink_ext::dialect::{MessageExt as _, TANDEM_IDS, cmd};
use mavlink_ext::link::LinkUri;
use mavlink_ext::presence::{Presence, PresenceEvent, companion_heartbeat};
use mavlink_ext::repeat::{Loss, Reception, Repeater};
use mavlink_ext::router::{LinkId as RouteId, LinkKind, Router};
use mavlink_ext::service::Ends;
use mavlink_ext::statustext::Speaker;
use mavlink_ext::timesync::Timesync;
use mavlink_ext::{Address, ComponentId, Encoder, Message, RawFrame, command};
use slam::State;

use crate::config::Settings;
use crate::event::{Action, Event, LinkId, Severity};
use crate::figures::{Figures, WireFigures};
use crate::odometry::{RateLimit, VehicleOdometry};
use crate::origin::{Origin, Wish};
use crate::pipeline::{Ending, FrameDone, SourceEnded};
use map_link::MapLink;
use status::Status;

/// The autopilot gets odometry at most so often: more is not fused.
const ODOMETRY_TO_AUTOPILOT: Duration = Duration::from_nanos(33_333_333);

/// The operator's picture needs less.
const ODOMETRY_TO_GROUND: Duration = Duration::from_millis(200);

/// A companion without an origin says so after this time.
const ORIGIN_PATIENCE: Duration = Duration::from_secs(15);

/// The on-board service.
pub struct Companion {
    own: Address,
    autopilot: Address,
    outbox: Outbox,
    router: Router,
    /// How the ground link is, and the copies of commands that it gets.
    reception: Reception,
    ground_loss: Loss,
    /// Whether the last frame from there was a copy.
    ground_copied: bool,
    repeater: Repeater,
    /// What signing adds to each frame there, and the bytes that left beside those of the map's objects since the last tick.
    ground_signature_bytes: u64,
    beside_map_bytes: u64,
    speaker: Speaker,
    presence: Presence,
    timesync: Timesync,
    commands: command::Client,
    map_link: MapLink,
    origin: Origin,
    origin_missed: bool,
    odometry: VehicleOdometry,
    to_autopilot: RateLimit,
    to_ground: RateLimit,
    tracking: Option<State>,
    status: Status,
    figures: Figures,
    stopping: bool,
}

/// What leaves: frames of ours, numbered for each link.
struct Outbox {
    autopilot: Encoder,
    ground: Encoder,
    /// Bytes of frames with Tandem's own messages.
    tandem_bytes: u64,
}

impl Outbox {
    fn new(own: Address) -> Self {
        Self {
            autopilot: Encoder::new(own),
            ground: Encoder::new(own),
            tandem_bytes: 0,
        }
    }

    /// Sends a message of ours to one link. Tandem's own messages never go to the autopilot.
    fn send(&mut self, link: LinkId, message: &Message, act: &mut dyn FnMut(Action)) {
        let ours = TANDEM_IDS.contains(&message.message_id());
        let frame: RawFrame = match link {
            LinkId::Autopilot if ours => return,
            LinkId::Autopilot => self.autopilot.encode(message),
            LinkId::Ground => self.ground.encode(message),
        };
        if ours {
            self.tandem_bytes += frame.bytes().len() as u64;
        }
        act(Action::Send(link, frame));
    }

    fn broadcast(&mut self, message: &Message, act: &mut dyn FnMut(Action)) {
        for link in LinkId::ALL {
            self.send(link, message, act);
        }
    }
}

impl Companion {
    /// A companion that has done nothing yet. `figures` knows the recording; `session` should differ from that of the
    /// last start, so that a ground station sees the restart.
    pub fn new(settings: &Settings, figures: Figures, session: u16) -> Self {
        let own = settings.address;
        let autopilot = Address {
            component: ComponentId::AUTOPILOT,
            ..own
        };
        Self {
            own,
            autopilot,
            outbox: Outbox::new(own),
            router: router(settings),
            reception: Reception::new(),
            ground_loss: Loss::default(),
            ground_copied: false,
            repeater: Repeater::new(),
            ground_signature_bytes: settings.ground.as_ref().map_or(0, LinkUri::signature_bytes),
            beside_map_bytes: 0,
            speaker: Speaker::new(),
            presence: Presence::new(own, companion_heartbeat()),
            timesync: Timesync::new(Ends {
                own,
                peer: autopilot,
            }),
            commands: command::Client::new(own),
            map_link: MapLink::new(own, session, settings.ground_bytes_per_s),
            origin: Origin::new(settings.origin),
            origin_missed: false,
            odometry: VehicleOdometry::new(settings.body_from_camera),
            to_autopilot: RateLimit::new(ODOMETRY_TO_AUTOPILOT),
            to_ground: RateLimit::new(ODOMETRY_TO_GROUND),
            tracking: None,
            status: Status::default(),
            figures,
            stopping: false,
        }
    }

    /// How the source ended, if it has.
    pub fn ending(&self) -> Option<&Ending> {
        self.figures.ended().map(|ended| &ended.ending)
    }

    /// When a copy of a command or of its answer is to go out, with the tick at that time.
    pub fn copies_due(&self) -> Option<Stamp> {
        self.repeater.due()
    }

    /// What to do about `event`, which happened at `now`.
    pub fn step(&mut self, now: Stamp, event: Event, mut act: impl FnMut(Action)) {
        if matches!(event, Event::Tick) {
            let beside = std::mem::take(&mut self.beside_map_bytes);
            self.map_link.ground_link_has_sent(beside);
        }
        let signature_bytes = self.ground_signature_bytes;
        let mut sent_bytes = 0;
        let mut act = |action| {
            if let Action::Send(LinkId::Ground, frame) = &action {
                sent_bytes += frame.bytes().len() as u64 + signature_bytes;
            }
            act(action);
        };
        for copy in self.repeater.tick(now) {
            act(Action::Send(LinkId::Ground, copy));
        }
        let from_ground = match &event {
            Event::Received(LinkId::Ground, frame) => Some(frame.clone()),
            _ => None,
        };
        let mut repeater = std::mem::take(&mut self.repeater);
        let act: &mut dyn FnMut(Action) = &mut |action| {
            if let Action::Send(LinkId::Ground, frame) = &action {
                repeater.sent(now, frame);
            }
            act(action);
        };
        self.react(now, event, act);
        repeater.set_loss(self.ground_loss);
        if let Some(frame) = from_ground {
            repeater.heard(now, &frame, self.ground_copied);
        }
        self.repeater = repeater;
        self.beside_map_bytes += sent_bytes.saturating_sub(self.map_link.take_object_bytes());
    }

    fn react(&mut self, now: Stamp, event: Event, act: &mut dyn FnMut(Action)) {
        match event {
            Event::Received(link, frame) => self.receive(now, link, &frame, act),
            Event::FrameDone(done) => self.frame_done(now, &done, act),
            Event::TilesChanged(changed) => {
                self.figures.set_map(changed.map);
                self.map_link.offer(now, changed.tiles);
            }
            Event::SourceEnded(ended) => self.source_ended(now, &ended, act),
            Event::Tick => self.tick(now, act),
            Event::Stop => {
                self.stopping = true;
                match self.figures.ended() {
                    None => act(Action::StopSource),
                    Some(_) => self.exit(now, act),
                }
            }
        }
    }

    fn receive(&mut self, now: Stamp, link: LinkId, frame: &RawFrame, act: &mut dyn FnMut(Action)) {
        let from = frame.from();
        let route = self.router.route(now, route_of(link), frame);
        for onward in LinkId::ALL {
            if route.forward.contains(&route_of(onward)) {
                act(Action::Send(onward, frame.clone()));
            }
        }
        if link == LinkId::Ground {
            self.ground_copied = route.is_copy;
            self.hear_ground(frame);
        }
        if !route.is_for_us {
            return;
        }
        // What cannot be decoded is none of the messages that concern us.
        let Ok(message) = frame.decode() else {
            return;
        };
        let heard = self.presence.handle(now, from, &message);
        self.tell_presence(&heard.events, act);
        // Only answered: nothing that comes in needs another's clock yet.
        for answer in self.timesync.handle(now, from, &message).send {
            self.outbox.send(link, &answer, act);
        }
        // Its outcome does not matter: what was asked for comes as a message.
        self.commands.handle(now, from, &message);
        if from == self.autopilot && self.origin.hear(&message) {
            self.tell(Severity::Info, "map origin is the autopilot's", act);
        }
        if link == LinkId::Ground {
            self.map_link.handle(now, from, &message);
        }
        if commands::names(self.own, &message)
            && let Some(incoming) = command::Incoming::parse(self.own, from, &message)
        {
            self.obey(now, link, &incoming, act);
        }
    }

    /// A frame came from the ground, perhaps a copy. Who speaks Tandem's dialect drops copies: only then are there any.
    fn hear_ground(&mut self, frame: &RawFrame) {
        self.reception.heard(frame);
        if TANDEM_IDS.contains(&frame.message_id()) {
            self.ground_loss = self.reception.loss().unwrap_or_default();
        }
    }

    fn frame_done(&mut self, now: Stamp, done: &FrameDone, act: &mut dyn FnMut(Action)) {
        self.figures.add_frame(done);
        let Some(tracked) = &done.tracked else { return };
        let before = self.tracking.replace(tracked.state);
        match (before, tracked.state) {
            (Some(State::Tracking), State::Lost { .. }) => {
                self.tell(Severity::Warning, "camera lost its place", act);
            }
            (Some(State::Lost { .. }), State::Tracking) => {
                self.tell(Severity::Info, "camera found its place again", act);
            }
            (None | Some(_), State::Searching | State::Tracking | State::Lost { .. }) => {}
        }
        let Some(odometry) = self.odometry.advance(done.released, tracked) else {
            return;
        };
        let message = Message::ODOMETRY(odometry_message(&odometry));
        if self.to_autopilot.allows(now) {
            self.outbox.send(LinkId::Autopilot, &message, act);
        }
        if self.to_ground.allows(now) {
            self.outbox.send(LinkId::Ground, &message, act);
        }
    }

    fn source_ended(&mut self, now: Stamp, ended: &SourceEnded, act: &mut dyn FnMut(Action)) {
        self.figures.end(ended);
        match &ended.ending {
            Ending::Finished => self.tell(Severity::Info, "recording finished, map complete", act),
            Ending::Stopped => {}
            Ending::Failed(error) => {
                act(Action::Log(Severity::Error, error.clone()));
                self.tell(Severity::Error, "camera source failed, map is kept", act);
            }
        }
        if self.stopping {
            self.exit(now, act);
        } else {
            self.write_report(now, act);
        }
    }

    fn tick(&mut self, now: Stamp, act: &mut dyn FnMut(Action)) {
        let presence = self.presence.tick(now);
        for message in &presence.send {
            self.outbox.broadcast(message, act);
        }
        self.tell_presence(&presence.events, act);
        for message in self.commands.tick(now).send {
            self.outbox.send(LinkId::Autopilot, &message, act);
        }
        self.ask_for_origin(now, act);
        for message in self.map_link.tick(now) {
            self.outbox.send(LinkId::Ground, &message, act);
        }
        if self.status.is_due(now) {
            self.status
                .begin(now, self.figures.frames(), self.outbox.tandem_bytes);
            let status = Some(self.status_message(now));
            for message in status.into_iter().chain(self.origin.message()) {
                self.outbox.send(LinkId::Ground, &message, act);
            }
        }
    }

    fn ask_for_origin(&mut self, now: Stamp, act: &mut dyn FnMut(Action)) {
        if self.origin.known().is_some() {
            return;
        }
        if !self.origin_missed && now.since(Stamp::ZERO) > ORIGIN_PATIENCE {
            self.origin_missed = true;
            self.tell(Severity::Warning, "no map origin: set it or get a fix", act);
        }
        if !self.presence.is_alive(self.autopilot) {
            return;
        }
        match self.origin.tick(now) {
            None => {}
            Some(Wish::HeightIsAboveSeaLevel) => {
                self.tell(Severity::Warning, "map origin is above mean sea level", act);
            }
            Some(Wish::Message(id)) => self.ask_autopilot(now, id, act),
        }
    }

    fn ask_autopilot(&mut self, now: Stamp, message_id: u32, act: &mut dyn FnMut(Action)) {
        // Ids have 24 bits: a single keeps them exactly.
        let request = command::Request::long(cmd::REQUEST_MESSAGE, &[message_id as f32]);
        // Already under way: it repeats itself.
        if let Ok(message) = self.commands.start(now, self.autopilot, request) {
            self.outbox.send(LinkId::Autopilot, &message, act);
        }
    }

    fn tell_presence(&mut self, events: &[PresenceEvent], act: &mut dyn FnMut(Action)) {
        for event in events {
            match *event {
                PresenceEvent::Lost(peer) if peer == self.autopilot => {
                    self.tell(Severity::Warning, "autopilot is silent", act);
                }
                PresenceEvent::Appeared(peer) if peer == self.autopilot => {
                    self.tell(Severity::Info, "autopilot heard", act);
                }
                PresenceEvent::Appeared(peer) => {
                    act(Action::Log(Severity::Info, format!("{peer} heard")));
                }
                PresenceEvent::Lost(peer) => {
                    act(Action::Log(Severity::Warning, format!("{peer} is silent")));
                }
            }
        }
    }

    /// Tells the operator, and the log.
    fn tell(&mut self, severity: Severity, text: &'static str, act: &mut dyn FnMut(Action)) {
        let level = match severity {
            Severity::Error => MavSeverity::MAV_SEVERITY_ERROR,
            Severity::Warning => MavSeverity::MAV_SEVERITY_WARNING,
            Severity::Info => MavSeverity::MAV_SEVERITY_INFO,
        };
        for message in self.speaker.say(level, &format!("companion: {text}")) {
            self.outbox.send(LinkId::Ground, &message, act);
        }
        act(Action::Log(severity, text.to_owned()));
    }

    fn write_report(&mut self, now: Stamp, act: &mut dyn FnMut(Action)) {
        self.figures.wire = WireFigures {
            tiles_sent: self.map_link.sent(now),
            tiles_delivered: self.map_link.delivered(now),
            bytes: self.outbox.tandem_bytes,
        };
        act(Action::WriteReport(Box::new(self.figures.report(now))));
    }

    fn exit(&mut self, now: Stamp, act: &mut dyn FnMut(Action)) {
        self.write_report(now, act);
        act(Action::Exit);
    }
}

/// The router's name for a link.
fn route_of(link: LinkId) -> RouteId {
    match link {
        LinkId::Autopilot => RouteId(0),
        LinkId::Ground => RouteId(1),
    }
}

fn router(settings: &Settings) -> Router {
    let mut router = Router::new(settings.address);
    if settings.autopilot.is_some() {
        router.add_link(route_of(LinkId::Autopilot), LinkKind::Autopilot);
    }
    if settings.ground.is_some() {
        router.add_link(route_of(LinkId::Ground), LinkKind::Network);
    }
    router
}

#[cfg(test)]
mod tests;
