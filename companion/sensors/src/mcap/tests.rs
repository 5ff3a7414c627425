use std::fs;

use maps::frame::{Camera, Isometry, World};
use nalgebra::Isometry3;
use proptest::prelude::*;

use super::*;

fn camera() -> Pinhole {
    Pinhole {
        width: 4,
        height: 3,
        fx: 4.0,
        fy: 4.0,
        cx: 1.5,
        cy: 1.0,
        distortion: [0.1, 0.0, 0.0, 0.0, 0.0],
    }
}

fn at(index: u64) -> Stamp {
    Stamp::from_nanos(1_700_000_000_000_000_000 + index * 33_333_333)
}

fn frame(index: u64) -> RgbdFrame {
    RgbdFrame {
        at: at(index),
        width: 4,
        height: 3,
        rgb: (0..12).map(|i| [i, index as u8, 7]).collect(),
        depth_m: (0..12_u16).map(|i| f32::from(i) * 0.25).collect(),
    }
}

fn pose(index: u64) -> Isometry<World, Camera> {
    Isometry::claim(Isometry3::translation(index as f64, 2.0, 1.5))
}

/// A file of this many frames.
fn record(path: &Path, frames: u64) {
    let mut writer = Writer::create(path, &Topics::default()).expect("creates");
    writer.camera(at(0), &camera()).expect("camera");
    for index in 0..frames {
        writer.truth(at(index), &pose(index)).expect("truth");
        writer.frame(&frame(index)).expect("frame");
    }
    writer.finish().expect("finishes");
}

fn read_all(path: &Path) -> Result<Vec<RgbdFrame>, SourceError> {
    let mut source = McapFile::open(path, Topics::default())?;
    let mut frames = Vec::new();
    while let Some(frame) = source.next_frame()? {
        frames.push(frame);
    }
    Ok(frames)
}

#[test]
fn what_was_recorded_is_played() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("flight.mcap");
    record(&path, 5);
    let mut source = McapFile::open(&path, Topics::default()).expect("opens");
    assert_eq!(source.name(), "flight");
    assert_eq!(source.camera(), camera());
    assert_eq!(source.frame_count(), Some(5));
    let truth: Vec<TruthPose> = (0..5)
        .map(|i| TruthPose {
            at: at(i),
            pose: pose(i).raw,
        })
        .collect();
    assert_eq!(source.truth(), truth);
    for index in 0..5 {
        let found = source.next_frame().expect("no error").expect("a frame");
        let expected = frame(index);
        assert_eq!((found.at, &found.rgb), (expected.at, &expected.rgb));
        for (found, expected) in found.depth_m.iter().zip(&expected.depth_m) {
            assert!(
                (found - expected).abs() <= 0.5e-3,
                "rounded to the millimetre"
            );
        }
    }
    assert_eq!(source.next_frame().expect("no error"), None);
    assert_eq!(source.frame_count(), Some(5));
}

#[test]
fn a_file_cut_off_gives_its_whole_frames_and_then_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("flight.mcap");
    record(&path, 3);
    // One chunk holds all of this small file, so give each frame its own by recording large ones.
    let large = Pinhole {
        width: 640,
        height: 480,
        ..camera()
    };
    let mut writer = Writer::create(&path, &Topics::default()).expect("creates");
    writer.camera(at(0), &large).expect("camera");
    for index in 0..4 {
        let frame = RgbdFrame {
            at: at(index),
            width: 640,
            height: 480,
            rgb: vec![[1; 3]; 640 * 480],
            depth_m: vec![1.0; 640 * 480],
        };
        writer.frame(&frame).expect("frame");
    }
    writer.finish().expect("finishes");
    let whole = fs::read(&path).expect("reads");
    fs::write(&path, &whole[..whole.len() * 5 / 8]).expect("cuts");
    let mut source = McapFile::open(&path, Topics::default()).expect("two frames are whole");
    let mut frames = 0;
    let error = loop {
        match source.next_frame() {
            Ok(frame) => frames += usize::from(frame.is_some()),
            Err(error) => break error.to_string(),
        }
    };
    assert_eq!(frames, 2);
    assert!(error.contains("damaged after 2 frames"), "{error}");
    assert_eq!(source.next_frame().expect("ended"), None);
}

#[track_caller]
fn check_refused(path: &Path, topics: Topics, words: &[&str]) {
    let error = McapFile::open(path, topics)
        .err()
        .expect("refused")
        .to_string();
    for word in words {
        assert!(error.contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn what_is_missing_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("flight.mcap");
    let topics = Topics::default;
    check_refused(&path, topics(), &["cannot read", "flight.mcap"]);
    fs::write(&path, b"not an mcap file at all").expect("writes");
    check_refused(&path, topics(), &["flight.mcap is no MCAP file"]);
    record(&path, 2);
    let elsewhere = |change: fn(&mut Topics)| {
        let mut topics = topics();
        change(&mut topics);
        topics
    };
    check_refused(
        &path,
        elsewhere(|t| t.color = "/c".into()),
        &["nothing on /c", "/uav/camera/color/image_raw"],
    );
    check_refused(
        &path,
        elsewhere(|t| t.depth = "/d".into()),
        &["nothing on /d"],
    );
    check_refused(
        &path,
        elsewhere(|t| t.camera_info = "/i".into()),
        &["nothing on /i"],
    );
    let swapped = elsewhere(|t| t.truth = "/uav/camera/color/camera_info".into());
    let swapped = Topics {
        camera_info: "/uav/ground_truth/pose".into(),
        ..swapped
    };
    check_refused(&path, swapped, &["sensor_msgs/msg/CameraInfo"]);
}

#[test]
fn colour_and_depth_are_not_interchangeable() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("flight.mcap");
    record(&path, 2);
    let topics = Topics::default();
    let swapped = Topics {
        color: topics.depth,
        depth: topics.color,
        ..Topics::default()
    };
    let mut source = McapFile::open(&path, swapped).expect("both are images");
    let error = source
        .next_frame()
        .expect_err("of another encoding")
        .to_string();
    assert!(error.contains("16UC1") || error.contains("rgb8"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_damaged_file_gives_frames_or_an_error(place in 0.0..1.0, bytes: Vec<u8>, keep in 0.0..1.0) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("flight.mcap");
        record(&path, 2);
        let mut file = fs::read(&path).expect("reads");
        let place = (place * file.len() as f64) as usize;
        for (byte, noise) in file[place..].iter_mut().zip(&bytes) {
            *byte ^= noise;
        }
        file.truncate(file.len().min(place + (keep * 4096.0) as usize));
        fs::write(&path, &file).expect("writes");
        let _outcome = read_all(&path).map(drop);
    }
}
