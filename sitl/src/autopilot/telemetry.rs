//! What it says about itself.

use maps::time::Stamp;
use mavlink_ext::Message;
use mavlink_ext::convert::{attitude_to_ned, deg_to_e7, to_frd, to_ned};
use mavlink_ext::dialect::tandem::{
    ATTITUDE_DATA, AUTOPILOT_VERSION_DATA, BATTERY_STATUS_DATA, EXTENDED_SYS_STATE_DATA,
    FENCE_STATUS_DATA, FLIGHT_INFORMATION_DATA, FenceBreach, FenceMitigate,
    GLOBAL_POSITION_INT_DATA, GPS_GLOBAL_ORIGIN_DATA, GPS_RAW_INT_DATA, GpsFixType, HEARTBEAT_DATA,
    HOME_POSITION_DATA, LOCAL_POSITION_NED_DATA, MISSION_CURRENT_DATA, MavAutopilot,
    MavBatteryChargeState, MavBatteryFunction, MavBatteryType, MavLandedState, MavModeFlag,
    MavProtocolCapability as Can, MavState, MavSysStatusSensor as Sensor, MavType, MavVtolState,
    MissionState, NAV_CONTROLLER_OUTPUT_DATA, SYS_STATUS_DATA, SYSTEM_TIME_DATA, VFR_HUD_DATA,
};

use super::arming::DILUTION;
use super::fence::Parts;
use super::guide::Goal;
use super::mode::{Kind, Mode};
use super::parameters::Parameter;
use super::power::Charge;
use super::streams::Stream;
use super::{Autopilot, execute};

/// 4.6.0, official, as `ArduPilot` codes its version.
const FIRMWARE_VERSION: u32 = 0x0406_00FF;

impl Autopilot {
    /// The message of a stream; `None` while there is nothing to say.
    pub(super) fn telemetry(&self, stream: Stream, now: Stamp) -> Option<Message> {
        Some(match stream {
            Stream::Attitude => self.attitude(now),
            Stream::GlobalPosition => self.global_position(now),
            Stream::LocalPosition => self.local_position(now),
            Stream::GpsRaw => self.gps_raw(now),
            Stream::Hud => self.hud(),
            Stream::SystemStatus => self.system_status(now),
            Stream::LandedState => self.landed_state(),
            Stream::Battery => self.battery_status(),
            Stream::MissionCurrent => self.mission_current(),
            Stream::SystemTime => Message::SYSTEM_TIME(SYSTEM_TIME_DATA {
                time_unix_usec: 0,
                time_boot_ms: boot_ms(now),
            }),
            Stream::Home => return self.home_position(),
            Stream::Navigation => self.navigation(),
            Stream::Fence => return self.fence_status(),
        })
    }

    pub(super) fn heartbeat(&self) -> Message {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
        base_mode |= match self.mode {
            Mode::Auto | Mode::Rtl | Mode::Land => MavModeFlag::MAV_MODE_FLAG_AUTO_ENABLED,
            Mode::Guided => MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED,
            Mode::Stabilize | Mode::Loiter | Mode::Brake | Mode::Manual | Mode::Hold => {
                MavModeFlag::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
            }
        };
        if self.armed {
            base_mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        }
        let system_status = match (self.failsafe_active(), self.armed) {
            (true, _) => MavState::MAV_STATE_CRITICAL,
            (false, true) => MavState::MAV_STATE_ACTIVE,
            (false, false) => MavState::MAV_STATE_STANDBY,
        };
        Message::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: self.mode.number(self.kind),
            mavtype: match self.kind {
                Kind::Copter => MavType::MAV_TYPE_QUADROTOR,
                Kind::Rover => MavType::MAV_TYPE_GROUND_ROVER,
            },
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode,
            system_status,
            mavlink_version: 3,
        })
    }

    fn attitude(&self, now: Stamp) -> Message {
        let turn = attitude_to_ned(self.estimate.world_from_body.rotation());
        let (roll, pitch, yaw) = turn.euler_angles();
        let [rollspeed, pitchspeed, yawspeed] = to_frd(self.estimate.rates).map(|rate| rate as f32);
        Message::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms: boot_ms(now),
            roll: roll as f32,
            pitch: pitch as f32,
            yaw: yaw as f32,
            rollspeed,
            pitchspeed,
            yawspeed,
        })
    }

    fn global_position(&self, now: Stamp) -> Message {
        let place = self.origin.to_geodetic(self.estimate.position());
        let [vx, vy, vz] = to_ned(self.estimate.velocity).map(|v| (v * 100.0).round() as i16);
        Message::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms: boot_ms(now),
            lat: deg_to_e7(place.lat_deg),
            lon: deg_to_e7(place.lon_deg),
            alt: millimetres(place.alt_m),
            relative_alt: millimetres(self.height()),
            vx,
            vy,
            vz,
            hdg: (self.compass_deg() * 100.0).round() as u16 % 36_000,
        })
    }

    fn local_position(&self, now: Stamp) -> Message {
        let [x, y, z] =
            to_ned(self.estimate.position() - maps::frame::Point::origin()).map(|v| v as f32);
        let [vx, vy, vz] = to_ned(self.estimate.velocity).map(|v| v as f32);
        Message::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms: boot_ms(now),
            x,
            y,
            z,
            vx,
            vy,
            vz,
        })
    }

    fn gps_raw(&self, now: Stamp) -> Message {
        let place = self.origin.to_geodetic(self.estimate.position());
        let quality = self.gnss.quality;
        let fix = self.has_fix(now);
        Message::GPS_RAW_INT(GPS_RAW_INT_DATA {
            time_usec: now.as_nanos() / 1000,
            lat: deg_to_e7(place.lat_deg),
            lon: deg_to_e7(place.lon_deg),
            alt: millimetres(place.alt_m),
            eph: if fix { DILUTION } else { u16::MAX },
            epv: if fix { 90 } else { u16::MAX },
            vel: (self.ground_speed() * 100.0).round() as u16,
            cog: u16::MAX,
            fix_type: if fix {
                GpsFixType::GPS_FIX_TYPE_RTK_FIXED
            } else {
                GpsFixType::GPS_FIX_TYPE_NO_FIX
            },
            satellites_visible: if fix { 18 } else { 0 },
            alt_ellipsoid: millimetres(place.alt_m),
            h_acc: (quality.horizontal_m * 1000.0) as u32,
            v_acc: (quality.vertical_m * 1000.0) as u32,
            ..GPS_RAW_INT_DATA::default()
        })
    }

    fn hud(&self) -> Message {
        let place = self.origin.to_geodetic(self.estimate.position());
        let speed = self.ground_speed() as f32;
        Message::VFR_HUD(VFR_HUD_DATA {
            airspeed: speed,
            groundspeed: speed,
            alt: place.alt_m as f32,
            climb: self.estimate.velocity.raw.z as f32,
            heading: self.compass_deg().round() as i16 % 360,
            throttle: u16::from(self.armed && !self.on_ground()) * 50,
        })
    }

    /// Sensors that it has and that work; the bit of the checks before arming tells whether it can be armed.
    fn system_status(&self, now: Stamp) -> Message {
        let mut present = Sensor::MAV_SYS_STATUS_SENSOR_3D_GYRO
            | Sensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL
            | Sensor::MAV_SYS_STATUS_SENSOR_3D_MAG
            | Sensor::MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
            | Sensor::MAV_SYS_STATUS_SENSOR_GPS
            | Sensor::MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL
            | Sensor::MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
            | Sensor::MAV_SYS_STATUS_SENSOR_YAW_POSITION
            | Sensor::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
            | Sensor::MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
            | Sensor::MAV_SYS_STATUS_AHRS
            | Sensor::MAV_SYS_STATUS_SENSOR_BATTERY
            | Sensor::MAV_SYS_STATUS_PREARM_CHECK;
        let mut enabled = present;
        let settings = self.fence_settings();
        let fenced = !self.fence.present(&settings).is_empty();
        if fenced {
            present |= Sensor::MAV_SYS_STATUS_GEOFENCE;
        }
        if fenced && self.fence.is_on() && self.parameters.bits(Parameter::FenceAction) != 0 {
            enabled |= Sensor::MAV_SYS_STATUS_GEOFENCE;
        }
        if self.parameters.bits(Parameter::ArmingCheck) == 0 {
            enabled -= Sensor::MAV_SYS_STATUS_PREARM_CHECK;
        }
        // A vehicle without a fence is within it, as on ArduPilot.
        let mut health = present | Sensor::MAV_SYS_STATUS_GEOFENCE;
        if fenced && !self.fence.breached().is_empty() {
            health -= Sensor::MAV_SYS_STATUS_GEOFENCE;
        }
        if self.failsafe.battery.noticed() > Charge::Enough {
            health -= Sensor::MAV_SYS_STATUS_SENSOR_BATTERY;
        }
        if !self.has_fix(now) {
            health -= Sensor::MAV_SYS_STATUS_SENSOR_GPS | Sensor::MAV_SYS_STATUS_AHRS;
        }
        if !self.prearm_failures(now).is_empty() {
            health -= Sensor::MAV_SYS_STATUS_PREARM_CHECK;
        }
        Message::SYS_STATUS(SYS_STATUS_DATA {
            onboard_control_sensors_present: present,
            onboard_control_sensors_enabled: enabled,
            onboard_control_sensors_health: health,
            load: 100,
            voltage_battery: (self.battery_reading().voltage_v * 1000.0) as u16,
            current_battery: (self.battery.current_a() * 100.0) as i16,
            battery_remaining: (self.battery.share() * 100.0).round() as i8,
            ..SYS_STATUS_DATA::default()
        })
    }

    fn battery_status(&self) -> Message {
        let mut voltages = [u16::MAX; 10];
        voltages[0] = (self.battery_reading().voltage_v * 1000.0) as u16;
        Message::BATTERY_STATUS(BATTERY_STATUS_DATA {
            current_consumed: self.battery.used_mah() as i32,
            energy_consumed: -1,
            temperature: i16::MAX,
            voltages,
            current_battery: (self.battery.current_a() * 100.0) as i16,
            battery_function: MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL,
            mavtype: MavBatteryType::MAV_BATTERY_TYPE_LIPO,
            battery_remaining: (self.battery.share() * 100.0).round() as i8,
            charge_state: match self.failsafe.battery.noticed() {
                Charge::Enough => MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_OK,
                Charge::Low => MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_LOW,
                Charge::Critical => MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_CRITICAL,
            },
            ..BATTERY_STATUS_DATA::default()
        })
    }

    /// Only while a fence is on.
    pub(super) fn fence_status(&self) -> Option<Message> {
        let breached = self.fence.breached();
        let (count, at) = self.fence.history();
        let level = Parts::CIRCLE.with(Parts::ZONES);
        let breach_type = if breached.has(level) {
            FenceBreach::FENCE_BREACH_BOUNDARY
        } else if breached.has(Parts::CEILING) {
            FenceBreach::FENCE_BREACH_MAXALT
        } else {
            FenceBreach::FENCE_BREACH_NONE
        };
        self.fence.is_on().then(|| {
            Message::FENCE_STATUS(FENCE_STATUS_DATA {
                breach_time: boot_ms(at),
                breach_count: count,
                breach_status: u8::from(!breached.is_empty()),
                breach_type,
                breach_mitigation: FenceMitigate::FENCE_MITIGATE_UNKNOWN,
            })
        })
    }

    fn landed_state(&self) -> Message {
        let landed_state = match (self.on_ground(), &self.goal) {
            (true, _) => MavLandedState::MAV_LANDED_STATE_ON_GROUND,
            (false, Goal::TakeOff(to)) if to.raw.z - self.estimate.position().raw.z > 0.3 => {
                MavLandedState::MAV_LANDED_STATE_TAKEOFF
            }
            (false, Goal::Land(_)) => MavLandedState::MAV_LANDED_STATE_LANDING,
            (false, _) => MavLandedState::MAV_LANDED_STATE_IN_AIR,
        };
        Message::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
            vtol_state: MavVtolState::MAV_VTOL_STATE_UNDEFINED,
            landed_state,
        })
    }

    pub(super) fn mission_current(&self) -> Message {
        let total = self.mission_items().len();
        let execution = self.execution();
        let running = self.mode == Mode::Auto && self.armed;
        let mission_state = match (total, execution.state()) {
            (0, _) => MissionState::MISSION_STATE_NO_MISSION,
            (_, execute::State::NotStarted) => MissionState::MISSION_STATE_NOT_STARTED,
            (_, execute::State::Running) if running => MissionState::MISSION_STATE_ACTIVE,
            (_, execute::State::Running) => MissionState::MISSION_STATE_PAUSED,
            (_, execute::State::Complete) => MissionState::MISSION_STATE_COMPLETE,
        };
        Message::MISSION_CURRENT(MISSION_CURRENT_DATA {
            seq: execution.current().min(total.saturating_sub(1)) as u16,
            // Home, the first item, does not count.
            total: total.saturating_sub(1) as u16,
            mission_state,
            mission_mode: if self.mode == Mode::Auto { 1 } else { 2 },
            mission_id: self.mission.mission_id(),
            ..MISSION_CURRENT_DATA::default()
        })
    }

    pub(super) fn home_position(&self) -> Option<Message> {
        let home = self.home?;
        let place = self.origin.to_geodetic(home);
        let [x, y, z] = to_ned(home - maps::frame::Point::origin()).map(|v| v as f32);
        Some(Message::HOME_POSITION(HOME_POSITION_DATA {
            latitude: deg_to_e7(place.lat_deg),
            longitude: deg_to_e7(place.lon_deg),
            altitude: millimetres(place.alt_m),
            x,
            y,
            z,
            q: [1.0, 0.0, 0.0, 0.0],
            ..HOME_POSITION_DATA::default()
        }))
    }

    fn navigation(&self) -> Message {
        let here = self.estimate.position();
        let (distance, bearing) = match &self.goal {
            Goal::Hover(to) | Goal::TakeOff(to) | Goal::Land(to) => {
                let way = (*to - here).raw.xy();
                (way.norm(), way.y.atan2(way.x))
            }
            Goal::Drive { line, .. } => line.next_waypoint(here).unwrap_or_default(),
            Goal::Stay => (0.0, self.estimate.heading_rad()),
        };
        let bearing = compass(bearing).round() as i16;
        Message::NAV_CONTROLLER_OUTPUT(NAV_CONTROLLER_OUTPUT_DATA {
            wp_dist: distance.round().min(65_535.0) as u16,
            nav_bearing: bearing,
            target_bearing: bearing,
            ..NAV_CONTROLLER_OUTPUT_DATA::default()
        })
    }

    pub(super) fn global_origin(&self, now: Stamp) -> Message {
        let place = self.origin.place();
        Message::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
            latitude: deg_to_e7(place.lat_deg),
            longitude: deg_to_e7(place.lon_deg),
            altitude: millimetres(place.alt_m),
            time_usec: now.as_nanos() / 1000,
        })
    }

    pub(super) fn autopilot_version(&self) -> Message {
        let system = self.address.system.0;
        Message::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
            capabilities: Can::MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
                | Can::MAV_PROTOCOL_CAPABILITY_MISSION_INT
                | Can::MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
                | Can::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
                | Can::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
                | Can::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
                | Can::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
                | Can::MAV_PROTOCOL_CAPABILITY_FTP
                | Can::MAV_PROTOCOL_CAPABILITY_MAVLINK2,
            uid: u64::from(system),
            flight_sw_version: FIRMWARE_VERSION,
            flight_custom_version: *b"tandem\0\0",
            ..AUTOPILOT_VERSION_DATA::default()
        })
    }

    fn ground_speed(&self) -> f64 {
        self.estimate.velocity.raw.xy().norm()
    }

    fn compass_deg(&self) -> f64 {
        compass(self.estimate.heading_rad())
    }

    /// What is left of the battery, 0 to 1.
    pub fn battery_share(&self) -> f64 {
        self.battery.share()
    }

    /// Whether a failsafe has struck and its cause still lasts.
    pub fn failsafe_active(&self) -> bool {
        self.failsafe.is_active(self.kind)
    }

    /// A parameter's value.
    pub fn parameter(&self, parameter: Parameter) -> f64 {
        self.parameters.get(parameter)
    }
}

pub(super) fn flight_information(now: Stamp) -> Message {
    Message::FLIGHT_INFORMATION(FLIGHT_INFORMATION_DATA {
        time_boot_ms: boot_ms(now),
        ..FLIGHT_INFORMATION_DATA::default()
    })
}

/// Clockwise from north in degrees, 0..360, of an angle counter-clockwise from east.
fn compass(heading_rad: f64) -> f64 {
    (90.0 - heading_rad.to_degrees()).rem_euclid(360.0)
}

fn boot_ms(now: Stamp) -> u32 {
    (now.as_nanos() / 1_000_000) as u32
}

fn millimetres(metres: f64) -> i32 {
    (metres * 1000.0).round() as i32
}
