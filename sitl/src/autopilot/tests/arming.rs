//! Arming that fails, for each reason.

use super::*;

fn prearm(flight: &Flight) -> Option<bool> {
    flight.is_healthy(MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK)
}

#[test]
fn without_a_fix_a_mode_that_needs_one_cannot_be_armed_in_and_the_prearm_bit_says_so_before() {
    for (mut flight, guided) in [(Flight::copter(), 4), (Flight::rover(), 15)] {
        flight.run(3);
        flight.mode(guided);
        flight.set("SIM_GPS_DISABLE", 1.0);
        flight.run(1);
        assert_eq!(prearm(&flight), Some(false));
        assert_eq!(flight.arm(), MavResult::MAV_RESULT_FAILED);
        assert!(
            flight.texts().contains(&"Arm: GPS 1: Bad fix"),
            "{:?}",
            flight.texts()
        );
        // What cannot be done without is asked for even where no checks are wanted.
        flight.set("ARMING_CHECK", 256.0);
        assert_eq!(flight.arm(), MavResult::MAV_RESULT_FAILED);
        assert!(
            flight.texts().contains(&"Arm: Need Position Estimate"),
            "{:?}",
            flight.texts()
        );
        flight.set("ARMING_CHECK", 1.0);
        flight.set("SIM_GPS_DISABLE", 0.0);
        flight.run(1);
        assert_eq!(prearm(&flight), Some(true));
        assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    }
}

#[test]
fn a_mode_that_needs_no_position_does_not_wait_for_one() {
    let mut rover = Flight::rover();
    rover.set("SIM_GPS_DISABLE", 1.0);
    rover.run(3);
    assert_eq!(rover.arm(), MavResult::MAV_RESULT_ACCEPTED, "MANUAL");
    let mut copter = Flight::copter();
    copter.set("SIM_GPS_DISABLE", 1.0);
    copter.step();
    assert_eq!(
        copter.arm(),
        MavResult::MAV_RESULT_FAILED,
        "it has just been powered up"
    );
    copter.run(3);
    assert_eq!(copter.arm(), MavResult::MAV_RESULT_ACCEPTED, "STABILIZE");
    assert_eq!(copter.mode(4), MavResult::MAV_RESULT_FAILED);
    let said = copter.texts();
    for words in [
        "Arm: AHRS: EKF3 still initialising",
        "Mode change to GUIDED failed: requires position",
    ] {
        assert!(said.contains(&words), "{words:?} in {said:?}");
    }
}

#[test]
fn the_reason_is_said_every_thirty_seconds_while_it_lasts() {
    for mut flight in [Flight::copter(), Flight::rover()] {
        flight.set("BATT_LOW_MAH", 6000.0);
        flight.run(14);
        let said = "PreArm: Battery 1 low capacity failsafe";
        assert!(
            !flight.texts().contains(&said),
            "it waits a little after power-up"
        );
        flight.run(35);
        let times = flight.texts().iter().filter(|text| **text == said).count();
        assert_eq!(times, 2, "at 15 s and at 45 s: {:?}", flight.texts());
        flight.set("BATT_LOW_MAH", 0.0);
        assert_eq!(flight.said_within(40), [""; 0]);
    }
}

#[test]
fn a_command_has_the_checks_said_at_once() {
    let mut flight = Flight::rover();
    flight.run(3);
    flight.set("ARMING_MIS_ITEMS", 64.0);
    flight.command(cmd::RUN_PREARM_CHECKS, [0.0; 7]);
    assert!(
        flight
            .texts()
            .contains(&"PreArm: Missing mission item: RTL"),
        "{:?}",
        flight.texts()
    );
    flight.upload(vec![
        waypoint(1.0, 0.0, 0.0),
        command_item(cmd::NAV_RETURN_TO_LAUNCH, [0.0; 4], 0.0),
    ]);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
}

/// Arms with a parameter set so; returns what it says.
fn attempt(mut flight: Flight, name: &str, value: f32, mode: u32) -> Vec<String> {
    flight.run(3);
    flight.mode(mode);
    flight.set(name, value);
    flight.heard.clear();
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_FAILED, "{name}");
    flight
        .texts()
        .iter()
        .map(|text| (*text).to_owned())
        .collect()
}

#[test]
fn each_check_says_its_reason() {
    let copter = |name, value, mode| attempt(Flight::copter(), name, value, mode);
    let rover = |name, value, mode| attempt(Flight::rover(), name, value, mode);
    assert_eq!(copter("ANGLE_MAX", 900.0, 0), ["Arm: Check ANGLE_MAX"]);
    assert_eq!(copter("GPS_HDOP_GOOD", 50.0, 4), ["Arm: High GPS HDOP"]);
    assert_eq!(
        copter("BATT_ARM_VOLT", 17.0, 0),
        ["Arm: Battery 1 below minimum arming voltage"]
    );
    assert_eq!(
        rover("BATT_CRT_MAH", 800.0, 0),
        ["Arm: Battery 1 capacity failsafe critical >= low"]
    );
    assert_eq!(
        rover("BATT_LOW_VOLT", 13.0, 0),
        ["Arm: Battery 1 low voltage failsafe"]
    );
    assert_eq!(
        copter("ARMING_MIS_ITEMS", 8.0, 0),
        ["Arm: Missing mission item: takeoff"]
    );
    assert_eq!(
        copter("BATT_LOW_TIMER", 10.0, 6),
        ["Arm: RTL mode not armable"]
    );
    assert_eq!(
        copter("BATT_LOW_TIMER", 10.0, 3),
        ["Arm: AUTO mode not armable"]
    );
    assert_eq!(rover("BATT_LOW_TIMER", 10.0, 11), ["Arm: Mode not armable"]);
    // Two things are wrong at once: both are said.
    let mut flight = Flight::copter();
    flight.set("ANGLE_MAX", 9000.0);
    let both = attempt(flight, "BATT_ARM_MAH", 6000.0, 0);
    assert_eq!(
        both,
        [
            "Arm: Check ANGLE_MAX",
            "Arm: Battery 1 below minimum arming capacity"
        ]
    );
}

#[test]
fn a_check_that_is_not_wanted_is_not_made() {
    for (check, named) in [
        (8.0, "GPS_HDOP_GOOD"),
        (32.0, "ANGLE_MAX"),
        (256.0, "BATT_ARM_VOLT"),
    ] {
        let mut flight = Flight::copter();
        flight.run(3);
        flight.mode(4);
        for (name, value) in [
            ("GPS_HDOP_GOOD", 50.0),
            ("ANGLE_MAX", 900.0),
            ("BATT_ARM_VOLT", 17.0),
        ] {
            flight.set(name, value);
        }
        flight.set("ARMING_CHECK", check);
        flight.heard.clear();
        assert_eq!(flight.arm(), MavResult::MAV_RESULT_FAILED);
        assert_eq!(
            flight.texts().len(),
            1,
            "only {named}: {:?}",
            flight.texts()
        );
        flight.set("ARMING_CHECK", 4.0);
        assert_eq!(
            flight.arm(),
            MavResult::MAV_RESULT_ACCEPTED,
            "the compass is well"
        );
    }
}

#[test]
fn whoever_insists_arms_against_the_checks_but_not_without_a_position() {
    for magic in [21196.0, 2989.0] {
        let mut flight = Flight::copter();
        flight.run(3);
        flight.mode(4);
        flight.set("BATT_LOW_MAH", 6000.0);
        flight.set("SIM_GPS_DISABLE", 1.0);
        let insist = [1.0, magic, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(
            flight.command(cmd::COMPONENT_ARM_DISARM, insist),
            MavResult::MAV_RESULT_FAILED
        );
        assert!(
            flight.texts().contains(&"Arm: Need Position Estimate"),
            "{:?}",
            flight.texts()
        );
        flight.set("SIM_GPS_DISABLE", 0.0);
        flight.run(1);
        assert_eq!(flight.arm(), MavResult::MAV_RESULT_FAILED);
        assert_eq!(
            flight.command(cmd::COMPONENT_ARM_DISARM, insist),
            MavResult::MAV_RESULT_ACCEPTED
        );
    }
    let mut flight = Flight::rover();
    flight.run(3);
    flight.set("ARMING_CHECK", 0.0);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    let said = ["Warning: Arming Checks Disabled", "Throttle armed"];
    assert!(flight.texts().ends_with(&said), "{:?}", flight.texts());
}

#[test]
fn a_flying_copter_is_disarmed_only_by_insisting_and_a_rover_at_any_time() {
    let disarm = |magic| [0.0, magic, 0.0, 0.0, 0.0, 0.0, 0.0];
    let mut copter = Flight::copter().airborne();
    assert_eq!(
        copter.command(cmd::COMPONENT_ARM_DISARM, disarm(0.0)),
        MavResult::MAV_RESULT_FAILED
    );
    assert!(copter.autopilot.is_armed());
    assert_eq!(
        copter.command(cmd::COMPONENT_ARM_DISARM, disarm(21196.0)),
        MavResult::MAV_RESULT_ACCEPTED
    );
    copter.run(3);
    assert!(copter.height() < 0.01, "it falls");
    assert_eq!(copter.texts(), ["Disarming motors"]);
    let mut rover = Flight::rover().airborne();
    rover.go(20.0, 0.0, 0.0);
    rover.run(3);
    assert_eq!(
        rover.command(cmd::COMPONENT_ARM_DISARM, disarm(0.0)),
        MavResult::MAV_RESULT_ACCEPTED
    );
    assert_eq!(rover.texts(), ["Throttle disarmed"]);
}

#[test]
fn auto_wants_a_mission_and_a_copter_on_the_ground_one_that_begins_with_a_takeoff() {
    let mut rover = Flight::rover();
    rover.run(3);
    assert_eq!(rover.mode(10), MavResult::MAV_RESULT_FAILED);
    assert_eq!(
        rover.texts(),
        ["No Mission. Can't set AUTO.", "Flight mode change failed"]
    );
    let mut copter = Flight::copter();
    copter.run(3);
    assert_eq!(copter.arm(), MavResult::MAV_RESULT_ACCEPTED);
    copter.heard.clear();
    assert_eq!(copter.mode(3), MavResult::MAV_RESULT_FAILED);
    assert_eq!(copter.texts(), ["Mode change to AUTO failed: init failed"]);
    copter.upload(vec![waypoint(1.0, 1.0, 2.0), waypoint(2.0, 1.0, 2.0)]);
    copter.heard.clear();
    assert_eq!(copter.mode(3), MavResult::MAV_RESULT_FAILED);
    assert_eq!(
        copter.texts(),
        [
            "Auto: Missing Takeoff Cmd",
            "Mode change to AUTO failed: init failed"
        ]
    );
}

#[test]
fn a_copter_may_be_armed_in_auto_if_its_options_say_so() {
    let mut flight = Flight::copter();
    flight.upload(survey());
    flight.run(3);
    flight.set("AUTO_OPTIONS", 1.0);
    assert_eq!(flight.mode(3), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(
        flight.arm(),
        MavResult::MAV_RESULT_ACCEPTED,
        "{:?}",
        flight.texts()
    );
}
