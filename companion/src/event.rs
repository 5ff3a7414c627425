//! Everything that can happen to the companion, and everything it can do.
//!
//! Recording the events with their stamps, in order, is a replay of the flight.

use mavlink_ext::RawFrame;

use crate::pipeline::{FrameDone, SourceEnded, TilesChanged};
use crate::report::Report;

/// A way to other MAVLink components.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LinkId {
    /// The vehicle's autopilot.
    Autopilot,
    /// The ground station.
    Ground,
}

impl LinkId {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Autopilot, Self::Ground];
}

/// Everything that can happen.
#[derive(Clone, Debug)]
pub enum Event {
    /// A whole MAVLink frame came in.
    Received(LinkId, RawFrame),
    /// A camera frame has been tracked.
    FrameDone(Box<FrameDone>),
    /// The map has changed.
    TilesChanged(TilesChanged),
    /// There are no more camera frames.
    SourceEnded(SourceEnded),
    /// Time has passed; comes every few milliseconds.
    Tick,
    /// The operator or the system wants the program to end.
    Stop,
}

/// Everything the companion can do.
#[derive(Clone, Debug)]
pub enum Action {
    /// Sends a frame.
    Send(LinkId, RawFrame),
    /// Tells the log what the operator was told.
    Log(Severity, String),
    /// Writes the report.
    WriteReport(Box<Report>),
    /// Ends the pipeline; [`Event::SourceEnded`] still comes.
    StopSource,
    /// Ends the program.
    Exit,
}

/// How bad something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// Data is lost.
    Error,
    /// Something is worse than it should be.
    Warning,
    /// Good to know.
    Info,
}
