//! The object transport and its anti-entropy: a hostile sender at our receiver, and a hostile receiver at our sender.
#![no_main]

use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use maps::tile::TileId;
use maps::time::Stamp;
use mavlink_ext::object::digest::{Answerer, Asker, Item};
use mavlink_ext::object::{
    Object, ObjectId, Receiver, ReceiverLimits, Sender, SenderSettings, Service, StreamId,
};
use mavlink_ext::service::Ends;
use mavlink_ext::{Address, RawFrame};

const OWN: Address = Address::new(255, 190);
const UAV: Address = Address::new(1, 191);
const LIMIT: usize = 100_000;

fuzz_target!(|bytes: &[u8]| {
    let limits = ReceiverLimits {
        object_bytes: LIMIT,
        bytes: LIMIT,
        transfers: 16,
        ..ReceiverLimits::default()
    };
    let mut receiver = Receiver::new(OWN, 1, limits);
    let ends = Ends { own: UAV, peer: OWN };
    let mut sender = Sender::new(Stamp::ZERO, ends, 1, SenderSettings::default());
    for (key, service) in [
        Service::Reliable,
        Service::BestEffort,
        Service::Latest { deadline: Duration::from_secs(9) },
    ]
    .into_iter()
    .enumerate()
    {
        let id = ObjectId { stream: StreamId(key as u8), key: key as u64, version: 1 };
        let object = Object { id, service, bytes: vec![key as u8; 3000] };
        sender.offer(Stamp::ZERO, object).expect("room for it");
    }
    let mut asker = Asker::new(OWN, 1);
    let mut answerer = Answerer::default();
    for x in 0..20 {
        let tile = TileId { x, y: x % 3, z: 0 };
        answerer.has(tile, Item::new(1, &[]));
        asker.has(Stamp::ZERO, UAV, tile, Item::new(1 + u64::from(x > 15), &[]));
    }
    let mut now = Stamp::ZERO;
    let mut feed = |frames: &[u8]| {
        // The fuzzer cannot guess checksums: ours are put in.
        for message in messages(frames) {
            now += Duration::from_millis(7);
            receiver.handle(now, UAV, &message);
            assert!(receiver.bytes_under_way() <= LIMIT);
            sender.handle(now, OWN, &message);
            for sent in sender.tick(now).send {
                receiver.handle(now, UAV, &sent);
            }
            receiver.tick(now);
            asker.handle(now, UAV, &message);
            answerer.handle(now, ends, OWN, &message);
            for question in asker.tick(now) {
                answerer.handle(now, ends, OWN, &question);
            }
        }
    };
    feed(bytes);
});

/// Cuts the input into messages of the transport: which one, how long, and its payload.
fn messages(mut bytes: &[u8]) -> Vec<mavlink_ext::Message> {
    let mut messages = Vec::new();
    while let [kind, length, rest @ ..] = bytes {
        let payload = &rest[..usize::from(*length).min(rest.len())];
        bytes = &rest[payload.len()..];
        let id = [54101, 54102, 54103, 54104, 54107, 54108][usize::from(kind % 6)];
        messages.extend(RawFrame::new(UAV, 0, (id, payload)).decode().ok());
    }
    messages
}
