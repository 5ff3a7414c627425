//! The colour and the class of each occupied voxel, given those before.
//!
//! Colours are coded as differences from the mean of the neighbours', green first: red and blue mostly differ as it does.
//! A class is mostly that of a neighbour. Against a known base, the first question is whether anything changed.

use super::field::{Field, OCCUPIED, ROW, Rows, SLICE};
use super::range_coder::{Bit, Coder};
use crate::voxel::ClassId;
use crate::voxel::surface::PackedColor;

/// Steps back to the neighbours that come before, nearest first.
const BEHIND: [usize; 9] = [
    1,
    ROW,
    SLICE,
    ROW + 1,
    ROW - 1,
    SLICE + 1,
    SLICE - 1,
    SLICE + ROW,
    SLICE - ROW,
];

/// The contexts of colours.
pub(super) struct Colors {
    /// By whether the voxel before had changed.
    unchanged: [Bit; 2],
    has_color: [Bit; 2],
    /// By channel and by how surprising the channel before was, or how well founded the reference is.
    color: Box<[[[Bit; 32]; 4]; 3]>,
    /// The colour that was coded last.
    recent: [u8; 3],
}

impl Colors {
    pub(super) fn new() -> Self {
        Self {
            unchanged: [Bit::NEW; 2],
            has_color: [Bit::NEW; 2],
            color: Box::new([[[Bit::NEW; 32]; 4]; 3]),
            recent: [16; 3],
        }
    }

    /// Codes the colours of all occupied voxels of these rows; `None` if no encoder wrote them.
    pub(super) fn code(
        &mut self,
        coder: &mut impl Coder,
        field: &mut Field,
        base: Option<&Field>,
        rows: &Rows,
    ) -> Option<()> {
        let mut changed = false;
        for_occupied(coder, field, rows, |coder, field, i| {
            let given = field.color(i);
            if let Some(base) = base.filter(|base| base.states[i] == OCCUPIED) {
                let unchanged = &mut self.unchanged[usize::from(changed)];
                changed = !coder.bit(unchanged, given == base.color(i));
                if !changed {
                    field.set_color(i, base.color(i));
                    return;
                }
            }
            let color = self.color(coder, field, i, given);
            field.set_color(i, color);
        })
    }

    fn color(
        &mut self,
        coder: &mut impl Coder,
        field: &Field,
        i: usize,
        given: PackedColor,
    ) -> PackedColor {
        let (reference, founded) = self.reference(field, i);
        let given = given.channels();
        let has_color = &mut self.has_color[usize::from(founded > 0)];
        if !coder.bit(has_color, given.is_some()) {
            return PackedColor::NONE;
        }
        let given = given.unwrap_or(reference);
        let mut color = [0; 3];
        let mut expected = 0;
        let mut context = founded.min(3);
        for channel in [1, 0, 2] {
            let base = reference[channel].wrapping_add(expected);
            let tree = &mut self.color[channel][context];
            let difference = coder.tree(tree, 5, given[channel].wrapping_sub(base) & 31);
            color[channel] = base.wrapping_add(difference) & 31;
            if channel == 1 {
                expected = difference;
            }
            context = match difference.min(32 - difference) {
                0 => 0,
                1 => 1,
                2..=3 => 2,
                _ => 3,
            };
        }
        self.recent = color;
        PackedColor::from_channels(color)
    }

    /// The colour to compare with: the neighbours' mean if any has one, else the last. With the number of neighbours that have.
    fn reference(&self, field: &Field, i: usize) -> ([u8; 3], usize) {
        let mut sum = [0_u16; 3];
        let mut count = 0;
        let neighbours = BEHIND.iter().map(|back| field.color(i - back));
        for channels in neighbours.filter_map(PackedColor::channels) {
            for (sum, channel) in sum.iter_mut().zip(channels) {
                *sum += u16::from(channel);
            }
            count += 1;
        }
        if count == 0 {
            return (self.recent, 0);
        }
        let mean = sum.map(|sum| ((2 * sum + count) / (2 * count)) as u8);
        (mean, usize::from(count))
    }
}

/// The contexts of classes.
pub(super) struct Classes {
    /// By how many neighbours agree with the guess and how many differ.
    same: [[Bit; 4]; 10],
    /// By whether the voxel before had changed.
    unchanged: [Bit; 2],
    class: Box<[Bit; 256]>,
    /// The class that was coded last.
    recent: ClassId,
}

impl Classes {
    pub(super) fn new() -> Self {
        Self {
            same: [[Bit::NEW; 4]; 10],
            unchanged: [Bit::NEW; 2],
            class: Box::new([Bit::NEW; 256]),
            recent: ClassId::NONE,
        }
    }

    /// Codes the classes of all occupied voxels of these rows; `None` if no encoder wrote them.
    pub(super) fn code(
        &mut self,
        coder: &mut impl Coder,
        field: &mut Field,
        base: Option<&Field>,
        rows: &Rows,
    ) -> Option<()> {
        let mut changed = false;
        for_occupied(coder, field, rows, |coder, field, i| {
            let given = field.class(i);
            if let Some(base) = base.filter(|base| base.states[i] == OCCUPIED) {
                let unchanged = &mut self.unchanged[usize::from(changed)];
                changed = !coder.bit(unchanged, given == base.class(i));
                if !changed {
                    field.set_class(i, base.class(i));
                    return;
                }
            }
            let (guess, agree, differ) = self.guess(field, i);
            let same = &mut self.same[agree][differ.min(3)];
            let class = if coder.bit(same, given == guess) {
                guess
            } else {
                ClassId(coder.tree(&mut self.class[..], 8, given.0))
            };
            self.recent = class;
            field.set_class(i, class);
        })
    }

    /// The class of most neighbours, the nearest's of those that tie, with how many have it and how many have another.
    fn guess(&self, field: &Field, i: usize) -> (ClassId, usize, usize) {
        let occupied = BEHIND
            .iter()
            .filter(|back| field.states[i - **back] == OCCUPIED);
        let mut counts: Vec<(ClassId, usize)> = Vec::with_capacity(BEHIND.len());
        for class in occupied.map(|back| field.class(i - back)) {
            match counts.iter_mut().find(|(known, _)| *known == class) {
                Some((_, count)) => *count += 1,
                None => counts.push((class, 1)),
            }
        }
        let all: usize = counts.iter().map(|(_, count)| count).sum();
        let most = counts.into_iter().rev().max_by_key(|(_, count)| *count);
        most.map_or((self.recent, 0, 0), |(class, count)| {
            (class, count, all - count)
        })
    }
}

/// Does something for each occupied voxel of these rows; `None` if the coder ran out of bytes.
fn for_occupied<C: Coder>(
    coder: &mut C,
    field: &mut Field,
    rows: &Rows,
    mut each: impl FnMut(&mut C, &mut Field, usize),
) -> Option<()> {
    for (_, runs) in rows.iter() {
        for i in runs.flat_map(|start| start..start + 8) {
            if field.states[i] == OCCUPIED {
                each(coder, field, i);
            }
        }
        if coder.is_exhausted() {
            return None;
        }
    }
    Some(())
}
