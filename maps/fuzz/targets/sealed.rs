//! Any payload in a tile whose checksum is right, since a fuzzer finds no checksums.

use maps::scan::Scan;
use maps::tile::{Detail, Tile, TileId};
use maps::time::Stamp;
use maps::voxel::{ClassId, Rgb, Sources, VoxelKey, VoxelMap};

/// The bytes of a header without a base; the checksum is the last four, also of a longer one.
pub const HEADER: usize = 33;
/// What a base adds to it.
pub const BASE: usize = 16;

/// The header of `tile`, which has `header` bytes, before `payload`.
pub fn sealed(mut tile: Vec<u8>, header: usize, payload: &[u8]) -> Vec<u8> {
    tile.truncate(header);
    tile.extend(payload);
    let checksum = crc32c::crc32c_append(crc32c::crc32c(&tile[..header - 4]), &tile[header..]);
    tile[header - 4..header].copy_from_slice(&checksum.to_le_bytes());
    tile
}

/// The detail that a byte stands for.
pub fn detail(byte: u8) -> Detail {
    Detail::ALL[usize::from(byte & 3)]
}

/// A tile with something of everything: a wall with colours and classes, seen twice.
pub fn base() -> Tile {
    let mut map = VoxelMap::new(0.1);
    let origin = map.center_of(VoxelKey::new(30, 20, 20));
    let hits: Vec<_> = (0..200)
        .map(|i| map.center_of(VoxelKey::new(10 + i % 40, 50, 12 + i / 40)))
        .collect();
    let colors: Vec<_> = (0..150_u8).map(|i| Rgb([i, 200, 40])).collect();
    let classes: Vec<_> = (0..100_u8).map(|i| ClassId(i / 30)).collect();
    for (at, source) in [(1, Sources::UAV), (3, Sources::UGV)] {
        map.insert_scan(&Scan {
            colors: &colors,
            classes: &classes,
            at: Stamp::from_nanos(at * 1_000_000_000),
            source,
            ..Scan::new(origin, &hits)
        });
    }
    map.tile(TileId { x: 0, y: 0, z: 0 }).expect("it has voxels")
}
