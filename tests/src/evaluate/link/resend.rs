//! Plain acknowledged resend, as MAVLink FTP does it with a burst read: one file after the other, each opened, sent as a
//! stream, and what is missing asked for piece by piece. <https://mavlink.io/en/services/ftp.html>
//!
//! Kinder than life: the ground knows at once what there is to fetch, takes BEV frames first and skips those out of date,
//! knows the round trip, and has no queue of its own.

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::dialect::Message;
use mavlink_ext::dialect::tandem::FILE_TRANSFER_PROTOCOL_DATA;
use mavlink_ext::object::{Object, ObjectId, Service};

use super::Case;
use super::team::{GROUND, Transport, UAV};

const CHUNK: usize = 239;
const HEADER: usize = 12;
const OPEN: u8 = 4;
const READ: u8 = 5;
const BURST_READ: u8 = 15;
const ACK: u8 = 128;
/// Beyond twice the delay, before a request is repeated.
const SLACK: Duration = Duration::from_millis(50);

struct File {
    number: u32,
    object: Object,
    offered: Stamp,
}

/// What the ground is doing about the file that it fetches.
enum Fetching {
    Opening,
    Streaming,
    Mending,
}

struct Fetch {
    number: u32,
    doing: Fetching,
    has: Vec<bool>,
    last_heard: Stamp,
}

pub(super) struct Resend {
    rate: f64,
    patience: Duration,
    files: VecDeque<File>,
    numbered: u32,
    /// The UAV's side: the file that streams, and its next chunk.
    stream: Option<(u32, usize)>,
    budget: f64,
    ticked: Stamp,
    fetch: Option<Fetch>,
}

impl Resend {
    pub(super) fn new(case: &Case) -> Self {
        Self {
            rate: case.rate(),
            patience: case.profile.delay * 2 + SLACK,
            files: VecDeque::new(),
            numbered: 0,
            stream: None,
            budget: 0.0,
            ticked: Stamp::ZERO,
            fetch: None,
        }
    }

    fn file(&self, number: u32) -> Option<&File> {
        self.files.iter().find(|file| file.number == number)
    }

    fn chunk(&self, number: u32, chunk: usize, opcode: u8) -> Option<Message> {
        let bytes = &self.file(number)?.object.bytes;
        let data = bytes.chunks(CHUNK).nth(chunk)?;
        let is_last = (chunk + 1) * CHUNK >= bytes.len();
        Some(frame(GROUND, number, (ACK, opcode, is_last), chunk, data))
    }

    /// Chooses the next file, the newest BEV frame first, and what to ask for.
    fn request(&mut self, now: Stamp) -> Option<Message> {
        if self.fetch.is_none() {
            let is_bev = |file: &&File| file.object.service != Service::Reliable;
            let file = (self.files.iter().rev().find(is_bev)).or(self.files.front())?;
            self.fetch = Some(Fetch {
                number: file.number,
                doing: Fetching::Opening,
                has: vec![false; file.object.bytes.len().div_ceil(CHUNK)],
                last_heard: now,
            });
        }
        let fetch = self.fetch.as_mut()?;
        fetch.last_heard = now;
        let missing = fetch.has.iter().position(|has| !has)?;
        let opcode = match fetch.doing {
            Fetching::Opening => OPEN,
            Fetching::Streaming => BURST_READ,
            Fetching::Mending => READ,
        };
        Some(frame(UAV, fetch.number, (opcode, 0, false), missing, &[]))
    }
}

impl Transport for Resend {
    fn offer(&mut self, now: Stamp, object: Object) {
        self.numbered += 1;
        self.files.push_back(File {
            number: self.numbered,
            object,
            offered: now,
        });
    }

    fn waiting_bytes(&self, _now: Stamp) -> usize {
        self.files.iter().map(|file| file.object.bytes.len()).sum()
    }

    fn tick_uav(&mut self, now: Stamp) -> Vec<Message> {
        self.files.retain(|file| match file.object.service {
            Service::Latest { deadline } => now.since(file.offered) <= deadline,
            Service::Reliable | Service::BestEffort => true,
        });
        let earned = self.rate * now.since(self.ticked).as_secs_f64();
        self.budget = (self.budget + earned).min(earned);
        self.ticked = now;
        let mut send = Vec::new();
        while self.budget > 0.0
            && let Some((number, chunk)) = self.stream
        {
            let Some(message) = self.chunk(number, chunk, BURST_READ) else {
                self.stream = None;
                break;
            };
            self.budget -= (HEADER + CHUNK + 15) as f64;
            self.stream = Some((number, chunk + 1));
            send.push(message);
        }
        send
    }

    fn at_uav(&mut self, _now: Stamp, message: &Message) -> Vec<Message> {
        let Message::FILE_TRANSFER_PROTOCOL(request) = message else {
            return Vec::new();
        };
        let (number, chunk) = (number(request), chunk(request));
        let answer = match request.payload[3] {
            OPEN => (self.file(number)).map(|_| frame(GROUND, number, (ACK, OPEN, false), 0, &[])),
            READ => self.chunk(number, chunk, READ),
            BURST_READ => {
                self.stream = Some((number, chunk));
                None
            }
            _ => None,
        };
        answer.into_iter().collect()
    }

    fn tick_ground(&mut self, now: Stamp) -> Vec<Message> {
        let is_gone = |fetch: &Fetch| self.file(fetch.number).is_none();
        if self.fetch.as_ref().is_some_and(is_gone) {
            self.fetch = None; // Its deadline has passed.
        }
        if let Some(fetch) = &mut self.fetch {
            if now.since(fetch.last_heard) < self.patience {
                return Vec::new();
            }
            if matches!(fetch.doing, Fetching::Streaming) && fetch.has.contains(&true) {
                fetch.doing = Fetching::Mending;
            }
        }
        self.request(now).into_iter().collect()
    }

    fn at_ground(&mut self, now: Stamp, message: &Message) -> (Vec<Message>, Vec<ObjectId>) {
        let (Message::FILE_TRANSFER_PROTOCOL(answer), Some(fetch)) = (message, &mut self.fetch)
        else {
            return (Vec::new(), Vec::new());
        };
        if number(answer) != fetch.number {
            return (Vec::new(), Vec::new());
        }
        fetch.last_heard = now;
        let is_read = answer.payload[5] != OPEN;
        if is_read && let Some(has) = fetch.has.get_mut(chunk(answer)) {
            *has = true;
        }
        let proceeds = match fetch.doing {
            Fetching::Opening => !is_read,
            // The stream is over.
            Fetching::Streaming => answer.payload[6] != 0,
            Fetching::Mending => answer.payload[5] == READ,
        };
        let mut delivered = Vec::new();
        if fetch.has.iter().all(|has| *has) {
            let number = fetch.number;
            let place = self.files.iter().position(|file| file.number == number);
            let file = place.and_then(|place| self.files.remove(place));
            delivered.extend(file.map(|file| file.object.id));
            self.fetch = None;
        } else if proceeds {
            fetch.doing = match fetch.doing {
                Fetching::Opening => Fetching::Streaming,
                Fetching::Streaming | Fetching::Mending => Fetching::Mending,
            };
        } else {
            return (Vec::new(), delivered);
        }
        (self.request(now).into_iter().collect(), delivered)
    }
}

/// The payload of MAVLink FTP: sequence, session, opcode, size, opcode asked for, burst complete, padding, offset, data.
fn frame(
    to: mavlink_ext::Address,
    number: u32,
    (opcode, asked, is_last): (u8, u8, bool),
    chunk: usize,
    data: &[u8],
) -> Message {
    let mut payload = [0; 251];
    payload[..3].copy_from_slice(&number.to_le_bytes()[..3]);
    payload[3] = opcode;
    payload[4] = data.len() as u8;
    payload[5] = asked;
    payload[6] = u8::from(is_last);
    payload[8..12].copy_from_slice(&((chunk * CHUNK) as u32).to_le_bytes());
    payload[HEADER..HEADER + data.len()].copy_from_slice(data);
    Message::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
        target_network: 0,
        target_system: to.system.0,
        target_component: to.component.0,
        payload,
    })
}

/// Which file it is about: the sequence and session numbers name it here.
fn number(message: &FILE_TRANSFER_PROTOCOL_DATA) -> u32 {
    let [a, b, c, ..] = message.payload;
    u32::from_le_bytes([a, b, c, 0])
}

fn chunk(message: &FILE_TRANSFER_PROTOCOL_DATA) -> usize {
    let offset = &message.payload[8..12];
    let offset = offset
        .iter()
        .rev()
        .fold(0_u32, |sum, byte| sum << 8 | u32::from(*byte));
    offset as usize / CHUNK
}
