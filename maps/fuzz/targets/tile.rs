//! Any bytes as a tile, and as the payload of one: refused or decoded; what is decoded comes back after encoding.

#![no_main]

use libfuzzer_sys::fuzz_target;
use maps::tile::{Detail, Tile, TileHeader, TileId};
use maps_fuzz::{HEADER, detail, sealed};

fuzz_target!(|input: &[u8]| {
    let _ = TileHeader::read(input);
    if let Ok(tile) = Tile::decode(input) {
        check(&tile, Detail::Sightings);
    }
    let Some((&how, payload)) = input.split_first() else {
        return;
    };
    let head = Tile::unknown(TileId { x: 0, y: 0, z: 0 }, 1, 0.1).encode_as(detail(how));
    if let Ok(tile) = Tile::decode(&sealed(head, HEADER, payload)) {
        check(&tile, detail(how));
    }
});

fn check(tile: &Tile, detail: Detail) {
    let again = Tile::decode(&tile.encode_as(detail)).expect("we encoded it");
    assert_eq!(again, tile.reduced(detail));
}
