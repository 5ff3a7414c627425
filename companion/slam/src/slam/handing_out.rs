//! What dense mapping is told of.

use std::sync::Arc;

use maps::frame::Isometry;

use super::Slam;
use crate::dense::{DenseKeyframe, DenseUpdate};
use crate::dynamics;
use crate::map::{Keyframe, KeyframeId, Standing};
use crate::mapping;
use crate::settings::Moving;

impl Slam {
    /// Takes the keyframes that have left the window of bundle adjustment since the last call, oldest first. After poses
    /// were corrected by more than that, those are all keyframes there are. Keyframes of a map whose place in the world is
    /// not known are held back until it is.
    pub fn take_keyframes(&mut self) -> DenseUpdate {
        DenseUpdate {
            anew: std::mem::take(&mut self.back.anew),
            keyframes: std::mem::take(&mut self.settled),
        }
    }

    /// Ends the recording: all keyframes that were not yet taken.
    pub fn finish(&mut self) -> DenseUpdate {
        self.take_adjustment();
        while let Some(id) = self.window.pop_front() {
            self.settle(id);
        }
        self.take_keyframes()
    }

    /// A keyframe leaves the window: its mask is judged once more by all that was seen since, and it is handed out.
    pub(super) fn settle(&mut self, id: KeyframeId) {
        self.map.keep_unbent(id);
        let mut seen_through = Vec::new();
        if self.settings.moving == Moving::Reject {
            seen_through = dynamics::reconsider(&self.optics, &mut self.map, id);
            mapping::forget_masked(&self.optics, &mut self.map, id);
        }
        let joined = self.map.standing == Standing::Joined;
        if let Some(k) = self.map.keyframes.get_mut(&id)
            && let Some(pending) = k.pending.take()
        {
            k.surface = Some(Arc::new(
                pending.surface(&self.optics, (&k.coarse, &seen_through)),
            ));
            let dense = dense(k, &self.optics.camera);
            self.settled.extend(dense.filter(|_| joined));
        }
    }

    /// Poses were corrected: everything is handed out once more.
    pub(super) fn hand_out_anew(&mut self) {
        if self.map.standing == Standing::Adrift {
            return;
        }
        let camera = &self.optics.camera;
        let keyframes = self.map.keyframes.values();
        self.settled = keyframes.filter_map(|k| dense(k, camera)).collect();
        self.settled.sort_by_key(|k| k.at);
        self.back.anew = true;
    }
}

fn dense(k: &Keyframe, camera: &maps::camera::Pinhole) -> Option<DenseKeyframe> {
    Some(DenseKeyframe {
        at: k.at,
        world_from_camera: Isometry::claim(k.world_from_camera),
        camera: *camera,
        surface: Arc::clone(k.surface.as_ref()?),
    })
}
