//! Nodes as bytes: those below a node are known only after it, and may turn out not to be needed.

use maps::palette;
use maps::voxel::{LogOdds, Rgb, Voxel};

use super::{Pruning, Shape};
use crate::{DEPTH, NO_COLOR};

/// How nodes become bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Log-odds and a bit for each child.
    Full,
    /// Log-odds, a colour and a bit for each child.
    Colored,
    /// Log-odds, the colour of a class and a bit for each child.
    Classified,
    /// Two bits for each child, nothing for a leaf.
    Binary,
}

impl Kind {
    /// What is said of a voxel.
    pub(super) fn said_of(self, voxel: Voxel) -> Said {
        let log_odds = match self {
            Self::Full | Self::Colored | Self::Classified => voxel.log_odds,
            Self::Binary if voxel.log_odds.is_occupied() => LogOdds::MAX,
            Self::Binary => LogOdds::MIN,
        };
        let color = match self {
            Self::Full | Self::Binary => None,
            Self::Colored => voxel
                .color
                .map(|Rgb(c)| if c == NO_COLOR { [254; 3] } else { c }),
            Self::Classified => palette::color_of(voxel.class).map(|Rgb(c)| c),
        };
        let color = color.unwrap_or(NO_COLOR);
        Said {
            log_odds,
            color,
            is_leaf: true,
        }
    }

    /// How many bytes an inner node has.
    fn size(self) -> usize {
        match self {
            Self::Full => 5,
            Self::Colored | Self::Classified => 8,
            Self::Binary => 2,
        }
    }
}

/// What is said of a node: of an inner one the greatest log-odds and the average colour below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Said {
    log_odds: LogOdds,
    color: [u8; 3],
    is_leaf: bool,
}

/// A node that waits for its children.
pub(super) struct Node {
    depth: u32,
    /// Where its bytes begin.
    start: usize,
    /// How many nodes came before.
    before: u64,
}

/// The nodes written so far.
pub(super) struct Nodes {
    pub(super) kind: Kind,
    pub(super) bytes: Vec<u8>,
    pub(super) count: u64,
    pruning: Pruning,
    /// The depth of the least leaf.
    lowest: u32,
}

impl Nodes {
    pub(super) fn new(kind: Kind, shape: Shape) -> Self {
        Self {
            kind,
            bytes: Vec::new(),
            count: 0,
            pruning: shape.pruning,
            lowest: DEPTH - shape.cut_levels.min(DEPTH - 1),
        }
    }

    /// Writes a leaf.
    pub(super) fn leaf(&mut self, said: Said) -> Said {
        self.count += 1;
        if self.kind != Kind::Binary {
            let head = self.head(said, &[None; 8]);
            self.bytes.extend(&head[..self.kind.size()]);
        }
        Said {
            is_leaf: true,
            ..said
        }
    }

    /// Makes room for a node whose children follow.
    pub(super) fn open(&mut self, depth: u32) -> Node {
        let (start, before) = (self.bytes.len(), self.count);
        self.count += 1;
        self.bytes.resize(start + self.kind.size(), 0);
        Node {
            depth,
            start,
            before,
        }
    }

    /// Fills in a node, of whose children there is at least one, or makes it a leaf.
    pub(super) fn close(&mut self, node: &Node, children: &[Option<Said>; 8]) -> Said {
        if let Some(said) = self.as_leaf(node, children) {
            self.bytes.truncate(node.start);
            self.count = node.before;
            return self.leaf(said);
        }
        let said = self.summary(children);
        let head = self.head(said, children);
        let size = self.kind.size();
        self.bytes[node.start..][..size].copy_from_slice(&head[..size]);
        said
    }

    /// What the node says if it shall have no children.
    fn as_leaf(&self, node: &Node, children: &[Option<Said>; 8]) -> Option<Said> {
        if node.depth == self.lowest {
            return Some(self.summary(children));
        }
        // The root of a `.bt` file is always an inner node.
        let may =
            self.pruning == Pruning::EqualLeaves && (node.depth > 0 || self.kind != Kind::Binary);
        let first = children[0].filter(|said| may && said.is_leaf)?;
        children
            .iter()
            .all(|child| *child == Some(first))
            .then_some(first)
    }

    /// What an inner node says.
    fn summary(&self, children: &[Option<Said>; 8]) -> Said {
        let children = || children.iter().flatten();
        let log_odds = children().map(|said| said.log_odds).max();
        let colors: Vec<_> = children()
            .map(|said| said.color)
            .filter(|c| *c != NO_COLOR)
            .collect();
        let color = match self.kind {
            _ if colors.is_empty() => NO_COLOR,
            Kind::Classified => most_frequent(&colors),
            Kind::Full | Kind::Colored | Kind::Binary => average(&colors),
        };
        Said {
            log_odds: log_odds.unwrap_or(LogOdds::MIN),
            color,
            is_leaf: false,
        }
    }

    /// The bytes of a node itself, and some zeros.
    fn head(&self, said: Said, children: &[Option<Said>; 8]) -> [u8; 8] {
        let [a, b, c, d] = as_octomap(said.log_odds).to_le_bytes();
        let [red, green, blue] = said.color;
        let bits = child_bits(children);
        let [low, high] = child_kinds(children).to_le_bytes();
        match self.kind {
            Kind::Full => [a, b, c, d, bits, 0, 0, 0],
            Kind::Colored | Kind::Classified => [a, b, c, d, red, green, blue, bits],
            Kind::Binary => [low, high, 0, 0, 0, 0, 0, 0],
        }
    }
}

/// At even odds `OctoMap` says occupied, we say free.
fn as_octomap(log_odds: LogOdds) -> f32 {
    if log_odds.0 == 0 {
        return -1e-6;
    }
    log_odds.value() as f32
}

/// The average of colours.
fn average(colors: &[[u8; 3]]) -> [u8; 3] {
    let count = colors.len() as u32;
    [0, 1, 2].map(|i| (colors.iter().map(|c| u32::from(c[i])).sum::<u32>() / count) as u8)
}

/// The most frequent of colours; the least of several.
fn most_frequent(colors: &[[u8; 3]]) -> [u8; 3] {
    let count = |color| colors.iter().filter(|c| **c == color).count();
    let first = colors[0];
    colors.iter().fold(first, |most, &color| {
        let (more, same) = (count(color), count(most));
        if more > same || more == same && color < most {
            color
        } else {
            most
        }
    })
}

fn child_bits(children: &[Option<Said>; 8]) -> u8 {
    let bits = children.iter().enumerate();
    bits.fold(0, |bits, (child, said)| {
        bits | u8::from(said.is_some()) << child
    })
}

/// For each child two bits: 0 unknown, 1 free, 2 occupied, 3 an inner node.
fn child_kinds(children: &[Option<Said>; 8]) -> u16 {
    let kind = |said: &Option<Said>| match said {
        None => 0,
        Some(said) if !said.is_leaf => 3,
        Some(said) if said.log_odds.is_occupied() => 2,
        Some(_) => 1,
    };
    let kinds = children.iter().enumerate();
    kinds.fold(0, |kinds, (child, said)| kinds | kind(said) << (2 * child))
}
