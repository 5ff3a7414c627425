//! From a scene's lines, vehicles and overlays to triangles and segments, for one view of it.
//!
//! Vehicles are drawn in their true size near by and never smaller than can be seen, so their triangles depend on the
//! camera. There are a few thousand at most; making them anew for each picture costs less than keeping them.

use std::f64::consts::TAU;

use bytemuck::{Pod, Zeroable};
use maps::frame::{Point, Vector, World};
use nalgebra::{Point3, Vector3};

use super::camera::{Camera3, Viewport};
use super::glyph::Glyph;
use super::grid;
use super::scene::{
    Freshness, GoalMarker, Marker, MarkerKind, Overlay, Polyline, Rgba, Scene, Stroke,
};

/// The corner of a triangle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct PlainVertex {
    position: [f32; 3],
    /// Of length 127; the fourth is 127 if the triangle is lit.
    normal: [i8; 4],
    color: Rgba,
}

/// One straight piece of a line.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct Segment {
    start: [f32; 3],
    end: [f32; 3],
    /// Metres from the beginning of the line to both ends, length of a dash or 0, width in pixels.
    along: [f32; 4],
    color: Rgba,
}

/// What is drawn beside the voxels.
#[derive(Default)]
pub(crate) struct Sketch {
    /// Triangles that hide what is behind them.
    pub(crate) solid: Vec<PlainVertex>,
    /// Triangles through which one sees.
    pub(crate) glass: Vec<PlainVertex>,
    pub(crate) segments: Vec<Segment>,
    /// How many of the segments, at the beginning, are part of the ground and do not show through what is on it.
    pub(crate) ground_segments: usize,
}

/// No vehicle is drawn smaller than this.
const SMALLEST_MARKER_PX: f64 = 34.0;
pub(crate) const WHITE: [u8; 3] = [245, 247, 250];
/// Of what stands for a circle.
pub(crate) const CORNERS: usize = 28;

impl Sketch {
    pub(crate) fn of(scene: &Scene, camera: &Camera3, viewport: Viewport) -> Self {
        let mut sketch = Self::default();
        if let Some(overlay) = &scene.overlay {
            sketch.overlay(overlay);
        }
        if scene.look.grid {
            grid::north_arrow(&mut sketch, camera);
        }
        sketch.ground_segments = sketch.segments.len();
        for line in &scene.lines {
            sketch.polyline(line);
        }
        if let Some(goal) = &scene.goal {
            sketch.goal(goal, 1.0 / camera.pixels_per_metre(goal.position, viewport));
        }
        for marker in &scene.markers {
            if marker.world_from_body.is_finite() {
                let place = marker.world_from_body.translation();
                sketch.marker(marker, 1.0 / camera.pixels_per_metre(place, viewport));
            }
        }
        sketch
    }

    pub(crate) fn polyline(&mut self, line: &Polyline) {
        let dash_m = match line.stroke {
            Stroke::Dashed { length_m } if length_m > 0.0 && length_m.is_finite() => {
                length_m as f32
            }
            Stroke::Solid | Stroke::Dashed { .. } => 0.0,
        };
        let mut along_m = 0.0;
        let mut points = line.points.iter().filter(|p| p.is_finite());
        let Some(mut start) = points.next() else {
            return;
        };
        for end in points {
            let end_along_m = along_m + (*end - *start).norm();
            self.segments.push(Segment {
                start: single(start.raw),
                end: single(end.raw),
                along: [along_m as f32, end_along_m as f32, dash_m, line.width_px],
                color: line.color,
            });
            (start, along_m) = (end, end_along_m);
        }
    }

    fn overlay(&mut self, overlay: &Overlay) {
        let half_m = 0.5 * overlay.cell_m;
        let mut cells = overlay
            .cells
            .iter()
            .filter(|cell| cell.center.is_finite())
            .peekable();
        while let Some(first) = cells.next() {
            let mut east = first.center.raw.x;
            while let Some(next) = cells.next_if(|next| {
                next.color == first.color
                    && next.center.raw.yz() == first.center.raw.yz()
                    && (next.center.raw.x - east - overlay.cell_m).abs() < 0.01 * overlay.cell_m
            }) {
                east = next.center.raw.x;
            }
            let Point3 { coords } = first.center.raw;
            let at = |x: f64, dy: f64| Point3::new(x, coords.y + dy, coords.z);
            let (west, east) = (coords.x - half_m, east + half_m);
            quad(
                &mut self.glass,
                [
                    at(west, -half_m),
                    at(east, -half_m),
                    at(east, half_m),
                    at(west, half_m),
                ],
                first.color,
                None,
            );
        }
    }

    fn marker(&mut self, marker: &Marker, metres_per_pixel: f64) {
        let length_m = if marker.length_m.is_finite() {
            marker.length_m
        } else {
            0.0
        };
        let glyph = Glyph {
            world_from_body: marker.world_from_body,
            size_m: length_m.max(SMALLEST_MARKER_PX * metres_per_pixel),
            color: marker.color,
        };
        let place = marker.world_from_body.translation();
        let ground = match marker.kind {
            MarkerKind::Copter => Point::new(place.raw.x, place.raw.y, 0.0),
            MarkerKind::Rover => place,
        };
        if marker.kind == MarkerKind::Copter {
            self.polyline(&Polyline {
                points: vec![place, ground],
                color: opaque(marker.color, 170),
                width_px: 1.5,
                stroke: Stroke::Dashed {
                    length_m: 4.0 * metres_per_pixel,
                },
            });
            self.disc(ground, 0.28 * glyph.size_m, opaque(marker.color, 90));
        }
        if marker.selected {
            self.ring(ground, 0.85 * glyph.size_m, opaque(WHITE, 230), 2.0);
        }
        match marker.freshness {
            Freshness::Fresh => match marker.kind {
                MarkerKind::Copter => glyph.copter(self),
                MarkerKind::Rover => glyph.rover(self),
            },
            Freshness::Stale { radius_m } => {
                match marker.kind {
                    MarkerKind::Copter => glyph.hollow_copter(self),
                    MarkerKind::Rover => glyph.hollow_rover(self),
                }
                if radius_m > 0.0 && radius_m.is_finite() {
                    self.ring(ground, radius_m, opaque(marker.color, 200), 1.5);
                    self.disc(ground, radius_m, opaque(marker.color, 26));
                }
            }
        }
    }

    fn goal(&mut self, goal: &GoalMarker, metres_per_pixel: f64) {
        if !goal.position.is_finite() {
            return;
        }
        let size_m = (26.0 * metres_per_pixel).max(0.12);
        let above = |height: f64| goal.position + Vector::new(0.0, 0.0, height * size_m);
        self.ring(goal.position, 0.55 * size_m, opaque(goal.color, 255), 2.5);
        self.disc(goal.position, 0.55 * size_m, opaque(goal.color, 70));
        self.line(&[goal.position, above(1.5)], opaque(WHITE, 255), 2.0);
        // A diamond on a pole.
        let (top, middle, foot) = (above(2.1), above(1.75), above(1.4));
        for quarter in 0..4 {
            let at = |i: i32| {
                let (sin, cos) = (f64::from(i) * 0.25 * TAU).sin_cos();
                middle.raw + Vector3::new(cos, sin, 0.0) * (0.26 * size_m)
            };
            let (a, b) = (at(quarter), at(quarter + 1));
            triangle(
                &mut self.solid,
                [a, b, top.raw],
                opaque(goal.color, 255),
                true,
            );
            triangle(
                &mut self.solid,
                [b, a, foot.raw],
                opaque(goal.color, 255),
                true,
            );
        }
        if let Some(heading_rad) = goal.heading_rad.filter(|h| h.is_finite()) {
            let ahead = |distance: f64, left: f64| {
                let (sin, cos) = heading_rad.sin_cos();
                goal.position
                    + Vector::new(
                        cos * distance - sin * left,
                        sin * distance + cos * left,
                        0.0,
                    ) * size_m
            };
            let color = opaque(goal.color, 255);
            self.line(&[ahead(0.55, 0.0), ahead(1.35, 0.0)], color, 2.5);
            self.line(
                &[ahead(1.05, 0.28), ahead(1.4, 0.0), ahead(1.05, -0.28)],
                color,
                2.5,
            );
        }
    }

    pub(crate) fn line(&mut self, points: &[Point<World>], color: Rgba, width_px: f32) {
        self.polyline(&Polyline {
            points: points.to_vec(),
            color,
            width_px,
            stroke: Stroke::Solid,
        });
    }

    pub(crate) fn ring(&mut self, center: Point<World>, radius_m: f64, color: Rgba, width_px: f32) {
        let points: Vec<_> = (0..=2 * CORNERS)
            .map(|i| on_circle(center, radius_m, i as f64 / (2 * CORNERS) as f64))
            .collect();
        self.line(&points, color, width_px);
    }

    fn disc(&mut self, center: Point<World>, radius_m: f64, color: Rgba) {
        for i in 0..CORNERS {
            let at = |i: usize| on_circle(center, radius_m, i as f64 / CORNERS as f64).raw;
            triangle(
                &mut self.glass,
                [center.raw, at(i), at(i + 1)],
                color,
                false,
            );
        }
    }
}

pub(crate) fn opaque([r, g, b]: [u8; 3], alpha: u8) -> Rgba {
    [r, g, b, alpha]
}

fn on_circle(center: Point<World>, radius_m: f64, share: f64) -> Point<World> {
    let (sin, cos) = (share * TAU).sin_cos();
    center + Vector::new(cos, sin, 0.0) * radius_m
}

pub(crate) fn quad(
    into: &mut Vec<PlainVertex>,
    corners: [Point3<f64>; 4],
    color: Rgba,
    normal: Option<Vector3<f64>>,
) {
    let vertices = corners.map(|corner| vertex(corner, color, normal));
    into.extend([0, 1, 2, 0, 2, 3].map(|i| vertices[i]));
}

pub(crate) fn triangle(
    into: &mut Vec<PlainVertex>,
    corners: [Point3<f64>; 3],
    color: Rgba,
    lit: bool,
) {
    let [a, b, c] = corners;
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0).filter(|_| lit);
    into.extend(corners.map(|corner| vertex(corner, color, normal)));
}

fn vertex(position: Point3<f64>, color: Rgba, normal: Option<Vector3<f64>>) -> PlainVertex {
    let normal = normal.map_or([0; 4], |n| {
        let [x, y, z] = [n.x, n.y, n.z].map(|c| (127.0 * c).round() as i8);
        [x, y, z, 127]
    });
    PlainVertex {
        position: single(position),
        normal,
        color,
    }
}

fn single(p: Point3<f64>) -> [f32; 3] {
    [p.x as f32, p.y as f32, p.z as f32]
}
