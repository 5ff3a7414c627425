//! The compressed form of a tile.
//!
//! ```text
//! magic "TDTL" · format 1 · codec 1 · x y z · version · resolution · CRC-32C of all the rest · payload
//!     4 bytes      u8        u8       3 i32     u64        f64              u32                         (little-endian)
//! ```
//!
//! The payload is range coded. Space is mostly smooth, so the coder walks through it, block by block, and asks of each
//! voxel first: is it the same as two of its three neighbours behind? How sure that is depends on how many of nine
//! neighbours agree, and on what they are. Only where the answer is no, it codes unknown, free or occupied, and the
//! log-odds, each given the neighbours. Colours are coded as differences from a neighbour's.
//!
//! Contexts see only what has been coded already: everything else counts as unknown, on both sides.

use super::model::{Field, Model};
use super::range_coder::{Bit, Coder, Decoder, Encoder};
use super::{Tile, TileError, TileId};
use crate::voxel::VoxelMap;
use crate::voxel::block::Block;
use crate::voxel::grid::BLOCKS;

const MAGIC: [u8; 4] = *b"TDTL";
/// The newest layout of the header that is understood.
const FORMAT: u8 = 1;
/// The range coder of this module.
const CODEC: u8 = 1;
const HEADER: usize = 38;
/// Where the checksum stands: the end of the header.
const CHECKSUM: usize = HEADER - 4;

impl Tile {
    /// The compressed form. Equal tiles give equal bytes.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(4096);
        bytes.extend(MAGIC);
        bytes.extend([FORMAT, CODEC]);
        for c in [self.id.x, self.id.y, self.id.z] {
            bytes.extend(c.to_le_bytes());
        }
        bytes.extend(self.version.to_le_bytes());
        bytes.extend(self.resolution_m.to_le_bytes());
        bytes.extend([0; 4]);
        let mut encoder = Encoder::new(bytes);
        // The walk fails on hostile bytes only.
        let walked = walk(&mut encoder, &self.blocks);
        debug_assert!(walked.is_some(), "blocks hold only what they may");
        let mut bytes = encoder.finish();
        let checksum = checksum(&bytes);
        bytes[CHECKSUM..HEADER].copy_from_slice(&checksum.to_le_bytes());
        bytes
    }

    /// The tile of which this is the compressed form. Takes at most the memory and time of a full tile, about 15 MB and
    /// 2 million voxels, whatever the bytes.
    pub fn decode(bytes: &[u8]) -> Result<Self, TileError> {
        let mut rest = bytes;
        if take(&mut rest)? != MAGIC {
            return Err(TileError::NotATile);
        }
        let [format, codec] = take(&mut rest)?;
        if format != FORMAT {
            return Err(TileError::OtherFormat {
                found: format,
                newest: FORMAT,
            });
        }
        if codec != CODEC {
            return Err(TileError::OtherCodec {
                found: codec,
                newest: CODEC,
            });
        }
        let mut coordinate = || take(&mut rest).map(i32::from_le_bytes);
        let id = TileId {
            x: coordinate()?,
            y: coordinate()?,
            z: coordinate()?,
        };
        let version = u64::from_le_bytes(take(&mut rest)?);
        let resolution_m = f64::from_le_bytes(take(&mut rest)?);
        let stored = u32::from_le_bytes(take(&mut rest)?);
        let computed = checksum(bytes);
        if stored != computed {
            return Err(TileError::Damaged { stored, computed });
        }
        if !id.is_in_world() {
            return Err(TileError::OutsideWorld(id));
        }
        if !VoxelMap::RESOLUTION_M.contains(&resolution_m) {
            return Err(TileError::BadResolution {
                id,
                tile_m: resolution_m,
            });
        }
        let mut decoder = Decoder::new(rest);
        let blocks = walk(&mut decoder, &[])
            .filter(|_| decoder.is_complete())
            .ok_or(TileError::Malformed(id))?;
        Ok(Self {
            id,
            version,
            resolution_m,
            blocks,
        })
    }
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], TileError> {
    bytes
        .split_off(..N)
        .and_then(|head| head.try_into().ok())
        .ok_or(TileError::TooShort)
}

/// Of everything but the checksum itself.
fn checksum(bytes: &[u8]) -> u32 {
    let head = crc32c::crc32c(&bytes[..CHECKSUM]);
    crc32c::crc32c_append(head, &bytes[HEADER..])
}

/// Codes all blocks: writes the given ones or reads and gives them, depending on the coder. `None` if what is read
/// cannot have been written.
fn walk<C: Coder>(coder: &mut C, given: &[(u16, Block)]) -> Option<Vec<(u16, Block)>> {
    let mut model = Model::new();
    let mut given = given.iter().peekable();
    let mut blocks = Vec::new();
    let colored = given.clone().any(|(_, block)| block.is_colored());
    let colored = coder.bit(&mut Bit::NEW.clone(), colored);
    let mut field = Field::new(colored);
    for at in 0..BLOCKS as u16 {
        let block = given
            .next_if(|(next, _)| *next == at)
            .map(|(_, block)| block);
        if !model.is_present(coder, at, block.is_some()) {
            continue;
        }
        let block = model.block(coder, &mut field, at, block)?;
        if block.is_unknown() || coder.is_exhausted() {
            return None;
        }
        blocks.push((at, block));
    }
    Some(blocks)
}

#[cfg(test)]
mod tests {
    use std::ops::RangeInclusive;

    use proptest::prelude::*;

    use super::*;
    use crate::frame::Point;
    use crate::scan::Scan;
    use crate::voxel::{LogOdds, Rgb, Voxel, VoxelKey};

    const HOME: TileId = TileId { x: 0, y: 0, z: 0 };

    fn any_tile() -> impl Strategy<Value = Tile> {
        let voxel = (
            -40..=70_i8,
            prop::option::of(prop::array::uniform3(any::<u8>())),
        );
        let within: RangeInclusive<i32> = 0..=127;
        let key = prop::array::uniform3(within);
        let voxels = prop::collection::vec((key, voxel), 0..200);
        let id = prop::array::uniform3(-256..256);
        (id, any::<u64>(), 0.001..100.0, voxels).prop_map(
            |([x, y, z], version, resolution_m, voxels)| {
                let id = TileId { x, y, z };
                let mut map = VoxelMap::new(resolution_m);
                let corner = id.corner();
                for ([x, y, z], (steps, color)) in voxels {
                    let key = VoxelKey::new(corner.x + x, corner.y + y, corner.z + z);
                    map.set_voxel(
                        key,
                        Voxel {
                            color: color.map(Rgb),
                            ..Voxel::new(LogOdds(steps))
                        },
                    );
                }
                let tile = map
                    .tile(id)
                    .unwrap_or_else(|| Tile::unknown(id, 0, resolution_m));
                Tile { version, ..tile }
            },
        )
    }

    /// A room 5 m by 4 m, seen all around from a few places.
    fn room() -> VoxelMap {
        let mut map = VoxelMap::new(0.05);
        for step in 0..8 {
            let origin = Point::new(1.0 + 0.3 * f64::from(step), 2.0, 1.5);
            let hits: Vec<_> = (0..20_000)
                .map(|i| {
                    let (turn, z) = (f64::from(i) * 2.399_963, 1.0 - f64::from(i) / 10_000.0);
                    let flat = (1.0 - z * z).max(0.0).sqrt();
                    let ray = [flat * turn.cos(), flat * turn.sin(), z];
                    let to_wall = |at: f64, ray: f64, size: f64| {
                        (if ray > 0.0 { size - at } else { at }) / ray.abs()
                    };
                    let reach = to_wall(origin.raw.x, ray[0], 5.0)
                        .min(to_wall(origin.raw.y, ray[1], 4.0))
                        .min(to_wall(origin.raw.z, ray[2], 2.5));
                    Point::from_raw(origin.raw + nalgebra::Vector3::from(ray) * reach)
                })
                .collect();
            let colors: Vec<_> = hits
                .iter()
                .map(|p| Rgb([p.raw.x, p.raw.y, p.raw.z].map(|c| (c * 40.0) as u8)))
                .collect();
            map.insert_scan(&Scan {
                colors: &colors,
                max_range_m: 10.0,
                ..Scan::new(origin, &hits)
            });
        }
        map
    }

    #[test]
    fn a_room_takes_a_tenth_of_a_byte_for_each_known_voxel() {
        let map = room();
        let (mut bytes, mut known) = (0, 0);
        let mut copy = VoxelMap::new(0.05);
        for id in map.tile_ids() {
            let tile = map.tile(id).expect("it is in the list");
            let encoded = tile.encode();
            let decoded = Tile::decode(&encoded).expect("it was encoded");
            assert_eq!(decoded, tile);
            copy.set_tile(&decoded).expect("the same resolution");
            bytes += encoded.len();
            known += tile.known_count();
        }
        assert_eq!(copy.digest(), map.digest());
        assert!(known > 300_000, "{known} voxels");
        assert!(bytes * 10 < known, "{bytes} bytes for {known} voxels");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn a_tile_comes_back_as_it_was(tile in any_tile()) {
            let bytes = tile.encode();
            prop_assert_eq!(Tile::decode(&bytes), Ok(tile));
        }

        #[test]
        fn any_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            prop_assert!(Tile::decode(&bytes).is_err());
        }

        #[test]
        fn any_payload_with_a_right_checksum_is_survived(payload in prop::collection::vec(any::<u8>(), 0..400)) {
            let mut bytes = Tile::unknown(HOME, 1, 0.1).encode();
            bytes.truncate(HEADER);
            bytes.extend(payload);
            let checksum = checksum(&bytes);
            bytes[CHECKSUM..HEADER].copy_from_slice(&checksum.to_le_bytes());
            if let Ok(tile) = Tile::decode(&bytes) {
                prop_assert_eq!(Tile::decode(&tile.encode()), Ok(tile), "what is accepted is a tile");
            }
        }

        #[test]
        fn a_damaged_byte_is_noticed(tile in any_tile(), at in any::<prop::sample::Index>(), flip in 1..=255_u8) {
            let mut bytes = tile.encode();
            let at = at.index(bytes.len());
            bytes[at] ^= flip;
            prop_assert!(Tile::decode(&bytes).is_err());
        }

        #[test]
        fn a_part_of_a_tile_is_refused(tile in any_tile(), at in any::<prop::sample::Index>()) {
            let bytes = tile.encode();
            prop_assert!(Tile::decode(&bytes[..at.index(bytes.len())]).is_err());
        }
    }

    #[track_caller]
    fn check_refused(position: usize, value: u8, message: &str) {
        let mut bytes = Tile::unknown(HOME, 1, 0.1).encode();
        bytes[position] = value;
        let error = Tile::decode(&bytes).map_err(|e| e.to_string());
        assert_eq!(error, Err(message.to_owned()));
    }

    #[test]
    fn what_is_refused_is_told() {
        check_refused(0, b'X', "not a tile: it does not begin with TDTL");
        check_refused(4, 2, "the tile has format 2, this program reads format 1");
        check_refused(
            5,
            7,
            "the tile is compressed by codec 7, this program knows codec 1",
        );
        let short = Tile::decode(b"TDTL\x01\x01").map_err(|e| e.to_string());
        assert_eq!(short, Err("the tile ends within its header".to_owned()));
    }
}
