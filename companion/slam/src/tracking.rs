//! Where a frame was taken, from the points of the map that it shows.

use maps::time::Stamp;
use nalgebra::{Isometry3, UnitQuaternion};
use rand_pcg::Pcg64;

use crate::map::{KeyframeId, Map};
use crate::matching::{Sighting, match_last, match_map};
use crate::motion::Motion;
use crate::optics::Optics;
use crate::relocalise::relocalise;
use crate::solver::{Fit, Seen, Sight, fit_pose};

/// The least number of points that supports a pose.
pub(crate) const FEWEST: usize = 15;
/// The least number of matches with the last frame that is worth a fit.
const FEWEST_AT_FIRST: usize = 20;
/// The least number of points that supports a pose found among all keyframes, without a guess.
const FEWEST_FOUND_AGAIN: usize = 30;

/// What is known to locate a frame by.
pub(crate) struct Located<'a> {
    pub(crate) optics: &'a Optics,
    pub(crate) map: &'a Map,
}

impl Located<'_> {
    /// Follows the motion from the last frame: first near where the velocity says, then in wider circles.
    pub(crate) fn follow(
        &self,
        last: &Sighting,
        motion: &Motion,
        (at, turned): (Stamp, Option<UnitQuaternion<f64>>),
        now: &mut Sighting,
    ) -> Option<Fit> {
        let mut moving = motion.predict(at);
        if let Some(turned) = turned {
            moving.rotation = motion.pose.rotation * turned;
        }
        [(moving, 14.0), (moving, 35.0), (motion.pose, 60.0)]
            .into_iter()
            .find_map(|(guess, radius)| {
                now.forget_matches();
                match_last(self.optics, self.map, last, now, (&guess, radius));
                if now.matched() < FEWEST_AT_FIRST {
                    return None;
                }
                let fit = self.fit_matches(now, &guess)?;
                self.refine(now, &fit).filter(|fit| fit.agreeing >= FEWEST)
            })
    }

    /// Compares the frame with keyframes, without a guess.
    pub(crate) fn find_again(
        &self,
        candidates: &[KeyframeId],
        now: &mut Sighting,
        rng: &mut Pcg64,
    ) -> Option<Fit> {
        candidates.iter().find_map(|id| {
            let keyframe = self.map.keyframes.get(id)?;
            now.forget_matches();
            let pose = relocalise(self.optics, self.map, now, &keyframe.points, rng)?;
            let fit = self.fit_matches(now, &pose)?;
            self.refine(now, &fit)
                .filter(|fit| fit.agreeing >= FEWEST_FOUND_AGAIN)
        })
    }

    /// Adds the points of the whole map that should be in view, and fits again.
    fn refine(&self, now: &mut Sighting, fit: &Fit) -> Option<Fit> {
        match_map(self.optics, self.map, now, (&fit.world_from_camera, 4.0));
        self.fit_matches(now, &fit.world_from_camera)
    }

    /// Fits the pose to the matches; those that disagree are forgotten.
    pub(crate) fn fit_matches(&self, now: &mut Sighting, start: &Isometry3<f64>) -> Option<Fit> {
        let mut sights = Vec::new();
        let mut matched = Vec::new();
        for (i, id) in now.points.iter().enumerate() {
            if let Some(point) = id.and_then(|id| self.map.point(id)) {
                matched.push(i);
                sights.push(Sight {
                    point: point.position,
                    seen: Seen::from(&now.features[i]),
                });
            }
        }
        let fit = fit_pose(self.optics, start, &sights)?;
        for (i, _) in matched.into_iter().zip(&fit.agrees).filter(|(_, a)| !**a) {
            now.forget_match(i);
        }
        Some(fit)
    }
}

/// The keyframes to compare a lost frame with: the newest, those that look most alike, and another one in turn.
pub(crate) fn candidates(map: &Map, now: &Sighting, turn: usize) -> Vec<KeyframeId> {
    const ALIKE: usize = 2;
    let all: Vec<KeyframeId> = map.keyframes.keys().rev().copied().collect();
    let newest = all.first().copied();
    let in_turn = turn.checked_rem(all.len()).map(|at| all[at]);
    let others = |id: &KeyframeId| Some(*id) != newest && Some(*id) != in_turn;
    let alike = map.places.query(&now.features).into_iter();
    let alike = alike.map(|c| c.keyframe).filter(others).take(ALIKE);
    newest
        .into_iter()
        .chain(alike)
        .chain(in_turn.filter(|id| Some(*id) != newest))
        .collect()
}
