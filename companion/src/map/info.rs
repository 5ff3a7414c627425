//! What is in a map.

use std::fmt;

use maps::tile::Tile;
use maps::voxel::{ClassId, VoxelMap};

use super::files::OpenedMap;

/// What is in a map, a line for each thing to know.
pub struct Info<'a> {
    opened: &'a OpenedMap,
    /// Whether a line for each tile follows.
    tiles: Tiles,
}

/// Whether tiles are listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tiles {
    /// Their number only.
    Counted,
    /// A line each.
    Listed,
}

impl<'a> Info<'a> {
    /// What is in this map.
    pub fn new(opened: &'a OpenedMap, tiles: Tiles) -> Self {
        Self { opened, tiles }
    }
}

/// Lines of a name and what it is, then perhaps a table.
impl fmt::Display for Info<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let map = &self.opened.map;
        let ids = map.tile_ids();
        let occupied = map.occupied_count();
        let free = map.known_count() - occupied;
        let has = |what: fn(&maps::voxel::Voxel) -> bool| {
            map.occupied().filter(|(_, voxel)| what(voxel)).count()
        };
        let (colored, classified) = (
            has(|voxel| voxel.color.is_some()),
            has(|voxel| voxel.class != ClassId::NONE),
        );
        writeln!(f, "file        {}", self.opened.kind)?;
        writeln!(f, "resolution  {} m", map.resolution_m())?;
        writeln!(f, "bounds      {}", Bounds(map))?;
        writeln!(
            f,
            "occupied    {occupied} voxels, {colored} with a colour, {classified} with a class"
        )?;
        writeln!(f, "free        {free} voxels")?;
        if self.opened.unclassified > 0 {
            let count = self.opened.unclassified;
            writeln!(
                f,
                "no class    {count} voxels have colours that are no class of the palette"
            )?;
        }
        writeln!(f, "tiles       {}", ids.len())?;
        if let Some(bytes) = self.opened.resident_bytes {
            let mib = bytes as f64 / f64::from(1 << 20);
            let known = map.known_count().max(1) as f64;
            let each = bytes as f64 / known;
            writeln!(f, "memory      {mib:.1} MiB, {each:.2} bytes a known voxel")?;
        }
        writeln!(f, "digest      {}", map.digest())?;
        if self.tiles == Tiles::Listed {
            writeln!(f, "\ntile            occupied       free  digest")?;
            for tile in ids.into_iter().filter_map(|id| map.tile(id)) {
                write_tile(&tile, f)?;
            }
        }
        Ok(())
    }
}

fn write_tile(tile: &Tile, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let occupied = tile.occupied_count();
    let free = tile.known_count() - occupied;
    let id = tile.id.to_string();
    writeln!(
        f,
        "{id:<12} {occupied:>11} {free:>10}  {:016x}",
        tile.digest()
    )
}

struct Bounds<'a>(&'a VoxelMap);

impl fmt::Display for Bounds<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((low, high)) = self.0.bounds() else {
            return f.write_str("nothing is known");
        };
        let resolution_m = self.0.resolution_m();
        let axes = [
            ("east", low.x, high.x),
            ("north", low.y, high.y),
            ("up", low.z, high.z),
        ];
        for (place, (name, low, high)) in axes.into_iter().enumerate() {
            let [from_m, to_m] = [low, high + 1].map(|c| f64::from(c) * resolution_m);
            let comma = if place == 0 { "" } else { ", " };
            write!(f, "{comma}{from_m:.2} to {to_m:.2} m {name}")?;
        }
        Ok(())
    }
}
