//! What satellite receivers say during a simulated flight, in a file beside the pictures.
//!
//! ```text
//! comes at east north up sigma_horizontal sigma_vertical
//! ```
//!
//! One position a line: when it comes and of when it is, in seconds; where the body is, and how well the receiver believes to
//! know that, in metres.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::Context as _;
use maps::frame::{Body, Camera, Isometry};
use maps::time::Stamp;
use nalgebra::{Matrix3, Vector3};
use sitl::platform::Platform;
use sitl::rays::Rays;
use sitl::scene::Scene;
use sitl::sensor::gnss::{Receiver, ReceiverModel, Sky};
use slam::Fix;

use super::columns;

/// The receivers that are flown, by the ending of the methods that use them.
pub(super) fn receivers() -> [(&'static str, ReceiverModel); 2] {
    [("m8n", ReceiverModel::m8n()), ("rtk", ReceiverModel::rtk())]
}

/// The file of a receiver in the folder of a recording.
pub(super) fn file(receiver: &str) -> String {
    format!("gnss-{receiver}.txt")
}

/// Flies all receivers over a street and leaves their files in `folder`.
pub(super) fn film(
    scene: &Scene,
    stamps: &[Stamp],
    seed: u64,
    folder: &Path,
) -> anyhow::Result<()> {
    let rays = Rays::new(scene);
    for (name, model) in receivers() {
        let mut receiver = Receiver::new(model, seed);
        let mut text = String::new();
        for at in stamps {
            let (motion, _acceleration) = Platform::Uav.motion(scene, *at, seed);
            let sky = if receiver.is_due(*at) {
                Sky::over(&rays.at(*at), motion.position().raw)
            } else {
                Sky::HIDDEN
            };
            let Some(reading) = receiver.step(*at, &motion, sky) else {
                continue;
            };
            if let Some(solution) = reading.solution {
                let [east, north, up] = solution.position.raw.coords.into();
                // Writing to a string cannot fail.
                let _ = writeln!(
                    text,
                    "{at} {} {east:.4} {north:.4} {up:.4} {:.4} {:.4}",
                    reading.at, solution.horizontal_accuracy_m, solution.vertical_accuracy_m
                );
            }
        }
        let path = folder.join(file(name));
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Positions that are still to come.
pub(super) struct Positions {
    waiting: VecDeque<(Stamp, Fix)>,
}

impl Positions {
    pub(super) fn read(
        path: &Path,
        body_from_camera: &Isometry<Body, Camera>,
    ) -> anyhow::Result<Self> {
        let antenna_in_camera = body_from_camera.raw.inverse().translation.vector;
        let line = |[comes, at, east, north, up, horizontal, vertical]: [f64; 7]| {
            let variances = Vector3::new(horizontal, horizontal, vertical).map(|s| s * s);
            let fix = Fix {
                at: Stamp::from_secs_f64(at)?,
                position: Vector3::new(east, north, up),
                covariance: Matrix3::from_diagonal(&variances),
                antenna_in_camera,
            };
            Some((Stamp::from_secs_f64(comes)?, fix))
        };
        let waiting = columns::read(path, "position", line)?.into();
        Ok(Self { waiting })
    }

    /// The newest of those that have come by then and were not taken.
    pub(super) fn until(&mut self, now: Stamp) -> Option<Fix> {
        let mut newest = None;
        while let Some((_, fix)) = self.waiting.pop_front_if(|(comes, _)| *comes <= now) {
            newest = Some(fix);
        }
        newest
    }
}
