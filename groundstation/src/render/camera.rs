//! The operator's camera: it orbits, pans and zooms about the point under the cursor, and that point stays there.
//!
//! ```text
//! forward f = (cos h cos p, sin h cos p, -sin p)   right r = (sin h, -cos h, 0)   up u = r × f
//! view (x, y, z) = ((q - eye)·r, (q - eye)·u, (q - eye)·f)        t = tan(fov / 2), a = width / height
//! perspective  clip = (x / ta, y / t, near, z)                    depth = near / z: 1 near by, 0 at infinity
//! parallel     clip = (x / hta, y / ht, ½ - (z - h) / 2R, 1)      h = distance to the target
//! ```
//!
//! with heading `h` counter-clockwise from east and pitch `p` below the horizon, so that looking straight down is no
//! special case. Depth is reversed: a float has its precision at 0, where a perspective has none to spare.
//!
//! - N. Reed, *Depth Precision Visualized*, 2015, on reversed depth and the infinite far plane.

use std::f64::consts::{FRAC_PI_2, TAU};

use maps::frame::{Point, Vector, World};
use nalgebra::{Matrix4, Vector3};

/// Nothing nearer than this is drawn by a perspective lens.
pub(crate) const NEAR_M: f64 = 0.02;
/// A parallel lens draws what is at most this far before or behind its target.
const PARALLEL_DEPTH_M: f64 = 10_000.0;
/// How far the camera may be from its target.
const DISTANCE_M: std::ops::RangeInclusive<f64> = 0.1..=20_000.0;
/// The lens may tilt up to see a ceiling, but never over its head.
const PITCH_RAD: std::ops::RangeInclusive<f64> = -1.5..=FRAC_PI_2;
/// Below this pitch a plane on the ground is too oblique to be dragged.
const GRAZING_RAD: f64 = 0.12;

/// The size of a picture, in pixels or points; pixel (0, 0) is its upper left corner and y points down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewport {
    /// From left to right.
    pub width: f64,
    /// From top to bottom.
    pub height: f64,
}

impl Viewport {
    fn aspect(self) -> f64 {
        self.width.max(1.0) / self.height.max(1.0)
    }

    /// Pixels to `-1..=1`, y up.
    fn ndc_of(self, pixel: [f64; 2]) -> [f64; 2] {
        [
            2.0 * pixel[0] / self.width.max(1.0) - 1.0,
            1.0 - 2.0 * pixel[1] / self.height.max(1.0),
        ]
    }

    fn pixel_of(self, ndc: [f64; 2]) -> [f64; 2] {
        [
            0.5 * (ndc[0] + 1.0) * self.width.max(1.0),
            0.5 * (1.0 - ndc[1]) * self.height.max(1.0),
        ]
    }
}

/// A half line in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: Point<World>,
    /// Where it goes; of length 1.
    pub direction: Vector<World>,
}

impl Ray {
    /// The point `distance_m` along the ray.
    pub fn at(&self, distance_m: f64) -> Point<World> {
        self.origin + self.direction * distance_m
    }

    /// How far along the ray the horizontal plane `height_m` above the origin lies; `None` unless it lies ahead.
    pub fn distance_to_height_m(&self, height_m: f64) -> Option<f64> {
        let distance_m = (height_m - self.origin.raw.z) / self.direction.raw.z;
        (distance_m >= 0.0 && distance_m.is_finite()).then_some(distance_m)
    }
}

/// How the camera projects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lens {
    /// Far things are small.
    Perspective,
    /// All things have the same scale, as on a map.
    Parallel,
}

/// A camera that looks at a target from a distance. Invariant: finite, and within the limits of its methods.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera3 {
    target: Point<World>,
    heading_rad: f64,
    pitch_rad: f64,
    distance_m: f64,
    lens: Lens,
}

impl Default for Camera3 {
    /// From the south-west, 10 m from the origin, 35° down.
    fn default() -> Self {
        Self {
            target: Point::origin(),
            heading_rad: 60_f64.to_radians(),
            pitch_rad: 35_f64.to_radians(),
            distance_m: 10.0,
            lens: Lens::Perspective,
        }
    }
}

impl Camera3 {
    /// Half the vertical field of view, as a tangent: 45° in all.
    const TAN: f64 = 0.414_213_562_373_095;
    /// What is fitted has this much room.
    const MARGIN: f64 = 1.06;

    /// Looks at `target` from `distance_m` away, along `heading_rad` (counter-clockwise from east) and `pitch_rad`
    /// below the horizon. Out of range is clamped, not finite is replaced by the default's.
    pub fn looking_at(
        target: Point<World>,
        heading_rad: f64,
        pitch_rad: f64,
        distance_m: f64,
    ) -> Self {
        let or = |value: f64, otherwise: f64| {
            if value.is_finite() { value } else { otherwise }
        };
        let default = Self::default();
        Self {
            target: if target.is_finite() {
                target
            } else {
                default.target
            },
            heading_rad: or(heading_rad, default.heading_rad).rem_euclid(TAU),
            pitch_rad: or(pitch_rad, default.pitch_rad).clamp(*PITCH_RAD.start(), *PITCH_RAD.end()),
            distance_m: or(distance_m, default.distance_m)
                .clamp(*DISTANCE_M.start(), *DISTANCE_M.end()),
            lens: default.lens,
        }
    }

    /// The same view through another lens; the target keeps its scale.
    #[must_use]
    pub fn with_lens(self, lens: Lens) -> Self {
        Self { lens, ..self }
    }

    /// The same target seen from straight above with north up, through a parallel lens: a map.
    #[must_use]
    pub fn top_down(self) -> Self {
        Self {
            heading_rad: FRAC_PI_2,
            pitch_rad: FRAC_PI_2,
            lens: Lens::Parallel,
            ..self
        }
    }

    /// The same direction of view, at a distance from which the whole box is seen. Corners that are not finite change
    /// nothing.
    #[must_use]
    pub fn fitted(self, low: Point<World>, high: Point<World>, viewport: Viewport) -> Self {
        if !low.is_finite() || !high.is_finite() {
            return self;
        }
        let middle = Point::from_raw(nalgebra::center(&low.raw, &high.raw));
        let [right, up, forward] = self.axes();
        let mut distance_m = *DISTANCE_M.start();
        for corner in corners(low, high) {
            let from_middle = corner.raw - middle.raw;
            let across = (from_middle.dot(&right).abs() / viewport.aspect())
                .max(from_middle.dot(&up).abs())
                * Self::MARGIN
                / Self::TAN;
            let nearer = match self.lens {
                Lens::Perspective => -from_middle.dot(&forward),
                Lens::Parallel => 0.0,
            };
            distance_m = distance_m.max(across + nearer);
        }
        Self {
            target: middle,
            distance_m: distance_m.min(*DISTANCE_M.end()),
            ..self
        }
    }

    /// What the camera looks at.
    pub fn target(&self) -> Point<World> {
        self.target
    }

    /// Direction of view, counter-clockwise from east.
    pub fn heading_rad(&self) -> f64 {
        self.heading_rad
    }

    /// Direction of view, below the horizon.
    pub fn pitch_rad(&self) -> f64 {
        self.pitch_rad
    }

    /// From the eye to the target.
    pub fn distance_m(&self) -> f64 {
        self.distance_m
    }

    /// How the camera projects.
    pub fn lens(&self) -> Lens {
        self.lens
    }

    /// Where the camera is.
    pub fn eye(&self) -> Point<World> {
        let [_, _, forward] = self.axes();
        Point::from_raw(self.target.raw - forward * self.distance_m)
    }

    /// The size at which 1 m appears at `point`, in pixels.
    pub fn pixels_per_metre(&self, point: Point<World>, viewport: Viewport) -> f64 {
        let depth_m = match self.lens {
            Lens::Perspective => self.depth_m(point).max(NEAR_M),
            Lens::Parallel => self.distance_m,
        };
        0.5 * viewport.height / (Self::TAN * depth_m)
    }

    /// The pixel at which `point` is seen; `None` if it lies behind the lens. It may be outside the picture.
    pub fn project(&self, point: Point<World>, viewport: Viewport) -> Option<[f64; 2]> {
        let [right, up, forward] = self.axes();
        let from_eye = point.raw - self.eye().raw;
        let half_height_m = match self.lens {
            Lens::Perspective => {
                let depth_m = from_eye.dot(&forward);
                if depth_m.is_nan() || depth_m < NEAR_M {
                    return None;
                }
                depth_m * Self::TAN
            }
            Lens::Parallel => self.distance_m * Self::TAN,
        };
        Some(viewport.pixel_of([
            from_eye.dot(&right) / (half_height_m * viewport.aspect()),
            from_eye.dot(&up) / half_height_m,
        ]))
    }

    /// What is seen at `pixel`, nearest first.
    pub fn ray(&self, pixel: [f64; 2], viewport: Viewport) -> Ray {
        let [right, up, forward] = self.axes();
        let [x, y] = viewport.ndc_of(pixel);
        let aside = (right * (x * viewport.aspect()) + up * y) * Self::TAN;
        match self.lens {
            Lens::Perspective => Ray {
                origin: self.eye(),
                direction: Vector::from_raw((forward + aside).normalize()),
            },
            // It starts as far before the target as the lens draws.
            Lens::Parallel => Ray {
                origin: Point::from_raw(
                    self.target.raw + aside * self.distance_m - forward * PARALLEL_DEPTH_M,
                ),
                direction: Vector::from_raw(forward),
            },
        }
    }

    /// Turns about `pivot`, which stays at its pixel: to the left by `heading_rad`, down by `pitch_rad`.
    #[must_use]
    pub fn orbited(self, pivot: Point<World>, heading_rad: f64, pitch_rad: f64) -> Self {
        let from_pivot = self.in_view(self.eye().raw - pivot.raw);
        let turned = Self::looking_at(
            self.target,
            self.heading_rad + heading_rad,
            self.pitch_rad + pitch_rad,
            self.distance_m,
        )
        .with_lens(self.lens);
        let [right, up, forward] = turned.axes();
        let eye = pivot.raw + right * from_pivot.x + up * from_pivot.y + forward * from_pivot.z;
        turned.with_eye(Point::from_raw(eye))
    }

    /// Slides until `anchor` is seen at `pixel`: along the ground, or across the view where that is too oblique.
    #[must_use]
    pub fn panned(self, anchor: Point<World>, pixel: [f64; 2], viewport: Viewport) -> Self {
        let ray = self.ray(pixel, viewport);
        let [_, _, forward] = self.axes();
        let normal =
            if self.pitch_rad.abs() < GRAZING_RAD || ray.direction.raw.z.abs() < GRAZING_RAD {
                forward
            } else {
                Vector3::z()
            };
        let distance_m =
            (anchor.raw - ray.origin.raw).dot(&normal) / ray.direction.raw.dot(&normal);
        if !distance_m.is_finite() || distance_m < 0.0 {
            return self;
        }
        let slide = anchor - ray.at(distance_m);
        self.with_eye(self.eye() + slide)
    }

    /// Moves towards `anchor`, which stays at its pixel, until it is `factor` times as far away.
    #[must_use]
    pub fn zoomed(self, anchor: Point<World>, factor: f64) -> Self {
        let mut focused = self;
        let depth_m = self.depth_m(anchor);
        if self.lens == Lens::Perspective && DISTANCE_M.contains(&depth_m) {
            // The eye stays; only what the distance is measured to moves along the view.
            focused.target = Point::from_raw(self.eye().raw + self.axes()[2] * depth_m);
            focused.distance_m = depth_m;
        }
        let distance_m =
            (focused.distance_m * factor).clamp(*DISTANCE_M.start(), *DISTANCE_M.end());
        let factor = distance_m / focused.distance_m;
        let eye = anchor + (focused.eye() - anchor) * factor;
        if !eye.is_finite() {
            return self;
        }
        Self {
            distance_m,
            ..focused
        }
        .with_eye(eye)
    }

    /// Whether any of the box may be seen; a false yes is possible, a false no is not.
    pub(crate) fn may_see(
        &self,
        low: Point<World>,
        high: Point<World>,
        viewport: Viewport,
    ) -> bool {
        let clip_from_eye = self.clip_from_eye(viewport);
        let eye = self.eye();
        let seen = corners(low, high).map(|corner| {
            let from_eye = corner.raw - eye.raw;
            clip_from_eye * from_eye.push(1.0)
        });
        let beyond = |outside: fn(&nalgebra::Vector4<f64>) -> bool| seen.iter().all(outside);
        !(beyond(|c| c.x < -c.w)
            || beyond(|c| c.x > c.w)
            || beyond(|c| c.y < -c.w)
            || beyond(|c| c.y > c.w)
            || beyond(|c| c.z > c.w)
            || beyond(|c| c.z < 0.0))
    }

    /// Clip space, as wgpu has it, from the displacement from the eye in world axes.
    pub(crate) fn clip_from_eye(&self, viewport: Viewport) -> Matrix4<f64> {
        let [right, up, forward] = self.axes();
        let aspect = viewport.aspect();
        let row = |v: Vector3<f64>, last: f64| v.push(last).transpose();
        match self.lens {
            Lens::Perspective => Matrix4::from_rows(&[
                row(right / (Self::TAN * aspect), 0.0),
                row(up / Self::TAN, 0.0),
                row(Vector3::zeros(), NEAR_M),
                row(forward, 0.0),
            ]),
            Lens::Parallel => {
                let half_height_m = self.distance_m * Self::TAN;
                Matrix4::from_rows(&[
                    row(right / (half_height_m * aspect), 0.0),
                    row(up / half_height_m, 0.0),
                    row(
                        forward * (-0.5 / PARALLEL_DEPTH_M),
                        0.5 + 0.5 * self.distance_m / PARALLEL_DEPTH_M,
                    ),
                    row(Vector3::zeros(), 1.0),
                ])
            }
        }
    }

    /// What a parallel lens adds to the depth of something 1 m nearer; 0 for a perspective.
    pub(crate) fn parallel_depth_per_metre(&self) -> f64 {
        match self.lens {
            Lens::Perspective => 0.0,
            Lens::Parallel => 0.5 / PARALLEL_DEPTH_M,
        }
    }

    /// Distance of `point` along the direction of view.
    pub(crate) fn depth_m(&self, point: Point<World>) -> f64 {
        (point.raw - self.eye().raw).dot(&self.axes()[2])
    }

    /// Right, up and forward in the world.
    pub(crate) fn axes(&self) -> [Vector3<f64>; 3] {
        let (sin_h, cos_h) = self.heading_rad.sin_cos();
        let (sin_p, cos_p) = self.pitch_rad.sin_cos();
        [
            Vector3::new(sin_h, -cos_h, 0.0),
            Vector3::new(cos_h * sin_p, sin_h * sin_p, cos_p),
            Vector3::new(cos_h * cos_p, sin_h * cos_p, -sin_p),
        ]
    }

    fn in_view(&self, v: Vector3<f64>) -> Vector3<f64> {
        let [right, up, forward] = self.axes();
        Vector3::new(v.dot(&right), v.dot(&up), v.dot(&forward))
    }

    /// The same direction of view from another place.
    fn with_eye(self, eye: Point<World>) -> Self {
        let target = Point::from_raw(eye.raw + self.axes()[2] * self.distance_m);
        if target.is_finite() {
            Self { target, ..self }
        } else {
            self
        }
    }
}

/// The corners of a box.
fn corners(low: Point<World>, high: Point<World>) -> [Point<World>; 8] {
    std::array::from_fn(|i| {
        let pick = |axis: usize| {
            if i >> axis & 1 == 0 {
                low.raw[axis]
            } else {
                high.raw[axis]
            }
        };
        Point::new(pick(0), pick(1), pick(2))
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const VIEWPORT: Viewport = Viewport {
        width: 960.0,
        height: 640.0,
    };
    /// Rounding of pixels up to 1000 from metres up to 1000.
    const TOLERANCE_PX: f64 = 1e-5;

    fn any_camera() -> impl Strategy<Value = Camera3> {
        (
            prop::array::uniform3(-100.0..100.0),
            -4.0..4.0,
            -1.4..=FRAC_PI_2,
            0.5..200.0,
            any::<bool>(),
        )
            .prop_map(
                |([x, y, z], heading, pitch, distance, parallel): ([f64; 3], _, _, _, _)| {
                    let lens = if parallel {
                        Lens::Parallel
                    } else {
                        Lens::Perspective
                    };
                    Camera3::looking_at(Point::new(x, y, z), heading, pitch, distance)
                        .with_lens(lens)
                },
            )
    }

    fn any_pixel() -> impl Strategy<Value = [f64; 2]> {
        (0.0..VIEWPORT.width, 0.0..VIEWPORT.height).prop_map(|(x, y)| [x, y])
    }

    #[track_caller]
    fn check_is_at(camera: &Camera3, point: Point<World>, pixel: [f64; 2]) {
        let seen = camera
            .project(point, VIEWPORT)
            .expect("in front of the lens");
        let error = (seen[0] - pixel[0]).hypot(seen[1] - pixel[1]);
        assert!(
            error < TOLERANCE_PX,
            "{point:?} is at {seen:?}, not at {pixel:?}, of {camera:?}"
        );
    }

    /// A point that `camera` sees at `pixel`, `depth` times as far as its target.
    fn seen_at(camera: &Camera3, pixel: [f64; 2], depth: f64) -> Point<World> {
        let ray = camera.ray(pixel, VIEWPORT);
        let start = camera.depth_m(ray.origin);
        let per_metre = camera.axes()[2].dot(&ray.direction.raw);
        ray.at((depth * camera.distance_m() - start) / per_metre)
    }

    proptest! {
        #[test]
        fn what_lies_on_the_ray_of_a_pixel_is_seen_at_that_pixel(
            camera in any_camera(), pixel in any_pixel(), depth in 0.2..5.0
        ) {
            check_is_at(&camera, seen_at(&camera, pixel, depth), pixel);
        }

        #[test]
        fn zooming_keeps_the_anchor_under_the_cursor(
            camera in any_camera(), pixel in any_pixel(), depth in 0.3..3.0, factor in 0.5..2.0
        ) {
            let anchor = seen_at(&camera, pixel, depth);
            check_is_at(&camera.zoomed(anchor, factor), anchor, pixel);
        }

        #[test]
        fn orbiting_keeps_the_pivot_under_the_cursor(
            camera in any_camera(), pixel in any_pixel(), depth in 0.3..3.0, turn in -3.0..3.0, tilt in -1.0..1.0
        ) {
            let pivot = seen_at(&camera, pixel, depth);
            check_is_at(&camera.orbited(pivot, turn, tilt), pivot, pixel);
        }

        #[test]
        fn panning_brings_the_anchor_under_the_cursor_and_keeps_the_height_of_the_eye(
            camera in any_camera(), from in any_pixel(), to in any_pixel()
        ) {
            let anchor = seen_at(&camera, from, 1.0);
            let panned = camera.panned(anchor, to, VIEWPORT);
            if panned != camera {
                check_is_at(&panned, anchor, to);
            }
            if camera.pitch_rad() > 0.9 {
                prop_assert!((panned.eye().raw.z - camera.eye().raw.z).abs() < 1e-9);
            }
        }

        #[test]
        fn a_fitted_box_is_inside_the_picture(
            camera in any_camera(), low in prop::array::uniform3(-50.0..50.0), size in prop::array::uniform3(0.1..50.0)
        ) {
            let low = Point::new(low[0], low[1], low[2]);
            let high = low + Vector::new(size[0], size[1], size[2]);
            let fitted = camera.fitted(low, high, VIEWPORT);
            prop_assert!(fitted.may_see(low, high, VIEWPORT));
            for corner in corners(low, high) {
                let [x, y] = fitted.project(corner, VIEWPORT).expect("in front of the lens");
                prop_assert!((0.0..=VIEWPORT.width).contains(&x) && (0.0..=VIEWPORT.height).contains(&y));
            }
        }

        #[test]
        fn clip_space_agrees_with_pixels_and_nearer_is_deeper(
            camera in any_camera(), pixel in any_pixel(), depth in 0.2..5.0
        ) {
            let depth_of = |point: Point<World>| {
                let clip = camera.clip_from_eye(VIEWPORT) * (point.raw - camera.eye().raw).push(1.0);
                let seen = VIEWPORT.pixel_of([clip.x / clip.w, clip.y / clip.w]);
                assert!((seen[0] - pixel[0]).hypot(seen[1] - pixel[1]) < TOLERANCE_PX);
                clip.z / clip.w
            };
            let (near, far) = (depth_of(seen_at(&camera, pixel, depth)), depth_of(seen_at(&camera, pixel, 1.1 * depth)));
            prop_assert!(1.0 >= near && near > far && far >= 0.0, "{near} {far}");
        }
    }

    #[test]
    fn from_above_north_is_up_and_east_is_right() {
        let camera = Camera3::default().top_down();
        let middle = camera.project(Point::origin(), VIEWPORT).expect("seen");
        let north = camera
            .project(Point::new(0.0, 1.0, 0.0), VIEWPORT)
            .expect("seen");
        let east = camera
            .project(Point::new(1.0, 0.0, 0.0), VIEWPORT)
            .expect("seen");
        assert!((north[0] - middle[0]).abs() < 1e-6 && north[1] < middle[1] - 10.0);
        assert!((east[1] - middle[1]).abs() < 1e-6 && east[0] > middle[0] + 10.0);
    }

    #[test]
    fn what_is_behind_is_not_seen() {
        let camera = Camera3::looking_at(Point::origin(), 0.0, 0.0, 10.0);
        let behind = Point::new(-11.0, 0.0, 0.0);
        assert_eq!(camera.project(behind, VIEWPORT), None);
        assert_eq!(
            camera.project(Point::new(f64::NAN, 0.0, 0.0), VIEWPORT),
            None
        );
        assert!(!camera.may_see(behind, Point::new(-10.5, 1.0, 1.0), VIEWPORT));
        assert!(
            camera.may_see(behind, Point::new(1.0, 1.0, 1.0), VIEWPORT),
            "the eye is inside"
        );
    }

    #[test]
    fn nonsense_leaves_a_usable_camera() {
        let camera = Camera3::looking_at(Point::new(f64::NAN, 0.0, 0.0), f64::INFINITY, 9.0, -1.0);
        assert!(camera.eye().is_finite());
        let ray = camera.ray(
            [0.0, 0.0],
            Viewport {
                width: 0.0,
                height: 0.0,
            },
        );
        assert!(ray.origin.is_finite() && ray.direction.raw.iter().all(|c| c.is_finite()));
        let far = Point::new(f64::INFINITY, 0.0, 0.0);
        for moved in [
            camera.zoomed(far, 0.5),
            camera.panned(far, [1.0, 1.0], VIEWPORT),
            camera.orbited(far, 1.0, 1.0),
        ] {
            assert!(moved.eye().is_finite());
        }
    }
}
