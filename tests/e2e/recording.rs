//! A user records what all sensors of a street say, and the official reader opens it.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::{peers, programs};

/// Runs a program of ours to its end.
#[track_caller]
fn run(program: &str, arguments: &[&str]) {
    let output = Command::new(programs::folder().join(program))
        .args(arguments)
        .output()
        .expect("it starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{program} {arguments:?}: {said}");
}

fn json(path: &Path) -> Value {
    let text = fs::read_to_string(path).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn the_official_reader_decodes_every_message_of_a_recorded_street() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("street.mcap");
    let report = folder.path().join("report.json");
    let [file, report] = [&file, &report].map(|path| path.to_str().expect("UTF-8"));
    let scene = [
        "run",
        "--scene",
        "residential-alley",
        "--seed",
        "1100",
        "--headless",
    ];
    let what = [
        "--duration",
        "1",
        "--masks",
        "--record",
        file,
        "--report",
        report,
    ];
    run("sitl", &[&scene[..], &what[..]].concat());

    let read: Value =
        serde_json::from_str(&peers::python("read_mcap.py", &[file.as_ref()])).expect("JSON");
    let report = json(Path::new(report));
    assert_eq!(read["counts"], report["recording"]["messages"]);
    let types: BTreeMap<String, String> =
        serde_json::from_value(read["types"].clone()).expect("texts");
    for (topic, kind) in [
        ("/uav/camera/color/image_raw", "sensor_msgs/msg/Image"),
        (
            "/uav/camera/color/camera_info",
            "sensor_msgs/msg/CameraInfo",
        ),
        (
            "/uav/ground_truth/class/compressed",
            "sensor_msgs/msg/CompressedImage",
        ),
        ("/uav/imu/data_raw", "sensor_msgs/msg/Imu"),
        ("/uav/gnss/fix", "sensor_msgs/msg/NavSatFix"),
        ("/uav/barometer/pressure", "sensor_msgs/msg/FluidPressure"),
        ("/uav/rangefinder/range", "sensor_msgs/msg/Range"),
        ("/uav/clock/reference", "sensor_msgs/msg/TimeReference"),
        (
            "/ugv/camera_front/image_raw/compressed",
            "sensor_msgs/msg/CompressedImage",
        ),
        ("/ugv/lidar/points", "sensor_msgs/msg/PointCloud2"),
        ("/ugv/radar/points", "sensor_msgs/msg/PointCloud2"),
        ("/ugv/wheels/joint_states", "sensor_msgs/msg/JointState"),
        ("/ugv/ground_truth/odom", "nav_msgs/msg/Odometry"),
        ("/tf", "tf2_msgs/msg/TFMessage"),
    ] {
        assert_eq!(types.get(topic).map(String::as_str), Some(kind), "{topic}");
    }
    let frames: Vec<String> = serde_json::from_value(read["frames"].clone()).expect("texts");
    for frame in [
        "world",
        "uav/base_link",
        "ugv/base_link",
        "ugv/lidar",
        "camera_color_optical_frame",
    ] {
        assert!(
            frames.iter().any(|known| known == frame),
            "{frame} in {frames:?}"
        );
    }
    assert_eq!(read["metadata"]["simulation"]["scene"], "residential-alley");
}
