use maps::time::Stamp;
use mavlink_ext::dialect::cmd;
use mavlink_ext::dialect::tandem::MavMissionResult;
use mavlink_ext::mission::{MissionFrame, MissionItem};
use proptest::prelude::*;

use super::*;
use crate::wgs84::Origin;

fn settings(set: &[(&str, f32)]) -> Settings {
    let mut parameters = Parameters::new(Kind::Copter);
    for (name, value) in [
        ("FENCE_ENABLE", 1.0),
        ("FENCE_RADIUS", 50.0),
        ("FENCE_ALT_MAX", 30.0),
    ]
    .iter()
    .chain(set)
    {
        assert!(parameters.set(name, *value).is_some(), "{name}");
    }
    Settings::of(&parameters, Kind::Copter)
}

fn place(x: f64, y: f64, up: f64) -> Place {
    Place {
        at: Point2::new(x, y),
        from_home_m: x.hypot(y),
        above_home_m: up,
    }
}

fn at(seconds: u64) -> Stamp {
    Stamp::from_nanos(seconds * 1_000_000_000)
}

fn origin() -> Origin {
    "50.7268,7.0865,60".parse().expect("a place")
}

/// A zone's item at metres east and north.
fn item(command: u16, first: f32, [x, y]: [f64; 2]) -> MissionItem {
    let place = origin().to_geodetic(maps::frame::Point::new(x, y, 0.0));
    MissionItem {
        command,
        params: [first, 0.0, 0.0, 0.0],
        ..MissionItem::waypoint(place.lat_deg, place.lon_deg, 0.0)
    }
}

fn polygon(command: u16, corners: &[[f64; 2]]) -> Vec<MissionItem> {
    corners
        .iter()
        .map(|corner| item(command, corners.len() as f32, *corner))
        .collect()
}

/// An L, with its notch to the north-east.
const L: [[f64; 2]; 6] = [
    [-10.0, -10.0],
    [10.0, -10.0],
    [10.0, 0.0],
    [0.0, 0.0],
    [0.0, 10.0],
    [-10.0, 10.0],
];
const WITHIN: u16 = cmd::NAV_FENCE_POLYGON_VERTEX_INCLUSION;
const OUT_OF: u16 = cmd::NAV_FENCE_POLYGON_VERTEX_EXCLUSION;

#[test]
fn names_are_joined_as_people_do() {
    assert_eq!(Parts::CIRCLE.names(), "Circle fence");
    assert_eq!(
        Parts::CIRCLE.with(Parts::CEILING).names(),
        "Max Alt and Circle fences"
    );
    assert_eq!(Parts::ALL.names(), "Max Alt, Circle and Polygon fences");
}

#[test]
fn a_breach_is_new_once_and_again_twenty_metres_further() {
    let (mut fence, settings) = (Fence::default(), settings(&[]));
    let mut check = |seconds, x, up| fence.check(at(seconds), &settings, Some(&place(x, 0.0, up)));
    assert_eq!(check(0, 49.9, 29.9), Parts::NONE);
    assert_eq!(check(1, 50.0, 29.9), Parts::CIRCLE);
    assert_eq!(check(2, 60.0, 29.9), Parts::NONE);
    assert_eq!(check(3, 60.0, 30.0), Parts::CEILING);
    assert_eq!(check(4, 70.1, 31.0), Parts::CIRCLE, "20 m on");
    assert_eq!(check(5, 49.0, 29.0), Parts::NONE);
    assert_eq!(check(6, 55.0, 29.0), Parts::CIRCLE, "back and out again");
    assert_eq!(fence.breached(), Parts::CIRCLE);
    assert_eq!(fence.history(), (4, at(6)));
    assert!((fence.beyond_m(Parts::ALL) - 5.0).abs() < 1e-9);
}

#[test]
fn a_change_of_mode_gives_ten_seconds_in_which_no_breach_is_acted_on() {
    let (mut fence, settings) = (Fence::default(), settings(&[]));
    assert!(
        !fence.begin_recovery(at(0)),
        "there is nothing to recover from"
    );
    assert_eq!(
        fence.check(at(0), &settings, Some(&place(51.0, 0.0, 1.0))),
        Parts::CIRCLE
    );
    assert!(fence.begin_recovery(at(1)));
    assert_eq!(
        fence.check(at(10), &settings, Some(&place(51.0, 0.0, 31.0))),
        Parts::NONE
    );
    assert_eq!(
        fence.breached(),
        Parts::CIRCLE.with(Parts::CEILING),
        "known, though"
    );
    assert_eq!(
        fence.check(at(11), &settings, Some(&place(80.0, 0.0, 31.0))),
        Parts::CIRCLE
    );
}

#[test]
fn what_is_switched_off_is_not_breached_and_the_parameter_switches_all_of_it() {
    let (mut fence, on) = (Fence::default(), settings(&[]));
    let far = place(51.0, 0.0, 31.0);
    fence.check(at(0), &on, Some(&far));
    assert_eq!(fence.switch(&on, false, Parts::CIRCLE), Parts::CIRCLE);
    assert_eq!(fence.breached(), Parts::CEILING);
    assert_eq!(
        fence.switch(&on, false, Parts::CIRCLE),
        Parts::NONE,
        "it was off already"
    );
    let off = settings(&[("FENCE_ENABLE", 0.0)]);
    fence.check(at(1), &off, Some(&far));
    assert!(!fence.is_on() && fence.breached().is_empty());
    fence.check(at(2), &on, Some(&far));
    assert_eq!(
        fence.active(&on),
        Parts::CIRCLE.with(Parts::CEILING),
        "there are no polygons"
    );
}

#[test]
fn without_a_position_nothing_is_breached_and_nothing_is_cleared() {
    let (mut fence, settings) = (Fence::default(), settings(&[]));
    fence.check(at(0), &settings, Some(&place(51.0, 0.0, 0.0)));
    assert_eq!(fence.check(at(1), &settings, None), Parts::NONE);
    assert_eq!(fence.breached(), Parts::CIRCLE);
}

#[test]
fn polygons_and_circles_are_to_stay_within_or_out_of() {
    let mut items = polygon(WITHIN, &L);
    items.push(item(cmd::NAV_FENCE_CIRCLE_EXCLUSION, 2.0, [-5.0, -5.0]));
    items.push(item(cmd::NAV_FENCE_CIRCLE_INCLUSION, 12.0, [0.0, 0.0]));
    items.extend(polygon(OUT_OF, &[[5.0, -8.0], [9.0, -8.0], [7.0, -4.0]]));
    assert_eq!(zones::accepts_all(&items), Ok(()));
    let zones = zones::of(&items, &origin());
    assert_eq!(zones.len(), 4);
    for (x, y, breached) in [
        (-5.0, 5.0, false),
        (5.0, 5.0, true),   // in the notch
        (-5.0, -4.0, true), // in the circle to stay out of
        (-9.5, -9.5, true), // outside of the circle to stay within
        (7.0, -7.0, true),  // in the triangle to stay out of
        (2.0, -2.0, false),
    ] {
        assert_eq!(
            zones::is_breached(&zones, Point2::new(x, y)),
            breached,
            "({x}, {y})"
        );
    }
}

#[test]
fn a_plan_that_makes_no_fence_is_refused() {
    let error = Err(MavMissionResult::MAV_MISSION_ERROR);
    let four = polygon(WITHIN, &L[..4]);
    assert_eq!(zones::accepts_all(&four), Ok(()));
    assert_eq!(zones::accepts_all(&four[..3]), error, "a corner is missing");
    assert_eq!(
        zones::accepts_all(&polygon(WITHIN, &L[..2])),
        error,
        "a line"
    );
    assert_eq!(
        zones::accepts_all(&[item(cmd::NAV_FENCE_CIRCLE_INCLUSION, 0.0, [0.0; 2])]),
        error
    );
    let mut mixed = four.clone();
    mixed[2].command = OUT_OF;
    assert_eq!(zones::accepts_all(&mixed), error, "two halves of polygons");
    let waypoint = MissionItem::waypoint(50.0, 7.0, 2.0);
    assert_eq!(
        zones::accepts(&waypoint),
        Err(MavMissionResult::MAV_MISSION_UNSUPPORTED)
    );
    let framed = MissionItem {
        frame: MissionFrame::Command,
        ..four[0]
    };
    assert_eq!(
        zones::accepts(&framed),
        Err(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME)
    );
    let many = item(WITHIN, 256.0, [0.0; 2]);
    assert_eq!(
        zones::accepts(&many),
        Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1)
    );
}

#[track_caller]
fn check_before_arming(set: &[(&str, f32)], has_position: bool, expected: Option<&str>) {
    let settings = settings(set);
    let mut fence = Fence::default();
    fence.set_zones(zones::of(
        &[item(cmd::NAV_FENCE_CIRCLE_INCLUSION, 5.0, [0.0; 2])],
        &origin(),
    ));
    fence.check(at(0), &settings, Some(&place(3.0, 0.0, 0.0)));
    let found = fence.arming_failure(&settings, has_position);
    assert_eq!(found.as_deref(), expected, "{set:?}");
}

#[test]
fn a_fence_that_cannot_be_kept_is_named_before_arming() {
    check_before_arming(&[], true, None);
    check_before_arming(&[], false, Some("Fence requires position"));
    check_before_arming(&[("FENCE_TYPE", 1.0)], false, None);
    check_before_arming(
        &[("FENCE_TYPE", 0.0)],
        true,
        Some("Fences enabled, but none selected"),
    );
    check_before_arming(&[("FENCE_ENABLE", 0.0), ("FENCE_RADIUS", 1.0)], false, None);
    check_before_arming(
        &[("FENCE_RADIUS", 2.5)],
        true,
        Some("Vehicle breaching Circle fence"),
    );
    check_before_arming(
        &[("FENCE_RADIUS", -1.0)],
        true,
        Some("Invalid Circle FENCE_RADIUS value"),
    );
    check_before_arming(
        &[("FENCE_RADIUS", 1.0)],
        true,
        Some("Circle FENCE_MARGIN is less than FENCE_RADIUS"),
    );
    check_before_arming(
        &[("FENCE_ALT_MAX", -1.0)],
        true,
        Some("Invalid FENCE_ALT_MAX value"),
    );
    check_before_arming(
        &[("FENCE_MARGIN", -1.0)],
        true,
        Some("Invalid FENCE_MARGIN value"),
    );
    check_before_arming(
        &[("FENCE_MARGIN", 6.0)],
        true,
        Some("Polygon fence margin is less than inclusion circle radius"),
    );
    check_before_arming(
        &[("FENCE_MARGIN", 21.0), ("FENCE_TYPE", 3.0)],
        true,
        Some("FENCE_MARGIN too big"),
    );
}

proptest! {
    #[test]
    fn any_items_are_taken_apart_without_a_panic_and_none_is_lost(
        items in prop::collection::vec((4998_u16..5007, prop_oneof![any::<f32>(), -1.0_f32..6.0], -90.0..90.0, -180.0..180.0), 0..40),
        x in -1e6..1e6, y in -1e6..1e6,
    ) {
        let items: Vec<MissionItem> = items.into_iter().map(|(command, first, lat_deg, lon_deg)| MissionItem {
            command,
            params: [first, 0.0, 0.0, 0.0],
            ..MissionItem::waypoint(lat_deg, lon_deg, 0.0)
        }).collect();
        let fine = items.iter().all(|item| zones::accepts(item).is_ok()) && zones::accepts_all(&items).is_ok();
        let zones = zones::of(&items, &origin());
        prop_assert!(zones.len() <= items.len());
        zones::is_breached(&zones, Point2::new(x, y));
        if fine {
            let corners = items.iter().filter(|item| [WITHIN, OUT_OF].contains(&item.command)).count();
            prop_assert!(zones.len() >= corners / 255);
        }
    }
}
