//! Real networks on real images, where both are beside the repository; and files that are no networks, everywhere.
#![expect(
    clippy::print_stdout,
    reason = "says which tests had nothing to look at"
)]

use std::path::{Path, PathBuf};

use perception::{Class, Detection, Detector, FastestDet, Image, OpenError, Yolox};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");

/// The path of a file of the data, if it is there.
fn data(name: &str) -> Option<PathBuf> {
    let path = Path::new(DATA).join(name);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {} is not there", path.display());
    None
}

fn look(detector: &dyn Detector, file: &Path) -> (Vec<Detection>, [usize; 2]) {
    let bytes = std::fs::read(file).expect("it exists");
    let mut decoder = zune_jpeg::JpegDecoder::new(std::io::Cursor::new(bytes));
    let bytes = decoder.decode().expect("a JPEG image");
    let (width, height) = decoder.dimensions().expect("a size");
    let image = Image::new(width, height, bytes.as_chunks().0).expect("as many pixels");
    let found = detector.detect(&image).expect("the weights fit");
    (found, [width, height])
}

fn share(found: &[Detection], name: &str) -> usize {
    let class = Class::named(name).expect("COCO knows it");
    found.iter().filter(|d| d.class == class).count()
}

/// What is claimed of a detector in a street: it sees the people and cars in it, and nothing outside of it.
#[track_caller]
fn check_street(detector: &dyn Detector) {
    let Some(street) = data("perception/images/street.jpg") else {
        return;
    };
    let (found, [width, height]) = look(detector, &street);
    assert!(share(&found, "person") >= 3, "{found:?}");
    assert!(share(&found, "car") >= 1, "{found:?}");
    assert!(found.len() < 40, "{} boxes: are doubles left?", found.len());
    for detection in &found {
        let [left, top, right, bottom] = detection.bounds_px;
        assert!(0.0 <= left && left < right && right <= width as f32);
        assert!(0.0 <= top && top < bottom && bottom <= height as f32);
        assert!((0.4..=1.0).contains(&detection.score));
    }
    assert!(found.is_sorted_by(|a, b| a.score >= b.score));
}

/// On the left of the street a person stands between 70 and 251 across, 560 and 953 down.
#[track_caller]
fn check_person_on_the_left(detector: &dyn Detector) {
    let Some(street) = data("perception/images/street.jpg") else {
        return;
    };
    let (found, _) = look(detector, &street);
    let there = |d: &&Detection| {
        let [left, top, right, bottom] = d.bounds_px;
        d.class.name() == "person"
            && (left - 70.0).abs() < 30.0
            && (top - 560.0).abs() < 40.0
            && (right - 251.0).abs() < 40.0
            && (bottom - 953.0).abs() < 40.0
    };
    assert!(found.iter().any(|d| there(&d)), "{found:?}");
}

#[test]
fn yolox_finds_people_and_cars_where_they_are() {
    if let Some(weights) = data("weights/yolox_nano_bigisland.onnx") {
        let detector = Yolox::open(&weights, 0.4, 1).expect("good weights");
        check_street(&detector);
        check_person_on_the_left(&detector);
    }
}

#[test]
fn fastest_det_finds_people_and_cars_where_they_are() {
    if let Some(weights) = data("weights/fastestdet.onnx") {
        let detector = FastestDet::open(&weights, 0.4, 1).expect("good weights");
        check_street(&detector);
        check_person_on_the_left(&detector);
    }
}

#[test]
fn threads_do_not_change_what_is_found() {
    let names = [
        "weights/yolox_nano_bigisland.onnx",
        "perception/images/street.jpg",
    ];
    if let [Some(weights), Some(street)] = names.map(data) {
        let found = [1, 2].map(|threads| {
            let detector = Yolox::open(&weights, 0.3, threads).expect("good weights");
            look(&detector, &street).0
        });
        assert_eq!(found[0], found[1]);
    }
}

#[test]
fn weights_of_another_detector_are_refused_with_what_they_put_out() {
    let names = [
        "weights/yolox_nano_bigisland.onnx",
        "weights/fastestdet.onnx",
    ];
    let [Some(yolox), Some(fastest)] = names.map(data) else {
        return;
    };
    let pixels = vec![[90; 3]; 64 * 48];
    let image = Image::new(64, 48, &pixels).expect("as many pixels");
    let wrong = Yolox::open(&fastest, 0.4, 1).expect("it takes images of a size that YOLOX could");
    let told = wrong.detect(&image).map_err(|e| e.to_string());
    assert_eq!(
        told,
        Err("the network put out [1, 85, 22, 22] numbers and should put out [1, 2541, 85]: is it of another kind?".to_owned())
    );
    let wrong = FastestDet::open(&yolox, 0.4, 1).expect("it takes images of a size that it could");
    assert!(wrong.detect(&image).is_err());
}

#[test]
fn what_is_no_file_or_no_network_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let missing = folder.path().join("missing.onnx");
    let refused = Yolox::open(&missing, 0.4, 1).err();
    assert!(
        matches!(refused, Some(OpenError::Unreadable { ref path, .. }) if *path == missing),
        "{refused:?}"
    );
    let names = folder.path().join("names.onnx");
    for content in [
        &b"person\nbicycle\n"[..],
        &[],
        &[0x08, 0xff, 0xff, 0xff, 0xff],
    ] {
        std::fs::write(&names, content).expect("a file");
        let refused = FastestDet::open(&names, 0.4, 1).err();
        let told = refused
            .as_ref()
            .map(ToString::to_string)
            .unwrap_or_default();
        assert!(
            matches!(refused, Some(OpenError::NotANetwork { .. })),
            "{refused:?}"
        );
        assert!(told.contains("names.onnx"), "{told}");
    }
}
