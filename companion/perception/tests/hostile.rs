//! Networks that put out nonsense: nothing of it becomes a detection.

use std::path::Path;

use perception::{Detector, FastestDet, Image, Yolox};

/// A field of a protocol buffer that holds bytes.
fn bytes(field: u8, content: &[u8]) -> Vec<u8> {
    let length = u8::try_from(content.len()).expect("short fields only") & 0x7f;
    assert_eq!(usize::from(length), content.len(), "short fields only");
    [&[field << 3 | 2, length], content].concat()
}

/// One that holds a number below 128.
fn number(field: u8, value: u8) -> Vec<u8> {
    assert!(value < 128, "short numbers only");
    vec![field << 3, value]
}

fn value_info(name: &str, sizes: &[u8]) -> Vec<u8> {
    let dimensions: Vec<u8> = sizes
        .iter()
        .flat_map(|&s| bytes(1, &number(1, s)))
        .collect();
    let tensor = [number(1, 1), bytes(2, &dimensions)].concat();
    [bytes(1, name.as_bytes()), bytes(2, &bytes(1, &tensor))].concat()
}

/// An ONNX network that takes a 3 x 32 x 32 image and puts out `value` in every place of a tensor of these sizes.
fn network(value: f32, sizes: &[u8]) -> Vec<u8> {
    const FLOAT: u8 = 1;
    const INT64: u8 = 7;
    let shape: Vec<u8> = sizes
        .iter()
        .flat_map(|&s| i64::from(s).to_le_bytes())
        .collect();
    let rank = u8::try_from(sizes.len()).expect("a few");
    let tensor = |name: &str, dimensions: &[u8], kind: u8, raw: &[u8]| {
        let dimensions: Vec<u8> = dimensions.iter().flat_map(|&d| number(1, d)).collect();
        let name = bytes(8, name.as_bytes());
        bytes(
            5,
            &[dimensions, number(2, kind), name, bytes(9, raw)].concat(),
        )
    };
    let node = [
        bytes(1, b"v"),
        bytes(1, b"s"),
        bytes(2, b"o"),
        bytes(4, b"Expand"),
    ]
    .concat();
    let graph = [
        bytes(1, &node),
        bytes(2, b"g"),
        tensor("v", &[], FLOAT, &value.to_le_bytes()),
        tensor("s", &[rank], INT64, &shape),
        bytes(11, &value_info("i", &[1, 3, 32, 32])),
        bytes(12, &value_info("o", sizes)),
    ]
    .concat();
    // The graph is longer than a short field: its length takes two bytes.
    let length = u16::try_from(graph.len()).expect("a small network");
    let length = [length as u8 & 0x7f | 0x80, (length >> 7) as u8];
    [
        number(1, 7),
        bytes(8, &number(2, 13)),
        vec![7 << 3 | 2],
        length.to_vec(),
        graph,
    ]
    .concat()
}

const NONSENSE: [f32; 7] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    -1.0,
    1e30,
    200.0,
];

#[track_caller]
fn check_nothing_is_found(detector: &dyn Detector, value: f32) {
    let pixels = vec![[128; 3]; 40 * 30];
    let image = Image::new(40, 30, &pixels).expect("as many pixels");
    let found = detector
        .detect(&image)
        .expect("the output has the right shape");
    assert_eq!(found, [], "of {value} everywhere");
}

fn file(folder: &Path, value: f32, sizes: &[u8]) -> std::path::PathBuf {
    let path = folder.join("network.onnx");
    std::fs::write(&path, network(value, sizes)).expect("a file");
    path
}

#[test]
fn nonsense_of_a_yolox_is_no_detection() {
    let folder = tempfile::tempdir().expect("a folder");
    for value in NONSENSE {
        let path = file(folder.path(), value, &[1, 21, 85]);
        let detector = Yolox::open(&path, 0.3, 1).expect("a network");
        check_nothing_is_found(&detector, value);
    }
}

#[test]
fn nonsense_of_a_fastest_det_is_no_detection() {
    let folder = tempfile::tempdir().expect("a folder");
    for value in NONSENSE {
        let path = file(folder.path(), value, &[1, 85, 2, 2]);
        let detector = FastestDet::open(&path, 0.3, 1).expect("a network");
        check_nothing_is_found(&detector, value);
    }
}

#[test]
fn sense_is_a_detection() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = file(folder.path(), 0.9, &[1, 21, 85]);
    let detector = Yolox::open(&path, 0.3, 1).expect("a network");
    let pixels = vec![[128; 3]; 40 * 30];
    let image = Image::new(40, 30, &pixels).expect("as many pixels");
    let found = detector
        .detect(&image)
        .expect("the output has the right shape");
    assert!(!found.is_empty(), "else the tests above show nothing");
}
