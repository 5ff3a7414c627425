use std::fmt::Write as _;

use proptest::prelude::*;
use tempfile::TempDir;

use super::*;

fn camera() -> Pinhole {
    Pinhole {
        width: 2,
        height: 2,
        fx: 2.0,
        fy: 2.0,
        cx: 0.5,
        cy: 0.5,
        distortion: [0.0; 5],
    }
}

fn png(color: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 2, 2);
    encoder.set_color(color);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().expect("header");
    writer.write_image_data(data).expect("data");
    writer.finish().expect("end");
    file
}

/// A folder of three frames whose depth images come 15 ms after their colour images.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("rgb")).expect("rgb");
    fs::create_dir(at("depth")).expect("depth");
    let (mut rgb, mut depth) = ("# colour\n".to_owned(), "# depth\n".to_owned());
    for index in 0..3_u8 {
        let color = png(png::ColorType::Rgb, png::BitDepth::Eight, &[index; 12]);
        let metres = png(
            png::ColorType::Grayscale,
            png::BitDepth::Sixteen,
            &[index, 0, 0, 0, 0, 0, 0, 0],
        );
        fs::write(at(&format!("rgb/{index}.png")), color).expect("writes");
        fs::write(at(&format!("depth/{index}.png")), metres).expect("writes");
        writeln!(rgb, "100.{index}00 rgb/{index}.png").expect("text");
        writeln!(depth, "100.{index}15 depth/{index}.png").expect("text");
    }
    fs::write(at("rgb.txt"), rgb).expect("writes");
    fs::write(at("depth.txt"), depth).expect("writes");
    folder
}

fn open(folder: &TempDir) -> Result<TumFolder, SourceError> {
    TumFolder::open(folder.path(), camera(), Settings::default())
}

#[track_caller]
fn check_refused(folder: &TempDir, words: &[&str]) {
    let outcome = open(folder).and_then(|mut source| {
        while source.next_frame()?.is_some() {}
        Ok(())
    });
    let error = outcome.expect_err("refused").to_string();
    for word in words {
        assert!(error.contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn frames_are_pairs_of_nearest_images_with_the_stamp_of_the_colour_image() {
    let folder = folder();
    let mut source = open(&folder).expect("opens");
    assert_eq!(source.frame_count(), Some(3));
    for index in 0..3_u8 {
        let frame = source.next_frame().expect("no error").expect("a frame");
        assert_eq!(
            frame.at,
            Stamp::from_nanos(100_000_000_000 + u64::from(index) * 100_000_000)
        );
        assert_eq!(frame.rgb, vec![[index; 3]; 4]);
        let expected = f32::from(index) * 256.0 / 5000.0;
        assert!(
            (frame.depth_m[0] - expected).abs() < 1e-6,
            "{:?}",
            frame.depth_m
        );
    }
    assert_eq!(source.next_frame().expect("no error"), None);
}

#[test]
fn associations_are_taken_as_they_are_whichever_comes_first() {
    let folder = folder();
    for line in [
        "7.5 rgb/0.png 9.25 depth/1.png",
        "9.25 depth/1.png 7.5 rgb/0.png",
    ] {
        fs::write(folder.path().join("associations.txt"), line).expect("writes");
        let mut source = open(&folder).expect("opens");
        assert_eq!(source.frame_count(), Some(1));
        let frame = source.next_frame().expect("no error").expect("a frame");
        assert_eq!(frame.at, Stamp::from_nanos(7_500_000_000));
        assert!(frame.depth_m[0] > 0.0, "the depth of frame 1");
    }
}

#[test]
fn truth_is_read_where_it_is() {
    let folder = folder();
    assert_eq!(open(&folder).expect("opens").truth(), []);
    let path = folder.path().join("groundtruth.txt");
    fs::write(&path, "# t\n1548339819.89427 1 2 3 0 0 0 -1\n").expect("writes");
    let source = open(&folder).expect("opens");
    let [truth] = source.truth() else {
        panic!("one pose, not {:?}", source.truth());
    };
    assert_eq!(truth.at, Stamp::from_nanos(1_548_339_819_894_270_000));
    assert!(truth.pose.rotation.angle() < 1e-9);
    fs::write(&path, "1 1 2 3 0 0 0 0\n").expect("writes");
    check_refused(&folder, &["groundtruth.txt"]);
}

#[test]
fn what_is_wrong_is_named_with_its_file() {
    let check = |name: &str, content: Option<&[u8]>, words: &[&str]| {
        let folder = folder();
        let path = folder.path().join(name);
        match content {
            Some(content) => fs::write(path, content).expect("writes"),
            None => fs::remove_file(path).expect("removes"),
        }
        check_refused(&folder, words);
    };
    let grey = png(png::ColorType::Grayscale, png::BitDepth::Eight, &[0; 4]);
    check("rgb.txt", None, &["TUM layout", "no rgb.txt"]);
    check("depth.txt", None, &["cannot read", "depth.txt"]);
    check(
        "rgb.txt",
        Some(b"1.0 rgb/0.png extra"),
        &["line 1", "rgb.txt", "timestamp picture"],
    );
    check("rgb.txt", Some(b"noon rgb/0.png"), &["line 1", "rgb.txt"]);
    check(
        "rgb.txt",
        Some(b"# empty"),
        &["0 colour and 3 depth", "20 ms"],
    );
    check(
        "depth.txt",
        Some(b"999 depth/0.png"),
        &["3 colour and 1 depth", "20 ms"],
    );
    check(
        "depth/1.png",
        None,
        &["depth/1.png", "missing", "0 more of 6", "skip"],
    );
    check(
        "depth/1.png",
        Some(b"\x89PNG but no more"),
        &["depth/1.png", "damaged"],
    );
    check("rgb/2.png", Some(b""), &["rgb/2.png", "damaged"]);
    check("depth/2.png", Some(&grey), &["depth/2.png", "16-bit"]);
}

#[test]
fn an_excerpt_is_played_when_asked_to() {
    let folder = folder();
    fs::remove_file(folder.path().join("rgb/1.png")).expect("removes");
    let settings = Settings {
        missing_images: MissingImages::Skip,
        ..Settings::default()
    };
    let source = TumFolder::open(folder.path(), camera(), settings).expect("opens");
    assert_eq!(source.frame_count(), Some(2));
}

#[test]
fn after_an_error_there_are_no_more_frames() {
    let folder = folder();
    fs::write(folder.path().join("rgb/0.png"), b"").expect("writes");
    let mut source = open(&folder).expect("opens");
    assert!(source.next_frame().is_err());
    assert_eq!(source.next_frame().expect("ended"), None);
}

/// An excerpt of a recording beside the repository, 18 images of each kind, of which 17 are pairs; `folder` is its twin
/// where it is absent.
#[test]
fn the_real_excerpt_has_17_frames_of_a_room() {
    let path = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../shared/data/rgbd/tum_fr1_xyz_18"
    ));
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return;
    }
    let camera = Pinhole {
        width: 640,
        height: 480,
        fx: 517.3,
        fy: 516.5,
        cx: 318.6,
        cy: 255.3,
        distortion: [0.0; 5],
    };
    let settings = Settings {
        missing_images: MissingImages::Skip,
        ..Settings::default()
    };
    let mut source = TumFolder::open(path, camera, settings).expect("opens");
    assert_eq!(source.frame_count(), Some(17));
    let mut last = Stamp::ZERO;
    while let Some(frame) = source.next_frame().expect("sound images") {
        assert!(frame.at > last);
        last = frame.at;
        let seen = frame.depth_m.iter().filter(|&&d| d > 0.0);
        let (count, sum) = seen.fold((0, 0.0), |(n, sum), d| (n + 1, sum + f64::from(*d)));
        let mean_m = sum / f64::from(count);
        assert!(count > 100_000, "a third of the pixels at least: {count}");
        assert!(
            (0.5..4.0).contains(&mean_m),
            "the walls are {mean_m} m away on average"
        );
    }
}

#[test]
fn stamps_are_exact_to_the_nanosecond() {
    for (text, nanos) in [
        ("1548339819.87426", 1_548_339_819_874_260_000),
        ("1548339819", 1_548_339_819_000_000_000),
        ("0.0000000019", 1),
        ("1e3", 1_000_000_000_000),
    ] {
        assert_eq!(stamp(text), Some(Stamp::from_nanos(nanos)), "{text}");
    }
    for text in [
        "",
        ".",
        "-1.0",
        "1.5.2",
        "1,5",
        "inf",
        "99999999999999999999",
        "+5",
    ] {
        assert_eq!(stamp(text).filter(|_| text != "+5"), None, "{text}");
    }
}

proptest! {
    #[test]
    fn any_lists_are_read_or_refused(list: Vec<u8>, pairs: Vec<u8>, poses in "[0-9e .\n#-]{0,80}") {
        let folder = folder();
        fs::write(folder.path().join("rgb.txt"), list).expect("writes");
        fs::write(folder.path().join("groundtruth.txt"), poses).expect("writes");
        let _outcome = open(&folder).map(drop);
        fs::write(folder.path().join("associations.txt"), pairs).expect("writes");
        let _outcome = open(&folder).map(drop);
    }

    #[test]
    fn any_text_is_a_stamp_or_none(text in "\\PC{0,30}") {
        let _outcome = stamp(&text);
    }
}
