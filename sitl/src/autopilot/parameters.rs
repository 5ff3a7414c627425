//! Parameters: named numbers that a ground station reads and sets, each of which changes how the vehicle behaves.
//!
//! As on `ArduPilot`, every value travels as a float whatever its type says (`MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST`),
//! and names, units and types are `ArduPilot`'s where it has such a parameter: clients insist on the type.

use mavlink_ext::Message;
use mavlink_ext::dialect::char_array;
use mavlink_ext::dialect::tandem::{MavParamType, PARAM_VALUE_DATA};

use super::mode::Kind;

const INT8: MavParamType = MavParamType::MAV_PARAM_TYPE_INT8;
const INT16: MavParamType = MavParamType::MAV_PARAM_TYPE_INT16;
const INT32: MavParamType = MavParamType::MAV_PARAM_TYPE_INT32;
const REAL: MavParamType = MavParamType::MAV_PARAM_TYPE_REAL32;

macro_rules! parameters {
    ($($(#[$doc:meta])* $variant:ident = $name:literal, $stored:ident, $kind:expr, $default:literal, $low:literal..=$high:literal;)*) => {
        /// The parameters.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Parameter {
            $($(#[$doc])* $variant,)*
        }

        const TABLE: &[Row] = &[$(Row {
            parameter: Parameter::$variant,
            name: $name,
            stored: $stored,
            kind: $kind,
            default: $default,
            range: ($low, $high),
        },)*];
    };
}

#[derive(Debug)]
struct Row {
    parameter: Parameter,
    name: &'static str,
    stored: MavParamType,
    /// Only this kind of vehicle has it.
    kind: Option<Kind>,
    default: f32,
    range: (f32, f32),
}

parameters! {
    /// Largest tilt of a copter, in hundredths of a degree.
    AngleMax = "ANGLE_MAX", INT16, Some(Kind::Copter), 3000.0, 0.0..=9000.0;
    /// Which checks arming waits for: 1 all, 0 those alone that cannot be done without, else a sum of `ArduPilot`'s bits, of which
    /// 8 (positions), 32 (parameters), 128 and 256 (battery) and 16384 (mission) count here.
    ArmingCheck = "ARMING_CHECK", INT32, None, 1.0, 0.0..=1_048_575.0;
    /// Which items a mission must have before arming: 1 a landing, 8 a take-off, 64 a return, or a sum of them.
    ArmingItems = "ARMING_MIS_ITEMS", INT32, None, 0.0, 0.0..=127.0;
    /// Steady gain of speed of a rover, m/s².
    Acceleration = "ATC_ACCEL_MAX", REAL, Some(Kind::Rover), 0.6, 0.1..=5.0;
    /// Loss of speed of a rover, m/s².
    Braking = "ATC_DECEL_MAX", REAL, Some(Kind::Rover), 0.5, 0.1..=5.0;
    /// 1: a copter may be armed in AUTO.
    AutoOptions = "AUTO_OPTIONS", INT32, Some(Kind::Copter), 0.0, 0.0..=1.0;
    /// Charge that it takes to arm, mAh; 0 any.
    BatteryToArm = "BATT_ARM_MAH", INT32, None, 0.0, 0.0..=100_000.0;
    /// Voltage that it takes to arm, V; 0 any.
    BatteryToArmVolt = "BATT_ARM_VOLT", REAL, None, 0.0, 0.0..=120.0;
    /// Charge of a full battery, mAh.
    BatteryCapacity = "BATT_CAPACITY", INT32, None, 5200.0, 100.0..=100_000.0;
    /// Charge below which the battery is critical, mAh; 0 never.
    BatteryCritical = "BATT_CRT_MAH", REAL, None, 0.0, 0.0..=100_000.0;
    /// Voltage below which the battery is critical, V; 0 never.
    BatteryCriticalVolt = "BATT_CRT_VOLT", REAL, None, 0.0, 0.0..=120.0;
    /// What a critical battery does: as `BATT_FS_LOW_ACT`.
    BatteryCriticalAction = "BATT_FS_CRT_ACT", INT8, None, 0.0, 0.0..=7.0;
    /// What a low battery does: 0 warns. Copter: 1 lands, 2 to 4 and 6 return or land, 5 stops the motors, 7 brakes. Rover: 1 and 3
    /// return, 2 and 4 hold, 5 disarms.
    BatteryAction = "BATT_FS_LOW_ACT", INT8, None, 0.0, 0.0..=7.0;
    /// Charge below which the battery is low, mAh; 0 never. Below it a vehicle does not arm.
    BatteryLow = "BATT_LOW_MAH", REAL, None, 700.0, 0.0..=100_000.0;
    /// How long a voltage has to be too low before it counts, s; 0: voltages never count.
    BatteryTimer = "BATT_LOW_TIMER", INT8, None, 10.0, 0.0..=120.0;
    /// Voltage below which the battery is low, V; 0 never. Below it a vehicle does not arm.
    BatteryLowVolt = "BATT_LOW_VOLT", REAL, None, 10.5, 0.0..=120.0;
    /// Speed of a rover where nothing else is said, m/s.
    CruiseSpeed = "CRUISE_SPEED", REAL, Some(Kind::Rover), 0.5, 0.05..=1.5;
    /// A copter disarms this long after it stands on the ground without wanting to fly, s; 0 never.
    DisarmDelay = "DISARM_DELAY", INT8, Some(Kind::Copter), 10.0, 0.0..=127.0;
    /// What a breach of the fence does: 0 tells. Copter: 1 and 3 return, 2 and 5 land, 4 brakes. Rover: 1 and 3 return, 2 and 4 hold,
    /// 5 disarms.
    FenceAction = "FENCE_ACTION", INT8, None, 1.0, 0.0..=5.0;
    /// Height above home that a copter has to stay below, m.
    FenceCeiling = "FENCE_ALT_MAX", REAL, Some(Kind::Copter), 100.0, -1.0..=1000.0;
    /// 1: the fence is on.
    FenceEnable = "FENCE_ENABLE", INT8, None, 0.0, 0.0..=1.0;
    /// Distance that a return keeps from the ceiling, m.
    FenceMargin = "FENCE_MARGIN", REAL, None, 2.0, -1.0..=100.0;
    /// Distance from home to stay within, m.
    FenceRadius = "FENCE_RADIUS", REAL, None, 300.0, -1.0..=10_000.0;
    /// What a copter's fence consists of: a sum of 1 (ceiling), 2 (circle about home), 4 (uploaded polygons and circles).
    CopterFenceType = "FENCE_TYPE", INT8, Some(Kind::Copter), 7.0, 0.0..=7.0;
    /// What a rover's fence consists of: as a copter's, without a ceiling.
    RoverFenceType = "FENCE_TYPE", INT8, Some(Kind::Rover), 6.0, 0.0..=6.0;
    /// What a rover does when the ground station is silent: 0 tells, 1 and 3 return, 2 and 4 hold, 5 disarms.
    RoverFailsafeAction = "FS_ACTION", INT8, Some(Kind::Rover), 2.0, 0.0..=5.0;
    /// What silence of the ground station does: 0 nothing. Copter: 1 to 4 and 6 return or land, 5 lands, 7 brakes. Rover: 1 does as
    /// `FS_ACTION` says, 2 too, but not in AUTO.
    GroundStationAction = "FS_GCS_ENABLE", INT8, None, 0.0, 0.0..=7.0;
    /// How long the ground station may be silent, s.
    GroundStationTimeout = "FS_GCS_TIMEOUT", REAL, None, 5.0, 2.0..=120.0;
    /// In what a copter goes on although the ground station is silent: a sum of 2 (AUTO), 8 (landing, also with a low battery), 16
    /// (modes that a pilot steers).
    CopterFailsafeOptions = "FS_OPTIONS", INT32, Some(Kind::Copter), 16.0, 0.0..=31.0;
    /// 1: a rover that holds does as `FS_ACTION` says, too.
    RoverFailsafeOptions = "FS_OPTIONS", INT32, Some(Kind::Rover), 0.0, 0.0..=1.0;
    /// How long a rover waits after it has noticed the silence, s.
    RoverFailsafeTimeout = "FS_TIMEOUT", REAL, Some(Kind::Rover), 1.5, 1.0..=100.0;
    /// Dilution of precision above which a copter does not arm where it needs a position, in hundredths.
    DilutionGood = "GPS_HDOP_GOOD", INT16, Some(Kind::Copter), 140.0, 10.0..=900.0;
    /// How fast a copter comes down to land, cm/s.
    LandSpeed = "LAND_SPEED", INT16, Some(Kind::Copter), 40.0, 20.0..=200.0;
    /// How far ahead on its path a rover steers, m.
    LookAhead = "PP_LOOKAHEAD", REAL, Some(Kind::Rover), 0.3, 0.1..=5.0;
    /// Height above home at which a copter returns, cm; it never descends to return.
    ReturnHeight = "RTL_ALT", INT32, Some(Kind::Copter), 200.0, 50.0..=30_000.0;
    /// What the battery monitor reads, V; 0: what the battery gives.
    BatteryVoltage = "SIM_BATT_VOLTAGE", REAL, None, 0.0, 0.0..=120.0;
    /// 1: the receiver has no fix, a test of what depends on one.
    GpsDisable = "SIM_GPS_DISABLE", INT8, None, 0.0, 0.0..=1.0;
    /// Where the wind comes from, degrees from north.
    WindDirection = "SIM_WIND_DIR", REAL, Some(Kind::Copter), 270.0, 0.0..=360.0;
    /// Mean wind, m/s.
    WindSpeed = "SIM_WIND_SPD", REAL, Some(Kind::Copter), 0.5, 0.0..=20.0;
    /// Standard deviation of the gusts along each axis, m/s.
    WindGusts = "SIM_WIND_TURB", REAL, Some(Kind::Copter), 0.2, 0.0..=10.0;
    /// Rate of `ATTITUDE` where nobody has asked for another, Hz.
    AttitudeRate = "SR0_EXTRA1", INT16, None, 10.0, 0.0..=50.0;
    /// Rate of `VFR_HUD`, Hz.
    HudRate = "SR0_EXTRA2", INT16, None, 4.0, 0.0..=50.0;
    /// Rate of battery and time, Hz.
    SlowRate = "SR0_EXTRA3", INT16, None, 1.0, 0.0..=50.0;
    /// Rate of status, fix and mission progress, Hz.
    StatusRate = "SR0_EXT_STAT", INT16, None, 2.0, 0.0..=50.0;
    /// Rate of positions, Hz.
    PositionRate = "SR0_POSITION", INT16, None, 5.0, 0.0..=50.0;
    /// Tightest turn that a rover is steered to, m; its chassis may allow less.
    TurnRadius = "TURN_RADIUS", REAL, Some(Kind::Rover), 0.45, 0.45..=10.0;
    /// How near a waypoint a copter has to come, cm.
    CopterWaypointRadius = "WPNAV_RADIUS", REAL, Some(Kind::Copter), 20.0, 5.0..=1000.0;
    /// Speed of a copter between waypoints, cm/s.
    CopterSpeed = "WPNAV_SPEED", REAL, Some(Kind::Copter), 100.0, 10.0..=1000.0;
    /// How fast it comes down between waypoints, cm/s.
    CopterSpeedDown = "WPNAV_SPEED_DN", REAL, Some(Kind::Copter), 80.0, 10.0..=300.0;
    /// How fast it climbs, cm/s.
    CopterSpeedUp = "WPNAV_SPEED_UP", REAL, Some(Kind::Copter), 100.0, 10.0..=300.0;
    /// How near a waypoint in the middle of its path a rover has to come, m.
    RoverWaypointRadius = "WP_RADIUS", REAL, Some(Kind::Rover), 0.1, 0.02..=10.0;
}

/// The parameters of one vehicle.
#[derive(Clone, Debug)]
pub struct Parameters {
    rows: Vec<(&'static Row, f32)>,
    /// The next one to be sent of a list that was asked for.
    listing: Option<usize>,
}

impl Parameters {
    /// All of that kind of vehicle, at their defaults, in alphabetical order.
    pub fn new(kind: Kind) -> Self {
        let rows = TABLE
            .iter()
            .filter(|row| row.kind.is_none_or(|only| only == kind));
        let mut rows: Vec<_> = rows.map(|row| (row, row.default)).collect();
        rows.sort_by_key(|(row, _)| row.name);
        Self {
            rows,
            listing: None,
        }
    }

    /// A value; the default of a parameter that this kind of vehicle does not have.
    pub fn get(&self, parameter: Parameter) -> f64 {
        let here = self.rows.iter().find(|(row, _)| row.parameter == parameter);
        let value = here.map_or_else(
            || {
                TABLE
                    .iter()
                    .find(|row| row.parameter == parameter)
                    .map_or(0.0, |row| row.default)
            },
            |&(_, value)| value,
        );
        f64::from(value)
    }

    /// A sum of bits.
    pub fn bits(&self, parameter: Parameter) -> u32 {
        self.get(parameter) as u32
    }

    /// Whether a parameter that is a switch is on.
    pub fn is_on(&self, parameter: Parameter) -> bool {
        self.get(parameter) > 0.5
    }

    /// Sets a value, within its range; returns where it is in the list, `None` without such a parameter. What is not a
    /// number changes nothing, and integers lose their fraction.
    pub fn set(&mut self, name: &str, value: f32) -> Option<usize> {
        let index = self.rows.iter().position(|(row, _)| row.name == name)?;
        let (row, current) = &mut self.rows[index];
        if value.is_finite() {
            let within = value.clamp(row.range.0, row.range.1);
            *current = if row.stored == REAL {
                within
            } else {
                (within + 0.01_f32.copysign(within)).trunc() // As ArduPilot: 1.99 is a 2 that lost a little on its way.
            };
        }
        Some(index)
    }

    /// All of them, as they are now.
    pub fn all(&self) -> Vec<mavlink_ext::params::Parameter> {
        let told = |(row, value): &(&Row, f32)| mavlink_ext::params::Parameter {
            name: row.name.to_owned(),
            value: f64::from(*value),
            kind: row.stored,
        };
        self.rows.iter().map(told).collect()
    }

    /// Where a parameter is in the list.
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.rows.iter().position(|(row, _)| row.name == name)
    }

    /// Starts to send all of them, some at each [`Self::next_listed`].
    pub fn list(&mut self) {
        self.listing = Some(0);
    }

    /// The next messages of the list that was asked for.
    pub fn next_listed(&mut self, count: usize) -> Vec<Message> {
        let Some(from) = self.listing else {
            return Vec::new();
        };
        let to = (from + count).min(self.rows.len());
        self.listing = (to < self.rows.len()).then_some(to);
        (from..to).filter_map(|index| self.message(index)).collect()
    }

    /// `PARAM_VALUE` of that one.
    pub fn message(&self, index: usize) -> Option<Message> {
        let (row, value) = self.rows.get(index)?;
        Some(Message::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: *value,
            param_count: self.rows.len() as u16,
            param_index: index as u16,
            param_id: char_array(row.name),
            param_type: row.stored,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_has_every_parameter_once_and_then_ends() {
        let mut parameters = Parameters::new(Kind::Rover);
        parameters.list();
        let mut names = Vec::new();
        loop {
            let messages = parameters.next_listed(4);
            if messages.is_empty() {
                break;
            }
            for message in messages {
                let Message::PARAM_VALUE(value) = message else {
                    panic!("{message:?}");
                };
                assert_eq!(usize::from(value.param_index), names.len());
                names.push(value.param_id.to_str().unwrap_or_default().to_owned());
            }
        }
        assert_eq!(names.len(), parameters.rows.len());
        assert!(names.is_sorted() && names.contains(&"WP_RADIUS".to_owned()));
        assert!(!names.contains(&"WPNAV_SPEED".to_owned()), "a copter's");
        assert!(
            names.iter().all(|name| name.len() <= 16),
            "longer names do not fit the wire"
        );
    }

    #[test]
    fn values_stay_within_their_range_and_nonsense_changes_nothing() {
        let mut parameters = Parameters::new(Kind::Rover);
        assert!(parameters.set("WP_RADIUS", 99.0).is_some());
        assert!((parameters.get(Parameter::RoverWaypointRadius) - 10.0).abs() < 1e-9);
        assert!(parameters.set("WP_RADIUS", f32::NAN).is_some());
        assert!((parameters.get(Parameter::RoverWaypointRadius) - 10.0).abs() < 1e-9);
        assert_eq!(parameters.set("NO_SUCH", 1.0), None);
    }

    #[test]
    fn integers_stay_integers() {
        let mut parameters = Parameters::new(Kind::Copter);
        for (asked, kept) in [(1.0, 1.0), (1.5, 1.0), (1.995, 2.0), (0.2, 0.0)] {
            let index = parameters.set("FS_GCS_ENABLE", asked).expect("it has one");
            assert!((parameters.get(Parameter::GroundStationAction) - kept).abs() < 1e-9);
            let Some(Message::PARAM_VALUE(told)) = parameters.message(index) else {
                panic!("parameter {index} has no message");
            };
            assert_eq!(told.param_type, MavParamType::MAV_PARAM_TYPE_INT8);
            assert_eq!(parameters.all()[index].kind, told.param_type);
        }
    }
}
