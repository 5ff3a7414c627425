//! Any bytes as a change of a tile, and as the payload of one: refused or decoded; what is decoded comes back after encoding.

#![no_main]

use libfuzzer_sys::fuzz_target;
use maps::tile::{Tile, TileId};
use maps_fuzz::{BASE, HEADER, base, detail, sealed};

fuzz_target!(|input: &[u8]| {
    let base = base();
    let _ = Tile::decode_change(input, &base);
    let Some((&how, payload)) = input.split_first() else {
        return;
    };
    let detail = detail(how);
    let empty = Tile::unknown(TileId { x: 0, y: 0, z: 0 }, 2, 0.1);
    let head = empty.encode_change(&base, detail);
    if let Ok(tile) = Tile::decode_change(&sealed(head, HEADER + BASE, payload), &base) {
        let bytes = tile.encode_change(&base, detail);
        let again = Tile::decode_change(&bytes, &base).expect("we encoded it");
        assert_eq!(again, tile.reduced(detail));
    }
});
