//! The vehicle's end: stores one plan, and answers for plans of other kinds that it has none.
//!
//! A vehicle with a fence has two: one of its mission, which answers for rally points too, and one of its fence, which is
//! told of messages of its own kind only.

use maps::time::Stamp;

use super::{ITEM_TIMEOUT, MISSION, MissionItem, RESPONSE_TIMEOUT, RETRIES};
use crate::convert::ItemError;
use crate::dialect::tandem::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_REQUEST_INT_DATA, MavMissionResult,
    MavMissionType,
};
use crate::dialect::{Message, MessageData as _, tandem::MISSION_ITEM_INT_DATA};
use crate::service::{Due, Retry, Step, is_for};
use crate::wire::Address;

/// Items that a server stores.
pub const MAX_ITEMS: usize = 1000;

/// What a client did to the stored mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissionChange {
    /// There is a new mission with this many items; 0 when it was cleared.
    Replaced {
        /// How many.
        items: usize,
    },
}

/// Whether a vehicle can do an item.
type Accept = fn(&MissionItem) -> Result<(), MavMissionResult>;
/// Whether a plan as a whole makes sense.
type AcceptAll = fn(&[MissionItem]) -> Result<(), MavMissionResult>;

/// A vehicle's storage of its mission, or of a plan of another kind.
#[derive(Clone, Debug)]
pub struct Server {
    own: Address,
    kind: MavMissionType,
    accept: Accept,
    accept_all: AcceptAll,
    items: Vec<MissionItem>,
    current: u16,
    receiving: Option<Receiving>,
    /// Whose upload was completed last: a repeated last item says that our acknowledgement was lost.
    completed: Option<Address>,
}

/// A mission that is being uploaded; the stored one stays until it is complete.
#[derive(Clone, Debug)]
struct Receiving {
    client: Address,
    total: usize,
    items: Vec<MissionItem>,
    retry: Retry,
}

impl Server {
    /// An empty mission. `accept` says which items the vehicle can do.
    pub fn new(own: Address, accept: Accept) -> Self {
        Self::of_kind(own, MISSION, (accept, |_| Ok(())))
    }

    /// An empty plan of that kind. The first function says which items the vehicle can do, the second one, asked when all
    /// have come, whether they make sense together.
    pub fn of_kind(
        own: Address,
        kind: MavMissionType,
        (accept, accept_all): (Accept, AcceptAll),
    ) -> Self {
        Self {
            own,
            kind,
            accept,
            accept_all,
            items: Vec::new(),
            current: 0,
            receiving: None,
            completed: None,
        }
    }

    /// The stored mission.
    pub fn items(&self) -> &[MissionItem] {
        &self.items
    }

    /// Which item is to be marked current when the mission is read.
    pub fn set_current(&mut self, seq: u16) {
        self.current = seq;
    }

    /// Stores a mission from within, such as a home position.
    pub fn set_items(&mut self, items: Vec<MissionItem>) {
        self.items = items;
        self.completed = None;
    }

    /// Changes with every mission: the CRC32C of its items as they travel; 0 if there is none. For
    /// `MISSION_CURRENT.mission_id`.
    pub fn mission_id(&self) -> u32 {
        let mut crc = 0;
        for (seq, item) in self.items.iter().enumerate() {
            let mut payload = [0; MISSION_ITEM_INT_DATA::ENCODED_LEN];
            item.to_message(seq as u16, Address::ALL, self.kind)
                .ser(mavlink_core::MavlinkVersion::V2, &mut payload);
            crc = crc32c::crc32c_append(crc, &payload);
        }
        crc
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<MissionChange> {
        if !is_for(self.own, message) {
            return Step::none();
        }
        match message {
            Message::MISSION_COUNT(count) => self.begin(now, from, count),
            Message::MISSION_ITEM_INT(item) => {
                let typed = MissionItem::from_message(item);
                self.received(now, from, (item.mission_type, item.seq, typed))
            }
            Message::MISSION_ITEM(item) => {
                let typed = MissionItem::from_float_message(item);
                self.received(now, from, (item.mission_type, item.seq, typed))
            }
            Message::MISSION_REQUEST_LIST(list) => {
                let count = self.stored(list.mission_type).len() as u16;
                Step::send(Message::MISSION_COUNT(MISSION_COUNT_DATA {
                    count,
                    target_system: from.system.0,
                    target_component: from.component.0,
                    mission_type: list.mission_type,
                    opaque_id: if list.mission_type == self.kind {
                        self.mission_id()
                    } else {
                        0
                    },
                }))
            }
            // "A system that gets this request should respond with MISSION_ITEM_INT."
            Message::MISSION_REQUEST(request) => self.read(from, request.seq, request.mission_type),
            Message::MISSION_REQUEST_INT(request) => {
                self.read(from, request.seq, request.mission_type)
            }
            Message::MISSION_CLEAR_ALL(clear) => self.clear(from, clear.mission_type),
            Message::MISSION_REQUEST_PARTIAL_LIST(list) => Step::send(ack(
                from,
                MavMissionResult::MAV_MISSION_UNSUPPORTED,
                list.mission_type,
            )),
            Message::MISSION_WRITE_PARTIAL_LIST(list) => Step::send(ack(
                from,
                MavMissionResult::MAV_MISSION_UNSUPPORTED,
                list.mission_type,
            )),
            Message::MISSION_ACK(_) => self.cancelled(from),
            _ => Step::none(),
        }
    }

    fn stored(&self, mission_type: MavMissionType) -> &[MissionItem] {
        if mission_type == self.kind {
            &self.items
        } else {
            &[]
        }
    }

    fn read(&self, to: Address, seq: u16, mission_type: MavMissionType) -> Step<MissionChange> {
        match self.stored(mission_type).get(usize::from(seq)) {
            Some(item) => {
                let mut item = item.to_message(seq, to, self.kind);
                item.current = u8::from(seq == self.current);
                Step::send(Message::MISSION_ITEM_INT(item))
            }
            None => invalid_sequence(to, mission_type),
        }
    }

    fn begin(
        &mut self,
        now: Stamp,
        from: Address,
        count: &MISSION_COUNT_DATA,
    ) -> Step<MissionChange> {
        let refuse = |result| Step::send(ack(from, result, count.mission_type));
        let total = usize::from(count.count);
        if count.mission_type != self.kind {
            return refuse(if total == 0 {
                MavMissionResult::MAV_MISSION_ACCEPTED
            } else {
                MavMissionResult::MAV_MISSION_UNSUPPORTED
            });
        }
        if total > MAX_ITEMS {
            return refuse(MavMissionResult::MAV_MISSION_NO_SPACE);
        }
        let busy = self.receiving.as_ref();
        if busy.is_some_and(|receiving| receiving.client != from) {
            return refuse(MavMissionResult::MAV_MISSION_DENIED);
        }
        if total == 0 {
            return self.clear(from, self.kind);
        }
        self.receiving = Some(Receiving {
            client: from,
            total,
            items: Vec::with_capacity(total),
            retry: item_retry(now),
        });
        Step::send(self.request(from, 0))
    }

    fn received(
        &mut self,
        now: Stamp,
        from: Address,
        (mission_type, seq, item): (MavMissionType, u16, Result<MissionItem, ItemError>),
    ) -> Step<MissionChange> {
        let kind = self.kind;
        let Some(receiving) = &mut self.receiving else {
            let is_last = usize::from(seq) + 1 == self.items.len();
            return if self.completed == Some(from) && mission_type == kind && is_last {
                Step::send(self.accepted(from))
            } else {
                Step::none()
            };
        };
        if receiving.client != from || mission_type != kind {
            return Step::none();
        }
        // Out of turn: it is the answer to a question asked twice, or an item was lost on the way here.
        if usize::from(seq) != receiving.items.len() {
            return Step::none();
        }
        let checked = item
            .map_err(|error| match error {
                ItemError::Frame { .. } => MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME,
                ItemError::Position => MavMissionResult::MAV_MISSION_INVALID,
            })
            .and_then(|item| (self.accept)(&item).map(|()| item));
        match checked {
            Ok(item) => receiving.items.push(item),
            Err(result) => {
                self.receiving = None;
                return Step::send(ack(from, result, kind));
            }
        }
        if receiving.items.len() < receiving.total {
            receiving.retry = item_retry(now);
            let next = receiving.items.len();
            return Step::send(self.request(from, next));
        }
        let items = std::mem::take(&mut receiving.items);
        self.receiving = None;
        if let Err(result) = (self.accept_all)(&items) {
            return Step::send(ack(from, result, kind));
        }
        self.items = items;
        self.completed = Some(from);
        self.replaced(from)
    }

    fn accepted(&self, client: Address) -> Message {
        let mut accepted = ack(client, MavMissionResult::MAV_MISSION_ACCEPTED, self.kind);
        if let Message::MISSION_ACK(ack) = &mut accepted {
            ack.opaque_id = self.mission_id();
        }
        accepted
    }

    fn replaced(&mut self, client: Address) -> Step<MissionChange> {
        self.current = 0;
        Step {
            send: vec![self.accepted(client)],
            events: vec![MissionChange::Replaced {
                items: self.items.len(),
            }],
        }
    }

    fn clear(&mut self, from: Address, mission_type: MavMissionType) -> Step<MissionChange> {
        let ours = [self.kind, MavMissionType::MAV_MISSION_TYPE_ALL].contains(&mission_type);
        if !ours {
            return Step::send(ack(
                from,
                MavMissionResult::MAV_MISSION_ACCEPTED,
                mission_type,
            ));
        }
        self.items.clear();
        self.receiving = None;
        let mut step = self.replaced(from);
        if let [Message::MISSION_ACK(ack)] = step.send.as_mut_slice() {
            ack.mission_type = mission_type;
        }
        step
    }

    /// The client gives up an upload by acknowledging it; after a download an acknowledgement means nothing to us.
    fn cancelled(&mut self, from: Address) -> Step<MissionChange> {
        if self
            .receiving
            .as_ref()
            .is_some_and(|receiving| receiving.client == from)
        {
            self.receiving = None;
        }
        Step::none()
    }

    /// Lets time pass: asks again for an item that does not come, and gives up in the end.
    pub fn tick(&mut self, now: Stamp) -> Step<MissionChange> {
        let Some(receiving) = &mut self.receiving else {
            return Step::none();
        };
        let (client, next) = (receiving.client, receiving.items.len());
        match receiving.retry.check(now) {
            Due::Nothing => Step::none(),
            Due::Again => Step::send(self.request(client, next)),
            Due::GiveUp => {
                self.receiving = None;
                let result = MavMissionResult::MAV_MISSION_OPERATION_CANCELLED;
                Step::send(ack(client, result, self.kind))
            }
        }
    }

    fn request(&self, to: Address, seq: usize) -> Message {
        Message::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
            seq: seq as u16,
            target_system: to.system.0,
            target_component: to.component.0,
            mission_type: self.kind,
        })
    }
}

fn item_retry(now: Stamp) -> Retry {
    Retry::new(now, ITEM_TIMEOUT, RETRIES).with_patience(RESPONSE_TIMEOUT)
}

fn ack(to: Address, result: MavMissionResult, mission_type: MavMissionType) -> Message {
    Message::MISSION_ACK(MISSION_ACK_DATA {
        target_system: to.system.0,
        target_component: to.component.0,
        mavtype: result,
        mission_type,
        opaque_id: 0,
    })
}

fn invalid_sequence(to: Address, mission_type: MavMissionType) -> Step<MissionChange> {
    Step::send(ack(
        to,
        MavMissionResult::MAV_MISSION_INVALID_SEQUENCE,
        mission_type,
    ))
}
