//! Where the world is: z up, the floor at z = 0, below the first camera.
//!
//! The floor is the plane of the first frame that has the most points, lies below a camera held roughly upright, and has
//! next to nothing beneath it (a table has the floor beneath it). Found by RANSAC, refined by least squares. A table that
//! fills the frame cannot be told from a floor: [`Floor`] says what was taken, the settings can exclude it.
//!
//! - M. A. Fischler, R. C. Bolles, *Random Sample Consensus*, CACM 1981.

use std::fmt;
use std::ops::RangeInclusive;

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng as _;

use crate::coarse::Coarse;
use crate::optics::Optics;

/// What the first frame's floor was taken to be: everything the map says of heights rests on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Floor {
    /// A plane was seen.
    Found {
        /// Of the first camera over it.
        height_m: f64,
        /// Of the frame's measured points, those on it; 0 to 1.
        share: f64,
    },
    /// None was in view: the camera was taken to be level, [`Settings::initial_height_m`](crate::Settings) high.
    Assumed {
        /// Of the first camera over it.
        height_m: f64,
    },
}

impl Floor {
    /// Of the first camera over it, in metres.
    pub fn height_m(&self) -> f64 {
        match *self {
            Self::Found { height_m, .. } | Self::Assumed { height_m } => height_m,
        }
    }
}

impl fmt::Display for Floor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Found { height_m, share } => write!(
                f,
                "found {height_m:.2} m below the camera, {:.0} % of the first frame",
                100.0 * share
            ),
            Self::Assumed { height_m } => write!(
                f,
                "none in the first frame: assumed {height_m:.2} m below a level camera"
            ),
        }
    }
}

/// A plane seen by the camera: `normal · p + height = 0`, the normal pointing up to the camera's side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    normal: Vector3<f64>,
    /// Of the camera over the plane.
    height_m: f64,
    /// Of all points, those on it.
    share: f64,
}

/// Cosine of the largest tilt of a camera that is held upright.
const UPRIGHT: f64 = 0.6;
/// The least share of the measured points that makes a floor.
const LEAST_SHARE: f64 = 0.06;
/// The largest share, of the floor's own points, that may lie beneath a floor.
const BENEATH: f64 = 0.08;
const TRIES: usize = 400;

/// The floor in the first frame, if it shows one so far below the camera.
pub(crate) fn find_floor(
    optics: &Optics,
    coarse: &Coarse,
    heights_m: &RangeInclusive<f64>,
    rng: &mut Pcg64,
) -> Option<Plane> {
    let points: Vec<Vector3<f64>> = (0..optics.cell_count())
        .step_by(3)
        .filter(|&cell| coarse.near_m[cell] > 0.0 && coarse.depth_m[cell] > 0.0)
        .map(|cell| optics.cell_point(cell, coarse.depth_m[cell]).map(f64::from))
        .collect();
    if points.len() < 100 {
        return None;
    }
    let mut best: Option<(usize, Plane)> = None;
    for _ in 0..TRIES {
        let mut pick = || points[(rng.next_u64() % points.len() as u64) as usize];
        let Some(floor) = plane_through(pick(), pick(), pick()) else {
            continue;
        };
        let (on, beneath) = count(&floor, &points);
        let acceptable = heights_m.contains(&floor.height_m)
            && on as f64 >= LEAST_SHARE * points.len() as f64
            && beneath as f64 <= BENEATH * on as f64;
        if acceptable && best.as_ref().is_none_or(|&(most, _)| on > most) {
            best = Some((on, floor));
        }
    }
    let (_, rough) = best?;
    let floor = refine(refine(rough, &points), &points);
    let (on, _) = count(&floor, &points);
    Some(Plane {
        share: on as f64 / points.len() as f64,
        ..floor
    })
}

fn plane_through(a: Vector3<f64>, b: Vector3<f64>, c: Vector3<f64>) -> Option<Plane> {
    let normal = (b - a).cross(&(c - a)).try_normalize(1e-4)?;
    upright(normal, &a)
}

/// Turns the normal up; refuses what cannot be a floor.
fn upright(normal: Vector3<f64>, on_plane: &Vector3<f64>) -> Option<Plane> {
    let normal = if normal.y > 0.0 { -normal } else { normal };
    let height_m = -normal.dot(on_plane);
    let possible = -normal.y >= UPRIGHT && height_m > 0.0;
    possible.then_some(Plane {
        normal,
        height_m,
        share: 0.0,
    })
}

/// How far a measurement may be off the plane: depth noise grows with the square of the distance.
fn tolerance(p: &Vector3<f64>) -> f64 {
    0.015 + 0.003 * p.z * p.z
}

fn count(floor: &Plane, points: &[Vector3<f64>]) -> (usize, usize) {
    let (mut on, mut beneath) = (0, 0);
    for p in points {
        let over = floor.normal.dot(p) + floor.height_m;
        let tolerance = tolerance(p);
        on += usize::from(over.abs() <= tolerance);
        beneath += usize::from(over < -4.0 * tolerance);
    }
    (on, beneath)
}

/// The plane that fits the points near it best.
fn refine(floor: Plane, points: &[Vector3<f64>]) -> Plane {
    let near: Vec<&Vector3<f64>> = points
        .iter()
        .filter(|p| (floor.normal.dot(p) + floor.height_m).abs() <= tolerance(p))
        .collect();
    if near.len() < 3 {
        return floor;
    }
    let mean = near.iter().copied().sum::<Vector3<f64>>() / near.len() as f64;
    let scatter: Matrix3<f64> = near
        .iter()
        .map(|p| (*p - mean) * (*p - mean).transpose())
        .sum();
    let eigen = scatter.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    upright(eigen.eigenvectors.column(least).into_owned(), &mean).unwrap_or(floor)
}

impl Plane {
    /// The floor of a level camera.
    pub(crate) fn level(height_m: f64) -> Self {
        Self {
            normal: -Vector3::y(),
            height_m,
            share: 0.0,
        }
    }

    pub(crate) fn as_found(&self) -> Floor {
        Floor::Found {
            height_m: self.height_m,
            share: self.share,
        }
    }
}

/// The first camera's pose: over the floor, its optical axis towards `heading_rad` counter-clockwise from east.
pub(crate) fn first_pose(floor: &Plane, heading_rad: f64) -> Isometry3<f64> {
    let up = floor.normal;
    // Straight down the optical axis has no heading; then the image's upper edge has it.
    let flat = |v: Vector3<f64>| (v - up * up.dot(&v)).try_normalize(1e-3);
    let forward = flat(Vector3::z())
        .or_else(|| flat(-Vector3::y()))
        .unwrap_or(Vector3::z());
    let left = up.cross(&forward);
    let level_from_camera =
        Matrix3::from_rows(&[forward.transpose(), left.transpose(), up.transpose()]);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad);
    Isometry3::from_parts(
        Translation3::new(0.0, 0.0, floor.height_m),
        turn * UnitQuaternion::from_matrix(&level_from_camera),
    )
}

#[cfg(test)]
mod tests {
    use maps::camera::Pinhole;
    use nalgebra::Point3;
    use rand_pcg::rand_core::SeedableRng as _;

    use super::*;

    fn optics() -> Optics {
        Optics::new(Pinhole {
            width: 160,
            height: 120,
            fx: 130.0,
            fy: 130.0,
            cx: 79.5,
            cy: 59.5,
            distortion: [0.0; 5],
        })
    }

    /// A floor 1.3 m below a camera that looks `down` and leans by `lean`, with a table of 0.7 m on its left and a wall.
    fn room(optics: &Optics, down: f64, lean: f64) -> Coarse {
        let up = UnitQuaternion::from_euler_angles(down, 0.0, lean) * -Vector3::y();
        let ahead = (Vector3::z() - up * up.z).normalize();
        let depth = |cell: usize| -> f32 {
            let ray = optics.cell_point(cell, 1.0).map(f64::from);
            let to_floor = 1.3 / -ray.dot(&up).min(-1e-9);
            let to_table = 0.6 / -ray.dot(&up).min(-1e-9);
            let to_wall = 4.0 / ray.dot(&ahead).max(1e-9);
            let nearest = if ray.x < -0.2 && to_table < 2.0 {
                to_table
            } else {
                to_floor
            };
            nearest.min(to_wall) as f32
        };
        let depth_m: Vec<f32> = (0..optics.cell_count()).map(depth).collect();
        Coarse {
            near_m: depth_m.clone(),
            far_m: depth_m.clone(),
            moving: vec![false; depth_m.len()],
            depth_m,
            slip: 0,
            named: None,
        }
    }

    #[track_caller]
    fn check_floor(down: f64, lean: f64) {
        let optics = optics();
        let floor = find_floor(
            &optics,
            &room(&optics, down, lean),
            &(0.15..=20.0),
            &mut Pcg64::seed_from_u64(1),
        );
        let floor = floor.expect("half of the view is floor");
        assert!(
            (floor.height_m - 1.3).abs() < 0.02,
            "{down} down, {lean} leaning: {floor:?}"
        );
        let pose = first_pose(&floor, 0.5);
        let off = pose.rotation * floor.normal - Vector3::z();
        assert!(off.norm() < 1e-9, "up stays up");
        let axis = pose.rotation * Vector3::z();
        assert!(
            (axis.y.atan2(axis.x) - 0.5).abs() < 1e-9,
            "the optical axis has the heading"
        );
        let origin = pose * Point3::origin();
        assert!(origin.x.abs() < 1e-12 && origin.y.abs() < 1e-12);
    }

    #[test]
    fn the_floor_is_found_beneath_a_table_and_before_a_wall() {
        check_floor(0.4, 0.0);
        check_floor(0.6, 0.2);
        check_floor(0.3, -0.3);
    }

    #[test]
    fn without_a_floor_the_camera_is_level_at_the_given_height() {
        let optics = optics();
        let empty = Coarse {
            depth_m: vec![0.0; optics.cell_count()],
            near_m: vec![0.0; optics.cell_count()],
            ..Coarse::default()
        };
        let heights_m = 0.15..=20.0;
        assert!(find_floor(&optics, &empty, &heights_m, &mut Pcg64::seed_from_u64(1)).is_none());
        let pose = first_pose(&Plane::level(1.5), 0.0);
        assert!((pose * Point3::new(0.0, 0.0, 2.0) - Point3::new(2.0, 0.0, 1.5)).norm() < 1e-12);
    }

    #[test]
    fn a_table_that_fills_the_view_is_passed_over_where_the_floor_is_known_to_be_lower() {
        let optics = optics();
        let up = UnitQuaternion::from_euler_angles(0.5, 0.0, 0.0) * -Vector3::y();
        let table = |cell: usize| {
            let ray = optics.cell_point(cell, 1.0).map(f64::from);
            (0.6 / -ray.dot(&up).min(-1e-9)).min(4.0) as f32
        };
        let depth_m: Vec<f32> = (0..optics.cell_count()).map(table).collect();
        let view = Coarse {
            near_m: depth_m.clone(),
            far_m: depth_m.clone(),
            moving: vec![false; depth_m.len()],
            depth_m,
            slip: 0,
            named: None,
        };
        let find = |heights_m| find_floor(&optics, &view, &heights_m, &mut Pcg64::seed_from_u64(1));
        let taken = find(0.15..=20.0).expect("it looks like a floor");
        let Floor::Found { height_m, share } = taken.as_found() else {
            panic!("found: {taken:?}");
        };
        assert!((height_m - 0.6).abs() < 0.02 && share > 0.5, "{taken:?}");
        assert!(find(1.0..=20.0).is_none());
    }
}
