//! The camera as the solvers see it: undistorted pixels, and a coarse grid of cells over the depth image.
//!
//! An *ideal* pixel is where a point would fall without lens distortion; features are undistorted once, so that the
//! solvers project with four multiplications. A *cell* stands for a square of raw pixels.

use maps::camera::Pinhole;
use nalgebra::{Isometry3, Matrix3, Vector3};

/// Nearest depth at which a projection is trusted, in metres.
pub(crate) const NEAREST_M: f64 = 0.05;
/// Cells across the image, about.
const CELLS_ACROSS: usize = 160;

pub(crate) struct Optics {
    pub(crate) camera: Pinhole,
    /// Raw pixels along the side of a cell.
    pub(crate) stride: usize,
    cells_per_pixel: f32,
    pub(crate) cells_across: usize,
    pub(crate) cells_down: usize,
    /// Of each cell: the ray `(X/Z, Y/Z)` of its central pixel.
    rays: Vec<[f32; 2]>,
    /// Ideal pixels of the image's corners, rounded outwards: `[left, top, right, bottom]`.
    bounds: [f64; 4],
    lens: Lens,
}

impl Optics {
    pub(crate) fn new(camera: Pinhole) -> Self {
        let stride = (camera.width / CELLS_ACROSS).max(1);
        let (cells_across, cells_down) = (camera.width / stride, camera.height / stride);
        let mut optics = Self {
            camera,
            stride,
            cells_per_pixel: (stride as f32).recip(),
            cells_across,
            cells_down,
            rays: Vec::with_capacity(cells_across * cells_down),
            bounds: [0.0; 4],
            lens: Lens::new(&camera, [0.0; 4], [0; 2]),
        };
        for cell in 0..cells_across * cells_down {
            let [u, v] = optics.cell_center(cell);
            let [x, y] = camera.undistort([u as f64, v as f64]);
            optics.rays.push([x as f32, y as f32]);
        }
        optics.bounds = optics.ideal_bounds();
        let used = [cells_across * stride, cells_down * stride];
        optics.lens = Lens::new(&camera, optics.bounds, used);
        optics
    }

    fn ideal_bounds(&self) -> [f64; 4] {
        let (right, bottom) = (
            self.camera.width as f64 - 1.0,
            self.camera.height as f64 - 1.0,
        );
        let mut bounds = [0.0, 0.0, right, bottom];
        for i in 0..=16 {
            let t = f64::from(i) / 16.0;
            let rim = [
                [0.0, t * bottom],
                [right, t * bottom],
                [t * right, 0.0],
                [t * right, bottom],
            ];
            for [u, v] in rim.map(|pixel| self.ideal(pixel)) {
                bounds = [
                    bounds[0].min(u),
                    bounds[1].min(v),
                    bounds[2].max(u),
                    bounds[3].max(v),
                ];
            }
        }
        bounds
    }

    pub(crate) fn cell_count(&self) -> usize {
        self.rays.len()
    }

    /// The raw pixel in the middle of a cell.
    pub(crate) fn cell_center(&self, cell: usize) -> [usize; 2] {
        let (column, row) = (cell % self.cells_across, cell / self.cells_across);
        [
            column * self.stride + self.stride / 2,
            row * self.stride + self.stride / 2,
        ]
    }

    /// The cell of a raw pixel inside the image.
    pub(crate) fn cell_at(&self, raw: [f32; 2]) -> usize {
        // Casts saturate.
        let [column, row] = raw.map(|c| (c * self.cells_per_pixel) as u32 as usize);
        row.min(self.cells_down - 1) * self.cells_across + column.min(self.cells_across - 1)
    }

    /// The point at `depth_m` in the middle of a cell.
    pub(crate) fn cell_point(&self, cell: usize, depth_m: f32) -> Vector3<f32> {
        let [x, y] = self.rays[cell];
        Vector3::new(x * depth_m, y * depth_m, depth_m)
    }

    pub(crate) fn ideal(&self, raw: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.camera.undistort(raw);
        [
            self.camera.fx * x + self.camera.cx,
            self.camera.fy * y + self.camera.cy,
        ]
    }

    /// The point at `depth_m` behind an ideal pixel.
    pub(crate) fn lift(&self, ideal: [f64; 2], depth_m: f64) -> Vector3<f64> {
        let c = &self.camera;
        Vector3::new(
            (ideal[0] - c.cx) / c.fx * depth_m,
            (ideal[1] - c.cy) / c.fy * depth_m,
            depth_m,
        )
    }

    /// The ideal pixel of a point in the camera, wherever it falls; `None` at or behind the camera.
    pub(crate) fn project(&self, p: &Vector3<f64>) -> Option<[f64; 2]> {
        (p.z > NEAREST_M).then(|| {
            let c = &self.camera;
            [c.fx * p.x / p.z + c.cx, c.fy * p.y / p.z + c.cy]
        })
    }

    /// The ideal pixel of a point in the camera, where it falls inside the image.
    pub(crate) fn see(&self, p: &Vector3<f64>) -> Option<[f64; 2]> {
        let [left, top, right, bottom] = self.bounds;
        self.project(p)
            .filter(|&[u, v]| u >= left && u <= right && v >= top && v <= bottom)
    }

    /// The cell in which a point in the camera falls.
    #[inline]
    pub(crate) fn cell_of(&self, p: &Vector3<f32>) -> Option<usize> {
        let [u, v] = self.lens.raw_pixel(p)?;
        let inside = u >= 0.0 && v >= 0.0 && u < self.lens.width && v < self.lens.height;
        inside.then(|| self.cell_at([u, v]))
    }
}

/// The camera in single precision: it is asked for every cell, by every witness, in every frame.
#[derive(Clone, Copy, Debug)]
struct Lens {
    focal: [f32; 2],
    center: [f32; 2],
    distortion: [f32; 5],
    bounds: [f32; 4],
    /// Raw pixels that belong to cells.
    width: f32,
    height: f32,
}

impl Lens {
    fn new(camera: &Pinhole, bounds: [f64; 4], [width, height]: [usize; 2]) -> Self {
        Self {
            focal: [camera.fx as f32, camera.fy as f32],
            center: [camera.cx as f32, camera.cy as f32],
            distortion: camera.distortion.map(|k| k as f32),
            bounds: bounds.map(|v| v as f32),
            width: width as f32,
            height: height as f32,
        }
    }

    /// The raw pixel of a point, counted from the corner of the first one.
    #[inline]
    fn raw_pixel(&self, p: &Vector3<f32>) -> Option<[f32; 2]> {
        if p.z.is_nan() || p.z <= NEAREST_M as f32 {
            return None;
        }
        let inverse = p.z.recip();
        let (x, y) = (p.x * inverse, p.y * inverse);
        let ([fx, fy], [cx, cy]) = (self.focal, self.center);
        // Far outside the image the distortion polynomial folds back into it: ask the ideal pixel first.
        let [left, top, right, bottom] = self.bounds;
        let (u, v) = (fx * x + cx, fy * y + cy);
        if !(u >= left && u <= right && v >= top && v <= bottom) {
            return None;
        }
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        Some([
            fx * (x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)) + cx + 0.5,
            fy * (y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y) + cy + 0.5,
        ])
    }
}

/// A rigid transform in single precision, for loops over cells.
pub(crate) struct Fast {
    rotation: Matrix3<f32>,
    translation: Vector3<f32>,
}

impl Fast {
    pub(crate) fn new(transform: &Isometry3<f64>) -> Self {
        Self {
            rotation: transform.rotation.to_rotation_matrix().matrix().cast(),
            translation: transform.translation.vector.cast(),
        }
    }

    pub(crate) fn apply(&self, p: &Vector3<f32>) -> Vector3<f32> {
        self.rotation * p + self.translation
    }
}
