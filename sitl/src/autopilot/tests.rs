use mavlink_ext::RawFrame;
use mavlink_ext::dialect::MessageInfo;
use mavlink_ext::dialect::tandem::{
    COMMAND_INT_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MISSION_CLEAR_ALL_DATA, MavFrame,
    MavLandedState, MavMissionResult, MavResult, MavSysStatusSensor, PARAM_SET_DATA,
};
use mavlink_ext::mission::Upload;
use mavlink_ext::service::Ends;
use proptest::prelude::*;

mod arming;
mod battery;
mod fence;
mod silence;

use super::*;
use crate::simulation::{COPTER, ROVER, STEP, Start, copter, rover};

const GROUND: Address = Address::new(255, 190);

/// A vehicle, the time, and everything that it has sent to a ground station.
struct Flight {
    autopilot: Autopilot,
    now: Stamp,
    heard: Vec<Message>,
    /// Whether the ground station sends heartbeats.
    present: bool,
}

impl Flight {
    fn copter() -> Self {
        Self::of(copter(&origin(), None, 1))
    }

    fn rover() -> Self {
        let start = Start {
            x_m: 0.0,
            y_m: 0.0,
            heading_deg: 0.0,
        };
        Self::of(rover(&origin(), start, 1))
    }

    fn of(autopilot: Autopilot) -> Self {
        Self {
            autopilot,
            now: Stamp::ZERO,
            heard: Vec::new(),
            present: true,
        }
    }

    fn tell(&mut self, message: &Message) {
        let answers = self.autopilot.handle(self.now, GROUND, message);
        self.heard.extend(answers);
    }

    fn step(&mut self) {
        if self.present && self.now.as_nanos().is_multiple_of(1_000_000_000) {
            self.tell(&heartbeat());
        }
        self.now += STEP;
        let sent = self.autopilot.step(self.now, STEP.as_secs_f64());
        self.heard.extend(sent);
    }

    fn run(&mut self, seconds: u32) {
        (0..seconds * 50).for_each(|_| self.step());
    }

    /// Goes on until that is so, at most for two minutes.
    #[track_caller]
    fn until(&mut self, what: &str, so: impl Fn(&Autopilot) -> bool) {
        for _ in 0..6000 {
            if so(&self.autopilot) {
                return;
            }
            self.step();
        }
        panic!("two minutes without {what}; said: {:?}", self.texts());
    }

    fn command(&mut self, command: u16, params: [f32; 7]) -> MavResult {
        let target = self.autopilot.address();
        let [param1, param2, param3, param4, param5, param6, param7] = params;
        self.tell(&Message::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            param4,
            param5,
            param6,
            param7,
            command,
            target_system: target.system.0,
            target_component: target.component.0,
            confirmation: 0,
        }));
        match self.heard.last() {
            Some(Message::COMMAND_ACK(ack)) if ack.command == command => ack.result,
            other => panic!("{command} is answered by {other:?}"),
        }
    }

    fn set(&mut self, name: &str, value: f32) {
        let target = self.autopilot.address();
        self.tell(&Message::PARAM_SET(PARAM_SET_DATA {
            param_value: value,
            target_system: target.system.0,
            target_component: target.component.0,
            param_id: char_array(name),
            ..PARAM_SET_DATA::default()
        }));
    }

    fn mode(&mut self, number: u32) -> MavResult {
        self.command(
            cmd::DO_SET_MODE,
            [1.0, number as f32, 0.0, 0.0, 0.0, 0.0, 0.0],
        )
    }

    fn arm(&mut self) -> MavResult {
        self.command(
            cmd::COMPONENT_ARM_DISARM,
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        )
    }

    /// Takes off in GUIDED to 2 m and stays there; a rover is armed in GUIDED.
    #[track_caller]
    fn airborne(mut self) -> Self {
        self.run(3);
        let guided = if self.autopilot.kind == Kind::Copter {
            4
        } else {
            15
        };
        assert_eq!(self.mode(guided), MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(
            self.arm(),
            MavResult::MAV_RESULT_ACCEPTED,
            "{:?}",
            self.texts()
        );
        if self.autopilot.kind == Kind::Copter {
            self.command(cmd::NAV_TAKEOFF, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0]);
            self.run(8);
            assert!((self.height() - 2.0).abs() < 0.3, "{} m", self.height());
        }
        self.heard.clear();
        self
    }

    /// Sends it to a place in GUIDED, metres east and north of the origin, at a height.
    fn go(&mut self, x: f64, y: f64, up: f32) -> MavResult {
        let place = origin().to_geodetic(Point::new(x, y, 0.0));
        let target = self.autopilot.address();
        self.tell(&Message::COMMAND_INT(COMMAND_INT_DATA {
            x: (place.lat_deg * 1e7) as i32,
            y: (place.lon_deg * 1e7) as i32,
            z: up,
            command: cmd::DO_REPOSITION,
            target_system: target.system.0,
            target_component: target.component.0,
            frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
            ..COMMAND_INT_DATA::default()
        }));
        match self.heard.last() {
            Some(Message::COMMAND_ACK(ack)) => ack.result,
            other => panic!("answered by {other:?}"),
        }
    }

    /// The last message for which that is something.
    fn last<T>(&self, of: impl Fn(&Message) -> Option<T>) -> Option<T> {
        self.heard.iter().rev().find_map(of)
    }

    /// Whether a bit of the sensors' health is set in the last `SYS_STATUS`.
    fn is_healthy(&self, sensor: MavSysStatusSensor) -> Option<bool> {
        self.last(|message| match message {
            Message::SYS_STATUS(status) => {
                Some(status.onboard_control_sensors_health.contains(sensor))
            }
            _ => None,
        })
    }

    /// What it says within so many seconds.
    fn said_within(&mut self, seconds: u32) -> Vec<String> {
        self.heard.clear();
        self.run(seconds);
        self.texts().iter().map(|text| (*text).to_owned()).collect()
    }

    /// Uploads as a ground station does.
    fn upload(&mut self, items: Vec<MissionItem>) {
        let ends = Ends {
            own: GROUND,
            peer: self.autopilot.address(),
        };
        let (mut upload, count) = Upload::start(self.now, ends, items).expect("short");
        let mut to_send = vec![count];
        while !to_send.is_empty() {
            let answers: Vec<Message> = to_send
                .iter()
                .flat_map(|message| self.autopilot.handle(self.now, GROUND, message))
                .collect();
            to_send = answers
                .iter()
                .flat_map(|answer| upload.handle(self.now, ends.peer, answer).send)
                .collect();
            self.heard.extend(answers);
        }
    }

    fn texts(&self) -> Vec<&str> {
        let texts = self.heard.iter().filter_map(|message| match message {
            Message::STATUSTEXT(text) => text.text.to_str().ok(),
            _ => None,
        });
        texts.collect()
    }

    fn reached(&self) -> Vec<u16> {
        let reached = self.heard.iter().filter_map(|message| match message {
            Message::MISSION_ITEM_REACHED(item) => Some(item.seq),
            _ => None,
        });
        reached.collect()
    }

    fn height(&self) -> f64 {
        self.autopilot.truth().position().raw.z
    }

    /// How far the vehicle truly is from a place, over ground.
    fn distance_to(&self, x: f64, y: f64) -> f64 {
        let here = self.autopilot.truth().position().raw;
        (here.x - x).hypot(here.y - y)
    }
}

fn origin() -> Origin {
    "50.7268,7.0865,60".parse().expect("a place")
}

fn heartbeat() -> Message {
    Message::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_GCS,
        ..HEARTBEAT_DATA::default()
    })
}

fn waypoint(x: f64, y: f64, alt_m: f64) -> MissionItem {
    let place = origin().to_geodetic(Point::new(x, y, 0.0));
    MissionItem::waypoint(place.lat_deg, place.lon_deg, alt_m)
}

fn command_item(command: u16, params: [f32; 4], alt_m: f64) -> MissionItem {
    MissionItem {
        command,
        params,
        alt_m,
        ..MissionItem::waypoint(0.0, 0.0, 0.0)
    }
}

fn survey() -> Vec<MissionItem> {
    vec![
        MissionItem {
            frame: mavlink_ext::mission::MissionFrame::Global,
            ..waypoint(0.0, 0.0, 60.0)
        },
        command_item(cmd::NAV_TAKEOFF, [0.0; 4], 2.0),
        command_item(cmd::DO_CHANGE_SPEED, [1.0, 0.8, -1.0, 0.0], 0.0),
        waypoint(2.0, 0.0, 2.0),
        waypoint(2.0, 1.5, 2.0),
        waypoint(0.0, 1.5, 2.0),
        command_item(cmd::NAV_RETURN_TO_LAUNCH, [0.0; 4], 0.0),
    ]
}

#[test]
fn a_copter_takes_off_goes_where_it_is_told_and_lands() {
    let mut flight = Flight::copter();
    flight.run(3);
    assert_eq!(
        flight.command(cmd::NAV_TAKEOFF, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0]),
        MavResult::MAV_RESULT_FAILED
    );
    assert_eq!(flight.mode(4), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(
        flight.command(cmd::NAV_TAKEOFF, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0]),
        MavResult::MAV_RESULT_ACCEPTED
    );
    flight.run(8);
    assert!((flight.height() - 2.0).abs() < 0.2, "{} m", flight.height());
    let place = origin().to_geodetic(Point::new(3.0, 1.0, 0.0));
    flight.tell(&Message::COMMAND_INT(COMMAND_INT_DATA {
        param2: 1.0,
        x: (place.lat_deg * 1e7) as i32,
        y: (place.lon_deg * 1e7) as i32,
        z: 1.5,
        command: cmd::DO_REPOSITION,
        target_system: 1,
        target_component: 1,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
        ..COMMAND_INT_DATA::default()
    }));
    flight.run(12);
    assert!(
        flight.distance_to(3.0, 1.0) < 0.3,
        "{} m away",
        flight.distance_to(3.0, 1.0)
    );
    assert!((flight.height() - 1.5).abs() < 0.2, "{} m", flight.height());
    assert_eq!(
        flight.command(cmd::NAV_LAND, [0.0; 7]),
        MavResult::MAV_RESULT_ACCEPTED
    );
    flight.until("disarming", |autopilot| !autopilot.is_armed());
    assert!(flight.height() < 0.01);
    flight.run(1);
    let landed = flight.heard.iter().rev().find_map(|message| match message {
        Message::EXTENDED_SYS_STATE(state) => Some(state.landed_state),
        _ => None,
    });
    assert_eq!(landed, Some(MavLandedState::MAV_LANDED_STATE_ON_GROUND));
}

#[test]
fn a_copter_flies_its_survey_and_comes_home() {
    let mut flight = Flight::copter();
    flight.upload(survey());
    flight.run(3);
    assert_eq!(flight.mode(4), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(
        flight.command(cmd::MISSION_START, [0.0; 7]),
        MavResult::MAV_RESULT_ACCEPTED
    );
    flight.until("landing", |autopilot| !autopilot.is_armed());
    assert_eq!(
        flight.reached(),
        [1, 2, 3, 4, 5],
        "each item once, home and the way back not"
    );
    assert!(
        flight.distance_to(-0.6, 0.0) < 0.4,
        "{} m from where it started",
        flight.distance_to(-0.6, 0.0)
    );
    let report = crate::report::VehicleReport::new(&flight.autopilot);
    assert!(
        report.survey_completed && report.mission_completed,
        "{report:?}"
    );
    let states = flight
        .heard
        .iter()
        .filter(|m| matches!(m, Message::MISSION_CURRENT(_)))
        .count();
    assert!(states > 20, "progress is streamed");
}

#[test]
fn a_rover_drives_dense_waypoints_backs_up_and_stands_at_the_last() {
    let mut flight = Flight::rover();
    let mut items: Vec<_> = (1..=12)
        .map(|i| {
            let angle = f64::from(i) * 0.15;
            waypoint(2.0 * angle.sin(), 2.0 * (1.0 - angle.cos()), 0.0)
        })
        .collect();
    items.push(command_item(cmd::DO_SET_REVERSE, [1.0, 0.0, 0.0, 0.0], 0.0));
    items.extend((8..=11).rev().map(|i| {
        let angle = f64::from(i) * 0.15;
        waypoint(2.0 * angle.sin(), 2.0 * (1.0 - angle.cos()), 0.0)
    }));
    items.push(command_item(cmd::DO_SET_REVERSE, [0.0; 4], 0.0));
    items.push(waypoint(
        2.0 * 1.35_f64.sin(),
        2.0 * (1.0 - 1.35_f64.cos()),
        0.0,
    ));
    let count = items.len();
    flight.upload(items);
    flight.run(3);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(flight.mode(10), MavResult::MAV_RESULT_ACCEPTED);
    let mut backwards = 0;
    for _ in 0..3000 {
        flight.step();
        let truth = flight.autopilot.truth();
        let ahead = truth
            .velocity
            .raw
            .dot(&(truth.world_from_body.rotation() * nalgebra::Vector3::x()));
        backwards += usize::from(ahead < -0.1);
    }
    assert!(
        flight.autopilot.execution().is_complete(),
        "{:?}",
        flight.texts()
    );
    assert!(backwards > 50, "it went backwards for {backwards} steps");
    let all: Vec<u16> = (0..count as u16).collect();
    let mut reached = flight.reached();
    reached.dedup();
    assert!(
        flight.autopilot.execution().reached().len() == count,
        "{reached:?} of {all:?}"
    );
    let report = crate::report::VehicleReport::new(&flight.autopilot);
    let error = report.final_error_m.expect("a target");
    assert!(error < 0.2, "truly {error} m from its last waypoint");
    assert!(report.survey_completed);
}

#[test]
fn missions_that_the_vehicle_cannot_do_are_refused() {
    let reject = |item: MissionItem| (accepts_on_the_ground(&item), accepts_in_the_air(&item));
    let reverse = command_item(cmd::DO_SET_REVERSE, [1.0, 0.0, 0.0, 0.0], 0.0);
    let takeoff = command_item(cmd::NAV_TAKEOFF, [0.0; 4], 2.0);
    let unsupported = Err(MavMissionResult::MAV_MISSION_UNSUPPORTED);
    assert_eq!(reject(reverse), (Ok(()), unsupported));
    assert_eq!(reject(takeoff), (unsupported, Ok(())));
    let nowhere = MissionItem::command(cmd::NAV_WAYPOINT, [0.0; 4]);
    let frame = Err(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME);
    assert_eq!(reject(nowhere), (frame, frame));
    let bad = Err(MavMissionResult::MAV_MISSION_INVALID_PARAM7);
    assert_eq!(reject(waypoint(0.0, 0.0, f64::NAN)), (bad, bad));
}

#[test]
fn unknown_commands_are_answered_and_messages_for_others_are_not() {
    let mut flight = Flight::rover();
    flight.step();
    assert_eq!(
        flight.command(65_000, [0.0; 7]),
        MavResult::MAV_RESULT_UNSUPPORTED
    );
    assert_eq!(
        flight.command(cmd::NAV_TAKEOFF, [0.0; 7]),
        MavResult::MAV_RESULT_UNSUPPORTED,
        "a rover"
    );
    let before = flight.heard.len();
    flight.tell(&Message::COMMAND_LONG(COMMAND_LONG_DATA {
        command: cmd::COMPONENT_ARM_DISARM,
        param1: 1.0,
        target_system: COPTER.system.0,
        target_component: 1,
        ..COMMAND_LONG_DATA::default()
    }));
    assert_eq!(flight.heard.len(), before, "{COPTER} is not {ROVER}");
}

#[test]
fn clearing_the_mission_in_flight_stops_the_copter_where_it_is() {
    let mut flight = Flight::copter();
    flight.upload(survey());
    flight.run(3);
    flight.mode(4);
    flight.arm();
    flight.command(cmd::MISSION_START, [0.0; 7]);
    flight.run(7);
    flight.tell(&Message::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        ..MISSION_CLEAR_ALL_DATA::default()
    }));
    flight.run(2);
    let here = flight.autopilot.truth().position();
    flight.run(5);
    assert!(
        (flight.autopilot.truth().position() - here).norm() < 0.6,
        "it stays"
    );
    assert!(flight.height() > 1.0, "in the air");
}

#[test]
fn odometry_counts_only_in_the_frames_that_ardupilot_takes() {
    let mut flight = Flight::copter();
    let mut odometry = ODOMETRY_DATA {
        frame_id: MavFrame::MAV_FRAME_LOCAL_FRD,
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
        quality: 87,
        ..ODOMETRY_DATA::default()
    };
    let companion = Address::new(1, 191);
    flight
        .autopilot
        .handle(flight.now, companion, &Message::ODOMETRY(odometry.clone()));
    odometry.frame_id = MavFrame::MAV_FRAME_LOCAL_NED;
    flight
        .autopilot
        .handle(flight.now, companion, &Message::ODOMETRY(odometry));
    let expected = OdometryHeard {
        accepted: 1,
        refused: 1,
        last_quality: Some(87),
    };
    assert_eq!(flight.autopilot.odometry(), expected);
}

#[test]
fn a_request_for_time_is_answered_and_an_answer_is_not() {
    let request = TIMESYNC_DATA {
        ts1: 42,
        ..TIMESYNC_DATA::default()
    };
    let now = Stamp::from_nanos(1000);
    let Some(Message::TIMESYNC(answer)) = timesync_answer(now, GROUND, &request) else {
        panic!("no answer");
    };
    assert_eq!(
        (answer.tc1, answer.ts1, answer.target_system),
        (1000, 42, 255)
    );
    assert_eq!(timesync_answer(now, GROUND, &answer), None);
}

/// A frame of that message with these bytes in it, from the ground station.
fn frame_of(info: &MessageInfo, payload: &[u8]) -> RawFrame {
    let [low, middle, high, _] = info.id.to_le_bytes();
    let length = info.length;
    let mut bytes = vec![
        0xFD,
        length as u8,
        0,
        0,
        0,
        GROUND.system.0,
        GROUND.component.0,
        low,
        middle,
        high,
    ];
    bytes.extend(&payload[..length]);
    // CRC-16/MCRF4XX over all but the first byte, and the seed of the message.
    let crc = bytes[1..]
        .iter()
        .chain(&[info.crc_extra])
        .fold(0xFFFF_u16, |crc, byte| {
            (0..8).fold(crc ^ u16::from(*byte), |crc, _| {
                if crc & 1 == 1 {
                    (crc >> 1) ^ 0x8408
                } else {
                    crc >> 1
                }
            })
        });
    bytes.extend(crc.to_le_bytes());
    RawFrame::from_bytes(&bytes).expect("well formed")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_message_from_the_wire_makes_it_panic(
        frames in prop::collection::vec((any::<prop::sample::Index>(), prop::collection::vec(any::<u8>(), 255)), 1..30),
        rover_too in any::<bool>()
    ) {
        let mut flight = if rover_too { Flight::rover() } else { Flight::copter() };
        flight.run(3);
        flight.arm();
        let known = mavlink_ext::dialect::CATALOGUE;
        for (index, mut payload) in frames {
            let info = &known[index.index(known.len())];
            // For this vehicle, so that it is not simply passed over.
            for (offset, value) in [(info.target_system, flight.autopilot.address().system.0), (info.target_component, 1)] {
                if let Some(offset) = offset {
                    payload[offset] = value;
                }
            }
            if let Ok(message) = frame_of(info, &payload).decode() {
                flight.tell(&message);
            }
            flight.step();
        }
        flight.run(2);
        prop_assert!(flight.autopilot.truth().world_from_body.is_finite());
        prop_assert!(flight.autopilot.estimate().world_from_body.is_finite());
    }
}
