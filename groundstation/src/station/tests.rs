//! The station in simulated time, against vehicles made of messages.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::frame::{Isometry, Point};
use maps::scan::Scan;
use maps::time::Stamp;
use maps::voxel::{Rgb, VoxelMap};
use mavlink_ext::command::Incoming;
use mavlink_ext::convert::{Odometry, odometry_message};
use mavlink_ext::dialect::tandem::{
    ATTITUDE_DATA, GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MISSION_CURRENT_DATA, MavAutopilot,
    MavModeFlag, MavResult, MavSeverity, MavState, MavType, MissionState, ODOMETRY_DATA,
    STATUSTEXT_DATA, TANDEM_ORIGIN_DATA, TANDEM_STATUS_DATA, TandemTracking,
};
use mavlink_ext::dialect::{char_array, cmd};
use mavlink_ext::mission::Server;
use mavlink_ext::object::{Object, ObjectId, Sender, SenderSettings, Service};
use mavlink_ext::service::Ends;

mod map;

use super::*;
use crate::command::{Order, SurveyArea};
use crate::config::Config;
use crate::model::alerts::Level;
use crate::model::map::Agreement;
use crate::model::missions::{PlanState, Transfer};
use crate::model::orders::OrderState;
use crate::model::vehicle::Presence;
use map::{deliver_map, floor};

const COPTER: Address = Address::new(1, 1);
const ROVER: Address = Address::new(2, 1);
const COMPANION: Address = Address::new(1, 191);
const ORIGIN_E7: [i32; 2] = [473_977_420, 85_455_940];

/// A station, a clock and what was sent.
struct Bench {
    station: Station,
    now: Stamp,
    encoders: BTreeMap<Address, Encoder>,
    sent: Vec<Message>,
    jobs: Vec<Job>,
}

impl Bench {
    fn new(source: Source) -> Self {
        let station = Station::new(Model::new(Config::default(), source, 1_700_000_000_000_000));
        Self {
            station,
            now: Stamp::ZERO,
            encoders: BTreeMap::new(),
            sent: Vec::new(),
            jobs: Vec::new(),
        }
    }

    fn model(&self) -> &Model {
        self.station.model()
    }

    fn feed(&mut self, event: Event) {
        let (sent, jobs) = (&mut self.sent, &mut self.jobs);
        self.station
            .step(self.now, event, &mut |action| match action {
                Action::Send { frame, .. } => sent.push(frame.decode().expect("own frame")),
                Action::Plan(job) => jobs.push(job),
                Action::Open(_) => {}
            });
    }

    fn hear(&mut self, from: Address, message: &Message) {
        let encoder = self.encoders.entry(from);
        let frame = encoder
            .or_insert_with(|| Encoder::new(from))
            .encode(message);
        self.feed(Event::Frame { link: 0, frame });
    }

    fn command(&mut self, command: Command) {
        self.feed(Event::Command(command));
    }

    /// Lets time pass in ticks of 100 ms, in which nothing is heard.
    fn silence(&mut self, span: Duration) {
        for _ in 0..span.as_millis() / 100 {
            self.now += Duration::from_millis(100);
            self.feed(Event::Tick);
        }
    }

    fn heartbeat(&mut self, from: Address, kind: MavType, armed: bool, mode: u32) {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, armed);
        let heartbeat = HEARTBEAT_DATA {
            custom_mode: mode,
            mavtype: kind,
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode,
            system_status: MavState::MAV_STATE_STANDBY,
            mavlink_version: 3,
        };
        self.hear(from, &Message::HEARTBEAT(heartbeat));
    }

    /// A rover in HOLD at the origin of the map, heading east.
    fn rover(&mut self) {
        self.heartbeat(ROVER, MavType::MAV_TYPE_GROUND_ROVER, false, 4);
        self.place(ROVER);
    }

    fn copter(&mut self) {
        self.heartbeat(COPTER, MavType::MAV_TYPE_QUADROTOR, false, 0);
        self.place(COPTER);
    }

    fn place(&mut self, vehicle: Address) {
        let origin = TANDEM_ORIGIN_DATA {
            lat: ORIGIN_E7[0],
            lon: ORIGIN_E7[1],
            alt: 488_000,
            epoch: 1,
        };
        self.hear(COMPANION, &Message::TANDEM_ORIGIN(origin));
        let position = GLOBAL_POSITION_INT_DATA {
            lat: ORIGIN_E7[0],
            lon: ORIGIN_E7[1],
            alt: 488_000,
            ..GLOBAL_POSITION_INT_DATA::default()
        };
        self.hear(vehicle, &Message::GLOBAL_POSITION_INT(position));
        let attitude = ATTITUDE_DATA {
            yaw: std::f32::consts::FRAC_PI_2,
            ..ATTITUDE_DATA::default()
        };
        self.hear(vehicle, &Message::ATTITUDE(attitude));
    }

    /// The last command of that number that was sent to a vehicle.
    fn sent_command(&self, to: Address, command: u16) -> Option<Incoming> {
        let parsed = self
            .sent
            .iter()
            .filter_map(|m| Incoming::parse(to, self.model().config.address(), m));
        parsed.rev().find(|incoming| incoming.command == command)
    }

    fn answer(&mut self, from: Address, command: u16, result: MavResult) {
        let ack = self
            .sent_command(from, command)
            .expect("it was sent")
            .ack(result);
        self.hear(from, &ack);
    }

    fn say(&mut self, from: Address, severity: MavSeverity, text: &str) {
        let text = STATUSTEXT_DATA {
            severity,
            text: char_array(text),
            ..STATUSTEXT_DATA::default()
        };
        self.hear(from, &Message::STATUSTEXT(text));
    }

    fn alerts(&self) -> Vec<(Level, String)> {
        let present = self.model().alerts.present().iter();
        present
            .map(|alert| (alert.level, alert.text.clone()))
            .collect()
    }

    /// Lets a vehicle that follows the mission protocol answer everything that was sent to it.
    fn serve(&mut self, server: &mut Server, vehicle: Address) {
        for _ in 0..200 {
            let sent = std::mem::take(&mut self.sent);
            for message in sent {
                let station = self.model().config.address();
                for answer in server.handle(self.now, station, &message).send {
                    self.hear(vehicle, &answer);
                }
            }
            self.silence(Duration::from_millis(100));
            self.heartbeat(vehicle, MavType::MAV_TYPE_QUADROTOR, false, 0);
        }
    }
}

#[test]
fn a_link_is_lost_after_three_and_a_half_seconds_without_a_heartbeat_and_found_again() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    bench.silence(Duration::from_millis(3500));
    assert!(bench.alerts().is_empty(), "{:?}", bench.alerts());
    bench.silence(Duration::from_millis(100));
    let text = "UGV 2: link lost, no heartbeat for more than 3.5 s".to_owned();
    assert_eq!(bench.alerts(), [(Level::Caution, text)]);
    assert_eq!(
        bench.model().vehicles[&SystemId(2)].presence(bench.now),
        Presence::Lost
    );
    bench.rover();
    bench.silence(Duration::from_millis(100));
    assert!(bench.alerts().is_empty(), "an alert leaves with its cause");
}

#[test]
fn losing_an_armed_vehicle_is_a_warning() {
    let mut bench = Bench::new(Source::Live);
    bench.heartbeat(ROVER, MavType::MAV_TYPE_GROUND_ROVER, true, 10);
    bench.silence(Duration::from_secs(4));
    assert_eq!(bench.alerts()[0].0, Level::Warning);
}

#[test]
fn only_the_heartbeat_of_the_autopilot_keeps_a_vehicle_alive() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    for _ in 0..40 {
        bench.silence(Duration::from_millis(100));
        let heartbeat = HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            ..HEARTBEAT_DATA::default()
        };
        bench.hear(COMPANION, &Message::HEARTBEAT(heartbeat));
        bench.place(COPTER);
    }
    assert_eq!(
        bench.model().vehicles[&SystemId(1)].presence(bench.now),
        Presence::Lost
    );
}

#[test]
fn everybody_hears_of_the_station_once_a_second() {
    let mut bench = Bench::new(Source::Live);
    bench.silence(Duration::from_secs(10));
    let beats = bench
        .sent
        .iter()
        .filter(|message| matches!(message, Message::HEARTBEAT(_)))
        .count();
    assert_eq!(beats, 10);
}

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

#[track_caller]
fn check_plan_is_refused(bench: &mut Bench, vehicle: u8, reason: &str) {
    let vehicle = SystemId(vehicle);
    bench.command(Command::PlanPath {
        vehicle,
        x_m: 1.0,
        y_m: 1.0,
        heading_deg: None,
    });
    let expected = PlanState::Refused {
        at: bench.now,
        reason: reason.to_owned(),
    };
    assert_eq!(bench.model().missions[&vehicle].plan, expected);
    assert!(bench.jobs.is_empty());
}

#[test]
fn a_plan_is_refused_with_the_reason() {
    let mut bench = Bench::new(Source::Live);
    check_plan_is_refused(&mut bench, 2, "vehicle 2 has never been heard");
    bench.heartbeat(ROVER, MavType::MAV_TYPE_GROUND_ROVER, false, 4);
    check_plan_is_refused(&mut bench, 2, "UGV 2 has not told its position");
    bench.rover();
    check_plan_is_refused(&mut bench, 2, "there is no map yet");
    bench.copter();
    check_plan_is_refused(&mut bench, 1, "UAV 1 does not drive");
}

#[test]
fn the_planner_is_asked_from_where_the_rover_is_and_its_refusal_is_shown() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    deliver_map(&mut bench, &floor());
    let vehicle = SystemId(2);
    bench.command(Command::PlanPath {
        vehicle,
        x_m: 90.0,
        y_m: 0.0,
        heading_deg: Some(0.0),
    });
    let Some(Job::Path(job)) = bench.jobs.pop() else {
        panic!("a job for the planner")
    };
    assert!(
        job.start.x_m.abs() < 1e-6 && job.start.heading_rad.abs() < 1e-6,
        "{:?}",
        job.start
    );
    assert_eq!(
        job.goal_heading_rad,
        Some(std::f64::consts::FRAC_PI_2),
        "north"
    );
    bench.feed(Event::Planned(crate::plan::run(Job::Path(job))));
    let PlanState::Refused { reason, .. } = &bench.model().missions[&vehicle].plan else {
        panic!("90 m away there is no map");
    };
    assert!(
        reason.starts_with("the goal (90.00, 0.00) m is outside the map"),
        "{reason}"
    );
}

#[test]
fn a_path_becomes_a_plan_with_figures() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    deliver_map(&mut bench, &floor());
    let vehicle = SystemId(2);
    bench.command(Command::PlanPath {
        vehicle,
        x_m: 1.5,
        y_m: 0.5,
        heading_deg: None,
    });
    let job = bench.jobs.pop().expect("a job for the planner");
    bench.feed(Event::Planned(crate::plan::run(job)));
    let plan = bench.model().missions[&vehicle]
        .plan()
        .expect("a plan")
        .clone();
    let crate::model::missions::PlanKind::Path { length_m, .. } = plan.kind else {
        panic!("a path")
    };
    assert!((1.5..2.5).contains(&length_m), "{length_m} m");
    assert_eq!(
        plan.items[0].command,
        cmd::NAV_WAYPOINT,
        "home first, as ArduPilot wants it"
    );
    assert_eq!(plan.items[1].command, cmd::DO_CHANGE_SPEED);
    assert!(plan.line.len() + 2 <= plan.items.len() + 1);
}

fn survey(bench: &mut Bench) {
    let area = SurveyArea {
        from_m: [-1.0, -1.0],
        to_m: [1.0, 1.0],
        altitude_m: 2.0,
        spacing_m: 1.0,
    };
    bench.command(Command::PlanSurvey {
        vehicle: SystemId(1),
        area,
    });
}

#[test]
fn an_upload_that_is_read_back_equal_is_verified() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    bench.sent.clear();
    bench.command(Command::Upload(SystemId(1)));
    assert_eq!(
        bench.model().missions[&SystemId(1)].transfer,
        Transfer::Uploading { done: 0, total: 8 }
    );
    bench.serve(&mut Server::new(COPTER, |_| Ok(())), COPTER);
    let transfer = &bench.model().missions[&SystemId(1)].transfer;
    assert!(
        matches!(transfer, Transfer::Verified { items: 8, .. }),
        "{transfer:?}"
    );
    assert!(bench.alerts().is_empty(), "{:?}", bench.alerts());
}

#[test]
fn an_upload_that_reads_back_otherwise_is_shown_with_what_differs() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    bench.sent.clear();
    bench.command(Command::Upload(SystemId(1)));
    let mut server = Server::new(COPTER, |_| Ok(()));
    for _ in 0..200 {
        for message in std::mem::take(&mut bench.sent) {
            for mut answer in server
                .handle(bench.now, Address::new(255, 190), &message)
                .send
            {
                if let Message::MISSION_ITEM_INT(item) = &mut answer
                    && item.seq == 3
                {
                    item.x += 500;
                }
                bench.hear(COPTER, &answer);
            }
        }
        bench.silence(Duration::from_millis(100));
        bench.heartbeat(COPTER, MavType::MAV_TYPE_QUADROTOR, false, 0);
    }
    let Transfer::Differs { differences, .. } = &bench.model().missions[&SystemId(1)].transfer
    else {
        panic!("{:?}", bench.model().missions[&SystemId(1)].transfer);
    };
    assert_eq!(differences.len(), 1);
    assert!(
        differences[0].starts_with("mission item 3: sent to"),
        "{differences:?}"
    );
    let text = "UAV 1: the mission read back differs in 1 places".to_owned();
    assert_eq!(bench.alerts(), [(Level::Warning, text)]);
}

#[test]
fn an_upload_to_a_silent_vehicle_fails_and_says_so() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    bench.command(Command::Upload(SystemId(1)));
    bench.silence(Duration::from_secs(20));
    let transfer = &bench.model().missions[&SystemId(1)].transfer;
    let Transfer::Failed { reason, .. } = transfer else {
        panic!("{transfer:?}")
    };
    assert_eq!(
        reason,
        "no answer from the vehicle after 0 of 8 mission items"
    );
}

#[test]
fn a_mission_is_complete_when_the_vehicle_says_so_and_not_any_more_when_it_starts_anew() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    let mut tell = |mission_state| {
        let current = MISSION_CURRENT_DATA {
            seq: 3,
            total: 5,
            mission_state,
            ..MISSION_CURRENT_DATA::default()
        };
        bench.hear(COPTER, &Message::MISSION_CURRENT(current));
        bench.model().vehicles[&SystemId(1)]
            .mission
            .is_some_and(|mission| mission.value.complete)
    };
    assert!(!tell(MissionState::MISSION_STATE_ACTIVE));
    assert!(tell(MissionState::MISSION_STATE_COMPLETE));
    assert!(tell(MissionState::MISSION_STATE_UNKNOWN), "nothing new");
    assert!(!tell(MissionState::MISSION_STATE_ACTIVE));
}

#[test]
fn the_active_vehicle_changes_only_when_the_operator_says_so() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    bench.rover();
    bench.silence(Duration::from_secs(5));
    bench.rover();
    assert_eq!(
        bench.model().active,
        Some(SystemId(1)),
        "although it is lost"
    );
    bench.command(Command::Select(SystemId(2)));
    assert_eq!(bench.model().active, Some(SystemId(2)));
}

#[test]
fn a_replay_sends_nothing_and_cannot_be_commanded() {
    let mut bench = Bench::new(Source::Replay);
    bench.rover();
    bench.command(Command::Order(SystemId(2), Order::Arm));
    bench.silence(Duration::from_secs(3));
    assert!(bench.sent.is_empty());
    assert_eq!(bench.model().orders.iter().len(), 0);
    assert!(
        bench.model().vehicles[&SystemId(2)].position.is_some(),
        "but it is shown"
    );
}

#[test]
fn a_position_is_put_on_the_map_anew_when_the_origin_changes() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    let origin = TANDEM_ORIGIN_DATA {
        lat: ORIGIN_E7[0],
        lon: ORIGIN_E7[1] - 1000,
        alt: 487_000,
        epoch: 2,
    };
    bench.hear(COMPANION, &Message::TANDEM_ORIGIN(origin));
    let position = bench.model().vehicles[&SystemId(2)]
        .position
        .expect("known")
        .value
        .raw;
    assert!(
        (7.0..8.0).contains(&position.x),
        "{position:?} is 1e-4 degrees east"
    );
    assert!((position.z - 1.0).abs() < 1e-3);
}

#[test]
fn a_plan_made_before_the_origin_moved_is_dropped_and_that_is_said() {
    let moved = |bench: &mut Bench, east_e7: i32| {
        let origin = TANDEM_ORIGIN_DATA {
            lat: ORIGIN_E7[0],
            lon: ORIGIN_E7[1] + east_e7,
            alt: 488_000,
            epoch: 2,
        };
        bench.hear(COMPANION, &Message::TANDEM_ORIGIN(origin));
    };
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    moved(&mut bench, 0); // the same place, in another epoch
    let plan = |bench: &Bench| bench.model().missions[&SystemId(1)].plan.clone();
    assert!(
        matches!(plan(&bench), PlanState::Ready(_)),
        "the same place"
    );
    moved(&mut bench, 100);
    let PlanState::Refused { reason, .. } = plan(&bench) else {
        panic!("the items lead 0.7 m beside what is drawn");
    };
    assert!(reason.contains("origin has changed"), "{reason}");
    let before = bench.sent.len();
    bench.command(Command::Upload(SystemId(1)));
    assert_eq!(bench.sent.len(), before, "nothing is uploaded");
}

#[test]
fn a_survey_is_drawn_lower_when_the_origin_turns_out_to_be_higher() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    let height_m = |bench: &Bench| match &bench.model().missions[&SystemId(1)].plan {
        PlanState::Ready(plan) => plan.line[0].raw.z,
        other => panic!("its items count from the home: {other:?}"),
    };
    let before = height_m(&bench);
    let origin = TANDEM_ORIGIN_DATA {
        lat: ORIGIN_E7[0],
        lon: ORIGIN_E7[1],
        alt: 500_000,
        epoch: 2,
    };
    bench.hear(COMPANION, &Message::TANDEM_ORIGIN(origin));
    let lowered = before - height_m(&bench);
    assert!((lowered - 12.0).abs() < 1e-6, "{lowered}");
}
