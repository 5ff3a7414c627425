//! What an antenna sees of the sky, in a scene.

use nalgebra::{Point3, Vector3};

use maps::frame::Vector;

use super::Sky;
use crate::rays::Snapshot;

/// Farther walls reflect too little to matter.
const WALLS_M: f64 = 40.0;
/// Rays by which the open share of the sky is told.
const SKY_RAYS: u32 = 48;
/// Satellites lower than this are left out by receivers.
const MASK_RAD: f64 = 0.17;

impl Sky {
    /// None of it: indoors.
    pub const HIDDEN: Self = Self {
        open: 0.0,
        wall: None,
    };

    /// How much of the sky an antenna sees outdoors, and the nearest wall.
    pub fn over(snapshot: &Snapshot, antenna: Point3<f64>) -> Self {
        let open =
            (0..SKY_RAYS).filter(|ray| snapshot.cast(antenna, towards_sky(*ray), 300.0).is_none());
        let open = open.count() as f64 / f64::from(SKY_RAYS);
        let walls = (0..16).filter_map(|i| {
            let (left, forward) = (std::f64::consts::TAU * f64::from(i) / 16.0).sin_cos();
            let direction = Vector3::new(forward, left, 0.0);
            let hit = snapshot.cast(antenna, direction, WALLS_M)?;
            Some((hit.range_m, direction))
        });
        let wall = walls.min_by(|(a, _), (b, _)| a.total_cmp(b));
        Self {
            open,
            wall: wall.map(|(_, direction)| Vector::from_raw(direction)),
        }
    }
}

/// Directions spread evenly over the sky above the mask: equal areas lie between equal steps of the sine of elevation, and
/// the golden angle keeps them apart.
fn towards_sky(ray: u32) -> Vector3<f64> {
    const GOLDEN_RAD: f64 = 2.399_963_229_728_653;
    let low = MASK_RAD.sin();
    let up = low + (1.0 - low) * (f64::from(ray) + 0.5) / f64::from(SKY_RAYS);
    let flat = (1.0 - up * up).sqrt();
    let (left, forward) = (GOLDEN_RAD * f64::from(ray)).sin_cos();
    Vector3::new(flat * forward, flat * left, up)
}
