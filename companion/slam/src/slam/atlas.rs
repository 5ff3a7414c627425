//! The place is lost: it is sought in all maps, and where that is in vain for long, a new map begins.

use maps::camera::RgbdFrame;
use nalgebra::Matrix6;

use super::{FEWEST_TO_START, Slam, UNKNOWN};
use crate::aid::Aid;
use crate::map::{Map, Standing};
use crate::mapping;
use crate::matching::Sighting;
use crate::motion::Motion;
use crate::solver::Fit;
use crate::tracked::State;
use crate::tracking::{self, Located};

/// Maps that are kept beside the one in use.
const MOST_STORED: usize = 3;
/// Keyframes that make a map, left adrift, worth keeping.
const FEWEST_KEYFRAMES: usize = 5;

impl Slam {
    /// A frame whose place is not found in the map in use.
    pub(super) fn lose(&mut self, frame: &RgbdFrame, mut now: Sighting, aid: &Aid<'_>) -> bool {
        let since = match self.state {
            State::Lost { since } => since,
            State::Searching | State::Tracking => frame.at,
        };
        if since < frame.at
            && let Some(fit) = self.find_elsewhere(&mut now, aid)
        {
            return self.follow(frame, now, (&fit, aid));
        }
        now.forget_matches();
        let deep = now.features.iter().filter(|f| f.depth_m.is_some()).count();
        if frame.at.since(since) >= self.settings.sought_for && deep >= FEWEST_TO_START {
            return self.begin_anew(frame, now, aid);
        }
        self.state = State::Lost { since };
        self.last.sighting = now;
        self.last.rejected = 0;
        false
    }

    /// Seeks the place in one of the stored maps, another one each time; that map is then in use.
    fn find_elsewhere(&mut self, now: &mut Sighting, aid: &Aid<'_>) -> Option<Fit> {
        const COMPARED: usize = 2;
        let at = self.next_try.checked_rem(self.back.stored.len())?;
        let candidates = self.back.stored[at].places.query(&now.features);
        let candidates = candidates.iter().map(|c| c.keyframe);
        let candidates: Vec<_> = candidates.take(COMPARED).collect();
        std::mem::swap(&mut self.map, &mut self.back.stored[at]);
        let known = Located {
            optics: &self.optics,
            map: &self.map,
        };
        let fit = known.find_again(&candidates, now, &mut self.rng);
        let fit = fit.and_then(|fit| self.reject_moving(now, fit, aid));
        std::mem::swap(&mut self.map, &mut self.back.stored[at]);
        let fit = fit.filter(|fit| fit.agreeing >= tracking::FEWEST)?;
        let found = self.back.stored.remove(at);
        self.put_away(found);
        Some(fit)
    }

    /// A new map, whose first frame is taken to be where the place was lost, for want of anything better.
    fn begin_anew(&mut self, frame: &RgbdFrame, mut now: Sighting, aid: &Aid<'_>) -> bool {
        self.back.maps += 1;
        self.put_away(Map::adrift(self.back.maps));
        let pose = self.last.motion.pose;
        self.mark_moving(&mut now, &pose, aid);
        self.state = State::Tracking;
        self.reset_counter = self.reset_counter.wrapping_add(1);
        self.last.motion = Motion::at_rest(frame.at, self.last.motion.pose);
        self.last.covariance = Matrix6::identity() * UNKNOWN;
        self.last.sighting = now;
        self.last.rejected = 0;
        self.insert_keyframe(frame);
        self.record(frame.at);
        true
    }

    /// Puts another map into use. The one before is kept, unless there is next to nothing in it.
    fn put_away(&mut self, next: Map) {
        self.take_adjustment();
        while let Some(id) = self.window.pop_front() {
            self.settle(id);
        }
        let _of_the_map_before = self.seeker.take();
        self.back.streak.forget();
        let before = std::mem::replace(&mut self.map, next);
        let worth_keeping =
            before.standing == Standing::Joined || before.keyframes.len() >= FEWEST_KEYFRAMES;
        if worth_keeping {
            self.back.stored.push(before);
        } else {
            self.log.retain(|logged| logged.map != before.number);
        }
        self.limit_stored();
    }

    /// Stored maps leave a third of all keyframes to the map in use.
    fn limit_stored(&mut self) {
        if self.back.stored.len() > MOST_STORED {
            let adrift = |(_, map): &(usize, &Map)| map.standing == Standing::Adrift;
            let stored = self.back.stored.iter().enumerate().filter(adrift);
            if let Some((at, _)) = stored.min_by_key(|(_, map)| map.keyframes.len()) {
                let dropped = self.back.stored.remove(at);
                self.log.retain(|logged| logged.map != dropped.number);
            }
        }
        let count = |stored: &[Map]| stored.iter().map(|map| map.keyframes.len()).sum::<usize>();
        let excess = count(&self.back.stored).saturating_sub(self.settings.max_keyframes / 3 * 2);
        if let Some(largest) = self
            .back
            .stored
            .iter_mut()
            .max_by_key(|map| map.keyframes.len())
        {
            let most = largest.keyframes.len().saturating_sub(excess);
            mapping::cull_keyframes(largest, &[], most.max(2));
        }
    }

    /// How many keyframes the map in use may have beside the stored ones.
    pub(super) fn most_keyframes(&self) -> usize {
        let stored: usize = self.back.stored.iter().map(|map| map.keyframes.len()).sum();
        self.settings.max_keyframes.saturating_sub(stored)
    }

    /// The map that keyframes of this number are in.
    pub(super) fn map_of(&self, number: u32) -> Option<&Map> {
        let mut all = std::iter::once(&self.map).chain(&self.back.stored);
        all.find(|map| map.number == number)
    }
}
