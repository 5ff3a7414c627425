//! The paper's scheme, as plainly as it is told: objects from a detector, and no geometry without them.
//!
//! Features on the masks of dynamic objects are dropped. Those of potentially dynamic objects are judged by their distance
//! from the epipolar lines of the static points, found by RANSAC over the matches with the frame before; if most are off,
//! the object moves and they are dropped too. What is in a box but not of the object is kept. Where the paper prompts a
//! segmenter with the box, the object's mask is taken if it has one, else its surface in the depth image. Frames that no
//! detector has looked at have no mask. What moves along its epipolar lines, as a car does beside a camera that drives, is
//! not seen to move.
//!
//! - Li et al., *Multi-Source Heterogeneous Collaborative Perception System Based on UAV and UGV*, Drones 2026, 10(6), 470,
//!   section 3.2.

use rand_pcg::Pcg64;

use super::epipolar::{self, Match};
use super::object::{self, View};
use super::region::{Label, with_margin};
use crate::aid::{Mobility, Object};
use crate::matching::{Sighting, Wanted};
use crate::optics::Optics;

/// Pixels within which the features of the frame before are sought.
const RADIUS: f64 = 40.0;
/// Bits in which two descriptions of one point may differ.
const SIMILAR: u32 = 56;
/// A point farther from its epipolar line moves, pixels.
const MOVING: f64 = 2.0;
/// An object moves if so large a share of its points does, and if it has so many.
const SHARE: f64 = 0.5;
const FEWEST: usize = 4;

/// What moves by the objects in this frame, by cell, margin included.
pub(super) fn moving(
    view: &View<'_>,
    (last, now): (&Sighting, &Sighting),
    objects: &[Object],
    rng: &mut Pcg64,
) -> Vec<bool> {
    // The paper knows no map here: every surface in a box is as good as another.
    let labels = vec![Label::Unknown; view.optics.cell_count()];
    let cells = |object: &Object| object::cells_of(view, object, &labels);
    let of = |mobility: Mobility| objects.iter().filter(move |o| o.mobility == mobility);
    let mut masked = vec![false; view.optics.cell_count()];
    for cell in of(Mobility::Dynamic).flat_map(cells) {
        masked[cell] = true;
    }
    let potential: Vec<Vec<usize>> = of(Mobility::Potential).map(cells).collect();
    if potential.iter().any(|cells| !cells.is_empty()) {
        for object in moving_ones(view.optics, (last, now), (&masked, &potential), rng) {
            for &cell in object {
                masked[cell] = true;
            }
        }
    }
    with_margin(view.optics, (view.pose, &now.coarse), masked.into_iter())
}

/// The potentially dynamic objects that move against the static points.
fn moving_ones<'a>(
    optics: &Optics,
    (last, now): (&Sighting, &Sighting),
    (dynamic, potential): (&[bool], &'a [Vec<usize>]),
    rng: &mut Pcg64,
) -> Vec<&'a Vec<usize>> {
    let mut maybe = dynamic.to_vec();
    for &cell in potential.iter().flatten() {
        maybe[cell] = true;
    }
    let matches = matches(optics, last, now);
    let fixed = matches.iter().filter(|(cell, _)| !maybe[*cell]);
    let fixed: Vec<Match> = fixed.map(|(_, m)| *m).collect();
    let Some(f) = epipolar::fundamental(&fixed, rng) else {
        return Vec::new();
    };
    let moves = |cells: &&Vec<usize>| {
        let mut on = vec![false; maybe.len()];
        for &cell in *cells {
            on[cell] = true;
        }
        let own: Vec<&Match> = matches.iter().filter(|m| on[m.0]).map(|m| &m.1).collect();
        let off = own.iter().filter(|m| epipolar::residual(&f, m) > MOVING);
        own.len() >= FEWEST && off.count() as f64 > SHARE * own.len() as f64
    };
    potential.iter().filter(moves).collect()
}

/// Features of the frame before found again near where they were, each with its cell in this one.
fn matches(optics: &Optics, last: &Sighting, now: &Sighting) -> Vec<(usize, Match)> {
    let again = |feature: &crate::features::Feature| {
        let (found, _) = now.most_similar(&Wanted {
            ideal: feature.ideal,
            radius: RADIUS,
            octave: feature.octave,
            descriptor: feature.descriptor,
            similar: SIMILAR,
        })?;
        let at = &now.features[found];
        Some((optics.cell_at(at.raw), (feature.ideal, at.ideal)))
    };
    last.features.iter().filter_map(again).collect()
}
