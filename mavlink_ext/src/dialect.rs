//! The messages of `dialects/tandem.xml` and everything it includes, generated at build time.
//!
//! Message fields that hold a command (`MAV_CMD`) are plain integers, see [`cmd`] for those we use; other enumerations
//! of the common dialect are Rust enums, and a message with a value outside them cannot be decoded.

#[expect(
    missing_docs,
    clippy::all,
    clippy::pedantic,
    clippy::restriction,
    reason = "generated from the XML, which carries the documentation"
)]
mod generated {
    include!(concat!(env!("OUT_DIR"), "/mod.rs"));
}

pub mod cmd;

pub use generated::tandem;
pub use generated::tandem::MavMessage as Message;
/// What every message can tell about itself, such as its id and name.
pub use mavlink_core::Message as MessageExt;
pub use mavlink_core::MessageData;
pub use mavlink_core::types::CharArray;

/// What a frame's header does not say about a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageInfo {
    /// Message id.
    pub id: u32,
    /// Name as in the XML, such as `HEARTBEAT`.
    pub name: &'static str,
    /// The byte that seeds the checksum with the message's definition.
    pub crc_extra: u8,
    /// Payload bytes in MAVLink 1.
    pub length_without_extensions: usize,
    /// Payload bytes in MAVLink 2 before trailing zeros are dropped.
    pub length: usize,
    /// Where the payload holds the target system, if it does.
    pub target_system: Option<usize>,
    /// Where the payload holds the target component, if it does.
    pub target_component: Option<usize>,
}

/// All messages of the dialect, in ascending order of their ids.
pub const CATALOGUE: &[MessageInfo] = include!(concat!(env!("OUT_DIR"), "/catalogue.rs"));

/// Message ids of Tandem's own messages.
pub const TANDEM_IDS: std::ops::RangeInclusive<u32> = 54_100..=54_199;

/// What is known of the message with this id; `None` if the dialect does not have it.
pub fn message_info(id: u32) -> Option<&'static MessageInfo> {
    CATALOGUE
        .binary_search_by_key(&id, |info| info.id)
        .ok()
        .map(|index| &CATALOGUE[index])
}

/// The fixed-size text field that holds `text`, cut where it does not fit.
pub fn char_array<const N: usize>(text: &str) -> CharArray<N> {
    let mut bytes = [0; N];
    for (to, from) in bytes.iter_mut().zip(text.bytes()) {
        *to = from;
    }
    CharArray::new(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_catalogue_agrees_with_the_generated_code() {
        for info in CATALOGUE {
            assert_eq!(info.crc_extra, Message::extra_crc(info.id), "{}", info.name);
            let message = Message::default_message_from_id(info.id).expect(info.name);
            assert_eq!(message.message_name(), info.name);
        }
        assert!(CATALOGUE.windows(2).all(|pair| pair[0].id < pair[1].id));
    }

    #[test]
    fn checksum_seeds_are_those_that_pymavlink_computes() {
        let seeds: Vec<u8> = (54_100..54_109).map(Message::extra_crc).collect();
        assert_eq!(seeds, [118, 226, 117, 21, 78, 41, 234, 16, 45]);
    }

    #[test]
    fn target_offsets_point_at_what_the_generated_code_writes_there() {
        for info in CATALOGUE {
            let mut message = Message::default_message_from_id(info.id).expect(info.name);
            if let Some(system) = message.target_system_id_mut() {
                *system = 0xA5;
            }
            if let Some(component) = message.target_component_id_mut() {
                *component = 0x5A;
            }
            let mut payload = [0; 255];
            message.ser(mavlink_core::MavlinkVersion::V2, &mut payload);
            assert_eq!(
                message.target_system_id(),
                info.target_system.map(|at| payload[at])
            );
            assert_eq!(
                message.target_component_id(),
                info.target_component.map(|at| payload[at])
            );
        }
    }

    #[test]
    fn text_that_does_not_fit_is_cut() {
        assert_eq!(char_array::<4>("ab").to_str(), Ok("ab"));
        assert_eq!(char_array::<4>("abcdef").to_str(), Ok("abcd"));
    }
}
