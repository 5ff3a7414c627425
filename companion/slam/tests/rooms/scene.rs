//! A room of textured planes, seen by ray casting: the truth of the tests.

use std::time::Duration;

use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Camera, Isometry, Point, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};

pub(crate) const CAMERA: Pinhole = Pinhole {
    width: 320,
    height: 240,
    fx: 260.0,
    fy: 260.0,
    cx: 159.5,
    cy: 119.5,
    distortion: [0.0; 5],
};

/// An upright box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    pub(crate) min: [f64; 3],
    pub(crate) max: [f64; 3],
}

impl Block {
    pub(crate) fn contains(&self, p: Point<World>, margin: f64) -> bool {
        (0..3).all(|i| p.raw[i] > self.min[i] - margin && p.raw[i] < self.max[i] + margin)
    }

    /// From a point to the surface, from inside or outside.
    fn distance(&self, p: Point<World>) -> f64 {
        let over = |i: usize| (self.min[i] - p.raw[i]).max(p.raw[i] - self.max[i]);
        let outside = (0..3).map(|i| over(i).max(0.0).powi(2)).sum::<f64>().sqrt();
        let inside = (0..3).map(over).fold(f64::NEG_INFINITY, f64::max);
        if inside < 0.0 { -inside } else { outside }
    }
}

/// The pose of a camera at a place, looking `heading` radians counter-clockwise from east and `down` radians down.
pub(crate) fn looking(position: [f64; 3], heading: f64, down: f64) -> Isometry<World, Camera> {
    // Columns: the camera's axes (right, down, forward) in a world seen towards east.
    let towards_east = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), down)
        * UnitQuaternion::from_matrix(&towards_east);
    Isometry::claim(Isometry3::from_parts(
        Translation3::from(Vector3::from(position)),
        turn,
    ))
}

/// A room and what stands in it.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    pub(crate) room: Block,
    pub(crate) blocks: Vec<Block>,
    /// After so many metres to the east the pattern on all surfaces begins again.
    pub(crate) period_m: f64,
}

impl Scene {
    /// A room whose pattern never repeats.
    pub(crate) fn new(room: Block, blocks: Vec<Block>) -> Self {
        Self {
            room,
            blocks,
            period_m: 1000.0,
        }
    }

    /// Distance from a point to the nearest surface.
    pub(crate) fn distance(&self, p: Point<World>) -> f64 {
        let to = |block: &Block| block.distance(p);
        self.blocks.iter().map(to).fold(to(&self.room), f64::min)
    }
}

/// When frame `index` of 30 a second is taken.
pub(crate) fn taken_at(index: u64) -> Stamp {
    Stamp::ZERO + Duration::from_micros(33_333) * u32::try_from(index).expect("a short test")
}

/// What the camera sees at frame `index` of 30 a second, in a room of 5 m by 5 m with `blocks`.
pub(crate) fn render(
    index: u64,
    world_from_camera: Isometry<World, Camera>,
    blocks: &[Block],
) -> RgbdFrame {
    let room = Block {
        min: [-1.0, -2.5, 0.0],
        max: [4.0, 2.5, 2.6],
    };
    render_scene(index, world_from_camera, &Scene::new(room, blocks.to_vec()))
}

/// What the camera sees at frame `index` of 30 a second.
pub(crate) fn render_scene(
    index: u64,
    world_from_camera: Isometry<World, Camera>,
    scene: &Scene,
) -> RgbdFrame {
    let (width, height) = (CAMERA.width, CAMERA.height);
    let pose = world_from_camera.raw;
    let mut rgb = Vec::with_capacity(width * height);
    let mut depth_m = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let ray = CAMERA.unproject([x as f64, y as f64], 1.0).raw.coords;
            let direction = pose.rotation * ray;
            let (depth, surface) = nearest_surface(&pose, &direction, scene);
            let mut hit = pose.translation.vector + direction * depth;
            hit.x = hit.x.rem_euclid(scene.period_m);
            // Blocks take their patches along.
            let block = (surface / 10).checked_sub(1);
            let block = block.and_then(|i| scene.blocks.get(i as usize));
            hit -= block.map_or(Vector3::zeros(), |b| Vector3::from(b.min));
            rgb.push([texture(surface, &hit); 3]);
            depth_m.push(depth as f32);
        }
    }
    RgbdFrame {
        at: taken_at(index),
        width,
        height,
        rgb,
        depth_m,
    }
}

/// Depth along the ray, and the number of the surface hit.
fn nearest_surface(pose: &Isometry3<f64>, direction: &Vector3<f64>, scene: &Scene) -> (f64, u64) {
    let eye = pose.translation.vector;
    let (_, out, side) = crossing(&scene.room, &eye, direction);
    let mut best = (out, side);
    for (number, block) in (1..).zip(&scene.blocks) {
        let (enter, leave, side) = crossing(block, &eye, direction);
        if enter > 0.0 && enter < leave && enter < best.0 {
            best = (enter, 10 * number + side);
        }
    }
    best
}

/// Where a ray enters and leaves a block, and through which pair of sides it does what is visible.
fn crossing(block: &Block, eye: &Vector3<f64>, direction: &Vector3<f64>) -> (f64, f64, u64) {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut enter_axis, mut leave_axis) = (0, 0);
    for axis in 0..3 {
        let a = (block.min[axis] - eye[axis]) / direction[axis];
        let b = (block.max[axis] - eye[axis]) / direction[axis];
        if a.min(b) > enter {
            (enter, enter_axis) = (a.min(b), axis as u64);
        }
        if a.max(b) < leave {
            (leave, leave_axis) = (a.max(b), axis as u64);
        }
    }
    let axis = if enter > 0.0 { enter_axis } else { leave_axis };
    (enter, leave, axis)
}

/// Patches of 7 cm, each of its own grey.
fn texture(surface: u64, p: &Vector3<f64>) -> u8 {
    let cell = p.map(|c| ((c + 100.003) / 0.07).floor() as u64);
    let mut h = surface
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(cell.x * 73_856_093)
        .wrapping_add(cell.y * 19_349_663)
        .wrapping_add(cell.z * 83_492_791);
    h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    40 + ((h >> 33) % 176) as u8
}

/// Distance and angle between two poses.
pub(crate) fn apart(a: Isometry<World, Camera>, b: Isometry<World, Camera>) -> (f64, f64) {
    let step = a.raw.inverse() * b.raw;
    (step.translation.vector.norm(), step.rotation.angle())
}

/// A point of the world, from its coordinates.
pub(crate) fn point(x: f64, y: f64, z: f64) -> Point<World> {
    Point::from_raw(Point3::new(x, y, z))
}
