//! A fence that is breached.

use mavlink_ext::dialect::tandem::{
    FENCE_STATUS_DATA, FenceBreach, MISSION_COUNT_DATA, MISSION_REQUEST_LIST_DATA, MavMissionType,
};

use super::*;

const FENCE: MavMissionType = MavMissionType::MAV_MISSION_TYPE_FENCE;

/// Uploads a fence as a ground station does; returns the result.
fn upload_fence(flight: &mut Flight, items: &[MissionItem]) -> MavMissionResult {
    let target = flight.autopilot.address();
    flight.tell(&Message::MISSION_COUNT(MISSION_COUNT_DATA {
        count: items.len() as u16,
        target_system: target.system.0,
        target_component: target.component.0,
        mission_type: FENCE,
        ..MISSION_COUNT_DATA::default()
    }));
    for (seq, item) in items.iter().enumerate() {
        flight.tell(&Message::MISSION_ITEM_INT(
            item.to_message(seq as u16, target, FENCE),
        ));
    }
    let result = flight.last(|message| match message {
        Message::MISSION_ACK(ack) if ack.mission_type == FENCE => Some(ack.mavtype),
        _ => None,
    });
    result.expect("an acknowledgement")
}

fn zone_item(command: u16, first: f32, [x, y]: [f64; 2]) -> MissionItem {
    MissionItem {
        command,
        params: [first, 0.0, 0.0, 0.0],
        ..waypoint(x, y, 0.0)
    }
}

/// A square to stay within, of that half an edge.
fn square(half_m: f64) -> Vec<MissionItem> {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let item = |[x, y]: [f64; 2]| {
        zone_item(
            cmd::NAV_FENCE_POLYGON_VERTEX_INCLUSION,
            4.0,
            [x * half_m, y * half_m],
        )
    };
    corners.map(item).to_vec()
}

fn status(flight: &Flight) -> Option<FENCE_STATUS_DATA> {
    flight.last(|message| match message {
        Message::FENCE_STATUS(status) => Some(status.clone()),
        _ => None,
    })
}

/// Flies it out of a circle of 4 m with that action.
fn fly_out(action: f32) -> Flight {
    let mut flight = Flight::copter().airborne();
    flight.set("FENCE_ACTION", action);
    flight.go(20.0, 0.0, 2.0);
    flight.set("FENCE_RADIUS", 4.0);
    flight.set("FENCE_ENABLE", 1.0);
    flight.until("breach", |autopilot| !autopilot.fence.breached().is_empty());
    flight
}

#[test]
fn a_copter_says_which_part_is_breached_and_does_what_the_action_says() {
    for (action, mode) in [
        (0.0, Mode::Guided),
        (1.0, Mode::Rtl),
        (2.0, Mode::Land),
        (3.0, Mode::Rtl),
        (4.0, Mode::Brake),
        (5.0, Mode::Land),
    ] {
        let mut flight = fly_out(action);
        let mut said = vec!["Circle fence breached"];
        if action > 0.0 {
            said.push("Manual recovery started");
        }
        assert_eq!(flight.texts(), said);
        assert_eq!(flight.autopilot.mode(), mode, "action {action}");
        let told = status(&flight).expect("it is told at once");
        assert_eq!(told.breach_status, 1);
        assert_eq!(
            (told.breach_count, told.breach_type),
            (1, FenceBreach::FENCE_BREACH_BOUNDARY)
        );
        assert!(told.breach_time > 11_000, "{} ms", told.breach_time);
        flight.run(1);
        assert_eq!(
            flight.is_healthy(MavSysStatusSensor::MAV_SYS_STATUS_GEOFENCE),
            Some(false)
        );
    }
}

#[test]
fn back_inside_the_breach_is_cleared() {
    let mut flight = fly_out(1.0);
    flight.until("return", |autopilot| autopilot.fence.breached().is_empty());
    assert!(
        flight.texts().contains(&"Fence breach cleared"),
        "{:?}",
        flight.texts()
    );
    flight.run(1);
    assert_eq!(status(&flight).map(|told| told.breach_status), Some(0));
    flight.until("landing", |autopilot| !autopilot.is_armed());
    assert!(flight.distance_to(-0.6, 0.0) < 0.4);
    assert_eq!(
        flight.is_healthy(MavSysStatusSensor::MAV_SYS_STATUS_GEOFENCE),
        Some(true)
    );
}

#[test]
fn the_ceiling_is_for_the_return_too() {
    let mut flight = Flight::copter().airborne();
    flight.set("RTL_ALT", 1500.0);
    flight.set("FENCE_MARGIN", 1.0);
    flight.set("FENCE_ALT_MAX", 4.0);
    flight.set("FENCE_ENABLE", 1.0);
    flight.run(1);
    assert_eq!(
        flight.go(3.0, 0.0, 5.0),
        MavResult::MAV_RESULT_FAILED,
        "there it must not go"
    );
    assert_eq!(flight.go(3.0, 0.0, 3.9), MavResult::MAV_RESULT_ACCEPTED);
    flight.run(10);
    flight.mode(6);
    let mut highest = 0.0_f64;
    for _ in 0..3000 {
        flight.step();
        highest = highest.max(flight.height());
    }
    assert!(highest < 4.1 && !flight.autopilot.is_armed(), "{highest} m");
    assert!(
        !flight.texts().contains(&"Max Alt fence breached"),
        "{:?}",
        flight.texts()
    );
}

#[test]
fn above_the_ceiling_a_copter_turns_back() {
    let mut flight = Flight::copter().airborne();
    flight.go(-0.6, 0.0, 6.0);
    flight.set("FENCE_ALT_MAX", 4.0);
    flight.set("FENCE_ENABLE", 1.0);
    flight.until("breach", |autopilot| !autopilot.fence.breached().is_empty());
    assert_eq!(
        flight.texts(),
        ["Max Alt fence breached", "Manual recovery started"]
    );
    let told = status(&flight).map(|told| told.breach_type);
    assert_eq!(told, Some(FenceBreach::FENCE_BREACH_MAXALT));
    assert_eq!(flight.autopilot.mode(), Mode::Rtl);
}

#[test]
fn a_rover_says_no_more_than_that_a_recovery_began_and_does_what_the_action_says() {
    for (action, mode) in [
        (0.0, Mode::Guided),
        (1.0, Mode::Rtl),
        (2.0, Mode::Hold),
        (3.0, Mode::Rtl),
        (4.0, Mode::Hold),
    ] {
        let mut flight = Flight::rover();
        assert_eq!(
            upload_fence(&mut flight, &square(3.0)),
            MavMissionResult::MAV_MISSION_ACCEPTED
        );
        let mut flight = flight.airborne();
        flight.set("FENCE_ACTION", action);
        flight.set("FENCE_ENABLE", 1.0);
        flight.go(10.0, 0.0, 0.0);
        flight.until("breach", |autopilot| !autopilot.fence.breached().is_empty());
        let said: &[&str] = if action > 0.0 {
            &["Manual recovery started"]
        } else {
            &[]
        };
        assert_eq!(flight.texts(), said);
        assert_eq!(flight.autopilot.mode(), mode, "action {action}");
        assert_eq!(status(&flight).map(|told| told.breach_status), Some(1));
        let out_m = flight.autopilot.truth().position().raw.x;
        assert!((out_m - 3.0).abs() < 0.3, "{out_m} m");
    }
}

#[test]
fn a_vehicle_outside_of_its_fence_is_not_armed() {
    for mut flight in [Flight::copter(), Flight::rover()] {
        let keep_out = zone_item(cmd::NAV_FENCE_CIRCLE_EXCLUSION, 2.0, [0.0, 0.0]);
        upload_fence(&mut flight, &[keep_out]);
        flight.set("FENCE_ENABLE", 1.0);
        flight.run(3);
        flight.heard.clear();
        assert_eq!(flight.arm(), MavResult::MAV_RESULT_FAILED);
        assert_eq!(flight.texts(), ["Arm: Vehicle breaching Polygon fence"]);
        flight.set("FENCE_ENABLE", 0.0);
        flight.run(1);
        assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    }
}

#[test]
fn commands_and_missions_switch_the_fence_and_leave_the_parameter() {
    let mut flight = Flight::copter();
    flight.run(3);
    flight.heard.clear();
    let switch = |on, parts| [on, parts, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(
        flight.command(cmd::DO_FENCE_ENABLE, switch(1.0, 0.0)),
        MavResult::MAV_RESULT_ACCEPTED
    );
    flight.command(cmd::DO_FENCE_ENABLE, switch(0.0, 2.0));
    assert_eq!(
        flight.command(cmd::DO_FENCE_ENABLE, switch(2.0, 0.0)),
        MavResult::MAV_RESULT_DENIED,
        "no floor"
    );
    assert_eq!(
        flight.texts(),
        [
            "Max Alt, Circle and Polygon fences enabled",
            "Circle fence disabled"
        ]
    );
    assert!(flight.autopilot.parameter(Parameter::FenceEnable) < 0.5);
    let mut rover = Flight::rover();
    let on = command_item(cmd::DO_FENCE_ENABLE, [1.0, 0.0, 0.0, 0.0], 0.0);
    rover.upload(vec![on, waypoint(2.0, 0.0, 0.0), waypoint(3.0, 0.0, 0.0)]);
    let mut rover = rover.airborne();
    rover.mode(10);
    rover.run(1);
    assert_eq!(rover.texts(), ["Circle and Polygon fences enabled"]);
}

#[test]
fn a_fence_is_read_back_apart_from_the_mission_and_cleared_with_it() {
    let mut flight = Flight::rover();
    flight.upload(vec![waypoint(2.0, 0.0, 0.0)]);
    upload_fence(&mut flight, &square(3.0));
    assert_eq!(
        upload_fence(&mut flight, &square(3.0)[..2]),
        MavMissionResult::MAV_MISSION_ERROR
    );
    let count = |flight: &mut Flight, mission_type| {
        let target = flight.autopilot.address();
        flight.tell(&Message::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
            target_system: target.system.0,
            target_component: target.component.0,
            mission_type,
        }));
        match flight.heard.last() {
            Some(Message::MISSION_COUNT(count)) if count.mission_type == mission_type => {
                count.count
            }
            other => panic!("{other:?}"),
        }
    };
    let kinds = [
        MavMissionType::MAV_MISSION_TYPE_MISSION,
        FENCE,
        MavMissionType::MAV_MISSION_TYPE_RALLY,
    ];
    assert_eq!(kinds.map(|kind| count(&mut flight, kind)), [1, 4, 0]);
    let target = flight.autopilot.address();
    let before = flight.heard.len();
    flight.tell(&Message::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: target.system.0,
        target_component: target.component.0,
        mission_type: MavMissionType::MAV_MISSION_TYPE_ALL,
    }));
    let acks = flight.heard[before..]
        .iter()
        .filter(|m| matches!(m, Message::MISSION_ACK(_)))
        .count();
    assert_eq!(acks, 1, "one answer for all of it");
    assert_eq!(kinds.map(|kind| count(&mut flight, kind)), [0; 3]);
}
