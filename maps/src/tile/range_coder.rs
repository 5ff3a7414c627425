//! An adaptive binary range coder: each bit costs `-log₂` of the probability that its [`Bit`] gave it.
//!
//! ```text
//! p ← p + (bit - p) / (n + 1.5)        n = bits seen so far, up to a limit: learns fast first, then follows slowly
//! ```
//!
//! - G. N. N. Martin, *Range encoding*, Video & Data Recording Conference, 1979.
//! - I. Pavlov's LZMA for the 32-bit range with a late carry; its probabilities adapt at one fixed rate instead.

/// Bits of a probability.
const PRECISION: u32 = 16;
/// Below this the range is too coarse for a probability: shift out a byte.
const SHORT: u32 = 1 << 24;
/// What the encoder writes at the end, and so what the decoder has read at the start.
const FLUSH: usize = 4;

/// A context's belief about its next bit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bit {
    /// Probability of a one, in 1 / 65536.
    one: u16,
    seen: u8,
}

impl Bit {
    pub(super) const NEW: Self = Self {
        one: 1 << (PRECISION - 1),
        seen: 0,
    };
    /// Low, as what is seen in one corner of a tile tells little of another.
    const LIMIT: u8 = 30;
    /// No bit may cost nothing, or the range could run empty.
    const LEAST: i32 = 24;

    fn learn(&mut self, bit: bool) {
        let target = if bit {
            (1 << PRECISION) - Self::LEAST
        } else {
            Self::LEAST
        };
        let error = target - i32::from(self.one);
        let step = error * 2 / (2 * i32::from(self.seen) + 3);
        self.one = (i32::from(self.one) + step) as u16;
        self.seen = (self.seen + 1).min(Self::LIMIT);
    }
}

/// Either direction, so that one model serves both: an encoder writes the bit it is given and gives it back, a decoder
/// ignores it and gives the one it reads.
pub(super) trait Coder {
    /// A bit that is one with probability `one` / 65536, which must be neither 0 nor 1.
    fn code(&mut self, one: u16, bit: bool) -> bool;

    /// A bit of which its context tells the probability.
    fn bit(&mut self, context: &mut Bit, bit: bool) -> bool {
        let bit = self.code(context.one, bit);
        context.learn(bit);
        bit
    }

    /// Whether more was asked for than there is.
    fn is_exhausted(&self) -> bool;

    /// The lowest `bits` of `value`, highest first; each node of the binary tree of prefixes is a context of its own.
    fn tree(&mut self, nodes: &mut [Bit], bits: u32, value: u8) -> u8 {
        let mut node = 1;
        for shift in (0..bits).rev() {
            let bit = self.bit(&mut nodes[node], value >> shift & 1 == 1);
            node = node << 1 | usize::from(bit);
        }
        (node - (1 << bits)) as u8
    }
}

/// The part of the range that stands for a one.
fn split(range: u32, one: u16) -> u32 {
    (range >> PRECISION) * u32::from(one)
}

/// Bits to bytes.
#[derive(Debug)]
pub(super) struct Encoder {
    low: u64,
    range: u32,
    bytes: Vec<u8>,
}

impl Encoder {
    /// Appends to these bytes.
    pub(super) fn new(bytes: Vec<u8>) -> Self {
        Self {
            low: 0,
            range: u32::MAX,
            bytes,
        }
    }

    pub(super) fn finish(mut self) -> Vec<u8> {
        for _ in 0..FLUSH {
            self.shift();
        }
        self.bytes
    }

    /// Writes the top byte of the low end; a carry goes into the bytes already written.
    fn shift(&mut self) {
        if self.low >> 32 != 0 {
            for byte in self.bytes.iter_mut().rev() {
                let (sum, carried) = byte.overflowing_add(1);
                *byte = sum;
                if !carried {
                    break;
                }
            }
        }
        self.bytes.push((self.low >> 24) as u8);
        self.low = (self.low & 0x00ff_ffff) << 8;
    }
}

impl Coder for Encoder {
    fn code(&mut self, one: u16, bit: bool) -> bool {
        let split = split(self.range, one);
        if bit {
            self.range = split;
        } else {
            self.low += u64::from(split);
            self.range -= split;
        }
        while self.range < SHORT {
            self.shift();
            self.range <<= 8;
        }
        bit
    }

    fn is_exhausted(&self) -> bool {
        false
    }
}

/// Bytes to bits.
#[derive(Debug)]
pub(super) struct Decoder<'a> {
    code: u32,
    range: u32,
    bytes: &'a [u8],
    /// Bytes made up after the end.
    missing: usize,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self {
            code: 0,
            range: u32::MAX,
            bytes,
            missing: 0,
        };
        for _ in 0..FLUSH {
            decoder.shift();
        }
        decoder
    }

    /// Whether it read exactly what an encoder wrote.
    pub(super) fn is_complete(&self) -> bool {
        self.bytes.is_empty() && self.missing == 0
    }

    fn shift(&mut self) {
        let byte = self.bytes.split_off_first().copied();
        self.missing += usize::from(byte.is_none());
        self.code = self.code << 8 | u32::from(byte.unwrap_or(0));
    }
}

impl Coder for Decoder<'_> {
    fn code(&mut self, one: u16, _: bool) -> bool {
        let split = split(self.range, one);
        let bit = self.code < split;
        if bit {
            self.range = split;
        } else {
            // Never below zero: the first bytes of any input are below the first range.
            self.code -= split;
            self.range -= split;
        }
        while self.range < SHORT {
            self.shift();
            self.range <<= 8;
        }
        bit
    }

    fn is_exhausted(&self) -> bool {
        self.missing > 0
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bits_come_back_and_all_bytes_are_read(bits in prop::collection::vec((0..4_usize, any::<bool>()), 0..2000)) {
            let mut encoder = Encoder::new(b"before".to_vec());
            let mut contexts = [Bit::NEW; 4];
            for &(context, bit) in &bits {
                encoder.bit(&mut contexts[context], bit);
            }
            let bytes = encoder.finish();
            let Some(bytes) = bytes.strip_prefix(b"before") else {
                return Err(TestCaseError::fail("a carry went too far"));
            };
            let mut decoder = Decoder::new(bytes);
            let mut contexts = [Bit::NEW; 4];
            for &(context, bit) in &bits {
                prop_assert_eq!(decoder.bit(&mut contexts[context], false), bit);
            }
            prop_assert!(decoder.is_complete());
        }

        #[test]
        fn any_bytes_are_some_bits(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            let mut decoder = Decoder::new(&bytes);
            let mut contexts = [Bit::NEW; 256];
            for _ in 0..10_000 {
                decoder.tree(&mut contexts, 8, 0);
            }
            prop_assert!(decoder.is_exhausted());
        }
    }

    #[test]
    fn a_million_equal_bits_cost_next_to_nothing() {
        for bit in [false, true] {
            let mut encoder = Encoder::new(Vec::new());
            let mut context = Bit::NEW;
            for _ in 0..1_000_000 {
                encoder.bit(&mut context, bit);
            }
            let size = encoder.finish().len();
            assert!(size < 600, "{size} bytes");
        }
    }
}
