//! Telemetry logs as ground stations write them: before each frame the time in microseconds since 1970, big-endian.
//!
//! The format has no marks to synchronise on. The reader goes from frame to frame; where one is damaged it looks for the
//! next place at which a plausible time, a start byte and a right checksum stand one after another.

use std::io::{self, Read, Write};

use crate::dialect::message_info;
use crate::wire::{MAX_FRAME_BYTES, RawFrame, STX_V1, STX_V2};

const TIME_BYTES: usize = 8;
/// Read ahead so far: a whole record, and the beginning of the next.
const WINDOW: usize = 2 * TIME_BYTES + MAX_FRAME_BYTES + 1;
const CHUNK: usize = 64 * 1024;
/// The years 1970 to 2100, in microseconds: some recorders have no clock and start at 0.
const LAST_PLAUSIBLE_TIME: u64 = 4_102_444_800_000_000;

/// Why a part of a log could not be read. After [`TlogError::Damaged`] the reader goes on.
#[derive(Debug, thiserror::Error)]
pub enum TlogError {
    /// The source failed.
    #[error("cannot read the telemetry log")]
    Read(#[from] io::Error),
    /// Bytes that are no record.
    #[error("telemetry log is damaged at byte {offset}: {bytes} bytes skipped")]
    Damaged {
        /// Where in the log they start.
        offset: u64,
        /// How many they are.
        bytes: u64,
    },
}

/// Writes a telemetry log.
#[derive(Debug)]
pub struct TlogWriter<W> {
    out: W,
}

impl<W: Write> TlogWriter<W> {
    /// A log that starts here. Give it a buffered writer.
    pub fn new(out: W) -> Self {
        Self { out }
    }

    /// Adds a frame that was sent or received at this time.
    pub fn write(&mut self, unix_micros: u64, frame: &RawFrame) -> io::Result<()> {
        self.out.write_all(&unix_micros.to_be_bytes())?;
        self.out.write_all(frame.bytes())
    }

    /// Writes out what is buffered.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// The writer below.
    pub fn into_inner(self) -> W {
        self.out
    }
}

/// Reads a telemetry log, frame by frame.
#[derive(Debug)]
pub struct TlogReader<R> {
    source: R,
    buffer: Vec<u8>,
    /// Where in the buffer the next record starts.
    start: usize,
    /// Where in the log the buffer starts.
    offset: u64,
    ended: bool,
}

impl<R: Read> TlogReader<R> {
    /// Reads from the start of a log.
    pub fn new(source: R) -> Self {
        Self {
            source,
            buffer: Vec::new(),
            start: 0,
            offset: 0,
            ended: false,
        }
    }

    /// Has a whole record and the beginning of the next in the buffer, unless the log ends before.
    fn fill(&mut self) -> io::Result<()> {
        if self.ended || self.buffer.len() - self.start >= WINDOW {
            return Ok(());
        }
        self.buffer.drain(..self.start);
        self.offset += self.start as u64;
        self.start = 0;
        while !self.ended && self.buffer.len() < WINDOW {
            let length = self.buffer.len();
            self.buffer.resize(length + CHUNK, 0);
            let read = self.source.read(&mut self.buffer[length..]);
            let count = *read.as_ref().unwrap_or(&0);
            self.buffer.truncate(length + count);
            match read {
                Ok(count) => self.ended = count == 0,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// The record at the start of the unread bytes.
    fn record(&self) -> Option<(u64, RawFrame)> {
        let unread = &self.buffer[self.start..];
        let (time, rest) = unread.split_first_chunk::<TIME_BYTES>()?;
        let unix_micros = u64::from_be_bytes(*time);
        let length = match *rest {
            [STX_V1, payload, ..] => 8 + usize::from(payload),
            [STX_V2, payload, flags, ..] => {
                12 + usize::from(payload) + if flags & 1 == 0 { 0 } else { 13 }
            }
            _ => return None,
        };
        let frame = RawFrame::from_bytes(rest.get(..length)?).ok()?;
        let next = &rest[length..];
        // Without a checksum that we can verify, the next record must stand where this one ends.
        let sure = message_info(frame.message_id()).is_some()
            || next.is_empty()
            || matches!(next.get(TIME_BYTES), Some(&(STX_V1 | STX_V2)));
        (sure && unix_micros <= LAST_PLAUSIBLE_TIME).then_some((unix_micros, frame))
    }
}

impl<R: Read> Iterator for TlogReader<R> {
    type Item = Result<(u64, RawFrame), TlogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut skipped = 0;
        let damaged = |reader: &Self, bytes: u64| TlogError::Damaged {
            offset: reader.offset + reader.start as u64 - bytes,
            bytes,
        };
        loop {
            if let Err(error) = self.fill() {
                self.ended = true;
                self.buffer.clear();
                self.start = 0;
                return Some(Err(error.into()));
            }
            if self.start == self.buffer.len() {
                return (skipped > 0).then(|| Err(damaged(self, skipped)));
            }
            match self.record() {
                // Tell of the damage first; the record is found again.
                Some(_) if skipped > 0 => return Some(Err(damaged(self, skipped))),
                Some((time, frame)) => {
                    self.start += TIME_BYTES + frame.bytes().len();
                    return Some(Ok((time, frame)));
                }
                None => {
                    self.start += 1;
                    skipped += 1;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::path::Path;

    use proptest::prelude::*;

    use super::*;
    use crate::dialect::Message;
    use crate::dialect::tandem::{ATTITUDE_DATA, HEARTBEAT_DATA};
    use crate::wire::{Address, Encoder, WireError};

    type Record = (u64, RawFrame);

    fn log(frames: usize) -> (Vec<u8>, Vec<Record>) {
        let mut encoder = Encoder::new(Address::new(1, 1));
        let mut writer = TlogWriter::new(Vec::new());
        let mut records = Vec::new();
        for index in 0..frames {
            let message = if index % 2 == 0 {
                Message::HEARTBEAT(HEARTBEAT_DATA::default())
            } else {
                Message::ATTITUDE(ATTITUDE_DATA {
                    time_boot_ms: index as u32,
                    yaw: 1.0,
                    ..ATTITUDE_DATA::default()
                })
            };
            let record = (
                1_700_000_000_000_000 + index as u64,
                encoder.encode(&message),
            );
            writer
                .write(record.0, &record.1)
                .expect("memory takes it all");
            records.push(record);
        }
        (writer.into_inner(), records)
    }

    /// The records, and where how many bytes were damaged.
    fn read(bytes: &[u8]) -> (Vec<Record>, Vec<(u64, u64)>) {
        let mut records = Vec::new();
        let mut damage = Vec::new();
        for item in TlogReader::new(bytes) {
            match item {
                Ok(record) => records.push(record),
                Err(TlogError::Damaged { offset, bytes }) => damage.push((offset, bytes)),
                Err(TlogError::Read(error)) => panic!("memory does not fail: {error}"),
            }
        }
        (records, damage)
    }

    #[test]
    fn what_is_written_is_read() {
        let (bytes, records) = log(5000);
        assert_eq!(read(&bytes), (records, Vec::new()));
    }

    #[test]
    fn a_damaged_record_costs_itself_and_is_told() {
        let (mut bytes, records) = log(10);
        let third = records[..2]
            .iter()
            .map(|(_, frame)| 8 + frame.bytes().len())
            .sum::<usize>();
        bytes[third + 8 + 11] ^= 0xFF;
        let (found, damage) = read(&bytes);
        let length = 8 + records[2].1.bytes().len() as u64;
        assert_eq!(damage, [(third as u64, length)]);
        assert_eq!(found.len(), 9);
        assert_eq!(found[2], records[3]);
    }

    #[test]
    fn a_log_that_breaks_off_ends_with_the_last_whole_record() {
        let (bytes, records) = log(3);
        let (found, damage) = read(&bytes[..bytes.len() - 1]);
        assert_eq!(found, records[..2]);
        assert_eq!(damage.len(), 1);
    }

    proptest! {
        #[test]
        fn any_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
            read(&bytes);
        }

        #[test]
        fn any_damage_leaves_the_rest(at in 0usize..1000, length in 1usize..100, byte in any::<u8>()) {
            let (mut bytes, records) = log(100);
            bytes.splice(at..at, vec![byte; length]);
            let (found, _) = read(&bytes);
            prop_assert!(found.len() >= 98, "{} of 100", found.len());
            let lost = records.iter().filter(|record| !found.contains(record)).count();
            prop_assert!(lost <= 2, "{lost} lost");
        }
    }

    /// Frames, messages that the dialect has, and addresses in a recorded log; `None` where the data is not there.
    fn read_recording(name: &str) -> Option<(usize, usize, std::collections::BTreeSet<Address>)> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../shared/data/telemetry")
            .join(name);
        let Ok(file) = File::open(&path) else {
            println!("skipped: no {}", path.display());
            return None;
        };
        let mut frames = 0;
        let mut decoded = 0;
        let mut addresses = std::collections::BTreeSet::new();
        let mut last = 0;
        for record in TlogReader::new(file) {
            let (time, frame) = record.expect(name);
            assert!(time + 60_000_000 > last, "{name}: time goes on");
            last = time;
            frames += 1;
            addresses.insert(frame.from());
            match frame.decode() {
                Ok(_) => decoded += 1,
                Err(WireError::Unknown { .. }) => {}
                Err(error) => panic!("{name}: {error}"),
            }
        }
        Some((frames, decoded, addresses))
    }

    #[test]
    fn recorded_telemetry_is_read_without_a_bad_frame() {
        for (name, frames, vehicle) in [
            (
                "mavlink-server_00025-2024-04-22.tlog",
                30_439,
                Address::new(1, 1),
            ),
            ("rust-mavlink_log.tlog", 1_426, Address::new(1, 1)),
            ("sitl_copter_quad_mission.tlog", 4_445, Address::new(1, 1)),
            ("sitl_rover_mission.tlog", 3_958, Address::new(2, 1)),
        ] {
            if let Some((read, decoded, addresses)) = read_recording(name) {
                println!("{name}: {read} frames, {decoded} decoded, {addresses:?}");
                assert_eq!(read, frames, "{name}");
                assert!(
                    decoded * 10 > read * 8,
                    "{name}: {decoded} of {read} decoded"
                );
                assert!(addresses.contains(&vehicle), "{name}: {addresses:?}");
            }
        }
    }
}
