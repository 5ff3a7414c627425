//! The serving end.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::sync::Arc;
use std::time::Duration;

use maps::time::Stamp;

use super::{CHUNK, Crc32, FtpError, Opcode, Packet, Root};
use crate::dialect::Message;
use crate::service::is_for;
use crate::wire::Address;

/// Files open at once.
const MAX_SESSIONS: usize = 8;
/// A session that is not used for so long is closed.
const FORGOTTEN: Duration = Duration::from_mins(1);
/// Clients whose last answer is kept.
const MAX_CLIENTS: usize = 32;
/// Of one answer in a frame.
const FRAME_BYTES: f64 = 266.0;
/// What a burst may save up, as a span of its rate.
const BURST: Duration = Duration::from_millis(50);
/// Bytes of a file read at once for its checksum.
const BLOCK: usize = 1 << 16;

#[derive(Clone, Debug)]
enum Access {
    Read(u32),
    Write,
}

/// What a session reads or writes.
#[derive(Clone, Debug)]
enum Content {
    File(Arc<File>),
    Published(Arc<[u8]>),
}

impl Content {
    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read_at(bytes, offset),
            Self::Published(all) => {
                let from = usize::try_from(offset).unwrap_or(usize::MAX).min(all.len());
                let count = bytes.len().min(all.len() - from);
                bytes[..count].copy_from_slice(&all[from..from + count]);
                Ok(count)
            }
        }
    }
}

#[derive(Clone, Debug)]
struct Session {
    client: Address,
    /// The sequence number of the request that opened it.
    opened_by: u16,
    content: Content,
    access: Access,
    last_used: Stamp,
    burst: Option<Burst>,
}

/// A file on its way.
#[derive(Clone, Debug)]
struct Burst {
    sequence: u16,
    offset: u32,
    /// Bytes in each message.
    piece: u8,
}

/// Serves a folder, and what its owner publishes, to any client.
#[derive(Clone, Debug)]
pub struct Server {
    own: Address,
    root: Option<Root>,
    /// Files that are not in the folder, by their path.
    published: BTreeMap<String, Arc<[u8]>>,
    bytes_per_second: u32,
    sessions: BTreeMap<u8, Session>,
    /// The last request of each client, and its answer.
    answered: BTreeMap<Address, (Packet, Packet)>,
    budget: f64,
    refilled: Stamp,
}

impl Server {
    /// Bursts take this many bytes of MAVLink frames per second together.
    /// Without a folder, only what is published is served.
    pub fn new(own: Address, root: Option<Root>, bytes_per_second: u32) -> Self {
        Self {
            own,
            root,
            published: BTreeMap::new(),
            bytes_per_second,
            sessions: BTreeMap::new(),
            answered: BTreeMap::new(),
            budget: 0.0,
            refilled: Stamp::ZERO,
        }
    }

    /// Serves these bytes under a path, whatever a client adds to it after a `?`. Who reads an older version reads it to its end.
    pub fn publish(&mut self, path: &str, bytes: Vec<u8>) {
        self.published.insert(path.to_owned(), bytes.into());
    }

    /// What is published under a path.
    fn published(&self, path: &[u8]) -> Option<Arc<[u8]>> {
        let path = path.split(|byte| *byte == b'?').next().unwrap_or_default();
        let path = std::str::from_utf8(path).ok()?;
        self.published.get(path.trim_start_matches('/')).cloned()
    }

    fn root(&self) -> Result<&Root, FtpError> {
        self.root.as_ref().ok_or(FtpError::FileNotFound)
    }

    /// Opens a file to read; its size.
    fn content(&self, path: &[u8]) -> Result<(Content, u32), FtpError> {
        if let Some(bytes) = self.published(path) {
            let size = u32::try_from(bytes.len()).map_err(|_too_large| FtpError::Fail)?;
            return Ok((Content::Published(bytes), size));
        }
        let (file, size) = self.root()?.open(path)?;
        Ok((Content::File(Arc::new(file)), size))
    }

    /// Tells it of any message that came in; what to send. Reads and writes files.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Vec<Message> {
        let Message::FILE_TRANSFER_PROTOCOL(request) = message else {
            return Vec::new();
        };
        if !is_for(self.own, message) {
            return Vec::new();
        }
        let request = Packet::read(request);
        if let Some((last, answer)) = self.answered.get(&from)
            && *last == request
        {
            return vec![answer.to_message(from)];
        }
        let Some(answer) = self.answer(now, from, &request) else {
            return Vec::new();
        };
        if self.answered.len() >= MAX_CLIENTS && !self.answered.contains_key(&from) {
            self.answered.pop_first();
        }
        let message = answer.to_message(from);
        self.answered.insert(from, (request, answer));
        vec![message]
    }

    /// The answer to a request; `None` where a burst is the answer, or to what is no request.
    fn answer(&mut self, now: Stamp, from: Address, request: &Packet) -> Option<Packet> {
        let opcode = Opcode::from_wire(request.opcode);
        if matches!(opcode, Some(Opcode::Ack | Opcode::Nak)) || request.opcode == 0 {
            return (request.opcode == 0).then(|| answer_to(request, Ok((0, Vec::new()))));
        }
        let done = match opcode {
            Some(Opcode::BurstReadFile) => match self.begin_burst(now, from, request) {
                Ok(()) => return None,
                Err(error) => Err(error),
            },
            Some(opcode) => self.carry_out(now, from, (opcode, request)),
            None => Err(FtpError::UnknownCommand),
        };
        Some(answer_to(request, done))
    }

    /// The session and data of the answer.
    fn carry_out(
        &mut self,
        now: Stamp,
        from: Address,
        (opcode, request): (Opcode, &Packet),
    ) -> Result<(u8, Vec<u8>), FtpError> {
        let same = |data: Vec<u8>| Ok((request.session, data));
        let path = request.text();
        match opcode {
            Opcode::TerminateSession => {
                self.session(now, from, request)?;
                self.sessions.remove(&request.session);
                same(Vec::new())
            }
            Opcode::ResetSessions => {
                self.sessions.retain(|_, session| session.client != from);
                same(Vec::new())
            }
            Opcode::ListDirectory => same(page(&self.root()?.list(path)?, request.offset)?),
            Opcode::OpenFileRo => {
                let (content, size) = self.content(path)?;
                let client = (from, request.sequence, request.session);
                let session = self.open(now, client, content, Access::Read(size))?;
                Ok((session, size.to_le_bytes().to_vec()))
            }
            Opcode::CreateFile => {
                let file = Content::File(Arc::new(self.root()?.create(path)?));
                Ok((
                    self.open(
                        now,
                        (from, request.sequence, request.session),
                        file,
                        Access::Write,
                    )?,
                    Vec::new(),
                ))
            }
            Opcode::ReadFile => {
                let session = self.session(now, from, request)?;
                same(session.read(request.offset, request.size)?)
            }
            Opcode::WriteFile => {
                let session = self.session(now, from, request)?;
                session.write(request)?;
                same(Vec::new())
            }
            Opcode::RemoveFile => same(self.root()?.remove(path).map(|()| Vec::new())?),
            Opcode::CreateDirectory => same(self.root()?.create_folder(path).map(|()| Vec::new())?),
            Opcode::RemoveDirectory => same(self.root()?.remove_folder(path).map(|()| Vec::new())?),
            Opcode::TruncateFile => {
                self.root()?.truncate(path, request.offset)?;
                same(Vec::new())
            }
            Opcode::Rename => {
                let mut names = request.data.split(|byte| *byte == 0);
                let (from, to) = (names.next(), names.next());
                let to = to.filter(|to| !to.is_empty());
                let (from, to) = from.zip(to).ok_or(FtpError::InvalidDataSize)?;
                self.root()?.rename(from, to)?;
                same(Vec::new())
            }
            Opcode::CalcFileCrc32 => {
                let (content, size) = self.content(path)?;
                same(checksum(&content, size)?.to_le_bytes().to_vec())
            }
            Opcode::BurstReadFile | Opcode::Ack | Opcode::Nak => Err(FtpError::UnknownCommand),
        }
    }

    /// The session that a request is about, which must be its client's.
    fn session(
        &mut self,
        now: Stamp,
        from: Address,
        request: &Packet,
    ) -> Result<&mut Session, FtpError> {
        let session = self.sessions.get_mut(&request.session);
        // What still comes for the session that had this number before must not touch this one.
        let is_later =
            |session: &Session| request.sequence.wrapping_sub(session.opened_by) < 1 << 15;
        let session = session.filter(|session| session.client == from && is_later(session));
        let session = session.ok_or(FtpError::InvalidSession)?;
        session.last_used = now;
        Ok(session)
    }

    fn open(
        &mut self,
        now: Stamp,
        (client, opened_by, wished): (Address, u16, u8),
        content: Content,
        access: Access,
    ) -> Result<u8, FtpError> {
        self.sessions
            .retain(|_, session| now.since(session.last_used) <= FORGOTTEN);
        // MAVProxy takes for granted that the session has the number that it asks for, MAVSDK that it is 0.
        let is_own = |number: &u8| self.sessions.get(number).is_none_or(|s| s.client == client);
        let wished = Some(wished).filter(|number| *number != 0 && is_own(number));
        let number = match wished {
            Some(number) => number,
            None => (0..=u8::MAX)
                .find(|number| !self.sessions.contains_key(number))
                .ok_or(FtpError::NoSessionsAvailable)?,
        };
        self.sessions.remove(&number);
        if self.sessions.len() >= MAX_SESSIONS {
            return Err(FtpError::NoSessionsAvailable);
        }
        let session = Session {
            client,
            opened_by,
            content,
            access,
            last_used: now,
            burst: None,
        };
        self.sessions.insert(number, session);
        Ok(number)
    }

    fn begin_burst(&mut self, now: Stamp, from: Address, request: &Packet) -> Result<(), FtpError> {
        let session = self.session(now, from, request)?;
        let Access::Read(size) = session.access else {
            return Err(FtpError::FileProtected);
        };
        if request.offset >= size {
            return Err(FtpError::Eof);
        }
        session.burst = Some(Burst {
            sequence: request.sequence,
            offset: request.offset,
            // Radios with small packets ask for less than a message holds.
            piece: if request.size == 0 {
                CHUNK as u8
            } else {
                request.size.min(CHUNK as u8)
            },
        });
        Ok(())
    }

    /// Lets time pass: the next pieces of bursts, as many as the rate allows.
    pub fn tick(&mut self, now: Stamp) -> Vec<Message> {
        let rate = f64::from(self.bytes_per_second);
        let earned = rate * now.since(self.refilled).as_secs_f64();
        self.budget = (self.budget + earned).min((rate * BURST.as_secs_f64()).max(1.0));
        self.refilled = now;
        let mut send = Vec::new();
        while self.budget > 0.0 {
            // In turn: the one that waits for longest, so that no client starves another.
            let bursting = self.sessions.iter_mut().filter(|(_, s)| s.burst.is_some());
            let Some((number, session)) = bursting.min_by_key(|(_, s)| s.last_used) else {
                break;
            };
            session.last_used = now.max(session.last_used + Duration::from_nanos(1));
            send.extend(session.next_piece(*number));
            self.budget -= FRAME_BYTES;
        }
        send
    }
}

impl Session {
    fn read(&self, offset: u32, size: u8) -> Result<Vec<u8>, FtpError> {
        let mut data = vec![0; usize::from(size).min(CHUNK)];
        let length = self.content.read_at(&mut data, u64::from(offset))?;
        if length == 0 {
            return Err(FtpError::Eof);
        }
        data.truncate(length);
        Ok(data)
    }

    fn write(&self, request: &Packet) -> Result<(), FtpError> {
        let (Content::File(file), Access::Write) = (&self.content, &self.access) else {
            return Err(FtpError::FileProtected);
        };
        // A file with a hole of gigabytes would be made by one message.
        if u64::from(request.offset) > file.metadata()?.len() + MOST_AHEAD {
            return Err(FtpError::InvalidDataSize);
        }
        Ok(file.write_all_at(&request.data, u64::from(request.offset))?)
    }

    fn next_piece(&mut self, number: u8) -> Option<Message> {
        let burst = self.burst.as_mut()?;
        burst.sequence = burst.sequence.wrapping_add(1);
        let (sequence, offset, piece) = (burst.sequence, burst.offset, burst.piece);
        let request = Packet {
            sequence: sequence.wrapping_sub(1),
            size: piece,
            ..Packet::request(Opcode::BurstReadFile, number, offset, &[])
        };
        let read = self.read(offset, piece);
        let mut answer = answer_to(&request, read.map(|data| (number, data)));
        let end = offset + u32::from(answer.size);
        let is_over = answer.opcode != Opcode::Ack as u8
            || matches!(self.access, Access::Read(size) if end >= size);
        answer.burst_complete = is_over;
        match &mut self.burst {
            Some(burst) if !is_over => burst.offset = end,
            _ => self.burst = None,
        }
        Some(answer.to_message(self.client))
    }
}

/// How far behind the end of a file it may be written: pieces come out of order.
const MOST_AHEAD: u64 = 1 << 20;

fn answer_to(request: &Packet, done: Result<(u8, Vec<u8>), FtpError>) -> Packet {
    let (opcode, session, data) = match done {
        Ok((session, data)) => (Opcode::Ack, session, data),
        Err(error) => {
            let (code, errno) = error.to_wire();
            let data = [code].into_iter().chain(errno).collect();
            (Opcode::Nak, request.session, data)
        }
    };
    Packet {
        sequence: request.sequence.wrapping_add(1),
        asked: request.opcode,
        ..Packet::request(opcode, session, request.offset, &data)
    }
}

/// Entries from the `first` on, as many as fit a message, each ended by a zero.
fn page(entries: &[String], first: u32) -> Result<Vec<u8>, FtpError> {
    let mut data = Vec::new();
    for entry in entries.iter().skip(first as usize) {
        // A name that fits no message is left out, but keeps its number.
        let entry = if entry.len() < CHUNK {
            entry.as_bytes()
        } else {
            b"S"
        };
        if data.len() + entry.len() + 1 > CHUNK {
            break;
        }
        data.extend(entry);
        data.push(0);
    }
    if data.is_empty() {
        Err(FtpError::Eof)
    } else {
        Ok(data)
    }
}

fn checksum(content: &Content, size: u32) -> Result<u32, FtpError> {
    let mut crc = Crc32::new();
    let mut block = vec![0; BLOCK];
    let mut offset = 0;
    while offset < u64::from(size) {
        let length = content.read_at(&mut block, offset)?;
        if length == 0 {
            break;
        }
        crc.update(&block[..length]);
        offset += length as u64;
    }
    Ok(crc.value())
}
