//! `mavros_msgs/msg/Mavlink`: one frame that went over a link, as MAVROS passes them on.

use maps::time::Stamp;

use super::{CdrError, Reader, Schema, Writer, read_header, write_header};

/// A frame.
pub const MAVLINK: Schema = Schema {
    name: "mavros_msgs/msg/Mavlink",
    text: concat!(
        "std_msgs/Header header\nuint8 framing_status\nuint8 magic\nuint8 len\nuint8 incompat_flags\n",
        "uint8 compat_flags\nuint8 seq\nuint8 sysid\nuint8 compid\nuint32 msgid\nuint16 checksum\nuint64[] payload64\n",
        "uint8[] signature\n",
        header!()
    ),
};

/// A whole `MAVLink` 2 frame without its signature's link: header (10 bytes), payload, checksum (2), signature (0 or 13).
const HEADER: usize = 10;
const CHECKSUM: usize = 2;
const MAGIC: u8 = 0xfd;

/// The message of a whole `MAVLink` 2 frame, in CDR; `None` if the bytes are none.
pub fn encode_frame(at: Stamp, link: &str, frame: &[u8]) -> Option<Vec<u8>> {
    let (header, rest) = frame.split_at_checked(HEADER)?;
    let (payload, rest) = rest.split_at_checked(usize::from(header[1]))?;
    let (checksum, signature) = rest.split_at_checked(CHECKSUM)?;
    if header[0] != MAGIC {
        return None;
    }
    let mut writer = Writer::new();
    write_header(&mut writer, at, link);
    writer.u8(1); // FRAMING_OK
    for byte in &header[..7] {
        writer.u8(*byte);
    }
    writer.u32(u32::from_le_bytes([header[7], header[8], header[9], 0]));
    writer.u16(u16::from_le_bytes([checksum[0], checksum[1]]));
    writer.length(payload.len().div_ceil(8));
    for word in payload.chunks(8) {
        let mut bytes = [0; 8];
        bytes[..word.len()].copy_from_slice(word);
        writer.u64(u64::from_le_bytes(bytes));
    }
    writer.bytes(signature);
    Some(writer.finish())
}

/// The frame of a message, byte for byte; `None` if its payload is shorter than it says.
pub fn decode_frame(message: &[u8]) -> Result<Option<(Stamp, Vec<u8>)>, CdrError> {
    let mut reader = Reader::new(message)?;
    let (at, _link) = read_header(&mut reader)?;
    let _framing_status = reader.u8()?;
    let mut frame = Vec::new();
    for _ in 0..7 {
        frame.push(reader.u8()?);
    }
    let length = usize::from(frame[1]);
    frame.extend_from_slice(&reader.u32()?.to_le_bytes()[..3]);
    let checksum = reader.u16()?;
    let mut payload = Vec::new();
    for _ in 0..reader.u32()? {
        payload.extend_from_slice(&reader.u64()?.to_le_bytes());
    }
    let Some(payload) = payload.get(..length) else {
        return Ok(None);
    };
    frame.extend_from_slice(payload);
    frame.extend_from_slice(&checksum.to_le_bytes());
    frame.extend_from_slice(reader.bytes()?);
    Ok(Some((at, frame)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn frame(payload: &[u8], signature: &[u8]) -> Vec<u8> {
        let header = [MAGIC, payload.len() as u8, 1, 0, 42, 1, 191, 0x10, 0x27, 0];
        [&header, payload, &[0xab, 0xcd], signature].concat()
    }

    #[test]
    fn bytes_that_are_no_whole_frame_have_no_message() {
        let whole = frame(&[1, 2, 3], &[]);
        assert!(encode_frame(Stamp::ZERO, "uav", &whole).is_some());
        assert_eq!(encode_frame(Stamp::ZERO, "uav", &whole[..14]), None, "cut");
        let mut old = whole;
        old[0] = 0xfe;
        assert_eq!(encode_frame(Stamp::ZERO, "uav", &old), None, "MAVLink 1");
    }

    proptest! {
        #[test]
        fn a_frame_comes_back_byte_for_byte(payload in prop::collection::vec(any::<u8>(), 0..=255), signed: bool) {
            let whole = frame(&payload, if signed { &[7; 13] } else { &[] });
            let at = Stamp::from_nanos(3);
            let message = encode_frame(at, "uav", &whole).expect("a whole frame");
            prop_assert_eq!(decode_frame(&message), Ok(Some((at, whole))));
        }

        #[test]
        fn any_bytes_are_decoded_or_refused(mut message: Vec<u8>) {
            if let Some(header) = message.get_mut(..4) {
                header.copy_from_slice(&[0, 1, 0, 0]);
            }
            let _outcome = decode_frame(&message).is_ok();
        }
    }
}
