//! A textured room and a camera that moves through it, drawn by casting a ray for each pixel.

use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use sensors::{RgbdSource, SourceError, TruthPose};

/// The corners of the room; the floor is at z = 0.
const LOW: [f64; 3] = [-1.5, -2.0, 0.0];
const HIGH: [f64; 3] = [3.0, 2.0, 2.5];

/// Edge of the patches of even colour on the walls.
const PATCH_M: f64 = 0.12;

/// A recording of the room.
pub(crate) struct Room {
    poses: Vec<TruthPose>,
    next: usize,
}

impl Room {
    /// This many frames of a camera that moves sideways and turns a little.
    pub(crate) fn new(frames: usize) -> Self {
        let pose = |index: usize| TruthPose {
            at: Stamp::from_nanos(1_700_000_000_000_000_000 + index as u64 * 33_333_333),
            pose: camera_pose(index as f64 / 30.0),
        };
        Self {
            poses: (0..frames).map(pose).collect(),
            next: 0,
        }
    }
}

/// Level above the floor, a little tilted down, so that the floor is in view.
fn camera_pose(seconds: f64) -> Isometry3<f64> {
    let ahead = Rotation3::from_basis_unchecked(&[-Vector3::y(), -Vector3::z(), Vector3::x()]);
    let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.15 * seconds);
    let tilted = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.35);
    let rotation = UnitQuaternion::from_rotation_matrix(&(turned * tilted * ahead));
    Isometry3::from_parts(
        Translation3::new(0.1 * seconds, 0.2 * seconds, 1.4),
        rotation,
    )
}

/// Where a ray from inside leaves the room: its length, and the wall's axis.
fn exit(from: &Vector3<f64>, along: &Vector3<f64>) -> (f64, usize) {
    let distance = |axis: usize| {
        let wall = if along[axis] > 0.0 {
            HIGH[axis]
        } else {
            LOW[axis]
        };
        (wall - from[axis]) / along[axis]
    };
    let walls = (0..3).filter(|&axis| along[axis].abs() > 1e-9);
    let exits = walls.map(|axis| (distance(axis), axis));
    exits
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .expect("a ray has a direction")
}

/// A colour for each patch of each wall, always the same.
fn color(p: &Vector3<f64>, axis: usize) -> [u8; 3] {
    let cell = |i: usize| {
        if i == axis {
            i64::from(p[i] > 1.0)
        } else {
            (p[i] / PATCH_M).floor() as i64
        }
    };
    let mut hash = axis as u64 + 1;
    for i in 0..3 {
        hash = (hash ^ cell(i) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        hash ^= hash >> 29;
    }
    let [r, g, b, ..] = hash.to_le_bytes();
    [r, g, b]
}

impl RgbdSource for Room {
    fn name(&self) -> &'static str {
        "room"
    }

    fn camera(&self) -> Pinhole {
        Pinhole {
            width: 320,
            height: 240,
            fx: 260.0,
            fy: 260.0,
            cx: 159.5,
            cy: 119.5,
            distortion: [0.0; 5],
        }
    }

    fn frame_count(&self) -> Option<usize> {
        Some(self.poses.len())
    }

    fn truth(&self) -> &[TruthPose] {
        &self.poses
    }

    fn next_frame(&mut self) -> Result<Option<RgbdFrame>, SourceError> {
        let Some(&TruthPose { at, pose }) = self.poses.get(self.next) else {
            return Ok(None);
        };
        self.next += 1;
        let camera = self.camera();
        let world_from_camera = Isometry::<World, Camera>::claim(pose);
        let from = pose.translation.vector;
        let (mut rgb, mut depth_m) = (Vec::new(), Vec::new());
        for y in 0..camera.height {
            for x in 0..camera.width {
                let ray = camera.unproject([x as f64, y as f64], 1.0);
                let along = (world_from_camera * ray).raw.coords - from;
                // The ray's z is 1 in the camera, so its length in these units is the depth.
                let (depth, axis) = exit(&from, &along);
                rgb.push(color(&(from + along * depth), axis));
                depth_m.push(depth as f32);
            }
        }
        Ok(Some(RgbdFrame {
            at,
            width: camera.width,
            height: camera.height,
            rgb,
            depth_m,
        }))
    }
}
