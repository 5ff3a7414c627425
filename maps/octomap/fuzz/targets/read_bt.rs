//! Any bytes as a `.bt` file: refused or read, within 48 KB of map; what is read can be written and read again.

#![no_main]

use libfuzzer_sys::fuzz_target;
use octomap::{ReadOptions, Shape, read, write_bt_as};

fuzz_target!(|input: &[u8]| {
    let Some((&how, rest)) = input.split_first() else {
        return;
    };
    let header: &[u8] = match how & 1 {
        0 => b"",
        _ => b"# Octomap OcTree binary file\nid OcTree\nres 0.1\ndata\n",
    };
    let options = ReadOptions {
        coarser: u32::from(how >> 2 & 15),
        most_bytes: 48 << 10,
        ..ReadOptions::default()
    };
    let Ok(opened) = read(&[header, rest].concat()[..], &options) else {
        return;
    };
    let mut again = Vec::new();
    write_bt_as(&opened.map, Shape::default(), &mut again).expect("memory takes it");
    let options = ReadOptions {
        coarser: 0,
        most_bytes: u64::MAX,
        ..options
    };
    let back = read(&again[..], &options).expect("we wrote it");
    assert_eq!(back.map.known_count(), opened.map.known_count());
    assert_eq!(back.map.occupied_count(), opened.map.occupied_count());
});
