//! Frames as they travel: addresses, MAVLink 1 and 2 framing, checksums.
//!
//! A [`RawFrame`] keeps its bytes, so that a router forwards unchanged what it does not understand; [`RawFrame::decode`]
//! makes a message of it. <https://mavlink.io/en/guide/serialization.html>

mod parser;

use std::fmt;

use mavlink_core::error::ParserError;
use mavlink_core::{MavlinkVersion, calculate_crc};

use crate::dialect::{Message, MessageExt as _, message_info};

pub use parser::Parser;

/// First byte of a MAVLink 1 frame.
pub const STX_V1: u8 = 0xFE;
/// First byte of a MAVLink 2 frame.
pub const STX_V2: u8 = 0xFD;
/// Bytes that a signature adds to a frame.
pub const SIGNATURE_BYTES: usize = 13;
/// No frame is longer: header, payload, checksum and signature of MAVLink 2.
pub const MAX_FRAME_BYTES: usize = 10 + 255 + 2 + SIGNATURE_BYTES;

/// The one incompatibility flag of MAVLink 2 that we can handle: a signature follows.
const FLAG_SIGNED: u8 = 0x01;

/// A vehicle or ground station in the MAVLink network, 1..=255; 0 means all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SystemId(pub u8);

/// A part of a system, 1..=255; 0 means all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ComponentId(pub u8);

impl SystemId {
    /// What ground stations use by convention.
    pub const GROUND_STATION: Self = Self(255);
}

impl ComponentId {
    /// All components of a system.
    pub const ALL: Self = Self(0);
    /// `MAV_COMP_ID_AUTOPILOT1`.
    pub const AUTOPILOT: Self = Self(1);
    /// `MAV_COMP_ID_MISSIONPLANNER`, which ground stations use.
    pub const GROUND_STATION: Self = Self(190);
    /// `MAV_COMP_ID_ONBOARD_COMPUTER`.
    pub const COMPANION: Self = Self(191);
}

/// One end of a MAVLink conversation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address {
    /// The system.
    pub system: SystemId,
    /// Its component.
    pub component: ComponentId,
}

impl Address {
    /// Everybody.
    pub const ALL: Self = Self::new(0, 0);

    /// The address `system/component`.
    pub const fn new(system: u8, component: u8) -> Self {
        Self {
            system: SystemId(system),
            component: ComponentId(component),
        }
    }

    /// Whether a message for `target` concerns this address: exactly, or as one of all.
    pub fn is_addressed_by(self, target: Self) -> bool {
        (target.system.0 == 0 || target.system == self.system)
            && (target.component.0 == 0 || target.component == self.component)
    }
}

/// As in `1/191`.
impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.system.0, self.component.0)
    }
}

/// Why bytes are no frame, or a frame no message.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// The checksum does not fit: damaged on the way, or from another version of the message's definition.
    #[error("message {id} has checksum {stored:04x}, computed is {computed:04x}")]
    Checksum {
        /// Message id.
        id: u32,
        /// What the frame says.
        stored: u16,
        /// What it should say.
        computed: u16,
    },
    /// The frame needs a feature that we do not have.
    #[error("frame with unknown incompatibility flags {flags:#04x}")]
    Flags {
        /// All incompatibility flags of the frame.
        flags: u8,
    },
    /// Not one whole frame.
    #[error("{length} bytes are not one MAVLink frame")]
    Framing {
        /// How many bytes there were.
        length: usize,
    },
    /// The message is not in the dialect.
    #[error("message {id} is not in the dialect")]
    Unknown {
        /// Message id.
        id: u32,
    },
    /// A field holds a value that the dialect does not know, or the payload is too long.
    #[error("{name} cannot be decoded: {reason}")]
    Content {
        /// The message's name.
        name: &'static str,
        /// What the generated code says.
        reason: String,
    },
}

/// One complete frame of MAVLink 1 or 2, its checksum verified if the dialect has the message.
#[derive(Clone, PartialEq, Eq)]
pub struct RawFrame {
    bytes: Box<[u8]>,
}

impl RawFrame {
    /// The frame of MAVLink 2 that carries a message of the dialect, by its id and payload of at most 255 bytes.
    pub fn new(from: Address, sequence: u8, (id, payload): (u32, &[u8])) -> Self {
        let payload = &payload[..payload.len().min(255)];
        let [id_low, id_middle, id_high, _] = id.to_le_bytes();
        let mut bytes = Vec::with_capacity(payload.len() + 12);
        bytes.extend([STX_V2, payload.len() as u8, 0, 0, sequence]);
        bytes.extend([from.system.0, from.component.0]);
        bytes.extend([id_low, id_middle, id_high]);
        bytes.extend(payload);
        let crc = calculate_crc(&bytes[1..], Message::extra_crc(id));
        bytes.extend(crc.to_le_bytes());
        Self {
            bytes: bytes.into(),
        }
    }

    /// The frame that these bytes are, exactly.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let framing = WireError::Framing {
            length: bytes.len(),
        };
        if frame_length(bytes)? != Some(bytes.len()) {
            return Err(framing);
        }
        let frame = Self {
            bytes: bytes.into(),
        };
        frame.verify()?;
        Ok(frame)
    }

    fn verify(&self) -> Result<(), WireError> {
        let id = self.message_id();
        let Some(info) = message_info(id) else {
            return Ok(()); // The seed of the checksum is part of the definition, which we do not have.
        };
        let end = self.payload_start() + self.payload().len();
        let computed = calculate_crc(&self.bytes[1..end], info.crc_extra);
        let stored = u16::from_le_bytes([self.bytes[end], self.bytes[end + 1]]);
        if computed == stored {
            Ok(())
        } else {
            Err(WireError::Checksum {
                id,
                stored,
                computed,
            })
        }
    }

    /// Which MAVLink it is.
    pub fn version(&self) -> MavlinkVersion {
        if self.bytes[0] == STX_V1 {
            MavlinkVersion::V1
        } else {
            MavlinkVersion::V2
        }
    }

    fn payload_start(&self) -> usize {
        match self.version() {
            MavlinkVersion::V1 => 6,
            MavlinkVersion::V2 => 10,
        }
    }

    /// Who sent it.
    pub fn from(&self) -> Address {
        match self.version() {
            MavlinkVersion::V1 => Address::new(self.bytes[3], self.bytes[4]),
            MavlinkVersion::V2 => Address::new(self.bytes[5], self.bytes[6]),
        }
    }

    /// The sender's count of its frames on this link, modulo 256.
    pub fn sequence(&self) -> u8 {
        match self.version() {
            MavlinkVersion::V1 => self.bytes[2],
            MavlinkVersion::V2 => self.bytes[4],
        }
    }

    /// Which message it carries.
    pub fn message_id(&self) -> u32 {
        match self.version() {
            MavlinkVersion::V1 => u32::from(self.bytes[5]),
            MavlinkVersion::V2 => {
                u32::from_le_bytes([self.bytes[7], self.bytes[8], self.bytes[9], 0])
            }
        }
    }

    /// Whom it is for. `None` if it is for everybody: target system 0, no such field, or a message not in the dialect.
    pub fn target(&self) -> Option<Address> {
        let info = message_info(self.message_id())?;
        let at = |offset: usize| self.payload().get(offset).copied().unwrap_or(0);
        let system = at(info.target_system?);
        let component = info.target_component.map_or(0, at);
        (system != 0).then(|| Address::new(system, component))
    }

    /// Whether it carries a signature.
    pub fn is_signed(&self) -> bool {
        self.version() == MavlinkVersion::V2 && self.bytes[2] & FLAG_SIGNED != 0
    }

    /// The 13 bytes of its signature: link id, timestamp, hash.
    pub(crate) fn signature(&self) -> Option<&[u8]> {
        let bytes = &self.bytes;
        self.is_signed()
            .then(|| &bytes[bytes.len() - SIGNATURE_BYTES..])
    }

    /// This frame of MAVLink 2 with a signature, in place of one that it may have. Of any message, also one that is not in
    /// the dialect.
    pub(crate) fn with_signature(&self, signature: [u8; SIGNATURE_BYTES]) -> Self {
        let end = self.payload_start() + self.payload().len();
        let mut bytes = self.bytes[..end + 2].to_vec();
        if !self.is_signed() {
            bytes[2] |= FLAG_SIGNED;
            // The checksum covers the flag, and its seed may be unknown; but since checksums are linear, that of the flag
            // alone tells the difference, whatever the seed.
            let nothing = vec![0; end - 1];
            let mut flag = nothing.clone();
            flag[1] = FLAG_SIGNED;
            let change = calculate_crc(&nothing, 0) ^ calculate_crc(&flag, 0);
            let [low, high] = change.to_le_bytes();
            bytes[end] ^= low;
            bytes[end + 1] ^= high;
        }
        bytes.extend(signature);
        Self {
            bytes: bytes.into(),
        }
    }

    /// The message's fields as they travel; MAVLink 2 drops trailing zeros.
    pub fn payload(&self) -> &[u8] {
        let start = self.payload_start();
        &self.bytes[start..start + usize::from(self.bytes[1])]
    }

    /// The message.
    pub fn decode(&self) -> Result<Message, WireError> {
        let id = self.message_id();
        let info = message_info(id).ok_or(WireError::Unknown { id })?;
        Message::parse(self.version(), id, self.payload()).map_err(|error| match error {
            ParserError::UnknownMessage { id } => WireError::Unknown { id },
            error => WireError::Content {
                name: info.name,
                reason: error.to_string(),
            },
        })
    }

    /// The whole frame.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

impl fmt::Debug for RawFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let id = self.message_id();
        write!(f, "RawFrame({} from {}, ", id, self.from())?;
        match message_info(id) {
            Some(info) => write!(f, "{}", info.name)?,
            None => f.write_str("unknown")?,
        }
        write!(f, ", {} bytes)", self.bytes.len())
    }
}

/// How long the frame is that starts with `bytes`; `None` if there are too few of them to know.
fn frame_length(bytes: &[u8]) -> Result<Option<usize>, WireError> {
    match *bytes {
        [STX_V1, payload, ..] => Ok(Some(6 + usize::from(payload) + 2)),
        [STX_V2, payload, flags, ..] => {
            // "If any flag is not understood, the packet must be dropped": even its length may be another.
            if flags & !FLAG_SIGNED != 0 {
                return Err(WireError::Flags { flags });
            }
            let signature = if flags & FLAG_SIGNED == 0 {
                0
            } else {
                SIGNATURE_BYTES
            };
            Ok(Some(10 + usize::from(payload) + 2 + signature))
        }
        [] | [STX_V1 | STX_V2] | [STX_V2, _] => Ok(None),
        _ => Err(WireError::Framing {
            length: bytes.len(),
        }),
    }
}

/// Makes MAVLink 2 frames of one sender's messages.
#[derive(Clone, Debug)]
pub struct Encoder {
    from: Address,
    sequence: u8,
}

impl Encoder {
    /// Frames from this address, counted from 0.
    pub fn new(from: Address) -> Self {
        Self { from, sequence: 0 }
    }

    /// Whose frames they are.
    pub fn address(&self) -> Address {
        self.from
    }

    /// The next frame.
    pub fn encode(&mut self, message: &Message) -> RawFrame {
        let mut payload = [0; 255];
        let length = message.ser(MavlinkVersion::V2, &mut payload);
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        RawFrame::new(
            self.from,
            sequence,
            (message.message_id(), &payload[..length]),
        )
    }
}
