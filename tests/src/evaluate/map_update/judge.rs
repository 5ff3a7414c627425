//! Which voxels count, and how good a map is at them.
//!
//! Only what somebody spoke of counts, the same for every rule. The inside of things is neither right nor wrong, as is where
//! something moves at the end. A surface is to be found if anybody ever spoke for it within a voxel.

use maps::evidence::{EvidenceMap, UpdateRule};
use maps::metrics::{
    OccupiedScore, Tolerance, VoxelSet, chamfer_m, neighbours, probability_rmse_percent,
};
use maps::voxel::VoxelKey;

use super::sensors::Recording;
use super::world::{HIGH, LOW, RESOLUTION_M};

/// The truth of one recording, as far as it counts.
pub(super) struct Judge {
    solid: VoxelSet,
    surface: VoxelSet,
    open: VoxelSet,
    /// Voxels whose probability counts, and whether they are truly occupied.
    judged: Vec<(VoxelKey, bool)>,
}

/// How good a rule's map is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Score {
    pub(super) precision: f64,
    pub(super) recall: f64,
    pub(super) f1: f64,
    pub(super) rmse: f64,
    /// With no tolerance; only of a [full](Judge::in_full) judgement, else 0.
    pub(super) f1_exact: f64,
    /// The same.
    pub(super) chamfer_m: f64,
}

impl Judge {
    pub(super) fn of(recording: &Recording) -> Self {
        let truth = &recording.truth;
        let set = |keys: &[VoxelKey]| keys.iter().copied().collect::<VoxelSet>();
        let near = Tolerance::NEIGHBOURS;
        let mut spoken = vec![Spoken::Nothing; volume()];
        for (key, seen) in recording.reports.iter().flat_map(|(_, seen)| seen) {
            let known = &mut spoken[index(*key)];
            *known = (*known).max(if seen.mass.occupied() > seen.mass.free() {
                Spoken::Occupied
            } else {
                Spoken::Free
            });
        }
        let said = |least: Spoken| {
            let all = spoken.iter().enumerate();
            all.filter(move |(_, spoken)| **spoken >= least)
                .map(|(at, _)| key_at(at))
        };
        let claimed: VoxelSet = said(Spoken::Occupied).collect();
        let (solid, open) = (set(&truth.solid), set(&truth.open));
        let seen_surface = truth.surface.iter().copied();
        let surface: VoxelSet = seen_surface
            .filter(|key| claimed.has_near(*key, near))
            .collect();
        let judged = said(Spoken::Free)
            .filter(|key| !open.has_near(*key, near))
            .filter_map(|key| {
                let is_true = surface.has(key);
                (is_true || !solid.has_near(key, near)).then_some((key, is_true))
            })
            .collect();
        Self {
            solid,
            surface,
            open,
            judged,
        }
    }

    /// Judges the map that a rule makes of a recording, a voxel being occupied above a probability of `threshold`.
    pub(super) fn judge<R: UpdateRule>(
        &self,
        rule: R,
        threshold: f64,
        recording: &Recording,
    ) -> Score {
        self.score(&believed(rule, recording), threshold)
    }

    /// The same, with every figure.
    pub(super) fn in_full<R: UpdateRule>(
        &self,
        rule: R,
        threshold: f64,
        recording: &Recording,
    ) -> Score {
        let probabilities = believed(rule, recording);
        let occupied = self.occupied(&probabilities, threshold);
        let exact = OccupiedScore::of(&occupied, &self.solid, &self.surface, Tolerance::EXACT);
        Score {
            f1_exact: exact.f1(),
            chamfer_m: chamfer_m(&occupied, &self.surface, RESOLUTION_M).unwrap_or(f64::NAN),
            ..self.score(&probabilities, threshold)
        }
    }

    fn occupied(&self, probabilities: &[f32], threshold: f64) -> VoxelSet {
        let all = probabilities.iter().enumerate();
        // NaN is above nothing.
        all.filter(|(_, p)| f64::from(**p) > threshold)
            .map(|(at, _)| key_at(at))
            .filter(|key| !self.open.has_near(*key, Tolerance::NEIGHBOURS))
            .collect()
    }

    fn score(&self, probabilities: &[f32], threshold: f64) -> Score {
        let occupied = self.occupied(probabilities, threshold);
        let near = Tolerance::NEIGHBOURS;
        let score = OccupiedScore::of(&occupied, &self.solid, &self.surface, near);
        let at = |key: VoxelKey| {
            let is_inside = (LOW.x..=HIGH.x).contains(&key.x)
                && (LOW.y..=HIGH.y).contains(&key.y)
                && (LOW.z..=HIGH.z).contains(&key.z);
            if is_inside {
                probabilities[index(key)]
            } else {
                f32::NAN
            }
        };
        let rmse = probability_rmse_percent(self.judged.iter().map(|(key, is_true)| {
            // As for recall, a surface may be one voxel off. `max` prefers numbers to NaN.
            let p = if *is_true {
                neighbours(*key, near).map(at).fold(f32::NAN, f32::max)
            } else {
                at(*key)
            };
            (if p.is_nan() { 0.5 } else { f64::from(p) }, *is_true)
        }));
        Score {
            precision: score.precision(),
            recall: score.recall(),
            f1: score.f1(),
            rmse: rmse.unwrap_or(0.0),
            ..Score::default()
        }
    }
}

/// The probability of being occupied at the end, by voxel; NaN where the rule knows nothing.
fn believed<R: UpdateRule>(rule: R, recording: &Recording) -> Vec<f32> {
    let mut map = EvidenceMap::new(rule, RESOLUTION_M);
    for (look, seen) in &recording.reports {
        map.observe(look, seen);
    }
    let mut probabilities = vec![f32::NAN; volume()];
    for (key, state) in map.states() {
        let mass = map.rule().mass(state, recording.end);
        if !mass.is_unknown() {
            probabilities[index(key)] = mass.probability();
        }
    }
    probabilities
}

/// What anybody ever said of a voxel.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Spoken {
    Nothing,
    Free,
    Occupied,
}

const SIZE: [usize; 3] = [
    (HIGH.x - LOW.x + 1) as usize,
    (HIGH.y - LOW.y + 1) as usize,
    (HIGH.z - LOW.z + 1) as usize,
];

fn volume() -> usize {
    SIZE.iter().product()
}

/// The place of a voxel of the street in a list of all.
pub(super) fn index(key: VoxelKey) -> usize {
    let [x, y, z] = [key.x - LOW.x, key.y - LOW.y, key.z - LOW.z].map(|c| c as usize);
    (z * SIZE[1] + y) * SIZE[0] + x
}

/// The voxel at a place in the list of all.
pub(super) fn key_at(index: usize) -> VoxelKey {
    let of = |c: usize| i32::try_from(c).unwrap_or(i32::MAX);
    let (x, rest) = (index % SIZE[0], index / SIZE[0]);
    VoxelKey::new(
        LOW.x + of(x),
        LOW.y + of(rest % SIZE[1]),
        LOW.z + of(rest / SIZE[1]),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_of_the_street_has_one_place() {
        for key in [LOW, HIGH, VoxelKey::new(100, 3, 10)] {
            assert_eq!(key_at(index(key)), key);
        }
        assert_eq!(index(HIGH) + 1, volume());
    }
}
