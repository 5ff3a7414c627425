//! A folder in the layout of the TUM and Bonn RGB-D data sets.
//!
//! `rgb.txt` and `depth.txt` list time stamps and pictures; the two cameras are not synchronised, so a frame is a
//! colour and a depth image that are each other's nearest in time. `associations.txt`, where present, lists the pairs
//! instead. A frame has the stamp of its colour image, as in the published evaluations. `groundtruth.txt`, where
//! present, is the truth: `timestamp tx ty tz qx qy qz qw`. Lines that start with `#` are comments.
//!
//! - J. Sturm et al., *A Benchmark for the Evaluation of RGB-D SLAM Systems*, IROS 2012.

use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use maps::trajectory::tum::parse;

use crate::image::{decode_color, decode_depth};
use crate::pairing::mutual_nearest;
use crate::{RgbdSource, SourceError, TruthPose, check_camera};

/// What to do about images that are listed and not there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MissingImages {
    /// Refuse the folder: it is damaged.
    #[default]
    Error,
    /// Leave their frames out: the folder is an excerpt.
    Skip,
}

/// How to read a folder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The value of a depth pixel at 1 m.
    pub depth_factor: f64,
    /// How far apart in time the colour and the depth image of a frame may be.
    pub max_difference: Duration,
    /// What to do about images that are listed and not there.
    pub missing_images: MissingImages,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            depth_factor: 5000.0,
            max_difference: Duration::from_millis(20),
            missing_images: MissingImages::Error,
        }
    }
}

/// One frame, not yet read.
#[derive(Clone, Debug, PartialEq)]
struct Pair {
    at: Stamp,
    color: PathBuf,
    depth: PathBuf,
}

/// A folder of colour and depth images.
#[derive(Debug)]
pub struct TumFolder {
    name: String,
    camera: Pinhole,
    depth_factor: f64,
    pairs: Vec<Pair>,
    next: usize,
    truth: Vec<TruthPose>,
}

impl TumFolder {
    /// Reads the lists of a folder and checks that the images are there.
    pub fn open(folder: &Path, camera: Pinhole, settings: Settings) -> Result<Self, SourceError> {
        check_camera(folder, &camera)?;
        let pairs = pairs(folder, settings.max_difference)?;
        let pairs = present(pairs, settings.missing_images)?;
        let truth_path = folder.join("groundtruth.txt");
        let truth = if truth_path.exists() {
            truth(&truth_path)?
        } else {
            Vec::new()
        };
        Ok(Self {
            name: crate::stem(folder),
            camera,
            depth_factor: settings.depth_factor,
            pairs,
            next: 0,
            truth,
        })
    }
}

impl RgbdSource for TumFolder {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Pinhole {
        self.camera
    }

    fn frame_count(&self) -> Option<usize> {
        Some(self.pairs.len())
    }

    fn truth(&self) -> &[TruthPose] {
        &self.truth
    }

    fn next_frame(&mut self) -> Result<Option<RgbdFrame>, SourceError> {
        let Some(pair) = self.pairs.get(self.next) else {
            return Ok(None);
        };
        self.next = self.pairs.len();
        let frame = read_pair(pair, &self.camera, self.depth_factor)?;
        // Only now: after an error there are no more frames.
        self.next = self.pairs.partition_point(|p| p.at <= frame.at);
        Ok(Some(frame))
    }
}

fn read_pair(pair: &Pair, camera: &Pinhole, factor: f64) -> Result<RgbdFrame, SourceError> {
    let color = read(&pair.color)?;
    let depth = read(&pair.depth)?;
    Ok(RgbdFrame {
        at: pair.at,
        width: camera.width,
        height: camera.height,
        rgb: decode_color(&pair.color, &color, camera)?,
        depth_m: decode_depth(&pair.depth, &depth, camera, factor)?,
    })
}

/// No picture or list is larger.
const LARGEST_FILE: u64 = 64 << 20;

fn read(path: &Path) -> Result<Vec<u8>, SourceError> {
    let cannot = |source| SourceError::Read {
        path: path.to_owned(),
        source,
    };
    let file = File::open(path).map_err(cannot)?;
    let mut bytes = Vec::new();
    let length = file
        .take(LARGEST_FILE + 1)
        .read_to_end(&mut bytes)
        .map_err(cannot)?;
    if length as u64 > LARGEST_FILE {
        return Err(SourceError::TooLong {
            path: path.to_owned(),
            limit: LARGEST_FILE,
        });
    }
    Ok(bytes)
}

/// The lines of a list with their numbers, without comments and blank lines.
fn for_each_line(
    path: &Path,
    expected: &'static str,
    mut parse: impl FnMut(&[&str]) -> Option<()>,
) -> Result<(), SourceError> {
    let bytes = read(path)?;
    // Not UTF-8 only in comments, or in a line that is then refused for itself.
    let text = String::from_utf8_lossy(&bytes);
    for (index, line) in text.lines().enumerate() {
        let words: Vec<&str> = line
            .split([' ', '\t', ',', '\r'])
            .filter(|w| !w.is_empty())
            .collect();
        if words.first().is_none_or(|first| first.starts_with('#')) {
            continue;
        }
        parse(&words).ok_or_else(|| SourceError::Line {
            path: path.to_owned(),
            line: index + 1,
            expected,
        })?;
    }
    Ok(())
}

/// `1548339819.87426` exactly: as a number of 64 bits it would be known to a quarter of a microsecond only.
fn stamp(text: &str) -> Option<Stamp> {
    let (seconds, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    if seconds.is_empty() || !digits(seconds) || !digits(fraction) {
        // Tools that write `1.548e9` exist.
        return text.parse().ok().and_then(Stamp::from_secs_f64);
    }
    let seconds: u64 = seconds.parse().ok()?;
    let nanos: u64 = format!("{fraction:0<9.9}").parse().ok()?;
    let nanos = seconds.checked_mul(1_000_000_000)?.checked_add(nanos)?;
    Some(Stamp::from_nanos(nanos))
}

/// The frames that the folder's lists describe, in order of time, each stamp once.
fn pairs(folder: &Path, max_difference: Duration) -> Result<Vec<Pair>, SourceError> {
    let associations = folder.join("associations.txt");
    let mut pairs = if associations.exists() {
        listed_pairs(folder, &associations)?
    } else if !folder.join("rgb.txt").exists() {
        return Err(SourceError::NotTum {
            path: folder.to_owned(),
        });
    } else {
        let colors = list(folder, "rgb.txt")?;
        let depths = list(folder, "depth.txt")?;
        let pairs = nearest_pairs(&colors, &depths, max_difference);
        if pairs.is_empty() {
            return Err(SourceError::NoPairs {
                path: folder.to_owned(),
                colors: colors.len(),
                depths: depths.len(),
                window_ms: max_difference.as_millis(),
            });
        }
        pairs
    };
    pairs.sort_by_key(|pair| pair.at);
    pairs.dedup_by_key(|pair| pair.at);
    Ok(pairs)
}

/// `associations.txt`: colour first as `associate.py rgb.txt depth.txt` writes it, or the other way round.
fn listed_pairs(folder: &Path, path: &Path) -> Result<Vec<Pair>, SourceError> {
    let mut pairs = Vec::new();
    for_each_line(path, "timestamp picture timestamp picture", |words| {
        let &[first_at, first, second_at, second] = words else {
            return None;
        };
        let (first_at, second_at) = (stamp(first_at)?, stamp(second_at)?);
        let depth_first = first.contains("depth") && !second.contains("depth");
        let (at, color, depth) = if depth_first {
            (second_at, second, first)
        } else {
            (first_at, first, second)
        };
        pairs.push(Pair {
            at,
            color: folder.join(color),
            depth: folder.join(depth),
        });
        Some(())
    })?;
    Ok(pairs)
}

/// One of `rgb.txt` and `depth.txt`, in order of time.
fn list(folder: &Path, name: &str) -> Result<Vec<(Stamp, PathBuf)>, SourceError> {
    let mut images = Vec::new();
    for_each_line(&folder.join(name), "timestamp picture", |words| {
        let &[at, picture] = words else {
            return None;
        };
        images.push((stamp(at)?, folder.join(picture)));
        Some(())
    })?;
    images.sort();
    Ok(images)
}

fn nearest_pairs(
    colors: &[(Stamp, PathBuf)],
    depths: &[(Stamp, PathBuf)],
    max_difference: Duration,
) -> Vec<Pair> {
    let stamps = |images: &[(Stamp, PathBuf)]| images.iter().map(|(at, _)| *at).collect::<Vec<_>>();
    let pairs = mutual_nearest(&stamps(colors), &stamps(depths), max_difference);
    let pair = |(color, depth): (usize, usize)| Pair {
        at: colors[color].0,
        color: colors[color].1.clone(),
        depth: depths[depth].1.clone(),
    };
    pairs.into_iter().map(pair).collect()
}

/// The pairs of which both images are there.
fn present(pairs: Vec<Pair>, missing_images: MissingImages) -> Result<Vec<Pair>, SourceError> {
    let listed = 2 * pairs.len();
    let missing: Vec<&PathBuf> = pairs
        .iter()
        .flat_map(|pair| [&pair.color, &pair.depth])
        .filter(|path| fs::metadata(path).is_err())
        .collect();
    let complete = |pair: &Pair| pair.color.exists() && pair.depth.exists();
    match missing.split_first() {
        None => Ok(pairs),
        Some(_) if missing_images == MissingImages::Skip && pairs.iter().any(complete) => {
            Ok(pairs.into_iter().filter(complete).collect())
        }
        Some((&first, others)) => Err(SourceError::MissingImages {
            path: first.clone(),
            others: others.len(),
            listed,
        }),
    }
}

/// `groundtruth.txt`: `timestamp tx ty tz qx qy qz qw`.
fn truth(path: &Path) -> Result<Vec<TruthPose>, SourceError> {
    let bytes = read(path)?;
    let trajectory = parse::<Camera>(&String::from_utf8_lossy(&bytes));
    let trajectory = trajectory.map_err(|source| SourceError::Truth {
        path: path.to_owned(),
        source,
    })?;
    let pose = |&(at, pose): &(Stamp, Isometry<World, Camera>)| TruthPose { at, pose: pose.raw };
    Ok(trajectory.poses().iter().map(pose).collect())
}

#[cfg(test)]
#[path = "tum_tests.rs"]
mod tests;
