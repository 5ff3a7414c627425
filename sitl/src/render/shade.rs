//! What colour a surface has: its material, lit.

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::shadow::ShadowMap;
use super::{Moment, Seen};
use crate::scene::{Daylight, Instance, Light, Spot};

/// What is seen above the walls of a room.
const CEILING: [u8; 3] = [226, 231, 238];

#[derive(Clone, Copy, Default)]
pub(super) struct Pixel {
    pub(super) rgb: [u8; 3],
    pub(super) depth_m: f32,
    pub(super) facing: f32,
    pub(super) instance: Instance,
}

/// A camera in a scene, and the light there.
pub(super) struct View<'a> {
    pub(super) camera: &'a Pinhole,
    world_from_camera: Isometry<World, Camera>,
    turn: UnitQuaternion<f64>,
    light: Lit<'a>,
}

enum Lit<'a> {
    /// Where the lamps are, for the camera.
    Lamps(Vec<Point3<f64>>),
    Sun(Daylight<'a>, &'a ShadowMap),
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
        Self {
            camera,
            world_from_camera,
            turn: world_from_camera.raw.rotation,
            light,
        }
    }

    fn ray(&self, [column, row]: [f64; 2]) -> Vector3<f64> {
        let camera = self.camera;
        let [x, y] = [
            (column - camera.cx) / camera.fx,
            (row - camera.cy) / camera.fy,
        ];
        Vector3::new(x, y, 1.0)
    }

    /// A pixel that shows no surface.
    pub(super) fn sky(&self, at: [f64; 2]) -> Pixel {
        let rgb = match &self.light {
            Lit::Lamps(_) => CEILING,
            Lit::Sun(day, _) => {
                let direction = (self.turn * self.ray(at)).normalize();
                developed(day.sky_towards(&direction), day.sun.exposure)
            }
        };
        Pixel {
            rgb,
            ..Pixel::default()
        }
    }

    /// A pixel that shows a face.
    pub(super) fn surface(&self, at: [f64; 2], depth_m: f64, seen: &Seen<'_>) -> Pixel {
        let ray = self.ray(at);
        let p = ray * depth_m;
        let length = ray.norm();
        let facing = (-seen.normal.dot(&ray) / length).max(0.0);
        let material = seen.face.material;
        // A pixel covers depth/f metres across; seen at a slant, more.
        let footprint = (depth_m / self.camera.fx / facing.max(0.1).sqrt()) as f32;
        let in_world = self.world_from_camera.raw * Point3::from(p);
        let [u, v] = if material.follows_the_world() {
            [in_world.x, in_world.y]
        } else {
            let from_corner = p - seen.corner;
            [from_corner.dot(&seen.u), from_corner.dot(&seen.v)]
        };
        let spot = Spot {
            u: u as f32,
            v: v as f32,
            size: seen.size,
            footprint,
        };
        let reflectance = material.reflectance(spot);
        let rgb = match &self.light {
            Lit::Lamps(lamps) => {
                let light = lamplight(lamps, &p, &seen.normal);
                developed(reflectance.map(|share| share * light), 1.0)
            }
            Lit::Sun(day, shadows) => {
                let normal = self.turn * seen.normal;
                let sunlit = if normal.dot(&day.towards) > 0.0 {
                    shadows.sunlit(in_world, &normal)
                } else {
                    0.0
                };
                let light = day.on(&normal, sunlit);
                let mut colour = [0, 1, 2].map(|c| reflectance[c] * light[c]);
                let gloss = material.gloss();
                if gloss > 0.0 {
                    let towards = self.turn * (ray / length);
                    let mirrored = towards - normal * (2.0 * normal.dot(&towards));
                    let sky = day.sky_towards(&mirrored);
                    // Schlick's approximation of Fresnel's law.
                    let share = gloss + (1.0 - gloss) * (1.0 - facing as f32).powi(5);
                    let share = share * if mirrored.z > 0.0 { 1.0 } else { 0.2 };
                    colour = [0, 1, 2].map(|c| colour[c] + (sky[c] - colour[c]) * share);
                }
                let distance_m = (depth_m * length) as f32;
                developed(day.through_air(colour, distance_m), day.sun.exposure)
            }
        };
        Pixel {
            rgb,
            depth_m: depth_m as f32,
            facing: facing as f32,
            instance: seen.face.instance,
        }
    }
}

/// What a camera makes of light: its gamma of 2.2, nearly.
pub(super) fn developed(light: [f32; 3], exposure: f32) -> [u8; 3] {
    light.map(|share| ((share * exposure).clamp(0.0, 1.0).sqrt() * 255.0) as u8)
}

/// Lambert's law for each lamp, and light from everywhere.
pub(super) fn lamplight(lamps: &[Point3<f64>], p: &Vector3<f64>, normal: &Vector3<f64>) -> f32 {
    let lamps: f64 = lamps
        .iter()
        .map(|lamp| {
            let to_lamp = lamp.coords - p;
            let square = to_lamp.norm_squared();
            1.6 * (normal.dot(&to_lamp) / square.sqrt()).max(0.0) / (1.0 + 0.35 * square)
        })
        .sum();
    (0.42 + lamps) as f32
}
