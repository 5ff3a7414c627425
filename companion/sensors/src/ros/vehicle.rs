//! What a vehicle's sensors say, where it is and how it moves.
//!
//! Frames follow REP-103 and REP-105: bodies have x forward, y left and z up; the world x east, y north and z up.

use maps::time::Stamp;
use nalgebra::{Isometry3, Vector3};

use super::{
    CdrError, Reader, Schema, Writer, read_header, read_pose, read_time, write_header, write_pose,
    write_time,
};

/// Angular velocity and specific force.
pub const IMU: Schema = Schema {
    name: "sensor_msgs/msg/Imu",
    text: concat!(
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n",
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n",
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
        header!(),
        quaternion!(),
        vector3!()
    ),
};

/// A place on Earth.
pub const NAV_SAT_FIX: Schema = Schema {
    name: "sensor_msgs/msg/NavSatFix",
    text: concat!(
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n",
        "float64 altitude\nfloat64[9] position_covariance\nuint8 position_covariance_type\n",
        header!(),
        dependencies!("sensor_msgs/NavSatStatus": "int8 status\nuint16 service\n")
    ),
};

/// The pressure of air.
pub const FLUID_PRESSURE: Schema = Schema {
    name: "sensor_msgs/msg/FluidPressure",
    text: concat!(
        "std_msgs/Header header\nfloat64 fluid_pressure\nfloat64 variance\n",
        header!()
    ),
};

/// One distance.
pub const RANGE: Schema = Schema {
    name: "sensor_msgs/msg/Range",
    text: concat!(
        "std_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\nfloat32 max_range\n",
        "float32 range\nfloat32 variance\n",
        header!()
    ),
};

/// How far wheels have turned.
pub const JOINT_STATE: Schema = Schema {
    name: "sensor_msgs/msg/JointState",
    text: concat!(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        header!()
    ),
};

/// What another clock showed.
pub const TIME_REFERENCE: Schema = Schema {
    name: "sensor_msgs/msg/TimeReference",
    text: concat!(
        "std_msgs/Header header\nbuiltin_interfaces/Time time_ref\nstring source\n",
        header!()
    ),
};

/// A pose and a velocity.
pub const ODOMETRY: Schema = Schema {
    name: "nav_msgs/msg/Odometry",
    text: concat!(
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n",
        "geometry_msgs/TwistWithCovariance twist\n",
        header!(),
        dependencies!(
            "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance\n"
        ),
        pose!(),
        dependencies!(
            "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
            "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"
        ),
        vector3!()
    ),
};

/// Where frames are in one another.
pub const TF: Schema = Schema {
    name: "tf2_msgs/msg/TFMessage",
    text: concat!(
        "geometry_msgs/TransformStamped[] transforms\n",
        dependencies!(
            "geometry_msgs/TransformStamped":
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
        ),
        header!(),
        dependencies!(
            "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
        ),
        vector3!(),
        quaternion!()
    ),
};

/// `sensor_msgs/msg/Imu` of a unit that knows no orientation.
#[derive(Clone, Debug, PartialEq)]
pub struct Imu<'a> {
    /// When it was measured.
    pub at: Stamp,
    /// The unit, as `tf2` knows it.
    pub frame_id: &'a str,
    /// Angular velocity in rad/s.
    pub rates: Vector3<f64>,
    /// Variance of each of its axes, in rad²/s².
    pub rates_variance: f64,
    /// Specific force in m/s²: at rest, gravity upwards.
    pub specific_force: Vector3<f64>,
    /// Variance of each of its axes, in m²/s⁴.
    pub specific_force_variance: f64,
}

impl<'a> Imu<'a> {
    /// Reads a message; of the variances the first axis'.
    pub fn decode(message: &'a [u8]) -> Result<Self, CdrError> {
        let mut reader = Reader::new(message)?;
        let (at, frame_id) = read_header(&mut reader)?;
        let _orientation = (reader.f64s::<4>()?, reader.f64s::<9>()?);
        let (rates, rates_covariance) = (reader.f64s::<3>()?, reader.f64s::<9>()?);
        let (force, force_covariance) = (reader.f64s::<3>()?, reader.f64s::<9>()?);
        Ok(Self {
            at,
            frame_id,
            rates: rates.into(),
            rates_variance: rates_covariance[0],
            specific_force: force.into(),
            specific_force_variance: force_covariance[0],
        })
    }

    /// The message in CDR.
    pub fn encode(&self) -> Vec<u8> {
        let mut writer = Writer::new();
        write_header(&mut writer, self.at, self.frame_id);
        writer.f64s([0.0, 0.0, 0.0, 1.0]);
        // REP-145 and the message's own comment: -1 where the quantity is not known.
        let mut unknown = [0.0; 9];
        unknown[0] = -1.0;
        writer.f64s(unknown);
        writer.f64s(self.rates.into());
        writer.f64s(diagonal::<9, 3>([self.rates_variance; 3]));
        writer.f64s(self.specific_force.into());
        writer.f64s(diagonal::<9, 3>([self.specific_force_variance; 3]));
        writer.finish()
    }
}

/// `sensor_msgs/msg/NavSatFix`.
#[derive(Clone, Debug, PartialEq)]
pub struct NavSatFix<'a> {
    /// The moment that the fix is of.
    pub at: Stamp,
    /// The antenna, as `tf2` knows it.
    pub frame_id: &'a str,
    /// -1 without a fix, 0 with one, 2 with corrections from a base.
    pub status: i8,
    /// Degrees north; NaN without a fix.
    pub latitude_deg: f64,
    /// Degrees east; NaN without a fix.
    pub longitude_deg: f64,
    /// Metres above the ellipsoid; NaN without a fix.
    pub altitude_m: f64,
    /// Variances east, north and up in m².
    pub variances_m2: [f64; 3],
}

impl<'a> NavSatFix<'a> {
    /// Reads a message; of the covariance its diagonal.
    pub fn decode(message: &'a [u8]) -> Result<Self, CdrError> {
        let mut reader = Reader::new(message)?;
        let (at, frame_id) = read_header(&mut reader)?;
        let status = reader.i8()?;
        let _service = reader.u16()?;
        let [latitude_deg, longitude_deg, altitude_m] = reader.f64s::<3>()?;
        let covariance = reader.f64s::<9>()?;
        let _kind = reader.u8()?;
        Ok(Self {
            at,
            frame_id,
            status,
            latitude_deg,
            longitude_deg,
            altitude_m,
            variances_m2: [covariance[0], covariance[4], covariance[8]],
        })
    }

    /// The message in CDR.
    pub fn encode(&self) -> Vec<u8> {
        /// `SERVICE_GPS | SERVICE_GLONASS | SERVICE_GALILEO`.
        const SERVICES: u16 = 1 | 2 | 8;
        /// `COVARIANCE_TYPE_DIAGONAL_KNOWN`.
        const DIAGONAL: u8 = 2;
        let mut writer = Writer::new();
        write_header(&mut writer, self.at, self.frame_id);
        writer.i8(self.status);
        writer.u16(SERVICES);
        writer.f64s([self.latitude_deg, self.longitude_deg, self.altitude_m]);
        writer.f64s(diagonal::<9, 3>(self.variances_m2));
        writer.u8(DIAGONAL);
        writer.finish()
    }
}

/// `sensor_msgs/msg/FluidPressure` in CDR: a pressure in pascal and its variance.
pub fn encode_pressure(at: Stamp, frame_id: &str, pressure_pa: f64, variance_pa2: f64) -> Vec<u8> {
    let mut writer = Writer::new();
    write_header(&mut writer, at, frame_id);
    writer.f64s([pressure_pa, variance_pa2]);
    writer.finish()
}

/// What a rangefinder can do, for [`encode_range`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeLimits {
    /// How wide its beam is.
    pub field_of_view_rad: f32,
    /// The nearest that it measures.
    pub nearest_m: f32,
    /// The farthest.
    pub farthest_m: f32,
    /// Variance of a distance; 0 if it is not known.
    pub variance_m2: f32,
}

/// `sensor_msgs/msg/Range` of an optical rangefinder, in CDR; infinity where nothing is in reach (REP-117).
pub fn encode_range(
    at: Stamp,
    frame_id: &str,
    range_m: Option<f32>,
    limits: RangeLimits,
) -> Vec<u8> {
    const INFRARED: u8 = 1;
    let mut writer = Writer::new();
    write_header(&mut writer, at, frame_id);
    writer.u8(INFRARED);
    writer.f32(limits.field_of_view_rad);
    writer.f32(limits.nearest_m);
    writer.f32(limits.farthest_m);
    writer.f32(range_m.unwrap_or(f32::INFINITY));
    writer.f32(limits.variance_m2);
    writer.finish()
}

/// `sensor_msgs/msg/JointState` in CDR: joints with their names and angles in rad.
pub fn encode_joints(at: Stamp, joints: &[(&str, f64)]) -> Vec<u8> {
    let mut writer = Writer::new();
    write_header(&mut writer, at, "");
    writer.length(joints.len());
    for (name, _) in joints {
        writer.string(name);
    }
    let angles: Vec<f64> = joints.iter().map(|(_, angle)| *angle).collect();
    writer.f64_sequence(&angles);
    writer.f64_sequence(&[]);
    writer.f64_sequence(&[]);
    writer.finish()
}

/// `sensor_msgs/msg/TimeReference` in CDR: what the clock `source` showed `at` that time of the sender's.
pub fn encode_time_reference(at: Stamp, shown: Stamp, source: &str) -> Vec<u8> {
    let mut writer = Writer::new();
    write_header(&mut writer, at, "");
    write_time(&mut writer, shown);
    writer.string(source);
    writer.finish()
}

/// Reads `sensor_msgs/msg/TimeReference`: the sender's time and what the other clock showed.
pub fn decode_time_reference(message: &[u8]) -> Result<(Stamp, Stamp), CdrError> {
    let mut reader = Reader::new(message)?;
    let (at, _frame_id) = read_header(&mut reader)?;
    Ok((at, read_time(&mut reader)?))
}

/// `nav_msgs/msg/Odometry`, exactly known.
#[derive(Clone, Debug, PartialEq)]
pub struct Odometry<'a> {
    /// When it was there.
    pub at: Stamp,
    /// The frame in which the pose is.
    pub frame_id: &'a str,
    /// The frame whose pose it is, and in which velocities are.
    pub child_frame_id: &'a str,
    /// Where it is.
    pub pose: Isometry3<f64>,
    /// Velocity in m/s, in its own axes.
    pub velocity: Vector3<f64>,
    /// Angular velocity in rad/s, in its own axes.
    pub rates: Vector3<f64>,
}

impl<'a> Odometry<'a> {
    /// Reads a message; `None` if its pose is none (not finite, quaternion of length 0).
    pub fn decode(message: &'a [u8]) -> Result<Option<Self>, CdrError> {
        let mut reader = Reader::new(message)?;
        let (at, frame_id) = read_header(&mut reader)?;
        let child_frame_id = reader.string()?;
        let pose = read_pose(&mut reader)?;
        let _covariance = reader.f64s::<36>()?;
        let (velocity, rates) = (reader.f64s::<3>()?, reader.f64s::<3>()?);
        Ok(pose.map(|pose| Self {
            at,
            frame_id,
            child_frame_id,
            pose,
            velocity: velocity.into(),
            rates: rates.into(),
        }))
    }

    /// The message in CDR.
    pub fn encode(&self) -> Vec<u8> {
        let mut writer = Writer::new();
        write_header(&mut writer, self.at, self.frame_id);
        writer.string(self.child_frame_id);
        write_pose(&mut writer, &self.pose);
        writer.f64s([0.0; 36]);
        writer.f64s(self.velocity.into());
        writer.f64s(self.rates.into());
        writer.f64s([0.0; 36]);
        writer.finish()
    }
}

/// One `geometry_msgs/msg/TransformStamped`: where `child` is in `parent`.
#[derive(Clone, Debug, PartialEq)]
pub struct Transform<'a> {
    /// The frame in which it is.
    pub parent: &'a str,
    /// The frame whose pose it is.
    pub child: &'a str,
    /// Takes points from the child's frame to the parent's.
    pub pose: Isometry3<f64>,
}

/// `tf2_msgs/msg/TFMessage` in CDR.
pub fn encode_tf(at: Stamp, transforms: &[Transform<'_>]) -> Vec<u8> {
    let mut writer = Writer::new();
    writer.length(transforms.len());
    for transform in transforms {
        write_header(&mut writer, at, transform.parent);
        writer.string(transform.child);
        write_pose(&mut writer, &transform.pose);
    }
    writer.finish()
}

/// An `N`-matrix, row by row, with this diagonal.
fn diagonal<const N: usize, const SIDE: usize>(values: [f64; SIDE]) -> [f64; N] {
    let mut matrix = [0.0; N];
    for (i, value) in values.into_iter().enumerate() {
        matrix[i * (SIDE + 1)] = value;
    }
    matrix
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const AT: Stamp = Stamp::from_nanos(1_700_000_000_123_456_789);

    #[test]
    fn what_a_vehicle_says_comes_back_from_its_messages() {
        let imu = Imu {
            at: AT,
            frame_id: "imu",
            rates: Vector3::new(0.1, -0.2, 0.3),
            rates_variance: 1e-6,
            specific_force: Vector3::new(0.0, 1.0, 9.8),
            specific_force_variance: 1e-4,
        };
        assert_eq!(Imu::decode(&imu.encode()), Ok(imu));
        let fix = NavSatFix {
            at: AT,
            frame_id: "gnss",
            status: -1,
            latitude_deg: 50.7,
            longitude_deg: -7.1,
            altitude_m: 110.0,
            variances_m2: [1.0, 2.0, 3.0],
        };
        assert_eq!(NavSatFix::decode(&fix.encode()), Ok(fix));
        let odometry = Odometry {
            at: AT,
            frame_id: "world",
            child_frame_id: "base_link",
            pose: Isometry3::new([1.0, 2.0, 3.0].into(), [0.0, 0.0, 1.5].into()),
            velocity: Vector3::new(1.0, 0.0, 0.0),
            rates: Vector3::new(0.0, 0.0, 0.2),
        };
        let message = odometry.encode();
        let back = Odometry::decode(&message).expect("own message");
        let back = back.expect("a pose");
        assert!(
            (back.pose.inverse() * odometry.pose)
                .translation
                .vector
                .norm()
                < 1e-12
        );
        assert_eq!(
            (back.velocity, back.rates),
            (odometry.velocity, odometry.rates)
        );
        let shown = Stamp::from_nanos(5);
        let message = encode_time_reference(AT, shown, "simulation");
        assert_eq!(decode_time_reference(&message), Ok((AT, shown)));
    }

    #[test]
    fn an_odometry_of_nan_has_no_pose() {
        let odometry = Odometry {
            at: AT,
            frame_id: "world",
            child_frame_id: "base_link",
            pose: Isometry3::translation(f64::NAN, 0.0, 0.0),
            velocity: Vector3::zeros(),
            rates: Vector3::zeros(),
        };
        assert_eq!(Odometry::decode(&odometry.encode()), Ok(None));
    }

    proptest! {
        #[test]
        fn any_bytes_are_decoded_or_refused(mut message: Vec<u8>) {
            if let Some(header) = message.get_mut(..4) {
                header.copy_from_slice(&[0, 1, 0, 0]);
            }
            let _outcomes = (
                Imu::decode(&message).is_ok(), NavSatFix::decode(&message).is_ok(), Odometry::decode(&message).is_ok(),
                decode_time_reference(&message).is_ok(),
            );
        }
    }
}
