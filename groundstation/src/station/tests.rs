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
mod orders;
mod plans;

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
                Action::Open(_) | Action::Forget { .. } => {}
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
