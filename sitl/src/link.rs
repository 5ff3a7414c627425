//! A radio link that delays, limits, loses, repeats and reorders what is sent over it: one [`Channel`] for each direction.
//!
//! Frames leave one after the other at the rate of the link, from a buffer that drops what does not fit; then they are lost
//! or travel for the delay. Nothing here knows the time: it comes with each call, so that a channel runs in simulated time
//! as well as behind a socket. The same calls with the same seed have the same result.
//!
//! - E. Gilbert, *Capacity of a burst-noise channel*, Bell System Technical Journal 39, 1960; E. Elliott, ibid. 42, 1963.

mod profile;

use std::collections::{BTreeMap, VecDeque};

use maps::time::Stamp;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

pub use profile::{Loss, Outage, Profile};

/// What has become of the frames handed to a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChannelStats {
    /// Handed over.
    pub sent: u64,
    /// Their bytes.
    pub sent_bytes: u64,
    /// Dropped because the buffer was full.
    pub dropped: u64,
    /// Lost on the way.
    pub lost: u64,
    /// Arrived or still under way, with those that do so twice.
    pub arrived: u64,
}

/// The largest frame of MAVLink 2, without a signature. Bursts are counted in these.
const FULL_FRAME_BYTES: f64 = 280.0;

/// One direction of a link. `T` is what travels.
#[derive(Clone, Debug)]
pub struct Channel<T> {
    profile: Profile,
    random: Pcg64,
    /// When the last frame of the buffer has left.
    busy_until: Stamp,
    /// When each frame in the buffer leaves, and its bytes.
    buffer: VecDeque<(Stamp, usize)>,
    buffered: usize,
    /// Whether the last frame fell into a burst of losses, and when it left.
    is_bad: bool,
    last_left: Stamp,
    /// By arrival; what arrives at once, in the order sent.
    under_way: BTreeMap<(Stamp, u64), T>,
    /// Frames arrive in order, but for those that overtake.
    last_arrival: Stamp,
    stats: ChannelStats,
}

impl<T: Clone> Channel<T> {
    /// An empty channel.
    pub fn new(profile: Profile, seed: u64) -> Self {
        Self {
            profile,
            random: Pcg64::seed_from_u64(seed),
            busy_until: Stamp::ZERO,
            buffer: VecDeque::new(),
            buffered: 0,
            is_bad: false,
            last_left: Stamp::ZERO,
            under_way: BTreeMap::new(),
            last_arrival: Stamp::ZERO,
            stats: ChannelStats::default(),
        }
    }

    /// Hands over a frame of so many bytes. `now` must not go back.
    pub fn send(&mut self, now: Stamp, frame: T, bytes: usize) {
        self.stats.sent += 1;
        self.stats.sent_bytes += bytes as u64;
        let Some(left) = self.leave(now, bytes) else {
            self.stats.dropped += 1;
            return;
        };
        if self.loses(left) || self.profile.outages.iter().any(|o| o.covers(left)) {
            self.stats.lost += 1;
            return;
        }
        let copies = 1 + usize::from(self.happens(self.profile.repeat));
        for _ in 0..copies {
            let arrival = self.arrival(left);
            self.stats.arrived += 1;
            self.under_way
                .insert((arrival, self.stats.arrived), frame.clone());
        }
    }

    /// When a frame has left the buffer; `None` if it does not fit in.
    fn leave(&mut self, now: Stamp, bytes: usize) -> Option<Stamp> {
        let Some(rate) = self.profile.bytes_per_second else {
            return Some(now);
        };
        while let Some(&(left, size)) = self.buffer.front()
            && left <= now
        {
            self.buffer.pop_front();
            self.buffered -= size;
        }
        if self.buffered + bytes > self.profile.buffer_bytes && !self.buffer.is_empty() {
            return None;
        }
        let span = std::time::Duration::from_secs_f64(bytes as f64 / rate);
        self.busy_until = self.busy_until.max(now) + span;
        self.buffer.push_back((self.busy_until, bytes));
        self.buffered += bytes;
        Some(self.busy_until)
    }

    fn loses(&mut self, left: Stamp) -> bool {
        match self.profile.loss {
            Loss::Even(share) => self.happens(share),
            loss @ Loss::Bursts { .. } => {
                let passed = left.since(std::mem::replace(&mut self.last_left, left));
                // Where frames take no time, they are the clock.
                let frames = (self.profile.bytes_per_second)
                    .map_or(1.0, |rate| passed.as_secs_f64() * rate / FULL_FRAME_BYTES);
                self.is_bad = self.happens(loss.chance_after(frames, self.is_bad));
                self.is_bad
            }
        }
    }

    fn arrival(&mut self, left: Stamp) -> Stamp {
        let jitter = self.profile.jitter.mul_f64(self.random.random());
        let arrival = left + self.profile.delay + jitter;
        if self.happens(self.profile.overtake) {
            // It takes a way of its own, and those behind do not wait for it.
            return arrival
                + self
                    .profile
                    .delay
                    .mul_f64(0.5 * self.random.random::<f64>());
        }
        self.last_arrival = self.last_arrival.max(arrival);
        self.last_arrival
    }

    fn happens(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.random.random_bool(probability.min(1.0))
    }

    /// Lets nothing through for a span, besides what the profile says.
    pub fn fail(&mut self, outage: Outage) {
        self.profile.outages.push(outage);
    }

    /// What has arrived by now, in that order.
    pub fn arrived(&mut self, now: Stamp) -> Vec<T> {
        let later = self.under_way.split_off(&(now, u64::MAX));
        std::mem::replace(&mut self.under_way, later)
            .into_values()
            .collect()
    }

    /// When the next frame arrives.
    pub fn next_arrival(&self) -> Option<Stamp> {
        self.under_way.keys().next().map(|(at, _)| *at)
    }

    /// Counts since the start.
    pub fn stats(&self) -> ChannelStats {
        self.stats
    }
}

#[cfg(test)]
mod tests;
