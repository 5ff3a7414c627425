//! How far a map is from the truth.
//!
//! ```text
//! precision = right occupied voxels / occupied voxels of the map                                  Eq. (28)
//! recall    = true occupied voxels that the map has / true occupied voxels                        Eq. (29)
//! F1        = 2 · precision · recall / (precision + recall)                                       Eq. (30)
//! RMSE      = 100 · √(Σ (p - z)² / n)        p believed, z 1 where truly occupied, else 0         Eq. (31)
//! chamfer   = ½ (mean distance of the map's surface to the true one + the other way round)
//! coverage  = share of the true surface that the map knows anything of
//! ```
//!
//! The paper's text does not say how near is near enough, nor what its RMSE is measured in. Our reading: a surface that
//! falls into the next voxel, which noise of a centimetre can do, is right, so distances up to [`Tolerance`] count as
//! equal, and [`Tolerance::EXACT`] gives the strict figure. The RMSE is that of the probability of being occupied, in per
//! cent: the paper's 2 to 19 fit the share of voxels that a map with its F1 gets wrong, while a distance in centimetres
//! could not go below the rounding of 0.1 m voxels (2.9 cm) to its best value, 2.1.
//!
//! - Li et al., *Multi-Source Heterogeneous Collaborative Perception System Based on UAV and UGV*, Drones 2026, 10(6), 470,
//!   Eq. (28)–(31).

use std::collections::HashMap;
use std::hash::BuildHasherDefault;

use crate::voxel::VoxelKey;
use crate::voxel::grid::{TileHasher, voxel_index};

/// How many voxels something may be off along each axis and still count as the same place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tolerance(pub u8);

impl Tolerance {
    /// The very voxel.
    pub const EXACT: Self = Self(0);
    /// The voxel or one of the 26 around it.
    pub const NEIGHBOURS: Self = Self(1);
}

/// A set of voxels.
#[derive(Clone, Debug, Default)]
pub struct VoxelSet {
    /// Sorted, each once.
    keys: Vec<VoxelKey>,
    /// The same, a bit each, by block of 8³: what is found by hash is never listed.
    blocks: HashMap<VoxelKey, [u64; 8], BuildHasherDefault<TileHasher>>,
}

impl FromIterator<VoxelKey> for VoxelSet {
    fn from_iter<I: IntoIterator<Item = VoxelKey>>(keys: I) -> Self {
        let mut keys: Vec<_> = keys.into_iter().collect();
        keys.sort_unstable();
        keys.dedup();
        let mut set = Self::default();
        for key in &keys {
            let index = voxel_index(*key);
            set.blocks.entry(block_of(*key)).or_default()[index / 64] |= 1 << (index % 64);
        }
        Self { keys, ..set }
    }
}

impl VoxelSet {
    /// How many.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// In order.
    pub fn iter(&self) -> impl Iterator<Item = VoxelKey> {
        self.keys.iter().copied()
    }

    /// Whether it has this voxel.
    pub fn has(&self, key: VoxelKey) -> bool {
        let index = voxel_index(key);
        self.blocks
            .get(&block_of(key))
            .is_some_and(|block| block[index / 64] >> (index % 64) & 1 == 1)
    }

    /// Whether it has a voxel at `key` or within the tolerance of it.
    pub fn has_near(&self, key: VoxelKey, tolerance: Tolerance) -> bool {
        self.has(key) || neighbours(key, tolerance).any(|near| self.has(near))
    }
}

fn block_of(key: VoxelKey) -> VoxelKey {
    VoxelKey::new(key.x >> 3, key.y >> 3, key.z >> 3)
}

/// Every voxel within the tolerance of `key`, itself included. Saturates at the end of the integers.
pub fn neighbours(key: VoxelKey, tolerance: Tolerance) -> impl Iterator<Item = VoxelKey> {
    let reach = i32::from(tolerance.0);
    let span = move || -reach..=reach;
    span().flat_map(move |z| {
        span().flat_map(move |y| {
            span().map(move |x| {
                VoxelKey::new(
                    key.x.saturating_add(x),
                    key.y.saturating_add(y),
                    key.z.saturating_add(z),
                )
            })
        })
    })
}

/// Precision, recall and F1 of the occupied voxels of a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OccupiedScore {
    /// Occupied voxels of the map.
    pub believed: usize,
    /// Those of them where something is.
    pub right: usize,
    /// True occupied voxels.
    pub truths: usize,
    /// Those of them that the map has.
    pub found: usize,
}

impl OccupiedScore {
    /// Of a map's occupied voxels. Each is right if it is near anything of `solid`; each of `surface`, what a map should
    /// have, is found if it is near one of them. Where the inside of things is of no interest, `solid` and `surface` are
    /// the same.
    pub fn of(
        believed: &VoxelSet,
        solid: &VoxelSet,
        surface: &VoxelSet,
        tolerance: Tolerance,
    ) -> Self {
        let near = |of: &VoxelSet, to: &VoxelSet| {
            of.iter().filter(|key| to.has_near(*key, tolerance)).count()
        };
        Self {
            believed: believed.len(),
            right: near(believed, solid),
            truths: surface.len(),
            found: near(surface, believed),
        }
    }

    /// The share of what the map has that is right, Eq. (28); 1 of a map that has nothing: it claims nothing wrong.
    pub fn precision(&self) -> f64 {
        share(self.right, self.believed)
    }

    /// The share of what is there that the map has, Eq. (29); 1 where nothing is.
    pub fn recall(&self) -> f64 {
        share(self.found, self.truths)
    }

    /// The harmonic mean of both, Eq. (30); 0 if both are.
    pub fn f1(&self) -> f64 {
        let (precision, recall) = (self.precision(), self.recall());
        let sum = precision + recall;
        if sum > 0.0 {
            2.0 * precision * recall / sum
        } else {
            0.0
        }
    }
}

fn share(part: usize, whole: usize) -> f64 {
    if whole == 0 {
        1.0
    } else {
        part as f64 / whole as f64
    }
}

/// The root mean square error of probabilities of being occupied, in per cent, Eq. (31): `(believed, whether it is true)`.
/// Within 0..=100; `None` of nothing, NaN if one is.
pub fn probability_rmse_percent(voxels: impl IntoIterator<Item = (f64, bool)>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0_u64);
    for (believed, is_true) in voxels {
        sum += (believed - f64::from(u8::from(is_true))).powi(2);
        count += 1;
    }
    (count > 0).then(|| 100.0 * (sum / count as f64).sqrt())
}

/// The chamfer distance between two sets of voxels, in metres: the mean of how far each is from the other on average, to
/// the nearest voxel's centre. `None` if one is empty. Costs a search of growing shells a voxel: cheap where they are close.
pub fn chamfer_m(a: &VoxelSet, b: &VoxelSet, resolution_m: f64) -> Option<f64> {
    Some(0.5 * resolution_m * (mean_distance(a, b)? + mean_distance(b, a)?))
}

/// The share of `surface` within the tolerance of something of `known`; 1 if there is no surface.
pub fn coverage(surface: &VoxelSet, known: &VoxelSet, tolerance: Tolerance) -> f64 {
    let covered = surface.iter().filter(|key| known.has_near(*key, tolerance));
    share(covered.count(), surface.len())
}

/// In voxels.
fn mean_distance(from: &VoxelSet, to: &VoxelSet) -> Option<f64> {
    if from.is_empty() || to.is_empty() {
        return None;
    }
    let sum: f64 = from.iter().map(|key| nearest(key, &to.keys)).sum();
    Some(sum / from.len() as f64)
}

/// The distance to the nearest of some voxels, sorted and not none, searched outward along x: a voxel further off in x than
/// the best so far ends the search.
fn nearest(key: VoxelKey, sorted: &[VoxelKey]) -> f64 {
    let along = |a: i32, b: i32| (f64::from(a) - f64::from(b)).powi(2);
    let (before, after) = sorted.split_at(sorted.partition_point(|other| other.x < key.x));
    let mut best = f64::INFINITY;
    let mut search = |others: &mut dyn Iterator<Item = &VoxelKey>| {
        for other in others {
            let x = along(other.x, key.x);
            if x >= best {
                break;
            }
            best = best.min(x + along(other.y, key.y) + along(other.z, key.z));
        }
    };
    search(&mut after.iter());
    search(&mut before.iter().rev());
    best.sqrt()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_set() -> impl Strategy<Value = VoxelSet> {
        prop::collection::vec(prop::array::uniform3(-8_i32..8), 1..30).prop_map(|keys| {
            keys.into_iter()
                .map(|[x, y, z]| VoxelKey::new(x, y, z))
                .collect()
        })
    }

    fn row(x: std::ops::Range<i32>, y: i32) -> VoxelSet {
        x.map(|x| VoxelKey::new(x, y, 0)).collect()
    }

    proptest! {
        #[test]
        fn a_map_is_as_good_as_it_can_be_at_itself(set in any_set()) {
            let score = OccupiedScore::of(&set, &set, &set, Tolerance::EXACT);
            prop_assert_eq!((score.precision(), score.recall(), score.f1()), (1.0, 1.0, 1.0));
            prop_assert_eq!(chamfer_m(&set, &set, 0.1), Some(0.0));
        }

        #[test]
        fn the_chamfer_distance_is_that_of_comparing_all_with_all(a in any_set(), b in any_set()) {
            let mean = |a: &VoxelSet, b: &VoxelSet| {
                let distance = |p: VoxelKey, q: VoxelKey| {
                    let [x, y, z] = [p.x - q.x, p.y - q.y, p.z - q.z].map(f64::from);
                    (x * x + y * y + z * z).sqrt()
                };
                let least = |p| b.iter().map(|q| distance(p, q)).fold(f64::INFINITY, f64::min);
                a.iter().map(least).sum::<f64>() / a.len() as f64
            };
            let expected = 0.1 * (mean(&a, &b) + mean(&b, &a)) / 2.0;
            let chamfer = chamfer_m(&a, &b, 0.1).expect("neither is empty");
            prop_assert!((chamfer - expected).abs() < 1e-9, "{chamfer} {expected}");
        }

        #[test]
        fn more_tolerance_never_makes_it_worse(a in any_set(), b in any_set()) {
            let f1 = |tolerance| OccupiedScore::of(&a, &b, &b, Tolerance(tolerance)).f1();
            prop_assert!(f1(0) <= f1(1) && f1(1) <= f1(2));
        }
    }

    #[test]
    fn precision_counts_what_is_believed_and_recall_what_is_true() {
        let score = OccupiedScore::of(
            &row(0..8, 0),
            &row(2..12, 0),
            &row(2..12, 0),
            Tolerance::EXACT,
        );
        assert_eq!((score.precision(), score.recall()), (0.75, 0.6));
        assert!((score.f1() - 2.0 / 3.0).abs() < 1e-12, "2 · 0.45 / 1.35");
    }

    #[test]
    fn a_wall_one_voxel_off_is_right_with_a_tolerance_of_one() {
        let score = |tolerance| {
            OccupiedScore::of(&row(0..8, 1), &row(0..8, 0), &row(0..8, 0), tolerance).f1()
        };
        assert_eq!(
            (score(Tolerance::EXACT), score(Tolerance::NEIGHBOURS)),
            (0.0, 1.0)
        );
    }

    #[test]
    fn the_inside_of_things_is_neither_wrong_nor_missed() {
        let inside: VoxelSet = (0..3).flat_map(|y| row(0..8, y).keys).collect();
        let score = OccupiedScore::of(&row(0..8, 1), &inside, &row(0..8, 0), Tolerance::NEIGHBOURS);
        assert_eq!((score.precision(), score.recall()), (1.0, 1.0));
    }

    #[test]
    fn not_to_know_costs_half() {
        let rmse = probability_rmse_percent([(0.5, true), (0.5, false)]);
        assert_eq!(rmse, Some(50.0));
        assert_eq!(probability_rmse_percent([]), None);
    }

    #[test]
    fn nothing_is_covered_by_nothing() {
        let none = VoxelSet::default();
        let covered = |by: &VoxelSet| coverage(&row(0..4, 0), by, Tolerance::NEIGHBOURS);
        assert_eq!((covered(&none), covered(&row(0..1, 0))), (0.0, 0.5));
        assert_eq!(chamfer_m(&none, &none, 0.1), None);
    }
}
