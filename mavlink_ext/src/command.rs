//! Commands and their acknowledgements, both ends.
//!
//! A client repeats a command until it is acknowledged, counting `confirmation` up, and waits longer while the vehicle
//! says that it is in progress. At most one command of a number is under way at one vehicle, since an acknowledgement
//! names only the number. <https://mavlink.io/en/services/command.html>

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use crate::convert::{deg_to_e7, e7_to_deg};
use crate::dialect::Message;
use crate::dialect::tandem::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavFrame, MavResult,
};
use crate::service::{Due, Retry, Step, is_for};
use crate::wire::Address;

/// Silence before a command is repeated.
const TIMEOUT: Duration = Duration::from_millis(1500);
/// How often it is repeated.
const RETRIES: u32 = 3;
/// Silence borne after the vehicle has said that the command is in progress.
const PROGRESS_TIMEOUT: Duration = Duration::from_secs(10);

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// `COMMAND_LONG`: seven plain parameters.
    Long {
        /// `MAV_CMD`, see [`crate::dialect::cmd`].
        command: u16,
        /// Parameters 1 to 7.
        params: [f32; 7],
    },
    /// `COMMAND_INT`: with a position, which single precision could not hold.
    At {
        /// `MAV_CMD`.
        command: u16,
        /// What the altitude is measured from.
        frame: MavFrame,
        /// Parameters 1 to 4.
        params: [f32; 4],
        /// Latitude, WGS-84.
        lat_deg: f64,
        /// Longitude, WGS-84.
        lon_deg: f64,
        /// Altitude in the frame.
        alt_m: f32,
    },
}

impl Request {
    /// A command of up to seven parameters; those not given are 0.
    pub fn long(command: u16, first_params: &[f32]) -> Self {
        let mut params = [0.0; 7];
        for (to, from) in params.iter_mut().zip(first_params) {
            *to = *from;
        }
        Self::Long { command, params }
    }

    /// Its number.
    pub fn command(&self) -> u16 {
        match self {
            Self::Long { command, .. } | Self::At { command, .. } => *command,
        }
    }

    fn to_message(&self, to: Address, confirmation: u8) -> Message {
        match *self {
            Self::Long { command, params } => {
                let [param1, param2, param3, param4, param5, param6, param7] = params;
                Message::COMMAND_LONG(COMMAND_LONG_DATA {
                    param1,
                    param2,
                    param3,
                    param4,
                    param5,
                    param6,
                    param7,
                    command,
                    target_system: to.system.0,
                    target_component: to.component.0,
                    confirmation,
                })
            }
            Self::At {
                command,
                frame,
                params: [param1, param2, param3, param4],
                lat_deg,
                lon_deg,
                alt_m,
            } => Message::COMMAND_INT(COMMAND_INT_DATA {
                param1,
                param2,
                param3,
                param4,
                x: deg_to_e7(lat_deg),
                y: deg_to_e7(lon_deg),
                z: alt_m,
                command,
                target_system: to.system.0,
                target_component: to.component.0,
                frame,
                current: 0,
                autocontinue: 0,
            }),
        }
    }
}

/// How a command ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Who was commanded.
    pub vehicle: Address,
    /// Which command.
    pub command: u16,
    /// What came of it.
    pub result: Result<(), CommandError>,
}

/// Why a command was not carried out.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CommandError {
    /// The vehicle will not, or cannot.
    #[error("the vehicle answered {result:?}")]
    Refused {
        /// Its answer.
        result: MavResult,
    },
    /// The vehicle does not answer.
    #[error("no answer from the vehicle to {tries} tries")]
    NoAnswer {
        /// How often it was sent.
        tries: u32,
    },
    /// The same command is under way at that vehicle.
    #[error("command {command} is already under way")]
    UnderWay {
        /// Its number.
        command: u16,
    },
}

/// A client's commands under way.
#[derive(Clone, Debug)]
pub struct Client {
    own: Address,
    running: BTreeMap<(Address, u16), Running>,
}

#[derive(Clone, Debug)]
struct Running {
    request: Request,
    tries: u32,
    retry: Retry,
}

impl Client {
    /// A client at this address with nothing under way.
    pub fn new(own: Address) -> Self {
        Self {
            own,
            running: BTreeMap::new(),
        }
    }

    /// Whether this command is under way at this vehicle.
    pub fn is_running(&self, vehicle: Address, command: u16) -> bool {
        self.running.contains_key(&(vehicle, command))
    }

    /// Begins a command.
    pub fn start(
        &mut self,
        now: Stamp,
        vehicle: Address,
        request: Request,
    ) -> Result<Message, CommandError> {
        let command = request.command();
        if self.is_running(vehicle, command) {
            return Err(CommandError::UnderWay { command });
        }
        let message = request.to_message(vehicle, 0);
        let running = Running {
            request,
            tries: 1,
            retry: Retry::new(now, TIMEOUT, RETRIES),
        };
        self.running.insert((vehicle, command), running);
        Ok(message)
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<Outcome> {
        let Message::COMMAND_ACK(ack) = message else {
            return Step::none();
        };
        let key = (from, ack.command);
        let Some(running) = self
            .running
            .get_mut(&key)
            .filter(|_| is_for(self.own, message))
        else {
            return Step::none();
        };
        if ack.result == MavResult::MAV_RESULT_IN_PROGRESS {
            running.retry = Retry::new(now, PROGRESS_TIMEOUT, 0);
            return Step::none();
        }
        self.running.remove(&key);
        let result = match ack.result {
            MavResult::MAV_RESULT_ACCEPTED => Ok(()),
            result => Err(CommandError::Refused { result }),
        };
        Step::event(Outcome {
            vehicle: from,
            command: ack.command,
            result,
        })
    }

    /// Lets time pass: repeats what was not answered, and gives up in the end.
    pub fn tick(&mut self, now: Stamp) -> Step<Outcome> {
        let mut step = Step::none();
        self.running.retain(
            |&(vehicle, command), running| match running.retry.check(now) {
                Due::Nothing => true,
                Due::Again => {
                    let confirmation = running.tries as u8;
                    running.tries += 1;
                    step.send
                        .push(running.request.to_message(vehicle, confirmation));
                    true
                }
                Due::GiveUp => {
                    let tries = running.tries;
                    step.events.push(Outcome {
                        vehicle,
                        command,
                        result: Err(CommandError::NoAnswer { tries }),
                    });
                    false
                }
            },
        );
        step
    }
}

/// A command that a vehicle received, from either message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incoming {
    /// Who commands.
    pub from: Address,
    /// `MAV_CMD`.
    pub command: u16,
    /// Parameters 1 to 4.
    pub params: [f32; 4],
    /// Parameters 5 and 6: degrees of latitude and longitude where the command has a position.
    pub x: f64,
    /// See `x`.
    pub y: f64,
    /// Parameter 7: an altitude where the command has a position.
    pub z: f32,
    /// What a position means; `None` in a `COMMAND_LONG`, where the command decides.
    pub frame: Option<MavFrame>,
    /// How often it was repeated.
    pub confirmation: u8,
}

impl Incoming {
    /// The command in a message for `own`; `None` if it is another message, or for somebody else.
    pub fn parse(own: Address, from: Address, message: &Message) -> Option<Self> {
        if !is_for(own, message) {
            return None;
        }
        match message {
            Message::COMMAND_LONG(long) => Some(Self {
                from,
                command: long.command,
                params: [long.param1, long.param2, long.param3, long.param4],
                x: f64::from(long.param5),
                y: f64::from(long.param6),
                z: long.param7,
                frame: None,
                confirmation: long.confirmation,
            }),
            Message::COMMAND_INT(int) => {
                let local = matches!(
                    int.frame,
                    MavFrame::MAV_FRAME_LOCAL_NED
                        | MavFrame::MAV_FRAME_LOCAL_ENU
                        | MavFrame::MAV_FRAME_LOCAL_FRD
                        | MavFrame::MAV_FRAME_BODY_FRD
                );
                // "local: x position in meters * 1e4, global: latitude in degrees * 10^7"
                let scaled = |v: i32| {
                    if local {
                        f64::from(v) * 1e-4
                    } else {
                        e7_to_deg(v)
                    }
                };
                Some(Self {
                    from,
                    command: int.command,
                    params: [int.param1, int.param2, int.param3, int.param4],
                    x: scaled(int.x),
                    y: scaled(int.y),
                    z: int.z,
                    frame: Some(int.frame),
                    confirmation: 0,
                })
            }
            _ => None,
        }
    }

    /// The acknowledgement.
    pub fn ack(&self, result: MavResult) -> Message {
        Message::COMMAND_ACK(COMMAND_ACK_DATA {
            command: self.command,
            result,
            progress: 0,
            result_param2: 0,
            target_system: self.from.system.0,
            target_component: self.from.component.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::cmd;

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
}
