//! What light comes from a surface: its material, lit. Sixteen pixels of one face at a time.

#![expect(
    clippy::inline_always,
    clippy::needless_range_loop,
    reason = "loops become vector instructions only if all that they call is in them and arrays are indexed alike"
)]

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::Moment;
use super::seen::Seen;
use super::shadow::Shadows;
use crate::lanes::{LANES, Lanes, lanes, vectorised};
use crate::noise::floor;
use crate::scene::{Colours, Daylight, Light, Spots};

/// What is seen above the walls of a room: [226, 231, 238] when developed.
const CEILING: [f32; 3] = [226.5, 231.5, 238.5];

/// Pixels of one face.
pub(super) struct Batch {
    /// Where their rays meet the plane one metre before the camera.
    pub(super) x: Lanes<f64>,
    pub(super) y: Lanes<f64>,
    /// Inverse depth.
    pub(super) inverse: Lanes<f64>,
}

/// What they show.
pub(super) struct Shaded {
    pub(super) light: Colours,
    pub(super) depth_m: Lanes,
    pub(super) facing: Lanes,
}

/// A camera in a scene, and the light there.
pub(super) struct View<'a> {
    pub(super) camera: &'a Pinhole,
    /// Where the ray of each column and row meets the plane one metre before the camera.
    pub(super) columns: Vec<f64>,
    pub(super) rows: Vec<f64>,
    turn: UnitQuaternion<f64>,
    place: Vector3<f64>,
    light: Lit<'a>,
    /// Light times this is 1 at full scale.
    exposure: f32,
}

enum Lit<'a> {
    /// Where the lamps are, for the camera.
    Lamps(Vec<Point3<f64>>),
    Sun(Daylight<'a>, &'a Shadows),
}

/// Where the rays of pixels meet their face.
struct Places {
    depth_m: Lanes<f64>,
    /// How long each ray is that reaches one metre along the optical axis.
    length: Lanes<f64>,
    facing: Lanes<f64>,
    in_camera: [Lanes<f64>; 3],
    in_world: [Lanes<f64>; 3],
}

impl<'a> View<'a> {
    pub(super) fn new(
        moment: &'a Moment<'_>,
        camera: &'a Pinhole,
        world_from_camera: Isometry<World, Camera>,
    ) -> Self {
        let camera_from_world = world_from_camera.inverse();
        let light = match (moment.scene.light(), &moment.shadows) {
            (Light::Sun(sun), Some(shadows)) => Lit::Sun(Daylight::of(sun), shadows),
            (Light::Lamps(lamps), _) => {
                let lamps = lamps.iter();
                Lit::Lamps(
                    lamps
                        .map(|lamp| camera_from_world.raw * Point3::from(*lamp))
                        .collect(),
                )
            }
            // A stage has shadows wherever there is a sun.
            (Light::Sun(_), None) => Lit::Lamps(Vec::new()),
        };
        let along = |count: usize, centre: f64, focal: f64| {
            let pixels = (0..count).map(|i| (i as f64 - centre) / focal);
            pixels.collect()
        };
        Self {
            camera,
            columns: along(camera.width, camera.cx, camera.fx),
            rows: along(camera.height, camera.cy, camera.fy),
            turn: world_from_camera.raw.rotation,
            place: world_from_camera.raw.translation.vector,
            light,
            exposure: moment.scene.light().exposure(),
        }
    }

    /// The light from where no surface is.
    pub(super) fn sky(&self, batch: &Batch) -> Colours {
        match &self.light {
            Lit::Lamps(_) => CEILING.map(|level| [(level / 255.0).powi(2); LANES]),
            Lit::Sun(day, _) => sky(day, &self.turn, batch),
        }
    }

    /// The light from pixels that show this face.
    pub(super) fn surface(&self, batch: &Batch, seen: &Seen<'_>) -> Shaded {
        let places = places(self, seen, batch);
        let material = seen.face.material;
        let reflectance = material.reflectance(&spots(self, seen, &places));
        let light = match &self.light {
            Lit::Lamps(lamps) => lamplit(lamps, &places.in_camera, &seen.normal, &reflectance),
            Lit::Sun(day, shadows) => {
                let normal = self.turn * seen.normal;
                let sunlit = if normal.dot(&day.towards) > 0.0 {
                    shadows.sunlit(&places.in_world, &normal)
                } else {
                    [0.0; LANES]
                };
                let mirrored = material.gloss() > 0.0;
                let mirrored = mirrored.then(|| mirrored_sky(self, day, batch, seen));
                daylit(
                    &Outdoors {
                        day,
                        normal,
                        sunlit,
                        reflectance,
                        gloss: material.gloss(),
                        mirrored,
                    },
                    &places,
                )
            }
        };
        Shaded {
            light,
            depth_m: places.depth_m.map(|z| z as f32),
            facing: places.facing.map(|cosine| cosine as f32),
        }
    }

    /// What a camera makes of light.
    pub(super) fn developed(&self, light: &Colours) -> [Lanes<u8>; 3] {
        developed(light, self.exposure)
    }
}

vectorised! {
/// What a camera makes of light: its gamma of 2.2, nearly.
pub(super) fn developed(light: &Colours, exposure: f32) -> [Lanes<u8>; 3] {
    let mut levels = [[0; LANES]; 3];
    for c in 0..3 {
        for k in 0..LANES {
            let share = (light[c][k] * exposure).clamp(0.0, 1.0);
            levels[c][k] = floor(share.sqrt() * 255.0) as u8;
        }
    }
    levels
}
}

vectorised! {
fn places(view: &View<'_>, seen: &Seen<'_>, batch: &Batch) -> Places {
    let depth_m = lanes!(k => 1.0 / batch.inverse[k]);
    let length = lanes!(k => (batch.x[k] * batch.x[k] + batch.y[k] * batch.y[k] + 1.0).sqrt());
    let n = &seen.normal;
    let facing = lanes!(k => {
        let along: f64 = -(n.x * batch.x[k] + n.y * batch.y[k] + n.z);
        (along / length[k]).max(0.0)
    });
    let in_camera = [
        lanes!(k => batch.x[k] * depth_m[k]),
        lanes!(k => batch.y[k] * depth_m[k]),
        depth_m,
    ];
    let mut in_world = turned(&view.turn, &in_camera);
    for (axis, offset) in in_world.iter_mut().zip(view.place.iter()) {
        for place in axis {
            *place += offset;
        }
    }
    Places { depth_m, length, facing, in_camera, in_world }
}
}

vectorised! {
fn spots(view: &View<'_>, seen: &Seen<'_>, places: &Places) -> Spots {
    // A pixel covers depth/f metres across; seen at a slant, more.
    let footprint = lanes!(k => {
        (places.depth_m[k] / view.camera.fx / places.facing[k].max(0.1).sqrt()) as f32
    });
    let at = if seen.face.material.follows_the_world() {
        let [x, y, _] = &places.in_world;
        [lanes!(k => x[k] as f32), lanes!(k => y[k] as f32)]
    } else {
        let (u, v) = (&seen.u, &seen.v);
        let from_corner = [
            lanes!(k => places.in_camera[0][k] - seen.corner.x),
            lanes!(k => places.in_camera[1][k] - seen.corner.y),
            lanes!(k => places.in_camera[2][k] - seen.corner.z),
        ];
        let [x, y, z] = &from_corner;
        [
            lanes!(k => (x[k] * u.x + y[k] * u.y + z[k] * u.z) as f32),
            lanes!(k => (x[k] * v.x + y[k] * v.y + z[k] * v.z) as f32),
        ]
    };
    Spots::new(at, seen.size, footprint)
}
}

/// Vectors, turned: t = 2 q × v, v' = v + w t + q × t.
#[inline(always)]
fn turned(turn: &UnitQuaternion<f64>, [x, y, z]: &[Lanes<f64>; 3]) -> [Lanes<f64>; 3] {
    let q = turn.as_ref().coords;
    let mut all = [[0.0; LANES]; 3];
    for k in 0..LANES {
        let t = cross([q.x, q.y, q.z], [x[k], y[k], z[k]]);
        let t = [t[0] * 2.0, t[1] * 2.0, t[2] * 2.0];
        let s = cross([q.x, q.y, q.z], t);
        all[0][k] = t[0] * q.w + s[0] + x[k];
        all[1][k] = t[1] * q.w + s[1] + y[k];
        all[2][k] = t[2] * q.w + s[2] + z[k];
    }
    all
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

vectorised! {
fn sky(day: &Daylight<'_>, turn: &UnitQuaternion<f64>, batch: &Batch) -> Colours {
    let [x, y, z] = turned(turn, &[batch.x, batch.y, [1.0; LANES]]);
    let length = lanes!(k => (x[k] * x[k] + y[k] * y[k] + z[k] * z[k]).sqrt());
    day.sky_towards(&[
        lanes!(k => x[k] / length[k]),
        lanes!(k => y[k] / length[k]),
        lanes!(k => z[k] / length[k]),
    ])
}
}

/// What a smooth surface shows of the sky, and which share of its light that would be if all of it were mirrored.
struct Mirrored {
    sky: Colours,
    is_up: Lanes<bool>,
}

vectorised! {
fn mirrored_sky(view: &View<'_>, day: &Daylight<'_>, batch: &Batch, seen: &Seen<'_>) -> Mirrored {
    let normal = view.turn * seen.normal;
    let length = lanes!(k => (batch.x[k] * batch.x[k] + batch.y[k] * batch.y[k] + 1.0).sqrt());
    let [x, y, z] = turned(&view.turn, &[
        lanes!(k => batch.x[k] / length[k]),
        lanes!(k => batch.y[k] / length[k]),
        lanes!(k => 1.0 / length[k]),
    ]);
    let twice = lanes!(k => (normal.x * x[k] + normal.y * y[k] + normal.z * z[k]) * 2.0);
    let up = lanes!(k => z[k] - normal.z * twice[k]);
    let sky = day.sky_towards(&[
        lanes!(k => x[k] - normal.x * twice[k]),
        lanes!(k => y[k] - normal.y * twice[k]),
        up,
    ]);
    Mirrored { sky, is_up: lanes!(k => up[k] > 0.0) }
}
}

/// What the light on a face outdoors is made of.
struct Outdoors<'a> {
    day: &'a Daylight<'a>,
    normal: Vector3<f64>,
    sunlit: Lanes,
    reflectance: Colours,
    gloss: f32,
    mirrored: Option<Mirrored>,
}

vectorised! {
fn daylit(lit: &Outdoors<'_>, places: &Places) -> Colours {
    let falling = lit.day.on(&lit.normal);
    let mut colours = lit.reflectance;
    for k in 0..LANES {
        let light = lit.day.light(falling, lit.sunlit[k]);
        colours[0][k] *= light[0];
        colours[1][k] *= light[1];
        colours[2][k] *= light[2];
    }
    if let Some(mirrored) = &lit.mirrored {
        for k in 0..LANES {
            // Schlick's approximation of Fresnel's law.
            let away = 1.0 - places.facing[k] as f32;
            let squared = away * away;
            let share = lit.gloss + (1.0 - lit.gloss) * (away * (squared * squared));
            let share = share * if mirrored.is_up[k] { 1.0 } else { 0.2 };
            for c in 0..3 {
                colours[c][k] += (mirrored.sky[c][k] - colours[c][k]) * share;
            }
        }
    }
    for k in 0..LANES {
        let distance_m = (places.depth_m[k] * places.length[k]) as f32;
        let seen = [colours[0][k], colours[1][k], colours[2][k]];
        let seen = lit.day.through_air(seen, distance_m);
        colours[0][k] = seen[0];
        colours[1][k] = seen[1];
        colours[2][k] = seen[2];
    }
    colours
}
}

vectorised! {
/// Lambert's law for each lamp, and light from everywhere; lamps, places and normal in one frame.
pub(super) fn lamplit(
    lamps: &[Point3<f64>],
    places: &[Lanes<f64>; 3],
    normal: &Vector3<f64>,
    reflectance: &Colours,
) -> Colours {
    let [x, y, z] = places;
    let mut light = [0.0; LANES];
    for lamp in lamps {
        for k in 0..LANES {
            let to_lamp = [lamp.x - x[k], lamp.y - y[k], lamp.z - z[k]];
            let square =
                to_lamp[0] * to_lamp[0] + to_lamp[1] * to_lamp[1] + to_lamp[2] * to_lamp[2];
            let facing = normal.x * to_lamp[0] + normal.y * to_lamp[1] + normal.z * to_lamp[2];
            light[k] += 1.6 * (facing / square.sqrt()).max(0.0) / (1.0 + 0.35 * square);
        }
    }
    let mut colours = *reflectance;
    for colour in &mut colours {
        for k in 0..LANES {
            colour[k] *= (0.42 + light[k]) as f32;
        }
    }
    colours
}
}
