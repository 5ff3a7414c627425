//! Keyframes as witnesses: what each of them saw where a frame now measures something.

use nalgebra::{Isometry3, Vector3};

use crate::coarse::{Coarse, clear_of};
use crate::map::{KeyframeId, Map};
use crate::optics::{Fast, Optics};

/// Keyframes that are asked about a frame.
const WITNESSES: usize = 6;
/// How far in front of a known surface is strong evidence, weak evidence, and none at all, in units of `clear_of`.
const STRONG: f32 = 1.5;
const WEAK: f32 = 0.7;
const CONFIRMING: f32 = 0.5;

/// What the witnesses say about a cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Votes {
    pub(super) confirm: u8,
    pub(super) weak: u8,
    pub(super) strong: u8,
}

impl Votes {
    /// Whether so many more voices cannot change the verdict.
    fn is_decided(self, more: u8) -> bool {
        self.confirm > self.weak + more || self.strong > self.confirm + more
    }
}

/// What the keyframes that know most say about each cell of a frame taken from `pose`.
pub(super) fn votes(
    optics: &Optics,
    map: &Map,
    view: (&Isometry3<f64>, &Coarse),
    except: Option<KeyframeId>,
) -> Vec<Votes> {
    let witnesses = choose(optics, map, view, except);
    hear(optics, map, view, &witnesses)
}

/// The keyframes that know most about what is in view: greedily, each next one for what the others leave open.
fn choose(
    optics: &Optics,
    map: &Map,
    (pose, coarse): (&Isometry3<f64>, &Coarse),
    except: Option<KeyframeId>,
) -> Vec<KeyframeId> {
    let step = (optics.cells_across / 14).max(1);
    let samples: Vec<Vector3<f32>> = (0..optics.cell_count())
        .filter(|cell| {
            let (column, row) = (cell % optics.cells_across, cell / optics.cells_across);
            column % step == step / 2 && row % step == step / 2 && coarse.depth_m[*cell] > 0.0
        })
        .map(|cell| optics.cell_point(cell, coarse.depth_m[cell]))
        .collect();
    let mut candidates: Vec<(KeyframeId, Vec<bool>)> = map
        .keyframes
        .iter()
        .filter(|(id, _)| Some(**id) != except)
        .map(|(&id, k)| {
            let relative = Fast::new(&(k.world_from_camera.inverse() * pose));
            let informs = |p: &Vector3<f32>| informs(optics, &k.coarse, &relative.apply(p));
            (id, samples.iter().map(informs).collect())
        })
        .collect();
    let mut heard = vec![0u32; samples.len()];
    let mut chosen = Vec::new();
    while chosen.len() < WITNESSES && !candidates.is_empty() {
        let worth = |(_, informs): &(KeyframeId, Vec<bool>)| -> u32 {
            let by = informs.iter().zip(&heard).filter(|(i, _)| **i);
            by.map(|(_, &count)| 16 >> (2 * count).min(5)).sum()
        };
        let ranked = candidates
            .iter()
            .enumerate()
            .map(|(i, c)| (worth(c), c.0, i));
        let Some((1.., id, best)) = ranked.max() else {
            break;
        };
        let (_, informs) = candidates.swap_remove(best);
        for (count, _) in heard.iter_mut().zip(&informs).filter(|(_, i)| **i) {
            *count += 1;
        }
        chosen.push(id);
    }
    chosen
}

/// Whether a keyframe saw the static surface at or behind a point in its camera.
fn informs(optics: &Optics, coarse: &Coarse, p: &Vector3<f32>) -> bool {
    optics.cell_of(p).is_some_and(|cell| {
        let (near, far) = (coarse.near_m[cell], coarse.far_m[cell]);
        near > 0.0 && !coarse.moving[cell] && p.z < far + clear_of(far)
    })
}

fn hear(
    optics: &Optics,
    map: &Map,
    (pose, coarse): (&Isometry3<f64>, &Coarse),
    witnesses: &[KeyframeId],
) -> Vec<Votes> {
    let mut votes = vec![Votes::default(); optics.cell_count()];
    let asked = witnesses.iter().filter_map(|id| map.keyframes.get(id));
    for (k, to_come) in asked.zip((0..witnesses.len() as u8).rev()) {
        let relative = Fast::new(&(k.world_from_camera.inverse() * pose));
        // One cell of displacement is in `near_m` already.
        let slip = (coarse.slip + k.coarse.slip).saturating_sub(1);
        let slack_m = k.coarse.near_within(optics.cells_across, slip);
        for (cell, vote) in votes.iter_mut().enumerate() {
            let depth = coarse.depth_m[cell];
            if depth > 0.0 && !vote.is_decided(to_come + 1) {
                let p = relative.apply(&optics.cell_point(cell, depth));
                cast_vote(optics, (&k.coarse, &slack_m), &p, vote);
            }
        }
    }
    votes
}

/// Free space is judged by the nearest surface that either image may show here, displaced as they are; a surface is
/// known again only where it is.
fn cast_vote(
    optics: &Optics,
    (witness, slack_m): (&Coarse, &[f32]),
    p: &Vector3<f32>,
    vote: &mut Votes,
) {
    let Some(cell) = optics.cell_of(p) else {
        return;
    };
    let (near, far) = (witness.near_m[cell], witness.far_m[cell]);
    if near <= 0.0 || p.z > far + clear_of(far) {
        return;
    }
    let in_front = |near: f32| (near - p.z) / clear_of(near);
    let gap = in_front(slack_m[cell]);
    if gap > STRONG {
        vote.strong += 1;
        vote.weak += 1;
    } else if gap > WEAK {
        vote.weak += 1;
    } else if in_front(near) < CONFIRMING && !witness.moving[cell] {
        vote.confirm += 1;
    }
}
