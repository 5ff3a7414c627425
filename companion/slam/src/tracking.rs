//! Where a frame was taken, from the points of the map that it shows.

use nalgebra::{Isometry3, Point3};
use rand_pcg::Pcg64;

use crate::map::{KeyframeId, Map, PointId};
use crate::matching::{Sighting, match_last, match_map};
use crate::motion::{Guess, Motion};
use crate::optics::Optics;
use crate::relocalise::relocalise;
use crate::solver::{Fit, PIXEL_GATE, Prior, Seen, Sight, fit_pose};

/// The least number of points that supports a pose.
pub(crate) const FEWEST: usize = 15;
/// The least number of matches with the last frame that is worth a fit.
const FEWEST_AT_FIRST: usize = 20;
/// Of the matches near an inertial unit's guess, the least share that stands where the rest moves.
const LEAST_STATIC: f64 = 0.15;
/// Standard deviations that the camera may be off the guess.
const SIGMAS: f64 = 4.0;
/// The least number of points that supports a pose found among all keyframes, without a guess.
const FEWEST_FOUND_AGAIN: usize = 30;

/// What is known to locate a frame by.
pub(crate) struct Located<'a> {
    pub(crate) optics: &'a Optics,
    pub(crate) map: &'a Map,
}

impl Located<'_> {
    /// Follows the motion from the last frame: first near where it should be by the guess, then in wider circles.
    pub(crate) fn follow(
        &self,
        last: &Sighting,
        motion: &Motion,
        guess: &Guess,
        now: &mut Sighting,
    ) -> Option<Fit> {
        self.follow_static(last, guess, now).or_else(|| {
            [(guess.pose, 14.0), (guess.pose, 35.0), (motion.pose, 60.0)]
                .into_iter()
                .find_map(|(guess, radius)| {
                    self.match_near(last, (&guess, radius), now)?;
                    let fit = self.fit_matches(now, &guess, None)?;
                    self.refine(now, &fit).filter(|fit| fit.agreeing >= FEWEST)
                })
        })
    }

    /// Something large that moves may have more points than all that stands. But where an inertial unit tells how the camera
    /// has moved, what stands is where it should be: so the fit begins with that, if it is not next to nothing.
    ///
    /// - J. Civera et al., *1-Point RANSAC for Extended Kalman Filtering*, JFR 2010: matches are judged by the prediction.
    fn follow_static(&self, last: &Sighting, guess: &Guess, now: &mut Sighting) -> Option<Fit> {
        let prior = guess.prior?;
        let reach_m = SIGMAS * prior.sigma_m;
        self.match_near(last, (&guess.pose, 14.0), now)?;
        let least = FEWEST_AT_FIRST.max((LEAST_STATIC * now.matched() as f64) as usize);
        self.forget_displaced(now, &guess.pose, reach_m);
        let is_near = |fit: &Fit| {
            let off = fit.world_from_camera.translation.vector - guess.pose.translation.vector;
            fit.agreeing >= least && off.norm() <= reach_m
        };
        // Where even these points would go with what moves, the guess is hardly left at all.
        let hard = Prior {
            sigma_m: prior.sigma_m / SIGMAS,
            ..prior
        };
        let near = now.points.clone();
        let (fit, prior) = [prior, hard].into_iter().find_map(|prior| {
            now.points.clone_from(&near);
            let fit = self.fit_matches(now, &guess.pose, Some(prior))?;
            is_near(&fit).then_some((fit, prior))
        })?;
        match_map(self.optics, self.map, now, (&fit.world_from_camera, 4.0));
        self.forget_displaced(now, &fit.world_from_camera, prior.sigma_m);
        // The points alone know better, but for that.
        let near = now.points.clone();
        let free = self.fit_matches(now, &fit.world_from_camera, None);
        free.filter(is_near).or_else(|| {
            now.points = near;
            self.fit_matches(now, &fit.world_from_camera, Some(prior))
                .filter(|held| held.agreeing >= FEWEST)
        })
    }

    /// Forgets the matches that are not where they should be, seen from somewhere so near this pose.
    fn forget_displaced(&self, now: &mut Sighting, pose: &Isometry3<f64>, reach_m: f64) {
        let camera_from_world = pose.inverse();
        let (matched, sights) = self.sights(now);
        for (i, sight) in matched.into_iter().zip(sights) {
            let p = (camera_from_world * Point3::from(sight.point)).coords;
            let is_there = self.optics.project(&p).is_some_and(|[u, v]| {
                let off = (u - sight.seen.pixel[0]).hypot(v - sight.seen.pixel[1]);
                let parallax = self.optics.camera.fx * reach_m / p.z;
                off <= PIXEL_GATE.sqrt() * sight.seen.sigma + parallax
            });
            if !is_there {
                now.forget_match(i);
            }
        }
    }

    fn match_near(
        &self,
        last: &Sighting,
        near: (&Isometry3<f64>, f64),
        now: &mut Sighting,
    ) -> Option<()> {
        now.forget_matches();
        match_last(self.optics, self.map, last, now, near);
        (now.matched() >= FEWEST_AT_FIRST).then_some(())
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
            let fit = self.fit_matches(now, &pose, None)?;
            self.refine(now, &fit)
                .filter(|fit| fit.agreeing >= FEWEST_FOUND_AGAIN)
        })
    }

    /// Adds the points of the whole map that should be in view, and fits again.
    fn refine(&self, now: &mut Sighting, fit: &Fit) -> Option<Fit> {
        match_map(self.optics, self.map, now, (&fit.world_from_camera, 4.0));
        self.fit_matches(now, &fit.world_from_camera, None)
    }

    /// Fits the pose to the matches; those that disagree are forgotten.
    pub(crate) fn fit_matches(
        &self,
        now: &mut Sighting,
        start: &Isometry3<f64>,
        prior: Option<Prior>,
    ) -> Option<Fit> {
        let (matched, sights) = self.sights(now);
        let fit = fit_pose(self.optics, start, &sights, prior)?;
        for (i, _) in matched.into_iter().zip(&fit.agrees).filter(|(_, a)| !**a) {
            now.forget_match(i);
        }
        Some(fit)
    }

    /// Which features are matched, and what they see.
    fn sights(&self, now: &Sighting) -> (Vec<usize>, Vec<Sight>) {
        let of = |(i, id): (usize, &Option<PointId>)| {
            let point = self.map.point((*id)?)?.position;
            let seen = Seen::from(&now.features[i]);
            Some((i, Sight { point, seen }))
        };
        now.points.iter().enumerate().filter_map(of).unzip()
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
