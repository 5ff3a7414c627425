use maps::time::Stamp;
use proptest::prelude::*;
use sitl::link::Profile;

use super::*;
use crate::command::{Incoming, Request};
use crate::dialect::tandem::MavResult;
use crate::dialect::{Message, MessageExt as _, cmd};
use crate::service::Ends;
use crate::simulated::{Air, losing, perfect};
use crate::wire::Address;

const OWN: Address = Address::new(255, 190);
const ROVER: Address = Address::new(2, 1);
const TICK: Duration = Duration::from_millis(10);
const ATTITUDE: u32 = 30;
const GLOBAL_POSITION: u32 = 33;
const VFR_HUD: u32 = 74;
const HOME_POSITION: u32 = 242;
/// In a dialect of the vehicle's, in no stream.
const OWN_MESSAGE: u32 = 54_101;

fn at(millis: u64) -> Stamp {
    Stamp::ZERO + Duration::from_millis(millis)
}

fn every(millis: u64) -> Rate {
    Rate::Every(Duration::from_millis(millis))
}

/// What a vehicle can do.
#[derive(Clone, Copy)]
struct Skills {
    commands: &'static [u16],
    streams: bool,
    /// Says that it sends, and does not.
    lies: bool,
}

const ALL: Skills = Skills {
    commands: &[
        cmd::SET_MESSAGE_INTERVAL,
        cmd::GET_MESSAGE_INTERVAL,
        cmd::REQUEST_MESSAGE,
    ],
    streams: false,
    lies: false,
};

struct Bench {
    now: Stamp,
    client: Client,
    skills: Skills,
    schedule: Schedule,
    there: Air,
    back: Air,
    events: Vec<IntervalEvent>,
    arrived: Vec<u32>,
    asked: Vec<Message>,
}

fn schedule(now: Stamp, shortest: Duration) -> Schedule {
    let mut schedule = Schedule::new(ROVER, shortest);
    for message in [ATTITUDE, GLOBAL_POSITION, HOME_POSITION, OWN_MESSAGE] {
        schedule.offer(now, message, None);
    }
    schedule.offer(now, VFR_HUD, Some(Duration::from_millis(250)));
    schedule
}

impl Bench {
    fn new(skills: Skills, radio: &Profile) -> Self {
        let ends = Ends {
            own: OWN,
            peer: ROVER,
        };
        Self {
            now: Stamp::ZERO,
            client: Client::new(ends),
            skills,
            schedule: schedule(Stamp::ZERO, Duration::from_millis(5)),
            there: Air::new(OWN, radio, 1),
            back: Air::new(ROVER, radio, 2),
            events: Vec::new(),
            arrived: Vec::new(),
            asked: Vec::new(),
        }
    }

    fn run(&mut self, seconds: u64) {
        let end = self.now + Duration::from_secs(seconds);
        while self.now < end {
            self.now += TICK;
            let step = self.client.tick(self.now);
            self.ask(step);
            let mut back = Vec::new();
            for (from, message) in self.there.arrived(self.now) {
                back.extend(self.vehicle(from, &message));
            }
            let due = self.schedule.due(self.now);
            let sends = due.iter().filter(|_| !self.skills.lies);
            back.extend(sends.filter_map(|id| Message::default_message_from_id(*id)));
            self.back.send(self.now, back);
            for (from, message) in self.back.arrived(self.now) {
                self.arrived.push(message.message_id());
                let step = self.client.handle(self.now, from, &message);
                self.ask(step);
            }
        }
    }

    fn ask(&mut self, step: crate::service::Step<IntervalEvent>) {
        self.events.extend(step.events);
        self.asked.extend(step.send.iter().cloned());
        self.there.send(self.now, step.send);
    }

    fn vehicle(&mut self, from: Address, message: &Message) -> Vec<Message> {
        if let Message::REQUEST_DATA_STREAM(stream) = message {
            let interval = Duration::from_secs(1) / u32::from(stream.req_message_rate.max(1));
            if self.skills.streams && stream.req_stream_id == MavDataStream::MAV_DATA_STREAM_EXTRA1
            {
                self.schedule.offer(self.now, ATTITUDE, Some(interval));
            }
            return Vec::new();
        }
        let Some(command) = Incoming::parse(ROVER, from, message) else {
            return Vec::new();
        };
        let can = self.skills.commands.contains(&command.command);
        let unsupported = || vec![command.ack(MavResult::MAV_RESULT_UNSUPPORTED)];
        let answers = can.then(|| self.schedule.handle(self.now, from, message));
        answers.flatten().unwrap_or_else(unsupported)
    }

    fn count(&self, message: u32) -> usize {
        self.arrived.iter().filter(|id| **id == message).count()
    }
}

fn granted(message: u32) -> IntervalEvent {
    IntervalEvent::Granted { message }
}

#[test]
fn rates_are_asked_for_one_after_another_and_come_on_a_link_that_loses_a_fifth() {
    let mut bench = Bench::new(ALL, &losing(0.2));
    bench.client.want(bench.now, ATTITUDE, every(50));
    bench.client.want(bench.now, GLOBAL_POSITION, every(200));
    bench.client.want(bench.now, VFR_HUD, Rate::Off);
    bench.run(20);
    let mut events = bench.events.clone();
    events.sort_by_key(|event| format!("{event:?}"));
    assert_eq!(events, [ATTITUDE, GLOBAL_POSITION, VFR_HUD].map(granted));
    bench.arrived.clear();
    bench.run(60);
    assert!(
        (800..1300).contains(&bench.count(ATTITUDE)),
        "of 1200, some twice"
    );
    assert!((200..330).contains(&bench.count(GLOBAL_POSITION)));
    assert_eq!(bench.count(VFR_HUD), 0);
    assert_eq!(bench.events.len(), 3, "and stays: {:?}", bench.events);
}

#[test]
fn what_comes_seldom_is_asked_about_instead_of_waited_for() {
    let mut bench = Bench::new(ALL, &perfect());
    bench.client.want(bench.now, HOME_POSITION, every(30_000));
    bench.run(1);
    assert_eq!(bench.events, [granted(HOME_POSITION)]);
}

#[test]
fn the_default_rate_needs_no_check() {
    let mut bench = Bench::new(ALL, &perfect());
    bench.client.want(bench.now, ATTITUDE, Rate::Default);
    bench.run(10);
    assert_eq!(bench.events, [granted(ATTITUDE)]);
    assert_eq!(bench.asked.len(), 1);
}

#[test]
fn a_vehicle_that_grants_less_is_asked_how_much_and_left_in_peace() {
    const WITHOUT_GET: &[u16] = &[cmd::SET_MESSAGE_INTERVAL, cmd::REQUEST_MESSAGE];
    const ONLY_SET: &[u16] = &[cmd::SET_MESSAGE_INTERVAL];
    for commands in [ALL.commands, WITHOUT_GET, ONLY_SET] {
        let skills = Skills { commands, ..ALL };
        let mut bench = Bench::new(skills, &perfect());
        bench.schedule = schedule(bench.now, Duration::from_millis(200));
        bench.client.want(bench.now, ATTITUDE, every(20));
        bench.run(10);
        let [IntervalEvent::Slower { message, interval }] = bench.events[..] else {
            panic!("{:?}", bench.events);
        };
        assert_eq!(message, ATTITUDE);
        let off = interval.abs_diff(Duration::from_millis(200));
        assert!(off < Duration::from_millis(25), "{interval:?}");
        let asked = bench.asked.len();
        bench.run(120);
        assert_eq!(bench.asked.len(), asked);
        assert_eq!(bench.events.len(), 1);
    }
}

#[test]
fn a_vehicle_that_restarts_is_asked_again() {
    let mut bench = Bench::new(ALL, &losing(0.2));
    bench.client.want(bench.now, ATTITUDE, every(100));
    bench.run(20);
    bench.schedule = schedule(bench.now, Duration::from_millis(5));
    bench.run(20);
    let lapsed = IntervalEvent::Lapsed { message: ATTITUDE };
    let expected = [granted(ATTITUDE), lapsed, granted(ATTITUDE)];
    assert_eq!(bench.events, expected);
}

#[test]
fn a_vehicle_without_intervals_is_asked_for_streams_and_what_is_in_none_is_unavailable() {
    let skills = Skills {
        commands: &[],
        streams: true,
        ..ALL
    };
    let mut bench = Bench::new(skills, &perfect());
    bench.client.want(bench.now, ATTITUDE, every(100));
    bench.client.want(bench.now, GLOBAL_POSITION, every(100));
    bench.client.want(bench.now, OWN_MESSAGE, every(100));
    bench.run(60);
    let unavailable = |message| IntervalEvent::Unavailable { message };
    let expected = [
        unavailable(OWN_MESSAGE),
        granted(ATTITUDE),
        unavailable(GLOBAL_POSITION),
    ];
    assert_eq!(bench.events, expected);
    assert!(bench.count(ATTITUDE) > 500, "10 Hz");
    let asked = bench.asked.len();
    bench.run(120);
    assert_eq!(bench.asked.len(), asked, "left in peace");
    // Another firmware.
    bench.skills = ALL;
    bench.events.clear();
    bench.client.peer_appeared(bench.now);
    bench.run(10);
    assert_eq!(bench.events.len(), 3, "{:?}", bench.events);
}

#[test]
fn a_message_that_the_vehicle_does_not_have_is_unavailable() {
    let mut bench = Bench::new(ALL, &perfect());
    bench.client.want(bench.now, 148, every(1000));
    bench.run(10);
    let unavailable = IntervalEvent::Unavailable { message: 148 };
    assert_eq!(bench.events, [unavailable]);
}

/// How many messages go out in ten minutes, and in the hour that follows.
fn traffic(bench: &mut Bench) -> (usize, usize) {
    bench.client.want(bench.now, ATTITUDE, every(100));
    bench.run(600);
    let early = bench.asked.len();
    bench.run(3600);
    (early, bench.asked.len() - early)
}

#[test]
fn a_silent_vehicle_is_asked_ever_more_seldom_and_nothing_is_given_up() {
    let mut bench = Bench::new(ALL, &losing(1.0));
    let (early, late) = traffic(&mut bench);
    assert!(early < 60 && late < 60, "{early}, {late}");
    assert_eq!(bench.events, []);
}

#[test]
fn a_vehicle_that_does_not_send_what_it_says_is_asked_ever_more_seldom() {
    let mut bench = Bench::new(Skills { lies: true, ..ALL }, &perfect());
    let (early, late) = traffic(&mut bench);
    assert!(early < 40 && late < 60, "{early}, {late}");
}

#[test]
fn strangers_are_not_heard() {
    let ends = Ends {
        own: OWN,
        peer: ROVER,
    };
    let mut client = Client::new(ends);
    client.want(at(0), ATTITUDE, every(100));
    let asked = client.tick(at(0)).send;
    let command = Incoming::parse(ROVER, OWN, &asked[0]).expect("a command");
    let ack = command.ack(MavResult::MAV_RESULT_UNSUPPORTED);
    client.handle(at(10), Address::new(1, 1), &ack);
    assert!(client.tick(at(20)).send.is_empty(), "it still waits");
}

#[test]
fn a_schedule_makes_up_for_no_stall_and_keeps_its_pace() {
    let mut schedule = schedule(at(0), Duration::from_millis(5));
    let sent: Vec<u64> = (0..100)
        .map(|tick| tick * 10)
        .filter(|ms| schedule.due(at(*ms)) == [VFR_HUD])
        .collect();
    assert_eq!(sent, [0, 250, 500, 750]);
    assert_eq!(schedule.next_due(), Some(at(1000)));
    assert_eq!(schedule.due(at(60_005)), [VFR_HUD]);
    assert_eq!(schedule.due(at(60_006)), [0; 0], "no burst");
    assert_eq!(schedule.next_due(), Some(at(60_255)));
}

/// What the schedule answers to a command.
fn answer(schedule: &mut Schedule, command: u16, params: &[f32]) -> Option<Vec<Message>> {
    let request = Request::long(command, params);
    let message = crate::command::Client::new(OWN)
        .start(at(0), ROVER, request)
        .expect("nothing is under way");
    schedule.handle(at(0), OWN, &message)
}

#[track_caller]
fn check_result(command: u16, params: &[f32], expected: MavResult) {
    let mut schedule = schedule(at(0), Duration::from_millis(5));
    let answers = answer(&mut schedule, command, params).expect("it is ours");
    let Some(Message::COMMAND_ACK(ack)) = answers.first() else {
        panic!("{answers:?}");
    };
    assert_eq!(ack.result, expected, "{command} {params:?}");
}

#[test]
fn a_schedule_refuses_what_it_cannot_do() {
    let set = cmd::SET_MESSAGE_INTERVAL;
    for params in [
        [30.0, f32::NAN],
        [30.0, f32::INFINITY],
        [30.0, -2.0],
        [30.5, 1000.0],
        [-30.0, 1000.0],
        [f32::NAN, 1000.0],
        [1e9, 1000.0],
        [148.0, 1000.0],
    ] {
        check_result(set, &params, MavResult::MAV_RESULT_DENIED);
    }
    let denied = MavResult::MAV_RESULT_DENIED;
    check_result(cmd::GET_MESSAGE_INTERVAL, &[70_000.0], denied);
    check_result(set, &[30.0, 1000.0], MavResult::MAV_RESULT_ACCEPTED);
}

#[test]
fn a_schedule_tells_its_intervals_by_both_commands() {
    let mut schedule = schedule(at(0), Duration::from_millis(5));
    answer(&mut schedule, cmd::SET_MESSAGE_INTERVAL, &[30.0, 1.0]);
    assert_eq!(schedule.interval(ATTITUDE), Some(Duration::from_millis(5)));
    for (message, told) in [(30, 5000), (74, 250_000), (33, -1), (148, 0)] {
        let message_id = f32::from(message);
        for (command, params) in [
            (cmd::GET_MESSAGE_INTERVAL, [message_id, 0.0]),
            (cmd::REQUEST_MESSAGE, [244.0, message_id]),
        ] {
            let answers = answer(&mut schedule, command, &params).expect("it is ours");
            let expected = MESSAGE_INTERVAL_DATA {
                interval_us: told,
                message_id: message,
            };
            assert_eq!(answers[1..], [Message::MESSAGE_INTERVAL(expected)]);
        }
    }
}

#[test]
fn one_message_goes_once_and_other_requests_are_the_owners() {
    let mut schedule = schedule(at(0), Duration::from_millis(5));
    schedule.due(at(0));
    assert!(answer(&mut schedule, cmd::REQUEST_MESSAGE, &[242.0]).is_some());
    assert_eq!(schedule.due(at(1)), [HOME_POSITION]);
    assert_eq!(schedule.due(at(100)), [0; 0], "once");
    assert_eq!(answer(&mut schedule, cmd::REQUEST_MESSAGE, &[148.0]), None);
    assert_eq!(answer(&mut schedule, cmd::NAV_TAKEOFF, &[]), None);
}

proptest! {
    #[test]
    fn any_commands_never_panic_and_never_ask_for_more_than_is_allowed(
        all in prop::collection::vec((any::<bool>(), any::<f32>(), any::<f32>(), 0_u64..10_000), 0..40)
    ) {
        let mut schedule = schedule(at(0), Duration::from_millis(5));
        for (set, first, second, millis) in all {
            let command = if set { cmd::SET_MESSAGE_INTERVAL } else { cmd::REQUEST_MESSAGE };
            answer(&mut schedule, command, &[first, second]);
            answer(&mut schedule, command, &[30.0, second]);
            schedule.due(at(millis));
            prop_assert!(schedule.interval(ATTITUDE).is_none_or(|i| i >= Duration::from_millis(5)));
        }
    }

    #[test]
    fn a_rate_survives_its_parameter(micros in 1_u32..16_777_216) {
        let rate = Rate::Every(Duration::from_micros(micros.into()));
        prop_assert_eq!(Rate::from_param(rate.to_param()), Some(rate));
    }
}
