//! What sensors beside the camera say of the map's drift is spread over it: positions by satellites, and which way is up.
//!
//! The world of the map stays where its first keyframe put it: it is bent, and turned about that keyframe until z is up.
//! What has bent the map once is no evidence for bending it further: so each time keyframes are tied to one another as they
//! were when they left the window, before they were bent ([`Map::unbent`]). How to bend it is found beside tracking, and comes in with
//! the next keyframe.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::Slam;
use crate::georeference::{Sighted, align};
use crate::loops;
use crate::map::{Keyframe, KeyframeId, Map, Standing};
use crate::pose_graph::{Outside, PoseGraph, Position, Trust, Upright};

use super::plumb::Hung;
use super::positions;

/// So many new ones are worth bending the map anew.
const WORTH_POSITIONS: usize = 10;
const WORTH_UPRIGHTS: usize = 3;

/// Keyframes no farther apart than this were tracked one from the other.
const NEAR: usize = 16;

/// What was found while tracking went on.
pub(super) struct Bent {
    map: u32,
    /// Loops that the map had closed.
    links: usize,
    /// From where keyframes were to where they should be, in the world.
    steps: BTreeMap<KeyframeId, Isometry3<f64>>,
    world_from_enu: Option<Isometry3<f64>>,
}

impl Slam {
    /// Bends the map as it was found that it should be, and has it found anew if enough has come since.
    pub(super) fn bend(&mut self) {
        let bent = self.bender.take().flatten();
        if self.map.standing != Standing::Joined {
            return;
        }
        if let Some(bent) = bent {
            self.take_bent(&bent);
        }
        if self.positions.new < WORTH_POSITIONS && self.plumb.new < WORTH_UPRIGHTS {
            return;
        }
        let Some((ids, graph)) = self.to_be_bent() else {
            return;
        };
        (self.positions.new, self.plumb.new) = (0, 0);
        let (map, links) = (self.map.number, self.map.links.len());
        self.bender.start(move || {
            let before = graph.poses.clone();
            let solved = graph.solve().ok()?;
            let steps = before.iter().zip(&solved.poses);
            let steps = steps.map(|(before, after)| after * before.inverse());
            let has_positions = !solved.outside.positions.is_empty();
            Some(Bent {
                map,
                links,
                steps: ids.into_iter().zip(steps).collect(),
                world_from_enu: has_positions.then_some(solved.outside.world_from_enu),
            })
        });
    }

    /// Unless a loop was closed meanwhile: then it is found anew. What came meanwhile goes with what was there before.
    fn take_bent(&mut self, bent: &Bent) {
        if bent.map != self.map.number || bent.links != self.map.links.len() {
            return;
        }
        let moved = |(&id, k): (&KeyframeId, &Keyframe)| {
            let (_, step) = bent.steps.range(..=id).next_back()?;
            Some((id, step * k.world_from_camera))
        };
        let corrected: Vec<_> = self.map.keyframes.iter().filter_map(moved).collect();
        self.apply(&corrected);
        if bent.world_from_enu.is_some() {
            self.positions.world_from_enu = bent.world_from_enu;
        }
    }

    /// The map as it is, tied as vision alone has it, and to the world outside; `None` where nothing is known of that.
    fn to_be_bent(&self) -> Option<(Vec<KeyframeId>, PoseGraph)> {
        let (ids, mut graph) = loops::graph(&self.map, loops::usual_drift(&self.map));
        let has_begun = |from, to| self.map.starts.iter().any(|s| from < *s && *s <= to);
        let tracked = graph.edges.iter_mut().filter(|e| {
            let is_near = e.to.abs_diff(e.from) <= NEAR;
            e.trust == Trust::Certain && is_near && !has_begun(ids[e.from], ids[e.to])
        });
        for edge in tracked {
            let [from, to] = [edge.from, edge.to].map(|i| self.map.unbent(ids[i]));
            edge.from_from_to = from.inverse() * to;
        }
        let uprights = self.uprights(&ids);
        let sighted = self.sighted();
        let places: Vec<Sighted> = sighted.iter().map(|&(_, s)| s).collect();
        graph.outside = match align(&places) {
            Some((world_from_enu, agrees)) => Outside {
                positions: tied(&self.map, &ids, sighted.iter().zip(&agrees)),
                world_from_enu,
                uprights,
                ..Outside::default()
            },
            None if uprights.is_empty() => return None,
            None => Outside {
                uprights,
                ..Outside::default()
            },
        };
        Some((ids, graph))
    }

    fn uprights(&self, ids: &[KeyframeId]) -> Vec<Upright> {
        let of_map = |hung: &&Hung| hung.map == self.map.number;
        let hung = self.plumb.hung.iter().filter(of_map);
        let upright = |hung: &Hung| {
            let kept = self.map.nearest_kept(hung.keyframe)?;
            let [there, here] =
                [hung.keyframe, kept].map(|id| self.map.poses.get(id.0 as usize).copied());
            Some(Upright {
                node: ids.binary_search(&kept).ok()?,
                up: here?.rotation.inverse() * there?.rotation * hung.up,
                sigma_rad: hung.sigma_rad,
            })
        };
        hung.filter_map(upright).collect()
    }
}

/// Those positions that agree with one another, where the keyframes next to them are now.
fn tied<'a>(
    map: &Map,
    ids: &[KeyframeId],
    sighted: impl Iterator<Item = (&'a (KeyframeId, Sighted), &'a bool)>,
) -> Vec<Position> {
    let position = |((keyframe, s), _): (&(KeyframeId, Sighted), &bool)| {
        let pose = map.poses.get(keyframe.0 as usize)?;
        Some(Position {
            node: ids.binary_search(keyframe).ok()?,
            beside: s.in_world - pose.translation.vector,
            in_enu: s.in_enu,
            covariance: s.covariance * positions::alike(&s.covariance),
        })
    };
    let agreeing = sighted.filter(|(_, agrees)| **agrees);
    agreeing.filter_map(position).collect()
}
