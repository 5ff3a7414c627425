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

/// The drone's camera, as `tf2` knows it: its optical axes.
pub const CAMERA_FRAME: &str = "camera_color_optical_frame";
/// The world.
pub const WORLD_FRAME: &str = "world";

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
    let RgbdFrame { at, depth_m, .. } = frame;
    let size = [frame.width as u32, frame.height as u32];
    let images = [
        (&topics.color, color(*at, size, &frame.rgb)),
        (&topics.depth, depth(*at, size, depth_m)),
    ];
    images.map(|(topic, bytes)| Message {
        topic,
        schema: &ros::IMAGE,
        at: *at,
        bytes,
    })
}

/// A colour image of the drone's camera, `rgb8`, in CDR.
pub fn color(at: Stamp, size: [u32; 2], rgb: &[[u8; 3]]) -> Vec<u8> {
    image(at, size, "rgb8", rgb.as_flattened())
}

/// A depth image of the drone's camera, `16UC1`, in CDR.
pub fn depth(at: Stamp, size: [u32; 2], depth_m: &[f32]) -> Vec<u8> {
    let millimetres = depth_m.iter().map(|&depth| millimetres(depth));
    let bytes: Vec<u8> = millimetres.flat_map(u16::to_le_bytes).collect();
    image(at, size, "16UC1", &bytes)
}

fn image(at: Stamp, [width, height]: [u32; 2], encoding: &str, data: &[u8]) -> Vec<u8> {
    Image {
        at,
        frame_id: CAMERA_FRAME,
        width,
        height,
        encoding,
        is_bigendian: false,
        step: (data.len() as u32).checked_div(height).unwrap_or(0),
        data,
    }
    .encode()
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
