//! What an inertial unit says during a simulated flight, in a file beside the pictures.
//!
//! ```text
//! at ωx ωy ωz fx fy fz
//! ```
//!
//! One sample a line, 200 a second: seconds, angular velocity in rad/s and specific force in m/s² in the axes of the body, in whose
//! middle the unit is. With the errors of a flight controller's unit, but without the shaking of a frame.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use maps::frame::{Body, Camera, Isometry};
use maps::time::Stamp;
use nalgebra::Vector3;
use sensors::beside::Collector;
use sensors::ros::vehicle::Imu as Sample;
use sitl::platform::Platform;
use sitl::scene::Scene;
use sitl::sensor::imu::{Imu, ImuModel, specific_force};
use slam::{Aid, Felt};

use super::columns;

const PERIOD: Duration = Duration::from_millis(5);

/// The file in the folder of a recording.
pub(super) fn file(recording: &Path) -> PathBuf {
    recording.join("imu.txt")
}

/// Leaves what the unit says until the last picture in `folder`.
pub(super) fn film(
    scene: &Scene,
    stamps: &[Stamp],
    seed: u64,
    folder: &Path,
) -> anyhow::Result<()> {
    let mut unit = Imu::new(ImuModel::ICM_42688_P, seed);
    let mut text = String::new();
    let (mut at, last) = (Stamp::ZERO, stamps.last().copied().unwrap_or(Stamp::ZERO));
    while at <= last {
        let (motion, acceleration) = Platform::Uav.motion(scene, at, seed);
        let force = specific_force(&motion.world_from_body.rotation(), acceleration);
        let sample = unit.measure(motion.rates, force, PERIOD.as_secs_f64());
        let (w, f) = (sample.rates.raw, sample.specific_force.raw);
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{at} {:.7} {:.7} {:.7} {:.6} {:.6} {:.6}",
            w.x, w.y, w.z, f.x, f.y, f.z
        );
        at += PERIOD;
    }
    let path = file(folder);
    fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// Samples that are still to come.
pub(super) struct Inertial {
    waiting: VecDeque<Sample<'static>>,
    collector: Collector,
    camera_from_body: Isometry<Camera, Body>,
}

impl Inertial {
    pub(super) fn read(
        path: &Path,
        body_from_camera: &Isometry<Body, Camera>,
    ) -> anyhow::Result<Self> {
        let line = |[at, wx, wy, wz, fx, fy, fz]: [f64; 7]| {
            Some(Sample {
                at: Stamp::from_secs_f64(at)?,
                frame_id: "imu",
                rates: Vector3::new(wx, wy, wz),
                rates_variance: 0.0,
                specific_force: Vector3::new(fx, fy, fz),
                specific_force_variance: 0.0,
            })
        };
        Ok(Self {
            waiting: columns::read(path, "sample", line)?.into(),
            collector: Collector::default(),
            camera_from_body: body_from_camera.inverse(),
        })
    }

    /// Tells the aid what was measured between the frame before and this one.
    pub(super) fn tell(&mut self, frame: Stamp, aid: &mut Aid<'_>) {
        while let Some(sample) = self.waiting.pop_front_if(|sample| sample.at <= frame) {
            self.collector.add_imu(&sample);
        }
        let beside = self.collector.until(frame);
        let axes = self.camera_from_body.rotation();
        aid.turned = beside.turned.map(|turn| axes * turn * axes.inverse());
        aid.felt = beside.specific_force.map(|force| Felt {
            specific_force: axes * force,
            unit_in_camera: self.camera_from_body.raw.translation.vector,
        });
    }
}
