//! What lights a scene: lamps indoors, sun and sky outdoors.
//!
//! Light is linear and has no unit: 1 on a white surface makes the sensor's full scale before its exposure. A sky without
//! clouds is brighter towards the horizon and around the sun; distance fades into it.
//!
//! - A. J. Preetham, P. Shirley, B. Smits, *A Practical Analytic Model for Daylight*, SIGGRAPH 1999 (what varies with what).

#![expect(
    clippy::inline_always,
    reason = "loops over these become vector instructions only if all of them is in the loop"
)]

use nalgebra::Vector3;

use super::Colours;
use crate::lanes::{LANES, Lanes, lanes};
use crate::noise::octaves_at;

/// What lights a scene.
#[derive(Clone, Debug)]
pub enum Light {
    /// Lamps under the ceiling, at these places.
    Lamps(Vec<[f64; 3]>),
    /// The sun, and a sky around it.
    Sun(Sun),
}

impl Light {
    /// What the camera makes of light: its exposure, as a factor.
    pub fn exposure(&self) -> f32 {
        match self {
            Self::Lamps(_) => 1.0,
            Self::Sun(sun) => sun.exposure,
        }
    }
}

/// The sun and its sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// How far it is above the horizon.
    pub elevation_rad: f64,
    /// Where it is, counter-clockwise from east.
    pub azimuth_rad: f64,
    /// What it adds to a surface that faces it.
    pub direct: [f32; 3],
    /// What the sky adds to a surface that faces upwards.
    pub sky: [f32; 3],
    /// What the camera makes of light: its exposure, as a factor.
    pub exposure: f32,
    /// Share of contrast that is lost over 100 m.
    pub haze: f32,
    /// Varies the clouds.
    pub seed: u32,
}

impl Sun {
    /// Towards the sun, in the world, of unit length.
    pub fn direction(&self) -> Vector3<f64> {
        let (up, flat) = self.elevation_rad.sin_cos();
        let (north, east) = self.azimuth_rad.sin_cos();
        Vector3::new(flat * east, flat * north, up)
    }
}

/// How much of sun and sky falls on a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Falling {
    facing: f32,
    around: f32,
}

/// The sun over a picture: what is the same for all of its pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Daylight<'a> {
    pub(crate) sun: &'a Sun,
    /// Towards the sun, of unit length.
    pub(crate) towards: Vector3<f64>,
}

impl<'a> Daylight<'a> {
    pub(crate) fn of(sun: &'a Sun) -> Self {
        let towards = sun.direction();
        Self { sun, towards }
    }

    /// What a surface with this normal gets of them: Lambert's law, and a sky that is
    /// half hidden from a wall; the ground gives some of it back from below.
    pub(crate) fn on(&self, normal: &Vector3<f64>) -> Falling {
        let facing = normal.dot(&self.towards).max(0.0) as f32;
        let up = 0.5 + 0.5 * normal.z as f32;
        Falling {
            facing,
            around: 0.3 + 0.7 * up,
        }
    }

    /// The light on a surface of whose sun that share is left.
    #[inline(always)]
    pub(crate) fn light(&self, falling: Falling, sunlit: f32) -> [f32; 3] {
        let facing = falling.facing * sunlit;
        let of = |c: usize| self.sun.direct[c] * facing + self.sun.sky[c] * falling.around;
        [of(0), of(1), of(2)]
    }

    /// What is seen where nothing is, in directions of unit length.
    #[inline(always)]
    pub(crate) fn sky_towards(&self, direction: &[Lanes<f64>; 3]) -> Colours {
        let sun = self.sun;
        let [east, north, up] = direction;
        let flat = lanes!(k => up[k].max(0.03) as f32);
        let x = lanes!(k => east[k] as f32 / flat[k] * 0.9);
        let y = lanes!(k => north[k] as f32 / flat[k] * 0.9);
        let fineness = lanes!(k => 0.2 / flat[k].min(1.0));
        let finest = fineness.iter().copied().fold(f32::INFINITY, f32::min);
        // Clouds lie on a plane above; towards the horizon they are too fine to be told apart.
        let clouds = octaves_at([&x, &y, &fineness], finest, 4, sun.seed);
        let towards = self.towards;
        let blue = [0.62, 0.78, 1.0];
        let mut colours = [[0.0; LANES]; 3];
        for k in 0..LANES {
            let near_sun =
                (east[k] * towards.x + north[k] * towards.y + up[k] * towards.z).max(0.0) as f32;
            let up = up[k].max(0.0) as f32;
            let clouds = (clouds[k] * 1.6).clamp(0.0, 0.8) * (up * 6.0).min(1.0);
            let horizon = 1.35 - 0.6 * up.sqrt();
            let [to_8, to_400] = eighth_and_400th(near_sun);
            let glow = to_8 * 0.5 + to_400 * 20.0;
            for c in 0..3 {
                let air = sun.sky[c] * blue[c] * horizon * 1.6;
                let cloud = sun.sky[c] * 1.9 + sun.direct[c] * 0.25;
                colours[c][k] = air + (cloud - air) * clouds + sun.direct[c] * glow;
            }
        }
        colours
    }

    /// A colour seen through so many metres of air, which distance fades into.
    #[inline(always)]
    pub(crate) fn through_air(&self, colour: [f32; 3], distance_m: f32) -> [f32; 3] {
        let sun = self.sun;
        // Near enough to an exponential for the distances of a street.
        let clear = 1.0 / (1.0 + sun.haze * distance_m / 100.0);
        let through = |c: usize| {
            let air = sun.sky[c] * 1.25 + sun.direct[c] * 0.06;
            air + (colour[c] - air) * clear
        };
        [through(0), through(1), through(2)]
    }
}

/// Powers of a number: `f32::powi` calls a function for them, which no vector instruction does.
#[inline(always)]
fn eighth_and_400th(x: f32) -> [f32; 2] {
    let to_2 = x * x;
    let to_4 = to_2 * to_2;
    let to_8 = to_4 * to_4;
    let to_16 = to_8 * to_8;
    let to_32 = to_16 * to_16;
    let to_64 = to_32 * to_32;
    let to_128 = to_64 * to_64;
    let to_256 = to_128 * to_128;
    [to_8, to_16 * to_128 * to_256]
}
