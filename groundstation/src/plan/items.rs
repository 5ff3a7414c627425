//! Plans as mission items.

use geodesy::{Geodetic, Origin};
use maps::frame::Point;
use maps::plan::{Gear, Path};
use mavlink_ext::convert::{MissionFrame, MissionItem};
use mavlink_ext::dialect::cmd;

use crate::command::SurveyArea;

/// `DO_CHANGE_SPEED`: the speed over ground.
const GROUND_SPEED: f32 = 1.0;
/// `DO_CHANGE_SPEED`: leave the throttle as it is.
const NO_THROTTLE: f32 = -1.0;

/// What a ground vehicle is told to do to drive `path`: its speed, each change of gear before the waypoint that is reached
/// in it, and every waypoint but the one it stands on.
pub fn of_path(path: &Path, origin: &Origin, speed_mps: f64) -> Vec<MissionItem> {
    let mut items = vec![speed(speed_mps)];
    let mut gear = None;
    for waypoint in path.waypoints.iter().skip(1) {
        if gear != Some(waypoint.gear) {
            gear = Some(waypoint.gear);
            items.push(reverse(waypoint.gear));
        }
        let place = origin.to_geodetic(Point::new(waypoint.pose.x_m, waypoint.pose.y_m, 0.0));
        items.push(MissionItem::waypoint(place.lat_deg, place.lon_deg, 0.0));
    }
    if gear == Some(Gear::Reverse) {
        items.push(reverse(Gear::Forward));
    }
    items
}

/// What an aircraft is told to do to fly over `corners`: take off, its speed, the corners, return and land.
pub fn of_survey(
    corners: &[[f64; 2]],
    area: &SurveyArea,
    origin: &Origin,
    speed_mps: f64,
) -> Vec<MissionItem> {
    let take_off = MissionItem {
        command: cmd::NAV_TAKEOFF,
        ..MissionItem::waypoint(0.0, 0.0, area.altitude_m)
    };
    let fly_over = corners.iter().map(|[x, y]| {
        let place = origin.to_geodetic(Point::new(*x, *y, 0.0));
        MissionItem::waypoint(place.lat_deg, place.lon_deg, area.altitude_m)
    });
    let back = MissionItem::command(cmd::NAV_RETURN_TO_LAUNCH, [0.0; 4]);
    [take_off, speed(speed_mps)]
        .into_iter()
        .chain(fly_over)
        .chain([back])
        .collect()
}

/// The item that stands for the home position.
pub fn home(place: Geodetic) -> MissionItem {
    let frame = MissionFrame::Global;
    MissionItem {
        frame,
        ..MissionItem::waypoint(place.lat_deg, place.lon_deg, place.alt_m)
    }
}

/// The sequence number of the last item that is a place or a return: reaching it completes the mission.
pub fn last_reached(items: &[MissionItem]) -> Option<u16> {
    let is_reached = |item: &MissionItem| {
        [
            cmd::NAV_WAYPOINT,
            cmd::NAV_TAKEOFF,
            cmd::NAV_LAND,
            cmd::NAV_RETURN_TO_LAUNCH,
        ]
        .contains(&item.command)
    };
    items
        .iter()
        .rposition(is_reached)
        .and_then(|last| u16::try_from(last).ok())
}

fn speed(speed_mps: f64) -> MissionItem {
    MissionItem::command(
        cmd::DO_CHANGE_SPEED,
        [GROUND_SPEED, speed_mps as f32, NO_THROTTLE, 0.0],
    )
}

fn reverse(gear: Gear) -> MissionItem {
    let backwards = match gear {
        Gear::Forward => 0.0,
        Gear::Reverse => 1.0,
    };
    MissionItem::command(cmd::DO_SET_REVERSE, [backwards, 0.0, 0.0, 0.0])
}

#[cfg(test)]
mod tests {
    use maps::plan::{Pose2, Waypoint};

    use super::*;

    fn origin() -> Origin {
        Origin::new(47.397_742, 8.545_594, 488.0).expect("on earth")
    }

    fn at(x_m: f64, y_m: f64, gear: Gear) -> Waypoint {
        Waypoint {
            pose: Pose2 {
                x_m,
                y_m,
                heading_rad: 0.0,
            },
            gear,
        }
    }

    #[test]
    fn a_gear_change_stands_before_the_waypoint_that_is_reached_in_it() {
        let waypoints = vec![
            at(0.0, 0.0, Gear::Forward),
            at(1.0, 0.0, Gear::Forward),
            at(0.5, 0.0, Gear::Reverse),
            at(0.2, 0.0, Gear::Reverse),
        ];
        let path = Path {
            waypoints,
            length_m: 1.8,
            min_clearance_m: 0.4,
        };
        let items = of_path(&path, &origin(), 0.5);
        let commands: Vec<u16> = items.iter().map(|item| item.command).collect();
        let (speed, gear, go) = (cmd::DO_CHANGE_SPEED, cmd::DO_SET_REVERSE, cmd::NAV_WAYPOINT);
        assert_eq!(commands, [speed, gear, go, gear, go, go, gear]);
        assert_eq!(
            [1, 3, 6].map(|item: usize| items[item].params[0] > 0.5),
            [false, true, false]
        );
        assert_eq!(last_reached(&items), Some(5));
    }

    #[test]
    fn waypoints_are_where_the_map_says() {
        let path = Path {
            waypoints: vec![at(0.0, 0.0, Gear::Forward), at(3.0, -2.0, Gear::Forward)],
            length_m: 3.6,
            min_clearance_m: 1.0,
        };
        let items = of_path(&path, &origin(), 0.5);
        let goal = items.last().expect("a waypoint");
        let place = geodesy::Geodetic {
            lat_deg: goal.lat_deg,
            lon_deg: goal.lon_deg,
            alt_m: 488.0,
        };
        let back = origin().to_world(place);
        assert!(
            (back.raw.x - 3.0).abs() < 1e-3 && (back.raw.y + 2.0).abs() < 1e-3,
            "{back:?}"
        );
    }

    #[test]
    fn a_survey_takes_off_first_and_returns_last() {
        let area = SurveyArea {
            from_m: [0.0, 0.0],
            to_m: [4.0, 2.0],
            altitude_m: 2.5,
            spacing_m: 1.0,
        };
        let items = of_survey(&[[0.0, 0.5], [4.0, 0.5]], &area, &origin(), 1.0);
        assert_eq!(
            items.first().map(|item| (item.command, item.alt_m)),
            Some((cmd::NAV_TAKEOFF, 2.5))
        );
        assert_eq!(
            items.last().map(|item| item.command),
            Some(cmd::NAV_RETURN_TO_LAUNCH)
        );
        assert_eq!(last_reached(&items), Some(4));
    }
}
