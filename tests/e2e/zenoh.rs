//! Nodes of others, over Zenoh as `rmw_zenoh` speaks it.

use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::Builder;
use std::time::Duration;

use maps::camera::{Pinhole, RgbdFrame};
use maps::time::Stamp;
use sensors::RgbdSource as _;
use sensors::mcap::Topics;
use sensors::message;
use sensors::ros::Image;
use sensors::zenoh::{Patience, Settings, ZenohSource};
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use sitl::live::Live;
use tests::program::{Program, Show};

use crate::peers::python;
use crate::programs;

const LONG: Duration = Duration::from_mins(1);

/// An endpoint of this machine where nobody is.
fn free_endpoint() -> String {
    let free = TcpListener::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    format!("tcp/{}", free.expect("a free port"))
}

fn camera() -> Pinhole {
    Pinhole {
        width: 320,
        height: 240,
        fx: 300.0,
        fy: 301.0,
        cx: 160.5,
        cy: 120.25,
        distortion: [0.1, -0.2, 0.001, 0.002, 0.3],
    }
}

fn frame(number: u64) -> RgbdFrame {
    let pixels = 320 * 240_u32;
    RgbdFrame {
        at: Stamp::from_nanos(1_700_000_000_123_456_789 + number * 50_000_000),
        width: 320,
        height: 240,
        rgb: (0..pixels)
            .map(|n| [n as u8, (n >> 8) as u8, number as u8])
            .collect(),
        depth_m: (0..pixels)
            .map(|n| (500 + n % 9000 + number as u32) as f32 * 1e-3)
            .collect(),
    }
}

/// Publishes a frame each 50 ms until it is told to end.
fn fly(mut live: Live, end: &Receiver<()>) {
    let topics = Topics::default();
    let mut number = 0;
    while end.recv_timeout(Duration::from_millis(50)) == Err(RecvTimeoutError::Timeout) {
        let frame = frame(number);
        let [color, depth] = message::frame(&topics, &frame);
        for message in [message::camera(&topics, frame.at, &camera()), color, depth] {
            live.publish(&message).expect("the session is open");
        }
        number += 1;
    }
}

/// SHA-256 in hexadecimal digits, as Python prints it.
fn sha256(pixels: &[u8]) -> String {
    let digits = Sha256::digest(pixels);
    let append = |text, byte| format!("{text}{byte:02x}");
    digits.iter().fold(String::new(), append)
}

#[test]
fn a_python_node_reads_our_camera_and_sees_it_in_the_graph() {
    let endpoint = free_endpoint();
    let live = Live::open(&format!("listen:{endpoint}")).expect("a free port");
    let (stop, stopped) = sync_channel(0);
    let flight = Builder::new()
        .name("flight".into())
        .spawn(move || fly(live, &stopped))
        .expect("a thread");
    let told = python(
        "zenoh_ros.py",
        &["listen".as_ref(), endpoint.as_ref(), "5".as_ref()],
    );
    drop(stop);
    flight.join().expect("it ends");
    let told: Value = serde_json::from_str(&told).expect("one JSON object");
    check_camera(&told["camera"][0]);
    check_images(&told);
    check_graph(&told["publishers"]);
}

#[track_caller]
fn check_camera(found: &Value) {
    let Pinhole {
        fx,
        fy,
        cx,
        cy,
        distortion,
        ..
    } = camera();
    assert_eq!(found["size"], serde_json::json!([320, 240]));
    assert_eq!(found["model"], "plumb_bob");
    assert_eq!(found["d"], serde_json::json!(distortion));
    let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    assert_eq!(found["k"], serde_json::json!(k));
}

/// What Python has read is, to the byte and the nanosecond, what was published.
#[track_caller]
fn check_images(told: &Value) {
    let topics = Topics::default();
    for name in ["color", "depth"] {
        let images = told[name].as_array().expect("images");
        assert!(images.len() >= 5, "{name}: {images:?}");
        let ids: Vec<&Value> = images.iter().map(|image| &image["gid"]).collect();
        assert!(ids.iter().all(|id| *id == ids[0]), "one publisher: {ids:?}");
        for found in images {
            let stamp = found["stamp"].as_u64().expect("nanoseconds");
            assert_eq!(found["made"], stamp, "{name}");
            let number = (stamp - frame(0).at.as_nanos()) / 50_000_000;
            assert_eq!(found["sequence"], number + 1, "{name}");
            let frame = frame(number);
            let [color, depth] = message::frame(&topics, &frame);
            let message = if name == "color" { color } else { depth };
            let image = Image::decode(&message.bytes).expect("our own");
            assert_eq!(found["encoding"], image.encoding);
            assert_eq!(found["frame"], image.frame_id);
            assert_eq!(found["size"], serde_json::json!([320, 240]));
            assert_eq!(found["sha256"], sha256(image.data), "{name} {number}");
        }
    }
}

#[track_caller]
fn check_graph(found: &Value) {
    let topics = Topics::default();
    let publishers: Vec<&Value> = found.as_array().expect("a list").iter().collect();
    for (topic, kind) in [
        (&topics.camera_info, "sensor_msgs::msg::dds_::CameraInfo_"),
        (&topics.color, "sensor_msgs::msg::dds_::Image_"),
        (&topics.depth, "sensor_msgs::msg::dds_::Image_"),
    ] {
        let is_it = |p: &&&Value| p[0] == "sitl" && p[1] == topic.as_str() && p[2] == kind;
        let publisher = publishers.iter().find(is_it);
        let publisher = publisher.unwrap_or_else(|| panic!("{topic} is not in {found}"));
        assert_eq!(publisher[4], "2::,5:,:,:,,", "best effort, the last five");
    }
}

/// `tests/peers/zenoh_ros.py drive`, as a process.
fn drive(endpoint: &str, frames: u32) -> Child {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    Command::new(root.join("../target/peers/bin/python"))
        .arg(root.join("peers/zenoh_ros.py"))
        .args(["drive", endpoint, &frames.to_string()])
        .stdout(Stdio::piped())
        .spawn()
        .expect("the Python peers are installed: run `tools/setup peers`")
}

#[test]
fn a_python_drivers_frames_are_read_byte_for_byte() {
    let endpoint = free_endpoint();
    let driver = drive(&endpoint, 6);
    let settings = Settings::at(&format!("listen:{endpoint}")).expect("an endpoint");
    let patience = Patience {
        camera: LONG,
        frame: LONG,
    };
    let mut source = ZenohSource::open(&settings, Topics::default(), patience).expect("a camera");
    assert_eq!((source.camera().width, source.camera().height), (320, 240));
    let frames: Vec<RgbdFrame> = (0..6)
        .map(|_| source.next_frame().expect("no error").expect("a frame"))
        .collect();
    let output = driver.wait_with_output().expect("it ends");
    assert!(output.status.success());
    let told = String::from_utf8(output.stdout).expect("UTF-8");
    assert_eq!(told.lines().count(), frames.len());
    for (line, frame) in told.lines().zip(&frames) {
        let sent: Value = serde_json::from_str(line).expect("JSON");
        assert_eq!(sent["stamp"], frame.at.as_nanos());
        assert_eq!(sent["color"], sha256(frame.rgb.as_flattened()));
        for (n, depth) in frame.depth_m.iter().enumerate() {
            let sent = (1500 + 3 * (n % 320)) as f32 * 1e-3;
            assert!((depth - sent).abs() < 1e-6, "pixel {n}: {depth} m");
        }
    }
}

/// A companion that maps what a live camera sees; its log, and its report after it has ended.
struct Mapping {
    companion: Program,
    folder: tempfile::TempDir,
}

impl Mapping {
    fn start(endpoint: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let config = folder.path().join("companion.toml");
        let text = format!(
            "[source]\nzenoh = \"listen:{endpoint}\"\nwait_s = 60.0\nsilence_s = 2.0\n\
             [links]\nground = \"\"\nautopilot = \"\"\n"
        );
        fs::write(&config, text).expect("there is room");
        let mut companion = Command::new(programs::folder().join("companion"));
        companion.arg("run").arg("-c").arg(config);
        companion.arg("--out").arg(folder.path().join("out"));
        let log = folder.path().join("companion.log");
        Self {
            companion: Program::start("companion", companion, &log, Show::Nothing)
                .expect("the companion starts"),
            folder,
        }
    }

    fn log(&self) -> String {
        fs::read_to_string(self.folder.path().join("companion.log")).unwrap_or_default()
    }

    fn report(&self) -> PathBuf {
        self.folder.path().join("out/report.json")
    }
}

#[test]
fn the_doctor_looks_at_a_live_camera() {
    let endpoint = free_endpoint();
    let driver = drive(&endpoint, 20);
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("companion.toml");
    let text = format!("[source]\nzenoh = \"listen:{endpoint}\"\nwait_s = 60.0\n");
    fs::write(&config, text).expect("there is room");
    let output = Command::new(programs::folder().join("companion"))
        .args(["doctor", "--listen-s", "0", "-c"])
        .arg(config)
        .arg("--out")
        .arg(folder.path().join("out"))
        .output()
        .expect("it runs");
    let told = String::from_utf8_lossy(&output.stdout);
    let source = told.lines().find(|line| line.contains(" source: "));
    let expected = format!("{endpoint}, live, 100 % of the first has depth");
    assert!(
        source.is_some_and(|line| line.contains(&expected)),
        "{told}"
    );
    driver.wait_with_output().expect("it ends");
}

#[test]
fn the_companion_maps_a_live_camera_and_says_when_it_is_lost() {
    let endpoint = free_endpoint();
    let mut mapping = Mapping::start(&endpoint);
    let driver = drive(&endpoint, 20).wait_with_output().expect("it ends");
    assert!(driver.status.success());
    // It has gone; the companion writes its report when it notices.
    let (_never, wait) = sync_channel::<()>(0);
    for _ in 0..600 {
        if mapping.report().is_file() {
            break;
        }
        let _pause = wait.recv_timeout(Duration::from_millis(100));
    }
    let report = fs::read_to_string(mapping.report());
    let report = report.unwrap_or_else(|_| panic!("no report; log:\n{}", mapping.log()));
    let report: Value = serde_json::from_str(&report).expect("JSON");
    let log = mapping.log();
    let frames = report["frames"].as_u64().expect("a number");
    assert!((1..=20).contains(&frames), "{report}");
    let lost = report["source_error"].as_str().expect("an error");
    for word in [
        "/uav/camera/color/image_raw",
        "2 s",
        "nobody publishes there",
    ] {
        assert!(lost.contains(word), "`{word}` is not in: {lost}");
        assert!(log.contains(word), "`{word}` is not in: {log}");
    }
    assert!(report["source_losses"].is_object(), "{report}");
    assert!(report["frames_in_recording"].is_null(), "{report}");
    // The map is still served; it ends when asked, with a failure.
    let ended = mapping.companion.stop(LONG);
    assert!(ended.is_err(), "its source has failed");
}
