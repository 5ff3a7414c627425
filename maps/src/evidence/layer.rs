//! The states of all voxels that anybody spoke of.

use std::collections::BTreeMap;

use super::{Look, Mass, Mobility, Observation, UpdateRule};
use crate::time::Stamp;
use crate::voxel::block::VOLUME;
use crate::voxel::grid::voxel_index;
use crate::voxel::{ClassId, LogOdds, Voxel, VoxelKey, VoxelMap};

/// Evidence by voxel, in blocks of 8³, ordered by block and voxel.
///
/// A block costs 512 states: 28 KB with our rule, however few of its voxels were seen.
#[derive(Clone, Debug)]
pub struct EvidenceMap<R: UpdateRule> {
    rule: R,
    resolution_m: f64,
    /// By block: z above y above x.
    blocks: BTreeMap<[i32; 3], Block<R::State>>,
}

#[derive(Clone, Debug)]
struct Block<S> {
    /// Which voxels somebody spoke of.
    seen: [u64; VOLUME / 64],
    states: Vec<S>,
}

impl<S: Clone + Default> Block<S> {
    fn new() -> Self {
        Self {
            seen: [0; VOLUME / 64],
            states: vec![S::default(); VOLUME],
        }
    }

    fn get(&self, index: usize) -> Option<&S> {
        (self.seen[index / 64] >> (index % 64) & 1 == 1).then(|| &self.states[index])
    }
}

impl<R: UpdateRule> EvidenceMap<R> {
    /// An empty layer over voxels with this edge.
    ///
    /// # Panics
    ///
    /// Unless the resolution is within [`VoxelMap::RESOLUTION_M`].
    pub fn new(rule: R, resolution_m: f64) -> Self {
        assert!(
            VoxelMap::RESOLUTION_M.contains(&resolution_m),
            "a voxel of {resolution_m} m"
        );
        Self {
            rule,
            resolution_m,
            blocks: BTreeMap::new(),
        }
    }

    /// The edge of a voxel.
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// The rule that updates it.
    pub fn rule(&self) -> &R {
        &self.rule
    }

    /// Takes in one look: each voxel once. Voxels outside of the world and ignorance are left out.
    ///
    /// Fastest where neighbours in the list share a block.
    pub fn observe(&mut self, look: &Look, seen: &[(VoxelKey, Observation)]) {
        for run in seen.chunk_by(|(a, _), (b, _)| block_of(*a) == block_of(*b)) {
            let mut known = run
                .iter()
                .filter(|(key, seen)| key.is_in_world() && !seen.mass.is_unknown())
                .peekable();
            let Some((first, _)) = known.peek() else {
                continue;
            };
            let block = self
                .blocks
                .entry(block_of(*first))
                .or_insert_with(Block::new);
            for (key, seen) in known {
                let index = voxel_index(*key);
                block.seen[index / 64] |= 1 << (index % 64);
                self.rule.observe(&mut block.states[index], look, seen);
            }
        }
    }

    /// Takes in all that a map knows, as one look at the time it was made: its log-odds as the least committed masses, its
    /// classes by what they can do.
    pub fn seed(&mut self, map: &VoxelMap, look: &Look, mobility: impl Fn(ClassId) -> Mobility) {
        let seen: Vec<_> = map
            .known()
            .map(|(key, voxel)| {
                let observation = Observation {
                    mass: Mass::least_committed(voxel.log_odds.probability() as f32),
                    mobility: mobility(voxel.class),
                    detection: None,
                };
                (key, observation)
            })
            .collect();
        self.observe(look, &seen);
    }

    /// What is believed of a voxel at `now`.
    pub fn mass(&self, key: VoxelKey, now: Stamp) -> Mass {
        self.state(key)
            .map_or(Mass::UNKNOWN, |state| self.rule.mass(state, now))
    }

    /// What the rule keeps of a voxel; `None` if nobody spoke of it.
    pub fn state(&self, key: VoxelKey) -> Option<&R::State> {
        self.blocks.get(&block_of(key))?.get(voxel_index(key))
    }

    /// Every voxel that somebody spoke of, ordered by block and place in the block.
    pub fn states(&self) -> impl Iterator<Item = (VoxelKey, &R::State)> {
        self.blocks.iter().flat_map(|(at, block)| {
            (0..VOLUME).filter_map(move |index| Some((key_of(*at, index), block.get(index)?)))
        })
    }

    /// A voxel map of what is believed at `now`: a voxel is occupied from a probability of `occupied_from` on, which must
    /// be above 0 and below 1. What is wholly unknown stays unknown.
    pub fn to_voxel_map(&self, now: Stamp, occupied_from: f64) -> VoxelMap {
        let mut map = VoxelMap::new(self.resolution_m);
        let logit = |p: f64| (p / (1.0 - p)).ln();
        for (key, state) in self.states() {
            let mass = self.rule.mass(state, now);
            if !mass.is_unknown() {
                let odds = logit(f64::from(mass.probability())) - logit(occupied_from);
                map.set_voxel(key, Voxel::new(LogOdds::nearest(odds)));
            }
        }
        map
    }
}

fn block_of(key: VoxelKey) -> [i32; 3] {
    [key.z >> 3, key.y >> 3, key.x >> 3]
}

fn key_of([z, y, x]: [i32; 3], index: usize) -> VoxelKey {
    let at = |block: i32, shift: usize| block << 3 | i32::from((index >> shift & 7) as u8);
    VoxelKey::new(at(x, 0), at(y, 3), at(z, 6))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::evidence::{LogOddsRule, Source, Tandem, View};
    use crate::voxel::Occupancy;

    const LOOK: Look = Look {
        source: Source::Ugv,
        at: Stamp::ZERO,
        view: View(0),
    };

    fn hit() -> Observation {
        Observation {
            mass: Mass::occupied_by(0.7),
            ..Observation::default()
        }
    }

    proptest! {
        #[test]
        fn states_are_found_where_they_were_put_and_listed_in_order(
            keys in prop::collection::vec(prop::array::uniform3(-40_i32..40), 1..40)
        ) {
            let keys: Vec<_> = keys.into_iter().map(|[x, y, z]| VoxelKey::new(x, y, z)).collect();
            let mut map = EvidenceMap::new(Tandem::default(), 0.1);
            map.observe(&LOOK, &keys.iter().map(|key| (*key, hit())).collect::<Vec<_>>());
            let mut reversed = EvidenceMap::new(Tandem::default(), 0.1);
            reversed.observe(&LOOK, &keys.iter().rev().map(|key| (*key, hit())).collect::<Vec<_>>());
            let listed: Vec<_> = map.states().map(|(key, state)| (key, *state)).collect();
            prop_assert!(listed.iter().all(|(key, _)| keys.contains(key)));
            prop_assert!(keys.iter().all(|key| map.state(*key).is_some()));
            prop_assert_eq!(listed, reversed.states().map(|(key, state)| (key, *state)).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_voxel_map_seeds_a_layer_that_gives_it_back() {
        let mut map = VoxelMap::new(0.1);
        let [wall, air] = [VoxelKey::new(1, 2, 3), VoxelKey::new(-9, 0, 0)];
        map.set_voxel(wall, Voxel::new(LogOdds::MAX));
        map.set_voxel(air, Voxel::new(LogOdds::MISS));
        let mut layer = EvidenceMap::new(LogOddsRule::default(), 0.1);
        layer.seed(&map, &LOOK, |_| Mobility::Unknown);
        let back = layer.to_voxel_map(Stamp::ZERO, 0.5);
        assert_eq!(back.digest(), map.digest());
    }

    #[test]
    fn what_nobody_spoke_of_is_unknown() {
        let mut map = EvidenceMap::new(Tandem::default(), 0.1);
        let outside = VoxelKey::new(1 << 20, 0, 0);
        let nothing = Observation::default();
        map.observe(
            &LOOK,
            &[(outside, hit()), (VoxelKey::new(0, 0, 0), nothing)],
        );
        assert_eq!(map.states().count(), 0);
        assert!(map.mass(outside, Stamp::ZERO).is_unknown());
        let exported = map.to_voxel_map(Stamp::ZERO, 0.5);
        assert_eq!(
            exported.occupancy(VoxelKey::new(0, 0, 0)),
            Occupancy::Unknown
        );
    }
}
