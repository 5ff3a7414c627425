//! Whether the vehicle's rectangle is free, exactly, and how far it is from what hinders.
//!
//! A pose is judged in three steps, cheapest first: far enough by the distances of a few discs that cover the rectangle, too
//! near by discs inside it, else by the distance between the rectangle and every blocked square around it. Motions are judged by conservative
//! advancement: after a pose with room to spare, the next one to judge is as far as no corner can use up that room.

use std::borrow::Cow;
use std::f64::consts::FRAC_1_SQRT_2;

use super::motion::{Motion, Pose2};
use crate::traversability::{CellIndex, Traversability, Vehicle};

/// The rectangle of a vehicle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Footprint {
    half_length: f64,
    half_width: f64,
    center_ahead: f64,
    circumradius: f64,
    /// Discs along the rectangle: how many, the distance between their middles where they cover it, and their radius.
    discs: (u32, f64, f64),
    /// How far any point of the rectangle moves at most while the reference point drives a metre.
    sweep: f64,
}

impl Footprint {
    pub(crate) fn new(vehicle: &Vehicle) -> Self {
        let half_length = 0.5 * vehicle.length_m;
        let half_width = 0.5 * vehicle.width_m;
        let center_ahead = 0.5 * vehicle.wheelbase_m;
        let count = (1.8 * half_length / half_width).round().clamp(1.0, 8.0);
        let apart = 2.0 * half_length / count;
        let farthest = (half_length + center_ahead).hypot(half_width);
        Self {
            half_length,
            half_width,
            center_ahead,
            circumradius: half_length.hypot(half_width),
            discs: (count as u32, apart, half_width.hypot(0.5 * apart)),
            sweep: 1.0 + farthest / vehicle.min_turning_radius_m,
        }
    }

    /// Radius of the largest circle inside, around the centre.
    pub(crate) fn inradius(&self) -> f64 {
        self.half_length.min(self.half_width)
    }

    /// How far any point of the rectangle moves at most while the reference point drives a metre.
    pub(crate) fn sweep(&self) -> f64 {
        self.sweep
    }

    /// The rectangle's centre, (x, y).
    pub(crate) fn center(&self, pose: &Pose2) -> [f64; 2] {
        pose.ahead(self.center_ahead)
    }

    /// The middles of the discs that cover the rectangle, (x, y); with the sine and cosine of the heading.
    fn discs_at(
        &self,
        pose: &Pose2,
        (sin, cos): (f64, f64),
    ) -> impl Iterator<Item = [f64; 2]> + use<> {
        let ((count, apart, _), pose, first) = (self.discs, *pose, self.center_ahead);
        (0..count).map(move |i| {
            let ahead = first + (f64::from(i) - 0.5 * f64::from(count - 1)) * apart;
            [pose.x_m + ahead * cos, pose.y_m + ahead * sin]
        })
    }

    fn rectangle(&self, pose: &Pose2) -> Rectangle {
        self.rectangle_of(pose, pose.heading_rad.sin_cos())
    }

    /// The same with the sine and cosine of the heading.
    fn rectangle_of(&self, pose: &Pose2, (sin, cos): (f64, f64)) -> Rectangle {
        let ahead = self.center_ahead;
        Rectangle {
            center: [pose.x_m + ahead * cos, pose.y_m + ahead * sin],
            sin,
            cos,
            half_length: self.half_length,
            half_width: self.half_width,
        }
    }

    /// Whether the rectangle at `pose`, widened by `margin_m`, covers a point.
    pub(crate) fn covers(&self, pose: &Pose2, margin_m: f64, [x, y]: [f64; 2]) -> bool {
        let r = self.rectangle(pose);
        let (dx, dy) = (x - r.center[0], y - r.center[1]);
        (dx * r.cos + dy * r.sin).abs() <= r.half_length + margin_m
            && (dy * r.cos - dx * r.sin).abs() <= r.half_width + margin_m
    }
}

struct Rectangle {
    center: [f64; 2],
    sin: f64,
    cos: f64,
    half_length: f64,
    half_width: f64,
}

impl Rectangle {
    /// Half the extent along x and along y.
    fn half_extent(&self) -> [f64; 2] {
        let (sin, cos) = (self.sin.abs(), self.cos.abs());
        [
            self.half_length * cos + self.half_width * sin,
            self.half_length * sin + self.half_width * cos,
        ]
    }

    /// Distance to an upright square; 0 where they overlap. Not needed beyond `enough`: a larger one may come out as less,
    /// but never as less than `enough`.
    fn distance_to_square(&self, [x, y]: [f64; 2], half: f64, enough: f64) -> f64 {
        let (wx, wy) = (x - self.center[0], y - self.center[1]);
        let (ahead, left) = (wx * self.cos + wy * self.sin, wy * self.cos - wx * self.sin);
        let spread = half * (self.sin.abs() + self.cos.abs());
        let [ex, ey] = self.half_extent();
        // Separating axes: a gap along any of the four is a lower bound of the distance.
        let gap = (ahead.abs() - self.half_length - spread)
            .max(left.abs() - self.half_width - spread)
            .max(wx.abs() - ex - half)
            .max(wy.abs() - ey - half);
        if gap <= 0.0 {
            return 0.0;
        }
        if gap >= enough {
            return gap;
        }
        // Apart, the nearest points of two convex polygons include a corner of one of them.
        let mut nearest = f64::INFINITY;
        for (sx, sy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let (qx, qy) = (wx + sx * half, wy + sy * half);
            let (a, l) = (qx * self.cos + qy * self.sin, qy * self.cos - qx * self.sin);
            nearest = nearest.min(squares(
                outside(a, self.half_length),
                outside(l, self.half_width),
            ));
            let (a, l) = (sx * self.half_length, sy * self.half_width);
            let (cx, cy) = (a * self.cos - l * self.sin, a * self.sin + l * self.cos);
            nearest = nearest.min(squares(outside(cx - wx, half), outside(cy - wy, half)));
        }
        nearest.sqrt()
    }
}

fn squares(a: f64, b: f64) -> f64 {
    a * a + b * b
}

fn outside(at: f64, half: f64) -> f64 {
    (at.abs() - half).max(0.0)
}

/// One kind of cells to keep away from.
#[derive(Clone)]
struct Layer<'a> {
    /// Distance from every cell's middle to the nearest such cell; 0 in one.
    distances: Cow<'a, [f32]>,
    /// Whether everything outside the grid is one, too.
    outside: bool,
    margin_m: f64,
    /// The margin near the start, where the vehicle may already stand nearer: half of what there is, so that it can turn.
    start_margin_m: f64,
}

/// How near the vehicle may come to what.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Margins {
    /// To blocked cells.
    pub(crate) clearance_m: f64,
    /// Whether unknown ground may lie under the footprint.
    pub(crate) cross_unknown: bool,
}

/// Judges poses and motions on one grid from one start.
#[derive(Clone)]
pub(crate) struct Checker<'a> {
    grid: &'a Traversability,
    pub(crate) footprint: Footprint,
    blocked: Layer<'a>,
    untrusted: Option<Layer<'a>>,
    start: Pose2,
    start_radius_m: f64,
    step_m: f64,
}

/// What is known of a pose without looking at what is around it.
enum Guess {
    /// There is at least this much room beyond the margin.
    Free(f64),
    Taken,
    Open,
}

/// The margin near a start that has `near_m` of it.
fn near_start(near_m: f64, margin_m: f64) -> f64 {
    if near_m < margin_m {
        0.5 * near_m
    } else {
        margin_m
    }
}

/// Two places that the vehicle cannot tell apart.
const TOUCH_M: f64 = 1e-9;

impl<'a> Checker<'a> {
    /// The unknown cells under the vehicle at `start` count as drivable: it stands on them.
    pub(crate) fn new(
        grid: &'a Traversability,
        footprint: Footprint,
        start: Pose2,
        margins: Margins,
    ) -> Self {
        let step_m = 0.5 * grid.resolution_m();
        let pad_m = 0.5 * step_m * footprint.sweep;
        let margin_m = margins.clearance_m + pad_m;
        let rectangle = footprint.rectangle(&start);
        let near = nearest(grid, grid.to_blocked(), &rectangle, margin_m);
        let untrusted = (!margins.cross_unknown).then(|| {
            let distances = without_start(grid, &footprint, &start, pad_m);
            let near = nearest(grid, &distances, &rectangle, pad_m);
            Layer {
                distances,
                outside: true,
                margin_m: pad_m,
                start_margin_m: near_start(near, pad_m),
            }
        });
        Self {
            grid,
            footprint,
            blocked: Layer {
                distances: Cow::Borrowed(grid.to_blocked()),
                outside: false,
                margin_m,
                start_margin_m: near_start(near, margin_m),
            },
            untrusted,
            start,
            start_radius_m: 4.0 * footprint.circumradius,
            step_m,
        }
    }

    pub(crate) fn grid(&self) -> &'a Traversability {
        self.grid
    }

    /// Clearance required, with the pad for the steps between judged poses.
    pub(crate) fn margin_m(&self) -> f64 {
        self.blocked.margin_m
    }

    fn layers(&self) -> impl Iterator<Item = &Layer<'a>> {
        std::iter::once(&self.blocked).chain(&self.untrusted)
    }

    /// Whether the vehicle may stand at `pose`.
    pub(crate) fn is_free(&self, pose: &Pose2) -> bool {
        self.room_m(pose).is_some()
    }

    /// How far every point of the footprint can move at least before it is too near to anything; `None` if it is already.
    pub(crate) fn room_m(&self, pose: &Pose2) -> Option<f64> {
        let near_start = pose.distance_m(&self.start) <= self.start_radius_m;
        let turned = pose.heading_rad.sin_cos();
        let mut room = f64::INFINITY;
        let mut rectangle = None;
        for layer in self.layers() {
            let margin = if near_start {
                layer.start_margin_m
            } else {
                layer.margin_m
            };
            let spare = match self.by_discs(layer, (pose, turned), margin) {
                Guess::Free(spare) => spare,
                Guess::Taken => return None,
                Guess::Open => {
                    let rectangle =
                        rectangle.get_or_insert_with(|| self.footprint.rectangle_of(pose, turned));
                    if layer.outside && !self.contains(rectangle, margin) {
                        return None;
                    }
                    let enough = margin + self.step_m;
                    let distance = nearest(self.grid, &layer.distances, rectangle, enough);
                    if distance < margin - TOUCH_M || distance <= 0.0 {
                        return None;
                    }
                    distance - margin
                }
            };
            room = room.min(spare);
        }
        if near_start {
            // Farther on the margins are wider.
            room = room.min(self.start_radius_m - pose.distance_m(&self.start));
        }
        Some(room.max(0.0))
    }

    /// What the distances at the middles of discs tell.
    fn by_discs(
        &self,
        layer: &Layer<'a>,
        (pose, (sin, cos)): (&Pose2, (f64, f64)),
        margin_m: f64,
    ) -> Guess {
        let footprint = &self.footprint;
        let (count, apart, covering_m) = footprint.discs;
        // From the first to the last disc inside, which touch the ends.
        let inside = 2.0 * (footprint.half_length - footprint.inradius());
        let inside_apart = inside / f64::from(count.max(2) - 1);
        let mut spare = f64::INFINITY;
        for i in 0..count {
            let offset = f64::from(i) - 0.5 * f64::from(count - 1);
            let ahead = footprint.center_ahead + offset * apart;
            let (x, y) = (pose.x_m + ahead * cos, pose.y_m + ahead * sin);
            let [mut around, mut at_most] = self.grid.bounds_at(&layer.distances, x, y);
            if layer.outside {
                let edge = self.to_the_edge(x, y);
                (around, at_most) = (around.min(edge), at_most.min(edge));
            }
            spare = spare.min(around - covering_m - margin_m);
            // Inside, the disc is nearer to the middle by this.
            let moved = offset.abs() * (apart - inside_apart).abs();
            if at_most + moved < footprint.inradius() + margin_m - TOUCH_M {
                return Guess::Taken;
            }
        }
        if spare > 0.0 {
            Guess::Free(spare)
        } else {
            Guess::Open
        }
    }

    /// Distance to the edge of the grid, negative outside.
    fn to_the_edge(&self, x_m: f64, y_m: f64) -> f64 {
        let [west, south, east, north] = self.bounds();
        (x_m - west)
            .min(east - x_m)
            .min(y_m - south)
            .min(north - y_m)
    }

    fn bounds(&self) -> [f64; 4] {
        let ([west, south], (width, height)) = (self.grid.origin_m(), self.grid.size());
        let res = self.grid.resolution_m();
        [
            west,
            south,
            west + width as f64 * res,
            south + height as f64 * res,
        ]
    }

    fn contains(&self, rectangle: &Rectangle, margin_m: f64) -> bool {
        let [west, south, east, north] = self.bounds();
        let ([x, y], [ex, ey]) = (rectangle.center, rectangle.half_extent());
        let slack = margin_m - TOUCH_M;
        x - ex - slack >= west
            && x + ex + slack <= east
            && y - ey - slack >= south
            && y + ey + slack <= north
    }

    /// Whether the vehicle may drive `motion` from `from`. Between the judged poses no point of the footprint moves
    /// farther than the pad in the margins.
    pub(crate) fn is_free_along(&self, from: &Pose2, motion: &Motion) -> bool {
        self.room_m(from)
            .is_some_and(|room| self.is_free_beyond(from, motion, room))
    }

    /// The same where the room at `from` is already known.
    pub(crate) fn is_free_beyond(&self, from: &Pose2, motion: &Motion, room_m: f64) -> bool {
        let length = motion.length_m();
        // Where a motion is not free, its end mostly is not.
        if self.room_m(&motion.at(from, length)).is_none() {
            return false;
        }
        let (mut driven, mut room) = (0.0, room_m);
        loop {
            driven += self.step_m.max(room / self.footprint.sweep);
            if driven >= length {
                return true;
            }
            match self.room_m(&motion.at(from, driven)) {
                Some(left) => room = left,
                None => return false,
            }
        }
    }

    /// A lower bound of the distance from the footprint at `pose` to the nearest blocked cell, at once.
    pub(crate) fn clearance_at_least_m(&self, pose: &Pose2) -> f64 {
        let (sin, cos) = pose.heading_rad.sin_cos();
        let covering_m = self.footprint.discs.2;
        (self.footprint.discs_at(pose, (sin, cos)))
            .map(|[x, y]| self.grid.bounds_at(&self.blocked.distances, x, y)[0] - covering_m)
            .fold(f64::INFINITY, f64::min)
    }

    /// Distance from the footprint at `pose` to the nearest blocked cell, exactly up to `enough_m`.
    pub(crate) fn clearance_m(&self, pose: &Pose2, enough_m: f64) -> f64 {
        let [x, y] = self.footprint.center(pose);
        let around = self.grid.clearance_m(x, y);
        let bound = around - self.footprint.circumradius;
        if bound >= enough_m {
            return bound;
        }
        // The rectangle is no farther away than its middle, of which the lower bound is at most a diagonal too small.
        let reach = enough_m.min(around + 1.5 * self.grid.resolution_m());
        let rectangle = self.footprint.rectangle(pose);
        nearest(self.grid, self.grid.to_blocked(), &rectangle, reach)
    }

    /// The blocked cell nearest to the footprint at `pose`, with its distance; the first in the grid's order among equals.
    pub(crate) fn nearest_blocked(&self, pose: &Pose2) -> Option<(f64, CellIndex)> {
        let rectangle = self.footprint.rectangle(pose);
        let half = 0.5 * self.grid.resolution_m();
        (self.grid.cells().zip(self.grid.to_blocked()))
            .filter(|(_, distance)| **distance <= 0.0)
            .map(|((index, _), _)| {
                let center = self.grid.center_of(index);
                let distance = rectangle.distance_to_square(center, half, f64::INFINITY);
                (distance, index)
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Whether the footprint at `pose` lies on ground that may be driven over, whatever is near it.
    pub(crate) fn is_on_known_ground(&self, pose: &Pose2) -> bool {
        self.untrusted.as_ref().is_none_or(|layer| {
            let rectangle = self.footprint.rectangle(pose);
            self.contains(&rectangle, 0.0)
                && nearest(self.grid, &layer.distances, &rectangle, self.step_m) > 0.0
        })
    }

    /// Whether the largest disc around the footprint's middle may be in a cell, with half a cell's diagonal of benefit of
    /// the doubt: where it may not, no vehicle may.
    pub(crate) fn disc_may_be(&self, cell: CellIndex) -> bool {
        self.disc_fits(cell, FRAC_1_SQRT_2 * self.grid.resolution_m())
    }

    /// The same without the benefit of the doubt.
    pub(crate) fn disc_surely_fits(&self, cell: CellIndex) -> bool {
        self.disc_fits(cell, 0.0)
    }

    fn disc_fits(&self, cell: CellIndex, doubt: f64) -> bool {
        let radius = self.footprint.inradius() - doubt;
        // The start's surroundings are those of the reference point.
        let near_start = self.start_radius_m + self.footprint.center_ahead + doubt;
        let i = cell.y * self.grid.size().0 + cell.x;
        self.layers().all(|layer| {
            let distance = f64::from(layer.distances[i]);
            if distance <= 0.0 || distance < radius + layer.start_margin_m {
                return false;
            }
            distance >= radius + layer.margin_m || {
                let [x, y] = self.grid.center_of(cell);
                (x - self.start.x_m).hypot(y - self.start.y_m) <= near_start
            }
        })
    }
}

fn without_start<'a>(
    grid: &'a Traversability,
    footprint: &Footprint,
    start: &Pose2,
    pad_m: f64,
) -> Cow<'a, [f32]> {
    let rectangle = footprint.rectangle(start);
    if nearest(grid, grid.to_untrusted(), &rectangle, pad_m) > 0.0 {
        return Cow::Borrowed(grid.to_untrusted());
    }
    let reach = pad_m + grid.resolution_m();
    Cow::Owned(grid.to_untrusted_except(|middle| footprint.covers(start, reach, middle)))
}

/// Distance from a rectangle to the nearest cell whose distance is 0: at most `enough`, and exact
/// below it.
fn nearest(grid: &Traversability, distances: &[f32], rectangle: &Rectangle, enough: f64) -> f64 {
    let ([x, y], [ex, ey]) = (rectangle.center, rectangle.half_extent());
    let (width, _) = grid.size();
    let (Some(low), Some(high)) = (
        grid.nearest_index(x - ex - enough, y - ey - enough),
        grid.nearest_index(x + ex + enough, y + ey + enough),
    ) else {
        return enough;
    };
    let half = 0.5 * grid.resolution_m();
    let per_resolution = grid.resolution_m().recip();
    let mut found = enough;
    for row in low.y..=high.y {
        let mut column = low.x;
        while column <= high.x {
            let index = CellIndex { x: column, y: row };
            let distance = f64::from(distances[row * width + column]);
            if distance <= 0.0 {
                let center = grid.center_of(index);
                found = found.min(rectangle.distance_to_square(center, half, found));
                if found <= 0.0 {
                    return 0.0;
                }
                column += 1;
            } else {
                // No such cell begins within that distance.
                let free = (distance * per_resolution + 0.5) as usize;
                column = column.saturating_add(free.max(1));
            }
        }
    }
    found
}
