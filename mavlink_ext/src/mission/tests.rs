//! Clients against the server, over a simulated radio.

use std::time::Duration;

use maps::time::Stamp;
use proptest::prelude::*;
use sitl::link::Profile;

use super::*;
use crate::dialect::tandem::{
    MISSION_ACK_DATA, MISSION_CLEAR_ALL_DATA, MISSION_COUNT_DATA, MISSION_ITEM_DATA,
    MISSION_REQUEST_DATA, MISSION_REQUEST_LIST_DATA, MavFrame,
};
use crate::dialect::{Message, MessageExt as _, cmd};
use crate::service::{Ends, Step};
use crate::simulated::{Air, losing, perfect};
use crate::wire::Address;

const STATION: Address = Address::new(255, 190);
const ROVER: Address = Address::new(2, 1);
const ENDS: Ends = Ends {
    own: STATION,
    peer: ROVER,
};
const TICK: Duration = Duration::from_millis(10);

fn survey(items: usize) -> Vec<MissionItem> {
    let mut mission = vec![MissionItem::command(
        cmd::DO_SET_REVERSE,
        [1.0, 0.0, 0.0, 0.0],
    )];
    mission.extend((1..items).map(|i| {
        let step = i as f64 * 1.234_567e-6;
        MissionItem::waypoint(52.0 + step, 13.0 - step, 0.1 * i as f64)
    }));
    mission
}

fn rover() -> Server {
    Server::new(ROVER, |item| {
        if item.command == cmd::NAV_LAND {
            Err(MavMissionResult::MAV_MISSION_UNSUPPORTED)
        } else {
            Ok(())
        }
    })
}

/// A client and the server on a radio, until the client's event or for a minute.
struct Room {
    server: Server,
    up: Air,
    down: Air,
    now: Stamp,
}

impl Room {
    fn new(server: Server, radio: &Profile, seed: u64) -> Self {
        Self {
            server,
            up: Air::new(STATION, radio, seed),
            down: Air::new(ROVER, radio, seed + 1),
            now: Stamp::ZERO,
        }
    }

    fn run<T>(
        &mut self,
        first: Message,
        mut client: impl FnMut(Stamp, Option<(Address, &Message)>) -> Step<T>,
    ) -> Option<T> {
        self.up.send(self.now, [first]);
        for _ in 0..6_000 {
            self.now += TICK;
            for (from, message) in self.up.arrived(self.now) {
                let step = self.server.handle(self.now, from, &message);
                self.down.send(self.now, step.send);
            }
            let step = self.server.tick(self.now);
            self.down.send(self.now, step.send);
            let mut steps = vec![client(self.now, None)];
            for (from, message) in self.down.arrived(self.now) {
                steps.push(client(self.now, Some((from, &message))));
            }
            for step in steps {
                self.up.send(self.now, step.send);
                if let Some(event) = step.events.into_iter().next() {
                    return Some(event);
                }
            }
        }
        None
    }

    fn upload(&mut self, items: Vec<MissionItem>) -> Result<(), MissionError> {
        let (mut upload, first) = Upload::start(self.now, ENDS, items)?;
        self.run(first, |now, message| match message {
            Some((from, message)) => upload.handle(now, from, message),
            None => upload.tick(now),
        })
        .expect("an upload ends within a minute")
    }

    fn download(&mut self) -> Result<Vec<MissionItem>, MissionError> {
        let (mut download, first) = Download::start(self.now, ENDS);
        self.run(first, |now, message| match message {
            Some((from, message)) => download.handle(now, from, message),
            None => download.tick(now),
        })
        .expect("a download ends within a minute")
    }

    fn clear(&mut self) -> Result<(), MissionError> {
        let (mut clear, first) = Clear::start(self.now, ENDS);
        self.run(first, |now, message| match message {
            Some((from, message)) => clear.handle(from, message),
            None => clear.tick(now),
        })
        .expect("a clearing ends within a minute")
    }
}

#[test]
fn what_was_uploaded_is_read_back_and_cleared() {
    let mut room = Room::new(rover(), &perfect(), 1);
    let mission = survey(20);
    assert_eq!(room.upload(mission.clone()), Ok(()));
    let read = room.download().expect("the rover has it");
    assert_eq!(differences(&mission, &read), []);
    let id = room.server.mission_id();
    assert_eq!(room.clear(), Ok(()));
    assert_eq!(room.download(), Ok(Vec::new()));
    assert_ne!(room.server.mission_id(), id);
    assert_eq!(room.upload(Vec::new()), Ok(()), "an empty one clears too");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn a_bad_radio_never_makes_a_wrong_mission(
        seed in any::<u64>(), loss in 0.0..0.3, items in 1usize..30
    ) {
        let before = survey(3);
        let mut server = rover();
        server.set_items(before.clone());
        let mut room = Room::new(server, &losing(loss), seed >> 1);
        let mission = survey(items);
        let uploaded = room.upload(mission.clone());
        // Should every acknowledgement be lost, the client cannot know; the vehicle has one mission or the other.
        let stored = room.server.items();
        let is_new = differences(&mission, stored).is_empty();
        prop_assert!(is_new || differences(&before, stored).is_empty());
        prop_assert!(is_new || uploaded.is_err());
        if let Ok(read) = room.download() {
            prop_assert_eq!(differences(room.server.items(), &read), []);
        }
    }
}

#[test]
fn a_radio_that_loses_one_message_in_five_is_good_enough() {
    let succeeded = (0..50)
        .filter(|seed| {
            let mut room = Room::new(rover(), &losing(0.2), 1000 + seed);
            room.upload(survey(20)).is_ok()
        })
        .count();
    assert!(succeeded >= 48, "{succeeded} of 50 uploads");
}

#[test]
fn a_silent_vehicle_is_given_up_after_nine_seconds() {
    let deaf = losing(1.0);
    let mut room = Room::new(rover(), &deaf, 1);
    let error = room.upload(survey(2)).expect_err("nobody hears");
    assert_eq!(error, MissionError::NoAnswer { done: 0, total: 2 });
    assert_eq!(room.now.since(Stamp::ZERO), Duration::from_secs(9));
    assert_eq!(
        room.download(),
        Err(MissionError::NoAnswer { done: 0, total: 0 })
    );
}

#[test]
fn a_refused_item_keeps_the_old_mission() {
    let mut room = Room::new(rover(), &perfect(), 1);
    room.upload(survey(3)).expect("fine");
    let mut bad = survey(5);
    bad[2].command = cmd::NAV_LAND;
    let error = room.upload(bad).expect_err("the rover cannot land");
    assert_eq!(
        error.to_string(),
        "the vehicle refused the mission at item 2: MAV_MISSION_UNSUPPORTED"
    );
    assert_eq!(room.server.items().len(), 3);
}

/// The types of the acknowledgements in answer to a message from the station.
fn acks(server: &mut Server, message: &Message) -> Vec<MavMissionResult> {
    let step = server.handle(Stamp::ZERO, STATION, message);
    step.send
        .iter()
        .filter_map(|message| match message {
            Message::MISSION_ACK(ack) => Some(ack.mavtype),
            _ => None,
        })
        .collect()
}

fn count(count: u16, mission_type: MavMissionType) -> Message {
    Message::MISSION_COUNT(MISSION_COUNT_DATA {
        count,
        target_system: ROVER.system.0,
        target_component: ROVER.component.0,
        mission_type,
        opaque_id: 0,
    })
}

#[test]
fn fences_and_rally_points_are_answered_that_there_are_none() {
    let mut server = rover();
    for mission_type in [
        MavMissionType::MAV_MISSION_TYPE_FENCE,
        MavMissionType::MAV_MISSION_TYPE_RALLY,
    ] {
        let list = Message::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
            target_system: 2,
            target_component: 1,
            mission_type,
        });
        let answer = server.handle(Stamp::ZERO, STATION, &list).send;
        let [Message::MISSION_COUNT(answer)] = answer.as_slice() else {
            panic!("expected a count, got {answer:?}");
        };
        assert_eq!((answer.count, answer.mission_type), (0, mission_type));
        let accepted = [MavMissionResult::MAV_MISSION_ACCEPTED];
        let unsupported = [MavMissionResult::MAV_MISSION_UNSUPPORTED];
        assert_eq!(acks(&mut server, &count(0, mission_type)), accepted);
        assert_eq!(acks(&mut server, &count(4, mission_type)), unsupported);
        let clear = Message::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
            target_system: 2,
            target_component: 1,
            mission_type,
        });
        assert_eq!(acks(&mut server, &clear), accepted);
    }
}

#[test]
fn a_second_client_is_denied_while_a_first_uploads() {
    let mut server = rover();
    server.handle(Stamp::ZERO, STATION, &count(3, MISSION));
    let other = Address::new(254, 190);
    let step = server.handle(Stamp::ZERO, other, &count(2, MISSION));
    assert!(matches!(
        step.send.as_slice(),
        [Message::MISSION_ACK(MISSION_ACK_DATA {
            mavtype: MavMissionResult::MAV_MISSION_DENIED,
            target_system: 254,
            ..
        })]
    ));
    let too_long = count(MAX_ITEMS as u16 + 1, MISSION);
    let no_space = [MavMissionResult::MAV_MISSION_NO_SPACE];
    assert_eq!(acks(&mut server, &too_long), no_space);
}

#[test]
fn older_clients_may_send_and_ask_for_items_without_int() {
    let mut server = rover();
    server.handle(Stamp::ZERO, STATION, &count(1, MISSION));
    let item = Message::MISSION_ITEM(MISSION_ITEM_DATA {
        x: 52.5,
        y: 13.25,
        z: 3.0,
        command: cmd::NAV_WAYPOINT,
        target_system: 2,
        target_component: 1,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
        ..MISSION_ITEM_DATA::default()
    });
    let accepted = [MavMissionResult::MAV_MISSION_ACCEPTED];
    assert_eq!(acks(&mut server, &item), accepted);
    assert!((server.items()[0].lat_deg - 52.5).abs() < 1e-9);
    let request = |seq| {
        Message::MISSION_REQUEST(MISSION_REQUEST_DATA {
            seq,
            target_system: 2,
            target_component: 1,
            mission_type: MISSION,
        })
    };
    let answer = server.handle(Stamp::ZERO, STATION, &request(0)).send;
    assert_eq!(answer[0].message_name(), "MISSION_ITEM_INT");
    let invalid = [MavMissionResult::MAV_MISSION_INVALID_SEQUENCE];
    assert_eq!(acks(&mut server, &request(1)), invalid);
}

#[test]
fn messages_for_another_vehicle_are_left_alone() {
    let mut copter = Server::new(Address::new(1, 1), |_| Ok(()));
    assert_eq!(
        copter.handle(Stamp::ZERO, STATION, &count(3, MISSION)),
        Step::none()
    );
}

#[test]
fn a_server_of_fences_takes_fences_alone_and_refuses_one_that_makes_no_sense_as_a_whole() {
    let fence = MavMissionType::MAV_MISSION_TYPE_FENCE;
    let error = MavMissionResult::MAV_MISSION_ERROR;
    let at_least_three: fn(&[MissionItem]) -> Result<(), MavMissionResult> =
        |items| match items.len() {
            3.. => Ok(()),
            _ => Err(MavMissionResult::MAV_MISSION_ERROR),
        };
    let mut server = Server::of_kind(ROVER, fence, (|_| Ok(()), at_least_three));
    let count = |count, mission_type| {
        Message::MISSION_COUNT(MISSION_COUNT_DATA {
            count,
            target_system: ROVER.system.0,
            target_component: ROVER.component.0,
            mission_type,
            ..MISSION_COUNT_DATA::default()
        })
    };
    let mut upload = |items: &[MissionItem], kind| {
        let mut step = server.handle(Stamp::ZERO, STATION, &count(items.len() as u16, kind));
        for (seq, item) in items.iter().enumerate() {
            let item = Message::MISSION_ITEM_INT(item.to_message(seq as u16, ROVER, kind));
            step = server.handle(Stamp::ZERO, STATION, &item);
        }
        let Some(Message::MISSION_ACK(ack)) = step.send.last() else {
            panic!("{:?}", step.send);
        };
        (ack.mavtype, ack.mission_type, server.items().len())
    };
    let accepted = MavMissionResult::MAV_MISSION_ACCEPTED;
    assert_eq!(upload(&survey(4), fence), (accepted, fence, 4));
    assert_eq!(
        upload(&survey(2), fence),
        (error, fence, 4),
        "the old one stays"
    );
    let mission = MavMissionType::MAV_MISSION_TYPE_MISSION;
    let refused = server.handle(Stamp::ZERO, STATION, &count(3, mission));
    let [Message::MISSION_ACK(ack)] = refused.send.as_slice() else {
        panic!("{:?}", refused.send);
    };
    assert_eq!(ack.mavtype, MavMissionResult::MAV_MISSION_UNSUPPORTED);
}
