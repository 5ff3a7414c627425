//! The asking end.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use super::wish::{Way, Wish};
use super::{IntervalEvent, MESSAGE_INTERVAL, Rate};
use crate::command::{self, CommandError, Outcome, Request};
use crate::dialect::tandem::{MavResult, REQUEST_DATA_STREAM_DATA};
use crate::dialect::{Message, MessageExt as _, cmd};
use crate::service::{Ends, Step};
use crate::wire::Address;

/// Messages wanted at most.
const MAX_WISHES: usize = 256;

/// How the vehicle is asked how often it sends a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Question {
    /// `MAV_CMD_GET_MESSAGE_INTERVAL`, which all know that know intervals at all.
    Get,
    /// `MAV_CMD_REQUEST_MESSAGE`, which has taken its place.
    Request,
    /// Not at all: it knows neither.
    None,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asked {
    For(u32),
    About(u32),
}

/// Asks one vehicle for messages, and sees to it that they come. It sends its commands itself, one at a time, since
/// acknowledgements do not name the message: nobody else at our address should send `MAV_CMD_SET_MESSAGE_INTERVAL` to that
/// vehicle.
#[derive(Clone, Debug)]
pub struct Client {
    ends: Ends,
    commands: command::Client,
    wishes: BTreeMap<u32, Wish>,
    question: Question,
    asked: Option<Asked>,
}

impl Client {
    /// Wants nothing yet.
    pub fn new(ends: Ends) -> Self {
        Self {
            ends,
            commands: command::Client::new(ends.own),
            wishes: BTreeMap::new(),
            question: Question::Get,
            asked: None,
        }
    }

    /// Wants a message at this rate from now on, in place of what was wanted of it before. Asked for at the next tick.
    /// More than 256 messages are not wanted.
    pub fn want(&mut self, now: Stamp, message: u32, rate: Rate) {
        // A message more often than a thousand times a second is a mistake.
        let rate = match rate {
            Rate::Every(interval) => Rate::Every(interval.max(Duration::from_millis(1))),
            Rate::Default | Rate::Off => rate,
        };
        if self.wishes.len() < MAX_WISHES || self.wishes.contains_key(&message) {
            self.wishes.insert(message, Wish::new(now, message, rate));
        }
    }

    /// Cares for this message no longer; the vehicle goes on sending it.
    pub fn forget(&mut self, message: u32) {
        self.wishes.remove(&message);
    }

    /// The vehicle is there again, perhaps another one: everything is asked for anew, what it could not do before, too.
    pub fn peer_appeared(&mut self, now: Stamp) {
        self.question = Question::Get;
        for (message, wish) in &mut self.wishes {
            *wish = Wish::new(now, *message, wish.rate());
        }
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<IntervalEvent> {
        let mut step = Step::none();
        if from != self.ends.peer {
            return step;
        }
        if let Some(wish) = self.wishes.get_mut(&message.message_id()) {
            wish.arrived();
        }
        if let Message::MESSAGE_INTERVAL(told) = message
            && let Some(wish) = self.wishes.get_mut(&u32::from(told.message_id))
        {
            step.events.extend(wish.told(now, told.interval_us));
        }
        for outcome in self.commands.handle(now, from, message).events {
            step.events.extend(self.ended(now, &outcome));
            step.send.extend(self.ask(now));
        }
        step
    }

    /// Lets time pass: asks, counts what arrived, and repeats.
    pub fn tick(&mut self, now: Stamp) -> Step<IntervalEvent> {
        let commands = self.commands.tick(now);
        let mut step = Step {
            send: commands.send,
            events: Vec::new(),
        };
        for outcome in commands.events {
            step.events.extend(self.ended(now, &outcome));
        }
        for (message, wish) in &mut self.wishes {
            let can_ask = self.question.about(*message).is_some();
            step.events.extend(wish.tick(now, can_ask));
        }
        self.ask_for_streams(now, &mut step.send);
        step.send.extend(self.ask(now));
        step
    }

    /// The command in flight has come to its end.
    fn ended(&mut self, now: Stamp, outcome: &Outcome) -> Option<IntervalEvent> {
        match self.asked.take()? {
            Asked::For(message) => {
                let wish = self.wishes.get_mut(&message)?;
                wish.answered(now, outcome.result)
            }
            Asked::About(message) => {
                let unsupported = Err(CommandError::Refused {
                    result: MavResult::MAV_RESULT_UNSUPPORTED,
                });
                if outcome.result == unsupported {
                    self.question = match self.question {
                        Question::Get => Question::Request,
                        Question::Request | Question::None => Question::None,
                    };
                }
                self.wishes.get_mut(&message)?.question_ended(now);
                None
            }
        }
    }

    /// The next command, of the wish that waits for longest.
    fn ask(&mut self, now: Stamp) -> Option<Message> {
        if self.asked.is_some() {
            return None;
        }
        let by_interval = |wish: &Wish| wish.way() == Way::Interval;
        let due = (self.wishes.iter())
            .filter(|(_, wish)| by_interval(wish))
            .filter_map(|(id, wish)| wish.due(now).map(|since| (since, Asked::For(*id))));
        let doubted = (self.wishes.iter())
            .filter(|(id, _)| self.question.about(**id).is_some())
            .filter_map(|(id, wish)| wish.doubted(now).map(|since| (since, Asked::About(*id))));
        let (_, asked) = due.chain(doubted).min_by_key(|(since, _)| *since)?;
        let request = match asked {
            Asked::For(message) => {
                let wish = self.wishes.get_mut(&message)?;
                wish.asked();
                let params = [message as f32, wish.rate().to_param()];
                Request::long(cmd::SET_MESSAGE_INTERVAL, &params)
            }
            Asked::About(message) => {
                let request = self.question.about(message)?;
                self.wishes.get_mut(&message)?.asked_about(now);
                request
            }
        };
        // None of them is under way: one at a time.
        let message = self.commands.start(now, self.ends.peer, request).ok()?;
        self.asked = Some(asked);
        Some(message)
    }

    fn ask_for_streams(&mut self, now: Stamp, send: &mut Vec<Message>) {
        let stream = |wish: &Wish| match wish.way() {
            Way::Stream(stream) => Some(stream),
            Way::Interval => None,
        };
        let is_due = |wish: &&Wish| wish.due(now).is_some();
        let next = |wishes: &BTreeMap<u32, Wish>| wishes.values().filter(is_due).find_map(stream);
        // Asking for one makes all of its messages wait.
        while let Some(id) = next(&self.wishes) {
            let of_stream = |wish: &&mut Wish| stream(wish) == Some(id);
            let mut rate_hz = 1;
            for wish in self.wishes.values_mut().filter(of_stream) {
                if let Rate::Every(interval) = wish.rate() {
                    rate_hz = rate_hz.max((1.0 / interval.as_secs_f64()).ceil() as u16);
                }
                if wish.due(now).is_some() {
                    wish.stream_asked(now);
                }
            }
            send.push(Message::REQUEST_DATA_STREAM(REQUEST_DATA_STREAM_DATA {
                req_message_rate: rate_hz,
                target_system: self.ends.peer.system.0,
                target_component: self.ends.peer.component.0,
                req_stream_id: id,
                start_stop: 1,
            }));
        }
    }
}

impl Question {
    /// Asks about a message; `None` where the answer could not name it.
    fn about(self, message: u32) -> Option<Request> {
        let message = u16::try_from(message).ok()?;
        let message = f32::from(message);
        match self {
            Self::Get => Some(Request::long(cmd::GET_MESSAGE_INTERVAL, &[message])),
            Self::Request => {
                let params = [MESSAGE_INTERVAL as f32, message];
                Some(Request::long(cmd::REQUEST_MESSAGE, &params))
            }
            Self::None => None,
        }
    }
}
