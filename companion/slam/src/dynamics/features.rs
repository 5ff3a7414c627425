//! What features say: those of a surface that moves are not where the camera's motion would put them.
//!
//! Depth tells of what stands where space was free; it says nothing of a thing that slides along a wall, nor of one
//! without depth. So the features of the frame before are found again, by description alone within a wide circle, and
//! compared with where a static point would now be:
//!
//! ```text
//! with depth z     r = ‖u - π(T⁻¹ · T_before · π⁻¹(u_before, z))‖                          reprojection
//! without depth    r = distance of u from the line π(T⁻¹ · T_before · π⁻¹(u_before, z)), z from nearest to ∞   epipolar
//! ```
//!
//! A match is wrong now and then, and a whole surface is not: around each cell, on the surface it belongs to, the
//! matches that contradict are counted against those that agree. What contradicts for several frames is doubted enough.

use std::ops::Range;

use nalgebra::{Isometry3, Point3, Vector3};

use super::memory::Trace;
use super::region::{connected, neighbors};
use crate::features::{Feature, scale_of};
use crate::map::Map;
use crate::matching::{Sighting, Wanted};
use crate::optics::Optics;

/// Pixels around where a static point would be in which its feature is sought.
const RADIUS: f64 = 24.0;
/// Bits in which two descriptions of one point may differ.
const SIMILAR: u32 = 56;
/// Larger residuals contradict: pixels of the level on which the feature was found, and a part of how far it went in the
/// image by the camera's turn, which is uneven and smears it, and by its way, since rows are exposed one after the other.
const CONTRADICTING: f64 = 3.0;
const CONTRADICTING_SHARE: f64 = 0.2;
const CONTRADICTING_SHARE_OF_WAY: f64 = 0.1;
/// Nothing contradicts where the camera's turn alone carries the image on by more pixels than this: all is blurred.
const FASTEST: f64 = 20.0;
/// Residuals below this part of that agree; those between say nothing.
const AGREEING: f64 = 0.4;
/// Coarser levels are not asked: their pixels are too large.
const COARSEST: u8 = 4;
/// Nearest and farthest that a point without measured depth can be, in metres.
const NEAREST_M: f64 = 0.4;
const FARTHEST_M: f64 = 1e3;
/// How many cells around a match are concerned, along its surface.
const REACH: u8 = 10;
/// So many matches must contradict, and be so large a share of all.
const FEWEST: u16 = 6;
const SHARE: f32 = 0.7;
/// What is left of a doubt after a frame, and how much of it is enough: three frames in a row.
const FADING: f32 = 0.8;
pub(super) const ENOUGH: f32 = 2.2;
const MOST: f32 = 5.0;

/// The frame before and this one, with the poses of both.
pub(super) struct Pair<'a> {
    pub(super) optics: &'a Optics,
    pub(super) map: &'a Map,
    pub(super) last: &'a Sighting,
    pub(super) now: &'a Sighting,
    /// `world_from_camera` of the frame before, and of this one.
    pub(super) poses: [&'a Isometry3<f64>; 2],
}

/// Matches that agree with the camera's motion and that contradict it, by cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Count {
    pub(super) agree: u16,
    pub(super) contradict: u16,
}

impl Count {
    pub(super) fn moves(self) -> bool {
        let all = f32::from(self.agree) + f32::from(self.contradict);
        self.contradict >= FEWEST && f32::from(self.contradict) >= SHARE * all
    }
}

/// What the features at each cell say.
pub(super) fn testimony(pair: &Pair<'_>) -> Vec<Count> {
    let mut counts = vec![Count::default(); pair.optics.cell_count()];
    let mut tracked: Vec<_> = pair.now.points.iter().flatten().copied().collect();
    tracked.sort_unstable();
    for (feature, point) in pair.now.features.iter().zip(&pair.now.points) {
        if point.is_some() {
            counts[pair.optics.cell_at(feature.raw)].agree += 1;
        }
    }
    for (feature, point) in pair.last.features.iter().zip(&pair.last.points) {
        let known = point.is_some_and(|id| tracked.binary_search(&id).is_ok());
        if known || feature.octave > COARSEST {
            continue;
        }
        let position = point.and_then(|id| pair.map.point(id)).map(|p| p.position);
        if let Some((cell, contradicts)) = compare(pair, feature, position) {
            let count = &mut counts[cell];
            if contradicts {
                count.contradict += 1;
            } else {
                count.agree += 1;
            }
        }
    }
    counts
}

/// Where a feature of the frame before is now, and whether that contradicts the camera's motion; `None` where it is not
/// found again or it does not tell.
fn compare(
    pair: &Pair<'_>,
    feature: &Feature,
    position: Option<Vector3<f64>>,
) -> Option<(usize, bool)> {
    let optics = pair.optics;
    let [before, pose] = pair.poses;
    let camera_from_world = pose.inverse();
    let seen_at = |p: Vector3<f64>| optics.see(&(camera_from_world * Point3::from(p)).coords);
    let lifted = |depth_m: f64| (before * Point3::from(optics.lift(feature.ideal, depth_m))).coords;
    let position = position.or_else(|| feature.depth_m.map(lifted));
    // One place, or the two ends of a line.
    let ends = match position {
        Some(p) => [seen_at(p)?; 2],
        None => [seen_at(lifted(NEAREST_M))?, seen_at(lifted(FARTHEST_M))?],
    };
    let scale = scale_of(feature.octave);
    let middle = [0, 1].map(|i| f64::midpoint(ends[0][i], ends[1][i]));
    let length = apart(ends[0], ends[1]);
    let (found, _) = pair.now.most_similar(&Wanted {
        ideal: middle,
        radius: RADIUS * scale + length / 2.0,
        octave: feature.octave,
        descriptor: feature.descriptor,
        similar: SIMILAR,
    })?;
    let at = &pair.now.features[found];
    let turned = pose.rotation.inverse() * before.rotation * optics.lift(feature.ideal, 1.0);
    let turned = optics.see(&turned)?;
    let by_turn = apart(feature.ideal, turned);
    let gate = CONTRADICTING * scale
        + CONTRADICTING_SHARE * by_turn
        + CONTRADICTING_SHARE_OF_WAY * apart(turned, middle);
    let residual = from_line(at.ideal, ends);
    if residual > gate {
        let distance = feature.descriptor.distance(&at.descriptor);
        let wanted = (feature, distance);
        let ambiguous = has_twin(pair.last, wanted, [feature.ideal; 2], 2.0..RADIUS)
            || has_twin(pair.now, wanted, ends, 0.0..gate);
        return (by_turn < FASTEST && !ambiguous).then(|| (optics.cell_at(at.raw), true));
    }
    (residual < AGREEING * gate).then(|| (optics.cell_at(at.raw), false))
}

/// Whether what is found may be one of several that look alike: keys of a keyboard, veins of wood. So it is if there is
/// another one beside the feature itself, or one where a static point would now be, with a description not much farther
/// from the feature's than that of the match. Sought within a range of distances from a line.
fn has_twin(
    sighting: &Sighting,
    (feature, distance): (&Feature, u32),
    line: [[f64; 2]; 2],
    range: Range<f64>,
) -> bool {
    /// How much farther, in bits.
    const CLEARLY: u32 = 24;
    let middle = [0, 1].map(|i| f64::midpoint(line[0][i], line[1][i]));
    let radius = range.end + apart(line[0], line[1]) / 2.0;
    let mut around = sighting.grid.around(&sighting.features, middle, radius);
    around.any(|(_, f)| {
        range.contains(&from_line(f.ideal, line))
            && f.octave.abs_diff(feature.octave) <= 1
            && f.descriptor.distance(&feature.descriptor) < distance + CLEARLY
    })
}

fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Distance of a point from the line between two ends, which may be one.
fn from_line(p: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let along = [b[0] - a[0], b[1] - a[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let part = ((p[0] - a[0]) * along[0] + (p[1] - a[1]) * along[1]) / square.max(1e-9);
    let part = part.clamp(0.0, 1.0);
    apart(p, [a[0] + part * along[0], a[1] + part * along[1]])
}

/// How much each cell is doubted now: what is left from before, what the matches around it on its surface say, and what
/// free space says.
pub(super) fn doubts(
    optics: &Optics,
    depth_m: &[f32],
    counts: &[Count],
    (recalled, suspicion): (&[Trace], &[f32]),
) -> Vec<f32> {
    let around = pooled(optics, depth_m, counts);
    let updated = |((count, trace), suspicion): ((&Count, &Trace), &f32)| {
        let said = if count.moves() { 1.0 } else { 0.0 };
        (FADING * trace.doubt + said + suspicion).min(MOST)
    };
    around
        .iter()
        .zip(recalled)
        .zip(suspicion)
        .map(updated)
        .collect()
}

/// The counts of the matches within reach of each cell along its surface; those that agree are counted where others
/// contradict.
fn pooled(optics: &Optics, depth_m: &[f32], counts: &[Count]) -> Vec<Count> {
    let mut pooled = vec![Count::default(); counts.len()];
    let mut walk = Walk {
        reached: vec![usize::MAX; counts.len()],
        queue: Vec::new(),
    };
    for start in (0..counts.len()).filter(|&c| counts[c].contradict > 0) {
        for &(cell, _) in walk.around(optics, depth_m, start) {
            pooled[cell].contradict = pooled[cell]
                .contradict
                .saturating_add(counts[start].contradict);
        }
    }
    let disputed = |c: &usize| counts[*c].agree > 0 && pooled[*c].contradict > 0;
    let agreeing: Vec<usize> = (0..counts.len()).filter(disputed).collect();
    walk.reached.fill(usize::MAX);
    for start in agreeing {
        for &(cell, _) in walk.around(optics, depth_m, start) {
            pooled[cell].agree = pooled[cell].agree.saturating_add(counts[start].agree);
        }
    }
    pooled
}

/// Finds the cells within reach of another one along its surface, breadth first.
struct Walk {
    /// From where each cell was reached last.
    reached: Vec<usize>,
    queue: Vec<(usize, u8)>,
}

impl Walk {
    fn around(&mut self, optics: &Optics, depth_m: &[f32], start: usize) -> &[(usize, u8)] {
        self.queue.clear();
        self.queue.push((start, 0));
        self.reached[start] = start;
        let mut next = 0;
        while let Some(&(cell, distance)) = self.queue.get(next) {
            next += 1;
            if distance == REACH {
                break;
            }
            for n in neighbors(optics, cell) {
                if self.reached[n] != start && connected(depth_m[cell], depth_m[n]) {
                    self.reached[n] = start;
                    self.queue.push((n, distance + 1));
                }
            }
        }
        &self.queue
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use maps::camera::Pinhole;

    pub(in super::super) fn optics() -> Optics {
        Optics::new(Pinhole {
            width: 640,
            height: 480,
            fx: 500.0,
            fy: 500.0,
            cx: 319.5,
            cy: 239.5,
            distortion: [0.0; 5],
        })
    }

    /// Counts of six matches that contradict at one cell and six that agree six cells from there.
    fn dispute(optics: &Optics) -> (Vec<Count>, usize) {
        let mut counts = vec![Count::default(); optics.cell_count()];
        let cell = 60 * optics.cells_across + 80;
        counts[cell].contradict = 6;
        counts[cell + 6].agree = 6;
        (counts, cell)
    }

    /// A wall, and on its left half something that stands so far before it.
    fn depths(optics: &Optics, before_m: f32) -> Vec<f32> {
        let left = |cell: usize| cell % optics.cells_across < 83;
        let depth = |cell| if left(cell) { 3.0 - before_m } else { 3.0 };
        (0..optics.cell_count()).map(depth).collect()
    }

    #[test]
    fn one_frame_is_not_enough_for_a_doubt_three_are_and_it_fades() {
        let optics = optics();
        let (counts, cell) = dispute(&optics);
        let depth_m = depths(&optics, 0.5);
        let mut traces = vec![Trace::default(); optics.cell_count()];
        let free = vec![0.0; traces.len()];
        let mut after = |counts: &[Count]| {
            let doubts = doubts(&optics, &depth_m, counts, (&traces, &free));
            for (trace, doubt) in traces.iter_mut().zip(&doubts) {
                trace.doubt = *doubt;
            }
            doubts[cell]
        };
        let rising = [(); 3].map(|()| after(&counts) >= ENOUGH);
        assert_eq!(rising, [false, false, true]);
        let silent = vec![Count::default(); counts.len()];
        let fading = [(); 3].map(|()| after(&silent) >= ENOUGH);
        assert_eq!(fading[2..], [false]);
    }

    #[test]
    fn matches_speak_for_their_own_surface_only() {
        let optics = optics();
        let (counts, cell) = dispute(&optics);
        let nothing = vec![Trace::default(); optics.cell_count()];
        let free = vec![0.0; nothing.len()];
        let doubt = |before_m| {
            let depth_m = depths(&optics, before_m);
            doubts(&optics, &depth_m, &counts, (&nothing, &free))[cell] > 0.0
        };
        assert!(doubt(0.5), "those that agree are on the wall behind");
        assert!(!doubt(0.0), "as many agree on the same wall");
    }

    #[test]
    fn a_point_of_unknown_depth_is_anywhere_on_its_line() {
        let line = [[10.0, 10.0], [20.0, 10.0]];
        assert!((from_line([14.0, 13.0], line) - 3.0).abs() < 1e-9);
        assert!(
            (from_line([24.0, 13.0], line) - 5.0).abs() < 1e-9,
            "beyond its end"
        );
        assert!(
            (from_line([3.0, 4.0], [[0.0, 0.0]; 2]) - 5.0).abs() < 1e-9,
            "one place"
        );
    }
}
