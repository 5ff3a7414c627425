//! Adding a scan to the map: every voxel that a ray crosses is free, every voxel in which one ends is occupied.
//!
//! What the rays touch is gathered in bit masks, so that each voxel is updated once a scan however many rays cross it, and
//! *hit* wins over *free*. Then each touched block gets one pass. Masks join by *or*, which has no order: the map depends
//! neither on the order of the points (their colours aside) nor on the number of threads. Called within a rayon pool, the
//! points, the rays (by sectors of azimuth) and then the tiles are spread over its threads; anywhere else one thread does
//! it all.
//!
//! Thin things survive ([`Carving::SparesSurfaces`]): a ray that grazes a surface before it ends in it does not wear it away.
//! A sensor's noise, if it is known, makes what it says of a place weigh less ([`Noise`]).
//!
//! - J. Amanatides, A. Woo, *A fast voxel traversal algorithm for ray tracing*, Eurographics 1987.
//! - A. Hornung et al., *`OctoMap`*, Autonomous Robots 34, 2013, section 5.1 (discretised insertion, preference of hits).

mod masks;
mod noise;
mod rays;
mod sectors;
mod walk;

use rayon::prelude::*;

use crate::frame::{Point, World};
use crate::tile::TileId;
use crate::time::Stamp;
use crate::voxel::block::{Block, Mask, NONE};
use crate::voxel::grid::{TileNode, block_corner, block_index, voxel_index};
use crate::voxel::surface::{PackedColor, PackedSeen, Surface};
use crate::voxel::{ClassId, Rgb, Seen, Sources, VoxelKey, VoxelMap, key_at};
pub use noise::Noise;
use rays::{Caster, Gathered};
use sectors::{Sectors, Shares};

/// Points that one sensor saw at one moment from one place. [`Scan::new`] fills in what a caller has nothing to say of.
#[derive(Clone, Copy, Debug)]
pub struct Scan<'a> {
    /// Where the sensor was.
    pub origin: Point<World>,
    /// Where its rays ended. A point with a NaN or an infinity is ignored, as is one outside of the world.
    pub hits: &'a [Point<World>],
    /// The colour of each point; none of those missing at the end. The first point in a voxel counts.
    pub colors: &'a [Rgb],
    /// The class of each point; [`ClassId::NONE`] for those missing at the end. Where the points of one voxel differ, most
    /// win, and the lowest id of those that tie.
    pub classes: &'a [ClassId],
    /// A ray is free up to here and what it hits beyond is ignored.
    pub max_range_m: f64,
    /// Points below are ignored, rays and all: reflections in wet ground.
    pub min_height_m: f64,
    /// The least and the greatest corner of a box outside of which nothing is updated. Rays cross it on their way.
    pub within: Option<[Point<World>; 2]>,
    /// How many rays are cast.
    pub rays: Rays,
    /// Which of the voxels that a ray crosses become freer.
    pub carving: Carving,
    /// How far the points may be off along their rays.
    pub noise: Noise,
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
            min_height_m: f64::NEG_INFINITY,
            within: None,
            rays: Rays::EachVoxel,
            carving: Carving::SparesSurfaces,
            noise: Noise::NONE,
            at: Stamp::ZERO,
            source: Sources::NONE,
        }
    }
}

/// How many rays are cast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rays {
    /// One to each point: what sparse `LiDAR` sweeps need to free all that they saw.
    EachPoint,
    /// One to the centre of each voxel with points in it: a depth image has dozens in one.
    EachVoxel,
}

/// Which of the voxels that a ray crosses become freer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carving {
    /// All but those that are hit in the same scan, as in `OctoMap`.
    EveryVoxel,
    /// Not the occupied voxels that the ray crosses last before its end without a gap: it runs along a surface there, and
    /// the floor would be worn away by rays that graze it. What stands apart from where the ray ends is still carved.
    SparesSurfaces,
}

/// What the scan under way has touched.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    /// By each thread.
    parts: Vec<Gathered>,
    /// The rays to the points of each part.
    sectors: Vec<Sectors>,
}

impl VoxelMap {
    /// Adds a scan. Nothing happens if its origin is outside of the world.
    pub fn insert_scan(&mut self, scan: &Scan<'_>) {
        let per_m = 1.0 / self.resolution_m();
        if !scan.origin.is_finite() || !key_at(scan.origin, per_m).is_in_world() {
            return;
        }
        let threads = match rayon::current_thread_index() {
            Some(_) => rayon::current_num_threads(),
            None => 1,
        };
        let mut scratch = std::mem::take(&mut self.scratch);
        let Scratch { parts, sectors } = &mut scratch;
        let count = threads.max(1);
        parts.resize_with(count, Gathered::default);
        sectors.resize_with(count, Sectors::default);
        let caster = Caster::new(self, scan);
        let mut pairs: Vec<_> = parts.iter_mut().zip(&mut *sectors).collect();
        each(&mut pairs, |(i, (part, sectors))| {
            let cut = |i: usize| scan.hits.len() * i / count;
            part.gather(&caster, cut(i)..cut(i + 1), sectors);
        });
        let shares = Shares::new(sectors, count);
        each(parts, |(i, part)| {
            while let Some(sector) = shares.next(i) {
                for sectors in &*sectors {
                    part.cast(&caster, sectors.points(sector));
                }
            }
        });
        self.update(parts, scan);
        parts.iter_mut().for_each(Gathered::clear);
        self.scratch = scratch;
    }

    /// One update for each voxel that is marked, and one version more for each tile that changed.
    fn update(&mut self, parts: &[Gathered], scan: &Scan<'_>) {
        let mut ids: Vec<_> = parts
            .iter()
            .flat_map(Gathered::tiles)
            .filter(|id| id.is_in_world())
            .collect();
        ids.sort_unstable();
        ids.dedup();
        let update = Update::new(scan, self.resolution_m());
        let mut nodes = self.tiles_mut().many_mut(&ids);
        if parts.len() == 1 {
            for node in &mut nodes {
                update.tile(node, parts);
            }
        } else {
            nodes
                .par_iter_mut()
                .with_max_len(1)
                .for_each(|node| update.tile(node, parts));
        }
        self.see_surfaces(parts);
        for node in self.tiles_mut().many_mut(&ids) {
            node.commit();
        }
    }

    /// Colours and classes, where voxels are occupied now.
    fn see_surfaces(&mut self, parts: &[Gathered]) {
        for (i, part) in parts.iter().enumerate() {
            for &(key, color) in part.colors() {
                // The first point of a voxel counts, and it is in the first part that hit the voxel.
                if !parts[..i].iter().any(|before| before.has_hit(key)) {
                    self.see(key, |surface| surface.see_color(color));
                }
            }
        }
        let classes = parts.iter().flat_map(Gathered::classes).copied().collect();
        for (key, class) in majorities(classes) {
            self.see(key, |surface| surface.see_class(class));
        }
    }

    /// Changes what is kept of a voxel, if it is occupied.
    fn see(&mut self, key: VoxelKey, change: impl FnOnce(&mut Surface)) {
        let at = block_index(key);
        let tile = self.tile_mut(TileId::of(key));
        if tile.block(at).is_none() {
            return; // outside of the box that is updated
        }
        tile.edit(at, |block| {
            let Some(surface) = block.surface_mut(voxel_index(key)) else {
                return false;
            };
            let before = *surface;
            change(surface);
            !before.is_same(*surface)
        });
    }
}

/// Does something to each of several, if there are several on as many threads.
fn each<T: Send>(all: &mut [T], work: impl Fn((usize, &mut T)) + Sync + Send) {
    if all.len() == 1 {
        all.iter_mut().enumerate().for_each(work);
    } else {
        all.par_iter_mut().enumerate().for_each(work);
    }
}

/// What a scan does to blocks.
struct Update {
    seen: PackedSeen,
    noise: Noise,
    origin: Point<World>,
    resolution_m: f64,
    /// The least and the greatest voxel that may be updated.
    within: Option<[VoxelKey; 2]>,
}

impl Update {
    fn new(scan: &Scan<'_>, resolution_m: f64) -> Self {
        let seen = Seen {
            at: scan.at,
            sources: scan.source,
        };
        Self {
            seen: seen.into(),
            noise: scan.noise,
            origin: scan.origin,
            resolution_m,
            within: scan
                .within
                .map(|corners| corners.map(|corner| key_at(corner, 1.0 / resolution_m))),
        }
    }

    fn tile(&self, node: &mut TileNode, parts: &[Gathered]) {
        let id = node.id;
        let touched: Vec<_> = parts.iter().filter_map(|part| part.tile(id)).collect();
        let blocks = || {
            touched.iter().enumerate().flat_map(|(i, part)| {
                let before = &touched[..i];
                // Blocks are updated with the first part that has them.
                let is_first = |at: &u16| before.iter().all(|p| p.free.get(*at).is_none());
                let places = part.free.places().iter().copied().filter(is_first);
                places.map(move |at| (i, at))
            })
        };
        let is_new = |at: u16| {
            let corner = block_corner(id, at);
            node.block(at).is_none() && self.within.is_none_or(|w| inside(corner, w) != NONE)
        };
        let new = blocks().filter(|(_, at)| is_new(*at)).count();
        node.reserve(new);
        for (first, at) in blocks() {
            let (mut free, mut hit) = (NONE, NONE);
            for part in &touched[first..] {
                join(&mut free, part.free.get(at));
                join(&mut hit, part.hit.and_then(|hit| hit.get(at)));
            }
            let corner = block_corner(id, at);
            if let Some(within) = self.within {
                let inside = inside(corner, within);
                for z in 0..inside.len() {
                    free[z] &= inside[z];
                    hit[z] &= inside[z];
                }
            }
            if free != NONE || hit != NONE {
                node.edit(at, |block| self.block(block, corner, [&free, &hit]));
            }
        }
    }

    fn block(&self, block: &mut Block, corner: VoxelKey, [free, hit]: [&Mask; 2]) -> bool {
        let weights = if self.noise == Noise::NONE {
            noise::Weights::FULL
        } else {
            let middle = [corner.x, corner.y, corner.z].map(|c| f64::from(c) + 4.0);
            let middle = nalgebra::Point3::from(middle) * self.resolution_m;
            let range_m = (middle - self.origin.raw).norm();
            self.noise.weights(range_m, self.resolution_m)
        };
        block.update(free, hit, [weights.miss, weights.hit], self.seen)
    }
}

fn join(mask: &mut Mask, other: Option<&Mask>) {
    for (word, other) in mask.iter_mut().zip(other.into_iter().flatten()) {
        *word |= other;
    }
}

/// The voxels of a block that are between two others, both inclusive.
fn inside(corner: VoxelKey, [low, high]: [VoxelKey; 2]) -> Mask {
    // The first and the one after the last within 0..=8 along an axis.
    let range = |corner: i32, low: i32, high: i32| {
        let from = low.saturating_sub(corner).clamp(0, 8);
        let to = high.saturating_sub(corner).saturating_add(1).clamp(0, 8);
        from..to
    };
    let row = range(corner.x, low.x, high.x).fold(0_u64, |row, x| row | 1 << x);
    let slice = range(corner.y, low.y, high.y).fold(0_u64, |slice, y| slice | row << (8 * y));
    let mut mask = NONE;
    for z in range(corner.z, low.z, high.z) {
        mask[z as usize] = slice;
    }
    mask
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

/// The packed colour of a point.
fn color_of(scan: &Scan<'_>, index: usize) -> Option<PackedColor> {
    scan.colors.get(index).map(|color| (*color).into())
}

#[cfg(test)]
mod tests;
