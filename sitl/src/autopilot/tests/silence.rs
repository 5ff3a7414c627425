//! A ground station that falls silent, and comes back.

use mavlink_ext::dialect::tandem::MavState;

use super::*;

/// Lets the ground station be silent for so long; returns what is said.
fn silence(flight: &mut Flight, seconds: u32) -> Vec<String> {
    flight.present = false;
    flight.said_within(seconds)
}

fn state(flight: &Flight) -> Option<MavState> {
    flight.last(|message| match message {
        Message::HEARTBEAT(heartbeat) => Some(heartbeat.system_status),
        _ => None,
    })
}

#[test]
fn without_the_parameter_nothing_happens() {
    for (mut flight, mode) in [
        (Flight::copter().airborne(), 4),
        (Flight::rover().airborne(), 15),
    ] {
        assert_eq!(silence(&mut flight, 20), [""; 0]);
        assert_eq!(flight.autopilot.mode().number(flight.autopilot.kind), mode);
        assert!(!flight.autopilot.failsafe_active());
    }
}

#[test]
fn a_copter_does_what_the_parameter_says_and_says_so_once_and_when_it_is_over() {
    for (action, mode, more) in [
        (1.0, Mode::Rtl, None),
        (2.0, Mode::Rtl, None),
        (
            3.0,
            Mode::Rtl,
            Some("SmartRTL Unavailable, Trying RTL Mode"),
        ),
        (
            4.0,
            Mode::Land,
            Some("SmartRTL Unavailable, Using Land Mode"),
        ),
        (5.0, Mode::Land, None),
        (6.0, Mode::Rtl, Some("Trying RTL Mode")),
        (7.0, Mode::Brake, None),
    ] {
        let mut flight = Flight::copter().airborne();
        flight.set("FS_GCS_ENABLE", action);
        assert_eq!(silence(&mut flight, 4), [""; 0], "5 s are allowed");
        let said = silence(&mut flight, 3);
        let expected: Vec<&str> = std::iter::once("GCS Failsafe").chain(more).collect();
        assert_eq!(said, expected);
        assert_eq!(flight.autopilot.mode(), mode, "action {action}");
        assert_eq!(state(&flight), Some(MavState::MAV_STATE_CRITICAL));
        flight.present = true;
        assert_eq!(flight.said_within(2), ["GCS Failsafe Cleared"]);
        assert_eq!(
            flight.autopilot.mode(),
            mode,
            "it does not go back by itself"
        );
        assert!(!flight.autopilot.failsafe_active());
    }
}

#[test]
fn a_copter_goes_on_where_its_options_say_so() {
    let silent_in = |mode: u32, options: f32| {
        let mut flight = Flight::copter();
        flight.upload(vec![
            command_item(cmd::NAV_TAKEOFF, [0.0; 4], 2.0),
            waypoint(50.0, 0.0, 2.0),
        ]);
        let mut flight = flight.airborne();
        flight.set("FS_GCS_ENABLE", 1.0);
        flight.set("FS_OPTIONS", options);
        assert_eq!(flight.mode(mode), MavResult::MAV_RESULT_ACCEPTED);
        // A landing would be over too soon.
        flight.set("LAND_SPEED", 20.0);
        let said = silence(&mut flight, 7);
        (said.join("; "), flight.autopilot.mode())
    };
    let says = |text: &str, mode| (text.to_owned(), mode);
    assert_eq!(
        silent_in(3, 2.0),
        says("GCS Failsafe - Continuing Auto Mode", Mode::Auto)
    );
    assert_eq!(silent_in(3, 16.0), says("GCS Failsafe", Mode::Rtl));
    assert_eq!(
        silent_in(5, 16.0),
        says("GCS Failsafe - Continuing Pilot Control", Mode::Loiter)
    );
    assert_eq!(silent_in(5, 0.0), says("GCS Failsafe", Mode::Rtl));
    assert_eq!(
        silent_in(9, 8.0),
        says("GCS Failsafe - Continuing Landing", Mode::Land)
    );
}

#[test]
fn a_copter_that_lands_with_a_low_battery_goes_on_landing() {
    let mut flight = Flight::copter().airborne();
    flight.set("FS_GCS_ENABLE", 1.0);
    flight.set("LAND_SPEED", 20.0);
    flight.set("BATT_FS_LOW_ACT", 1.0);
    flight.set("BATT_LOW_MAH", 6000.0);
    let said = silence(&mut flight, 7);
    assert_eq!(
        said[1..],
        [
            "Battery Failsafe",
            "GCS + Battery Failsafe - Continuing Landing"
        ]
    );
    assert_eq!(flight.autopilot.mode(), Mode::Land);
}

#[test]
fn a_copter_on_the_ground_is_disarmed_and_a_disarmed_one_cannot_be_armed() {
    let mut flight = Flight::copter();
    flight.set("FS_GCS_ENABLE", 1.0);
    flight.run(3);
    flight.arm();
    assert_eq!(
        silence(&mut flight, 7),
        ["Disarming motors", "GCS Failsafe - Disarming"]
    );
    flight.heard.clear();
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_FAILED);
    assert_eq!(flight.texts(), ["Arm: GCS failsafe on"]);
    flight.present = true;
    flight.run(2);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
}

#[test]
fn a_rover_waits_a_little_longer_and_does_what_its_action_says() {
    for (action, mode) in [
        (0.0, Mode::Guided),
        (1.0, Mode::Rtl),
        (2.0, Mode::Hold),
        (3.0, Mode::Rtl),
        (4.0, Mode::Hold),
    ] {
        let mut flight = Flight::rover().airborne();
        flight.set("FS_GCS_ENABLE", 1.0);
        flight.set("FS_ACTION", action);
        assert_eq!(silence(&mut flight, 5), [""; 0], "5 s, and 1.5 s more");
        assert_eq!(silence(&mut flight, 3), ["GCS Failsafe"]);
        assert_eq!(flight.autopilot.mode(), mode, "action {action}");
        assert_eq!(state(&flight), Some(MavState::MAV_STATE_CRITICAL));
        flight.present = true;
        assert_eq!(flight.said_within(2), ["GCS Failsafe Cleared"]);
        assert!(!flight.autopilot.failsafe_active());
    }
}

#[test]
fn a_rover_goes_on_with_its_mission_if_told_so_and_stands_by_in_hold() {
    for (enable, mode, said) in [
        (1.0, Mode::Hold, &["GCS Failsafe"] as &[&str]),
        (
            2.0,
            Mode::Auto,
            &["GCS Failsafe", "Failsafe - Continuing Auto Mode"],
        ),
    ] {
        let mut flight = Flight::rover();
        flight.upload(vec![waypoint(30.0, 0.0, 0.0), waypoint(40.0, 0.0, 0.0)]);
        let mut flight = flight.airborne();
        flight.mode(10);
        flight.set("FS_GCS_ENABLE", enable);
        assert_eq!(silence(&mut flight, 8), said);
        assert_eq!(flight.autopilot.mode(), mode);
    }
    for (options, said) in [(0.0, &[] as &[&str]), (1.0, &["GCS Failsafe"])] {
        let mut flight = Flight::rover().airborne();
        flight.mode(4);
        flight.set("FS_GCS_ENABLE", 1.0);
        flight.set("FS_ACTION", 1.0);
        flight.set("FS_OPTIONS", options);
        assert_eq!(silence(&mut flight, 8), said);
    }
}

#[test]
fn a_ground_station_that_was_never_there_is_not_missed() {
    let mut flight = Flight::rover();
    flight.set("FS_GCS_ENABLE", 1.0);
    assert_eq!(silence(&mut flight, 20), [""; 0]);
}
