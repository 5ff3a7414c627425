//! The voxels of one tile in an array with a border, so that every voxel has neighbours.

use crate::voxel::block::{Block, VOLUME};
use crate::voxel::surface::PackedColor;
use crate::voxel::{ClassId, LogOdds};

/// The border: as far as a context looks.
const BORDER: usize = 3;
const SIDE: usize = 128 + 2 * BORDER;
/// Steps from a voxel to the next along y and z; along x it is 1.
pub(super) const ROW: usize = SIDE;
pub(super) const SLICE: usize = SIDE * SIDE;

/// Unknown, free or occupied.
pub(super) type State = u8;
pub(super) const UNKNOWN: State = 0;
pub(super) const FREE: State = 1;
pub(super) const OCCUPIED: State = 2;

/// What is known of each voxel. A voxel that was not put in is unknown.
pub(super) struct Field {
    pub(super) states: Vec<State>,
    /// Log-odds, 0 where unknown.
    pub(super) values: Vec<i8>,
    /// Empty as long as no voxel has a colour.
    colors: Vec<PackedColor>,
    /// Empty as long as no voxel has a class.
    classes: Vec<ClassId>,
}

impl Field {
    pub(super) fn new() -> Self {
        Self {
            states: vec![UNKNOWN; SIDE * SLICE],
            values: vec![0; SIDE * SLICE],
            colors: Vec::new(),
            classes: Vec::new(),
        }
    }

    pub(super) fn of<'a>(blocks: impl Iterator<Item = (u16, &'a Block)>) -> Self {
        let mut field = Self::new();
        for (at, block) in blocks {
            field.put(at, block);
        }
        field
    }

    /// Takes over a block at its place.
    pub(super) fn put(&mut self, at: u16, block: &Block) {
        for index in 0..VOLUME {
            let Some(log_odds) = block.log_odds(index) else {
                continue;
            };
            let i = place(at, index);
            self.values[i] = log_odds.0;
            self.states[i] = state_of(log_odds);
            if let Some(surface) = block.surface(index) {
                self.set_color(i, surface.color);
                self.set_class(i, surface.class);
            }
        }
    }

    /// The log-odds of a block's voxels.
    pub(super) fn log_odds(&self, at: u16) -> [Option<LogOdds>; VOLUME] {
        std::array::from_fn(|index| {
            let i = place(at, index);
            (self.states[i] != UNKNOWN).then_some(LogOdds(self.values[i]))
        })
    }

    /// Makes every voxel of these rows as sure as can be.
    pub(super) fn make_sure(&mut self, rows: &Rows) {
        for i in rows
            .iter()
            .flat_map(|(_, runs)| runs)
            .flat_map(|start| start..start + 8)
        {
            self.values[i] = match self.states[i] {
                UNKNOWN => 0,
                FREE => LogOdds::MIN.0,
                _ => LogOdds::MAX.0,
            };
        }
    }

    pub(super) fn has_colors(&self) -> bool {
        !self.colors.is_empty()
    }

    pub(super) fn has_classes(&self) -> bool {
        !self.classes.is_empty()
    }

    pub(super) fn color(&self, i: usize) -> PackedColor {
        self.colors.get(i).copied().unwrap_or_default()
    }

    pub(super) fn class(&self, i: usize) -> ClassId {
        self.classes.get(i).copied().unwrap_or_default()
    }

    pub(super) fn set_color(&mut self, i: usize, color: PackedColor) {
        set(&mut self.colors, i, color);
    }

    pub(super) fn set_class(&mut self, i: usize, class: ClassId) {
        set(&mut self.classes, i, class);
    }
}

/// Sets an entry of a list that exists from its first entry on that is not the default.
fn set<T: Copy + Default + PartialEq>(list: &mut Vec<T>, i: usize, value: T) {
    if list.is_empty() {
        if value == T::default() {
            return;
        }
        *list = vec![T::default(); SIDE * SLICE];
    }
    list[i] = value;
}

/// Where in a field a voxel of a block is.
pub(super) fn place(at: u16, index: usize) -> usize {
    let [x, y, z] = [0, 4, 8].map(|shift| usize::from(at >> shift & 15) * 8 + BORDER);
    let [dx, dy, dz] = [0, 3, 6].map(|shift| index >> shift & 7);
    (z + dz) * SLICE + (y + dy) * ROW + x + dx
}

pub(super) fn state_of(log_odds: LogOdds) -> State {
    if log_odds.is_occupied() {
        OCCUPIED
    } else {
        FREE
    }
}

/// Which blocks of a tile are to be coded, for walks through their voxels: slice by slice, row by row, along x.
pub(super) struct Rows {
    /// By `16 z + y` of the block, a bit for each x.
    blocks: Box<[u16; 256]>,
}

impl Rows {
    pub(super) fn new() -> Self {
        Self {
            blocks: Box::new([0; 256]),
        }
    }

    pub(super) fn add(&mut self, at: u16) {
        self.blocks[usize::from(at >> 4)] |= 1 << (at & 15);
    }

    /// Each row of voxels: the field's place of the first of each run of eight, with z.
    pub(super) fn iter(
        &self,
    ) -> impl Iterator<Item = (usize, impl Iterator<Item = usize> + use<>)> {
        (0..128_usize * 128).filter_map(|row| {
            let [y, z] = [row & 127, row >> 7];
            let bits = self.blocks[z / 8 * 16 + y / 8];
            let start = (z + BORDER) * SLICE + (y + BORDER) * ROW + BORDER;
            let runs = (0..16).filter(move |x| bits >> x & 1 == 1);
            (bits != 0).then(|| (z, runs.map(move |x| start + 8 * x)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_visit_every_voxel_of_the_blocks_added_once() {
        let mut rows = Rows::new();
        let blocks = [0, 1, 17, 4095];
        for at in blocks {
            rows.add(at);
        }
        let mut visited: Vec<_> = rows
            .iter()
            .flat_map(|(_, runs)| runs.flat_map(|start| start..start + 8))
            .collect();
        assert!(visited.is_sorted(), "slice by slice, row by row, along x");
        let mut expected: Vec<_> = blocks
            .iter()
            .flat_map(|at| (0..VOLUME).map(|index| place(*at, index)))
            .collect();
        expected.sort_unstable();
        visited.dedup();
        assert_eq!(visited, expected);
    }
}
