//! Orders to vehicles, and what the vehicles make of them.

use super::*;

#[test]
fn a_denied_arming_shows_why() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    bench.command(Command::Order(SystemId(2), Order::Arm));
    bench.answer(
        ROVER,
        cmd::COMPONENT_ARM_DISARM,
        MavResult::MAV_RESULT_FAILED,
    );
    bench.say(
        ROVER,
        MavSeverity::MAV_SEVERITY_CRITICAL,
        "Arm: GPS 1: Bad fix",
    );
    let order = bench.model().orders.iter().next().expect("one order");
    assert_eq!(
        order.failure().as_deref(),
        Some("denied: it failed (Arm: GPS 1: Bad fix)")
    );
    assert!(!bench.model().vehicles[&SystemId(2)].is_armed());
}

#[test]
fn armed_is_shown_when_the_heartbeat_says_so_and_not_when_it_is_acknowledged() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    bench.command(Command::Order(SystemId(2), Order::Arm));
    bench.answer(
        ROVER,
        cmd::COMPONENT_ARM_DISARM,
        MavResult::MAV_RESULT_ACCEPTED,
    );
    bench.silence(Duration::from_millis(200));
    let order = bench
        .model()
        .orders
        .iter()
        .next()
        .expect("one order")
        .clone();
    assert_eq!(
        (order.state, order.confirmed_at),
        (OrderState::Accepted, None)
    );
    assert!(!bench.model().vehicles[&SystemId(2)].is_armed());
    bench.heartbeat(ROVER, MavType::MAV_TYPE_GROUND_ROVER, true, 4);
    bench.silence(Duration::from_millis(100));
    assert!(bench.model().vehicles[&SystemId(2)].is_armed());
    assert!(
        bench
            .model()
            .orders
            .iter()
            .next()
            .is_some_and(|order| order.confirmed_at.is_some())
    );
}

#[test]
fn an_accepted_order_without_effect_is_a_caution() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    bench.command(Command::Order(SystemId(2), Order::Arm));
    bench.answer(
        ROVER,
        cmd::COMPONENT_ARM_DISARM,
        MavResult::MAV_RESULT_ACCEPTED,
    );
    for _ in 0..6 {
        bench.silence(Duration::from_secs(1));
        bench.rover();
    }
    let text = "UGV 2: accepted \"Arm\", but telemetry does not show it".to_owned();
    assert_eq!(bench.alerts(), [(Level::Caution, text)]);
}

#[test]
fn an_order_is_repeated_and_then_given_up() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    bench.command(Command::Order(SystemId(2), Order::Arm));
    bench.silence(Duration::from_millis(1600));
    let state = |bench: &Bench| {
        bench
            .model()
            .orders
            .iter()
            .next()
            .map(|order| order.state.clone())
    };
    assert_eq!(state(&bench), Some(OrderState::Sent { attempt: 2, of: 4 }));
    bench.silence(Duration::from_secs(10));
    assert_eq!(state(&bench), Some(OrderState::NoAnswer));
}

#[test]
fn a_newer_order_ends_the_repetitions_of_one_that_is_not_answered() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    bench.command(Command::Order(SystemId(2), Order::Arm));
    bench.silence(Duration::from_millis(500));
    bench.command(Command::Order(SystemId(2), Order::Disarm));
    bench.sent.clear();
    bench.silence(Duration::from_secs(4));
    // Of the same number: only what is wanted now is repeated.
    let disarms = bench.sent.iter().filter_map(|message| match message {
        Message::COMMAND_LONG(long) if long.command == cmd::COMPONENT_ARM_DISARM => {
            Some(long.param1)
        }
        _ => None,
    });
    let disarms: Vec<f32> = disarms.collect();
    assert!(
        !disarms.is_empty() && disarms.iter().all(|arm| *arm == 0.0),
        "{disarms:?}"
    );
    let states: Vec<_> = (bench.model().orders.iter())
        .map(|sent| (sent.order, sent.state.clone()))
        .collect();
    assert!(
        states.contains(&(Order::Arm, OrderState::Superseded)),
        "{states:?}"
    );
}

#[test]
fn taking_off_means_guided_mode_first() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    let takeoff = Order::Takeoff { altitude_m: 2.0 };
    bench.command(Command::Order(SystemId(1), takeoff));
    let refused = bench
        .model()
        .orders
        .iter()
        .next()
        .map(|order| order.state.clone());
    assert_eq!(
        refused,
        Some(OrderState::Refused(
            "UAV 1 is not armed: arm it first".into()
        ))
    );
    bench.heartbeat(COPTER, MavType::MAV_TYPE_QUADROTOR, true, 0);
    bench.command(Command::Order(SystemId(1), takeoff));
    let mode = bench
        .sent_command(COPTER, cmd::DO_SET_MODE)
        .expect("the mode is set");
    assert_eq!(mode.params[1].to_bits(), 4_f32.to_bits());
    assert!(
        bench.sent_command(COPTER, cmd::NAV_TAKEOFF).is_none(),
        "not before it is accepted"
    );
    bench.answer(COPTER, cmd::DO_SET_MODE, MavResult::MAV_RESULT_ACCEPTED);
    let climb = bench
        .sent_command(COPTER, cmd::NAV_TAKEOFF)
        .expect("then it climbs");
    assert!((climb.z - 2.0).abs() < 1e-6);
}

#[test]
fn a_vehicle_is_told_the_numbers_of_its_own_firmware_or_none() {
    let mut bench = Bench::new(Source::Live);
    let mut beat = |autopilot, custom_mode| {
        let heartbeat = HEARTBEAT_DATA {
            custom_mode,
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot,
            mavlink_version: 3,
            ..HEARTBEAT_DATA::default()
        };
        bench.hear(COPTER, &Message::HEARTBEAT(heartbeat));
        bench.command(Command::Order(SystemId(1), Order::ReturnToLaunch));
        let vehicle = &bench.model().vehicles[&SystemId(1)];
        let mode = vehicle.heartbeat.value.mode.to_string();
        let told = bench.sent_command(COPTER, cmd::DO_SET_MODE);
        if told.is_some() {
            bench.answer(COPTER, cmd::DO_SET_MODE, MavResult::MAV_RESULT_ACCEPTED);
        }
        bench.sent.clear();
        (mode, told.map(|told| told.params[..3].to_vec()))
    };
    let px4_hold = 3 << 24 | 4 << 16;
    let px4 = beat(MavAutopilot::MAV_AUTOPILOT_PX4, px4_hold);
    assert_eq!(px4, ("HOLD".into(), Some(vec![1.0, 4.0, 5.0])));
    let other = beat(MavAutopilot::MAV_AUTOPILOT_GENERIC, 9);
    assert_eq!(other, ("MODE 9".into(), None));
}

#[test]
fn a_height_above_sea_level_does_not_stand_in_for_one_above_home() {
    let mut bench = Bench::new(Source::Live);
    bench.heartbeat(ROVER, MavType::MAV_TYPE_GROUND_ROVER, false, 4);
    let position = |relative_alt| {
        Message::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            lat: ORIGIN_E7[0],
            lon: ORIGIN_E7[1],
            alt: 584_000,
            relative_alt,
            ..GLOBAL_POSITION_INT_DATA::default()
        })
    };
    bench.hear(ROVER, &position(584_000));
    assert!(bench.model().map.origin.is_none(), "it has no home yet");
    bench.hear(ROVER, &position(100));
    let place = bench.model().vehicles[&SystemId(2)].position;
    let height_m = place.map(|place| place.value.raw.z).expect("on the map");
    assert!((height_m - 0.1).abs() < 1e-3, "{height_m}");
}

#[test]
fn an_order_to_a_lost_vehicle_is_not_sent_unless_it_is_safe() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    bench.silence(Duration::from_secs(5));
    bench.command(Command::Order(SystemId(2), Order::Arm));
    let failure = bench
        .model()
        .orders
        .iter()
        .next()
        .and_then(crate::model::orders::SentOrder::failure);
    assert_eq!(
        failure.as_deref(),
        Some("not sent: the link to UGV 2 is lost")
    );
    bench.command(Command::Order(SystemId(2), Order::Hold));
    assert!(bench.sent_command(ROVER, cmd::DO_SET_MODE).is_some());
}
