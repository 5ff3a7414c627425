//! What can be asked of the camera of the 3-D view, by buttons, keys and scripts.

use mavlink_ext::SystemId;

/// Where to look from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraCommand {
    /// Straight down, north up, all of the map.
    Top,
    /// All of the map, from the present direction.
    Fit,
    /// Keep a vehicle in the middle.
    Follow(SystemId),
    /// Follow nobody.
    Free,
    /// From this direction and distance.
    Orbit {
        /// Where the camera looks to, clockwise from north.
        azimuth_deg: f64,
        /// How far it looks down; 90 is straight down.
        elevation_deg: f64,
        /// From what it looks at.
        distance_m: f64,
    },
    /// At this place.
    LookAt {
        /// East.
        x_m: f64,
        /// North.
        y_m: f64,
        /// Up.
        z_m: f64,
    },
}
