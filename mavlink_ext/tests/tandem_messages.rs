//! Every message of Tandem's own survives the wire, whatever its fields hold.

use mavlink_ext::dialect::tandem::{
    TANDEM_BEV_DATA, TANDEM_BOX_DATA, TANDEM_DIGEST_ACK_DATA, TANDEM_DIGEST_DATA,
    TANDEM_OBJECT_DATA, TANDEM_ORIGIN_DATA, TANDEM_REPORT_DATA, TANDEM_STATUS_DATA,
    TANDEM_SYMBOL_DATA,
};
use mavlink_ext::dialect::{CATALOGUE, MessageExt, TANDEM_IDS};
use mavlink_ext::{Address, Encoder, Message, RawFrame};
use proptest::collection::vec;
use proptest::prelude::*;

/// Eight bytes for each field, in the order in which [`Bytes`] takes them.
struct Bytes<'a>(std::iter::Cycle<std::slice::Iter<'a, u8>>);

impl Bytes<'_> {
    fn u8(&mut self) -> u8 {
        *self.0.next().expect("a cycle of at least one byte")
    }
    fn u16(&mut self) -> u16 {
        u16::from_le_bytes([self.u8(), self.u8()])
    }
    fn u32(&mut self) -> u32 {
        u32::from(self.u16()) << 16 | u32::from(self.u16())
    }
    fn u64(&mut self) -> u64 {
        u64::from(self.u32()) << 32 | u64::from(self.u32())
    }
    fn i32(&mut self) -> i32 {
        self.u32().cast_signed()
    }
    /// Any but NaN, which equals nothing, not even itself.
    fn f32(&mut self) -> f32 {
        let value = f32::from_bits(self.u32());
        if value.is_nan() { 0.5 } else { value }
    }
}

/// All of Tandem's messages, filled from these bytes.
fn messages(bytes: &[u8]) -> Vec<Message> {
    let b = &mut Bytes(bytes.iter().cycle());
    let mut messages = transport_messages(b).to_vec();
    messages.extend(digest_messages(b));
    messages.extend(perception_messages(b));
    messages
}

fn transport_messages(b: &mut Bytes<'_>) -> [Message; 5] {
    [
        Message::TANDEM_ORIGIN(TANDEM_ORIGIN_DATA {
            lat: b.i32(),
            lon: b.i32(),
            alt: b.i32(),
            epoch: b.u32(),
        }),
        Message::TANDEM_OBJECT(TANDEM_OBJECT_DATA {
            key: b.u64(),
            version: b.u64(),
            transfer: b.u32(),
            size: b.u32(),
            hash: b.u32(),
            deadline: b.u32(),
            target_system: b.u8(),
            target_component: b.u8(),
            stream: b.u8(),
            service: b.u8(),
            symbol_size: b.u8(),
        }),
        Message::TANDEM_SYMBOL(TANDEM_SYMBOL_DATA {
            transfer: b.u16(),
            symbol: b.u16(),
            target_system: b.u8(),
            target_component: b.u8(),
            data: std::array::from_fn(|_| b.u8()),
        }),
        Message::TANDEM_REPORT(TANDEM_REPORT_DATA {
            session: b.u32(),
            symbols: b.u32(),
            room: b.u32(),
            echo_age: b.u32(),
            echo_transfer: b.u16(),
            echo_symbol: b.u16(),
            transfers: std::array::from_fn(|_| b.u32()),
            received: std::array::from_fn(|_| b.u16()),
            missing: std::array::from_fn(|_| b.u16()),
            target_system: b.u8(),
            target_component: b.u8(),
            count: b.u8(),
            states: std::array::from_fn(|_| b.u8()),
        }),
        Message::TANDEM_STATUS(TANDEM_STATUS_DATA {
            time_usec: b.u64(),
            map_digest: b.u64(),
            voxels_occupied: b.u32(),
            tiles_known: b.u32(),
            tiles_delivered: b.u32(),
            frames: b.u32(),
            frames_tracked: b.u32(),
            queued: b.u32(),
            link_rate: b.u32(),
            frame_rate: b.u16(),
            latency_slam: b.u16(),
            latency_map: b.u16(),
            latency_delivery: b.u16(),
            loss: b.u16(),
            mode: b.u8(),
            mode_reason: b.u8(),
            tracking: b.u8(),
            flags: b.u8(),
        }),
    ]
}

fn digest_messages(b: &mut Bytes<'_>) -> [Message; 2] {
    [
        Message::TANDEM_DIGEST(TANDEM_DIGEST_DATA {
            salt: b.u32(),
            x: b.u32(),
            y: b.u32(),
            z: b.u32(),
            target_system: b.u8(),
            target_component: b.u8(),
            stream: b.u8(),
            level: b.u8(),
            hashes: std::array::from_fn(|_| b.u8()),
        }),
        Message::TANDEM_DIGEST_ACK(TANDEM_DIGEST_ACK_DATA {
            differing: b.u64(),
            salt: b.u32(),
            x: b.u32(),
            y: b.u32(),
            z: b.u32(),
            inner_x: b.u32(),
            inner_y: b.u32(),
            inner_z: b.u32(),
            target_system: b.u8(),
            target_component: b.u8(),
            stream: b.u8(),
            level: b.u8(),
            inner_level: b.u8(),
        }),
    ]
}

fn perception_messages(b: &mut Bytes<'_>) -> [Message; 2] {
    [
        Message::TANDEM_BEV(TANDEM_BEV_DATA {
            time_usec: b.u64(),
            frame: b.u32(),
            x: b.f32(),
            y: b.f32(),
            z: b.f32(),
            q: std::array::from_fn(|_| b.f32()),
            pose_covariance: std::array::from_fn(|_| b.f32()),
            cell: b.f32(),
            cells_x: b.u16(),
            cells_y: b.u16(),
            channels: b.u16(),
            codec: b.u8(),
            source: b.u8(),
        }),
        Message::TANDEM_BOX(TANDEM_BOX_DATA {
            time_usec: b.u64(),
            id: b.u32(),
            x: b.f32(),
            y: b.f32(),
            z: b.f32(),
            length: b.f32(),
            width: b.f32(),
            height: b.f32(),
            yaw: b.f32(),
            vx: b.f32(),
            vy: b.f32(),
            vz: b.f32(),
            covariance: std::array::from_fn(|_| b.f32()),
            score: b.f32(),
            class_id: b.u16(),
            source: b.u8(),
        }),
    ]
}

#[track_caller]
fn check_round_trip(message: &Message) {
    let mut encoder = Encoder::new(Address::new(1, 191));
    let frame = encoder.encode(message);
    let received = RawFrame::from_bytes(frame.bytes()).expect("we encoded it");
    assert_eq!(received.decode().as_ref(), Ok(message));
}

proptest! {
    #[test]
    fn every_message_round_trips(bytes in vec(any::<u8>(), 1..300)) {
        for message in messages(&bytes) {
            check_round_trip(&message);
        }
    }
}

#[test]
fn none_is_forgotten_here() {
    let tested: Vec<&str> = messages(&[0])
        .iter()
        .map(MessageExt::message_name)
        .collect();
    for info in CATALOGUE {
        let is_ours = TANDEM_IDS.contains(&info.id);
        assert_eq!(is_ours, tested.contains(&info.name), "{}", info.name);
        assert!(info.length <= 255);
    }
}

#[test]
fn trailing_zeros_do_not_travel() {
    let mut data = [0; 248];
    data[0] = 7;
    let symbol = Message::TANDEM_SYMBOL(TANDEM_SYMBOL_DATA {
        transfer: 1,
        symbol: 2,
        target_system: 255,
        target_component: 190,
        data,
    });
    let frame = Encoder::new(Address::new(1, 191)).encode(&symbol);
    assert_eq!(frame.bytes().len(), 12 + 2 + 2 + 2 + 1);
    check_round_trip(&symbol);
}
