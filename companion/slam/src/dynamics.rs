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
//! still before unknown background stays masked for a while, and a detector need not look at every frame. It may answer a few
//! frames late, too: the last frames are kept, named as they should have been, and carried along anew ([`history`]).
//!
//! While the camera turns fast, depth and colour are displaced against each other; both what counts as free and the
//! margin around the mask allow for it.
//!
//! - E. Palazzolo et al., *`ReFusion`*, IROS 2019 (free space stays free); B. Bescos et al., *`DynaSLAM`*, RA-L 2018
//!   (multi-view test of depth). Both compare in the other direction or need a volume; the idea is the same.

mod epipolar;
mod features;
mod history;
mod memory;
mod object;
mod paper;
mod region;
mod witness;

use maps::time::Stamp;
use nalgebra::Isometry3;
use rand_pcg::Pcg64;

use crate::aid::Object;
use crate::coarse::{Coarse, Named};
use crate::drift::Drift;
use crate::map::{KeyframeId, Map};
use crate::matching::Sighting;
use crate::optics::Optics;
use features::Pair;
pub(crate) use history::History;
use memory::{Memory, Trace};
use object::View;
use region::Label;
use witness::{Judged, Votes};

/// Frames for which an object is known again where no detector looks, or where it misses the object.
pub(crate) const NAMED: u8 = 15;

/// What is known when what moves in a frame is sought.
pub(crate) struct Scene<'a> {
    pub(crate) optics: &'a Optics,
    pub(crate) map: &'a Map,
    pub(crate) at: Stamp,
    /// The frame before, and where it was taken from; without features if that is not known.
    pub(crate) last: &'a Sighting,
    pub(crate) last_pose: &'a Isometry3<f64>,
    pub(crate) pose: &'a Isometry3<f64>,
    /// What a detector sees in this very frame; `None` where it has not looked, or not answered yet.
    pub(crate) objects: Option<&'a [Object]>,
}

/// Finds what moves in a frame; marks it there, and notes what later frames should remember.
pub(crate) fn reject_moving(scene: &Scene<'_>, now: &mut Sighting, history: &mut History) {
    let (optics, pose) = (scene.optics, scene.pose);
    let frame = Judged {
        at: scene.at,
        pose,
        coarse: &now.coarse,
        drift: Drift::of(scene.map, &now.points),
        id: None,
    };
    let votes = witness::votes(optics, scene.map, &frame);
    let last_from_this = history.last_from(pose);
    let recalled = history.recall(optics, scene.at, (&last_from_this, &now.coarse.depth_m));
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
    let mut named = remembered(&recalled);
    let view = View {
        optics,
        depth_m: &now.coarse.depth_m,
        pose,
    };
    let objects = scene.objects.unwrap_or_default();
    object::name(&view, objects, (&mut labels, &counts), &mut named);
    let masked = mask(optics, (pose, &now.coarse), &labels, &named);
    (now.coarse.moving, now.coarse.named) = (masked.moving, masked.by_name);
    let traces = masked.age.into_iter().zip(named).zip(doubts);
    let memory = Memory {
        at: scene.at,
        traces: traces
            .map(|((age, named), doubt)| Trace { age, named, doubt })
            .collect(),
        depth_m: now.coarse.depth_m.clone(),
        world_from_camera: *pose,
        last_from_this,
        labels,
        counts,
    };
    history.push(memory, scene.objects.is_some());
}

/// What moves in a frame, by cell.
struct Masked {
    /// Frames since there was evidence.
    age: Vec<Option<u8>>,
    /// Margin included.
    moving: Vec<bool>,
    by_name: Option<Box<Named>>,
}

/// Grows the mask of a frame from the labels of its cells, and from what a detector has named.
fn mask(
    optics: &Optics,
    (pose, coarse): (&Isometry3<f64>, &Coarse),
    labels: &[Label],
    named: &[Option<u8>],
) -> Masked {
    let margin = |of: &[Option<u8>]| {
        region::with_margin(optics, (pose, coarse), of.iter().map(Option::is_some))
    };
    let mut age = region::grow(optics, coarse, labels, pose);
    let mut by_name = None;
    if named.iter().any(Option::is_some) {
        by_name = Some(Box::new(Named {
            unmapped: margin(named),
            evident: margin(&age),
        }));
        // Somebody who has stood there for a while is as good as furniture until they move.
        let by_name = |(&label, named): (&Label, &Option<u8>)| match named {
            Some(_) if label != Label::Confirmed => Label::Named,
            Some(_) | None => label,
        };
        let labels: Vec<Label> = labels.iter().zip(named).map(by_name).collect();
        age = region::grow(optics, coarse, &labels, pose);
    }
    Masked {
        moving: margin(&age),
        age,
        by_name,
    }
}

/// Frames since a detector saw something that moves at each cell, as far as it is remembered.
fn remembered(traces: &[Trace]) -> Vec<Option<u8>> {
    let named = |t: &Trace| t.named.filter(|&frames| frames <= NAMED);
    traces.iter().map(named).collect()
}

/// Marks what moves in a frame by the paper's scheme, from the pose of the frame before.
pub(crate) fn reject_objects(scene: &Scene<'_>, now: &mut Sighting, rng: &mut Pcg64) {
    let view = View {
        optics: scene.optics,
        depth_m: &now.coarse.depth_m,
        pose: scene.pose,
    };
    let objects = scene.objects.unwrap_or_default();
    let moving = paper::moving(&view, (scene.last, now), objects, rng);
    now.coarse.moving = moving;
}

/// Marks in a keyframe what later frames have looked through: somebody stood there, and has gone. Returns the cells that
/// nobody is sure of: too little evidence that something moves, and next to no loss for a dense map, since what stands is seen
/// by several. Somebody who walks slowly may be confirmed by the next keyframe, and a part of them by chance where the rest
/// is known to move.
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
    let Some(k) = map.keyframes.get_mut(&id) else {
        return Vec::new();
    };
    for (cell, found) in k.coarse.moving.iter_mut().zip(moving) {
        *cell |= found;
    }
    let part_of_movers = region::part_of_movers(optics, &k.coarse, &pose);
    let most = votes.iter().map(|v| v.confirm).max().unwrap_or(0);
    let is_sure =
        |(label, votes): (&Label, &Votes)| *label == Label::Confirmed && votes.is_sure(most);
    let sure = labels.iter().zip(&votes).map(is_sure);
    sure.zip(part_of_movers)
        .map(|(sure, mover)| !sure || mover)
        .collect()
}
