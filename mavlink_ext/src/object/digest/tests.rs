use std::collections::BTreeSet;
use std::time::Duration;

use maps::time::Stamp;
use proptest::collection::{btree_map, vec};
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::*;
use crate::dialect::tandem::{TANDEM_STATUS_DATA, TANDEM_SYMBOL_DATA};
use crate::wire::Encoder;

const UAV: Address = Address::new(1, 191);
const STATION: Address = Address::new(255, 190);
const ENDS: Ends = Ends {
    own: UAV,
    peer: STATION,
};
const TICK: Duration = Duration::from_millis(50);

fn tile(x: i32, y: i32, z: i32) -> TileId {
    TileId { x, y, z }
}

fn item(version: u64) -> Item {
    let content = version * 7;
    Item { version, content }
}

/// Both ends, and a link that loses some of what they say.
struct Room {
    now: Stamp,
    sender: Answerer,
    asker: Asker,
    loss: f64,
    random: Pcg64,
    /// The tiles that were asked for, in order.
    wanted: Vec<TileId>,
    /// Those that are said to be the same.
    same: BTreeSet<TileId>,
    messages: usize,
    bytes: usize,
}

impl Room {
    fn new(loss: f64) -> Self {
        Self {
            now: Stamp::ZERO,
            sender: Answerer::default(),
            asker: Asker::new(STATION, 1),
            loss,
            random: Pcg64::seed_from_u64(5),
            wanted: Vec::new(),
            same: BTreeSet::new(),
            messages: 0,
            bytes: 0,
        }
    }

    fn both_have(&mut self, tile: TileId) {
        self.sender.has(tile, item(1));
        self.asker.has(self.now, UAV, tile, item(1));
    }

    fn is_lost(&mut self) -> bool {
        self.random.random_bool(self.loss)
    }

    fn count(&mut self, message: &Message) {
        self.messages += 1;
        self.bytes += Encoder::new(UAV).encode(message).bytes().len();
    }

    fn step(&mut self) {
        self.now += TICK;
        let status = Message::TANDEM_STATUS(TANDEM_STATUS_DATA::default());
        self.asker.handle(self.now, UAV, &status);
        for question in self.asker.tick(self.now) {
            self.count(&question);
            if self.is_lost() {
                continue;
            }
            let answer = self.sender.handle(self.now, ENDS, STATION, &question);
            let Answer {
                message: reply,
                lacking,
                same,
            } = answer.expect("an answer");
            self.same.extend(same);
            for tile in lacking {
                if !self.wanted.contains(&tile) {
                    self.wanted.push(tile);
                }
            }
            self.count(&reply);
            if !self.is_lost() {
                self.asker.handle(self.now, UAV, &reply);
            }
        }
    }

    fn progress(&self) -> CatchUp {
        self.asker.progress(UAV).unwrap_or_default()
    }

    /// One round, to its end.
    fn run_round(&mut self) {
        let rounds = self.progress().rounds;
        for _ in 0..10_000 {
            self.step();
            if self.progress().rounds > rounds {
                return;
            }
        }
        panic!("no end: {:?}", self.asker);
    }
}

/// A map of 40 × 40 × 2 tiles around the world's origin.
fn map() -> impl Iterator<Item = TileId> {
    (0..3200).map(|i| tile(i % 40 - 20, i / 40 % 40 - 20, i / 1600))
}

#[test]
fn equal_maps_cost_one_question_and_one_answer() {
    let mut room = Room::new(0.0);
    map().for_each(|tile| room.both_have(tile));
    room.run_round();
    assert_eq!((room.messages, room.progress().lacking), (2, 0));
    assert_eq!(room.wanted, []);
    assert_eq!(room.same.len(), 3200);
    let before = room.bytes;
    for _ in 0..20 * 29 {
        room.step();
    }
    assert_eq!(room.bytes, before, "nothing for half a minute");
}

#[test]
fn what_differs_is_asked_for_and_nothing_else_over_a_link_that_loses_a_third() {
    let mut room = Room::new(0.33);
    map().for_each(|tile| room.both_have(tile));
    let changed = [
        tile(-20, 7, 0),
        tile(3, 3, 1),
        tile(4, 3, 1),
        tile(19, 19, 1),
    ];
    for tile in changed {
        room.sender.has(tile, item(2));
    }
    // Another start of the sender may have made something else of the same version.
    let remade = tile(-8, -8, 0);
    let content = 5;
    room.sender.has(remade, Item { content, ..item(1) });
    // New ground far away, and ground that only the receiver knows.
    let new = tile(-700, 4000, 3);
    room.sender.has(new, item(1));
    room.asker.has(room.now, UAV, tile(90, 90, 0), item(4));
    room.run_round();
    let wanted: BTreeSet<_> = room.wanted.iter().copied().collect();
    let expected: BTreeSet<_> = changed.into_iter().chain([remade, new]).collect();
    assert_eq!(wanted, expected);
    assert_eq!(room.same.len(), 3195);
    assert!(room.same.is_disjoint(&wanted));
    assert_eq!(room.progress().lacking, 6);
    assert!(
        room.bytes < 20_000,
        "{} bytes to find 6 of 3201 tiles",
        room.bytes
    );
}

#[test]
fn a_receiver_with_nothing_asks_for_everything_nearest_to_its_path_first() {
    let mut room = Room::new(0.1);
    for tile in map() {
        room.sender.has(tile, item(3));
    }
    let path: Vec<_> = (-20..0).map(|x| tile(x, 18, 0)).collect();
    room.asker.toward(&path);
    room.run_round();
    assert_eq!(room.wanted.len(), 3200);
    let away = |tile: &TileId| {
        let squares = path
            .iter()
            .map(|p| (p.x - tile.x).pow(2) + (p.y - tile.y).pow(2));
        f64::from(squares.min().unwrap_or(0)).sqrt()
    };
    let mean = |tiles: &[TileId]| tiles.iter().map(away).sum::<f64>() / tiles.len() as f64;
    let quarters: Vec<_> = room.wanted.chunks(800).map(mean).collect();
    assert!(
        quarters.is_sorted() && quarters[0] < quarters[3] / 4.0,
        "{quarters:?}"
    );
    // Three small messages for 64 tiles, each of which is several hundred bytes at least.
    assert!(room.bytes < 3200 * 10, "{} bytes", room.bytes);
}

#[test]
fn a_round_waits_for_what_arrives_but_not_for_ever() {
    let mut room = Room::new(0.0);
    room.sender.has(tile(0, 0, 0), item(1));
    room.run_round();
    let symbol = Message::TANDEM_SYMBOL(TANDEM_SYMBOL_DATA::default());
    let start = room.now;
    while room.progress().rounds == 1 {
        room.asker.handle(room.now, UAV, &symbol);
        room.step();
    }
    let waited = room.now.since(start);
    assert!((59..62).contains(&waited.as_secs()), "{waited:?}");
    let start = room.now;
    room.asker.has(room.now, UAV, tile(0, 0, 0), item(1));
    room.run_round();
    let waited = room.now.since(start);
    assert!((5..7).contains(&waited.as_secs()), "{waited:?}");
    assert_eq!(room.progress().lacking, 0);
}

#[test]
fn a_sender_that_comes_back_or_starts_anew_is_asked_at_once() {
    let mut room = Room::new(0.0);
    room.both_have(tile(1, 1, 1));
    room.run_round();
    room.sender.has(tile(1, 1, 1), item(2));
    room.now += Duration::from_secs(10);
    room.step();
    assert_eq!(room.messages, 4, "it was away");
    for _ in 0..40 {
        room.step();
    }
    room.sender.has(tile(2, 2, 2), item(1));
    let object = crate::dialect::tandem::TANDEM_OBJECT_DATA {
        transfer: 9 << 16 | 1,
        ..Default::default()
    };
    room.asker
        .handle(room.now, UAV, &Message::TANDEM_OBJECT(object));
    room.step();
    room.step();
    assert!(room.wanted.contains(&tile(2, 2, 2)));
}

#[test]
fn a_sender_that_does_not_answer_is_asked_seldom_and_one_that_is_gone_is_not() {
    let mut room = Room::new(1.0);
    room.both_have(tile(1, 1, 1));
    for _ in 0..20 * 60 {
        room.step();
    }
    assert!(room.messages <= 60, "{}", room.messages);
    let before = room.messages;
    for _ in 0..20 * 60 {
        room.now += TICK;
        room.messages += room.asker.tick(room.now).len();
    }
    assert!(room.messages - before <= 4, "{}", room.messages - before);
}

#[test]
fn answers_to_other_questions_and_of_strangers_change_nothing() {
    let mut room = Room::new(0.0);
    room.both_have(tile(1, 1, 1));
    room.now += TICK;
    let status = Message::TANDEM_STATUS(TANDEM_STATUS_DATA::default());
    room.asker.handle(room.now, UAV, &status);
    let question = room.asker.tick(room.now).remove(0);
    let stranger = Address::new(9, 9);
    assert_eq!(
        room.sender.handle(room.now, ENDS, stranger, &question),
        None
    );
    let answer = room.sender.handle(room.now, ENDS, STATION, &question);
    let Some(Message::TANDEM_DIGEST_ACK(right)) = answer.map(|answer| answer.message) else {
        panic!("an answer")
    };
    for level in [0, 1, 3, 4, 23, 255] {
        let wrong = TANDEM_DIGEST_ACK_DATA {
            level,
            differing: u64::MAX,
            ..right.clone()
        };
        room.asker
            .handle(room.now, UAV, &Message::TANDEM_DIGEST_ACK(wrong));
    }
    let wrong = TANDEM_DIGEST_ACK_DATA {
        salt: !right.salt,
        differing: u64::MAX,
        ..right.clone()
    };
    room.asker
        .handle(room.now, UAV, &Message::TANDEM_DIGEST_ACK(wrong));
    room.asker.handle(
        room.now,
        Address::new(2, 191),
        &Message::TANDEM_DIGEST_ACK(right.clone()),
    );
    assert_eq!(room.asker.tick(room.now), []);
    assert_eq!(room.progress().rounds, 0);
    room.asker
        .handle(room.now, UAV, &Message::TANDEM_DIGEST_ACK(right));
    assert_eq!(room.asker.tick(room.now), []);
    assert_eq!(room.progress().rounds, 1);
}

#[test]
fn a_flood_of_questions_is_answered_at_a_bounded_rate() {
    let mut sender = Answerer::default();
    let question = question(UAV, &Inventory::default(), Region::WORLD, 1);
    let answers = |ms: u64| {
        let now = Stamp::ZERO + Duration::from_millis(ms);
        let all = (0..1000).map(|_| sender.handle(now, ENDS, STATION, &question));
        all.flatten().count()
    };
    assert_eq!([0, 100, 5000].map(answers), [100, 10, 100]);
}

fn any_tile() -> impl Strategy<Value = TileId> {
    let c = prop_oneof![-5..5, -(1 << 20)..1 << 20];
    [c.clone(), c.clone(), c].prop_map(|[x, y, z]| tile(x, y, z))
}

proptest! {
    #[test]
    fn both_ends_agree_on_regions_wherever_tiles_are(tiles in btree_map(any_tile(), 0..3_u64, 1..60)) {
        let mut all = Inventory::default();
        for (tile, version) in &tiles {
            prop_assert!(all.insert(*tile, item(*version)));
        }
        prop_assert_eq!(all.len(), tiles.len());
        let bounds = all.bounds(Region::WORLD).expect("there are tiles");
        for (tile, version) in &tiles {
            prop_assert_eq!(all.get(*tile), Some(item(*version)));
            prop_assert_eq!(bounds.distance_squared(*tile), 0);
            // From the world down to the tile, through parts that differ from nothing.
            let mut region = Region::WORLD;
            while region.level > Region::LEAST_LEVEL {
                let differing = all.differing(region, 1, &[0; HASHES]);
                let parts = (0..HASHES).filter(|part| differing >> part & 1 == 1);
                let part = parts.filter_map(|part| region.part(part)).find(|part| part.distance_squared(*tile) == 0);
                let part = part.expect("its part differs");
                prop_assert!(region.contains(part) && !part.contains(region));
                region = part;
            }
            let differing = all.differing(region, 1, &[0; HASHES]);
            prop_assert!(all.tiles_of(region, differing).contains(tile));
        }
        let hashes = all.hashes(bounds, 3);
        prop_assert_eq!(unpacked(&packed(&hashes)), hashes);
        prop_assert_eq!(all.differing(bounds, 3, &hashes), 0);
    }

    #[test]
    fn any_question_gets_an_answer_or_none(level in any::<u8>(), at in any::<[u32; 3]>(), hashes in vec(any::<u8>(), 192)) {
        let mut sender = Answerer::default();
        map().take(100).for_each(|tile| { sender.has(tile, item(1)); });
        let mut digest = TANDEM_DIGEST_DATA { level, x: at[0], y: at[1], z: at[2], ..Default::default() };
        digest.hashes.copy_from_slice(&hashes);
        let question = Message::TANDEM_DIGEST(digest);
        let answer = sender.handle(Stamp::ZERO, ENDS, STATION, &question);
        prop_assert!(answer.is_none_or(|answer| answer.lacking.len() <= 64));
    }
}

#[test]
fn tiles_out_of_this_world_are_not_noted() {
    let mut inventory = Inventory::default();
    assert!(!inventory.insert(tile(1 << 20, 0, 0), item(1)));
    assert!(inventory.insert(tile((1 << 20) - 1, -(1 << 20), 0), item(1)));
    inventory.remove(tile((1 << 20) - 1, -(1 << 20), 0));
    assert!(inventory.is_empty());
}
