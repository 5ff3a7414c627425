//! Reading `OctoMap` files, which may come from anyone: depth, memory, values and header are bounded.

use std::io::BufRead;

use maps::palette;
use maps::voxel::{ClassId, LogOdds, Rgb, Voxel, VoxelKey, VoxelMap};

use crate::error::ReadError;
use crate::header::{Format, Header, TreeType};
use crate::memory::Memory;
use crate::{DEPTH, NO_COLOR};

/// How to read a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadOptions {
    /// Levels to leave out at the bottom: each doubles the edge of a voxel, which is then as occupied as the most
    /// occupied leaf in it and of that leaf's colour. At most 15, and within [`VoxelMap::RESOLUTION_M`].
    pub coarser: u32,
    /// What the colours of a `ColorOcTree` mean.
    pub colors: Colors,
    /// The most memory, about, that the map may take.
    pub most_bytes: u64,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            coarser: 0,
            colors: Colors::Surface,
            most_bytes: 2 << 30,
        }
    }
}

/// What the colours of a `ColorOcTree` mean. The file does not tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colors {
    /// What a camera saw.
    Surface,
    /// The class of what is there, by [`maps::palette`]. Other colours, such as `OctoMap`'s averages where it pruned
    /// different classes into one leaf, are no class.
    Classes,
}

/// What was in a file.
#[derive(Debug)]
pub struct Opened {
    /// Its voxels.
    pub map: VoxelMap,
    /// What its header said.
    pub header: Header,
    /// How many nodes the tree has, inner ones included.
    pub nodes: u64,
    /// Leaves that stand for more than a voxel.
    pub pruned: u64,
    /// Occupied voxels whose colour is no class, where colours were to mean classes.
    pub unclassified: u64,
}

/// Reads a `.ot` or `.bt` file, whichever it is.
///
/// Leaves above the lowest level become voxels; inner nodes tell nothing that their leaves do not. Log-odds are rounded to
/// our steps of 0.05 and clamped, but what is occupied or free to `OctoMap` stays so; in a `.bt` file either is as sure
/// as can be.
pub fn read(mut from: impl BufRead, options: &ReadOptions) -> Result<Opened, ReadError> {
    let header = Header::read(&mut from)?;
    read_nodes(from, header, options)
}

fn read_nodes(
    from: impl BufRead,
    header: Header,
    options: &ReadOptions,
) -> Result<Opened, ReadError> {
    let resolution_m = header.resolution_m * f64::from(1_u32 << options.coarser.min(31));
    if options.coarser >= DEPTH || !VoxelMap::RESOLUTION_M.contains(&resolution_m) {
        let coarser = options.coarser;
        return Err(ReadError::TooCoarse { coarser });
    }
    let mut tree = Tree {
        from,
        opened: Opened {
            map: VoxelMap::new(resolution_m),
            header,
            nodes: 0,
            pruned: 0,
            unclassified: 0,
        },
        options: *options,
        lowest: DEPTH - options.coarser,
        used: Memory::default(),
    };
    if header.nodes != Some(0) {
        let root = Place {
            path: [0; 3],
            depth: 0,
        };
        tree.opened.nodes = 1;
        match header.format {
            Format::Full => tree.full_node(root)?,
            Format::Binary | Format::OldBinary => tree.binary_node(root)?,
        };
    }
    let found = tree.opened.nodes;
    match header.nodes {
        Some(said) if said != found && header.format != Format::Full => {
            Err(ReadError::OtherCount { said, found })
        }
        _ => Ok(tree.opened),
    }
}

/// Reads the voxels of a `.ot` file, as [`read()`] does by default.
pub fn read_ot(from: impl BufRead) -> Result<VoxelMap, ReadError> {
    read_format(from, ".ot", &[Format::Full])
}

/// Reads the voxels of a `.bt` file, as [`read()`] does by default.
pub fn read_bt(from: impl BufRead) -> Result<VoxelMap, ReadError> {
    read_format(from, ".bt", &[Format::Binary, Format::OldBinary])
}

fn read_format(
    mut from: impl BufRead,
    expected: &'static str,
    formats: &[Format],
) -> Result<VoxelMap, ReadError> {
    let header = Header::read(&mut from)?;
    if !formats.contains(&header.format) {
        return Err(ReadError::OtherFormat { expected });
    }
    Ok(read_nodes(from, header, &ReadOptions::default())?.map)
}

/// A node: the path to it along each axis, and how deep it lies.
#[derive(Clone, Copy)]
struct Place {
    path: [i32; 3],
    depth: u32,
}

impl Place {
    fn child(self, child: u8) -> Self {
        Self {
            path: [0, 1, 2].map(|axis| self.path[axis] << 1 | i32::from(child >> axis & 1)),
            depth: self.depth + 1,
        }
    }
}

/// What a leaf says.
#[derive(Clone, Copy)]
struct Content {
    log_odds: LogOdds,
    color: Option<Rgb>,
}

impl Content {
    fn as_voxel(self, colors: Colors) -> Voxel {
        let voxel = Voxel::new(self.log_odds);
        match colors {
            Colors::Surface => Voxel {
                color: self.color,
                ..voxel
            },
            Colors::Classes => Voxel {
                class: self
                    .color
                    .and_then(palette::class_of)
                    .unwrap_or(ClassId::NONE),
                ..voxel
            },
        }
    }

    const fn uncolored(log_odds: LogOdds) -> Self {
        Self {
            log_odds,
            color: None,
        }
    }
}

/// What follows of a child.
enum Child {
    /// Nothing: a leaf of a `.bt` file.
    Leaf(LogOdds),
    /// A node.
    Node,
}

struct Tree<R> {
    from: R,
    opened: Opened,
    options: ReadOptions,
    /// The depth of the map's voxels.
    lowest: u32,
    used: Memory,
}

impl<R: BufRead> Tree<R> {
    /// A node of a `.ot` file; the most occupied of its leaves.
    fn full_node(&mut self, at: Place) -> Result<Content, ReadError> {
        let value = f32::from_le_bytes(self.read()?);
        let color = match self.opened.header.tree {
            TreeType::Color => Some(self.read()?),
            TreeType::Plain | TreeType::Stamped => None,
        };
        let [children] = self.read()?;
        if children == 0 {
            let content = self.content(value, color)?;
            self.leaf(at, content)?;
            return Ok(content);
        }
        let children = (0..8).filter(|child| children >> child & 1 == 1);
        self.inner(at, children.map(|child| (child, Child::Node)))
    }

    /// An inner node of a `.bt` file; the most occupied of its leaves.
    fn binary_node(&mut self, at: Place) -> Result<Content, ReadError> {
        let kinds = u16::from_le_bytes(self.read()?);
        let children = (0..8).filter_map(|child| match kinds >> (2 * child) & 3 {
            0b01 => Some((child, Child::Leaf(LogOdds::MIN))),
            0b10 => Some((child, Child::Leaf(LogOdds::MAX))),
            0b11 => Some((child, Child::Node)),
            _ => None,
        });
        self.inner(at, children)
    }

    /// The children of a node, in the order in which they follow.
    fn inner(
        &mut self,
        at: Place,
        children: impl Iterator<Item = (u8, Child)>,
    ) -> Result<Content, ReadError> {
        if at.depth == DEPTH {
            let node = self.opened.nodes;
            return Err(ReadError::TooDeep { node });
        }
        let mut most = Content::uncolored(LogOdds::MIN);
        for (child, kind) in children {
            self.opened.nodes += 1;
            let place = at.child(child);
            let content = match (kind, self.opened.header.format) {
                (Child::Leaf(log_odds), _) => {
                    self.leaf(place, Content::uncolored(log_odds))?;
                    Content::uncolored(log_odds)
                }
                (Child::Node, Format::Full) => self.full_node(place)?,
                (Child::Node, Format::Binary | Format::OldBinary) => self.binary_node(place)?,
            };
            if content.log_odds > most.log_odds
                || most.color.is_none() && content.log_odds == most.log_odds
            {
                most = content;
            }
        }
        if at.depth == self.lowest {
            self.fill(at, most)?;
        }
        Ok(most)
    }

    fn content(&self, value: f32, color: Option<[u8; 3]>) -> Result<Content, ReadError> {
        if value.is_nan() {
            let node = self.opened.nodes;
            return Err(ReadError::NotANumber { node });
        }
        let nearest = LogOdds::nearest(value.into());
        // Rounding must not change sides, and at even odds OctoMap says occupied, we say free.
        let log_odds = if value >= 0.0 {
            nearest.max(LogOdds(1))
        } else {
            nearest.min(LogOdds(0))
        };
        let color = color.filter(|c| *c != NO_COLOR).map(Rgb);
        Ok(Content { log_odds, color })
    }

    fn leaf(&mut self, at: Place, content: Content) -> Result<(), ReadError> {
        self.opened.pruned += u64::from(at.depth < DEPTH);
        // What lies below the voxels of the map is summed up by the node above.
        if at.depth > self.lowest {
            return Ok(());
        }
        self.fill(at, content)
    }

    /// Makes the cube of a node so many equal voxels.
    fn fill(&mut self, at: Place, content: Content) -> Result<(), ReadError> {
        let levels = self.lowest - at.depth;
        let low = VoxelKey::RANGE.start() >> self.options.coarser;
        let [x, y, z] = at.path.map(|c| (c << levels) + low);
        if self.used.add(VoxelKey::new(x, y, z), levels) > self.options.most_bytes {
            return Err(ReadError::TooLarge {
                most_mib: self.options.most_bytes >> 20,
                node: self.opened.nodes,
                edge_m: self.opened.map.resolution_m() * f64::from(1_u32 << levels),
                voxels: 1 << (3 * levels),
                coarser: self.options.coarser
                    + Memory::levels_too_many(levels, self.options.most_bytes),
            });
        }
        let voxel = content.as_voxel(self.options.colors);
        if self.options.colors == Colors::Classes
            && content.color.is_some()
            && voxel.log_odds.is_occupied()
            && voxel.class == ClassId::NONE
        {
            self.opened.unclassified += 1 << (3 * levels);
        }
        let edge = 1 << levels;
        for dz in 0..edge {
            for dy in 0..edge {
                for dx in 0..edge {
                    let key = VoxelKey::new(x + dx, y + dy, z + dz);
                    self.opened.map.set_voxel(key, voxel);
                }
            }
        }
        Ok(())
    }

    fn read<const N: usize>(&mut self) -> Result<[u8; N], ReadError> {
        let mut bytes = [0; N];
        self.from.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}
