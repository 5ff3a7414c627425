//! One vehicle, as its telemetry tells.

use std::collections::VecDeque;
use std::time::Duration;

use geodesy::Geodetic;
use maps::frame::{Body, Isometry, Point, World};
use maps::time::Stamp;
use mavlink_ext::SystemId;
use nalgebra::{Isometry3, UnitQuaternion};

use super::{LINK_LOST_AFTER, Timed};
use crate::modes::{Firmware, Kind, Mode};

/// A track longer than this loses its oldest points.
const TRACK_POINTS: usize = 20_000;
/// A track gets a new point after this distance.
const TRACK_STEP_M: f64 = 0.02;

/// An armed aircraft above this height, that does not tell whether it has landed, is taken to fly.
const AIRBORNE_M: f64 = 0.5;

/// Whether and on how many links a vehicle is heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// Its autopilot's heartbeat is not older than [`LINK_LOST_AFTER`] on at least one link.
    Present,
    /// Nothing on any link.
    Lost,
}

/// How it is turned in the map's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// The rotation.
    pub world_from_body: UnitQuaternion<f64>,
}

impl Attitude {
    /// Compass heading of the nose, clockwise from north, 0..360.
    pub fn heading_deg(&self) -> f64 {
        (90.0 - self.heading_rad().to_degrees()).rem_euclid(360.0)
    }

    /// Heading of the nose, counter-clockwise from east.
    pub fn heading_rad(&self) -> f64 {
        self.world_from_body.euler_angles().2
    }

    /// Nose up is positive.
    pub fn pitch_deg(&self) -> f64 {
        -self.world_from_body.euler_angles().1.to_degrees()
    }

    /// Right side down is positive.
    pub fn roll_deg(&self) -> f64 {
        self.world_from_body.euler_angles().0.to_degrees()
    }
}

/// The battery that the vehicle flies or drives on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Battery {
    /// `None` if not measured.
    pub voltage_v: Option<f64>,
    /// `None` if not measured.
    pub current_a: Option<f64>,
    /// 0..=100; `None` if not estimated.
    pub remaining_percent: Option<u8>,
}

/// Where it is on the earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Altitude above the ellipsoid, if its satellite receiver tells how high sea level is above that, else above sea level.
    pub geodetic: Geodetic,
    /// Above the take-off point.
    pub above_home_m: f64,
    /// Above mean sea level, as the vehicle sends it.
    pub above_sea_m: f64,
    /// Over ground.
    pub speed_mps: f64,
}

/// The satellite receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gps {
    /// `GPS_FIX_TYPE`: 3 and more is a fix in three dimensions.
    pub fix_type: u8,
    /// `None` if unknown.
    pub satellites: Option<u8>,
}

/// Whether it stands or flies, from `EXTENDED_SYS_STATE`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Landed {
    /// On the ground.
    OnGround,
    /// In the air.
    InAir,
    /// On its way up.
    TakingOff,
    /// On its way down.
    Landing,
}

/// What its heartbeat says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// Flight or drive mode.
    pub mode: Mode,
    /// Whether the motors run.
    pub armed: bool,
    /// `MAV_STATE`: 5 is critical, 6 an emergency.
    pub system_status: u8,
}

/// How far it is in its mission.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MissionProgress {
    /// Sequence number of the item under way.
    pub current: u16,
    /// Number of items, as the vehicle counts them.
    pub total: Option<u16>,
    /// The highest item reached since the mission was started or uploaded.
    pub reached: Option<u16>,
    /// Whether it is at its end.
    pub complete: bool,
}

/// A place it was at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPoint {
    /// On the earth; `None` for a vehicle that only knows its local frame.
    pub geodetic: Option<Geodetic>,
    /// In the map's frame, once its origin is known.
    pub world: Option<Point<World>>,
}

/// One vehicle.
#[derive(Clone, Debug)]
pub struct Vehicle {
    /// Its system id.
    pub id: SystemId,
    /// What it is.
    pub kind: Kind,
    /// Whose numbers its modes are.
    pub firmware: Firmware,
    /// When its autopilot's heartbeat was last heard, by link.
    pub heard: Vec<Option<Stamp>>,
    /// What its autopilot's heartbeat says.
    pub heartbeat: Timed<Heartbeat>,
    /// Where it is on the earth.
    pub fix: Option<Timed<Fix>>,
    /// Where it is on the map.
    pub position: Option<Timed<Point<World>>>,
    /// How it is turned.
    pub attitude: Option<Timed<Attitude>>,
    /// What it runs on.
    pub battery: Option<Timed<Battery>>,
    /// Its satellite receiver.
    pub gps: Option<Timed<Gps>>,
    /// Whether its pre-arm checks pass, from `SYS_STATUS`.
    pub ready: Option<Timed<bool>>,
    /// Whether it stands or flies.
    pub landed: Option<Timed<Landed>>,
    /// How far it is in its mission.
    pub mission: Option<Timed<MissionProgress>>,
    /// Height of mean sea level above the ellipsoid where it is, from its satellite receiver; 0 until it tells.
    pub geoid_height_m: f64,
    /// Where it was, the newest last.
    pub track: VecDeque<TrackPoint>,
    /// What it said of why it cannot be armed, the newest last.
    pub not_ready: VecDeque<Timed<String>>,
}

impl Vehicle {
    /// A vehicle that was just heard for the first time.
    pub fn new(id: SystemId, kind: Kind, heartbeat: Timed<Heartbeat>) -> Self {
        Self {
            id,
            kind,
            firmware: Firmware::Other,
            heard: Vec::new(),
            heartbeat,
            fix: None,
            position: None,
            attitude: None,
            battery: None,
            gps: None,
            ready: None,
            landed: None,
            mission: None,
            geoid_height_m: 0.0,
            track: VecDeque::new(),
            not_ready: VecDeque::new(),
        }
    }

    /// What to call it, for example `UGV 2`.
    pub fn name(&self) -> String {
        format!("{} {}", self.kind.word(), self.id.0)
    }

    /// Whether it is heard on any link. Only its autopilot's own heartbeat counts.
    pub fn presence(&self, now: Stamp) -> Presence {
        if self.heartbeat.age(now) > LINK_LOST_AFTER {
            Presence::Lost
        } else {
            Presence::Present
        }
    }

    /// Whether its motors run, as it last said.
    pub fn is_armed(&self) -> bool {
        self.heartbeat.value.armed
    }

    /// Whether it is off the ground: as it says, or as its height says if it does not.
    pub fn is_airborne(&self) -> bool {
        let high = self
            .fix
            .is_some_and(|fix| fix.value.above_home_m > AIRBORNE_M);
        let airborne = self
            .landed
            .map_or(high, |landed| landed.value != Landed::OnGround);
        self.kind.flies() && airborne && self.is_armed()
    }

    /// Notes that its autopilot was heard on a link.
    pub fn hear(&mut self, link: usize, now: Stamp) {
        if self.heard.len() <= link {
            self.heard.resize(link + 1, None);
        }
        self.heard[link] = Some(now);
    }

    /// Time since its autopilot was heard on each link that ever heard it.
    pub fn link_ages(&self, now: Stamp) -> impl Iterator<Item = (usize, Duration)> {
        let heard = self.heard.iter().enumerate();
        heard.filter_map(move |(link, at)| at.map(|at| (link, now.since(at))))
    }

    /// Adds a place to the track, unless it is where the track ends.
    pub fn extend_track(&mut self, point: TrackPoint) {
        let moved = match (self.track.back().and_then(|last| last.world), point.world) {
            (Some(last), Some(next)) => (next - last).norm() >= TRACK_STEP_M,
            _ => true,
        };
        if !moved {
            return;
        }
        if self.track.len() == TRACK_POINTS {
            self.track.pop_front();
        }
        self.track.push_back(point);
    }

    /// Its pose on the map.
    pub fn world_from_body(&self) -> Option<Isometry<World, Body>> {
        let (position, attitude) = (self.position?, self.attitude?);
        Some(Isometry::claim(Isometry3::from_parts(
            position.value.raw.into(),
            attitude.value.world_from_body,
        )))
    }
}
