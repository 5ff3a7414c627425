//! One view: cubes in parallel projection with a depth buffer, then darkened behind edges.

use super::Drawn;
use super::Picture;
use super::canvas::{Area, PAPER};
use super::faces::{Cube, Side, cubes};
use crate::voxel::{Voxel, VoxelKey};

/// Rays a pixel along each axis.
const OVERSAMPLING: usize = 2;
/// Share of the cubes that may lie outside, at each of the four edges.
const OUTSIDE: f64 = 0.002;
/// Room at each edge, as a share of what lies between; most of those outside are just there.
const MARGIN: f64 = 0.02;
/// How much of the light the darkest corner takes.
const CORNER: f64 = 0.45;
/// How much of the light a place deep behind an edge loses.
const EDGE: f64 = 0.55;
/// A step of so many voxels, and of so many samples, is a deep one.
const DEEP: f64 = 6.0;
const DEEP_SAMPLES: f64 = 10.0;
/// Where something is known to be free, from above.
const FREE: [u8; 3] = [228, 233, 238];

/// The sides that show from the south-south-west: top, south and west.
static FROM_ASIDE: [Side; 3] = [Side::new(2, 1), Side::new(1, -1), Side::new(0, -1)];

/// A direction of view, in voxels: two axes of the picture and one into it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projection {
    right: [f64; 3],
    down: [f64; 3],
    into: [f64; 3],
    sides: &'static [Side],
    lights: &'static [f64],
}

impl Projection {
    /// From above, north up.
    pub(super) const TOP: Self = Self {
        right: [1.0, 0.0, 0.0],
        down: [0.0, -1.0, 0.0],
        into: [0.0, 0.0, -1.0],
        sides: &[Side::new(2, 1)],
        lights: &[1.0],
    };

    /// From the south-south-west, 40° down.
    pub(super) fn oblique() -> Self {
        let (sin, cos) = 25.0_f64.to_radians().sin_cos();
        let (fall, level) = 40.0_f64.to_radians().sin_cos();
        Self {
            right: [cos, -sin, 0.0],
            down: [-sin * fall, -cos * fall, -level],
            into: [sin * level, cos * level, -fall],
            sides: &FROM_ASIDE,
            lights: &[1.0, 0.82, 0.66],
        }
    }

    /// Right, down and into the picture, in voxels.
    fn project(&self, p: [f64; 3]) -> [f64; 3] {
        [self.right, self.down, self.into].map(|axis| dot(axis, p))
    }
}

/// A view that has been framed: what is seen and where.
pub(super) struct View {
    projection: Projection,
    cubes: Vec<Cube>,
    /// The least and the greatest place along the picture, in voxels.
    low: [f64; 2],
    high: [f64; 2],
}

impl View {
    /// Frames all but the outermost; there must be something to see.
    pub(super) fn new(drawn: &Drawn<'_>, projection: Projection) -> Self {
        let cubes = cubes(drawn, projection.sides);
        let mut low = [0.0; 2];
        let mut high = [1.0; 2];
        for axis in 0..2 {
            let mut places: Vec<_> = cubes
                .iter()
                .map(|cube| projection.project(center(cube.key))[axis])
                .collect();
            let outside = (places.len() as f64 * OUTSIDE) as usize;
            let last = places.len().saturating_sub(1);
            if places.is_empty() {
                continue;
            }
            let least = *places.select_nth_unstable_by(outside, f64::total_cmp).1;
            let most = *places
                .select_nth_unstable_by(last - outside, f64::total_cmp)
                .1;
            let margin = 1.0 + MARGIN * (most - least);
            (low[axis], high[axis]) = (least - margin, most + margin);
        }
        Self {
            projection,
            cubes,
            low,
            high,
        }
    }

    /// Pixels a voxel takes if the view fills an area of this size.
    pub(super) fn scale(&self, width: usize, height: usize) -> f64 {
        let fit = |axis: usize, pixels: usize| pixels as f64 / (self.high[axis] - self.low[axis]);
        fit(0, width).min(fit(1, height))
    }

    /// Draws the view, and from above what is free, into an area.
    pub(super) fn draw(
        &self,
        drawn: &Drawn<'_>,
        area: Area,
        paint: impl Fn(VoxelKey, Voxel) -> [u8; 3],
        picture: &mut Picture,
    ) {
        let mut layer = Layer::new(self, area);
        if self.projection.sides.len() == 1 {
            layer.draw_free(drawn);
        }
        let faces = self.projection.sides.iter().zip(self.projection.lights);
        for (at, (side, light)) in faces.enumerate() {
            let stamp = Stamp::new(&layer, *side);
            for cube in &self.cubes {
                if let Some(corners) = cube.sides[at] {
                    let color = paint(cube.key, cube.voxel).map(|c| light * f64::from(c));
                    layer.draw_face(&stamp, cube.key, corners, color);
                }
            }
        }
        layer.put_into(area, picture);
    }
}

/// The samples of a view.
struct Layer {
    projection: Projection,
    width: usize,
    height: usize,
    /// Samples a voxel.
    scale: f64,
    /// What is at sample (0, 0), in voxels along the picture.
    corner: [f64; 2],
    /// In voxels; infinite where there is nothing.
    depth: Vec<f64>,
    color: Vec<[u8; 3]>,
}

/// What all faces of one side have in common, in samples: the way along them and back.
struct Stamp {
    corner: [f64; 3],
    steps: [[f64; 3]; 2],
    /// From samples to the share of each step.
    inverse: [[f64; 2]; 2],
    /// Half a sample in shares of each step: no face is so small that it falls between samples.
    slack: [f64; 2],
    /// How far it reaches.
    low: [f64; 2],
    high: [f64; 2],
}

impl Stamp {
    fn new(layer: &Layer, side: Side) -> Self {
        let project = |p: [i32; 3]| {
            let [x, y, z] = layer.projection.project(p.map(f64::from));
            [x * layer.scale, y * layer.scale, z]
        };
        let corner = project(side.corner());
        let steps = side.along().map(project);
        let [u, v] = steps;
        let area = u[0] * v[1] - u[1] * v[0];
        let inverse = [[v[1] / area, -v[0] / area], [-u[1] / area, u[0] / area]];
        let slack = inverse.map(|[a, b]| 0.5 * (a.abs() + b.abs()));
        let ends =
            |axis: usize| [0.0, u[axis], v[axis], u[axis] + v[axis]].map(|c| corner[axis] + c);
        let least = |axis| ends(axis).into_iter().fold(f64::INFINITY, f64::min) - 0.5;
        let most = |axis| ends(axis).into_iter().fold(f64::NEG_INFINITY, f64::max) + 0.5;
        Self {
            corner,
            steps,
            inverse,
            slack,
            low: [least(0), least(1)],
            high: [most(0), most(1)],
        }
    }
}

impl Layer {
    fn new(view: &View, area: Area) -> Self {
        let (width, height) = (area.width * OVERSAMPLING, area.height * OVERSAMPLING);
        let scale = view.scale(width, height);
        let middle = [0, 1].map(|axis| f64::midpoint(view.low[axis], view.high[axis]));
        let half = [width, height].map(|samples| samples as f64 / scale / 2.0);
        Self {
            projection: view.projection,
            width,
            height,
            scale,
            corner: [0, 1].map(|axis| middle[axis] - half[axis]),
            depth: vec![f64::INFINITY; width * height],
            color: vec![PAPER; width * height],
        }
    }

    /// The samples of a voxel's least corner, and its depth in voxels.
    fn place(&self, key: VoxelKey) -> [f64; 3] {
        let p = [key.x, key.y, key.z].map(f64::from);
        let [x, y, depth] = self.projection.project(p);
        [
            (x - self.corner[0]) * self.scale,
            (y - self.corner[1]) * self.scale,
            depth,
        ]
    }

    /// The samples from `low` to `high`, as far as there are any.
    fn range(low: f64, high: f64, samples: usize) -> std::ops::Range<usize> {
        let first = (low - 0.5).ceil().max(0.0) as usize; // negative and NaN give 0
        let end = ((high - 0.5).floor() + 1.0).max(0.0) as usize;
        first..end.min(samples)
    }

    fn draw_face(&mut self, stamp: &Stamp, key: VoxelKey, corners: [u8; 4], color: [f64; 3]) {
        let [x, y, depth] = self.place(key);
        let columns = Self::range(x + stamp.low[0], x + stamp.high[0], self.width);
        let [a, b, c, d] = corners.map(|dark| f64::from(dark) / 3.0);
        for row in Self::range(y + stamp.low[1], y + stamp.high[1], self.height) {
            let dy = row as f64 + 0.5 - y - stamp.corner[1];
            for column in columns.clone() {
                let dx = column as f64 + 0.5 - x - stamp.corner[0];
                let [s, t] = stamp
                    .inverse
                    .map(|[along, across]| along * dx + across * dy);
                let [reach_s, reach_t] = stamp.slack;
                if s < -reach_s || s > 1.0 + reach_s || t < -reach_t || t > 1.0 + reach_t {
                    continue;
                }
                let (s, t) = (s.clamp(0.0, 1.0), t.clamp(0.0, 1.0));
                let depth = depth + stamp.corner[2] + s * stamp.steps[0][2] + t * stamp.steps[1][2];
                let at = row * self.width + column;
                if depth >= self.depth[at] {
                    continue;
                }
                self.depth[at] = depth;
                let dark = (1.0 - t) * ((1.0 - s) * a + s * b) + t * ((1.0 - s) * c + s * d);
                self.color[at] = color.map(|c| (c * (1.0 - CORNER * dark)).round() as u8);
            }
        }
    }

    /// Tints where some voxel is free: what has been seen and is not there.
    fn draw_free(&mut self, drawn: &Drawn<'_>) {
        for (key, voxel) in drawn.map.known() {
            if key.z > drawn.top || voxel.log_odds.is_occupied() {
                continue;
            }
            // Towards the viewer's down, a voxel reaches up from its corner.
            let [x, y, _] = self.place(key);
            let columns = Self::range(x - 0.5, x + self.scale + 0.5, self.width);
            for row in Self::range(y - self.scale - 0.5, y + 0.5, self.height) {
                self.color[row * self.width + columns.start.min(self.width)..][..columns.len()]
                    .fill(FREE);
            }
        }
    }

    /// How much light is left here, after what stands out around has taken its part.
    fn light(&self, column: usize, row: usize) -> f64 {
        let here = self.depth[row * self.width + column];
        if here.is_infinite() {
            return 1.0;
        }
        let deep = DEEP.max(DEEP_SAMPLES / self.scale);
        let mut dark = 0.0;
        for (dx, dy) in [
            (-2, 0),
            (2, 0),
            (0, -2),
            (0, 2),
            (-1, -1),
            (1, -1),
            (-1, 1),
            (1, 1),
        ] {
            let (x, y) = (column.wrapping_add_signed(dx), row.wrapping_add_signed(dy));
            if x < self.width && y < self.height {
                let step = here - self.depth[y * self.width + x];
                dark += (step / deep).clamp(0.0, 1.0);
            }
        }
        1.0 - EDGE * dark / 8.0
    }

    /// Averages the samples of each pixel.
    fn put_into(&self, area: Area, picture: &mut Picture) {
        for y in 0..area.height {
            for x in 0..area.width {
                let mut sum = [0.0; 3];
                for i in 0..OVERSAMPLING * OVERSAMPLING {
                    let column = x * OVERSAMPLING + i % OVERSAMPLING;
                    let row = y * OVERSAMPLING + i / OVERSAMPLING;
                    let light = self.light(column, row);
                    for (sum, c) in sum.iter_mut().zip(self.color[row * self.width + column]) {
                        *sum += light * f64::from(c);
                    }
                }
                let samples = (OVERSAMPLING * OVERSAMPLING) as f64;
                let color = sum.map(|sum| (sum / samples).round() as u8);
                picture.put(area.left + x, area.top + y, color);
            }
        }
    }
}

fn center(key: VoxelKey) -> [f64; 3] {
    [key.x, key.y, key.z].map(|c| f64::from(c) + 0.5)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
