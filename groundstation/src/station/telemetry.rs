//! What autopilots say, into the model.

use std::time::Duration;

use geodesy::{Geodetic, Origin};
use maps::time::Stamp;
use mavlink_ext::convert;
use mavlink_ext::dialect::tandem::{
    BATTERY_STATUS_DATA, COMMAND_LONG_DATA, EXTENDED_SYS_STATE_DATA, GLOBAL_POSITION_INT_DATA,
    GPS_RAW_INT_DATA, HEARTBEAT_DATA, MISSION_CURRENT_DATA, MavAutopilot, MavLandedState,
    MavModeFlag, MissionState, SYS_STATUS_DATA,
};
use mavlink_ext::dialect::{MessageData as _, cmd, tandem};
use mavlink_ext::statustext::Text;
use mavlink_ext::{Address, Message, SystemId};

use super::{Heard, Outbox, Station};
use crate::model::Timed;
use crate::model::log::{LogLine, Severity};
use crate::model::map::MapOrigin;
use crate::model::vehicle::{
    Attitude, Battery, Fix, Gps, Heartbeat, Landed, MissionProgress, Presence, TrackPoint, Vehicle,
};
use crate::modes::{Firmware, Kind, Mode};
use crate::plan::items::last_reached;

/// `MAV_SYS_STATUS_PREARM_CHECK`.
const PREARM_CHECK: u32 = 0x1000_0000;
/// Messages that are asked for, and how often.
const WANTED: [(u32, Duration); 8] = [
    (tandem::ATTITUDE_DATA::ID, Duration::from_millis(200)),
    (
        tandem::GLOBAL_POSITION_INT_DATA::ID,
        Duration::from_millis(200),
    ),
    (
        tandem::LOCAL_POSITION_NED_DATA::ID,
        Duration::from_millis(200),
    ),
    (tandem::SYS_STATUS_DATA::ID, Duration::from_secs(1)),
    (tandem::GPS_RAW_INT_DATA::ID, Duration::from_secs(1)),
    (tandem::EXTENDED_SYS_STATE_DATA::ID, Duration::from_secs(1)),
    (tandem::MISSION_CURRENT_DATA::ID, Duration::from_secs(1)),
    (tandem::BATTERY_STATUS_DATA::ID, Duration::from_secs(2)),
];
/// A vehicle that has rebooted forgets what was asked for: ask again this often.
const ASK_EVERY: Duration = Duration::from_secs(30);
/// A vehicle explains why it cannot be armed in at most so many lines that are kept.
const REASONS: usize = 5;

/// Origins nearer to each other are one: coordinates cross the link in steps of a centimetre.
const SAME_PLACE_M: f64 = 0.03;

impl Station {
    /// Takes in what the autopilot of a vehicle says.
    pub(super) fn hear_autopilot(&mut self, heard: Heard, message: &Message, outbox: &mut Outbox) {
        let Heard { at: now, from, .. } = heard;
        if let Message::HEARTBEAT(heartbeat) = message {
            self.hear_heartbeat(heard, heartbeat, outbox);
        }
        let origin = self.model.map.origin.as_ref().map(|origin| &origin.origin);
        let Some(vehicle) = self.model.vehicles.get_mut(&from.system) else {
            return;
        };
        match message {
            Message::GLOBAL_POSITION_INT(position) => {
                hear_position(vehicle, now, position, origin);
                self.stand_in_for_origin(from.system);
            }
            Message::LOCAL_POSITION_NED(position) => {
                // The only position of a vehicle without satellites; its frame is then taken for the map's.
                if let (None, Some(local)) = (vehicle.fix, convert::local_position(position)) {
                    vehicle.position = Some(Timed::new(local.position, now));
                    vehicle.extend_track(TrackPoint {
                        geodetic: None,
                        world: Some(local.position),
                    });
                }
            }
            Message::ATTITUDE(attitude) => {
                let typed = convert::attitude(attitude);
                let typed = typed.map(|typed| {
                    Timed::new(
                        Attitude {
                            world_from_body: typed.world_from_body,
                        },
                        now,
                    )
                });
                vehicle.attitude = typed.or(vehicle.attitude);
            }
            Message::SYS_STATUS(status) => hear_system(vehicle, now, status),
            Message::BATTERY_STATUS(battery) => hear_battery(vehicle, now, battery),
            Message::GPS_RAW_INT(gps) => hear_gps(vehicle, now, gps),
            Message::EXTENDED_SYS_STATE(state) => hear_landed(vehicle, now, state),
            Message::MISSION_CURRENT(current) => self.hear_mission(now, from.system, current),
            Message::MISSION_ITEM_REACHED(reached) => {
                self.hear_reached(now, from.system, reached.seq);
            }
            Message::STATUSTEXT(piece) => {
                if let Some(text) = self.texts.hear(now, from, piece) {
                    self.hear_text(now, &text);
                }
            }
            _ => {}
        }
    }

    fn hear_heartbeat(&mut self, heard: Heard, heartbeat: &HEARTBEAT_DATA, outbox: &mut Outbox) {
        let Heard {
            at: now,
            link,
            from: Address { system: id, .. },
        } = heard;
        if heartbeat.autopilot == MavAutopilot::MAV_AUTOPILOT_INVALID {
            return;
        }
        let kind = Kind::from_mav_type(heartbeat.mavtype as u32);
        let firmware = Firmware::from_mav_autopilot(heartbeat.autopilot as u32);
        let told = Heartbeat {
            mode: Mode::from_number(firmware, kind, heartbeat.custom_mode),
            armed: heartbeat
                .base_mode
                .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
            system_status: heartbeat.system_status as u8,
        };
        let told = Timed::new(told, now);
        let is_new = !self.model.vehicles.contains_key(&id);
        let vehicle = self
            .model
            .vehicles
            .entry(id)
            .or_insert_with(|| Vehicle::new(id, kind, told));
        let was_lost = vehicle.presence(now) == Presence::Lost;
        vehicle.hear(link, now);
        (vehicle.kind, vehicle.heartbeat, vehicle.firmware) = (kind, told, firmware);
        let name = vehicle.name();
        if is_new {
            self.model.active.get_or_insert(id);
            self.say(Severity::Notice, format!("{name} is here"));
        } else if was_lost {
            self.asked_at.remove(&id);
            self.say(Severity::Notice, format!("{name} is heard again"));
        }
        if is_new || was_lost {
            self.ask_for_telemetry(outbox);
        }
    }

    /// Asks every vehicle for what is shown of it, in the beginning and now and then.
    pub(super) fn ask_for_telemetry(&mut self, outbox: &mut Outbox) {
        let now = self.model.now;
        for vehicle in self.model.vehicles.values() {
            let due = self
                .asked_at
                .get(&vehicle.id)
                .is_none_or(|at| now.since(*at) >= ASK_EVERY);
            if !due || vehicle.presence(now) == Presence::Lost {
                continue;
            }
            self.asked_at.insert(vehicle.id, now);
            for (message, interval) in WANTED {
                outbox.push(Message::COMMAND_LONG(COMMAND_LONG_DATA {
                    command: cmd::SET_MESSAGE_INTERVAL,
                    target_system: vehicle.id.0,
                    target_component: 1,
                    param1: message as f32,
                    param2: interval.as_micros() as f32,
                    ..COMMAND_LONG_DATA::default()
                }));
            }
        }
    }

    /// Without a companion's origin, the first position of a vehicle is the origin of the map.
    fn stand_in_for_origin(&mut self, id: SystemId) {
        if self.model.map.origin.is_some() {
            return;
        }
        let fix = self.model.vehicles.get(&id).and_then(|vehicle| vehicle.fix);
        let Some(fix) = fix.filter(|fix| !has_no_home(&fix.value)) else {
            return;
        };
        let geodetic = Geodetic {
            alt_m: fix.value.geodetic.alt_m - fix.value.above_home_m,
            ..fix.value.geodetic
        };
        if let Ok(origin) = Origin::new(geodetic.lat_deg, geodetic.lon_deg, geodetic.alt_m) {
            self.say(
                Severity::Notice,
                format!(
                    "no companion tells the map's origin: the position of {} stands in",
                    self.model.name_of(id)
                ),
            );
            self.set_origin(MapOrigin {
                origin,
                geodetic,
                from: None,
                epoch: 0,
            });
        }
    }

    /// Puts every position onto the map anew.
    pub(super) fn set_origin(&mut self, origin: MapOrigin) {
        if let Some(before) = &self.model.map.origin {
            let there = origin.origin.to_world(before.geodetic).raw;
            if there.coords.xy().norm() > SAME_PLACE_M {
                self.drop_plans_of_old_origin();
            } else {
                self.lift_surveys(there.z);
            }
        }
        for vehicle in self.model.vehicles.values_mut() {
            for point in &mut vehicle.track {
                point.world = point
                    .geodetic
                    .map(|place| origin.origin.to_world(place))
                    .or(point.world);
            }
            if let Some(fix) = vehicle.fix {
                vehicle.position = Some(Timed::new(
                    origin.origin.to_world(fix.value.geodetic),
                    fix.at,
                ));
            }
        }
        self.model.map.origin = Some(origin);
    }

    fn hear_mission(&mut self, now: Stamp, id: SystemId, current: &MISSION_CURRENT_DATA) {
        let Some(vehicle) = self.model.vehicles.get_mut(&id) else {
            return;
        };
        let before = vehicle
            .mission
            .map(|mission| mission.value)
            .unwrap_or_default();
        let finished = current.mission_state == MissionState::MISSION_STATE_COMPLETE;
        vehicle.mission = Some(Timed::new(
            MissionProgress {
                current: current.seq,
                // 0 and 65535 say that it does not tell.
                total: Some(current.total)
                    .filter(|total| (1..u16::MAX).contains(total))
                    .or(before.total),
                reached: before.reached,
                complete: finished || (before.complete && !vehicle_restarted(current)),
            },
            now,
        ));
    }

    fn hear_reached(&mut self, now: Stamp, id: SystemId, seq: u16) {
        let plan = self
            .model
            .missions
            .get(&id)
            .filter(|mission| mission.is_verified());
        let last = plan
            .and_then(|mission| mission.plan())
            .and_then(|plan| last_reached(&plan.items));
        let Some(vehicle) = self.model.vehicles.get_mut(&id) else {
            return;
        };
        let mut progress = vehicle
            .mission
            .map(|mission| mission.value)
            .unwrap_or_default();
        progress.reached = Some(progress.reached.map_or(seq, |before| before.max(seq)));
        progress.complete |= last.is_some_and(|last| seq >= last);
        vehicle.mission = Some(Timed::new(progress, now));
    }

    /// Somebody says something; a long text comes in pieces.
    pub(super) fn hear_text(&mut self, now: Stamp, text: &Text) {
        let severity = Severity::from_number(text.severity as u8);
        let id = text.from.system;
        let words = text.words.trim().to_owned();
        if words.is_empty() {
            return;
        }
        if severity <= Severity::Warning {
            self.model.orders.hear(now, id, &words);
        }
        if let Some(vehicle) = self.model.vehicles.get_mut(&id)
            && (words.starts_with("PreArm") || words.starts_with("Arm"))
        {
            vehicle.not_ready.retain(|known| known.value != words);
            vehicle.not_ready.push_back(Timed::new(words.clone(), now));
            if vehicle.not_ready.len() > REASONS {
                vehicle.not_ready.pop_front();
            }
        }
        self.model.log.push(LogLine {
            at: now,
            from: Some(id),
            severity,
            text: words,
        });
    }
}

/// Whether the mission has begun anew, so that an earlier completion no longer counts.
fn vehicle_restarted(current: &MISSION_CURRENT_DATA) -> bool {
    matches!(
        current.mission_state,
        MissionState::MISSION_STATE_ACTIVE | MissionState::MISSION_STATE_NOT_STARTED
    )
}

/// Whether a vehicle has no home yet: its height above home is then that above mean sea level. Up to 5 m it does not matter.
fn has_no_home(fix: &Fix) -> bool {
    fix.above_home_m.abs() > 5.0 && (fix.above_home_m - fix.above_sea_m).abs() < 1.5e-3
}

fn hear_position(
    vehicle: &mut Vehicle,
    now: Stamp,
    position: &GLOBAL_POSITION_INT_DATA,
    origin: Option<&Origin>,
) {
    let Some([lat_deg, lon_deg, alt_m]) = convert::global_position(position) else {
        return;
    };
    let geodetic = Geodetic {
        lat_deg,
        lon_deg,
        alt_m: alt_m + vehicle.geoid_height_m,
    };
    let speed_mps = f64::from(position.vx).hypot(f64::from(position.vy)) / 100.0;
    let above_home_m = f64::from(position.relative_alt) / 1000.0;
    vehicle.fix = Some(Timed::new(
        Fix {
            geodetic,
            above_home_m,
            above_sea_m: alt_m,
            speed_mps,
        },
        now,
    ));
    let world = origin.map(|origin| origin.to_world(geodetic));
    if let Some(world) = world {
        vehicle.position = Some(Timed::new(world, now));
    }
    vehicle.extend_track(TrackPoint {
        geodetic: Some(geodetic),
        world,
    });
}

fn hear_system(vehicle: &mut Vehicle, now: Stamp, status: &SYS_STATUS_DATA) {
    let known = |value: u16| (value != u16::MAX).then_some(value);
    let battery = Battery {
        voltage_v: known(status.voltage_battery).map(|mv| f64::from(mv) / 1000.0),
        current_a: (status.current_battery >= 0).then(|| f64::from(status.current_battery) / 100.0),
        remaining_percent: u8::try_from(status.battery_remaining)
            .ok()
            .filter(|percent| *percent <= 100),
    };
    if battery.voltage_v.is_some() || battery.remaining_percent.is_some() {
        vehicle.battery = Some(Timed::new(battery, now));
    }
    let present = status.onboard_control_sensors_present.bits() & PREARM_CHECK != 0;
    if present {
        let healthy = status.onboard_control_sensors_health.bits() & PREARM_CHECK != 0;
        vehicle.ready = Some(Timed::new(healthy, now));
    }
}

fn hear_battery(vehicle: &mut Vehicle, now: Stamp, status: &BATTERY_STATUS_DATA) {
    if status.id != 0 {
        return;
    }
    let cells = status
        .voltages
        .iter()
        .filter(|mv| **mv != u16::MAX && **mv != 0);
    let sum_mv: u32 = cells.map(|mv| u32::from(*mv)).sum();
    let battery = Battery {
        voltage_v: (sum_mv > 0).then(|| f64::from(sum_mv) / 1000.0),
        current_a: (status.current_battery >= 0).then(|| f64::from(status.current_battery) / 100.0),
        remaining_percent: u8::try_from(status.battery_remaining)
            .ok()
            .filter(|percent| *percent <= 100),
    };
    if battery.voltage_v.is_some() || battery.remaining_percent.is_some() {
        vehicle.battery = Some(Timed::new(battery, now));
    }
}

fn hear_gps(vehicle: &mut Vehicle, now: Stamp, gps: &GPS_RAW_INT_DATA) {
    let satellites = (gps.satellites_visible != u8::MAX).then_some(gps.satellites_visible);
    vehicle.gps = Some(Timed::new(
        Gps {
            fix_type: gps.fix_type as u8,
            satellites,
        },
        now,
    ));
    let above_m = (f64::from(gps.alt_ellipsoid) - f64::from(gps.alt)) / 1000.0;
    // 0 is what a receiver without an ellipsoid sends; sea level is nowhere 150 m from it.
    if gps.alt_ellipsoid != 0 && above_m.abs() < 150.0 {
        vehicle.geoid_height_m = above_m;
    }
}

fn hear_landed(vehicle: &mut Vehicle, now: Stamp, state: &EXTENDED_SYS_STATE_DATA) {
    let landed = match state.landed_state {
        MavLandedState::MAV_LANDED_STATE_ON_GROUND => Landed::OnGround,
        MavLandedState::MAV_LANDED_STATE_IN_AIR => Landed::InAir,
        MavLandedState::MAV_LANDED_STATE_TAKEOFF => Landed::TakingOff,
        MavLandedState::MAV_LANDED_STATE_LANDING => Landed::Landing,
        MavLandedState::MAV_LANDED_STATE_UNDEFINED => return,
    };
    vehicle.landed = Some(Timed::new(landed, now));
}
