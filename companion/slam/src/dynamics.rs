//! What moves: three kinds of evidence about cells of the depth image, fused into regions.
//!
//! Free space. A pixel measures a point, and that everything between the camera and the point was empty. So each cell of
//! the new depth image is carried into a few keyframes that look at the same place and compared with what they measured
//! there ([`witness`]):
//!
//! ```text
//! q = T_key⁻¹ · T · p        q.z < near(π(q)) - t   in front of the known surface: was free, now is not: it moves
//!                            q.z > far(π(q)) + t    hidden from the keyframe: says nothing
//!                            else                   the same surface: static
//! ```
//!
//! Features. Those of a surface that slides are not where the camera's motion would put them ([`features`]).
//!
//! Objects. A detector's box or mask says what a surface is ([`object`]): one that is dynamic by its kind moves; one that
//! may move or stand is judged by the other two, so that parked cars stay in the map. What else is in the box is static.
//!
//! Cells that clearly violate free space, whose features move, or that are an object's are seeds; from them the mask grows
//! over depth-connected cells that violate free space weakly or of which nothing is known, never over those that a
//! keyframe confirms ([`region`]). The mask of the frame before is carried along ([`memory`]), so that somebody who stands
//! still before unknown background stays masked for a while, and a detector need not look at every frame.
//!
//! While the camera turns fast, depth and colour are displaced against each other; both what counts as free and the
//! margin around the mask allow for it.
//!
//! - E. Palazzolo et al., *`ReFusion`*, IROS 2019 (free space stays free); B. Bescos et al., *`DynaSLAM`*, RA-L 2018
//!   (multi-view test of depth). Both compare in the other direction or need a volume; the idea is the same.

mod epipolar;
mod features;
mod memory;
mod object;
mod paper;
mod region;
mod witness;

use maps::time::Stamp;
use nalgebra::Isometry3;
use rand_pcg::Pcg64;

use crate::aid::{Mobility, Object};
use crate::coarse::Named;
use crate::drift::Drift;
use crate::map::{KeyframeId, Map};
use crate::matching::Sighting;
use crate::optics::Optics;
use features::{Count, Pair};
pub(crate) use memory::Memory;
use memory::Trace;
use object::View;
use region::Label;
use witness::Judged;

/// Frames for which an object is known again where no detector looks, or where it misses the object.
const NAMED: u8 = 15;
/// An object that may move does so if that share of its surface stands where space was free, or is doubted.
const MOVING_SHARE: f64 = 0.25;

/// What is known when what moves in a frame is sought.
pub(crate) struct Scene<'a> {
    pub(crate) optics: &'a Optics,
    pub(crate) map: &'a Map,
    pub(crate) at: Stamp,
    /// The frame before, and where it was taken from; without features if that is not known.
    pub(crate) last: &'a Sighting,
    pub(crate) last_pose: &'a Isometry3<f64>,
    pub(crate) pose: &'a Isometry3<f64>,
    pub(crate) objects: &'a [Object],
}

/// Finds what moves in a frame; marks it there, and returns what the next frame should remember.
pub(crate) fn reject_moving(scene: &Scene<'_>, now: &mut Sighting, before: &Memory) -> Memory {
    let (optics, pose) = (scene.optics, scene.pose);
    let frame = Judged {
        at: scene.at,
        pose,
        coarse: &now.coarse,
        drift: Drift::of(scene.map, &now.points),
        id: None,
    };
    let votes = witness::votes(optics, scene.map, &frame);
    let recalled = before.recall(optics, (pose, &now.coarse));
    let counts = features::testimony(&Pair {
        optics,
        map: scene.map,
        last: scene.last,
        now,
        poses: [scene.last_pose, pose],
    });
    let mut labels = region::label(&now.coarse, &votes, &recalled);
    let suspicion = region::suspicion(optics, &votes, &labels);
    let doubts = features::doubts(
        optics,
        &now.coarse.depth_m,
        &counts,
        (&recalled, &suspicion),
    );
    for (label, doubt) in labels.iter_mut().zip(&doubts) {
        if *doubt >= features::ENOUGH {
            *label = Label::Certain;
        }
    }
    let named = name(scene, now, (&mut labels, &counts), &recalled);
    let age = mask(scene, now, labels, &named);
    let traces = age.iter().zip(named).zip(doubts);
    Memory {
        traces: traces
            .map(|((&age, named), doubt)| Trace { age, named, doubt })
            .collect(),
        depth_m: now.coarse.depth_m.clone(),
        world_from_camera: *pose,
    }
}

/// Grows the mask of a frame from the labels of its cells, and marks it there; frames since there was evidence, by cell.
fn mask(
    scene: &Scene<'_>,
    now: &mut Sighting,
    mut labels: Vec<Label>,
    named: &[Option<u8>],
) -> Vec<Option<u8>> {
    let (optics, pose) = (scene.optics, scene.pose);
    let coarse = &now.coarse;
    let margin = |of: &[Option<u8>]| {
        region::with_margin(optics, (pose, coarse), of.iter().map(Option::is_some))
    };
    let mut age = region::grow(optics, coarse, &labels, pose);
    let mut by_name = None;
    if named.iter().any(Option::is_some) {
        by_name = Some(Box::new(Named {
            unmapped: margin(named),
            evident: margin(&age),
        }));
        for (label, named) in labels.iter_mut().zip(named) {
            // Somebody who has stood there for a while is as good as furniture until they move.
            if named.is_some() && *label != Label::Confirmed {
                *label = Label::Named;
            }
        }
        age = region::grow(optics, coarse, &labels, pose);
    }
    let moving = margin(&age);
    (now.coarse.moving, now.coarse.named) = (moving, by_name);
    age
}

/// Frames since a detector saw something that moves at each cell: those of now, and those remembered. Of what proves to
/// move, all cells are certain.
fn name(
    scene: &Scene<'_>,
    now: &Sighting,
    (labels, counts): (&mut [Label], &[Count]),
    recalled: &[Trace],
) -> Vec<Option<u8>> {
    let remembered = |t: &Trace| t.named.filter(|&frames| frames <= NAMED);
    let mut named: Vec<Option<u8>> = recalled.iter().map(remembered).collect();
    let view = View {
        optics: scene.optics,
        coarse: &now.coarse,
        pose: scene.pose,
    };
    for object in scene.objects {
        let cells = match object.mobility {
            Mobility::Static => continue,
            Mobility::Potential | Mobility::Dynamic => object::cells_of(&view, object, labels),
        };
        let is_proven = is_moving(&cells, labels, counts);
        let moves = is_proven || object.mobility == Mobility::Dynamic;
        for cell in cells {
            // If it stands, what was remembered of it is no longer true.
            named[cell] = moves.then_some(0);
            if is_proven && labels[cell] != Label::Confirmed {
                labels[cell] = Label::Certain;
            }
        }
    }
    named
}

/// Whether an object that may move does: by the free space it stands in, or by most of its features.
fn is_moving(cells: &[usize], labels: &[Label], counts: &[Count]) -> bool {
    let moves = |&&cell: &&usize| matches!(labels[cell], Label::Strong | Label::Certain);
    let moving = cells.iter().filter(moves).count();
    let sum = cells.iter().fold(Count::default(), |sum, &cell| Count {
        agree: sum.agree.saturating_add(counts[cell].agree),
        contradict: sum.contradict.saturating_add(counts[cell].contradict),
    });
    sum.moves() || (moving > 0 && moving as f64 >= MOVING_SHARE * cells.len() as f64)
}

/// Marks what moves in a frame by the paper's scheme, from the pose of the frame before.
pub(crate) fn reject_objects(scene: &Scene<'_>, now: &mut Sighting, rng: &mut Pcg64) {
    let view = View {
        optics: scene.optics,
        coarse: &now.coarse,
        pose: scene.pose,
    };
    let moving = paper::moving(&view, (scene.last, now), scene.objects, rng);
    now.coarse.moving = moving;
}

/// Marks in a keyframe what later frames have looked through: somebody stood there, and has gone. Returns the cells that
/// no other keyframe confirms: too little to be sure that something moves, and next to no loss for a dense map, since what
/// stands is seen by several.
pub(crate) fn reconsider(optics: &Optics, map: &mut Map, id: KeyframeId) -> Vec<bool> {
    let Some(k) = map.keyframes.get(&id) else {
        return Vec::new();
    };
    if map.keyframes.len() == 1 {
        // There is nobody to ask.
        return Vec::new();
    }
    let pose = k.world_from_camera;
    let frame = Judged {
        at: k.at,
        pose: &pose,
        coarse: &k.coarse,
        drift: k.drift,
        id: Some(id),
    };
    let votes = witness::votes(optics, map, &frame);
    let nothing = vec![Trace::default(); optics.cell_count()];
    let labels = region::label(&k.coarse, &votes, &nothing);
    let age = region::grow(optics, &k.coarse, &labels, &pose);
    let moving = region::with_margin(optics, (&pose, &k.coarse), age.iter().map(Option::is_some));
    if let Some(k) = map.keyframes.get_mut(&id) {
        for (cell, found) in k.coarse.moving.iter_mut().zip(moving) {
            *cell |= found;
        }
    }
    labels.iter().map(|l| *l != Label::Confirmed).collect()
}
