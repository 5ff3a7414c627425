//! What vehicles and this station said.

use std::collections::VecDeque;

use maps::time::Stamp;
use mavlink_ext::SystemId;

/// How many lines are kept.
const KEPT: usize = 500;

/// `MAV_SEVERITY`, most severe first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Emergency, alert or critical.
    Critical,
    /// Something does not work.
    Error,
    /// Something may soon not work.
    Warning,
    /// For the operator to know.
    Notice,
    /// For whoever looks for a fault.
    Debug,
}

impl Severity {
    /// From the number on the wire.
    pub fn from_number(number: u8) -> Self {
        match number {
            0..=2 => Self::Critical,
            3 => Self::Error,
            4 => Self::Warning,
            5 | 6 => Self::Notice,
            _ => Self::Debug,
        }
    }

    /// One word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Critical => "CRITICAL",
            Self::Error => "ERROR",
            Self::Warning => "WARNING",
            Self::Notice => "INFO",
            Self::Debug => "DEBUG",
        }
    }
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct LogLine {
    /// When it was received or said.
    pub at: Stamp,
    /// Who said it; `None` is this station.
    pub from: Option<SystemId>,
    /// How bad it is.
    pub severity: Severity,
    /// The words.
    pub text: String,
}

/// The last lines, the newest last.
#[derive(Clone, Debug, Default)]
pub struct Log {
    lines: VecDeque<LogLine>,
}

impl Log {
    /// Adds a line and drops the oldest of too many.
    pub fn push(&mut self, line: LogLine) {
        if self.lines.len() == KEPT {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
    }

    /// All lines, the oldest first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &LogLine> + ExactSizeIterator {
        self.lines.iter()
    }
}
