//! The key and the highest timestamp, on disk.

use std::fs::{self, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::NamedTempFile;

use super::{SigningKey, Timestamp};

/// A restart with a wrong clock begins so long after the highest timestamp that was kept, which may be this old. ArduPilot
/// does the same.
const AHEAD: Timestamp = Timestamp::from_duration(Duration::from_mins(1));
/// Read and written by its owner only.
const MODE: u32 = 0o600;
const OTHERS: u32 = 0o077;
const DIGIT: &[u8; 16] = b"0123456789abcdef";
/// Hexadecimal digits of a key.
const DIGITS: usize = 64;

/// Why a key cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// The file cannot be read.
    #[error("cannot read the key {}", path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Others may read it.
    #[error("the key {} can be read by others (mode {mode:03o}): chmod 600 it", path.display())]
    Exposed {
        /// Which file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// It is no key.
    #[error("{} is no key: 64 hexadecimal digits are expected", path.display())]
    Content {
        /// Which file.
        path: PathBuf,
    },
    /// A file cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// A file with a key of 64 hexadecimal digits, and one beside it, `KEY.timestamp`.
#[derive(Clone, Debug)]
pub struct KeyFile {
    path: PathBuf,
}

impl KeyFile {
    /// The key in this file.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into() }
    }

    /// Writes a key into a file that must not be there yet.
    pub fn create(&self, key: &SigningKey) -> Result<(), KeyError> {
        let mut digits = String::new();
        for byte in key.0 {
            digits
                .extend([byte >> 4, byte & 15].map(|digit| char::from(DIGIT[usize::from(digit)])));
        }
        let written = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(MODE)
            .open(&self.path)
            .and_then(|mut file| file.write_all((digits + "\n").as_bytes()));
        written.map_err(|source| KeyError::Write {
            path: self.path.clone(),
            source,
        })
    }

    /// Reads the key. Refused if anybody else may read the file.
    pub fn read(&self) -> Result<SigningKey, KeyError> {
        let path = || self.path.clone();
        let failed = |source| KeyError::Read {
            path: path(),
            source,
        };
        let file = fs::File::open(&self.path).map_err(failed)?;
        let mode = file.metadata().map_err(failed)?.mode() & 0o777;
        if mode & OTHERS != 0 {
            return Err(KeyError::Exposed { path: path(), mode });
        }
        let mut text = String::new();
        // A file that is no key may be long, or not end.
        let taken = file.take(2 * DIGITS as u64).read_to_string(&mut text);
        let content = || KeyError::Content { path: path() };
        taken.map_err(|error| match error.kind() {
            io::ErrorKind::InvalidData => content(),
            _ => failed(error),
        })?;
        parse(text.trim()).map(SigningKey::new).ok_or_else(content)
    }

    /// After which timestamp to begin where the clock shows that: what was kept, and a minute if the clock is behind it and
    /// so cannot be right. The lowest if nothing was kept.
    ///
    /// A clock that has passed what was kept needs no minute: programs that share a key and start together would each be a
    /// minute ahead of the one before, and not take its frames.
    pub fn begin(&self, clock: Timestamp) -> Timestamp {
        let kept = fs::read_to_string(self.timestamp_path()).ok();
        let kept = kept
            .and_then(|text| text.trim().parse().ok())
            .map(|kept: u64| Timestamp(kept.min(Timestamp::MAX)));
        match kept {
            Some(kept) if kept > clock => kept.plus(AHEAD),
            Some(kept) => kept,
            None => Timestamp::default(),
        }
    }

    /// Keeps the highest timestamp, for the next start. To be called at least every half minute.
    pub fn keep(&self, timestamp: Timestamp) -> Result<(), KeyError> {
        let path = self.timestamp_path();
        // Under a name of its own first: several links may keep the timestamps of one key, in one program or in several.
        let write = || {
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
            let mut file = NamedTempFile::new_in(folder.unwrap_or(Path::new(".")))?;
            writeln!(file, "{}", timestamp.0)?;
            file.as_file().sync_all()?;
            file.persist(&path).map_err(io::Error::from)
        };
        match write() {
            Ok(_file) => Ok(()),
            Err(source) => Err(KeyError::Write { path, source }),
        }
    }

    fn timestamp_path(&self) -> PathBuf {
        let mut name = self.path.clone().into_os_string();
        name.push(".timestamp");
        name.into()
    }
}

fn parse(digits: &str) -> Option<[u8; 32]> {
    let mut key = [0; 32];
    if digits.len() != DIGITS || !digits.is_ascii() {
        return None;
    }
    for (place, byte) in key.iter_mut().enumerate() {
        *byte = u8::from_str_radix(digits.get(2 * place..2 * place + 2)?, 16).ok()?;
    }
    Some(key)
}
