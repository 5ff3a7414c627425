//! The compressed form of a tile: a [header](TileHeader), then the payload.
//!
//! The payload is range coded, one kind of content after another, so that each sees all of those before: which blocks there
//! are, which voxels are free and occupied, their log-odds, their colours and classes, and when they were seen. Each kind
//! walks through the tile slice by slice and expects every voxel to be like those it has passed.
//!
//! A change of a base first names the blocks that differ from it; only those are coded, and expected to be as in the base.
//! Whoever decodes it must have the very same base: its digest is in the header.
//!
//! Contexts see only what has been coded already: everything else counts as unknown, on both sides.

use super::field::{Field, Rows};
use super::header::{self, TileHeader};
use super::range_coder::{Bit, Coder, Decoder, Encoder};
use super::sightings::Sightings;
use super::states::States;
use super::surfaces::{Classes, Colors};
use super::values::Values;
use super::{Detail, Tile, TileError};
use crate::voxel::block::Block;
use crate::voxel::grid::BLOCKS;
use crate::voxel::surface::Surface;

/// Blocks by their place in the tile, ascending.
type Blocks = [(u16, Block)];

impl Tile {
    /// The compressed form with all that makes maps equal. Equal tiles give equal bytes, on every machine.
    pub fn encode(&self) -> Vec<u8> {
        self.encode_as(Detail::Surface)
    }

    /// The compressed form with that much detail. Takes time in the voxels of known blocks.
    pub fn encode_as(&self, detail: Detail) -> Vec<u8> {
        write(&self.reduced(detail), None, detail)
    }

    /// The compressed form as a change of `base`: small if little changed. Whoever decodes it must have that version with
    /// at least this detail.
    pub fn encode_change(&self, base: &Self, detail: Detail) -> Vec<u8> {
        write(&self.reduced(detail), Some(&base.reduced(detail)), detail)
    }

    /// The tile of which this is the compressed form; one that is a change of a base is refused. Takes at most the memory
    /// and time of a full tile, 2 million voxels, whatever the bytes.
    pub fn decode(bytes: &[u8]) -> Result<Self, TileError> {
        let (header, payload) = TileHeader::split(bytes)?;
        if let Some(needed) = header.base {
            let id = header.id;
            return Err(TileError::NeedsBase { id, needed });
        }
        read(&header, payload, None)
    }

    /// As [`Self::decode`], and a change of `base` is understood too; one of anything else is refused.
    pub fn decode_change(bytes: &[u8], base: &Self) -> Result<Self, TileError> {
        let (header, payload) = TileHeader::split(bytes)?;
        let Some(needed) = header.base else {
            return read(&header, payload, None);
        };
        let base = base.reduced(header.detail);
        let given = base.as_base(header.detail);
        if given.digest != needed.digest {
            let id = header.id;
            return Err(TileError::OtherBase { id, needed, given });
        }
        read(&header, payload, Some(&base))
    }
}

/// Compresses a tile; it and its base are reduced already.
fn write(tile: &Tile, base: Option<&Tile>, detail: Detail) -> Vec<u8> {
    let header = TileHeader {
        id: tile.id,
        version: tile.version,
        resolution_m: tile.resolution_m,
        detail,
        base: base.map(|base| base.as_base(detail)),
    };
    let head = header.write();
    let length = head.len();
    let mut encoder = Encoder::new(head);
    let known = base.map(|base| &base.blocks[..]);
    // The walk fails on hostile bytes only.
    let walked = walk(&mut encoder, detail, known, &tile.blocks);
    debug_assert!(walked.is_some(), "blocks hold only what they may");
    let mut bytes = encoder.finish();
    header::seal(&mut bytes, length);
    bytes
}

fn read(header: &TileHeader, payload: &[u8], base: Option<&Tile>) -> Result<Tile, TileError> {
    let mut decoder = Decoder::new(payload);
    let known = base.map(|base| &base.blocks[..]);
    let blocks = walk(&mut decoder, header.detail, known, &[])
        .filter(|_| decoder.is_complete())
        .ok_or(TileError::Malformed(header.id))?;
    Ok(Tile {
        id: header.id,
        version: header.version,
        resolution_m: header.resolution_m,
        blocks,
    })
}

/// Codes all blocks: writes the given ones or reads and gives them, depending on the coder. `None` if what is read
/// cannot have been written.
fn walk<C: Coder>(
    coder: &mut C,
    detail: Detail,
    base: Option<&Blocks>,
    given: &Blocks,
) -> Option<Vec<(u16, Block)>> {
    let presence = presence(coder, detail, base, given)?;
    let mut rows = Rows::new();
    let coded = presence.iter().filter(|(_, is)| *is == Presence::Coded);
    for (at, _) in coded {
        rows.add(*at);
    }
    let mut field = Field::of(given.iter().map(|(at, block)| (*at, block)));
    for (at, _) in presence.iter().filter(|(_, is)| *is == Presence::AsBase) {
        field.put(*at, find(base?, *at)?);
    }
    let before = base.map(|base| Field::of(base.iter().map(|(at, block)| (*at, block))));
    layers(coder, detail, (&mut field, before.as_ref()), &rows)?;
    let mut sightings = Sightings::new();
    let mut blocks = Vec::with_capacity(presence.len());
    for (at, is) in presence {
        if is == Presence::AsBase {
            blocks.push((at, find(base?, at)?.clone()));
            continue;
        }
        let mut block = block(&field, detail, at);
        if detail == Detail::Sightings {
            sightings.code(coder, find(given, at), &mut block)?;
        }
        if block.is_unknown() || coder.is_exhausted() {
            return None;
        }
        blocks.push((at, block));
    }
    Some(blocks)
}

/// Codes the voxels of these rows.
fn layers<C: Coder>(
    coder: &mut C,
    detail: Detail,
    (field, base): (&mut Field, Option<&Field>),
    rows: &Rows,
) -> Option<()> {
    States::new().code(coder, field, base, rows)?;
    if detail >= Detail::LogOdds {
        Values::new().code(coder, field, base, rows)?;
    } else {
        field.make_sure(rows);
    }
    if detail >= Detail::Surface {
        let (has_colors, has_classes) = (field.has_colors(), field.has_classes());
        let had = |which: fn(&Field) -> bool| base.is_some_and(which);
        if coder.bit(&mut Bit::NEW.clone(), has_colors || had(Field::has_colors)) {
            Colors::new().code(coder, field, base, rows)?;
        }
        if coder.bit(
            &mut Bit::NEW.clone(),
            has_classes || had(Field::has_classes),
        ) {
            Classes::new().code(coder, field, base, rows)?;
        }
    }
    Some(())
}

/// The block that a field holds at a place.
fn block(field: &Field, detail: Detail, at: u16) -> Block {
    Block::from_voxels(&field.log_odds(at), |index| {
        if detail < Detail::Surface {
            return Surface::default();
        }
        let i = super::field::place(at, index);
        Surface::new(field.color(i), field.class(i))
    })
}

/// Where a block of a tile comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Presence {
    Coded,
    AsBase,
}

/// Codes which blocks there are, and which of them are as in the base.
fn presence<C: Coder>(
    coder: &mut C,
    detail: Detail,
    base: Option<&Blocks>,
    given: &Blocks,
) -> Option<Vec<(u16, Presence)>> {
    let mut blocks = Vec::with_capacity(given.len());
    let (mut present, mut changed) = (Behind::new(), Behind::new());
    let mut present_contexts = [[Bit::NEW; 8]; 3];
    let mut changed_contexts = [[Bit::NEW; 8]; 2];
    for at in 0..BLOCKS as u16 {
        let block = find(given, at);
        let before = base.and_then(|base| find(base, at));
        let was = usize::from(before.is_some());
        if base.is_some() {
            let is_changed = !is_same(block, before, detail);
            let context = &mut changed_contexts[was][changed.context(at)];
            if !coder.bit(context, is_changed) {
                present.set(at, before.is_some());
                blocks.extend(before.map(|_| (at, Presence::AsBase)));
                continue;
            }
            changed.set(at, true);
        }
        let kind = if base.is_some() { 1 + was } else { 0 };
        let context = &mut present_contexts[kind][present.context(at)];
        if coder.bit(context, block.is_some()) {
            present.set(at, true);
            blocks.push((at, Presence::Coded));
        }
    }
    (!coder.is_exhausted()).then_some(blocks)
}

fn find(blocks: &Blocks, at: u16) -> Option<&Block> {
    let place = blocks.binary_search_by_key(&at, |(at, _)| *at).ok()?;
    Some(&blocks[place].1)
}

fn is_same(one: Option<&Block>, other: Option<&Block>, detail: Detail) -> bool {
    let (Some(one), Some(other)) = (one, other) else {
        return one.is_none() && other.is_none();
    };
    let are_seen_alike = || {
        let mut surfaces = one.surfaces().iter().zip(other.surfaces());
        one.slices_seen() == other.slices_seen() && surfaces.all(|(a, b)| a.seen == b.seen)
    };
    one == other && (detail < Detail::Sightings || are_seen_alike())
}

/// A property of blocks, and what it is of the three behind a block.
struct Behind(Box<[bool; 17 * 17 * 17]>);

impl Behind {
    fn new() -> Self {
        Self(Box::new([false; 17 * 17 * 17]))
    }

    fn place(at: u16) -> usize {
        let [x, y, z] = [0, 4, 8].map(|shift| usize::from(at >> shift & 15) + 1);
        (z * 17 + y) * 17 + x
    }

    fn set(&mut self, at: u16, value: bool) {
        self.0[Self::place(at)] = value;
    }

    fn context(&self, at: u16) -> usize {
        let i = Self::place(at);
        let behind = [1, 17, 17 * 17].map(|back| usize::from(self.0[i - back]));
        behind[0] | behind[1] << 1 | behind[2] << 2
    }
}

#[cfg(test)]
mod tests {
    use std::ops::RangeInclusive;

    use proptest::prelude::*;

    use super::*;
    use crate::frame::Point;
    use crate::scan::Scan;
    use crate::tile::TileId;
    use crate::time::Stamp;
    use crate::voxel::{ClassId, LogOdds, Rgb, Sources, Voxel, VoxelKey, VoxelMap};

    const HOME: TileId = TileId { x: 0, y: 0, z: 0 };
    const WHOLE_HEADER: usize = 33;
    const CHANGE_HEADER: usize = WHOLE_HEADER + 16;

    /// A voxel within a tile, its log-odds, colour, class, and when and by whom it was seen.
    type Seed = ([i32; 3], i8, Option<[u8; 3]>, u8, (u16, u8));

    fn any_voxels(most: usize) -> impl Strategy<Value = Vec<Seed>> {
        let within: RangeInclusive<i32> = 0..=127;
        let key = prop::array::uniform3(within);
        let color = prop::option::of(prop::array::uniform3(any::<u8>()));
        let class = prop_oneof![Just(0_u8), 0..5_u8, any::<u8>()];
        let voxel = (key, -40..=70_i8, color, class, (any::<u16>(), 0..8_u8));
        prop::collection::vec(voxel, 0..most)
    }

    fn any_tile() -> impl Strategy<Value = Tile> {
        let id = prop::array::uniform3(-256..256);
        (id, any::<u64>(), 0.001..100.0, any_voxels(200)).prop_map(
            |([x, y, z], version, resolution_m, voxels)| {
                let tile = Tile::unknown(TileId { x, y, z }, version, resolution_m);
                with_voxels(&tile, &voxels)
            },
        )
    }

    /// A tile, and the same one with some more voxels or others.
    fn any_change() -> impl Strategy<Value = (Tile, Tile)> {
        (any_tile(), any_voxels(60)).prop_map(|(base, voxels)| {
            let changed = with_voxels(&base, &voxels);
            let version = base.version.wrapping_add(3);
            (base, Tile { version, ..changed })
        })
    }

    /// The tile with these voxels put in, some by scans and some as they are.
    fn with_voxels(tile: &Tile, voxels: &[Seed]) -> Tile {
        let mut map = VoxelMap::new(tile.resolution_m);
        map.set_tile(tile).expect("the same resolution");
        let corner = tile.id.corner();
        for &([x, y, z], steps, color, class, (at, by)) in voxels {
            let key = VoxelKey::new(corner.x + x, corner.y + y, corner.z + z);
            if at % 4 == 0 {
                let center = map.center_of(key);
                map.insert_scan(&Scan {
                    at: Stamp::from_nanos(u64::from(at) * 1_000_000_000),
                    source: Sources::from_bits(by),
                    ..Scan::new(center, &[center])
                });
            }
            map.set_voxel(
                key,
                Voxel {
                    log_odds: LogOdds(steps),
                    color: color.map(Rgb),
                    class: ClassId(class),
                },
            );
        }
        let changed = map.tile(tile.id);
        let changed = changed.unwrap_or_else(|| Tile::unknown(tile.id, 0, tile.resolution_m));
        Tile {
            version: tile.version,
            ..changed
        }
    }

    /// Equality that counts when and by whom things were seen.
    #[track_caller]
    fn check_same(one: &Tile, other: &Tile) {
        assert_eq!(one, other);
        assert_eq!(one.digest(), other.digest());
        for (key, _) in one.known() {
            assert_eq!(one.seen(key), other.seen(key), "{key:?}");
        }
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
            for detail in Detail::ALL {
                let decoded = Tile::decode(&tile.encode_as(detail)).expect("it was encoded");
                check_same(&decoded, &tile.reduced(detail));
            }
            prop_assert_eq!(Tile::decode(&tile.encode()), Ok(tile));
        }

        #[test]
        fn a_change_of_a_base_comes_back((base, tile) in any_change()) {
            for detail in Detail::ALL {
                let bytes = tile.encode_change(&base, detail);
                let decoded = Tile::decode_change(&bytes, &base).expect("it was encoded");
                check_same(&decoded, &tile.reduced(detail));
                let again = Tile::decode_change(&bytes, &base.reduced(detail));
                prop_assert_eq!(again, Ok(decoded), "a receiver has the base with the detail it was sent with");
            }
        }

        #[test]
        fn a_change_is_refused_without_its_very_base((base, tile) in any_change()) {
            let bytes = tile.encode_change(&base, Detail::Surface);
            let needed = TileHeader::read(&bytes).expect("a header").base.expect("a base");
            prop_assert_eq!((needed.version, needed.digest), (base.version, base.digest()));
            let id = tile.id;
            prop_assert_eq!(Tile::decode(&bytes), Err(TileError::NeedsBase { id, needed }));
            let other = with_voxels(&base, &[([1, 2, 3], if base.voxel(id.corner()).is_some() { 7 } else { 9 }, None, 77, (1, 1))]);
            if other.digest() != base.digest() {
                let given = crate::tile::Base { version: other.version, digest: other.digest() };
                let refused = Tile::decode_change(&bytes, &other);
                prop_assert_eq!(refused, Err(TileError::OtherBase { id, needed, given }));
            }
        }

        #[test]
        fn a_whole_tile_needs_no_base(tile in any_tile()) {
            let base = Tile::unknown(HOME, 0, 1.0);
            prop_assert_eq!(Tile::decode_change(&tile.encode(), &base), Ok(tile));
        }

        #[test]
        fn any_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            prop_assert!(Tile::decode(&bytes).is_err());
        }

        #[test]
        fn any_payload_with_a_right_checksum_is_survived(
            payload in prop::collection::vec(any::<u8>(), 0..400),
            detail in prop::sample::select(&Detail::ALL[..]),
            base in prop::option::of(any_tile()),
        ) {
            let empty = Tile::unknown(HOME, 1, 0.1);
            let base = base.unwrap_or_else(|| empty.clone());
            for (mut bytes, header) in [
                (empty.encode_as(detail), WHOLE_HEADER),
                (empty.encode_change(&base, detail), CHANGE_HEADER),
            ] {
                bytes.truncate(header);
                bytes.extend(&payload);
                header::seal(&mut bytes, header);
                if let Ok(tile) = Tile::decode_change(&bytes, &base) {
                    let again = Tile::decode(&tile.encode_as(detail));
                    prop_assert_eq!(again, Ok(tile), "what is accepted is a tile");
                }
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
        check_refused(4, 1, "the tile has format 1, this program reads format 2");
        check_refused(
            5,
            7,
            "the tile is compressed by codec 7, this program knows codec 2",
        );
        let short = Tile::decode(b"TDTL\x02\x02\x02").map_err(|e| e.to_string());
        assert_eq!(short, Err("the tile ends within its header".to_owned()));
    }

    #[test]
    fn content_from_a_newer_program_is_refused() {
        let mut bytes = Tile::unknown(HOME, 1, 0.1).encode();
        bytes[6] |= 0x80;
        header::seal(&mut bytes, WHOLE_HEADER);
        let error = Tile::decode(&bytes).map_err(|e| e.to_string());
        let message = "the tile has content of kind 130, this program knows kinds 0 to 7";
        assert_eq!(error, Err(message.to_owned()));
    }

    #[test]
    fn a_small_change_is_small() {
        let map = room();
        let tiles = map.tile_ids().into_iter().filter_map(|id| map.tile(id));
        let base = tiles.max_by_key(Tile::known_count).expect("a room");
        let voxels: Vec<Seed> = (0..10)
            .map(|i| ([40 + i, 50, 20], 17, None, 0, (1, 1)))
            .collect();
        let tile = with_voxels(&base, &voxels);
        let (whole, change) = (tile.encode(), tile.encode_change(&base, Detail::Surface));
        assert!(
            change.len() * 20 < whole.len(),
            "{} bytes against {}",
            change.len(),
            whole.len()
        );
    }

    /// The most that a payload of any length gives.
    #[test]
    fn a_full_tile_of_one_state_takes_a_thousand_bytes() {
        let mut map = VoxelMap::new(0.1);
        for z in 0..128 {
            for y in 0..128 {
                for x in 0..128 {
                    map.set_voxel(VoxelKey::new(x, y, z), Voxel::new(LogOdds::MIN));
                }
            }
        }
        let tile = map.tile(HOME).expect("it was filled");
        let bytes = tile.encode();
        assert!(bytes.len() < 1000, "{} bytes", bytes.len());
        assert_eq!(Tile::decode(&bytes), Ok(tile));
    }
}
