//! What a path is worth, judged from its waypoints, the grid and the vehicle alone: none of the planner's geometry is used.

use maps::plan::{Gear, Pose2};
use maps::traversability::{Cell, CellIndex, Traversability, Vehicle};

/// A pose and the gear in which it is reached.
pub(super) type Stop = (Pose2, Gear);

/// Distances beyond this are reported as this.
pub(super) const FAR_M: f64 = 3.0;
/// Rounding of a curvature that is just the limit.
const TOLERANCE: f64 = 1.005;

/// What was measured on one path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Verdict {
    /// Length of the polyline through the waypoints.
    pub(super) length_m: f64,
    /// Least distance from the footprint at a waypoint to anything blocked, at most [`FAR_M`]; 0 where it overlaps.
    pub(super) clearance_m: f64,
    /// Waypoints at which unknown ground is under the footprint's middle.
    pub(super) over_unknown: usize,
    /// Waypoints at which the path is tighter than the vehicle turns, changes of gear aside.
    pub(super) curvature_violations: usize,
}

/// Judges waypoints of poses of the rear axle.
pub(super) fn judge(grid: &Traversability, vehicle: &Vehicle, stops: &[Stop]) -> Verdict {
    let length_m = (stops.windows(2))
        .map(|pair| pair[0].0.distance_m(&pair[1].0))
        .sum();
    let mut verdict = Verdict {
        length_m,
        clearance_m: FAR_M,
        over_unknown: 0,
        curvature_violations: violations(stops, vehicle.min_turning_radius_m),
    };
    for (pose, _) in stops {
        let corners = corners(vehicle, pose);
        let blocked = |cell| cell == Cell::Blocked;
        verdict.clearance_m = nearest(grid, &corners, verdict.clearance_m, blocked);
        let middle: [f64; 2] = std::array::from_fn(|k| 0.5 * (corners[0][k] + corners[2][k]));
        verdict.over_unknown += usize::from(grid.cell(middle[0], middle[1]) == Cell::Unknown);
    }
    verdict
}

/// Whether the footprint at `pose` is `needed_m` away from everything that is not known to be drivable.
pub(super) fn stands_free(
    grid: &Traversability,
    vehicle: &Vehicle,
    pose: &Pose2,
    needed_m: f64,
) -> bool {
    let corners = corners(vehicle, pose);
    let hinders = |cell| !matches!(cell, Cell::Drivable { .. });
    let (low, high) = extent(&corners);
    let inside = |[x, y]: [f64; 2]| grid.index_of(x, y).is_some();
    inside(low.map(|c| c - needed_m))
        && inside(high.map(|c| c + needed_m))
        && nearest(grid, &corners, needed_m, hinders) >= needed_m
}

/// Waypoints where the circle through one, the one before and the one after has less than the radius. The curvature of
/// such a circle is never more than the largest of the curve between, so an arc at full lock passes.
fn violations(stops: &[Stop], radius_m: f64) -> usize {
    (stops.windows(3))
        .filter(|three| three[1].1 == three[2].1)
        .filter(|three| {
            let [a, b, c] = [0, 1, 2].map(|i| three[i].0);
            let (ab, bc, ac) = (a.distance_m(&b), b.distance_m(&c), a.distance_m(&c));
            let cross = (b.x_m - a.x_m) * (c.y_m - a.y_m) - (b.y_m - a.y_m) * (c.x_m - a.x_m);
            let doubles_back = ab * ab + bc * bc > ac * ac && ac < ab.max(bc);
            let curvature = 2.0 * cross.abs() / (ab * bc * ac).max(1e-12);
            ab.min(bc) > 1e-6 && (doubles_back || curvature * radius_m > TOLERANCE)
        })
        .count()
}

/// The corners of the footprint, counter-clockwise.
fn corners(vehicle: &Vehicle, pose: &Pose2) -> [[f64; 2]; 4] {
    let (sin, cos) = pose.heading_rad.sin_cos();
    let (front, rear) = (
        0.5 * (vehicle.length_m + vehicle.wheelbase_m),
        0.5 * (vehicle.wheelbase_m - vehicle.length_m),
    );
    let side = 0.5 * vehicle.width_m;
    [(front, -side), (front, side), (rear, side), (rear, -side)].map(|(ahead, left)| {
        [
            pose.x_m + ahead * cos - left * sin,
            pose.y_m + ahead * sin + left * cos,
        ]
    })
}

/// Distance from a rectangle to the nearest cell that hinders, `enough_m` at most.
fn nearest(
    grid: &Traversability,
    corners: &[[f64; 2]; 4],
    enough_m: f64,
    hinders: impl Fn(Cell) -> bool,
) -> f64 {
    let (low, high) = extent(corners);
    let ([x0, y0], (width, height)) = (grid.origin_m(), grid.size());
    let cell = grid.resolution_m();
    let index = |at: f64, origin: f64, count: usize| {
        ((at - origin) / cell)
            .floor()
            .clamp(0.0, count as f64 - 1.0) as usize
    };
    let mut least = enough_m;
    for y in index(low[1] - enough_m, y0, height)..=index(high[1] + enough_m, y0, height) {
        for x in index(low[0] - enough_m, x0, width)..=index(high[0] + enough_m, x0, width) {
            let at = CellIndex { x, y };
            if !hinders(grid.cell_at(at)) {
                continue;
            }
            let [cx, cy] = grid.center_of(at);
            let (l, r) = (cx - 0.5 * cell, cx + 0.5 * cell);
            let (b, t) = (cy - 0.5 * cell, cy + 0.5 * cell);
            let apart = (l - high[0])
                .max(low[0] - r)
                .max(b - high[1])
                .max(low[1] - t);
            if apart < least {
                least = least.min(between(corners, &[[l, b], [r, b], [r, t], [l, t]]));
            }
        }
    }
    least
}

fn extent(points: &[[f64; 2]]) -> ([f64; 2], [f64; 2]) {
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for point in points {
        for k in 0..2 {
            low[k] = low[k].min(point[k]);
            high[k] = high[k].max(point[k]);
        }
    }
    (low, high)
}

/// Distance between two convex polygons, their corners counter-clockwise; 0 where they overlap.
fn between(a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]) -> f64 {
    let holds = |polygon: &[[f64; 2]; 4], p: [f64; 2]| {
        (0..4).all(|i| {
            let ([ux, uy], [vx, vy]) = (polygon[i], polygon[(i + 1) % 4]);
            (vx - ux) * (p[1] - uy) - (vy - uy) * (p[0] - ux) >= 0.0
        })
    };
    if holds(a, b[0]) || holds(b, a[0]) {
        return 0.0;
    }
    let mut least = f64::INFINITY;
    for i in 0..4 {
        for j in 0..4 {
            let (s, t) = ([a[i], a[(i + 1) % 4]], [b[j], b[(j + 1) % 4]]);
            least = least.min(between_segments(s, t));
        }
    }
    least
}

fn between_segments(s: [[f64; 2]; 2], t: [[f64; 2]; 2]) -> f64 {
    let side = |[p, q]: [[f64; 2]; 2], r: [f64; 2]| {
        (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
    };
    if side(s, t[0]) * side(s, t[1]) < 0.0 && side(t, s[0]) * side(t, s[1]) < 0.0 {
        return 0.0;
    }
    [(s[0], t), (s[1], t), (t[0], s), (t[1], s)]
        .into_iter()
        .map(|(point, segment)| to_segment(point, segment))
        .fold(f64::INFINITY, f64::min)
}

fn to_segment(p: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let along = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy).max(1e-12);
    let along = along.clamp(0.0, 1.0);
    (p[0] - a[0] - along * dx).hypot(p[1] - a[1] - along * dy)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn square(x: f64, y: f64, edge: f64) -> [[f64; 2]; 4] {
        [[x, y], [x + edge, y], [x + edge, y + edge], [x, y + edge]]
    }

    #[test]
    fn polygons_are_as_far_apart_as_their_nearest_points() {
        let unit = square(0.0, 0.0, 1.0);
        assert!((between(&unit, &square(4.0, 5.0, 1.0)) - 5.0).abs() < 1e-12);
        assert!((between(&unit, &square(1.5, -3.0, 9.0)) - 0.5).abs() < 1e-12);
        assert!(between(&unit, &square(0.5, 0.5, 9.0)) < 1e-12);
        assert!(
            between(&unit, &square(0.2, 0.2, 0.1)) < 1e-12,
            "one in the other"
        );
        let cross = [[-5.0, 0.4], [5.0, 0.4], [5.0, 0.6], [-5.0, 0.6]];
        assert!(between(&unit, &cross) < 1e-12, "no corner in the other");
    }

    /// Waypoints around a circle, half a metre apart.
    fn circle(radius_m: f64) -> Vec<Stop> {
        (0..20)
            .map(|i| {
                let angle = f64::from(i) * 0.5 / radius_m;
                let (sin, cos) = angle.sin_cos();
                (
                    Pose2::new(radius_m * cos, radius_m * sin, angle + 0.5 * PI),
                    Gear::Forward,
                )
            })
            .collect()
    }

    #[test]
    fn a_circle_is_too_tight_if_its_radius_is_too_small() {
        assert_eq!(violations(&circle(3.0), 3.0), 0);
        assert_eq!(violations(&circle(2.9), 3.0), 18);
    }

    #[test]
    fn doubling_back_is_too_tight_unless_the_gear_changes() {
        let at = |x, gear| (Pose2::new(x, 0.0, 0.0), gear);
        let there = [at(0.0, Gear::Forward), at(1.0, Gear::Forward)];
        let forward = [there[0], there[1], at(0.3, Gear::Forward)];
        let reverse = [there[0], there[1], at(0.3, Gear::Reverse)];
        assert_eq!(violations(&forward, 3.0), 1);
        assert_eq!(violations(&reverse, 3.0), 0);
    }
}
