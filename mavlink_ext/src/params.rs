//! The parameter protocol, both ends: <https://mavlink.io/en/services/parameter.html>.
//!
//! A value travels in a float: flight controllers of ArduPilot cast it, those of PX4 put its bytes there.
//! `AUTOPILOT_VERSION.capabilities` tells which.

mod client;
mod packed;
mod server;

use crate::dialect::tandem::{MavParamType, MavProtocolCapability};
use crate::dialect::{CharArray, char_array};

pub use client::{Client, ClientEvent, ParamError};
pub use packed::{PACKED_PATH, PackedError, pack, unpack};
pub use server::{Changed, Server};

/// Characters of a name.
pub const NAME_BYTES: usize = 16;

/// How values travel in a float.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As the nearest float: ArduPilot, and us.
    Cast,
    /// As the bytes of the integer: PX4.
    Bytes,
}

impl Encoding {
    /// What a vehicle with these capabilities uses.
    pub fn of(capabilities: MavProtocolCapability) -> Self {
        let bytes = MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE;
        if capabilities.contains(bytes) {
            Self::Bytes
        } else {
            Self::Cast
        }
    }

    /// The float that carries the value.
    pub fn encode(self, kind: MavParamType, value: f64) -> f32 {
        match (self, kind) {
            (Self::Cast, _) | (_, MavParamType::MAV_PARAM_TYPE_REAL32) => value as f32,
            (Self::Bytes, _) if value < 0.0 => f32::from_bits(value as i32 as u32),
            (Self::Bytes, _) => f32::from_bits(value as u32),
        }
    }

    /// The value that the float carries.
    pub fn decode(self, kind: MavParamType, wire: f32) -> f64 {
        let bits = wire.to_bits();
        match (self, kind) {
            (Self::Cast, _) | (_, MavParamType::MAV_PARAM_TYPE_REAL32) => f64::from(wire),
            (Self::Bytes, MavParamType::MAV_PARAM_TYPE_UINT8) => f64::from(bits as u8),
            (Self::Bytes, MavParamType::MAV_PARAM_TYPE_INT8) => f64::from(bits as i8),
            (Self::Bytes, MavParamType::MAV_PARAM_TYPE_UINT16) => f64::from(bits as u16),
            (Self::Bytes, MavParamType::MAV_PARAM_TYPE_INT16) => f64::from(bits as i16),
            (Self::Bytes, MavParamType::MAV_PARAM_TYPE_INT32) => f64::from(bits.cast_signed()),
            (Self::Bytes, _) => f64::from(bits),
        }
    }
}

/// One parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Its name, at most [`NAME_BYTES`] characters.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// The type that the vehicle stores it in.
    pub kind: MavParamType,
}

impl Parameter {
    /// A parameter that is stored as a float.
    pub fn real(name: &str, value: f64) -> Self {
        Self {
            name: name.to_owned(),
            value,
            kind: MavParamType::MAV_PARAM_TYPE_REAL32,
        }
    }

    /// A parameter that is stored as a 32-bit integer.
    pub fn integer(name: &str, value: i32) -> Self {
        Self {
            name: name.to_owned(),
            value: f64::from(value),
            kind: MavParamType::MAV_PARAM_TYPE_INT32,
        }
    }
}

fn to_wire_name(name: &str) -> CharArray<NAME_BYTES> {
    char_array(name)
}

/// The name in a message; `None` if it is not text.
fn from_wire_name(name: &CharArray<NAME_BYTES>) -> Option<String> {
    let name = name.to_str().ok()?;
    (!name.is_empty()).then(|| name.to_owned())
}

#[cfg(test)]
mod tests;
