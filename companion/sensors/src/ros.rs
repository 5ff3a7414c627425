//! The ROS 2 messages that carry an RGB-D camera and its true pose, and their text definitions.
//!
//! The definitions go into every file beside the data, so that Foxglove and `ros2 bag` show a recording without being
//! told anything. Depth is `16UC1` in millimetres with 0 for nothing, or `32FC1` in metres with NaN for nothing
//! (REP-118).

use maps::camera::Pinhole;
use maps::time::Stamp;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use crate::cdr::{CdrError, Reader, Writer};

/// Name and definition of a message type, dependencies included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schema {
    /// As `sensor_msgs/msg/Image`.
    pub name: &'static str,
    /// In the form `ros2msg`: the fields, then those of each message within, after a line of `=`.
    pub text: &'static str,
}

macro_rules! dependencies {
    ($($name:literal: $text:expr),+) => {
        concat!($(
            "================================================================================\nMSG: ", $name, "\n", $text
        ),+)
    };
}

macro_rules! header {
    () => {
        dependencies!(
            "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
            "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n"
        )
    };
}

/// Pixels.
pub const IMAGE: Schema = Schema {
    name: "sensor_msgs/msg/Image",
    text: concat!(
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n",
        header!()
    ),
};

/// A camera's lens.
pub const CAMERA_INFO: Schema = Schema {
    name: "sensor_msgs/msg/CameraInfo",
    text: concat!(
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n",
        "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
        header!(),
        dependencies!(
            "sensor_msgs/RegionOfInterest":
            "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
        )
    ),
};

/// A pose.
pub const POSE_STAMPED: Schema = Schema {
    name: "geometry_msgs/msg/PoseStamped",
    text: concat!(
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
        header!(),
        dependencies!(
            "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
            "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
            "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
        )
    ),
};

/// `sensor_msgs/msg/Image`, as far as it is used; the pixels are borrowed.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<'a> {
    /// When the shutter was open.
    pub at: Stamp,
    /// The camera, as `tf2` knows it.
    pub frame_id: &'a str,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// What a pixel is: `rgb8`, `16UC1`, ...
    pub encoding: &'a str,
    /// Whether numbers of more than one byte have their high byte first.
    pub is_bigendian: bool,
    /// Bytes from one row to the next.
    pub step: u32,
    /// The rows.
    pub data: &'a [u8],
}

impl<'a> Image<'a> {
    /// Reads a message; its data may be shorter or longer than its size says.
    pub fn decode(message: &'a [u8]) -> Result<Self, CdrError> {
        let mut reader = Reader::new(message)?;
        let (at, frame_id) = read_header(&mut reader)?;
        Ok(Self {
            at,
            frame_id,
            height: reader.u32()?,
            width: reader.u32()?,
            encoding: reader.string()?,
            is_bigendian: reader.u8()? != 0,
            step: reader.u32()?,
            data: reader.bytes()?,
        })
    }

    /// The message in CDR.
    pub fn encode(&self) -> Vec<u8> {
        let mut writer = Writer::new();
        write_header(&mut writer, self.at, self.frame_id);
        writer.u32(self.height);
        writer.u32(self.width);
        writer.string(self.encoding);
        writer.u8(u8::from(self.is_bigendian));
        writer.u32(self.step);
        writer.bytes(self.data);
        writer.finish()
    }
}

/// `sensor_msgs/msg/CameraInfo`, as far as it is used.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraInfo<'a> {
    /// The name of the lens model: `plumb_bob` is ours.
    pub model: &'a str,
    /// Its coefficients, however many the message has.
    pub coefficients: Vec<f64>,
    /// The camera; its distortion is the first five coefficients, whatever the model.
    pub camera: Pinhole,
}

impl<'a> CameraInfo<'a> {
    /// Reads a message.
    pub fn decode(message: &'a [u8]) -> Result<Self, CdrError> {
        let mut reader = Reader::new(message)?;
        read_header(&mut reader)?;
        let height = reader.u32()? as usize;
        let width = reader.u32()? as usize;
        let model = reader.string()?;
        let coefficients = reader.f64_sequence()?;
        let [fx, _, cx, _, fy, cy, ..] = reader.f64s::<9>()?;
        let mut distortion = [0.0; 5];
        for (known, &given) in distortion.iter_mut().zip(&coefficients) {
            *known = given;
        }
        let camera = Pinhole {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            distortion,
        };
        Ok(Self {
            model,
            coefficients,
            camera,
        })
    }

    /// Whether [`Pinhole`] says all there is to say about the lens.
    pub fn is_understood(&self) -> bool {
        // `rational_polynomial` is `plumb_bob` with three more coefficients in a denominator.
        let brown = ["plumb_bob", "rational_polynomial", ""].contains(&self.model);
        let others = self.coefficients.iter().skip(if brown { 5 } else { 0 });
        others.into_iter().all(|&c| c == 0.0)
    }
}

/// `sensor_msgs/msg/CameraInfo` of this camera, in CDR.
pub fn encode_camera_info(at: Stamp, frame_id: &str, camera: &Pinhole) -> Vec<u8> {
    let Pinhole { fx, fy, cx, cy, .. } = *camera;
    let mut writer = Writer::new();
    write_header(&mut writer, at, frame_id);
    writer.u32(camera.height as u32);
    writer.u32(camera.width as u32);
    writer.string("plumb_bob");
    writer.f64_sequence(&camera.distortion);
    writer.f64s([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    writer.f64s([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    writer.f64s([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    // No binning, the whole image.
    for _ in 0..6 {
        writer.u32(0);
    }
    writer.u8(0);
    writer.finish()
}

/// Reads `geometry_msgs/msg/PoseStamped`; `None` instead of a pose that is none (not finite, quaternion of length 0).
pub fn decode_pose(message: &[u8]) -> Result<(Stamp, Option<Isometry3<f64>>), CdrError> {
    let mut reader = Reader::new(message)?;
    let (at, _frame_id) = read_header(&mut reader)?;
    let [x, y, z] = reader.f64s::<3>()?;
    let [i, j, k, w] = reader.f64s::<4>()?;
    let finite = [x, y, z, i, j, k, w].iter().all(|c| c.is_finite());
    let rotation = UnitQuaternion::try_new(Quaternion::new(w, i, j, k), 1e-6);
    let pose = rotation.map(|r| Isometry3::from_parts(Translation3::new(x, y, z), r));
    Ok((at, pose.filter(|_| finite)))
}

/// `geometry_msgs/msg/PoseStamped` of this pose, in CDR.
pub fn encode_pose(at: Stamp, frame_id: &str, pose: &Isometry3<f64>) -> Vec<u8> {
    let mut writer = Writer::new();
    write_header(&mut writer, at, frame_id);
    writer.f64s(pose.translation.vector.into());
    writer.f64s(pose.rotation.coords.into());
    writer.finish()
}

const NANOS_PER_SECOND: u64 = 1_000_000_000;

fn read_header<'a>(reader: &mut Reader<'a>) -> Result<(Stamp, &'a str), CdrError> {
    // `int32 sec` in the definition, taken as unsigned: no camera ran before 1970, and it lasts until 2106.
    let seconds = u64::from(reader.u32()?);
    let nanos = u64::from(reader.u32()?);
    let at = Stamp::from_nanos(seconds * NANOS_PER_SECOND + nanos);
    Ok((at, reader.string()?))
}

fn write_header(writer: &mut Writer, at: Stamp, frame_id: &str) {
    writer.u32((at.as_nanos() / NANOS_PER_SECOND) as u32);
    writer.u32((at.as_nanos() % NANOS_PER_SECOND) as u32);
    writer.string(frame_id);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_camera_comes_back_from_its_message() {
        let camera = Pinhole {
            width: 640,
            height: 480,
            fx: 542.8,
            fy: 542.5,
            cx: 315.5,
            cy: 237.7,
            distortion: [0.04, -0.1, -0.0007, -0.0001, 0.0],
        };
        let message = encode_camera_info(Stamp::from_nanos(5), "camera", &camera);
        let info = CameraInfo::decode(&message).expect("own message");
        assert_eq!(info.camera, camera);
        assert!(info.is_understood());
    }

    #[track_caller]
    fn check_understood(model: &str, coefficients: &[f64], expected: bool) {
        let camera = Pinhole {
            width: 2,
            height: 2,
            fx: 1.0,
            fy: 1.0,
            cx: 0.5,
            cy: 0.5,
            distortion: [0.0; 5],
        };
        let coefficients = coefficients.to_vec();
        let info = CameraInfo {
            model,
            coefficients,
            camera,
        };
        assert_eq!(info.is_understood(), expected, "{info:?}");
    }

    #[test]
    fn a_lens_that_brown_cannot_describe_is_not_taken_for_one() {
        check_understood("plumb_bob", &[0.1, 0.2, 0.0, 0.0, 0.3], true);
        check_understood(
            "rational_polynomial",
            &[0.1, 0.2, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0],
            true,
        );
        check_understood(
            "rational_polynomial",
            &[0.1, 0.2, 0.0, 0.0, 0.3, 0.5, 0.0, 0.0],
            false,
        );
        check_understood("equidistant", &[0.1, 0.0, 0.0, 0.0], false);
        check_understood("equidistant", &[0.0; 4], true);
    }

    #[test]
    fn a_pose_comes_back_from_its_message_to_the_nanosecond() {
        let at = Stamp::from_nanos(1_548_339_819_874_260_001);
        let pose = Isometry3::new([1.0, -2.0, 3.0].into(), [0.1, 0.2, -0.3].into());
        let (stamp, back) = decode_pose(&encode_pose(at, "world", &pose)).expect("own message");
        assert_eq!(stamp, at);
        let back = back.expect("a pose");
        assert!((back.inverse() * pose).translation.vector.norm() < 1e-12);
        assert!(back.rotation.angle_to(&pose.rotation) < 1e-7);
    }

    #[test]
    fn a_pose_of_nan_or_without_rotation_is_none() {
        let at = Stamp::ZERO;
        let mut message = encode_pose(at, "", &Isometry3::identity());
        let end = message.len();
        message[end - 8..].fill(0);
        assert_eq!(decode_pose(&message), Ok((at, None)), "zero quaternion");
        message[end - 8..].copy_from_slice(&f64::NAN.to_le_bytes());
        assert_eq!(decode_pose(&message), Ok((at, None)), "NaN");
    }

    proptest! {
        #[test]
        fn any_bytes_are_decoded_or_refused(mut message: Vec<u8>) {
            if let Some(header) = message.get_mut(..4) {
                header.copy_from_slice(&[0, 1, 0, 0]);
            }
            let _outcomes = (
                Image::decode(&message).is_ok(), CameraInfo::decode(&message).is_ok(), decode_pose(&message).is_ok()
            );
        }

        #[test]
        fn an_image_comes_back_from_its_message(width: u32, height: u32, step: u32, data: Vec<u8>, nanos in 0..u64::from(u32::MAX) * 1_000_000_000) {
            let image = Image {
                at: Stamp::from_nanos(nanos), frame_id: "camera", width, height, encoding: "rgb8", is_bigendian: false,
                step, data: &data,
            };
            let message = image.encode();
            prop_assert_eq!(Image::decode(&message), Ok(image.clone()));
        }
    }
}
