//! Everything the ground station knows: pure state, shown by [`crate::view`] and changed by [`crate::station`] alone.
//!
//! Each value keeps the time it was received, and its age decides how it is shown: fresh, dimmed, or dashes. What a vehicle
//! does is known from its telemetry; a command that was sent or even accepted is only that.

pub mod alerts;
pub mod log;
pub mod map;
pub mod missions;
pub mod orders;
pub mod vehicle;

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::SystemId;

use crate::config::Config;

/// Without a heartbeat for this long a link, and then a vehicle, counts as lost (as in `QGroundControl`'s
/// `VehicleLinkManager`).
pub const LINK_LOST_AFTER: Duration = Duration::from_millis(3500);

/// A value and when it was received.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timed<T> {
    /// The value.
    pub value: T,
    /// When it was received.
    pub at: Stamp,
}

/// How far a value can be trusted, by its age.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Freshness {
    /// Not older than one and a half expected periods.
    Fresh,
    /// Older: shown dimmed with its age.
    Old,
    /// As old as a lost link: shown as dashes.
    Lost,
}

impl<T> Timed<T> {
    /// The value, received at `at`.
    pub fn new(value: T, at: Stamp) -> Self {
        Self { value, at }
    }

    /// Time since it was received.
    pub fn age(&self, now: Stamp) -> Duration {
        now.since(self.at)
    }

    /// How far to trust it, if one is expected every `period`.
    pub fn freshness(&self, now: Stamp, period: Duration) -> Freshness {
        let age = self.age(now);
        if age > LINK_LOST_AFTER.max(period * 3) {
            Freshness::Lost
        } else if age > period * 3 / 2 {
            Freshness::Old
        } else {
            Freshness::Fresh
        }
    }
}

/// Where the events come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Vehicles that can be commanded.
    Live,
    /// A recording: nothing is ever sent.
    Replay,
}

/// One link of this station.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkState {
    /// As it was asked for.
    pub uri: String,
    /// Why it does not work, if it does not.
    pub error: Option<String>,
    /// Bytes received.
    pub bytes_received: u64,
    /// Bytes sent.
    pub bytes_sent: u64,
    /// Damaged or unknown frames received.
    pub bad_frames: u64,
    /// When the last frame came.
    pub heard_at: Option<Stamp>,
    /// Bytes received per second, over the last seconds.
    pub receive_rate_bps: f64,
}

/// Everything the ground station knows.
#[derive(Debug)]
pub struct Model {
    /// The time of the last event.
    pub now: Stamp,
    /// Unix time of the clock's start, in microseconds.
    pub epoch_unix_us: u64,
    /// Live or a recording.
    pub source: Source,
    /// What is configured: this station's address, the ground vehicle's size.
    pub config: Config,
    /// By system id.
    pub vehicles: BTreeMap<SystemId, vehicle::Vehicle>,
    /// The vehicle that map clicks and the mission panel are about. Only the operator changes it, once it is set.
    pub active: Option<SystemId>,
    /// The links, in the order they were opened.
    pub links: Vec<LinkState>,
    /// The map the companions build.
    pub map: map::MapState,
    /// The plan for each vehicle and what became of it.
    pub missions: BTreeMap<SystemId, missions::Mission>,
    /// Orders that were sent, the newest first.
    pub orders: orders::Orders,
    /// What the operator must know now.
    pub alerts: alerts::Alerts,
    /// What vehicles and this station said, the newest last.
    pub log: log::Log,
}

impl Model {
    /// Knows nothing yet.
    pub fn new(config: Config, source: Source, epoch_unix_us: u64) -> Self {
        Self {
            now: Stamp::ZERO,
            epoch_unix_us,
            source,
            map: map::MapState::new(),
            config,
            vehicles: BTreeMap::new(),
            active: None,
            links: Vec::new(),
            missions: BTreeMap::new(),
            orders: orders::Orders::default(),
            alerts: alerts::Alerts::default(),
            log: log::Log::default(),
        }
    }

    /// The active vehicle.
    pub fn active_vehicle(&self) -> Option<&vehicle::Vehicle> {
        self.active.and_then(|id| self.vehicles.get(&id))
    }

    /// What to call a system, for example `UGV 2`.
    pub fn name_of(&self, id: SystemId) -> String {
        self.vehicles
            .get(&id)
            .map_or_else(|| format!("System {}", id.0), vehicle::Vehicle::name)
    }

    /// Unix time of `at` in microseconds.
    pub fn unix_us(&self, at: Stamp) -> u64 {
        self.epoch_unix_us.saturating_add(at.as_nanos() / 1000)
    }

    /// The time of day of `at` in UTC, as `14:03:59`.
    pub fn utc(&self, at: Stamp) -> String {
        let seconds = self.unix_us(at) / 1_000_000 % 86_400;
        format!(
            "{:02}:{:02}:{:02}",
            seconds / 3600,
            seconds / 60 % 60,
            seconds % 60
        )
    }
}
