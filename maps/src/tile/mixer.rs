//! A bit predicted by several contexts at once, whose opinions are weighed by how well they did before.
//!
//! ```text
//! p = squash(Σ wᵢ xᵢ)        xᵢ = cᵢ · stretch(pᵢ)        wᵢ ← wᵢ + η xᵢ (bit - p)
//! stretch(p) = ln(p / (1 - p))        squash(x) = 1 / (1 + e⁻ˣ)
//! ```
//!
//! where `pᵢ` is what context `i` has seen and `cᵢ` in 0..=1 grows with how often. A tile is small, so both learn fast.
//! All is done in integers, with tables made by the compiler: every machine predicts the same.
//!
//! - M. Mahoney, *Adaptive weighing of context models for lossless data compression*, Florida Tech. CS-2005-16, 2005.

use super::range_coder::Coder;

/// Contexts each input tells apart; more are folded onto these by hashing.
const SLOTS: u32 = 1 << 16;
/// What a difference of 1 is in a stretched probability.
const ONE: i32 = 256;
/// The greatest stretched probability: 0.99966.
const MOST: i32 = 8 * ONE - 1;
/// Weights are in 1 / 65536. Together the contexts start out somewhat surer than their mean.
const FIRST_WEIGHT: i32 = 11_800;
/// No weight exceeds 8, so that products stay within 32 bits.
const MOST_WEIGHT: i32 = (1 << 19) - 1;
/// `η`, in a scale that the integers give.
const RATE: i32 = 25;
const RATE_SHIFT: u32 = 15;
/// Bits of a counter that hold how often its context was seen; the others hold the probability.
const SEEN_BITS: u32 = 10;
/// A counter follows slowly after this many bits, and no slower after more.
const SEEN_LIMIT: u32 = 100;
/// `cᵢ` in 1 / 256 by how often the context was seen.
const CONFIDENCE: [i32; 8] = [0, 160, 200, 224, 240, 248, 256, 256];

/// A predictor of bits from `N` contexts.
#[derive(Debug)]
pub(super) struct Mixer<const N: usize> {
    /// A counter for each context of each input: a probability, stored with its top bit flipped so that zero is even odds,
    /// above how often it was seen.
    counters: Vec<u32>,
    /// By what the caller tells apart.
    weights: Vec<[i32; N]>,
}

impl<const N: usize> Mixer<N> {
    /// With `sets` sets of weights.
    pub(super) fn new(sets: usize) -> Self {
        Self {
            counters: vec![0; N * SLOTS as usize],
            weights: vec![[FIRST_WEIGHT; N]; sets],
        }
    }

    /// Codes a bit in these contexts; [`hash`] makes any number one.
    pub(super) fn bit(
        &mut self,
        coder: &mut impl Coder,
        contexts: &[u32; N],
        set: usize,
        bit: bool,
    ) -> bool {
        let mut at = [0; N];
        let mut inputs = [0; N];
        let mut sum = 0;
        let weights = &mut self.weights[set];
        for (i, context) in contexts.iter().enumerate() {
            at[i] = i * SLOTS as usize + (context & (SLOTS - 1)) as usize;
            inputs[i] = input(self.counters[at[i]]);
            sum += (inputs[i] * weights[i]) >> 8;
        }
        let one = squash(sum >> 8);
        let bit = coder.code(one, bit);
        let error = (i32::from(bit) * 0xffff - i32::from(one)) >> 4;
        for (weight, input) in weights.iter_mut().zip(inputs) {
            let step = (input * error * RATE + (1 << (RATE_SHIFT - 1))) >> RATE_SHIFT;
            *weight = (*weight + step).clamp(-MOST_WEIGHT, MOST_WEIGHT);
        }
        for at in at {
            learn(&mut self.counters[at], bit);
        }
        bit
    }

    /// Codes the lowest `bits` of `value`, highest first; the prefix coded so far becomes part of each context.
    pub(super) fn tree(
        &mut self,
        coder: &mut impl Coder,
        contexts: &[u32; N],
        bits: u32,
        value: u8,
    ) -> u8 {
        let mut node = 1;
        for shift in (0..bits).rev() {
            let contexts = contexts.map(|context| hash(u64::from(context) << 8 | node));
            let bit = self.bit(coder, &contexts, node as usize, value >> shift & 1 == 1);
            node = node << 1 | u64::from(bit);
        }
        (node - (1 << bits)) as u8
    }
}

/// Any number as a context.
pub(super) const fn hash(value: u64) -> u32 {
    let mixed = (value ^ value >> 29).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> 40) as u32
}

fn input(counter: u32) -> i32 {
    let probability = (counter ^ 1 << 31) >> 20;
    let seen = counter & ((1 << SEEN_BITS) - 1);
    let stretched = i32::from(STRETCH[probability as usize]);
    (stretched * CONFIDENCE[(seen as usize).min(CONFIDENCE.len() - 1)]) >> 8
}

fn learn(counter: &mut u32, bit: bool) {
    let seen = *counter & ((1 << SEEN_BITS) - 1);
    let probability = ((*counter ^ 1 << 31) >> SEEN_BITS).cast_signed();
    let target = if bit { (1 << (32 - SEEN_BITS)) - 1 } else { 0 };
    let step = (i64::from(target - probability) * STEP[seen as usize]) >> 16;
    let probability = (probability + step as i32).cast_unsigned();
    *counter = (probability << SEEN_BITS ^ 1 << 31) | (seen + 1).min(SEEN_LIMIT);
}

/// `1 / (n + 1.5)` in 1 / 65536.
static STEP: [i64; SEEN_LIMIT as usize + 1] = {
    let mut table = [0; SEEN_LIMIT as usize + 1];
    let mut seen = 0;
    while seen < table.len() {
        table[seen] = 2 * 65_536 / (2 * seen as u64 + 3).cast_signed();
        seen += 1;
    }
    table
};

fn squash(stretched: i32) -> u16 {
    SQUASH[(stretched.clamp(-MOST, MOST) + MOST) as usize]
}

/// `65536 / (1 + e⁻ˣ)` for x from `-MOST` to `MOST`.
static SQUASH: [u16; 2 * MOST as usize + 1] = squash_table();

const fn squash_table() -> [u16; 2 * MOST as usize + 1] {
    let mut table = [0; 2 * MOST as usize + 1];
    let mut i = 0;
    while i < table.len() {
        let x = ((i as u32).cast_signed() - MOST) as f64 / ONE as f64;
        table[i] = (65_536.0 / (1.0 + exp(-x))) as u16;
        i += 1;
    }
    table
}

/// For `x` within ±8.
const fn exp(x: f64) -> f64 {
    // e^x = (e^(x / 64))^64, and the series converges at once for a small exponent.
    let small = x / 64.0;
    let mut term = 1.0;
    let mut sum = 1.0;
    let mut n = 1.0;
    while n < 12.0 {
        term *= small / n;
        sum += term;
        n += 1.0;
    }
    let mut power = sum;
    let mut doublings = 0;
    while doublings < 6 {
        power *= power;
        doublings += 1;
    }
    power
}

/// The inverse of [`squash`] for probabilities in 1 / 4096.
static STRETCH: [i16; 4096] = {
    let squash = squash_table();
    let mut table = [0; 4096];
    let mut i = 0;
    let mut probability = 0;
    while probability < table.len() {
        // The middle of the 16 probabilities that share an entry.
        while i + 1 < squash.len() && (squash[i] as usize) < probability * 16 + 8 {
            i += 1;
        }
        table[probability] = ((i as u32).cast_signed() - MOST) as i16;
        probability += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::super::range_coder::{Decoder, Encoder};
    use super::*;

    #[test]
    fn squash_and_stretch_are_inverse_to_each_other() {
        assert_eq!(squash(0), 32_768);
        assert_eq!(squash(ONE), 47_910, "65536 / (1 + 1 / e), cut off");
        for (probability, stretched) in STRETCH.iter().enumerate().take(4088).skip(8) {
            let back = usize::from(squash(i32::from(*stretched)));
            let middle = probability * 16 + 8;
            // A step of x changes p by at most 64.
            assert!(back.abs_diff(middle) <= 64, "{middle} comes back as {back}");
        }
    }

    /// Two contexts, of which the second tells the bit but for one in 16 and the first tells nothing.
    fn stream() -> impl Iterator<Item = ([u32; 2], bool)> {
        (0..20_000_u64).map(|i| {
            let random = hash(i * 7 + 1);
            let tells = random >> 4 & 1;
            (
                [random & 7, tells],
                (tells == 1) != (random >> 8).is_multiple_of(16),
            )
        })
    }

    #[test]
    fn the_context_that_tells_is_listened_to() {
        let mut encoder = Encoder::new(Vec::new());
        let mut mixer = Mixer::<2>::new(1);
        for (contexts, bit) in stream() {
            mixer.bit(&mut encoder, &contexts, 0, bit);
        }
        let bytes = encoder.finish();
        // The entropy of one in 16 is 0.337 bits: 843 bytes.
        assert!(bytes.len() < 900, "{} bytes", bytes.len());

        let mut decoder = Decoder::new(&bytes);
        let mut mixer = Mixer::<2>::new(1);
        for (contexts, bit) in stream() {
            assert_eq!(mixer.bit(&mut decoder, &contexts, 0, false), bit);
        }
        assert!(decoder.is_complete());
    }
}
