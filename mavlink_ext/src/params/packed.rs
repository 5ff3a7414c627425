//! All parameters in one file, `@PARAM/param.pck`, which clients fetch by MAVLink FTP: a hundred times faster than one message
//! each on a link with delay. The format is ArduPilot's.
//!
//! ```text
//! file      = magic 0x671B, number of parameters here, number of all: u16 each, little-endian
//!             parameter …
//! parameter = zeros to skip, type (low 4 bits) and flags, bytes shared with the last name (low 4 bits) and further ones less
//!             one, the further bytes, value
//! type      = 1: i8, 2: i16, 3: i32, 4: f32
//! ```

use crate::dialect::tandem::MavParamType;

use super::{NAME_BYTES, Parameter};

/// Where clients look for it.
pub const PACKED_PATH: &str = "@PARAM/param.pck";
const MAGIC: u16 = 0x671B;
/// The same with default values.
const MAGIC_WITH_DEFAULTS: u16 = 0x671C;

/// Why bytes are no file of parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PackedError {
    /// Another file, or another version of the format.
    #[error("not a file of packed parameters: it begins with {magic:#06x}")]
    Magic {
        /// Its first two bytes.
        magic: u16,
    },
    /// It ends too early, or says so many and has others.
    #[error("the file of parameters says it has {said}, {found} were found")]
    Count {
        /// What it says.
        said: usize,
        /// What it has.
        found: usize,
    },
    /// A parameter that cannot be read.
    #[error("parameter {number} of the file is damaged")]
    Damaged {
        /// Which, from 0.
        number: usize,
    },
}

/// The file of these parameters, in this order. Names longer than [`NAME_BYTES`] are cut.
pub fn pack(parameters: &[Parameter]) -> Vec<u8> {
    let count = parameters.len().min(usize::from(u16::MAX));
    let mut file = Vec::new();
    for number in [MAGIC, count as u16, count as u16] {
        file.extend(number.to_le_bytes());
    }
    let mut last: &[u8] = &[];
    for parameter in &parameters[..count] {
        let name = parameter.name.as_bytes();
        let name = &name[..name.len().min(NAME_BYTES)];
        // One byte of the name always follows, and both counts have 4 bits.
        let same = last.iter().zip(name).take_while(|(a, b)| a == b).count();
        let shared = same.min(name.len().saturating_sub(1)).min(15);
        let rest = &name[shared..];
        let (kind, value) = packed_value(parameter);
        file.push(kind);
        file.push((shared as u8) | (rest.len().saturating_sub(1) as u8) << 4);
        file.extend(rest);
        file.extend(value);
        last = name;
    }
    file
}

fn packed_value(parameter: &Parameter) -> (u8, Vec<u8>) {
    let value = parameter.value;
    match parameter.kind {
        MavParamType::MAV_PARAM_TYPE_INT8 => (1, (value as i8).to_le_bytes().to_vec()),
        MavParamType::MAV_PARAM_TYPE_INT16 | MavParamType::MAV_PARAM_TYPE_UINT8 => {
            (2, (value as i16).to_le_bytes().to_vec())
        }
        MavParamType::MAV_PARAM_TYPE_INT32 | MavParamType::MAV_PARAM_TYPE_UINT16 => {
            (3, (value as i32).to_le_bytes().to_vec())
        }
        _ => (4, (value as f32).to_le_bytes().to_vec()),
    }
}

/// The parameters of a file.
pub fn unpack(file: &[u8]) -> Result<Vec<Parameter>, PackedError> {
    let header = |place: usize| {
        let bytes = [file.get(place), file.get(place + 1)];
        bytes.map(|byte| byte.copied().unwrap_or(0))
    };
    let magic = u16::from_le_bytes(header(0));
    let with_defaults = magic == MAGIC_WITH_DEFAULTS;
    if magic != MAGIC && !with_defaults {
        return Err(PackedError::Magic { magic });
    }
    let said = usize::from(u16::from_le_bytes(header(2)));
    let mut rest = file.get(6..).unwrap_or_default();
    let mut parameters: Vec<Parameter> = Vec::new();
    let mut last: Vec<u8> = Vec::new();
    loop {
        let zeros = rest.iter().take_while(|byte| **byte == 0).count();
        rest = &rest[zeros..];
        if rest.is_empty() {
            break;
        }
        let number = parameters.len();
        let (parameter, name, length) =
            unpack_one(rest, &last, with_defaults).ok_or(PackedError::Damaged { number })?;
        parameters.push(parameter);
        last = name;
        rest = &rest[length..];
    }
    let found = parameters.len();
    if found == said {
        Ok(parameters)
    } else {
        Err(PackedError::Count { said, found })
    }
}

/// The parameter at the start of these bytes, the bytes of its name, and how many there were of it.
fn unpack_one(
    bytes: &[u8],
    last: &[u8],
    with_defaults: bool,
) -> Option<(Parameter, Vec<u8>, usize)> {
    let [head, lengths, ..] = *bytes else {
        return None;
    };
    let shared = last.get(..usize::from(lengths & 0x0F))?;
    let further = usize::from(lengths >> 4) + 1;
    let mut name = shared.to_vec();
    name.extend(bytes.get(2..2 + further)?);
    let (kind, size) = match head & 0x0F {
        1 => (MavParamType::MAV_PARAM_TYPE_INT8, 1),
        2 => (MavParamType::MAV_PARAM_TYPE_INT16, 2),
        3 => (MavParamType::MAV_PARAM_TYPE_INT32, 4),
        4 => (MavParamType::MAV_PARAM_TYPE_REAL32, 4),
        _ => return None,
    };
    let start = 2 + further;
    let value = match *bytes.get(start..start + size)? {
        [a] => f64::from(i8::from_le_bytes([a])),
        [a, b] => f64::from(i16::from_le_bytes([a, b])),
        [a, b, c, d] if head & 0x0F == 3 => f64::from(i32::from_le_bytes([a, b, c, d])),
        [a, b, c, d] => f64::from(f32::from_le_bytes([a, b, c, d])),
        _ => return None,
    };
    let default = if with_defaults && head & 0x10 != 0 {
        size
    } else {
        0
    };
    let length = start + size + default;
    if name.len() > NAME_BYTES || bytes.len() < length {
        return None;
    }
    let text = String::from_utf8(name.clone()).ok()?;
    let parameter = Parameter {
        name: text,
        value,
        kind,
    };
    Some((parameter, name, length))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn names_share_their_beginnings() {
        let parameters = [
            Parameter::real("ATC_ACCEL_MAX", 0.5),
            Parameter::real("ATC_ACCEL_MIN", 0.0),
            Parameter::integer("BATT", -3),
        ];
        let file = pack(&parameters);
        assert_eq!(file.len(), 6 + (2 + 13 + 4) + (2 + 2 + 4) + (2 + 4 + 4));
        assert_eq!(unpack(&file), Ok(parameters.to_vec()));
    }

    #[test]
    fn what_is_no_such_file_is_refused() {
        assert_eq!(unpack(&[]), Err(PackedError::Magic { magic: 0 }));
        let file = pack(&[Parameter::real("A", 1.0), Parameter::real("B", 1.0)]);
        let cut = unpack(&file[..file.len() - 1]);
        assert_eq!(cut, Err(PackedError::Damaged { number: 1 }));
        let short = unpack(&file[..6 + 7]);
        assert_eq!(short, Err(PackedError::Count { said: 2, found: 1 }));
    }

    proptest! {
        #[test]
        fn any_parameters_come_back(
            all in prop::collection::vec(("[A-Z][A-Z0-9_]{0,15}", any::<i32>(), any::<bool>()), 0..40)
        ) {
            let all: Vec<Parameter> = all.into_iter().map(|(name, value, is_real)| {
                if is_real { Parameter::real(&name, f64::from(value as f32 / 7.0)) } else { Parameter::integer(&name, value) }
            }).collect();
            prop_assert_eq!(unpack(&pack(&all)), Ok(all));
        }

        #[test]
        fn any_bytes_never_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..200), with_defaults in any::<bool>()) {
            let _any = unpack(&bytes);
            bytes.splice(..0, if with_defaults { [0x1C, 0x67, 3, 0, 3, 0] } else { [0x1B, 0x67, 3, 0, 3, 0] });
            let _any = unpack(&bytes);
        }
    }
}
