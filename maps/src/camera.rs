//! The pinhole camera with lens distortion, and the colour and depth image it takes.
//!
//! ```text
//! u = fx·x' + cx    v = fy·y' + cy        (x', y') = distorted (X/Z, Y/Z)
//! x' = x(1 + k₁r² + k₂r⁴ + k₃r⁶) + 2p₁xy + p₂(r² + 2x²)
//! y' = y(1 + k₁r² + k₂r⁴ + k₃r⁶) + p₁(r² + 2y²) + 2p₂xy
//! ```
//!
//! - D. C. Brown, *Decentering distortion of lenses*, 1966; the coefficients are in `OpenCV`'s and ROS's order.

use crate::frame::{Camera, Point};
use crate::time::Stamp;

/// A pinhole camera with Brown's lens distortion. Pixel (0, 0) is the centre of the upper left pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Focal length along x, in pixels.
    pub fx: f64,
    /// Focal length along y, in pixels.
    pub fy: f64,
    /// Principal point, in pixels.
    pub cx: f64,
    /// Principal point, in pixels.
    pub cy: f64,
    /// `[k1, k2, p1, p2, k3]`, the order of ROS's `plumb_bob`; all zero for a camera without distortion.
    pub distortion: [f64; 5],
}

impl Pinhole {
    /// The pixel on which a point falls, with lens distortion; `None` behind the camera. It may lie outside the image.
    pub fn project(&self, p: Point<Camera>) -> Option<[f64; 2]> {
        let [x, y, z] = p.raw.coords.into();
        if z <= 0.0 || !z.is_finite() {
            return None;
        }
        let [x, y] = self.distort([x / z, y / z]);
        Some([self.fx * x + self.cx, self.fy * y + self.cy])
    }

    /// The point seen at `pixel` whose distance along the optical axis is `depth_m`.
    pub fn unproject(&self, pixel: [f64; 2], depth_m: f64) -> Point<Camera> {
        let [x, y] = self.undistort(pixel);
        Point::new(x * depth_m, y * depth_m, depth_m)
    }

    /// The normalised image coordinates `(X/Z, Y/Z)` seen at `pixel`, lens distortion removed.
    pub fn undistort(&self, pixel: [f64; 2]) -> [f64; 2] {
        let distorted = [
            (pixel[0] - self.cx) / self.fx,
            (pixel[1] - self.cy) / self.fy,
        ];
        let mut ideal = distorted;
        // Fixed-point iteration: a contraction for every lens whose distortion is small within the image.
        for _ in 0..10 {
            let again = self.distort(ideal);
            ideal = [
                ideal[0] + distorted[0] - again[0],
                ideal[1] + distorted[1] - again[1],
            ];
        }
        ideal
    }

    fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }
}

/// One colour image with the depth of each pixel, both taken at the same moment by the same camera, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdFrame {
    /// When the shutter was open.
    pub at: Stamp,
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Red, green and blue of each pixel; `width * height` of them.
    pub rgb: Vec<[u8; 3]>,
    /// Distance along the optical axis of each pixel in metres; 0 where the sensor saw nothing.
    pub depth_m: Vec<f32>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_and_its_depth_give_back_the_pixel() {
        let bonn = Pinhole {
            width: 640,
            height: 480,
            fx: 542.822_841,
            fy: 542.576_870,
            cx: 315.593_520,
            cy: 237.756_098,
            distortion: [0.039_903, -0.099_343, -0.000_730, -0.000_144, 0.0],
        };
        for pixel in [
            [0.0, 0.0],
            [639.0, 0.0],
            [0.0, 479.0],
            [639.0, 479.0],
            [315.0, 237.0],
        ] {
            let seen = bonn.unproject(pixel, 2.5);
            let [u, v] = bonn.project(seen).expect("in front of the camera");
            let error = (u - pixel[0]).hypot(v - pixel[1]);
            assert!(error < 1e-6, "{pixel:?} comes back {error} pixels off");
        }
    }

    #[test]
    fn a_point_behind_the_camera_has_no_pixel() {
        let camera = Pinhole {
            width: 4,
            height: 4,
            fx: 2.0,
            fy: 2.0,
            cx: 2.0,
            cy: 2.0,
            distortion: [0.0; 5],
        };
        assert_eq!(camera.project(Point::new(0.0, 0.0, -1.0)), None);
        assert_eq!(camera.project(Point::new(0.0, 0.0, 0.0)), None);
        assert_eq!(camera.project(Point::new(0.0, 0.0, f64::NAN)), None);
    }
}
