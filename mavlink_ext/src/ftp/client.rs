//! The asking end: one job at a time.

mod gaps;

use std::time::Duration;

use maps::time::Stamp;

use super::{CHUNK, Crc32, FtpError, Opcode, Packet};
use crate::dialect::Message;
use crate::service::{Due, Ends, Retry, Step};
use gaps::Gaps;

/// Silence before a request is repeated.
const TIMEOUT: Duration = Duration::from_millis(500);
/// How often it is repeated.
const RETRIES: u32 = 10;
/// Pieces asked for at once where a burst left gaps.
const MENDING: usize = 5;
/// Larger files are refused.
pub const MAX_FILE_BYTES: u32 = 64 << 20;
/// Entries of a list.
const MAX_ENTRIES: usize = 10_000;

/// What is to be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Job {
    /// Fetches a file, and verifies it.
    Download {
        /// Where it is.
        path: String,
        /// The beginning of it, where an earlier attempt ended.
        resume: Vec<u8>,
    },
    /// Writes a file, and verifies it.
    Upload {
        /// Where to.
        path: String,
        /// Its content.
        bytes: Vec<u8>,
    },
    /// What is in a folder.
    List {
        /// Which.
        path: String,
    },
    /// The checksum of a file.
    Checksum {
        /// Which.
        path: String,
    },
}

/// What came of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Done {
    /// The file's content; its checksum is right, if the server can tell one.
    Downloaded(Vec<u8>),
    /// It is there; its checksum is right, if the server can tell one.
    Uploaded,
    /// Names, those of folders with a `/` behind, and sizes of files.
    Listed(Vec<(String, Option<u32>)>),
    /// See [`Crc32`].
    Checksum(u32),
}

/// Why it was not done.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum JobError {
    /// Another job is under way.
    #[error("another transfer is under way")]
    Busy,
    /// The path is longer than a message.
    #[error("a path of {length} bytes is too long, {CHUNK} are allowed")]
    Path {
        /// How long.
        length: usize,
    },
    /// The server will not.
    #[error("the server refuses: {0}")]
    Refused(FtpError),
    /// The server does not answer.
    #[error("the server does not answer")]
    NoAnswer {
        /// What has come so far: a download can be resumed with it.
        so_far: Vec<u8>,
    },
    /// The file is too large for this client.
    #[error("the file has {bytes} bytes, {MAX_FILE_BYTES} are taken at most")]
    TooLarge {
        /// Its size.
        bytes: u32,
    },
    /// What came, or arrived, is not what was sent.
    #[error("the file is damaged: checksum {theirs:08x}, computed is {ours:08x}; try again")]
    Damaged {
        /// The server's.
        theirs: u32,
        /// Ours.
        ours: u32,
    },
}

/// How it goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// So many bytes of all are there.
    Progress {
        /// Bytes there.
        done: u32,
        /// Bytes of the file.
        of: u32,
    },
    /// It is over.
    Finished(Result<Done, JobError>),
}

enum Stage {
    /// Waits for the answer to the request.
    Asking,
    /// A burst runs.
    Bursting { silent_at: Stamp },
    /// Gaps are filled; the offsets asked for, and when they are asked for again.
    Mending {
        asked: Vec<(u32, Stamp)>,
        last_heard: Stamp,
    },
}

/// The job under way.
struct Task {
    job: Job,
    stage: Stage,
    request: Packet,
    retry: Retry,
    session: u8,
    /// The file, as far as it is there.
    bytes: Vec<u8>,
    gaps: Gaps,
    entries: Vec<(String, Option<u32>)>,
    listed: u32,
}

/// Talks to one server.
pub struct Client {
    ends: Ends,
    sequence: u16,
    task: Option<Task>,
}

impl Client {
    /// A client with nothing to do.
    pub fn new(ends: Ends) -> Self {
        Self {
            ends,
            sequence: 0,
            task: None,
        }
    }

    /// Whether nothing is under way.
    pub fn is_idle(&self) -> bool {
        self.task.is_none()
    }

    #[cfg(test)]
    pub(super) fn sequence_expected(&self) -> u16 {
        self.sequence.wrapping_add(1)
    }

    /// Begins a job.
    pub fn start(&mut self, now: Stamp, job: Job) -> Result<Message, JobError> {
        if self.task.is_some() {
            return Err(JobError::Busy);
        }
        let (opcode, path) = match &job {
            Job::Download { path, .. } => (Opcode::OpenFileRo, path),
            Job::Upload { path, .. } => (Opcode::CreateFile, path),
            Job::List { path } => (Opcode::ListDirectory, path),
            Job::Checksum { path } => (Opcode::CalcFileCrc32, path),
        };
        let length = path.len();
        if length > CHUNK {
            return Err(JobError::Path { length });
        }
        let request = Packet::request(opcode, 0, 0, path.as_bytes());
        self.task = Some(Task {
            job,
            stage: Stage::Asking,
            request: request.clone(),
            retry: Retry::new(now, TIMEOUT, RETRIES),
            session: 0,
            bytes: Vec::new(),
            gaps: Gaps::new(0),
            entries: Vec::new(),
            listed: 0,
        });
        Ok(self.ask(now, request))
    }

    /// Sends a request that is answered once.
    fn ask(&mut self, now: Stamp, mut request: Packet) -> Message {
        self.sequence = self.sequence.wrapping_add(1);
        request.sequence = self.sequence;
        let message = request.to_message(self.ends.peer);
        if let Some(task) = &mut self.task {
            task.request = request;
            task.retry = Retry::new(now, TIMEOUT, RETRIES);
            task.stage = Stage::Asking;
        }
        message
    }

    /// Tells it of any message that came in.
    pub fn handle(
        &mut self,
        now: Stamp,
        from: crate::wire::Address,
        message: &Message,
    ) -> Step<Event> {
        let Message::FILE_TRANSFER_PROTOCOL(answer) = message else {
            return Step::none();
        };
        if !self.ends.accept(from, message) {
            return Step::none();
        }
        let answer = Packet::read(answer);
        let Some(task) = &mut self.task else {
            return Step::none();
        };
        let is_read = [Opcode::BurstReadFile as u8, Opcode::ReadFile as u8].contains(&answer.asked);
        if !matches!(task.stage, Stage::Asking) {
            return if is_read && answer.session == task.session {
                self.piece_came(now, &answer)
            } else {
                Step::none()
            };
        }
        let fits = answer.asked == task.request.opcode
            && answer.sequence == task.request.sequence.wrapping_add(1);
        if !fits {
            return Step::none();
        }
        if answer.opcode == Opcode::Nak as u8 {
            let error = FtpError::from_wire(&answer.data);
            return self.refused(error);
        }
        self.answered(now, &answer)
    }

    fn finish(&mut self, result: Result<Done, JobError>) -> Step<Event> {
        let Some(task) = self.task.take() else {
            return Step::none();
        };
        let mut step = Step::event(Event::Finished(result));
        if matches!(task.job, Job::Download { .. } | Job::Upload { .. }) {
            // Not waited for: a server closes what is not used.
            self.sequence = self.sequence.wrapping_add(1);
            let mut close = Packet::request(Opcode::TerminateSession, task.session, 0, &[]);
            close.sequence = self.sequence;
            step.send.push(close.to_message(self.ends.peer));
        }
        step
    }

    fn refused(&mut self, error: FtpError) -> Step<Event> {
        let Some(task) = &mut self.task else {
            return Step::none();
        };
        let asked = Opcode::from_wire(task.request.opcode);
        match asked {
            Some(Opcode::ListDirectory) if error == FtpError::Eof => {
                let entries = std::mem::take(&mut task.entries);
                self.finish(Ok(Done::Listed(entries)))
            }
            // A server that cannot tell the checksum: what came is all that is known.
            Some(Opcode::CalcFileCrc32)
                if error == FtpError::UnknownCommand
                    && !matches!(task.job, Job::Checksum { .. }) =>
            {
                let done = task.done();
                self.finish(Ok(done))
            }
            _ => self.finish(Err(JobError::Refused(error))),
        }
    }

    fn answered(&mut self, now: Stamp, answer: &Packet) -> Step<Event> {
        let Some(task) = &mut self.task else {
            return Step::none();
        };
        match Opcode::from_wire(task.request.opcode) {
            Some(Opcode::ListDirectory) => {
                task.add_entries(&answer.data);
                let next =
                    Packet::request(Opcode::ListDirectory, 0, task.listed, &task.request.data);
                if answer.data.is_empty() || task.entries.len() >= MAX_ENTRIES {
                    let entries = std::mem::take(&mut task.entries);
                    return self.finish(Ok(Done::Listed(entries)));
                }
                Step::send(self.ask(now, next))
            }
            Some(Opcode::CalcFileCrc32) => self.checked(now, answer),
            Some(Opcode::OpenFileRo) => self.opened(now, answer),
            Some(Opcode::CreateFile) => {
                task.session = answer.session;
                self.write_next(now, 0)
            }
            Some(Opcode::WriteFile) => {
                let written = task.request.offset + u32::from(task.request.size);
                self.write_next(now, written)
            }
            _ => Step::none(),
        }
    }

    fn checked(&mut self, now: Stamp, answer: &Packet) -> Step<Event> {
        let [a, b, c, d, ..] = answer.data[..] else {
            return self.refused(FtpError::InvalidDataSize);
        };
        let theirs = u32::from_le_bytes([a, b, c, d]);
        let Some(task) = &mut self.task else {
            return Step::none();
        };
        let ours = match &mut task.job {
            Job::Checksum { .. } => return self.finish(Ok(Done::Checksum(theirs))),
            Job::Upload { bytes, .. } => Crc32::of(bytes),
            Job::Download { resume, .. } => {
                let ours = Crc32::of(&task.bytes);
                if ours != theirs && !resume.is_empty() {
                    // The file has changed since: from the beginning.
                    resume.clear();
                    task.gaps = Gaps::new(task.bytes.len() as u32);
                    return self.burst(now);
                }
                ours
            }
            Job::List { .. } => return Step::none(),
        };
        if ours == theirs {
            let done = task.done();
            self.finish(Ok(done))
        } else {
            self.finish(Err(JobError::Damaged { theirs, ours }))
        }
    }

    fn opened(&mut self, now: Stamp, answer: &Packet) -> Step<Event> {
        let [a, b, c, d, ..] = answer.data[..] else {
            return self.refused(FtpError::InvalidDataSize);
        };
        let size = u32::from_le_bytes([a, b, c, d]);
        let Some(task) = &mut self.task else {
            return Step::none();
        };
        task.session = answer.session;
        if size > MAX_FILE_BYTES {
            return self.finish(Err(JobError::TooLarge { bytes: size }));
        }
        task.bytes = vec![0; size as usize];
        task.gaps = Gaps::new(size);
        if let Job::Download { resume, .. } = &mut task.job {
            if resume.len() > size as usize {
                resume.clear();
            }
            task.bytes[..resume.len()].copy_from_slice(resume);
            task.gaps.fill(0, resume.len() as u32);
        }
        self.burst(now)
    }

    /// Asks for everything from the first gap on.
    fn burst(&mut self, now: Stamp) -> Step<Event> {
        let Some(task) = &mut self.task else {
            return Step::none();
        };
        let Some((offset, _)) = task.gaps.first() else {
            return self.check(now);
        };
        task.stage = Stage::Bursting {
            silent_at: now + TIMEOUT,
        };
        let mut request = Packet::request(Opcode::BurstReadFile, task.session, offset, &[]);
        request.size = CHUNK as u8;
        self.sequence = self.sequence.wrapping_add(1);
        request.sequence = self.sequence;
        Step::send(request.to_message(self.ends.peer))
    }

    fn check(&mut self, now: Stamp) -> Step<Event> {
        let path = match self.task.as_ref().map(|task| &task.job) {
            Some(Job::Download { path, .. } | Job::Upload { path, .. }) => path.clone(),
            _ => return Step::none(),
        };
        let request = Packet::request(Opcode::CalcFileCrc32, 0, 0, path.as_bytes());
        Step::send(self.ask(now, request))
    }

    fn write_next(&mut self, now: Stamp, written: u32) -> Step<Event> {
        let Some(Task {
            job: Job::Upload { bytes, .. },
            session,
            ..
        }) = &self.task
        else {
            return Step::none();
        };
        let of = bytes.len() as u32;
        let rest = bytes.get(written as usize..).unwrap_or_default();
        if rest.is_empty() {
            return self.check(now);
        }
        let piece = &rest[..rest.len().min(CHUNK)];
        let request = Packet::request(Opcode::WriteFile, *session, written, piece);
        let mut step = Step::send(self.ask(now, request));
        step.events.push(Event::Progress { done: written, of });
        step
    }

    /// A piece of the file came, or word that there is none.
    fn piece_came(&mut self, now: Stamp, answer: &Packet) -> Step<Event> {
        let Some(task) = &mut self.task else {
            return Step::none();
        };
        let mut step = Step::none();
        if answer.opcode == Opcode::Ack as u8 {
            let end = answer.offset.saturating_add(answer.data.len() as u32);
            if let Some(place) = task.bytes.get_mut(answer.offset as usize..end as usize) {
                place.copy_from_slice(&answer.data);
                task.gaps.fill(answer.offset, end);
                let of = task.bytes.len() as u32;
                let done = of - task.gaps.missing();
                step.events.push(Event::Progress { done, of });
            }
        } else if FtpError::from_wire(&answer.data) != FtpError::Eof {
            return self.refused(FtpError::from_wire(&answer.data));
        }
        let is_over = answer.burst_complete || answer.opcode != Opcode::Ack as u8;
        match &mut task.stage {
            Stage::Bursting { silent_at } if !is_over => *silent_at = now + TIMEOUT,
            Stage::Bursting { .. } => {
                task.stage = Stage::Mending {
                    asked: Vec::new(),
                    last_heard: now,
                };
            }
            Stage::Mending { asked, last_heard } => {
                asked.retain(|(offset, _)| *offset != answer.offset);
                *last_heard = now;
            }
            Stage::Asking => {}
        }
        step.extend(self.mend(now));
        step
    }

    /// Asks for what is missing, a few pieces at once.
    fn mend(&mut self, now: Stamp) -> Step<Event> {
        let Some(task) = &mut self.task else {
            return Step::none();
        };
        if task.gaps.first().is_none() {
            return self.check(now);
        }
        let Stage::Mending { asked, .. } = &mut task.stage else {
            return Step::none();
        };
        let mut step = Step::none();
        let pieces = task.gaps.pieces(CHUNK as u32, MENDING);
        asked.retain(|(offset, _)| pieces.iter().any(|(piece, _)| piece == offset));
        for (offset, size) in pieces {
            if asked
                .iter()
                .any(|(other, due)| *other == offset && now < *due)
            {
                continue;
            }
            asked.retain(|(other, _)| *other != offset);
            asked.push((offset, now + TIMEOUT));
            let mut request = Packet::request(Opcode::ReadFile, task.session, offset, &[]);
            request.size = size as u8;
            self.sequence = self.sequence.wrapping_add(1);
            request.sequence = self.sequence;
            step.send.push(request.to_message(self.ends.peer));
        }
        step
    }

    /// Lets time pass: repeats what was not answered, and gives up in the end.
    pub fn tick(&mut self, now: Stamp) -> Step<Event> {
        let Some(task) = &mut self.task else {
            return Step::none();
        };
        match &mut task.stage {
            Stage::Asking => match task.retry.check(now) {
                Due::Nothing => Step::none(),
                Due::Again => Step::send(task.request.to_message(self.ends.peer)),
                Due::GiveUp => self.no_answer(),
            },
            Stage::Bursting { silent_at } if now < *silent_at => Step::none(),
            Stage::Bursting { .. } => {
                task.stage = Stage::Mending {
                    asked: Vec::new(),
                    last_heard: now,
                };
                self.mend(now)
            }
            Stage::Mending { last_heard, .. } if now.since(*last_heard) > TIMEOUT * RETRIES => {
                self.no_answer()
            }
            Stage::Mending { asked, .. } if asked.iter().all(|(_, due)| now < *due) => Step::none(),
            Stage::Mending { .. } => self.mend(now),
        }
    }

    fn no_answer(&mut self) -> Step<Event> {
        let task = self.task.as_mut();
        let so_far = task.map_or(Vec::new(), |task| {
            let whole = task
                .gaps
                .first()
                .map_or(task.bytes.len(), |(offset, _)| offset as usize);
            let mut bytes = std::mem::take(&mut task.bytes);
            bytes.truncate(whole);
            bytes
        });
        self.finish(Err(JobError::NoAnswer { so_far }))
    }
}

impl Task {
    fn done(&mut self) -> Done {
        match &self.job {
            Job::Upload { .. } => Done::Uploaded,
            _ => Done::Downloaded(std::mem::take(&mut self.bytes)),
        }
    }

    fn add_entries(&mut self, data: &[u8]) {
        for entry in data
            .split(|byte| *byte == 0)
            .filter(|entry| !entry.is_empty())
        {
            self.listed += 1;
            let text = String::from_utf8_lossy(&entry[1..]);
            match entry[0] {
                b'D' => self.entries.push((format!("{text}/"), None)),
                b'F' => {
                    let (name, size) = text.split_once('\t').unwrap_or((&text, ""));
                    self.entries.push((name.to_owned(), size.parse().ok()));
                }
                _ => {}
            }
        }
    }
}
