//! Trajectories as text: one pose a line, `timestamp tx ty tz qx qy qz qw`, in seconds and metres, `#` before a comment.
//!
//! - J. Sturm et al., *A benchmark for the evaluation of RGB-D SLAM systems*, IROS 2012, and its file formats.

use std::fmt::Write as _;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::Trajectory;
use crate::frame::{Isometry, World};
use crate::time::Stamp;

/// What is wrong with a line of a trajectory.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("line {line}: {problem}")]
pub struct TumError {
    /// Counted from 1, comments and empty lines included.
    pub line: usize,
    /// What is wrong.
    pub problem: TumProblem,
}

/// What can be wrong with a line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TumProblem {
    /// Too few or too many fields.
    #[error("{found} fields instead of the 8 of `timestamp tx ty tz qx qy qz qw`")]
    Fields {
        /// How many there are.
        found: usize,
    },
    /// A field that is no finite number.
    #[error("`{text}` is not a finite number ({name})")]
    Number {
        /// Name of the field.
        name: &'static str,
        /// What it says, shortened.
        text: String,
    },
    /// A time stamp that is negative or too large.
    #[error("`{text}` is not a time in seconds since 1970 or since the start")]
    Stamp {
        /// What it says, shortened.
        text: String,
    },
    /// A quaternion that is far from a unit one.
    #[error("the quaternion has length {norm}, not 1")]
    Quaternion {
        /// Its length.
        norm: f64,
    },
    /// A time stamp not after the one before.
    #[error("time {at} s is not after the {previous} s before it")]
    NotIncreasing {
        /// The stamp.
        at: Stamp,
        /// The one before.
        previous: Stamp,
    },
}

const NAMES: [&str; 8] = ["timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw"];
/// Files have four digits or more; anything further off is another format.
const NORM_TOLERANCE: f64 = 0.05;

/// Reads a trajectory. Fields are separated by blanks, tabs or commas.
pub fn parse<B>(text: &str) -> Result<Trajectory<B>, TumError> {
    let mut poses: Vec<(Stamp, Isometry<_, B>)> = Vec::new();
    let lines = text.trim_start_matches('\u{feff}').lines().enumerate();
    for (index, line) in lines {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let failed = |problem| TumError {
            line: index + 1,
            problem,
        };
        let (at, pose) = pose(line).map_err(failed)?;
        if let Some((previous, _)) = poses.last().filter(|(previous, _)| *previous >= at) {
            return Err(failed(TumProblem::NotIncreasing {
                at,
                previous: *previous,
            }));
        }
        poses.push((at, Isometry::claim(pose)));
    }
    Ok(Trajectory { poses })
}

fn pose(line: &str) -> Result<(Stamp, Isometry3<f64>), TumProblem> {
    let fields = || {
        line.split([' ', '\t', ','])
            .filter(|field| !field.is_empty())
    };
    let found = fields().count();
    if found != NAMES.len() {
        return Err(TumProblem::Fields { found });
    }
    let mut numbers = [0.0; 8];
    for ((field, name), number) in fields().zip(NAMES).zip(&mut numbers) {
        *number = field
            .parse()
            .ok()
            .filter(|n: &f64| n.is_finite())
            .ok_or_else(|| TumProblem::Number {
                name,
                text: shortened(field),
            })?;
    }
    let stamp_text = fields().next().unwrap_or_default();
    let at = stamp(stamp_text, numbers[0]).ok_or_else(|| TumProblem::Stamp {
        text: shortened(stamp_text),
    })?;
    let [_, tx, ty, tz, qx, qy, qz, qw] = numbers;
    let quaternion = Quaternion::new(qw, qx, qy, qz);
    let norm = quaternion.norm();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        return Err(TumProblem::Quaternion { norm });
    }
    let pose = Isometry3::from_parts(
        Translation3::new(tx, ty, tz),
        UnitQuaternion::from_quaternion(quaternion),
    );
    Ok((at, pose))
}

/// The stamp a field stands for, exact to the nanosecond where a double would not be: digits with at most one point.
/// Other notations are taken as the number they were read as.
fn stamp(text: &str, seconds: f64) -> Option<Stamp> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
    if whole.is_empty() || !digits(whole) || !digits(fraction) {
        return Stamp::from_secs_f64(seconds);
    }
    let whole: u64 = whole.parse().ok()?;
    let nanos: u64 = format!("{fraction:0<9.9}").parse().ok()?;
    let total = whole.checked_mul(1_000_000_000)?.checked_add(nanos)?;
    Some(Stamp::from_nanos(total))
}

fn shortened(text: &str) -> String {
    text.chars().take(32).collect()
}

/// Writes a trajectory such that [`parse`] gives back the same stamps and, to rounding, the same poses.
pub fn format<B>(trajectory: &Trajectory<B>) -> String {
    format_poses(trajectory.poses())
}

/// The same of poses in the order in which they come.
pub fn format_poses<B>(poses: &[(Stamp, Isometry<World, B>)]) -> String {
    let mut text = String::from("# timestamp tx ty tz qx qy qz qw\n");
    for (at, pose) in poses {
        let t = pose.translation().raw;
        let q = pose.rotation();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{at} {} {} {} {} {} {} {}",
            t.x, t.y, t.z, q.i, q.j, q.k, q.w
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::frame::Camera;

    const POSE: &str = "0 0 0 0 0 0 1";

    #[track_caller]
    fn check_error(text: &str, expected: &str) {
        let error = parse::<Camera>(text).expect_err("refused");
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn errors_name_the_line_and_what_is_wrong_with_it() {
        check_error(
            "# comment\n\n1.0 0 0 0 0 0 0\n",
            "line 3: 7 fields instead of the 8 of `timestamp tx ty tz qx qy qz qw`",
        );
        check_error(
            "1.0 0 zero 0 0 0 0 1",
            "line 1: `zero` is not a finite number (ty)",
        );
        check_error(
            "1.0 0 0 nan 0 0 0 1",
            "line 1: `nan` is not a finite number (tz)",
        );
        check_error(
            &format!("-1.0 {POSE}"),
            "line 1: `-1.0` is not a time in seconds since 1970 or since the start",
        );
        check_error(
            "1.0 0 0 0 0 0 0 0",
            "line 1: the quaternion has length 0, not 1",
        );
        check_error(
            &format!("2.5 {POSE}\n2.5 {POSE}\n"),
            "line 2: time 2.500000000 s is not after the 2.500000000 s before it",
        );
    }

    #[test]
    fn stamps_are_exact_where_a_double_is_not() {
        let text = format!(
            "1305031098.665900001 {POSE}\r\n1.305031099e9,{}",
            POSE.replace(' ', ",")
        );
        let trajectory = parse::<Camera>(&text).expect("two poses");
        let stamps: Vec<u64> = trajectory
            .poses()
            .iter()
            .map(|(at, _)| at.as_nanos())
            .collect();
        assert_eq!(
            stamps,
            [1_305_031_098_665_900_001, 1_305_031_099_000_000_000]
        );
    }

    #[test]
    fn a_file_without_poses_is_an_empty_trajectory() {
        assert!(parse::<Camera>("# nothing\n").expect("no poses").is_empty());
        assert!(parse::<Camera>("").expect("no poses").is_empty());
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in ".{0,300}") {
            drop(parse::<Camera>(&text));
        }

        #[test]
        fn any_bytes_among_numbers_are_read_or_refused(
            fields in prop::collection::vec("[-+0-9.eE,# \\t\\n\\PCnaif]{0,12}", 0..24)
        ) {
            drop(parse::<Camera>(&fields.join(" ")));
        }

        #[test]
        fn what_was_written_is_read_back(
            steps in prop::collection::vec((1_u64..5_000_000_000, prop::array::uniform6(-3.0..3.0_f64)), 0..12)
        ) {
            let mut nanos = 1_700_000_000_000_000_000;
            let poses = steps.into_iter().map(|(step, [x, y, z, rx, ry, rz])| {
                nanos += step;
                let pose = Isometry3::new([x, y, z].into(), [rx, ry, rz].into());
                (Stamp::from_nanos(nanos), Isometry::<_, Camera>::claim(pose))
            }).collect();
            let written = Trajectory::new(poses).expect("increasing");
            let read = parse::<Camera>(&format(&written)).expect("own format");
            prop_assert_eq!(written.len(), read.len());
            for ((a_at, a), (b_at, b)) in written.poses().iter().zip(read.poses()) {
                prop_assert_eq!(a_at, b_at);
                let off = (a.inverse() * *b).raw;
                prop_assert!(off.translation.vector.norm() < 1e-12 && off.rotation.angle() < 1e-7);
            }
        }
    }
}
