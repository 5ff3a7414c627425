//! Keyframes as witnesses: what each of them saw where a frame now measures something.

use std::time::Duration;

use maps::time::Stamp;
use nalgebra::{Isometry3, Vector3};

use crate::coarse::{Coarse, clear_of};
use crate::drift::Drift;
use crate::map::{Keyframe, KeyframeId, Map};
use crate::optics::{Fast, Optics};

/// Keyframes that are asked about a frame.
const WITNESSES: usize = 6;
/// How far in front of a known surface is strong evidence, weak evidence, and none at all, in units of `clear_of`.
const STRONG: f32 = 1.5;
const WEAK: f32 = 0.7;
const CONFIRMING: f32 = 0.5;

/// So many who confirm a surface are enough if none of them was of another opinion.
const ENOUGH: u8 = 2;
/// Witnesses closer together in time than this have seen the same thing: one of them is enough.
const SPACING: Duration = Duration::from_millis(250);
/// Within this time drift is too small to show space where there is none, so that the order of what was seen counts.
const RECENT: Duration = Duration::from_secs(5);

/// Drift from a witness, one standard deviation, below which even what is weakly free was free.
const SOUND_M: f64 = 0.05;

/// What the witnesses say about a cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Votes {
    pub(super) confirm: u8,
    pub(super) weak: u8,
    pub(super) strong: u8,
    /// Of the strong ones, those of the last seconds before anybody has confirmed the surface: somebody came; or, in the
    /// midst of others, of the next seconds after all who have: somebody left. What came and is confirmed later has stayed.
    pub(super) apart: u8,
    /// Of the weak ones, the strong ones included, those from which the frame has not drifted.
    pub(super) sound: u8,
    pub(super) confirmed_before: bool,
    /// By somebody who looked long ago, or long after.
    pub(super) confirmed_long_ago: bool,
}

impl Votes {
    /// Whether so many more voices cannot change the verdict, or are not worth hearing: the oldest have spoken first, and
    /// what they all know stands. Of a keyframe in the midst of others, the last word is that of the last one.
    fn is_decided(self, more: u8, is_newest: bool) -> bool {
        let known = self.weak == 0 && self.confirm >= ENOUGH;
        self.strong > self.confirm + more
            || (is_newest && (known || self.confirm > self.weak + more))
    }

    /// Whether the surface is confirmed beyond what somebody who walks slowly may be. `most` is how many
    /// confirm any surface of the picture: where there are not two to ask, one is enough.
    pub(super) fn is_sure(self, most: u8) -> bool {
        self.confirm >= ENOUGH.min(most) || self.confirmed_long_ago
    }

    fn weak(&mut self, by: Standpoint) {
        self.weak += 1;
        self.sound += u8::from(by.is_sound);
    }

    fn strong(&mut self, by: Standpoint) {
        self.strong += 1;
        self.weak(by);
        let counts = match by.when {
            When::Before => !self.confirmed_before,
            When::After => true,
            When::LongAgo => false,
        };
        self.apart += u8::from(counts);
    }

    fn confirm(&mut self, by: Standpoint) {
        self.confirm += 1;
        match by.when {
            When::Before => self.confirmed_before = true,
            When::After => self.apart = 0,
            When::LongAgo => self.confirmed_long_ago = true,
        }
    }
}

/// When a witness looked: before the frame or after it, or so much apart from it that its order does not matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum When {
    LongAgo,
    Before,
    After,
}

/// How a witness is related to the frame.
#[derive(Clone, Copy, Debug)]
struct Standpoint {
    when: When,
    /// Whether the frame has next to not drifted from it, so that what is weakly free is not drift.
    is_sound: bool,
}

/// The frame that is judged.
pub(super) struct Judged<'a> {
    pub(super) at: Stamp,
    pub(super) pose: &'a Isometry3<f64>,
    pub(super) coarse: &'a Coarse,
    /// How far it may be off.
    pub(super) drift: Drift,
    /// Its name, if it is a keyframe itself.
    pub(super) id: Option<KeyframeId>,
}

impl Judged<'_> {
    fn standpoint(&self, witness: &Keyframe) -> Standpoint {
        let when = self.when(witness.at);
        let is_sound = when != When::LongAgo || self.drift.apart_m(&witness.drift) < SOUND_M;
        Standpoint { when, is_sound }
    }

    fn when(&self, at: Stamp) -> When {
        match () {
            () if between(at, self.at) > RECENT => When::LongAgo,
            () if at < self.at => When::Before,
            () => When::After,
        }
    }
}

fn between(a: Stamp, b: Stamp) -> Duration {
    a.max(b).since(a.min(b))
}

/// What the keyframes that know most say about each cell of a frame.
pub(super) fn votes(optics: &Optics, map: &Map, frame: &Judged<'_>) -> Vec<Votes> {
    hear(optics, map, frame, &choose(optics, map, frame))
}

/// The keyframes that know most about what is in view: greedily, each next one for what the others leave open. Oldest
/// first.
fn choose(optics: &Optics, map: &Map, frame: &Judged<'_>) -> Vec<KeyframeId> {
    let coarse = frame.coarse;
    let step = (optics.cells_across / 14).max(1);
    let samples: Vec<Vector3<f32>> = (0..optics.cell_count())
        .filter(|cell| {
            let (column, row) = (cell % optics.cells_across, cell / optics.cells_across);
            column % step == step / 2 && row % step == step / 2 && coarse.depth_m[*cell] > 0.0
        })
        .map(|cell| optics.cell_point(cell, coarse.depth_m[cell]))
        .collect();
    let mut candidates: Vec<(KeyframeId, Stamp, Vec<bool>)> = map
        .keyframes
        .iter()
        .filter(|(id, _)| Some(**id) != frame.id)
        .map(|(&id, k)| {
            let relative = Fast::new(&(k.world_from_camera.inverse() * frame.pose));
            let informs = |p: &Vector3<f32>| informs(optics, &k.coarse, &relative.apply(p));
            (id, k.at, samples.iter().map(informs).collect())
        })
        .collect();
    let mut heard = vec![0u32; samples.len()];
    let mut chosen = Vec::new();
    while chosen.len() < WITNESSES && !candidates.is_empty() {
        let worth = |(.., informs): &(KeyframeId, Stamp, Vec<bool>)| -> u32 {
            let by = informs.iter().zip(&heard).filter(|(i, _)| **i);
            by.map(|(_, &count)| 16 >> (2 * count).min(5)).sum()
        };
        let ranked = candidates
            .iter()
            .enumerate()
            .map(|(i, c)| (worth(c), c.0, i));
        let Some((1.., id, best)) = ranked.max() else {
            break;
        };
        let (_, at, informs) = candidates.swap_remove(best);
        candidates.retain(|(_, other, _)| between(*other, at) >= SPACING);
        for (count, _) in heard.iter_mut().zip(&informs).filter(|(_, i)| **i) {
            *count += 1;
        }
        chosen.push(id);
    }
    chosen.sort_unstable();
    chosen
}

/// Whether a keyframe saw the static surface at or behind a point in its camera.
fn informs(optics: &Optics, coarse: &Coarse, p: &Vector3<f32>) -> bool {
    optics.cell_of(p).is_some_and(|cell| {
        let (near, far) = (coarse.near_m[cell], coarse.far_m[cell]);
        near > 0.0 && !coarse.moving[cell] && p.z < far + clear_of(far)
    })
}

fn hear(optics: &Optics, map: &Map, frame: &Judged<'_>, witnesses: &[KeyframeId]) -> Vec<Votes> {
    let (pose, coarse) = (frame.pose, frame.coarse);
    let mut votes = vec![Votes::default(); optics.cell_count()];
    let asked = witnesses.iter().filter_map(|id| map.keyframes.get(id));
    for (k, to_come) in asked.zip((0..witnesses.len() as u8).rev()) {
        let relative = Fast::new(&(k.world_from_camera.inverse() * pose));
        // One cell of displacement is in `near_m` already.
        let slip = (coarse.slip + k.coarse.slip).saturating_sub(1);
        let slack_m = k.coarse.near_within(optics.cells_across, slip);
        let by = frame.standpoint(k);
        for (cell, vote) in votes.iter_mut().enumerate() {
            let depth = coarse.depth_m[cell];
            if depth > 0.0 && !vote.is_decided(to_come + 1, frame.id.is_none()) {
                let p = relative.apply(&optics.cell_point(cell, depth));
                cast_vote(optics, (&k.coarse, &slack_m), &p, (vote, by));
            }
        }
    }
    votes
}

/// Free space is judged by the nearest surface that either image may show here, displaced as they are; a surface is
/// known again only where it is.
fn cast_vote(
    optics: &Optics,
    (witness, slack_m): (&Coarse, &[f32]),
    p: &Vector3<f32>,
    (vote, by): (&mut Votes, Standpoint),
) {
    let Some(cell) = optics.cell_of(p) else {
        return;
    };
    let (near, far) = (witness.near_m[cell], witness.far_m[cell]);
    if near <= 0.0 || p.z > far + clear_of(far) {
        return;
    }
    let in_front = |near: f32| (near - p.z) / clear_of(near);
    let gap = in_front(slack_m[cell]);
    if gap > STRONG {
        vote.strong(by);
    } else if gap > WEAK {
        vote.weak(by);
    } else if in_front(near) < CONFIRMING && !witness.moves_evidently(cell) {
        vote.confirm(by);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What witnesses say, in the order in which they looked: `f`ree, `c`onfirmed; `|` is the frame that is judged, and
    /// capitals looked long ago.
    fn heard(said: &str) -> Votes {
        let mut votes = Votes::default();
        let mut is_over = false;
        for word in said.chars() {
            let when = match word {
                'F' | 'C' => When::LongAgo,
                _ if is_over => When::After,
                _ => When::Before,
            };
            let by = Standpoint {
                when,
                is_sound: when != When::LongAgo,
            };
            match word.to_ascii_lowercase() {
                'f' => votes.strong(by),
                'c' => votes.confirm(by),
                _ => is_over = true,
            }
        }
        votes
    }

    #[test]
    fn who_came_and_who_left_are_told_by_the_order_of_the_witnesses() {
        for (said, apart) in [
            ("ffccc|", 2),
            ("cfcfc|", 0),
            ("cc|ff", 2),
            ("ffc|c", 0),
            ("ffc|cff", 2),
            ("cc|fcf", 1),
            ("ccc|", 0),
        ] {
            assert_eq!(heard(said).apart, apart, "{said}");
        }
    }

    #[test]
    fn the_order_of_what_was_seen_long_ago_tells_nothing_and_drift_is_no_evidence() {
        let votes = heard("FFFcc|");
        assert_eq!((votes.strong, votes.apart, votes.sound), (3, 0, 0));
        assert_eq!(heard("CCff|").apart, 2, "what stood there then has gone");
    }

    #[test]
    fn what_the_oldest_two_confirm_is_decided_unless_somebody_disagrees() {
        assert!(heard("cc|").is_decided(4, true));
        assert!(!heard("cc|").is_decided(4, false), "it may leave later");
        assert!(!heard("fcc|").is_decided(4, true));
    }

    #[test]
    fn one_who_looked_just_before_is_not_enough_to_be_sure_of_a_surface() {
        assert!(heard("c|").is_sure(1), "there is nobody else to ask");
        for (said, is_sure) in [
            ("c|", false),
            ("|c", false),
            ("cc|", true),
            ("c|c", true),
            ("C|", true),
        ] {
            assert_eq!(heard(said).is_sure(3), is_sure, "{said}");
        }
    }
}
