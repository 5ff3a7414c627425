//! Ten minutes of two companions and a ground station over links that drop, stall, repeat, reorder and break, in simulated
//! time. Both ends restart in between.

use std::collections::BTreeMap;
use std::fs;
use std::time::Duration;

use maps::tile::TileId;
use maps::time::Stamp;
use mavlink_ext::Address;
use mavlink_ext::Message;
use mavlink_ext::command::{Client, CommandError, Incoming, Request};
use mavlink_ext::dialect::tandem::{MavResult, TANDEM_STATUS_DATA};
use mavlink_ext::object::digest::{Answerer, Asker, Item};
use mavlink_ext::object::{
    Object, ObjectId, OfferError, Receiver, ReceiverLimits, Sender, SenderSettings, Service,
};
use mavlink_ext::service::Ends;
use rand::{Rng as _, RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use sitl::link::{Channel, Loss, Outage, Profile};
use tests::radio::End;

const STATION: Address = Address::new(255, 190);
const COMPANIONS: [Address; 2] = [Address::new(1, 191), Address::new(2, 191)];
const STEP: Duration = Duration::from_millis(5);
const TICK_STEPS: u64 = 2;
const MINUTE: u64 = 60_000;
const SOAK_MS: u64 = 10 * MINUTE;
/// After the end of the changes, everything is there within this time.
const SETTLED_MS: u64 = MINUTE;
/// How much the process may grow after its first three minutes.
const GROWTH_BYTES: u64 = 16 << 20;
const KEYS: u64 = 40;
/// Numbers that MAVLink leaves to users.
const FIRST_COMMAND: u16 = 31_010;

/// A map of 8 × 5 tiles.
fn tile(key: u64) -> TileId {
    TileId {
        x: (key % 8) as i32,
        y: (key / 8) as i32,
        z: 0,
    }
}

fn at(millis: u64) -> Stamp {
    Stamp::ZERO + Duration::from_millis(millis)
}

/// A companion that maps, and the link from it to the station and back.
struct Companion {
    address: Address,
    session: u16,
    sender: Sender,
    answerer: Answerer,
    /// The newest version of each key, and its content.
    tiles: BTreeMap<u64, (u64, Vec<u8>)>,
    end: End,
    station: End,
    /// Until when nothing comes out of the link, but is not lost.
    stalled_until: Stamp,
    /// Versions of tiles that were sent, or sent again.
    offered: usize,
    /// Commands carried out, with those that were asked for again.
    obeyed: u32,
}

fn sender(now: Stamp, address: Address, session: u16) -> Sender {
    let ends = Ends {
        own: address,
        peer: STATION,
    };
    let settings = SenderSettings {
        bytes_per_second: 500_000, // Twice what the link carries.
        ..SenderSettings::default()
    };
    Sender::new(now, ends, session, settings)
}

impl Companion {
    fn new(address: Address, random: &mut Pcg64) -> Self {
        let profile = Profile {
            jitter: Duration::from_millis(20),
            loss: Loss::Bursts {
                share: 0.15,
                length: 3.0,
            },
            repeat: 0.02,
            overtake: 0.1,
            ..Profile::of_rate(2e6, Duration::from_millis(50))
        };
        let mut end = |address| {
            let channel = Channel::new(profile.clone(), random.random());
            End::new(address, channel, true)
        };
        Self {
            address,
            session: 1,
            sender: sender(Stamp::ZERO, address, 1),
            answerer: Answerer::default(),
            tiles: BTreeMap::new(),
            end: end(address),
            station: end(STATION),
            stalled_until: Stamp::ZERO,
            offered: 0,
            obeyed: 0,
        }
    }

    fn offer(&mut self, now: Stamp, key: u64) {
        let (version, bytes) = &self.tiles[&key];
        let id = ObjectId::of_tile(tile(key), *version).expect("near the origin");
        let object = Object {
            id,
            service: Service::Reliable,
            bytes: bytes.clone(),
        };
        match self.sender.offer(now, object) {
            Ok(()) => self.offered += 1,
            Err(OfferError::Outdated { .. }) => {} // on its way
            Err(error) => panic!("{error}"),
        }
    }

    /// A tile changes.
    fn map(&mut self, now: Stamp, random: &mut Pcg64) {
        let key = random.random_range(0..KEYS);
        let mut bytes = vec![0; random.random_range(500..12_000)];
        random.fill_bytes(&mut bytes);
        let version = self.tiles.get(&key).map_or(1, |(version, _)| version + 1);
        self.answerer.has(tile(key), Item::new(version, &bytes));
        self.tiles.insert(key, (version, bytes));
        self.offer(now, key);
    }

    /// The program starts anew with the map that it has on its disk. What the station has of it, it is asked.
    fn restart(&mut self, now: Stamp) {
        self.session += 1;
        self.sender = sender(now, self.address, self.session);
    }

    /// The station asks what is new.
    fn answer(&mut self, now: Stamp, message: &Message) {
        let ends = Ends {
            own: self.address,
            peer: STATION,
        };
        let Some(answer) = self.answerer.handle(now, ends, STATION, message) else {
            return;
        };
        self.end.send(now, vec![answer.message]);
        for (key, (version, _)) in self.tiles.clone() {
            let id = ObjectId::of_tile(tile(key), version).expect("near the origin");
            if answer.same.contains(&tile(key)) {
                self.sender.is_there(id);
            }
            if answer.lacking.contains(&tile(key)) {
                self.sender.is_lacking(id.stream, id.key);
                self.offer(now, key);
            }
        }
    }

    fn run(&mut self, now: Stamp) {
        let step = self.sender.tick(now);
        self.end.send(now, step.send);
        self.end.repeat(now);
        for frame in self.station.channel.arrived(now) {
            let Some(message) = self.end.heard(now, &frame) else {
                continue;
            };
            let step = self.sender.handle(now, STATION, &message);
            self.end.send(now, step.send);
            self.answer(now, &message);
            if let Some(command) = Incoming::parse(self.address, STATION, &message) {
                self.obeyed += 1;
                let ack = command.ack(MavResult::MAV_RESULT_ACCEPTED);
                self.end.send(now, vec![ack]);
            }
        }
    }

    /// At the end the station has every tile, and few went more often than they changed.
    fn check(&self, station: &Station) {
        for (key, content) in &self.tiles {
            let has = station.has.get(&(self.address, tile(*key)));
            assert!(
                has == Some(content),
                "tile {key} of {} is stale",
                self.address
            );
        }
        // Those of the half of the tiles that the station lost, and what was under way when one of them started anew.
        let again = self.offered - (SOAK_MS / 250) as usize;
        assert!(
            (1..=60).contains(&again),
            "{again} tiles were sent again by {}",
            self.address
        );
        let stats = self.sender.stats(at(SOAK_MS + SETTLED_MS));
        assert!(self.sender.is_idle(), "{stats:?}");
    }

    /// The link breaks, or stalls, now and then.
    fn disturb(&mut self, now: Stamp, random: &mut Pcg64) {
        let span = Duration::from_millis(random.random_range(500..20_000));
        if random.random_bool(0.5) {
            for channel in [&mut self.end.channel, &mut self.station.channel] {
                channel.fail(Outage { from: now, span });
            }
        } else {
            self.stalled_until = now + span / 4;
        }
    }
}

/// The station: what it has of both maps, and its commands.
struct Station {
    receiver: Receiver,
    asker: Asker,
    session: u32,
    has: BTreeMap<(Address, TileId), (u64, Vec<u8>)>,
    commands: Client,
    asked: u32,
    answered: u32,
    unanswered: u32,
}

impl Station {
    fn new() -> Self {
        let session = 1;
        Self {
            receiver: Receiver::new(STATION, session, ReceiverLimits::default()),
            asker: Asker::new(STATION, session),
            session,
            has: BTreeMap::new(),
            commands: Client::new(STATION),
            asked: 0,
            answered: 0,
            unanswered: 0,
        }
    }

    /// The program starts anew with what it had on its disk: half of the tiles. Commands under way are still waited for, so
    /// as to count them.
    fn restart(&mut self, now: Stamp) {
        self.session += 1;
        self.receiver = Receiver::new(STATION, self.session, ReceiverLimits::default());
        self.asker = Asker::new(STATION, self.session);
        self.has.retain(|(_, tile), _| tile.x % 2 == 0);
        for ((from, tile), (version, bytes)) in &self.has {
            let item = Item::new(*version, bytes);
            self.asker.has(now, *from, *tile, item);
        }
    }

    fn ended(&mut self, outcomes: Vec<mavlink_ext::command::Outcome>) {
        for outcome in outcomes {
            match outcome.result {
                Ok(()) => self.answered += 1,
                Err(CommandError::NoAnswer { .. }) => self.unanswered += 1,
                Err(error) => panic!("{error}"),
            }
        }
    }

    fn hear(&mut self, now: Stamp, companion: &mut Companion) {
        if now < companion.stalled_until {
            return;
        }
        let from = companion.address;
        for frame in companion.end.channel.arrived(now) {
            let Some(message) = companion.station.heard(now, &frame) else {
                continue;
            };
            let step = self.commands.handle(now, from, &message);
            self.ended(step.events);
            self.asker.handle(now, from, &message);
            let step = self.receiver.handle(now, from, &message);
            companion.station.send(now, step.send);
            for received in step.events {
                let tile = received.id.tile().expect("a tile");
                let item = Item::new(received.id.version, &received.bytes);
                self.asker.has(now, from, tile, item);
                self.has
                    .insert((from, tile), (received.id.version, received.bytes));
            }
        }
    }

    fn command(&mut self, now: Stamp, number: u64, companion: &mut Companion) {
        let command = FIRST_COMMAND + (number % 500) as u16;
        let request = Request::long(command, &[]);
        let message = self.commands.start(now, companion.address, request);
        self.asked += 1;
        companion
            .station
            .send(now, vec![message.expect("it is not under way any more")]);
    }

    fn tick(&mut self, now: Stamp, companions: &mut [Companion]) {
        let mut reports = self.receiver.tick(now).send;
        reports.extend(self.asker.tick(now));
        let again = self.commands.tick(now);
        self.ended(again.events);
        for companion in companions {
            // Each has a link of its own; what is for the other goes nowhere there.
            let mut messages = reports.clone();
            messages.extend(again.send.clone());
            companion.station.send(now, messages);
            companion.station.repeat(now);
        }
    }
}

/// Resident memory of this process.
fn resident_bytes() -> u64 {
    let pages = fs::read_to_string("/proc/self/statm").expect("Linux tells");
    let resident = pages
        .split(' ')
        .nth(1)
        .and_then(|pages| pages.parse::<u64>().ok());
    resident.expect("a number") * 4096
}

#[test]
fn ten_minutes_of_bad_links_lose_no_tile_no_command_and_no_memory() {
    let mut random = Pcg64::seed_from_u64(11);
    let mut companions = COMPANIONS.map(|address| Companion::new(address, &mut random));
    let mut station = Station::new();
    let mut early = 0;
    let mut commands = 0;
    for millis in (0..SOAK_MS + SETTLED_MS).step_by(STEP.as_millis() as usize) {
        let now = at(millis);
        let soaks = millis < SOAK_MS;
        for companion in &mut companions {
            if soaks && millis % 250 == 0 {
                companion.map(now, &mut random);
            }
            if millis % 1000 == 0 {
                let status = TANDEM_STATUS_DATA::default();
                companion
                    .end
                    .send(now, vec![Message::TANDEM_STATUS(status)]);
            }
            if soaks && millis % 30_000 == 15_000 {
                companion.disturb(now, &mut random);
            }
            if millis % (TICK_STEPS * STEP.as_millis() as u64) == 0 {
                companion.run(now);
            }
            station.hear(now, companion);
        }
        if soaks && millis % 500 == 0 {
            commands += 1;
            let target = &mut companions[(commands % 2) as usize];
            station.command(now, commands, target);
        }
        if millis % 10 == 0 {
            station.tick(now, &mut companions);
        }
        match millis {
            m if m == 3 * MINUTE => early = resident_bytes(),
            m if m == 4 * MINUTE => companions[0].restart(now),
            m if m == 7 * MINUTE => station.restart(now),
            _ => {}
        }
    }
    let grown = resident_bytes().saturating_sub(early);
    assert!(
        grown < GROWTH_BYTES,
        "{grown} bytes more than after three minutes"
    );
    for companion in &companions {
        companion.check(&station);
    }
    let Station {
        asked,
        answered,
        unanswered,
        ..
    } = station;
    assert_eq!(
        asked,
        answered + unanswered,
        "each was answered, or told to be unanswered"
    );
    let obeyed: u32 = companions.iter().map(|companion| companion.obeyed).sum();
    assert!(
        obeyed < asked * 11 / 10,
        "{obeyed} carried out of {asked}: copies count once"
    );
    assert!(answered > asked * 8 / 10, "{answered} of {asked}");
}
