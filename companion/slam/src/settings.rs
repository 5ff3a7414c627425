//! What can be chosen about the SLAM.

use std::ops::RangeInclusive;
use std::time::Duration;

/// What is done about people and vehicles in view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moving {
    /// They are found by their depth, by their features and, where a detector runs, by what they are, and are left out of
    /// tracking and of the dense points.
    Reject,
    /// The plain scheme of Li et al., Drones 2026, 10(6), 470, section 3.2, to compare with: only what a detector sees in
    /// the very frame is left out; without a detector, nothing.
    Paper,
    /// Everything is taken for static: cheaper, and right where nothing moves.
    Ignore,
}

/// What is made of the frames that are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mapping {
    /// A map of keyframes and points, adjusted together, in which old places are known again.
    Full,
    /// Only the last keyframe and its points, as it first saw them: frame-to-keyframe odometry, which drifts, as a plain
    /// baseline to compare with.
    LastKeyframe,
}

/// Settings; the defaults serve all cameras and recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Height of the first camera over the floor where the first frame shows no floor.
    pub initial_height_m: f64,
    /// How far below the first camera its floor can be; a plane nearer or farther (a table) is not taken for one.
    pub floor_below_m: RangeInclusive<f64>,
    /// Where the first camera looks, counter-clockwise from east.
    pub initial_heading_rad: f64,
    /// Features sought in an image.
    pub features: usize,
    /// Nearer depth is not believed.
    pub min_depth_m: f64,
    /// Farther depth is not mapped; up to twice as far it tells what is free.
    pub max_depth_m: f64,
    /// Every how many pixels, along and across, a dense point is taken.
    pub dense_stride: usize,
    /// Keyframes that are adjusted together; older ones move only when a loop is closed.
    pub window: usize,
    /// Keyframes kept, in all maps; beyond, the most redundant ones are forgotten. One takes up to 0.6 MB.
    pub max_keyframes: usize,
    /// Map points kept; beyond, the least seen ones are forgotten.
    pub max_points: usize,
    /// For how long a lost place is sought before a new map is begun.
    pub sought_for: Duration,
    /// What is done about people and vehicles in view.
    pub moving: Moving,
    /// Whether the map is adjusted, and loops are sought, in threads of their own. The result is the same, bit for bit.
    pub threaded: bool,
    /// What is made of the frames that are kept.
    pub mapping: Mapping,
    /// Seed of the random samples of plane and pose searches.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            initial_height_m: 1.5,
            floor_below_m: 0.15..=20.0,
            initial_heading_rad: 0.0,
            features: 1000,
            min_depth_m: 0.3,
            max_depth_m: 6.0,
            dense_stride: 3,
            window: 12,
            max_keyframes: 500,
            max_points: 60_000,
            sought_for: Duration::from_secs(4),
            moving: Moving::Reject,
            threaded: true,
            mapping: Mapping::Full,
            seed: 1,
        }
    }
}
