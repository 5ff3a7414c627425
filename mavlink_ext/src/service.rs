//! What the services have in common: they are pure, take `(now, message)` and return what to send and what happened.

use std::time::Duration;

use maps::time::Stamp;

use crate::dialect::{Message, MessageExt as _};
use crate::wire::Address;

/// What a service wants done after it was told something.
#[derive(Clone, Debug, PartialEq)]
pub struct Step<Event> {
    /// Messages to send, in this order.
    pub send: Vec<Message>,
    /// What the owner should know, in this order.
    pub events: Vec<Event>,
}

impl<Event> Default for Step<Event> {
    fn default() -> Self {
        Self {
            send: Vec::new(),
            events: Vec::new(),
        }
    }
}

impl<Event> Step<Event> {
    /// Nothing to do.
    pub fn none() -> Self {
        Self::default()
    }

    /// Only this is to be sent.
    pub fn send(message: Message) -> Self {
        Self {
            send: vec![message],
            events: Vec::new(),
        }
    }

    /// Only this has happened.
    pub fn event(event: Event) -> Self {
        Self {
            send: Vec::new(),
            events: vec![event],
        }
    }

    /// Adds another step after this one.
    pub fn extend(&mut self, later: Self) {
        self.send.extend(later.send);
        self.events.extend(later.events);
    }
}

/// The two ends of a conversation, seen from one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ends {
    /// Ours.
    pub own: Address,
    /// The other.
    pub peer: Address,
}

impl Ends {
    /// Whether the message comes from the peer and is meant for us.
    pub fn accept(self, from: Address, message: &Message) -> bool {
        from == self.peer && is_for(self.own, message)
    }
}

/// Whether the message is meant for this address: it names it, or names nobody.
pub fn is_for(own: Address, message: &Message) -> bool {
    let target = Address::new(
        message.target_system_id().unwrap_or(0),
        message.target_component_id().unwrap_or(0),
    );
    own.is_addressed_by(target)
}

/// When to ask again, and when to give up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Retry {
    interval: Duration,
    /// Silence after the last try that is still borne.
    patience: Duration,
    tries_left: u32,
    due: Stamp,
}

/// What [`Retry::check`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Due {
    /// Not yet.
    Nothing,
    /// Ask again.
    Again,
    /// Nobody answers.
    GiveUp,
}

impl Retry {
    /// Asked for the first time at `now`; asked again `retries` times.
    pub(crate) fn new(now: Stamp, interval: Duration, retries: u32) -> Self {
        Self {
            interval,
            patience: interval,
            tries_left: retries,
            due: now + interval,
        }
    }

    /// With more silence allowed after the last try.
    pub(crate) fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    pub(crate) fn check(&mut self, now: Stamp) -> Due {
        if now < self.due {
            return Due::Nothing;
        }
        if self.tries_left == 0 {
            return Due::GiveUp;
        }
        self.tries_left -= 1;
        self.due = now
            + if self.tries_left == 0 {
                self.patience
            } else {
                self.interval
            };
        Due::Again
    }
}
