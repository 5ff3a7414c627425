//! The client that reads a vehicle's mission.

use maps::time::Stamp;

use super::{ITEM_TIMEOUT, MISSION, MissionError, MissionItem, RESPONSE_TIMEOUT, RETRIES};
use crate::convert::ItemError;
use crate::dialect::Message;
use crate::dialect::tandem::{
    MISSION_ACK_DATA, MISSION_REQUEST_INT_DATA, MISSION_REQUEST_LIST_DATA, MavMissionResult,
};
use crate::service::{Due, Ends, Retry, Step};
use crate::wire::Address;

/// A download under way. Its one event is the mission, or why there is none; after that it does nothing.
#[derive(Clone, Debug)]
pub struct Download {
    ends: Ends,
    state: State,
    retry: Retry,
}

#[derive(Clone, Debug)]
enum State {
    /// Waiting for the number of items.
    Listing,
    /// Waiting for the item after those we have.
    Reading {
        total: usize,
        items: Vec<MissionItem>,
    },
    Finished,
}

type Outcome = Result<Vec<MissionItem>, MissionError>;

impl Download {
    /// Begins to download.
    pub fn start(now: Stamp, ends: Ends) -> (Self, Message) {
        let download = Self {
            ends,
            state: State::Listing,
            retry: Retry::new(now, RESPONSE_TIMEOUT, RETRIES),
        };
        let message = download.list();
        (download, message)
    }

    /// Items read, and all items; 0 while that is not known.
    pub fn progress(&self) -> (usize, usize) {
        match &self.state {
            State::Reading { total, items } => (items.len(), *total),
            State::Listing | State::Finished => (0, 0),
        }
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<Outcome> {
        if !self.ends.accept(from, message) {
            return Step::none();
        }
        match (&self.state, message) {
            (State::Listing, Message::MISSION_COUNT(count)) if count.mission_type == MISSION => {
                self.state = State::Reading {
                    total: usize::from(count.count),
                    items: Vec::new(),
                };
                self.advance(now)
            }
            (State::Reading { .. }, Message::MISSION_ITEM_INT(item))
                if item.mission_type == MISSION =>
            {
                self.received(now, item.seq, MissionItem::from_message(item))
            }
            (State::Reading { .. }, Message::MISSION_ITEM(item))
                if item.mission_type == MISSION =>
            {
                self.received(now, item.seq, MissionItem::from_float_message(item))
            }
            (State::Listing | State::Reading { .. }, Message::MISSION_ACK(ack))
                if ack.mission_type == MISSION
                    && ack.mavtype != MavMissionResult::MAV_MISSION_ACCEPTED =>
            {
                let item = self.progress().0;
                self.finish(Err(MissionError::Refused {
                    result: ack.mavtype,
                    item,
                }))
            }
            _ => Step::none(),
        }
    }

    /// An item out of turn is dropped: the one that is due will be asked for again.
    fn received(
        &mut self,
        now: Stamp,
        seq: u16,
        item: Result<MissionItem, ItemError>,
    ) -> Step<Outcome> {
        let State::Reading { items, .. } = &mut self.state else {
            return Step::none();
        };
        if usize::from(seq) != items.len() {
            return Step::none();
        }
        match item {
            Ok(item) => {
                items.push(item);
                self.advance(now)
            }
            Err(source) => {
                let mut step = Step::send(self.ack(MavMissionResult::MAV_MISSION_UNSUPPORTED));
                step.extend(self.finish(Err(MissionError::Item {
                    item: usize::from(seq),
                    source,
                })));
                step
            }
        }
    }

    /// Asks for the next item, or ends.
    fn advance(&mut self, now: Stamp) -> Step<Outcome> {
        let State::Reading { total, items } = &mut self.state else {
            return Step::none();
        };
        if items.len() < *total {
            let message = self.question();
            self.retry = Retry::new(now, ITEM_TIMEOUT, RETRIES).with_patience(RESPONSE_TIMEOUT);
            return Step::send(message);
        }
        let items = std::mem::take(items);
        let mut step = Step::send(self.ack(MavMissionResult::MAV_MISSION_ACCEPTED));
        step.extend(self.finish(Ok(items)));
        step
    }

    fn finish(&mut self, outcome: Outcome) -> Step<Outcome> {
        self.state = State::Finished;
        Step::event(outcome)
    }

    /// What we wait to be answered.
    fn question(&self) -> Message {
        match &self.state {
            State::Reading { items, .. } => {
                Message::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
                    seq: items.len() as u16,
                    target_system: self.ends.peer.system.0,
                    target_component: self.ends.peer.component.0,
                    mission_type: MISSION,
                })
            }
            State::Listing | State::Finished => self.list(),
        }
    }

    fn list(&self) -> Message {
        Message::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
            target_system: self.ends.peer.system.0,
            target_component: self.ends.peer.component.0,
            mission_type: MISSION,
        })
    }

    fn ack(&self, result: MavMissionResult) -> Message {
        Message::MISSION_ACK(MISSION_ACK_DATA {
            target_system: self.ends.peer.system.0,
            target_component: self.ends.peer.component.0,
            mavtype: result,
            mission_type: MISSION,
            opaque_id: 0,
        })
    }

    /// Lets time pass.
    pub fn tick(&mut self, now: Stamp) -> Step<Outcome> {
        if matches!(self.state, State::Finished) {
            return Step::none();
        }
        match self.retry.check(now) {
            Due::Nothing => Step::none(),
            Due::Again => Step::send(self.question()),
            Due::GiveUp => {
                let (done, total) = self.progress();
                self.finish(Err(MissionError::NoAnswer { done, total }))
            }
        }
    }
}
