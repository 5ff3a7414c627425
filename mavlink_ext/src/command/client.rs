//! The commanding end.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use super::{CommandError, Outcome, PROGRESS_UNKNOWN, Request};
use crate::dialect::Message;
use crate::dialect::tandem::{COMMAND_ACK_DATA, COMMAND_CANCEL_DATA, MavResult};
use crate::service::{Due, Retry, Step, is_for};
use crate::wire::Address;

/// Silence before a command is repeated.
const TIMEOUT: Duration = Duration::from_millis(1500);
/// How often it is repeated.
const RETRIES: u32 = 3;
/// Silence borne after the vehicle has said that the command is in progress.
const PROGRESS_TIMEOUT: Duration = Duration::from_secs(10);
/// An acknowledgement is not under way for longer.
const UNDER_WAY: Duration = Duration::from_secs(3);

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
    last_sent: Stamp,
    retry: Retry,
    state: State,
    earlier: Earlier,
}

/// What the vehicle is known to do.
#[derive(Clone, Copy, Debug)]
enum State {
    /// It has not answered.
    Asked,
    /// It has said that it is at it.
    InProgress { percent: Option<u8> },
    /// We want it to stop.
    Cancelling { retry: Retry },
}

/// Acknowledgements that may still come for an earlier command of the same number.
#[derive(Clone, Copy, Debug)]
struct Earlier {
    acks: u32,
    until: Stamp,
}

impl Earlier {
    const NONE: Self = Self {
        acks: 0,
        until: Stamp::ZERO,
    };
}

/// A command that has taken the place of others.
#[derive(Clone, Debug, PartialEq)]
pub struct Superseding {
    /// To send.
    pub message: Message,
    /// Commands that are not repeated any more, and have no other outcome. For [`crate::repeat::Repeater::forget`] too.
    pub ended: Vec<u16>,
}

impl Running {
    fn new(now: Stamp, request: Request) -> Self {
        Self {
            request,
            tries: 1,
            last_sent: now,
            retry: Retry::new(now, TIMEOUT, RETRIES),
            state: State::Asked,
            earlier: Earlier::NONE,
        }
    }

    /// Whether an acknowledgement may be that of an earlier command of the same number.
    fn is_of_earlier(&mut self, now: Stamp) -> bool {
        let may_be = self.earlier.acks > 0 && now <= self.earlier.until;
        if may_be {
            self.earlier.acks -= 1;
        }
        may_be
    }

    fn progressed(&mut self, now: Stamp, ack: &COMMAND_ACK_DATA) {
        self.retry = Retry::new(now, PROGRESS_TIMEOUT, 0);
        let known = |percent: &u8| *percent != PROGRESS_UNKNOWN;
        let percent = Some(ack.progress).filter(known).map(|p| p.min(100));
        if !matches!(self.state, State::Cancelling { .. }) {
            self.state = State::InProgress { percent };
        }
    }

    /// The next message, and whether it is over.
    fn tick(&mut self, now: Stamp, vehicle: Address) -> (Option<Message>, Due) {
        let mut send = None;
        if let State::Cancelling { retry } = &mut self.state {
            match retry.check(now) {
                Due::Nothing => {}
                Due::Again => send = Some(cancel_message(vehicle, self.request.command())),
                // It does not know how to, or has never heard: the command goes its way.
                Due::GiveUp => self.state = State::InProgress { percent: None },
            }
        }
        let due = self.retry.check(now);
        if due == Due::Again {
            send = Some(self.request.to_message(vehicle, self.tries as u8));
            self.tries += 1;
            self.last_sent = now;
        }
        (send, due)
    }
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

    /// How much of a command the vehicle has done, in percent, if it says so.
    pub fn progress_percent(&self, vehicle: Address, command: u16) -> Option<u8> {
        match self.running.get(&(vehicle, command))?.state {
            State::InProgress { percent } => percent,
            State::Asked | State::Cancelling { .. } => None,
        }
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
        let running = Running::new(now, request);
        self.running.insert((vehicle, command), running);
        Ok(message)
    }

    /// Ends the waiting for all commands that this vehicle has not answered: they are not repeated any more, and have no
    /// outcome; the vehicle may have carried them out nevertheless. Those in progress go on. Which ones ended, in the
    /// order of their numbers.
    pub fn end_unanswered(&mut self, vehicle: Address) -> Vec<u16> {
        let is_ended = |key: &(Address, u16), running: &mut Running| {
            key.0 == vehicle && matches!(running.state, State::Asked)
        };
        (self.running.extract_if(.., is_ended))
            .map(|((_, command), _)| command)
            .collect()
    }

    /// Begins a command that makes older, unanswered ones at this vehicle void, as "return" does "take off": a late repetition of
    /// an older one must not undo it. Refused if one of the same number is in progress, which can be cancelled.
    ///
    /// An acknowledgement that comes soon may be one of an older command of the same number; as many as may be under way
    /// are not believed, for three seconds.
    pub fn supersede(
        &mut self,
        now: Stamp,
        vehicle: Address,
        request: Request,
    ) -> Result<Superseding, CommandError> {
        let command = request.command();
        let earlier = match self.running.get(&(vehicle, command)) {
            None => Earlier::NONE,
            Some(running) if matches!(running.state, State::Asked) => Earlier {
                acks: running.tries + running.earlier.acks,
                until: running.last_sent + UNDER_WAY,
            },
            Some(_) => return Err(CommandError::UnderWay { command }),
        };
        let ended = self.end_unanswered(vehicle);
        let message = request.to_message(vehicle, 0);
        let running = Running {
            earlier,
            ..Running::new(now, request)
        };
        self.running.insert((vehicle, command), running);
        Ok(Superseding { message, ended })
    }

    /// Tells the vehicle to stop a command; `None` if it is not under way. The command is not repeated any more, its
    /// cancellation is. The outcome comes as ever: cancelled ([`CommandError::is_cancelled`]), or whatever the command came to
    /// before the vehicle heard, or if it cannot cancel; no answer after ten seconds of silence.
    pub fn cancel(&mut self, now: Stamp, vehicle: Address, command: u16) -> Option<Message> {
        let running = self.running.get_mut(&(vehicle, command))?;
        running.state = State::Cancelling {
            retry: Retry::new(now, TIMEOUT, RETRIES),
        };
        running.retry = Retry::new(now, PROGRESS_TIMEOUT, 0);
        Some(cancel_message(vehicle, command))
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
        if running.is_of_earlier(now) {
            return Step::none();
        }
        if ack.result == MavResult::MAV_RESULT_IN_PROGRESS {
            running.progressed(now, ack);
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
        self.running.retain(|&(vehicle, command), running| {
            let (send, due) = running.tick(now, vehicle);
            step.send.extend(send);
            if due == Due::GiveUp {
                let tries = running.tries;
                step.events.push(Outcome {
                    vehicle,
                    command,
                    result: Err(CommandError::NoAnswer { tries }),
                });
            }
            due != Due::GiveUp
        });
        step
    }
}

fn cancel_message(vehicle: Address, command: u16) -> Message {
    Message::COMMAND_CANCEL(COMMAND_CANCEL_DATA {
        command,
        target_system: vehicle.system.0,
        target_component: vehicle.component.0,
    })
}
