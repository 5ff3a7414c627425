//! Whether a new keyframe shows a place known from before, and what that says of the path in between.
//!
//! ```text
//! looks alike ─ 3-D RANSAC ─ fit by all points around there ─ enough, spread, both ways, depth agrees ─ thrice, and alike
//! (places)      (relocalise)  (matching, solver)                                                         (Streak)
//! ```
//!
//! A wrong loop bends the whole map, a missed one leaves it as it was. So every test is strict, three of four keyframes in a
//! row must pass all of them and agree on the correction, and the correction must be one that drift explains.
//!
//! - R. Mur-Artal, J. D. Tardós, *ORB-SLAM2*, IEEE T-RO 2017, section III-D.
//! - C. Campos et al., *ORB-SLAM3*, IEEE T-RO 2021, section VI (geometry before consistency).

use nalgebra::{Isometry3, Matrix6, Vector6};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng as _;

use crate::coarse::clear_of;
use crate::map::{Excerpt, KeyframeId, Link, Map, PointId};
use crate::matching::{Sighting, expected_points, match_descriptions, match_map};
use crate::optics::{Fast, Optics};
use crate::pose_graph::{Edge, Outside, PoseGraph, Trust};
use crate::relocalise::consensus_of;
use crate::solver::Fit;
use crate::tracking::Located;

/// Keyframes around an old one whose points are sought.
pub(crate) const AROUND: usize = 10;
/// Pairs by description alone that agree on a pose.
const FEWEST_PAIRS: usize = 20;
/// Of all pairs by description, those that must agree.
const PAIRS_SHARE: f64 = 0.3;
/// Points that support the pose in the end.
const FEWEST_AGREEING: usize = 50;
/// Of the points that should be in view from there, those found: in the new keyframe, and in the old one the other way.
const FOUND_SHARE: f64 = 0.15;
const FOUND_SHARE_BACK: f64 = 0.12;
/// Parts across and down the image, and how many of them must hold supporting points.
const PARTS: [f64; 2] = [4.0, 3.0];
const FEWEST_PARTS: usize = 5;
const FEWEST_IN_PART: usize = 3;
/// Of the depths that both measured, those that contradict each other.
const CONTRADICTING: f64 = 0.12;
const FEWEST_COMMON_CELLS: usize = 300;

/// A keyframe to be compared, cut out of its map with the points around it.
pub(crate) struct Place {
    id: KeyframeId,
    world_from_camera: Isometry3<f64>,
    sighting: Sighting,
    around: Excerpt,
    /// Which of the points around it sees.
    seen: Vec<Option<PointId>>,
}

impl Place {
    /// `None` if the map has no such keyframe.
    pub(crate) fn new(optics: &Optics, map: &Map, id: KeyframeId) -> Option<Self> {
        let k = map.keyframes.get(&id)?;
        let around = Excerpt::new(map, &map.around(id, AROUND));
        let find = |id: &Option<PointId>| id.and_then(|id| around.find(id));
        Some(Self {
            id,
            world_from_camera: k.world_from_camera,
            sighting: Sighting::new(optics, k.features.clone(), k.coarse.clone()),
            seen: k.points.iter().map(find).collect(),
            around,
        })
    }
}

/// A new keyframe and an old one that looks alike.
pub(crate) struct Comparison<'a> {
    optics: &'a Optics,
    now: &'a Place,
    then: &'a Place,
    /// What each of them shows of the points around the other one.
    now_shows: Sighting,
    then_shows: Sighting,
}

/// The place is the same.
#[derive(Clone, Debug)]
pub(crate) struct Sameness {
    pub(crate) now: KeyframeId,
    pub(crate) then: KeyframeId,
    /// The new keyframe's pose in the old one's map, and in its own.
    pub(crate) pose: Isometry3<f64>,
    pub(crate) pose_before: Isometry3<f64>,
    /// In the frame of the old keyframe.
    pub(crate) then_from_now: Isometry3<f64>,
    /// Of the pose's right perturbation, as fitted to the old map.
    pub(crate) covariance: Matrix6<f64>,
    /// Features of the new keyframe and the points of the old map that they show.
    pub(crate) pairs: Vec<(usize, PointId)>,
}

impl<'a> Comparison<'a> {
    /// Compares a keyframe with an older one, be it of the same map or of another one.
    pub(crate) fn new(optics: &'a Optics, now: &'a Place, then: &'a Place) -> Self {
        Self {
            optics,
            now,
            then,
            now_shows: now.sighting.clone(),
            then_shows: then.sighting.clone(),
        }
    }

    /// Whether the two show the same place beyond doubt.
    pub(crate) fn verify(mut self) -> Option<Sameness> {
        let fit = self.fit()?;
        let pose = fit.world_from_camera;
        let (there, now) = (&self.then.around, &self.now_shows);
        let expected = expected_points(self.optics, &there.map, &now.coarse, &pose).len();
        let enough =
            fit.agreeing >= FEWEST_AGREEING && fit.agreeing as f64 >= FOUND_SHARE * expected as f64;
        if !enough || !is_spread(self.optics, now) {
            return None;
        }
        if !self.is_found_back(&pose) || !self.depths_agree(&pose) {
            return None;
        }
        let shown = (0..).zip(&self.now_shows.points);
        Some(Sameness {
            now: self.now.id,
            then: self.then.id,
            pose,
            pose_before: self.now.world_from_camera,
            then_from_now: self.then.world_from_camera.inverse() * pose,
            covariance: fit.covariance,
            pairs: shown
                .filter_map(|(i, id)| Some((i, there.name((*id)?)?)))
                .collect(),
        })
    }

    /// The new keyframe's pose in the old map, by description alone, then by all points around there.
    fn fit(&mut self) -> Option<Fit> {
        let (optics, map) = (self.optics, &self.then.around.map);
        let now = &mut self.now_shows;
        let seed = u64::from(self.now.id.0) << 32 | u64::from(self.then.id.0);
        let mut rng = Pcg64::seed_from_u64(seed);
        let matches = match_descriptions(&now.features, map, &self.then.seen);
        let all = matches.len();
        let (pose, agreeing) = consensus_of((optics, map), &now.features, matches, &mut rng)?;
        if agreeing.len() < FEWEST_PAIRS || (agreeing.len() as f64) < PAIRS_SHARE * all as f64 {
            return None;
        }
        for (feature, id, distance) in agreeing {
            now.claim(feature, id, distance);
        }
        let known = Located { optics, map };
        let mut fit = known.fit_matches(now, &pose, None)?;
        for radius in [10.0, 4.0] {
            match_map(optics, map, now, (&fit.world_from_camera, radius));
            fit = known.fit_matches(now, &fit.world_from_camera, None)?;
        }
        Some(fit)
    }

    /// Whether the old keyframe, seen from the new one's map, shows that map's points.
    fn is_found_back(&mut self, pose: &Isometry3<f64>) -> bool {
        let optics = self.optics;
        let then_in_new_map =
            self.now.world_from_camera * pose.inverse() * self.then.world_from_camera;
        let (map, then) = (&self.now.around.map, &mut self.then_shows);
        match_map(optics, map, then, (&then_in_new_map, 6.0));
        let known = Located { optics, map };
        let Some(fit) = known.fit_matches(then, &then_in_new_map, None) else {
            return false;
        };
        let pose = fit.world_from_camera;
        let expected = expected_points(optics, map, &then.coarse, &pose).len();
        let off = then_in_new_map.inverse() * pose;
        fit.agreeing >= FEWEST_AGREEING / 2
            && fit.agreeing as f64 >= FOUND_SHARE_BACK * expected as f64
            && off.translation.vector.norm() < 0.15
            && off.rotation.angle() < 0.06
    }

    /// Whether neither of the two looks through what the other one saw.
    fn depths_agree(&self, pose: &Isometry3<f64>) -> bool {
        let optics = self.optics;
        let then_from_now = self.then.world_from_camera.inverse() * pose;
        let (now, then) = (&self.now.sighting, &self.then.sighting);
        let forth = contradictions(optics, (now, then), &Fast::new(&then_from_now));
        let back = contradictions(optics, (then, now), &Fast::new(&then_from_now.inverse()));
        [forth, back].iter().all(|&(against, common)| {
            common >= FEWEST_COMMON_CELLS.min(optics.cell_count() / 8)
                && against as f64 <= CONTRADICTING * common as f64
        })
    }
}

/// Of the cells of `a` whose surface `b` should see: those that `b` looks through, and all that are not hidden from it.
fn contradictions(
    optics: &Optics,
    (a, b): (&Sighting, &Sighting),
    b_from_a: &Fast,
) -> (usize, usize) {
    let (mut against, mut common) = (0, 0);
    for cell in (0..optics.cell_count()).step_by(3) {
        let depth = a.coarse.depth_m[cell];
        if depth <= 0.0 || a.coarse.moving[cell] {
            continue;
        }
        let p = b_from_a.apply(&optics.cell_point(cell, depth));
        let Some(there) = optics.cell_of(&p) else {
            continue;
        };
        let near = b.coarse.near_m[there];
        if near <= 0.0 || b.coarse.moving[there] || b.coarse.hides(there, p.z) {
            continue;
        }
        common += 1;
        against += usize::from(near > p.z + 1.5 * clear_of(near));
    }
    (against, common)
}

/// Whether the matched features lie all over the image.
fn is_spread(optics: &Optics, now: &Sighting) -> bool {
    let [across, down] = PARTS;
    let size = [optics.camera.width as f64, optics.camera.height as f64];
    let mut counts = vec![0; (across * down) as usize];
    for (f, _) in now
        .features
        .iter()
        .zip(&now.points)
        .filter(|(_, p)| p.is_some())
    {
        let column = (f64::from(f.raw[0]) / size[0] * across).clamp(0.0, across - 1.0) as usize;
        let row = (f64::from(f.raw[1]) / size[1] * down).clamp(0.0, down - 1.0) as usize;
        counts[row * across as usize + column] += 1;
    }
    counts
        .iter()
        .filter(|&&count| count >= FEWEST_IN_PART)
        .count()
        >= FEWEST_PARTS
}

/// How many keyframes in a row have recognised a place and agree on where it is.
#[derive(Default)]
pub(crate) struct Streak {
    /// Number of the map the place is in.
    map: u32,
    found: Vec<Sameness>,
    missed: usize,
}

impl Streak {
    const ENOUGH: usize = 3;
    /// So much may the corrections differ by which two keyframes would be moved.
    const APART_M: f64 = 0.12;
    const APART_RAD: f64 = 0.06;

    /// Nothing was recognised in a keyframe.
    pub(crate) fn miss(&mut self) {
        self.missed += 1;
        if self.missed > 1 {
            self.found.clear();
        }
    }

    /// A place of a map was recognised; all that speaks for it, once that is enough.
    pub(crate) fn add(&mut self, map: u32, found: Sameness) -> Option<Vec<Sameness>> {
        let agrees = |before: &Sameness| {
            let guess = before.pose * before.pose_before.inverse() * found.pose_before;
            let off = guess.inverse() * found.pose;
            off.translation.vector.norm() < Self::APART_M && off.rotation.angle() < Self::APART_RAD
        };
        if self.map != map || !self.found.last().is_some_and(agrees) {
            self.found.clear();
        }
        (self.map, self.missed) = (map, 0);
        self.found.push(found);
        (self.found.len() >= Self::ENOUGH).then(|| std::mem::take(&mut self.found))
    }

    /// Says of each what is known now of the poses of its keyframes; where one is gone, all that was found is forgotten.
    pub(crate) fn update(&mut self, mut now: impl FnMut(u32, Sameness) -> Option<Sameness>) {
        let found = std::mem::take(&mut self.found).into_iter();
        let updated: Option<Vec<Sameness>> = found.map(|found| now(self.map, found)).collect();
        self.found = updated.unwrap_or_default();
    }

    /// What was found before no longer holds: keyframes have moved or changed their names.
    pub(crate) fn forget(&mut self) {
        self.found.clear();
    }
}

/// Whether drift on the way from the old keyframe to the new one can be as large as the correction says. Tracking drifts
/// by less than 2 % of the way; the rest is margin.
pub(crate) fn is_plausible(map: &Map, found: &Sameness) -> bool {
    let path = map.poses.get(found.then.0 as usize..=found.now.0 as usize);
    let steps = path.unwrap_or_default().windows(2);
    let way_m: f64 = steps
        .map(|pair| (pair[1].translation.vector - pair[0].translation.vector).norm())
        .sum();
    let off = found.pose_before.inverse() * found.pose;
    off.translation.vector.norm() < 0.3 + 0.1 * way_m
        && off.rotation.angle() < (0.15 + 0.03 * way_m).min(0.7)
}

/// The pose graph of a map: every keyframe, tied to the one before, to those it shares most points with, and by the loops.
///
/// `tracked` are the standard deviations, in metres and radians, of an edge that was tracked: see [`drift_of`] and
/// [`usual_drift`].
pub(crate) fn graph(map: &Map, tracked: [f64; 2]) -> (Vec<KeyframeId>, PoseGraph) {
    let ids: Vec<KeyframeId> = map.keyframes.keys().copied().collect();
    let index = |id: KeyframeId| ids.binary_search(&id).ok();
    let mut edges = Vec::new();
    for (to, id) in ids.iter().enumerate() {
        let others = covisible(map, *id);
        let before = to.checked_sub(1).map(|from| {
            let apart = map
                .starts
                .iter()
                .any(|start| ids[from] < *start && *start <= *id);
            (
                from,
                if apart {
                    [UNTRACKED_M, UNTRACKED_RAD]
                } else {
                    tracked
                },
            )
        });
        let others = others.into_iter().filter_map(index);
        let ties = before.into_iter().chain(others.map(|from| (from, tracked)));
        for (from, sigma) in ties {
            if edges
                .iter()
                .rev()
                .take(4 * MOST_COVISIBLE)
                .any(|e: &Edge| (e.from, e.to) == (from, to))
            {
                continue;
            }
            let from_from_to = map.poses[ids[from].0 as usize].inverse() * map.poses[id.0 as usize];
            let longer = 1.0 + from_from_to.translation.vector.norm();
            edges.push(Edge {
                from,
                to,
                from_from_to,
                information: information(sigma.map(|s| s * longer)),
                trust: Trust::Certain,
            });
        }
    }
    let recognised = map.links.iter().filter_map(|link| {
        Some(Edge {
            from: index(link.from)?,
            to: index(link.to)?,
            from_from_to: link.from_from_to,
            information: information([LOOP_M, LOOP_RAD]),
            trust: Trust::Robust,
        })
    });
    edges.extend(recognised);
    let graph = PoseGraph {
        poses: ids.iter().map(|id| map.poses[id.0 as usize]).collect(),
        fixed: ids
            .partition_point(|id| *id < map.fixed)
            .min(ids.len().saturating_sub(1)),
        edges,
        outside: Outside::default(),
    };
    (ids, graph)
}

/// Standard deviations of a recognised pose.
const LOOP_M: f64 = 0.02;
const LOOP_RAD: f64 = 0.01;
/// Of a tracked edge at least, in metres and radians: where a loop shows a drift, and where nothing does. Over 170
/// edges of 0.9 m the second bends a way by 0.2 m, about what is measured over streets.
const LEAST_DRIFT: [f64; 2] = [0.005, 0.002];
const LEAST_USUAL_DRIFT: [f64; 2] = [0.001, 0.000_2];
/// Of a step that was not tracked.
const UNTRACKED_M: f64 = 10.0;
const UNTRACKED_RAD: f64 = 3.0;
/// Keyframes to which one is tied, apart from the one before, and the points they must share.
const MOST_COVISIBLE: usize = 4;
const FEWEST_COVISIBLE: usize = 50;

/// Standard deviations of a tracked edge, where a loop says how far tracking has drifted: those that make its correction a
/// likely one. What counts is how the edges compare.
pub(crate) fn drift_of(map: &Map, newest: &Sameness) -> [f64; 2] {
    let between = map.keyframes.range(newest.then..=newest.now).count();
    let off = newest.pose_before.inverse() * newest.pose;
    per_edge(
        [off.translation.vector.norm(), off.rotation.angle()],
        between.saturating_sub(1),
        LEAST_DRIFT,
    )
}

/// The same where nothing says so but what the newest keyframe believes of itself.
pub(crate) fn usual_drift(map: &Map) -> [f64; 2] {
    let newest = map.keyframes.values().next_back();
    let [position_m, attitude_rad] = newest.map_or([0.0; 2], |k| k.drift.sigmas());
    per_edge(
        [position_m, attitude_rad],
        map.keyframes.len(),
        LEAST_USUAL_DRIFT,
    )
}

fn per_edge(off: [f64; 2], edges: usize, least: [f64; 2]) -> [f64; 2] {
    let share = (edges.max(1) as f64).sqrt().recip();
    [0, 1].map(|i| (off[i] * share).max(least[i]))
}

fn information([sigma_m, sigma_rad]: [f64; 2]) -> Matrix6<f64> {
    let (t, r) = (sigma_m.powi(-2), sigma_rad.powi(-2));
    Matrix6::from_diagonal(&Vector6::new(t, t, t, r, r, r))
}

/// The older keyframes that share most points with one.
fn covisible(map: &Map, id: KeyframeId) -> Vec<KeyframeId> {
    let mut shared: Vec<(usize, KeyframeId)> = map
        .shared(&[id])
        .into_iter()
        .filter(|&(other, count)| other < id && count >= FEWEST_COVISIBLE)
        .map(|(other, count)| (count, other))
        .collect();
    shared.sort_unstable_by(|a, b| b.cmp(a));
    shared.truncate(MOST_COVISIBLE);
    shared.into_iter().map(|(_, other)| other).collect()
}

impl From<&Sameness> for Link {
    fn from(found: &Sameness) -> Self {
        Self {
            from: found.then,
            to: found.now,
            from_from_to: found.then_from_now,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::map::tests::keyframe;

    fn at(x: f64, heading: f64) -> Isometry3<f64> {
        Isometry3::new(Vector3::new(x, 0.0, 0.0), Vector3::new(0.0, 0.0, heading))
    }

    /// Keyframe `now`, which believes to be at `believed`, has recognised a place that puts it elsewhere by `shift`.
    fn found(now: u32, believed: &Isometry3<f64>, shift: &Isometry3<f64>) -> Sameness {
        Sameness {
            now: KeyframeId(now),
            then: KeyframeId(0),
            pose: shift * believed,
            pose_before: *believed,
            then_from_now: shift * believed,
            covariance: Matrix6::identity(),
            pairs: Vec::new(),
        }
    }

    #[test]
    fn three_keyframes_that_agree_are_enough_and_one_miss_is_forgiven() {
        let shift = at(0.5, 0.02);
        let mut streak = Streak::default();
        assert!(streak.add(0, found(10, &at(1.0, 0.1), &shift)).is_none());
        streak.miss();
        assert!(streak.add(0, found(12, &at(1.3, 0.2), &shift)).is_none());
        let nearly = at(0.53, 0.03);
        let evidence = streak.add(0, found(13, &at(1.5, 0.2), &nearly));
        let names: Vec<_> = evidence.into_iter().flatten().map(|f| f.now.0).collect();
        assert_eq!(names, [10, 12, 13]);
        assert!(
            streak.add(0, found(14, &at(1.7, 0.2), &shift)).is_none(),
            "it begins anew"
        );
    }

    #[test]
    fn keyframes_that_disagree_or_miss_twice_begin_anew() {
        let shift = at(0.5, 0.0);
        let count = |between: &dyn Fn(&mut Streak)| {
            let mut streak = Streak::default();
            streak.add(0, found(10, &at(1.0, 0.0), &shift));
            streak.add(0, found(11, &at(1.2, 0.0), &shift));
            between(&mut streak);
            streak
                .add(0, found(12, &at(1.4, 0.0), &shift))
                .map_or(0, |all| all.len())
        };
        assert_eq!(count(&|_| {}), 3);
        assert_eq!(count(&|s| (0..2).for_each(|_| s.miss())), 0);
        assert_eq!(
            count(&|s| drop(s.add(0, found(11, &at(1.3, 0.0), &at(0.8, 0.0))))),
            0
        );
        assert_eq!(
            count(&|s| drop(s.add(0, found(11, &at(1.3, 0.0), &at(0.5, 0.1))))),
            0
        );
        assert_eq!(
            count(&|s| drop(s.add(7, found(11, &at(1.3, 0.0), &shift)))),
            0,
            "another map"
        );
        assert_eq!(count(&Streak::forget), 0);
    }

    /// Keyframes in a row, half a metre apart, each of which shares no point with another.
    fn row(count: u32) -> Map {
        let mut map = Map::default();
        for i in 0..count {
            let id = map.add_keyframe(keyframe(vec![None]));
            map.set_pose(id, at(0.5 * f64::from(i), 0.0));
        }
        map
    }

    #[test]
    fn drift_is_plausible_only_in_proportion_to_the_way() {
        let map = row(21);
        let believed = map.poses[20];
        let check =
            |x: f64, heading: f64| is_plausible(&map, &found(20, &believed, &at(x, heading)));
        assert!(check(1.2, 0.0), "a tenth of 10 m");
        assert!(!check(1.5, 0.0));
        let turned = |angle: f64| {
            let pose = believed * at(0.0, angle);
            is_plausible(
                &map,
                &Sameness {
                    pose,
                    ..found(20, &believed, &at(0.0, 0.0))
                },
            )
        };
        assert!(turned(0.4) && !turned(0.5));
        let short = Sameness {
            then: KeyframeId(18),
            ..found(20, &believed, &at(0.6, 0.0))
        };
        assert!(!is_plausible(&map, &short), "not within a metre");
    }

    #[test]
    fn the_graph_of_a_map_spreads_a_loop_and_leaves_the_fixed_keyframe() {
        let mut map = row(21);
        let newest = found(20, &map.poses[20], &at(-0.4, 0.0));
        map.links.push(Link::from(&newest));
        map.remove_keyframe(KeyframeId(7));
        let (ids, graph) = graph(&map, drift_of(&map, &newest));
        assert_eq!(
            (ids.len(), graph.edges.len()),
            (20, 20),
            "19 steps and the loop"
        );
        let poses = graph.solve().expect("connected").poses;
        let x: Vec<f64> = poses.iter().map(|p| p.translation.vector.x).collect();
        assert!(x[0].abs() < 1e-9, "fixed");
        assert!((x[19] - 9.6).abs() < 0.02, "{} m instead of 9.6", x[19]);
        assert!(
            (x[9] - 4.8).abs() < 0.05,
            "half way, half of the correction: {}",
            x[9]
        );
    }

    #[test]
    fn a_step_that_was_not_tracked_bends_first() {
        let mut map = row(21);
        map.starts.push(KeyframeId(15));
        let newest = found(20, &map.poses[20], &at(-0.4, 0.0));
        map.links.push(Link::from(&newest));
        let poses = graph(&map, drift_of(&map, &newest))
            .1
            .solve()
            .expect("connected")
            .poses;
        let x: Vec<f64> = poses.iter().map(|p| p.translation.vector.x).collect();
        assert!(
            (x[14] - 7.0).abs() < 0.01 && (x[15] - 7.1).abs() < 0.02,
            "{x:?}"
        );
    }
}
