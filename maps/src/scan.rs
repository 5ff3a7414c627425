//! Adding a scan to the map: every voxel that a ray crosses is free, every voxel in which one ends is occupied.
//!
//! Rays are discretised by their end: of all the points in one voxel, one ray is cast, to its centre. What the rays touch
//! is gathered in bit masks, so that each voxel is updated once a scan however many rays cross it, and *hit* wins over
//! *free*: a wall seen at a grazing angle is not carved away by its own rays. Then each touched block gets one pass.
//!
//! Masks join by *or*, which has no order: the map does not depend on the order of the points (their colours aside).
//!
//! - J. Amanatides, A. Woo, *A fast voxel traversal algorithm for ray tracing*, Eurographics 1987.
//! - A. Hornung et al., *`OctoMap`*, Autonomous Robots 34, 2013, section 5.1 (discretised insertion, preference of hits).

use crate::frame::{Point, World};
use crate::tile::TileId;
use crate::time::Stamp;
use crate::voxel::block::{Mask, NONE};
use crate::voxel::grid::{Directory, Hashed, OfTile, block_index, voxel_index};
use crate::voxel::surface::{PackedColor, PackedSeen, Surface};
use crate::voxel::{ClassId, Rgb, Seen, Sources, VoxelKey, VoxelMap, key_at};

/// Points that one sensor saw at one moment from one place. [`Scan::new`] fills in what a caller has nothing to say of.
#[derive(Clone, Copy, Debug)]
pub struct Scan<'a> {
    /// Where the sensor was.
    pub origin: Point<World>,
    /// Where its rays ended. A point with a NaN or an infinity is ignored, as is one outside of the world.
    pub hits: &'a [Point<World>],
    /// The colour of each point; none of those missing at the end.
    pub colors: &'a [Rgb],
    /// The class of each point; [`ClassId::NONE`] for those missing at the end. Where the points of one voxel differ, most
    /// win, and the lowest id of those that tie.
    pub classes: &'a [ClassId],
    /// A ray is free up to here and what it hits beyond is ignored.
    pub max_range_m: f64,
    /// When.
    pub at: Stamp,
    /// By whom.
    pub source: Sources,
}

impl<'a> Scan<'a> {
    /// Points without colour or class, of any range, seen at the start of the clock by nobody in particular.
    pub const fn new(origin: Point<World>, hits: &'a [Point<World>]) -> Self {
        Self {
            origin,
            hits,
            colors: &[],
            classes: &[],
            max_range_m: f64::INFINITY,
            at: Stamp::ZERO,
            source: Sources::NONE,
        }
    }
}

impl VoxelMap {
    /// Adds a scan. Nothing happens if its origin is outside of the world.
    pub fn insert_scan(&mut self, scan: &Scan<'_>) {
        let per_m = 1.0 / self.resolution_m();
        if !scan.origin.is_finite() || !key_at(scan.origin, per_m).is_in_world() {
            return;
        }
        let mut marks = std::mem::take(&mut self.marks);
        marks.gather(scan, per_m);
        let seen = Seen {
            at: scan.at,
            sources: scan.source,
        };
        self.update(&marks, seen.into());
        marks.clear();
        self.marks = marks;
    }

    /// One update for each voxel that is marked, and one version more for each tile that changed.
    fn update(&mut self, marks: &Marks, seen: PackedSeen) {
        for &position in &marks.touched {
            let tile_marks = marks.tiles.at(position);
            let tile = self.tile_mut(tile_marks.id);
            for (at, marks) in &tile_marks.blocks {
                if marks.free != NONE || marks.hit != NONE {
                    let changed = tile.block_mut(*at).update(&marks.free, &marks.hit, seen);
                    tile.note(changed);
                }
            }
        }
        for &(key, color) in &marks.colored {
            self.see(key, |surface| surface.see_color(color));
        }
        for &(key, class) in &marks.classified {
            self.see(key, |surface| surface.see_class(class));
        }
        for &position in &marks.touched {
            self.tile_mut(marks.tiles.at(position).id).commit();
        }
    }
}

impl VoxelMap {
    /// Changes what is kept of a voxel, if it is occupied.
    fn see(&mut self, key: VoxelKey, change: impl FnOnce(&mut Surface)) {
        let tile = self.tile_mut(TileId::of(key));
        if let Some(surface) = tile
            .block_mut(block_index(key))
            .surface_mut(voxel_index(key))
        {
            let before = *surface;
            change(surface);
            let changed = !before.is_same(*surface);
            tile.note(changed);
        }
    }
}

/// What one scan has touched.
#[derive(Clone, Debug, Default)]
pub(crate) struct Marks {
    tiles: Hashed<TileMarks>,
    /// Which tiles this scan has touched; the others wait, empty, for a later one.
    touched: Vec<usize>,
    /// The tile asked for last.
    recent: Option<(TileId, usize)>,
    /// The colour of the first point in each voxel that was hit.
    colored: Vec<(VoxelKey, PackedColor)>,
    /// The classes of all points, then the class that most points of a voxel have.
    classified: Vec<(VoxelKey, ClassId)>,
    ends: Vec<VoxelKey>,
}

#[derive(Clone, Debug)]
struct TileMarks {
    id: TileId,
    directory: Directory,
    blocks: Vec<(u16, BlockMarks)>,
}

#[derive(Clone, Debug)]
struct BlockMarks {
    /// Crossed by a ray.
    free: Mask,
    /// With a point in it.
    hit: Mask,
    /// With the end of a ray in it, which is a point or the limit of the range.
    end: Mask,
}

impl OfTile for TileMarks {
    fn new(id: TileId) -> Self {
        Self {
            id,
            directory: Directory::new(),
            blocks: Vec::new(),
        }
    }
}

impl Marks {
    /// Marks every voxel in which a ray of the scan ends and every voxel that one crosses.
    fn gather(&mut self, scan: &Scan<'_>, per_m: f64) {
        let reach = scan.max_range_m.max(0.0); // no NaN
        let mut ends = std::mem::take(&mut self.ends);
        for (index, hit) in scan.hits.iter().enumerate() {
            let ray = *hit - scan.origin;
            let squared = ray.raw.norm_squared();
            if !squared.is_finite() {
                continue;
            }
            let beyond = squared > reach * reach;
            let end = if beyond {
                scan.origin + ray * (reach / squared.sqrt())
            } else {
                *hit
            };
            let key = key_at(end, per_m);
            if !key.is_in_world() {
                continue;
            }
            let voxel = voxel_index(key);
            let marks = self.block_mut(TileId::of(key), block_index(key));
            if put(&mut marks.end, voxel) {
                ends.push(key);
            }
            if beyond {
                continue;
            }
            if put(&mut marks.hit, voxel) {
                let color = scan.colors.get(index).map(|c| (key, (*c).into()));
                self.colored.extend(color);
            }
            let class = scan.classes.get(index).filter(|c| **c != ClassId::NONE);
            self.classified.extend(class.map(|class| (key, *class)));
        }
        let points = std::mem::take(&mut self.classified);
        self.classified = majorities(points);
        let start = Start {
            key: key_at(scan.origin, per_m),
            at: (scan.origin.raw.coords * per_m).into(),
        };
        for &end in &ends {
            self.mark_ray(&start, end);
        }
        ends.clear();
        self.ends = ends;
    }

    /// Marks the voxels from the one at the start, included, to the one at the end, excluded.
    ///
    /// Positions along the ray count from 0 at the start to 1 at the centre of the end. The sum of the steps along each
    /// axis is known beforehand; rounding cannot change which those are, as the end is half a voxel from any border.
    fn mark_ray(&mut self, start: &Start, end: VoxelKey) {
        let from = [start.key.x, start.key.y, start.key.z];
        let to = [end.x, end.y, end.z];
        let ray: [f64; 3] = std::array::from_fn(|i| f64::from(to[i]) + 0.5 - start.at[i]);
        let step = ray.map(|c| if c > 0.0 { 1 } else { -1 });
        let delta = ray.map(|c| 1.0 / c.abs());
        let [mut next_x, mut next_y, mut next_z] = std::array::from_fn(|i| {
            let border = f64::from(from[i] + i32::from(step[i] > 0));
            if ray[i] == 0.0 {
                f64::INFINITY
            } else {
                (border - start.at[i]) / ray[i]
            }
        });
        let mut remaining: u32 = (0..3).map(|i| to[i].abs_diff(from[i])).sum();
        let [mut x, mut y, mut z] = from;
        while remaining > 0 {
            let key = VoxelKey::new(x, y, z);
            let marks = self.block_mut(TileId::of(key), block_index(key));
            loop {
                marks.free[(z & 7) as usize] |= 1 << ((y & 7) << 3 | x & 7);
                remaining -= 1;
                let (was, is) = if next_x < next_y && next_x < next_z {
                    next_x += delta[0];
                    x += step[0];
                    (x - step[0], x)
                } else if next_y < next_z {
                    next_y += delta[1];
                    y += step[1];
                    (y - step[1], y)
                } else {
                    next_z += delta[2];
                    z += step[2];
                    (z - step[2], z)
                };
                let left_the_block = (was ^ is) & !7 != 0;
                if left_the_block || remaining == 0 {
                    break;
                }
            }
        }
    }

    fn block_mut(&mut self, tile: TileId, block: u16) -> &mut BlockMarks {
        let position = match self.recent {
            Some((recent, position)) if recent == tile => position,
            _ => self.enter(tile),
        };
        self.tiles.at_mut(position).block_mut(block)
    }

    fn enter(&mut self, tile: TileId) -> usize {
        let position = self.tiles.position(tile);
        if self.tiles.at(position).blocks.is_empty() {
            self.touched.push(position);
        }
        self.recent = Some((tile, position));
        position
    }

    /// Forgets the scan but keeps the memory for the next, unless most of it lies where the sensor no longer is.
    fn clear(&mut self) {
        if self.tiles.values().count() > 16 + 2 * self.touched.len() {
            *self = Self::default();
            return;
        }
        for position in self.touched.drain(..) {
            let tile = self.tiles.at_mut(position);
            for (block, _) in tile.blocks.drain(..) {
                tile.directory.clear(block);
            }
        }
        self.recent = None;
        self.colored.clear();
        self.classified.clear();
    }
}

impl TileMarks {
    fn block_mut(&mut self, block: u16) -> &mut BlockMarks {
        let slot = self.directory.get(block).unwrap_or_else(|| {
            let slot = self.blocks.len();
            self.blocks.push((block, BlockMarks::EMPTY));
            self.directory.set(block, slot);
            slot
        });
        &mut self.blocks[slot].1
    }
}

impl BlockMarks {
    const EMPTY: Self = Self {
        free: NONE,
        hit: NONE,
        end: NONE,
    };
}

/// Where the rays start: in voxels, and in which.
struct Start {
    at: [f64; 3],
    key: VoxelKey,
}

/// One class for each voxel: that of most of its points, the lowest of those that tie.
fn majorities(mut points: Vec<(VoxelKey, ClassId)>) -> Vec<(VoxelKey, ClassId)> {
    points.sort_unstable();
    points
        .chunk_by(|a, b| a.0 == b.0)
        .filter_map(|voxel| {
            let classes = voxel.chunk_by(|a, b| a.1 == b.1);
            let most = classes.max_by_key(|same| (same.len(), std::cmp::Reverse(same[0].1)))?;
            most.first().copied()
        })
        .collect()
}

/// Sets a bit; whether it was not set before.
fn put(mask: &mut Mask, index: usize) -> bool {
    let bit = 1 << (index % 64);
    let word = &mut mask[index / 64];
    let new = *word & bit == 0;
    *word |= bit;
    new
}
