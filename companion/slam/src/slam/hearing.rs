//! A detector that answers late.

use super::Slam;
use crate::aid::Seen;

impl Slam {
    /// How many answers of a detector came too late, or were of frames that could not be tracked: they have changed nothing.
    pub fn unheard(&self) -> u64 {
        self.moved.unheard()
    }

    /// Something was seen in one of the last frames: what is remembered of them changes, and what the keyframes among them
    /// leave out of the map.
    pub(super) fn hear(&mut self, seen: &Seen<'_>) {
        if !self.moved.hear(&self.optics, seen) {
            return;
        }
        for id in &self.window {
            if let Some(k) = self.map.keyframes.get_mut(id)
                && k.pending.is_some()
            {
                self.moved.mark(&self.optics, k);
            }
        }
    }
}
