//! Which messages are sent how often.
//!
//! Nothing but heartbeats flows until a ground station is heard; from then on every stream has a default rate that a
//! parameter sets, and that `SET_MESSAGE_INTERVAL` or `REQUEST_DATA_STREAM` overrides.

use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::dialect::tandem::MavDataStream;

use super::parameters::{Parameter, Parameters};

/// What can be sent again and again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stream {
    Attitude,
    GlobalPosition,
    LocalPosition,
    GpsRaw,
    Hud,
    SystemStatus,
    LandedState,
    Battery,
    MissionCurrent,
    SystemTime,
    Home,
    Navigation,
    Fence,
}

struct Row {
    stream: Stream,
    id: u32,
    rate: Parameter,
    group: MavDataStream,
}

const fn row(stream: Stream, id: u32, rate: Parameter, group: MavDataStream) -> Row {
    Row {
        stream,
        id,
        rate,
        group,
    }
}

const TABLE: [Row; 13] = [
    row(
        Stream::Attitude,
        30,
        Parameter::AttitudeRate,
        MavDataStream::MAV_DATA_STREAM_EXTRA1,
    ),
    row(
        Stream::GlobalPosition,
        33,
        Parameter::PositionRate,
        MavDataStream::MAV_DATA_STREAM_POSITION,
    ),
    row(
        Stream::LocalPosition,
        32,
        Parameter::PositionRate,
        MavDataStream::MAV_DATA_STREAM_POSITION,
    ),
    row(
        Stream::GpsRaw,
        24,
        Parameter::StatusRate,
        MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS,
    ),
    row(
        Stream::Hud,
        74,
        Parameter::HudRate,
        MavDataStream::MAV_DATA_STREAM_EXTRA2,
    ),
    row(
        Stream::SystemStatus,
        1,
        Parameter::StatusRate,
        MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS,
    ),
    row(
        Stream::LandedState,
        245,
        Parameter::StatusRate,
        MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS,
    ),
    row(
        Stream::Battery,
        147,
        Parameter::SlowRate,
        MavDataStream::MAV_DATA_STREAM_EXTRA3,
    ),
    row(
        Stream::MissionCurrent,
        42,
        Parameter::StatusRate,
        MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS,
    ),
    row(
        Stream::SystemTime,
        2,
        Parameter::SlowRate,
        MavDataStream::MAV_DATA_STREAM_EXTRA3,
    ),
    row(
        Stream::Home,
        242,
        Parameter::SlowRate,
        MavDataStream::MAV_DATA_STREAM_EXTRA3,
    ),
    row(
        Stream::Navigation,
        62,
        Parameter::StatusRate,
        MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS,
    ),
    row(
        Stream::Fence,
        162,
        Parameter::StatusRate,
        MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS,
    ),
];

impl Stream {
    /// The stream of that message.
    pub(super) fn of(id: u32) -> Option<Self> {
        TABLE.iter().find(|row| row.id == id).map(|row| row.stream)
    }
}

/// How often each is sent, and when it is due.
#[derive(Clone, Debug, Default)]
pub(super) struct Streams {
    /// Whether anybody is there to hear.
    flowing: bool,
    /// What was asked for; zero for never.
    asked: [Option<Duration>; TABLE.len()],
    due: [Stamp; TABLE.len()],
}

impl Streams {
    /// Somebody listens.
    pub(super) fn start(&mut self) {
        self.flowing = true;
    }

    /// Asks for that message every `interval`: zero for never, `None` for the default. False if it is not a stream.
    pub(super) fn ask(&mut self, id: u32, interval: Option<Duration>) -> bool {
        let Some(index) = TABLE.iter().position(|row| row.id == id) else {
            return false;
        };
        self.flowing = true;
        self.asked[index] = interval;
        self.due[index] = Stamp::ZERO;
        true
    }

    /// Asks for a group of messages, the older way.
    pub(super) fn ask_group(&mut self, group: MavDataStream, interval: Duration) {
        for row in &TABLE {
            if group == MavDataStream::MAV_DATA_STREAM_ALL || group == row.group {
                self.ask(row.id, Some(interval));
            }
        }
    }

    /// How often that message is sent: zero for never; `None` if it is not a stream.
    pub(super) fn interval(&self, id: u32, parameters: &Parameters) -> Option<Duration> {
        let index = TABLE.iter().position(|row| row.id == id)?;
        Some(self.interval_of(index, parameters))
    }

    fn interval_of(&self, index: usize, parameters: &Parameters) -> Duration {
        self.asked[index].unwrap_or_else(|| {
            let rate_hz = parameters.get(TABLE[index].rate);
            // Slower than this is never; a tiny rate would not fit a span of time.
            if rate_hz >= 0.001 {
                Duration::from_secs_f64(1.0 / rate_hz)
            } else {
                Duration::ZERO
            }
        })
    }

    /// What is to be sent now.
    pub(super) fn due(&mut self, now: Stamp, parameters: &Parameters) -> Vec<Stream> {
        if !self.flowing {
            return Vec::new();
        }
        let mut streams = Vec::new();
        for (index, row) in TABLE.iter().enumerate() {
            let interval = self.interval_of(index, parameters);
            if interval.is_zero() || now < self.due[index] {
                continue;
            }
            streams.push(row.stream);
            // In step with the rate, not with the moment it was noticed; but without catching up.
            let next = self.due[index] + interval;
            self.due[index] = if next > now { next } else { now + interval };
        }
        streams
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::mode::Kind;

    fn count(streams: &mut Streams, stream: Stream, seconds: u64) -> usize {
        let parameters = Parameters::new(Kind::Copter);
        let steps = (0..seconds * 50).map(|i| Stamp::from_nanos(i * 20_000_000));
        let sent = steps.flat_map(|now| streams.due(now, &parameters));
        sent.filter(|&s| s == stream).count()
    }

    #[test]
    fn nothing_flows_before_somebody_listens_and_then_at_the_rate_asked_for() {
        let mut streams = Streams::default();
        assert_eq!(count(&mut streams, Stream::Attitude, 2), 0);
        streams.start();
        assert_eq!(count(&mut streams, Stream::Attitude, 2), 20);
        let mut streams = Streams::default();
        assert!(streams.ask(30, Some(Duration::from_millis(250))));
        assert_eq!(count(&mut streams, Stream::Attitude, 2), 8);
        assert!(streams.ask(30, Some(Duration::ZERO)));
        assert_eq!(count(&mut streams, Stream::Attitude, 2), 0);
        assert!(
            !streams.ask(54_100, None),
            "nothing that this vehicle sends"
        );
    }
}
