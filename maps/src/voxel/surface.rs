//! What is kept of an occupied voxel besides its log-odds, in ten bytes.

use super::{ClassId, Rgb, Seen, Sources};
use crate::time::Stamp;

/// A colour with five bits a channel; zero is no colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PackedColor(u16);

impl PackedColor {
    pub(crate) const NONE: Self = Self(0);
    const PRESENT: u16 = 0x8000;

    pub(crate) fn from_channels([r, g, b]: [u8; 3]) -> Self {
        let channel = |c: u8| u16::from(c & 31);
        Self(Self::PRESENT | channel(r) << 10 | channel(g) << 5 | channel(b))
    }

    pub(crate) fn channels(self) -> Option<[u8; 3]> {
        (self != Self::NONE).then(|| [10, 5, 0].map(|shift| (self.0 >> shift) as u8 & 31))
    }

    pub(crate) fn to_le_bytes(self) -> [u8; 2] {
        self.0.to_le_bytes()
    }

    /// Halfway to `new` if that differs by more than noise: the colours of what is seen again and again must come to
    /// rest, or every tile in view would change with every scan.
    fn towards(self, new: Self) -> Self {
        const NOISE: u8 = 2;
        let (Some(old), Some(seen)) = (self.channels(), new.channels()) else {
            return new;
        };
        if old
            .iter()
            .zip(seen)
            .all(|(old, seen)| old.abs_diff(seen) <= NOISE)
        {
            return self;
        }
        Self::from_channels(std::array::from_fn(|i| {
            (old[i] + seen[i] + u8::from(seen[i] > old[i])) / 2
        }))
    }
}

impl From<Rgb> for PackedColor {
    fn from(Rgb(channels): Rgb) -> Self {
        Self::from_channels(channels.map(|c| c >> 3))
    }
}

impl From<PackedColor> for Option<Rgb> {
    fn from(color: PackedColor) -> Self {
        let channels = color.channels()?;
        Some(Rgb(channels.map(|c| c << 3 | c >> 2)))
    }
}

/// When and by whom, in six bytes: the sources, and 40 bits of 1/32 s, which outlast the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PackedSeen {
    sources: u8,
    ticks: [u8; 5],
}

impl PackedSeen {
    pub(crate) const NEVER: Self = Self {
        sources: 0,
        ticks: [0; 5],
    };
    const TICK_NS: u64 = 31_250_000;

    /// As seen by one more; the later moment counts.
    pub(crate) fn and(self, other: Self) -> Self {
        let later = if self.ticks() < other.ticks() {
            other.ticks
        } else {
            self.ticks
        };
        Self {
            sources: self.sources | other.sources,
            ticks: later,
        }
    }

    fn ticks(self) -> u64 {
        let [a, b, c, d, e] = self.ticks;
        u64::from_le_bytes([a, b, c, d, e, 0, 0, 0])
    }
}

impl From<Seen> for PackedSeen {
    fn from(seen: Seen) -> Self {
        let [a, b, c, d, e, ..] = (seen.at.as_nanos() / Self::TICK_NS).to_le_bytes();
        Self {
            sources: seen.sources.bits(),
            ticks: [a, b, c, d, e],
        }
    }
}

impl From<PackedSeen> for Seen {
    fn from(seen: PackedSeen) -> Self {
        Self {
            at: Stamp::from_nanos(seen.ticks().saturating_mul(PackedSeen::TICK_NS)),
            sources: Sources::from_bits(seen.sources),
        }
    }
}

/// What is kept of one occupied voxel.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Surface {
    pub(crate) color: PackedColor,
    pub(crate) class: ClassId,
    /// By how many scans the class is ahead of all others; 1 if that is not known.
    votes: u8,
    pub(crate) seen: PackedSeen,
}

impl Surface {
    /// The most votes a class may be ahead, so that it can change within as many scans.
    const MOST_VOTES: u8 = 8;

    pub(crate) fn new(color: PackedColor, class: ClassId) -> Self {
        Self {
            color,
            class,
            votes: u8::from(class != ClassId::NONE),
            seen: PackedSeen::NEVER,
        }
    }

    /// Takes over colour and class.
    pub(crate) fn set(&mut self, color: PackedColor, class: ClassId) {
        *self = Self {
            seen: self.seen,
            ..Self::new(color, class)
        };
    }

    /// Moves the colour towards one that was seen.
    pub(crate) fn see_color(&mut self, seen: PackedColor) {
        self.color = self.color.towards(seen);
    }

    /// Counts a vote for a class: Boyer and Moore's majority vote, which one byte can hold.
    pub(crate) fn see_class(&mut self, seen: ClassId) {
        if seen == ClassId::NONE {
            return;
        }
        if seen == self.class {
            self.votes = (self.votes + 1).min(Self::MOST_VOTES);
        } else if self.votes <= 1 {
            self.class = seen;
            self.votes = 1;
        } else {
            self.votes -= 1;
        }
    }

    /// Whether colour and class are the same: what counts as content.
    pub(crate) fn is_same(self, other: Self) -> bool {
        self.color == other.color && self.class == other.class
    }
}
