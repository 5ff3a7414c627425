//! Recordings with a depth camera: which there are in a folder, and how each is read.
//!
//! Two layouts are understood: that of the TUM and Bonn data sets, whose cameras are known by the recording's name, and that
//! of 7-Scenes, which gets lists in TUM layout that point to its pictures. What is neither is left out by name.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use maps::camera::Pinhole;
use maps::frame::Camera;
use maps::time::Stamp;
use maps::trajectory::{Trajectory, tum};

/// What a recording is like.
pub(super) enum Layout {
    /// `rgb.txt`, `depth.txt` or `associations.txt`.
    Tum(Pinhole),
    /// `frame-NNNNNN.color.jpg`, `.depth.png`, `.pose.txt` and `camera-intrinsics.txt`.
    SevenScenes,
}

/// A recording that can be read.
pub(super) struct Recording {
    pub(super) name: String,
    pub(super) folder: PathBuf,
    pub(super) layout: Layout,
}

/// A folder that is none, and why.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct LeftOut {
    pub(super) name: String,
    pub(super) why: &'static str,
}

/// The recordings in a folder, or in `rgbd` in it, by name; and what else is there.
pub(super) fn find(data: &Path) -> anyhow::Result<(Vec<Recording>, Vec<LeftOut>)> {
    let inner = data.join("rgbd");
    let data = if inner.is_dir() {
        inner
    } else {
        data.to_owned()
    };
    let entries = fs::read_dir(&data)
        .with_context(|| format!("cannot look for recordings in {}", data.display()))?;
    let mut folders = Vec::new();
    for entry in entries {
        let path = entry
            .with_context(|| format!("cannot look for recordings in {}", data.display()))?
            .path();
        if path.is_dir() {
            folders.push(path);
        }
    }
    folders.sort();
    let (mut found, mut left_out) = (Vec::new(), Vec::new());
    for folder in folders {
        let name = folder.file_name().unwrap_or_default();
        let name = name.to_string_lossy().into_owned();
        match layout(&folder, &name) {
            Ok(layout) => found.push(Recording {
                name,
                folder,
                layout,
            }),
            Err(why) => left_out.push(LeftOut { name, why }),
        }
    }
    Ok((found, left_out))
}

fn layout(folder: &Path, name: &str) -> Result<Layout, &'static str> {
    let has = |file: &str| folder.join(file).is_file();
    if has("associations.txt") || has("rgb.txt") && has("depth.txt") {
        let camera = camera(name);
        return camera
            .map(Layout::Tum)
            .ok_or("its camera is not known: its name begins with neither bonn nor tum_fr1");
    }
    if has("camera-intrinsics.txt") && has("frame-000000.color.jpg") {
        return Ok(Layout::SevenScenes);
    }
    Err("it has neither the lists of the TUM layout nor the pictures of 7-Scenes")
}

/// The calibration that the publishers of a data set give.
fn camera(name: &str) -> Option<Pinhole> {
    let (focal, centre, distortion) = if name.starts_with("bonn") || name.starts_with("rgbd_bonn") {
        (
            [542.822_841, 542.576_870],
            [315.593_520, 237.756_098],
            [0.039_903, -0.099_343, -0.000_730, -0.000_144, 0.0],
        )
    } else if name.starts_with("tum_fr1") || name.contains("freiburg1") {
        (
            [517.306_408, 516.469_215],
            [318.643_040, 255.313_989],
            [0.262_383, -0.953_104, -0.005_358, 0.002_628, 1.163_314],
        )
    } else {
        return None;
    };
    Some(Pinhole {
        width: 640,
        height: 480,
        fx: focal[0],
        fy: focal[1],
        cx: centre[0],
        cy: centre[1],
        distortion,
    })
}

/// The truth in a TUM folder; none where it has none. Of poses with one stamp the first counts.
pub(super) fn truth(folder: &Path) -> anyhow::Result<Option<Trajectory<Camera>>> {
    let path = folder.join("groundtruth.txt");
    if !path.is_file() {
        return Ok(None);
    }
    let text = fs::read_to_string(&path)
        .with_context(|| format!("cannot read the truth in {}", path.display()))?;
    let trajectory = tum::parse(&text);
    Ok(Some(trajectory.with_context(|| {
        format!("cannot read the truth in {}", path.display())
    })?))
}

/// Pictures a second of a Kinect.
const RATE_HZ: u64 = 30;

/// Writes `associations.txt` for a recording in the layout of 7-Scenes into a folder; its pictures stay where they are. Frames
/// are numbered from the start at 30 a second.
pub(super) fn list_seven_scenes(recording: &Path, into: &Path) -> anyhow::Result<Pinhole> {
    let recording = std::path::absolute(recording)?;
    let camera = seven_scenes_camera(&recording.join("camera-intrinsics.txt"))?;
    let mut numbers: Vec<u64> = Vec::new();
    for entry in fs::read_dir(&recording)? {
        let name = entry?.file_name();
        let number = name.to_string_lossy();
        let number = number
            .strip_prefix("frame-")
            .and_then(|n| n.strip_suffix(".color.jpg"));
        numbers.extend(number.and_then(|n| n.parse::<u64>().ok()));
    }
    numbers.sort_unstable();
    let mut list = String::new();
    for number in numbers {
        let at = Stamp::from_nanos(number.saturating_mul(1_000_000_000) / RATE_HZ);
        let picture = recording.join(format!("frame-{number:06}"));
        let picture = picture.display();
        // Writing to a string cannot fail.
        let _ = writeln!(list, "{at} {picture}.color.jpg {at} {picture}.depth.png");
    }
    let path = into.join("associations.txt");
    fs::write(&path, list).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(camera)
}

/// A 3 × 3 matrix of intrinsics, row by row.
fn seven_scenes_camera(path: &Path) -> anyhow::Result<Pinhole> {
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let numbers: Vec<f64> = (text.split_whitespace())
        .filter_map(|word| word.parse().ok())
        .collect();
    let [fx, _, cx, _, fy, cy, ..] = numbers[..] else {
        anyhow::bail!("{} is no matrix of intrinsics", path.display());
    };
    Ok(Pinhole {
        width: 640,
        height: 480,
        fx,
        fy,
        cx,
        cy,
        distortion: [0.0; 5],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(path: &Path) {
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(path, "").expect("written");
    }

    #[test]
    fn what_is_no_recording_is_left_out_by_name() {
        let data = tempfile::tempdir().expect("a folder");
        let at = |path: &str| data.path().join("rgbd").join(path);
        touch(&at("bonn_x/associations.txt"));
        touch(&at("other/associations.txt"));
        touch(&at("pictures/README.md"));
        touch(&at("tum_fr1_x/rgb.txt"));
        touch(&at("tum_fr1_x/depth.txt"));
        touch(&at("scenes/camera-intrinsics.txt"));
        touch(&at("scenes/frame-000000.color.jpg"));
        let (found, left_out) = find(data.path()).expect("readable");
        let names: Vec<_> = found.iter().map(|recording| &recording.name).collect();
        assert_eq!(names, ["bonn_x", "scenes", "tum_fr1_x"]);
        let names: Vec<_> = left_out.iter().map(|left| &left.name).collect();
        assert_eq!(names, ["other", "pictures"]);
        assert!(left_out[0].why.contains("camera"), "{}", left_out[0].why);
        let error = find(&data.path().join("none")).err().expect("no folder");
        assert!(error.to_string().contains("none"), "{error}");
    }

    #[test]
    fn frames_of_seven_scenes_are_listed_in_order_with_the_time_of_their_number() {
        let data = tempfile::tempdir().expect("a folder");
        for number in [8, 0, 16] {
            touch(&data.path().join(format!("frame-{number:06}.color.jpg")));
        }
        let intrinsics = "585.0 0.0 320.0\n0.0 586.0 240.0\n0.0 0.0 1.0\n";
        fs::write(data.path().join("camera-intrinsics.txt"), intrinsics).expect("written");
        let into = tempfile::tempdir().expect("a folder");
        let camera = list_seven_scenes(data.path(), into.path()).expect("listed");
        assert!((camera.fy - 586.0).abs() < 1e-9 && (camera.cx - 320.0).abs() < 1e-9);
        let list = fs::read_to_string(into.path().join("associations.txt")).expect("a list");
        let stamps: Vec<_> = list.lines().map(|line| &line[..11]).collect();
        assert_eq!(stamps, ["0.000000000", "0.266666666", "0.533333333"]);
        assert!(list.contains("frame-000008.depth.png"), "{list}");
    }
}
