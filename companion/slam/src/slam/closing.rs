//! Loops are closed, and maps joined: the part of the state machine that works with [`crate::loops`].

use std::sync::Arc;

use nalgebra::Isometry3;

use crate::bundle::Local;
use crate::loops::{self, Comparison, Place, Sameness, Streak};
use crate::map::{Excerpt, KeyframeId, Link, Map, Renaming, Standing};
use crate::optics::Optics;
use crate::places::Candidate;

use super::Slam;

/// Keyframes that are compared with the new one, at most, of each map.
const COMPARED: usize = 3;
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

/// A place that was recognised, and the number of the map it is in.
pub(super) type Recognised = (u32, Sameness);

impl Slam {
    /// Closes the loop if it is sure by now that the keyframe before the newest shows a place known from before, and has
    /// the same looked for in the newest one. What that one is called from now on.
    pub(super) fn close_loop(&mut self, newest: KeyframeId) -> KeyframeId {
        self.take_recognised();
        let newest = self.window.back().copied().unwrap_or(newest);
        let alike = self.places_like(newest);
        if !alike.is_empty()
            && let Some(now) = Place::new(&self.optics, &self.map, newest)
        {
            let optics = Arc::clone(&self.optics);
            self.seeker
                .start(move || first_verified(&optics, &now, &alike));
        }
        newest
    }

    /// Hears what became of the comparisons of the last keyframe.
    fn take_recognised(&mut self) {
        let found = self.seeker.take().flatten();
        let Some((number, found)) = found.and_then(|found| self.as_known_now(found)) else {
            self.back.streak.miss();
            return;
        };
        let mut streak = std::mem::take(&mut self.back.streak);
        streak.update(|number, found| Some(self.as_known_now((number, found))?.1));
        let evidence = streak.add(number, found);
        self.back.streak = streak;
        let Some(evidence) = evidence else {
            return;
        };
        if number != self.map.number {
            self.join(number, evidence);
        } else if evidence
            .iter()
            .all(|found| loops::is_plausible(&self.map, found))
        {
            self.spread(&evidence);
        }
    }

    /// While the two keyframes were compared, they may have been adjusted, or forgotten.
    fn as_known_now(&self, (number, found): Recognised) -> Option<Recognised> {
        let pose_before = self.map.keyframes.get(&found.now)?.world_from_camera;
        let then = self.map_of(number)?.keyframes.get(&found.then)?;
        let found = Sameness {
            pose: then.world_from_camera * found.then_from_now,
            pose_before,
            ..found
        };
        Some((number, found))
    }

    /// The keyframes that look like the newest one, beyond those that the window knows of; with the numbers of their maps.
    fn places_like(&self, newest: KeyframeId) -> Vec<(u32, Place)> {
        let Some(k) = self.map.keyframes.get(&newest) else {
            return Vec::new();
        };
        let window: Vec<KeyframeId> = self.window.iter().copied().collect();
        let shared = self.map.shared(&window);
        let is_near = |id: KeyframeId| {
            window.contains(&id) || shared.get(&id).is_some_and(|&count| count >= FEWEST_SHARED)
        };
        let here = self.map.places.query(&k.features);
        let mut of_window = here.iter().filter(|c| c.keyframe != newest);
        let Some(usual) = of_window.find(|c| is_near(c.keyframe)) else {
            return Vec::new();
        };
        let least = ALIKE_SHARE * usual.score;
        let alike = |all: &[Candidate], wanted: &dyn Fn(KeyframeId) -> bool| -> Vec<KeyframeId> {
            let alike = all.iter().take_while(|c| c.score >= least);
            let wanted = alike.map(|c| c.keyframe).filter(|&id| wanted(id));
            wanted.take(COMPARED).collect()
        };
        let place = |map: &Map, id| Some((map.number, Place::new(&self.optics, map, id)?));
        let mut places: Vec<_> = alike(&here, &|id| !is_near(id))
            .into_iter()
            .filter_map(|id| place(&self.map, id))
            .collect();
        for old in &self.back.stored {
            let there = alike(&old.places.query(&k.features), &|_| true);
            places.extend(there.into_iter().filter_map(|id| place(old, id)));
        }
        places
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
            let solved = graph.solve().ok().map(|solved| solved.poses);
            let Some(poses) = solved.filter(|poses| agrees(&ids, poses, newest)) else {
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
        self.positions.rename(was, old.number, renaming);
        self.plumb.rename(was, old.number, renaming);
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

/// The first of the old places that is the same as the new one.
fn first_verified(optics: &Optics, now: &Place, old: &[(u32, Place)]) -> Option<Recognised> {
    old.iter().find_map(|(number, then)| {
        let found = Comparison::new(optics, now, then).verify()?;
        Some((*number, found))
    })
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
