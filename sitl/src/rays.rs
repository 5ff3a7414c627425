//! What a straight line meets first: for `LiDAR`, rangefinders, radar, and truth along lines.
//!
//! A tree of boxes finds the few faces that a line can meet; where it meets one is then computed in double precision from
//! the face itself, so that ranges are as exact as pictures' depths.

use std::sync::Arc;
use std::time::Duration;

use glam::Vec3A;
use maps::time::Stamp;
use nalgebra::{Point3, Vector3};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};

use crate::scene::{Face, Scene};

/// Boxes are this much larger than what is in them, for single precision in the tree: 0.2 mm at 1 km.
const MARGIN_M: f32 = 0.001;

/// A scene to send rays through.
#[derive(Clone)]
pub struct Rays<'a> {
    scene: &'a Scene,
    still: Arc<Tree>,
}

impl std::fmt::Debug for Rays<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Rays").finish_non_exhaustive()
    }
}

impl<'a> Rays<'a> {
    /// Sorts all that stands still.
    pub fn new(scene: &'a Scene) -> Self {
        let still = Arc::new(Tree::new(scene.still(), BvhBuildParams::medium_build()));
        Self { scene, still }
    }

    /// What they go through.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// The scene at one moment.
    pub fn at(&self, at: Stamp) -> Snapshot {
        let moving = self.scene.moving(at);
        Snapshot {
            still: Arc::clone(&self.still),
            moving: Tree::new(&moving, BvhBuildParams::fastest_build()),
        }
    }
}

/// A scene at one moment.
pub struct Snapshot {
    still: Arc<Tree>,
    moving: Tree,
}

/// Where a ray ends.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// How far it went.
    pub range_m: f64,
    /// The cosine between it and the surface's normal.
    pub facing: f64,
    /// What it met.
    pub face: Face,
}

impl Snapshot {
    /// The first face that a ray meets from its front, up to a range. `direction` has unit length.
    pub fn cast(&self, from: Point3<f64>, direction: Vector3<f64>, range_m: f64) -> Option<Hit> {
        let still = self.still.cast(from, direction, range_m);
        let range_m = still.map_or(range_m, |hit| hit.range_m);
        self.moving.cast(from, direction, range_m).or(still)
    }
}

/// Faces by place.
struct Tree {
    planes: Vec<Plane>,
    tree: Option<Bvh2>,
}

/// A face with what the intersection needs.
struct Plane {
    face: Face,
    normal: Vector3<f64>,
    distance: f64,
    /// Coordinates on the face as shares of its edges.
    u: Vector3<f64>,
    v: Vector3<f64>,
}

impl Tree {
    fn new(faces: &[Face], params: BvhBuildParams) -> Self {
        let planes: Vec<Plane> = faces.iter().filter_map(Plane::new).collect();
        let boxes: Vec<Aabb> = planes.iter().map(|plane| around(&plane.face)).collect();
        // A tree of nothing cannot be asked.
        let tree =
            (!boxes.is_empty()).then(|| build_bvh2(&boxes, params, &mut Duration::default()));
        Self { planes, tree }
    }

    fn cast(&self, from: Point3<f64>, direction: Vector3<f64>, range_m: f64) -> Option<Hit> {
        let tree = self.tree.as_ref()?;
        let mut best: Option<(f64, usize)> = None;
        let ray = Ray::new(single(from.coords), single(direction), 0.0, range_m as f32);
        let mut nearest = RayHit::none();
        tree.ray_traverse(ray, &mut nearest, |_, index| {
            let plane = tree.primitive_indices[index] as usize;
            let limit = best.map_or(range_m, |(range_m, _)| range_m);
            match self.planes[plane].meet(from, direction) {
                Some(range_m) if range_m < limit => {
                    best = Some((range_m, plane));
                    range_m as f32
                }
                _ => f32::INFINITY,
            }
        });
        best.map(|(range_m, plane)| Hit {
            range_m,
            facing: -self.planes[plane].normal.dot(&direction),
            face: self.planes[plane].face,
        })
    }
}

impl Plane {
    /// `None` for a face without area.
    fn new(face: &Face) -> Option<Self> {
        let (u, v) = (face.edge_u.raw, face.edge_v.raw);
        let normal = u.cross(&v).try_normalize(1e-12)?;
        Some(Self {
            face: *face,
            normal,
            distance: normal.dot(&face.corner.raw.coords),
            u: u / u.norm_squared(),
            v: v / v.norm_squared(),
        })
    }

    /// How far a ray goes until it meets the face from its front.
    fn meet(&self, from: Point3<f64>, direction: Vector3<f64>) -> Option<f64> {
        let approach = self.normal.dot(&direction);
        if approach >= -1e-12 {
            return None;
        }
        let range_m = (self.distance - self.normal.dot(&from.coords)) / approach;
        if range_m <= 0.0 {
            return None;
        }
        let on_face = from + direction * range_m - self.face.corner.raw;
        let (u, v) = (on_face.dot(&self.u), on_face.dot(&self.v));
        let [left, right] = self.face.top;
        let within = (0.0..=1.0).contains(&v) && u >= left * v && u <= 1.0 + (right - 1.0) * v;
        within.then_some(range_m)
    }
}

fn around(face: &Face) -> Aabb {
    let corners = face.corners().map(|corner| single(corner.raw.coords));
    let (low, high) = corners.iter().fold(
        (Vec3A::INFINITY, Vec3A::NEG_INFINITY),
        |(low, high), corner| (low.min(*corner), high.max(*corner)),
    );
    let margin = Vec3A::splat(MARGIN_M);
    Aabb {
        min: low - margin,
        max: high + margin,
    }
}

fn single(v: Vector3<f64>) -> Vec3A {
    Vec3A::new(v.x as f32, v.y as f32, v.z as f32)
}

#[cfg(test)]
mod tests {
    use maps::frame::Isometry;
    use nalgebra::{Isometry3, UnitQuaternion};

    use super::*;
    use crate::depth_camera::d455;
    use crate::render::render;
    use crate::scene::Name;

    #[test]
    fn rays_through_pixels_meet_what_the_picture_shows_at_its_depth() {
        for name in [Name::ResidentialAlley, Name::UnderBridge] {
            let scene = Scene::generate(name, 1000);
            let at = Stamp::from_nanos(7_300_000_000);
            let turn = UnitQuaternion::from_euler_angles(-2.0, 0.0, -1.5);
            let pose = Isometry3::from_parts(Vector3::new(-8.0, -1.0, 6.0).into(), turn);
            let camera = d455();
            let picture = render(&scene, at, &camera, Isometry::claim(pose));
            let rays = Rays::new(&scene).at(at);
            let (mut met, mut differ) = (0, 0);
            for (i, instance) in picture.instance.iter().enumerate().step_by(97) {
                let pixel = [(i % camera.width) as f64, (i / camera.width) as f64];
                let ray = camera.unproject(pixel, 1.0).raw.coords;
                let hit = rays.cast(pose.translation.vector.into(), pose * ray.normalize(), 1e4);
                let depth_m = hit.map_or(0.0, |hit| hit.range_m / ray.norm());
                met += usize::from(hit.is_some());
                let is_same = hit.map_or(0, |hit| hit.face.instance.0) == instance.0;
                let error_m = (depth_m - f64::from(picture.depth_m[i])).abs();
                differ += usize::from(!is_same || error_m > 1e-5 * depth_m.max(1.0));
            }
            assert!(met > 2000, "{met} rays met something");
            // On an edge, a pixel and its ray may fall on different sides by a rounding error.
            assert!(
                differ <= 3,
                "{differ} of {met} rays differ from the picture"
            );
        }
    }

    #[test]
    fn a_ray_ends_at_its_range_and_passes_through_backs() {
        let scene = Scene::generate(Name::Room, 1);
        let rays = Rays::new(&scene).at(Stamp::ZERO);
        let down = -Vector3::z();
        let hit = rays.cast(Point3::new(1.3, 1.5, 1.5), down, 10.0);
        assert!(
            hit.is_some_and(|hit| (hit.range_m - 1.5).abs() < 1e-12 && hit.facing > 1.0 - 1e-12)
        );
        assert!(rays.cast(Point3::new(1.3, 1.5, 1.5), down, 1.4).is_none());
        // The walls show only their inner side.
        let hit = rays.cast(Point3::new(9.0, 2.4, 2.2), -Vector3::x(), 50.0);
        assert!(hit.is_some_and(|hit| hit.range_m > 7.0), "{hit:?}");
    }
}
