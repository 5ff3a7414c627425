//! Objects as pictures are sent in MAVLink: announced, sent once at the rate of the link, and never asked for again.
//! <https://mavlink.io/en/services/image_transmission.html>

use std::collections::VecDeque;

use maps::time::Stamp;
use mavlink_ext::dialect::Message;
use mavlink_ext::dialect::tandem::{
    DATA_TRANSMISSION_HANDSHAKE_DATA, ENCAPSULATED_DATA_DATA, MavlinkDataStreamType,
};
use mavlink_ext::object::{Object, ObjectId, Service};

use super::Case;
use super::team::Transport;

const CHUNK: usize = 253;

pub(super) struct Blind {
    rate: f64,
    waiting: VecDeque<(Object, Stamp)>,
    /// What is being sent, and its next packet.
    sending: Option<(Object, usize)>,
    budget: f64,
    ticked: Stamp,
    /// The ground's side: the last picture announced, and which packets of it came.
    receiving: Option<(ObjectId, Vec<bool>)>,
    last_packet: Option<u16>,
    /// Those announced and not received, by number.
    announced: VecDeque<(u32, ObjectId)>,
    numbered: u32,
}

impl Blind {
    pub(super) fn new(case: &Case) -> Self {
        Self {
            rate: case.rate(),
            waiting: VecDeque::new(),
            sending: None,
            budget: 0.0,
            ticked: Stamp::ZERO,
            receiving: None,
            last_packet: None,
            announced: VecDeque::new(),
            numbered: 0,
        }
    }

    /// The next message, and the bytes of its frame.
    fn next(&mut self, now: Stamp) -> Option<(Message, usize)> {
        if let Some((object, packet)) = &mut self.sending {
            if let Some(chunk) = object.bytes.chunks(CHUNK).nth(*packet) {
                let mut data = [0; CHUNK];
                data[..chunk.len()].copy_from_slice(chunk);
                let seqnr = *packet as u16;
                *packet += 1;
                let message = ENCAPSULATED_DATA_DATA { seqnr, data };
                return Some((Message::ENCAPSULATED_DATA(message), chunk.len() + 14));
            }
            self.sending = None;
        }
        self.waiting
            .retain(|(object, offered)| match object.service {
                Service::Latest { deadline } => now.since(*offered) <= deadline,
                Service::Reliable | Service::BestEffort => true,
            });
        let is_bev = |(object, _): &(Object, Stamp)| object.service != Service::Reliable;
        let place = self.waiting.iter().position(is_bev).unwrap_or(0);
        let (object, _) = self.waiting.remove(place)?;
        self.numbered += 1;
        let message = Message::DATA_TRANSMISSION_HANDSHAKE(DATA_TRANSMISSION_HANDSHAKE_DATA {
            // The protocol has no name for a picture; its size stands for one here.
            size: self.numbered,
            width: 0,
            height: 0,
            packets: object.bytes.len().div_ceil(CHUNK) as u16,
            mavtype: MavlinkDataStreamType::MAVLINK_DATA_STREAM_IMG_PNG,
            payload: CHUNK as u8,
            jpg_quality: 0,
        });
        self.announced.push_back((self.numbered, object.id));
        self.sending = Some((object, 0));
        Some((message, 24))
    }
}

impl Transport for Blind {
    fn offer(&mut self, now: Stamp, object: Object) {
        self.waiting.push_back((object, now));
    }

    fn waiting_bytes(&self, _now: Stamp) -> usize {
        self.waiting
            .iter()
            .map(|(object, _)| object.bytes.len())
            .sum()
    }

    fn tick_uav(&mut self, now: Stamp) -> Vec<Message> {
        let earned = self.rate * now.since(self.ticked).as_secs_f64();
        self.budget = (self.budget + earned).min(earned);
        self.ticked = now;
        let mut send = Vec::new();
        while self.budget > 0.0
            && let Some((message, bytes)) = self.next(now)
        {
            self.budget -= bytes as f64;
            send.push(message);
        }
        send
    }

    fn at_uav(&mut self, _now: Stamp, _message: &Message) -> Vec<Message> {
        Vec::new()
    }

    fn tick_ground(&mut self, _now: Stamp) -> Vec<Message> {
        Vec::new()
    }

    fn at_ground(&mut self, _now: Stamp, message: &Message) -> (Vec<Message>, Vec<ObjectId>) {
        let mut delivered = Vec::new();
        match message {
            Message::DATA_TRANSMISSION_HANDSHAKE(picture) => {
                while (self.announced.front()).is_some_and(|(number, _)| *number < picture.size) {
                    self.announced.pop_front();
                }
                self.last_packet = None;
                let id = self.announced.front().map(|(_, id)| *id);
                self.receiving = id.map(|id| (id, vec![false; usize::from(picture.packets)]));
            }
            Message::ENCAPSULATED_DATA(packet) => {
                if self.last_packet.replace(packet.seqnr) >= Some(packet.seqnr) {
                    self.receiving = None; // Of the next picture, whose announcement was lost.
                }
                if let Some((id, has)) = &mut self.receiving
                    && let Some(slot) = has.get_mut(usize::from(packet.seqnr))
                {
                    *slot = true;
                    if has.iter().all(|has| *has) {
                        delivered.push(*id);
                        self.receiving = None;
                    }
                }
            }
            _ => {}
        }
        (Vec::new(), delivered)
    }
}
