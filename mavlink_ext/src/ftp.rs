//! Files over MAVLink: a server of a folder, and a client.
//!
//! Each request is answered once, ACK or NAK; it is repeated until then, and a server that sees a request again sends its last
//! answer again. A burst read streams a file, and what is lost of it is asked for piece by piece.
//! <https://mavlink.io/en/services/ftp.html>

pub mod client;
mod root;
pub mod server;
#[cfg(test)]
mod tests;

use crate::dialect::Message;
use crate::dialect::tandem::FILE_TRANSFER_PROTOCOL_DATA;
use crate::wire::Address;

pub use client::Client;
pub use root::Root;
pub use server::Server;

/// Bytes of a file that a message carries.
pub const CHUNK: usize = 239;
const HEADER: usize = 12;

/// What is asked, and what is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Opcode {
    TerminateSession = 1,
    ResetSessions = 2,
    ListDirectory = 3,
    OpenFileRo = 4,
    ReadFile = 5,
    CreateFile = 6,
    WriteFile = 7,
    RemoveFile = 8,
    CreateDirectory = 9,
    RemoveDirectory = 10,
    TruncateFile = 12,
    Rename = 13,
    CalcFileCrc32 = 14,
    BurstReadFile = 15,
    Ack = 128,
    Nak = 129,
}

impl Opcode {
    const ALL: [Self; 16] = [
        Self::TerminateSession,
        Self::ResetSessions,
        Self::ListDirectory,
        Self::OpenFileRo,
        Self::ReadFile,
        Self::CreateFile,
        Self::WriteFile,
        Self::RemoveFile,
        Self::CreateDirectory,
        Self::RemoveDirectory,
        Self::TruncateFile,
        Self::Rename,
        Self::CalcFileCrc32,
        Self::BurstReadFile,
        Self::Ack,
        Self::Nak,
    ];

    fn from_wire(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|opcode| *opcode as u8 == byte)
    }
}

/// Why a server does not do what was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FtpError {
    /// Some failure that the protocol has no name for.
    #[error("it failed")]
    Fail,
    /// The operating system refused it.
    #[error("it failed with error {0} of the server's system")]
    Errno(u8),
    /// The request is too short or too long.
    #[error("the request has a wrong size")]
    InvalidDataSize,
    /// The session was never opened, or was closed after a long silence.
    #[error("no such session")]
    InvalidSession,
    /// Too many files are open.
    #[error("too many files are open")]
    NoSessionsAvailable,
    /// Nothing is left to read or to list.
    #[error("end of the file or list")]
    Eof,
    /// The server does not know the request.
    #[error("the server cannot do that")]
    UnknownCommand,
    /// It is there already.
    #[error("it exists already")]
    FileExists,
    /// It may not be written, or lies outside of what is served.
    #[error("it is protected")]
    FileProtected,
    /// There is no such file.
    #[error("no such file or folder")]
    FileNotFound,
    /// The server answered with an error that is not in the protocol.
    #[error("unknown error {0}")]
    Unknown(u8),
}

impl FtpError {
    fn to_wire(self) -> (u8, Option<u8>) {
        match self {
            Self::Fail => (1, None),
            Self::Errno(errno) => (2, Some(errno)),
            Self::InvalidDataSize => (3, None),
            Self::InvalidSession => (4, None),
            Self::NoSessionsAvailable => (5, None),
            Self::Eof => (6, None),
            Self::UnknownCommand => (7, None),
            Self::FileExists => (8, None),
            Self::FileProtected => (9, None),
            Self::FileNotFound => (10, None),
            Self::Unknown(code) => (code, None),
        }
    }

    fn from_wire(data: &[u8]) -> Self {
        match *data {
            [] | [1, ..] => Self::Fail,
            [2] => Self::Errno(0),
            [2, errno, ..] => Self::Errno(errno),
            [3, ..] => Self::InvalidDataSize,
            [4, ..] => Self::InvalidSession,
            [5, ..] => Self::NoSessionsAvailable,
            [6, ..] => Self::Eof,
            [7, ..] => Self::UnknownCommand,
            [8, ..] => Self::FileExists,
            [9, ..] => Self::FileProtected,
            [10, ..] => Self::FileNotFound,
            [code, ..] => Self::Unknown(code),
        }
    }
}

/// The payload of `FILE_TRANSFER_PROTOCOL`.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Packet {
    sequence: u16,
    session: u8,
    opcode: u8,
    /// What an answer answers.
    asked: u8,
    burst_complete: bool,
    offset: u32,
    /// Bytes to read, or those that follow.
    size: u8,
    data: Vec<u8>,
}

impl Packet {
    fn request(opcode: Opcode, session: u8, offset: u32, data: &[u8]) -> Self {
        let data = data[..data.len().min(CHUNK)].to_vec();
        Self {
            sequence: 0,
            session,
            opcode: opcode as u8,
            asked: 0,
            burst_complete: false,
            offset,
            size: data.len() as u8,
            data,
        }
    }

    fn read(message: &FILE_TRANSFER_PROTOCOL_DATA) -> Self {
        let [
            a,
            b,
            session,
            opcode,
            size,
            asked,
            burst,
            _,
            o0,
            o1,
            o2,
            o3,
            data @ ..,
        ] = &message.payload;
        let length = usize::from(*size).min(CHUNK);
        Self {
            sequence: u16::from_le_bytes([*a, *b]),
            session: *session,
            opcode: *opcode,
            asked: *asked,
            burst_complete: *burst != 0,
            offset: u32::from_le_bytes([*o0, *o1, *o2, *o3]),
            size: *size,
            data: data[..length].to_vec(),
        }
    }

    fn to_message(&self, to: Address) -> Message {
        let mut payload = [0; HEADER + CHUNK];
        payload[..2].copy_from_slice(&self.sequence.to_le_bytes());
        payload[2] = self.session;
        payload[3] = self.opcode;
        payload[4] = self.size;
        payload[5] = self.asked;
        payload[6] = u8::from(self.burst_complete);
        payload[8..HEADER].copy_from_slice(&self.offset.to_le_bytes());
        payload[HEADER..HEADER + self.data.len()].copy_from_slice(&self.data);
        Message::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
            target_network: 0,
            target_system: to.system.0,
            target_component: to.component.0,
            payload,
        })
    }

    /// The text that a path or an entry of a list is, up to a zero.
    fn text(&self) -> &[u8] {
        let end = self.data.iter().position(|byte| *byte == 0);
        &self.data[..end.unwrap_or(self.data.len())]
    }
}

/// The checksum of files in this protocol: CRC-32 with the register empty at first and not inverted at the end.
#[derive(Clone, Debug)]
pub struct Crc32(crc32fast::Hasher);

impl Crc32 {
    /// Of nothing.
    pub fn new() -> Self {
        Self(crc32fast::Hasher::new_with_initial(u32::MAX))
    }

    /// Of these bytes.
    pub fn of(bytes: &[u8]) -> u32 {
        let mut crc = Self::new();
        crc.update(bytes);
        crc.value()
    }

    /// With further bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// The checksum.
    pub fn value(&self) -> u32 {
        !self.0.clone().finalize()
    }
}

impl Default for Crc32 {
    fn default() -> Self {
        Self::new()
    }
}
