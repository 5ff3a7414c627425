//! The client that gives a vehicle a mission, or takes it away.

use maps::time::Stamp;

use super::{ITEM_TIMEOUT, MISSION, MissionError, MissionItem, RESPONSE_TIMEOUT, RETRIES};
use crate::dialect::Message;
use crate::dialect::tandem::{
    MISSION_ACK_DATA, MISSION_CLEAR_ALL_DATA, MISSION_COUNT_DATA, MavMissionResult,
};
use crate::service::{Due, Ends, Retry, Step};

/// An upload under way. Its one event is how it ended; after that it does nothing.
#[derive(Clone, Debug)]
pub struct Upload {
    ends: Ends,
    items: Vec<MissionItem>,
    /// How the vehicle last asked: the newest thing to repeat.
    last_sent: Message,
    /// Items that the vehicle has asked for, from the first on.
    asked: usize,
    retry: Option<Retry>,
}

impl Upload {
    /// Begins to upload. The mission replaces the vehicle's; an empty one clears it.
    pub fn start(
        now: Stamp,
        ends: Ends,
        items: Vec<MissionItem>,
    ) -> Result<(Self, Message), MissionError> {
        let count = u16::try_from(items.len())
            .map_err(|_too_many| MissionError::TooLong { items: items.len() })?;
        let message = Message::MISSION_COUNT(MISSION_COUNT_DATA {
            count,
            target_system: ends.peer.system.0,
            target_component: ends.peer.component.0,
            mission_type: MISSION,
            opaque_id: 0,
        });
        let upload = Self {
            ends,
            items,
            last_sent: message.clone(),
            asked: 0,
            retry: Some(Retry::new(now, RESPONSE_TIMEOUT, RETRIES)),
        };
        Ok((upload, message))
    }

    /// Items that the vehicle has asked for, and all items.
    pub fn progress(&self) -> (usize, usize) {
        (self.asked, self.items.len())
    }

    /// The mission that is uploaded.
    pub fn items(&self) -> &[MissionItem] {
        &self.items
    }

    /// Tells it of any message that came in.
    pub fn handle(
        &mut self,
        now: Stamp,
        from: crate::Address,
        message: &Message,
    ) -> Step<Result<(), MissionError>> {
        if self.retry.is_none() || !self.ends.accept(from, message) {
            return Step::none();
        }
        match message {
            Message::MISSION_REQUEST_INT(request) if request.mission_type == MISSION => {
                self.answer(now, request.seq)
            }
            Message::MISSION_REQUEST(request) if request.mission_type == MISSION => {
                self.answer(now, request.seq)
            }
            Message::MISSION_ACK(ack) if ack.mission_type == MISSION => self.acknowledged(ack),
            _ => Step::none(),
        }
    }

    /// `MISSION_REQUEST` is what old vehicles send; it too is answered with the precise item, as the specification asks.
    fn answer(&mut self, now: Stamp, seq: u16) -> Step<Result<(), MissionError>> {
        let Some(item) = self.items.get(usize::from(seq)) else {
            return Step::none();
        };
        let message = Message::MISSION_ITEM_INT(item.to_message(seq, self.ends.peer, MISSION));
        self.last_sent = message.clone();
        self.asked = self.asked.max(usize::from(seq) + 1);
        // The vehicle asks again by itself, some only after a second: be patient at the end.
        let retry = Retry::new(now, ITEM_TIMEOUT, RETRIES).with_patience(RESPONSE_TIMEOUT);
        self.retry = Some(retry);
        Step::send(message)
    }

    fn acknowledged(&mut self, ack: &MISSION_ACK_DATA) -> Step<Result<(), MissionError>> {
        let result = match ack.mavtype {
            MavMissionResult::MAV_MISSION_ACCEPTED if self.asked == self.items.len() => Ok(()),
            MavMissionResult::MAV_MISSION_ACCEPTED => Err(MissionError::Incomplete {
                done: self.asked,
                total: self.items.len(),
            }),
            // ArduPilot says so of a repeated item, and goes on.
            MavMissionResult::MAV_MISSION_INVALID_SEQUENCE => return Step::none(),
            result => Err(MissionError::Refused {
                result,
                item: self.asked.saturating_sub(1),
            }),
        };
        self.retry = None;
        Step::event(result)
    }

    /// Lets time pass: repeats what was not answered, and gives up in the end.
    pub fn tick(&mut self, now: Stamp) -> Step<Result<(), MissionError>> {
        match self.retry.as_mut().map(|retry| retry.check(now)) {
            None | Some(Due::Nothing) => Step::none(),
            Some(Due::Again) => Step::send(self.last_sent.clone()),
            Some(Due::GiveUp) => {
                self.retry = None;
                Step::event(Err(MissionError::NoAnswer {
                    done: self.asked,
                    total: self.items.len(),
                }))
            }
        }
    }
}

/// A clearing of the vehicle's mission under way. Its one event is how it ended.
#[derive(Clone, Debug)]
pub struct Clear {
    ends: Ends,
    message: Message,
    retry: Option<Retry>,
}

impl Clear {
    /// Begins to clear.
    pub fn start(now: Stamp, ends: Ends) -> (Self, Message) {
        let message = Message::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
            target_system: ends.peer.system.0,
            target_component: ends.peer.component.0,
            mission_type: MISSION,
        });
        let clear = Self {
            ends,
            message: message.clone(),
            retry: Some(Retry::new(now, RESPONSE_TIMEOUT, RETRIES)),
        };
        (clear, message)
    }

    /// Tells it of any message that came in.
    pub fn handle(
        &mut self,
        from: crate::Address,
        message: &Message,
    ) -> Step<Result<(), MissionError>> {
        let Message::MISSION_ACK(ack) = message else {
            return Step::none();
        };
        if self.retry.is_none() || !self.ends.accept(from, message) || ack.mission_type != MISSION {
            return Step::none();
        }
        self.retry = None;
        Step::event(match ack.mavtype {
            MavMissionResult::MAV_MISSION_ACCEPTED => Ok(()),
            result => Err(MissionError::Refused { result, item: 0 }),
        })
    }

    /// Lets time pass.
    pub fn tick(&mut self, now: Stamp) -> Step<Result<(), MissionError>> {
        match self.retry.as_mut().map(|retry| retry.check(now)) {
            None | Some(Due::Nothing) => Step::none(),
            Some(Due::Again) => Step::send(self.message.clone()),
            Some(Due::GiveUp) => {
                self.retry = None;
                Step::event(Err(MissionError::NoAnswer { done: 0, total: 0 }))
            }
        }
    }
}
