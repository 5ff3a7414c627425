//! Client against server over a simulated radio.

use std::time::Duration;

use maps::time::Stamp;
use proptest::prelude::*;
use sitl::link::Profile;

use super::*;
use crate::service::Ends;
use crate::simulated::{Air, losing, perfect};
use crate::wire::Address;

const STATION: Address = Address::new(255, 190);
const ROVER: Address = Address::new(2, 1);

struct Room {
    client: Client,
    server: Server,
    up: Air,
    down: Air,
    now: Stamp,
}

impl Room {
    fn new(radio: &Profile) -> Self {
        let mut parameters: Vec<Parameter> = (0..200)
            .map(|i| Parameter::real(&format!("RATE_{i}"), f64::from(i) * 0.25))
            .collect();
        parameters.push(Parameter::integer("SIXTEEN_LETTERS_", -7));
        let ends = Ends {
            own: STATION,
            peer: ROVER,
        };
        Self {
            client: Client::new(ends, Encoding::Cast),
            server: Server::new(ROVER, parameters),
            up: Air::new(STATION, radio, 1),
            down: Air::new(ROVER, radio, 2),
            now: Stamp::ZERO,
        }
    }

    fn run(&mut self, first: crate::Message) -> Option<ClientEvent> {
        self.up.send(self.now, [first]);
        for _ in 0..6000 {
            self.now += Duration::from_millis(10);
            self.down.send(self.now, self.server.tick().send);
            for (_, message) in self.up.arrived(self.now) {
                self.down.send(self.now, self.server.handle(&message).send);
            }
            let mut steps = vec![self.client.tick(self.now)];
            for (from, message) in self.down.arrived(self.now) {
                steps.push(self.client.handle(self.now, from, &message));
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
}

#[test]
fn all_parameters_are_read_over_a_bad_radio_and_one_is_set() {
    let mut room = Room::new(&losing(0.2));
    let first = room.client.read_all(room.now);
    assert_eq!(room.run(first), Some(ClientEvent::Read(Ok(()))));
    let read: Vec<Parameter> = room.client.parameters().cloned().collect();
    assert_eq!(read, room.server.parameters());

    let wanted = Parameter::integer("SIXTEEN_LETTERS_", 12);
    let first = room.client.set(room.now, wanted.clone());
    assert_eq!(room.run(first), Some(ClientEvent::Set(Ok(wanted))));
    assert_eq!(room.server.get("SIXTEEN_LETTERS_"), Some(12.0));
}

#[test]
fn a_parameter_that_is_not_there_is_not_confirmed() {
    let mut room = Room::new(&perfect());
    let first = room.client.set(room.now, Parameter::real("NONE", 1.0));
    let name = "NONE".to_owned();
    let error = ParamError::NotConfirmed { name };
    assert_eq!(room.run(first), Some(ClientEvent::Set(Err(error))));
}

#[test]
fn a_value_that_is_no_number_changes_nothing_and_is_answered_with_the_old_one() {
    let mut room = Room::new(&perfect());
    let first = room
        .client
        .set(room.now, Parameter::real("RATE_4", f64::NAN));
    let old = Parameter::real("RATE_4", 1.0);
    assert_eq!(room.run(first), Some(ClientEvent::Set(Ok(old))));
}

#[test]
fn a_silent_vehicle_is_given_up() {
    let deaf = losing(1.0);
    let mut room = Room::new(&deaf);
    let first = room.client.read_all(room.now);
    let error = ParamError::NoAnswer { read: 0, total: 0 };
    assert_eq!(room.run(first), Some(ClientEvent::Read(Err(error))));
}

proptest! {
    #[test]
    fn integers_survive_either_encoding(value in -8_388_608i32..8_388_608) {
        let kind = MavParamType::MAV_PARAM_TYPE_INT32;
        for encoding in [Encoding::Cast, Encoding::Bytes] {
            let wire = encoding.encode(kind, f64::from(value));
            prop_assert_eq!(encoding.decode(kind, wire) as i32, value);
        }
    }
}
