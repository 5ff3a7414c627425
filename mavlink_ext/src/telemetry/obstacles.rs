//! `OBSTACLE_DISTANCE`: what is around the vehicle, as seen from above, for the autopilot's own avoidance.
//!
//! 72 sectors of 5°, clockwise, the middle of the first one straight ahead (`MAV_FRAME_BODY_FRD`): ArduPilot and PX4 take
//! an element's angle for the middle of its sector. ArduPilot leaves out distances below the least and reads all others as
//! horizontal. <https://mavlink.io/en/messages/common.html#OBSTACLE_DISTANCE>

use std::f64::consts::TAU;

use maps::frame::{Body, Point};
use maps::time::Stamp;

use crate::dialect::tandem::{MavDistanceSensor, MavFrame, OBSTACLE_DISTANCE_DATA};

/// Sectors of a turn.
pub const SECTORS: usize = 72;
/// Angle of a sector in degrees.
const SECTOR_DEG: u8 = 5;
/// Not seen.
const UNKNOWN: u16 = u16::MAX;
/// The greatest distance in centimetres that leaves a value for "nothing there".
const FARTHEST_CM: f64 = (u16::MAX - 2) as f64;

/// What is seen in one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sight {
    /// An obstacle, so many metres away.
    Obstacle(f64),
    /// Nothing as far as is looked.
    Free,
    /// Nobody has looked there.
    Unknown,
}

/// What is seen all around a vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Surroundings {
    nearest_cm: u16,
    farthest_cm: u16,
    /// `None` where nothing was said yet.
    sectors: [Option<Sight>; SECTORS],
}

impl Surroundings {
    /// Nothing seen yet; obstacles are told from `nearest_m` to `farthest_m` metres, at most 655.33 m.
    pub fn new(nearest_m: f64, farthest_m: f64) -> Self {
        // Zero would be "touching", which ArduPilot takes for no value. What is no number becomes zero, too.
        let nearest_cm = ((nearest_m * 100.0).clamp(1.0, FARTHEST_CM) as u16).max(1);
        let farthest_cm = (farthest_m * 100.0).clamp(1.0, FARTHEST_CM) as u16;
        Self {
            nearest_cm,
            farthest_cm: farthest_cm.max(nearest_cm),
            sectors: [None; SECTORS],
        }
    }

    /// Adds what is seen in a direction: radians from straight ahead, to the left positive (as from +x to +y of
    /// [`Body`]). Of several in a sector the nearest obstacle counts; without one, it is free only if all are. A direction that
    /// is no number is ignored.
    pub fn see(&mut self, heading_rad: f64, sight: Sight) {
        let sectors = SECTORS as f64;
        let clockwise = (-heading_rad / TAU * sectors).round().rem_euclid(sectors);
        if !clockwise.is_finite() {
            return;
        }
        // A remainder of rounding may be a whole turn.
        let Some(sector) = self.sectors.get_mut(clockwise as usize % SECTORS) else {
            return;
        };
        *sector = Some(match (*sector, sight) {
            (Some(Sight::Obstacle(known)), Sight::Obstacle(new)) => Sight::Obstacle(known.min(new)),
            (Some(known @ Sight::Obstacle(_)), _) => known,
            (None, new) | (Some(_), new @ Sight::Obstacle(_)) => new,
            (Some(Sight::Free), Sight::Free) => Sight::Free,
            (Some(_), _) => Sight::Unknown,
        });
    }

    /// Adds an obstacle at a point of a body that is held level: only its heading is the vehicle's. The distance is the
    /// horizontal one. A point that is not finite is ignored.
    pub fn see_point(&mut self, point: Point<Body>) {
        if point.is_finite() {
            let (x, y) = (point.raw.x, point.raw.y);
            self.see(y.atan2(x), Sight::Obstacle(x.hypot(y)));
        }
    }

    /// The message, of sensors that saw it at this moment.
    pub fn message(&self, at: Stamp) -> OBSTACLE_DISTANCE_DATA {
        OBSTACLE_DISTANCE_DATA {
            time_usec: at.as_nanos() / 1000,
            distances: self.sectors.map(|sight| self.distance(sight)),
            min_distance: self.nearest_cm,
            max_distance: self.farthest_cm,
            sensor_type: MavDistanceSensor::MAV_DISTANCE_SENSOR_UNKNOWN,
            increment: SECTOR_DEG,
            increment_f: f32::from(SECTOR_DEG),
            angle_offset: 0.0,
            frame: MavFrame::MAV_FRAME_BODY_FRD,
        }
    }

    fn distance(&self, sight: Option<Sight>) -> u16 {
        match sight {
            None | Some(Sight::Unknown) => UNKNOWN,
            Some(Sight::Free) => self.farthest_cm + 1,
            Some(Sight::Obstacle(distance_m)) if distance_m.is_nan() => UNKNOWN,
            Some(Sight::Obstacle(distance_m)) => {
                // Cut, not rounded: rather too near. One that is nearer than the least is told at the least, or it would
                // be left out.
                let cm = (distance_m * 100.0) as u16;
                if distance_m * 100.0 >= f64::from(self.farthest_cm) + 1.0 {
                    self.farthest_cm + 1
                } else {
                    cm.clamp(self.nearest_cm, self.farthest_cm)
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;

    fn distances(surroundings: &Surroundings) -> [u16; SECTORS] {
        surroundings.message(Stamp::ZERO).distances
    }

    #[test]
    fn sectors_go_clockwise_from_straight_ahead() {
        let mut seen = Surroundings::new(0.2, 20.0);
        seen.see_point(Point::new(1.0, 0.0, 5.0));
        seen.see_point(Point::new(0.0, -2.0, 0.0));
        seen.see_point(Point::new(-3.0, 0.0, 0.0));
        seen.see_point(Point::new(0.0, 4.0, 0.0));
        let mut expected = [UNKNOWN; SECTORS];
        expected[0] = 100;
        expected[18] = 200;
        expected[36] = 300;
        expected[54] = 400;
        assert_eq!(distances(&seen), expected, "ahead, right, behind, left");
        let message = seen.message(Stamp::from_nanos(9_000));
        assert_eq!(message.frame, MavFrame::MAV_FRAME_BODY_FRD);
        assert_eq!((message.time_usec, message.increment), (9, 5));
        assert!((message.increment_f - 5.0).abs() < f32::EPSILON);
        assert!(message.angle_offset.abs() < f32::EPSILON);
        assert_eq!((message.min_distance, message.max_distance), (20, 2000));
    }

    #[test]
    fn the_first_sector_reaches_two_and_a_half_degrees_to_both_sides() {
        for (degrees, sector) in [
            (2.4, 0),
            (-2.4, 0),
            (2.6, 71),
            (-2.6, 1),
            (357.6, 0),
            (-720.0, 0),
        ] {
            let mut seen = Surroundings::new(0.2, 20.0);
            seen.see(f64::to_radians(degrees), Sight::Obstacle(1.0));
            let found = distances(&seen).iter().position(|d| *d == 100);
            assert_eq!(found, Some(sector), "{degrees}° to the left");
        }
    }

    #[track_caller]
    fn check_together(sights: &[Sight], expected: u16) {
        let mut seen = Surroundings::new(0.2, 20.0);
        for sight in sights {
            seen.see(FRAC_PI_2, *sight);
        }
        assert_eq!(distances(&seen)[54], expected, "{sights:?}");
        let mut backwards = Surroundings::new(0.2, 20.0);
        for sight in sights.iter().rev() {
            backwards.see(FRAC_PI_2, *sight);
        }
        assert_eq!(distances(&backwards)[54], expected, "{sights:?} backwards");
    }

    #[test]
    fn the_nearest_obstacle_counts_and_free_is_only_what_all_rays_saw_free() {
        use Sight::{Free, Obstacle, Unknown};
        check_together(&[], UNKNOWN);
        check_together(&[Free, Free], 2001);
        check_together(&[Free, Unknown, Free], UNKNOWN);
        check_together(&[Obstacle(5.0), Free, Obstacle(3.0), Unknown], 300);
    }

    #[test]
    fn an_obstacle_at_the_ends_of_the_range_is_no_special_value() {
        use Sight::Obstacle;
        check_together(&[Obstacle(0.0)], 20);
        check_together(&[Obstacle(-1.0)], 20);
        check_together(&[Obstacle(0.05)], 20);
        check_together(&[Obstacle(1.239)], 123);
        check_together(&[Obstacle(20.0)], 2000);
        check_together(&[Obstacle(20.02)], 2001);
        check_together(&[Obstacle(f64::INFINITY)], 2001);
        check_together(&[Obstacle(f64::NAN)], UNKNOWN);
    }

    #[test]
    fn ranges_that_do_not_fit_leave_room_for_the_special_values() {
        for (nearest, farthest) in [
            (0.0, 1e9),
            (f64::NAN, f64::INFINITY),
            (30.0, 2.0),
            (-1.0, -1.0),
        ] {
            let seen = Surroundings::new(nearest, farthest).message(Stamp::ZERO);
            assert!(seen.min_distance >= 1, "{nearest} to {farthest} m");
            assert!(seen.max_distance >= seen.min_distance);
            assert!(seen.max_distance < UNKNOWN - 1);
        }
    }

    proptest! {
        #[test]
        fn any_sights_never_panic_and_an_obstacle_in_range_is_told(
            heading in any::<f64>(), far in any::<f64>(), near in 0.2..20.0
        ) {
            let mut seen = Surroundings::new(0.2, 20.0);
            seen.see(heading, Sight::Obstacle(far));
            seen.see(far, Sight::Free);
            seen.see_point(Point::new(heading, far, 0.0));
            seen.see(1.0, Sight::Obstacle(near));
            let told = distances(&seen)[61];
            prop_assert!((20..=2000).contains(&told), "57.3° to the left: {}", told);
        }
    }
}
