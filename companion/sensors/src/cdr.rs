//! The Common Data Representation in which ROS 2 puts messages on the wire and into files.
//!
//! Four bytes of encapsulation (`00 01 00 00`: plain CDR, little-endian) are followed by the fields in the order of
//! the message definition. A primitive of n bytes starts at a multiple of n, counted from the end of the
//! encapsulation; a string is its length with the final zero, its bytes and the zero; a sequence is its length and its
//! elements; an array of fixed length is its elements alone.
//!
//! The reader borrows from its input: a length that reaches beyond the end is an error before anything is allocated,
//! and no bytes make it panic.
//!
//! - OMG, *Common Object Request Broker Architecture* 3.3 part 2, §9.3 (CDR); *DDS-RTPS* 2.3, §10 (encapsulation).

/// Plain CDR, little-endian, no options.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Why bytes are not the message they should be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// The message does not start with the header of little-endian CDR.
    #[error("encapsulation {found:02x?} is not little-endian CDR (00 01)")]
    Encapsulation {
        /// The bytes in its place.
        found: Vec<u8>,
    },
    /// A field reaches beyond the end.
    #[error("message ends after {length} bytes, a field needs {needed} at byte {at}")]
    Short {
        /// Where the field starts.
        at: usize,
        /// How long it says it is.
        needed: usize,
        /// How long the message is.
        length: usize,
    },
    /// A string that is no UTF-8.
    #[error("string at byte {at} is not UTF-8")]
    Text {
        /// Where it starts.
        at: usize,
    },
}

/// Reads one message from front to back.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    /// What follows the encapsulation.
    body: &'a [u8],
    at: usize,
}

macro_rules! read_numbers {
    ($($name:ident: $type:ty),+ $(,)?) => {$(
        #[doc = concat!("The next `", stringify!($type), "`.")]
        pub fn $name(&mut self) -> Result<$type, CdrError> {
            self.align(size_of::<$type>());
            let bytes = self.array()?;
            Ok(<$type>::from_le_bytes(bytes))
        }
    )+};
}

impl<'a> Reader<'a> {
    /// Starts reading a message that begins with its encapsulation.
    pub fn new(message: &'a [u8]) -> Result<Self, CdrError> {
        match message.split_at_checked(ENCAPSULATION.len()) {
            // The last two bytes are options, which plain CDR ignores.
            Some((header, body)) if header[..2] == ENCAPSULATION[..2] => Ok(Self { body, at: 0 }),
            _ => Err(CdrError::Encapsulation {
                found: message.iter().take(4).copied().collect(),
            }),
        }
    }

    read_numbers!(u8: u8, i8: i8, u16: u16, u32: u32, u64: u64, f32: f32, f64: f64);

    /// The next `N` doubles: an array of fixed length.
    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N], CdrError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// The next sequence of doubles.
    pub fn f64_sequence(&mut self) -> Result<Vec<f64>, CdrError> {
        let length = self.u32()? as usize;
        if length == 0 {
            return Ok(Vec::new());
        }
        self.align(8);
        let bytes = self.take(length.saturating_mul(8))?;
        let (numbers, _) = bytes.as_chunks::<8>();
        Ok(numbers.iter().map(|&b| f64::from_le_bytes(b)).collect())
    }

    /// The next sequence of bytes.
    pub fn bytes(&mut self) -> Result<&'a [u8], CdrError> {
        let length = self.u32()? as usize;
        self.take(length)
    }

    /// The next string, without its final zero.
    pub fn string(&mut self) -> Result<&'a str, CdrError> {
        let at = self.at;
        let bytes = self.bytes()?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        std::str::from_utf8(text).map_err(|_utf8| CdrError::Text { at })
    }

    fn align(&mut self, size: usize) {
        self.at = self.at.next_multiple_of(size);
    }

    fn take(&mut self, needed: usize) -> Result<&'a [u8], CdrError> {
        let field = self
            .at
            .checked_add(needed)
            .and_then(|end| self.body.get(self.at..end));
        let field = field.ok_or(CdrError::Short {
            at: self.at + ENCAPSULATION.len(),
            needed,
            length: self.body.len() + ENCAPSULATION.len(),
        })?;
        self.at += needed;
        Ok(field)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], CdrError> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        Ok(bytes)
    }
}

/// Writes one message from front to back; the counterpart of [`Reader`].
#[derive(Clone, Debug)]
pub struct Writer {
    message: Vec<u8>,
}

impl Default for Writer {
    fn default() -> Self {
        Self::new()
    }
}

macro_rules! write_numbers {
    ($($name:ident: $type:ty),+ $(,)?) => {$(
        #[doc = concat!("Appends a `", stringify!($type), "`.")]
        pub fn $name(&mut self, value: $type) {
            self.align(size_of::<$type>());
            self.message.extend_from_slice(&value.to_le_bytes());
        }
    )+};
}

impl Writer {
    /// A message that holds its encapsulation only.
    pub fn new() -> Self {
        Self {
            message: ENCAPSULATION.to_vec(),
        }
    }

    write_numbers!(u8: u8, i8: i8, u16: u16, u32: u32, u64: u64, f32: f32, f64: f64);

    /// Appends an array of fixed length.
    pub fn f64s<const N: usize>(&mut self, values: [f64; N]) {
        for value in values {
            self.f64(value);
        }
    }

    /// Appends a sequence of doubles.
    pub fn f64_sequence(&mut self, values: &[f64]) {
        self.length(values.len());
        for &value in values {
            self.f64(value);
        }
    }

    /// Appends a sequence of bytes.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.length(bytes.len());
        self.message.extend_from_slice(bytes);
    }

    /// Appends a string.
    pub fn string(&mut self, text: &str) {
        self.length(text.len() + 1);
        self.message.extend_from_slice(text.as_bytes());
        self.message.push(0);
    }

    /// The finished message.
    pub fn finish(self) -> Vec<u8> {
        self.message
    }

    /// Appends the length of a sequence whose elements follow.
    pub fn length(&mut self, length: usize) {
        self.u32(u32::try_from(length).expect("a message is shorter than 4 GiB"));
    }

    fn align(&mut self, size: usize) {
        let body = (self.message.len() - ENCAPSULATION.len()).next_multiple_of(size);
        self.message.resize(ENCAPSULATION.len() + body, 0);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn fields_are_aligned_from_the_end_of_the_encapsulation() {
        let mut writer = Writer::new();
        writer.u8(7);
        writer.u32(0x0403_0201);
        writer.string("ab");
        writer.f64(1.0);
        #[rustfmt::skip]
        let expected = [
            0, 1, 0, 0,
            7, 0, 0, 0, 1, 2, 3, 4,
            3, 0, 0, 0, b'a', b'b', 0, 0,
            0, 0, 0, 0, 0, 0, 0xf0, 0x3f,
        ];
        assert_eq!(writer.finish(), expected);
    }

    #[test]
    fn a_length_beyond_the_end_is_refused_with_its_numbers() {
        let mut reader = Reader::new(&[0, 1, 0, 0, 255, 255, 255, 255, 1]).expect("header");
        assert_eq!(
            reader.bytes(),
            Err(CdrError::Short {
                at: 8,
                needed: 0xffff_ffff,
                length: 9
            })
        );
    }

    #[test]
    fn big_endian_and_empty_messages_are_refused() {
        for message in [&[][..], &[0, 1, 0], &[0, 0, 0, 0, 1]] {
            assert!(matches!(
                Reader::new(message),
                Err(CdrError::Encapsulation { .. })
            ));
        }
    }

    proptest! {
        #[test]
        fn what_was_written_is_read(
            byte: u8, word: u32, text in "\\PC{0,9}", numbers in prop::collection::vec(-1e9..1e9, 0..5), blob: Vec<u8>
        ) {
            let mut writer = Writer::new();
            writer.u8(byte);
            writer.string(&text);
            writer.f64_sequence(&numbers);
            writer.u32(word);
            writer.bytes(&blob);
            let message = writer.finish();
            let mut reader = Reader::new(&message).expect("own header");
            prop_assert_eq!(reader.u8(), Ok(byte));
            prop_assert_eq!(reader.string(), Ok(text.as_str()));
            prop_assert_eq!(reader.f64_sequence(), Ok(numbers));
            prop_assert_eq!(reader.u32(), Ok(word));
            prop_assert_eq!(reader.bytes(), Ok(blob.as_slice()));
        }

        #[test]
        fn any_bytes_are_read_or_refused(message: Vec<u8>, order in prop::collection::vec(0..7, 0..20)) {
            let Ok(mut reader) = Reader::new(&message) else { return Ok(()) };
            for field in order {
                let _outcome = match field {
                    0 => reader.u8().map(drop),
                    1 => reader.u32().map(drop),
                    2 => reader.f64().map(drop),
                    3 => reader.string().map(drop),
                    4 => reader.bytes().map(drop),
                    5 => reader.f64_sequence().map(drop),
                    _ => reader.f64s::<9>().map(drop),
                };
            }
        }
    }
}
