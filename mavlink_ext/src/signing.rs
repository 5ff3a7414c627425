//! Signed frames: who does not have the key is not heard.
//!
//! A MAVLink 2 frame may end with 13 bytes: a link id, a timestamp and the first 48 bits of a SHA-256 over the key and the
//! frame. The timestamps of a stream (system, component, link id) grow, so that a recorded frame is not taken twice.
//! <https://mavlink.io/en/guide/message_signing.html>
//!
//! - The timestamp counts 10 µs since 2015. It must not go back when the program restarts with a wrong clock: the highest one
//!   is kept in a file beside the key, and the next start begins a minute after it ([`KeyFile`]).
//! - `RADIO_STATUS` comes from the radio itself, which has no key: it is taken unsigned under every policy.
//! - A frame that somebody else signed is forwarded as it is; an unsigned one is signed when it leaves by a link that asks for it.

mod file;

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use mavlink_core::MavlinkVersion;
use sha2::{Digest as _, Sha256};

use crate::wire::{Address, RawFrame, SIGNATURE_BYTES};

pub use file::{KeyError, KeyFile};

/// A stream that was not heard before must not be older than this.
const MAX_AGE: Timestamp = Timestamp::from_duration(Duration::from_mins(1));
/// Streams whose timestamps are remembered. Only who has the key can begin one.
const MAX_STREAMS: usize = 1024;
const RADIO_STATUS: u32 = 109;

/// 10 µs since the beginning of 2015, 48 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Timestamp(u64);

impl Timestamp {
    /// From 1970 to 2015.
    const EPOCH: Duration = Duration::from_hours(394_464);
    const MAX: u64 = (1 << 48) - 1;

    /// Of a time since 1970, as the system's clock has it; the lowest before 2015.
    pub const fn from_unix(time: Duration) -> Self {
        Self::from_duration(time.saturating_sub(Self::EPOCH))
    }

    pub(crate) const fn from_duration(span: Duration) -> Self {
        let ticks = span.as_micros() / 10;
        Self(if ticks > Self::MAX as u128 {
            Self::MAX
        } else {
            ticks as u64
        })
    }

    fn from_bytes(bytes: [u8; 6]) -> Self {
        let [a, b, c, d, e, f] = bytes;
        Self(u64::from_le_bytes([a, b, c, d, e, f, 0, 0]))
    }

    fn to_bytes(self) -> [u8; 6] {
        let [a, b, c, d, e, f, ..] = self.0.to_le_bytes();
        [a, b, c, d, e, f]
    }

    pub(crate) fn plus(self, span: Self) -> Self {
        Self((self.0 + span.0).min(Self::MAX))
    }
}

/// What both ends know and nobody else.
#[derive(Clone, PartialEq, Eq)]
pub struct SigningKey([u8; 32]);

impl SigningKey {
    /// A key of these bytes.
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// A new one, from the system's source of chance; its error if that fails.
    pub fn random() -> std::io::Result<Self> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes)?;
        Ok(Self(bytes))
    }
}

/// Shows nothing of it.
impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SigningKey(..)")
    }
}

/// What is asked of the frames of a link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// Signatures are neither made nor looked at.
    #[default]
    Off,
    /// Frames are signed; unsigned ones are taken, wrongly signed ones are not.
    Accepted,
    /// Frames are signed, and only signed ones are taken.
    Required,
}

/// Why a frame was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Rejection {
    /// It has no signature.
    #[error("not signed")]
    Unsigned,
    /// Another key, or changed on the way.
    #[error("signed with another key, or changed on the way")]
    WrongKey,
    /// It was heard before, or is an old one of a new stream.
    #[error(
        "older than what was heard before: a recording, or a clock that is wrong by more than a minute"
    )]
    Replayed,
}

/// Frames since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SigningStats {
    /// Taken, with a right signature.
    pub signed: u64,
    /// Taken without one.
    pub unsigned: u64,
    /// See [`Rejection::Unsigned`].
    pub rejected_unsigned: u64,
    /// See [`Rejection::WrongKey`].
    pub rejected_wrong_key: u64,
    /// See [`Rejection::Replayed`].
    pub rejected_replayed: u64,
    /// Frames of MAVLink 1 that could not be signed and were not sent.
    pub unsignable: u64,
}

/// Signs what leaves by a link, and checks what comes in.
#[derive(Clone, Debug)]
pub struct Signing {
    policy: Policy,
    key: SigningKey,
    link_id: u8,
    /// The highest used or heard.
    timestamp: Timestamp,
    streams: BTreeMap<(Address, u8), Timestamp>,
    stats: SigningStats,
}

impl Signing {
    /// For one link. Timestamps begin after `after`, see [`KeyFile::begin`].
    pub fn new(policy: Policy, key: SigningKey, link_id: u8, after: Timestamp) -> Self {
        Self {
            policy,
            key,
            link_id,
            timestamp: after,
            streams: BTreeMap::new(),
            stats: SigningStats::default(),
        }
    }

    /// The highest timestamp used or heard: to be kept, see [`KeyFile::keep`].
    pub fn timestamp(&self) -> Timestamp {
        self.timestamp
    }

    /// Counts.
    pub fn stats(&self) -> SigningStats {
        self.stats
    }

    /// The frame as it leaves by this link; `None` if it has to be signed and is one of MAVLink 1, which cannot be.
    pub fn sign(&mut self, clock: Timestamp, frame: RawFrame) -> Option<RawFrame> {
        if self.policy == Policy::Off || frame.is_signed() {
            return Some(frame);
        }
        if frame.version() == MavlinkVersion::V1 {
            let goes = self.policy == Policy::Accepted;
            self.stats.unsignable += u64::from(!goes);
            return goes.then_some(frame);
        }
        self.timestamp = self.timestamp.plus(Timestamp(1)).max(clock);
        let mut signature = [0; SIGNATURE_BYTES];
        signature[0] = self.link_id;
        signature[1..7].copy_from_slice(&self.timestamp.to_bytes());
        let frame = frame.with_signature(signature);
        let hash = self.hash(&frame);
        signature[7..].copy_from_slice(&hash);
        Some(frame.with_signature(signature))
    }

    /// Whether a frame that came by this link is taken.
    pub fn check(&mut self, clock: Timestamp, frame: &RawFrame) -> Result<(), Rejection> {
        let checked = self.checked(clock, frame);
        let count = match checked {
            Ok(true) => &mut self.stats.signed,
            Ok(false) => &mut self.stats.unsigned,
            Err(Rejection::Unsigned) => &mut self.stats.rejected_unsigned,
            Err(Rejection::WrongKey) => &mut self.stats.rejected_wrong_key,
            Err(Rejection::Replayed) => &mut self.stats.rejected_replayed,
        };
        *count += 1;
        checked.map(|_| ())
    }

    /// Whether it is taken for its signature.
    fn checked(&mut self, clock: Timestamp, frame: &RawFrame) -> Result<bool, Rejection> {
        let exempt = self.policy != Policy::Required || frame.message_id() == RADIO_STATUS;
        let Some(signature) = frame.signature().filter(|_| self.policy != Policy::Off) else {
            return if exempt {
                Ok(false)
            } else {
                Err(Rejection::Unsigned)
            };
        };
        let (link_id, stamp, hash) = (signature[0], &signature[1..7], &signature[7..]);
        // In constant time: how far a guess was right must not be measurable.
        let expected = self.hash(frame);
        let differs = hash
            .iter()
            .zip(expected)
            .fold(0, |all, (a, b)| all | (a ^ b));
        if differs != 0 {
            return Err(Rejection::WrongKey);
        }
        let mut bytes = [0; 6];
        bytes.copy_from_slice(stamp);
        let stamp = Timestamp::from_bytes(bytes);
        let stream = (frame.from(), link_id);
        let is_fresh = match self.streams.get(&stream) {
            Some(last) => stamp > *last,
            None => stamp.plus(MAX_AGE) >= self.timestamp.max(clock),
        };
        if !is_fresh || (self.streams.len() >= MAX_STREAMS && !self.streams.contains_key(&stream)) {
            return Err(Rejection::Replayed);
        }
        self.streams.insert(stream, stamp);
        self.timestamp = self.timestamp.max(stamp);
        Ok(true)
    }

    fn hash(&self, signed: &RawFrame) -> [u8; 6] {
        let bytes = signed.bytes();
        let mut sha = Sha256::new();
        sha.update(self.key.0);
        sha.update(&bytes[..bytes.len() - 6]);
        let hash = sha.finalize();
        let mut first = [0; 6];
        first.copy_from_slice(&hash[..6]);
        first
    }
}

#[cfg(test)]
mod tests;
