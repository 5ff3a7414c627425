//! Which bytes of a file are still missing.

use std::collections::BTreeMap;

/// A file with more gaps than this keeps some of them although they were filled, and is asked for them again: a server that
/// sends it byte by byte does not fill the memory.
const MAX_GAPS: usize = 4096;

/// Gaps by their first byte, with the one after their last.
#[derive(Clone, Debug)]
pub(super) struct Gaps {
    gaps: BTreeMap<u32, u32>,
}

impl Gaps {
    /// All of a file of this size.
    pub(super) fn new(size: u32) -> Self {
        let all = (size > 0).then_some((0, size));
        Self {
            gaps: all.into_iter().collect(),
        }
    }

    /// These bytes are there now.
    pub(super) fn fill(&mut self, start: u32, end: u32) {
        if start >= end {
            return;
        }
        let before = self.gaps.range(..start).next_back();
        let first = before
            .filter(|(_, gap_end)| **gap_end > start)
            .map(|(gap, _)| *gap);
        let touched: Vec<(u32, u32)> = (self.gaps.range(first.unwrap_or(start)..end))
            .map(|(gap, gap_end)| (*gap, *gap_end))
            .collect();
        let splits = touched.len() == 1 && touched[0].0 < start && end < touched[0].1;
        if splits && self.gaps.len() >= MAX_GAPS {
            return;
        }
        for (gap, gap_end) in touched {
            self.gaps.remove(&gap);
            if gap < start {
                self.gaps.insert(gap, start);
            }
            if gap_end > end {
                self.gaps.insert(end, gap_end);
            }
        }
    }

    /// The first gap.
    pub(super) fn first(&self) -> Option<(u32, u32)> {
        self.gaps
            .first_key_value()
            .map(|(start, end)| (*start, *end))
    }

    /// How many bytes are missing.
    pub(super) fn missing(&self) -> u32 {
        self.gaps.iter().map(|(start, end)| end - start).sum()
    }

    /// The first `count` pieces of gaps of at most `size` bytes: offset and size.
    pub(super) fn pieces(&self, size: u32, count: usize) -> Vec<(u32, u32)> {
        let of_gap = |(&start, &end): (&u32, &u32)| {
            (start..end)
                .step_by(size as usize)
                .map(move |offset| (offset, size.min(end - offset)))
        };
        self.gaps.iter().flat_map(of_gap).take(count).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn pieces_come_from_the_first_gaps() {
        let mut gaps = Gaps::new(1000);
        gaps.fill(0, 100);
        gaps.fill(150, 900);
        assert_eq!(gaps.first(), Some((100, 150)));
        assert_eq!(gaps.pieces(60, 3), [(100, 50), (900, 60), (960, 40)]);
        assert_eq!(gaps.missing(), 150);
    }

    proptest! {
        #[test]
        fn gaps_are_what_was_not_filled(
            size in 0u32..200, fills in prop::collection::vec((0u32..220, 0u32..60), 0..20)
        ) {
            let mut gaps = Gaps::new(size);
            let mut missing: Vec<bool> = vec![true; size as usize];
            for (start, length) in fills {
                gaps.fill(start, start + length);
                missing.iter_mut().skip(start as usize).take(length as usize).for_each(|m| *m = false);
            }
            let mut listed = vec![false; size as usize];
            for (offset, size) in gaps.pieces(7, usize::MAX) {
                listed[offset as usize..(offset + size) as usize].fill(true);
            }
            prop_assert_eq!(&listed, &missing);
            prop_assert_eq!(gaps.missing() as usize, missing.iter().filter(|m| **m).count());
        }
    }
}
