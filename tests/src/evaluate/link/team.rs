//! A UAV and a ground station with a link between them.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::command::{Client, Incoming, Request};
use mavlink_ext::dialect::Message;
use mavlink_ext::dialect::tandem::{GLOBAL_POSITION_INT_DATA, MavResult};
use mavlink_ext::object::{Object, ObjectId, Service, StreamId};
use mavlink_ext::wire::{Address, Encoder, RawFrame};
use rand::{Rng as _, RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use sitl::link::{Channel, Outage};

use super::{BEV_DEADLINE, Case};

pub(super) const UAV: Address = Address::new(1, 191);
pub(super) const GROUND: Address = Address::new(255, 190);

/// Simulated time goes on by this.
const STEP: Duration = Duration::from_millis(1);
/// How often both ends let time pass.
const TICK_MS: u64 = 10;
const SETTLING: Duration = Duration::from_secs(5);
const SATURATED: Duration = Duration::from_secs(40);
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
    /// What the UAV sends when time passes.
    fn tick_uav(&mut self, now: Stamp) -> Vec<Message>;
    /// What it answers.
    fn at_uav(&mut self, now: Stamp, message: &Message) -> Vec<Message>;
    /// What the ground sends when time passes.
    fn tick_ground(&mut self, now: Stamp) -> Vec<Message>;
    /// What it answers, and the objects that are there now.
    fn at_ground(&mut self, now: Stamp, message: &Message) -> (Vec<Message>, Vec<ObjectId>);
}

/// What a run has shown.
#[derive(Debug, Default)]
pub(super) struct Measured {
    /// How long the link was saturated and watched.
    pub(super) saturated: Duration,
    pub(super) tiles: u64,
    pub(super) tile_bytes: u64,
    pub(super) wire_bytes: u64,
    pub(super) bev_offered: u64,
    pub(super) bev_in_time: u64,
    /// Bytes of those delivered.
    pub(super) bev_bytes: u64,
    /// Of those delivered.
    pub(super) bev_ages: Vec<Option<Duration>>,
    /// From each command to its acknowledgement.
    pub(super) commands: Vec<Option<Duration>>,
    pub(super) catch_up: Option<Duration>,
}

/// Runs a case with a transport.
pub(super) fn run(case: &Case, transport: impl Transport) -> Measured {
    let mut team = Team::new(case, transport);
    team.saturate(SETTLING);
    team.measured = Measured::default();
    let before = team.sent_bytes();
    team.saturate(SATURATED);
    team.measured.saturated = SATURATED;
    team.measured.wire_bytes = team.sent_bytes() - before;
    let mut measured = std::mem::take(&mut team.measured);
    measured.catch_up = team.catch_up();
    measured
}

struct Team<'a, T> {
    case: &'a Case,
    transport: T,
    now: Stamp,
    step: u64,
    there: Channel<RawFrame>,
    back: Channel<RawFrame>,
    uav: Encoder,
    ground: Encoder,
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
    measured: Measured,
}

impl<'a, T: Transport> Team<'a, T> {
    fn new(case: &'a Case, transport: T) -> Self {
        let profile = case.profile.clone();
        Self {
            case,
            transport,
            now: Stamp::ZERO,
            step: 0,
            there: Channel::new(profile.clone(), case.seed),
            back: Channel::new(profile, case.seed + 1),
            uav: Encoder::new(UAV),
            ground: Encoder::new(GROUND),
            commands: Client::new(GROUND),
            commanded: BTreeMap::new(),
            next_command: 0,
            random: Pcg64::seed_from_u64(case.seed),
            offered: BTreeMap::new(),
            pending: 0,
            next_key: 0,
            sends_bev: true,
            measured: Measured::default(),
        }
    }

    fn sent_bytes(&self) -> u64 {
        self.there.stats().sent_bytes + self.back.stats().sent_bytes
    }

    /// Always has more tiles to send than the link carries.
    fn saturate(&mut self, span: Duration) {
        let end = self.now + span;
        let backlog = (self.case.rate() * BACKLOG.as_secs_f64()) as usize;
        while self.now < end {
            if self.step.is_multiple_of(TICK_MS) {
                while self.pending < backlog {
                    self.offer_tile();
                }
            }
            self.advance();
        }
    }

    /// How long it takes after an outage until nothing waits; `None` if it takes too long.
    fn catch_up(&mut self) -> Option<Duration> {
        self.sends_bev = false;
        self.drain()?;
        let outage = Outage {
            from: self.now,
            span: OUTAGE,
        };
        self.there.fail(outage);
        self.back.fail(outage);
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
        self.measured.bev_offered += 1;
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
            let messages = self.transport.tick_uav(now);
            self.send_there(messages);
            let messages = self.transport.tick_ground(now);
            self.send_back(messages);
            let again = self.commands.tick(now);
            self.send_back(again.send);
            self.ended(&again.events);
        }
        for frame in self.there.arrived(now) {
            self.at_ground(&frame);
        }
        for frame in self.back.arrived(now) {
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
        let Ok(message) = frame.decode() else {
            return;
        };
        if let Some(command) = Incoming::parse(UAV, frame.from(), &message) {
            self.send_there([command.ack(MavResult::MAV_RESULT_ACCEPTED)]);
        }
        let answers = self.transport.at_uav(self.now, &message);
        self.send_there(answers);
    }

    fn at_ground(&mut self, frame: &RawFrame) {
        let Ok(message) = frame.decode() else {
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
                self.measured.bev_in_time += u64::from(age <= BEV_DEADLINE);
                self.measured.bev_bytes += bytes as u64;
                self.measured.bev_ages.push(Some(age));
            } else {
                self.pending -= bytes;
                self.measured.tiles += 1;
                self.measured.tile_bytes += bytes as u64;
            }
        }
    }

    fn send_there(&mut self, messages: impl IntoIterator<Item = Message>) {
        for message in messages {
            let frame = self.uav.encode(&message);
            let bytes = frame.bytes().len();
            self.there.send(self.now, frame, bytes);
        }
    }

    fn send_back(&mut self, messages: impl IntoIterator<Item = Message>) {
        for message in messages {
            let frame = self.ground.encode(&message);
            let bytes = frame.bytes().len();
            self.back.send(self.now, frame, bytes);
        }
    }
}
