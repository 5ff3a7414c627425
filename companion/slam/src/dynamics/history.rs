//! The last frames as they are remembered, for a detector that answers late: the one it has looked at is named as it
//! should have been, and what is known of the frames since is carried along anew.
//!
//! Memory: 18 bytes a cell and frame, 5 MB at 640 x 480 pixels.

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;
use nalgebra::Isometry3;

use super::memory::{Memory, Trace};
use super::{mask, remembered};
use crate::aid::Seen;
use crate::map::Keyframe;
use crate::optics::Optics;

/// As long as 45 frames, for which a mask lives without evidence, take at 30 a second.
const REMEMBERED: Duration = Duration::from_millis(1500);

/// What is remembered of the last frames that were tracked.
#[derive(Debug, Default)]
pub(crate) struct History {
    /// Oldest first; none older than the one of which a detector was heard last.
    frames: VecDeque<Memory>,
    unheard: u64,
}

impl History {
    /// From a camera at this pose to that of the last frame.
    pub(super) fn last_from(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        let last = self.frames.back();
        last.map_or_else(Isometry3::identity, |m| {
            m.world_from_camera.inverse() * pose
        })
    }

    /// The traces of the last frame as they apply to the cells of the next one, of that time; where the place was lost for
    /// longer than a mask lives without evidence, there are none.
    pub(super) fn recall(
        &self,
        optics: &Optics,
        at: Stamp,
        next: (&Isometry3<f64>, &[f32]),
    ) -> Vec<Trace> {
        let nothing = || vec![Trace::default(); optics.cell_count()];
        let last = self.frames.back().filter(|m| at.since(m.at) < REMEMBERED);
        last.map_or_else(nothing, |m| m.recall(optics, next))
    }

    /// One frame more, or the last one looked at once more; `is_named` if a detector has said what is in it.
    pub(super) fn push(&mut self, memory: Memory, is_named: bool) {
        if is_named {
            self.frames.clear();
        }
        if self.frames.back().is_some_and(|last| last.at == memory.at) {
            self.frames.pop_back();
        }
        if self.frames.len() == Seen::KEPT {
            self.frames.pop_front();
        }
        self.frames.push_back(memory);
    }

    /// Names what was seen in one of the frames; false if that one is not kept.
    pub(crate) fn hear(&mut self, optics: &Optics, seen: &Seen<'_>) -> bool {
        let Some(of) = self.frames.iter().position(|m| m.at == seen.of) else {
            self.unheard += 1;
            return false;
        };
        self.frames.drain(..of);
        let frames = self.frames.make_contiguous();
        frames[0].name(optics, seen.objects);
        for i in 1..frames.len() {
            let (before, after) = frames.split_at_mut(i);
            after[0].amend(optics, &before[i - 1]);
        }
        true
    }

    /// Marks what moves in a keyframe as it is known now, if it is one of the frames.
    pub(crate) fn mark(&self, optics: &Optics, k: &mut Keyframe) {
        if let Some(m) = self.frames.iter().find(|m| m.at == k.at) {
            let named = remembered(&m.traces);
            let masked = mask(optics, (&m.world_from_camera, &k.coarse), &m.labels, &named);
            (k.coarse.moving, k.coarse.named) = (masked.moving, masked.by_name);
        }
    }

    pub(crate) fn unheard(&self) -> u64 {
        self.unheard
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::features::tests::optics;

    #[test]
    fn a_mask_is_carried_on_but_not_over_a_long_loss() {
        let optics = optics();
        let count = optics.cell_count();
        let masked = Trace {
            age: Some(0),
            ..Trace::default()
        };
        let mut history = History::default();
        history.push(
            Memory {
                traces: vec![masked; count],
                depth_m: vec![2.0; count],
                ..Memory::default()
            },
            false,
        );
        let after = |ms: u64| {
            let at = Stamp::from_nanos(1_000_000 * ms);
            let next = (&Isometry3::identity(), vec![2.0; count]);
            history.recall(&optics, at, (next.0, &next.1))[count / 2].age
        };
        assert_eq!(after(33), Some(1));
        assert_eq!(after(4000), None, "the place was lost meanwhile");
    }
}
