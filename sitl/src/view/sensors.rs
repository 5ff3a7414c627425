//! What sensors see at one moment, from the exact models: pictures, returns of the `LiDAR`, voxels.

use std::time::Duration;

use maps::frame::{Body, Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::{Point3, Vector3};
use sitl::depth_camera::d455;
use sitl::lidar::{Lidar, Return};
use sitl::palette::{self, Above, Canvas};
use sitl::platform;
use sitl::rays::Rays;
use sitl::render::diorama::Vertex;
use sitl::render::{Moment, Picture};
use sitl::scene::{Class, Name, Scene};
use sitl::truth::{sight, voxels};

use super::world::Poses;

/// Which sensors' pictures are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Tab {
    /// The drone's camera.
    Drone,
    /// The four cameras of the ground vehicle.
    Ground,
    /// The ground vehicle's surroundings from above: truth, and its `LiDAR`.
    Above,
}

impl Tab {
    pub(crate) const ALL: [(Self, &'static str); 3] = [
        (Self::Drone, "Drone"),
        (Self::Ground, "Ground"),
        (Self::Above, "Above"),
    ];
}

/// What of a camera's picture is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Kind {
    /// The picture itself.
    Colour,
    /// True depth, near is bright.
    Depth,
    /// Each thing in a colour of its own.
    Instance,
    /// Classes in the colours of Cityscapes.
    Class,
    /// Road users from green (seen whole) to red (hidden).
    Occlusion,
}

impl Kind {
    pub(crate) const ALL: [(Self, &'static str); 5] = [
        (Self::Colour, "colour"),
        (Self::Depth, "depth"),
        (Self::Instance, "instance"),
        (Self::Class, "class"),
        (Self::Occlusion, "occlusion"),
    ];
}

/// Everything that sensors are asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wanted {
    pub(crate) scene: (Name, u64),
    pub(crate) at: Stamp,
    pub(crate) poses: Poses,
    pub(crate) tab: Tab,
    pub(crate) kind: Kind,
    pub(crate) lidar: bool,
    pub(crate) voxels: bool,
}

impl Wanted {
    fn is_of_moment(&self, other: &Self) -> bool {
        (self.scene, self.at, self.poses) == (other.scene, other.at, other.poses)
    }

    pub(crate) fn has_pictures_of(&self, other: &Self) -> bool {
        let same_kind = self.tab == Tab::Above || self.kind == other.kind;
        self.is_of_moment(other) && self.tab == other.tab && same_kind
    }

    pub(crate) fn has_returns_of(&self, other: &Self) -> bool {
        self.is_of_moment(other)
    }

    /// Where the drone is.
    pub(crate) fn uav(&self, scene: &Scene) -> Isometry<World, Body> {
        let told = self.poses.uav;
        told.unwrap_or_else(|| platform::uav(scene, self.at, self.scene.1))
    }

    /// Its camera.
    pub(crate) fn uav_camera(&self, scene: &Scene) -> Isometry<World, Camera> {
        let (at, seed) = (self.at, self.scene.1);
        let camera = platform::uav_camera(scene, at, seed);
        match self.poses.uav {
            None => camera,
            // Mounted as on the drone that the scene has.
            Some(uav) => uav * (platform::uav(scene, at, seed).inverse() * camera),
        }
    }

    /// Where the ground vehicle is.
    pub(crate) fn ugv(&self, scene: &Scene) -> Isometry<World, Body> {
        self.ugv_at(scene, self.at)
    }

    /// Where it is within the same turn of the `LiDAR`. Where it is told of, it stands for that long.
    fn ugv_at(&self, scene: &Scene, at: Stamp) -> Isometry<World, Body> {
        self.poses.ugv.unwrap_or_else(|| platform::ugv(scene, at))
    }
}

/// One picture with its name.
#[derive(Clone, Debug)]
pub(crate) struct Panel {
    pub(crate) name: &'static str,
    pub(crate) canvas: Canvas,
}

/// The pictures that were asked for.
#[derive(Clone, Debug)]
pub(crate) struct Pictures {
    pub(crate) of: Wanted,
    pub(crate) panels: Vec<Panel>,
    /// How long it took to draw them.
    pub(crate) took: Duration,
}

/// Draws them.
pub(crate) fn pictures(wanted: &Wanted, moment: &Moment<'_>, rays: &Rays<'_>) -> Vec<Panel> {
    let scene = moment.scene();
    match wanted.tab {
        Tab::Drone => {
            let (lens, pose) = (d455(), wanted.uav_camera(scene));
            let views = [(pose, moment.picture(&lens, pose))];
            coloured(wanted.kind, moment, &lens, &["drone"], &views)
        }
        Tab::Ground => {
            let views = ground_views(wanted, moment);
            let lens = platform::ugv_lens();
            coloured(wanted.kind, moment, &lens, &platform::UGV_CAMERAS, &views)
        }
        Tab::Above => {
            let (body, size) = (wanted.ugv(scene), 384);
            let above = Above { body, size };
            let views = ground_views(wanted, moment);
            let panels = [
                ("street (truth)", above.street(moment, rays)),
                ("occlusion (truth)", above.occlusions(moment, &views)),
                ("LiDAR", above.lidar(scene, &sweep(wanted, rays))),
            ];
            panels.map(|(name, canvas)| Panel { name, canvas }).into()
        }
    }
}

fn ground_views(wanted: &Wanted, moment: &Moment<'_>) -> Vec<(Isometry<World, Camera>, Picture)> {
    let (lens, body) = (platform::ugv_lens(), wanted.ugv(moment.scene()));
    (0..platform::UGV_CAMERAS.len())
        .map(|index| {
            let pose = body * platform::body_from_ugv_camera(index);
            (pose, moment.picture(&lens, pose))
        })
        .collect()
}

fn coloured(
    kind: Kind,
    moment: &Moment<'_>,
    lens: &maps::camera::Pinhole,
    names: &[&'static str],
    views: &[(Isometry<World, Camera>, Picture)],
) -> Vec<Panel> {
    let scene = moment.scene();
    let sights = match kind {
        Kind::Occlusion => sight(moment, lens, views),
        _ => std::collections::BTreeMap::new(),
    };
    let canvas = |picture: &Picture| match kind {
        Kind::Colour => palette::colours(picture),
        Kind::Depth => palette::depths(picture),
        Kind::Instance => palette::instances(picture),
        Kind::Class => palette::classes(scene, picture),
        Kind::Occlusion => palette::occlusions(scene, picture, &sights),
    };
    let named = names.iter().zip(views);
    named
        .map(|(&name, (_, picture))| Panel {
            name,
            canvas: canvas(picture),
        })
        .collect()
}

/// A return of the `LiDAR`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Echo {
    /// In the world.
    pub(crate) place: [f32; 3],
    pub(crate) intensity: u8,
    pub(crate) ring: u8,
    pub(crate) class: Class,
}

/// The last turn of the `LiDAR` before a moment.
#[derive(Clone, Debug)]
pub(crate) struct Cloud {
    pub(crate) of: Wanted,
    pub(crate) echoes: Vec<Echo>,
}

/// A turn ends at the moment that is looked at.
fn turn_start(wanted: &Wanted, lidar: &Lidar) -> Stamp {
    wanted.at - lidar.turn
}

fn sweep(wanted: &Wanted, rays: &Rays<'_>) -> Vec<Return> {
    let lidar = Lidar::rs_32();
    let (scene, start) = (rays.scene(), turn_start(wanted, &lidar));
    lidar.sweep(rays, start, |at| wanted.ugv_at(scene, at), wanted.scene.1)
}

/// Measures them.
pub(crate) fn echoes(wanted: &Wanted, rays: &Rays<'_>) -> Vec<Echo> {
    let lidar = Lidar::rs_32();
    let (scene, start) = (rays.scene(), turn_start(wanted, &lidar));
    let returns = sweep(wanted, rays);
    returns
        .iter()
        .map(|seen| {
            let at = start + Duration::from_secs_f32(seen.after_s);
            let sensor = wanted.ugv_at(scene, at).raw * lidar.body_from_sensor;
            let place = sensor * Point3::from(seen.point.map(f64::from));
            Echo {
                place: place.coords.map(|c| c as f32).into(),
                intensity: seen.intensity,
                ring: seen.ring,
                class: scene.class_of(seen.instance),
            }
        })
        .collect()
}

/// Edge of the voxels that are shown.
const VOXEL_M: f64 = 0.2;
/// They reach this far from the ground vehicle, which may go on this far until they are found anew.
const VOXELS_REACH_M: f64 = 14.0;
const VOXELS_STRIDE_M: f64 = 4.0;

/// Where voxels are shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Around {
    pub(crate) scene: (Name, u64),
    middle: [i32; 2],
}

impl Around {
    pub(crate) fn of(wanted: &Wanted, scene: &Scene) -> Self {
        let place = wanted.ugv(scene).translation().raw;
        let middle = [place.x, place.y].map(|c| (c / VOXELS_STRIDE_M).round() as i32);
        Self {
            scene: wanted.scene,
            middle,
        }
    }

    /// The sides of true voxels that one can see, as triangles in the colours of their classes.
    pub(crate) fn voxels(&self, scene: &Scene) -> Vec<Vertex> {
        let [x, y] = self.middle.map(|c| f64::from(c) * VOXELS_STRIDE_M);
        let reach = VOXELS_REACH_M;
        let corners = [
            Point3::new(x - reach, y - reach, -0.5),
            Point3::new(x + reach, y + reach, 5.0),
        ];
        let truth = voxels(scene, VOXEL_M, corners).classes;
        let mut vertices = Vec::new();
        for (key, class) in &truth {
            for axis in 0..3 {
                for sign in [-1, 1] {
                    let mut beside = *key;
                    beside[axis] += sign;
                    if !truth.contains_key(&beside) {
                        side(*key, (axis, sign), *class, &mut vertices);
                    }
                }
            }
        }
        vertices
    }
}

/// One side of a voxel: two triangles, counter-clockwise from outside.
fn side(key: [i32; 3], (axis, sign): (usize, i32), class: Class, vertices: &mut Vec<Vertex>) {
    let light = match (axis, sign) {
        (2, 1) => 1.0,
        (2, _) => 0.45,
        (1, _) => 0.75,
        _ => 0.62,
    };
    // Neighbours differ a little, so that one can count them.
    let is_odd = key.iter().sum::<i32>().rem_euclid(2) == 1;
    let light = if is_odd { 0.92 * light } else { light };
    let [r, g, b] = bright(class).map(|c| (f32::from(c) * light) as u8);
    let middle = Vector3::from(key.map(|c| f64::from(c) + 0.5));
    let axis_of = |i: usize| Vector3::from_fn(|j, _| f64::from(u8::from(i % 3 == j)));
    let out = axis_of(axis) * f64::from(sign);
    let (u, v) = (axis_of(axis + 1) * f64::from(sign), axis_of(axis + 2));
    let corner = |along: f64, up: f64| {
        let at = (middle + (out + u * along + v * up) * 0.5) * VOXEL_M;
        Vertex::plain(at.into(), [r, g, b, 255])
    };
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(a, b)| corner(a, b));
    vertices.extend([0, 1, 2, 0, 2, 3].map(|i: usize| corners[i]));
}

/// The colour of a class, light enough to be told from the street: those of Cityscapes for vehicles are next to black.
pub(crate) fn bright(class: Class) -> [u8; 3] {
    match class {
        Class::Car => [80, 150, 255],
        Class::Truck => [60, 200, 220],
        Class::Bus => [120, 110, 255],
        Class::Cyclist => [255, 120, 60],
        Class::Pedestrian => [255, 70, 110],
        Class::Building => [150, 150, 155],
        other => other.colour(),
    }
}
