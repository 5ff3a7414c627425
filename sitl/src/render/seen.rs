//! A face as a camera sees it.

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use nalgebra::{Point3, Vector3};

use super::raster::{Outline, Polygon};
use crate::scene::Face;

/// Surfaces nearer than this are not drawn.
pub(super) const NEAR_M: f64 = 0.05;
/// What is so near the edge of what can be seen, or of turning its back, is looked at more closely.
const DOUBT_M: f64 = 1e-6;

/// A face as the camera sees it: its outline in pixels and its plane as inverse depth.
pub(super) struct Seen<'a> {
    pub(super) face: &'a Face,
    pub(super) outline: Outline,
    /// `1/z = inverse · (u, v, 1)`.
    pub(super) inverse: [f64; 3],
    pub(super) corner: Vector3<f64>,
    pub(super) u: Vector3<f64>,
    pub(super) v: Vector3<f64>,
    pub(super) normal: Vector3<f64>,
    pub(super) size: [f32; 2],
}

impl<'a> Seen<'a> {
    /// `None` for a face that shows its back, or lies behind the camera or beside the picture.
    pub(super) fn new(
        face: &'a Face,
        camera: &Pinhole,
        camera_from_world: &Isometry<Camera, World>,
    ) -> Option<Self> {
        let corner = (*camera_from_world * face.corner).raw.coords;
        let edge_u = (*camera_from_world * face.edge_u).raw;
        let edge_v = (*camera_from_world * face.edge_v).raw;
        let normal = edge_u.cross(&edge_v).normalize();
        let distance = normal.dot(&corner);
        // A face without area has no normal.
        if distance.is_nan() || distance >= -1e-9 {
            return None;
        }
        let [left, right] = face.top.map(|share| corner + edge_u * share + edge_v);
        let corners = [corner, corner + edge_u, right, left];
        let in_front = clip_near(&corners)?;
        let outline = Outline::of(in_front.map(|p| {
            [
                camera.fx * p.x / p.z + camera.cx,
                camera.fy * p.y / p.z + camera.cy,
            ]
        }));
        if !outline.is_within(camera.width, camera.height) {
            return None;
        }
        let (x, y) = (
            normal.x / distance / camera.fx,
            normal.y / distance / camera.fy,
        );
        let offset = normal.z / distance - x * camera.cx - y * camera.cy;
        Some(Self {
            face,
            outline,
            inverse: [x, y, offset],
            corner,
            u: edge_u.normalize(),
            v: edge_v.normalize(),
            normal,
            size: [edge_u.norm() as f32, edge_v.norm() as f32],
        })
    }
}

/// The part of a convex polygon in front of the near plane (Sutherland and Hodgman, one plane).
pub(super) fn clip_near(corners: &[Vector3<f64>; 4]) -> Option<Polygon<Vector3<f64>>> {
    let mut inside = Polygon::default();
    for (i, &from) in corners.iter().enumerate() {
        let to = corners[(i + 1) % corners.len()];
        if from.z >= NEAR_M {
            inside.push(from);
        }
        if (from.z >= NEAR_M) != (to.z >= NEAR_M) {
            inside.push(from + (to - from) * ((NEAR_M - from.z) / (to.z - from.z)));
        }
    }
    (inside.len() >= 3).then_some(inside)
}

/// A ball around a face and the plane that it lies in: enough to tell that most faces are not seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bound {
    centre: Point3<f64>,
    radius_m: f64,
    normal: Vector3<f64>,
}

impl Bound {
    pub(super) fn of(face: &Face) -> Self {
        let corners = face.corners().map(|corner| corner.raw);
        let middle = corners
            .iter()
            .fold(Vector3::zeros(), |sum, corner| sum + corner.coords)
            / 4.0;
        let centre = Point3::from(middle);
        let to_corner = corners.map(|corner| (corner - centre).norm());
        Self {
            centre,
            radius_m: to_corner.into_iter().fold(0.0, f64::max),
            normal: face.edge_u.raw.cross(&face.edge_v.raw).normalize(),
        }
    }

    /// Around a face that moves straight from here to there. Which way it faces meanwhile is not known.
    pub(super) fn along_to(&self, other: &Self) -> Self {
        let half = (other.centre - self.centre) / 2.0;
        Self {
            centre: self.centre + half,
            radius_m: self.radius_m.max(other.radius_m) + half.norm(),
            normal: Vector3::zeros(),
        }
    }
}

/// How far other poses are from the one that a frustum is of.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sway {
    shift_m: f64,
    turn_rad: f64,
}

impl Sway {
    pub(super) fn around(
        pose: Isometry<World, Camera>,
        others: &[Isometry<World, Camera>],
    ) -> Self {
        others.iter().fold(Self::default(), |sway, other| {
            let shift = other.raw.translation.vector - pose.raw.translation.vector;
            let turn = other.raw.rotation.angle_to(&pose.raw.rotation);
            Self {
                shift_m: sway.shift_m.max(shift.norm()),
                turn_rad: sway.turn_rad.max(turn),
            }
        })
    }
}

/// All that a camera may see: five planes through it, or just in front of it.
pub(super) struct Frustum {
    eye: Point3<f64>,
    /// Inwards.
    planes: [Vector3<f64>; 5],
}

impl Frustum {
    pub(super) fn of(camera: &Pinhole, world_from_camera: Isometry<World, Camera>) -> Self {
        Self::of_rows(camera, world_from_camera, [0, camera.height])
    }

    /// What these rows may see, from the first to before the last.
    pub(super) fn of_rows(
        camera: &Pinhole,
        world_from_camera: Isometry<World, Camera>,
        [top, end]: [usize; 2],
    ) -> Self {
        let width = camera.width as f64;
        let planes = [
            [camera.fx, 0.0, camera.cx],
            [-camera.fx, 0.0, width - camera.cx],
            [0.0, camera.fy, camera.cy - top as f64],
            [0.0, -camera.fy, end as f64 - camera.cy],
            [0.0, 0.0, 1.0],
        ];
        let turn = world_from_camera.raw.rotation;
        Self {
            eye: world_from_camera.raw.translation.vector.into(),
            planes: planes.map(|plane| turn * Vector3::from(plane).normalize()),
        }
    }

    /// Whether anything of a face could be seen; `false` only if [`Seen::new`] would say so.
    pub(super) fn may_see(&self, bound: &Bound) -> bool {
        self.may_see_swaying(bound, Sway::default())
    }

    /// The same for any pose that is not farther away than that: seen from the camera, a place moves by no more than the
    /// camera does and by its distance times the angle.
    pub(super) fn may_see_swaying(&self, bound: &Bound, sway: Sway) -> bool {
        let to_centre = bound.centre - self.eye;
        if bound.normal.dot(&to_centre) >= DOUBT_M + sway.shift_m {
            return false;
        }
        let turned_m = if sway.turn_rad > 0.0 {
            sway.turn_rad * (to_centre.norm() + bound.radius_m + sway.shift_m)
        } else {
            0.0
        };
        let reach = bound.radius_m + DOUBT_M + sway.shift_m + turned_m;
        let mut planes = self.planes.iter();
        planes.all(|plane| plane.dot(&to_centre) > -reach)
    }
}
