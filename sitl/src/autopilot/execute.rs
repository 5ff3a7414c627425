//! The mission, item by item.
//!
//! Items that go somewhere (`NAV_`) are done one after the other; those that only change something (`DO_`) are done as
//! soon as the one before them is reached. Waypoints in a row are one line for a rover, which it drives without
//! stopping; a change of direction ends it.
//!
//! Ground stations write the home position as item 0 of an `ArduPilot` mission: a waypoint in the frame of absolute
//! altitudes. Such a first item is not flown to. A mission that starts with anything else is done from its first item.

use std::collections::BTreeSet;
use std::time::Duration;

use maps::frame::{Point, World};
use maps::time::Stamp;
use mavlink_ext::Message;
use mavlink_ext::dialect::cmd;
use mavlink_ext::dialect::tandem::{MISSION_ITEM_REACHED_DATA, MavSeverity};
use mavlink_ext::mission::{MissionFrame, MissionItem};

use super::Autopilot;
use super::fence::Parts;
use super::guide::Goal;
use super::mode::{Kind, Mode};
use super::parameters::Parameter;
use super::pursuit::Line;
use crate::wgs84::Geodetic;

/// How the mission goes.
#[derive(Clone, Debug, Default)]
pub struct Execution {
    current: usize,
    state: State,
    /// Item that is being done, and until when it holds once it is reached.
    active: Option<Active>,
    reached: BTreeSet<usize>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum State {
    #[default]
    NotStarted,
    Running,
    Complete,
}

#[derive(Clone, Copy, Debug)]
struct Active {
    item: usize,
    hold: Duration,
    reached_at: Option<Stamp>,
}

impl Execution {
    /// The item being done, or to be done next.
    pub fn current(&self) -> usize {
        self.current
    }

    /// Items that were reached, in order of their numbers.
    pub fn reached(&self) -> &BTreeSet<usize> {
        &self.reached
    }

    /// Whether the last item has been done.
    pub fn is_complete(&self) -> bool {
        self.state == State::Complete
    }

    pub(super) fn state(&self) -> State {
        self.state
    }
}

impl Autopilot {
    /// A new mission has come in.
    pub(super) fn mission_replaced(&mut self, items: usize) {
        self.execution = Execution {
            current: self.first_item(),
            ..Execution::default()
        };
        self.say(
            MavSeverity::MAV_SEVERITY_INFO,
            &format!("Mission: {items} items"),
        );
        if self.mode == Mode::Auto {
            // What was being done is no longer there: start over, or stay if there is nothing.
            self.goal = Goal::Stay;
        }
    }

    /// Item 0, unless it is the home position.
    pub(crate) fn first_item(&self) -> usize {
        let first = self.mission.items().first();
        let home = first.is_some_and(|item| {
            item.command == cmd::NAV_WAYPOINT && item.frame == MissionFrame::Global
        });
        usize::from(home)
    }

    /// Whether there is anything to do.
    pub(super) fn has_mission(&self) -> bool {
        self.mission.items().len() > self.first_item()
    }

    /// Whether a copter that stands on the ground would be told to go somewhere without having taken off.
    pub(super) fn lacks_takeoff(&self) -> bool {
        let mut items = self.mission.items()[self.first_item()..].iter();
        let first = items.find(|item| goes_somewhere(item.command));
        self.kind == Kind::Copter && first.is_some_and(|item| item.command != cmd::NAV_TAKEOFF)
    }

    /// Goes on with that item. False if there is no such item.
    pub(super) fn set_mission_current(&mut self, item: usize) -> bool {
        if item >= self.mission.items().len() {
            return false;
        }
        self.execution.current = item.max(self.first_item());
        self.execution.active = None;
        if self.execution.state == State::Complete {
            self.execution.state = State::NotStarted;
        }
        true
    }

    /// Starts over.
    pub(super) fn restart_mission(&mut self) {
        self.execution = Execution {
            current: self.first_item(),
            ..Execution::default()
        };
    }

    /// What was interrupted by another mode goes on from its beginning.
    pub(super) fn resume_mission(&mut self) {
        self.execution.active = None;
        if self.execution.state == State::Complete {
            self.restart_mission();
        }
    }

    /// One step of the mission, in AUTO.
    pub(super) fn execute_mission(&mut self, now: Stamp) {
        if self.mode != Mode::Auto || !self.armed || self.execution.state == State::Complete {
            return;
        }
        if let Some(active) = self.execution.active {
            if !self.is_done(now, active) {
                return;
            }
            self.execution.active = None;
        }
        while self.execution.active.is_none() {
            let Some(item) = self.mission.items().get(self.execution.current).copied() else {
                self.mission_complete();
                return;
            };
            self.execution.state = State::Running;
            if goes_somewhere(item.command) {
                self.begin(self.execution.current, &item);
            } else {
                self.change(&item);
                self.item_reached(self.execution.current);
            }
        }
        self.mission.set_current(self.execution.current as u16);
    }

    fn mission_complete(&mut self) {
        self.execution.state = State::Complete;
        self.execution.current = self.mission.items().len().saturating_sub(1);
        self.say(MavSeverity::MAV_SEVERITY_INFO, "Mission complete");
        self.out.push(self.mission_current());
        if !matches!(self.goal, Goal::Land(_)) {
            self.goal = Goal::Stay;
        }
    }

    /// Whether the item has been reached and held as long as it asks for.
    fn is_done(&mut self, now: Stamp, active: Active) -> bool {
        if self.kind == Kind::Rover {
            // Its waypoints are reported while it drives; here only the hold at the end of a line is left.
            let standing = matches!(self.goal, Goal::Stay);
            return standing && self.held(now, active);
        }
        let here = self.estimate.position();
        let radius_m = self.parameters.get(Parameter::CopterWaypointRadius) / 100.0;
        let arrived = match self.goal {
            Goal::Hover(to) => (to - here).norm() <= radius_m,
            Goal::TakeOff(to) => (to.raw.z - here.raw.z).abs() <= radius_m,
            Goal::Land(_) | Goal::Stay | Goal::Drive { .. } => false,
        };
        if arrived && active.reached_at.is_none() {
            self.execution.active = Some(Active {
                reached_at: Some(now),
                ..active
            });
            self.item_reached(active.item);
        }
        let active = self.execution.active.unwrap_or(active);
        active.reached_at.is_some() && self.held(now, active)
    }

    fn held(&mut self, now: Stamp, active: Active) -> bool {
        let Some(since) = active.reached_at else {
            self.execution.active = Some(Active {
                reached_at: Some(now),
                ..active
            });
            return active.hold.is_zero();
        };
        now.since(since) >= active.hold
    }

    /// Reports an item and makes the next one current.
    pub(super) fn item_reached(&mut self, item: usize) {
        if self.mode != Mode::Auto {
            return;
        }
        self.execution.reached.insert(item);
        self.execution.current = item + 1;
        self.out
            .push(Message::MISSION_ITEM_REACHED(MISSION_ITEM_REACHED_DATA {
                seq: item as u16,
            }));
        // A line runs on past items that only change something.
        if matches!(self.goal, Goal::Drive { .. }) {
            while let Some(next) = self.mission.items().get(self.execution.current).copied() {
                if goes_somewhere(next.command) {
                    break;
                }
                self.change(&next);
                let changed = self.execution.current;
                self.execution.reached.insert(changed);
                self.execution.current += 1;
            }
        }
    }

    fn begin(&mut self, index: usize, item: &MissionItem) {
        let hold = hold_of(item);
        self.execution.active = Some(Active {
            item: index,
            hold,
            reached_at: None,
        });
        match (self.kind, item.command) {
            (_, cmd::NAV_RETURN_TO_LAUNCH) => {
                self.execution.reached.insert(index);
                self.execution.state = State::Complete;
                self.enter(Mode::Rtl);
            }
            (Kind::Copter, cmd::NAV_TAKEOFF) => {
                let here = self.estimate.position().raw;
                self.goal = Goal::TakeOff(Point::new(here.x, here.y, self.place_of(item).raw.z));
            }
            (Kind::Copter, cmd::NAV_LAND) => {
                let named = item.lat_deg.abs() > 1e-9 || item.lon_deg.abs() > 1e-9;
                let at = if named {
                    self.place_of(item)
                } else {
                    self.estimate.position()
                };
                self.goal = Goal::Land(at);
            }
            (Kind::Copter, _) => self.goal = Goal::Hover(self.place_of(item)),
            (Kind::Rover, _) => self.begin_line(index),
        }
    }

    /// All waypoints that can be driven in one go from this one on.
    fn begin_line(&mut self, first: usize) {
        let mut items = Vec::new();
        let mut points = Vec::new();
        let mut hold = Duration::ZERO;
        for (index, item) in self.mission.items().iter().enumerate().skip(first) {
            let stops = match item.command {
                cmd::DO_SET_REVERSE => (item.params[0] > 0.5) != self.reverse,
                cmd::NAV_RETURN_TO_LAUNCH => true,
                command => !hold.is_zero() && goes_somewhere(command),
            };
            if stops {
                break;
            }
            if goes_somewhere(item.command) {
                items.push(index);
                points.push(self.place_of(item));
                hold = hold_of(item);
            }
        }
        if let Some(active) = &mut self.execution.active {
            active.hold = hold;
        }
        self.goal = Goal::Drive {
            line: Line::new(self.estimate.position(), points),
            items,
        };
    }

    /// An item that only changes something.
    fn change(&mut self, item: &MissionItem) {
        match item.command {
            cmd::DO_CHANGE_SPEED => {
                self.change_speed(item.params[1]);
            }
            cmd::DO_SET_REVERSE => self.reverse = item.params[0] > 0.5,
            cmd::DO_FENCE_ENABLE => {
                self.switch_fence(item.params[0], 0.0);
            }
            // There is no camera to trigger: the recording has every frame.
            _ => {}
        }
    }

    /// 1: the fence is on, 0: it is off; the second number says which parts, 0 for all.
    pub(super) fn switch_fence(&mut self, on: f32, parts: f32) -> bool {
        let (on, word) = match on {
            on if on.abs() < 0.5 => (false, "disabled"),
            on if (on - 1.0).abs() < 0.5 => (true, "enabled"),
            _ => return false, // 2 is the floor of a fence, which these vehicles do not have.
        };
        let parts = if parts > 0.5 {
            Parts::from_bits(parts as u32)
        } else {
            Parts::ALL
        };
        let settings = self.fence_settings();
        let changed = self.fence.switch(&settings, on, parts);
        if !changed.is_empty() {
            let text = format!("{} {word}", changed.names());
            self.say(MavSeverity::MAV_SEVERITY_NOTICE, &text);
        }
        true
    }

    /// A speed in m/s, if it is one; the default again if it is not positive.
    pub(super) fn change_speed(&mut self, speed_mps: f32) -> bool {
        if !speed_mps.is_finite() {
            return false;
        }
        let speed_mps = f64::from(speed_mps);
        self.speed_mps = (speed_mps > 0.0).then_some(speed_mps.min(10.0));
        true
    }

    /// Where an item is in the world.
    pub(super) fn place_of(&self, item: &MissionItem) -> Point<World> {
        self.place(item.lat_deg, item.lon_deg, (item.frame, item.alt_m))
    }

    /// A latitude and longitude at an altitude of that kind. A rover stays on the ground.
    pub(super) fn place(
        &self,
        lat_deg: f64,
        lon_deg: f64,
        (frame, alt_m): (MissionFrame, f64),
    ) -> Point<World> {
        let place = Geodetic {
            lat_deg,
            lon_deg,
            alt_m: self.origin.place().alt_m,
        };
        let flat = self.origin.to_world(place).raw;
        let z = match (self.kind, frame) {
            (Kind::Rover, _) => self.estimate.position().raw.z,
            (Kind::Copter, MissionFrame::Global) => alt_m - self.origin.place().alt_m,
            (Kind::Copter, _) => alt_m + self.home.map_or(0.0, |home| home.raw.z),
        };
        Point::new(flat.x, flat.y, z)
    }

    /// Copter: it stands again. It disarms, and a mission that ended with a landing is complete.
    pub(super) fn landed(&mut self) {
        if let Some(active) = self.execution.active.take()
            && matches!(self.goal, Goal::Land(_))
        {
            self.item_reached(active.item);
            if self.execution.current >= self.mission.items().len() {
                self.mission_complete();
            }
        }
        self.disarm();
    }
}

/// Whether an item has a place, or ends at one; the others only change something.
fn goes_somewhere(command: u16) -> bool {
    matches!(
        command,
        cmd::NAV_WAYPOINT
            | cmd::NAV_LOITER_UNLIM
            | cmd::NAV_LOITER_TIME
            | cmd::NAV_RETURN_TO_LAUNCH
            | cmd::NAV_LAND
            | cmd::NAV_TAKEOFF
    )
}

/// How long to stay once it is reached.
fn hold_of(item: &MissionItem) -> Duration {
    match item.command {
        cmd::NAV_LOITER_UNLIM => Duration::MAX,
        cmd::NAV_WAYPOINT | cmd::NAV_LOITER_TIME => {
            Duration::try_from_secs_f32(item.params[0]).unwrap_or(Duration::ZERO)
        }
        _ => Duration::ZERO,
    }
}
