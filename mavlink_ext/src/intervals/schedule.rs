//! The sending end: which message is due when.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use super::{MESSAGE_INTERVAL, Rate};
use crate::command::Incoming;
use crate::dialect::tandem::{MESSAGE_INTERVAL_DATA, MavResult};
use crate::dialect::{Message, cmd};
use crate::wire::Address;

/// Messages that can be asked for, and when each is due. One for each link: rates are of a link.
#[derive(Clone, Debug)]
pub struct Schedule {
    own: Address,
    shortest: Duration,
    entries: BTreeMap<u32, Entry>,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    default: Option<Duration>,
    interval: Option<Duration>,
    /// When it goes next; it may go once though it has no interval.
    due: Option<Stamp>,
}

impl Schedule {
    /// Nothing to send yet. Nothing is sent more often than once in `shortest`, whatever is asked for.
    pub fn new(own: Address, shortest: Duration) -> Self {
        Self {
            own,
            shortest: shortest.max(Duration::from_millis(1)),
            entries: BTreeMap::new(),
        }
    }

    /// Offers a message: sent once in so long unless somebody wants it otherwise, or only if somebody wants it.
    pub fn offer(&mut self, now: Stamp, message: u32, default: Option<Duration>) {
        let default = default.map(|interval| interval.max(self.shortest));
        let entry = Entry {
            default,
            interval: default,
            due: default.map(|_| now),
        };
        self.entries.insert(message, entry);
    }

    /// Time between two of a message; `None` if it is off or not offered.
    pub fn interval(&self, message: u32) -> Option<Duration> {
        self.entries.get(&message)?.interval
    }

    /// Tells it of any message that came in: what to answer. `None` for all but commands about messages that it
    /// offers, or about intervals.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Option<Vec<Message>> {
        let command = Incoming::parse(self.own, from, message)?;
        let [first, second, ..] = command.params;
        let told = match command.command {
            cmd::SET_MESSAGE_INTERVAL => {
                let wanted = id(first).zip(Rate::from_param(second));
                let done = wanted.and_then(|(message, rate)| self.set(now, message, rate));
                return Some(vec![command.ack(result(done.is_some()))]);
            }
            cmd::GET_MESSAGE_INTERVAL => id(first),
            cmd::REQUEST_MESSAGE if id(first) == Some(MESSAGE_INTERVAL) => id(second),
            cmd::REQUEST_MESSAGE => {
                let entry = self.entries.get_mut(&id(first)?)?;
                entry.due = Some(now);
                return Some(vec![command.ack(MavResult::MAV_RESULT_ACCEPTED)]);
            }
            _ => return None,
        };
        let told = told.and_then(|message| self.message_interval(message));
        let mut answers = vec![command.ack(result(told.is_some()))];
        answers.extend(told);
        Some(answers)
    }

    fn set(&mut self, now: Stamp, message: u32, rate: Rate) -> Option<()> {
        let shortest = self.shortest;
        let entry = self.entries.get_mut(&message)?;
        entry.interval = match rate {
            Rate::Every(interval) => Some(interval.max(shortest)),
            Rate::Default => entry.default,
            Rate::Off => None,
        };
        entry.due = entry.interval.map(|_| now);
        Some(())
    }

    /// `MESSAGE_INTERVAL`: 0 for what is not offered. `None` for an id that does not fit the message.
    fn message_interval(&self, message: u32) -> Option<Message> {
        let message_id = u16::try_from(message).ok()?;
        let interval_us = match self.entries.get(&message).map(|entry| entry.interval) {
            None => 0,
            Some(None) => -1,
            Some(Some(interval)) => i32::try_from(interval.as_micros()).unwrap_or(i32::MAX),
        };
        Some(Message::MESSAGE_INTERVAL(MESSAGE_INTERVAL_DATA {
            interval_us,
            message_id,
        }))
    }

    /// The messages that are due, in the order of their ids; each is due again after its interval. What was missed in a
    /// stall is not made up for.
    pub fn due(&mut self, now: Stamp) -> Vec<u32> {
        let mut due = Vec::new();
        for (message, entry) in &mut self.entries {
            let Some(at) = entry.due.filter(|at| *at <= now) else {
                continue;
            };
            due.push(*message);
            entry.due = entry.interval.map(|interval| {
                let next = at + interval;
                if next > now { next } else { now + interval }
            });
        }
        due
    }

    /// When the next message is due; `None` if nothing is to be sent.
    pub fn next_due(&self) -> Option<Stamp> {
        self.entries.values().filter_map(|entry| entry.due).min()
    }
}

fn result(done: bool) -> MavResult {
    if done {
        MavResult::MAV_RESULT_ACCEPTED
    } else {
        MavResult::MAV_RESULT_DENIED
    }
}

/// The message id in a parameter: whole and of 24 bits.
fn id(param: f32) -> Option<u32> {
    let fits = (0.0..16_777_216.0).contains(&param) && param.fract() == 0.0;
    fits.then_some(param as u32)
}
