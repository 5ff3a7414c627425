//! Which keyframes show the same place as a frame, by what its features look like.
//!
//! An inverted index of binary descriptions, without a trained vocabulary: a vocabulary is a file of tens of megabytes that
//! was learnt from somebody else's pictures with somebody else's features, and ours differ. Instead each description is
//! cut down to a few fixed random subsets of its bits (locality-sensitive hashing). Two views of one corner differ in few
//! bits and so agree in some subset; two corners differ in about half of them and hardly ever do:
//!
//! ```text
//! P(agree in a subset of k bits) = (1 - d/256)ᵏ        d = 30: 0.05    d = 110: 10⁻⁶    (k = 24)
//! score(keyframe) = Σ over values found in it  ln(1 + N/nᵥ) / ln(1 + N)        nᵥ: of N keyframes, those with the value
//! ```
//!
//! What many places have in common thus counts little. Memory: 16 bytes by subset and feature. Deterministic.
//!
//! - P. Indyk, R. Motwani, *Approximate Nearest Neighbors*, STOC 1998 (subsets of bits as hashes).
//! - J. Sivic, A. Zisserman, *Video Google*, ICCV 2003 (rarity as weight).

use std::collections::BTreeMap;

use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng as _, SeedableRng as _};

use crate::brief::Descriptor;
use crate::features::Feature;
use crate::map::KeyframeId;

const TABLES: usize = 8;
const BITS: usize = 24;
/// Features of a keyframe that are put into the index.
const MOST_FEATURES: usize = 500;
/// Lists of each table.
const LISTS: usize = 1 << 16;
/// A list is followed no farther than this: what is that common says nothing.
const LONGEST: usize = 64;
const SEED: u64 = 0x0070_6c61_6365;
const NONE: u32 = u32::MAX;

/// An index of keyframes by what they show.
pub(crate) struct Places {
    /// By table: the numbers of the bits in its subset.
    subsets: Vec<[u8; BITS]>,
    /// By table and list: the newest entry; empty before the first.
    heads: Vec<u32>,
    entries: Vec<Entry>,
    free: Vec<u32>,
    /// By keyframe: the lists its entries are in.
    members: BTreeMap<KeyframeId, Vec<(u32, u32)>>,
}

#[derive(Clone, Copy)]
struct Entry {
    value: u32,
    keyframe: KeyframeId,
    next: u32,
}

/// A keyframe that may show the same place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Candidate {
    pub(crate) keyframe: KeyframeId,
    /// Larger is more alike; only to be compared with others of the same features.
    pub(crate) score: f64,
}

impl Default for Places {
    fn default() -> Self {
        let mut rng = Pcg64::seed_from_u64(SEED);
        Self {
            subsets: (0..TABLES).map(|_| draw_subset(&mut rng)).collect(),
            heads: Vec::new(),
            entries: Vec::new(),
            free: Vec::new(),
            members: BTreeMap::new(),
        }
    }
}

/// Different bits, each as likely as any other.
fn draw_subset(rng: &mut Pcg64) -> [u8; BITS] {
    let mut all: Vec<u8> = (0..=255).collect();
    std::array::from_fn(|_| all.swap_remove((rng.next_u64() % all.len() as u64) as usize))
}

impl Places {
    /// Adds a keyframe; one that is in it already stays as it is.
    pub(crate) fn insert(&mut self, id: KeyframeId, features: &[Feature]) {
        if self.members.contains_key(&id) {
            return;
        }
        self.heads.resize(TABLES * LISTS, NONE);
        let mut places = Vec::new();
        for feature in indexed(features) {
            for table in 0..TABLES {
                let value = self.value(table, &feature.descriptor);
                let list = list_of(table, value);
                places.push((list, value));
            }
        }
        // Two features of a keyframe with the same value count once.
        places.sort_unstable();
        places.dedup();
        for &(list, value) in &places {
            let entry = Entry {
                value,
                keyframe: id,
                next: self.heads[list as usize],
            };
            let at = if let Some(at) = self.free.pop() {
                self.entries[at as usize] = entry;
                at
            } else {
                self.entries.push(entry);
                self.entries.len() as u32 - 1
            };
            self.heads[list as usize] = at;
        }
        self.members.insert(id, places);
    }

    /// Removes a keyframe, if it is there.
    pub(crate) fn remove(&mut self, id: KeyframeId) {
        for (list, value) in self.members.remove(&id).unwrap_or_default() {
            let mut before = NONE;
            let mut at = self.heads[list as usize];
            while at != NONE {
                let entry = self.entries[at as usize];
                if entry.keyframe == id && entry.value == value {
                    if before == NONE {
                        self.heads[list as usize] = entry.next;
                    } else {
                        self.entries[before as usize].next = entry.next;
                    }
                    self.free.push(at);
                    break;
                }
                (before, at) = (at, entry.next);
            }
        }
    }

    /// All keyframes that are alike in something, the most alike first.
    pub(crate) fn query(&self, features: &[Feature]) -> Vec<Candidate> {
        let Some((newest, _)) = self.members.last_key_value() else {
            return Vec::new();
        };
        let mut scores = vec![0.0; newest.0 as usize + 1];
        let all = self.members.len() as f64;
        let mut asked: Vec<(u32, u32)> = indexed(features)
            .flat_map(|f| (0..TABLES).map(|table| (table, self.value(table, &f.descriptor))))
            .map(|(table, value)| (list_of(table, value), value))
            .collect();
        asked.sort_unstable();
        asked.dedup();
        let mut having = Vec::new();
        for (list, value) in asked {
            having.clear();
            let mut at = self.heads[list as usize];
            for _ in 0..LONGEST {
                let Some(entry) = self.entries.get(at as usize) else {
                    break;
                };
                if entry.value == value {
                    having.push(entry.keyframe);
                }
                at = entry.next;
            }
            let rarity = (all / having.len().max(1) as f64).ln_1p() / all.ln_1p();
            for id in &having {
                scores[id.0 as usize] += rarity;
            }
        }
        let scores = (0..).map(KeyframeId).zip(scores);
        let mut found: Vec<Candidate> = scores
            .filter(|&(_, score)| score > 0.0)
            .map(|(keyframe, score)| Candidate { keyframe, score })
            .collect();
        found.sort_by(|a, b| {
            b.score
                .total_cmp(&a.score)
                .then(a.keyframe.cmp(&b.keyframe))
        });
        found
    }

    fn value(&self, table: usize, descriptor: &Descriptor) -> u32 {
        let bits = self.subsets[table].iter();
        bits.fold(0, |value, &bit| value << 1 | u32::from(descriptor.bit(bit)))
    }
}

/// At most [`MOST_FEATURES`] of them, evenly picked over the pyramid levels and the image.
fn indexed(features: &[Feature]) -> impl Iterator<Item = &Feature> {
    features
        .iter()
        .step_by(features.len().div_ceil(MOST_FEATURES).max(1))
}

/// The list of a value: its bits, mixed, among those of its table.
fn list_of(table: usize, value: u32) -> u32 {
    let mixed = value.wrapping_mul(0x9e37_79b1) >> 16;
    (table * LISTS) as u32 + mixed
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feature(descriptor: Descriptor) -> Feature {
        Feature {
            raw: [1.0, 1.0],
            ideal: [1.0, 1.0],
            octave: 0,
            depth_m: None,
            is_far: false,
            descriptor,
        }
    }

    /// The features of place `seed`: random bits, of which `off` differ from one view to the other.
    fn view(seed: u64, off: usize, noise: u64) -> Vec<Feature> {
        let mut place = Pcg64::seed_from_u64(seed);
        let mut noise = Pcg64::seed_from_u64(noise);
        (0..300)
            .map(|_| {
                let mut words: [u64; 4] = std::array::from_fn(|_| place.next_u64());
                for _ in 0..off {
                    let bit = noise.next_u64() % 256;
                    words[(bit / 64) as usize] ^= 1 << (bit % 64);
                }
                feature(Descriptor::from_words(words))
            })
            .collect()
    }

    fn indexed_places(count: u32) -> Places {
        let mut places = Places::default();
        for i in 0..count {
            places.insert(KeyframeId(i), &view(u64::from(i), 0, 0));
        }
        places
    }

    #[test]
    fn a_place_is_recognised_from_another_view_among_many() {
        let places = indexed_places(60);
        for place in [0u32, 17, 59] {
            let found = places.query(&view(u64::from(place), 30, 7));
            assert_eq!(found[0].keyframe, KeyframeId(place));
            let next = found.get(1).map_or(0.0, |c| c.score);
            assert!(found[0].score > 5.0 * next, "{found:?} is not clear");
        }
    }

    #[test]
    fn what_all_places_have_in_common_counts_little() {
        let mut places = Places::default();
        let common = view(1000, 0, 0);
        for i in 0..40 {
            let own = view(u64::from(i), 0, 0);
            let both: Vec<Feature> = [&common[..250], &own[..50]].concat();
            places.insert(KeyframeId(i), &both);
        }
        let asked: Vec<Feature> = [&common[..250], &view(9, 20, 5)[..50]].concat();
        let found = places.query(&asked);
        assert_eq!(found[0].keyframe, KeyframeId(9));
        assert!(found[0].score > 1.05 * found[1].score, "{found:?}");
    }

    #[test]
    fn a_removed_keyframe_is_not_found_and_leaves_no_memory() {
        let mut places = indexed_places(20);
        let (entries, before) = (places.entries.len(), places.query(&view(3, 0, 0)));
        assert_eq!(before[0].keyframe, KeyframeId(3));
        places.remove(KeyframeId(3));
        let found = places.query(&view(3, 0, 0));
        assert!(
            found.iter().all(|c| c.keyframe != KeyframeId(3)),
            "{found:?}"
        );
        for _ in 0..50 {
            places.insert(KeyframeId(3), &view(3, 0, 0));
            places.remove(KeyframeId(3));
        }
        places.insert(KeyframeId(3), &view(3, 0, 0));
        assert_eq!(places.entries.len(), entries);
        assert_eq!(places.query(&view(3, 0, 0))[0].keyframe, KeyframeId(3));
        for i in 0..20 {
            places.remove(KeyframeId(i));
        }
        assert_eq!(places.free.len(), places.entries.len());
        assert!(places.heads.iter().all(|&head| head == NONE));
    }

    #[test]
    fn an_empty_index_knows_no_place() {
        assert!(Places::default().query(&view(2, 0, 0)).is_empty());
    }
}
