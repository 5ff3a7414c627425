//! One object as `RaptorQ` symbols, and back. One source block, no sub-blocks: every symbol helps the whole object.

use raptorq::{
    EncodingPacket, ObjectTransmissionInformation, PayloadId, SourceBlockDecoder,
    SourceBlockEncoder,
};

use super::{MAX_OBJECT_BYTES, SYMBOL_BYTES};

/// Source symbols of the largest object; what a smaller symbol size may split it into as well.
pub(super) const MAX_SYMBOLS: usize = MAX_OBJECT_BYTES.div_ceil(SYMBOL_BYTES);
/// The code fails in 1 of 100 blocks with exactly K symbols, and 100 times less often with each one more. Where it
/// still fails after this many, symbols are forged.
const MAX_ATTEMPTS: u32 = 8;

/// Source symbols of an object; `None` if the numbers are not allowed.
pub(super) fn source_symbols(size: usize, symbol_bytes: usize) -> Option<u32> {
    let allowed = (1..=MAX_OBJECT_BYTES).contains(&size)
        && (8..=SYMBOL_BYTES).contains(&symbol_bytes)
        && symbol_bytes.is_multiple_of(8);
    let symbols = allowed.then(|| size.div_ceil(symbol_bytes))?;
    (symbols <= MAX_SYMBOLS).then_some(symbols as u32)
}

fn block(size: usize, symbol_bytes: usize) -> ObjectTransmissionInformation {
    ObjectTransmissionInformation::new(size as u64, symbol_bytes as u16, 1, 1, 8)
}

/// Makes symbols of an object. Source symbols cost nothing; the first repair symbol costs a solve.
pub(super) struct Fountain {
    symbol_bytes: usize,
    repair: Option<SourceBlockEncoder>,
}

impl Fountain {
    /// Of symbols of an allowed size.
    pub(super) fn new(symbol_bytes: usize) -> Self {
        Self {
            symbol_bytes,
            repair: None,
        }
    }

    /// Symbol `id` of these bytes, which must be the same each time; zeros behind it.
    pub(super) fn symbol(&mut self, bytes: &[u8], id: u16) -> [u8; SYMBOL_BYTES] {
        let symbol_bytes = self.symbol_bytes;
        let mut symbol = [0; SYMBOL_BYTES];
        let start = id as usize * symbol_bytes;
        if let Some(source) = bytes.get(start..).filter(|source| !source.is_empty()) {
            let length = source.len().min(symbol_bytes);
            symbol[..length].copy_from_slice(&source[..length]);
            return symbol;
        }
        let repair = self.repair.get_or_insert_with(|| {
            let mut padded = bytes.to_vec();
            padded.resize(bytes.len().next_multiple_of(symbol_bytes), 0);
            SourceBlockEncoder::new(0, &block(bytes.len(), symbol_bytes), &padded)
        });
        let first_repair = bytes.len().div_ceil(symbol_bytes) as u32;
        for packet in repair.repair_packets(u32::from(id) - first_repair, 1) {
            symbol[..symbol_bytes].copy_from_slice(packet.data());
        }
        symbol
    }
}

/// What one more symbol did.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Progress {
    /// More are needed.
    Wanting,
    /// The object.
    Complete(Vec<u8>),
    /// The symbols contradict one another.
    Hopeless,
}

/// Collects symbols until they make an object.
pub(super) struct Collector {
    decoder: SourceBlockDecoder,
    size: usize,
    symbol_bytes: usize,
    needed: u32,
    seen: std::collections::BTreeSet<u16>,
    attempts: u32,
}

impl Collector {
    /// For an object of `size` bytes; `None` if the numbers are not allowed.
    pub(super) fn new(size: usize, symbol_bytes: usize) -> Option<Self> {
        let needed = source_symbols(size, symbol_bytes)?;
        let padded = u64::from(needed) * symbol_bytes as u64;
        Some(Self {
            decoder: SourceBlockDecoder::new(0, &block(size, symbol_bytes), padded),
            size,
            symbol_bytes,
            needed,
            seen: std::collections::BTreeSet::new(),
            attempts: 0,
        })
    }

    /// Distinct symbols held.
    pub(super) fn received(&self) -> u32 {
        self.seen.len() as u32
    }

    /// Symbols still needed: at least one, as long as the object is not complete.
    pub(super) fn missing(&self) -> u32 {
        self.needed.saturating_sub(self.received()).max(1)
    }

    /// Adds a symbol, of which only the first bytes may count.
    pub(super) fn add(&mut self, id: u16, data: &[u8; SYMBOL_BYTES]) -> Progress {
        if !self.seen.insert(id) {
            return Progress::Wanting;
        }
        if self.received() >= self.needed {
            self.attempts += 1;
        }
        let symbol = data[..self.symbol_bytes].to_vec();
        let packet = EncodingPacket::new(PayloadId::new(0, u32::from(id)), symbol);
        match self.decoder.decode([packet]) {
            Some(mut bytes) => {
                bytes.truncate(self.size);
                Progress::Complete(bytes)
            }
            None if self.attempts >= MAX_ATTEMPTS => Progress::Hopeless,
            None => Progress::Wanting,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn sizes_that_no_object_has_are_refused() {
        assert_eq!(source_symbols(0, 248), None);
        assert_eq!(source_symbols(MAX_OBJECT_BYTES + 1, 248), None);
        assert_eq!(source_symbols(MAX_OBJECT_BYTES, 248), Some(16_913));
        assert_eq!(
            source_symbols(MAX_OBJECT_BYTES, 8),
            None,
            "too many symbols"
        );
        assert_eq!(source_symbols(100, 7), None);
        assert_eq!(source_symbols(100, 256), None);
        assert_eq!(source_symbols(1, 8), Some(1));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn any_symbols_a_few_more_than_needed_make_the_object(
            bytes in prop::collection::vec(any::<u8>(), 1..20_000), first in 0u16..200, step in 1u16..5,
            eighths in 8usize..=SYMBOL_BYTES / 8
        ) {
            let mut fountain = Fountain::new(8 * eighths);
            let mut collector = Collector::new(bytes.len(), 8 * eighths).expect("allowed");
            let enough = collector.missing() as u16 + 6;
            let made = (0..enough).find_map(|i| {
                let id = first + i * step;
                match collector.add(id, &fountain.symbol(&bytes, id)) {
                    Progress::Complete(made) => Some(made),
                    Progress::Wanting | Progress::Hopeless => None,
                }
            });
            prop_assert_eq!(made, Some(bytes));
        }

        #[test]
        fn forged_symbols_never_panic_and_end(
            size in 1usize..5_000, symbols in prop::collection::vec((any::<u16>(), any::<u8>()), 0..100)
        ) {
            let mut collector = Collector::new(size, SYMBOL_BYTES).expect("allowed");
            for (id, byte) in symbols {
                if collector.add(id, &[byte; SYMBOL_BYTES]) != Progress::Wanting {
                    break;
                }
                prop_assert!(collector.received() <= collector.needed + MAX_ATTEMPTS);
            }
        }
    }
}
