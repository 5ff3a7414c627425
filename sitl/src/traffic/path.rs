//! Ways on the ground, by the distance along them.
//!
//! A path is a chain of straight pieces and arcs (the arcs cut into short chords), so that what follows it can really
//! drive it. East, north in metres; headings counter-clockwise from east, as everywhere in the scene.
//!
//! ```text
//! t = r·tan(|θ|/2)      an arc of radius r that turns by θ leaves the corner t before it and ends t behind it
//! ```

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;

/// Points nearer to each other than this are one.
const SAME_M: f64 = 1e-3;
/// Corners are never sharper than this, so that a straight piece has one heading from end to end.
const SHARPEST_M: f64 = 0.1;
/// An arc is cut into chords that turn by no more than this.
const CHORD_RAD: f64 = 0.05;

/// A place on the ground and a direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose2 {
    /// East, in metres.
    pub x: f64,
    /// North, in metres.
    pub y: f64,
    /// Counter-clockwise from east, in `-π..=π`.
    pub heading_rad: f64,
}

impl Pose2 {
    /// The place so far to the left of it, negative to the right, in the scene.
    pub fn to_the_left(self, left_m: f64) -> [f64; 2] {
        let (sin, cos) = self.heading_rad.sin_cos();
        [self.x - sin * left_m, self.y + cos * left_m]
    }
}

/// A way on the ground. Open ones have two ends, closed ones come round to where they began.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    vertices: Vec<Vertex>,
    closed: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Vertex {
    at: Vector2<f64>,
    /// Not wrapped: it differs from its neighbours by what is turned between them.
    heading_rad: f64,
    along_m: f64,
}

impl Path {
    /// From the first point to the last, its corners rounded with this radius, or less where a side is too short for
    /// it. Repeated points and those that are not finite are left out; with fewer than two left, its length is zero.
    pub fn open(points: &[[f64; 2]], corner_radius_m: f64) -> Self {
        Self::rounded(&distinct(points), corner_radius_m, false)
    }

    /// Round all points and back to the first, as [`Path::open`]. Fewer than three distinct points enclose nothing and
    /// give an open path.
    pub fn closed(points: &[[f64; 2]], corner_radius_m: f64) -> Self {
        let mut corners = distinct(points);
        while corners.len() > 1 && (corners[corners.len() - 1] - corners[0]).norm() < SAME_M {
            corners.pop();
        }
        let closed = corners.len() >= 3;
        Self::rounded(&corners, corner_radius_m, closed)
    }

    fn rounded(corners: &[Vector2<f64>], corner_radius_m: f64, closed: bool) -> Self {
        let radius_m = if corner_radius_m.is_finite() {
            corner_radius_m.max(SHARPEST_M)
        } else {
            SHARPEST_M
        };
        let mut path = Self {
            vertices: Vec::new(),
            closed,
        };
        let count = corners.len();
        if count < 2 {
            for &at in corners {
                path.push(at, 0.0);
            }
            return path;
        }
        let side = |i: usize| corners[(i + 1) % count] - corners[i % count];
        let mut heading_rad = if closed {
            angle(side(count - 1))
        } else {
            angle(side(0))
        };
        if closed {
            for (i, &corner) in corners.iter().enumerate() {
                let sides = [side(i + count - 1), side(i)];
                heading_rad = path.push_corner(corner, sides, heading_rad, radius_m);
            }
            let first = path.vertices[0].at;
            path.push(first, heading_rad);
        } else {
            path.push(corners[0], heading_rad);
            for (i, &corner) in corners.iter().enumerate().take(count - 1).skip(1) {
                let sides = [side(i - 1), side(i)];
                heading_rad = path.push_corner(corner, sides, heading_rad, radius_m);
            }
            path.push(corners[count - 1], heading_rad);
        }
        path
    }

    fn push(&mut self, at: Vector2<f64>, heading_rad: f64) {
        let along_m = self
            .vertices
            .last()
            .map_or(0.0, |last| last.along_m + (at - last.at).norm());
        self.vertices.push(Vertex {
            at,
            heading_rad,
            along_m,
        });
    }

    /// Adds the arc round a corner between two sides, and returns the heading behind it.
    fn push_corner(
        &mut self,
        corner: Vector2<f64>,
        sides: [Vector2<f64>; 2],
        heading_rad: f64,
        radius_m: f64,
    ) -> f64 {
        let turn_rad = wrapped(angle(sides[1]) - angle(sides[0]));
        if turn_rad.abs() < 1e-9 {
            self.push(corner, heading_rad);
            return heading_rad;
        }
        let per_radius = (turn_rad.abs() / 2.0).tan();
        let cut_m = (radius_m * per_radius)
            .min(sides[0].norm() / 2.0)
            .min(sides[1].norm() / 2.0);
        let to_centre_m = cut_m / per_radius * turn_rad.signum();
        let start = corner - sides[0].normalize() * cut_m;
        let centre = start + left_of(heading_rad) * to_centre_m;
        let chords = (turn_rad.abs() / CHORD_RAD).ceil().max(1.0) as u32;
        for i in 0..=chords {
            let now_rad = heading_rad + turn_rad * f64::from(i) / f64::from(chords);
            self.push(centre - left_of(now_rad) * to_centre_m, now_rad);
        }
        heading_rad + turn_rad
    }

    /// Whether it comes round to where it began.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// From end to end, or once round.
    pub fn length_m(&self) -> f64 {
        self.vertices.last().map_or(0.0, |last| last.along_m)
    }

    /// The place `along_m` from its start. A closed path goes on round; an open one ends at its ends. A path without
    /// points is at the origin.
    pub fn at(&self, along_m: f64) -> Pose2 {
        let along_m = self.on_path(along_m);
        let Some((from, to)) = self.piece(along_m) else {
            return self.vertices.first().map_or_else(Pose2::default, pose);
        };
        let share = share(from, to, along_m);
        pose(&Vertex {
            at: from.at + (to.at - from.at) * share,
            heading_rad: from.heading_rad + (to.heading_rad - from.heading_rad) * share,
            along_m,
        })
    }

    /// As [`Path::at`], but an open path goes straight on beyond its ends.
    pub(super) fn at_or_beyond(&self, along_m: f64) -> Pose2 {
        let mut pose = self.at(along_m);
        let beyond_m = along_m - along_m.clamp(0.0, self.length_m());
        if !self.closed && beyond_m.is_finite() {
            pose.x += beyond_m * pose.heading_rad.cos();
            pose.y += beyond_m * pose.heading_rad.sin();
        }
        pose
    }

    /// How sharply it turns there, in 1/m, positive to the left.
    pub fn curvature_per_m(&self, along_m: f64) -> f64 {
        match self.piece(self.on_path(along_m)) {
            Some((from, to)) if to.along_m - from.along_m > 1e-9 => {
                (to.heading_rad - from.heading_rad) / (to.along_m - from.along_m)
            }
            _ => 0.0,
        }
    }

    /// The path that runs so far to the left of this one, negative to the right. Where an arc is tighter than that,
    /// what would run backwards is left out.
    #[must_use]
    pub fn shifted(&self, left_m: f64) -> Self {
        let left_m = if left_m.is_finite() { left_m } else { 0.0 };
        let mut path = Self {
            vertices: Vec::with_capacity(self.vertices.len()),
            closed: self.closed,
        };
        let last = self.vertices.len().saturating_sub(1);
        for (i, vertex) in self.vertices.iter().enumerate() {
            let at = vertex.at + left_of(vertex.heading_rad) * left_m;
            let forwards = path.vertices.last().is_none_or(|before| {
                let middle_rad = f64::midpoint(before.heading_rad, vertex.heading_rad);
                (at - before.at).dot(&direction(middle_rad)) > 0.0
            });
            if i == last && self.closed {
                let first = path.vertices.first().map_or(at, |first| first.at);
                path.push(first, vertex.heading_rad);
            } else if forwards {
                path.push(at, vertex.heading_rad);
            }
        }
        path
    }

    /// The place of the path that is nearest to a point: how far along it, and how far to its left the point is.
    pub fn nearest(&self, point: [f64; 2]) -> Nearest {
        let point = Vector2::from(point);
        let mut best = (f64::INFINITY, 0.0);
        for pair in self.vertices.windows(2) {
            let side = pair[1].at - pair[0].at;
            let share = if side.norm_squared() > 0.0 {
                ((point - pair[0].at).dot(&side) / side.norm_squared()).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let distance_m = (pair[0].at + side * share - point).norm();
            if distance_m < best.0 {
                best = (
                    distance_m,
                    pair[0].along_m + share * (pair[1].along_m - pair[0].along_m),
                );
            }
        }
        let there = self.at(best.1);
        let away = point - Vector2::new(there.x, there.y);
        Nearest {
            along_m: best.1,
            left_m: away.dot(&left_of(there.heading_rad)),
            distance_m: away.norm(),
        }
    }

    /// How much it turns between two distances, left and right added, in radians; sampled, so that a turn within a
    /// quarter of the span may be missed only if it is turned back there.
    pub(super) fn turning_rad(&self, from_m: f64, to_m: f64) -> f64 {
        let at = |i: u8| {
            self.at(from_m + (to_m - from_m) * f64::from(i) / 4.0)
                .heading_rad
        };
        (0..4).map(|i| wrapped(at(i + 1) - at(i)).abs()).sum()
    }

    fn on_path(&self, along_m: f64) -> f64 {
        let length_m = self.length_m();
        if !along_m.is_finite() || length_m <= 0.0 {
            0.0
        } else if self.closed {
            along_m.rem_euclid(length_m)
        } else {
            along_m.clamp(0.0, length_m)
        }
    }

    fn piece(&self, along_m: f64) -> Option<(&Vertex, &Vertex)> {
        let behind = self.vertices.partition_point(|v| v.along_m <= along_m);
        let to = behind.clamp(1, self.vertices.len().checked_sub(1).filter(|&n| n > 0)?);
        Some((&self.vertices[to - 1], &self.vertices[to]))
    }
}

/// Where a path is nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::struct_field_names, reason = "the unit is part of each name")]
pub struct Nearest {
    /// From the start of the path.
    pub along_m: f64,
    /// From the path to the point, across it, positive to the left.
    pub left_m: f64,
    /// From the path to the point.
    pub distance_m: f64,
}

/// An angle in `-π..=π`.
pub(super) fn wrapped(angle_rad: f64) -> f64 {
    let angle_rad = angle_rad.rem_euclid(TAU);
    if angle_rad > PI {
        angle_rad - TAU
    } else {
        angle_rad
    }
}

/// The unit vector in that direction.
pub(super) fn direction(heading_rad: f64) -> Vector2<f64> {
    let (sin, cos) = heading_rad.sin_cos();
    Vector2::new(cos, sin)
}

/// The unit vector to the left of that direction.
pub(super) fn left_of(heading_rad: f64) -> Vector2<f64> {
    let (sin, cos) = heading_rad.sin_cos();
    Vector2::new(-sin, cos)
}

/// The direction of a vector.
pub(super) fn angle(v: Vector2<f64>) -> f64 {
    v.y.atan2(v.x)
}

fn pose(vertex: &Vertex) -> Pose2 {
    Pose2 {
        x: vertex.at.x,
        y: vertex.at.y,
        heading_rad: wrapped(vertex.heading_rad),
    }
}

fn share(from: &Vertex, to: &Vertex, along_m: f64) -> f64 {
    let span_m = to.along_m - from.along_m;
    if span_m > 0.0 {
        (along_m - from.along_m) / span_m
    } else {
        0.0
    }
}

fn distinct(points: &[[f64; 2]]) -> Vec<Vector2<f64>> {
    let mut kept: Vec<Vector2<f64>> = Vec::with_capacity(points.len());
    for point in points {
        let point = Vector2::from(*point);
        let is_new = kept
            .last()
            .is_none_or(|&last| (point - last).norm() >= SAME_M);
        if point.x.is_finite() && point.y.is_finite() && is_new {
            kept.push(point);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    fn block() -> Path {
        Path::closed(&[[0.0, 0.0], [40.0, 0.0], [40.0, 30.0], [0.0, 30.0]], 6.0)
    }

    #[test]
    fn a_rounded_block_is_as_long_as_its_sides_and_arcs() {
        let expected = 2.0 * (28.0 + 18.0) + TAU * 6.0;
        // Chords of 0.05 rad are 1e-4 shorter than their arcs.
        assert!((block().length_m() - expected).abs() < 0.005);
    }

    #[test]
    fn heading_and_position_go_on_smoothly_round_a_closed_path() {
        for path in [block(), block().shifted(3.0), block().shifted(-3.0)] {
            let step_m = 0.1;
            let laps = (2.0 * path.length_m() / step_m) as u32;
            for i in 0..laps {
                let [a, b] = [i, i + 1].map(|i| path.at(f64::from(i) * step_m));
                let moved = Vector2::new(b.x - a.x, b.y - a.y);
                assert!((moved.norm() - step_m).abs() < 1e-3, "{a:?} {b:?}");
                let turned = wrapped(b.heading_rad - a.heading_rad);
                // The tightest arc has a radius of 3 m: 0.034 rad for 0.1 m.
                assert!(turned.abs() < 0.04, "{turned} rad");
                assert!(wrapped(angle(moved) - a.heading_rad).abs() < 0.06);
            }
        }
    }

    #[test]
    fn a_shifted_path_keeps_its_distance() {
        for left_m in [-4.0, -1.5, 2.0, 5.0] {
            let (path, shifted) = (block(), block().shifted(left_m));
            for i in 0..200 {
                let there = shifted.at(f64::from(i) * 0.6);
                let nearest = path.nearest([there.x, there.y]);
                assert!((nearest.left_m - left_m).abs() < 0.01, "{nearest:?}");
            }
        }
    }

    #[test]
    fn the_nearest_place_of_a_point_beside_the_path_is_where_it_came_from() {
        let path = block();
        for i in 0..100 {
            let along_m = f64::from(i) * 1.3;
            let nearest = path.nearest(path.at(along_m).to_the_left(1.2));
            assert!((nearest.along_m - along_m).abs() < 0.1, "{nearest:?}");
            assert!((nearest.left_m - 1.2).abs() < 0.01, "{nearest:?}");
        }
    }

    #[test]
    fn paths_of_few_or_repeated_points_stand_still() {
        for path in [
            Path::open(&[], 1.0),
            Path::closed(&[], 1.0),
            Path::open(&[[1.0, 2.0], [1.0, 2.0]], 1.0),
            Path::open(&[[f64::NAN, 0.0], [1.0, f64::INFINITY]], f64::NAN),
        ] {
            assert!(path.length_m().abs() < 1e-12);
            for along_m in [-1.0, 0.0, 5.0, f64::NAN, f64::INFINITY] {
                let pose = path.at(along_m);
                assert!(pose.x.is_finite() && pose.y.is_finite() && pose.heading_rad.abs() < 1e-12);
                assert!(path.curvature_per_m(along_m).abs() < 1e-12);
                assert!(path.nearest([3.0, 4.0]).along_m.abs() < 1e-12);
            }
            assert!(path.shifted(2.0).length_m().abs() < 1e-12);
        }
    }

    #[test]
    fn a_path_that_doubles_back_has_finite_poses() {
        let path = Path::closed(&[[0.0, 0.0], [10.0, 0.0], [0.0, 0.0], [0.0, 5.0]], 3.0);
        for i in 0..400 {
            let pose = path.at(f64::from(i) * 0.1);
            assert!(pose.x.is_finite() && pose.y.is_finite() && pose.heading_rad.is_finite());
        }
    }

    #[test]
    fn an_open_path_ends_at_its_ends_or_goes_straight_on() {
        let path = Path::open(&[[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]], 2.0);
        let end = path.at(1e3);
        assert!((end.x - 10.0).abs() < 1e-9 && (end.y - 10.0).abs() < 1e-9);
        assert!((end.heading_rad - FRAC_PI_2).abs() < 1e-9);
        let beyond = path.at_or_beyond(path.length_m() + 3.0);
        assert!((beyond.x - 10.0).abs() < 1e-9 && (beyond.y - 13.0).abs() < 1e-9);
    }
}
