//! What moves: depth that lies where a keyframe saw free space.
//!
//! A pixel measures a point, and that everything between the camera and the point was empty. So each cell of the new
//! depth image is carried into a few keyframes that look at the same place and compared with what they measured there:
//!
//! ```text
//! q = T_key⁻¹ · T · p        q.z < near(π(q)) - t   in front of the known surface: was free, now is not: it moves
//!                            q.z > far(π(q)) + t    hidden from the keyframe: says nothing
//!                            else                   the same surface: static
//! ```
//!
//! Cells that clearly violate free space are seeds; from them the mask grows over depth-connected cells that violate it
//! weakly or of which nothing is known, never over those that a keyframe confirms. A mask of the frame before is
//! carried along, so that somebody who stands still before unknown background stays masked for a while.
//!
//! - E. Palazzolo et al., *`ReFusion`*, IROS 2019 (free space stays free); B. Bescos et al., *`DynaSLAM`*, RA-L 2018
//!   (multi-view test of depth). Both compare in the other direction or need a volume; the idea is the same.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::coarse::{Coarse, clear_of};
use crate::map::{KeyframeId, Map};
use crate::optics::{Fast, Optics};

/// Keyframes that are asked about a frame.
const WITNESSES: usize = 6;
/// Frames for which a mask lives on without new evidence.
const MEMORY: u8 = 45;
/// Cells over which a mask grows into the unknown, from evidence or from the mask of the frame before.
const GROWTH: u16 = 10;
/// How far in front of a known surface is strong evidence, weak evidence, and none at all, in units of `clear_of`.
const STRONG: f32 = 1.5;
const WEAK: f32 = 0.7;
const CONFIRMING: f32 = 0.5;
/// The least share of a component for which there is strong evidence.
const STRONG_SHARE: f64 = 0.25;
/// The least share of the image that is believed to move: smaller spots are noise.
const SMALLEST_SHARE: f64 = 0.002;
/// Below this height over the floor the mask does not grow into what no witness speaks of: feet touch the floor.
const FLOOR_M: f64 = 0.06;

/// What the witnesses say about a cell.
#[derive(Clone, Copy, Debug, Default)]
struct Votes {
    confirm: u8,
    weak: u8,
    strong: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Label {
    /// No depth.
    Empty,
    /// A keyframe saw the same surface.
    Confirmed,
    /// Nobody looked here.
    Unknown,
    /// Nobody looked here since it was masked, so many frames ago.
    Remembered(u8),
    /// Slightly in front of what was there.
    Weak,
    /// Clearly in front of what was there.
    Strong,
}

/// The mask of one frame, to be carried to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mask {
    /// Frames since there was evidence for the cell, `None` where it is static.
    age: Vec<Option<u8>>,
    /// Depth, to know the surface again.
    depth_m: Vec<f32>,
    world_from_camera: Isometry3<f64>,
}

/// Finds what moves in `coarse`, taken from `pose`; marks it there, and returns the mask for the next frame.
pub(crate) fn reject_moving(
    optics: &Optics,
    map: &Map,
    coarse: &mut Coarse,
    (pose, before): (&Isometry3<f64>, &Mask),
) -> Mask {
    let witnesses = choose_witnesses(optics, map, (pose, coarse), None);
    let votes = hear(optics, map, (pose, coarse), &witnesses);
    let labels = label(optics, coarse, &votes, (pose, before));
    let age = grow(optics, coarse, &labels, pose);
    coarse.moving = with_margin(optics, coarse, &age);
    Mask {
        age,
        depth_m: coarse.depth_m.clone(),
        world_from_camera: *pose,
    }
}

/// The keyframes that know most about what is in view: greedily, each next one for what the others leave open.
fn choose_witnesses(
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
        let best = (0..candidates.len()).max_by_key(|&i| (worth(&candidates[i]), candidates[i].0));
        let Some(best) = best.filter(|&i| worth(&candidates[i]) > 0) else {
            break;
        };
        let (id, informs) = candidates.swap_remove(best);
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
    for k in witnesses.iter().filter_map(|id| map.keyframes.get(id)) {
        let relative = Fast::new(&(k.world_from_camera.inverse() * pose));
        for (cell, vote) in votes.iter_mut().enumerate() {
            let depth = coarse.depth_m[cell];
            if depth > 0.0 {
                let p = relative.apply(&optics.cell_point(cell, depth));
                cast_vote(optics, &k.coarse, &p, vote);
            }
        }
    }
    votes
}

fn cast_vote(optics: &Optics, witness: &Coarse, p: &Vector3<f32>, vote: &mut Votes) {
    let Some(cell) = optics.cell_of(p) else {
        return;
    };
    let (near, far) = (witness.near_m[cell], witness.far_m[cell]);
    if near <= 0.0 || p.z > far + clear_of(far) {
        return;
    }
    let gap = (near - p.z) / clear_of(near);
    if gap > STRONG {
        vote.strong += 1;
        vote.weak += 1;
    } else if gap > WEAK {
        vote.weak += 1;
    } else if gap < CONFIRMING && !witness.moving[cell] {
        vote.confirm += 1;
    }
}

fn label(
    optics: &Optics,
    coarse: &Coarse,
    votes: &[Votes],
    (pose, before): (&Isometry3<f64>, &Mask),
) -> Vec<Label> {
    let to_before = Fast::new(&(before.world_from_camera.inverse() * pose));
    let remembered = |cell: usize| -> Option<u8> {
        let p = to_before.apply(&optics.cell_point(cell, coarse.depth_m[cell]));
        let there = optics.cell_of(&p)?;
        let age = (*before.age.get(there)?)?;
        let same = (before.depth_m[there] - p.z).abs() < 0.05 + 0.03 * p.z;
        (same && age < MEMORY).then_some(age + 1)
    };
    let of = |(cell, v): (usize, &Votes)| match v {
        _ if coarse.depth_m[cell] <= 0.0 => Label::Empty,
        v if v.strong > v.confirm => Label::Strong,
        v if v.weak > 0 && v.weak >= v.confirm => Label::Weak,
        v if v.confirm > 0 => Label::Confirmed,
        _ => remembered(cell).map_or(Label::Unknown, Label::Remembered),
    };
    votes.iter().enumerate().map(of).collect()
}

/// Grows the mask from its seeds, component by component; keeps those with enough evidence. Returns the age by cell.
fn grow(
    optics: &Optics,
    coarse: &Coarse,
    labels: &[Label],
    pose: &Isometry3<f64>,
) -> Vec<Option<u8>> {
    let smallest = (SMALLEST_SHARE * labels.len() as f64).ceil() as usize;
    let mut age = vec![None; labels.len()];
    let mut visited = vec![false; labels.len()];
    for start in 0..labels.len() {
        if visited[start] || !matches!(labels[start], Label::Strong | Label::Remembered(_)) {
            continue;
        }
        let component = collect(optics, coarse, labels, (start, &mut visited), pose);
        let strong = component
            .iter()
            .filter(|&&c| labels[c] == Label::Strong)
            .count();
        let solid = component
            .iter()
            .filter(|&&c| is_solid(optics, labels, c))
            .count();
        let memory = component
            .iter()
            .filter_map(|&c| match labels[c] {
                Label::Remembered(age) => Some(age),
                _ => None,
            })
            .min();
        let seen_now = solid >= smallest && strong as f64 >= STRONG_SHARE * component.len() as f64;
        let since = if seen_now {
            Some(0)
        } else {
            memory.filter(|_| component.len() >= smallest)
        };
        if let Some(since) = since {
            for cell in component {
                age[cell] = Some(since);
            }
        }
    }
    age
}

/// Whether a cell and those around it are all strong evidence: the rims of static things, seen a little displaced, are
/// thin.
fn is_solid(optics: &Optics, labels: &[Label], cell: usize) -> bool {
    let strong = |c: usize| labels[c] == Label::Strong;
    let full = |c: usize| strong(c) && neighbors(optics, c).all(strong);
    full(cell) && neighbors(optics, cell).all(full)
}

/// The cells connected in depth to a seed, breadth first; only so far into the unknown.
fn collect(
    optics: &Optics,
    coarse: &Coarse,
    labels: &[Label],
    (start, visited): (usize, &mut [bool]),
    pose: &Isometry3<f64>,
) -> Vec<usize> {
    let mut component = vec![(start, 0u16)];
    visited[start] = true;
    let mut next = 0;
    while let Some(&(cell, distance)) = component.get(next) {
        next += 1;
        for neighbor in neighbors(optics, cell) {
            let further = match labels[neighbor] {
                Label::Strong | Label::Weak | Label::Remembered(_) => 0,
                Label::Unknown => distance + 1,
                Label::Empty | Label::Confirmed => continue,
            };
            let (a, b) = (coarse.depth_m[cell], coarse.depth_m[neighbor]);
            let connected = (a - b).abs() < 0.03 + 0.02 * a;
            if visited[neighbor] || !connected || further > GROWTH {
                continue;
            }
            if further > 0 && height(optics, neighbor, b, pose) < FLOOR_M {
                continue;
            }
            visited[neighbor] = true;
            component.push((neighbor, further));
        }
    }
    component.into_iter().map(|(cell, _)| cell).collect()
}

fn height(optics: &Optics, cell: usize, depth_m: f32, pose: &Isometry3<f64>) -> f64 {
    let p = optics.cell_point(cell, depth_m).map(f64::from);
    (pose * Point3::from(p)).z
}

fn neighbors(optics: &Optics, cell: usize) -> impl Iterator<Item = usize> + use<> {
    let (across, count) = (optics.cells_across, optics.cell_count());
    let column = cell % across;
    [
        (column > 0).then(|| cell - 1),
        (column + 1 < across).then_some(cell + 1),
        cell.checked_sub(across),
        Some(cell + across).filter(|&below| below < count),
    ]
    .into_iter()
    .flatten()
}

/// Two cells around the mask, where colour and depth disagree about the outline, and four where there is no depth.
fn with_margin(optics: &Optics, coarse: &Coarse, age: &[Option<u8>]) -> Vec<bool> {
    let mut moving: Vec<bool> = age.iter().map(Option::is_some).collect();
    for ring in 0..4 {
        let inner = moving.clone();
        for cell in (0..inner.len()).filter(|&cell| !inner[cell]) {
            let wanted = ring < 2 || coarse.depth_m[cell] <= 0.0;
            if wanted && neighbors(optics, cell).any(|n| inner[n]) {
                moving[cell] = true;
            }
        }
    }
    moving
}

/// Marks in a keyframe what later frames have looked through: somebody stood there, and has gone.
pub(crate) fn reconsider(optics: &Optics, map: &mut Map, id: KeyframeId) {
    let Some(k) = map.keyframes.get(&id) else {
        return;
    };
    let pose = k.world_from_camera;
    let witnesses = choose_witnesses(optics, map, (&pose, &k.coarse), Some(id));
    let votes = hear(optics, map, (&pose, &k.coarse), &witnesses);
    let labels = label(optics, &k.coarse, &votes, (&pose, &Mask::default()));
    let age = grow(optics, &k.coarse, &labels, &pose);
    let moving = with_margin(optics, &k.coarse, &age);
    if let Some(k) = map.keyframes.get_mut(&id) {
        for (cell, found) in k.coarse.moving.iter_mut().zip(moving) {
            *cell |= found;
        }
    }
}
