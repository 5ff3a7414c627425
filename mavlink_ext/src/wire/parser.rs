//! Finds frames in a stream of bytes, and finds its way back after damage.

use super::{MAX_FRAME_BYTES, RawFrame, STX_V1, STX_V2, WireError, frame_length};

/// Cuts a stream of bytes into frames. [`Parser::push`] bytes, then take frames until there is none: it is an iterator
/// that goes on after `None` when more bytes have come.
///
/// After a bad frame it looks for the next start byte inside that frame's bytes, so that one damaged frame costs no
/// other. A start byte that stands in noise may make it wait for at most [`MAX_FRAME_BYTES`].
#[derive(Debug, Default)]
pub struct Parser {
    buffer: Vec<u8>,
    /// Where in the buffer the unread bytes start.
    start: usize,
    bad_frames: u64,
    skipped_bytes: u64,
}

impl Parser {
    /// A parser that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds bytes that came in. Memory grows by what is pushed until the frames are taken.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.start);
        self.start = 0;
        self.buffer.extend_from_slice(bytes);
    }

    /// Forgets an unfinished frame, as at the end of a datagram, and counts it as bad.
    pub fn finish(&mut self) {
        if self.start < self.buffer.len() {
            self.bad_frames += 1;
        }
        self.buffer.clear();
        self.start = 0;
    }

    /// Frames with a wrong checksum, with unknown flags or cut off.
    pub fn bad_frames(&self) -> u64 {
        self.bad_frames
    }

    /// Bytes that belonged to no good frame.
    pub fn skipped_bytes(&self) -> u64 {
        self.skipped_bytes
    }

    fn skip(&mut self, count: usize) {
        self.start += count;
        self.skipped_bytes += count as u64;
    }
}

impl Iterator for Parser {
    type Item = Result<RawFrame, WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        let unread = &self.buffer[self.start..];
        let noise = unread
            .iter()
            .position(|byte| matches!(*byte, STX_V1 | STX_V2))
            .unwrap_or(unread.len());
        self.skip(noise);
        let unread = &self.buffer[self.start..];
        let length = match frame_length(unread) {
            Ok(length) => length?,
            Err(error) => {
                self.bad_frames += 1;
                self.skip(1);
                return Some(Err(error));
            }
        };
        debug_assert!(length <= MAX_FRAME_BYTES);
        let bytes = unread.get(..length)?;
        match RawFrame::from_bytes(bytes) {
            Ok(frame) => {
                self.start += length;
                Some(Ok(frame))
            }
            Err(error) => {
                self.bad_frames += 1;
                self.skip(1);
                Some(Err(error))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::dialect::tandem::{ATTITUDE_DATA, HEARTBEAT_DATA};
    use crate::dialect::{CATALOGUE, Message, MessageExt as _};
    use crate::wire::{Address, Encoder};

    fn three_frames() -> Vec<RawFrame> {
        let mut encoder = Encoder::new(Address::new(1, 1));
        let attitude = ATTITUDE_DATA {
            roll: 0.5,
            ..ATTITUDE_DATA::default()
        };
        [
            Message::HEARTBEAT(HEARTBEAT_DATA::default()),
            Message::ATTITUDE(attitude),
            Message::HEARTBEAT(HEARTBEAT_DATA::default()),
        ]
        .iter()
        .map(|message| encoder.encode(message))
        .collect()
    }

    fn joined(frames: &[RawFrame]) -> Vec<u8> {
        frames.iter().flat_map(RawFrame::bytes).copied().collect()
    }

    #[test]
    fn frames_come_out_however_the_stream_is_cut() {
        let frames = three_frames();
        let bytes = joined(&frames);
        for step in 1..bytes.len() {
            let mut parser = Parser::new();
            let mut found = Vec::new();
            for piece in bytes.chunks(step) {
                parser.push(piece);
                found.extend(parser.by_ref().flatten());
            }
            assert_eq!(found, frames, "pieces of {step} bytes");
            assert_eq!((parser.bad_frames(), parser.skipped_bytes()), (0, 0));
        }
    }

    #[test]
    fn one_damaged_byte_costs_one_frame() {
        let frames = three_frames();
        let damaged_at = frames[0].bytes().len() + 12;
        let mut bytes = joined(&frames);
        bytes[damaged_at] ^= 0x10;
        let mut parser = Parser::new();
        parser.push(&bytes);
        let found: Vec<_> = parser.by_ref().flatten().collect();
        assert_eq!(found, [frames[0].clone(), frames[2].clone()]);
        assert_eq!(parser.bad_frames(), 1);
        assert_eq!(parser.skipped_bytes(), frames[1].bytes().len() as u64);
    }

    #[test]
    fn an_unknown_incompatibility_flag_refuses_the_frame() {
        let mut bytes = joined(&three_frames());
        bytes[2] = 0x02;
        let mut parser = Parser::new();
        parser.push(&bytes);
        assert_eq!(parser.next(), Some(Err(WireError::Flags { flags: 2 })));
        assert_eq!(parser.flatten().count(), 2);
    }

    #[test]
    fn a_message_outside_the_dialect_stays_a_raw_frame() {
        // ardupilotmega's AHRS (163), which common.xml does not have.
        let bytes = [0xFE, 2, 9, 1, 1, 163, 7, 8, 0xAB, 0xCD];
        let frame = RawFrame::from_bytes(&bytes).expect("its checksum cannot be known");
        assert_eq!(frame.decode(), Err(WireError::Unknown { id: 163 }));
        assert_eq!((frame.from(), frame.sequence()), (Address::new(1, 1), 9));
        assert_eq!(frame.payload(), [7, 8]);
        assert_eq!(frame.target(), None);
    }

    proptest! {
        #[test]
        fn any_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let mut parser = Parser::new();
            parser.push(&bytes);
            for frame in parser.by_ref().flatten() {
                drop((frame.target(), frame.decode(), format!("{frame:?}")));
            }
            parser.finish();
        }

        #[test]
        fn any_payload_of_any_message_never_panics(
            message in prop::sample::select(CATALOGUE.to_vec()), payload in prop::collection::vec(any::<u8>(), 0..=255),
            version_1 in any::<bool>()
        ) {
            let length = payload.len() as u8;
            let mut bytes = if version_1 && message.id < 256 {
                vec![STX_V1, length, 0, 1, 1, message.id as u8]
            } else {
                let [low, middle, high, _] = message.id.to_le_bytes();
                vec![STX_V2, length, 0, 0, 0, 1, 1, low, middle, high]
            };
            bytes.extend(&payload);
            let crc = mavlink_core::calculate_crc(&bytes[1..], message.crc_extra);
            bytes.extend(crc.to_le_bytes());
            let frame = RawFrame::from_bytes(&bytes).expect("its checksum is right");
            drop((frame.target(), frame.decode()));
        }
    }

    #[test]
    fn every_message_of_the_dialect_survives_the_wire() {
        let mut encoder = Encoder::new(Address::new(7, 9));
        for info in CATALOGUE {
            let message = Message::default_message_from_id(info.id).expect(info.name);
            let frame = encoder.encode(&message);
            let received = RawFrame::from_bytes(frame.bytes()).expect(info.name);
            assert_eq!(received.decode(), Ok(message));
            assert_eq!(received.from(), Address::new(7, 9));
        }
    }
}
