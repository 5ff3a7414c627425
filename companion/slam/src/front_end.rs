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

/// How much farther than for the map depth is believed as a witness of free space: its noise, which grows with the square
/// of the distance, is allowed for there.
const FREE_SPACE: f32 = 2.0;

/// Finds features in frames. Clones share their tables.
#[derive(Clone)]
pub struct FrontEnd {
    pub(crate) optics: Arc<Optics>,
    extractor: Arc<Extractor>,
    pub(crate) depths: DepthRange,
    /// Depth too rough for the map is good enough to tell what is empty.
    free_space: DepthRange,
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
        let (min_m, max_m) = (settings.min_depth_m as f32, settings.max_depth_m as f32);
        Self {
            optics: Arc::new(Optics::new(camera)),
            extractor: Arc::new(Extractor::new(settings.features)),
            depths: DepthRange { min_m, max_m },
            free_space: DepthRange {
                min_m,
                max_m: FREE_SPACE * max_m,
            },
        }
    }

    /// Finds corners, describes them, and reads the depth image on a coarse grid.
    pub fn look(&self, frame: &RgbdFrame) -> Result<Look, FrameError> {
        self.check(frame)?;
        Ok(Look {
            at: frame.at,
            features: self.extractor.extract(&self.optics, frame, self.depths),
            coarse: Coarse::new(&self.optics, frame, self.free_space),
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
