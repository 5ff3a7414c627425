//! A UAV and a ground station with a link between them.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::command::{Client, Incoming, Request};
use mavlink_ext::dialect::Message;
use mavlink_ext::dialect::tandem::{GLOBAL_POSITION_INT_DATA, MavResult};
use mavlink_ext::object::{Object, ObjectId, Service, StreamId};
use mavlink_ext::wire::{Address, RawFrame};
use rand::{Rng as _, RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use sitl::link::{Channel, Outage};

use super::{BEV_DEADLINE, Case};
use crate::radio::End;

pub(super) const UAV: Address = Address::new(1, 191);
pub(super) const GROUND: Address = Address::new(255, 190);

/// Simulated time goes on by this.
const STEP: Duration = Duration::from_millis(1);
/// How often both ends let time pass: as often as `companion` does.
const TICK_MS: u64 = 5;
const SETTLING: Duration = Duration::from_secs(5);
pub(super) const SATURATED: Duration = Duration::from_secs(40);
const OUTAGE: Duration = Duration::from_secs(30);
/// Tiles that change during the outage, as a span of the link.
const CHANGED: Duration = Duration::from_secs(5);
/// Longer than this nothing is waited for.
const PATIENCE: Duration = Duration::from_mins(2);
/// So many seconds' worth of tiles wait at any time while the link is saturated.
const BACKLOG: Duration = Duration::from_secs(2);
const COMMAND_EVERY_MS: u64 = 250;
/// Numbers that MAVLink leaves to users (`MAV_CMD_USER_1`), and how many are used in turn.
const FIRST_COMMAND: u16 = 31010;
const COMMANDS: u16 = 100;
const TELEMETRY_EVERY_MS: u64 = 100;

/// A way to bring objects from the UAV to the ground.
pub(super) trait Transport {
    /// Takes an object.
    fn offer(&mut self, now: Stamp, object: Object);
    /// Bytes of objects that are not over yet.
    fn waiting_bytes(&self, now: Stamp) -> usize;
    /// Whether both ends repeat commands on a link that loses, and drop the copies.
    fn repeats_commands(&self) -> bool {
        false
    }
    /// So many bytes more have left the UAV that are not the transport's.
    fn link_has_sent(&mut self, _bytes: u64) {}
    /// What the UAV sends when time passes.
    fn tick_uav(&mut self, now: Stamp) -> Vec<Message>;
    /// What it answers.
    fn at_uav(&mut self, now: Stamp, message: &Message) -> Vec<Message>;
    /// What the ground sends when time passes.
    fn tick_ground(&mut self, now: Stamp) -> Vec<Message>;
    /// What it answers, and the objects that are there now.
    fn at_ground(&mut self, now: Stamp, message: &Message) -> (Vec<Message>, Vec<ObjectId>);
}

/// What was seen while the link was saturated.
#[derive(Debug, Default)]
pub(super) struct Measured {
    pub(super) tiles: u64,
    pub(super) tile_bytes: u64,
    /// Of frames in both directions.
    pub(super) wire_bytes: u64,
    /// Bytes of BEV frames delivered.
    pub(super) bev_bytes: u64,
    /// Of each BEV frame offered, when, and its age at delivery.
    bev: BTreeMap<ObjectId, (Stamp, Option<Duration>)>,
    /// From each command to its acknowledgement.
    pub(super) commands: Vec<Option<Duration>>,
}

impl Measured {
    /// The ages of the BEV frames delivered, and which share of them all came before their deadline.
    pub(super) fn bev(&self) -> (Vec<Option<Duration>>, f64) {
        let ages: Vec<Option<Duration>> = self.bev.values().map(|(_, age)| *age).collect();
        let in_time = ages.iter().flatten().filter(|age| **age <= BEV_DEADLINE);
        let share = in_time.count() as f64 / ages.len() as f64;
        (ages.into_iter().flatten().map(Some).collect(), share)
    }
}

/// What a run has shown.
#[derive(Debug)]
pub(super) struct Run {
    /// Tiles share the link with BEV frames.
    pub(super) shared: Measured,
    /// Tiles have it for themselves.
    pub(super) alone: Measured,
    pub(super) catch_up: Option<Duration>,
}

/// Runs a case with a transport.
pub(super) fn run(case: &Case, transport: impl Transport) -> Run {
    let mut team = Team::new(case, transport);
    let shared = team.measure();
    team.sends_bev = false;
    Run {
        shared,
        alone: team.measure(),
        catch_up: team.catch_up(),
    }
}

struct Team<'a, T> {
    case: &'a Case,
    transport: T,
    now: Stamp,
    step: u64,
    uav: End,
    ground: End,
    commands: Client,
    /// When each command under way was begun, by its number.
    commanded: BTreeMap<u16, Stamp>,
    next_command: u16,
    random: Pcg64,
    /// Size and time of offer of what was not delivered.
    offered: BTreeMap<ObjectId, (usize, Stamp)>,
    /// Bytes of tiles that have not arrived.
    pending: usize,
    next_key: u64,
    sends_bev: bool,
    /// Bytes that the UAV has sent: the transport's, and others that it knows of.
    object_bytes: u64,
    other_bytes: u64,
    measured: Measured,
}

impl<'a, T: Transport> Team<'a, T> {
    fn new(case: &'a Case, transport: T) -> Self {
        let repeats = transport.repeats_commands();
        let channel = |seed| Channel::new(case.profile.clone(), seed);
        Self {
            case,
            transport,
            now: Stamp::ZERO,
            step: 0,
            uav: End::new(UAV, channel(case.seed), repeats),
            ground: End::new(GROUND, channel(case.seed + 1), repeats),
            commands: Client::new(GROUND),
            commanded: BTreeMap::new(),
            next_command: 0,
            random: Pcg64::seed_from_u64(case.seed),
            offered: BTreeMap::new(),
            pending: 0,
            next_key: 0,
            sends_bev: true,
            object_bytes: 0,
            other_bytes: 0,
            measured: Measured::default(),
        }
    }

    fn sent_bytes(&self) -> u64 {
        self.uav.channel.stats().sent_bytes + self.ground.channel.stats().sent_bytes
    }

    /// Lets the link settle, and watches it for [`SATURATED`].
    fn measure(&mut self) -> Measured {
        self.saturate(SETTLING);
        self.measured = Measured::default();
        let before = self.sent_bytes();
        self.saturate(SATURATED);
        self.measured.wire_bytes = self.sent_bytes() - before;
        let now = self.now;
        let mut measured = std::mem::take(&mut self.measured);
        // Of those offered last, nobody knows yet.
        let is_over = |offered: Stamp| now.since(offered) > BEV_DEADLINE;
        measured.bev.retain(|_, (offered, _)| is_over(*offered));
        measured
    }

    /// Always has more tiles to send than the link carries.
    fn saturate(&mut self, span: Duration) {
        let end = self.now + span;
        let backlog = (self.case.rate() * BACKLOG.as_secs_f64()) as usize;
        while self.now < end {
            if self.step.is_multiple_of(TICK_MS) {
                let mut waiting = self.transport.waiting_bytes(self.now);
                while waiting < backlog {
                    waiting += self.offer_tile();
                }
            }
            self.advance();
        }
    }

    /// How long it takes after an outage until nothing waits; `None` if it takes too long.
    fn catch_up(&mut self) -> Option<Duration> {
        self.drain()?;
        let outage = Outage {
            from: self.now,
            span: OUTAGE,
        };
        self.uav.channel.fail(outage);
        self.ground.channel.fail(outage);
        let mut left = self.case.rate() * CHANGED.as_secs_f64();
        while self.now < outage.from + OUTAGE {
            if left > 0.0 && self.step.is_multiple_of(TICK_MS) {
                left -= self.offer_tile() as f64;
            }
            self.advance();
        }
        self.drain()
    }

    fn drain(&mut self) -> Option<Duration> {
        let begun = self.now;
        while self.pending > 0 {
            self.advance();
            if self.now.since(begun) > PATIENCE {
                return None;
            }
        }
        Some(self.now.since(begun))
    }

    /// A tile as they are: most are small, some are large.
    fn offer_tile(&mut self) -> usize {
        let share: f64 = self.random.random();
        let bytes = (1_000.0 * 20_f64.powf(share)) as usize;
        self.next_key += 1;
        let id = ObjectId {
            stream: StreamId::TILE,
            key: self.next_key,
            version: 1,
        };
        self.pending += bytes;
        self.offer(id, Service::Reliable, bytes);
        bytes
    }

    fn offer_bev(&mut self) {
        self.next_key += 1;
        let id = ObjectId {
            stream: StreamId::BEV,
            key: 0,
            version: self.next_key,
        };
        let deadline = BEV_DEADLINE;
        self.measured.bev.insert(id, (self.now, None));
        self.offer(id, Service::Latest { deadline }, self.case.bev_bytes);
    }

    fn offer(&mut self, id: ObjectId, service: Service, size: usize) {
        let mut bytes = vec![0; size];
        self.random.fill_bytes(&mut bytes);
        self.offered.insert(id, (size, self.now));
        self.transport
            .offer(self.now, Object { id, service, bytes });
    }

    fn advance(&mut self) {
        self.step += 1;
        self.now += STEP;
        let now = self.now;
        if self.step.is_multiple_of(TELEMETRY_EVERY_MS) {
            let position = GLOBAL_POSITION_INT_DATA::default();
            self.send_there([Message::GLOBAL_POSITION_INT(position)]);
        }
        if self.sends_bev && self.step.is_multiple_of(u64::from(1000 / self.case.bev_hz)) {
            self.offer_bev();
        }
        if self.step.is_multiple_of(COMMAND_EVERY_MS) {
            self.command();
        }
        if self.step.is_multiple_of(TICK_MS) {
            self.count_others();
            let messages = self.transport.tick_uav(now);
            self.send_objects(messages);
            let messages = self.transport.tick_ground(now);
            self.send_back(messages);
            let again = self.commands.tick(now);
            self.send_back(again.send);
            self.ended(&again.events);
        }
        self.uav.repeat(now);
        self.ground.repeat(now);
        for frame in self.uav.channel.arrived(now) {
            self.at_ground(&frame);
        }
        for frame in self.ground.channel.arrived(now) {
            self.at_uav(&frame);
        }
    }

    /// Each command has another number than those that may be unanswered, so that a slow one holds none back.
    fn command(&mut self) {
        let command = FIRST_COMMAND + self.next_command;
        self.next_command = (self.next_command + 1) % COMMANDS;
        let request = Request::long(command, &[]);
        if let Ok(message) = self.commands.start(self.now, UAV, request) {
            self.commanded.insert(command, self.now);
            self.send_back([message]);
        }
    }

    fn ended(&mut self, outcomes: &[mavlink_ext::command::Outcome]) {
        for outcome in outcomes {
            let begun = self.commanded.remove(&outcome.command);
            let took = begun.map(|begun| self.now.since(begun));
            self.measured
                .commands
                .push(took.filter(|_| outcome.result.is_ok()));
        }
    }

    fn at_uav(&mut self, frame: &RawFrame) {
        let Some(message) = self.uav.heard(self.now, frame) else {
            return;
        };
        if let Some(command) = Incoming::parse(UAV, frame.from(), &message) {
            self.send_there([command.ack(MavResult::MAV_RESULT_ACCEPTED)]);
        }
        let answers = self.transport.at_uav(self.now, &message);
        self.send_objects(answers);
    }

    fn at_ground(&mut self, frame: &RawFrame) {
        let Some(message) = self.ground.heard(self.now, frame) else {
            return;
        };
        let step = self.commands.handle(self.now, frame.from(), &message);
        self.ended(&step.events);
        let (answers, delivered) = self.transport.at_ground(self.now, &message);
        self.send_back(answers);
        for id in delivered {
            let Some((bytes, offered)) = self.offered.remove(&id) else {
                continue;
            };
            let age = self.now.since(offered);
            if id.stream == StreamId::BEV {
                self.measured.bev_bytes += bytes as u64;
                if let Some((_, delivered)) = self.measured.bev.get_mut(&id) {
                    *delivered = Some(age);
                }
            } else {
                self.pending -= bytes;
                self.measured.tiles += 1;
                self.measured.tile_bytes += bytes as u64;
            }
        }
    }

    /// Tells the transport of what else the UAV has sent.
    fn count_others(&mut self) {
        let others = self.uav.channel.stats().sent_bytes - self.object_bytes;
        self.transport.link_has_sent(others - self.other_bytes);
        self.other_bytes = others;
    }

    fn send_objects(&mut self, messages: Vec<Message>) {
        let before = self.uav.channel.stats().sent_bytes;
        self.send_there(messages);
        self.object_bytes += self.uav.channel.stats().sent_bytes - before;
    }

    fn send_there(&mut self, messages: impl IntoIterator<Item = Message>) {
        self.uav.send(self.now, messages);
    }

    fn send_back(&mut self, messages: impl IntoIterator<Item = Message>) {
        self.ground.send(self.now, messages);
    }
}
