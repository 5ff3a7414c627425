//! From where the scene is looked at: an eye that turns about a target, or sits in a camera.
//!
//! ```text
//! forward f = (cos h cos p, sin h cos p, -sin p)   right r = (sin h, -cos h, 0)   up u = r × f
//! clip (x, y, z, w) = (q·r / ta, q·u / t, near, q·f)      q from the eye, t = tan(fov / 2), a = width / height
//! ```
//!
//! with heading `h` counter-clockwise from east and pitch `p` below the horizon. Depth is reversed: 1 nearby, 0 at infinity,
//! where a float has its precision.

use std::f64::consts::{FRAC_PI_2, TAU};

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use nalgebra::{Matrix4, Point3, Vector3};

/// Nothing nearer than this is drawn, in metres.
pub(crate) const NEAR_M: f64 = 0.05;
/// How far the eye may be from its target.
const DISTANCE_M: [f64; 2] = [0.5, 600.0];
const PITCH_RAD: [f64; 2] = [-0.2, FRAC_PI_2 - 1e-3];
/// Targets stay within this of the origin.
const REACH_M: f64 = 500.0;

/// An eye in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Eye {
    pub(crate) position: Point3<f64>,
    pub(crate) forward: Vector3<f64>,
    pub(crate) right: Vector3<f64>,
    pub(crate) up: Vector3<f64>,
    /// Half the vertical field of view, as a tangent.
    pub(crate) tan: f64,
}

impl Eye {
    /// In a camera, with all of its picture in view.
    pub(crate) fn of_camera(
        pose: Isometry<World, Camera>,
        lens: &Pinhole,
        [width, height]: [f64; 2],
    ) -> Self {
        let axis = |v: Vector3<f64>| pose.raw.rotation * v;
        let half = [
            lens.width as f64 / 2.0 / lens.fx,
            lens.height as f64 / 2.0 / lens.fy,
        ];
        Self {
            position: pose.translation().raw,
            forward: axis(Vector3::z()),
            right: axis(Vector3::x()),
            up: axis(-Vector3::y()),
            tan: half[1].max(half[0] * height.max(1.0) / width.max(1.0)),
        }
    }

    /// From the world to clip space, for a view of that size.
    pub(crate) fn clip_from_world(&self, [width, height]: [f64; 2]) -> Matrix4<f64> {
        let aspect = width.max(1.0) / height.max(1.0);
        let row = |axis: Vector3<f64>, scale: f64| {
            let axis = axis * scale;
            [axis.x, axis.y, axis.z, -axis.dot(&self.position.coords)]
        };
        let [a, b, d] = [
            row(self.right, 1.0 / (self.tan * aspect)),
            row(self.up, 1.0 / self.tan),
            row(self.forward, 1.0),
        ];
        Matrix4::from_fn(|i, j| match i {
            0 => a[j],
            1 => b[j],
            2 => [0.0, 0.0, 0.0, NEAR_M][j],
            _ => d[j],
        })
    }

    /// Where a place is in a view of that size, from its upper left corner; `None` behind the eye.
    pub(crate) fn pixel(&self, place: Point3<f64>, size: [f64; 2]) -> Option<[f64; 2]> {
        let clip = self.clip_from_world(size) * place.to_homogeneous();
        (clip.w > NEAR_M).then(|| {
            [
                (0.5 + 0.5 * clip.x / clip.w) * size[0],
                (0.5 - 0.5 * clip.y / clip.w) * size[1],
            ]
        })
    }
}

/// An eye that turns about a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Orbit {
    /// What it looks at, from whatever it follows.
    pub(crate) target: Point3<f64>,
    /// Against the heading of whatever it follows.
    pub(crate) heading_rad: f64,
    pub(crate) pitch_rad: f64,
    pub(crate) distance_m: f64,
}

impl Orbit {
    /// From behind and above, from that far away.
    pub(crate) fn behind(distance_m: f64) -> Self {
        Self {
            target: Point3::origin(),
            heading_rad: 0.0,
            pitch_rad: 0.45,
            distance_m,
        }
    }

    pub(crate) fn turn(&mut self, right_rad: f64, down_rad: f64) {
        self.heading_rad = (self.heading_rad + right_rad).rem_euclid(TAU);
        self.pitch_rad = (self.pitch_rad + down_rad).clamp(PITCH_RAD[0], PITCH_RAD[1]);
    }

    pub(crate) fn zoom(&mut self, factor: f64) {
        self.distance_m = (self.distance_m * factor).clamp(DISTANCE_M[0], DISTANCE_M[1]);
    }

    /// Moves the target over the ground: to the right and ahead as seen, in metres. `base_rad` is the heading of whatever is
    /// followed.
    pub(crate) fn shift(&mut self, right_m: f64, ahead_m: f64, base_rad: f64) {
        let (sin, cos) = (base_rad + self.heading_rad).sin_cos();
        let way = Vector3::new(cos, sin, 0.0) * ahead_m + Vector3::new(sin, -cos, 0.0) * right_m;
        let moved = (self.target + way).coords;
        self.target = moved.map(|c| c.clamp(-REACH_M, REACH_M)).into();
    }

    /// The eye, with what it follows at `base` with that heading.
    pub(crate) fn eye(&self, base: Point3<f64>, base_rad: f64) -> Eye {
        let (sin_h, cos_h) = (base_rad + self.heading_rad).sin_cos();
        let (sin_p, cos_p) = self.pitch_rad.sin_cos();
        let forward = Vector3::new(cos_h * cos_p, sin_h * cos_p, -sin_p);
        let right = Vector3::new(sin_h, -cos_h, 0.0);
        let mut position = base + self.target.coords - forward * self.distance_m;
        // Never below the ground: it is seen from above only.
        position.z = position.z.max(0.3);
        Eye {
            position,
            forward,
            right,
            up: right.cross(&forward),
            tan: 0.45,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [f64; 2] = [800.0, 600.0];

    #[track_caller]
    fn check_pixel(eye: &Eye, place: [f64; 3], expected: [f64; 2]) {
        let pixel = eye.pixel(Point3::from(place), SIZE).expect("in view");
        let off = (0..2).map(|i| (pixel[i] - expected[i]).abs()).sum::<f64>();
        assert!(off < 1e-6, "{place:?} is at {pixel:?}, not {expected:?}");
    }

    #[test]
    fn the_target_is_in_the_middle_up_is_up_and_right_is_right() {
        let orbit = Orbit::behind(10.0);
        let eye = orbit.eye(Point3::new(5.0, 2.0, 1.0), 0.7);
        check_pixel(&eye, [5.0, 2.0, 1.0], [400.0, 300.0]);
        let above = eye.pixel(Point3::new(5.0, 2.0, 2.0), SIZE).expect("seen");
        assert!(
            (above[0] - 400.0).abs() < 1e-6 && above[1] < 299.0,
            "{above:?}"
        );
        let to_the_right = Point3::new(5.0 + 0.7_f64.sin(), 2.0 - 0.7_f64.cos(), 1.0);
        let right = eye.pixel(to_the_right, SIZE).expect("seen");
        assert!(right[0] > 401.0, "{right:?}");
        assert_eq!(eye.pixel(eye.position - eye.forward, SIZE), None);
    }

    #[test]
    fn an_eye_in_a_camera_sees_its_picture_where_the_camera_does() {
        let lens = sitl::depth_camera::d455();
        let pose = sitl::flight::world_from_camera(maps::time::Stamp::ZERO, 1);
        let eye = Eye::of_camera(pose, &lens, [640.0, 480.0]);
        for pixel in [[0.0, 0.0], [639.0, 479.0], [100.0, 400.0]] {
            let place = pose * lens.unproject(pixel, 3.0);
            let seen = eye.pixel(place.raw, [640.0, 480.0]).expect("in view");
            // The middle of a camera's first pixel is 0, that of a view's is a half.
            let off = (0..2).map(|i| (seen[i] - 0.5 - pixel[i]).abs());
            assert!(off.sum::<f64>() < 1e-6, "{seen:?} {pixel:?}");
        }
    }

    #[test]
    fn dragging_keeps_within_bounds() {
        let mut orbit = Orbit::behind(10.0);
        orbit.turn(9.0, 9.0);
        orbit.zoom(1e9);
        orbit.shift(1e9, -1e9, 0.0);
        let eye = orbit.eye(Point3::origin(), 0.0);
        assert!(eye.position.coords.norm() < 2000.0 && eye.position.z > 0.0);
        assert!(eye.clip_from_world(SIZE).iter().all(|c| c.is_finite()));
        orbit.turn(0.0, -9.0);
        assert!(orbit.eye(Point3::origin(), 0.0).position.z > 0.0);
    }
}
