use maps::frame::{Body, Camera, Isometry, Point};

use super::*;

fn sound() -> Config {
    let mut config = Config::default();
    config.source.path = "flight.mcap".into();
    config
}

#[test]
fn the_defaults_fly_once_there_is_a_source() {
    let settings = sound().check().expect("sound");
    assert_eq!(settings.address.to_string(), "1/191");
    assert!(settings.autopilot.is_some() && settings.ground.is_some());
}

#[test]
fn what_is_printed_is_read_back() {
    let mut config = sound();
    config.origin = Some(OriginTable {
        lat_deg: 47.0,
        lon_deg: 8.0,
        alt_m: 400.0,
    });
    let text = config.to_toml().expect("prints");
    assert_eq!(toml::from_str::<Config>(&text).expect("reads"), config);
}

#[test]
fn a_typo_names_the_line_and_the_keys_there_are() {
    let error = toml::from_str::<Config>("[map]\nresolution = 0.1").expect_err("a typo");
    let text = error.to_string();
    assert!(text.contains("line 2"), "{text}");
    assert!(text.contains("`resolution_m`"), "{text}");
}

#[track_caller]
fn check_refused(toml: &str, words: &[&str]) {
    let mut config: Config = toml::from_str(toml).expect("well-formed");
    if !toml.contains("path") {
        config.source.path = "flight.mcap".into();
    }
    let text = config.check().expect_err("makes no sense").to_string();
    for word in words {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
}

#[test]
fn a_value_that_makes_no_sense_is_refused_with_its_key_and_what_it_should_be() {
    check_refused("source.path = \"\"", &["source.path", "--source"]);
    check_refused(
        "vehicle.system_id = 0",
        &["vehicle.system_id is 0", "1 to 254"],
    );
    check_refused("vehicle.component_id = 1", &["vehicle.component_id", "191"]);
    check_refused("map.resolution_m = 0.0", &["map.resolution_m is 0", "0.01"]);
    check_refused("map.resolution_m = nan", &["map.resolution_m is NaN"]);
    check_refused("map.max_range_m = inf", &["map.max_range_m is inf"]);
    check_refused("camera.fx_px = -500.0", &["camera.fx_px is -500"]);
    check_refused("camera.width_px = 0", &["camera.width_px is 0"]);
    check_refused("camera.cx_px = 900.0", &["camera.cx_px", "in the image"]);
    check_refused(
        "links.ground = \"tcp:a\"",
        &["links.ground", "udpout:HOST:PORT"],
    );
    check_refused(
        "links.ground_bytes_per_s = 5",
        &["links.ground_bytes_per_s"],
    );
    check_refused(
        "source.depth_factor = 0.0",
        &["source.depth_factor", "5000"],
    );
    check_refused("map.tile_period_s = -1.0", &["map.tile_period_s is -1"]);
    check_refused(
        "slam.floor_below_m = [2.0, 1.0]",
        &["slam.floor_below_m is [2, 1]", "the lower one first"],
    );
    check_refused("mount.tilted_down_deg = nan", &["mount.tilted_down_deg"]);
    check_refused(
        "origin = { lat_deg = 91.0, lon_deg = 0.0, alt_m = 0.0 }",
        &["origin.lat_deg is 91"],
    );
}

#[test]
fn a_source_is_a_recording_or_a_live_camera_and_never_both() {
    check_refused(
        "source.path = \"a.mcap\"\nsource.zenoh = \"tcp/127.0.0.1:7447\"",
        &["source.path is a.mcap, beside source.zenoh", "either"],
    );
    let live: Config = toml::from_str("source.zenoh = \"tcp/10.0.0.7:7447\"\nsource.domain_id = 3")
        .expect("well-formed");
    let SourcePlace::Live(session, patience) = live.check().expect("sound").source.place else {
        panic!("no camera");
    };
    assert_eq!(session.connect, ["tcp/10.0.0.7:7447"]);
    assert_eq!((session.domain, session.node.as_str()), (3, "companion"));
    assert_eq!(patience, Patience::default());
    let place = sound().check().expect("sound").source.place;
    assert_eq!(place, SourcePlace::Recording("flight.mcap".into()));
}

#[test]
fn what_makes_no_sense_of_a_live_camera_is_refused() {
    let refused = |toml: &str, words: &[&str]| {
        check_refused(&format!("source.path = \"\"\n{toml}"), words);
    };
    refused(
        "source.zenoh = \"udp/127.0.0.1:7447\"",
        &["source.zenoh is \"udp/127.0.0.1:7447\"", "tcp/HOST:PORT"],
    );
    let at = "source.zenoh = \"tcp/a:1\"";
    refused(
        &format!("{at}\nsource.domain_id = 233"),
        &["source.domain_id is 233", "0 to 232"],
    );
    refused(
        &format!("{at}\nsource.wait_s = 0.0"),
        &["source.wait_s is 0", "0.1 to 600 s"],
    );
    refused(
        &format!("{at}\nsource.silence_s = nan"),
        &["source.silence_s is NaN"],
    );
}

#[test]
fn all_values_that_make_no_sense_are_named_at_once() {
    check_refused(
        "map.resolution_m = nan\nmap.tile_period_s = nan\nlinks.ground = \"tcp:a\"\ncamera.height_px = 0",
        &[
            "map.resolution_m is NaN",
            "map.tile_period_s is NaN",
            "links.ground",
            "camera.height_px is 0",
        ],
    );
}

#[test]
fn a_source_path_starts_at_its_file_and_is_printed_as_it_stands_there() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("drone.toml");
    std::fs::write(&file, "source.path = \"../flight.mcap\"").expect("writes");
    let config = Config::read(&file).expect("reads");
    let printed = config.to_toml().expect("prints");
    assert!(printed.contains("path = \"../flight.mcap\""), "{printed}");
    let path = config.relative_to(&file).source.path;
    assert_eq!(path, folder.path().join("../flight.mcap"));
}

#[test]
fn weights_start_at_their_file_and_a_detector_has_the_usual_score_of_its_kind() {
    for (kind, least_score) in [("yolox", 0.3), ("fastest-det", 0.65)] {
        let text = format!("[detector]\nkind = \"{kind}\"\nweights = \"a.onnx\"");
        let mut config: Config = toml::from_str(&text).expect("well-formed");
        config.source.path = "flight.mcap".into();
        let config = config.relative_to(Path::new("/drone/drone.toml"));
        let detector = config.check().expect("sound").detector.expect("one");
        assert_eq!(detector.weights, Path::new("/drone/a.onnx"));
        assert!((detector.least_score - least_score).abs() < 1e-6);
        assert_eq!(detector.every_frames, 3);
    }
    assert_eq!(sound().check().expect("sound").detector, None);
}

#[test]
fn a_detector_needs_a_kind_and_weights_and_answers_while_its_frame_is_known() {
    let detector = |more: &str| format!("[detector]\nkind = \"yolox\"\n{more}");
    check_refused(&detector("weights = \"\""), &["detector.weights", "ONNX"]);
    for (key, wrong) in [
        ("every_frames = 0", "detector.every_frames is 0"),
        ("every_frames = 16", "1 to 15"),
        ("least_score = 1.5", "detector.least_score is 1.5"),
        ("least_score = nan", "detector.least_score is NaN"),
    ] {
        let text = detector(&format!("weights = \"a.onnx\"\n{key}"));
        let mut config: Config = toml::from_str(&text).expect("well-formed");
        config.source.path = "flight.mcap".into();
        let error = config.check().expect_err("makes no sense").to_string();
        assert!(error.contains(wrong), "{error}");
    }
    for (text, word) in [
        (detector(""), "weights"),
        (detector("weight = \"a.onnx\""), "unknown field `weight`"),
        ("[detector]\nkind = \"yolo\"".to_owned(), "`fastest-det`"),
    ] {
        let error = toml::from_str::<Config>(&text).expect_err("is none");
        assert!(error.to_string().contains(word), "{error}");
    }
}

#[test]
fn the_reference_names_every_key_with_its_default() {
    let reference = include_str!("../../config/reference.toml");
    let written: toml::Table = reference.parse().expect("well-formed");
    let printed = Config::default().to_toml().expect("prints");
    let printed: toml::Table = printed.parse().expect("well-formed");
    assert_eq!(written, printed);
    let optional = reference.split("# [detector]").nth(1).unwrap_or_default();
    let optional = format!("[detector]{}", optional.replace("\n# ", "\n"));
    let config: Config = toml::from_str(&optional).expect("the commented tables are some");
    assert!(config.origin.is_some());
    let detector = config.detector.expect("commented");
    assert_eq!(detector.least_score, Some(detector.kind.least_score()));
    assert_eq!(detector.every_frames, every_third());
}

#[test]
fn headings_turn_clockwise_from_north() {
    let mut config = sound();
    config.slam.initial_heading_deg = 0.0;
    let mapping = config.check().expect("sound").mapping;
    let north = std::f64::consts::FRAC_PI_2;
    assert!((mapping.initial_heading_rad - north).abs() < 1e-12);
}

#[test]
fn an_empty_link_is_none() {
    let mut config = sound();
    config.links.autopilot.clear();
    assert_eq!(config.check().expect("sound").autopilot, None);
}

fn check_mount(mount: &MountTable) -> Isometry<Body, Camera> {
    let mut faults = settings::Faults::default();
    let checked = mount.check(&mut faults);
    faults.into_result(checked).expect("sound")
}

/// Where does a camera mounted like this look, in the body's frame?
#[track_caller]
fn check_view_ray(mount: &MountTable, expected: [f64; 3]) {
    let body_from_camera = check_mount(mount);
    let ahead = body_from_camera * Point::new(0.0, 0.0, 1.0);
    let [x, y, z] = expected;
    assert!(
        (ahead - Point::new(x, y, z)).norm() < 1e-12,
        "{mount:?} looks at {ahead:?}"
    );
}

#[test]
fn the_mount_turns_the_camera_as_its_words_say() {
    let level = MountTable::default();
    check_view_ray(&level, [1.0, 0.0, 0.0]);
    check_view_ray(
        &MountTable {
            tilted_down_deg: 90.0,
            up_m: 0.5,
            ..level.clone()
        },
        [0.0, 0.0, -0.5],
    );
    check_view_ray(
        &MountTable {
            turned_left_deg: 90.0,
            ..level.clone()
        },
        [0.0, 1.0, 0.0],
    );
    let rolled = MountTable {
        rolled_right_deg: 90.0,
        ..level
    };
    // Rolled to the right, the image's upper edge is on the right.
    let up = check_mount(&rolled) * Point::new(0.0, -1.0, 0.0);
    assert!((up - Point::new(0.0, -1.0, 0.0)).norm() < 1e-12, "{up:?}");
}

#[test]
fn the_examples_are_sound() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/config");
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("a file").path();
        let mut config = Config::read(&path).expect("readable");
        if path.ends_with("reference.toml") {
            config.source.path = "flight.mcap".into();
        }
        config.check().expect("sound");
    }
}
