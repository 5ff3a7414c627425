//! What an RGB-D camera has to say as ROS 2 messages, for files and for the wire.

use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;

use crate::mcap::Topics;
use crate::ros::{self, Image, Schema};

/// One message, ready to be written or sent.
#[derive(Clone, Debug, PartialEq)]
pub struct Message<'a> {
    /// Where it belongs, such as `/uav/camera/color/image_raw`.
    pub topic: &'a str,
    /// Its type.
    pub schema: &'static Schema,
    /// When what it says was so.
    pub at: Stamp,
    /// CDR with its encapsulation header.
    pub bytes: Vec<u8>,
}

const CAMERA_FRAME: &str = "camera_color_optical_frame";
const WORLD_FRAME: &str = "world";

/// The camera of colour and depth.
pub fn camera<'a>(topics: &'a Topics, at: Stamp, camera: &Pinhole) -> Message<'a> {
    Message {
        topic: &topics.camera_info,
        schema: &ros::CAMERA_INFO,
        at,
        bytes: ros::encode_camera_info(at, CAMERA_FRAME, camera),
    }
}

/// Colour as `rgb8`, then depth as `16UC1`, which is to the millimetre and up to 65.5 m.
pub fn frame<'a>(topics: &'a Topics, frame: &RgbdFrame) -> [Message<'a>; 2] {
    let color = Image {
        at: frame.at,
        frame_id: CAMERA_FRAME,
        width: frame.width as u32,
        height: frame.height as u32,
        encoding: "rgb8",
        is_bigendian: false,
        step: 3 * frame.width as u32,
        data: frame.rgb.as_flattened(),
    };
    let millimetres: Vec<u8> = frame
        .depth_m
        .iter()
        .flat_map(|&depth| millimetres(depth).to_le_bytes())
        .collect();
    let depth = Image {
        encoding: "16UC1",
        step: 2 * frame.width as u32,
        data: &millimetres,
        ..color
    };
    [(&topics.color, color), (&topics.depth, depth)].map(|(topic, image)| Message {
        topic,
        schema: &ros::IMAGE,
        at: image.at,
        bytes: image.encode(),
    })
}

/// Where the camera really was.
pub fn truth<'a>(
    topics: &'a Topics,
    at: Stamp,
    world_from_camera: &Isometry<World, Camera>,
) -> Message<'a> {
    Message {
        topic: &topics.truth,
        schema: &ros::POSE_STAMPED,
        at,
        bytes: ros::encode_pose(at, WORLD_FRAME, &world_from_camera.raw),
    }
}

/// 0, which is nothing, for what is not finite, not positive or too far.
fn millimetres(depth_m: f32) -> u16 {
    let millimetres = (depth_m * 1000.0).round();
    if millimetres > 0.0 && millimetres < f32::from(u16::MAX) {
        millimetres as u16
    } else {
        0
    }
}
