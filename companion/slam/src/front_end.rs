//! What can be found in a frame before anything is known of where it was taken: a pure function of the frame, so that
//! another thread can do it for the next frame while this one is tracked.

use std::sync::Arc;

use maps::camera::{Pinhole, RgbdFrame};
use maps::time::Stamp;

use crate::coarse::Coarse;
use crate::features::{DepthRange, Extractor, Feature};
use crate::optics::Optics;
use crate::settings::Settings;
use crate::tracked::FrameError;

/// Finds features in frames. Clones share their tables.
#[derive(Clone)]
pub struct FrontEnd {
    pub(crate) optics: Arc<Optics>,
    extractor: Arc<Extractor>,
    pub(crate) depths: DepthRange,
}

/// What was found in a frame.
pub struct Look {
    pub(crate) at: Stamp,
    pub(crate) features: Vec<Feature>,
    pub(crate) coarse: Coarse,
}

impl FrontEnd {
    /// For this camera.
    pub fn new(camera: Pinhole, settings: &Settings) -> Self {
        Self {
            optics: Arc::new(Optics::new(camera)),
            extractor: Arc::new(Extractor::new(settings.features)),
            depths: DepthRange {
                min_m: settings.min_depth_m as f32,
                max_m: settings.max_depth_m as f32,
            },
        }
    }

    /// Finds corners, describes them, and reads the depth image on a coarse grid.
    pub fn look(&self, frame: &RgbdFrame) -> Result<Look, FrameError> {
        self.check(frame)?;
        Ok(Look {
            at: frame.at,
            features: self.extractor.extract(&self.optics, frame, self.depths),
            coarse: Coarse::new(&self.optics, frame, self.depths),
        })
    }

    fn check(&self, frame: &RgbdFrame) -> Result<(), FrameError> {
        let camera = &self.optics.camera;
        if (frame.width, frame.height) != (camera.width, camera.height) {
            return Err(FrameError::Size {
                found_width: frame.width,
                found_height: frame.height,
                width: camera.width,
                height: camera.height,
            });
        }
        let expected = frame.width * frame.height;
        if frame.rgb.len() != expected || frame.depth_m.len() != expected {
            return Err(FrameError::Length {
                expected,
                rgb: frame.rgb.len(),
                depth: frame.depth_m.len(),
            });
        }
        Ok(())
    }
}
