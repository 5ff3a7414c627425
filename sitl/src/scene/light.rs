//! What lights a scene: lamps indoors, sun and sky outdoors.
//!
//! Light is linear and has no unit: 1 on a white surface makes the sensor's full scale before its exposure. A sky without
//! clouds is brighter towards the horizon and around the sun; distance fades into it.
//!
//! - A. J. Preetham, P. Shirley, B. Smits, *A Practical Analytic Model for Daylight*, SIGGRAPH 1999 (what varies with what).

use nalgebra::Vector3;

use crate::noise::octaves;

pub(crate) type Colour = [f32; 3];

/// What lights a scene.
#[derive(Clone, Debug)]
pub enum Light {
    /// Lamps under the ceiling, at these places.
    Lamps(Vec<[f64; 3]>),
    /// The sun, and a sky around it.
    Sun(Sun),
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

    /// What a surface with this normal gets, by the share of the sun that reaches it: Lambert's law, and a sky that is
    /// half hidden from a wall; the ground gives some of it back from below.
    pub(crate) fn on(&self, normal: &Vector3<f64>, sunlit: f32) -> Colour {
        let facing = normal.dot(&self.towards).max(0.0) as f32 * sunlit;
        let up = 0.5 + 0.5 * normal.z as f32;
        let around = 0.3 + 0.7 * up;
        [0, 1, 2].map(|c| self.sun.direct[c] * facing + self.sun.sky[c] * around)
    }

    /// What is seen where nothing is, in a direction of unit length.
    pub(crate) fn sky_towards(&self, direction: &Vector3<f64>) -> Colour {
        let sun = self.sun;
        let up = direction.z.max(0.0) as f32;
        let near_sun = direction.dot(&self.towards).max(0.0) as f32;
        let glow = near_sun.powi(8) * 0.5 + near_sun.powi(400) * 20.0;
        let horizon = 1.35 - 0.6 * up.sqrt();
        let flat = (direction.z.max(0.03)) as f32;
        let [x, y] = [direction.x as f32 / flat, direction.y as f32 / flat];
        // Clouds lie on a plane above; towards the horizon they are too fine to be told apart.
        let clouds = (octaves(x * 0.9, y * 0.9, 4, 0.2 / flat.min(1.0), sun.seed) * 1.6)
            .clamp(0.0, 0.8)
            * (up * 6.0).min(1.0);
        let blue = [0.62, 0.78, 1.0];
        [0, 1, 2].map(|c| {
            let air = sun.sky[c] * blue[c] * horizon * 1.6;
            let cloud = sun.sky[c] * 1.9 + sun.direct[c] * 0.25;
            air + (cloud - air) * clouds + sun.direct[c] * glow
        })
    }

    /// A colour seen through so many metres of air, which distance fades into.
    pub(crate) fn through_air(&self, colour: Colour, distance_m: f32) -> Colour {
        let sun = self.sun;
        // Near enough to an exponential for the distances of a street.
        let clear = 1.0 / (1.0 + sun.haze * distance_m / 100.0);
        [0, 1, 2].map(|c| {
            let air = sun.sky[c] * 1.25 + sun.direct[c] * 0.06;
            air + (colour[c] - air) * clear
        })
    }
}
