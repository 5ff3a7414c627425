//! What a real camera makes of the light: rolling shutter, motion blur, exposure and the noise of its pixels.
//!
//! A pixel turns light into electrons, which gain turns into grey levels. Per EMVA 1288 their variance is
//!
//! ```text
//! σ_y² = K² σ_d² + K μ_y        K = gain / full well        y: share of full scale
//! ```
//!
//! of which the first term is read noise and the second the noise of the photons themselves. Only then comes the gamma.
//! Blur is the mean of several pictures taken within the exposure, in linear light. Automatic exposure looks at the last
//! picture and moves towards its target as far as the time since then allows. All of it is a function of seed, moment and
//! the pictures before.
//!
//! Depth, facing and instance are those of the middle of each row's exposure: as true as an instant can be of a blur.
//!
//! - EMVA Standard 1288, *Standard for Characterization of Image Sensors and Cameras*: the linear model, without its noise
//!   of quantisation, which comes with the rounding to grey levels.
//! - C. Geyer, M. Meingast, S. Sastry, *Geometric Models of Rolling-Shutter Cameras*, OMNIVIS 2005.

mod exposure;

use std::time::Duration;

use maps::camera::Pinhole;
use maps::time::Stamp;
use rayon::prelude::*;

pub use exposure::{Automatic, Exposure, Setting};

use crate::lanes::vectorised;
use crate::noise::{at_cell, floor, mix, normal};
use crate::render::{Picture, PoseAt, Radiance, Readout, Stage};

/// How a camera gathers light and reads it out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// How long it takes to read out all rows, from the top one on; zero is a global shutter.
    pub readout: Duration,
    /// How long light is gathered, and how much it is amplified.
    pub exposure: Exposure,
    /// How many pictures a blurred one is the mean of, an odd number: best as many as the blur has pixels. Drawing takes
    /// as many times longer. One does not blur.
    pub blur_samples: u32,
    /// Its pixels; `None` for ones without noise.
    pub photosites: Option<Photosites>,
}

/// What the pixels of a sensor are like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Photosites {
    /// Electrons at full scale when the gain is 1.
    pub full_well_e: f32,
    /// Standard deviation of what reading adds, in electrons.
    pub read_noise_e: f32,
}

impl Optics {
    /// No time passes while light is gathered and read out, and there is no noise: the picture of
    /// [`Moment::picture`](crate::render::Moment::picture), byte for byte.
    pub const IDEAL: Self = Self {
        readout: Duration::ZERO,
        exposure: Exposure::Scene,
        blur_samples: 1,
        photosites: None,
    };
    /// A global shutter with automatic exposure, blur and noise.
    pub const GLOBAL_SHUTTER: Self = Self {
        readout: Duration::ZERO,
        exposure: Exposure::Automatic(Automatic::USUAL),
        blur_samples: 5,
        photosites: Some(Photosites::SMALL),
    };
    /// The same with rows that are read out one after the other in 20 ms.
    pub const ROLLING_SHUTTER: Self = Self {
        readout: Duration::from_millis(20),
        ..Self::GLOBAL_SHUTTER
    };
}

impl Photosites {
    /// Assumed for a small machine-vision sensor; no data sheet's figures.
    pub const SMALL: Self = Self {
        full_well_e: 10_000.0,
        read_noise_e: 4.0,
    };
}

/// Why a camera cannot be built like that.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum OpticsError {
    /// The truth is that of the middle sample.
    #[error("blur_samples is {0}: take an odd number from 1 to {most}", most = Self::MOST_SAMPLES)]
    Samples(u32),
    /// Longer than a picture of a moving camera can sensibly take.
    #[error("the {what} time is {} s: take at most {} s", given.as_secs_f64(), Self::LONGEST.as_secs_f64())]
    Time {
        /// Which time.
        what: &'static str,
        /// How long it is.
        given: Duration,
    },
    /// Of automatic exposure.
    #[error("the shortest exposure is {} s and the longest {} s: take more than 0 for the first and no less for the other", from.as_secs_f64(), to.as_secs_f64())]
    Limits {
        /// The shortest exposure.
        from: Duration,
        /// The longest exposure.
        to: Duration,
    },
    /// Of a number that must be finite and more than 0, or as its name says.
    #[error("{what} is {given}: take {remedy}")]
    Number {
        /// Which number.
        what: &'static str,
        /// What it is.
        given: f32,
        /// What it may be.
        remedy: &'static str,
    },
}

impl OpticsError {
    /// Most samples of a blur.
    const MOST_SAMPLES: u32 = 63;
    /// Longest exposure and readout.
    const LONGEST: Duration = Duration::from_secs(1);

    fn time(what: &'static str, given: Duration) -> Result<(), Self> {
        if given > Self::LONGEST {
            return Err(Self::Time { what, given });
        }
        Ok(())
    }

    fn positive(what: &'static str, given: f32) -> Result<(), Self> {
        if given.is_finite() && given > 0.0 {
            return Ok(());
        }
        Err(Self::Number {
            what,
            given,
            remedy: "a finite number above 0",
        })
    }
}

impl Optics {
    fn check(&self) -> Result<(), OpticsError> {
        let samples = self.blur_samples;
        if samples.is_multiple_of(2) || samples > OpticsError::MOST_SAMPLES {
            return Err(OpticsError::Samples(samples));
        }
        OpticsError::time("readout", self.readout)?;
        self.exposure.check()?;
        if let Some(photosites) = &self.photosites {
            OpticsError::positive("full_well_e", photosites.full_well_e)?;
            let given = photosites.read_noise_e;
            if !given.is_finite() || given < 0.0 {
                return Err(OpticsError::Number {
                    what: "read_noise_e",
                    given,
                    remedy: "a finite number that is not below 0",
                });
            }
        }
        Ok(())
    }
}

/// A camera that takes one picture after the other.
#[derive(Clone, Debug)]
pub struct CameraModel {
    lens: Pinhole,
    optics: Optics,
    seed: u64,
    setting: Setting,
    /// When the last picture was taken, and its mean level, from 0 to 1.
    last: Option<(Stamp, f32)>,
}

/// What a camera took.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The picture with its truth.
    pub picture: Picture,
    /// When each row was exposed.
    pub readout: Readout,
    /// How long, and how much the light was amplified; `None` for the scene's own exposure.
    pub setting: Option<Setting>,
}

impl CameraModel {
    /// A camera; the seed varies its noise.
    pub fn new(lens: Pinhole, optics: Optics, seed: u64) -> Result<Self, OpticsError> {
        optics.check()?;
        Ok(Self {
            lens,
            optics,
            seed,
            setting: optics.exposure.start(),
            last: None,
        })
    }

    /// How it is built.
    pub fn optics(&self) -> &Optics {
        &self.optics
    }

    /// Takes a picture, the middle row of which is exposed around `at`, by a camera that is where `pose_at` says.
    pub fn shoot(&mut self, stage: &Stage<'_>, at: Stamp, pose_at: &PoseAt<'_>) -> Shot {
        let readout = Readout {
            at,
            duration: self.optics.readout,
            rows: self.lens.height,
        };
        if self.optics == Optics::IDEAL {
            return Shot {
                picture: stage.at(at).picture(&self.lens, pose_at(at)),
                readout,
                setting: None,
            };
        }
        if let (Exposure::Automatic(automatic), Some((before, level))) =
            (&self.optics.exposure, self.last)
        {
            self.setting = automatic.after(self.setting, level, at.since(before));
        }
        let setting = match self.optics.exposure {
            Exposure::Scene => None,
            Exposure::Fixed(_) | Exposure::Automatic(_) => Some(self.setting),
        };
        let radiance = self.gather(stage, readout, setting, pose_at);
        let factor = setting.map_or(stage.exposure(), Setting::factor);
        let rgb = self.develop(
            &radiance,
            factor,
            setting.map_or(1.0, |setting| setting.gain),
        );
        self.last = Some((at, mean_level(&rgb)));
        Shot {
            picture: radiance.with_colours(rgb),
            readout,
            setting,
        }
    }

    /// The mean light over the exposure, with the truth of its middle.
    fn gather(
        &self,
        stage: &Stage<'_>,
        readout: Readout,
        setting: Option<Setting>,
        pose_at: &PoseAt<'_>,
    ) -> Radiance {
        let time = setting.map_or(Duration::ZERO, |setting| setting.time);
        let mut radiance = stage.scan(&self.lens, readout, pose_at);
        let samples = self.optics.blur_samples;
        if time.is_zero() || samples == 1 {
            return radiance;
        }
        for sample in (0..samples).filter(|sample| *sample != samples / 2) {
            // As the rows of a picture, samples are spread evenly around its middle.
            let spread = Readout {
                at: readout.at,
                duration: time,
                rows: samples as usize,
            };
            let moved = Readout {
                at: spread.time_of(sample as usize),
                ..readout
            };
            let light = stage.scan(&self.lens, moved, pose_at).light;
            let sum = radiance.light.as_flattened_mut().iter_mut();
            for (sum, light) in sum.zip(light.as_flattened()) {
                *sum += light;
            }
        }
        for light in radiance.light.as_flattened_mut() {
            *light /= samples as f32;
        }
        radiance
    }

    fn develop(&self, radiance: &Radiance, factor: f32, gain: f32) -> Vec<[u8; 3]> {
        let moment = radiance.at.as_nanos() ^ self.seed.rotate_left(32) ^ self.seed;
        let film = Film {
            factor,
            noise: self.optics.photosites.map(|photosites| Noise {
                share_per_electron: gain / photosites.full_well_e,
                read_noise_e: photosites.read_noise_e,
                seed: mix(mix(moment as u32) ^ (moment >> 32) as u32) ^ mix(41),
            }),
        };
        let mut rgb = vec![[0; 3]; radiance.light.len()];
        let width = radiance.width.max(1);
        let rows = rgb.par_chunks_mut(width);
        let rows = rows.zip(radiance.light.par_chunks(width)).enumerate();
        rows.for_each(|(row, (rgb, light))| {
            film.expose(row, light.as_flattened(), rgb.as_flattened_mut());
        });
        rgb
    }
}

/// What makes grey levels of light.
struct Film {
    /// Light times this is the share of full scale.
    factor: f32,
    noise: Option<Noise>,
}

#[derive(Clone, Copy)]
struct Noise {
    share_per_electron: f32,
    read_noise_e: f32,
    seed: u32,
}

impl Film {
    fn expose(&self, row: usize, light: &[f32], levels: &mut [u8]) {
        match self.noise {
            None => clean(self.factor, light, levels),
            Some(noise) => noisy(self.factor, noise, row, light, levels),
        }
    }
}

/// A gamma of 2.2, nearly, as ideal pictures have.
#[expect(
    clippy::inline_always,
    reason = "so that loops over it become vector instructions"
)]
#[inline(always)]
fn level(share: f32) -> u8 {
    floor(share.clamp(0.0, 1.0).sqrt() * 255.0) as u8
}

vectorised! {
fn clean(factor: f32, light: &[f32], levels: &mut [u8]) {
    for (level_of, light) in levels.iter_mut().zip(light) {
        *level_of = level(light * factor);
    }
}
}

vectorised! {
fn noisy(factor: f32, noise: Noise, row: usize, light: &[f32], levels: &mut [u8]) {
    let row = (row as u32).cast_signed();
    let read_variance = noise.read_noise_e * noise.read_noise_e;
    for (i, (level_of, light)) in (0_i32..).zip(levels.iter_mut().zip(light)) {
        let electrons = light * factor / noise.share_per_electron;
        let sigma = (electrons.max(0.0) + read_variance).sqrt();
        let measured = electrons + sigma * normal(at_cell(i, row, noise.seed));
        *level_of = level(measured * noise.share_per_electron);
    }
}
}

/// From 0 to 1.
fn mean_level(rgb: &[[u8; 3]]) -> f32 {
    let sum: u64 = rgb
        .as_flattened()
        .iter()
        .map(|&level| u64::from(level))
        .sum();
    (sum as f64 / (rgb.len() * 3).max(1) as f64 / 255.0) as f32
}

#[cfg(test)]
mod tests;
