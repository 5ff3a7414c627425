//! Orders as objects the operator can watch: sent, repeated, accepted or denied with the reason, seen or not in telemetry.
//!
//! ```text
//! sent ─► retry n/N ─► accepted ─► confirmed by telemetry
//!                  ├─► denied (reason, and what the vehicle said about it)
//!                  └─► no answer
//! ```

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::SystemId;

use crate::command::Order;

/// How many orders are kept.
const KEPT: usize = 100;
/// A vehicle explains a denial shortly after it.
const EXPLAINED_WITHIN: Duration = Duration::from_secs(2);
/// An accepted order whose effect telemetry does not show within this time is a caution.
pub const EFFECT_WITHIN: Duration = Duration::from_secs(5);

/// What has become of an order.
#[derive(Clone, Debug, PartialEq)]
pub enum OrderState {
    /// On its way, for the `attempt`-th time.
    Sent {
        /// From 1.
        attempt: u8,
        /// How often it is tried.
        of: u8,
    },
    /// The vehicle works on it.
    InProgress {
        /// How far, if it says so.
        percent: Option<u8>,
    },
    /// The vehicle agreed. What it does is seen in telemetry.
    Accepted,
    /// The vehicle refused.
    Denied {
        /// Its `MAV_RESULT` in words.
        result: String,
    },
    /// It never answered.
    NoAnswer,
    /// Not answered before a newer one took its place; the vehicle may have heard it.
    Superseded,
    /// It was never sent: why.
    Refused(String),
}

/// One order to one vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct SentOrder {
    /// Counted from 0 over all orders.
    pub id: u64,
    /// To whom.
    pub vehicle: SystemId,
    /// What.
    pub order: Order,
    /// When it was first sent.
    pub sent_at: Stamp,
    /// When the answer came.
    pub answered_at: Option<Stamp>,
    /// What has become of it.
    pub state: OrderState,
    /// What the vehicle said meanwhile and shortly after: why it refuses, as a rule.
    pub texts: Vec<String>,
    /// When telemetry first showed the effect.
    pub confirmed_at: Option<Stamp>,
}

impl SentOrder {
    /// Whether the vehicle can still answer.
    pub fn is_open(&self) -> bool {
        matches!(
            self.state,
            OrderState::Sent { .. } | OrderState::InProgress { .. }
        )
    }

    /// Why it came to nothing; `None` if it did not.
    pub fn failure(&self) -> Option<String> {
        let words = match &self.state {
            OrderState::Denied { result } => format!("denied: {result}"),
            OrderState::NoAnswer => "no answer".to_owned(),
            OrderState::Superseded => "not answered before a newer order took its place".to_owned(),
            OrderState::Refused(why) => format!("not sent: {why}"),
            OrderState::Sent { .. } | OrderState::InProgress { .. } | OrderState::Accepted => {
                return None;
            }
        };
        if self.texts.is_empty() {
            return Some(words);
        }
        Some(format!("{words} ({})", self.texts.join("; ")))
    }

    /// Accepted a while ago, and telemetry does not show it.
    pub fn is_without_effect(&self, now: Stamp) -> bool {
        let accepted = self.state == OrderState::Accepted && self.confirmed_at.is_none();
        accepted
            && self
                .answered_at
                .is_some_and(|at| now.since(at) > EFFECT_WITHIN)
    }

    fn listens(&self, now: Stamp) -> bool {
        match self.state {
            OrderState::Sent { .. } | OrderState::InProgress { .. } => true,
            OrderState::Denied { .. } => self
                .answered_at
                .is_some_and(|at| now.since(at) <= EXPLAINED_WITHIN),
            OrderState::Accepted
            | OrderState::NoAnswer
            | OrderState::Superseded
            | OrderState::Refused(_) => false,
        }
    }
}

/// The last orders.
#[derive(Clone, Debug, Default)]
pub struct Orders {
    list: VecDeque<SentOrder>,
    next_id: u64,
}

impl Orders {
    /// Notes a new order and gives its id.
    pub fn add(&mut self, now: Stamp, vehicle: SystemId, order: Order, state: OrderState) -> u64 {
        let id = self.next_id;
        self.next_id += 1;
        if self.list.len() == KEPT {
            self.list.pop_back();
        }
        let answered_at = matches!(state, OrderState::Refused(_)).then_some(now);
        self.list.push_front(SentOrder {
            id,
            vehicle,
            order,
            sent_at: now,
            answered_at,
            state,
            texts: Vec::new(),
            confirmed_at: None,
        });
        id
    }

    /// The newest first.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &SentOrder> {
        self.list.iter()
    }

    /// The newest first, to be changed.
    pub(crate) fn iter_mut(&mut self) -> impl Iterator<Item = &mut SentOrder> {
        self.list.iter_mut()
    }

    /// The order with this id, while it is kept.
    pub fn get_mut(&mut self, id: u64) -> Option<&mut SentOrder> {
        self.list.iter_mut().find(|order| order.id == id)
    }

    /// Puts what a vehicle said to the order it is about.
    pub fn hear(&mut self, now: Stamp, vehicle: SystemId, text: &str) {
        let about = self
            .list
            .iter_mut()
            .find(|order| order.vehicle == vehicle && order.listens(now));
        if let Some(order) = about
            && order.texts.len() < 5
            && !order.texts.iter().any(|known| known == text)
        {
            order.texts.push(text.to_owned());
        }
    }
}
