//! Any bytes as a `.ot` file: refused or read, within 48 KB of map; what is read can be written and read again.

#![no_main]

use libfuzzer_sys::fuzz_target;
use octomap::{Colors, Content, ReadOptions, Shape, read, write_ot_as};

fuzz_target!(|input: &[u8]| {
    let Some((&how, rest)) = input.split_first() else {
        return;
    };
    let header: &[u8] = match how & 3 {
        0 => b"",
        1 => b"# Octomap OcTree file\nid OcTree\nres 0.1\ndata\n",
        2 => b"# Octomap OcTree file\nid ColorOcTree\nres 0.1\ndata\n",
        _ => b"# Octomap OcTree file\nid OcTreeStamped\nsize 9\nres 0.1\ndata\n",
    };
    let options = ReadOptions {
        coarser: u32::from(how >> 2 & 15),
        colors: if how & 64 == 0 {
            Colors::Surface
        } else {
            Colors::Classes
        },
        most_bytes: 48 << 10,
    };
    let Ok(opened) = read(&[header, rest].concat()[..], &options) else {
        return;
    };
    let content = if how & 64 == 0 {
        Content::Color
    } else {
        Content::Class
    };
    let mut again = Vec::new();
    write_ot_as(&opened.map, content, Shape::default(), &mut again).expect("memory takes it");
    let options = ReadOptions {
        coarser: 0,
        most_bytes: u64::MAX,
        ..options
    };
    let back = read(&again[..], &options).expect("we wrote it");
    assert_eq!(back.map.digest(), opened.map.digest());
});
