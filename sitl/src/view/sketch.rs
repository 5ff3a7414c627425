//! What is added to the scene: boxes, vehicles, the drone's view, returns of the `LiDAR`.

use maps::frame::{Camera, Isometry, World};
use nalgebra::{Isometry3, Point3, Vector3};
use sitl::depth_camera::d455;
use sitl::render::diorama::Vertex;
use sitl::scene::{RoadUser, Thing};

use super::pipelines::{Dot, Segment};
use super::sensors::{Echo, bright};

/// The drone.
pub(crate) const UAV: [u8; 3] = [255, 170, 40];
/// The ground vehicle.
pub(crate) const UGV: [u8; 3] = [70, 220, 190];
/// How far the drone's view is drawn, at most.
const VIEW_M: f64 = 5.0;

/// By what returns are coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Colouring {
    /// How much light came back.
    Intensity,
    /// Which beam.
    Ring,
    /// The true class of what was met.
    Class,
}

impl Colouring {
    pub(crate) const ALL: [(Self, &'static str); 3] = [
        (Self::Intensity, "intensity"),
        (Self::Ring, "ring"),
        (Self::Class, "class"),
    ];

    fn colour(self, echo: &Echo) -> [u8; 3] {
        match self {
            Self::Intensity => ramp(f32::from(echo.intensity) / 140.0),
            Self::Ring => ramp(f32::from(echo.ring) / 31.0),
            Self::Class => bright(echo.class),
        }
    }
}

/// Blue, green, yellow, red.
fn ramp(share: f32) -> [u8; 3] {
    let stops = [
        [60.0, 90.0, 255.0],
        [40.0, 220.0, 210.0],
        [240.0, 230.0, 60.0],
        [255.0, 70.0, 50.0],
    ];
    let share = if share.is_finite() { share } else { 0.0 };
    let at = share.clamp(0.0, 1.0) * 2.999;
    let (stop, share) = (at as usize, at.fract());
    [0, 1, 2].map(|c: usize| {
        let (from, to): (f32, f32) = (stops[stop][c], stops[stop + 1][c]);
        (from + (to - from) * share) as u8
    })
}

/// Points of a turn.
pub(crate) fn dots(echoes: &[Echo], colouring: Colouring) -> Vec<Dot> {
    let dot = |echo: &Echo| {
        let [r, g, b] = colouring.colour(echo);
        Dot {
            place: echo.place,
            color: [r, g, b, 255],
        }
    };
    echoes.iter().map(dot).collect()
}

fn segment(from: Point3<f64>, to: Point3<f64>, [r, g, b]: [u8; 3], width_px: f32) -> Segment {
    Segment {
        start: from.coords.map(|c| c as f32).into(),
        end: to.coords.map(|c| c as f32).into(),
        color: [r, g, b, 255],
        width_px,
    }
}

/// The edges of a road user's box, and where it is within the next second.
pub(crate) fn boxes(users: &[RoadUser], segments: &mut Vec<Segment>) {
    for user in users {
        let Thing { place, size, .. } = user.thing;
        let colour = bright(user.thing.class);
        let corner = |i: usize| {
            let half = |bit: usize, size: f64| {
                if i & bit == 0 {
                    -size / 2.0
                } else {
                    size / 2.0
                }
            };
            let up = if i & 4 == 0 { 0.0 } else { size.z };
            place * Point3::new(half(1, size.x), half(2, size.y), up)
        };
        for from in 0..8 {
            for bit in [1, 2, 4] {
                if from & bit == 0 {
                    segments.push(segment(corner(from), corner(from | bit), colour, 1.6));
                }
            }
        }
        if user.velocity.norm() > 0.2 {
            let middle = user.thing.centre();
            segments.push(segment(middle, middle + user.velocity, colour, 2.4));
        }
    }
}

/// What the drone's camera looks at: the edges of its view, and glass between them.
pub(crate) fn frustum(
    pose: Isometry<World, Camera>,
    segments: &mut Vec<Segment>,
    glass: &mut Vec<Vertex>,
) {
    let lens = d455();
    let (width, height) = (lens.width as f64, lens.height as f64);
    let apex = pose.translation().raw;
    // Near the ground a shorter one says as much.
    let view_m = (1.0 + apex.z.max(0.0)).min(VIEW_M);
    let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]
        .map(|[u, v]| (pose * lens.unproject([u - 0.5, v - 0.5], view_m)).raw);
    for (i, &corner) in corners.iter().enumerate() {
        let next = corners[(i + 1) % 4];
        segments.push(segment(apex, corner, UAV, 1.6));
        segments.push(segment(corner, next, UAV, if i == 0 { 3.0 } else { 1.6 }));
        let [r, g, b] = UAV;
        glass.extend([apex, corner, next].map(|p| Vertex::plain(p, [r, g, b, 26])));
    }
}

/// A small quadrotor: four rotors on arms, and where it looks.
pub(crate) fn drone(pose: &Isometry3<f64>, solid: &mut Vec<Vertex>, segments: &mut Vec<Segment>) {
    block(pose, [-0.16, 0.16, -0.09, 0.09, -0.05, 0.06], UAV, solid);
    for (x, y) in [(0.26, 0.26), (0.26, -0.26), (-0.26, 0.26), (-0.26, -0.26)] {
        let hub = pose * Point3::new(x, y, 0.05);
        segments.push(segment(pose * Point3::origin(), hub, UAV, 3.0));
        let rim = |i: u8| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 12.0).sin_cos();
            pose * Point3::new(x + 0.17 * cos, y + 0.17 * sin, 0.06)
        };
        let colour = if x > 0.0 { [255, 240, 200] } else { UAV };
        for i in 0..12 {
            segments.push(segment(rim(i), rim(i + 1), colour, 2.0));
        }
    }
    // Where it is above the ground.
    let at = pose.translation.vector;
    let foot = Point3::new(at.x, at.y, 0.02);
    segments.push(segment(at.into(), foot, UAV, 1.0));
}

/// The ground vehicle, where the scene has none.
pub(crate) fn rover(pose: &Isometry3<f64>, solid: &mut Vec<Vertex>) {
    block(pose, [-0.3, 0.3, -0.2, 0.2, 0.08, 0.32], UGV, solid);
    block(pose, [0.05, 0.25, -0.12, 0.12, 0.32, 0.42], UGV, solid);
    block(pose, [-0.03, 0.03, -0.03, 0.03, 0.32, 1.2], [200; 3], solid);
    for (x, y) in [(0.2, 0.2), (0.2, -0.25), (-0.2, 0.2), (-0.2, -0.25)] {
        let wheel = [x - 0.09, x + 0.09, y, y + 0.05, 0.0, 0.18];
        block(pose, wheel, [40; 3], solid);
    }
}

/// An arrow on the ground that says which way the ground vehicle goes.
pub(crate) fn heading(pose: &Isometry3<f64>, segments: &mut Vec<Segment>) {
    let at = |x: f64, y: f64| pose * Point3::new(x, y, 0.06);
    let tip = at(2.2, 0.0);
    segments.push(segment(at(0.9, 0.0), tip, UGV, 3.0));
    segments.push(segment(at(1.8, 0.25), tip, UGV, 3.0));
    segments.push(segment(at(1.8, -0.25), tip, UGV, 3.0));
}

/// A box by its bounds along x, y and z.
fn block(pose: &Isometry3<f64>, bounds: [f64; 6], colour: [u8; 3], solid: &mut Vec<Vertex>) {
    let [low, high] = [0, 1].map(|i| Vector3::new(bounds[i], bounds[2 + i], bounds[4 + i]));
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    for axis in 0..3_usize {
        for sign in [-1.0, 1.0] {
            let unit = |i: usize| Vector3::from_fn(|j, _| f64::from(u8::from(i % 3 == j)));
            let (out, u, v) = (unit(axis) * sign, unit(axis + 1) * sign, unit(axis + 2));
            let normal = pose.rotation * out;
            let light = (0.62 + 0.3 * normal.z + 0.08 * normal.x) as f32;
            let [r, g, b] = colour.map(|c| (f32::from(c) * light) as u8);
            let corner = |a: f64, b_: f64| {
                let at = middle + (out + u * a + v * b_).component_mul(&half);
                Vertex::plain(pose * Point3::from(at), [r, g, b, 255])
            };
            let corners = [
                corner(-1.0, -1.0),
                corner(1.0, -1.0),
                corner(1.0, 1.0),
                corner(-1.0, 1.0),
            ];
            solid.extend([0, 1, 2, 0, 2, 3].map(|i: usize| corners[i]));
        }
    }
}

/// A shadow below each road user: texture and light of what stands still know nothing of it.
pub(crate) fn shadows(users: &[RoadUser], glass: &mut Vec<Vertex>) {
    for user in users {
        let Thing { place, size, .. } = user.thing;
        let corner = |x: f64, y: f64| {
            let at = Point3::new(x * size.x * 0.52, y * size.y * 0.56, 0.025);
            Vertex::plain(place * at, [0, 0, 0, 90])
        };
        let corners = [
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ];
        glass.extend([0, 1, 2, 0, 2, 3].map(|i: usize| corners[i]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use maps::frame::Isometry as Pose;

    #[test]
    fn a_block_is_closed_and_seen_from_outside() {
        let mut solid = Vec::new();
        let pose = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::z());
        block(
            &pose,
            [-1.0, 1.0, -0.5, 0.5, 0.0, 2.0],
            [200; 3],
            &mut solid,
        );
        let volume = solid.chunks(3).map(|corners| {
            let [a, b, c] = [0, 1, 2].map(|i| Vector3::from(corners[i].position.map(f64::from)));
            a.dot(&b.cross(&c)) / 6.0
        });
        let volume: f64 = volume.sum();
        assert!((volume - 4.0).abs() < 1e-4, "{volume}");
    }

    #[test]
    fn the_drones_view_opens_to_where_its_camera_looks() {
        let (mut segments, mut glass) = (Vec::new(), Vec::new());
        let pose: Pose<World, Camera> = sitl::flight::world_from_camera(maps::time::Stamp::ZERO, 1);
        frustum(pose, &mut segments, &mut glass);
        assert_eq!((segments.len(), glass.len()), (8, 12));
        for end in segments.iter().map(|segment| segment.end) {
            let place = Point3::from(end.map(f64::from));
            let in_camera = pose.raw.inverse() * place;
            assert!((in_camera.z - 2.5).abs() < 1e-3, "{in_camera}");
        }
    }

    #[test]
    fn colours_go_from_cold_to_warm_and_never_leave_the_ramp() {
        assert_eq!(ramp(-1.0), [60, 90, 255]);
        assert_eq!(ramp(f32::NAN), ramp(0.0));
        let [red, _, blue] = ramp(9.0);
        assert!(red > 250 && blue < 60, "{red} {blue}");
    }
}
