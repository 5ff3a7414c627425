use std::time::Duration;

use maps::time::Stamp;

use super::*;
use crate::dialect::cmd;
use crate::service::Step;

const OWN: Address = Address::new(255, 190);
const ROVER: Address = Address::new(2, 1);
const ARM: fn() -> Request = || Request::long(cmd::COMPONENT_ARM_DISARM, &[1.0]);

fn at(millis: u64) -> Stamp {
    Stamp::ZERO + Duration::from_millis(millis)
}

fn answer(message: &Message, result: MavResult) -> Message {
    Incoming::parse(ROVER, OWN, message)
        .expect("a command for the rover")
        .ack(result)
}

#[test]
fn a_lost_command_is_repeated_with_its_confirmation_counted_up() {
    let mut client = Client::new(OWN);
    let first = client
        .start(at(0), ROVER, ARM())
        .expect("nothing under way");
    assert_eq!(
        client.start(at(1), ROVER, ARM()),
        Err(CommandError::UnderWay { command: 400 })
    );
    let again = client.tick(at(1500)).send;
    let confirmation = |message: &Message| {
        Incoming::parse(ROVER, OWN, message).map(|command| command.confirmation)
    };
    assert_eq!(confirmation(&first), Some(0));
    assert_eq!(
        again.iter().map(confirmation).collect::<Vec<_>>(),
        [Some(1)]
    );
    let accepted = answer(&again[0], MavResult::MAV_RESULT_ACCEPTED);
    let outcome = client.handle(at(1600), ROVER, &accepted).events;
    assert_eq!(outcome[0].result, Ok(()));
    assert!(client.tick(at(60_000)).send.is_empty(), "it is over");
}

#[test]
fn silence_ends_after_four_tries() {
    let mut client = Client::new(OWN);
    client
        .start(at(0), ROVER, ARM())
        .expect("nothing under way");
    let mut sent = 1;
    let mut outcomes = Vec::new();
    for tick in 0..200 {
        let step = client.tick(at(tick * 100));
        sent += step.send.len();
        outcomes.extend(step.events);
    }
    assert_eq!(sent, 4);
    assert_eq!(outcomes.len(), 1);
    assert_eq!(outcomes[0].result, Err(CommandError::NoAnswer { tries: 4 }));
}

#[test]
fn progress_lengthens_the_wait_and_a_refusal_ends_it() {
    let mut client = Client::new(OWN);
    let message = client
        .start(at(0), ROVER, ARM())
        .expect("nothing under way");
    let in_progress = answer(&message, MavResult::MAV_RESULT_IN_PROGRESS);
    assert_eq!(client.handle(at(100), ROVER, &in_progress), Step::none());
    assert_eq!(client.tick(at(9_000)), Step::none(), "not repeated");
    let denied = answer(&message, MavResult::MAV_RESULT_DENIED);
    let other = Address::new(1, 1);
    assert_eq!(client.handle(at(9_500), other, &denied), Step::none());
    let step = client.handle(at(9_500), ROVER, &denied);
    let result = MavResult::MAV_RESULT_DENIED;
    assert_eq!(step.events[0].result, Err(CommandError::Refused { result }));
}

const TAKEOFF: fn() -> Request = || Request::long(cmd::NAV_TAKEOFF, &[]);
const RETURN: fn() -> Request = || Request::long(cmd::NAV_RETURN_TO_LAUNCH, &[]);
const MODE: fn(f32) -> Request = |mode| Request::long(cmd::DO_SET_MODE, &[1.0, mode]);

/// A command that the rover has said to be at since 0.1 s.
fn in_progress() -> (Client, Incoming) {
    let mut client = Client::new(OWN);
    let message = client
        .start(at(0), ROVER, ARM())
        .expect("nothing under way");
    let command = Incoming::parse(ROVER, OWN, &message).expect("a command for the rover");
    client.handle(at(100), ROVER, &command.in_progress(Some(40)));
    (client, command)
}

#[test]
fn progress_is_told_in_percent_and_unknown_is_none() {
    let (mut client, command) = in_progress();
    assert_eq!(client.progress_percent(ROVER, 400), Some(40));
    client.handle(at(200), ROVER, &command.in_progress(Some(200)));
    assert_eq!(client.progress_percent(ROVER, 400), Some(100), "at most");
    client.handle(at(300), ROVER, &command.in_progress(None));
    assert_eq!(client.progress_percent(ROVER, 400), None);
    assert_eq!(client.progress_percent(ROVER, 22), None, "not under way");
}

#[test]
fn a_command_in_progress_is_cancelled_though_the_first_cancellation_is_lost() {
    let (mut client, command) = in_progress();
    assert!(client.cancel(at(200), ROVER, 400).is_some());
    assert_eq!(client.cancel(at(200), ROVER, 22), None, "not under way");
    // Still at it: it has not heard.
    client.handle(at(500), ROVER, &command.in_progress(Some(50)));
    assert_eq!(client.tick(at(1699)), Step::none());
    let again = client.tick(at(1700)).send;
    let parsed: Vec<_> = (again.iter())
        .map(|message| Cancel::parse(ROVER, OWN, message))
        .collect();
    let expected = Cancel {
        from: OWN,
        command: 400,
    };
    assert_eq!(parsed, [Some(expected)]);
    let cancelled = command.ack(MavResult::MAV_RESULT_CANCELLED);
    let step = client.handle(at(1800), ROVER, &cancelled);
    let error = step.events[0].result.expect_err("not carried out");
    assert!(error.is_cancelled(), "{error}");
    assert_eq!(client.tick(at(60_000)), Step::none(), "it is over");
}

#[test]
fn a_command_that_ends_before_its_cancellation_is_heard_has_its_own_outcome() {
    let (mut client, command) = in_progress();
    client.cancel(at(200), ROVER, 400);
    let accepted = command.ack(MavResult::MAV_RESULT_ACCEPTED);
    let step = client.handle(at(300), ROVER, &accepted);
    assert_eq!(step.events[0].result, Ok(()));
    let cancelled = command.ack(MavResult::MAV_RESULT_CANCELLED);
    assert_eq!(client.handle(at(400), ROVER, &cancelled), Step::none());
}

/// Messages and outcomes of each 100 ms until `until_ms`.
fn run(client: &mut Client, from_ms: u64, until_ms: u64) -> Step<Outcome> {
    let mut all = Step::none();
    for millis in (from_ms..until_ms).step_by(100) {
        all.extend(client.tick(at(millis)));
    }
    all
}

#[test]
fn a_vehicle_that_cannot_cancel_carries_on_and_a_silent_one_is_given_up_after_ten_seconds() {
    let (mut client, command) = in_progress();
    client.cancel(at(200), ROVER, 400);
    let mut cancellations = 0;
    for second in 1..30 {
        client.handle(at(second * 1000), ROVER, &command.in_progress(Some(60)));
        let step = run(&mut client, second * 1000, second * 1000 + 1000);
        assert_eq!(step.events, []);
        cancellations += step.send.len();
    }
    assert_eq!(cancellations, 3, "and the first");
    assert_eq!(client.progress_percent(ROVER, 400), Some(60));
    let step = run(&mut client, 30_000, 60_000);
    assert_eq!(step.send, []);
    let result = step.events.first().map(|outcome| outcome.result);
    assert_eq!(result, Some(Err(CommandError::NoAnswer { tries: 1 })));
}

#[test]
fn a_cancelled_command_that_was_never_heard_is_not_sent_again() {
    let mut client = Client::new(OWN);
    client
        .start(at(0), ROVER, ARM())
        .expect("nothing under way");
    client.cancel(at(1400), ROVER, 400);
    let step = run(&mut client, 1400, 30_000);
    let is_cancel = |message: &Message| matches!(message, Message::COMMAND_CANCEL(_));
    assert!(step.send.iter().all(is_cancel), "{:?}", step.send);
    assert_eq!(step.events.len(), 1);
}

#[test]
fn cancellations_for_all_or_for_others_are_none() {
    let cancel = |system, component| {
        Message::COMMAND_CANCEL(crate::dialect::tandem::COMMAND_CANCEL_DATA {
            command: 400,
            target_system: system,
            target_component: component,
        })
    };
    for (message, is_ours) in [
        (cancel(2, 1), true),
        (cancel(2, 0), true),
        (cancel(0, 0), false),
        (cancel(2, 7), false),
        (cancel(1, 1), false),
        (ARM().to_message(ROVER, 0), false),
    ] {
        let parsed = Cancel::parse(ROVER, OWN, &message);
        assert_eq!(parsed.is_some(), is_ours, "{message:?}");
    }
}

#[test]
fn a_newer_command_ends_the_repetitions_of_older_ones_at_its_vehicle_only() {
    let (mut client, _) = in_progress();
    let copter = Address::new(1, 1);
    client
        .start(at(0), ROVER, TAKEOFF())
        .expect("not under way");
    client
        .start(at(0), copter, TAKEOFF())
        .expect("not under way");
    let newer = client.supersede(at(1000), ROVER, RETURN());
    let ended = newer.map(|newer| newer.ended);
    assert_eq!(ended, Ok(vec![cmd::NAV_TAKEOFF]), "arming is in progress");
    assert!(client.is_running(ROVER, 400));
    let again = client.tick(at(2499)).send;
    assert_eq!(again, [TAKEOFF().to_message(copter, 1)]);
    let again = client.tick(at(2500)).send;
    assert_eq!(again, [RETURN().to_message(ROVER, 1)]);
    // The older one was heard after all: nobody waits for it.
    let late = answer(
        &TAKEOFF().to_message(ROVER, 0),
        MavResult::MAV_RESULT_ACCEPTED,
    );
    assert_eq!(client.handle(at(2600), ROVER, &late), Step::none());
}

#[test]
fn an_answer_to_the_older_of_two_commands_of_a_number_is_not_taken_for_the_newers() {
    let mut client = Client::new(OWN);
    let older = client
        .start(at(0), ROVER, MODE(10.0))
        .expect("not under way");
    let newer = client.supersede(at(1000), ROVER, MODE(11.0));
    let newer = newer.expect("the older is not in progress");
    assert_eq!(newer.ended, [cmd::DO_SET_MODE]);
    let denied = answer(&older, MavResult::MAV_RESULT_DENIED);
    assert_eq!(client.handle(at(1100), ROVER, &denied), Step::none());
    let accepted = answer(&newer.message, MavResult::MAV_RESULT_ACCEPTED);
    let step = client.handle(at(1200), ROVER, &accepted);
    assert_eq!(step.events[0].result, Ok(()));
}

#[test]
fn where_the_older_of_two_was_lost_the_newer_is_repeated_and_then_believed() {
    let mut client = Client::new(OWN);
    client
        .start(at(0), ROVER, MODE(10.0))
        .expect("not under way");
    let newer = client.supersede(at(1000), ROVER, MODE(11.0));
    let newer = newer.expect("the older is not in progress").message;
    let accepted = answer(&newer, MavResult::MAV_RESULT_ACCEPTED);
    let step = client.handle(at(1100), ROVER, &accepted);
    assert_eq!(step, Step::none(), "it may be the older's");
    assert_eq!(client.tick(at(2500)).send.len(), 1);
    let step = client.handle(at(2600), ROVER, &accepted);
    assert_eq!(step.events[0].result, Ok(()));
    // Three seconds after the last of the older, no answer to it is under way.
    client.start(at(3000), ROVER, MODE(10.0)).expect("over");
    client
        .supersede(at(5900), ROVER, MODE(11.0))
        .expect("asked");
    let step = client.handle(at(6001), ROVER, &accepted);
    assert_eq!(step.events[0].result, Ok(()));
}

#[test]
fn a_command_in_progress_is_not_superseded_by_one_of_its_number() {
    let (mut client, _) = in_progress();
    client
        .start(at(0), ROVER, TAKEOFF())
        .expect("not under way");
    let refused = client.supersede(at(200), ROVER, ARM());
    assert_eq!(refused, Err(CommandError::UnderWay { command: 400 }));
    assert!(client.is_running(ROVER, cmd::NAV_TAKEOFF), "nothing ended");
}

#[test]
fn a_position_keeps_its_centimetres() {
    let request = Request::At {
        command: cmd::DO_REPOSITION,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
        params: [0.0; 4],
        lat_deg: 52.123_456_7,
        lon_deg: -13.765_432_1,
        alt_m: 12.5,
    };
    let mut client = Client::new(OWN);
    let message = client
        .start(at(0), ROVER, request)
        .expect("nothing under way");
    let received = Incoming::parse(ROVER, OWN, &message).expect("for the rover");
    assert!((received.x - 52.123_456_7).abs() < 1e-9);
    assert!((received.y + 13.765_432_1).abs() < 1e-9);
    assert_eq!(Incoming::parse(Address::new(1, 1), OWN, &message), None);
}
