//! What was found to move in the frame before, carried to where it is seen now.

use maps::time::Stamp;
use nalgebra::Isometry3;

use super::features::Count;
use super::object::{self, View};
use super::region::Label;
use crate::aid::Object;
use crate::optics::{Fast, Optics};

/// Where surfaces without depth are taken to be: far enough that only the camera's turn displaces them.
const FAR_M: f32 = 10.0;

/// What is known of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Trace {
    /// Frames since there was evidence that it moves; `None` where it is static.
    pub(super) age: Option<u8>,
    /// Frames since a detector saw an object there that moves; `None` where it saw none.
    pub(super) named: Option<u8>,
    /// How strongly, and for how long, its features have contradicted the camera's motion.
    pub(super) doubt: f32,
}

/// The traces of one frame, and what tells which of its cells an object is.
#[derive(Clone, Debug, Default)]
pub(crate) struct Memory {
    pub(super) at: Stamp,
    pub(super) traces: Vec<Trace>,
    /// Depth, to know the surface again.
    pub(super) depth_m: Vec<f32>,
    pub(super) world_from_camera: Isometry3<f64>,
    /// From this camera to that of the frame before, as both were known then: poses jump.
    pub(super) last_from_this: Isometry3<f64>,
    pub(super) labels: Vec<Label>,
    pub(super) counts: Vec<Count>,
}

impl Memory {
    /// The traces as they apply to the cells of a frame, one frame older, by its depth and the step from there to here.
    pub(super) fn recall(
        &self,
        optics: &Optics,
        (here_from_there, depth_m): (&Isometry3<f64>, &[f32]),
    ) -> Vec<Trace> {
        if self.traces.iter().all(|t| *t == Trace::default()) {
            return vec![Trace::default(); optics.cell_count()];
        }
        let there = Fast::new(here_from_there);
        let recall = |(cell, &depth): (usize, &f32)| {
            let place = if depth > 0.0 { depth } else { FAR_M };
            let p = there.apply(&optics.cell_point(cell, place));
            let at = optics.cell_of(&p)?;
            let expected = if depth > 0.0 { p.z } else { 0.0 };
            Some(self.trace_at(at, expected))
        };
        let depths = depth_m.iter().enumerate();
        depths.map(|d| recall(d).unwrap_or_default()).collect()
    }

    /// The trace of a cell one frame later, if the surface there is at this depth, 0 for none.
    fn trace_at(&self, at: usize, depth_m: f32) -> Trace {
        let before = self.depth_m[at];
        let known = (before > 0.0) == (depth_m > 0.0);
        if !known || (before - depth_m).abs() > 0.05 + 0.03 * depth_m {
            return Trace::default();
        }
        let older = |age: Option<u8>| age.map(|age| age.saturating_add(1));
        let here = self.traces[at];
        Trace {
            age: older(here.age),
            named: older(here.named),
            doubt: here.doubt,
        }
    }

    /// A detector has seen these objects in this frame.
    pub(super) fn name(&mut self, optics: &Optics, objects: &[Object]) {
        let view = View {
            optics,
            depth_m: &self.depth_m,
            pose: &self.world_from_camera,
        };
        let mut named: Vec<_> = self.traces.iter().map(|t| t.named).collect();
        object::name(&view, objects, (&mut self.labels, &self.counts), &mut named);
        let known = named.into_iter().zip(&self.labels);
        for (trace, (named, label)) in self.traces.iter_mut().zip(known) {
            trace.named = named;
            if *label == Label::Certain {
                trace.age = Some(0);
            }
        }
    }

    /// Of the frame before is now known what was not when this one was looked at.
    pub(super) fn amend(&mut self, optics: &Optics, before: &Self) {
        let recalled = before.recall(optics, (&self.last_from_this, &self.depth_m));
        for (trace, recalled) in self.traces.iter_mut().zip(recalled) {
            trace.named = recalled.named;
            trace.age = match (trace.age, recalled.age) {
                (Some(a), Some(b)) => Some(a.min(b)),
                (a, b) => a.or(b),
            };
        }
    }
}
