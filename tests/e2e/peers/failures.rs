//! Things go wrong on the simulated vehicles, and pymavlink hears of it in `ArduPilot`'s words.

use super::autopilot::{OTHERS, use_vehicle};

/// What is heard of that failure on both vehicles.
#[track_caller]
fn check_failure(failure: &str, copter: &[&str], rover: &[&str]) {
    for (vehicle, expected) in [("--copter", copter), ("--rover", rover)] {
        let told = use_vehicle("pymavlink_failures.py", &[failure], OTHERS, &[vehicle]);
        assert_eq!(told.lines().collect::<Vec<_>>(), expected, "{vehicle}");
    }
}

#[test]
fn a_low_battery_is_told_and_brings_both_vehicles_back() {
    let low = "Battery 1 is low _V used _ mAh";
    let unwell = "battery low and unwell";
    check_failure(
        "battery",
        &[low, "Battery Failsafe", "mode RTL", unwell],
        &[low, "mode RTL", unwell],
    );
}

#[test]
fn a_silent_ground_station_is_missed_by_both_vehicles_until_it_is_back() {
    let expected = [
        "GCS Failsafe",
        "mode RTL",
        "critical",
        "GCS Failsafe Cleared",
    ];
    check_failure("silence", &expected, &expected);
}

#[test]
fn a_breached_fence_is_told_and_brings_both_vehicles_back_inside() {
    check_failure(
        "fence",
        &[
            "fence uploaded",
            "Max Alt, Circle and Polygon fences enabled",
            "FENCE_BREACH_BOUNDARY, 1 in all",
            "Polygon fence breached",
            "mode RTL",
            "Manual recovery started",
            "Fence breach cleared",
            "back inside",
        ],
        &[
            "fence uploaded",
            "Circle and Polygon fences enabled",
            "FENCE_BREACH_BOUNDARY, 1 in all",
            "mode RTL",
            "Manual recovery started",
            "back inside",
        ],
    );
}

#[test]
fn arming_is_refused_for_each_reason_and_goes_by_force() {
    let expected = |mode, armed| {
        [
            "Arm: GPS 1: Bad fix",
            "Arm: Battery 1 below minimum arming voltage",
            "PreArm: Battery 1 below minimum arming voltage",
            "Arm: Circle FENCE_MARGIN is less than FENCE_RADIUS",
            "Arm: Missing mission item: RTL",
            mode,
            armed,
        ]
    };
    check_failure(
        "arming",
        &expected("Arm: RTL mode not armable", "Arming motors"),
        &expected("Arm: Mode not armable", "Throttle armed"),
    );
}
