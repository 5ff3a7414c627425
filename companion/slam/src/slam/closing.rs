//! Loops are closed, and maps joined: the part of the state machine that works with [`crate::loops`].

use nalgebra::Isometry3;

use crate::bundle::Local;
use crate::loops::{self, Comparison, Sameness, Streak};
use crate::map::{Excerpt, KeyframeId, Link, Map, Renaming, Standing};
use crate::places::Candidate;

use super::Slam;

/// Keyframes that are compared with the new one, at most, of each map.
const COMPARED: usize = 2;
/// A candidate must look this much like the new keyframe, compared with the most similar one of the window.
const ALIKE_SHARE: f64 = 0.15;
/// Points that make two keyframes look at the same place.
const FEWEST_SHARED: usize = 10;
/// A correction larger than this is spread over the map.
const NOTED_M: f64 = 0.02;
const NOTED_RAD: f64 = 0.01;
/// Dense keyframes that were moved by more than this are wrong where they are.
const WRONG_M: f64 = 0.03;
const WRONG_RAD: f64 = 0.01;

impl Slam {
    /// Looks whether the newest keyframe shows a place known from before, and closes the loop once that is sure. What the
    /// keyframe is called from now on.
    pub(super) fn close_loop(&mut self, newest: KeyframeId) -> KeyframeId {
        let Some((number, found)) = self.recognise() else {
            self.back.streak.miss();
            return newest;
        };
        let Some(evidence) = self.back.streak.add(number, found) else {
            return newest;
        };
        if number != self.map.number {
            self.join(number, evidence);
        } else if evidence
            .iter()
            .all(|found| loops::is_plausible(&self.map, found))
        {
            self.spread(&evidence);
        }
        self.window.back().copied().unwrap_or(newest)
    }

    /// The place that the newest keyframe shows beyond what the window knows of, and the map it is in.
    fn recognise(&self) -> Option<(u32, Sameness)> {
        let &newest = self.window.back()?;
        let features = &self.map.keyframes.get(&newest)?.features;
        let window: Vec<KeyframeId> = self.window.iter().copied().collect();
        let shared = self.map.shared(&window);
        let is_near = |id: KeyframeId| {
            window.contains(&id) || shared.get(&id).is_some_and(|&count| count >= FEWEST_SHARED)
        };
        let of_window = |id: KeyframeId| id != newest && is_near(id);
        let usual = self.map.places.query(features, 1, of_window);
        let least = ALIKE_SHARE * usual.first()?.score;
        let alike = |map: &Map, wanted: &dyn Fn(KeyframeId) -> bool| -> Vec<Candidate> {
            let mut found = map.places.query(features, COMPARED, wanted);
            found.retain(|candidate| candidate.score >= least);
            found
        };
        let verify = |old: &Map, candidate: &Candidate| {
            let pair = ((&self.map, newest), (old, candidate.keyframe));
            let found = Comparison::new(&self.optics, pair.0, pair.1)?.verify(&self.optics)?;
            Some((old.number, found))
        };
        let here = alike(&self.map, &|id| !is_near(id));
        here.iter()
            .find_map(|candidate| verify(&self.map, candidate))
            .or_else(|| {
                self.back.stored.iter().find_map(|old| {
                    let there = alike(old, &|_| true);
                    there.iter().find_map(|candidate| verify(old, candidate))
                })
            })
    }

    /// Spreads over the map what the keyframes that have recognised a place say, and makes one of what is there twice.
    fn spread(&mut self, evidence: &[Sameness]) {
        let Some(newest) = evidence.last() else {
            return;
        };
        let links = self.map.links.len();
        self.map.links.extend(evidence.iter().map(Link::from));
        let off = newest.pose_before.inverse() * newest.pose;
        if off.translation.vector.norm() > NOTED_M || off.rotation.angle() > NOTED_RAD {
            let (ids, graph) = loops::graph(&self.map, loops::drift_of(&self.map, newest));
            let Some(poses) = graph
                .solve()
                .ok()
                .filter(|poses| agrees(&ids, poses, newest))
            else {
                self.map.links.truncate(links);
                return;
            };
            self.apply(&ids.into_iter().zip(poses).collect::<Vec<_>>());
        }
        self.fuse(newest);
    }

    /// Moves keyframes to where they were found to be, and has the dense map made anew where that was wrong.
    pub(super) fn apply(&mut self, corrected: &[(KeyframeId, Isometry3<f64>)]) {
        let wrong = corrected.iter().any(|(id, pose)| {
            let k = self.map.keyframes.get(id).filter(|k| k.surface.is_some());
            k.is_some_and(|k| {
                let off = k.world_from_camera.inverse() * pose;
                off.translation.vector.norm() > WRONG_M || off.rotation.angle() > WRONG_RAD
            })
        });
        self.map.correct(corrected);
        if wrong {
            self.hand_out_anew();
        }
    }

    /// What was mapped twice becomes one, and bundle adjustment evens it out.
    fn fuse(&mut self, newest: &Sameness) {
        for &(feature, original) in &newest.pairs {
            match self
                .map
                .keyframes
                .get(&newest.now)
                .and_then(|k| k.points[feature])
            {
                Some(copy) if copy == original => {}
                Some(copy) => self.map.merge(copy, original),
                None => self.map.attach(newest.now, feature, original),
            }
        }
        let old = self.map.around(newest.then, loops::AROUND);
        let mut place: Vec<KeyframeId> = self.window.iter().copied().collect();
        for id in place.clone() {
            let there = Excerpt::new(&self.map, &old);
            self.map.fuse(&self.optics, id, &there);
        }
        place.extend(old.iter().filter(|id| !self.window.contains(id)));
        place.sort_unstable();
        if let Some(local) = Local::new(&self.map, &place) {
            local.solve(&self.optics).write_back(&mut self.map);
        }
    }

    /// Makes one of this map and the stored one of that number, in which its newest keyframes have recognised a place.
    fn join(&mut self, number: u32, mut evidence: Vec<Sameness>) {
        let Some(at) = self.back.stored.iter().position(|map| map.number == number) else {
            return;
        };
        let Some(newest) = evidence.last() else {
            return;
        };
        let mut old = self.back.stored.remove(at);
        let old_from_here = newest.pose * newest.pose_before.inverse();
        // What is joined to the world stays where it is.
        let moves_old = self.map.standing == Standing::Joined;
        if moves_old {
            old.transform(&old_from_here.inverse());
        } else {
            self.map.transform(&old_from_here);
            if let Some(drift) = old.keyframes.get(&newest.then).map(|k| k.drift) {
                self.map.set_drift(drift);
                self.last.covariance = drift.widen(&newest.covariance);
            }
            // The pose jumps, be it by little: where it was, was not known.
            self.reset_counter = self.reset_counter.wrapping_add(1);
            let pose = old_from_here * self.last.motion.pose;
            self.last.motion.correct(pose);
        }
        let renaming = self.become_part_of(old);
        for found in &mut evidence {
            found.now = renaming.keyframe(found.now);
            if moves_old {
                found.pose = old_from_here.inverse() * found.pose;
            } else {
                found.pose_before = old_from_here * found.pose_before;
            }
        }
        self.spread(&evidence);
        self.hand_out_anew();
    }

    /// The map in use becomes part of an older one in the same frame, which is then in use.
    fn become_part_of(&mut self, mut old: Map) -> Renaming {
        let here = std::mem::take(&mut self.map);
        let (was, standing, fixed) = (here.number, here.standing, here.fixed);
        let renaming = old.absorb(here);
        if standing == Standing::Joined {
            (old.standing, old.fixed) = (standing, renaming.keyframe(fixed));
        }
        for logged in self.log.iter_mut().filter(|logged| logged.map == was) {
            logged.map = old.number;
            logged.reference = renaming.keyframe(logged.reference);
        }
        for id in &mut self.window {
            *id = renaming.keyframe(*id);
        }
        for id in self.last.sighting.points.iter_mut().flatten() {
            *id = renaming.point(*id);
        }
        self.map = old;
        renaming
    }
}

/// Whether the corrected poses of the two keyframes are what was recognised: else the loop was outvoted.
fn agrees(ids: &[KeyframeId], poses: &[Isometry3<f64>], newest: &Sameness) -> bool {
    const OFF_M: f64 = 0.1;
    const OFF_RAD: f64 = 0.05;
    let pose = |id: KeyframeId| Some(poses[ids.binary_search(&id).ok()?]);
    let off = pose(newest.then)
        .zip(pose(newest.now))
        .map(|(then, now)| (then * newest.then_from_now).inverse() * now);
    off.is_some_and(|off| off.translation.vector.norm() < OFF_M && off.rotation.angle() < OFF_RAD)
}

/// What the back end knows beside the map.
#[derive(Default)]
pub(super) struct BackEnd {
    /// Maps that were left when the place was lost, oldest first.
    pub(super) stored: Vec<Map>,
    pub(super) streak: Streak,
    /// How many maps were begun.
    pub(super) maps: u32,
    /// Whether the dense map is to be made anew.
    pub(super) anew: bool,
}
