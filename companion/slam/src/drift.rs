//! How far the map itself may be off, so that a pose can say honestly how far it is off in all.
//!
//! A pose fitted to known points is as uncertain as the fit, as the errors that all points of a picture share, and as the
//! points. Many points average the noise of each, never what they share: what calibration left of the lens, and when,
//! while rows were read out, the picture was taken. Points are as uncertain as the keyframe
//! that added them, and that as the points it was fitted to:
//!
//! ```text
//! σ²(pose) = σ²(fit) + σ²(shared) + mean of σ²(point)          σ²(point) = σ²(keyframe that added it)          σ²(first keyframe) = 0
//! ```
//!
//! So the error grows as a random walk where new ground is seen and stays where it is known. It is kept as one variance
//! of position and one of attitude, alike in all directions: which way the map has drifted nobody knows.

use nalgebra::{Matrix6, Vector6};

use crate::map::{Map, PointId};

/// What calibration leaves of the lens: about as much as a careful one reports as its residual, in pixels.
const LENS_PX: f64 = 0.5;
/// Doubt about when a picture was taken: a rolling shutter of 30 ms has its middle within some milliseconds.
const INSTANT_S: f64 = 0.005;

/// Covariance of the errors that all points of a picture share, for a camera of this focal length that moves with
/// `twist` (translation first, m/s and rad/s in its own axes) and sees things at `depth_m`.
pub(crate) fn shared(focal_px: f64, depth_m: f64, twist: &Vector6<f64>) -> Matrix6<f64> {
    let angle = LENS_PX / focal_px;
    let off = INSTANT_S * twist;
    let mut covariance = off * off.transpose();
    for i in 0..3 {
        covariance[(i, i)] += (angle * depth_m).powi(2);
        covariance[(i + 3, i + 3)] += angle * angle;
    }
    covariance
}

/// Variance of what the map is off at some place, relative to its beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Drift {
    /// Of each coordinate, m².
    position_m2: f64,
    /// About each axis, rad².
    attitude_rad2: f64,
}

impl Drift {
    /// Of the points by which a frame was located, on average.
    pub(crate) fn of(map: &Map, points: &[Option<PointId>]) -> Self {
        let mut sum = Self::default();
        let mut count = 0.0;
        for point in points.iter().flatten().filter_map(|&id| map.point(id)) {
            sum.position_m2 += point.drift.position_m2;
            sum.attitude_rad2 += point.drift.attitude_rad2;
            count += 1.0;
        }
        let share = 1.0 / f64::max(count, 1.0);
        Self {
            position_m2: sum.position_m2 * share,
            attitude_rad2: sum.attitude_rad2 * share,
        }
    }

    /// How far one of two places may have drifted from the other: the way between them is what the later one adds.
    pub(crate) fn apart_m(&self, other: &Self) -> f64 {
        (self.position_m2 - other.position_m2).abs().sqrt()
    }

    /// The covariance of a pose, translation first, whose fit alone has this one.
    pub(crate) fn widen(&self, fit: &Matrix6<f64>) -> Matrix6<f64> {
        let mut wide = *fit;
        for i in 0..3 {
            wide[(i, i)] += self.position_m2;
            wide[(i + 3, i + 3)] += self.attitude_rad2;
        }
        wide
    }

    /// Standard deviations of a coordinate, in metres, and about an axis, in radians.
    pub(crate) fn sigmas(&self) -> [f64; 2] {
        [self.position_m2.sqrt(), self.attitude_rad2.sqrt()]
    }

    /// Of a keyframe whose pose has this covariance.
    pub(crate) fn from_covariance(pose: &Matrix6<f64>) -> Self {
        Self {
            position_m2: pose.fixed_view::<3, 3>(0, 0).trace() / 3.0,
            attitude_rad2: pose.fixed_view::<3, 3>(3, 3).trace() / 3.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fast_camera_knows_less_about_where_it_was() {
        let still = shared(500.0, 2.0, &Vector6::zeros());
        assert!((still[(0, 0)] - 4e-6).abs() < 1e-12 && (still[(4, 4)] - 1e-6).abs() < 1e-12);
        let fast = shared(500.0, 2.0, &Vector6::new(2.0, 0.0, 0.0, 0.0, 0.0, 0.0));
        assert!((fast[(0, 0)] - 4e-6 - 1e-4).abs() < 1e-12, "1 cm in 5 ms");
        assert!((fast[(1, 1)] - still[(1, 1)]).abs() < 1e-15);
    }

    #[test]
    fn places_are_apart_by_what_the_way_between_them_adds() {
        let of = |position_m2| Drift {
            position_m2,
            attitude_rad2: 0.0,
        };
        let (early, late) = (of(4e-4), of(13e-4));
        assert!((early.apart_m(&late) - 0.03).abs() < 1e-12);
        assert!((late.apart_m(&early) - 0.03).abs() < 1e-12);
        assert!(late.apart_m(&late) < 1e-12);
    }

    #[test]
    fn uncertainty_adds_up_from_keyframe_to_keyframe() {
        let fit = Matrix6::from_diagonal(&[4e-6, 1e-6, 1e-6, 3e-8, 3e-8, 3e-8].into());
        let first = Drift::from_covariance(&Drift::default().widen(&fit));
        let second = Drift::from_covariance(&first.widen(&fit));
        assert!((first.position_m2 - 2e-6).abs() < 1e-15);
        assert!((second.position_m2 - 4e-6).abs() < 1e-15);
        assert!((second.attitude_rad2 - 6e-8).abs() < 1e-15);
    }
}
