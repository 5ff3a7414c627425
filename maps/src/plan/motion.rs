//! Poses in the plane and the arcs between them.
//!
//! A vehicle that drives `s` metres (negative in reverse) along curvature `κ` moves, in its own frame, by
//!
//! ```text
//! Δθ = κ·s    Δx = sin(Δθ)/κ    Δy = (1 - cos(Δθ))/κ        (κ → 0: Δx = s, Δy = 0)
//! ```

use std::f64::consts::{PI, TAU};

/// A pose in the world's horizontal plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose2 {
    /// East.
    pub x_m: f64,
    /// North.
    pub y_m: f64,
    /// Where the front points, counter-clockwise from east.
    pub heading_rad: f64,
}

impl Pose2 {
    /// The pose at these coordinates.
    pub const fn new(x_m: f64, y_m: f64, heading_rad: f64) -> Self {
        Self {
            x_m,
            y_m,
            heading_rad,
        }
    }

    /// Whether no coordinate is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite() && self.heading_rad.is_finite()
    }

    /// Distance in the plane, whatever the headings.
    pub fn distance_m(&self, other: &Self) -> f64 {
        let (x, y) = (self.x_m - other.x_m, self.y_m - other.y_m);
        // Faster than `hypot`, which also serves lengths that no map has.
        (x * x + y * y).sqrt()
    }

    /// The point `ahead_m` before this one, (x, y).
    pub(crate) fn ahead(&self, ahead_m: f64) -> [f64; 2] {
        let (sin, cos) = self.heading_rad.sin_cos();
        [self.x_m + ahead_m * cos, self.y_m + ahead_m * sin]
    }

    /// The coordinates of `other` seen from here: ahead, to the left, heading.
    pub(crate) fn local(&self, other: &Self) -> [f64; 3] {
        let (sin, cos) = self.heading_rad.sin_cos();
        let (dx, dy) = (other.x_m - self.x_m, other.y_m - self.y_m);
        let turn = wrapped(other.heading_rad - self.heading_rad);
        [dx * cos + dy * sin, dy * cos - dx * sin, turn]
    }
}

/// An angle in (-π, π].
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    if -PI < angle_rad && angle_rad <= PI {
        return angle_rad; // most are
    }
    let turned = angle_rad.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

/// The direction in which a vehicle drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Gear {
    /// Front first.
    Forward,
    /// Rear first.
    Reverse,
}

/// A drive along one circle or straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Motion {
    /// 1/m, positive to the left.
    pub(crate) curvature: f64,
    /// Negative in reverse.
    pub(crate) signed_m: f64,
}

impl Motion {
    pub(crate) fn length_m(&self) -> f64 {
        self.signed_m.abs()
    }

    pub(crate) fn gear(&self) -> Gear {
        if self.signed_m < 0.0 {
            Gear::Reverse
        } else {
            Gear::Forward
        }
    }

    /// Where it ends if it begins at `from`.
    pub(crate) fn end(&self, from: &Pose2) -> Pose2 {
        self.at(from, self.length_m())
    }

    /// Where it has come to after `driven_m`.
    pub(crate) fn at(&self, from: &Pose2, driven_m: f64) -> Pose2 {
        let signed = driven_m.copysign(self.signed_m);
        let turn = self.curvature * signed;
        // Below this the series is exact to double precision.
        let (ahead, left) = if turn.abs() < 1e-6 {
            (signed, 0.5 * turn * signed)
        } else {
            (
                turn.sin() / self.curvature,
                (1.0 - turn.cos()) / self.curvature,
            )
        };
        let (sin, cos) = from.heading_rad.sin_cos();
        Pose2 {
            x_m: from.x_m + ahead * cos - left * sin,
            y_m: from.y_m + ahead * sin + left * cos,
            heading_rad: wrapped(from.heading_rad + turn),
        }
    }

    /// The part that is left after `driven_m`.
    pub(crate) fn after(&self, driven_m: f64) -> Self {
        Self {
            curvature: self.curvature,
            signed_m: (self.length_m() - driven_m).copysign(self.signed_m),
        }
    }

    /// The part up to `driven_m`.
    pub(crate) fn until(&self, driven_m: f64) -> Self {
        Self {
            curvature: self.curvature,
            signed_m: driven_m.copysign(self.signed_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_quarter_turn_to_the_left_ends_a_radius_ahead_and_a_radius_left() {
        let quarter = Motion {
            curvature: 0.5,
            signed_m: PI,
        };
        let end = quarter.end(&Pose2::new(1.0, 1.0, FRAC_PI_2));
        assert!(end.distance_m(&Pose2::new(-1.0, 3.0, 0.0)) < 1e-12);
        assert!((end.heading_rad - PI).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn a_motion_driven_back_ends_where_it_began(
            curvature in -3.0..3.0, signed_m in -5.0..5.0, heading_rad in -PI..PI
        ) {
            let start = Pose2::new(3.0, -2.0, heading_rad);
            let there = Motion { curvature, signed_m }.end(&start);
            let back = Motion { curvature, signed_m: -signed_m }.end(&there);
            prop_assert!(back.distance_m(&start) < 1e-9);
            prop_assert!(wrapped(back.heading_rad - start.heading_rad).abs() < 1e-9);
        }

        #[test]
        fn two_parts_of_a_motion_are_the_whole(
            curvature in -3.0..3.0, signed_m in -5.0..5.0, share in 0.0..1.0
        ) {
            let start = Pose2::new(3.0, -2.0, 0.7);
            let whole = Motion { curvature, signed_m };
            let cut = share * whole.length_m();
            let parts = whole.after(cut).end(&whole.until(cut).end(&start));
            prop_assert!(parts.distance_m(&whole.end(&start)) < 1e-9);
        }
    }
}
