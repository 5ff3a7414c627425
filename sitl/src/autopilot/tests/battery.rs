//! A battery that runs low in flight.

use mavlink_ext::dialect::tandem::MavBatteryChargeState;

use super::*;

fn charge_state(flight: &Flight) -> Option<MavBatteryChargeState> {
    flight.last(|message| match message {
        Message::BATTERY_STATUS(status) => Some(status.charge_state),
        _ => None,
    })
}

/// Lets the battery of an armed vehicle run low with that action; returns what it says.
fn run_low(flight: &mut Flight, action: f32) -> Vec<String> {
    flight.set("BATT_FS_LOW_ACT", action);
    flight.set("BATT_LOW_MAH", 6000.0);
    flight.said_within(2)
}

/// `Battery 1 is low 16.72V used 17 mAh`, without its numbers.
fn without_numbers(text: &str) -> String {
    text.chars().filter(|c| !c.is_ascii_digit()).collect()
}

#[test]
fn a_copter_says_how_its_battery_is_and_does_what_the_action_says() {
    for (action, mode, more) in [
        (0.0, Mode::Guided, None),
        (1.0, Mode::Land, None),
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
        (6.0, Mode::Rtl, Some("Trying RTL Mode")),
        (7.0, Mode::Brake, None),
    ] {
        let mut flight = Flight::copter().airborne();
        let said = run_low(&mut flight, action);
        assert_eq!(
            without_numbers(&said[0]),
            "Battery  is low .V used  mAh",
            "{said:?}"
        );
        let expected: Vec<&str> = std::iter::once("Battery Failsafe").chain(more).collect();
        assert_eq!(said[1..], expected);
        assert_eq!(flight.autopilot.mode(), mode, "action {action}");
        assert_eq!(
            charge_state(&flight),
            Some(MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_LOW)
        );
        assert_eq!(
            flight.is_healthy(MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_BATTERY),
            Some(false)
        );
    }
}

#[test]
fn a_copter_can_be_told_to_stop_its_motors() {
    let mut flight = Flight::copter().airborne();
    run_low(&mut flight, 5.0);
    assert!(!flight.autopilot.is_armed() && flight.height() < 0.01);
}

#[test]
fn a_rover_says_one_line_and_does_what_the_action_says() {
    for (action, mode) in [
        (0.0, Mode::Guided),
        (1.0, Mode::Rtl),
        (2.0, Mode::Hold),
        (3.0, Mode::Rtl),
        (4.0, Mode::Hold),
    ] {
        let mut flight = Flight::rover().airborne();
        flight.go(20.0, 0.0, 0.0);
        flight.run(3);
        let said = run_low(&mut flight, action);
        assert_eq!(said.len(), 1, "{said:?}");
        assert_eq!(without_numbers(&said[0]), "Battery  is low .V used  mAh");
        assert_eq!(flight.autopilot.mode(), mode, "action {action}");
        assert!(flight.autopilot.is_armed());
    }
    let mut flight = Flight::rover().airborne();
    run_low(&mut flight, 5.0);
    assert!(!flight.autopilot.is_armed());
}

#[test]
fn a_failsafe_that_lands_hovers_for_four_seconds_first() {
    let mut flight = Flight::copter().airborne();
    run_low(&mut flight, 1.0);
    flight.run(1);
    assert!(flight.height() > 1.7, "{} m", flight.height());
    flight.until("landing", |autopilot| !autopilot.is_armed());
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_FAILED);
    let said = flight.texts().join("; ");
    for reason in [
        "Arm: Battery 1 low capacity failsafe",
        "Arm: Battery failsafe",
    ] {
        assert!(said.contains(reason), "{reason} in {said}");
    }
}

#[test]
fn a_voltage_has_to_be_too_low_for_ten_seconds() {
    for mut flight in [Flight::copter().airborne(), Flight::rover().airborne()] {
        flight.set("BATT_CRT_VOLT", 10.0);
        flight.set("BATT_FS_CRT_ACT", 2.0);
        flight.set("SIM_BATT_VOLTAGE", 9.5);
        flight.run(9);
        assert_eq!(flight.texts(), [""; 0]);
        flight.run(3);
        let said = flight.texts();
        assert!(
            said[0].starts_with("Battery 1 is critical 9.50V used "),
            "{said:?}"
        );
        let kind = flight.autopilot.kind;
        let expected = if kind == Kind::Copter {
            Mode::Rtl
        } else {
            Mode::Hold
        };
        assert_eq!(flight.autopilot.mode(), expected);
        let critical = MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_CRITICAL;
        assert_eq!(charge_state(&flight), Some(critical));
    }
}

#[test]
fn a_critical_battery_does_not_undo_what_a_low_one_did_with_less_urgency() {
    let mut flight = Flight::copter().airborne();
    flight.set("BATT_FS_CRT_ACT", 2.0);
    run_low(&mut flight, 1.0);
    flight.set("BATT_CRT_MAH", 5900.0);
    let said = flight.said_within(1);
    assert!(said[0].starts_with("Battery 1 is critical"), "{said:?}");
    assert_eq!(said.len(), 1, "landing is more urgent than returning");
    assert_eq!(flight.autopilot.mode(), Mode::Land);
}

#[test]
fn an_armed_copter_on_the_ground_is_disarmed() {
    let mut flight = Flight::copter();
    flight.run(3);
    flight.arm();
    let said = run_low(&mut flight, 2.0);
    assert_eq!(
        said[1..],
        ["Disarming motors", "Battery Failsafe - Disarming"]
    );
}

#[test]
fn a_landing_goes_on_if_the_options_say_so() {
    let mut flight = Flight::copter().airborne();
    flight.mode(9);
    flight.run(1);
    flight.set("FS_OPTIONS", 8.0);
    let said = run_low(&mut flight, 2.0);
    assert_eq!(said[1..], ["Battery Failsafe - Continuing Landing"]);
    assert_eq!(flight.autopilot.mode(), Mode::Land);
}

#[test]
fn a_battery_is_low_until_it_is_replaced() {
    let mut flight = Flight::copter();
    flight.run(3);
    flight.arm();
    run_low(&mut flight, 1.0);
    flight.set("BATT_LOW_MAH", 700.0);
    flight.run(1);
    assert_eq!(
        flight.arm(),
        MavResult::MAV_RESULT_FAILED,
        "it is remembered"
    );
    let reset = |mask, percent| [mask, percent, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(
        flight.command(42_651, reset(2.0, 100.0)),
        MavResult::MAV_RESULT_DENIED,
        "no second one"
    );
    assert_eq!(
        flight.command(42_651, reset(1.0, 101.0)),
        MavResult::MAV_RESULT_DENIED
    );
    assert_eq!(
        flight.command(42_651, reset(1.0, 80.0)),
        MavResult::MAV_RESULT_ACCEPTED
    );
    assert!((flight.autopilot.battery_share() - 0.8).abs() < 0.01);
    assert_eq!(
        flight.arm(),
        MavResult::MAV_RESULT_ACCEPTED,
        "{:?}",
        flight.texts()
    );
}

#[test]
fn a_low_battery_brings_a_copter_home_from_its_mission() {
    let mut flight = Flight::copter();
    flight.upload(survey());
    flight.set("BATT_FS_LOW_ACT", 2.0);
    flight.run(3);
    flight.mode(4);
    flight.arm();
    flight.command(cmd::MISSION_START, [0.0; 7]);
    flight.run(5);
    flight.set("BATT_LOW_MAH", 6000.0);
    flight.run(1);
    assert_eq!(flight.autopilot.mode(), Mode::Rtl);
    flight.until("landing", |autopilot| !autopilot.is_armed());
    assert!(
        flight.distance_to(-0.6, 0.0) < 0.4,
        "{} m from home",
        flight.distance_to(-0.6, 0.0)
    );
}
