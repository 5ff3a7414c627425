//! From the camera's pose to the vehicle's, at the rate a flight controller takes.
//!
//! ```text
//! T_world_body = T_world_camera · T_camera_body          Σ_body = Ad · Σ_camera · Adᵀ
//! Ad = [ R  [t]×R ]   of T_body_camera = (R, t), for perturbations on the right, translation before rotation
//!      [ 0     R  ]
//! ```
//!
//! - T. D. Barfoot, *State Estimation for Robotics*, 2017, §7.1.4 (the adjoint).

use std::time::Duration;

use maps::frame::{Body, Camera, Isometry, Vector};
use maps::time::Stamp;
use mavlink_ext::convert::Odometry;
use nalgebra::{Matrix6, Vector3};
use slam::{State, Tracked};

/// Lets through at most so many a second, evenly; jitter of half an interval loses none.
#[derive(Clone, Copy, Debug)]
pub struct RateLimit {
    interval: Duration,
    due: Stamp,
}

impl RateLimit {
    /// At most one in an interval, on average.
    pub fn new(interval: Duration) -> Self {
        Self {
            interval,
            due: Stamp::ZERO,
        }
    }

    /// Whether what happens at `now` is let through.
    pub fn allows(&mut self, now: Stamp) -> bool {
        let allowed = now + self.interval / 2 >= self.due;
        if allowed {
            self.due = self.due.max(now) + self.interval;
        }
        allowed
    }
}

/// Turns what SLAM says of the camera into what the autopilot wants to know of the vehicle.
#[derive(Clone, Debug)]
pub struct VehicleOdometry {
    body_from_camera: Isometry<Body, Camera>,
    /// The last frame with a pose.
    last: Option<Tracked>,
}

/// So many supporting points make a perfect estimate.
const POINTS_FOR_FULL_QUALITY: usize = 200;

impl VehicleOdometry {
    /// For a camera mounted like this.
    pub fn new(body_from_camera: Isometry<Body, Camera>) -> Self {
        Self {
            body_from_camera,
            last: None,
        }
    }

    /// The vehicle at `at`, when the frame was taken; `None` before the first pose. While the camera is lost the
    /// estimate is the last one, marked as failed.
    pub fn advance(&mut self, at: Stamp, tracked: &Tracked) -> Option<Odometry> {
        let world_from_body = tracked.world_from_camera * self.body_from_camera.inverse();
        let reset_counter = tracked.reset_counter as u8;
        let failed = Odometry {
            at,
            world_from_body,
            velocity: None,
            turn_rate: None,
            covariance: None,
            reset_counter,
            quality: -1,
        };
        match tracked.state {
            State::Searching => None,
            State::Lost { .. } => Some(failed),
            State::Tracking => {
                let motion = self.motion(tracked);
                self.last = Some(tracked.clone());
                let adjoint = adjoint(&self.body_from_camera);
                let quality = 100 * tracked.points / POINTS_FOR_FULL_QUALITY;
                Some(Odometry {
                    velocity: motion.map(|[velocity, _]| velocity),
                    turn_rate: motion.map(|[_, turn_rate]| turn_rate),
                    covariance: Some(adjoint * tracked.covariance * adjoint.transpose()),
                    quality: quality.clamp(1, 100) as i8,
                    ..failed
                })
            }
        }
    }

    /// Velocity and turn rate since the last frame; `None` across a jump or a gap.
    fn motion(&self, tracked: &Tracked) -> Option<[Vector<Body>; 2]> {
        let last = self.last.as_ref()?;
        let dt_s = tracked.at.since(last.at).as_secs_f64();
        if tracked.reset_counter != last.reset_counter || !(1e-3..0.5).contains(&dt_s) {
            return None;
        }
        let before = last.world_from_camera * self.body_from_camera.inverse();
        let after = tracked.world_from_camera * self.body_from_camera.inverse();
        let moved = (after.translation() - before.translation()).raw;
        let turned = (before.rotation().inverse() * after.rotation()).scaled_axis();
        let velocity = after.rotation().inverse() * moved / dt_s;
        Some([velocity, turned / dt_s].map(Vector::from_raw))
    }
}

fn adjoint(body_from_camera: &Isometry<Body, Camera>) -> Matrix6<f64> {
    let r = *body_from_camera.rotation().to_rotation_matrix().matrix();
    let t: Vector3<f64> = body_from_camera.raw.translation.vector;
    let mut adjoint = Matrix6::zeros();
    adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
    adjoint
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(t.cross_matrix() * r));
    adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
    adjoint
}

#[cfg(test)]
mod tests {
    use super::*;
    use maps::frame::{Point, World};
    use nalgebra::{Isometry3, UnitQuaternion, Vector6};

    fn at(ms: u64) -> Stamp {
        Stamp::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn the_rate_is_held_on_average_and_jitter_loses_nothing() {
        let mut limit = RateLimit::new(Duration::from_millis(33));
        let early_and_late = [0, 30, 69, 96, 135];
        assert!(early_and_late.iter().all(|&ms| limit.allows(at(ms))));
        let mut limit = RateLimit::new(Duration::from_millis(100));
        let passed = (0..1000).filter(|&ms| limit.allows(at(1000 + ms))).count();
        assert!((10..=11).contains(&passed), "{passed} in a second at 10 Hz");
    }

    /// Ahead on the body, looking down.
    fn mount() -> Isometry<Body, Camera> {
        let down = UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, -1.0);
        Isometry::claim(Isometry3::from_parts(
            Vector3::new(0.2, 0.1, -0.05).into(),
            down,
        ))
    }

    fn tracked(ms: u64, world_from_body: Isometry<World, Body>) -> Tracked {
        Tracked {
            at: at(ms),
            state: State::Tracking,
            world_from_camera: world_from_body * mount(),
            covariance: Matrix6::identity() * 1e-4,
            reset_counter: 0,
            points: 100,
            rejected: 0,
            moving_share: 0.0,
            keyframe: false,
        }
    }

    fn pose(x: f64, yaw: f64) -> Isometry<World, Body> {
        Isometry::claim(Isometry3::new([x, 0.0, 2.0].into(), [0.0, 0.0, yaw].into()))
    }

    #[test]
    fn the_vehicle_is_where_its_mounted_camera_says() {
        let mut odometry = VehicleOdometry::new(mount());
        let first = odometry
            .advance(at(5), &tracked(0, pose(1.0, 0.5)))
            .expect("a pose");
        assert_eq!((first.at, first.velocity, first.quality), (at(5), None, 50));
        let centre = first.world_from_body * Point::origin();
        assert!((centre - Point::new(1.0, 0.0, 2.0)).norm() < 1e-12);
        let second = odometry
            .advance(at(105), &tracked(100, pose(1.1, 0.5)))
            .expect("a pose");
        let velocity = second
            .velocity
            .expect("a tenth of a metre in a tenth of a second")
            .raw;
        let expected = Vector3::new(0.5_f64.cos(), -0.5_f64.sin(), 0.0);
        assert!((velocity - expected).norm() < 1e-9, "{velocity}");
        let third = odometry
            .advance(at(205), &tracked(200, pose(1.1, 0.6)))
            .expect("a pose");
        let turning = third.turn_rate.expect("known").raw;
        assert!(
            (turning - Vector3::new(0.0, 0.0, 1.0)).norm() < 1e-9,
            "{turning}"
        );
    }

    #[test]
    fn no_velocity_is_made_of_a_jump_and_a_lost_camera_is_marked() {
        let mut odometry = VehicleOdometry::new(mount());
        odometry.advance(at(0), &tracked(0, pose(0.0, 0.0)));
        let jumped = Tracked {
            reset_counter: 1,
            ..tracked(33, pose(3.0, 0.0))
        };
        let after = odometry.advance(at(33), &jumped).expect("a pose");
        assert_eq!((after.velocity, after.reset_counter), (None, 1));
        let lost = Tracked {
            state: State::Lost { since: at(66) },
            ..jumped
        };
        let failed = odometry.advance(at(66), &lost).expect("the last pose");
        assert_eq!((failed.quality, failed.covariance), (-1, None));
        let searching = Tracked {
            state: State::Searching,
            ..lost
        };
        assert_eq!(odometry.advance(at(99), &searching), None);
    }

    #[test]
    fn covariance_moves_with_the_lever_arm() {
        // The camera is 2 m ahead of the body, turned like it: its turning about z moves the body sideways.
        let ahead = Isometry::claim(Isometry3::translation(2.0, 0.0, 0.0));
        let sigma = Matrix6::from_diagonal(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 1.0));
        let adjoint = adjoint(&ahead);
        let body = adjoint * sigma * adjoint.transpose();
        assert!((body[(1, 1)] - 4.0).abs() < 1e-12, "{body}");
        assert!((body[(5, 5)] - 1.0).abs() < 1e-12);
        assert!(body[(0, 0)].abs() < 1e-12);
    }
}
