//! The voxels that rays cross.

use std::ops::Range;

use super::masks::{Masks, TileMasks};
use super::sectors::{Sectors, sector};
use super::walk::Walk;
use super::{Carving, Rays, Scan, color_of};
use crate::frame::{Point, World};
use crate::tile::TileId;
use crate::voxel::block::Mask;
use crate::voxel::grid::voxel_index;
use crate::voxel::surface::PackedColor;
use crate::voxel::{ClassId, Occupancy, VoxelKey, VoxelMap, floor, key_at};

/// What the points of a scan, or a part of them, have touched.
#[derive(Clone, Debug, Default)]
pub(super) struct Gathered {
    /// Crossed by a ray. Has a mask for each block with a hit, too.
    free: Masks,
    /// With a point in it.
    hit: Masks,
    /// With the end of a ray in it that was cut at the greatest range.
    cut: Masks,
    /// The colour of the first point in each voxel that was hit.
    colors: Vec<(VoxelKey, PackedColor)>,
    /// The class of each point.
    classes: Vec<(VoxelKey, ClassId)>,
}

/// What a part of a scan has touched in one tile.
#[derive(Clone, Copy)]
pub(super) struct Touched<'a> {
    pub(super) free: &'a TileMasks,
    pub(super) hit: Option<&'a TileMasks>,
}

impl Gathered {
    pub(super) fn tiles(&self) -> impl Iterator<Item = TileId> {
        self.free.tiles()
    }

    /// What was touched in a tile; `None` if it never was entered.
    pub(super) fn tile(&self, id: TileId) -> Option<Touched<'_>> {
        let hit = self.hit.tile(id);
        self.free.tile(id).map(|free| Touched { free, hit })
    }

    pub(super) fn has_hit(&self, key: VoxelKey) -> bool {
        let block = crate::voxel::grid::block_index(key);
        let index = voxel_index(key);
        self.hit
            .tile(TileId::of(key))
            .and_then(|tile| tile.get(block))
            .is_some_and(|mask| mask[index / 64] >> (index % 64) & 1 == 1)
    }

    pub(super) fn colors(&self) -> &[(VoxelKey, PackedColor)] {
        &self.colors
    }

    pub(super) fn classes(&self) -> &[(VoxelKey, ClassId)] {
        &self.classes
    }

    pub(super) fn clear(&mut self) {
        self.free.clear();
        self.hit.clear();
        self.cut.clear();
        self.colors.clear();
        self.classes.clear();
    }

    /// Marks what these points of the scan hit, and notes to which of them rays are to be cast.
    pub(super) fn gather(
        &mut self,
        caster: &Caster<'_>,
        points: Range<usize>,
        sectors: &mut Sectors,
    ) {
        let mut last = None;
        sectors.sort(points.filter_map(|index| {
            let hit = caster.scan.hits[index];
            let end = caster.end(hit)?;
            let is_first = self.mark(caster, index, &end, &mut last);
            let is_cast = is_first || caster.scan.rays == Rays::EachPoint;
            // Memory ends before these numbers do.
            let point = u32::try_from(index).ok()?;
            is_cast.then(|| (point, sector((hit - caster.scan.origin).raw)))
        }));
    }

    /// Marks where the ray to a point ends; whether it is the first there. `last` is the voxel hit before: neighbours in an
    /// image mostly hit the same.
    fn mark(
        &mut self,
        caster: &Caster<'_>,
        index: usize,
        end: &End,
        last: &mut Option<VoxelKey>,
    ) -> bool {
        let voxel = voxel_index(end.key);
        if end.is_cut {
            return put(self.cut.of(end.key), voxel);
        }
        self.classes.extend(caster.class_of(index, end.key));
        let is_first = last.replace(end.key) != Some(end.key) && put(self.hit.of(end.key), voxel);
        if is_first {
            let color = color_of(caster.scan, index).map(|color| (end.key, color));
            self.colors.extend(color);
            let _touched = self.free.of(end.key);
        }
        is_first
    }

    /// Marks what the rays to these points cross.
    pub(super) fn cast(&mut self, caster: &Caster<'_>, points: &[u32]) {
        for &point in points {
            let Some(end) = caster.end(caster.scan.hits[point as usize]) else {
                continue;
            };
            let towards = match caster.scan.rays {
                Rays::EachPoint => end.at,
                Rays::EachVoxel => [end.key.x, end.key.y, end.key.z].map(|c| f64::from(c) + 0.5),
            };
            caster.cast(&mut self.free, towards, &end);
        }
    }
}

/// Where a ray ends: at a point, or at the greatest range.
struct End {
    /// In voxels.
    at: [f64; 3],
    key: VoxelKey,
    is_cut: bool,
}

/// Casts the rays of one scan.
pub(super) struct Caster<'a> {
    map: &'a VoxelMap,
    scan: &'a Scan<'a>,
    per_m: f64,
    reach_squared: f64,
    /// The origin, in voxels, and its voxel.
    start: [f64; 3],
    from: [i32; 3],
}

impl<'a> Caster<'a> {
    pub(super) fn new(map: &'a VoxelMap, scan: &'a Scan<'a>) -> Self {
        let per_m = 1.0 / map.resolution_m();
        let reach = scan.max_range_m.max(0.0); // no NaN
        let key = key_at(scan.origin, per_m);
        Self {
            map,
            scan,
            per_m,
            reach_squared: reach * reach,
            start: (scan.origin.raw.coords * per_m).into(),
            from: [key.x, key.y, key.z],
        }
    }

    /// Where the ray to a point ends; `None` if the point is to be ignored.
    fn end(&self, hit: Point<World>) -> Option<End> {
        let ray = hit - self.scan.origin;
        let squared = ray.raw.norm_squared();
        if !squared.is_finite() || hit.raw.z < self.scan.min_height_m {
            return None;
        }
        let is_cut = squared > self.reach_squared;
        let end = if is_cut {
            self.scan.origin + ray * (self.reach_squared / squared).sqrt()
        } else {
            hit
        };
        let at = [end.raw.x, end.raw.y, end.raw.z].map(|c| c * self.per_m);
        let [x, y, z] = at.map(floor);
        let key = VoxelKey { x, y, z };
        key.is_in_world().then_some(End { at, key, is_cut })
    }

    fn class_of(&self, index: usize, key: VoxelKey) -> Option<(VoxelKey, ClassId)> {
        let class = self.scan.classes.get(index)?;
        (*class != ClassId::NONE).then_some((key, *class))
    }

    /// Marks the voxels from that of the origin, included, to that of the end, excluded, on the way to a place in it.
    fn cast(&self, free: &mut Masks, towards: [f64; 3], end: &End) {
        let to = [end.key.x, end.key.y, end.key.z];
        let steps = distance(self.from, to);
        let spared = if end.is_cut {
            0
        } else {
            self.spared(towards, to, steps)
        };
        Walk::new(self.start, self.from, towards).mark(free, steps - spared);
    }

    /// How many of the last steps to an end mark nothing.
    fn spared(&self, towards: [f64; 3], to: [i32; 3], steps: u32) -> u32 {
        let mut spared = 0;
        if self.scan.noise != super::Noise::NONE {
            let ray: [f64; 3] = std::array::from_fn(|i| towards[i] - self.start[i]);
            let length_m = ray.iter().map(|c| c * c).sum::<f64>().sqrt() / self.per_m;
            let share = (1.0 - self.scan.noise.margin_m(length_m) / length_m).max(0.0);
            let stop = std::array::from_fn(|i| floor(self.start[i] + ray[i] * share));
            spared = steps.saturating_sub(distance(self.from, stop));
        }
        if self.scan.carving == Carving::SparesSurfaces {
            spared = spared.max(self.surface_before(towards, to, steps));
        }
        spared
    }

    /// How many occupied voxels are crossed without a gap just before the end.
    fn surface_before(&self, towards: [f64; 3], to: [i32; 3], steps: u32) -> u32 {
        let mut back = Walk::new(towards, to, self.start);
        (0..steps)
            .find(|_| self.map.occupancy(back.advance()) != Occupancy::Occupied)
            .unwrap_or(steps)
    }
}

/// The steps from one voxel to another, each across one face.
fn distance(a: [i32; 3], b: [i32; 3]) -> u32 {
    (0..3).map(|i| a[i].abs_diff(b[i])).sum()
}

/// Sets a bit; whether it was not set before.
fn put(mask: &mut Mask, index: usize) -> bool {
    let bit = 1 << (index % 64);
    let word = &mut mask[index / 64];
    let new = *word & bit == 0;
    *word |= bit;
    new
}
