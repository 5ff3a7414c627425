//! Both ends over a simulated radio, in simulated time.

use std::collections::BTreeMap;

use maps::time::Stamp;
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;
use sitl::link::Profile;

use super::*;
use crate::dialect::Message;
use crate::dialect::tandem::{TANDEM_OBJECT_DATA, TANDEM_REPORT_DATA, TANDEM_SYMBOL_DATA};
use crate::service::Ends;
use crate::simulated::{Air, losing, perfect};
use crate::wire::Address;

const UAV: Address = Address::new(1, 191);
const STATION: Address = Address::new(255, 190);
const TICK: Duration = Duration::from_millis(10);

/// A sender, a receiver and the radio between them.
struct Room {
    now: Stamp,
    sender: Sender,
    receiver: Receiver,
    there: Air,
    back: Air,
    /// Whether the receiver's program runs.
    receiving: bool,
    got: Vec<Received>,
    events: Vec<SenderEvent>,
}

impl Room {
    fn new(radio: &Profile, seed: u64) -> Self {
        Self::with(radio, seed, SenderSettings::default())
    }

    fn with(radio: &Profile, seed: u64, settings: SenderSettings) -> Self {
        let ends = Ends {
            own: UAV,
            peer: STATION,
        };
        Self {
            now: Stamp::ZERO,
            sender: Sender::new(Stamp::ZERO, ends, 7, settings),
            receiver: Receiver::new(STATION, 1, ReceiverLimits::default()),
            there: Air::new(UAV, radio, seed),
            back: Air::new(STATION, radio, seed ^ 0xFFFF),
            receiving: true,
            got: Vec::new(),
            events: Vec::new(),
        }
    }

    fn offer(&mut self, key: u64, version: u64, bytes: Vec<u8>) {
        let id = tile(key, version);
        let service = Service::Reliable;
        let object = Object { id, service, bytes };
        self.sender.offer(self.now, object).expect("room for it");
    }

    fn run(&mut self, span: Duration) {
        let end = self.now + span;
        while self.now < end {
            self.step();
        }
    }

    /// How long it takes until the sender is done.
    fn run_until_idle(&mut self, at_most: Duration) -> Duration {
        let start = self.now;
        while !self.sender.is_idle() {
            self.step();
            assert!(
                self.now.since(start) < at_most,
                "{:?}",
                self.sender.stats(self.now)
            );
        }
        self.now.since(start)
    }

    fn step(&mut self) {
        self.now += TICK;
        let step = self.sender.tick(self.now);
        self.there.send(self.now, step.send);
        self.events.extend(step.events);
        for (from, message) in self.there.arrived(self.now) {
            if self.receiving {
                let step = self.receiver.handle(self.now, from, &message);
                self.back.send(self.now, step.send);
                self.got.extend(step.events);
            }
        }
        if self.receiving {
            let step = self.receiver.tick(self.now);
            self.back.send(self.now, step.send);
        }
        for (from, message) in self.back.arrived(self.now) {
            let step = self.sender.handle(self.now, from, &message);
            self.events.extend(step.events);
        }
    }

    /// The newest version and content of each key that was handed out.
    fn newest(&self) -> BTreeMap<u64, (u64, &[u8])> {
        let mut newest = BTreeMap::new();
        for received in &self.got {
            newest.insert(
                received.id.key,
                (received.id.version, received.bytes.as_slice()),
            );
        }
        newest
    }
}

fn tile(key: u64, version: u64) -> ObjectId {
    ObjectId {
        stream: StreamId::TILE,
        key,
        version,
    }
}

fn content(size: usize, seed: u64) -> Vec<u8> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut bytes = vec![0; size];
    random.fill_bytes(&mut bytes);
    bytes
}

#[track_caller]
fn check_twenty_tiles_arrive(loss: f64, most_overhead: f64) {
    let mut room = Room::new(&losing(loss), 3);
    let sizes: Vec<usize> = (0..20).map(|key| 500 + 2500 * key).collect();
    for (key, &size) in sizes.iter().enumerate() {
        room.offer(key as u64, 1, content(size, key as u64));
    }
    room.run_until_idle(Duration::from_secs(20));
    for (key, &size) in sizes.iter().enumerate() {
        let expected = content(size, key as u64);
        assert_eq!(
            room.newest()[&(key as u64)],
            (1, expected.as_slice()),
            "tile {key}"
        );
    }
    let stats = room.sender.stats(room.now);
    assert_eq!((stats.objects_delivered, stats.keys_delivered), (20, 20));
    assert_eq!(room.got.len(), 20, "each once");
    let total: usize = sizes.iter().sum();
    // What the code and the loss cost at least: K / (1 - p) symbols.
    let least = total as f64 / (1.0 - loss);
    let overhead = stats.symbols_sent as f64 * SYMBOL_BYTES as f64 / least - 1.0;
    assert!(
        overhead < most_overhead,
        "{overhead} above the least at {loss} loss"
    );
}

#[test]
fn tiles_arrive_over_a_radio_that_repeats_and_reorders() {
    check_twenty_tiles_arrive(0.0, 0.02);
}

#[test]
fn tiles_arrive_at_a_tenth_lost() {
    check_twenty_tiles_arrive(0.1, 0.25);
}

#[test]
fn tiles_arrive_at_three_tenths_lost() {
    check_twenty_tiles_arrive(0.3, 0.35);
}

#[test]
fn the_budget_is_kept() {
    let settings = SenderSettings {
        bytes_per_second: 50_000,
        ..SenderSettings::default()
    };
    let mut room = Room::with(&perfect(), 1, settings);
    room.offer(1, 1, content(200_000, 1));
    let took = room.run_until_idle(Duration::from_mins(1)).as_secs_f64();
    let sent = room.sender.stats(room.now).wire_bytes as f64;
    assert!(sent / took <= 52_000.0, "{sent} bytes in {took} s");
    assert!(took < 5.0, "{took} s for 200 kB of payload at 50 kB/s");
}

#[test]
fn what_else_the_link_carries_counts_against_the_budget() {
    let settings = SenderSettings {
        bytes_per_second: 50_000,
        ..SenderSettings::default()
    };
    let mut room = Room::with(&perfect(), 1, settings);
    room.offer(1, 1, content(2_000_000, 1));
    room.run(Duration::from_secs(5));
    let before = room.sender.stats(room.now).wire_bytes;
    for _ in 0..1000 {
        room.sender.link_has_sent(300); // 30 kB/s
        room.run(TICK);
    }
    let sent = room.sender.stats(room.now).wire_bytes - before;
    assert!((180_000..=202_000).contains(&sent), "{sent} in 10 s");
    room.sender.link_has_sent(100_000_000);
    let before = room.sender.stats(room.now).wire_bytes;
    room.run(Duration::from_secs(2));
    let sent = room.sender.stats(room.now).wire_bytes - before;
    assert!(sent > 50_000, "{sent} in 2 s: a flood is forgotten soon");
}

#[test]
fn on_a_slow_link_no_frame_keeps_a_command_waiting_for_long() {
    let slow = SenderSettings {
        bytes_per_second: 14_400,
        ..SenderSettings::default()
    };
    let mut room = Room::with(&Profile::of_rate(115_200.0, Duration::ZERO), 1, slow);
    room.offer(1, 1, content(30_000, 1));
    room.run_until_idle(Duration::from_secs(10));
    room.offer(2, 1, content(30_000, 2));
    let before = room.sender.stats(room.now);
    room.run_until_idle(Duration::from_secs(10));
    let after = room.sender.stats(room.now);
    let frame = (after.wire_bytes - before.wire_bytes) / (after.symbols_sent - before.symbols_sent);
    assert!(frame <= 144, "{frame} bytes take more than 10 ms");
    // A large object has too many small symbols.
    room.offer(3, 1, content(MAX_OBJECT_BYTES, 3));
    room.run(Duration::from_secs(10));
    assert!(room.sender.stats(room.now).symbols_sent > after.symbols_sent);
}

#[test]
fn a_receiver_that_starts_late_gets_everything_and_little_is_sent_before() {
    let mut room = Room::new(&losing(0.1), 5);
    room.receiving = false;
    for key in 0..5 {
        room.offer(key, 1, content(30_000, key));
    }
    room.run(Duration::from_mins(1));
    let before = room.sender.stats(room.now);
    assert!(!before.receiver_alive);
    assert!(before.wire_bytes < 5_000, "{before:?}");
    room.receiving = true;
    let took = room.run_until_idle(Duration::from_secs(10));
    assert!(took < Duration::from_secs(3), "{took:?}");
    assert_eq!(room.newest().len(), 5);
}

#[test]
fn a_receiver_that_restarts_can_be_given_again_what_it_had() {
    let mut room = Room::new(&losing(0.1), 6);
    for key in 0..5 {
        room.offer(key, 1, content(30_000, key));
    }
    room.run_until_idle(Duration::from_secs(10));
    room.receiving = false;
    room.run(Duration::from_secs(5));
    room.receiver = Receiver::new(STATION, 2, ReceiverLimits::default());
    room.receiving = true;
    room.got.clear();
    room.run(Duration::from_secs(5));
    let delivered = (0..5).map(|key| tile(key, 1)).collect();
    let restarted = SenderEvent::ReceiverRestarted { delivered };
    assert!(room.events.contains(&restarted), "{:?}", room.events);
    assert!(room.got.is_empty(), "it may have kept it");
    assert_eq!(room.sender.stats(room.now).keys_delivered, 0);
    for key in 0..5 {
        room.offer(key, 1, content(30_000, key));
    }
    room.run_until_idle(Duration::from_secs(10));
    assert_eq!(room.newest().len(), 5);
}

#[test]
fn a_receiver_that_restarts_in_the_middle_gets_what_is_under_way_and_the_rest_is_named() {
    let mut room = Room::new(&losing(0.1), 7);
    for key in 0..10 {
        room.offer(key, 1, content(100_000, key));
    }
    room.run(Duration::from_millis(600));
    room.receiver = Receiver::new(STATION, 2, ReceiverLimits::default());
    room.got.clear();
    room.run_until_idle(Duration::from_secs(20));
    let mut keys: Vec<_> = room.newest().into_keys().collect();
    for event in &room.events {
        if let SenderEvent::ReceiverRestarted { delivered } = event {
            keys.extend(delivered.iter().map(|id| id.key));
        }
    }
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys, (0..10).collect::<Vec<_>>());
}

#[test]
fn what_the_receiver_lacks_is_taken_again_unless_it_is_on_its_way() {
    let mut room = Room::new(&perfect(), 8);
    room.offer(1, 3, content(900, 1));
    let again = |room: &mut Room| {
        let id = tile(1, 3);
        let (service, bytes) = (Service::Reliable, content(900, 1));
        room.sender.offer(room.now, Object { id, service, bytes })
    };
    room.sender.is_lacking(StreamId::TILE, 1);
    let outdated = OfferError::Outdated {
        id: tile(1, 3),
        newest: 3,
    };
    assert_eq!(again(&mut room), Err(outdated), "it waits");
    room.run_until_idle(Duration::from_secs(5));
    assert_eq!(again(&mut room), Err(outdated), "it is there");
    room.sender.is_lacking(StreamId::TILE, 1);
    room.sender.is_lacking(StreamId::TILE, 2);
    assert_eq!(again(&mut room), Ok(()));
}

#[test]
fn a_sender_that_restarts_replaces_what_the_receiver_has() {
    let mut room = Room::new(&losing(0.1), 9);
    room.offer(1, 7, content(5_000, 1));
    room.run_until_idle(Duration::from_secs(5));
    let ends = Ends {
        own: UAV,
        peer: STATION,
    };
    room.sender = Sender::new(room.now, ends, 8, SenderSettings::default());
    room.offer(1, 1, content(5_000, 2));
    room.run_until_idle(Duration::from_secs(5));
    assert_eq!(room.newest()[&1], (1, content(5_000, 2).as_slice()));
}

#[test]
fn a_newer_version_replaces_one_that_waits_but_not_one_under_way() {
    let settings = SenderSettings {
        bytes_per_second: 20_000,
        ..SenderSettings::default()
    };
    let mut room = Room::with(&perfect(), 10, settings);
    room.run(Duration::from_secs(2));
    for version in 1..=50 {
        room.offer(1, version, content(10_000, version));
        room.run(Duration::from_millis(100));
    }
    room.run_until_idle(Duration::from_secs(10));
    let versions: Vec<u64> = room
        .got
        .iter()
        .map(|received| received.id.version)
        .collect();
    assert_eq!(versions.last(), Some(&50));
    assert!(versions.is_sorted(), "{versions:?}");
    assert!(
        (5..20).contains(&versions.len()),
        "5 s at 20 kB/s: {versions:?}"
    );
    let stats = room.sender.stats(room.now);
    assert_eq!(stats.objects_replaced + stats.objects_delivered, 50);
    let again = room.sender.offer(
        room.now,
        Object {
            id: tile(1, 50),
            service: Service::Reliable,
            bytes: vec![1],
        },
    );
    let newest = 50;
    assert_eq!(
        again,
        Err(OfferError::Outdated {
            id: tile(1, 50),
            newest
        })
    );
}

#[test]
fn what_has_a_deadline_goes_first_and_expires() {
    let settings = SenderSettings {
        bytes_per_second: 100_000,
        ..SenderSettings::default()
    };
    let mut room = Room::with(&perfect(), 11, settings);
    room.run(Duration::from_secs(2));
    room.offer(1, 1, content(400_000, 1));
    room.run(Duration::from_millis(200));
    let deadline = Duration::from_millis(500);
    let bev = |key, size| Object {
        id: ObjectId {
            stream: StreamId::BEV,
            key,
            version: 0,
        },
        service: Service::Latest { deadline },
        bytes: content(size, key),
    };
    room.sender.offer(room.now, bev(1, 10_000)).expect("room");
    room.run(Duration::from_millis(300));
    assert_eq!(room.got.len(), 1, "before the tile");
    room.sender.offer(room.now, bev(2, 300_000)).expect("room");
    room.run(Duration::from_secs(1));
    let expired = |event: &SenderEvent| matches!(event, SenderEvent::Expired(id) if id.key == 2);
    assert!(room.events.iter().any(expired));
    room.run_until_idle(Duration::from_secs(20));
    assert_eq!(room.got.len(), 2, "the tile after all");
    assert_eq!(room.receiver.bytes_under_way(), 0);
}

#[test]
fn best_effort_is_sent_once() {
    let mut room = Room::new(&perfect(), 12);
    room.run(Duration::from_secs(2));
    let picture = Object {
        id: ObjectId {
            stream: StreamId::PICTURE,
            key: 1,
            version: 1,
        },
        service: Service::BestEffort,
        bytes: content(24_800, 1),
    };
    room.sender.offer(room.now, picture).expect("room");
    room.run_until_idle(Duration::from_secs(2));
    room.run(Duration::from_millis(100));
    assert_eq!(room.got.len(), 1);
    assert_eq!(room.sender.stats(room.now).symbols_sent, 100);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_last_version_offered_is_the_last_received(
        seed in any::<u64>(), loss in 0.0..0.3,
        offers in prop::collection::vec((0u64..4, 1usize..6_000, 0u64..400), 1..20)
    ) {
        let mut room = Room::new(&losing(loss), seed);
        let mut last = BTreeMap::new();
        for (version, (key, size, pause_ms)) in (1..).zip(offers) {
            room.offer(key, version, content(size, version));
            last.insert(key, (version, content(size, version)));
            room.run(Duration::from_millis(pause_ms));
        }
        room.run_until_idle(Duration::from_mins(1));
        for (key, (version, bytes)) in &last {
            prop_assert_eq!(room.newest()[key], (*version, bytes.as_slice()));
        }
        prop_assert_eq!(room.sender.stats(room.now).keys_delivered, last.len());
    }

    #[test]
    fn hostile_announcements_and_symbols_never_panic_and_are_bounded(
        messages in prop::collection::vec(
            (any::<u8>(), 0u32..20, any::<u32>(), any::<u32>(), any::<u8>(), any::<u8>()), 0..300
        )
    ) {
        let limits = ReceiverLimits { bytes: 100_000, object_bytes: 60_000, ..ReceiverLimits::default() };
        let mut receiver = Receiver::new(STATION, 1, limits);
        let mut now = Stamp::ZERO;
        for (kind, transfer, a, b, c, d) in messages {
            now += Duration::from_millis(u64::from(d));
            let message = if kind % 3 == 0 {
                Message::TANDEM_OBJECT(TANDEM_OBJECT_DATA {
                    key: u64::from(b), version: u64::from(c), transfer: transfer << (d % 32), size: a >> (c % 32),
                    hash: b, deadline: u32::from(c), target_system: 0, target_component: 0, stream: d, service: c,
                    symbol_size: if kind % 2 == 0 { 248 } else { d },
                })
            } else {
                Message::TANDEM_SYMBOL(TANDEM_SYMBOL_DATA {
                    transfer: transfer as u16, symbol: (a >> (c % 32)) as u16, data: [c; SYMBOL_BYTES],
                    ..TANDEM_SYMBOL_DATA::default()
                })
            };
            let step = receiver.handle(now, Address::new(c, 1), &message);
            prop_assert!(step.send.len() <= 10, "{} reports", step.send.len());
            prop_assert!(receiver.bytes_under_way() <= 8 * 100_000);
            receiver.tick(now);
        }
    }

    #[test]
    fn hostile_reports_never_panic(
        reports in prop::collection::vec((any::<u32>(), any::<u32>(), any::<u8>(), any::<u8>(), any::<u16>()), 0..50)
    ) {
        let mut room = Room::new(&perfect(), 1);
        room.offer(1, 1, content(5_000, 1));
        for (session, symbols, count, state, missing) in reports {
            let report = TANDEM_REPORT_DATA {
                session: session % 2, symbols, count, states: [state % 8; 8], missing: [missing; 8],
                transfers: [7 << 16 | u32::from(state % 4); 8], echo_transfer: 1, echo_symbol: missing % 32,
                echo_age: symbols >> (count % 32), ..TANDEM_REPORT_DATA::default()
            };
            room.sender.handle(room.now, STATION, &Message::TANDEM_REPORT(report));
            room.run(Duration::from_millis(20));
        }
    }
}

#[test]
fn one_transfer_with_a_forged_symbol_is_sent_again() {
    let mut room = Room::new(&perfect(), 13);
    room.offer(1, 1, content(24_000, 1));
    room.run(Duration::from_millis(20));
    let forged = Message::TANDEM_SYMBOL(TANDEM_SYMBOL_DATA {
        transfer: 1,
        symbol: 99,
        data: [0xEE; SYMBOL_BYTES],
        ..TANDEM_SYMBOL_DATA::default()
    });
    room.there.send(room.now, [forged]);
    room.run_until_idle(Duration::from_secs(10));
    assert_eq!(room.newest()[&1], (1, content(24_000, 1).as_slice()));
    assert_eq!(room.receiver.stats().damaged, 1);
}

#[test]
fn objects_that_cannot_be_sent_are_refused_with_the_numbers() {
    let mut room = Room::new(&perfect(), 14);
    let object = |size| Object {
        id: ObjectId::of_tile(TileId { x: -3, y: 4, z: 0 }, 2).expect("in the world"),
        service: Service::Reliable,
        bytes: vec![0; size],
    };
    let error = room
        .sender
        .offer(room.now, object(0))
        .expect_err("nothing to send");
    assert_eq!(
        error.to_string(),
        "object tile:-3/4/0@2 has 0 bytes, allowed are 1 to 4194304"
    );
    assert!(
        room.sender
            .offer(room.now, object(MAX_OBJECT_BYTES + 1))
            .is_err()
    );
}

#[test]
fn a_tile_s_id_survives_the_key() {
    for tile in [
        TileId { x: 0, y: 0, z: 0 },
        TileId { x: -1, y: 1, z: -1 },
        TileId {
            x: -(1 << 20),
            y: (1 << 20) - 1,
            z: -256,
        },
    ] {
        let id = ObjectId::of_tile(tile, 1).expect("21 bits");
        assert_eq!(id.tile(), Some(tile));
    }
    let far = TileId {
        x: 1 << 20,
        y: 0,
        z: 0,
    };
    assert_eq!(ObjectId::of_tile(far, 1), None);
}
